"""Interval bounds of derivatives over boxes, and of the growth of rounding errors, by the chain rule.

Mitchell, "Robust Ray Intersection with Interval Arithmetic", Graphics Interface 1990.
"""

from __future__ import annotations

from typing import Any

from .interval_arithmetic import (
    OVERFLOW,
    Interval,
    add,
    down,
    either,
    endless,
    high_of,
    low_of,
    magnitude,
    multiply,
    negate,
    outward,
    reciprocal,
    subtract,
    up,
)
from .interval_semantics import NOISE_CURVE, branch_choices, choices, interval, log, middles, periods, select_operands
from .opcodes import LEAST_COSINE, Op
from .point_semantics import Number, arc, hypotenuse, noise


def slope_intervals(m: Any, op: int, boxes: list[Interval], value: Interval, turns: list[list[Interval]]) -> list[Interval]:
    """Bounds of derivatives of an operation along several directions; ±`m.most` where the operation may jump.

    `turns` holds, for each operand, bounds of its derivatives along them.
    """
    ways = range(len(turns[0]))
    a = boxes[0]
    match op:
        case Op.COPY:
            return turns[0]
        case Op.ADD:
            return [add(m, turns[0][k], turns[1][k]) for k in ways]
        case Op.SUBTRACT:
            return [subtract(m, turns[0][k], turns[1][k]) for k in ways]
        case Op.NEGATE:
            return [negate(d) for d in turns[0]]
        case Op.MIN | Op.MAX:
            return [either(m, *select_operands(choices(m, op, a, boxes[1]), turns[0][k], turns[1][k])) for k in ways]
        case Op.CHOOSE:
            first, second = branch_choices(m, a)
            found = [either(m, first, turns[1][k], second, turns[2][k]) for k in ways]
            return [_unless(m, first | second, d) for d in found]
        case Op.FLOOR | Op.CEIL | Op.SIGN:
            still = value[0] == value[1]
            return [_unless(m, still, (0.0 * d[0], 0.0 * d[0])) for d in turns[0]]
        case Op.MOD:
            begin, end = periods(m, a, boxes[1])
            found = [subtract(m, turns[0][k], multiply(m, turns[1][k], (begin, begin))) for k in ways]
            return [_unless(m, begin == end, d) for d in found]
    partial = _partials(m, op, boxes, value)
    return [_sum(m, [multiply(m, p, turns[n][k]) for n, p in enumerate(partial)]) for k in ways]


def spread(m: Any, op: int, boxes: list[Interval], value: Interval, off: list[Number]) -> Number:
    """The largest change of a result when the operands change by `off` at most.

    Equal, bit for bit, to slope_intervals of the derivatives −off … off, where none is infinite.
    """
    match op:
        case Op.COPY | Op.NEGATE:
            return off[0]
        case Op.ADD | Op.SUBTRACT:
            return _spread_sum(m, off)
        case Op.MIN | Op.MAX:
            first, second = choices(m, op, boxes[0], boxes[1])
            return m.where(first, off[0], m.where(second, off[1], high_of(m, *off)))
        case Op.CHOOSE | Op.FLOOR | Op.CEIL | Op.SIGN | Op.MOD:
            ((least, most),) = slope_intervals(m, op, boxes, value, [[(-e, e)] for e in off])
            return high_of(m, abs(least), abs(most))
    parts = []
    for size, e in zip((high_of(m, abs(low), abs(high)) for low, high in _partials(m, op, boxes, value)), off, strict=True):
        part = e * size
        m.unbounded(part > m.big)
        part = m.where(part > m.most, m.most, part)
        rounded = up(m, part) if m.lost else part + part * (1.25 * m.unit)
        parts.append(rounded if m.lost else endless(m, (size > OVERFLOW * m.most) | (e > OVERFLOW * m.most), (rounded, rounded))[1])
    return _spread_sum(m, parts)


def _spread_sum(m: Any, parts: list[Number]) -> Number:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
        total = total + total * (1.25 * m.unit)
    return total


def _sum(m: Any, parts: list[Interval]) -> Interval:
    total = parts[0]
    for part in parts[1:]:
        total = add(m, total, part)
    return total


def _unless(m: Any, smooth: Number, slope: Interval) -> Interval:
    """A derivative; ±`m.most` where the operation may jump."""
    m.unbounded(~smooth)
    return m.where(smooth, slope[0], -m.most + 0.0 * slope[0]), m.where(smooth, slope[1], m.most + 0.0 * slope[1])


