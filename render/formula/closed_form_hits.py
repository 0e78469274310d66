"""Ray hits of CSG trees of planes, quadrics and tori: a walk along the ray over the intervals of each leaf (Roth 1982).

At each step of the walk, the tree is evaluated: whether the point is in the solid, and up to which distance that cannot change. `and` and
`or` combine the answers of their operands. So intervals are never merged into lists, and the walk passes few roots of hidden parts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler.formula.closed_form_solids import EITHER, LEAF, MOST_DEPTH, MOST_LEAVES
from .. import simd
from ..geometry.analytic_shapes import torus_crossings
from ..jit.function_pointer import DeclaredKernel
from ..jit.kernel import helper
from ..lanes import crosslane, ops
from ..lanes.kinds import FLOAT
from ..types import Lane, Vec
from .bracketing import ULP
from .hit_geometry import normal_and_spacing
from .intersect import clip_to_bounds
from .llvm_math import LANES
from .tables import FIRST_LEAF, FIRST_STEP, HIT, HOLE, LARGEST_COORDINATE, LINEAR, QUADRIC, STEP_COUNT, TORUS

_INTERVALS = 4 * MOST_LEAVES * LANES
_STACK = 3 * (MOST_DEPTH + 1) * LANES
_SPACE = 32.0 * ULP  # of the largest coordinate: thinner parts of a solid, and gaps in it, are ignored


def _crossings(numbers, leaf, origin, direction):
    o = (
        _row(numbers, leaf, 0, origin) + numbers[leaf, 3], _row(numbers, leaf, 4, origin) + numbers[leaf, 7],
        _row(numbers, leaf, 8, origin) + numbers[leaf, 11],
    )  # fmt: skip
    d = (_row(numbers, leaf, 0, direction), _row(numbers, leaf, 4, direction), _row(numbers, leaf, 8, direction))
    ring, tube = ops.full_like(o[0], numbers[leaf, 12]), ops.full_like(o[0], numbers[leaf, 13])
    return torus_crossings(ring, tube, o, d)


crossings = DeclaredKernel(_crossings, (FLOAT,) * 4)
call_crossings = crossings.call


@helper
def _row(numbers: Any, leaf: int, first: int, v: Vec) -> Lane:
    return numbers[leaf, first] * v[0] + numbers[leaf, first + 1] * v[1] + numbers[leaf, first + 2] * v[2]


def _first_hit(forms, g, origin, direction, t_min, t_max):
    """(t, spacing, u, v, unproved) of rays' first hits of surface `g`, as intersect.first_hit."""
    k = np.int64(forms.surface_of[g])
    size = ops.length(direction)
    size = ops.where(size > 0.0, size, 1.0)
    unit = ops.scale(direction, 1.0 / size)
    enter, leave = clip_to_bounds(forms, k, origin, unit, t_min * size, t_max * size)
    active = enter < leave
    zero = ops.full_like(t_min, 0.0)
    t, spacing, u, v = zero + np.inf, ops.int_like(zero, 0), zero, zero
    if ops.any_lane(active):
        begin = ops.where(active, enter, zero)
        start = ops.along(origin, unit, begin)
        intervals = simd.stack_array(np.float64, _INTERVALS)
        _leaf_intervals(forms, k, intervals, start, unit)
        root, leaf, inside = _first_crossing(forms, k, intervals, ops.where(active, leave - begin, zero), active)
        hit = root < np.inf
        if ops.any_lane(hit):
            distance, gradient, off = _complete_hits(forms, k, leaf, start, unit, ops.where(hit, root, zero))
            spacing, u, v = normal_and_spacing(forms, k, unit, gradient, inside, off)
            t = ops.where(hit, (begin + distance) / size, t)
            u, v = ops.where(hit, u, zero), ops.where(hit, v, zero)
    return t, spacing, u, v, ops.int_like(zero, 0)


first_hit = DeclaredKernel(_first_hit, HIT)
call_first_hit = first_hit.call


def _dispatch_hit(forms, g, origin, direction, t_min, t_max):
    """`first_hit` in a scene with closed forms and other surfaces."""
    which = 0 if forms.parts.places[np.int64(forms.surface_of[g]), STEP_COUNT] > 0 else 1
    return call_first_hit(forms.parts.kernels[which], (forms, g, origin, direction, t_min, t_max))  # pyright: ignore[reportCallIssue]


dispatch_hit = DeclaredKernel(_dispatch_hit, HIT)


# --- along a ray --------------------------------------------------------------------------------------------------------


