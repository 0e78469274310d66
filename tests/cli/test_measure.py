"""The `measure` command: closed forms within the errors told, whole output, and messages."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.cli.main import cli
from maquette.compiler import load
from maquette.render.tessellation import mass_properties


def run(folder: Path, text: str, *options: str) -> tuple[int, str, str]:
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    done = CliRunner().invoke(cli, ["measure", str(path), *options])
    return done.exit_code, done.stdout, done.stderr


def is_within(measured: dict[str, float], truth: float) -> bool:
    return abs(measured["value"] - truth) <= measured["error"]


R, H = 0.4, 0.3
CLOSED_FORMS = {  # (volume, area, inertia of density 1 about y)
    f"sphere({R})": (4 / 3 * math.pi * R**3, 4 * math.pi * R**2, 0.4 * R**2 * 4 / 3 * math.pi * R**3),
    f"cylinder({R}, {H})": (math.pi * R**2 * H, 2 * math.pi * R * (R + H), 0.5 * R**2 * math.pi * R**2 * H),
    f"cone({R}, {H})": (math.pi * R**2 * H / 3, math.pi * R * (R + math.hypot(R, H)), 0.3 * R**2 * math.pi * R**2 * H / 3),
    f"torus({R}, {H})": (
        2 * math.pi**2 * R * H**2, 4 * math.pi**2 * R * H, (R**2 + 0.75 * H**2) * 2 * math.pi**2 * R * H**2,
    ),
    f"difference {{ box(1); sphere({R}) }}": (
        1 - 4 / 3 * math.pi * R**3, 6 + 4 * math.pi * R**2, 1 / 6 - 0.4 * R**2 * 4 / 3 * math.pi * R**3,
    ),
    "union(round: 0.1) { box([1, 0.5, 1], center: [0, 0.25, 0]); box([0.5, 1, 1], center: [-0.25, 0.5, 0]) }": (
        0.75 + (1 - math.pi / 4) * 0.01, 4 + 2 * (0.75 + (1 - math.pi / 4) * 0.01) - 0.2 + math.pi / 20, None,
    ),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("shape", CLOSED_FORMS)
def test_closed_forms_lie_within_the_errors(tmp_path: Path, shape: str) -> None:
    volume, area, inertia = CLOSED_FORMS[shape]
    code, out, _ = run(tmp_path, shape, "--json", "--density", "2.5g/cm3")
    (part,) = json.loads(out)
    assert code == 0
    assert is_within(part["volume"], volume)
    assert is_within(part["area"], area)
    assert part["volume"]["error"] < 2e-3 * volume
    assert part["mass"]["value"] == pytest.approx(2500 * part["volume"]["value"])
    if inertia is not None:
        at = {key: part["inertia"][key][1][1] / 2500 for key in ("value", "error")}
        assert is_within(at, inertia)


THIN_AND_SMALL = {  # (volume, area) of the first object
    "torus(1, 1mm)": (2e-6 * math.pi**2, 4e-3 * math.pi**2),
    "cylinder(1mm, 2)": (2e-6 * math.pi, 2e-3 * math.pi * 2.001),
    "curve([[0, 0, 0], [2, 0, 0]], 1mm)": (2e-6 * math.pi, 2e-3 * math.pi * 2.001),
    "torus(20mm, 5mm)\nsphere(1, center: [30, 0, 0])": (1e-6 * math.pi**2, 4e-4 * math.pi**2),
    "difference { box(20mm); cylinder(5mm, 40mm) }\nsphere(1, center: [30, 0, 0])": (8e-6 - 5e-7 * math.pi, 2.4e-3 + 1.5e-4 * math.pi),
    "quadric([1, 1, 1, 0, 0, 0, 0, 0, 0, -1])": (4 / 3 * math.pi, 4 * math.pi),
}


@pytest.mark.parametrize("text", THIN_AND_SMALL)
def test_thin_shapes_and_small_ones_in_large_scenes_lie_within_the_errors(tmp_path: Path, text: str) -> None:
    volume, area = THIN_AND_SMALL[text]
    code, out, _ = run(tmp_path, text, "--json")
    assert code == 0
    part = json.loads(out)[0]
    assert is_within(part["volume"], volume)
    assert is_within(part["area"], area)


def test_a_small_object_in_a_large_scene_is_measured_by_its_own_size(tmp_path: Path) -> None:
    _, out, _ = run(tmp_path, "sphere(1mm)\nsphere(1, center: [30, 0, 0])\n", "--json")
    small, large = json.loads(out)
    assert small["volume"]["error"] < 0.01 * small["volume"]["value"]
    assert small["volume"]["value"] == pytest.approx(1e-9 * 4 / 3 * math.pi, rel=1e-3)
    assert is_within(large["volume"], 4 / 3 * math.pi)


@pytest.mark.long
def test_a_solid_whose_thin_parts_are_missing_has_no_numbers(tmp_path: Path) -> None:
    code, out, err = run(tmp_path, "shell(1mm) { sphere(1) }\n")
    assert code == 0
    assert "thinner parts are missing" in err
    assert out.splitlines()[2].startswith("  area     none: parts thinner than ")
    assert out.splitlines()[4].startswith("  volume   none: parts thinner than ")


@pytest.mark.long
@settings(deadline=None, max_examples=20)
@given(st.tuples(*[st.floats(0.1, 3.0)] * 3), st.tuples(*[st.floats(-5.0, 5.0)] * 3), st.floats(0.0, 360.0))
def test_a_box_anywhere(tmp_path_factory: pytest.TempPathFactory, size: tuple[float, ...], at: tuple[float, ...], turn: float) -> None:
    path = tmp_path_factory.mktemp("box") / "a.scene"
    path.write_text(f"box({list(size)}, center: {list(at)}, rotate: [0, {turn}deg, 0])\n", encoding="utf-8")
    (part,), _ = mass_properties.measure(load.load(path))
    assert part.volume is not None
    assert part.center is not None
    assert part.inertia is not None
    x, y, z = size
    assert float(part.volume.value) == pytest.approx(x * y * z, rel=1e-6)
    turned = math.radians(turn)
    middle = [at[0] * math.cos(turned) + at[2] * math.sin(turned), at[1], at[2] * math.cos(turned) - at[0] * math.sin(turned)]
    assert np.allclose(part.center.value, middle, atol=1e-5)
    assert float(part.inertia.value[1, 1]) == pytest.approx(x * y * z * (x * x + z * z) / 12, rel=1e-5)


def test_the_whole_output(tmp_path: Path) -> None:
    text = 'unit mm\nbox([40, 10, 20], center: [0, 5, 0], name: "base")\nbox(10, center: [0, 15, 0], name: "peg")\n'
    code, out, err = run(tmp_path, text, "--density", "1.24g/cm3")
    assert (code, err) == (0, "")
    assert (
        out
        == """\
