"""Pictures rendered in strips have the same files as pictures rendered at once."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.render import large_images, render_scene

from ..files import standing_by

SCENE = """\
sphere(1, center: [0, 1, 0], material: phong(#d0402a, specular: 0.3))
plane(y: 0, material: lambert(checker(#eee, #333)))
area([2, 4, 3], look_at: [0, 1, 0], size: [1, 1], flux: 40)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
render(size: [80, 150])
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return standing_by(tmp_path, monkeypatch, SCENE)


def hold_less(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limit memory to less than the picture: strips of 32 rows."""
    monkeypatch.setattr(large_images, "MAX_PIXELS", 80 * 40)
    monkeypatch.setattr(large_images, "STRIP_PIXELS", 80 * 40)


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    hold_less(monkeypatch)


def run(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(cli, ["render", "a.scene", *map(str, arguments)])
    return done.exit_code, done.stderr


def pixels(path: str) -> tuple[np.ndarray, tuple[str, ...]]:
    source = oiio.ImageInput.open(path)
    assert source is not None
    values = np.asarray(source.read_image(0, 0, 0, source.spec().nchannels, oiio.FLOAT)), tuple(source.spec().channelnames)
    source.close()
    return values


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("a.exr", ("--aov", "depth,normal,id,samples", "--samples", 4)),
        ("a.exr", ("--crop", "10,7,70,140", "--samples", 2)),
        ("a.png", ("--samples", 1, "--bits", 16)),
        ("a.jpg", ("--samples", 1)),
    ],
)  # fmt: skip
def test_strips_make_the_file_that_the_whole_makes(folder, monkeypatch, backend, name, more):
    at_once = run("--backend", backend, "-o", name, *more)
    first = pixels(name)
    hold_less(monkeypatch)
    parts = run("--backend", backend, "-o", "b" + name, *more)
    second = pixels("b" + name)
    assert at_once[0] == parts[0] == 0
    assert first[1] == second[1]
    assert np.array_equal(first[0], second[0])
    assert len(np.unique(first[0])) > 20
    assert not list(folder.glob(".*"))


@pytest.mark.long
def test_an_error_is_that_of_all_strips(folder, small):
    assert run("--error", "5%", "-o", "a.exr")[0] == 0
    source = oiio.ImageInput.open("a.exr")
    assert source is not None
    assert source.spec().height == 150


def test_what_needs_the_whole_picture_is_refused(folder, small):
    text = SCENE.replace("flux: 40", "flux: 900lm")  # light in lumens is metered
    (folder / "a.scene").write_text(text, encoding="utf-8")
    code, said = run("-o", "a.png")
    assert code == 2
    assert "a picture of 80 by 150 pixels is rendered in strips: metering needs the whole picture: give --exposure" in said
    assert not (folder / "a.png").exists()
    assert run("-o", "a.exr", "--samples", 1)[0] == 0  # linear light needs no exposure


def test_an_interrupted_picture_is_kept_aside(folder, small, monkeypatch):
    """The first strips are rendered, the others empty; the old file stays."""
    (folder / "a.exr").write_bytes(b"old")
    drawn, every = render_scene.draw, []

    def interrupted(scene, plan, progress, cancel: threading.Event, **others):
        every.append(plan["crop"])
        if len(every) == 3:
            cancel.set()
        return drawn(scene, plan, progress, cancel, **others)

    monkeypatch.setattr(render_scene, "draw", interrupted)
    code, said = run("--samples", 1, "-o", "a.exr")
    assert code == 130
    assert "interrupted: the partial picture is in a.partial.exr" in said
    assert (folder / "a.exr").read_bytes() == b"old"
    values = pixels("a.partial.exr")[0]
    assert values.shape[0] == 150
    assert values[:64].any()
    assert not values[64:].any()
