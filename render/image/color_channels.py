"""Channels of colours: between the primaries in which light is computed, linear Rec.709 of pictures in memory, and those of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...compiler.io.color_encoding import multiplied
from ...lang import color_spaces
from ...lang.schema.picture_channels import LIGHT

F32 = NDArray[np.float32]
REC709 = "rec709"
_INTEROP = {REC709: "lin_rec709_scene", "rec2020": "lin_rec2020_scene", "acescg": "lin_ap1_scene"}
_COLORS = ("rgba", "albedo")  # channels of light and reflectance; variances and shares stay those of the working space


class Computed(Protocol):
    """The parts of an image.Image that are converted."""

    @property
    def channels(self) -> dict[str, F32]: ...
    @property
    def metadata(self) -> dict[str, Any]: ...


def is_color(channel: str) -> bool:
    """Whether a channel is converted."""
    return channel in _COLORS or channel.startswith(LIGHT)


def to_rec709(image: Computed, space: str) -> None:
    """Convert the colours of a picture that was computed in a working space, and their estimated error, in place."""
    if space == REC709:
        return
    matrix, about = _matrix(space, REC709), image.metadata
    _convert(image.channels, matrix)
    if (half := about.get("half_difference")) is not None:
        about["half_difference"] = multiplied(half, matrix)
        about["variance"] = np.square(about["half_difference"])


def rgba_to_rec709(rgba: F32, space: str) -> F32:
    """A converted copy of (…, 4) light."""
    return np.concatenate([multiplied(rgba[..., :3], _matrix(space, REC709)), rgba[..., 3:]], axis=-1)


def of_file(channels: Mapping[str, F32], about: Mapping[str, Any]) -> Mapping[str, F32]:
    """The channels as an EXR has them: in the working space of the picture."""
    space = about.get("working_space", REC709)
    if space == REC709:
        return channels
    written = dict(channels)
    for name in filter(is_color, channels):
        written[name] = channels[name].copy()
    _convert(written, _matrix(REC709, space))
    return written


def file_space(about: Mapping[str, Any]) -> tuple[str, color_spaces.Chromaticities]:
    """The name and the chromaticities of an EXR's colours."""
    space = about.get("working_space", REC709)
    return _INTEROP[space], color_spaces.WORKING[space]


def from_file(channels: dict[str, F32], primaries: Sequence[float] | None) -> str:
    """Convert the colours that a file has with some chromaticities, in place. Returns why not, as the end of a sentence; "" if done."""
    if primaries is None:
        return ""
    r, g, b, c, d, e, f, h = primaries
    places = (r, g, b, c, d, e, f, h)
    if color_spaces.are_same(places, color_spaces.REC709):
        return ""
    try:
        _convert(channels, np.array(color_spaces.matrix(places, color_spaces.REC709)))
    except ValueError:
        return "are not of a colour space: its colours are read as Rec.709"
    return ""


def _convert(channels: dict[str, F32], matrix: NDArray[np.floating]) -> None:
    for name in filter(is_color, channels):
        channels[name][..., :3] = multiplied(channels[name][..., :3], matrix)


def _matrix(source: str, target: str) -> NDArray[np.float64]:
    return np.array(color_spaces.matrix(color_spaces.WORKING[source], color_spaces.WORKING[target]))
