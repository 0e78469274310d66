"""Chooses the frames of an animation that `--resume` keeps: whole ones of the same scene and settings."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ... import __version__
from ...compiler.io.regular_files import ANY_SIZE, open_regular

if TYPE_CHECKING:
    from ...compiler import ir
    from ...compiler.plan.plan import Plan


class Keys(NamedTuple):
    """Keys of frames, as attributes of their files. Frames of equal `inputs` need no look at `picture`."""

    inputs: str  # of the animation: its files, and the first frame's scene and settings
    picture: str  # of the frame's own scene and settings


class ExistingFrames(NamedTuple):
    """Frames that are there, and the attributes of their files. JPEG has none: its frames count as finished."""

    finished: dict[Path, dict[str, str]]
    damaged: list[Path]
    others: dict[Path, dict[str, str]]  # of other inputs


def keys_of(scene: ir.Scene, plan: Plan, bits: int | None, inputs: str) -> Keys:
    """The keys of a frame that is written with a number of bits. `inputs` is the animation's key, "" for its first frame."""
    from ...render.film import checkpoint

    version = f"{__version__} {bits or 8}"
    return Keys(inputs or checkpoint.key_of(scene, plan, f"{version} {_digest(scene.files)}"), checkpoint.key_of(scene, plan, version))


def _digest(files: Iterable[str]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for file in sorted(files):
        if Path(file).is_file():
            with open_regular(file, ANY_SIZE) as opened:
                digest.update(hashlib.file_digest(opened, "blake2b").digest())
    return digest.hexdigest()


def find(files: Iterable[Path], inputs: str) -> ExistingFrames:
    """The frames among some files of an animation with a key."""
    from ...render.image import image_files, image_reader

    frames = ExistingFrames({}, [], {})
    for file in files:
        if not file.is_file() or file.is_symlink():  # a link is refused when the frame is drawn
            continue
        if image_files.damage(file):
            frames.damaged.append(file)
            continue
        about = image_reader.about(file)
        same = not about or about.get("inputs") == inputs
        (frames.finished if same else frames.others)[file] = about
    return frames
