"""Scalar z-buffer rasterizer for arbitrary sample positions: the nearest triangle at each sample of a tile.

Triangles are clipped, divided by w, snapped to 1/256 pixel and filled exactly (coverage.py). Keys are linear on the screen: 1 / depth for
a perspective camera, -depth for an orthographic one. They come from the triangle's plane in homogeneous coordinates, in float64
(Olano and Greer, Triangle Scan Conversion using 2D Homogeneous Coordinates, 1997). At equal keys the lowest instance, then the lowest
triangle wins, so that drawing order does not matter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..geometry import clipping
from ..jit.kernel import helper, kernel
from ..types import Tile
from . import coverage
from .view_geometry import COLUMNS, to_clip

NO_LINE = -(1 << 62)  # no row of samples
FLAT = 1e-6  # of a polygon's size: the largest distance of its corners from its plane, to fill it as a whole


class Samples(NamedTuple):
    """Sample positions of a tile, in fixed point from the picture's top left; `count` a pixel, in rows of pixels."""

    x: NDArray[np.int64]  # (h · w · count,)
    y: NDArray[np.int64]
    rows: int
    columns: int
    count: int
    reach: int  # largest distance from the pixel's centre in x or y


class DepthBuffer(NamedTuple):
    """The nearest triangle of each sample."""

    key: NDArray[np.float64]  # (h · w · count,) larger is nearer; -inf: empty
    instance: NDArray[np.int32]  # or -1
    triangle: NDArray[np.int32]  # row of Model.triangles; -1 for instances without triangles


class Workspace(NamedTuple):
    """Temporary memory of one thread."""

    corners: NDArray[np.float64]  # (3, 5) triangle in clip space
    first: NDArray[np.float64]  # (16, 5) clipped polygon
    second: NDArray[np.float64]  # (16, 5) temporary of clipping
    x: NDArray[np.int64]  # (n,) fixed-point corners of a triangle or a polygon's loops
    y: NDArray[np.int64]
    crossings: NDArray[np.int64]  # (n,)
    plane: NDArray[np.float64]  # (m, 5) depth planes a, b, c, and range of keys; one for each triangle of a polygon
    part_x: NDArray[np.int64]  # (m, 3) fixed-point corners of each triangle of a polygon
    part_y: NDArray[np.int64]


class Scratch(NamedTuple):
    """Output and temporary memory of one thread."""

    samples: Samples
    depth: DepthBuffer
    work: Workspace


def scratch_for(tile: Tile, count: int, reach: int, work: Workspace) -> Scratch:
    """Memory for `count` samples of each pixel of a tile; the z-buffer is empty."""
    rows, columns = tile.y1 - tile.y0, tile.x1 - tile.x0
    n = rows * columns * count
    samples = Samples(np.empty(n, np.int64), np.empty(n, np.int64), rows, columns, count, reach)
    return Scratch(samples, DepthBuffer(np.full(n, -np.inf), np.full(n, -1, np.int32), np.full(n, -1, np.int32)), work)


def workspace_for(tables: ir.Tables) -> Workspace:
    """Temporary memory for the largest polygon of the tables."""
    corners = max(16, _most_corners(tables.polygons, tables.pools.loops))
    parts = max(1, int(tables.polygons.triangle_count.max(initial=1)))
    return Workspace(
        np.empty((3, COLUMNS)), np.empty((16, COLUMNS)), np.empty((16, COLUMNS)), np.empty(corners, np.int64), np.empty(corners, np.int64),
        np.empty(corners, np.int64), np.empty((parts, 5)), np.empty((parts, 3), np.int64), np.empty((parts, 3), np.int64),
    )  # fmt: skip


def _most_corners(polygons: ir.Polygons, loops: NDArray[np.int32]) -> int:
    """The largest number of corners of a polygon with its holes."""
    if len(polygons.first_loop) == 0:
        return 0
    total = np.concatenate([[0], np.cumsum(loops[:, 1], dtype=np.int64)])
    return int((total[polygons.first_loop + polygons.loop_count] - total[polygons.first_loop]).max())