def _partials(m: Any, op: int, boxes: list[Interval], value: Interval) -> list[Interval]:
    """Bounds of an operation's partial derivatives by its operands."""
    a = boxes[0]
    one = 1.0 + 0.0 * a[0]
    match op:
        case Op.MULTIPLY:
            return [boxes[1], a]
        case Op.DIVIDE:
            inverse = reciprocal(m, boxes[1])
            return [inverse, multiply(m, negate(value), inverse)]
        case Op.ABS:
            positive, negative = a[0] > 0.0, a[1] < 0.0
            return [(m.where(positive, one, -one), m.where(negative, -one, one))]
        case Op.SQUARE:
            return [(a[0] + a[0], a[1] + a[1])]
        case Op.CUBE:
            low, high = interval(m, Op.SQUARE, a)
            return [outward(m, 3.0 * low, 3.0 * high)]
        case Op.SQRT:
            found = reciprocal(m, value)
            return [(0.5 * found[0], 0.5 * found[1])]
        case Op.HYPOT:
            inverse = reciprocal(m, value, report=False)
            return [_within_one(m, multiply(m, p, inverse), one) for p in boxes]
        case Op.EXP:
            return [value]
        case Op.LOG:
            return [reciprocal(m, a)]
        case Op.POWER:
            return _power_partials(m, boxes, value)
        case Op.ATAN2 | Op.ANGLE:
            return _angle_partials(m, op, boxes)
        case Op.ARC:
            return _arc_partials(m, boxes, value)
        case Op.QUARTER_ARC:
            return _quarter_arc_partials(m, boxes)
        case Op.NOISE:
            middle, half = middles(m, boxes)
            reach = NOISE_CURVE * (half[0] + half[1] + half[2]) + 64.0 * m.unit
            return [(way - reach, way + reach) for way in noise(m, *middle)[1:]]
    return [_trigonometric_derivative(m, op, a, value)]


def _trigonometric_derivative(m: Any, op: int, a: Interval, value: Interval) -> Interval:
    one = 1.0 + 0.0 * a[0]
    match op:
        case Op.SIN:
            return interval(m, Op.COS, a)
        case Op.COS:
            return negate(interval(m, Op.SIN, a))
        case Op.TAN:
            smooth = (value[0] > -m.big) & (value[1] < m.big)  # it falls from ∞ to −∞ over a pole, and increases elsewhere
            return _unless(m, smooth, add(m, (one, one), interval(m, Op.SQUARE, value)))
        case Op.ATAN:
            return reciprocal(m, add(m, (one, one), interval(m, Op.SQUARE, a)))
        case Op.ASIN | Op.ACOS:
            x, y = (m.where(p < -1.0, -one, m.where(p > 1.0, one, p)) for p in a)
            rest = subtract(m, (one, one), interval(m, Op.SQUARE, (x, y)))
            zero = 0.0 * one
            root = m.sqrt(high_of(m, rest[0], zero)), m.sqrt(high_of(m, rest[1], zero))
            found = reciprocal(m, (high_of(m, down(m, root[0]), zero), up(m, root[1])))
            return found if op == Op.ASIN else negate(found)
    raise ValueError(op)


def _power_partials(m: Any, boxes: list[Interval], value: Interval) -> list[Interval]:
    a = boxes[0]
    one = 1.0 + 0.0 * a[0]
    smooth = (a[0] > 0.0) | ((a[1] < 0.0) & (boxes[1][0] == boxes[1][1]))
    by_base = multiply(m, boxes[1], multiply(m, value, reciprocal(m, (m.where(smooth, a[0], one), m.where(smooth, a[1], one)))))
    safe = (m.where(a[0] > 0.0, a[0], one), m.where(a[0] > 0.0, a[1], one))
    by_exponent = multiply(m, value, log(m, Op.LOG, safe))
    return [_unless(m, smooth, by_base), _unless(m, a[0] > 0.0, by_exponent)]


def _angle_partials(m: Any, op: int, boxes: list[Interval]) -> list[Interval]:
    y, x = boxes
    inverse = reciprocal(m, add(m, interval(m, Op.SQUARE, y), interval(m, Op.SQUARE, x)))
    found = [multiply(m, x, inverse), multiply(m, negate(y), inverse)]
    jumps = (y[0] <= 0.0) & (y[1] >= 0.0) & (x[0] <= 0.0) & (x[1] >= 0.0)  # at the origin, also in a flat box
    if op == Op.ATAN2:
        jumps = jumps | ((y[0] < 0.0) & (y[1] >= 0.0) & (x[0] < 0.0))
    return [_unless(m, ~jumps, p) for p in found]


