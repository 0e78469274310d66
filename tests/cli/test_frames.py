"""The frames of `--frames all`: half-open durations, animations of glTF files by name, and cameras of stages that are not used."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.render import render_scene
from maquette.render.image.image import Image

TURN = (0, 0.5, 1.0), [(0, 0, 0), (0, 0, 0), (4, 0, 0)]
SLIDE = (0, 2.0), [(0, 0, 0), (0, 8, 0)]


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, [str(a) for a in arguments])
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture
def seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[float]]:
    """The places of the first instance in the pictures drawn; the current folder is empty."""
    monkeypatch.chdir(tmp_path)
    places: list[list[float]] = []

    def drawn(compiled: ir.Scene, *_: object, **__: object) -> Image:
        places.append(compiled.tables.transforms.matrix[compiled.tables.instances.transform[0], :, 3].round(9).tolist())
        return Image(1, 1, {"rgba": np.zeros((1, 1, 4), np.float32)}, {"seconds": {}, "notes": [], "unproved": 0, "issues": 0})

    monkeypatch.setattr(render_scene, "draw", drawn)
    return places


def moving(*animations: tuple[str | None, tuple[Any, Any]]) -> str:
    """A .gltf file of a triangle that animations move."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
    arrays, kinds, listed = [corners], ["VEC3"], []
    for name, (times, places) in animations:
        arrays += [np.array(times, "<f4"), np.array(places, "<f4")]
        kinds += ["SCALAR", "VEC3"]
        sampler = {"input": len(arrays) - 2, "output": len(arrays) - 1}
        channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
        listed.append({"samplers": [sampler], "channels": [channel]} | ({} if name is None else {"name": name}))
    data = b"".join(array.tobytes() for array in arrays)
    starts = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
    return json.dumps(
        {
            "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [
                {"bufferView": k, "componentType": 5126, "count": len(array), "type": kind}
                for k, (array, kind) in enumerate(zip(arrays, kinds, strict=True))
            ],
            "bufferViews": [{"buffer": 0, "byteOffset": s, "byteLength": a.nbytes} for s, a in zip(starts, arrays, strict=False)],
            "buffers": [{"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}],
            "animations": listed,
        }
    )  # fmt: skip


@pytest.mark.parametrize(
    ("duration", "fps", "count"), [("1s", 4, 4), ("250ms", 24, 6), ("2s", 24, 48), ("10ms", 24, 1), ("260ms", 24, 7), ("100ms", 30, 3)]
)
def test_a_duration_is_half_open(seen: list[list[float]], duration: str, fps: int, count: int) -> None:
    text = f"sphere(1, center: [time / 1s, 0, 0])\nanimate(duration: {duration}, fps: {fps})\n"
    Path("a.scene").write_text(text, encoding="utf-8")
    assert run("render", "a.scene", "-o", "f.####.exr", "--frames", "all", "-q")[0] == 0
    assert [place[0] for place in seen] == pytest.approx([k / fps for k in range(count)])


def test_too_long_an_animation_is_told(seen: list[list[float]]) -> None:
    Path("a.scene").write_text("sphere(1)\nanimate(duration: 100000s, fps: 24)\n", encoding="utf-8")
    code, _, err = run("render", "a.scene", "-o", "f.####.exr", "--frames", "all", "-q")
    assert code == 2
    assert "a.scene has more than 1,000,000 frames: name some, as in --frames 1..24" in err


@pytest.mark.parametrize("codes", ["startTimeCode = 1\nendTimeCode = inf", "startTimeCode = -inf\nendTimeCode = 3", "endTimeCode = 1e300"])
def test_time_codes_without_an_end_are_told(seen: list[list[float]], codes: str) -> None:
    Path("a.usda").write_text(f'#usda 1.0\n(\n{codes}\n)\ndef Sphere "s" {{}}\n', encoding="utf-8")
    code, _, err = run("render", "a.usda", "-o", "f.####.exr", "--frames", "all", "-q")
    assert code == 2
    assert "frames: name" in err
    assert not seen


@pytest.mark.parametrize(
    ("options", "places"),
    [
        (["--fps", 4], [[0, 0, 0], [0, 0, 0], [0, 0, 0], [2, 0, 0]]),
        (["--fps", 2, "--animation", "slide"], [[0, 0, 0], [0, 2, 0], [0, 4, 0], [0, 6, 0]]),
        (["--fps", 2, "--animation", "1"], [[0, 0, 0], [0, 2, 0], [0, 4, 0], [0, 6, 0]]),
    ],
)
def test_the_frames_of_a_gltf_animation(seen: list[list[float]], options: list[Any], places: list[list[float]]) -> None:
    Path("a.gltf").write_text(moving(("turn", TURN), ("slide", SLIDE)), encoding="utf-8")
    assert run("render", "a.gltf", "-o", "f.####.exr", "--frames", "all", *options, "-q")[0] == 0
    assert seen == places


@pytest.mark.long
def test_a_gltf_animation_has_24_pictures_a_second(seen: list[list[float]]) -> None:
    Path("a.gltf").write_text(moving((None, TURN)), encoding="utf-8")
    assert run("render", "a.gltf", "-o", "f.####.exr", "--frames", "all", "-q")[0] == 0
    assert len(seen) == 24
    assert run("render", "a.gltf", "-o", "t.exr", "--time", "1s", "-q")[0] == 0
    assert seen[-1] == [4, 0, 0]


def test_a_wrong_animation_lists_the_others(seen: list[list[float]]) -> None:
    Path("a.gltf").write_text(moving(("turn", TURN), ("slide", SLIDE)), encoding="utf-8")
    code, _, err = run("render", "a.gltf", "-o", "a.exr", "--animation", "slid")
    assert code == 1
    assert "a.gltf: error: there is no animation `slid`: the glTF file has `turn`, `slide`; did you mean `slide`?" in err
    Path("b.gltf").write_text(moving(), encoding="utf-8")
    assert "there is no animation `x`: the glTF file has none" in run("render", "b.gltf", "-o", "a.exr", "--animation", "x")[2]
    assert "b.gltf has no range of frames: name them, as in --frames 1..24" in run("render", "b.gltf", "-o", "a.gif", "--frames", "all")[2]
    Path("a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    code, _, err = run("render", "a.obj", "-o", "a.exr", "--animation", "x")
    assert code == 1
    assert "only glTF files have animations with names" in err
    assert not seen


def test_animations_that_are_not_drawn_are_told(seen: list[list[float]]) -> None:
    Path("a.gltf").write_text(moving(("turn", TURN), ("slide", SLIDE)), encoding="utf-8")
    told = "the file has 2 animations (`turn`, `slide`): --time draws a moment of the first, of 1 s, --frames all its pictures"
    assert f"{told}, and --animation takes another" in run("render", "a.gltf", "-o", "a.exr")[2]
    told = "only the first of 2 animations, `turn`, is drawn: --animation takes another (`slide`)"
    assert told in run("render", "a.gltf", "-o", "a.exr", "--time", "1s")[2]
    assert run("render", "a.gltf", "-o", "a.exr", "--animation", "turn", "--time", "1s", "-q") == (0, "", "")


CAMERA = 'def Camera "{}" {{ double3 xformOp:translate = (0, 0, 10)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n}}\n'


@pytest.mark.parametrize(
    ("names", "options", "told"),
    [
        (["c"], [], "a.usda</c>: note: the stage's camera is not used: it is not called `main_cam`, so that the picture frames everything, "
         "as usdrecord does\n  --camera /c takes it\n"),
        (["b", "c"], [], "a.usda</b>: note: none of the stage's 2 cameras is used: none is called `main_cam`, so that the picture frames "
         "everything, as usdrecord does\n  --camera /b takes the first\n"),
        (["c"], ["--camera", "/c"], ""), (["c", "main_cam"], [], ""), ([], [], ""),
    ],
)  # fmt: skip
def test_a_camera_that_is_not_used_is_told(seen: list[list[float]], names: list[str], options: list[str], told: str) -> None:
    text = '#usda 1.0\n(\nupAxis = "Y"\nmetersPerUnit = 1\n)\ndef Sphere "s" {}\n' + "".join(map(CAMERA.format, names))
    Path("a.usda").write_text(text, encoding="utf-8")
    code, _, err = run("render", "a.usda", "-o", "a.exr", "--size", "32x24", *options)
    assert (code, "".join(line for line in err.splitlines(keepends=True) if "amera" in line)) == (0, told)
