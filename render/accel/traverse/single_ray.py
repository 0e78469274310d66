"""Rays through a mesh's tree, each for itself, against as many boxes or triangles at a time as a vector holds.

Boxes are float32 and never missed through rounding: what the origin and the planes lose is in the boxes' SLACK, all else is
relative to the distance and moves the far side out (Ize, "Robust BVH Ray Traversal", JCGT 2013). To keep the origin's part small
a ray begins where it enters the mesh's box. Triangles are sieved in float32, with all that rounding may do to them taken into
account; those that are left are met in float64, one by one, so that what is met, and where, is what brute force finds. Several rays
take turns, a step each, so that one moves on while others wait for memory or for a branch that was guessed wrong.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...geometry import flat_shapes as flat
from ...jit.kernel import helper
from ...lanes import crosslane, ops
from ...simd import target
from ...types import Hit, Lane, Vec
from ..build.wide_bvh import DEPTH, LEAF, NODE, WIDTH, spread32, triangle_of
from . import triangle_filter

FAR = 1.0 + 2.0**-21  # of the far side: eight roundings of float32
STEEP = 1e12  # times the inverse of the largest component: no other is larger, so that all are finite
RAYS = 2 * crosslane.WIDTH  # that have room
_SINGLES, _DOUBLES, _INTS = 14 * RAYS, 9 * RAYS, 6 * RAYS
_FAR = np.float32(FAR)
_LAST = np.int32(2**31 - 1)
STACK = 2 * DEPTH + 16  # one ray's, over instances and in a mesh; not so that all begin in the same part of the cache
_STACKS, _PLACES, _FOUND, _NUMBERS = STACK * RAYS, 3 * RAYS, 4 * RAYS, 2 * RAYS


class Rays(NamedTuple):
    """Rays in memory, rows of lanes, for `step` and bundle.py."""

    singles: Any  # float32: as in Box; limit, how far off a corner may be; as in Sieve
    doubles: Any  # float64: origin in the shear's axes, the shear, where the ray enters and may begin and end
    axes: Any  # int64: the shear's axes, and the rows in Box


class TraversalState(NamedTuple):
    """Where several rays are on their ways, and what they have met; rows of lanes in memory, and a stack for each."""

    children: Any  # int32: what is still to be seen
    reaches: Any  # float32: and from where on
    place: Any  # int64: the node or ~ leaf each is at, where its stack ends, and where that part begins which is of the mesh it is in
    found: Any  # float64: t, weights of the second and the third corner times a total, the total
    numbers: Any  # int64: instance and primitive, or -1


@helper
def room() -> Rays:
    """Where rays are kept."""
    return Rays(simd.stack_array(np.float32, _SINGLES), simd.stack_array(np.float64, _DOUBLES), simd.stack_array(np.int64, _INTS))


@helper
def keep(
    rays: Rays, part: int, mine: Lane, o: Vec, d: Vec, inverse: Vec, enters: Lane, t_min: Lane, t_max: Lane, until: Lane, reach: Lane
) -> None:
    """Store the rays of a mask as the first or the second vector of them, that enter a mesh's box at `enters`.

    What lies between `until` and t_max may be found, but need not. `reach` is the largest of the mesh's coordinates.
    """
    singles, doubles, axes = rays.singles, rays.doubles, rays.axes
    most = STEEP * ops.smallest((abs(inverse[0]), abs(inverse[1]), abs(inverse[2])))
    x, y, z = (
        crosslane.to_float32(o[0] + enters * d[0]),
        crosslane.to_float32(o[1] + enters * d[1]),
        crosslane.to_float32(o[2] + enters * d[2]),
    )
    sx, sy, sz = _slope(inverse[0], most), _slope(inverse[1], most), _slope(inverse[2], most)
    _put3(singles, 0, part, (sx, sy, sz), mine)
    _put3(singles, 3, part, (-x * sx, -y * sy, -z * sz), mine)
    _put(singles, 6, part, (until - enters) * FAR, mine)
    _put(singles, 7, part, enters * 0.0 + triangle_filter.OFF * reach, mine)
    kx, ky, kz, tx, ty, tz = flat.shear_of(d, inverse)
    _put3(singles, 8, part, (flat.component((x, y, z), kx), flat.component((x, y, z), ky), flat.component((x, y, z), kz)), mine)
    _put(singles, 11, part, tx, mine)
    _put(singles, 12, part, ty, mine)
    _put(singles, 13, part, flat.component(d, kz), mine)
    _put3(axes, 0, part, (kx, ky, kz), mine)
    _put3(axes, 3, part, (_row(sx, kx, 0), _row(sy, kx, 2), _row(sz, kx, 4)), mine)
    _put3(doubles, 0, part, (flat.component(o, kx), flat.component(o, ky), flat.component(o, kz)), mine)
    _put3(doubles, 3, part, (tx, ty, tz), mine)
    _put3(doubles, 6, part, (enters, t_min, t_max), mine)


@helper
def keep_boxes(rays: Rays, entry: Vec, inverse: Vec, limit: Lane) -> None:
    """Store as the first vector of rays what boxes ask: where they enter, 1 / direction (its largest component 1), how far they go."""
    x, y, z = crosslane.to_float32(entry[0]), crosslane.to_float32(entry[1]), crosslane.to_float32(entry[2])
    sx, sy, sz = _slope(inverse[0], STEEP), _slope(inverse[1], STEEP), _slope(inverse[2], STEEP)
    all_ = ops.bool_like(limit, True)
    _put3(rays.singles, 0, 0, (sx, sy, sz), all_)
    _put3(rays.singles, 3, 0, (-x * sx, -y * sy, -z * sz), all_)
    _put(rays.singles, 6, 0, limit * FAR, all_)
    _put3(rays.axes, 3, 0, (_row(sx, limit, 0), _row(sy, limit, 2), _row(sz, limit, 4)), all_)


@helper
def vector(row: int, part: int) -> int:
    """Which vector of a table is that of the first (0) or the second (1) vector of rays in a row."""
    return 2 * row + part


@helper
def _put(table: Any, row: int, part: int, x: Lane, mine: Lane) -> None:
    crosslane.write_lanes(table, vector(row, part), 0, x, mine)


@helper
def _put3(table: Any, row: int, part: int, v: Vec, mine: Lane) -> None:
    _put(table, row, part, v[0], mine)
    _put(table, row + 1, part, v[1], mine)
    _put(table, row + 2, part, v[2], mine)


@helper
def _slope(steep: Lane, most: Lane) -> Lane:
    return crosslane.to_float32(ops.clip(steep, -most, most))


@helper
def _row(slope: Lane, like: Lane, row: int) -> Lane:
    """Which row of a node's planes a ray meets first that goes up an axis, or down it."""
    return ops.where(slope > 0.0, ops.int_like(like, row * WIDTH), ops.int_like(like, (row + 1) * WIDTH))


