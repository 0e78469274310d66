"""Fills bands through the scalar z-buffer, by areas or scanlines, triangle by triangle or polygon by polygon.

The band's visibility buffer then holds the same keys and ids as the fill by meshlets gives, so that shading is the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..jit.kernel import kernel
from ..jit.packed_struct import Handle
from ..types import Tile, View
from . import coverage, scalar_raster, view_geometry
from .band_buffer import Pattern
from .meshlet_culling import VisibleMeshlets
from .meshlets import SHIFT, Meshlets


class ClusterRasterizer:
    """Draws the clusters of a view into scalar z-buffers, by any of the three fills."""

    def __init__(self, tables: ir.Tables, packed: Handle, view: View, model: Handle, ranges: NDArray, how: int, margin: int) -> None:
        """`packed` is the handle of `tables`, `how` a value of coverage.NAMES; `margin` pixels grow the picture."""
        self.packed, self.model, self.how = packed, model, how
        self.flat = np.zeros(len(tables.polygons.first_loop), np.bool_)
        by_polygon = how == coverage.SCANLINE
        if by_polygon:
            scalar_raster.flat_polygons(packed, self.flat)
        clusters = view_geometry.clusters(model, ranges, tables, view, margin, by_polygon)
        self.box, self.by_polygon, self.clusters = clusters.box, clusters.polygons, Handle(clusters)

    def draw(self, tile: Tile, scratch: Handle) -> None:
        """Draw the clusters that overlap a tile into its scratch."""
        box = self.box
        overlaps = (box[:, 0] < tile.x1) & (box[:, 2] > tile.x0) & (box[:, 1] < tile.y1) & (box[:, 3] > tile.y0)
        scalar_raster.draw_triangles(self.model, self.clusters, np.flatnonzero(overlaps & ~self.by_polygon), tile, self.how, scratch)
        if self.by_polygon.any():
            scalar_raster.draw_polygons(
                self.model, self.clusters, np.flatnonzero(overlaps & self.by_polygon), self.packed, self.flat, tile, scratch
            )


class AlternativeFill:
    """Fills bands by areas or scanlines."""

    def __init__(self, how: str, tables: ir.Tables, packed: Handle, view: View, model: Handle, ranges: NDArray, meshlets: Meshlets) -> None:
        self.tables = tables
        self.rasterizer = ClusterRasterizer(tables, packed, view, model, ranges, coverage.NAMES[how], 2)
        self.slots = np.full(len(model.tables.triangles), -1, np.int32)
        self.meshlet = np.zeros(len(model.tables.triangles), np.int32)
        for m, (first, count) in enumerate(zip(meshlets.first_triangle.tolist(), meshlets.triangles.tolist(), strict=True)):
            rows = meshlets.corner[first : first + count, 3]
            self.slots[rows], self.meshlet[rows] = np.arange(count), m

    def draw(self, band: Handle, pattern: Pattern, visible: VisibleMeshlets) -> None:
        """Fill a band's visibility buffer."""
        buffer: Any = band.tables
        x, y, columns, rows = (int(n) for n in buffer.window)
        tile = Tile(x, y, x + columns, y + rows)
        scratch = scalar_raster.scratch_for(tile, len(pattern.x), 128, scalar_raster.workspace_for(self.tables))
        line, column = np.mgrid[y : y + rows, x : x + columns] * coverage.ONE
        scratch.samples.x[:] = (column[..., None] + pattern.x).ravel()
        scratch.samples.y[:] = (line[..., None] + pattern.y).ravel()
        packed = Handle(scratch)
        self.rasterizer.draw(tile, packed)
        count = int(visible.count[0])
        rank = visible.instance[:count].astype(np.int64) << 32 | visible.meshlet[:count]
        write_band(packed, self.slots, self.meshlet, rank, len(pattern.x), band)


@kernel
def write_band(scratch, slots, meshlet, rank, samples, band):
    """Write a z-buffer to a band's visibility buffer. `rank` holds instance << 32 | meshlet of the visible meshlets, ascending."""
    depth_buffer = scratch.depth
    columns = band.window[2]
    for k in range(len(depth_buffer.key)):
        pixel, s = k // samples, k % samples
        x, y = pixel % columns, pixel // columns
        place = ((((y >> 2) * (columns >> 2) + (x >> 2)) * samples + s) << 4) + ((x & 3) << 2) + (y & 3)
        band.key[place] = depth_buffer.key[k]
        band.ids[place] = -1
        if depth_buffer.instance[k] >= 0:
            triangle = depth_buffer.triangle[k]
            row = np.searchsorted(rank, (np.int64(depth_buffer.instance[k]) << 32) | meshlet[triangle])
            band.ids[place] = row << SHIFT | slots[triangle]
