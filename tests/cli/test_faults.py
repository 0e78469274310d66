"""Files that are damaged, replaced or cannot be written while a picture is drawn."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.render import render_scene
from maquette.render.film import checkpoint
from maquette.render.image import image_reader

from ..files import standing_by

SCENE = """\
sphere(center: [time / 1s, 1, 0], material: lambert(#d0402a))
point([2, 4, 3], intensity: 20)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
animate(duration: 2s, fps: 4)
render(size: [32, 24], samples: 4, backend: "reference")
"""

LINK = "is a link, and nothing is written through links: remove it, or choose another name"


@pytest.fixture(autouse=True)
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small scene as a.scene in the current folder, and a temporary folder of its own."""
    (tmp_path / "temporary").mkdir()
    standing_by(tmp_path, monkeypatch, SCENE)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))


def run(*arguments: object) -> tuple[int, str]:
    """(exit code, stderr) of a render."""
    done = CliRunner().invoke(cli, ["render", "a.scene", "--exposure", "0", "-q", *map(str, arguments)])
    return done.exit_code, done.stderr


def pixels(path: str) -> np.ndarray:
    return image_reader.read(Path(path)).channels["rgba"]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], Any]], None]:
    """Call it with what happens after a picture is drawn and before it is written."""

    def then(happen: Callable[[], Any]) -> None:
        draw = render_scene.draw

        def changed(*arguments: Any, **more: Any) -> Any:
            image = draw(*arguments, **more)
            happen()
            return image

        monkeypatch.setattr(render_scene, "draw", changed)

    return then


# --- outputs ---------------------------------------------------------------------------------------------------------------


def test_an_output_that_becomes_a_link_to_the_scene_does_not_replace_it(tmp_path: Path, drawn: Any) -> None:
    drawn(lambda: Path("a.exr").symlink_to("a.scene"))
    code, told = run("-o", "a.exr")
    (rescued,) = tmp_path.glob("a.*.rescued.exr")
    assert (code, told) == (1, f"error: a.exr {LINK}; its pixels are in {rescued.name}\n")
    assert Path("a.scene").read_text(encoding="utf-8") == SCENE
    assert pixels(str(rescued)).shape == (24, 32, 4)


def test_rescued_pixels_have_a_new_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: Any) -> None:
    """A link that somebody has planted at the name of a picture, its rescued or its partial one leads nowhere."""
    for name in ("a.rescued.exr", "a.partial.exr", "temporary/a.rescued.exr"):
        Path(name).symlink_to(tmp_path / "a.scene")
    drawn(lambda: Path("a.exr").mkdir())
    code, told = run("-o", "a.exr")
    (rescued,) = tmp_path.glob("a.?*.rescued.exr")
    assert (code, told) == (1, f"error: a.exr is a folder; its pixels are in {rescued.name}\n")
    assert Path("a.scene").read_text(encoding="utf-8") == SCENE


def test_a_folder_that_becomes_a_file(tmp_path: Path, drawn: Any) -> None:
    Path("out").mkdir()

    def happen() -> None:
        Path("out").rmdir()
        Path("out").write_bytes(b"")

    drawn(happen)
    code, told = run("-o", "out/a.exr")
    assert code == 1
    (rescued,) = tmp_path.glob("temporary/a.*.rescued.exr")
    assert told == f"error: cannot write out/a.exr: Not a directory; its pixels are in {rescued}\n"


def test_the_current_folder_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, drawn: Any) -> None:
    (tmp_path / "gone").mkdir()
    shutil.copy("a.scene", tmp_path / "gone" / "a.scene")
    monkeypatch.chdir(tmp_path / "gone")
    drawn(lambda: shutil.rmtree(tmp_path / "gone"))
    code, told = run("-o", "a.exr")
    (rescued,) = tmp_path.glob("temporary/a.*.rescued.exr")
    assert (code, told) == (1, f"error: cannot write a.exr: the current folder was removed; its pixels are in {rescued}\n")


def command(*arguments: object) -> tuple[int, str]:
    """(exit code, stderr) of a command."""
    done = CliRunner().invoke(cli, [*map(str, arguments)])
    return done.exit_code, done.stderr


