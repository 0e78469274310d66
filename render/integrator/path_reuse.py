"""Reuse: the pixels of a block share what their paths found beyond the first surface.

Each first surface of a block of 4 × 4 pixels is joined to the second surfaces of all sixteen paths of a sample number: a ray tells whether
it sees them, and their light counts by the balance heuristic over the sixteen ways of having found it. So sixteen times as many paths tell
of what is not direct light, for less than twice the time. Bekaert, Sbert, Halton 2002, "Accelerating Path Tracing by Re-Using Paths".
Pixels of a block have sixteen neighbouring stretches of one sequence (sampler.place): what they share is as well spread as one pixel's
own samples. It takes surfaces that send the same light in all directions.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.extending import overload

from .. import simd
from ..accel import intersect, primitive_hits
from ..jit.kernel import HELPER, helper, noinline_helper, specialize_if_present
from ..lanes import crosslane, ops
from ..lanes.soa import ROW, add, gather3, load3, store3
from ..light import lights
from ..types import Lane, Surface, Vec
from .path import OTHER_RAY, Path
from .ray_queue import as_searched, enters, from_search, pad, queue_up

SIDE = 4  # pixels of a block
BLOCK = SIDE * SIDE
FIRST, NORMAL, ALBEDO, SECOND, FACING, OWN = 0, 3, 6, 9, 12, 15  # rows of Shared.rows
COUNT = 18


class Alone(NamedTuple):
    """Each path for itself."""


class Shared(NamedTuple):
    """What paths leave for the others of their block, by their place in the wave."""

    rows: Any  # (COUNT · ROW,) float: first surface, its normal (0: none), albedo; second surface, its normal; light that is not shared
    pairs: Any  # (BLOCK · BLOCK,) float: how well each first surface sees each second one

    @classmethod
    def of(cls, kind: type) -> Shared:
        """Room for waves of float32 or float64."""
        found, pairs = simd.aligned_empty(COUNT * ROW, kind), simd.aligned_empty(BLOCK * BLOCK, kind)
        found[:], pairs[:] = 0, 0
        return cls(found, pairs)


@helper
def _cleared(shared: Any, plain: Any, n: int) -> Any:
    like = simd.load(shared.rows, 0)
    zero = (0.0 * like, 0.0 * like, 0.0 * like)
    for i in range(0, n, crosslane.width(like)):
        store3(shared.rows, 0, NORMAL, i, zero)
        store3(shared.rows, 0, FACING, i, zero)
    return plain


@helper
def _parted(shared: Any, onward: Path, i: int, slot: Lane, point: Surface, here: Lane, going: Lane, depth: int) -> Path:
    zero = 0.0 * onward.density
    none = (zero, zero, zero)
    if depth == 0:  # slots are those of the lanes
        store3(shared.rows, 0, FIRST, i, onward.origin)
        store3(shared.rows, 0, NORMAL, i, ops.where3(going, point.normal, none))
        store3(shared.rows, 0, ALBEDO, i, ops.where3(going, onward.weight, none))
        one = (zero + 1.0, zero + 1.0, zero + 1.0)
        return Path(onward.origin, onward.direction, one, onward.density, onward.straight, onward.inside, onward.phase, onward.facing)
    if depth == 1:
        place = ops.along(point.position, point.geometric, point.offset)
        for k in range(3):
            simd.scatter(shared.rows, slot + (SECOND + k) * ROW, place[k], here)
            simd.scatter(shared.rows, slot + (FACING + k) * ROW, point.normal[k], here)
    return onward


cleared = specialize_if_present(_cleared)  # nothing is known of the first n paths of a wave
parted = specialize_if_present(_parted)  # the ray that goes on, of weight 1 where it leaves the first surface; surfaces are noted


def found(shared: Any, light: Any, slot: Lane, sent: Vec, mask: Lane, depth: int) -> None:
    """Add what paths found by themselves to their light."""
    raise NotImplementedError


@overload(found, jit_options=HELPER)
def _found_in_kernels(shared, light, slot, sent, mask, depth):
    if not shared.layout:
        return lambda shared, light, slot, sent, mask, depth: add(light, slot, sent, mask)

    def own(shared, light, slot, sent, mask, depth):
        if depth == 1:  # of shining things and skies, which others look for themselves
            albedo = gather3(shared.rows, 0, ALBEDO, ops.where(mask, slot, 0))
            add(shared.rows, slot + OWN * ROW, ops.mul(albedo, sent), mask)
        else:
            add(light, slot, sent, mask)

    return own


@helper
def _parted_light(shared: Any, plain: Any, light: Any, n: int) -> Any:
    like = simd.load(light, 0)
    zero = (0.0 * like, 0.0 * like, 0.0 * like)
    for i in range(0, n, crosslane.width(like)):
        store3(shared.rows, 0, OWN, i, load3(light, 0, 0, i))
        store3(light, 0, 0, i, zero)
    return plain


parted_light = specialize_if_present(_parted_light)  # light so far is the paths' own: what comes now is that of second surfaces


@helper
def _joined(shared: Any, plain: Any, accel: Any, scene: Any, room: Any, shadows: bool, n: int) -> Any:
    _join(accel, scene, room, shadows, n)
    return plain


joined = specialize_if_present(_joined)  # the light of all n paths of a wave


@noinline_helper
def _join(accel: Any, scene: Any, room: Any, shadows: bool, n: int) -> None:
    """Give the light of second surfaces to all first ones of their blocks that see them."""
    rows, pairs, light = room.shared.rows, room.shared.pairs, room.light
    like = simd.load(rows, 0)
    step = crosslane.width(like)
    for block in range(0, n, BLOCK):
        for j in range(BLOCK):
            _weigh(accel, scene, room, shadows, block, j)
        for i in range(0, BLOCK, step):
            red, green, blue = 0.0 * like, 0.0 * like, 0.0 * like
            for j in range(BLOCK):
                share, at = simd.load(pairs, j * BLOCK + i), block + j
                red = ops.fma(share, simd.read(light, at), red)
                green = ops.fma(share, simd.read(light, at + ROW), green)
                blue = ops.fma(share, simd.read(light, at + 2 * ROW), blue)
            given = ops.mul(load3(rows, 0, ALBEDO, block + i), (red, green, blue))
            store3(rows, 0, OWN, block + i, ops.add(load3(rows, 0, OWN, block + i), given))
    for i in range(0, n, step):
        store3(light, 0, 0, i, load3(rows, 0, OWN, i))


@helper
def _weigh(accel: Any, scene: Any, room: Any, shadows: bool, block: int, j: int) -> None:
    """Write how much of the j-th second surface's light each first surface of a block is given, before its albedo.

    That is its cosines over the squared distance, if it sees it, as a share of the sum over the block.
    """
    rows, pairs, light = room.shared.rows, room.shared.pairs, room.light
    like = simd.load(rows, 0)
    step, at, total, queued = crosslane.width(like), block + j, 0.0, 0
    place, facing = _one(rows, SECOND, at), _one(rows, FACING, at)
    known = facing[0] * facing[0] + facing[1] * facing[1] + facing[2] * facing[2] > 0.5
    lit = known and simd.read(light, at) + simd.read(light, at + ROW) + simd.read(light, at + 2 * ROW) > 0.0
    for i in range(0, BLOCK, step):
        likely = 0.0 * like
        if lit:
            likely = _likely(load3(rows, 0, FIRST, block + i), load3(rows, 0, NORMAL, block + i), place, facing)
            own = simd.iota(ops.int_like(like, 0)) == j - i
            asked = (likely > 0.0) & ops.not_(own)
            if shadows and ops.any_lane(asked):
                origin = load3(rows, 0, FIRST, block + i)
                direction, reach = _towards(origin, place)
                blocked = asked & primitive_hits.blocked(scene.tried.between, origin, direction, reach)
                likely = ops.where(blocked, 0.0, likely)
                if scene.trees:
                    inside = asked & ops.not_(blocked) & enters(scene, origin, direction, reach)
                    queued += queue_up(room, queued, block + i, inside)
            likely = ops.where(own, ops.maximum(likely, lights.TINY), likely)
        simd.store(pairs, j * BLOCK + i, likely)
    if queued > 0:
        pad(room, queued)
        _ask_trees(accel, room, place, queued, j * BLOCK - block)
    for i in range(0, BLOCK, step):
        total += simd.sum_of(simd.load(pairs, j * BLOCK + i))
    for i in range(0, BLOCK, step):
        simd.store(pairs, j * BLOCK + i, simd.load(pairs, j * BLOCK + i) * (1.0 / max(total, lights.TINY)))


@helper
def _likely(origin: Vec, normal: Vec, place: Vec, facing: Vec) -> Lane:
    """How densely the rays that leave a matt surface meet another one, times π, if nothing stands between."""
    way = (place[0] - origin[0], place[1] - origin[1], place[2] - origin[2])
    inverse = 1.0 / ops.maximum(ops.dot(way, way), lights.TINY)
    leaving = ops.maximum(ops.dot(normal, way), 0.0)
    arriving = ops.maximum(-(way[0] * facing[0] + way[1] * facing[1] + way[2] * facing[2]), 0.0)
    return leaving * arriving * inverse * inverse


@helper
def _towards(origin: Vec, place: Vec) -> tuple[Vec, Lane]:
    """(unit direction to a place, how far a ray may go without meeting what is there)."""
    way = (place[0] - origin[0], place[1] - origin[1], place[2] - origin[2])
    squared = ops.maximum(ops.dot(way, way), lights.TINY)
    inverse = ops.rsqrt(squared)
    return ops.scale(way, inverse), squared * inverse * (1.0 - 64.0 * ops.roundoff(squared))


def _ask_trees(accel: Any, room: Any, place: Vec, queued: int, to: int) -> None:
    """Take what trees hide of a place from the first surfaces whose numbers are queued out of their pairs, `to` from those."""
    raise NotImplementedError


@overload(_ask_trees, jit_options=HELPER)
def _ask_trees_in_kernels(accel, room, place, queued, to):
    if accel.field("search") is None:
        return lambda accel, room, place, queued, to: None

    def ask(accel, room, place, queued, to):
        rows, wide = room.shared.rows, simd.load(room.queue, 0)
        for q in range(0, queued, simd.WIDTH64):
            k = simd.load(room.queue, q)
            origin = gather3(rows, 0, FIRST, k)
            direction, reach = _towards(origin, place)
            ray = as_searched(origin, direction, 0.0 * reach, reach, None)
            hit = intersect.find(accel, ray, ops.bool_like(ray.t_min, True), OTHER_RAY, True)
            simd.scatter(room.shared.pairs, k + to, 0.0 * reach, from_search(hit.instance, wide) >= 0)

    return ask


@helper
def _one(rows: Any, row: int, at: int) -> Vec:
    first = row * ROW + at
    return simd.read(rows, first), simd.read(rows, first + ROW), simd.read(rows, first + 2 * ROW)
