"""Many rays through one mesh, a few at a time: where one of them ends the next begins, so that all that have room are always under way.

Rays take turns (walk.py), that each may wait for memory while the others go on. Of eight that begin together most have ended when half
of the steps are taken, and the last ones wait alone; here they never are the last ones but for a wave's end. Rays that go much the same
way do better as bundles (traverse.py). What is met is the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import across, boxes, lanes, simd, walk
from .bvh import REACH
from .kernels import apart, helper
from .single import MESH
from .walk import STACK

_LANES = across.WIDTH
_ALL = (1 << _LANES) - 1
_SINGLES, _DOUBLES, _AXES = 8, 9, 3  # rows of walk.Rays that come with a ray; the others follow from them
STEP = _LANES  # rays that are made ready at a time: queues have room for so many more


class Wave(NamedTuple):
    """Where a wave's rays are, and what they meet is written; rows of `row` numbers each, an element a ray."""

    rays: Any  # rows of origin and direction, float32 or float64, from `base` on
    base: int
    far: Any  # how far they go, from `far_base` on
    far_base: int
    row: int
    met: Any  # rows of t, u, v
    what: Any  # rows of something else, instance, primitive


class _Ready(NamedTuple):
    """Rays made ready, as many as lanes."""

    rays: walk.Rays
    numbers: Any  # int64: which rays of the wave


@helper
def suits(accel: Any) -> bool:
    """Whether one mesh is all there is in the trees: rays through several things do better in batches, which share tests."""
    return len(accel.endless) == 0 and accel.only >= 0 and accel.placed[accel.only, 3] == MESH


@apart
def through(accel, wave, queue, count, visible_bit, any_hit):
    """Follow rays 0 … count - 1 of a queue; how many of them are then at its front: those that met something, or, `any_hit`, nothing.

    What is met first goes to the wave, without `any_hit`. All rays begin at 0.
    """
    rays, ready = walk.room(), _Ready(walk.room(), simd.stack_array(np.int64, _LANES))
    zero = lanes.to_float(simd.load(queue, 0)) * 0.0
    none = lanes.int_like(zero, -1)
    steps, numbers = walk.walks(zero, none, none, zero, zero), simd.stack_array(np.int64, _LANES)
    only = np.int64(accel.only)
    root = np.int64(accel.placed[only, 4])
    left, waiting, upto, done = 0, 0, 0, 0
    while True:
        idle = _ALL & ~left
        while idle != 0:
            if waiting == 0:
                if upto >= count:
                    break
                waiting = _make_ready(accel, wave, queue, upto, ready, visible_bit)
                if any_hit:
                    done = _keep_front(queue, done, ready.numbers, _first(count - upto) & ~waiting)
                waiting &= _first(count - upto)
                upto += STEP
                continue
            k, j = simd.trailing_zeros(idle), simd.trailing_zeros(waiting)
            idle &= idle - 1
            waiting &= waiting - 1
            simd.write(numbers, k, simd.read(ready.numbers, j))
            _begin(ready, j, rays, steps, k, root)
            left |= 1 << k
        if left == 0:
            return done
        todo = left
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            if not walk.step(accel.wide, rays, steps, k, only, any_hit):
                left &= ~(1 << k)
                done = _end(wave, queue, done, steps, k, simd.read(numbers, k), any_hit)


@helper
def _first(count: int) -> int:
    """Bits of the lanes that hold the first `count`, all at the most."""
    return (1 << min(count, _LANES)) - 1


@helper
def _make_ready(accel: Any, wave: Wave, queue: Any, at: int, ready: _Ready, visible_bit: int) -> int:
    """Make rays of a queue ready, as many as lanes; bits of those that have something to go through."""
    number = simd.load(queue, at)
    simd.store(ready.numbers, 0, number)
    here = number + wave.base
    origin = (wave.rays[here], wave.rays[here + wave.row], wave.rays[here + 2 * wave.row])
    direction = (wave.rays[here + 3 * wave.row], wave.rays[here + 4 * wave.row], wave.rays[here + 5 * wave.row])
    until = wave.far[number + wave.far_base]
    near = 0.0 * origin[0]
    i = np.int64(accel.only)
    if (accel.placed[i, 0] & visible_bit) == 0:
        return 0
    g = accel.placed[i, 2]
    o = lanes.transform_point(accel.inverse, i, origin)
    o = lanes.sub(o, (accel.origin[g, 0], accel.origin[g, 1], accel.origin[g, 2]))
    d = lanes.transform_vector(accel.inverse, i, direction)
    ray = boxes.local_ray(o, d)
    enters = boxes.enter(accel.boxes, g, ray, near, until)
    there = enters < np.inf
    walk.keep(ready.rays, 0, o, d, ray.inverse, lanes.where(there, enters, 0.0), near, until, until, accel.boxes[g, REACH])
    return across.bits(there)


@helper
def _keep_front(queue: Any, done: int, numbers: Any, which: int) -> int:
    """Put rays of lanes at the front of the queue; how many are there then."""
    while which != 0:
        simd.write(queue, done, simd.read(numbers, simd.trailing_zeros(which)))
        which &= which - 1
        done += 1
    return done


@helper
def _begin(ready: _Ready, j: int, rays: walk.Rays, steps: walk.Walks, k: int, root: int) -> None:
    """Let ray j of those that are ready begin in lane k."""
    simd.write(steps.found, k, np.inf)
    simd.write(steps.numbers, k, -1)
    _copy(ready.rays.singles, rays.singles, _SINGLES, j, k)
    _copy(ready.rays.doubles, rays.doubles, _DOUBLES, j, k)
    _copy(ready.rays.axes, rays.axes, _AXES, j, k)
    walk.enter(rays, steps, k, root, k * STACK)


@helper
def _copy(source: Any, target: Any, rows: int, j: int, k: int) -> None:
    for row in range(rows):
        simd.write(target, row * _LANES + k, simd.read(source, row * _LANES + j))


@helper
def _end(wave: Wave, queue: Any, done: int, steps: walk.Walks, k: int, number: int, any_hit: bool) -> int:
    """Write what the ray of lane k has met; how many rays are then at the front of the queue."""
    instance = simd.read(steps.numbers, k)
    if (instance < 0) != any_hit:
        return done
    simd.write(queue, done, number)
    if not any_hit:
        total = simd.read(steps.found, 3 * _LANES + k)
        simd.write(wave.met, number, simd.read(steps.found, k))
        simd.write(wave.met, number + wave.row, simd.read(steps.found, _LANES + k) / total)
        simd.write(wave.met, number + 2 * wave.row, simd.read(steps.found, 2 * _LANES + k) / total)
        simd.write(wave.what, number + wave.row, instance)
        simd.write(wave.what, number + 2 * wave.row, simd.read(steps.numbers, _LANES + k))
    return done + 1
