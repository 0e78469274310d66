"""The `maquette` command: options, exit codes, messages, stdout and stderr, imported modules."""

from __future__ import annotations

import importlib.util
import json
import math
import os
import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np
import OpenImageIO as oiio
import pytest
from click.testing import CliRunner
from maquette.cli import commands, memory, render_job
from maquette.cli import option_types as values
from maquette.cli.main import COMMANDS, cli
from maquette.compiler import ir
from maquette.compiler.io import landlock, seccomp
from maquette.compiler.plan.decision import Decision, Plan
from maquette.lang.schema.picture_settings import PICTURE_SETTINGS
from maquette.render import picture_notes, render_scene
from maquette.render.image import image_files, image_reader
from maquette.render.image.image import Image

from ..files import standing_by

SCENE = """\
param radius = 1 in 0.2..2  "sphere radius"
sphere(center: [0, radius, 0], radius: radius, material: lambert(#d0402a))
plane(y: 0, material: lambert(#e8e8e8))
point([2, 4, 3], intensity: 20)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
render(size: [32, 24], samples: 1)
"""
LINK = "is a link, and nothing is written through links: remove it, or choose another name"
WRONG = """\
sphere(radius: 1, colour: #ff0000)
camera(position: [0, 0, 5], fov: 35)
plane(y: 0
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small scene as a.scene in the current folder."""
    standing_by(tmp_path, monkeypatch, SCENE)
    return Path("a.scene")


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, [str(a) for a in arguments])
    return done.exit_code, done.stdout, done.stderr


