"""What waves ask of trees: rays that enter the box around what is in them, gathered by their numbers, in lanes as trees take them."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import overload

from .. import simd
from ..jit.kernel import HELPER, helper
from ..lanes import ops
from ..types import Lane, Ray, Vec

_WIDTH64 = simd.WIDTH64


@helper
def enters(scene: Any, origin: Vec, direction: Vec, t: Lane) -> Lane:
    """Whether rays enter the box around what is in trees, nearer than t."""
    begin, end = ops.full_like(t, 0.0), t
    for k in range(3):
        inverse = 1.0 / direction[k]
        one, other = (scene.low[k] - origin[k]) * inverse, (scene.high[k] - origin[k]) * inverse
        begin = ops.maximum(ops.minimum(one, other), begin)
        end = ops.minimum(ops.maximum(one, other) * 1.000001, end)
    return begin <= end


@helper
def queue_up(room: Any, queued: int, i: int, mask: Lane) -> int:
    """Write down the numbers of a mask's lanes, which count from i; how many they are."""
    left = simd.bits(mask)
    count = 0
    while left != 0:
        k = simd.trailing_zeros(left)
        left &= left - 1
        simd.write(room.queue, queued + count, i + k)
        count += 1
    return count


@helper
def pad(room: Any, queued: int) -> None:
    """Repeat the last one, so that whole vectors can be read."""
    for k in range(_WIDTH64 if queued > 0 else 0):
        simd.write(room.queue, queued + k, simd.read(room.queue, queued - 1))


def for_search(x: Any) -> Any:
    raise NotImplementedError


@overload(for_search, jit_options=HELPER)
def _for_search_kernel(x):
    """Lanes as traverse.find takes them: numbers where the machine has one lane."""
    if _WIDTH64 > 1:
        return lambda x: x
    if isinstance(x, types.NoneType):
        return lambda x: x
    return lambda x: simd.lane(x, 0)


def from_search(x: Any, like: Any) -> Any:
    raise NotImplementedError


@overload(from_search, jit_options=HELPER)
def _from_search_kernel(x, like):
    """And back."""
    if _WIDTH64 > 1:
        return lambda x, like: x
    return lambda x, like: like * 0 + x


@helper
def as_searched(origin: Vec, direction: Vec, near: Lane, far: Lane, time: Any) -> Ray:
    o = (for_search(origin[0]), for_search(origin[1]), for_search(origin[2]))
    d = (for_search(direction[0]), for_search(direction[1]), for_search(direction[2]))
    return Ray(o, d, for_search(near), for_search(far), for_search(time))