def _arc_partials(m: Any, boxes: list[Interval], value: Interval) -> list[Interval]:
    """By a and b: their factors λ and μ in the shortest vector λ n + μ m; by the cosine c: −λ μ times its length.

    λ grows with a. Over b it rises up to b = 0 and falls from there on. Of one cosine, corners bound it; of several, intervals do.
    """
    a, b, c = boxes
    zero = 0.0 * a[0]
    one = zero + 1.0
    cosines = m.clipped(c[0], LEAST_COSINE, 1.0), m.clipped(c[1], LEAST_COSINE, 1.0)
    small, large = magnitude(m, cosines)
    squares = high_of(m, one - large * large, zero) * (1.0 - 4.0 * m.unit), one - small * small + 4.0 * m.unit
    most = m.where(cosines[0] < 0.0, 2.0 * one, one)
    inverse = reciprocal(m, multiply(m, squares, value), report=False)

    def share(mine: Interval, other: Interval, only: Number, never: Number) -> Interval:
        middle = high_of(m, low_of(m, zero, other[1]), other[0])
        lows = [_arc_share(m, mine[0], end, cosines[0], first=False) for end in other]
        low = m.where(mine[0] > m.tiny, low_of(m, *lows) * (1.0 - 16.0 * m.unit), zero)
        high = m.where(mine[1] > m.tiny, _arc_share(m, mine[1], middle, cosines[0], first=True) * (1.0 + 16.0 * m.unit), most)
        wide = multiply(m, subtract(m, mine, multiply(m, cosines, other)), inverse)
        alone = other[0] <= high_of(m, *multiply(m, cosines, mine))
        unused = mine[0] <= high_of(m, *multiply(m, cosines, other))
        wide = m.where(unused, zero, wide[0]), m.where(alone, high_of(m, wide[1], one), wide[1])
        wide = m.where(alone, low_of(m, wide[0], one), wide[0]), m.where(wide[1] == wide[1], wide[1], most)
        single = c[0] == c[1]
        low, high = m.where(single, low, wide[0]), m.where(single, high, wide[1])
        low, high = m.where(only, one, low), m.where(never, zero, high)
        return m.where((low > zero) & ~never, low, zero), m.where((high < most) | only, m.where(only, one, high), most)

    first, second = choices(m, Op.ARC, a, b, c)
    by_a, by_b = share(a, b, first, second), share(b, a, second, first)
    length = high_of(m, value[0], zero), high_of(m, value[1], zero)
    low, high = multiply(m, multiply(m, by_a, by_b), length)
    free = (c[0] > LEAST_COSINE) & (c[1] < 1.0)
    return [by_a, by_b, (-high, m.where(free, -low, zero))]


def _quarter_arc_partials(m: Any, boxes: list[Interval]) -> list[Interval]:
    """a⁺ / √(a⁺² + b⁺²), which rises with a and falls with b⁺, and the same of b; of two negative operands, the larger one's is 1."""
    a, b = boxes
    zero = 0.0 * a[0]
    one = zero + 1.0

    def share(mine: Interval, other: Interval, only: Number, never: Number) -> Interval:
        lows, highs = ((end, m.where(across > zero, across, zero)) for end, across in zip(mine, other[::-1], strict=True))
        low = m.where(lows[0] > m.tiny, lows[0] / hypotenuse(m, *lows) * (1.0 - 16.0 * m.unit), zero)
        high = m.where(highs[0] > m.tiny, highs[0] / hypotenuse(m, *highs) * (1.0 + 16.0 * m.unit), one)
        low, high = m.where((low > zero) & ~never, low, zero), m.where(never, zero, m.where(high < one, high, one))
        return m.where(only, one, low), m.where(only, one, high)

    first, second = choices(m, Op.QUARTER_ARC, a, b)
    return [share(a, b, first, second), share(b, a, second, first)]


def _arc_share(m: Any, a: Number, b: Number, cosine: Number, first: bool) -> Number:
    """The derivative of ARC by its first operand; `first` says whether of equal operands that one counts."""
    within, leads, large, part, (cosine, sine) = arc(m, a, b, cosine)
    length = hypotenuse(m, large, part)
    length = m.where(length > m.tiny, length, m.tiny + 0.0 * length)
    found = m.where(leads, (large - cosine * part / sine) / length, part / (sine * length))
    alone = (a >= b) if first else (a > b)
    return m.where(within, found, m.where(alone, 1.0 + 0.0 * found, 0.0 * found))


def _within_one(m: Any, a: Interval, one: Number) -> Interval:
    return m.where(a[0] > -one, a[0], -one), m.where(a[1] < one, a[1], one)