def shell(*arguments: object, **more: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from maquette.cli.main import cli; cli(prog_name='maquette')", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, **more)  # type: ignore[call-overload]


# --- help, usage, exit codes -----------------------------------------------------------------------------------------------


def test_help_lists_commands() -> None:
    code, out, err = run("--help")
    assert (code, err) == (0, "")
    for name in COMMANDS:
        assert f"\n  {name} " in out


@pytest.mark.parametrize(("name", "line"), COMMANDS.items())
def test_each_command_has_its_line_in_the_help(name: str, line: str) -> None:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    assert command.get_short_help_str(100) == line
    assert not cli.commands


def test_each_module_of_commands_has_a_row() -> None:
    assert {path.stem for path in Path(commands.__file__).parent.glob("*.py")} - {"__init__"} == set(COMMANDS)


@pytest.mark.parametrize("name", list(COMMANDS))
def test_each_help_shows_an_example(name: str) -> None:
    code, out, _ = run(name, "--help")
    assert code == 0
    assert f"Examples:\n    maquette {name} " in out


def test_format_lays_scenes_out_in_place(scene: Path) -> None:
    scene.write_bytes(b"sphere( 1 )\r\n")
    scene.chmod(0o640)
    assert run("format", "--check", scene) == (1, "a.scene\n", "")
    assert scene.read_bytes() == b"sphere( 1 )\r\n"
    assert run("format", scene) == (0, "a.scene\n", "")
    assert scene.read_bytes() == b"sphere(1)\n"
    assert scene.stat().st_mode & 0o777 == 0o640
    assert run("format", scene) == run("format", "--check", scene) == (0, "", "")


def test_format_skips_scenes_with_errors(scene: Path) -> None:
    scene.write_text("sphere((1)\n", encoding="utf-8")
    Path("b.scene").write_text("box( 1 )\n", encoding="utf-8")
    code, out, err = run("format", scene, "b.scene")
    assert (code, out) == (1, "b.scene\n")
    assert err == "a.scene:1:7: error: this `(` is not closed\n   1 | sphere((1)\n     |       ^ write `)` where it ends\n"
    assert scene.read_text(encoding="utf-8") == "sphere((1)\n"
    assert sorted(p.name for p in Path().iterdir()) == ["a.scene", "b.scene"]


@pytest.mark.long
def test_format_reads_stdin(scene: Path) -> None:
    done = shell("format", "-", input="sphere( 1 )")
    assert (done.returncode, done.stdout, done.stderr) == (0, "sphere(1)\n", "")
    done = shell("format", "-", input="sphere( 1")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "stdin:1:7: error: this `(` is not closed\n   1 | sphere( 1\n     |       ^ write `)` where it ends\n"


def test_format_takes_scenes_only(scene: Path) -> None:
    Path("a.usda").write_text("#usda 1.0\n", encoding="utf-8")
    code, _, err = run("format", "a.usda")
    assert code == 2
    assert err.endswith("Error: a.usda: only .scene files can be formatted\n")


@pytest.mark.parametrize(
    ("option", "message"),
    [
        (("--size", "800×"), "Invalid value for '--size': '800×': a size is written 800x600, or 512 for a square"),
        (("--size", "0x10"), "Invalid value for '--size': '0x10': a picture's sides are 1 to 65536 pixels"),
        (("--error", "0"), "Invalid value for '--error': '0': a share is written 1% or 0.01, and is more than 0"),
        (("--error", "1"), "Invalid value for '--error': '1': that is 100%: write 1%"),
        (("--error", "1%", "--samples", "8"), "--samples and --error exclude each other: --samples sets the work, --error the quality"),
        (("--budget", "3m"), "Invalid value for '--budget': '3m': a time is written 20s, 500ms or 2min"),
        (("--budget", "0s"), "Invalid value for '--budget': '0s': a budget is more than 0 seconds"),
        (("--time", "1deg"), "Invalid value for '--time': '1deg': a time is written 20s, 500ms or 2min"),
        (("--frames", "5..1"), "Invalid value for '--frames': '5..1': frames are written 1..24, 1..240x10, 1,5,10 or all, upwards"),
        (("--frames", "1-5"), "Invalid value for '--frames': '1-5': frames are written 1..24, 1..240x10, 1,5,10 or all"),
        (("--crop", "0,0,10"), "Invalid value for '--crop': '0,0,10': a crop is written x0,y0,x1,y1, in pixels from the top left"),
        (("--crop", "9,0,3,4"), "Invalid value for '--crop': '9,0,3,4': a crop has x0 < x1 and y0 < y1"),
        (("--background", "red"), "Invalid value for '--background': 'red': a background is sky, transparent or a colour like #87b5e0"),
        (("--exposure", "bright"), "Invalid value for '--exposure': 'bright': an exposure is a number of stops, like -1.5 or 2ev"),
        (("--samples", "0"), "Invalid value for '--samples': 0 is not in the range 1<=x<=1048576."),
        (("--set", "radius"), "Invalid value for '--set': 'radius': write it as name=value"),
        (("--set", "radius=1", "--set", "radius=2"), "Invalid value for '--set': `radius` is given twice"),
        (("--variant", "set=name"), "Invalid value for '--variant': 'set=name': a variant is written /prim:set=name"),
        (("--backend", "gpu"), "Invalid value for '--backend': 'gpu' is not one of 'auto', 'ray', 'raster', 'reference'."),
        (("--frames", "1..2", "--time", "1s"), "--time and --frames exclude each other"),
        (("-o", "a.bmp"), "cannot tell the picture format of a.bmp: its name must end in one of .exr, .png, .tif, .tiff, .jpg, .jpeg"),
        (("-o", "a.exr", "--bits", "8"), "a.exr holds 32-bit floats: --bits is for 8 and 16-bit pictures"),
        (("--aov", "depth"), "a.png has no room for the channels depth: write an .exr"),
        (("-o", "a.exr", "--aov", "dept"), "no channel is called `dept`; there are "
            "depth, normal, position, albedo, uv, id, transmittance, scatter_depth, "
            "variance, samples, cryptomatte, lights, issues."),
        (("--plan", "raster.coverag=areas"), "no decision is called `raster.coverag`; did you mean `raster.coverage`?"),
        (("--plan", "raster.coverage=lines"), "`raster.coverage` cannot be lines; it can be: edges, areas, scanline"),
        (("--camera", "left"), "no camera is called `left`; the scene has: "),
        (("--crop", "0,0,33,24"), "the crop 0,0,33,24 does not lie inside the picture of 32x24 pixels"),
        (("--colour", "red"), "No such option '--colour'."),
    ],
)
def test_wrong_options_are_usage_errors(scene: Path, option: tuple[str, ...], message: str) -> None:
    code, out, err = run("render", scene, *option)
    assert (code, out) == (2, "")
    assert f"Error: {message}" in err
    assert not list(Path().glob("*.png"))


def test_a_missing_scene() -> None:
    code, _, err = run("render", "none.scene")
    assert code == 2
    assert "File 'none.scene' does not exist." in err


def test_a_missing_folder(scene: Path) -> None:
    assert run("render", scene, "-o", "no/where/a.png") == (1, "", "error: there is no folder no/where to write a.png into\n")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder(scene: Path) -> None:
    Path("locked").mkdir(mode=0o500)
    assert run("render", scene, "-o", "locked/a.png") == (1, "", "error: the folder locked is not writable\n")


# --- option values ---------------------------------------------------------------------------------------------------------


def test_values() -> None:
    assert values.size("512") == (512, 512)
    assert values.size("800x600") == (800, 600)
    assert values.share("1%") == pytest.approx(0.01) == values.share("0.01")
    assert (values.seconds("2"), values.seconds("500ms"), values.seconds("2min")) == (2.0, 0.5, 120.0)
    assert values.frames("1..10x4") == (1, 5, 9)
    assert values.frames("-2..1") == (-2, -1, 0, 1)
    assert values.frames("1,5,10,5") == (1, 5, 10)
    assert values.frames("1:10x4") == (1, 5, 9)  # as usdrecord writes them
    assert values.frames("1:2x0.25,7.5") == (1, 1.25, 1.5, 1.75, 2, 7.5)
    assert values.frames("all") == ()
    assert PICTURE_SETTINGS["background"].read("#fff") == pytest.approx((1, 1, 1))
    assert values.assignment("text=a=b") == ("text", "a=b")
    assert values.variant("/robot:colour=red") == ("/robot:colour", "red")


def test_frames_are_numbered() -> None:
    assert values.frame_path(Path("a/out.####.png"), 7) == Path("a/out.0007.png")
    assert values.frame_path(Path("out##.exr"), 123) == Path("out123.exr")
    assert values.frame_path(Path("out.png"), 7) == Path("out.0007.png")
    assert values.frame_path(Path("FRAME/out_FRAME.png"), 7) == Path("FRAME/out_0007.png")
    assert values.frame_path(Path("out.###.##.png"), 7.5) == Path("out.007.50.png")
    assert values.frame_path(Path("out.###.png"), -7.25) == Path("out.-07.25.png")


# --- render ----------------------------------------------------------------------------------------------------------------


def test_render_writes_a_picture_and_says_so(scene: Path) -> None:
    code, out, err = run("render", scene)
    assert (code, err) == (0, "")
    assert out.startswith("a.png: 32x24, ray, 1 samples a pixel, ")
    image = image_reader.read(Path("a.png"))
    assert (image.width, image.height) == (32, 24)
    ball, floor = image.channels["rgba"][12, 16], image.channels["rgba"][22, 2]
    assert ball[0] > 2 * ball[2] > 0  # red
    assert floor[0] == pytest.approx(floor[2], abs=1e-3)  # grey


def test_quiet_prints_nothing(scene: Path) -> None:
    assert run("render", scene, "-q") == (0, "", "")


@pytest.mark.parametrize("backend", ["ray", "raster", "reference"])
def test_the_same_picture_by_each_backend(scene: Path, backend: str) -> None:
    assert run("render", scene, "-o", f"{backend}.exr", "--backend", backend)[0] == 0
    assert run("render", scene, "-o", "ray.exr", "--backend", "ray")[0] == 0
    code, out, _ = run("compare", f"{backend}.exr", "ray.exr", "--threshold", "5%")
    assert code == 0, out


def test_the_command_line_overrides_the_scene(scene: Path) -> None:
    assert run("render", scene, "--size", "10x8", "-o", "small.png")[0] == 0
    assert (image_reader.read(Path("small.png")).width, image_reader.read(Path("small.png")).height) == (10, 8)


def test_set_changes_the_scene(scene: Path) -> None:
    run("render", scene, "-o", "one.exr", "--set", "radius=1")
    run("render", scene, "-o", "default.exr")
    run("render", scene, "-o", "half.exr", "--set", "radius=0.5")
    assert run("compare", "one.exr", "default.exr", "--threshold", "0")[0] == 0
    assert run("compare", "half.exr", "default.exr", "--threshold", "1%")[0] == 1


def test_aovs_go_into_the_exr(scene: Path) -> None:
    assert run("render", scene, "-o", "a.exr", "--aov", "depth,normal,id")[0] == 0
    names = set(oiio.ImageBuf("a.exr").spec().channelnames)
    assert names == {"R", "G", "B", "A", "depth.Z", "normal.X", "normal.Y", "normal.Z", "id.instance", "id.material"}


def test_a_transparent_background_gives_alpha(scene: Path) -> None:
    scene.write_text(SCENE.replace("plane(y: 0, material: lambert(#e8e8e8))\n", ""), encoding="utf-8")
    run("render", scene, "-o", "t.png", "--background", "transparent")
    run("render", scene, "-o", "c.png", "--background", "#ff0000")
    assert [oiio.ImageBuf(name).spec().nchannels for name in ("t.png", "c.png")] == [4, 3]
    alpha = image_reader.read(Path("t.png")).channels["rgba"][..., 3]
    assert (alpha[0, 0], alpha[12, 16]) == (0, 1)
    assert image_reader.read(Path("c.png")).channels["rgba"][0, 0].tolist() == [1, 0, 0, 1]


def test_frames_are_moments(scene: Path) -> None:
    moving = SCENE.replace("[0, radius, 0]", "[2 * time / 1s, radius, 0]") + "animate(duration: 2s, fps: 2)\n"
    scene.write_text(moving, encoding="utf-8")
    assert run("render", scene, "-o", "f.##.exr", "--frames", "0..2x2", "-q") == (0, "", "")
    assert sorted(p.name for p in Path().glob("f.*")) == ["f.00.exr", "f.02.exr"]
    run("render", scene, "-o", "one.exr", "--time", "1s")
    assert run("compare", "f.02.exr", "one.exr", "--threshold", "0")[0] == 0
    assert run("compare", "f.00.exr", "one.exr", "--threshold", "1%")[0] == 1


def test_frames_of_a_stage_are_its_time_codes(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cube at x = code - 100, in a stage that starts at 101 with 24 codes a second."""
    Path("a.usda").write_text(
        """#usda 1.0
(
    startTimeCode = 101
    endTimeCode = 110
    timeCodesPerSecond = 24
)
def Cube "cube" {
    double3 xformOp:translate.timeSamples = { 101: (1, 0, 0), 110: (10, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
""",
        encoding="utf-8",
    )
    seen = []

    def drawn(compiled: ir.Scene, *_: object, **__: object) -> Image:
        seen.append(float(compiled.tables.transforms.matrix[compiled.tables.instances.transform[0], 0, 3]))
        return Image(1, 1, {"rgba": np.zeros((1, 1, 4), np.float32)}, {"seconds": {}, "notes": [], "unproved": 0, "issues": 0})

    monkeypatch.setattr(render_scene, "draw", drawn)
    assert run("render", "a.usda", "--frames", "101..109x4", "-o", "f.exr")[0] == 0
    assert run("render", "a.usda", "--time", "250ms", "-o", "t.exr")[0] == 0
    assert seen == pytest.approx([1, 5, 9, 7])
    assert run("check", "a.usda", "--set", "a=1")[0] == 1


def test_photometric_scenes_are_metered(scene: Path) -> None:
    scene.write_text(SCENE.replace("intensity: 20", "intensity: 20000cd"), encoding="utf-8")
    code, _, err = run("render", scene)
    assert code == 0
    assert err.startswith("exposure: metered, -")
    fixed = err.split("--exposure ")[1].split(" ")[0]
    run("render", scene, "-o", "fixed.png", "--exposure", fixed)
    assert run("compare", "a.png", "fixed.png", "--threshold", "0")[0] == 0


def test_the_limit_on_elements_is_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.scene").write_text("for (k in 1..20) { sphere(center: [k, 0, 0]) }\n", encoding="utf-8")
    Path("a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    assert run("check", "a.scene", "--max-elements", "20")[0] == 0
    code, _, err = run("check", "a.scene", "--max-elements", "19")
    assert code == 1
    assert err.startswith("a.scene:1:11: error: the scene makes more than 19 elements, most of them in this loop\n")
    code, _, err = run("check", "a.obj", "--max-elements", "19")
    assert code == 1
    assert "error: only .scene files make elements" in err


def test_a_missed_error_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    noisy = SCENE.replace("point([2, 4, 3], intensity: 20)", "sky(luminance: 1)").replace("samples: 1", "bounces: 3")
    standing_by(tmp_path, monkeypatch, noisy)
    code, _, err = run("render", "a.scene", "--error", "0.01%", "--budget", "10ms")
    assert code == 0
    told = [line for line in err.splitlines() if line.startswith("warning: the budget of 0.01 s ended the render ")]
    assert [line.endswith("; 0.01% was asked for") for line in told] == [True]
    assert "a longer --budget or a larger --error" in err
    assert run("render", "a.scene", "--error", "50%")[2] == ""


@pytest.mark.parametrize(
    ("about", "budget", "message"),
    [
        ({"error": 0.052}, 3.0, "the budget of 3 s ended the render at an error of 5.20%; 2.00% was asked for"),
        ({"error": None}, 0.5, "the budget of 0.5 s ended the render before its error was known; 2.00% was asked for"),
        ({"error": 0.021}, math.inf, "the limit of 1,048,576 samples a pixel ended the render at an error of 2.10%; 2.00% was asked for"),
        ({"error": 0.019}, math.inf, None),
        ({"error": None, "partial": True}, 3.0, None),
    ],
)
def test_how_a_render_missed_its_error(about: dict[str, Any], budget: float, message: str | None) -> None:
    values = {"error": 0.02, "budget": budget, "samples": 1 << 20}
    plan = Plan({name: Decision(name, value, "asked for") for name, value in values.items()})
    assert [d.message for d in picture_notes.missed_error_warnings(about, plan)] == ([message] if message else [])


@pytest.mark.parametrize(
    ("error", "more", "message"),
    [
        (0.47, {}, "the picture is noisy: its error is 47% with the default of 64 samples a pixel"),
        (0.04, {}, None),
        (None, {}, None),
        (0.47, {"denoise": "on"}, None),
        (0.47, {"error": 0.03, "samples": 1 << 20}, None),
        (0.029, {"error": 0.03, "samples": 256}, None),
        (0.47, {"monte_carlo": False}, None),
    ],
)
def test_a_noisy_picture_of_the_defaults(
    monkeypatch: pytest.MonkeyPatch, error: float | None, more: dict[str, Any], message: str | None
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)
    values = {"error": 0.0, "budget": math.inf, "samples": 64, "denoise": "off", "monte_carlo": True, **more}
    plan = Plan({name: Decision(name, value, "the default") for name, value in values.items()})
    notes = picture_notes.noise_notes({"error": error, "seconds": {"render": 1.5}}, plan)
    assert [d.message for d in notes] == ([message] if message else [])
    assert [d.hint for d in notes] == (["--error 5% takes about 2:15 min; --denoise smooths it"] if message else [])


def test_a_picture_above_the_default_error(monkeypatch: pytest.MonkeyPatch) -> None:
    values = {"error": 0.03, "budget": math.inf, "samples": 256, "denoise": "above_error", "monte_carlo": True}
    plan = Plan({name: Decision(name, value, "the default") for name, value in values.items()})
    about = {"error": 0.12, "seconds": {"render": 2.0}}
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    (noisy,) = picture_notes.noise_notes(about, plan)
    (clean,) = picture_notes.noise_notes({**about, "denoised": True, "denoised_error": 0.021}, plan)
    assert noisy.message == "the picture is noisy: its error is 12% with the default of at most 256 samples a pixel"
    assert noisy.hint == "--error 3% takes about 32 s; pip install maquette-render[denoise] smooths it"
    start = "the picture was noisy after the default of at most 256 samples a pixel, and is denoised: "
    assert clean.message == start + "its error was 12.0%, and about 2.1% are left"
    assert clean.hint == "--error 3% takes about 32 s without denoising"
    assert picture_notes.missed_error_warnings(about, plan) == []


def test_a_picture_that_a_budget_ends_is_denoised() -> None:
    values = {"error": 0.0, "budget": 5.0, "samples": 1 << 20, "denoise": "above_error", "monte_carlo": True}
    plan = Plan({name: Decision(name, value, "the default") for name, value in values.items()})
    about = {"error": 0.12, "seconds": {"render": 5.0}, "denoised": True, "denoised_error": 0.021}
    (note,) = picture_notes.noise_notes(about, plan)
    assert note.message == "the picture was noisy after a budget of 5 s, and is denoised: its error was 12.0%, and about 2.1% are left"
    assert note.hint == "--error 3% takes about 1:20 min without denoising"
    assert picture_notes.noise_notes({**about, "error": 0.02}, plan) == []
    (note,) = picture_notes.noise_notes({**about, "error": None, "denoised_error": None}, plan)
    assert note.message == "the picture is denoised: a budget of 5 s ended before its error was known"


def test_an_error_that_strays_decide_is_uncertain() -> None:
    (note,) = picture_notes.sparse_error_notes({"error": 0.08, "error_in_few": 0.7})
    assert note.message == "70% of the squared error is in 0.1 % of the pixels: stray bright samples, so the error is uncertain"
    assert picture_notes.sparse_error_notes({"error": 0.08, "error_in_few": 0.3}) == []
    assert picture_notes.sparse_error_notes({"error": None}) == []


@pytest.mark.parametrize(("mean", "said"), [(16.0, "16 samples a pixel"), (11.25, "11.2 (at most 16) samples a pixel")])
def test_the_summary_tells_the_mean_of_samples_that_pixels_share_unevenly(mean: float, said: str) -> None:
    figures = {
        "size": (8, 6), "backend": "ray", "samples": 16, "samples_mean": mean, "error": None, "denoised": False, "denoised_error": None,
        "seconds": {"render": 0.5}, "bias": None, "left_out": (), "plan": {"bounces": 0},
    }  # fmt: skip
    assert render_job.summary(Path("a.png"), figures) == f"a.png: 8x6, ray, {said}, 0.50 s"


def test_stats(scene: Path) -> None:
    assert run("render", scene, "--stats", "stats.json", "--samples", "2")[0] == 0
    stats = json.loads(Path("stats.json").read_text(encoding="utf-8"))
    assert list(stats) == [
        "scene", "backend", "size", "samples", "samples_mean", "seconds", "instances", "rays", "memory", "memory_expected", "error",
        "denoised", "denoised_error", "elapsed", "cut", "bias", "left_out", "plan", "warnings",
    ]  # fmt: skip
    assert stats["instances"] == 2
    assert 10**7 < stats["memory"] < 10**11
    assert stats["memory_expected"] >= 10**8
    assert list(stats["seconds"]) == ["import", "parse", "evaluate", "lower", "validate", "compile_kernels", "build", "render", "write"]
    assert (stats["scene"], stats["backend"], stats["size"], stats["samples"]) == ("a.scene", "ray", [32, 24], 2)
    assert [stage for stage, took in stats["seconds"].items() if took <= 0 and stage != "compile_kernels"] == []  # may be in memory
    assert stats["plan"]["raster.coverage"] == "edges"
    assert stats["plan"]["budget"] is None
    assert stats["warnings"] == []


@pytest.mark.parametrize("command", ["render", "watch"])
@pytest.mark.parametrize("file", ["a.scene", "a.png"])
def test_stats_replace_neither_scene_nor_picture(scene: Path, command: str, file: str) -> None:
    before = scene.read_bytes()
    code, _, err = run(command, "a.scene", "-o", "a.png", "--stats", file)
    assert code == 2
    assert f"--stats {file} would replace {file}: choose another file, such as a.json" in err
    assert scene.read_bytes() == before


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_and_its_like_write_the_partial_picture(scene: Path, number: int) -> None:
    tell = "p.Display.__call__ = lambda self, reached: reached.share > 0 and print('begun', flush=True)"
    code = f"from maquette.cli import main, progress as p; {tell}; main.main()"
    command = [sys.executable, "-c", code, "render", "a.scene", "--backend", "reference", "--size", "600", "--samples", "1024"]
    restored = partial(signal.signal, number, signal.SIG_DFL)  # nohup ignores SIGHUP
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=restored)
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert re.fullmatch(r"interrupted: the partial picture is in a\.partial\.exr(; --resume goes on from a\.png\.checkpoint)?\n", err)
    assert set(out.split()) <= {"begun"}
    assert image_reader.read(Path("a.partial.exr")).channels["rgba"].any()
    assert not Path("a.png").exists()


# --- check, inspect, explain, convert --------------------------------------------------------------------------------------


def test_check_finds_all_errors_at_once(scene: Path) -> None:
    Path("wrong.scene").write_text(WRONG, encoding="utf-8")
    code, out, err = run("check", "wrong.scene", scene)
    assert code == 1
    assert out.splitlines()[1] == "a.scene: no errors"
    assert next(line for line in err.splitlines() if ": error: " in line).startswith("wrong.scene:1:19: error: sphere has no `colour`")
    assert "wrong.scene:2:" in err
    assert "wrong.scene:3:" in err
    assert "Traceback" not in err


def test_check_json_is_the_same_as_data(scene: Path) -> None:
    Path("wrong.scene").write_text(WRONG, encoding="utf-8")
    code, out, err = run("check", "wrong.scene", "--json")
    assert (code, err) == (1, "")
    found = json.loads(out)
    assert set(found[0]) == {"severity", "message", "hint", "span", "trace"}
    assert found[0]["span"]["line"] == 1
    assert run("check", scene, "--json") == (0, "[]\n", "")


def test_errors_of_render_precede_output(scene: Path) -> None:
    Path("wrong.scene").write_text(WRONG, encoding="utf-8")
    code, out, err = run("render", "wrong.scene")
    assert (code, out) == (1, "")
    assert "wrong.scene:1:19: error:" in err
    assert not Path("wrong.png").exists()


def test_explain_prints_every_decision_and_reason(scene: Path) -> None:
    code, out, _ = run("explain", scene, "--plan", "raster.coverage=areas", "--samples", "3")
    assert code == 0
    rows = {line.split("  ")[0]: line for line in out.splitlines()}
    assert "asked for" in rows["samples"]
    assert "set with --plan" in rows["raster.coverage"]
    data = json.loads(run("explain", scene, "--json")[1])
    assert {row["name"] for row in data} <= set(rows)
    assert all(row["reason"] for row in data)


def test_explain_begins_with_what_matters(scene: Path) -> None:
    _, out, _ = run("explain", scene, "--plan", "accelerator=bvh")
    lines = out.splitlines()
    assert lines[0] == "The decisions with the largest effect on this scene:"
    assert lines[1:3] == ["  accelerator = bvh: set with --plan", "  backend = ray: draws every kind of scene"]
    assert lines[6:8] == ["", "All decisions:"]
    data = json.loads(run("explain", scene, "--json", "--plan", "accelerator=bvh")[1])
    assert [f"  {row['name']} = " for row in data if row["matters"]] == sorted(
        [line.partition("=")[0] + "= " for line in lines[1:6]], key=[f"  {row['name']} = " for row in data].index
    )


def test_explain_prints_added_defaults(scene: Path) -> None:
    scene.write_text("sphere(1)\n", encoding="utf-8")
    _, out, _ = run("explain", scene)
    assert [line for line in out.splitlines() if line.startswith("added: camera")]
    assert [line for line in out.splitlines() if line.startswith("added: sun")]


def test_inspect(scene: Path) -> None:
    code, out, _ = run("inspect", scene)
    assert code == 0
    assert "param radius: number = 1" in out or "param radius: length = 1" in out
    assert "file: " in out
    assert run("inspect", scene, "--ir")[0] == 0
    assert isinstance(json.loads(run("inspect", scene, "--json")[1]), dict)
    assert run("inspect", scene, "--ir", "--json")[0] == 2


def test_a_picture_whose_file_cannot_be_written_is_rescued(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A failure after the last sample does not lose the picture."""

    def write(picture: Any, path: Path, *rest: Any) -> None:
        if path.suffix == ".png":
            raise ValueError("no view")
        written(picture, path, *rest)

    written = image_files.write
    monkeypatch.setattr(image_files, "write", write)
    code, _, err = run("render", scene, "-o", "a.png", "--size", "8x6", "--quiet")
    (rescued,) = Path().glob("a.*.rescued.exr")
    assert (code, err) == (1, f"error: no view; its pixels are in {rescued}\n")
    assert image_reader.read(rescued).channels["rgba"].any()


@pytest.mark.long
def test_a_closed_output_is_no_error(scene: Path) -> None:
    command = f"{sys.executable} -m maquette render a.scene -o a.png --size 8x6 --quiet >&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")


def test_a_saved_ir_draws_the_same(scene: Path) -> None:
    assert run("convert", scene, "a.npz") == (0, "", "")
    run("render", scene, "-o", "scene.exr")
    assert run("render", "a.npz", "-o", "npz.exr")[0] == 0
    assert run("compare", "scene.exr", "npz.exr", "--threshold", "0")[0] == 0
    code, _, err = run("convert", scene, "a.fbx")
    assert code == 2
    endings = "OUT ends in .npz (a saved IR), .scene (readable source), .xml (Mitsuba 3), .pov (POV-Ray 3.7), .glb ("
    assert f"Error: writing .fbx is not built yet: {endings}" in err


# --- imported modules, terminal output ------------------------------------------------------------------------------------------


HEAVY = (
    "numba", "llvmlite", "pxr", "OpenImageIO", "matplotlib", "trimesh", "manifold3d", "flip_evaluator", "fontTools", "PIL", "rich",
    "uharfbuzz", "multiprocessing", "asyncio", "unittest", "email", "http",
)  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "banned"),
    [
        (("--help",), (*HEAVY, "numpy", "lark")),
        (("render", "--help"), (*HEAVY, "numpy", "lark")),
        (("check", "a.scene"), HEAVY),
        (("inspect", "a.scene"), HEAVY),
        (("explain", "a.scene"), tuple(name for name in HEAVY if name not in ("llvmlite", "email"))),  # it looks for kernels
        (("format", "--check", "a.scene"), (*HEAVY, "numpy")),
    ],
)
def test_commands_load_no_more_than_they_need(scene: Path, arguments: tuple[str, ...], banned: tuple[str, ...]) -> None:
    tell = "atexit.register(lambda: print('LOADED', *sys.modules, file=sys.stderr))"
    code = f"import sys, atexit; {tell}; from maquette.cli.main import cli; cli()"
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stderr.split("LOADED ")[1].split())
    assert not loaded & set(banned)


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
def test_drawing_again_loads_no_numba(scene: Path, backend: str) -> None:
    """Once its kernels are compiled, which the first run does if nobody did."""
    tell = "atexit.register(lambda: print('LOADED', *sys.modules, file=sys.stderr))"
    code = f"import sys, atexit; {tell}; from maquette.cli.main import cli; cli()"
    command = [sys.executable, "-c", code, "render", "a.scene", "-o", "a.png", "--size", "8x6", "--quiet", "--backend", backend]
    for _ in range(2):
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
    assert "numba" not in done.stderr.split("LOADED ")[1].split()


def test_import_maquette_is_light() -> None:
    code = "import maquette, sys; sys.exit(bool({'numpy', 'numba', 'click', 'rich'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0


@pytest.mark.long
def test_no_colours_without_a_terminal(scene: Path) -> None:
    Path("wrong.scene").write_text(WRONG, encoding="utf-8")
    done = shell("check", "wrong.scene", env={**os.environ, "FORCE_COLOR": ""})
    assert done.returncode == 1
    assert "\x1b" not in done.stderr + done.stdout


@pytest.mark.long
def test_a_file_name_that_the_locale_lacks(scene: Path) -> None:
    Path("named.scene").write_text('mesh("b\u00e9.obj")\n', encoding="utf-8")
    ascii_names = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = shell("check", "named.scene", env=ascii_names)
    assert done.returncode == 1
    assert done.stderr == "error: no file name has `\\xe9` here, where names are ascii: set PYTHONUTF8=1\n"


def test_too_little_memory_is_said(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def inspect(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("maquette.cli.terminal.inspect", inspect)
    message = "error: not enough memory for this picture: give a smaller --size, or fewer channels by --aov\n"
    assert run("inspect", scene) == (1, "", message)


def test_a_fault_of_our_own_is_no_traceback(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maquette.cli.terminal.inspect", lambda *_: 1 / 0)
    code, out, err = run("inspect", scene)
    assert (code, out) == (1, "")
    assert err.startswith("internal error: ZeroDivisionError: division by zero\n")
    assert "Traceback" not in err


# --- checkpoints -----------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_killed_render_goes_on(scene: Path) -> None:
    """From its last checkpoint, with the same bits; the checkpoint is removed at the end."""
    options = ("--backend", "reference", "--size", "96x64", "--samples", "32", "--threads", "1")
    run("render", scene, "-o", "whole.exr", *options)
    keep = "c.Canvas.finish = lambda self, view: (self.keep(), print('kept', flush=True), time.sleep(60))"
    code = f"import time; from maquette.render.film import canvas as c; {keep}; from maquette.cli import main; main.main()"
    command = [sys.executable, "-c", code, "render", "a.scene", "-o", "a.exr", *options, "--checkpoint", "1s", "-q"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "kept\n"
    process.kill()
    process.wait()
    assert not Path("a.exr").exists()
    code, _, err = run("render", scene, "-o", "a.exr", *options, "--resume")
    assert (code, err) == (0, "goes on from a.exr.checkpoint, with 32 samples a pixel\n")
    assert not Path("a.exr.checkpoint").exists()
    np.testing.assert_array_equal(image_reader.read(Path("a.exr")).channels["rgba"], image_reader.read(Path("whole.exr")).channels["rgba"])


def test_a_checkpoint_of_another_picture_is_told(scene: Path) -> None:
    Path("a.png.checkpoint").write_bytes(b"")
    code, _, err = run("render", scene, "--size", "16", "--samples", "2", "--backend", "reference", "--resume")
    told = "warning: a.png.checkpoint is damaged, or of another scene, version, machine or settings: the picture begins anew\n"
    assert (code, err) == (0, told)
    Path("a.png.checkpoint").write_bytes(b"")
    code, _, err = run("render", scene, "--size", "16", "--samples", "2", "--backend", "reference")
    assert (code, err) == (0, "a.png.checkpoint is there: --resume goes on from it\n")
    assert not Path("a.png.checkpoint").exists()


# --- memory ------------------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_picture_is_drawn_in_strips_where_memory_is_short(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the same pixels; a picture that does not fit in strips is refused before it is drawn."""
    monkeypatch.setattr(memory, "resident_memory", lambda: 129_700_000)  # without what the tests have loaded
    options = ("--backend", "reference", "--samples", "1", "--size", "128x96")
    run("render", scene, "-o", "whole.exr", *options)
    assert run("render", scene, "-o", "strips.exr", *options, "--memory", "460MB")[0] == 0
    strips, whole = (image_reader.read(Path(name)).channels["rgba"] for name in ("strips.exr", "whole.exr"))
    np.testing.assert_array_equal(strips, whole)
    _, _, err = run("render", scene, "-o", "strips.exr", *options, "--memory", "460MB", "--checkpoint", "5s", "--resume")
    without = "has no effect: the picture has no checkpoints, as it is drawn in strips"
    assert err == f"note: --checkpoint {without}\nnote: --resume {without}\n"
    code, _, err = run("render", scene, "-o", "a.exr", "--size", "8000x6000", "--samples", "1", "--memory", "100MB", "--backend", "ray")
    assert code == 2
    what = "a picture of 8000 by 6000 pixels takes about 2.5 GB of memory, and 0.1 GB are allowed"
    assert f"Error: {what}; a strip of it does not fit either: give a smaller --size" in err
    code, _, err = run("render", scene, "--memory", "lots")
    assert code == 2
    assert "a memory is written 8GB or 500MB" in err


# --- sandbox -----------------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.skipif(not landlock.version(), reason="this system has no Landlock")
def test_a_sandboxed_render_draws_and_reads_nothing_else(scene: Path, tmp_path: Path) -> None:
    """The picture is the same; code in the process cannot read the home folder of the test."""
    inside, outside = tmp_path / "in", tmp_path / "secret.txt"
    inside.mkdir()
    outside.write_text("secret", encoding="utf-8")
    scene.rename(inside / "a.scene")
    options = ["--backend", "reference", "--size", "16", "--samples", "1", "-q"]
    read = f"lambda *a, real=jobs.make_plan, **k: (Path({str(outside)!r}).read_text(), real(*a, **k))[1]"
    attack = f"from pathlib import Path; from maquette.cli import render_job as jobs; jobs.make_plan = {read}"
    for code, returned in (("pass", 0), (attack, 1)):
        command = [sys.executable, "-c", f"{code}; from maquette.cli import main; main.main()"]
        done = subprocess.run([*command, "render", "in/a.scene", "-o", "in/a.png", "--sandbox", *options], capture_output=True, text=True)
        assert done.returncode == returned, done.stderr
    assert "Permission denied" in done.stderr
    assert sorted(path.name for path in inside.iterdir()) == ["a.png", "a.scene"]


@pytest.mark.long
@pytest.mark.skipif(not landlock.version() or bool(seccomp.missing()), reason="this system confines no processes")
@pytest.mark.parametrize(
    ("arguments", "returned", "told"),
    [
        (("up/a.scene", "-o", "up/out.png"), 1, f"error: up/out.png {LINK}\n"),
        (("up/a.scene", "-o", "up/o.png", "--stats", "up/x.json"), 1, f"error: up/x.json {LINK}\n"),
        (("up/a.scene", "-o", "up/sub/o.png"), 2, "Error: --sandbox: up/sub is a link: "),
        (("up/sub/a.scene", "-o", "up/o.png"), 2, "Error: --sandbox: up/sub is a link: "),
        (("up/a.scene", "-o", "up/o.png", "--allow", "up/sub"), 2, "Error: --sandbox: up/sub is a link: "),
        (("up/a.usda", "-o", "up/o.png", "--session-layer", "up/s.usda"), 2, "Error: --sandbox: up/s.usda is a link: "),
        (("up/leak.scene", "-o", "up/o.png"), 1, "up/leak.scene: error: `leak.scene` is a link that leads outside of the scene's folder\n"),
        (("up/leak.obj", "-o", "up/o.png"), 1, "up/leak.obj: error: `leak.obj` is a link that leads outside of the scene's folder\n"),
        (("up/leak.usda", "-o", "up/o.#.png", "--frames", "all"), 1, "up/leak.usda: error: `leak.usda` is a link that leads outside of"),
    ],
)  # fmt: skip
def test_links_in_a_strangers_folder_lead_nowhere(
    tmp_path: Path, scene: Path, arguments: tuple[str, ...], returned: int, told: str
) -> None:  # fmt: skip
    """The folders are those of the names as given. No message quotes what a link leads to."""
    up, secret = tmp_path / "up", tmp_path / "secret"
    up.mkdir()
    secret.mkdir()
    scene.rename(up / "a.scene")
    (up / "a.usda").write_text("#usda 1.0\n", encoding="utf-8")
    (secret / "notes.txt").write_text("TOP SECRET\n", encoding="utf-8")
    for name in ("out.png", "x.json", "leak.scene", "leak.obj", "leak.usda", "s.usda"):
        (up / name).symlink_to("../secret/notes.txt")
    (secret / "a.scene").write_text("sphere(1)\n", encoding="utf-8")
    (up / "sub").symlink_to("../secret")
    before = sorted(path.name for path in up.iterdir())
    options = ("--sandbox", "--backend", "reference", "--size", "8", "--samples", "1", "-q")
    done = subprocess.run([sys.executable, "-m", "maquette", "render", *arguments, *options], capture_output=True, text=True)
    assert (done.returncode, told in done.stderr, "TOP" in done.stderr) == (returned, True, False), done.stderr
    assert (secret / "notes.txt").read_text(encoding="utf-8") == "TOP SECRET\n"
    assert (sorted(path.name for path in up.iterdir()), sorted(os.listdir(secret))) == (before, ["a.scene", "notes.txt"])


@pytest.mark.parametrize("link", [False, True])
def test_a_picture_does_not_replace_what_the_scene_reads(scene: Path, link: bool) -> None:
    run("render", scene, "-o", "a.png", "--size", "8", "--samples", "1", "-q")
    Path("textured.scene").write_text('plane(y: 0, material: lambert(image("a.png")))\n')
    if link:
        Path("b.png").symlink_to("a.png")
    before, name = Path("a.png").read_bytes(), "b.png" if link else "a.png"
    why = LINK if link else f"would replace {Path('a.png').resolve()}, which is read: choose another name"
    expected = (1, "", f"error: {name} {why}\n")
    assert run("render", "textured.scene", "-o", name, "--size", "8", "--samples", "1", "-q") == expected
    assert Path("a.png").read_bytes() == before


@pytest.mark.parametrize("command", [("render",), ("sweep", "--set", "radius=1,2")])
def test_a_link_to_the_scene_is_not_replaced(scene: Path, command: tuple[str, ...]) -> None:
    Path("a.png").symlink_to(scene)
    before = scene.read_bytes()
    code, _, err = run(command[0], scene, *command[1:], "-o", "a.png", "--size", "8", "--samples", "1", "-q")
    assert (code, scene.read_bytes()) == (1, before)
    assert err == f"error: a.png {LINK}\n"


def test_convert_does_not_replace_its_input(scene: Path) -> None:
    Path("a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert run("convert", "a.obj", "a.obj") == (
        1, "", f"error: a.obj would replace {Path('a.obj').resolve()}, which is read: choose another name\n"
    )  # fmt: skip
    assert Path("a.obj").read_text().endswith("f 1 2 3\n")


def test_a_device_is_not_replaced(scene: Path) -> None:
    Path("a.json").symlink_to("/dev/null")
    assert run("render", scene, "-o", "a.png", "--stats", "a.json", "-q") == (
        1, "", f"error: a.json {LINK}\n"
    )  # fmt: skip
    assert Path("/dev/null").is_char_device()


def test_a_name_too_long_for_its_checkpoint(scene: Path) -> None:
    name = "n" * 246 + ".png"
    options = ("-o", name, "--size", "8", "--samples", "1", "-q")
    assert run("render", scene, *options) == (
        1, "", f"error: {name}.checkpoint: File name too long; shorten the name of the picture, or give --checkpoint off\n"
    )  # fmt: skip
    assert run("render", scene, *options, "--checkpoint", "off")[0] == 0
    assert Path(name).is_file()


@pytest.mark.parametrize(
    ("options", "notes"),
    [
        (["-o", "a.exr", "--exposure", "1"], ["--exposure has no effect: an EXR file holds the radiance itself"]),
        (["-o", "a.exr", "--view", "sRGB"], ["--view has no effect: an EXR file holds the radiance itself"]),
        (["-o", "a.png", "--tolerance", "1"], ["--tolerance has no effect: the backend ray draws curved shapes without triangles"]),
        (["-o", "a.png", "--exposure", "1"], []),
        (["-o", "a.exr", "--exposure", "1", "--quiet"], []),
        (["-o", "a.exr", "--backend", "raster", "--tolerance", "1"], []),
    ],
)  # fmt: skip
def test_options_without_an_effect_are_noted(scene: Path, options: list[str], notes: list[str]) -> None:
    backend = [] if "--backend" in options else ["--backend", "ray"]
    code, _, err = run("render", "a.scene", "--size", "8", "--samples", "1", "--no-denoise", *backend, *options)
    assert code == 0
    assert [line for line in err.splitlines() if "no effect" in line] == [f"note: {note}" for note in notes]


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="this system has no /proc")
def test_a_folder_that_takes_no_files_is_told_before_drawing(scene: Path) -> None:
    """The rights of root say otherwise."""
    if os.access("/proc", os.W_OK):
        message = "error: no file can be made in the folder /proc: choose another one for x.png\n"
    else:
        message = "error: the folder /proc is not writable\n"
    assert run("render", scene, "-o", "/proc/x.png") == (1, "", message)


@pytest.mark.long
@pytest.mark.skipif(memory.resource is None, reason="this system has no limits of processes")
def test_a_small_address_space_is_told() -> None:
    command = f"ulimit -v 500000 && exec {sys.executable} -P -m maquette doctor"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    message = "error: this shell limits the address space to 500000 kB, and 600000 are needed: ulimit -v unlimited\n"
    assert (done.returncode, done.stderr) == (1, message)