@kernel
def draw_triangles(model, clusters, chosen, tile, how, scratch):
    """Draw the chosen clusters of triangles into scratch.depth; `how` is one of the values of coverage.NAMES.

    `made`, `clusters` and `scratch` are handles.
    """
    for c in chosen:
        for item in range(clusters.first[c], clusters.first[c] + clusters.count[c]):
            draw_triangle(model, clusters.instance[c], model.order[item], tile, how, scratch)


@kernel
def draw_polygons(model, clusters, chosen, tables, flat, tile, scratch):
    """Draw the chosen clusters of polygons by scanlines: as a whole where `flat` (polygons,), else by triangles."""
    for c in chosen:
        instance, first, last = clusters.instance[c], clusters.first[c], clusters.first[c] + clusters.count[c]
        for polygon in range(first, last):
            if not (flat[polygon] and draw_polygon(model, tables, instance, polygon, tile, scratch)):
                start = tables.polygons.first_triangle[polygon]
                for triangle in range(start, start + tables.polygons.triangle_count[polygon]):
                    draw_triangle(model, instance, triangle, tile, coverage.SCANLINE, scratch)


@kernel
def draw_triangle(model, instance, triangle, tile, how, scratch):
    """Clip, project, snap and fill one triangle."""
    work = scratch.work
    for k in range(3):
        to_clip(model.matrix, instance, model.positions, model.triangles[triangle, k], work.corners, k)
    count = clip_triangle(model.planes, work)
    if count < 3 or not snap(work.first, count, model.perspective, work, 0):
        return
    x0, y0, x1, y1 = pixel_box(work, count, scratch.samples.reach, tile)
    if x0 >= x1 or y0 >= y1 or not key_plane(work.corners, tile, model.perspective, work.plane, 0):
        return
    for k in range(1, count - 1):
        fill_triangle(0, k, k + 1, instance, triangle, tile, how, scratch)


@helper
def clip_triangle(planes: Any, work: Workspace) -> int:
    """Clip the triangle work.corners into work.first; returns the number of corners."""
    cut = False
    for p in range(len(planes)):
        outside = 0
        for k in range(3):
            outside += clipping.distance(work.corners, k, planes[p]) < 0.0
        if outside == 3:
            return 0
        cut = cut or outside > 0
    for k in range(3):
        for c in range(COLUMNS):
            work.first[k, c] = work.corners[k, c]
    return clipping.clip_to_planes(work.first, 3, planes, work.second) if cut else 3


@helper
def key_plane(corners: Any, tile: Tile, perspective: bool, out: Any, row: int) -> bool:
    """Write the depth plane a, b, c, in pixels from the tile's corner, to out[row]; False if the triangle is edge-on.

    The corners' weights at a pixel are its products with the crosses of their rows (X, Y, W), over the determinant. Nothing is divided
    by W, so corners may lie behind the eye or at infinity.
    """
    w0, w1, w2 = corners[0, 2], corners[1, 2], corners[2, 2]
    x0, x1, x2 = corners[0, 0] - tile.x0 * w0, corners[1, 0] - tile.x0 * w1, corners[2, 0] - tile.x0 * w2
    y0, y1, y2 = corners[0, 1] - tile.y0 * w0, corners[1, 1] - tile.y0 * w1, corners[2, 1] - tile.y0 * w2
    a0, b0, c0 = y1 * w2 - w1 * y2, w1 * x2 - x1 * w2, x1 * y2 - y1 * x2
    a1, b1, c1 = y2 * w0 - w2 * y0, w2 * x0 - x2 * w0, x2 * y0 - y2 * x0
    a2, b2, c2 = y0 * w1 - w0 * y1, w0 * x1 - x0 * w1, x0 * y1 - y0 * x1
    determinant = x0 * a0 + y0 * b0 + w0 * c0
    if determinant == 0.0:
        return False
    k0 = (corners[0, 4] if perspective else -corners[0, 3]) / determinant
    k1 = (corners[1, 4] if perspective else -corners[1, 3]) / determinant
    k2 = (corners[2, 4] if perspective else -corners[2, 3]) / determinant
    out[row, 0] = k0 * a0 + k1 * a1 + k2 * a2
    out[row, 1] = k0 * b0 + k1 * b1 + k2 * b2
    out[row, 2] = k0 * c0 + k1 * c1 + k2 * c2
    return True