class Box(NamedTuple):
    """A ray as boxes want it, and which of a node's rows are near."""

    scale: Vec  # 1 / direction
    shift: Vec  # -origin / direction
    near: tuple[int, int, int]


@helper
def box(rays: Rays, k: int) -> Box:
    return Box(
        _spread(_single(rays, 0, k), _single(rays, 1, k), _single(rays, 2, k)),
        _spread(_single(rays, 3, k), _single(rays, 4, k), _single(rays, 5, k)),
        (_axis(rays, 3, k), _axis(rays, 4, k), _axis(rays, 5, k)),
    )


@helper
def _spread(x: Any, y: Any, z: Any) -> Vec:
    return spread32(x), spread32(y), spread32(z)


@helper
def _single(rays: Rays, row: int, k: int) -> Any:
    return simd.read(rays.singles, row * RAYS + k)


@helper
def limit_of(rays: Rays, k: int) -> Any:
    """How far beyond its entry ray k goes."""
    return _single(rays, 6, k)


@helper
def set_limit(rays: Rays, k: int, limit: Any) -> None:
    simd.write(rays.singles, 6 * RAYS + k, limit)


@helper
def _double(rays: Rays, row: int, k: int) -> Any:
    return simd.read(rays.doubles, row * RAYS + k)


@helper
def enter_boxes(nodes: Any, node: int, ray: Box, limit: Any) -> tuple[Lane, Lane, int]:
    """Where a ray enters a node's boxes and leaves them or ends, and bits of those it enters before `limit`."""
    at = node * NODE
    x, y, z = ray.near
    near = simd.maximum(
        simd.maximum(_plane(nodes, at + x, ray, 0), _plane(nodes, at + y, ray, 1)),
        simd.maximum(_plane(nodes, at + z, ray, 2), spread32(0.0)),
    )
    far = simd.minimum(
        simd.minimum(_plane(nodes, at + (x ^ WIDTH), ray, 0), _plane(nodes, at + (y ^ WIDTH), ray, 1)),
        _plane(nodes, at + (z ^ WIDTH), ray, 2),
    )
    far = simd.minimum(far * _FAR, spread32(limit))
    return near, far, simd.bits(near <= far)


