"""The `check` command on files that have more than is drawn."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner
from maquette.cli.main import cli


def test_strict_counts_warnings_as_errors(tmp_path):
    stage = tmp_path / "x.usda"
    stage.write_text('#usda 1.0\ndef Cube "c" {\n}\ndef Volume "n" {\n}\n')
    plain = CliRunner().invoke(cli, ["check", str(stage)])
    assert (plain.exit_code, plain.stdout) == (0, f"{stage}: no errors\n")
    hint = "write its grid as an array (docs/media.md says how), and fill a box with medium(density: volume(…))"
    assert plain.stderr == f"{stage}</n>: warning: Volume is not drawn: {hint}\n"
    strict = CliRunner().invoke(cli, ["check", str(stage), "--strict"])
    assert (strict.exit_code, strict.stdout) == (1, f"{stage}: 1 error\n")
    assert strict.stderr == f"{stage}</n>: error: Volume is not drawn: {hint}\n"


def test_inspect_sums_up_a_stage(tmp_path):
    stage = tmp_path / "x.usda"
    stage.write_text(
        '#usda 1.0\n(\n    startTimeCode = 1\n    endTimeCode = 9\n    upAxis = "Z"\n    metersPerUnit = 0.01\n)\n'
        'def Xform "a" (\n    variants = { string shape = "ball" }\n    prepend variantSets = "shape"\n) {\n'
        '    variantSet "shape" = {\n        "ball" {\n def Sphere "s" {\n }\n }\n        "box" {\n def Cube "s" {\n }\n }\n    }\n}\n'
    )
    done = CliRunner().invoke(cli, ["inspect", str(stage)])
    assert done.exit_code == 0
    assert done.stdout.splitlines()[1:5] == [
        "prims: 2 (1 Xform, 1 Sphere)",
        "axes: Z up, 0.01 m a unit",
        "time codes: 1 to 9, 24 a second",
        "variants: /a:shape=ball (ball, box)",
    ]


@pytest.mark.long
def test_of_many_diagnostics_the_first_are_shown(tmp_path):
    scene = tmp_path / "x.scene"
    unused, unknown = (f"let a{k} = {k}\n" for k in range(103)), (f"sphere(b{k})\n" for k in range(1200))
    scene.write_text("".join(unused) + "".join(unknown) + "camera([0, 1, 5])\n")
    done = CliRunner().invoke(cli, ["check", str(scene)])
    assert (done.exit_code, done.stdout) == (1, f"{scene}: 1200 errors\n")
    lines = done.stderr.splitlines()
    assert sum(": error: " in line for line in lines) == sum(": warning: " in line for line in lines) == 100
    assert lines[-2:] == [
        "3 more warnings: `maquette check --json` shows all",
        "1,100 more errors: `maquette check --json` shows all",
    ]
    data = json.loads(CliRunner().invoke(cli, ["check", str(scene), "--json"]).stdout)
    assert len(data) == 1303


@pytest.mark.parametrize(
    ("faces", "messages"),
    [
        ("3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n", ["note: 4 triangles: closed, 1 body, Euler number 2"]),
        ("3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n", ["note: 4 triangles: closed, 1 body, Euler number 2",
                                                   "warning: the mesh has faces that all point inwards"]),
        ("3 0 2 1\n3 0 1 3\n3 0 3 2\n3 3 2 1\n", ["note: 4 triangles: closed, 1 body, Euler number 2",
                                                   "warning: the mesh has faces that are wound against their neighbours"]),
        ("3 0 2 1\n3 0 1 3\n3 0 3 2\n", ["note: 3 triangles: open at 3 edges, 1 body, Euler number 1"]),
    ],
    ids=["closed", "inwards", "wound", "open"],
)  # fmt: skip
@pytest.mark.parametrize("inside", [False, True], ids=["file", "scene"])
def test_meshes_of_files_are_told_to_be_closed_or_open(tmp_path: Path, faces: str, messages: list[str], inside: bool) -> None:
    mesh = tmp_path / "a.off"
    mesh.write_text(f"OFF\n4 {len(faces.splitlines())} 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{faces}")
    (tmp_path / "a.scene").write_text('mesh("a.off")\nsphere(1)\nsun()\n')
    done = CliRunner().invoke(cli, ["check", str(tmp_path / "a.scene" if inside else mesh)])
    assert done.exit_code == 0
    assert [line.partition("a.off: ")[2] for line in done.stderr.splitlines() if "a.off: " in line] == messages
