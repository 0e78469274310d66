"""One ray through a mesh's tree, against eight boxes or eight triangles at a time.

Boxes are float32 and never missed through rounding: what the origin and the planes lose is in the boxes' SLACK, all else is
relative to the distance and moves the far side out (Ize, "Robust BVH Ray Traversal", JCGT 2013). To keep the origin's part small
a ray begins where it enters the mesh's box. Triangles are float64, so that what is met, and where, is what brute force finds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import across, boxes, lanes, machine, simd
from . import shapes_flat as flat
from .kernels import apart, helper
from .records import Lane, Vec
from .wide import DEPTH, LEAF, NODE, WIDTH

FAR = 1.0 + 2.0**-21  # of the far side: eight roundings of float32
STEEP = 1e12  # times the inverse of the largest component: no other is larger, so that all are finite
_SINGLES, _DOUBLES, _INTS = 7 * across.WIDTH, 9 * across.WIDTH, 3 * across.WIDTH
_FAR = np.float32(FAR)


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
def room() -> Rays:
    """Where rays are kept."""
    return Rays(simd.stack_array(np.float32, _SINGLES), simd.stack_array(np.float64, _DOUBLES), simd.stack_array(np.int64, _INTS))


@helper
def keep(rays: Rays, k: int, o: Vec, d: Vec, inverse: Vec, enters: Lane, t_min: Lane, t_max: Lane, until: Lane) -> None:
    """Store rays, or ray k alone, that enter a mesh's box at `enters`; what lies between `until` and t_max may be found, but need not."""
    singles, doubles, axes = rays.singles, rays.doubles, rays.axes
    most = STEEP * lanes.smallest((abs(inverse[0]), abs(inverse[1]), abs(inverse[2])))
    for j, x, slope, steep in ((0, o[0], d[0], inverse[0]), (1, o[1], d[1], inverse[1]), (2, o[2], d[2], inverse[2])):
        across.put_lane(singles, j, k, x + enters * slope)
        across.put_lane(singles, 3 + j, k, lanes.where(steep > most, most, lanes.where(steep < -most, -most, steep)))
    across.put_lane(singles, 6, k, (until - enters) * FAR)
    kx, ky, kz, sx, sy, sz = flat.shear_of(d, inverse)
    for j, axis, factor in ((0, kx, sx), (1, ky, sy), (2, kz, sz)):
        across.put_lane(axes, j, k, axis)
        across.put_lane(doubles, j, k, flat.component(o, axis))
        across.put_lane(doubles, 3 + j, k, factor)
    across.put_lane(doubles, 6, k, enters)
    across.put_lane(doubles, 7, k, t_min)
    across.put_lane(doubles, 8, k, t_max)


class Box(NamedTuple):
    """A ray as boxes want it: for eight boxes, and which of a node's rows are near and far."""

    scale: Vec  # 1 / direction
    shift: Vec  # -origin / direction
    far_scale: Vec  # FAR times both
    far_shift: Vec
    near: tuple[int, int, int]
    far: tuple[int, int, int]


@helper
def _box(rays: Rays, k: int) -> Box:
    x, y, z = _single(rays, 3, k), _single(rays, 4, k), _single(rays, 5, k)
    px, py, pz = -_single(rays, 0, k) * x, -_single(rays, 1, k) * y, -_single(rays, 2, k) * z
    zero = np.float32(0.0)
    nx, ny, nz = boxes.rows_of(x > zero, y > zero, z > zero)
    return Box(
        _spread(x, y, z), _spread(px, py, pz), _spread(x * _FAR, y * _FAR, z * _FAR), _spread(px * _FAR, py * _FAR, pz * _FAR),
        (nx, ny, nz), (nx ^ WIDTH, ny ^ WIDTH, nz ^ WIDTH),
    )  # fmt: skip


@helper
def _spread(x: Any, y: Any, z: Any) -> Vec:
    return simd.f32x8(x), simd.f32x8(y), simd.f32x8(z)


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
            simd.fma(simd.load(nodes, at + box.far[0], 8), box.far_scale[0], box.far_shift[0]),
            simd.fma(simd.load(nodes, at + box.far[1], 8), box.far_scale[1], box.far_shift[1]),
        ),
        simd.minimum(simd.fma(simd.load(nodes, at + box.far[2], 8), box.far_scale[2], box.far_shift[2]), simd.f32x8(limit)),
    )
    return near, simd.bits(near <= far)