@helper
def _plane(nodes: Any, at: int, box: Box, axis: int) -> Lane:
    return simd.fma(simd.load(nodes, at, WIDTH), box.scale[axis], box.shift[axis])


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


_PACKS = target.AVX512 or target.AVX2
push = _push_packed if _PACKS else _push_each


# What follows has no branch on what boxes and stacks hold: to guess one wrong, as often as not, costs as much as twenty additions.


@helper
def nearest_first(links: Any, node: int, near: Lane, hits: int, children: Any, reaches: Any, top: int) -> tuple[Any, int]:
    """(the nearest child of a node among `hits` or, where there are none, what is last on a stack; where the stack ends with the others).

    That is below where it began where nothing is left.
    """
    key = simd.select(simd.mask_from_bits(hits, near), _ranks(near), _LAST)
    return _onward(links, node, near, hits, np.int64(simd.min_of(key) & (WIDTH - 1)), children, reaches, top)


@helper
def any_first(links: Any, node: int, hits: int, children: Any, top: int) -> tuple[Any, int]:
    """The same with any child, of a stack that does not tell from where on."""
    return _on_to(links, node, hits, simd.trailing_zeros(hits) & (WIDTH - 1), children, top)


@helper
def nearest_instance_first(
    links: Any, node: int, near: Lane, far: Lane, hits: int, children: Any, reaches: Any, top: int, any_hit: bool
) -> tuple[Any, int]:
    """The same in a tree over instances: the nearest child or, where any hit will do, the one rays are in for longest, likely to be met."""
    if any_hit:
        key = simd.select(simd.mask_from_bits(hits, near), _ranks(far - near), np.int32(0))
        return _on_to(links, node, hits, np.int64(simd.max_of(key) & (WIDTH - 1)), children, top)
    return nearest_first(links, node, near, hits, children, reaches, top)


@helper
def _on_to(links: Any, node: int, hits: int, first: int, children: Any, top: int) -> tuple[Any, int]:
    child, last = np.int64(simd.read(links, node * WIDTH + first)), np.int64(simd.read(children, max(top - 1, 0)))
    push(children, top, simd.load(links, node * WIDTH, WIDTH), hits & ~(1 << first))
    return child if hits != 0 else last, top + simd.population(hits) - 1


@helper
def _ranks(near: Lane) -> Lane:
    """Integers that rise as what is not below 0, nearly, and tell their lanes in their last bits."""
    return (simd.float_bits(near) & ~np.int32(WIDTH - 1)) | simd.iota(simd.to_i32(near))


@helper
def _onward(links: Any, node: int, near: Lane, hits: int, first: int, children: Any, reaches: Any, top: int) -> tuple[Any, int]:
    child, last = np.int64(simd.read(links, node * WIDTH + first)), np.int64(simd.read(children, max(top - 1, 0)))
    rest = hits & ~(1 << first)
    push(children, top, simd.load(links, node * WIDTH, WIDTH), rest)
    push(reaches, top, near, rest)
    return child if hits != 0 else last, top + simd.population(hits) - 1


