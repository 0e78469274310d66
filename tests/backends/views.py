"""Pixel centres, channels of pictures as float64 arrays, and pixels where pictures must agree."""

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


def interior(*images: Image) -> np.ndarray:
    """(h, w) pixels whose neighbours belong to the same instance in every picture: no outline passes."""
    h, w = images[0].height, images[0].width
    inside = np.ones((h, w), bool)
    for image in images:
        ids = np.pad(image.channels["id"][..., 0], 1, mode="edge")
        for dy in range(3):
            for dx in range(3):
                inside &= ids[dy : dy + h, dx : dx + w] == image.channels["id"][..., 0]
    return inside


def relative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(h, w) largest difference of channels, relative to the pixel's largest value or a thousandth of the picture's."""
    size = np.maximum(np.abs(b).max(-1), 1e-3 * np.abs(b).max())
    return np.abs(a - b).max(-1) / np.where(size > 0, size, 1.0)


def show(different: np.ndarray, limit: int) -> str:
    """Message: how many pixels differ, how many may, and where the first are."""
    where = np.argwhere(different)
    return f"{len(where)} pixels differ, at most {limit} may: {where[:10].tolist()}"
