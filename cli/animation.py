"""Animations of `render --frames`: renders the frames that are missing, and puts them into one file."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..compiler.io.replace_file import make_folder

if TYPE_CHECKING:
    from .render_job import Job

SUFFIXES = (".gif", ".apng", ".webp", ".mp4")


def is_animation(path: Path) -> bool:
    """Whether an output file holds all frames."""
    return path.suffix.lower() in SUFFIXES


def frame_files(path: Path) -> Path:
    """The pattern of the pictures of an animation's frames, in a folder beside it that is removed in the end."""
    return path.with_name(f"{path.name}.frames") / "####.png"


def check(path: Path, frames: tuple[float, ...] | None) -> None:
    """Check before rendering that an animation can be written. Raises UsageError, or OSError for a wrong folder."""
    from ..render.image import animation
    from .render_job import check_folder

    if frames is None:
        raise click.UsageError(f"{path.name} is an animation: give its --frames, such as 1..48")
    try:
        animation.check(path)
    except animation.FormatError as error:
        raise click.UsageError(str(error)) from None
    check_folder(path)


def render(job: Job, path: Path, frames: tuple[float, ...], fps: float | None) -> list[dict[str, Any]]:
    """Render an animation; returns the statistics of the frames rendered. Raises KeyboardInterrupt after a partial one."""
    job.output = frame_files(path)
    folder = job.output.parent
    make_folder(folder)
    with _locked(folder, path):
        return _render(job, path, folder, frames, fps)


def _render(job: Job, path: Path, folder: Path, frames: tuple[float, ...], fps: float | None) -> list[dict[str, Any]]:
    from ..render.image import animation

    if not job.resume:
        for file in _pictures(folder):
            file.unlink()
    try:
        pictures = job.run(frames)
    except BaseException:
        if done := len(_pictures(folder)):
            click.echo(f"{done} frame{'' if done == 1 else 's'} in {folder}: --resume continues from there", err=True)
        _remove(folder, keep=True)
        raise
    numbers = job.source.frames(frames)
    animation.write(path, [job.frame_file(number) for number in numbers], _durations(numbers, fps or job.source.rate()))
    _remove(folder)
    if not job.quiet:
        click.echo(f"{path}: {len(numbers)} frame{'' if len(numbers) == 1 else 's'}, {path.stat().st_size / 1e6:.2f} MB")
    return pictures


@contextmanager
def _locked(folder: Path, path: Path) -> Iterator[None]:
    """Hold the folder of an animation's frames, while this process lives. Raises OSError if another one holds it."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OSError(f"another process renders {path}: wait for it, or choose another -o") from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(handle)


def _pictures(folder: Path) -> list[Path]:
    return [file for file in folder.glob("*.png") if re.fullmatch(r"-?\d+(\.\d+)?", file.stem)]


def _remove(folder: Path, keep: bool = False) -> None:
    """Remove the pictures of frames, without `keep`, and their folder if it then is empty."""
    for file in () if keep else _pictures(folder):
        file.unlink()
    with suppress(OSError):
        folder.rmdir()


def _durations(numbers: Sequence[float], fps: float) -> list[float]:
    """The seconds of each frame: up to the next one, and for the last one as long as the one before."""
    steps = [after - before for before, after in itertools.pairwise(numbers)] or [1.0]
    return [step / fps for step in (*steps, steps[-1])][: len(numbers)]
