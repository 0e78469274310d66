"""Rays through solids of planes, quadrics and tori (compiler/closed_forms.py): of each relation the stretches of the ray that fulfil it.

A walk along the ray asks, place by place, whether the solid holds there and up to where nothing changes: of `and` and `or` that follows
from the operands' answers. So what combines hundreds of stretches is never listed, and of hidden parts hardly any root is passed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler.closed_forms import EITHER, LEAF, MOST_DEPTH, MOST_LEAVES
from .. import across, lanes, simd, torus
from ..kernels import helper
from ..links import FLOAT, Answering
from ..records import Lane, Vec
from . import meet
from .forms import HOLE, LINEAR, MET, QUADRIC, TORUS
from .vectors import LANES

ULP = 2.0**-52
_WIDE, _KEPT = 4 * LANES, 4 * MOST_LEAVES * LANES
_STACK = 3 * (MOST_DEPTH + 1) * LANES
_SPACE = 32.0 * ULP  # of the largest coordinate: parts of a solid, or gaps in it, that are thinner than this count as nothing


def _crossings(numbers, leaf, origin, direction):
    o = (
        _row(numbers, leaf, 0, origin) + numbers[leaf, 3], _row(numbers, leaf, 4, origin) + numbers[leaf, 7],
        _row(numbers, leaf, 8, origin) + numbers[leaf, 11],
    )  # fmt: skip
    d = (_row(numbers, leaf, 0, direction), _row(numbers, leaf, 4, direction), _row(numbers, leaf, 8, direction))
    ring, tube = lanes.full_like(o[0], numbers[leaf, 12]), lanes.full_like(o[0], numbers[leaf, 13])
    return torus.crossings(ring, tube, o, d)


crossings = Answering(_crossings, (FLOAT,) * 4)
call_crossings = crossings.call


@helper
def _row(numbers: Any, leaf: int, first: int, v: Vec) -> Lane:
    return numbers[leaf, first] * v[0] + numbers[leaf, first + 1] * v[1] + numbers[leaf, first + 2] * v[2]


def _met(forms, g, origin, direction, t_min, t_max):
    """As formulas.meet's: (t, spacing, u, v, unproved) of rays' first meetings with surface `g`."""
    k = np.int64(forms.of[g])
    size = lanes.length(direction)
    size = lanes.where(size > 0.0, size, 1.0)
    way = lanes.scale(direction, 1.0 / size)
    enter, leave = meet.clipped(forms, k, origin, way, t_min * size, t_max * size)
    active = enter < leave
    zero = lanes.full_like(t_min, 0.0)
    t, spacing, u, v = zero + np.inf, lanes.int_like(zero, 0), zero, zero
    if lanes.any_lane(active):
        begin = lanes.where(active, enter, zero)
        start = lanes.along(origin, way, begin)
        kept = simd.stack_array(np.float64, _KEPT)
        _roots(forms, k, kept, start, way)
        found, leaf, inside = _first(forms, k, kept, lanes.where(active, leave - begin, zero), active)
        hit = found < np.inf
        if lanes.any_lane(hit):
            at, gradient, off = _finished(forms, k, leaf, start, way, lanes.where(hit, found, zero))
            spacing, u, v = meet.dressed(forms, k, way, gradient, inside, off)
            t = lanes.where(hit, (begin + at) / size, t)
            u, v = lanes.where(hit, u, zero), lanes.where(hit, v, zero)
    return t, spacing, u, v, lanes.int_like(zero, 0)


met = Answering(_met, MET)


def _either(forms, g, origin, direction, t_min, t_max):
    """A surface in a scene that has some of both."""
    which = 0 if forms.parts.places[np.int64(forms.of[g]), 1] > 0 else 1
    return call_met(forms.parts.ways[which], (forms, g, origin, direction, t_min, t_max))  # pyright: ignore[reportCallIssue]


call_met = met.call
either = Answering(_either, MET)


# --- along a ray --------------------------------------------------------------------------------------------------------


@helper
def _roots(forms: Any, k: int, kept: Any, start: Vec, way: Vec) -> None:
    """Keep of each leaf two stretches of the ray in which its relation holds."""
    numbers, kinds = forms.parts.numbers, forms.parts.kinds
    steps, begin = forms.parts.places[k, 1], forms.parts.places[k, 2]
    none = lanes.full_like(start[0], np.inf)
    for i in range((steps + 1) // 2):
        leaf = begin + i
        a0, a1, b0, b1 = none, none, none, none
        if kinds[leaf] == LINEAR:
            slope = _row(numbers, leaf, 6, way)
            level = _row(numbers, leaf, 6, start) + numbers[leaf, 9]
            t = -level / lanes.where(slope == 0.0, 1.0, slope)
            still = slope == 0.0
            a0 = lanes.where(still, lanes.where(level <= 0.0, -none, none), lanes.where(slope < 0.0, t, -none))
            a1 = lanes.where(still, none, lanes.where(slope < 0.0, none, t))
        elif kinds[leaf] == QUADRIC:
            a0, a1, b0, b1 = _quadric(numbers, leaf, start, way, none)
        else:
            a0, a1, b0, b1 = call_crossings(forms.parts.ways[2], (numbers, np.int64(leaf), start, way))  # pyright: ignore[reportCallIssue]
        across.store(kept, 4 * i, a0)
        across.store(kept, 4 * i + 1, a1)
        across.store(kept, 4 * i + 2, b0)
        across.store(kept, 4 * i + 3, b1)


@helper
def _quadric(numbers: Any, leaf: int, o: Vec, d: Vec, none: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """Where a polynomial of second degree is at most 0."""
    gx, gy, gz = _turn(numbers, leaf, d)
    a = 0.5 * (gx * d[0] + gy * d[1] + gz * d[2])
    half = 0.5 * (gx * o[0] + gy * o[1] + gz * o[2] + _row(numbers, leaf, 6, d))
    hx, hy, hz = _turn(numbers, leaf, o)
    c = 0.5 * (hx * o[0] + hy * o[1] + hz * o[2]) + _row(numbers, leaf, 6, o) + numbers[leaf, 9]
    rest = half * half - a * c
    real = rest > 0.0
    root = lanes.sqrt(lanes.where(real, rest, 0.0))
    q = -(half + lanes.where(half < 0.0, -root, root))
    flat = a == 0.0
    one = q / lanes.where(flat, 1.0, a)
    one = lanes.where(flat, lanes.where(half < 0.0, none, -none), one)
    other = lanes.where(q == 0.0, lanes.where(flat, none, 0.0), c / lanes.where(q == 0.0, 1.0, q))
    low, high = lanes.minimum(one, other), lanes.maximum(one, other)
    between = (a > 0.0) | flat  # of a line one root is endlessly far
    holds = (a < 0.0) | (flat & (c <= 0.0))  # everywhere, where there are no roots
    return (
        lanes.where(real, lanes.where(between, low, -none), lanes.where(holds, -none, none)),
        lanes.where(real, lanes.where(between, high, low), none), lanes.where(real & lanes.not_(between), high, none), none,
    )  # fmt: skip


@helper
def _turn(numbers: Any, leaf: Any, p: Vec) -> Vec:
    """The derivatives of a polynomial's terms of second degree."""
    xy, yz, xz = numbers[leaf, 3], numbers[leaf, 4], numbers[leaf, 5]
    return (
        2.0 * numbers[leaf, 0] * p[0] + xy * p[1] + xz * p[2], xy * p[0] + 2.0 * numbers[leaf, 1] * p[1] + yz * p[2],
        xz * p[0] + yz * p[1] + 2.0 * numbers[leaf, 2] * p[2],
    )  # fmt: skip


