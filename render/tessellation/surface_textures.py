"""Values of textures at points of surfaces, for exporters that bake them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.mesh.shells import SurfacePoints
from ..texture import graphs, textures

_BATCH = 1 << 14  # points at once: their values stay in the cache


def make_texture_look_up(tables: ir.Tables) -> Callable[[int, int, SurfacePoints], NDArray[np.float64]]:
    """A function of a texture (a row), an instance (a row) and points: the values (k, 3) that a picture without a footprint shows."""
    linked: list[ir.Tables] = []  # once a texture is looked up

    def look_up(texture: int, instance: int, points: SurfacePoints) -> NDArray[np.float64]:
        if not linked:
            linked.append(graphs.with_lookups(tables))
        values = np.empty((len(points.local), 3))
        for first in range(0, len(values), _BATCH):
            local, _, faces, uvs = (column[first : first + _BATCH] for column in points)
            unit, rows = np.ones(len(local)), np.zeros(len(local), np.int64)
            spot = textures.Spot(tuple(local.T), tuple(faces.T), tuple(uvs.T), (unit, unit), rows + instance, None)  # type: ignore[arg-type]
            with np.errstate(all="ignore"):
                values[first : first + _BATCH] = np.stack(textures.value(linked[0], rows + texture, spot), axis=1)  # type: ignore[arg-type]
        return values

    return look_up
