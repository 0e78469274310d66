"""Several rays that go one way through a mesh's tree: boxes and triangles are tested against all of them at once.

Intervals of origins and of inverse directions hold all rays, so that one test says whether any of them may enter a box (Reshetov,
Soupikov & Hurley, "Multi-Level Ray Tracing Algorithm", 2005). What is left of a leaf's triangles is met in double precision by all
rays side by side, and is what each of them would meet by itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import across, boxes, lanes, simd, walk
from . import shapes_flat as flat
from .kernels import apart, helper
from .records import Lane, Vec
from .wide import DEPTH, LEAF, NODE, SLACK, WIDTH, spread32

LANES = across.WIDTH
FEW = 3  # rays from which on it is worth it
WIDE = 0.2  # leaves of the mesh for each of them that they may be apart
WIDE_ANY = 0.1  # the same for any hit, which a ray by itself finds sooner
_FAR = np.float32(walk.FAR)


class Beam(NamedTuple):
    """Rays as intervals, for a node's boxes or a leaf's triangles; see walk.Box for the rows."""

    near: Vec  # origins, as they matter for near planes
    far: Vec
    least: Vec  # of 1 / direction
    most: Vec
    before: Vec  # near and far, moved by what rounding may do: triangles' corners have no slack
    behind: Vec
    rows: tuple[int, int, int]


@helper
def alike(rays: walk.Rays, left: int, reach: Any, fine: Any, any_hit: bool) -> bool:
    """Whether the rays whose bits are set in `left` are several and go through much the same leaves of a mesh.

    `reach` is the largest of the mesh's coordinates, `fine` how wide its leaves are.
    """
    count = simd.population(left)
    if count < FEW:
        return False
    width = (WIDE_ANY if any_hit else WIDE) * fine * count
    k = simd.trailing_zeros(left)
    kx, ky, kz = simd.read(rays.axes, k), simd.read(rays.axes, LANES + k), simd.read(rays.axes, 2 * LANES + k)
    same = (
        _like(simd.load(rays.axes, 0, LANES), k) & _like(simd.load(rays.axes, LANES, LANES), k)
        & _close(rays, 3, kx, kz, k, reach, width) & _close(rays, 4, ky, kz, k, reach, width)
        & _one_way(simd.load(rays.singles, 3 * LANES, LANES), k) & _one_way(simd.load(rays.singles, 4 * LANES, LANES), k)
        & _one_way(simd.load(rays.singles, 5 * LANES, LANES), k)
    )  # fmt: skip
    return (same & left) == left


@helper
def _like(axis: Lane, k: int) -> int:
    return simd.bits(axis == simd.lane(axis, k))


@helper
def _close(rays: walk.Rays, row: int, axis: int, along: int, k: int, reach: Any, width: Any) -> int:
    """Bits of the rays that stay within `width` of ray k on an axis from where they enter the mesh's box; `row` holds their slopes."""
    slope = simd.load(rays.doubles, row * LANES, LANES)
    across_, forth = simd.load(rays.singles, axis * LANES, LANES), simd.load(rays.singles, along * LANES, LANES)
    place = simd.to_f64(across_) - simd.lane(slope, k) * simd.to_f64(forth)
    apart_ = abs(place - simd.lane(place, k)) + 2.0 * reach * abs(slope - simd.lane(slope, k))
    return simd.bits(apart_ <= width)


@helper
def _one_way(inverse: Lane, k: int) -> int:
    up = simd.bits(inverse > np.float32(0.0))
    return up if (up >> k) & 1 else ~up


@helper
def _beam(rays: walk.Rays, left: int, reach: float) -> Beam:
    """`reach` is the largest of the mesh's coordinates."""
    k, slack = simd.trailing_zeros(left), np.float32(SLACK * reach)
    nx, fx, lx, mx, bx, ax = _interval(rays.singles, 0, left, k, slack)
    ny, fy, ly, my, by, ay = _interval(rays.singles, 1, left, k, slack)
    nz, fz, lz, mz, bz, az = _interval(rays.singles, 2, left, k, slack)
    zero, w = np.float32(0.0), LANES
    rows = boxes.rows_of(
        simd.read(rays.singles, 3 * w + k) > zero, simd.read(rays.singles, 4 * w + k) > zero, simd.read(rays.singles, 5 * w + k) > zero
    )
    return Beam((nx, ny, nz), (fx, fy, fz), (lx, ly, lz), (mx, my, mz), (bx, by, bz), (ax, ay, az), rows)


