"""A drawn picture: named float32 channels and what is known about how it came to be."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import metrics

WIDTHS = {
    "rgba": 4, "depth": 1, "normal": 3, "position": 3, "albedo": 3, "uv": 2, "id": 2, "issues": 1, "variance": 3, "samples": 1,
    "crypto_object": 12, "crypto_material": 12,
}  # fmt: skip
"""Numbers a pixel of each channel has. rgba: scene-linear, unexposed, alpha is coverage; depth in metres along the camera's axis,
inf where nothing is; normal and position in the world; albedo k_d; id: instance and material, -1 where nothing is; issues: 1 where
the first root of a formula could not be proved; variance of the pixel's mean, as its halves tell it; samples taken; crypto_…: see
cryptomatte.py. Light groups, `light:NAME`, have three."""
LIGHT = 3

EMPTY = {"depth": np.inf, "id": -1.0}  # what stands where nothing was hit or drawn; 0 elsewhere


@dataclass(frozen=True, eq=False)
class Image:
    """`width` by `height` pixels, the crop's where there was one; each channel (height, width, k) float32.

    `metadata` as film.run fills it: "size" and "crop" (x0, y0, x1, y1) of the whole picture, "samples" (the most any pixel
    has), "samples_mean", "error" (estimated √relMSE, None where unknown), "variance" (of the pixels' means, (height, width, 3), inf
    where unknown; None after one sample), "partial", "rays" (from the camera),
    "issues" (samples left out because they were not
    finite), "threads"; and as draw.draw adds: "seconds" by stage, "backend", "notes", "unproved", "cut" and
    "attributes", what a file is to say of its channels.
    """

    width: int
    height: int
    channels: dict[str, NDArray[np.float32]]
    metadata: dict[str, Any] = field(default_factory=dict)

    @property
    def luminance(self) -> NDArray[np.float64]:
        """(height, width) relative luminance."""
        return metrics.luminance(self.channels["rgba"][..., :3])


def blank(width: int, height: int, names: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
    """Channels of a picture with nothing in it."""
    return {name: np.full((height, width, WIDTHS.get(name, LIGHT)), EMPTY.get(name, 0.0), np.float32) for name in names}
