"""Loads images for textures through OpenImageIO, from disk or memory, as linear float32 r, g, b, a."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ...lang.input_error import InputError
from ..io import library_messages, stage_cache

if TYPE_CHECKING:
    from ..scene.builder import SceneBuilder

MAX_TEXELS = 1 << 26  # of one image: 8192 × 8192, 1 GiB
MAX_ALL_TEXELS = 1 << 27  # of all images of a scene
LARGEST = float(np.finfo(np.float32).max)
SPACES = ("auto", "srgb", "linear")
_BAND = 1 << 14  # pixels that are converted together
_MOST_PARTS = 100  # of a file, counted in messages
_PARTS = {"gif": "frames", "webp": "frames", "png": "frames", "tiff": "pages", "ico": "sizes"}  # names of further pictures in a file
_COMPOSED = ("psd",)  # formats whose first picture is made of the others
_RGB = (("r", "g", "b"), ("red", "green", "blue"))
_MAIN_LAYERS = ("rgba", "rgb", "beauty", "combined", "color", "colour")
_ALPHA = ("a", "alpha")
_ANOTHER = "to draw another, write it to a file of its own"
_OTHERS = "to draw them, write them to files of their own"
_JPEG_SEGMENT = re.compile(rb"\xff[\x02-\xcf\xd9-\xfe]")  # the markers of segments and of the end, and no byte of coded pixels
_JPEG_END = 0xD9


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

    def warn(self, name: str, diagnostics: Diagnostics, span: Span | None) -> None:
        """Add a warning for each fault of the image `name`, and for its pixels that are not finite."""
        for message, hint in self.faults:
            diagnostics.warning(message, span, hint)
        if self.odd:
            pixels = self.texels.shape[0] * self.texels.shape[1]
            message = f"{self.odd:,} of {pixels:,} pixels of the picture `{name}` are infinite or no numbers"
            hint = f"they are drawn as {LARGEST:.1e} and as 0; half floats end at 65504: write it as float"
            diagnostics.warning(message, span, hint)


class _Channels(NamedTuple):
    """The channels of a file that are read, and how they are drawn."""

    first: int
    end: int
    alpha: int  # among those read; -1: none
    told: str  # the channels that are drawn in place of R, G and B, for a message; "" where the file has these


def row(builder: SceneBuilder, path: Path, space: str = "auto", color: bool = True, span: Span | None = None) -> int:
    """The row in ir.Images of an image file, loaded once for each colour space. Raises ImageError.

    `path` is already allowed by Files. `space` "auto" means sRGB for an 8 or 16 bit integer image used as a `color`, linear otherwise.
    Warnings refer to `span`.
    """
    return _row(builder, str(path), space, color, lambda: str(path), path.name, span)


def row_from_bytes(
    builder: SceneBuilder, data: bytes, name: str, space: str = "auto", color: bool = True, span: Span | None = None
) -> int:  # fmt: skip
    """Like `row`, for an image file in memory (from a .usdz or .glb). `name` with its extension identifies the image."""
    return _row(builder, name, space, color, lambda: data, name, span)


def _row(builder: SceneBuilder, key: str, space: str, color: bool, source: Any, name: str, span: Span | None) -> int:
    space = "linear" if space == "auto" and not color else space
    limit = min(MAX_TEXELS, MAX_ALL_TEXELS - builder.texels)

    def made() -> int:
        decoded = _read_cached(source(), name, space, limit)
        decoded.warn(name, builder.diagnostics, span)
        return builder.image(decoded.texels, key)

    return builder.shared(("image", key, space), made)


def _read_cached(source: str | bytes, name: str, space: str, limit: int) -> Decoded:
    """As `read`, or its result of the last compilation."""
    try:
        data = source if isinstance(source, bytes) else Path(source).read_bytes()
    except OSError:
        return read(source, name, space, limit)
    return stage_cache.cached("images read", (data, name, space, limit), lambda: read(source, name, space, limit))


@library_messages.left_out()
def read(source: str | bytes, name: str, space: str = "auto", limit: int = MAX_TEXELS) -> Decoded:
    """Decode a path or a file's bytes. `name` is the one in messages. Raises ImageError.

    The first picture of the file is read: its R, G, B and A, or the channels that `_channels` selects. Infinite values become the largest
    float, NaN becomes 0.
    """
    import OpenImageIO as oiio

    with _on_disk(source) as path, np.errstate(all="ignore"):
        config = oiio.ImageSpec()
        config.attribute("oiio:UnassociatedAlpha", 1)
        picture = oiio.ImageInput.open(path, config)
        if picture is None:
            raise ImageError(f"cannot read the picture `{name}`", _reason(oiio.geterror(), path, name))
        try:
            spec = picture.spec()
            width, height = max(spec.width, spec.full_width), max(spec.height, spec.full_height)
            if width * height * max(1, spec.depth) > limit:
                raise ImageError(
                    f"the picture `{name}` is too big: {width} by {height} pixels",
                    f"at most {MAX_TEXELS:,} in one and {MAX_ALL_TEXELS:,} in all pictures of a scene",
                )
            channels = _channels([str(channel) for channel in spec.channelnames], spec.alpha_channel, picture.format_name())
            pixels = picture.read_image(0, 0, channels.first, channels.end, _stored_type(spec))
            if pixels is None:
                raise ImageError(f"the picture `{name}` is damaged", _reason(picture.geterror(), path, name))
            faults = tuple(_faults(picture, spec, channels, path, name))
        finally:
            picture.close()
    if pixels.ndim == 4:  # first slice of a volume
        pixels = pixels[0]
    texels = _in_display_window(_linear(pixels.reshape(spec.height, spec.width, -1), spec, channels.alpha, space), spec)
    odd = 0 if pixels.dtype != np.float32 else _make_finite(texels)
    return Decoded(texels, odd, faults)


def matrix(source: str | bytes, name: str, names: tuple[str, ...]) -> np.ndarray | None:
    """The first of the metadata `names` with sixteen numbers in an image file, (4, 4), row by row; None without one. Raises ImageError."""
    import OpenImageIO as oiio

    with _on_disk(source) as path:
        picture = oiio.ImageInput.open(path)
        if picture is None:
            raise ImageError(f"cannot read the picture `{name}`", _reason(oiio.geterror(), path, name))
        found = [picture.spec().getattribute(key) for key in names]
        picture.close()
    return next((np.array(values, np.float64).reshape(4, 4) for values in found if np.size(values) == 16), None)


def _channels(names: list[str], alpha: int, kind: str) -> _Channels:
    """The channels to read: the first four, but for EXR files by their names, as these may hold anything.

    Of an EXR without R and Y these are the R, G and B of a layer, or its Y, or its first three, with the alpha that follows them.
    """
    if kind != "openexr":
        known = alpha < len(names)  # OpenImageIO gives the alpha of GIF files as the fifth of four channels
        return _Channels(0, min(len(names), 4), alpha if known else names.index("A") if "A" in names else -1, "")
    ends = [name.rpartition(".")[2].lower() for name in names]
    layers: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        layers.setdefault(name.rpartition(".")[0], []).append(k)
    colored = [layer for layer, at in layers.items() if tuple(ends[k] for k in at[:3]) in _RGB]
    colored.sort(key=lambda layer: layer.rpartition(".")[2].lower() not in _MAIN_LAYERS)
    grey = [layer for layer, at in layers.items() if ends[at[0]] == "y"]
    plain = ends[layers[""][0]] in ("r", "red", "y") if "" in layers else False
    free = [layer for layer, at in layers.items() if any(ends[k] not in _ALPHA for k in at)]
    layer = "" if plain else (colored or grey or free or list(layers))[0]
    at = [k for k in layers[layer] if ends[k] not in _ALPHA]
    if plain or layer in colored:
        at = [k for k in at if ends[k] in (*_RGB[0], *_RGB[1])] or at[:1]
    elif layer in grey:
        at = at[:1]
    first, end = (at[0], at[:3][-1] + 1) if at else (layers[layer][0], layers[layer][0])
    has_alpha = ends[end : end + 1] in ([word] for word in _ALPHA) and end in layers[layer]
    return _Channels(first, end + has_alpha, end - first if has_alpha else -1, "" if plain else _drawn_as(names[first:end]))


def _drawn_as(names: list[str]) -> str:
    """The sense of colour channels by their number, for a message."""
    if not names:
        return "it is drawn white, with its alpha"
    quoted = [f"`{name}`" for name in names]
    inks = {1: "grey", 2: "red and green", 3: "red, green and blue"}[len(names)]
    return f"{', '.join(quoted[:-1])}{' and ' * (len(names) > 1)}{quoted[-1]} {'are' if len(names) > 1 else 'is'} drawn as {inks}"


def _faults(picture: Any, spec: Any, channels: _Channels, path: str, name: str) -> Iterator[tuple[str, str]]:
    """(message, hint) of all that an image lacks, or has and is not drawn. Smaller copies (MIP maps, thumbnails) are not meant."""
    kind = picture.format_name()
    if kind == "jpeg" and _is_cut_off(Path(path).read_bytes()):
        hint = "the missing part is drawn grey or blurred: copy or write the file again"
        yield f"the picture `{name}` is cut off: its file ends early", hint
    if channels.told:
        yield f"the picture `{name}` has no channels R, G and B: {channels.told}", "name the channels to draw R, G and B"
    left = [*spec.channelnames[: channels.first], *spec.channelnames[channels.end :]]
    unread = []
    if left:
        listed = ", ".join(f"`{channel}`" for channel in left[:8]) + (f" and {len(left) - 8} more" if len(left) > 8 else "")
        unread.append(f"the channel{'s' * (len(left) > 1)} {listed}")
    parts = _count_parts(picture, path, kind)
    if parts > 1 and kind == "openexr":
        unread.append(f"{parts - 1} further part{'s' * (parts > 2)}")
    if unread:
        are = "are" if len(left) > 1 or len(unread) > 1 or parts > 2 else "is"
        yield f"of the picture `{name}`, {' and '.join(unread)} {are} not drawn", _OTHERS
    if parts > 1 and kind != "openexr":
        counted = f"more than {_MOST_PARTS}" if parts > _MOST_PARTS else str(parts)
        yield f"the picture `{name}` has {counted} {_PARTS.get(kind, 'pictures')}: the first is drawn", _ANOTHER
    if (turn := spec.get_int_attribute("Orientation", 1)) not in (0, 1):
        yield f"the picture `{name}` is drawn as it is stored: its orientation {turn} is left out", "turn it and write it again"
    if spec.depth > 1:
        yield f"the picture `{name}` has {spec.depth} slices: the first is drawn", _ANOTHER


def _is_cut_off(data: bytes) -> bool:
    """Whether a JPEG ends without the marker of its end."""
    at = 2
    while found := _JPEG_SEGMENT.search(data, at):
        if data[found.end() - 1] == _JPEG_END:
            return False
        at = found.end() + int.from_bytes(data[found.end() : found.end() + 2], "big")
    return True


def _count_parts(picture: Any, path: str, kind: str) -> int:
    """The number of pictures in a file, at most _MOST_PARTS + 1; 1 where the first is made of the others, or they of it."""
    from PIL import Image

    if kind in _COMPOSED or picture.spec().get_int_attribute("oiio:miplevels") > 1:
        return 1
    if kind in _PARTS:
        with suppress(Exception), Image.open(path) as file:  # Pillow raises exceptions of any kind for damaged files
            frames = min(len(file.info["sizes"]) if kind == "ico" else getattr(file, "n_frames", 1), _MOST_PARTS + 1)
            return sum(_is_page(file, k) for k in range(frames)) if kind == "tiff" else frames
    parts = 1
    while parts <= _MOST_PARTS and picture.seek_subimage(parts, 0):
        parts += 1
    return parts


def _is_page(file: Any, number: int) -> bool:
    """Whether a picture of a TIFF is neither a smaller copy (bit 0 of NewSubfileType) nor a mask (bit 2) of another."""
    file.seek(number)
    return number == 0 or not file.tag_v2.get(254, 0) & 5


def _in_display_window(texels: np.ndarray, spec: Any) -> np.ndarray:
    """The pixels of the display window, of an EXR whose data window is another: clear where there are no data."""
    x, y, width, height = spec.x - spec.full_x, spec.y - spec.full_y, spec.full_width, spec.full_height
    if (x, y, width, height) == (0, 0, spec.width, spec.height) or width <= 0 or height <= 0:
        return texels
    made = np.zeros((height, width, 4), dtype=np.float32)
    left, top, right, bottom = max(x, 0), max(y, 0), min(x + spec.width, width), min(y + spec.height, height)
    if left < right and top < bottom:
        made[top:bottom, left:right] = texels[top - y : bottom - y, left - x : right - x]
    return made


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


def _linear(pixels: np.ndarray, spec: Any, alpha_at: int, space: str) -> np.ndarray:
    whole = pixels.dtype != np.float32
    if space == "auto":
        space = "srgb" if whole else "linear"
    top = float(np.iinfo(pixels.dtype).max) if whole else 1.0
    colors = [c for c in range(pixels.shape[2]) if c != alpha_at][:3]
    if len(colors) == 2:
        colors = [*colors, -1]  # two channels only: blue is 0
    made = np.empty((*pixels.shape[:2], 4), dtype=np.float32)
    table = _decode(np.arange(top + 1) / top, space).astype(np.float32) if whole else None
    channels = [colors[min(k, len(colors) - 1)] if colors else -1 for k in range(3)]
    associated = alpha_at >= 0 and not spec.get_int_attribute("oiio:UnassociatedAlpha", 0)
    for rows in _bands(made):
        given, band, decoded = pixels[rows], made[rows], {-1: np.array(0.0 if colors else 1.0, np.float32)}
        for k, channel in enumerate(channels):
            if channel not in decoded:
                values = given[..., channel]
                decoded[channel] = np.take(table, values) if table is not None else _decode(values, space)
            band[..., k] = decoded[channel]
        band[..., 3] = given[..., alpha_at] / np.float32(top) if alpha_at >= 0 else 1.0
        if associated:
            band[..., :3] /= np.where(band[..., 3:] > 0, band[..., 3:], 1.0)
    return made


def _decode(values: np.ndarray, space: str) -> np.ndarray:
    """sRGB to linear (IEC 61966-2-1), or values as they are."""
    if space != "srgb":
        return values
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4)


@contextmanager
def _on_disk(source: str | bytes) -> Iterator[str]:
    """A path for a source: a memory file for bytes where the system supports it, else a temporary file."""
    if isinstance(source, str):
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