@helper
def _leaf_intervals(forms: Any, k: int, intervals: Any, start: Vec, direction: Vec) -> None:
    """Store two intervals of the ray in which each leaf's relation holds."""
    numbers, kinds = forms.parts.numbers, forms.parts.kinds
    steps, begin = forms.parts.places[k, STEP_COUNT], forms.parts.places[k, FIRST_LEAF]
    none = ops.full_like(start[0], np.inf)
    for i in range((steps + 1) // 2):
        leaf = begin + i
        a0, a1, b0, b1 = none, none, none, none
        if kinds[leaf] == LINEAR:
            slope = _row(numbers, leaf, 6, direction)
            level = _row(numbers, leaf, 6, start) + numbers[leaf, 9]
            t = -level / ops.where(slope == 0.0, 1.0, slope)
            parallel = slope == 0.0
            a0 = ops.where(parallel, ops.where(level <= 0.0, -none, none), ops.where(slope < 0.0, t, -none))
            a1 = ops.where(parallel, none, ops.where(slope < 0.0, none, t))
        elif kinds[leaf] == QUADRIC:
            a0, a1, b0, b1 = _quadric(numbers, leaf, start, direction, none)
        else:
            a0, a1, b0, b1 = call_crossings(forms.parts.kernels[2], (numbers, np.int64(leaf), start, direction))  # pyright: ignore[reportCallIssue]
        crosslane.store(intervals, 4 * i, a0)
        crosslane.store(intervals, 4 * i + 1, a1)
        crosslane.store(intervals, 4 * i + 2, b0)
        crosslane.store(intervals, 4 * i + 3, b1)


@helper
def _quadric(numbers: Any, leaf: int, o: Vec, d: Vec, none: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """Intervals in which a quadratic polynomial is at most 0."""
    gx, gy, gz = _quadratic_gradient(numbers, leaf, d)
    a = 0.5 * (gx * d[0] + gy * d[1] + gz * d[2])
    half = 0.5 * (gx * o[0] + gy * o[1] + gz * o[2] + _row(numbers, leaf, 6, d))
    hx, hy, hz = _quadratic_gradient(numbers, leaf, o)
    c = 0.5 * (hx * o[0] + hy * o[1] + hz * o[2]) + _row(numbers, leaf, 6, o) + numbers[leaf, 9]
    discriminant = half * half - a * c
    real = discriminant > 0.0
    root = ops.sqrt(ops.where(real, discriminant, 0.0))
    q = -(half + ops.where(half < 0.0, -root, root))
    flat = a == 0.0
    first_root = q / ops.where(flat, 1.0, a)
    first_root = ops.where(flat, ops.where(half < 0.0, none, -none), first_root)
    second_root = ops.where(q == 0.0, ops.where(flat, none, 0.0), c / ops.where(q == 0.0, 1.0, q))
    low, high = ops.minimum(first_root, second_root), ops.maximum(first_root, second_root)
    between = (a > 0.0) | flat  # a linear polynomial has one root at infinity
    holds = (a < 0.0) | (flat & (c <= 0.0))  # everywhere, without roots
    return (
        ops.where(real, ops.where(between, low, -none), ops.where(holds, -none, none)),
        ops.where(real, ops.where(between, high, low), none), ops.where(real & ops.not_(between), high, none), none,
    )  # fmt: skip


@helper
def _quadratic_gradient(numbers: Any, leaf: Any, p: Vec) -> Vec:
    """Derivatives of the quadratic terms of a polynomial."""
    xy, yz, xz = numbers[leaf, 3], numbers[leaf, 4], numbers[leaf, 5]
    return (
        2.0 * numbers[leaf, 0] * p[0] + xy * p[1] + xz * p[2], xy * p[0] + 2.0 * numbers[leaf, 1] * p[1] + yz * p[2],
        xz * p[0] + yz * p[1] + 2.0 * numbers[leaf, 2] * p[2],
    )  # fmt: skip


@helper
def _first_crossing(forms: Any, k: int, intervals: Any, end: Lane, active: Lane) -> tuple[Lane, Lane, Lane]:
    """(distance at which a ray first enters or leaves the solid, or inf; the leaf hit there; whether it is inside before)."""
    stack = simd.stack_array(np.float64, _STACK)
    reach = forms.numbers[k, LARGEST_COORDINATE]
    distance = 0.0 * end
    inside, until, leaf = _evaluate_tree(forms, k, intervals, stack, distance)
    crossing, hit_leaf = distance + np.inf, ops.int_like(distance, 0)
    active = active & (until < end)
    while ops.any_lane(active):
        distance = ops.where(active, until, distance)
        now, next_until, next_leaf = _evaluate_tree(forms, k, intervals, stack, distance + _SPACE * (distance + reach))
        changed = active & (now != inside)
        crossing, hit_leaf = ops.where(changed, distance, crossing), ops.where(changed, leaf, hit_leaf)
        until, leaf = ops.where(active, next_until, until), ops.where(active, next_leaf, leaf)
        active = active & ops.not_(changed) & (until < end)
    return crossing, forms.parts.places[k, FIRST_LEAF] + hit_leaf, inside > 0.0


@helper
def _evaluate_tree(forms: Any, k: int, intervals: Any, stack: Any, t: Lane) -> tuple[Lane, Lane, Lane]:
    """(1 inside the solid at t, else 0; distance up to which that cannot change; the leaf with a root there)."""
    steps, kinds = forms.parts.steps, forms.parts.kinds
    first, count, begin = forms.parts.places[k, FIRST_STEP], forms.parts.places[k, STEP_COUNT], forms.parts.places[k, FIRST_LEAF]
    top = 0
    for row in range(first, first + count):
        if steps[row, 0] == LEAF:
            i: Any = np.int64(steps[row, 1])
            a0, a1 = crosslane.load(intervals, 4 * i), crosslane.load(intervals, 4 * i + 1)
            state, until = ops.where((t >= a0) & (t < a1), 1.0, 0.0 * t), ops.where(t < a0, a0, ops.where(t < a1, a1, np.inf))
            if kinds[begin + i] != LINEAR:
                b0, b1 = crosslane.load(intervals, 4 * i + 2), crosslane.load(intervals, 4 * i + 3)
                state = ops.where((t >= b0) & (t < b1), 1.0, state)
                until = ops.minimum(until, ops.where(t < b0, b0, ops.where(t < b1, b1, np.inf)))
            if kinds[begin + i] == HOLE:
                state = 1.0 - state
            crosslane.store(stack, 3 * top, state)
            crosslane.store(stack, 3 * top + 1, until)
            crosslane.store(stack, 3 * top + 2, ops.full_like(t, ops.to_float(i)))
            top += 1
        else:
            top -= 1
            decides = 1.0 if steps[row, 0] == EITHER else 0.0
            left_state, right_state = crosslane.load(stack, 3 * top - 3), crosslane.load(stack, 3 * top)
            until, beyond = crosslane.load(stack, 3 * top - 2), crosslane.load(stack, 3 * top + 1)
            left_decides, right_decides = left_state == decides, right_state == decides
            earlier = until < beyond
            first = ops.where(
                left_decides & right_decides, ops.not_(earlier), ops.where(left_decides, True, ops.where(right_decides, False, earlier))
            )
            crosslane.store(stack, 3 * top - 3, ops.where(left_decides | right_decides, decides, 1.0 - decides + 0.0 * t))
            crosslane.store(stack, 3 * top - 2, ops.where(first, until, beyond))
            crosslane.store(stack, 3 * top - 1, ops.where(first, crosslane.load(stack, 3 * top - 1), crosslane.load(stack, 3 * top + 2)))
    return crosslane.load(stack, 0), crosslane.load(stack, 1), ops.to_int(crosslane.load(stack, 2))


@helper
def _complete_hits(forms: Any, k: int, leaf: Lane, start: Vec, direction: Vec, root: Lane) -> tuple[Lane, Vec, Lane]:
    """(distance of the hit after a Newton step, gradient of the leaf there, bound of its value)."""
    numbers, kind = forms.parts.numbers, ops.to_int(forms.parts.kinds[leaf])
    p = ops.along(start, direction, root)
    tx, ty, tz = _quadratic_gradient(numbers, leaf, p)
    g = (tx + numbers[leaf, 6], ty + numbers[leaf, 7], tz + numbers[leaf, 8])
    value = 0.5 * ops.dot((tx, ty, tz), p) + _row(numbers, leaf, 6, p) + numbers[leaf, 9]
    size = ops.length(g)
    along = ops.dot(g, direction)
    step = -value / ops.where(along == 0.0, 1.0, along)
    usual = kind < TORUS
    certain = usual & (abs(along) > 1e-3 * size) & (abs(step) < 1e-9 * (root + forms.numbers[k, LARGEST_COORDINATE]))
    better = ops.where(certain, ops.maximum(root + step, 0.0), root)
    reach = ops.maximum(ops.maximum(abs(p[0]), abs(p[1])), abs(p[2]))
    off = 8.0 * ULP * (size * reach + abs(numbers[leaf, 9]))
    if ops.any_lane(ops.not_(usual)):
        ring, tube = numbers[leaf, 12], numbers[leaf, 13]
        q = (
            _row(numbers, leaf, 0, p) + numbers[leaf, 3], _row(numbers, leaf, 4, p) + numbers[leaf, 7],
            _row(numbers, leaf, 8, p) + numbers[leaf, 11],
        )  # fmt: skip
        rho = ops.sqrt(q[0] * q[0] + q[2] * q[2])
        share = ops.where(rho > 0.0, 1.0 - ring / ops.where(rho > 0.0, rho, 1.0), 0.0) * ops.where(kind == HOLE, -1.0, 1.0)
        n = (share * q[0], q[1] * ops.where(kind == HOLE, -1.0, 1.0), share * q[2])
        normal = (
            numbers[leaf, 0] * n[0] + numbers[leaf, 4] * n[1] + numbers[leaf, 8] * n[2],
            numbers[leaf, 1] * n[0] + numbers[leaf, 5] * n[1] + numbers[leaf, 9] * n[2],
            numbers[leaf, 2] * n[0] + numbers[leaf, 6] * n[1] + numbers[leaf, 10] * n[2],
        )  # fmt: skip
        g = ops.where3(usual, g, normal)
        off = ops.where(usual, off, 16.0 * ULP * (ring + tube + reach) * tube)
    return better, g, off
