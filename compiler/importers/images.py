"""Loads images for textures through OpenImageIO, from disk or memory, as linear float32 r, g, b, a."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ...lang.input_error import InputError
from ..io import color_encoding, library_messages, picture_contents, stage_cache
from ..io.color_config import Config
from ..io.color_encoding import Encoding
from ..io.regular_files import is_regular, read_bytes
from .khronos import ktx2

if TYPE_CHECKING:
    from ..scene.builder import SceneBuilder

MAX_TEXELS = 1 << 26  # of one image: 8192 × 8192, 1 GiB
MAX_ALL_TEXELS = 1 << 27  # of all images of a scene
LARGEST = float(np.finfo(np.float32).max)
PLAIN = ("srgb", "linear")  # spaces in which numbers and colours are the same
_BAND = 1 << 14  # pixels that are converted together


class ImageError(InputError):
    """An image that cannot be read. The caller adds the span."""


class Decoded(NamedTuple):
    """A decoded image file."""

    texels: np.ndarray
    """(h, w, 4) float32 linear r, g, b, unassociated alpha; finite."""
    odd: int
    """Number of pixels that were infinite or NaN."""
    faults: tuple[tuple[str, str], ...]
    """(message, hint) of all that is missing, not drawn, or drawn by a guess."""
    is_wide: bool = False
    """Whether colours lie beyond Rec.709, with negative components."""

    def warn(self, name: str, diagnostics: Diagnostics, span: Span | None) -> None:
        """Add a warning for each fault of the image `name`, and for its pixels that are not finite."""
        for message, hint in self.faults:
            diagnostics.warning(message, span, hint)
        if self.odd:
            pixels = self.texels.shape[0] * self.texels.shape[1]
            message = f"{self.odd:,} of {pixels:,} pixels of the picture `{name}` are infinite or no numbers"
            hint = f"they are drawn as {LARGEST:.1e} and as 0; half floats end at 65504: write it as float"
            diagnostics.warning(message, span, hint)


def row(builder: SceneBuilder, path: Path, space: str = "auto", color: bool = True, span: Span | None = None) -> int:
    """The row in ir.Images of an image file, loaded once for each colour space. Raises ImageError.

    `path` is already allowed by Files. `space` "auto" means sRGB for an 8 or 16 bit integer image used as a `color`, linear otherwise;
    others are those of color_encoding.find. Warnings refer to `span`.
    """
    return _row(builder, str(path), space, color, lambda: str(path), path.name, span)


def row_from_bytes(
    builder: SceneBuilder, data: bytes, name: str, space: str = "auto", color: bool = True, span: Span | None = None
) -> int:  # fmt: skip
    """Like `row`, for an image file in memory (from a .usdz or .glb). `name` with its extension identifies the image."""
    return _row(builder, name, space, color, lambda: data, name, span)


def _row(builder: SceneBuilder, key: str, space: str, color: bool, source: Any, name: str, span: Span | None) -> int:
    space = "linear" if space == "auto" and not color else space
    limit, config = min(MAX_TEXELS, MAX_ALL_TEXELS - builder.texels), builder.files.colors

    def texture_row() -> int:
        decoded = _read_cached(source(), name, (space, limit, color, config))
        decoded.warn(name, builder.diagnostics, span)
        builder.is_wide |= decoded.is_wide
        return builder.image(decoded.texels, key)

    return builder.shared(("image", key, space, color or space in PLAIN), texture_row)


def _read_cached(source: str | bytes, name: str, how: tuple[str, int, bool, Config | None]) -> Decoded:
    """As `read`, or its result of the last compilation; `how` are its last arguments."""
    try:
        data = source if isinstance(source, bytes) else read_bytes(source)
    except OSError:
        return read(source, name, *how)
    key = (data, name, *how[:3], how[3].name if how[3] is not None else "")
    return stage_cache.cached("images read", key, lambda: read(source, name, *how))


@library_messages.left_out()
def read(
    source: str | bytes, name: str, space: str = "auto", limit: int = MAX_TEXELS, color: bool = True, config: Config | None = None
) -> Decoded:
    """Decode a path or a file's bytes. `name` is the one in messages. Raises ImageError.

    The first picture of the file is read: its R, G, B and A, or the channels that `choose_channels` selects. Infinite values become
    the largest float, NaN becomes 0. Colours become Rec.709; those beyond it are negative.
    """
    import OpenImageIO as oiio

    if (data := _start(source)).startswith(ktx2.IDENTIFIER):
        return _read_ktx2(data if isinstance(source, bytes) else read_bytes(source), name, space, limit, color, config)
    with _on_disk(source) as path, np.errstate(all="ignore"):
        wanted = oiio.ImageSpec()
        wanted.attribute("oiio:UnassociatedAlpha", 1)
        picture = oiio.ImageInput.open(path, wanted)
        if picture is None:
            raise ImageError(f"cannot read the picture `{name}`", _reason(picture_contents.message_of(oiio), path, name))
        try:
            spec = picture.spec()
            width, height = max(spec.width, spec.full_width), max(spec.height, spec.full_height)
            if width * height * max(1, spec.depth) > limit:
                raise ImageError(
                    f"the picture `{name}` is too big: {width} by {height} pixels",
                    f"at most {MAX_TEXELS:,} in one and {MAX_ALL_TEXELS:,} in all pictures of a scene",
                )
            names = picture_contents.channel_names(spec)
            channels = picture_contents.choose_channels(names, spec.alpha_channel, picture.format_name())
            first = min(channels.used)
            pixels = picture.read_image(0, 0, first, max(channels.used) + 1, _stored_type(spec))
            if pixels is None:
                raise ImageError(f"the picture `{name}` is damaged", _reason(picture_contents.message_of(picture), path, name))
            encoding, odd_space = _encoding(spec, name, space, color, config)
            unread, is_srgb = channels.unread(names), space in ("auto", "srgb")
            faults = (*picture_contents.faults(picture, channels.stand_in, unread, path, name, is_srgb=is_srgb), *odd_space)
        finally:
            picture.close()
    if pixels.ndim == 4:  # first slice of a volume
        pixels = pixels[0]
    pixels = pixels.reshape(spec.height, spec.width, -1)
    rows = [k - first for k in channels.used]
    if rows != list(range(pixels.shape[2])):
        pixels = pixels[..., rows]
    alpha = len(channels.colors) if channels.alpha >= 0 else -1
    texels = _in_display_window(_linear(pixels, spec, alpha, encoding), spec)
    odd = 0 if pixels.dtype != np.float32 else _make_finite(texels)
    return Decoded(texels, odd, faults, encoding.changes_colors and bool((texels[..., :3] < 0.0).any()))


def _start(source: str | bytes) -> bytes:
    """The first bytes of an ordinary file, or all that are in memory."""
    if isinstance(source, bytes):
        return source
    if not is_regular(source):
        return b""
    with open(source, "rb") as file:
        return file.read(len(ktx2.IDENTIFIER))


def _read_ktx2(data: bytes, name: str, space: str, limit: int, color: bool, config: Config | None) -> Decoded:
    """A picture in KTX 2, as `read`. How it is used says whether its colours are encoded, as in glTF."""
    import OpenImageIO as oiio

    try:
        pixels, is_srgb, others = ktx2.decode(data, name, limit)
    except InputError as failure:
        raise ImageError(failure.message, failure.hint) from None
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 4, "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    encoding, faults = _encoding(spec, name, space, color, config)
    if (is_srgb and not color) or (space == "auto" and color and not is_srgb):
        as_written, used = ("sRGB", "data") if is_srgb else ("linear", "a colour in sRGB")
        faults = [*faults, (f"the picture `{name}` says that it is {as_written}: it is drawn as {used}", "")]
    if others:
        faults = [*faults, (f"the picture `{name}` has {others} further layers or faces, which are not drawn", "")]
    texels = _linear(pixels, spec, 3, encoding)
    return Decoded(texels, 0, tuple(faults), encoding.changes_colors and bool((texels[..., :3] < 0.0).any()))


def _encoding(spec: Any, name: str, space: str, color: bool, config: Config | None) -> tuple[Encoding, list[tuple[str, str]]]:
    """The encoding of a picture, and the fault of its chromaticities. Raises ImageError for a colour space that is not known."""
    primaries = picture_contents.chromaticities(spec)
    try:
        return color_encoding.find(space, _stored_type(spec) != "float", color, primaries, config), []
    except ValueError:
        message = f"the chromaticities of the picture `{name}` are not of a colour space: its colours are drawn as Rec.709"
        return color_encoding.find(space, False), [(message, "write them as x and y of red, green, blue and white")]
    except InputError as unknown:
        raise ImageError(unknown.message, unknown.hint) from None


def matrix(source: str | bytes, name: str, names: tuple[str, ...]) -> np.ndarray | None:
    """The first of the metadata `names` with sixteen numbers in an image file, (4, 4), row by row; None without one. Raises ImageError."""
    import OpenImageIO as oiio

    with _on_disk(source) as path:
        picture = oiio.ImageInput.open(path)
        if picture is None:
            raise ImageError(f"cannot read the picture `{name}`", _reason(picture_contents.message_of(oiio), path, name))
        attributes = [picture.spec().getattribute(key) for key in names]
        picture.close()
    return next((np.array(values, np.float64).reshape(4, 4) for values in attributes if np.size(values) == 16), None)


def _in_display_window(texels: np.ndarray, spec: Any) -> np.ndarray:
    """The pixels of the display window, of an EXR whose data window is another: clear where there are no data."""
    x, y, width, height = spec.x - spec.full_x, spec.y - spec.full_y, spec.full_width, spec.full_height
    if (x, y, width, height) == (0, 0, spec.width, spec.height) or width <= 0 or height <= 0:
        return texels
    canvas = np.zeros((height, width, 4), dtype=np.float32)
    left, top, right, bottom = max(x, 0), max(y, 0), min(x + spec.width, width), min(y + spec.height, height)
    if left < right and top < bottom:
        canvas[top:bottom, left:right] = texels[top - y : bottom - y, left - x : right - x]
    return canvas


def _make_finite(texels: np.ndarray) -> int:
    """Put the largest float in place of +inf, and 0 in place of −inf and NaN. Returns the number of pixels that have some."""
    odd = 0
    for rows in _bands(texels):
        finite = np.isfinite(texels[rows])
        if not finite.all():
            odd += int(np.count_nonzero(~finite.all(axis=2)))
            np.nan_to_num(texels[rows], copy=False, nan=0.0, posinf=LARGEST, neginf=0.0)
    return odd


def _bands(pixels: np.ndarray) -> Iterator[slice]:
    """Slices of some rows of a picture: temporary arrays of one stay in the processor's cache."""
    step = max(1, _BAND // max(1, pixels.shape[1]))
    return (slice(first, first + step) for first in range(0, len(pixels), step))


def _stored_type(spec: Any) -> str:
    return {"uint8": "uint8", "uint16": "uint16"}.get(str(spec.format), "float")


def _linear(pixels: np.ndarray, spec: Any, alpha_at: int, encoding: Encoding) -> np.ndarray:
    integers = pixels.dtype != np.float32
    top = float(np.iinfo(pixels.dtype).max) if integers else 1.0
    colors = [c for c in range(pixels.shape[2]) if c != alpha_at][:3]
    if len(colors) == 2:
        colors = [*colors, -1]  # two channels only: blue is 0
    texels = np.empty((*pixels.shape[:2], 4), dtype=np.float32)
    table = encoding.linear(np.arange(top + 1) / top).astype(np.float32) if integers else None
    channels = [colors[min(k, len(colors) - 1)] if colors else -1 for k in range(3)]
    associated = alpha_at >= 0 and not spec.get_int_attribute("oiio:UnassociatedAlpha", 0)
    for rows in _bands(texels):
        source, band, decoded = pixels[rows], texels[rows], {-1: np.array(0.0 if colors else 1.0, np.float32)}
        for k, channel in enumerate(channels):
            if channel not in decoded:
                values = source[..., channel]
                decoded[channel] = np.take(table, values) if table is not None else encoding.linear(values)
            band[..., k] = decoded[channel]
        band[..., 3] = source[..., alpha_at] / np.float32(top) if alpha_at >= 0 else 1.0
        if encoding.changes_colors:
            band[..., :3] = encoding.convert(band[..., :3])
        if associated:
            band[..., :3] /= np.where(band[..., 3:] > 0, band[..., 3:], 1.0)
    return texels


@contextmanager
def _on_disk(source: str | bytes) -> Iterator[str]:
    """A path for a source: a memory file for bytes where the system supports it, else a temporary file.

    Raises ImageError for the path of a device, a pipe or a socket, for which a library would wait.
    """
    if isinstance(source, str):
        if os.path.exists(source) and not is_regular(source):
            raise ImageError(f"the picture `{os.path.basename(source)}` is not an ordinary file")
        yield source
    elif hasattr(os, "memfd_create"):
        handle = os.memfd_create("picture")
        with os.fdopen(handle, "wb") as file:
            file.write(source)
            file.flush()
            yield f"/proc/self/fd/{handle}"
    else:
        with tempfile.NamedTemporaryFile(suffix=".picture") as file:
            file.write(source)
            file.flush()
            yield file.name


def _reason(text: str, path: str, name: str) -> str:
    """The first line of a library's message, with the image's name in place of its path."""
    if "could not find a format reader" in text:
        return "its format is not known: write it as PNG, JPEG, TIFF, WebP, EXR or HDR"
    return next((part.strip() for part in text.replace(path, name).splitlines() if part.strip()), "")