base
  size     40 × 10 × 20 mm
  area     2800 mm²
  mesh     closed, 1 body, Euler number 2
  volume   8000 mm³
  center   [0, 5, 0] mm
  mass     9.92 g
  inertia  [413.333, 1653.33, 1405.33] g mm²
peg
  size     10 × 10 × 10 mm
  area     600 mm²
  mesh     closed, 1 body, Euler number 2
  volume   1000 mm³
  center   [0, 15, 0] mm
  mass     1.24 g
  inertia  [20.6667, 20.6667, 20.6667] g mm²
total volume  9000 mm³, mass 11.16 g
"""
    )


def test_parts_of_one_name_are_told_apart(tmp_path: Path) -> None:
    code, out, _ = run(tmp_path, 'for (k in 0..2) { sphere(0.5, center: [3 * k, 0, 0], name: "ball") }\n', "--json")
    assert code == 0
    for k, part in enumerate(json.loads(out)):
        assert part["center"]["value"][0] == pytest.approx(3 * k, abs=1e-6)
        assert max(part["center"]["error"]) < 1e-6


def test_open_surfaces_have_no_volume(tmp_path: Path) -> None:
    code, out, err = run(tmp_path, "cylinder(0.5, 1, capped: false)\nplane(y: 0)\n")
    assert code == 0
    assert "  volume   none: the surface is open" in out.splitlines()
    assert "has no caps" in err
    assert "is unbounded and is left out" in err


@pytest.mark.parametrize(
    ("text", "options", "code", "message"),
    [
        ("sphere(1)", ("--density", "3mm"), 2, "a density is written 1.24g/cm3 or 7850kg/m3, and is more than 0"),
        ("plane(y: 0)", (), 1, "the scene has no bounded surface to measure"),
        ('sphere(1, name: "ball")', ("--only", "bal"), 2, "did you mean `ball`?"),
    ],
)
def test_messages(tmp_path: Path, text: str, options: tuple[str, ...], code: int, message: str) -> None:
    exit_code, _, err = run(tmp_path, text, *options)
    assert (exit_code, message in err) == (code, True), err


CUBE = "OFF\n8 12 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n1 0 1\n1 1 1\n0 1 1\n"
FACES = "3 3 2 1\n3 3 1 0\n3 4 5 6\n3 4 6 7\n3 0 1 5\n3 0 5 4\n3 1 2 6\n3 1 6 5\n3 2 3 7\n3 2 7 6\n3 3 0 4\n3 3 4 7\n"


@pytest.mark.parametrize(
    ("faces", "mesh", "volume"),
    [
        (FACES, "closed, 1 body, Euler number 2", "1 m³"),
        (FACES.replace("3 3 2 1", "3 1 2 3"), "closed, not wound one way, 1 body, Euler number 2",
         "none: neighbouring faces are wound against each other"),
        (FACES.replace("3 3 2 1\n", ""), "open at 3 edges, 1 body, Euler number 1", "none: the surface is open"),
        ("".join(f"3 {c} {b} {a}\n" for _, a, b, c in map(str.split, FACES.splitlines())), "closed, 1 body, Euler number 2",
         "none: its faces point inwards"),
    ],
    ids=["closed", "wound", "open", "inwards"],
)  # fmt: skip
def test_a_mesh_that_bounds_no_volume_has_no_number(tmp_path: Path, faces: str, mesh: str, volume: str) -> None:
    path = tmp_path / "cube.off"
    path.write_text(CUBE.replace("8 12", f"8 {len(faces.splitlines())}") + faces)
    done = CliRunner().invoke(cli, ["measure", str(path), "--density", "1"])
    assert done.exit_code == 0
    assert done.stdout.splitlines()[3:5] == [f"  mesh     {mesh}", f"  volume   {volume}"]
    assert ("mass" in done.stdout) == volume.startswith("1")
    (part,) = json.loads(CliRunner().invoke(cli, ["measure", str(path), "--json"]).stdout)
    assert (part["volume"] is None) == bool(part["no_volume"]) == volume.startswith("none")


def test_a_surface_that_crosses_itself_has_no_volume(tmp_path: Path) -> None:
    path = tmp_path / "two.off"
    points = CUBE.split("\n")[2:10]
    shifted = [" ".join(str(float(x) + step) for x, step in zip(point.split(), (0.5, 0.3, 0.2), strict=True)) for point in points]
    second = "".join(f"3 {int(a) + 8} {int(b) + 8} {int(c) + 8}\n" for _, a, b, c in map(str.split, FACES.splitlines()))
    path.write_text("OFF\n16 24 0\n" + "\n".join([*points, *shifted]) + "\n" + FACES + second)
    done = CliRunner().invoke(cli, ["measure", str(path)])
    assert "  volume   none: the surface crosses itself in " in done.stdout


# --- light -------------------------------------------------------------------------------------------------------------

LIT = """
box(size: [40, 1, 40], center: [0, -0.5, 0], material: lambert(0), name: "floor")
point([0, 2, 0], flux: 1000lm, name: "bulb")
translate([0, 0, -3]) { sphere(10cm, material: emissive(#ffffff, luminance: 5000nit), name: "globe") }
meter(name: "under")
meter([1, 0, 0], size: [2, 1], grid: [2, 1], name: "desk")
camera([0, 1, 3], look_at: [0, 0.5, 0])
render(size: [32, 24])
"""


def test_meters_are_told_after_the_parts(tmp_path: Path) -> None:
    code, out, _ = run(tmp_path, LIT)
    assert code == 0
    assert out.startswith("floor\n  size     40 × 1 × 40 m\n")
    assert "under\n  illuminance  " in out
    assert "desk\n  illuminance  " in out
    assert "lx, mean of 2 × 1 cells\n" in out
    assert " lm on 2 m²\n" in out


def test_one_meter_as_json_and_csv(tmp_path: Path) -> None:
    code, out, _ = run(tmp_path, LIT, "--meter", "desk", "--json", "-o", str(tmp_path / "a.csv"), "-o", str(tmp_path / "a.json"))
    assert code == 0
    data = json.loads(out)
    assert data == json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    (meter,) = data["meters"]
    assert meter["name"] == "desk"
    assert meter["area"] == pytest.approx(2.0)
    assert is_within(meter["uniformity"], meter["least"]["value"] / meter["mean"]["value"])
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()))
    cells = [row for row in rows if row["quantity"] == "illuminance"]
    assert [(row["column"], row["row"], row["x"], row["unit"]) for row in cells] == [("0", "0", "0.5", "lx"), ("1", "0", "1.5", "lx")]
    assert [float(row["value"]) for row in cells] == pytest.approx(meter["cells"]["value"][0], rel=1e-5)


def test_luminance_glare_and_daylight(tmp_path: Path) -> None:
    code, out, err = run(tmp_path, LIT, "--luminance", "16,12", "--glare", "--daylight-factor", "--meter", "under")
    assert code == 0
    assert "under\n  illuminance  " in out
    assert "under, daylight factor under the CIE overcast sky\n  mean  " in out
    assert "pixel 16,12\n  luminance    " in out
    assert "glare at the camera\n  UGR          none: there is no light behind the lamps\n" in out
    assert "bulb is a point, which has no luminance: the glare rating leaves it out" in err


def test_false_colours(tmp_path: Path) -> None:
    code, out, _ = run(tmp_path, LIT, "-o", str(tmp_path / "a.png"))
    assert (code, out) == (0, "")
    assert (tmp_path / "a.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_a_scene_without_meters_is_told_as_before(tmp_path: Path) -> None:
    code, out, _ = run(tmp_path, "sphere(1)", "--json")
    assert code == 0
    assert isinstance(json.loads(out), list)


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (LIT, ("--meter", "desc"), "Error: no meter is called `desc`; did you mean `desk`?"),
        (LIT, ("--luminance", "32,1"), "Error: the pixel 32,1 is outside of the picture of 32x24 pixels"),
        (LIT, ("--luminance", "1"), "a crop is written x0,y0,x1,y1, in pixels from the top left"),
        (LIT, ("--luminance", "-1,2"), "a pixel is written x,y, and a region x0,y0,x1,y1, in pixels from the top left"),
        (LIT, ("-o", "a.txt"), "Error: measurements are written as .json, .csv (light) or .png (luminance): a.txt is none of them"),
        (LIT, ("-o", "a.csv", "-o", "./a.csv"), "Error: two files of -o are the same"),
        (LIT, ("-o", "nowhere/a.csv"), "error: there is no folder nowhere to write a.csv into"),
        (
            "sphere(1)", ("-o", "a.csv"),
            "Error: a .csv holds light, and the scene has no light meter; place meter([0, 75cm, 0], size: [2, 1])",
        ),
        ("sphere(1)", ("--daylight-factor",), "Error: the scene has no light meter, of which daylight factors are; place meter("),
        ('sphere(1)\nmeter(on: ["ball"])', (), "a.scene:2:1: error: the meter `meter` has no surface: no instance is called `ball`"),
    ],
)  # fmt: skip
def test_messages_of_light(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, options: tuple[str, ...], message: str) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = run(tmp_path, text, *options)
    assert code != 0
    assert message in err