@helper
def snap(corners: Any, count: int, perspective: bool, work: Workspace, row: int) -> bool:
    """Write the fixed-point corners of a clipped polygon to work.x and work.y, the range of their keys to work.plane[row, 3:].

    The range clamps keys at samples that lie just outside the true triangle because of snapping. False if a corner has w <= 0.
    """
    low, high = np.inf, -np.inf
    for k in range(count):
        w = corners[k, 2]
        if not w > 0.0:
            return False
        work.x[k] = int(np.floor(corners[k, 0] / w * coverage.ONE + 0.5))
        work.y[k] = int(np.floor(corners[k, 1] / w * coverage.ONE + 0.5))
        key = corners[k, 4] / corners[k, 3] if perspective else -corners[k, 3] / corners[k, 4]
        low, high = min(low, key), max(high, key)
    work.plane[row, 3], work.plane[row, 4] = low, high
    return True


@helper
def pixel_range(low: int, high: int, reach: int, start: int, end: int) -> tuple[int, int]:
    """The pixels of a tile's row or column, from its start, with samples between two fixed-point coordinates."""
    first = -((coverage.HALF + reach - low) // coverage.ONE)
    last = (high - coverage.HALF + reach) // coverage.ONE
    return max(first, start) - start, min(last + 1, end) - start


@helper
def pixel_box(work: Workspace, count: int, reach: int, tile: Tile) -> tuple[int, int, int, int]:
    """x0, y0, x1, y1 of the tile's pixels with samples in the bounds of the first `count` corners of work.x and work.y."""
    x0, y0, x1, y1 = work.x[0], work.y[0], work.x[0], work.y[0]
    for k in range(1, count):
        x0, y0, x1, y1 = min(x0, work.x[k]), min(y0, work.y[k]), max(x1, work.x[k]), max(y1, work.y[k])
    i0, i1 = pixel_range(x0, x1, reach, tile.x0, tile.x1)
    j0, j1 = pixel_range(y0, y1, reach, tile.y0, tile.y1)
    return i0, j0, i1, j1


@helper
def fill_triangle(a: int, b: int, c: int, instance: int, triangle: int, tile: Tile, how: int, scratch: Scratch) -> None:
    """Fill the triangle of corners a, b, c of work.x and work.y, in either order."""
    work, samples = scratch.work, scratch.samples
    area = coverage.doubled_area(work.x[a], work.y[a], work.x[b], work.y[b], work.x[c], work.y[c])
    if area == 0:
        return
    if area < 0:
        b, c = c, b
    ax, ay, bx, by, cx, cy = work.x[a], work.y[a], work.x[b], work.y[b], work.x[c], work.y[c]
    x0, x1 = pixel_range(min(ax, min(bx, cx)), max(ax, max(bx, cx)), samples.reach, tile.x0, tile.x1)
    y0, y1 = pixel_range(min(ay, min(by, cy)), max(ay, max(by, cy)), samples.reach, tile.y0, tile.y1)
    if x0 >= x1 or y0 >= y1:
        return
    part_x, part_y = work.part_x[0], work.part_y[0]
    part_x[0], part_x[1], part_x[2], part_y[0], part_y[1], part_y[2] = ax, bx, cx, ay, by, cy
    crossing_count, line = 0, min(ay, min(by, cy)) - 1
    for j in range(y0, y1):
        start = j * samples.columns
        for s in range((start + x0) * samples.count, (start + x1) * samples.count):
            px, py = samples.x[s], samples.y[s]
            if how == coverage.EDGES:
                covered = coverage.inside_edges(ax, ay, bx, by, cx, cy, px, py)
            elif how == coverage.AREAS:
                covered = coverage.inside_areas(ax, ay, bx, by, cx, cy, px, py)
            else:
                if py != line:
                    line = py
                    crossing_count = coverage.crossings(part_x, part_y, 0, 3, py, work.crossings, 0)
                covered = coverage.inside_crossings(work.crossings, crossing_count, px)
            if covered:
                test_depth(work.plane, 0, px, py, instance, triangle, tile, s, scratch.depth)


@helper
def test_depth(plane: Any, row: int, px: int, py: int, instance: int, triangle: int, tile: Tile, s: int, depth: DepthBuffer) -> None:
    """Depth-test the triangle of plane[row] at sample s."""
    x, y = px / coverage.ONE - tile.x0, py / coverage.ONE - tile.y0
    key = min(max(plane[row, 0] * x + plane[row, 1] * y + plane[row, 2], plane[row, 3]), plane[row, 4])
    old = depth.key[s]
    if not key >= old:
        return
    if key == old and (instance, triangle) > (depth.instance[s], depth.triangle[s]):
        return
    depth.key[s], depth.instance[s], depth.triangle[s] = key, instance, triangle


# --- whole polygons ------------------------------------------------------------------------------------------------------


@kernel
def flat_polygons(tables, out):
    """Write for each polygon whether it is planar (by Newell's normal) and has more than one triangle."""
    polygons, pools = tables.polygons, tables.pools
    for p in range(len(polygons.first_loop)):
        first = polygons.first_loop[p]
        normal, low, high = np.zeros(3), np.full(3, np.inf), np.full(3, -np.inf)
        for loop in range(first, first + polygons.loop_count[p]):
            start, count = pools.loops[loop, 0], pools.loops[loop, 1]
            for c in range(count):
                corner, next_corner = pools.corners[start + c], pools.corners[start + (c + 1) % count]
                for k in range(3):
                    u, v = (k + 1) % 3, (k + 2) % 3
                    a, b = pools.positions[corner], pools.positions[next_corner]
                    if loop == first:
                        normal[k] += (float(a[u]) - b[u]) * (float(a[v]) + b[v] - 2.0 * pools.positions[pools.corners[start]][v])
                    low[k], high[k] = min(low[k], a[k]), max(high[k], a[k])
        size = np.sqrt(((high - low) ** 2).sum())
        length = np.sqrt((normal**2).sum())
        nearest, farthest = np.inf, -np.inf
        for loop in range(first, first + polygons.loop_count[p]):
            start, count = pools.loops[loop, 0], pools.loops[loop, 1]
            for c in range(count):
                d = 0.0
                for k in range(3):
                    d += normal[k] * (float(pools.positions[pools.corners[start + c], k]) - low[k])
                nearest, farthest = min(nearest, d), max(farthest, d)
        out[p] = polygons.triangle_count[p] > 1 and length > 0.0 and farthest - nearest <= FLAT * size * length


@kernel
def draw_polygon(model, tables, instance, polygon, tile, scratch):
    """Fill one planar polygon by scanlines; False, without drawing, if it needs clipping."""
    first, count = tables.polygons.first_triangle[polygon], tables.polygons.triangle_count[polygon]
    if not snap_triangles(model, instance, first, count, tile, scratch.work):
        return False
    corners = project_loops(model, tables, instance, polygon, scratch.work)
    if corners > 0:
        fill_polygon(tables, instance, polygon, corners, tile, scratch)
    return True


@helper
def snap_triangles(model: Any, instance: int, first: int, count: int, tile: Tile, work: Workspace) -> bool:
    """Write the fixed-point corners and depth planes of a polygon's triangles; False if one needs clipping."""
    for t in range(count):
        for k in range(3):
            to_clip(model.matrix, instance, model.positions, model.triangles[first + t, k], work.corners, k)
            for p in range(len(model.planes)):
                if clipping.distance(work.corners, k, model.planes[p]) < 0.0:
                    return False
        if not snap(work.corners, 3, model.perspective, work, t):
            return False
        if not key_plane(work.corners, tile, model.perspective, work.plane, t):
            work.plane[t, 0], work.plane[t, 1], work.plane[t, 2] = 0.0, 0.0, 0.0
        for k in range(3):
            work.part_x[t, k], work.part_y[t, k] = work.x[k], work.y[k]
    return True


@helper
def project_loops(model: Any, tables: ir.Tables, instance: int, polygon: int, work: Workspace) -> int:
    """Write the fixed-point corners of all loops of a polygon; returns their number, 0 if one is behind the eye."""
    corner_count = 0
    first = tables.polygons.first_loop[polygon]
    for loop in range(first, first + tables.polygons.loop_count[polygon]):
        start = tables.pools.loops[loop, 0]
        for c in range(start, start + tables.pools.loops[loop, 1]):
            to_clip(model.matrix, instance, model.positions, tables.pools.corners[c], work.corners, 0)
            w = work.corners[0, 2]
            if not w > 0.0:
                return 0
            work.x[corner_count] = int(np.floor(work.corners[0, 0] / w * coverage.ONE + 0.5))
            work.y[corner_count] = int(np.floor(work.corners[0, 1] / w * coverage.ONE + 0.5))
            corner_count += 1
    return corner_count


@helper
def fill_polygon(tables: ir.Tables, instance: int, polygon: int, corners: int, tile: Tile, scratch: Scratch) -> None:
    """Fill a polygon's loops by scanlines and the even-odd rule; each covered sample stores the triangle it lies in."""
    work, samples = scratch.work, scratch.samples
    loops, first_loop = tables.pools.loops, tables.polygons.first_loop[polygon]
    first, count = tables.polygons.first_triangle[polygon], tables.polygons.triangle_count[polygon]
    x0, y0, x1, y1 = pixel_box(work, corners, samples.reach, tile)
    crossing_count, line = 0, np.int64(NO_LINE)
    for j in range(y0, y1):
        for s in range((j * samples.columns + x0) * samples.count, (j * samples.columns + x1) * samples.count):
            px, py = samples.x[s], samples.y[s]
            if py != line:
                line, crossing_count, start = py, 0, 0
                for loop in range(first_loop, first_loop + tables.polygons.loop_count[polygon]):
                    crossing_count = coverage.crossings(work.x, work.y, start, loops[loop, 1], py, work.crossings, crossing_count)
                    start += loops[loop, 1]
            if coverage.inside_crossings(work.crossings, crossing_count, px):
                t = triangle_at(work, count, px, py)
                test_depth(work.plane, t, px, py, instance, first + t, tile, s, scratch.depth)


@helper
def triangle_at(work: Workspace, count: int, px: int, py: int) -> int:
    """The triangle of a polygon that contains a sample; if snapping flipped a sliver and none does, the nearest."""
    best, least = 0, -np.inf
    for t in range(count):
        x, y = work.part_x[t], work.part_y[t]
        area = coverage.doubled_area(x[0], y[0], x[1], y[1], x[2], y[2])
        if area == 0:
            continue
        b, c = (1, 2) if area > 0 else (2, 1)
        if coverage.inside_edges(x[0], y[0], x[b], y[b], x[c], y[c], px, py):
            return t
        inside = min(
            coverage.doubled_area(px, py, x[b], y[b], x[c], y[c]),
            min(coverage.doubled_area(x[0], y[0], px, py, x[c], y[c]), coverage.doubled_area(x[0], y[0], x[b], y[b], px, py)),
        ) / abs(area)  # fmt: skip
        if inside > least:
            best, least = t, inside
    return best