@helper
def last_of(children: Any, top: int) -> tuple[Any, int]:
    """(what is last on a stack; where it ends without that)."""
    return np.int64(simd.read(children, max(top - 1, 0))), top - 1


@helper
def _sifted_packed(children: Any, reaches: Any, start: int, top: int, limit: Any) -> int:
    """Where a stack from `start` to `top` ends without what begins beyond `limit`."""
    end = start
    for i in range(start, top, WIDTH):
        reach, child = simd.load(reaches, i, WIDTH), simd.load(children, i, WIDTH)
        near = simd.bits(reach <= limit) & ((1 << min(top - i, WIDTH)) - 1)
        _push_packed(children, end, child, near)
        end = _push_packed(reaches, end, reach, near)
    return end


@helper
def _sifted_each(children: Any, reaches: Any, start: int, top: int, limit: Any) -> int:
    """The same one by one."""
    end = start
    for i in range(start, top):
        reach = simd.read(reaches, i)
        simd.write(children, end, simd.read(children, i))
        simd.write(reaches, end, reach)
        end += 1 if reach <= limit else 0
    return end


sifted = _sifted_packed if _PACKS else _sifted_each


@helper
def sieve_of(rays: Rays, k: int) -> triangle_filter.Sieve:
    x, y, z = _axis(rays, 0, k), _axis(rays, 1, k), _axis(rays, 2, k)
    off, along = _single(rays, 7, k), _single(rays, 13, k)
    way = np.float32(1.0) if along > np.float32(0.0) else np.float32(-1.0)
    return triangle_filter.Sieve(
        WIDTH * x, WIDTH * y, WIDTH * z, spread32(way), _spread(_single(rays, 8, k), _single(rays, 9, k), way * _single(rays, 10, k)),
        (spread32(way * _single(rays, 11, k)), spread32(way * _single(rays, 12, k))), spread32(off), spread32(np.float32(2.0) * off * off),
        abs(along), triangle_filter.unsure(off),
    )  # fmt: skip


@helper
def _axis(rays: Rays, row: int, k: int) -> Any:
    return simd.read(rays.axes, row * RAYS + k)


class Sheared(NamedTuple):
    """A ray as triangles want it in double precision."""

    x: int  # rows of a leaf
    y: int
    z: int
    origin: Vec
    shear: Vec


@helper
def sheared(rays: Rays, k: int) -> Sheared:
    return Sheared(
        WIDTH * _axis(rays, 0, k), WIDTH * _axis(rays, 1, k), WIDTH * _axis(rays, 2, k),
        (_double(rays, 0, k), _double(rays, 1, k), _double(rays, 2, k)), (_double(rays, 3, k), _double(rays, 4, k), _double(rays, 5, k)),
    )  # fmt: skip


@helper
def crossing(leaves: Any, leaf: int, j: int, ray: Sheared) -> flat.Crossing:
    """Triangle j of a leaf against a ray."""
    at = leaf * LEAF + j
    return flat.crossing(
        _corner(leaves, at, ray), _corner(leaves, at + 3 * WIDTH, ray), _corner(leaves, at + 6 * WIDTH, ray), ray.shear[0], ray.shear[1],
    )  # fmt: skip


@helper
def _corner(leaves: Any, at: int, ray: Sheared) -> Vec:
    return (
        np.float64(simd.read(leaves, at + ray.x)) - ray.origin[0], np.float64(simd.read(leaves, at + ray.y)) - ray.origin[1],
        np.float64(simd.read(leaves, at + ray.z)) - ray.origin[2],
    )  # fmt: skip


# --- several rays in turns ------------------------------------------------------------------------------------------------


@helper
def allocate_state() -> TraversalState:
    """Where rays' ways are kept."""
    return TraversalState(
        simd.stack_array(np.int32, _STACKS), simd.stack_array(np.float32, _STACKS), simd.stack_array(np.int64, _PLACES),
        simd.stack_array(np.float64, _FOUND), simd.stack_array(np.int64, _NUMBERS),
    )  # fmt: skip