@pytest.mark.long
@pytest.mark.parametrize(
    ("arguments", "link"),
    [
        (("render", "a.scene", "-o", "b.png", "-q"), "b.png"),
        (("render", "a.scene", "-o", "b.png", "--stats", "b.json", "-q"), "b.json"),
        (("render", "a.scene", "-o", "b.#.png", "--frames", "1..2", "-q"), "b.2.png"),
        (("render", "a.scene", "-o", "b.#.png", "--frames", "1..2", "--resume", "-q"), "b.2.png"),
        (("render", "a.scene", "-o", "b.gif", "--frames", "1..2", "-q"), "b.gif"),
        (("convert", "a.scene", "b.obj"), "b.obj"),
        (("convert", "a.scene", "b.usda"), "b.usda"),
        (("sweep", "a.scene", "--set", "radius=1,2", "-o", "b.png", "-q"), "b.png"),
        (("thumbnail", "a.scene", "-o", "."), "a.scene.png"),
        (("thumbnail", "a.scene", "-o", "."), "index.html"),
        (("format", "b.scene"), "b.scene"),
        (("new", "b.scene"), "b.scene"),
        (("chart", "a.json", "-o", "b.svg"), "b.svg"),
    ],
)
def test_nothing_is_written_through_a_link(tmp_path: Path, arguments: tuple[str, ...], link: str) -> None:
    (tmp_path / "secret").write_text("sphere( 1 )\n", encoding="utf-8")
    Path("a.scene").write_text(f"param radius = 1\n{SCENE}", encoding="utf-8")
    Path("a.json").write_text("{}", encoding="utf-8")
    Path(link).symlink_to(tmp_path / "secret")
    code, told = command(*arguments)
    if "thumbnail" not in arguments or link == "index.html":
        assert code == 1
    assert "is a link, and nothing is written through links" in told or "exists already" in told
    assert Path(link).is_symlink()
    assert (tmp_path / "secret").read_text(encoding="utf-8") == "sphere( 1 )\n"


def test_frames_are_not_removed_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "0001.png").write_bytes(b"a photo")
    Path("b.gif.frames").symlink_to("photos")
    assert run("-o", "b.gif", "--frames", "1..2") == (1, f"error: b.gif.frames {LINK}\n")
    assert (tmp_path / "photos" / "0001.png").read_bytes() == b"a photo"


# --- inputs ----------------------------------------------------------------------------------------------------------------


def test_no_pipe_is_waited_for() -> None:
    """As a picture of a stage, its layer, and the files of the command line."""
    os.mkfifo("pipe.png")
    os.mkfifo("pipe.usda")
    os.mkfifo("pipe.scene")
    Path("a.usda").write_text(
        """#usda 1.0
(subLayers = [@pipe.usda@])
def DomeLight "Sky" {
    asset inputs:texture:file = @pipe.png@
}
""", encoding="utf-8"
    )  # fmt: skip
    size = ("--size", "8", "--samples", "1", "-q", "-o", "b.png")
    code, told = command("render", "a.usda", *size)
    assert (code, "not an ordinary file" in told, "the picture `pipe.png` is not an ordinary file" in told) == (0, True, True), told
    why = "pipe.usda is a device, a pipe or a socket: give the name of a file\n"
    code, told = command("render", "a.usda", "--session-layer", "pipe.usda", *size)
    assert (code, told.endswith(why)) == (2, True)
    for arguments in (("check", "pipe.scene"), ("format", "pipe.scene"), ("compare", "pipe.png", "pipe.png"), ("inspect", "pipe.usda")):
        code, told = command(*arguments)
        assert (code, "ordinary file" in told) == (1, True), (arguments, told)


