"""Charts of a mesh: connected triangles that a projection along one axis lays into a plane without folding them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...ir import F64

STEEPEST = 0.6  # least cosine of the angle between the normal of a triangle and the axis of its chart
_TINY = 1e-14  # area of a triangle without one, over the square of its longest edge
Rows = NDArray[np.intp]


class Charts(NamedTuple):
    """The charts of a mesh."""

    chart: Rows  # (m,) of each triangle; -1 of one without area
    frames: F64  # (c, 3, 3) of each chart: unit vectors along its u, along its v, and its axis
    shared: Rows  # (e, 2) pairs of sides that lie on each other; side 3 t + k of triangle t begins at its corner k
    fineness: F64  # (c,) factors of the density of texels

    def flat(self, corners: F64) -> F64:
        """(m, 3, 3) u, v and height of corners (m, 3, 3); those without a chart are at 0."""
        placed = np.zeros(corners.shape)
        used = self.chart >= 0
        frames = self.frames[self.chart[used]] * self.fineness[self.chart[used], None, None]
        placed[used] = np.einsum("mcj,mkj->mkc", frames, corners[used])
        return placed

    @property
    def outer(self) -> NDArray[np.bool_]:
        """(m,) triangles with a side that no other of their chart has."""
        first, second = self.shared.T
        same = self.chart[first // 3] == self.chart[second // 3]
        inner = np.zeros(3 * len(self.chart), bool)
        inner[first[same]] = inner[second[same]] = True
        return np.logical_not(inner.reshape(-1, 3).all(axis=1))


def make_charts(positions: F64, triangles: NDArray[np.int32], fineness: F64 | None = None) -> Charts:
    """The charts of a mesh with positions (n, 3): each grows from its largest triangle over edges, as far as STEEPEST allows.

    `fineness` (m,) are factors of the density of texels on triangles; a chart has one.
    """
    fine = np.ones(len(triangles)) if fineness is None else fineness
    corners = positions[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(cross, axis=1)
    longest = (np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2) ** 2).max(axis=1, initial=0.0)
    is_flat = ~(doubled > _TINY * longest) | ~np.isfinite(doubled)
    normals = np.divide(cross, doubled[:, None], out=np.zeros_like(cross), where=~is_flat[:, None])
    shared = _shared_sides(positions, triangles)
    pairs = shared // 3
    chart, seeds = _grown(normals, doubled, is_flat, pairs[fine[pairs[:, 0]] == fine[pairs[:, 1]]])
    frames = _frames(normals[seeds], corners[seeds], corners, chart)
    return Charts(chart, frames, shared, fine[seeds])


def _shared_sides(positions: F64, triangles: NDArray[np.int32]) -> Rows:
    """(e, 2) pairs of sides with equal ends."""
    _, vertex = np.unique(positions, axis=0, return_inverse=True)
    ends = np.sort(np.stack([vertex.ravel()[triangles], vertex.ravel()[np.roll(triangles, -1, axis=1)]], axis=2).reshape(-1, 2), axis=1)
    key = ends[:, 0].astype(np.int64) * len(positions) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order[1:]] == key[order[:-1]])
    return np.stack([order[same], order[same + 1]], axis=1)


def _grown(normals: F64, areas: F64, is_flat: NDArray[np.bool_], neighbours: Rows) -> tuple[Rows, list[int]]:
    """(the chart of each triangle, the triangle that each chart began with). `neighbours` are pairs of triangles."""
    sources = np.concatenate([neighbours[:, 0], neighbours[:, 1]])
    by_source = np.argsort(sources, kind="stable")
    targets = np.concatenate([neighbours[:, 1], neighbours[:, 0]])[by_source].tolist()
    starts = np.searchsorted(sources[by_source], np.arange(len(areas) + 1)).tolist()
    rows: list[tuple[float, float, float]] = list(map(tuple, normals.tolist()))
    chart, seeds = [-1] * len(areas), list[int]()
    is_open = (~is_flat).tolist()
    for seed in np.argsort(-areas, kind="stable").tolist():
        if not is_open[seed]:
            continue
        x, y, z = rows[seed]
        is_open[seed], number, waiting = False, len(seeds), [seed]
        seeds.append(seed)
        while waiting:
            triangle = waiting.pop()
            chart[triangle] = number
            for neighbour in targets[starts[triangle] : starts[triangle + 1]]:
                if is_open[neighbour]:
                    nx, ny, nz = rows[neighbour]
                    if x * nx + y * ny + z * nz >= STEEPEST:
                        is_open[neighbour] = False
                        waiting.append(neighbour)
    return np.array(chart, np.intp), seeds


def _frames(axes: F64, seeds: F64, corners: F64, chart: Rows) -> F64:
    """(c, 3, 3) the frames of charts; u lies along the edge of the first triangle (c, 3, 3) that makes the least rectangle around all."""
    least_area, frames = np.full(len(axes), np.inf), np.tile(np.eye(3), (len(axes), 1, 1))
    used = np.flatnonzero(chart >= 0)
    for k in range(3):
        u = seeds[:, (k + 1) % 3] - seeds[:, k]
        u = u - (u * axes).sum(axis=1, keepdims=True) * axes
        u = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-300)
        turned = np.stack([u, np.cross(axes, u), axes], axis=1)
        flat = np.einsum("mcj,mkj->mkc", turned[chart[used], :2], corners[used])
        low, high = np.full((len(axes), 2), np.inf), np.full((len(axes), 2), -np.inf)
        np.minimum.at(low, chart[used], flat.min(axis=1))
        np.maximum.at(high, chart[used], flat.max(axis=1))
        area = (high - low).prod(axis=1)
        frames[area < least_area] = turned[area < least_area]
        least_area = np.minimum(least_area, area)
    return frames
