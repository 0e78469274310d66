"""Writes animations from image files of their frames: GIF, APNG and WebP through Pillow, MP4 (H.264) through PyAV."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from ...compiler.io.replace_file import replacing
from ...lang.distribution import install_command
from .image_files import FormatError

PILLOW = {".gif": "GIF", ".apng": "PNG", ".webp": "WEBP"}
VIDEO = (".mp4",)
QUALITY = "18"  # of H.264: constant rate factor; 0 is lossless, 23 the encoder's default
TICKS = 90_000  # a second, of time stamps in an MP4 file


def check(path: Path) -> None:
    """Check before rendering that an animation can be written. Raises FormatError."""
    if path.suffix.lower() in VIDEO and importlib.util.find_spec("av") is None:
        raise FormatError(f".mp4 files take the package av, which is not installed: {install_command('video')}")


def write(path: Path, frames: Sequence[Path], seconds: Sequence[float]) -> None:
    """Write an animation that repeats, from the image file of each frame and its duration; replaces `path` atomically.

    GIF has one bit of alpha and 256 colors a frame, MP4 no alpha: transparent pixels are over black.
    """
    with replacing(path) as partial:
        if path.suffix.lower() in VIDEO:
            _write_video(partial, frames, seconds)
        else:
            _write_pictures(partial, frames, seconds)


class _Pictures:
    """The pictures of image files, which can be iterated more than once, as Pillow does; one is in memory at a time."""

    def __init__(self, files: Sequence[Path], has_palette: bool) -> None:
        self.files, self.has_palette = files, has_palette

    def __iter__(self) -> Iterator[Any]:
        from PIL import Image

        for file in self.files:
            with Image.open(file) as frame:
                reduced = self.has_palette and frame.mode == "RGB"
                yield frame.quantize(dither=Image.Dither.FLOYDSTEINBERG) if reduced else frame.copy()


def _write_pictures(path: Path, frames: Sequence[Path], seconds: Sequence[float]) -> None:
    suffix = path.suffix.lower()
    is_gif = suffix == ".gif"
    (first,) = _Pictures(frames[:1], is_gif)
    options: dict[str, Any] = {".gif": {"disposal": 2}, ".webp": {"quality": 90, "method": 4}, ".apng": {}}[suffix]
    options |= {"duration": _rounded(seconds, 10 if is_gif else 1), "loop": 0}
    first.save(path, format=PILLOW[suffix], save_all=True, append_images=_Pictures(frames[1:], is_gif), **options)


def _rounded(seconds: Sequence[float], step: int) -> list[int]:
    """Durations in milliseconds, in whole steps, whose sums deviate from the exact ones by less than a step."""
    ends = np.rint(np.cumsum(seconds) * 1000.0 / step).astype(int)
    return [max(int(length), 1) * step for length in np.diff(ends, prepend=0)]


def _write_video(path: Path, frames: Sequence[Path], seconds: Sequence[float]) -> None:
    import av
    from PIL import Image

    starts = np.concatenate([[0.0], np.cumsum(seconds)[:-1]])
    rate = Fraction(1.0 / min(seconds)).limit_denominator(1001)
    with av.open(str(path), "w", format="mp4") as file:
        stream: Any = None
        for name, start in zip(frames, starts, strict=True):
            with Image.open(name) as picture:
                pixels = np.asarray(Image.alpha_composite(Image.new("RGBA", picture.size, "black"), picture.convert("RGBA")))[..., :3]
            height, width = pixels.shape[:2]
            pixels = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), "edge")  # the encoder takes even sizes
            if stream is None:
                stream = file.add_stream("libx264", rate=rate, options={"crf": QUALITY, "preset": "slow"})
                stream.width, stream.height, stream.pix_fmt = pixels.shape[1], pixels.shape[0], "yuv420p"
                stream.codec_context.time_base = Fraction(1, TICKS)
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")
            frame.pts, frame.time_base = math.floor(start * TICKS + 0.5), Fraction(1, TICKS)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
