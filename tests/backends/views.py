"""Pixel centres, and channels of pictures as float64 arrays, for known answers."""

from __future__ import annotations

import numpy as np
from maquette.render.image.image import Image
from numpy.typing import NDArray

Array = NDArray[np.float64]


def centres(image: Image) -> tuple[Array, Array]:
    """(h, w) coordinates x and y of pixel centres."""
    y, x = np.mgrid[0 : image.height, 0 : image.width]
    return x + 0.5, y + 0.5


def channel(image: Image, name: str) -> Array:
    """A channel in float64; (h, w) if it has one component."""
    values = image.channels[name].astype(np.float64)
    return values[..., 0] if values.shape[2] == 1 else values


def rgb(image: Image) -> Array:
    """(h, w, 3) the linear picture."""
    return channel(image, "rgba")[..., :3]


def grey(image: Image) -> Array:
    """(h, w) values of a grey picture."""
    color = rgb(image)
    assert np.array_equal(color[..., 0], color[..., 1])
    assert np.array_equal(color[..., 0], color[..., 2])
    return color[..., 0]


def alpha(image: Image) -> Array:
    """(h, w) coverage."""
    return channel(image, "rgba")[..., 3]
