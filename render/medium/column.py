"""Column of a medium along a ray: the integral of its density over the distance, in closed form, and its inverse.

The density is 1 up to the height `top`, and falls off exponentially above it (ir.Media). Media whose density is a formula are in
`tracking.py`.
"""

from __future__ import annotations

import math

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane

STEEP = 1e-3  # exponents below which a series takes the place of the closed form


@helper
def _above(density: Lane, slope: Lane, falloff: Lane, distance: Lane) -> Lane:
    """The column over a distance above the top, from a point of some density; `slope` is the height that the ray gains per metre."""
    safe = ops.maximum(falloff, 1e-30)
    x = slope * ops.where(distance < math.inf, distance, 0.0) / safe
    series = ops.where(distance < math.inf, distance, 0.0) * (1.0 - 0.5 * x + x * x * (1.0 / 6.0))
    x = ops.where(distance < math.inf, x, ops.where(slope > 0.0, ops.full_like(x, 80.0), 0.0))
    turn = ops.where(ops.absolute(slope) > 1e-12, slope, 1e-12)
    closed = (1.0 - ops.exp(ops.clip(-x, -80.0, 80.0))) * safe / turn
    level = ops.where(distance < math.inf, series, ops.full_like(x, math.inf))
    return ops.where(falloff > 0.0, density * ops.where(ops.absolute(x) < STEEP, level, closed), 0.0)


@helper
def _above_inverse(density: Lane, slope: Lane, falloff: Lane, column: Lane) -> Lane:
    """The distance above the top that has a column; inf where none has."""
    none = ops.full_like(column, math.inf)
    dense = density > 1e-30
    q = column * slope / ops.maximum(falloff * density, 1e-30)
    flat = column / ops.maximum(density, 1e-30) * (1.0 + 0.5 * q + q * q * (1.0 / 3.0))
    turn = ops.where(ops.absolute(slope) > 1e-12, slope, 1e-12)
    closed = -ops.log(ops.maximum(1.0 - q, 1e-30)) * falloff / turn
    found = ops.where(ops.absolute(q) < STEEP, flat, closed)
    return ops.where((falloff > 0.0) & dense & (q < 1.0), found, none)


@helper
def _density_at(height: Lane, top: Lane, falloff: Lane) -> Lane:
    over = ops.where(top < math.inf, height - top, -1.0)
    fallen = ops.exp(ops.maximum(-over / ops.maximum(falloff, 1e-30), -80.0))
    return ops.where(over <= 0.0, ops.full_like(height, 1.0), ops.where(falloff > 0.0, fallen, 0.0))


@helper
def _lengths(height: Lane, slope: Lane, top: Lane) -> tuple[Lane, Lane]:
    """(whether a ray begins below the top, distance at which it crosses it; inf: never)."""
    below = height <= ops.where(top < math.inf, top, height)
    turn = ops.where(ops.absolute(slope) > 1e-12, slope, 1e-12)
    cross = (ops.where(top < math.inf, top, 0.0) - height) / turn
    crosses = (top < math.inf) & (ops.absolute(slope) > 1e-12) & ((slope > 0.0) == below)
    return below, ops.where(crosses, ops.maximum(cross, 0.0), ops.full_like(height, math.inf))


@helper
def column(height: Lane, slope: Lane, top: Lane, falloff: Lane, distance: Lane) -> Lane:
    """The column over a distance from a height y, in metres of density 1."""
    if ops.not_(ops.any_lane(top < math.inf)):
        return distance
    below, cross = _lengths(height, slope, top)
    first = ops.minimum(distance, cross)
    rest = ops.where(distance > cross, distance - ops.where(cross < math.inf, cross, 0.0), 0.0)
    start = _density_at(height, top, falloff)
    under = ops.where(below, first, rest)
    over = ops.where(below, rest, first)
    return under + ops.where(over > 0.0, _above(ops.where(below, ops.full_like(start, 1.0), start), slope, falloff, over), 0.0)


@helper
def distance_of(height: Lane, slope: Lane, top: Lane, falloff: Lane, wanted: Lane) -> Lane:
    """The distance whose column is `wanted`; inf where the whole ray has less."""
    if ops.not_(ops.any_lane(top < math.inf)):
        return wanted
    below, cross = _lengths(height, slope, top)
    start = _density_at(height, top, falloff)
    none = ops.full_like(height, math.inf)
    finite = ops.where(cross < math.inf, cross, 0.0)
    beyond = cross + _above_inverse(ops.full_like(start, 1.0), slope, falloff, wanted - finite)
    up = ops.where(wanted <= cross, wanted, beyond)
    before = ops.where(cross < math.inf, _above(start, slope, falloff, finite), none)
    under = cross + (wanted - ops.where(before < math.inf, before, 0.0))
    down = ops.where(wanted <= before, _above_inverse(start, slope, falloff, wanted), under)
    return ops.where(below, up, down)


@helper
def density_at(height: Lane, top: Lane, falloff: Lane) -> Lane:
    """The density at a height y."""
    return _density_at(height, top, falloff)