@helper
def _interval(singles: Any, axis: int, left: int, k: int, slack: Any) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane]:
    origin, inverse = simd.load(singles, axis * LANES, LANES), simd.load(singles, (3 + axis) * LANES, LANES)
    mine = simd.mask_from_bits(left, origin)
    origin = simd.select(mine, origin, simd.lane(origin, k))
    inverse = simd.select(mine, inverse, simd.lane(inverse, k))
    low, high = simd.min_of(origin), simd.max_of(origin)
    near, far, moved = (high, low, slack) if simd.lane(inverse, k) > np.float32(0.0) else (low, high, -slack)
    return (
        spread32(near), spread32(far), spread32(simd.min_of(inverse)), spread32(simd.max_of(inverse)),
        spread32(near + moved), spread32(far - moved),
    )  # fmt: skip


@helper
def _slabs(low: Lane, high: Lane, near: Vec, far: Vec, beam: Beam, k: int) -> tuple[Lane, Lane]:
    """Between what t the rays may be between near planes and far ones on axis k, for origins `near` and `far`."""
    low, high = low - near[k], high - far[k]
    return simd.minimum(low * beam.least[k], low * beam.most[k]), simd.maximum(high * beam.least[k], high * beam.most[k]) * _FAR


@helper
def _enter(nodes: Any, node: int, beam: Beam, limit: Any) -> tuple[Lane, int]:
    """Where the first ray may enter a node's boxes, and bits of those that one may enter before `limit`."""
    at = node * NODE
    x, y, z = beam.rows
    x0, x1 = _slabs(simd.load(nodes, at + x, WIDTH), simd.load(nodes, at + (x ^ WIDTH), WIDTH), beam.near, beam.far, beam, 0)
    y0, y1 = _slabs(simd.load(nodes, at + y, WIDTH), simd.load(nodes, at + (y ^ WIDTH), WIDTH), beam.near, beam.far, beam, 1)
    z0, z1 = _slabs(simd.load(nodes, at + z, WIDTH), simd.load(nodes, at + (z ^ WIDTH), WIDTH), beam.near, beam.far, beam, 2)
    near = simd.maximum(simd.maximum(x0, y0), simd.maximum(spread32(0.0), z0))
    return near, simd.bits(near <= simd.minimum(simd.minimum(x1, y1), simd.minimum(z1, spread32(limit))))


@helper
def _triangles(leaves: Any, leaf: int, beam: Beam, limit: Any) -> int:
    """Bits of a leaf's triangles that one of the rays may meet before `limit`."""
    at = leaf * LEAF
    x0, x1 = _corners(leaves, at, beam.rows[0] == 0, beam, 0)
    y0, y1 = _corners(leaves, at + WIDTH, beam.rows[1] == 2 * WIDTH, beam, 1)
    z0, z1 = _corners(leaves, at + 2 * WIDTH, beam.rows[2] == 4 * WIDTH, beam, 2)
    near = simd.maximum(simd.maximum(x0, y0), simd.maximum(spread32(0.0), z0))
    return simd.bits(near <= simd.minimum(simd.minimum(x1, y1), simd.minimum(z1, spread32(limit))))


@helper
def _corners(leaves: Any, at: int, up: bool, beam: Beam, k: int) -> tuple[Lane, Lane]:
    a, b, c = simd.load(leaves, at, WIDTH), simd.load(leaves, at + 3 * WIDTH, WIDTH), simd.load(leaves, at + 6 * WIDTH, WIDTH)
    low, high = simd.minimum(simd.minimum(a, b), c), simd.maximum(simd.maximum(a, b), c)
    if not up:
        low, high = high, low
    return _slabs(low, high, beam.before, beam.behind, beam, k)


