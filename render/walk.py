"""One ray through a mesh's tree, against eight boxes or eight triangles at a time.

Boxes are float32 and never missed through rounding: what the origin and the planes lose is in the boxes' SLACK, all else is
relative to the distance and moves the far side out (Ize, "Robust BVH Ray Traversal", JCGT 2013). To keep the origin's part small
a ray begins where it enters the mesh's box. Triangles are float64, so that what is met, and where, is what brute force finds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import across, lanes, shapes, simd
from .kernels import helper
from .records import Lane, Vec
from .wide import DEPTH, LEAF, NODE, WIDTH

FAR = 1.0 + 2.0**-21  # of the far side: eight roundings of float32
AXIS = 1e-12  # of the largest component: what smaller ones are moved by, so that their inverse is finite
_SINGLES, _DOUBLES, _INTS = 7 * across.WIDTH, 9 * across.WIDTH, 3 * across.WIDTH
_FAR = np.float32(FAR)
_NONE = -(1 << 40)  # no node to go to


class Rays(NamedTuple):
    """Rays in memory, rows of lanes, for `closest` and `blocked` to take one by one."""

    singles: Any  # float32: origin where the ray enters, 1 / direction, limit
    doubles: Any  # float64: origin in the shear's axes, the shear, where the ray enters and may begin and end
    axes: Any  # int64: the shear's axes


class Met(NamedTuple):
    """What one ray meets."""

    t: Any  # inf: nothing
    triangle: Any  # or -1
    u: Any
    v: Any


@helper
def keep(o: Vec, d: Vec, enters: Lane, t_min: Lane, t_max: Lane, until: Lane) -> Rays:
    """Store rays that enter a mesh's box at `enters`; what lies between `until` and t_max is not wanted, but may be found."""
    singles, doubles = simd.stack_array(np.float32, _SINGLES), simd.stack_array(np.float64, _DOUBLES)
    axes = simd.stack_array(np.int64, _INTS)
    least = AXIS * lanes.largest((abs(d[0]), abs(d[1]), abs(d[2])))
    for k, x, slope in ((0, o[0], d[0]), (1, o[1], d[1]), (2, o[2], d[2])):
        across.store(singles, k, x + enters * slope)
        aside = lanes.where(slope < 0.0, -least, least)
        across.store(singles, 3 + k, 1.0 / lanes.where(abs(slope) < least, slope + aside, slope))
    across.store(singles, 6, (until - enters) * FAR)
    kx, ky, kz, sx, sy, sz = shapes.shear(d)
    for k, axis, factor in ((0, kx, sx), (1, ky, sy), (2, kz, sz)):
        across.store(axes, k, axis)
        across.store(doubles, k, shapes.component(o, axis))
        across.store(doubles, 3 + k, factor)
    across.store(doubles, 6, enters)
    across.store(doubles, 7, t_min)
    across.store(doubles, 8, t_max)
    return Rays(singles, doubles, axes)


class Box(NamedTuple):
    """A ray as boxes want it: for eight boxes, and which of a node's rows are near and far."""

    scale: Vec  # 1 / direction
    shift: Vec  # -origin / direction
    near: tuple[int, int, int]
    far: tuple[int, int, int]


@helper
def _box(rays: Rays, k: int) -> Box:
    x, y, z = _single(rays, 3, k), _single(rays, 4, k), _single(rays, 5, k)
    px, py, pz = -_single(rays, 0, k) * x, -_single(rays, 1, k) * y, -_single(rays, 2, k) * z
    zero = np.float32(0.0)
    nx, ny, nz = 0 if x > zero else WIDTH, 2 * WIDTH if y > zero else 3 * WIDTH, 4 * WIDTH if z > zero else 5 * WIDTH
    return Box(
        (simd.f32x8(x), simd.f32x8(y), simd.f32x8(z)), (simd.f32x8(px), simd.f32x8(py), simd.f32x8(pz)),
        (nx, ny, nz), (nx ^ WIDTH, ny ^ WIDTH, nz ^ WIDTH),
    )  # fmt: skip


@helper
def _single(rays: Rays, row: int, k: int) -> Any:
    return simd.read(rays.singles, row * across.WIDTH + k)


@helper
def _double(rays: Rays, row: int, k: int) -> Any:
    return simd.read(rays.doubles, row * across.WIDTH + k)


@helper
def _enter(nodes: Any, node: int, box: Box, limit: Any) -> tuple[Lane, int]:
    """Where a ray enters a node's eight boxes, and bits of those it enters before `limit`."""
    at = node * NODE
    near = simd.maximum(
        simd.maximum(
            simd.fma(simd.load(nodes, at + box.near[0], 8), box.scale[0], box.shift[0]),
            simd.fma(simd.load(nodes, at + box.near[1], 8), box.scale[1], box.shift[1]),
        ),
        simd.maximum(simd.fma(simd.load(nodes, at + box.near[2], 8), box.scale[2], box.shift[2]), simd.f32x8(0.0)),
    )
    far = simd.minimum(
        simd.minimum(
            simd.fma(simd.load(nodes, at + box.far[0], 8), box.scale[0], box.shift[0]),
            simd.fma(simd.load(nodes, at + box.far[1], 8), box.scale[1], box.shift[1]),
        ),
        simd.minimum(simd.fma(simd.load(nodes, at + box.far[2], 8), box.scale[2], box.shift[2]), simd.f32x8(limit)),
    )
    return near, simd.bits(near <= far * _FAR)


class Sheared(NamedTuple):
    """A ray as triangles want it."""

    x: int  # rows of a leaf
    y: int
    z: int
    origin: Vec
    shear: Vec