@helper
def set_out(made: TraversalState, part: int, t: Lane, instance: Lane, primitive: Lane, u: Lane, v: Lane) -> None:
    """Let a vector of rays have met something, or nothing."""
    crosslane.store(made.found, vector(0, part), t)
    crosslane.store(made.found, vector(1, part), u)
    crosslane.store(made.found, vector(2, part), v)
    crosslane.store(made.found, vector(3, part), ops.full_like(t, 1.0))
    crosslane.store(made.numbers, vector(0, part), instance)
    crosslane.store(made.numbers, vector(1, part), primitive)


@helper
def met(steps: TraversalState, part: int) -> Hit:
    """What a vector of rays has met."""
    total = crosslane.load(steps.found, vector(3, part))
    return Hit(
        crosslane.load(steps.found, vector(0, part)), crosslane.load(steps.numbers, vector(0, part)),
        crosslane.load(steps.numbers, vector(1, part)),
        crosslane.load(steps.found, vector(1, part)) / total, crosslane.load(steps.found, vector(2, part)) / total,
    )  # fmt: skip


@helper
def go(steps: TraversalState, k: int, node: int, top: int) -> None:
    """Let ray k be at a node, its stack end at `top`."""
    simd.write(steps.place, k, node)
    simd.write(steps.place, RAYS + k, top)


@helper
def begin(tree: Any, nodes: Any, links: Any, rays: Rays, steps: TraversalState, k: int, any_hit: bool) -> bool:
    """Let ray k begin at node 0 of some that are not a tree's but lead to its; whether it enters anything there."""
    start = k * STACK
    node, top = visit_node(nodes, links, 0, box(rays, k), limit_of(rays, k), steps, start, any_hit)
    prefetch_node(tree, node)
    go(steps, k, node, top)
    simd.write(steps.place, 2 * RAYS + k, start)
    return top >= start


@helper
def traverse_step(tree: Any, rays: Rays, steps: TraversalState, k: int, instance: int, any_hit: bool) -> bool:
    """One node or leaf of ray k's way through a mesh, or two nodes where any meeting will do; whether there is more of it."""
    node, top, start = simd.read(steps.place, k), simd.read(steps.place, RAYS + k), simd.read(steps.place, 2 * RAYS + k)
    if node >= 0:
        ray, limit = box(rays, k), limit_of(rays, k)
        node, top = visit_node(tree.nodes, tree.links, node, ray, limit, steps, top, any_hit)
        if any_hit and node >= 0 and top >= start:
            node, top = visit_node(tree.nodes, tree.links, node, ray, limit, steps, top, any_hit)
    else:
        node, top = _pass_leaf(tree, ~node, rays, steps, k, instance, start, top, any_hit)
    if top < start:
        return False
    prefetch_node(tree, node)
    go(steps, k, node, top)
    return True


@helper
def visit_node(nodes: Any, links: Any, node: int, ray: Box, limit: Any, steps: TraversalState, top: int, any_hit: bool) -> tuple[Any, int]:
    """(where a ray goes on after a node; where its stack ends then)."""
    near, _, hits = enter_boxes(nodes, node, ray, limit)
    if any_hit:
        return any_first(links, node, hits, steps.children, top)
    return nearest_first(links, node, near, hits, steps.children, steps.reaches, top)


@helper
def pass_things(nodes: Any, links: Any, node: int, ray: Box, limit: Any, steps: TraversalState, top: int, any_hit: bool) -> tuple[Any, int]:
    """The same in the tree over instances."""
    near, far, hits = enter_boxes(nodes, node, ray, limit)
    return nearest_instance_first(links, node, near, far, hits, steps.children, steps.reaches, top, any_hit)


