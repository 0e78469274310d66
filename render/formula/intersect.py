"""First hits of rays with implicit surfaces, proved to be the first roots by interval bounds of the formula."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..jit.function_pointer import DeclaredKernel
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec
from .evaluate import RayFunction, eval_buffers
from .grid_traversal import first_roots
from .hit_geometry import complete_hits
from .tables import BALL_CENTER, BALL_RADIUS, HIGH, HIT

SMALLEST = 1e-290  # products of a unit vector's components below this lose digits


def _first_hit(forms, g, origin, direction, t_min, t_max):
    """(t, spacing, u, v, unproved) of the first hit of rays with implicit surface `g`, in its own frame; t is inf without a hit.

    u and v hold the normal, as `hit_geometry.encode_normal` writes it. The point may be off the surface by `spacing` ulps of its largest
    coordinate.
    """
    k = np.int64(forms.surface_of[g])
    size = ops.length(direction)
    size = ops.where(size > 0.0, size, 1.0)
    unit = ops.scale(direction, 1.0 / size)
    enter, leave = clip_to_bounds(forms, k, origin, unit, t_min * size, t_max * size)
    active = enter < leave
    zero = ops.full_like(t_min, 0.0)
    begin = ops.where(active, enter, zero)
    start = ops.along(origin, unit, begin)
    memory = eval_buffers()
    root, tape, inside, unproved = zero + np.inf, ops.int_like(zero, 0), active & ops.not_(active), zero
    if ops.any_lane(active):
        root, tape, inside, unproved = first_roots(forms, k, memory, start, unit, ops.where(active, leave - begin, zero), begin, active)
    hit = root < np.inf
    spacing, u, v, t = ops.int_like(zero, 0), zero, zero, zero + np.inf
    if ops.any_lane(hit):
        hit_root = ops.where(hit, root, zero)
        ray = RayFunction(forms, k, tape, memory, start, unit)
        distance, spacing, u, v = complete_hits(ray, origin, begin, hit_root, inside, hit)
        t = ops.where(hit, distance / size, t)
        u, v = ops.where(hit, u, zero), ops.where(hit, v, zero)
    return t, spacing, u, v, ops.to_int(unproved)


first_hit = DeclaredKernel(_first_hit, HIT)
call = first_hit.call


@helper
def clip_to_bounds(forms: Any, k: int, o: Vec, d: Vec, low: Lane, high: Lane) -> tuple[Lane, Lane]:
    """Clip the interval low … high of rays with unit directions to a surface's box, and to its ball if it has one."""
    numbers, inverses = forms.numbers, _inverse_direction(d)
    for axis in range(3):
        x, dx, inverse = (o[0], d[0], inverses[0]) if axis == 0 else (o[1], d[1], inverses[1]) if axis == 1 else (o[2], d[2], inverses[2])
        near, far = numbers[k, axis] - x, numbers[k, HIGH + axis] - x
        parallel = dx == 0.0
        first, second = near * inverse, far * inverse
        within = (near <= 0.0) & (far >= 0.0)
        first = ops.where(parallel, ops.where(within, -np.inf, np.inf), first)
        second = ops.where(parallel, ops.where(within, np.inf, -np.inf), second)
        low, high = ops.maximum(low, ops.minimum(first, second)), ops.minimum(high, ops.maximum(first, second))
    radius = numbers[k, BALL_RADIUS]
    if radius > 0.0:
        f = ops.sub(
            (0.0 * o[0] + numbers[k, BALL_CENTER], 0.0 * o[1] + numbers[k, BALL_CENTER + 1], 0.0 * o[2] + numbers[k, BALL_CENTER + 2]), o
        )
        along = ops.dot(f, d)
        off = ops.sub(f, ops.scale(d, along))
        discriminant = radius * radius - ops.dot(off, off)
        half = ops.sqrt(ops.maximum(discriminant, 0.0))
        low = ops.where(discriminant > 0.0, ops.maximum(low, along - half), np.inf)
        high = ops.minimum(high, along + half)
    return low, high


@helper
def _inverse_direction(d: Vec) -> Vec:
    """1 / d of unit vectors by components, undefined where a component is 0; by one division, the most expensive operation here."""
    x, y, z = ops.where(d[0] == 0.0, 1.0, d[0]), ops.where(d[1] == 0.0, 1.0, d[1]), ops.where(d[2] == 0.0, 1.0, d[2])
    product = x * y * z
    inverse = 1.0 / product
    first, second, third = y * z * inverse, x * z * inverse, x * y * inverse
    small = abs(product) < SMALLEST
    if ops.any_lane(small):
        first, second, third = ops.where3(small, (1.0 / x, 1.0 / y, 1.0 / z), (first, second, third))
    return first, second, third
