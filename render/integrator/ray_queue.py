"""Queue of the rays of a wave that enter the BVH's bounding box, their conversion to the lanes of BVH kernels, and visibility of points."""

from __future__ import annotations

from typing import Any

from .. import simd
from ..accel import intersect, primitive_hits
from ..jit.kernel import helper, separate_helper
from ..lanes import crosslane, ops
from ..lanes.soa import ROW, gather3, load3
from ..light import lights
from ..simd.registration import overload, types
from ..types import Lane, Ray, Vec

_WIDTH64 = simd.WIDTH64


@helper
def enters(scene: Any, origin: Vec, direction: Vec, t: Lane) -> Lane:
    """Whether rays enter the BVH's bounding box before t."""
    begin, end = ops.full_like(t, 0.0), t
    for k in range(3):
        inverse = 1.0 / direction[k]
        t0, t1 = (scene.low[k] - origin[k]) * inverse, (scene.high[k] - origin[k]) * inverse
        begin = ops.maximum(ops.minimum(t0, t1), begin)
        end = ops.minimum(ops.maximum(t0, t1) * 1.000001, end)
    return begin <= end


@helper
def queue_up(memory: Any, queued: int, i: int, mask: Lane) -> int:
    """Append the indices of a mask's lanes, from i on, to the queue; return their number."""
    lanes = simd.bits(mask)
    count = 0
    while lanes != 0:
        k = simd.trailing_zeros(lanes)
        lanes &= lanes - 1
        simd.write(memory.queue, queued + count, i + k)
        count += 1
    return count


@helper
def pad(memory: Any, queued: int) -> None:
    """Pad the queue with its last entry to whole vectors."""
    for k in range(_WIDTH64 if queued > 0 else 0):
        simd.write(memory.queue, queued + k, simd.read(memory.queue, queued - 1))


def for_search(x: Any) -> Any:
    raise NotImplementedError


@overload(for_search)
def _for_search_kernel(x):
    """Convert lanes for `intersect.find`: to scalars on machines with one lane."""
    if _WIDTH64 > 1:
        return lambda x: x
    if isinstance(x, types.NoneType):
        return lambda x: x
    return lambda x: simd.lane(x, 0)


def from_search(x: Any, like: Any) -> Any:
    raise NotImplementedError


@overload(from_search)
def _from_search_kernel(x, like):
    """Convert results of `intersect.find` back to lanes."""
    if _WIDTH64 > 1:
        return lambda x, like: x
    return lambda x, like: like * 0 + x


@helper
def as_searched(origin: Vec, direction: Vec, near: Lane, far: Lane, time: Any) -> Ray:
    o = (for_search(origin[0]), for_search(origin[1]), for_search(origin[2]))
    d = (for_search(direction[0]), for_search(direction[1]), for_search(direction[2]))
    return Ray(o, d, for_search(near), for_search(far), for_search(time))


# --- visibility of points ------------------------------------------------------------------------------------------------


@helper
def towards(origin: Vec, place: Vec) -> tuple[Vec, Lane]:
    """(unit direction to a point, length of a shadow ray that ends before it)."""
    way = (place[0] - origin[0], place[1] - origin[1], place[2] - origin[2])
    squared = ops.maximum(ops.dot(way, way), lights.TINY)
    inverse = ops.rsqrt(squared)
    return ops.scale(way, inverse), squared * inverse * (1.0 - 64.0 * ops.roundoff(squared))


@separate_helper
def attenuate_between(accel, scene, memory, rows, ends, n):
    """Multiply n shares by the transmittance between two points.

    `rows` hold the points and shares, and `ends` are the rows of the first point, of the second and of the share.
    """
    begin, end, share = ends
    like = simd.load(rows, 0)
    queued = 0
    for i in range(0, n, crosslane.width(like)):
        shares = simd.load(rows, share * ROW + i)
        tested = simd.first_lanes(n - i, like) & (shares > 0.0)
        if ops.any_lane(tested):
            origin = load3(rows, 0, begin, i)
            direction, reach = towards(origin, load3(rows, 0, end, i))
            blocked = primitive_hits.blocked(scene.primitives.blocking, origin, direction, reach)
            simd.store(rows, share * ROW + i, ops.where(blocked, 0.0, shares))
            if scene.trees:
                queued += queue_up(memory, queued, i, tested & ops.not_(blocked) & enters(scene, origin, direction, reach))
    pad(memory, queued)
    _attenuate_queued(accel, memory, rows, ends, queued)


def _attenuate_queued(accel: Any, memory: Any, rows: Any, ends: Any, queued: int) -> None:
    """`attenuate_between` for the queued pairs, in the BVH."""
    raise NotImplementedError


@overload(_attenuate_queued)
def _attenuate_queued_in_kernels(accel, memory, rows, ends, queued):
    if accel.field("search") is None:
        return lambda accel, memory, rows, ends, queued: None
    unused: Any = None  # tables, which kernels have beside their trees

    def ask(accel, memory, rows, ends, queued):
        begin, end, share = ends
        for q in range(0, queued, _WIDTH64):
            k = simd.load(memory.queue, q)
            origin = gather3(rows, 0, begin, k)
            direction, reach = towards(origin, gather3(rows, 0, end, k))
            ray = as_searched(origin, direction, 0.0 * reach, reach, None)
            passes = intersect.transmittance(accel, unused, ray, ops.bool_like(ray.t_min, True))
            simd.scatter(rows, k + share * ROW, rows[k + share * ROW] * from_search(passes, reach), reach >= 0.0)

    return ask
