"""Animations of `render --frames`: frames, durations, resuming, and messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from PIL import Image

from ..files import standing_by

SCENE = """\
let moment = time / 1s
box([1, 1, 1], center: [moment, 0, 0], material: lambert(#ffffff))
ambient(luminance: 1)
camera(position: [0.5, 0, 5], look_at: [0.5, 0, 0], projection: "orthographic", width: 6)
animate(duration: 2s, fps: 4)
render(size: [41, 21], samples: 1, bounces: 0)
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    standing_by(tmp_path, monkeypatch, SCENE)
    return Path("a.scene")


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, ["render", "--background", "#000000", *map(str, arguments)])
    return done.exit_code, done.stdout, done.stderr


def centers(frames: list[np.ndarray]) -> list[float]:
    """The mean column of the bright pixels of each frame."""
    return [float(np.mean(np.nonzero(frame[..., :3].mean(axis=-1) > 128)[1])) for frame in frames]


def frames_of(path: Path) -> tuple[list[np.ndarray], list[float]]:
    """(pictures, durations in seconds)."""
    if path.suffix == ".mp4":
        with av.open(str(path)) as file:
            stream: Any = file.streams.video[0]
            found = [(frame.to_ndarray(format="rgb24"), frame.time) for frame in file.decode(stream)]
            ends = [*[time for _, time in found[1:]], float(stream.duration * stream.time_base)]
        return [pixels for pixels, _ in found], [end - time for (_, time), end in zip(found, ends, strict=True)]
    with Image.open(path) as file:
        pictures, durations = [], []
        for k in range(getattr(file, "n_frames")):  # noqa: B009 (not in the types of Pillow)
            file.seek(k)
            file.load()
            durations.append(file.info["duration"] / 1000.0)
            pictures.append(np.asarray(file.convert("RGB")))
    return pictures, durations


@pytest.mark.parametrize("suffix", ["gif", "webp", "apng", "mp4"])
def test_frames_and_their_durations(scene: Path, suffix: str) -> None:
    path = Path(f"a.{suffix}")
    code, out, err = run(scene, "-o", path, "--frames", "0..4x2")
    assert (code, err) == (0, "")
    assert out.splitlines()[-1].startswith(f"{path}: 3 frames, 0.0")
    pictures, durations = frames_of(path)
    assert durations == pytest.approx([0.5, 0.5, 0.5], abs=0.001)
    across = 41 / 6  # pixels a meter
    assert np.diff(centers(pictures)) == pytest.approx([0.5 * across, 0.5 * across], abs=0.6)
    assert {p.name for p in Path().iterdir()} == {"a.scene", path.name}


def test_the_rate_can_be_given(scene: Path) -> None:
    assert run(scene, "-o", "a.webp", "--frames", "0..2", "--fps", "25", "-q") == (0, "", "")
    assert frames_of(Path("a.webp"))[1] == pytest.approx([0.04, 0.04, 0.04])


def test_durations_of_a_gif_are_hundredths_whose_sum_is_right(scene: Path) -> None:
    assert run(scene, "-o", "a.gif", "--frames", "0..5", "--fps", "30", "-q") == (0, "", "")
    durations = frames_of(Path("a.gif"))[1]
    assert set(np.round(durations, 3)) <= {0.03, 0.04}
    assert sum(durations) == pytest.approx(0.2)


def test_resuming_keeps_the_frames_that_are_there(scene: Path) -> None:
    assert run(scene, "-o", "f.##.png", "--frames", "0..1", "-q")[0] == 0
    Path("f.01.png").unlink()
    before = Path("f.00.png").stat().st_mtime_ns
    code, out, err = run(scene, "-o", "f.##.png", "--frames", "0..2", "--resume")
    assert (code, err) == (0, "1 frame is there already\n")
    assert [line.split(":")[0] for line in out.splitlines()] == ["f.01.png", "f.02.png"]
    assert Path("f.00.png").stat().st_mtime_ns == before


@pytest.mark.long
def test_resuming_draws_frames_of_another_scene_again(scene: Path) -> None:
    assert run(scene, "-o", "f.##.png", "--frames", "0..3", "-q")[0] == 0
    scene.write_text(SCENE.replace("[moment, 0, 0]", "[min(moment, 0.25), 0, 0]"), encoding="utf-8")  # frames 0 and 1 stay the same
    code, out, err = run(scene, "-o", "f.##.png", "--frames", "0..3", "--resume")
    assert code == 0
    assert err.splitlines() == [
        "warning: 2 frames are of another scene, version or settings, such as f.02.png: drawn again",
        "2 frames are there already",
    ]
    assert [line.split(":")[0] for line in out.splitlines()] == ["f.02.png", "f.03.png"]
    again = [Path(f"f.0{k}.png").read_bytes() for k in range(4)]
    assert run(scene, "-o", "g.##.png", "--frames", "0..3", "-q")[0] == 0
    assert [pixels(Path(f"g.0{k}.png")) for k in range(4)] == [pixels(Path(f"f.0{k}.png")) for k in range(4)]
    assert run(scene, "-o", "f.##.png", "--frames", "0..3", "--resume", "-q") == (0, "", "")
    assert [Path(f"f.0{k}.png").read_bytes() for k in range(4)] == again


@pytest.mark.parametrize("more", [("--samples", "4"), ("--bits", "16"), ("--size", "20x20")])
def test_resuming_draws_frames_of_other_settings_again(scene: Path, more: tuple[str, ...]) -> None:
    assert run(scene, "-o", "f.##.png", "--frames", "0..1", "-q")[0] == 0
    code, out, err = run(scene, "-o", "f.##.png", "--frames", "0..1", "--resume", *more)
    assert code == 0
    assert err.splitlines() == ["warning: 2 frames are of another scene, version or settings, such as f.00.png: drawn again"]
    assert len(out.splitlines()) == 2


def pixels(path: Path) -> list[int]:
    return np.asarray(Image.open(path)).tolist()


def test_an_animation_resumes_after_an_error(scene: Path) -> None:
    text = SCENE.replace("animate(", "assert(moment < 0.4)\nanimate(")
    scene.write_text(text, encoding="utf-8")
    code, _, err = run(scene, "-o", "a.gif", "--frames", "0..2")
    assert code == 1
    assert "2 frames in a.gif.frames: --resume continues from there" in err.splitlines()
    assert not Path("a.gif").exists()
    scene.write_text(SCENE, encoding="utf-8")
    code, out, err = run(scene, "-o", "a.gif", "--frames", "0..2", "--resume")
    assert (code, err) == (0, "2 frames are there already\n")
    assert out.splitlines()[-1].startswith("a.gif: 3 frames")
    assert not Path("a.gif.frames").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-o", "a.gif"), "a.gif is an animation: give its --frames, such as 1..48"),
        (("-o", "a.png", "--frames", "0..2", "--fps", "12"), "--fps is for animations: .mp4, .gif, .webp or .apng"),
    ],
)
def test_wrong_options(scene: Path, options: tuple[str, ...], message: str) -> None:
    code, _, err = run(scene, *options)
    assert (code, err.splitlines()[-1]) == (2, f"Error: {message}")


def test_transparent_pixels_of_a_video_are_black(scene: Path) -> None:
    assert run(scene, "-o", "a.mp4", "--frames", "0..1", "--background", "transparent", "-q") == (0, "", "")
    assert frames_of(Path("a.mp4"))[0][0][0, 0].max() < 20
