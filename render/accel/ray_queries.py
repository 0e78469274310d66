"""Closest-hit, occlusion and transmittance queries for arrays of rays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...compiler import ir
from .. import simd
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..types import Lane, Ray, Vec
from . import intersect, scene_bvh
from .traverse import motion_alpha

_LANES = crosslane.WIDTH
SHORTEST, LONGEST = 1e-20, 1e20  # lengths of directions whose inverse float32 holds in all frames
CAMERA, SHADOW = int(ir.Visibility.CAMERA), int(ir.Visibility.SHADOW)


class Hits(NamedTuple):
    """First hits of n rays, (n,) each; see types.Hit."""

    t: NDArray[np.float64]
    instance: NDArray[np.int64]
    primitive: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]


def build(
    tables: ir.Tables, brute: bool = False, threads: int = 0, keep: bool = True, closed: bool = True, general: bool = False
) -> Handle:  # fmt: skip
    """Build and link the BVH of a scene, see scene_bvh.build. Keep the handle as long as rays are traced."""
    accel = Handle(scene_bvh.build(tables, brute, threads, keep, closed=closed, general=general))
    motion_alpha.link(accel, general)
    return accel


def load_closest(accel: Handle) -> None:
    """Compile or load the kernel of `closest`."""
    closest(accel, np.zeros((0, 3)), np.zeros((0, 3)))


def closest(
    accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf, visible: int = CAMERA
) -> Hits:
    """First hits of rays (n, 3) between t_min and t_max (n,) with instances that have a bit of `visible`.

    Lengths of directions may range from SHORTEST to LONGEST; rays outside of that hit nothing, nor do rays that are not finite.
    """
    columns = _columns(origin, direction, t_min, t_max)
    n = len(columns[0])
    hits = Hits(np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n), np.empty(n))
    trace_closest(accel, *columns, visible, hits)
    return hits


def find_unproved(accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike, t_max: ArrayLike) -> NDArray[np.bool_]:
    """(n,) whether some interval before a ray's hit could not be proved free of roots of a formula.

    The BVH counts such intervals for all rays; batches with a count are halved. No other thread may trace through this BVH meanwhile.
    """
    o, d, begin, end = _columns(origin, direction, t_min, t_max)
    n, count = len(o), accel.tables.forms.unproved
    result, batches = np.zeros(n, np.bool_), [(0, n)]
    while batches:
        first, last = batches.pop()
        before = int(count[0])
        part = slice(first, last)
        closest(accel, o[part], d[part], begin[part], end[part])
        if count[0] == before:
            continue
        if last - first == 1:
            result[first] = True
        else:
            middle = (first + last) // 2
            batches += [(first, middle), (middle, last)]
    return result


def occluded(
    accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf, visible: int = SHADOW
) -> NDArray[np.bool_]:
    """(n,) whether a ray hits any instance with a bit of `visible`; arguments as of `closest`."""
    columns = _columns(origin, direction, t_min, t_max)
    blocked = np.empty(len(columns[0]), np.bool_)
    trace_occluded(accel, *columns, visible, blocked)
    return blocked


def transmittance(
    accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf
) -> NDArray[np.float64]:
    """(n,) the share of light, 0 to 1, that passes all shadow casters; arguments as of `closest`."""
    columns = _columns(origin, direction, t_min, t_max)
    share = np.empty(len(columns[0]))
    trace_transmittance(accel, *columns, share)
    return share


def _columns(origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike, t_max: ArrayLike) -> tuple[NDArray[Any], ...]:
    o, d = np.ascontiguousarray(origin, np.float64), np.ascontiguousarray(direction, np.float64)
    n = (len(o),)
    return o, d, np.array(np.broadcast_to(t_min, n), np.float64), np.array(np.broadcast_to(t_max, n), np.float64)


# --- kernels ---


@helper
def load_vectors(rows: Any, start: int, n: int) -> Vec:
    """Rows `start` on of an (n, 3) array as lanes; lanes beyond the end repeat the last row."""
    if start + crosslane.WIDTH <= n:
        return crosslane.load_rows3(rows, start)
    x, y, z = simd.stack_array(np.float64, _LANES), simd.stack_array(np.float64, _LANES), simd.stack_array(np.float64, _LANES)
    for j in range(crosslane.WIDTH):
        k = min(start + j, n - 1)
        simd.write(x, j, rows[k, 0])
        simd.write(y, j, rows[k, 1])
        simd.write(z, j, rows[k, 2])
    return crosslane.load(x, 0), crosslane.load(y, 0), crosslane.load(z, 0)


@helper
def _load_numbers(numbers: Any, start: int, n: int) -> Lane:
    """Numbers `start` on as lanes; lanes beyond the end repeat the last number."""
    if start + crosslane.WIDTH <= n:
        return crosslane.load_row(numbers, start)
    x = simd.stack_array(np.float64, _LANES)
    for j in range(crosslane.WIDTH):
        simd.write(x, j, numbers[min(start + j, n - 1)])
    return crosslane.load(x, 0)


@helper
def store_numbers(numbers: Any, start: int, n: int, x: Lane) -> None:
    """Store lanes to numbers `start` on, up to the end."""
    if start + crosslane.WIDTH <= n:
        crosslane.store_row(numbers, start, x)
        return
    for j in range(n - start):
        numbers[start + j] = crosslane.lane(x, j)


@helper
def _load_ray(origin: Any, direction: Any, t_min: Any, t_max: Any, start: int) -> Ray:
    """Rays `start` on; t_max is -inf where a direction is too short or too long."""
    n = len(t_min)
    d, t = load_vectors(direction, start, n), _load_numbers(t_max, start, n)
    length = ops.largest((abs(d[0]), abs(d[1]), abs(d[2])))
    t = ops.where((length >= SHORTEST) & (length <= LONGEST), t, -np.inf)
    return Ray(load_vectors(origin, start, n), d, _load_numbers(t_min, start, n), t, None)


@kernel
def trace_closest(accel, origin, direction, t_min, t_max, visible, hits):
    """Kernel of `closest`: fill the columns of `hits`."""
    n = len(t_min)
    for start in range(0, n, crosslane.WIDTH):
        ray = _load_ray(origin, direction, t_min, t_max, start)
        hit = intersect.find(accel, ray, ops.bool_like(ray.t_min, True), visible, False)
        store_numbers(hits.t, start, n, hit.t)
        store_numbers(hits.u, start, n, hit.u)
        store_numbers(hits.v, start, n, hit.v)
        store_numbers(hits.instance, start, n, hit.instance)
        store_numbers(hits.primitive, start, n, hit.primitive)


@kernel
def trace_occluded(accel, origin, direction, t_min, t_max, visible, blocked):
    """Kernel of `occluded`: fill `blocked`."""
    n = len(t_min)
    for start in range(0, n, crosslane.WIDTH):
        ray = _load_ray(origin, direction, t_min, t_max, start)
        hit = intersect.find(accel, ray, ops.bool_like(ray.t_min, True), visible, True)
        store_numbers(blocked, start, n, hit.instance >= 0)


@kernel
def trace_transmittance(accel, origin, direction, t_min, t_max, share):
    """Kernel of `transmittance`: fill `share`."""
    n = len(t_min)
    for start in range(0, n, crosslane.WIDTH):
        ray = _load_ray(origin, direction, t_min, t_max, start)
        store_numbers(share, start, n, intersect.transmittance(accel, accel, ray, ops.bool_like(ray.t_min, True)))