@helper
def _first(forms: Any, k: int, kept: Any, end: Lane, active: Lane) -> tuple[Lane, Lane, Lane]:
    """(where a ray first enters or leaves a solid, or inf; the leaf that it meets there; whether it is inside before)."""
    stack = simd.stack_array(np.float64, _STACK)
    reach = forms.numbers[k, 13]
    at = 0.0 * end
    inside, until, leaf = _state(forms, k, kept, stack, at)
    found, met_leaf = at + np.inf, lanes.int_like(at, 0)
    active = active & (until < end)
    while lanes.any_lane(active):
        at = lanes.where(active, until, at)
        now, onward, further = _state(forms, k, kept, stack, at + _SPACE * (at + reach))
        changed = active & (now != inside)
        found, met_leaf = lanes.where(changed, at, found), lanes.where(changed, leaf, met_leaf)
        until, leaf = lanes.where(active, onward, until), lanes.where(active, further, leaf)
        active = active & lanes.not_(changed) & (until < end)
    return found, forms.parts.places[k, 2] + met_leaf, inside > 0.0


@helper
def _state(forms: Any, k: int, kept: Any, stack: Any, t: Lane) -> tuple[Lane, Lane, Lane]:
    """(1 where a solid holds at t, else 0; up to where nothing changes that; the leaf of which that is a root)."""
    steps, kinds = forms.parts.steps, forms.parts.kinds
    first, count, begin = forms.parts.places[k, 0], forms.parts.places[k, 1], forms.parts.places[k, 2]
    top = 0
    for row in range(first, first + count):
        if steps[row, 0] == LEAF:
            i: Any = np.int64(steps[row, 1])
            a0, a1 = across.load(kept, 4 * i), across.load(kept, 4 * i + 1)
            state, until = lanes.where((t >= a0) & (t < a1), 1.0, 0.0 * t), lanes.where(t < a0, a0, lanes.where(t < a1, a1, np.inf))
            if kinds[begin + i] != LINEAR:
                b0, b1 = across.load(kept, 4 * i + 2), across.load(kept, 4 * i + 3)
                state = lanes.where((t >= b0) & (t < b1), 1.0, state)
                until = lanes.minimum(until, lanes.where(t < b0, b0, lanes.where(t < b1, b1, np.inf)))
            if kinds[begin + i] == HOLE:
                state = 1.0 - state
            across.store(stack, 3 * top, state)
            across.store(stack, 3 * top + 1, until)
            across.store(stack, 3 * top + 2, lanes.full_like(t, lanes.to_float(i)))
            top += 1
        else:
            top -= 1
            decides = 1.0 if steps[row, 0] == EITHER else 0.0
            one, other = across.load(stack, 3 * top - 3), across.load(stack, 3 * top)
            until, beyond = across.load(stack, 3 * top - 2), across.load(stack, 3 * top + 1)
            by_one, by_other = one == decides, other == decides
            earlier = until < beyond
            keep = lanes.where(by_one & by_other, lanes.not_(earlier), lanes.where(by_one, True, lanes.where(by_other, False, earlier)))
            across.store(stack, 3 * top - 3, lanes.where(by_one | by_other, decides, 1.0 - decides + 0.0 * t))
            across.store(stack, 3 * top - 2, lanes.where(keep, until, beyond))
            across.store(stack, 3 * top - 1, lanes.where(keep, across.load(stack, 3 * top - 1), across.load(stack, 3 * top + 2)))
    return across.load(stack, 0), across.load(stack, 1), lanes.to_int(across.load(stack, 2))