@helper
def _push_packed(stack: Any, top: int, values: Lane, which: int) -> int:
    """Put the lanes whose bits are set on a stack; where it ends then. What lies above is written over."""
    simd.store(stack, top, simd.compress(values, simd.mask_from_bits(which, values)))
    return top + simd.population(which)


@helper
def _push_each(stack: Any, top: int, values: Lane, which: int) -> int:
    """The same on machines that can't close lanes up: one by one."""
    aside = top + WIDTH
    simd.store(stack, aside, values)
    while which != 0:
        simd.write(stack, top, simd.read(stack, aside + simd.trailing_zeros(which)))
        which &= which - 1
        top += 1
    return top


_push = _push_packed if machine.AVX512 else _push_each


@helper
def nearest_first(links: Any, node: int, near: Lane, hits: int, children: Any, reaches: Any, top: int) -> tuple[Any, int]:
    """(the nearest child of a node among `hits`, not 0; where the stack ends with the others on it)."""
    if (hits & (hits - 1)) == 0:
        return np.int64(simd.read(links, node * WIDTH + simd.trailing_zeros(hits))), top
    mine = simd.mask_from_bits(hits, near)
    first = simd.trailing_zeros(simd.bits(near == simd.min_of(simd.select(mine, near, np.inf))) & hits)
    rest = hits ^ (1 << first)
    _push(children, top, simd.load(links, node * WIDTH, 8), rest)
    return np.int64(simd.read(links, node * WIDTH + first)), _push(reaches, top, near, rest)


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
def _triangles(leaves: Any, leaf: int, ray: Sheared) -> flat.Crossing:
    """Eight triangles against a ray."""
    at = leaf * LEAF
    return flat.crossing(
        _corner(leaves, at, ray), _corner(leaves, at + 3 * WIDTH, ray), _corner(leaves, at + 6 * WIDTH, ray), ray.shear[0], ray.shear[1],
    )  # fmt: skip


@helper
def _corner(leaves: Any, at: int, ray: Sheared) -> Vec:
    return (
        simd.to_f64(simd.load(leaves, at + ray.x, 8)) - ray.origin[0], simd.to_f64(simd.load(leaves, at + ray.y, 8)) - ray.origin[1],
        simd.to_f64(simd.load(leaves, at + ray.z, 8)) - ray.origin[2],
    )  # fmt: skip


@apart
def down(tree, root, rays, k, any_hit):
    """What ray k meets first in the tree at `root`; with `any_hit`, what is found first."""
    return blocked(tree, root, rays, k) if any_hit else closest(tree, root, rays, k)


@helper
def closest(tree: Any, root: int, rays: Rays, k: int) -> Met:
    """What ray k meets first in the tree at `root`."""
    nodes, links, leaves, rows = tree.nodes, tree.links, tree.leaves, tree.rows
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    box, ray, limit = _box(rays, k), _sheared(rays, k), _single(rays, 6, k)
    enters, t_min, t_max = _double(rays, 6, k), _double(rays, 7, k), _double(rays, 8, k)
    t, triangle, u, v = np.inf, np.int64(-1), 0.0, 0.0
    top, node = np.int64(0), np.int64(root)
    while True:
        if node >= 0:
            near, hits = _enter(nodes, node, box, limit)
            if hits != 0:
                node, top = nearest_first(links, node, near, hits, children, reaches, top)
                continue
        else:
            leaf = ~node
            met = _triangles(leaves, leaf, ray)
            if simd.any_of(flat.ahead(met, ray.shear[2])):
                at_t = flat.reached(met, ray.shear[2], t_min, t_max)
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
                links8 = simd.load(links, node * WIDTH, 8)
                node = np.int64(simd.read(links, node * WIDTH + simd.trailing_zeros(hits)))
                top = _push(children, top, links8, hits & (hits - 1))
                continue
        else:
            met = _triangles(leaves, ~node, ray)
            if simd.any_of(flat.ahead(met, ray.shear[2])):
                at_t = flat.reached(met, ray.shear[2], t_min, t_max)
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
