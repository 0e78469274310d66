"""Selects the channels of a picture file, and finds its faults: cut-off data, unread frames and channels, unknown colour spaces."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ...lang import text_encoding
from .regular_files import read_bytes

_MOST_PARTS = 100  # of a file, counted in messages
_PARTS = {"gif": "frames", "webp": "frames", "png": "frames", "tiff": "pages", "ico": "sizes"}  # names of further pictures in a file
_COMPOSED = ("psd",)  # formats whose first picture is made of the others
_RGB = (("r", "g", "b"), ("red", "green", "blue"))
_MAIN_LAYERS = ("rgba", "rgb", "beauty", "combined", "color", "colour")
_ALPHA = ("a", "alpha")
_JPEG_SEGMENT = re.compile(rb"\xff[\x02-\xcf\xd9-\xfe]")  # the markers of segments and of the end, and no byte of coded pixels
_JPEG_END = 0xD9
_SRGB_PROFILES = ("c2",)  # names of ICC profiles of sRGB that lack its name
_SRGB_PLACES = (0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06)  # x and y of its white, red, green and blue
_SLACK = 0.03


class Use(NamedTuple):
    """What is done with pictures, as a word of messages."""

    infinitive: str
    done: str


DRAWN, READ = Use("draw", "drawn"), Use("read", "read")


class Channels(NamedTuple):
    """The channels of a file that are used, by their numbers in it."""

    colors: tuple[int, ...]
    alpha: int  # -1: none
    stand_in: tuple[str, ...] | None  # the channels that are used in place of R, G and B; None where the file has these

    @property
    def used(self) -> tuple[int, ...]:
        """The colours, and the alpha behind them if there is one."""
        return (*self.colors, self.alpha) if self.alpha >= 0 else self.colors

    def unread(self, names: list[str]) -> list[str]:
        """Those of a file's channels that are not used."""
        return [name for k, name in enumerate(names) if k not in self.used]


def channel_names(spec: Any) -> list[str]:
    """The names of a file's channels; those that are not UTF-8 are read as other text is."""
    return [_readable(str(name)) for name in spec.channelnames]


def chromaticities(spec: Any) -> tuple[float, ...] | None:
    """x and y of a file's red, green, blue and white, as an EXR has them; None without them."""
    values = spec.getattribute("chromaticities")
    return tuple(map(float, values)) if values is not None and np.size(values) == 8 else None


def message_of(source: Any) -> str:
    """The message of a failure of OpenImageIO, or of one of its pictures, which may quote bytes of the file."""
    try:
        return _readable(str(source.geterror()))
    except UnicodeDecodeError as failure:
        return text_encoding.decode_any(failure.object)


def _readable(text: str) -> str:
    """Text without the surrogates that stand for bytes that are not UTF-8."""
    return text_encoding.decode_any(text.encode("utf-8", "surrogateescape")) if text and not text.isascii() else text


def choose_channels(names: list[str], alpha: int, kind: str) -> Channels:
    """The channels to use: the first four, but for EXR files by their names, as these may hold anything.

    Of an EXR without R and Y these are the R, G and B of a layer, or its Y, or its first three, with the alpha of the layer.
    """
    if kind != "openexr":
        stated = alpha < len(names)  # OpenImageIO gives the alpha of GIF files as the fifth of four channels
        alpha = alpha if stated else names.index("A") if "A" in names else -1
        alpha = alpha if alpha < 4 else -1
        return Channels(tuple(k for k in range(min(len(names), 4)) if k != alpha)[:3], alpha, None)
    ends = [name.rpartition(".")[2].lower() for name in names]
    layers: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        layers.setdefault(name.rpartition(".")[0], []).append(k)
    colored = [layer for layer, places in layers.items() if tuple(ends[k] for k in places[:3]) in _RGB]
    colored.sort(key=lambda layer: layer.rpartition(".")[2].lower() not in _MAIN_LAYERS)
    grey = [layer for layer, places in layers.items() if ends[places[0]] == "y"]
    plain = ends[layers[""][0]] in ("r", "red", "y") if "" in layers else False
    free = [layer for layer, places in layers.items() if any(ends[k] not in _ALPHA for k in places)]
    layer = "" if plain else (colored or grey or free or list(layers))[0]
    chosen = [k for k in layers[layer] if ends[k] not in _ALPHA]
    if plain or layer in colored:
        chosen = [k for k in chosen if ends[k] in (*_RGB[0], *_RGB[1])] or chosen[:1]
    elif layer in grey:
        chosen = chosen[:1]
    alpha_channel = next((k for k in layers[layer] if ends[k] in _ALPHA), -1)
    return Channels(tuple(chosen[:3]), alpha_channel, None if plain else tuple(names[k] for k in chosen[:3]))


