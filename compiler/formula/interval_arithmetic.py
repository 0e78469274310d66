"""Interval arithmetic, rounded outward: one source for numpy and LLVM vectors.

Intervals are pairs (low, high): each bound moves by more than its operation's error. NaN twice is an interval where nothing is defined.
`m.undefined(mask)` records where an operation may be undefined in a part of the box. Numbers beyond `m.big` are not distinguished: lower
bounds saturate there, upper bounds at `m.most`. So no bound is infinite, and no product of bounds is undefined. The distance between the
two leaves the difference of two saturated numbers open on both sides.

With `m.forks`, an operation that jumps once over a box takes the values on one side of the jump. The lanes together cover all combinations
of sides. The value at the jump itself is left out.

Moore, Kearfott, Cloud, "Introduction to Interval Analysis", 2009.
"""

from __future__ import annotations

from typing import Any

from .point_semantics import Number

Interval = tuple[Number, Number]

OVERFLOW = 1e-5  # times `m.most`: a larger bound may stand for ∞


def down(m: Any, x: Number, ulps: int = 0) -> Number:
    """x rounded down, by more than an operation's error of `ulps`."""
    return x - (abs(x) * ((ulps + 1.25) * m.unit) + m.tiny)


def up(m: Any, x: Number, ulps: int = 0) -> Number:
    return x + (abs(x) * ((ulps + 1.25) * m.unit) + m.tiny)


def low_of(m: Any, a: Number, b: Number) -> Number:
    return m.where(a < b, a, b)


def high_of(m: Any, a: Number, b: Number) -> Number:
    return m.where(a > b, a, b)


def saturate(m: Any, low: Number, high: Number) -> Interval:
    """Saturate bounds (see above); NaN stays."""
    if m.tells:
        m.unbounded(is_saturated(m, (low, high)))
    return m.clipped(low, -m.most, m.big), m.clipped(high, -m.big, m.most)


def is_saturated(m: Any, a: Interval) -> Number:
    """Whether a bound is saturated."""
    return (a[0] < -m.big) | (a[1] > m.big)


def add(m: Any, a: Interval, b: Interval) -> Interval:
    return outward(m, a[0] + b[0], a[1] + b[1])


def subtract(m: Any, a: Interval, b: Interval) -> Interval:
    return outward(m, a[0] - b[1], a[1] - b[0])


def outward(m: Any, low: Number, high: Number) -> Interval:
    """Bounds of a sum or product, rounded outward by a relative error, so that 0 stays 0: small sums are exact.

    A product may underflow at points, too; `m.lost` says where it does not, and needs an absolute margin.
    """
    return low - abs(low) * (1.25 * m.unit), high + abs(high) * (1.25 * m.unit)


def multiply(m: Any, a: Interval, b: Interval) -> Interval:
    p, q, r, s = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    low, high = m.least(m.least(p, q), m.least(r, s)), m.largest(m.largest(p, q), m.largest(r, s))
    low, high = saturate(m, low, high)  # before rounding: ∞ cannot be rounded down
    return (down(m, low), up(m, high)) if m.lost else endless(m, _may_be_infinite(m, a) | _may_be_infinite(m, b), outward(m, low, high))


def _may_be_infinite(m: Any, a: Interval) -> Number:
    """Whether a bound may stand for ∞."""
    return (a[0] < -OVERFLOW * m.most) | (a[1] > OVERFLOW * m.most)


def endless(m: Any, mask: Number, a: Interval) -> Interval:
    """Open the bounds of a product where a factor may be ∞."""
    return m.where(mask & (a[0] < 0.0), -m.most, a[0]), m.where(mask & (a[1] > 0.0), m.most, a[1])


def negate(a: Interval) -> Interval:
    return -a[1], -a[0]


def hull(m: Any, a: Interval, b: Interval) -> Interval:
    return low_of(m, a[0], b[0]), high_of(m, a[1], b[1])


def reciprocal(m: Any, a: Interval, report: bool = True) -> Interval:
    """1 / a; everything where a contains 0, which `m.unbounded` records unless the caller bounds the result itself."""
    apart = (a[0] > 0.0) | (a[1] < 0.0)
    if report:
        m.unbounded(~apart)
    low, high = down(m, 1.0 / a[1]), up(m, 1.0 / a[0])
    least, most = -m.most + 0.0 * a[0], m.most + 0.0 * a[1]
    above, below = (apart | (a[0] >= 0.0), apart | (a[1] <= 0.0)) if m.forks else (apart, apart)
    whole = m.where(above, low, least), m.where(below, high, most)
    if m.forks:  # a pole inside the box, or a box at the pole, whose sides are both infinities
        on = (a[0] == 0.0) & (a[1] == 0.0)
        before, behind = (least, m.where(on, least, high)), (m.where(on, most, low), most)
        whole = one_side(m, on | ((a[0] < 0.0) & (a[1] > 0.0)), before, behind, whole)
    low, high = whole
    return where_defined(m, a, saturate(m, m.where(low == low, low, -m.most), m.where(high == high, high, m.most)))


def magnitude(m: Any, a: Interval) -> Interval:
    """|a|."""
    return m.largest(m.largest(a[0], -a[1]), 0.0 * a[0]), m.largest(-a[0], a[1])


def where_defined(m: Any, a: Interval, result: Interval) -> Interval:
    """A result, NaN where its operand is."""
    bad = a[0] != a[0]
    return m.where(bad, a[0], result[0]), m.where(bad, a[0], result[1])


def either(m: Any, first: Number, a: Interval, second: Number, b: Interval) -> Interval:
    """`a` where `first`, `b` where `second`, else their hull."""
    whole = hull(m, a, b)
    low = m.where(first, a[0], m.where(second, b[0], whole[0]))
    return low, m.where(first, a[1], m.where(second, b[1], whole[1]))


def one_side(m: Any, jumps: Number, one: Interval, other: Interval, whole: Interval) -> Interval:
    """`whole`; where the operation jumps and `m` forks, one of its two sides."""
    if not m.forks:
        return whole
    second = m.fork(jumps)
    sides = [m.where(second, other[k], one[k]) for k in range(2)]
    return m.where(jumps, sides[0], whole[0]), m.where(jumps, sides[1], whole[1])


def everything(m: Any, like: Interval) -> Interval:
    nothing = m.where(like[0] == like[0], 0.0 * like[0], like[0])
    return nothing - m.most, nothing + m.most