@helper
def _pass_leaf(
    tree: Any, leaf: int, rays: Rays, steps: TraversalState, k: int, instance: int, start: int, top: int, any_hit: bool
) -> tuple[Any, int]:
    """The same after a leaf, its stack in the mesh beginning at `start`."""
    if any_hit:
        return _pass_leaf_any(tree, leaf, rays, steps, k, instance, top)
    limit = limit_of(rays, k)
    hits, before = triangle_filter.touched(tree.leaves, leaf, sieve_of(rays, k), limit), limit
    limit = _meet_all(tree, leaf, hits, rays, steps, k, instance, any_hit, limit)
    if limit < before:
        set_limit(rays, k, limit)
        top = sifted(steps.children, steps.reaches, start, top, limit)
    return last_of(steps.children, top)


@helper
def _pass_leaf_any(tree: Any, leaf: int, rays: Rays, steps: TraversalState, k: int, instance: int, top: int) -> tuple[Any, int]:
    """The same where any meeting will do, with no branch on what is usual."""
    limit, ray = limit_of(rays, k), sieve_of(rays, k)
    seen = triangle_filter.passed(tree.leaves, leaf, ray)
    may, sure = triangle_filter.may_meet(seen, ray, limit), triangle_filter.surely_meets(seen, ray, limit)
    ends = sure != 0
    before = simd.read(steps.found, k), simd.read(steps.numbers, k), simd.read(steps.numbers, RAYS + k)
    number = np.int64(triangle_of(tree.leaves, leaf, simd.trailing_zeros(sure) & (WIDTH - 1)))
    simd.write(steps.found, k, _double(rays, 6, k) if ends else before[0])
    simd.write(steps.numbers, k, instance if ends else before[1])
    simd.write(steps.numbers, RAYS + k, number if ends else before[2])
    if may != 0 and sure == 0:
        ends = _meet_all(tree, leaf, may, rays, steps, k, instance, True, limit) < limit
    node, top = last_of(steps.children, top)
    return node, -1 if ends else top


@helper
def _meet_all(tree: Any, leaf: int, hits: int, rays: Rays, steps: TraversalState, k: int, instance: int, any_hit: bool, limit: Any) -> Any:
    """Take in those triangles of a leaf, whose bits are set in `hits`, that ray k meets first; the limit then."""
    while hits != 0:
        j = simd.trailing_zeros(hits)
        hits &= hits - 1
        limit = _meet(tree, leaf, j, rays, steps, k, instance, any_hit, limit)
    return limit


@helper
def _meet(tree: Any, leaf: int, j: int, rays: Rays, steps: TraversalState, k: int, instance: int, any_hit: bool, limit: Any) -> Any:
    """Take in triangle j of a leaf, if ray k meets it first; the limit then."""
    ray = sheared(rays, k)
    met = crossing(tree.leaves, leaf, j, ray)
    if not flat.ahead(met, ray.shear[2]):
        return limit
    t = flat.reached(met, ray.shear[2], _double(rays, 7, k), _double(rays, 8, k))
    number = np.int64(triangle_of(tree.leaves, leaf, j))
    if not is_closer(steps, k, t, instance, number):
        return limit
    simd.write(steps.found, k, t)
    simd.write(steps.found, RAYS + k, met.v)
    simd.write(steps.found, 2 * RAYS + k, met.w)
    simd.write(steps.found, 3 * RAYS + k, met.total)
    simd.write(steps.numbers, k, instance)
    simd.write(steps.numbers, RAYS + k, number)
    return np.float32(-np.inf) if any_hit else np.float32((t - _double(rays, 6, k)) * FAR)


@helper
def is_closer(steps: TraversalState, k: int, t: Any, instance: int, primitive: int) -> bool:
    """Whether ray k meets this before what it has met; of two at one place, that with the lower number."""
    before = simd.read(steps.found, k)
    if t != before:
        return t < before
    other = simd.read(steps.numbers, k)
    return t < np.inf and (instance < other or (instance == other and primitive < simd.read(steps.numbers, RAYS + k)))


@helper
def prefetch_node(tree: Any, node: int) -> None:
    """Ask for a leaf that will be read soon; of a node, which others have read before, nothing."""
    at = max(~node, 0) * LEAF
    for line in range((LEAF + 15) // 16):
        simd.prefetch(tree.leaves, at + line * 16)
