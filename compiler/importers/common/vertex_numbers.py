"""Numbers that vary over a mesh without texture coordinates: the number is u, and a texture of two texels returns it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....lang.diagnostics import Span
from ... import ir
from ...scene.builder import SceneBuilder
from ...scene.row_records import MeshAttribute, TextureData

# u = 0 and u = 1 are the centres of the two texels; between them the texture is linear.
ROUNDING = 1e-6  # of numbers that count as 0 or 1 without a warning
_FRAME = ((0.5, 0.0, 0.25), (0.0, 0.0, 0.5))


def coordinates(numbers: MeshAttribute, warn: Callable[[str], None]) -> MeshAttribute:
    """Texture coordinates whose u is a number (n, 1), clamped to 0…1 with a warning; numbers that are none count as 0."""
    values = np.asarray(numbers.values, np.float64).reshape(-1)
    beyond = np.count_nonzero(~((values >= -ROUNDING) & (values <= 1.0 + ROUNDING)))
    if beyond:
        warn(f"{beyond:,} of {len(values):,} numbers at vertices lie outside 0 to 1: they count as 0 or 1")
    u = np.clip(np.nan_to_num(values), 0.0, 1.0)
    return MeshAttribute(np.stack([u, np.zeros(len(u))], axis=1).astype(np.float32), numbers.interpolation)


def texture(builder: SceneBuilder, span: Span | None = None) -> int:
    """The row of a texture whose value is u."""
    texels = np.array([[[0, 0, 0, 1], [1, 1, 1, 1]]], np.float32)
    image = builder.shared("ramp of numbers", lambda: builder.image(texels, "ramp"))
    clamp = ir.Wrap.CLAMP
    return builder.texture(TextureData(ir.TextureKind.IMAGE, image, wrap_u=clamp, wrap_v=clamp, channel=0, frame=_FRAME), span)
