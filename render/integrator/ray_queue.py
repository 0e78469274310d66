"""Queue of the rays of a wave that enter the BVH's bounding box, and their conversion to the lanes of BVH kernels."""

from __future__ import annotations

from typing import Any

from .. import simd
from ..jit.kernel import helper
from ..lanes import ops
from ..simd.registration import overload, types
from ..types import Lane, Ray, Vec

_WIDTH64 = simd.WIDTH64


@helper
def enters(scene: Any, origin: Vec, direction: Vec, t: Lane) -> Lane:
    """Whether rays enter the BVH's bounding box before t."""
    begin, end = ops.full_like(t, 0.0), t
    for k in range(3):
        inverse = 1.0 / direction[k]
        one, other = (scene.low[k] - origin[k]) * inverse, (scene.high[k] - origin[k]) * inverse
        begin = ops.maximum(ops.minimum(one, other), begin)
        end = ops.minimum(ops.maximum(one, other) * 1.000001, end)
    return begin <= end


@helper
def queue_up(memory: Any, queued: int, i: int, mask: Lane) -> int:
    """Append the indices of a mask's lanes, from i on, to the queue; return their number."""
    left = simd.bits(mask)
    count = 0
    while left != 0:
        k = simd.trailing_zeros(left)
        left &= left - 1
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
