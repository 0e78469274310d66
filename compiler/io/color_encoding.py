"""Values of picture files as linear Rec.709: the transfer function, primaries or configuration of a colour space by its name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...lang import color_spaces
from ...lang.diagnostics import suggest
from ...lang.input_error import InputError
from .color_config import Config


class Encoding(NamedTuple):
    """How stored values become linear Rec.709."""

    transfer: float  # as color_spaces.ColorSpace.transfer
    matrix: NDArray[np.float32] | None = None  # (3, 3) on columns of linear colours; None: they are Rec.709, or numbers
    config: Config | None = None  # the configuration that has the space, in place of both
    space: str = ""

    @property
    def changes_colors(self) -> bool:
        """Whether red, green and blue depend on each other."""
        return self.matrix is not None or self.config is not None

    def linear(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Single values without their transfer function."""
        if self.transfer == color_spaces.LINEAR or self.config is not None:
            return values
        if self.transfer == color_spaces.SRGB:
            return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0.0) + 0.055) / 1.055) ** 2.4)
        return np.sign(values) * np.abs(values) ** self.transfer

    def convert(self, rgb: NDArray[np.float32]) -> NDArray[np.float32]:
        """(h, w, 3) values after `linear` as linear Rec.709."""
        if self.config is not None:
            return self.config.to_rec709(rgb, self.space)
        return rgb if self.matrix is None else multiplied(rgb, self.matrix)


def multiplied(rgb: NDArray[np.float32], matrix: NDArray[np.floating]) -> NDArray[np.float32]:
    """(…, 3) colours times a matrix, in a fixed order of sums; a grey stays grey up to rounding."""
    m = matrix.astype(np.float32)
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    return np.stack([row[0] * r + row[1] * g + row[2] * b for row in m], axis=-1)


def find(
    space: str, integers: bool, color: bool = True, primaries: Sequence[float] | None = None, config: Config | None = None
) -> Encoding:
    """The encoding of a picture. Raises InputError for a colour space that neither the table nor the configuration `config` has.

    "auto" is sRGB for integers, and linear light for floats: of the file's `primaries`, if it has some. Numbers, which are no `color`,
    keep their values but for the transfer function. Raises ValueError for primaries that are not of a colour space.
    """
    if space == "auto":
        if integers:
            return Encoding(color_spaces.SRGB)
        return Encoding(color_spaces.LINEAR, _matrix(primaries) if color and primaries is not None else None)
    named_space = color_spaces.find(space)
    if named_space is not None:
        return Encoding(named_space.transfer, _matrix(named_space.primaries) if color and named_space.primaries is not None else None)
    _check(space, config)
    return Encoding(color_spaces.LINEAR, config=config, space=space)


def is_known(space: str, config: Config | None = None) -> bool:
    """Whether a colour space has an encoding."""
    try:
        return space == "auto" or color_spaces.find(space) is not None or bool(_check(space, config))
    except InputError:
        return False


def _check(space: str, config: Config | None) -> bool:
    names: tuple[str, ...] = ("auto", *color_spaces.NAMES)
    if config is not None:
        if config.has_space(space):
            return True
        names += config.spaces
    raise InputError(f"no colour space is called `{space}`", suggest(space, names) or f"there are {', '.join(names[:8])}, …")


def _matrix(primaries: Sequence[float] | None) -> NDArray[np.float32] | None:
    if primaries is None:
        return None
    r, g, b, c, d, e, f, h = primaries
    places = (r, g, b, c, d, e, f, h)
    if color_spaces.are_same(places, color_spaces.REC709):
        return None
    return np.array(color_spaces.matrix(places, color_spaces.REC709), np.float32)
