"""Test of one ray against the boxes of a node, and a stack of the children it enters.

The functions do not branch on boxes or stack entries: half of such branches are mispredicted, and each costs as much as twenty additions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...simd import target
from ...types import Lane
from ..bvh_build.wide_bvh import NODE, WIDTH, spread32
from .ray_state import FAR, NodeRay

_FAR = np.float32(FAR)
_NO_KEY = np.int32(2**31 - 1)


@helper
def intersect_boxes(nodes: Any, node: int, ray: NodeRay, limit: Any) -> tuple[Lane, Lane, int]:
    """(entry distances of a node's boxes, exit distances or the ray's end, bits of the boxes entered before `limit`)."""
    start = node * NODE
    x, y, z = ray.near
    near = simd.maximum(
        simd.maximum(_plane(nodes, start + x, ray, 0), _plane(nodes, start + y, ray, 1)),
        simd.maximum(_plane(nodes, start + z, ray, 2), spread32(0.0)),
    )
    far = simd.minimum(
        simd.minimum(_plane(nodes, start + (x ^ WIDTH), ray, 0), _plane(nodes, start + (y ^ WIDTH), ray, 1)),
        _plane(nodes, start + (z ^ WIDTH), ray, 2),
    )
    far = simd.minimum(far * _FAR, spread32(limit))
    return near, far, simd.bits(near <= far)


@helper
def _plane(nodes: Any, element: int, ray: NodeRay, axis: int) -> Lane:
    return simd.fma(simd.load(nodes, element, WIDTH), ray.scale[axis], ray.shift[axis])


@helper
def _push_packed(stack: Any, top: int, values: Lane, which: int) -> int:
    """Push the lanes whose bits are set; return the new top. Entries above the top are overwritten."""
    simd.store(stack, top, simd.compress(values, simd.mask_from_bits(which, values)))
    return top + simd.population(which)


@helper
def _push_scalar(stack: Any, top: int, values: Lane, which: int) -> int:
    """`_push_packed` without a compress instruction."""
    buffer = top + WIDTH
    simd.store(stack, buffer, values)
    while which != 0:
        simd.write(stack, top, simd.read(stack, buffer + simd.trailing_zeros(which)))
        which &= which - 1
        top += 1
    return top


@helper
def _cull_packed(stack: Any, distances: Any, bottom: int, top: int, limit: Any) -> int:
    """Remove the entries between `bottom` and `top` that start beyond `limit`; return the new top."""
    end = bottom
    for i in range(bottom, top, WIDTH):
        distance, child = simd.load(distances, i, WIDTH), simd.load(stack, i, WIDTH)
        near = simd.bits(distance <= limit) & ((1 << min(top - i, WIDTH)) - 1)
        _push_packed(stack, end, child, near)
        end = _push_packed(distances, end, distance, near)
    return end


@helper
def _cull_scalar(stack: Any, distances: Any, bottom: int, top: int, limit: Any) -> int:
    """`_cull_packed` without a compress instruction."""
    end = bottom
    for i in range(bottom, top):
        distance = simd.read(distances, i)
        simd.write(stack, end, simd.read(stack, i))
        simd.write(distances, end, distance)
        end += 1 if distance <= limit else 0
    return end


_COMPRESSES = target.AVX512 or target.AVX2
push, cull = (_push_packed, _cull_packed) if _COMPRESSES else (_push_scalar, _cull_scalar)


@helper
def pop(stack: Any, top: int) -> tuple[Any, int]:
    """(last entry, new top); the top falls below the bottom where the stack is empty."""
    return np.int64(simd.read(stack, max(top - 1, 0))), top - 1


@helper
def descend_nearest(links: Any, node: int, near: Lane, hits: int, stack: Any, distances: Any, top: int) -> tuple[Any, int]:
    """(next node, new top): the nearest child among `hits`, others pushed; without hits, the last entry of the stack, popped."""
    key = simd.select(simd.mask_from_bits(hits, near), _sort_keys(near), _NO_KEY)
    first = np.int64(simd.min_of(key) & (WIDTH - 1))
    child, last = np.int64(simd.read(links, node * WIDTH + first)), np.int64(simd.read(stack, max(top - 1, 0)))
    others = hits & ~(1 << first)
    push(stack, top, simd.load(links, node * WIDTH, WIDTH), others)
    push(distances, top, near, others)
    return child if hits != 0 else last, top + simd.population(hits) - 1


@helper
def descend_any(links: Any, node: int, hits: int, stack: Any, top: int) -> tuple[Any, int]:
    """`descend_nearest` for any hit: to the first child; entry distances are not stored."""
    return _descend_to(links, node, hits, simd.trailing_zeros(hits) & (WIDTH - 1), stack, top)


@helper
def descend_instances(
    links: Any, node: int, near: Lane, far: Lane, hits: int, stack: Any, distances: Any, top: int, any_hit: bool
) -> tuple[Any, int]:
    """`descend_nearest` over instances; for any hit, to the box that the ray crosses for longest, where a hit is most likely."""
    if any_hit:
        key = simd.select(simd.mask_from_bits(hits, near), _sort_keys(far - near), np.int32(0))
        return _descend_to(links, node, hits, np.int64(simd.max_of(key) & (WIDTH - 1)), stack, top)
    return descend_nearest(links, node, near, hits, stack, distances, top)


@helper
def _descend_to(links: Any, node: int, hits: int, first: int, stack: Any, top: int) -> tuple[Any, int]:
    child, last = np.int64(simd.read(links, node * WIDTH + first)), np.int64(simd.read(stack, max(top - 1, 0)))
    push(stack, top, simd.load(links, node * WIDTH, WIDTH), hits & ~(1 << first))
    return child if hits != 0 else last, top + simd.population(hits) - 1


@helper
def _sort_keys(near: Lane) -> Lane:
    """Integers in the order of distances, which must not be negative, with the lane in their last bits."""
    return (simd.float_bits(near) & ~np.int32(WIDTH - 1)) | simd.iota(simd.to_i32(near))
