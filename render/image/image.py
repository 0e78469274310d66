"""Image: named float32 channels and metadata."""

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
"""Components of each channel. rgba: scene-linear, unexposed, alpha is coverage; depth in metres along the camera's axis, inf for misses;
normal and position in world space; albedo k_d; id: instance and material, -1 for misses; issues: 1 where the first root of a formula is
unproven; variance of the pixel's mean, estimated from halves; samples; crypto_…: see cryptomatte.py. Light groups, `light:NAME`, have
three."""
LIGHT = 3

EMPTY = {"depth": np.inf, "id": -1.0}  # values of pixels without a hit or a sample; 0 in other channels


@dataclass(frozen=True, eq=False)
class Image:
    """`width` by `height` pixels (of the crop); each channel is (height, width, k) float32.

    `metadata` as film.run fills it: "size" and "crop" (x0, y0, x1, y1) of the whole picture, "samples" (the most any pixel
    has), "samples_mean", "error" (estimated √relMSE, None where unknown), "variance" (of the pixels' means, (height, width, 3), inf
    where unknown; None after one sample), "partial", "rays" (from the camera), "issues" (samples left out because they were not finite),
    "threads". render_scene.draw adds "seconds" by stage, "backend", "notes", "unproved", "cut" and "attributes" (file attributes of the
    channels).
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
    """Return the channels of an empty picture."""
    return {name: np.full((height, width, WIDTHS.get(name, LIGHT)), EMPTY.get(name, 0.0), np.float32) for name in names}
