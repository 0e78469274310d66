"""Options of colour: configurations, displays and looks, working spaces, spaces of pictures; their messages; strips, windows, sandbox."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.compiler.io import landlock, seccomp
from maquette.render import large_images
from maquette.render.image import image_reader

from ..compiler.io.test_color_config import written
from ..files import standing_by, write_image
from ..live.windows import served, until

SCENE = """\
plane(y: 0, material: lambert(image("a.png"SPACE)))
sphere(1, center: [0, 1, 0], material: lambert(#d0402a))
directional(from: [1, 2, 1], color: kelvin(3000))
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
render(size: [24, 40], samples: 2, backend: "reference", background: #305070)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("OCIO", raising=False)
    write_image(tmp_path / "a.png", np.full((2, 2, 3), 128, np.uint8))
    standing_by(tmp_path, monkeypatch, SCENE.replace("SPACE", ""))
    (tmp_path / "out.scene").write_text(SCENE.replace("SPACE", ', space: "out"'), encoding="utf-8")
    return tmp_path


def run(command: str, *arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli, [command, *arguments])
    return done.exit_code, done.output


def test_a_configuration_shows_its_default_view_and_has_spaces_of_pictures(folder: Path) -> None:
    name = written(folder)
    assert run("render", "out.scene", "-o", "a.exr", "-q", "--ocio", name) == (0, "")
    assert run("render", "out.scene", "-o", "a.tif", "-q", "--ocio", name, "--bits", "16") == (0, "")
    light, shown = (image_reader.read(folder / file).channels["rgba"][20, 12, :3] for file in ("a.exr", "a.tif"))
    encoded = 12.92 * shown if shown[0] < 0.0031308 else 1.055 * shown ** (1 / 2.4) - 0.055  # the reader takes it for sRGB
    assert encoded == pytest.approx(np.sqrt(np.clip(light, 0, 1)), abs=1e-4)
    code, text = run("render", "out.scene", "-o", "o.png", "-q")
    assert (code, "no colour space is called `out`" in text) == (1, True)
    assert run("check", "out.scene", "--ocio", name)[0] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--ocio", "absent.ocio"), "the colour configuration absent.ocio cannot be read: there is no such file"),
        (("--display", "monitor"), "no display is called `monitor`; there are: screen"),
        (("--look", "bright"), "no look is called `bright`; there are: dim"),
        (("--view", "other"), "no view is called `other`; there are: standard, sRGB, rolloff, agx, aces, plain, table"),
        (("--view", "agx", "--look", "dim"), "the look `dim` has no view `agx`, which is sRGB by a closed form: leave one of them out"),
        (("--working-space", "xyz"), "'xyz' is not one of 'rec709', 'rec2020', 'acescg'"),
    ],
)  # fmt: skip
def test_names_that_do_not_exist(folder: Path, options: tuple[str, ...], message: str) -> None:
    config = () if "--ocio" in options else ("--ocio", written(folder))
    code, text = run("render", "a.scene", "-o", "o.png", *config, *options)
    assert code != 0
    assert message in text
    assert "Traceback" not in text
    assert not (folder / "o.png").exists()


def test_a_table_that_is_absent_is_told_before_drawing(folder: Path) -> None:
    code, text = run("render", "a.scene", "-o", "o.png", "--ocio", written(folder, "absent.cube"), "--view", "table")
    assert code != 0
    assert "the view `table` failed: The specified file reference 'absent.cube' could not be located" in text


def test_strips_and_threads_write_the_same_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ("--working-space", "acescg", "--ocio", written(folder), "--look", "dim", "-q")
    for name in ("o.png", "o.exr"):
        assert run("render", "a.scene", "-o", name, *options, "--threads", "1")[0] == 0
        assert run("render", "a.scene", "-o", f"b{name}", *options, "--threads", "3")[0] == 0
    monkeypatch.setattr(large_images, "MAX_PIXELS", 24 * 20)
    monkeypatch.setattr(large_images, "STRIP_PIXELS", 24 * 20)
    for name in ("o.png", "o.exr"):
        assert run("render", "a.scene", "-o", f"c{name}", *options)[0] == 0
        first, second, strips = (image_reader.read(folder / file).channels["rgba"] for file in (name, f"b{name}", f"c{name}"))
        assert (first == second).all()
        assert (first == strips).all()


def test_compare_reads_each_file_in_its_own_space(folder: Path) -> None:
    """A wall in one light: the same colours, whichever space the files have."""
    Path("flat.scene").write_text('sphere(9, material: emissive(#d0402a))\ncamera(position: [0, 0, 5])\nrender(size: [4, 4], samples: 1)\n')
    for space in ("rec709", "acescg", "rec2020"):
        assert run("render", "flat.scene", "-o", f"{space}.exr", "--working-space", space, "--backend", "reference", "-q")[0] == 0
    for space in ("acescg", "rec2020"):
        code, text = run("compare", "rec709.exr", f"{space}.exr", "--json")
        assert code == 0, text
        a, b = (image_reader.read(folder / f"{name}.exr").channels["rgba"] for name in ("rec709", space))
        assert a == pytest.approx(b, abs=1e-6)


def test_options_without_effect_in_an_exr(folder: Path) -> None:
    _, text = run("render", "a.scene", "-o", "a.exr", "--ocio", written(folder), "--display", "screen", "--look", "dim")
    for option in ("display", "look"):
        assert f"note: --{option} has no effect: an EXR file holds the radiance itself" in text


@pytest.mark.parametrize("options", [{}, {"working_space": "acescg"}])
def test_the_live_window_shows_the_view(folder: Path, options: dict[str, Any]) -> None:
    config = written(folder)
    settings = ir.Settings(ocio=config, look="dim", **options)
    with served(folder / "a.scene", settings=settings) as window:
        studio: Any = window.session.studio
        until(lambda: studio.current is not None and studio.current.complete)
        assert studio.current.plan["view"] == "plain"
        shown = np.asarray(studio.current.shown.rgba)
    assert run("render", "a.scene", "-o", "a.exr", "-q", *(("--working-space", "acescg") if options else ()))[0] == 0
    assert shown == pytest.approx(image_reader.read(folder / "a.exr").channels["rgba"], abs=1e-5)


@pytest.mark.long
@pytest.mark.skipif(not landlock.version() or bool(seccomp.missing()), reason="this system confines no processes")
def test_a_sandbox_opens_the_folder_of_the_configuration_alone(folder: Path) -> None:
    configs, inside = folder / "configs", folder / "in"
    configs.mkdir()
    inside.mkdir()
    (folder / "a.scene").rename(inside / "a.scene")
    (folder / "a.png").rename(inside / "a.png")
    name = written(configs)
    options = ("--sandbox", "-q", "--ocio", name, "--view", "table")
    command = [sys.executable, "-m", "maquette", "render", "in/a.scene", "-o", "in/o.png", *options]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    (folder / "secret.cube").write_text((configs / "luts" / "half.cube").read_text(encoding="ascii"), encoding="ascii")
    written(configs, "../../secret.cube")
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert "reads `../../secret.cube`, which lies outside of its folder" in done.stderr
