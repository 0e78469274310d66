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
LEVEL = 1e-7  # slopes below which a ray is level


@helper
def _fallen(over: Lane, falloff: Lane) -> Lane:
    """The density at a height `over` the top, not below it."""
    share = ops.exp(ops.maximum(-over / ops.maximum(falloff, 1e-30), -80.0))
    return ops.where(falloff > 0.0, share, 0.0)


@helper
def _above(over: Lane, slope: Lane, falloff: Lane, distance: Lane) -> Lane:
    """The column over a distance from a height `over` the top, along a ray that stays above it; `slope` is the height gained per metre."""
    none = ops.full_like(over, math.inf)
    finite = distance < math.inf
    length = ops.where(finite, distance, 0.0)
    gained = slope * length
    start = _fallen(over, falloff)
    end = ops.where(finite, _fallen(ops.maximum(over + gained, 0.0), falloff), 0.0)
    x = gained / ops.maximum(falloff, 1e-30)
    flat = ops.where(finite, start * length * (1.0 - 0.5 * x + x * x * (1.0 / 6.0)), ops.where(start > 0.0, none, 0.0))
    turns = ops.absolute(slope) > LEVEL
    closed = (start - end) * falloff / ops.where(turns, slope, 1.0)
    return ops.where(falloff > 0.0, ops.where(turns & ops.not_(finite & (ops.absolute(x) < STEEP)), closed, flat), 0.0)


@helper
def _above_inverse(over: Lane, slope: Lane, falloff: Lane, column: Lane) -> Lane:
    """The distance that has a column, from a height `over` the top along a ray that stays above it; inf where none has."""
    none = ops.full_like(column, math.inf)
    start = _fallen(over, falloff)
    change = column * slope / ops.maximum(falloff, 1e-30)
    end = start - change
    q = change / ops.maximum(start, 1e-30)
    flat = column / ops.maximum(start, 1e-30) * (1.0 + 0.5 * q + q * q * (1.0 / 3.0))
    turns = ops.absolute(slope) > LEVEL
    closed = (-falloff * ops.log(ops.maximum(end, 1e-30)) - over) / ops.where(turns, slope, 1.0)
    level = ops.not_(turns) | ((ops.absolute(q) < STEEP) & (start > 1e-30))
    distance = ops.where(level, ops.where(start > 1e-30, flat, none), closed)
    return ops.where((falloff > 0.0) & (end > 1e-30), ops.maximum(distance, 0.0), none)


@helper
def _lengths(height: Lane, slope: Lane, top: Lane) -> tuple[Lane, Lane]:
    """(whether a ray begins below the top, distance at which it crosses it; inf: never)."""
    below = height <= ops.where(top < math.inf, top, height)
    turn = ops.where(ops.absolute(slope) > LEVEL, slope, LEVEL)
    cross = (ops.where(top < math.inf, top, 0.0) - height) / turn
    crosses = (top < math.inf) & (ops.absolute(slope) > LEVEL) & ((slope > 0.0) == below)
    return below, ops.where(crosses, ops.maximum(cross, 0.0), ops.full_like(height, math.inf))


@helper
def column(height: Lane, slope: Lane, top: Lane, falloff: Lane, distance: Lane) -> Lane:
    """The column over a distance from a height y, in metres of density 1."""
    if ops.not_(ops.any_lane(top < math.inf)):
        return distance
    below, cross = _lengths(height, slope, top)
    first = ops.minimum(distance, cross)
    beyond = ops.where(distance > cross, distance - ops.where(cross < math.inf, cross, 0.0), 0.0)
    under, over = ops.where(below, first, beyond), ops.where(below, beyond, first)
    start = ops.where(below, 0.0, height - top)
    return under + ops.where(over > 0.0, _above(start, slope, falloff, over), 0.0)


@helper
def distance_of(height: Lane, slope: Lane, top: Lane, falloff: Lane, target: Lane) -> Lane:
    """The distance whose column is `target`; inf where the whole ray has less."""
    if ops.not_(ops.any_lane(top < math.inf)):
        return target
    below, cross = _lengths(height, slope, top)
    crosses = cross < math.inf
    finite = ops.where(crosses, cross, 0.0)
    zero = 0.0 * height
    up = ops.where(target <= cross, target, finite + _above_inverse(zero, slope, falloff, ops.maximum(target - finite, 0.0)))
    over = ops.where(below, zero, height - top)
    before = ops.where(crosses, _above(over, slope, falloff, finite), ops.full_like(height, math.inf))
    under = finite + (target - ops.where(crosses, before, 0.0))
    down = ops.where(target <= before, _above_inverse(over, slope, falloff, target), under)
    return ops.where(below, up, down)


@helper
def density_at(height: Lane, top: Lane, falloff: Lane) -> Lane:
    """The density at a height y."""
    over = ops.where(top < math.inf, height - top, -1.0)
    return ops.where(over <= 0.0, ops.full_like(height, 1.0), _fallen(ops.maximum(over, 0.0), falloff))