# --- frames ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damage", ["empty", "cut", "other"])
@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_a_damaged_frame_is_drawn_again(suffix: str, damage: str) -> None:
    frames = ("-o", f"f.#.{suffix}", "--frames", "1..2")
    assert run(*frames) == (0, "")
    whole = Path(f"f.2.{suffix}").read_bytes()
    broken = {"empty": b"", "cut": whole[: len(whole) // 2], "other": b"text"}[damage]
    expected = [pixels(f"f.{n}.{suffix}") for n in (1, 2)]
    for n in (1, 2):
        Path(f"f.{n}.{suffix}").write_bytes(broken)
        assert run(*frames, "--resume") == (0, f"warning: f.{n}.{suffix} is damaged: the frame is drawn again\n")
    np.testing.assert_array_equal([pixels(f"f.{n}.{suffix}") for n in (1, 2)], expected)


def test_an_animation_is_drawn_by_one_process() -> None:
    """Two that draw into one folder would mix their frames."""
    Path("a.apng.frames").mkdir()
    handle = os.open("a.apng.frames", os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    frames = ("-o", "a.apng", "--frames", "0..1")
    assert run(*frames) == (1, "error: another process renders a.apng: wait for it, or choose another -o\n")
    assert not Path("a.apng").exists()
    os.close(handle)
    assert run(*frames) == (0, "")
    assert not Path("a.apng.frames").exists()


# --- checkpoints -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("what", ["folder", "link"])
def test_no_checkpoint_can_stand_there(what: str) -> None:
    file = Path("a.exr.checkpoint")
    file.mkdir() if what == "folder" else file.symlink_to("a.scene")
    why = {"folder": "is a folder", "link": LINK}[what]
    assert run("-o", "a.exr") == (1, f"error: a.exr.checkpoint {why}; remove it, or give --checkpoint off\n")
    assert run("-o", "a.exr", "--checkpoint", "off", "--seed", "2") == (0, "")
    assert Path("a.scene").read_text(encoding="utf-8") == SCENE


def test_a_checkpoint_that_cannot_be_written_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once; the picture goes on."""

    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    hint = "the picture goes on; make room there, or give --checkpoint off"
    told = f"warning: cannot write a.exr.checkpoint: No space left on device\n  {hint}\n"
    monkeypatch.setattr(checkpoint.Keeper, "due", lambda _: True)
    assert run("-o", "a.exr", "--size", "96x96", "--threads", "1") == (0, told)
    assert Path("a.exr").is_file()


WITHOUT = [
    ((), "--aov", "lights", "it has channels of light groups"),
    (("--samples", "1"), "--size", "16x12", "it has one sample a pixel"),
    (("--backend", "raster"), "--plan", "raster.sample_positions=shared", "the rasterizer draws it as a whole"),
]


@pytest.mark.parametrize(("options", "name", "value", "why"), WITHOUT)
@pytest.mark.parametrize(("asked", "time"), [("--checkpoint", "5s"), ("--resume", "")])
def test_options_of_checkpoints_without_effect(options: tuple[str, ...], name: str, value: str, why: str, asked: str, time: str) -> None:
    given = ["render", "a.scene", "-o", "a.exr", *options, name, value, *filter(None, (asked, time))]
    done = CliRunner().invoke(cli, given)
    note = f"note: {asked} has no effect: the picture has no checkpoints, as {why}\n"
    assert (done.exit_code, [line for line in done.stderr.splitlines(True) if "effect" in line]) == (0, [note])


@pytest.mark.parametrize(
    ("camera", "why"), [("shutter: 0.5s", "the rasterizer draws its motion"), ("aperture: 4", "the rasterizer draws its depth of field")]
)
def test_the_rasterizer_has_no_checkpoints_of_motion_and_lenses(camera: str, why: str) -> None:
    Path("a.scene").write_text(SCENE.replace("fov: 35deg", f"fov: 35deg, {camera}"), encoding="utf-8")
    done = CliRunner().invoke(cli, ["render", "a.scene", "-o", "a.exr", "--backend", "raster", "--checkpoint", "5s", "--resume"])
    notes = [f"note: {asked} has no effect: the picture has no checkpoints, as {why}" for asked in ("--checkpoint", "--resume")]
    assert (done.exit_code, [line for line in done.stderr.splitlines() if "effect" in line]) == (0, notes)


def test_resume_without_a_checkpoint_is_told() -> None:
    done = CliRunner().invoke(cli, ["render", "a.scene", "-o", "a.exr", "--resume"])
    assert (done.exit_code, done.stderr) == (0, "note: --resume has no effect: there is no a.exr.checkpoint\n")


def test_frames_without_checkpoints_tell_once() -> None:
    options = ("--frames", "0..2", "--samples", "1", "--checkpoint", "5s", "--resume")
    done = CliRunner().invoke(cli, ["render", "a.scene", "-o", "a.#.exr", *options])
    note = "note: --checkpoint has no effect: the picture has no checkpoints, as it has one sample a pixel\n"
    assert (done.exit_code, done.stderr) == (0, note)


def test_resume_reads_a_checkpoint_though_none_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("a.exr.checkpoint").write_bytes(b"")
    told = "warning: a.exr.checkpoint is damaged, or of another scene, version, machine or settings: the picture begins anew\n"
    assert run("-o", "a.exr", "--resume", "--checkpoint", "off") == (0, told)
    assert not Path("a.exr.checkpoint").exists()


@pytest.mark.long
@pytest.mark.parametrize("name", ["maquette", "kernels", "target", "numpy"])
def test_a_checkpoint_of_another_installation_is_told(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its kernels or libraries may draw other bits."""
    from maquette.render.cluster import identity

    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    options = ("-o", "a.exr", "--size", "96x96", "--threads", "1")
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.Keeper, "due", lambda _: True)
        patch.setattr(checkpoint.Keeper, "remove", interrupted)
        assert run(*options)[0] == 130
    assert Path("a.exr.checkpoint").is_file()
    other = {**identity.identity(), name: "other"}
    monkeypatch.setattr(identity, "identity", lambda: other)
    told = "warning: a.exr.checkpoint is damaged, or of another scene, version, machine or settings: the picture begins anew\n"
    assert run(*options, "--resume") == (0, told)