@helper
def _sheared(rays: Rays, k: int) -> Sheared:
    w = across.WIDTH
    return Sheared(
        WIDTH * simd.read(rays.axes, k), WIDTH * simd.read(rays.axes, w + k), WIDTH * simd.read(rays.axes, 2 * w + k),
        (_double(rays, 0, k), _double(rays, 1, k), _double(rays, 2, k)), (_double(rays, 3, k), _double(rays, 4, k), _double(rays, 5, k)),
    )  # fmt: skip


@helper
def _triangles(leaves: Any, leaf: int, ray: Sheared) -> shapes.Crossing:
    """Eight triangles against a ray."""
    at = leaf * LEAF
    return shapes.crossing(
        _corner(leaves, at, ray), _corner(leaves, at + 3 * WIDTH, ray), _corner(leaves, at + 6 * WIDTH, ray), ray.shear[0], ray.shear[1],
    )  # fmt: skip


@helper
def _corner(leaves: Any, at: int, ray: Sheared) -> Vec:
    return (
        simd.to_f64(simd.load(leaves, at + ray.x, 8)) - ray.origin[0], simd.to_f64(simd.load(leaves, at + ray.y, 8)) - ray.origin[1],
        simd.to_f64(simd.load(leaves, at + ray.z, 8)) - ray.origin[2],
    )  # fmt: skip


@helper
def closest(tree: Any, root: int, rays: Rays, k: int) -> Met:
    """What ray k meets first in the tree at `root`."""
    nodes, links, leaves, rows = tree.nodes, tree.links, tree.leaves, tree.rows
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    entered = simd.stack_array(np.float32, 8)
    box, ray, limit = _box(rays, k), _sheared(rays, k), _single(rays, 6, k)
    enters, t_min, t_max = _double(rays, 6, k), _double(rays, 7, k), _double(rays, 8, k)
    t, triangle, u, v = np.inf, np.int64(-1), 0.0, 0.0
    top, node = np.int64(0), np.int64(root)
    while True:
        while node >= 0:
            near, hits = _enter(nodes, node, box, limit)
            if hits == 0:
                node = np.int64(_NONE)
                break
            first = np.int64(simd.read(links, node * WIDTH + simd.trailing_zeros(hits)))
            rest = hits & (hits - 1)
            if rest == 0:
                node = first
                continue
            simd.store(entered, 0, near)
            distance = simd.read(entered, simd.trailing_zeros(hits))
            base = top
            while rest != 0:
                j = simd.trailing_zeros(rest)
                rest &= rest - 1
                child, reach = simd.read(links, node * WIDTH + j), simd.read(entered, j)
                if reach < distance:
                    child, first = np.int32(first), np.int64(child)
                    reach, distance = distance, reach
                at = top
                while at > base and simd.read(reaches, at - 1) < reach:
                    simd.write(children, at, simd.read(children, at - 1))
                    simd.write(reaches, at, simd.read(reaches, at - 1))
                    at -= 1
                simd.write(children, at, child)
                simd.write(reaches, at, reach)
                top += 1
            node = first
        if node > _NONE:
            leaf = ~node
            met = _triangles(leaves, leaf, ray)
            if simd.any_of(met.inside):
                at_t = shapes.reached(met, ray.shear[2], t_min, t_max)
                nearest = simd.min_of(at_t)
                if nearest <= t and nearest < np.inf:
                    row = simd.load(rows, leaf * WIDTH, 8)
                    same = at_t == nearest
                    number = np.int64(simd.min_of(simd.select(same, simd.to_i64(row), 1 << 40)))
                    if nearest < t or number < triangle:
                        lane = simd.trailing_zeros(simd.bits(same & (simd.to_i64(row) == number)))
                        total = simd.lane(met.total, lane)
                        t, triangle, u, v = nearest, number, simd.lane(met.v, lane) / total, simd.lane(met.w, lane) / total
                        limit = np.float32((t - enters) * FAR)
        while top > 0 and simd.read(reaches, top - 1) > limit:
            top -= 1
        if top == 0:
            return Met(t, triangle, u, v)
        top -= 1
        node = np.int64(simd.read(children, top))


@helper
def blocked(tree: Any, root: int, rays: Rays, k: int) -> Met:
    """The first triangle found in the way of ray k in the tree at `root`."""
    nodes, links, leaves, rows = tree.nodes, tree.links, tree.leaves, tree.rows
    children = simd.stack_array(np.int32, DEPTH)
    box, ray, limit = _box(rays, k), _sheared(rays, k), _single(rays, 6, k)
    t_min, t_max = _double(rays, 7, k), _double(rays, 8, k)
    top, node = np.int64(0), np.int64(root)
    while True:
        if node >= 0:
            hits = _enter(nodes, node, box, limit)[1]
            if hits != 0:
                at = node * WIDTH
                node = np.int64(simd.read(links, at + simd.trailing_zeros(hits)))
                hits &= hits - 1
                while hits != 0:
                    simd.write(children, top, simd.read(links, at + simd.trailing_zeros(hits)))
                    hits &= hits - 1
                    top += 1
                continue
        else:
            met = _triangles(leaves, ~node, ray)
            if simd.any_of(met.inside):
                at_t = shapes.reached(met, ray.shear[2], t_min, t_max)
                found = simd.bits(at_t < np.inf)
                if found != 0:
                    lane = simd.trailing_zeros(found)
                    total = simd.lane(met.total, lane)
                    row = np.int64(simd.read(rows, ~node * WIDTH + lane))
                    return Met(simd.lane(at_t, lane), row, simd.lane(met.v, lane) / total, simd.lane(met.w, lane) / total)
        if top == 0:
            return Met(np.inf, np.int64(-1), 0.0, 0.0)
        top -= 1
        node = np.int64(simd.read(children, top))