_like_rays = getattr(simd, f"f32x{LANES}")  # a number for each ray


@apart
def meet(tree, root, rays, left, reach, any_hit):
    """(t, triangle, u, v) that the rays whose bits are set in `left` meet first; with `any_hit`, what each is found to meet first."""
    nodes, links, leaves, rows = tree.nodes, tree.links, tree.leaves, tree.rows
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    beam = _beam(rays, left, reach)
    first = simd.trailing_zeros(left)
    kx, ky, kz = (
        WIDTH * simd.read(rays.axes, first), WIDTH * simd.read(rays.axes, LANES + first), WIDTH * simd.read(rays.axes, 2 * LANES + first),
    )  # fmt: skip
    ox, oy, oz = across.load(rays.doubles, 0), across.load(rays.doubles, 1), across.load(rays.doubles, 2)
    sx, sy, sz = across.load(rays.doubles, 3), across.load(rays.doubles, 4), across.load(rays.doubles, 5)
    enters, t_min = across.load(rays.doubles, 6), across.load(rays.doubles, 7)
    t_max = lanes.where(simd.mask_from_bits(left, enters), across.load(rays.doubles, 8), -np.inf)
    t, triangle = enters * 0.0 + np.inf, lanes.int_like(enters, -1)
    v, w, total = enters * 0.0, enters * 0.0, enters * 0.0 + 1.0
    limits = simd.load(rays.singles, 6 * LANES, LANES)
    limits = simd.select(simd.mask_from_bits(left, limits), limits, np.float32(-np.inf))
    limit = simd.max_of(limits)
    top, node = np.int64(0), np.int64(root)
    while True:
        if node >= 0:
            near, hits = _enter(nodes, node, beam, limit)
            if hits != 0:
                node, top = walk.nearest_first(links, node, near, hits, children, reaches, top)
                continue
        else:
            leaf = ~node
            hits = _triangles(leaves, leaf, beam, limit)
            while hits != 0:
                j = simd.trailing_zeros(hits)
                hits &= hits - 1
                a, b, c = leaf * LEAF + j, leaf * LEAF + 3 * WIDTH + j, leaf * LEAF + 6 * WIDTH + j
                met = flat.crossing(
                    (_number(leaves, a + kx) - ox, _number(leaves, a + ky) - oy, _number(leaves, a + kz) - oz),
                    (_number(leaves, b + kx) - ox, _number(leaves, b + ky) - oy, _number(leaves, b + kz) - oz),
                    (_number(leaves, c + kx) - ox, _number(leaves, c + ky) - oy, _number(leaves, c + kz) - oz), sx, sy,
                )  # fmt: skip
                if lanes.any_lane(flat.ahead(met, sz)):
                    at_t, row = flat.reached(met, sz, t_min, t_max), np.int64(simd.read(rows, leaf * WIDTH + j))
                    nearer = (at_t < t) | ((at_t == t) & (at_t < np.inf) & (row < triangle))
                    t, triangle = lanes.where(nearer, at_t, t), lanes.where(nearer, row, triangle)
                    v, w, total = lanes.where(nearer, met.v, v), lanes.where(nearer, met.w, w), lanes.where(nearer, met.total, total)
                    if any_hit:
                        t_max = lanes.where(nearer, -np.inf, t_max)
                        shorter = lanes.where(nearer, -np.inf, enters * 0.0 + np.inf)
                    else:
                        shorter = (t - enters) * walk.FAR
                    limits = simd.minimum(limits, simd.to_f32(shorter))
                    limit = simd.max_of(limits)
        while top > 0 and simd.read(reaches, top - 1) > limit:
            top -= 1
        if top == 0:
            return t, triangle, v / total, w / total
        top -= 1
        node = np.int64(simd.read(children, top))


@helper
def _number(leaves: Any, i: int) -> Any:
    return simd.to_f64(_like_rays(simd.read(leaves, i)))
