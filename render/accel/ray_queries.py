"""Rays by the array: what each of them meets, or whether anything stands in its way."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...compiler import ir
from .. import simd
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..types import Hit, Lane, Ray, Vec
from . import double_packet, intersect, ray_sort, scene_bvh
from .ray_sort import BLOCK
from .traverse import motion_alpha, two_level

_LANES = crosslane.WIDTH
SHORTEST, LONGEST = 1e-20, 1e20  # directions, so that float32 has their inverses in all frames
CAMERA, SHADOW = int(ir.Visibility.CAMERA), int(ir.Visibility.SHADOW)


class Met(NamedTuple):
    """What n rays meet first, (n,) each; see records.Hit."""

    t: NDArray[np.float64]
    instance: NDArray[np.int64]
    primitive: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]


def trees(tables: ir.Tables, brute: bool = False, threads: int = 0, keep: bool = True, closed: bool = True) -> Handle:
    """What rays go through: the trees of a scene, ready for kernels; see bvh.build. Keep it as long as rays are traced."""
    accel = Handle(scene_bvh.build(tables, brute, threads, keep, closed=closed))
    motion_alpha.link(accel)
    return accel


def closest(
    accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf, visible: int = CAMERA
) -> Met:
    """The first hits of rays with origins and directions (n, 3), between t_min and t_max (n,), with what has a bit of `visible`.

    Directions are of any length from SHORTEST to LONGEST; rays whose are not meet nothing.
    """
    columns = _columns(origin, direction, t_min, t_max)
    n = len(columns[0])
    met = Met(np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n), np.empty(n))
    closest_of(accel, *columns, visible, met)
    return met


def unproved(accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike, t_max: ArrayLike) -> NDArray[np.bool_]:
    """(n,) whether a stretch before what a ray meets could not be proved to be without a formula's root.

    Trees count that for all rays: those that do are halved. Nobody else may trace through these trees meanwhile.
    """
    o, d, begin, end = _columns(origin, direction, t_min, t_max)
    n, counted = len(o), accel.tables.forms.unproved
    found, waiting = np.zeros(n, np.bool_), [(0, n)]
    while waiting:
        first, last = waiting.pop()
        before = int(counted[0])
        part = slice(first, last)
        closest(accel, o[part], d[part], begin[part], end[part])
        if counted[0] == before:
            continue
        if last - first == 1:
            found[first] = True
        else:
            middle = (first + last) // 2
            waiting += [(first, middle), (middle, last)]
    return found


def occluded(
    accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf, visible: int = SHADOW
) -> NDArray[np.bool_]:
    """(n,) whether a ray meets anything with a bit of `visible`; arguments as of `closest`."""
    columns = _columns(origin, direction, t_min, t_max)
    blocked = np.empty(len(columns[0]), np.bool_)
    occluded_of(accel, *columns, visible, blocked)
    return blocked


def let_through(
    accel: Handle, origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike = 0.0, t_max: ArrayLike = np.inf
) -> NDArray[np.float64]:
    """(n,) the share of light that passes what casts shadows, from 0 to 1; arguments as of `closest`."""
    columns = _columns(origin, direction, t_min, t_max)
    share = np.empty(len(columns[0]))
    shares_of(accel, *columns, share)
    return share


def _columns(origin: ArrayLike, direction: ArrayLike, t_min: ArrayLike, t_max: ArrayLike) -> tuple[NDArray[Any], ...]:
    o, d = np.ascontiguousarray(origin, np.float64), np.ascontiguousarray(direction, np.float64)
    n = (len(o),)
    return o, d, np.array(np.broadcast_to(t_min, n), np.float64), np.array(np.broadcast_to(t_max, n), np.float64)


@helper
def _three(rows: Any, start: int, n: int) -> Vec:
    """The columns of rows `start` on, (n, 3); beyond the last one it is repeated."""
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
def _one(numbers: Any, start: int, n: int) -> Lane:
    """Numbers `start` on; beyond the last one it is repeated."""
    if start + crosslane.WIDTH <= n:
        return crosslane.load_row(numbers, start)
    x = simd.stack_array(np.float64, _LANES)
    for j in range(crosslane.WIDTH):
        simd.write(x, j, numbers[min(start + j, n - 1)])
    return crosslane.load(x, 0)


@helper
def _ray(origin: Any, direction: Any, t_min: Any, t_max: Any, start: int, n: int) -> Ray:
    d = _three(direction, start, n)
    return Ray(_three(origin, start, n), d, _one(t_min, start, n), _if_sound(d, _one(t_max, start, n)), None)


@helper
def _if_sound(d: Vec, t_max: Lane) -> Lane:
    """How far rays go, -inf where their directions are too short or too long."""
    length = ops.largest((abs(d[0]), abs(d[1]), abs(d[2])))
    return ops.where((length >= SHORTEST) & (length <= LONGEST), t_max, -np.inf)


@helper
def _put(numbers: Any, start: int, n: int, x: Lane) -> None:
    """Write a value to numbers `start` on, as far as there are any."""
    if start + crosslane.WIDTH <= n:
        crosslane.store_row(numbers, start, x)
        return
    for j in range(n - start):
        numbers[start + j] = crosslane.lane(x, j)


@kernel
def closest_of(accel, origin, direction, t_min, t_max, visible, met):
    n = len(t_min)
    for start in range(0, n, 2 * crosslane.WIDTH):
        after = start + crosslane.WIDTH
        first, second = _ray(origin, direction, t_min, t_max, start, n), _ray(origin, direction, t_min, t_max, after, n)
        one, two = double_packet.find(accel, first, second, visible, False)
        _put_hit(met, start, n, one)
        _put_hit(met, after, n, two)


@helper
def _put_hit(met: Any, start: int, n: int, hit: Hit) -> None:
    _put(met.t, start, n, hit.t)
    _put(met.u, start, n, hit.u)
    _put(met.v, start, n, hit.v)
    _put(met.instance, start, n, hit.instance)
    _put(met.primitive, start, n, hit.primitive)


@helper
def _by_place(accel: Any, origin: Any, direction: Any, t_min: Any, t_max: Any, visible: int, blocked: Any) -> None:
    """`occluded_of`, rays that begin near each other side by side."""
    rows, n = simd.stack_array(np.int64, BLOCK), len(t_min)
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        _fetch(direction, 3 * start, 3 * count)  # which are read in another order than they stand in
        _fetch(t_max, start, count)
        ray_sort.order(origin, start, count, rows)
        for k in range(0, (count + crosslane.WIDTH - 1) // crosslane.WIDTH, 2):
            row, other = crosslane.load(rows, k), crosslane.load(rows, k + 1)
            first, second = _ray_at(origin, direction, t_min, t_max, row), _ray_at(origin, direction, t_min, t_max, other)
            one, two = double_packet.find(accel, first, second, visible, True)
            all_ = ops.bool_like(first.t_min, True)
            crosslane.put_at(blocked, row, one.instance >= 0, all_)
            crosslane.put_at(blocked, other, two.instance >= 0, all_)


@helper
def _ray_at(origin: Any, direction: Any, t_min: Any, t_max: Any, row: Lane) -> Ray:
    d = _at3(direction, row)
    return Ray(_at3(origin, row), d, ops.to_float(t_min[row]), _if_sound(d, ops.to_float(t_max[row])), None)


@helper
def _fetch(numbers: Any, first: int, count: int) -> None:
    """Ask for so many numbers of an array."""
    for k in range(first, first + count, 8):
        simd.prefetch(numbers, k)


@helper
def _at3(columns: Any, row: Lane) -> Vec:
    return ops.to_float(columns[row, 0]), ops.to_float(columns[row, 1]), ops.to_float(columns[row, 2])


@kernel
def occluded_of(accel, origin, direction, t_min, t_max, visible, blocked):
    if crosslane.WIDTH > 1 and len(accel.top.links) > two_level.SMALL:
        _by_place(accel, origin, direction, t_min, t_max, visible, blocked)
        return
    n = len(t_min)
    for start in range(0, n, 2 * crosslane.WIDTH):
        after = start + crosslane.WIDTH
        first, second = _ray(origin, direction, t_min, t_max, start, n), _ray(origin, direction, t_min, t_max, after, n)
        one, two = double_packet.find(accel, first, second, visible, True)
        _put(blocked, start, n, one.instance >= 0)
        _put(blocked, after, n, two.instance >= 0)


@kernel
def shares_of(accel, origin, direction, t_min, t_max, share):
    n = len(t_min)
    for start in range(0, n, crosslane.WIDTH):
        ray = _ray(origin, direction, t_min, t_max, start, n)
        _put(share, start, n, intersect.transmittance(accel, accel, ray, ops.bool_like(ray.t_min, True)))