def _used_as(names: tuple[str, ...], use: Use) -> str:
    """The sense of colour channels by their number, for a message."""
    if not names:
        return f"it is {use.done} white, with its alpha"
    quoted = [f"`{name}`" for name in names]
    inks = {1: "grey", 2: "red and green", 3: "red, green and blue"}[len(names)]
    return f"{', '.join(quoted[:-1])}{' and ' * (len(names) > 1)}{quoted[-1]} {'are' if len(names) > 1 else 'is'} {use.done} as {inks}"


def faults(
    picture: Any, stand_in: tuple[str, ...] | None, unused: list[str], path: str, name: str, use: Use = DRAWN, is_srgb: bool = True
) -> Iterator[tuple[str, str]]:  # fmt: skip
    """(message, hint) of all that an open picture lacks, or has and is not used. Smaller copies (MIP maps, thumbnails) are not meant.

    `stand_in` are the channels in place of R, G and B, as in Channels. A warning names those in `unused`. `is_srgb`: integers are read as
    sRGB.
    """
    kind, spec = picture.format_name(), picture.spec()
    if kind == "jpeg" and _is_cut_off(read_bytes(path)):
        hint = f"the missing part is {use.done} grey or blurred: copy or write the file again"
        yield f"the picture `{name}` is cut off: its file ends early", hint
    if stand_in is not None:
        hint = f"name the channels to {use.infinitive} R, G and B"
        yield f"the picture `{name}` has no channels R, G and B: {_used_as(stand_in, use)}", hint
    unread = []
    if unused:
        listed = ", ".join(f"`{channel}`" for channel in unused[:8]) + (f" and {len(unused) - 8} more" if len(unused) > 8 else "")
        unread.append(f"the channel{'s' * (len(unused) > 1)} {listed}")
    parts, another = _count_parts(picture, path, kind), f"to {use.infinitive} another, write it to a file of its own"
    if parts > 1 and kind == "openexr":
        unread.append(f"{parts - 1} further part{'s' * (parts > 2)}")
    if unread:
        are = "are" if len(unused) > 1 or len(unread) > 1 or parts > 2 else "is"
        others = f"to {use.infinitive} them, write them to files of their own"
        yield f"of the picture `{name}`, {' and '.join(unread)} {are} not {use.done}", others
    if parts > 1 and kind != "openexr":
        counted = f"more than {_MOST_PARTS}" if parts > _MOST_PARTS else str(parts)
        yield f"the picture `{name}` has {counted} {_PARTS.get(kind, 'pictures')}: the first is {use.done}", another
    if (turn := spec.get_int_attribute("Orientation", 1)) not in (0, 1):
        yield f"the picture `{name}` is {use.done} as it is stored: its orientation {turn} is left out", "turn it and write it again"
    if is_srgb and (instead := _color_space(spec, path, kind)):
        yield f"the colours of the picture `{name}` are {use.done} as sRGB, and not by {instead}", "convert it to sRGB and write it again"
    if spec.depth > 1:
        yield f"the picture `{name}` has {spec.depth} slices: the first is {use.done}", another


def _color_space(spec: Any, path: str, kind: str) -> str:
    """What says that the colours of integers are not of sRGB, for a message: an ICC profile, or the gamma or primaries of a PNG."""
    if str(spec.format) not in ("uint8", "uint16"):
        return ""
    if spec.getattribute("ICCProfile") is not None:
        profile = _readable(str(spec.getattribute("ICCProfile:profile_description") or "").strip("\0 "))
        return "" if "srgb" in profile.lower() or profile in _SRGB_PROFILES else f"its profile `{profile}`" if profile else "its profile"
    if kind != "png":
        return ""
    head = read_bytes(path).partition(b"IDAT")[0]
    if b"sRGB" in head:
        return ""
    if offset := head.find(b"gAMA") + 1:
        gamma = int.from_bytes(head[offset + 3 : offset + 7], "big") / 100_000
        if gamma > 0 and abs(gamma * 2.2 - 1) > _SLACK:
            return f"its gamma of {1 / gamma:.3g}"
    if offset := head.find(b"cHRM") + 1:
        places = [int.from_bytes(head[k : k + 4], "big") / 100_000 for k in range(offset + 3, offset + 35, 4)]
        if max(abs(place - expected) for place, expected in zip(places, _SRGB_PLACES, strict=True)) > _SLACK:
            return "its primaries"
    return ""


def _is_cut_off(data: bytes) -> bool:
    """Whether a JPEG ends without the marker of its end."""
    offset = 2
    while segment := _JPEG_SEGMENT.search(data, offset):
        if data[segment.end() - 1] == _JPEG_END:
            return False
        offset = segment.end() + int.from_bytes(data[segment.end() : segment.end() + 2], "big")
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