@helper
def _finished(forms: Any, k: int, leaf: Lane, start: Vec, way: Vec, at: Lane) -> tuple[Lane, Vec, Lane]:
    """(where the meeting is after a step of Newton's, the gradient of what is met there, by how much that may be off 0)."""
    numbers, kind = forms.parts.numbers, lanes.to_int(forms.parts.kinds[leaf])
    p = lanes.along(start, way, at)
    tx, ty, tz = _turn(numbers, leaf, p)
    g = (tx + numbers[leaf, 6], ty + numbers[leaf, 7], tz + numbers[leaf, 8])
    value = 0.5 * lanes.dot((tx, ty, tz), p) + _row(numbers, leaf, 6, p) + numbers[leaf, 9]
    size = lanes.length(g)
    along = lanes.dot(g, way)
    step = -value / lanes.where(along == 0.0, 1.0, along)
    usual = kind < TORUS
    certain = usual & (abs(along) > 1e-3 * size) & (abs(step) < 1e-9 * (at + forms.numbers[k, 13]))
    better = lanes.where(certain, lanes.maximum(at + step, 0.0), at)
    reach = lanes.maximum(lanes.maximum(abs(p[0]), abs(p[1])), abs(p[2]))
    off = 8.0 * ULP * (size * reach + abs(numbers[leaf, 9]))
    if lanes.any_lane(lanes.not_(usual)):
        ring, tube = numbers[leaf, 12], numbers[leaf, 13]
        q = (
            _row(numbers, leaf, 0, p) + numbers[leaf, 3], _row(numbers, leaf, 4, p) + numbers[leaf, 7],
            _row(numbers, leaf, 8, p) + numbers[leaf, 11],
        )  # fmt: skip
        rho = lanes.sqrt(q[0] * q[0] + q[2] * q[2])
        share = lanes.where(rho > 0.0, 1.0 - ring / lanes.where(rho > 0.0, rho, 1.0), 0.0) * lanes.where(kind == HOLE, -1.0, 1.0)
        n = (share * q[0], q[1] * lanes.where(kind == HOLE, -1.0, 1.0), share * q[2])
        turned = (
            numbers[leaf, 0] * n[0] + numbers[leaf, 4] * n[1] + numbers[leaf, 8] * n[2],
            numbers[leaf, 1] * n[0] + numbers[leaf, 5] * n[1] + numbers[leaf, 9] * n[2],
            numbers[leaf, 2] * n[0] + numbers[leaf, 6] * n[1] + numbers[leaf, 10] * n[2],
        )  # fmt: skip
        g = lanes.where3(usual, g, turned)
        off = lanes.where(usual, off, 16.0 * ULP * (ring + tube + reach) * tube)
    return better, g, off
