"""Atlas of a mesh: its charts packed into one picture, with the points of the surface that its texels show.

Each chart lies in a rectangle with a gutter. Texels of a gutter show the plane of the nearest triangle, so that interpolation between
texels, and the first level of smaller pictures, reads nothing of other charts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...ir import F64
from .charts import Charts, Rows, make_charts

_GUTTERS = 3, 1  # texels around a chart; the smaller one where the charts are many
_ROUNDS = 5  # in which charts that overlap themselves are divided
_COARSE = 4  # of the side of the picture over that in the first of them
_APART = 3.0  # texels of height between two triangles in one place: more are two layers
_INSIDE = 1e-7  # barycentric coordinate of a texel outside of a triangle that counts as inside
_SLACK = 0.01  # texels around a triangle that are looked at


class Atlas(NamedTuple):
    """The layout of a picture, its texels from the top left in rows."""

    width: int
    height: int
    density: float  # texels a unit of length, along the planes of charts; of fineness 1
    coordinates: F64  # (m, 3, 2) u and v of corners, v up
    texels: Rows  # (k,) texels that show a point
    triangle: Rows  # (k,) its triangle
    weights: F64  # (k, 3) of the triangle's corners; beyond 0 and 1 in gutters
    tangents: F64  # (k, 2, 3) unit vectors along u and v of the texel's chart
    axes: F64  # (k, 3) the axis of that chart


class _Layout(NamedTuple):
    """Charts in a picture."""

    density: float
    gutter: int
    size: tuple[int, int]
    flat: F64  # (m, 3, 3) corners in texels, x to the right and y up; their height in texels
    boxes: Rows  # (m, 4) the rectangle of each triangle's chart: first and last column and row, the last excluded


class _Shown(NamedTuple):
    """Charts in a picture, the triangle that each texel shows (-1: none), and triangles that higher layers of their chart hide."""

    charts: Charts
    layout: _Layout
    owner: Rows
    hidden: Rows


def make_atlas(positions: F64, triangles: NDArray[np.int32], side: int, fineness: F64 | None = None) -> Atlas | None:
    """The atlas of a mesh with positions (n, 3), at most `side` texels wide and high; None where the charts are too many for it.

    `fineness`: see make_charts.
    """
    charts, corners = make_charts(positions, triangles, fineness), positions[triangles]
    if not (charts.chart >= 0).any():
        return None
    coarse = max(side // _COARSE, 1)
    for _ in range(_ROUNDS):  # at a low density, which is quicker
        shown = _shown(charts, corners, coarse)
        if shown is None or not len(shown.hidden):
            break
        charts = _divided(charts, shown.hidden)
    for attempt in range(_ROUNDS):
        shown = _shown(charts, corners, side)
        if shown is None or not len(shown.hidden) or attempt == _ROUNDS - 1:
            break
        charts = _divided(charts, shown.hidden, attempt > 0)
    return None if shown is None else _atlas(shown)


def _shown(charts: Charts, corners: F64, side: int) -> _Shown | None:
    """The charts in a picture; None where they do not fit."""
    layout = _laid_out(charts, corners, side)
    if layout is None:
        return None
    owner = _owners(layout, charts)
    return _Shown(charts, layout, owner, _hidden(layout, charts, owner))


def _atlas(shown: _Shown) -> Atlas:
    charts, layout, owner, _ = shown
    width, height = layout.size
    texels = np.flatnonzero(owner >= 0)
    triangle = owner[texels]
    weights = _weights(layout.flat[triangle, :, :2], _middles(texels % width, height - 1 - texels // width))
    frames = charts.frames[charts.chart[triangle]]
    return Atlas(
        width, height, layout.density, layout.flat[..., :2] / [width, height], texels, triangle, weights, frames[:, :2], frames[:, 2]
    )  # fmt: skip


# --- layout -------------------------------------------------------------------------------------------------------------


def _laid_out(charts: Charts, corners: F64, side: int) -> _Layout | None:
    """Charts in a picture at the highest density; None where they do not fit at any."""
    flat, chart = charts.flat(corners), charts.chart
    used = chart >= 0
    low, high = np.full((len(charts.frames), 3), np.inf), np.full((len(charts.frames), 3), -np.inf)
    np.minimum.at(low, chart[used], flat[used].min(axis=1))
    np.maximum.at(high, chart[used], flat[used].max(axis=1))
    extents = (high - low)[:, :2]
    for gutter in _GUTTERS:
        density = _densest(extents, side, gutter)
        if density > 0.0:
            break
    else:
        return None
    sizes = _sizes(extents, density, gutter)
    places, height = _packed(sizes, side)
    width = int((places[:, 0] + sizes[:, 0]).max())
    shift = places + gutter + 0.5 - low[:, :2] * density
    flat = flat * density
    flat[used, :, :2] += shift[chart[used], None]
    flat[~used] = 0.5
    boxes = np.concatenate([places, places + sizes], axis=1)[chart][:, [0, 2, 1, 3]]
    return _Layout(density, gutter, (width, height), flat, boxes)


def _sizes(extents: F64, density: float, gutter: int) -> Rows:
    """(c, 2) texels of rectangles around charts."""
    return np.ceil(extents * density - 1e-9).astype(np.intp) + 1 + 2 * gutter


def _densest(extents: F64, side: int, gutter: int) -> float:
    """The highest density at which charts fit, within a hundredth; 0 where they do not."""
    room = side - 1 - 2 * gutter
    longest, area = float(extents.max()), float(extents.prod(axis=1).sum())
    if room < 1 or longest <= 0.0 or len(extents) * (1 + 2 * gutter) ** 2 > side * side:
        return 0.0

    def fits(density: float) -> bool:
        sizes = _sizes(extents, density, gutter)
        return bool(sizes.max() <= side and sizes.prod(axis=1).sum() <= side * side and _packed(sizes, side)[1] <= side)

    high = min(room / longest, side / max(area, 1e-300) ** 0.5)
    if fits(high):
        return high
    low = high / 1024.0
    if not fits(low):
        return 0.0
    while high > 1.01 * low:
        middle = (low * high) ** 0.5
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _packed(sizes: Rows, side: int) -> tuple[Rows, int]:
    """(places (c, 2) of rectangles in shelves, from the highest to the lowest; the height of all)."""
    order = np.lexsort((-sizes[:, 0], -sizes[:, 1]))
    places = [(0, 0)] * len(sizes)
    x = y = shelf = 0
    for number, (width, height) in zip(order.tolist(), sizes[order].tolist(), strict=True):
        if x + width > side:
            x, y, shelf = 0, y + shelf, 0
        places[number] = (x, y)
        x, shelf = x + width, max(shelf, height)
    return np.array(places, np.intp), y + shelf


# --- texels of triangles --------------------------------------------------------------------------------------------------


class _Pairs(NamedTuple):
    """Pairs of a triangle and a texel by it."""

    triangle: Rows  # (k,)
    column: Rows
    row: Rows  # from below
    weights: F64  # (k, 3) of the texel's middle
    height: F64  # (k,) of the triangle's plane there, in texels


def _pairs(layout: _Layout, charts: Charts, reach: float) -> _Pairs:
    """Texels inside of triangles, and in the rectangle of their chart up to about `reach` texels from its outer triangles."""
    used = np.flatnonzero(charts.chart >= 0)
    flat, boxes = layout.flat[used, :, :2], layout.boxes[used]
    wider = np.where(charts.outer[used], reach, _SLACK)[:, None]
    low = np.maximum(np.floor(flat.min(axis=1) - wider).astype(np.intp), boxes[:, [0, 2]])
    high = np.minimum(np.ceil(flat.max(axis=1) + wider).astype(np.intp), boxes[:, [1, 3]])
    lines = np.maximum(high[:, 1] - low[:, 1], 0)
    each, step = _ranges(lines)
    rows = low[each, 1] + step
    first_column, last_column = low[each, 0].astype(np.float64), high[each, 0] - 1.0
    turn = np.where(_cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]) < 0.0, -1.0, 1.0)[:, None]
    for k in range(3):  # columns at which the row enters and leaves the half-plane of a side
        side = flat[:, (k + 1) % 3] - flat[:, k]
        normal = turn * np.stack([-side[:, 1], side[:, 0]], axis=1) / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-300)
        offset = -(normal * flat[:, k]).sum(axis=1) + wider[:, 0]
        slope, offset_in_row = normal[each, 0], normal[each, 1] * (rows + 0.5) + offset[each]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            crossing = np.clip(-offset_in_row / slope - 0.5, -2.0, 1e6)
        first_column = np.where(slope > 1e-12, np.maximum(first_column, np.ceil(crossing)), first_column)
        last_column = np.where(slope < -1e-12, np.minimum(last_column, np.floor(crossing)), last_column)
        last_column = np.where((np.abs(slope) <= 1e-12) & (offset_in_row < 0.0), -1.0, last_column)
    counts = np.maximum(last_column - first_column + 1.0, 0.0).astype(np.intp)
    line, step = _ranges(counts)
    columns, rows, triangle = first_column[line].astype(np.intp) + step, rows[line], used[each[line]]
    weights = _weights(layout.flat[triangle, :, :2], _middles(columns, rows))
    return _Pairs(triangle, columns, rows, weights, _heights(layout, triangle, weights))


def _ranges(counts: Rows) -> tuple[Rows, Rows]:
    """(numbers k, each counts[k] times; 0, 1, … of each)."""
    each = np.repeat(np.arange(len(counts)), counts)
    return each, np.arange(len(each)) - np.repeat(np.cumsum(counts) - counts, counts)


def _weights(corners: F64, points: F64) -> F64:
    """(k, 3) barycentric coordinates of points (k, 2) in triangles (k, 3, 2)."""
    a, b, c = (corners[:, k] for k in range(3))
    e1, e2, p = b - a, c - a, points - a
    area = _cross(e1, e2)
    area = np.where(area == 0.0, 1.0, area)
    second, third = _cross(p, e2) / area, _cross(e1, p) / area
    return np.stack([1.0 - second - third, second, third], axis=1)


def _middles(columns: Rows, rows: Rows) -> F64:
    """(k, 2) the middles of texels."""
    return np.stack([columns, rows], axis=1).astype(np.float64) + 0.5


def _cross(a: F64, b: F64) -> F64:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _distances(layout: _Layout, pairs: _Pairs) -> F64:
    """(k,) distances of texels from triangles; 0 inside."""
    distance = np.where(pairs.weights.min(axis=1) >= -_INSIDE, 0.0, np.inf)
    away = np.flatnonzero(distance > 0.0)
    corners, nearest = layout.flat[pairs.triangle[away], :, :2], np.full(len(away), np.inf)
    points = _middles(pairs.column[away], pairs.row[away])
    for k in range(3):
        side, p = corners[:, (k + 1) % 3] - corners[:, k], points - corners[:, k]
        share = np.clip((p * side).sum(axis=1) / np.maximum((side * side).sum(axis=1), 1e-300), 0.0, 1.0)[:, None]
        nearest = np.minimum(nearest, np.hypot(*(p - share * side).T))
    distance[away] = nearest
    return distance


def _heights(layout: _Layout, triangles: Rows, weights: F64) -> F64:
    """(k,) heights of the planes of triangles over the plane of their chart, in texels."""
    return (layout.flat[triangles, :, 2] * weights).sum(axis=1)


def _owners(layout: _Layout, charts: Charts) -> Rows:
    """(texels,) the triangle that each texel shows, the nearest and of several the topmost; -1 without one."""
    width, height = layout.size
    reach = 1.5 * layout.gutter
    pairs = _pairs(layout, charts, reach)
    distance, texels = _distances(layout, pairs), (height - 1 - pairs.row) * width + pairs.column
    nearest, top = np.full(width * height, reach), np.full(width * height, -np.inf)
    np.minimum.at(nearest, texels, distance)
    wins = np.flatnonzero(distance == nearest[texels])
    np.maximum.at(top, texels[wins], pairs.height[wins])
    wins = wins[pairs.height[wins] == top[texels[wins]]]
    owner = np.full(width * height, -1, np.intp)
    np.maximum.at(owner, texels[wins], pairs.triangle[wins])
    return owner


def _hidden(layout: _Layout, charts: Charts, owner: Rows) -> Rows:
    """The lower triangles of pairs in two layers of a chart, of which one shows in or beside the other."""
    width, height = layout.size
    used = np.flatnonzero(charts.chart >= 0)
    columns, rows = np.floor(layout.flat[used, :, :2].mean(axis=1)).astype(np.intp).T
    weights = _weights(layout.flat[used, :, :2], _middles(columns, rows))
    hidden = []
    for pairs in (_Pairs(used, columns, rows, weights, _heights(layout, used, weights)), _pairs(layout, charts, 1.5)):
        shown = owner[(height - 1 - pairs.row) * width + pairs.column]
        k = np.flatnonzero((shown >= 0) & (shown != pairs.triangle))
        points = _middles(pairs.column[k], pairs.row[k])
        over = _heights(layout, shown[k], _weights(layout.flat[shown[k], :, :2], points))
        apart = over - pairs.height[k]
        hidden.append(np.where(apart > 0.0, pairs.triangle[k], shown[k])[np.abs(apart) > _APART])
    return np.unique(np.concatenate(hidden))


def _divided(charts: Charts, hidden: Rows, singly: bool = False) -> Charts:
    """Charts without some triangles, which make new ones: one for each chart that they come from, or one for each triangle."""
    sources = charts.chart[hidden]
    kinds, numbers = (sources, np.arange(len(hidden))) if singly else np.unique(sources, return_inverse=True)
    chart = charts.chart.copy()
    chart[hidden] = len(charts.frames) + numbers.ravel()
    frames, fineness = (np.concatenate([column, column[kinds]]) for column in (charts.frames, charts.fineness))
    return charts._replace(chart=chart, frames=frames, fineness=fineness)
