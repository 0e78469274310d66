"""Bounds of what the operations of tapes give over boxes of points: one source for numpy and for LLVM vectors. Of slopes: slopes.py.

Intervals are pairs (low, high), rounded outward: each bound moves by more than its operation's error. Not-a-number twice is an interval
in which nothing is defined. Where a part of it may be undefined, `m.undefined(mask)` is told. Numbers beyond `m.big` are not told
apart: a lower bound stops there, and an upper one at `m.most`, so that none is infinite and no product of bounds is undefined. That these
two are far from each other keeps the difference of two such numbers open on both sides.

A mathematics that forks (`m.forks`) goes, where an operation jumps once over a box, one of two ways: as if it had only the values on one
side of the jump. All lanes together go all ways. What is left out is what an operation may be at the jump alone.

Moore, Kearfott, Cloud, "Introduction to Interval Analysis", 2009.
"""

from __future__ import annotations

import math
from typing import Any

from .opcodes import Op
from .point_semantics import Number, hypotenuse, noise, point

Interval = tuple[Number, Number]

ULPS = 4  # by which the elementary functions may be off, with room (docs/simd.md)
LEAST = 2.3e-308  # no number is closer to 0 and keeps its digits
LEAST_LOG = -746.0  # of numbers above 0
OVERFLOW = 1e-5  # times the most that bounds tell: what is beyond may stand for ∞, or for what is left of it
NOISE_BOUND = 1.5  # of |noise|
NOISE_CURVE = 24.0  # of its second derivatives: fade″ ≤ 5.8, fade′ ≤ 1.9, differences of corners ≤ 4


def down(m: Any, x: Number, ulps: int = 0) -> Number:
    """A little less, by more than an operation's error."""
    return x - (abs(x) * ((ulps + 1.25) * m.unit) + m.tiny)


def up(m: Any, x: Number, ulps: int = 0) -> Number:
    return x + (abs(x) * ((ulps + 1.25) * m.unit) + m.tiny)


def low_of(m: Any, a: Number, b: Number) -> Number:
    return m.where(a < b, a, b)


def high_of(m: Any, a: Number, b: Number) -> Number:
    return m.where(a > b, a, b)


def _bounded(m: Any, low: Number, high: Number) -> Interval:
    """Within ±`m.most`, and of what lies beyond `m.big` altogether that alone; not-a-number stays."""
    if m.tells:
        m.unbounded(_large(m, (low, high)))
    return m.clipped(low, -m.most, m.big), m.clipped(high, -m.big, m.most)


def _large(m: Any, a: Interval) -> Number:
    """Whether a number may be larger than floating point can tell."""
    return (a[0] < -m.big) | (a[1] > m.big)


def add(m: Any, a: Interval, b: Interval) -> Interval:
    return outward(m, a[0] + b[0], a[1] + b[1])


def subtract(m: Any, a: Interval, b: Interval) -> Interval:
    return outward(m, a[0] - b[1], a[1] - b[0])


def outward(m: Any, low: Number, high: Number) -> Interval:
    """Sums rounded outward: 0 stays 0, since small sums are exact. So what holds no negative numbers does not begin to; nor does a product
    with 0, if what products lose when they are too small for floating point is lost at points, too (`m.lost`: where it is not)."""
    return low - abs(low) * (1.25 * m.unit), high + abs(high) * (1.25 * m.unit)


def multiply(m: Any, a: Interval, b: Interval) -> Interval:
    p, q, r, s = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    low, high = m.least(m.least(p, q), m.least(r, s)), m.largest(m.largest(p, q), m.largest(r, s))
    low, high = _bounded(m, low, high)  # first: there is nothing below ∞
    return (down(m, low), up(m, high)) if m.lost else endless(m, _overflown(m, a) | _overflown(m, b), outward(m, low, high))


def _overflown(m: Any, a: Interval) -> Number:
    """Whether a number may be ∞."""
    return (a[0] < -OVERFLOW * m.most) | (a[1] > OVERFLOW * m.most)


def endless(m: Any, mask: Number, a: Interval) -> Interval:
    """Where something may be ∞, so may what small numbers make of it."""
    return m.where(mask & (a[0] < 0.0), -m.most, a[0]), m.where(mask & (a[1] > 0.0), m.most, a[1])


def negate(a: Interval) -> Interval:
    return -a[1], -a[0]


def hull(m: Any, a: Interval, b: Interval) -> Interval:
    return low_of(m, a[0], b[0]), high_of(m, a[1], b[1])


def reciprocal(m: Any, a: Interval, told: bool = True) -> Interval:
    """1 / a; everything where a holds 0. Unless what it is used for is bounded by itself, `m` is told."""
    apart = (a[0] > 0.0) | (a[1] < 0.0)
    if told:
        m.unbounded(~apart)
    low, high = down(m, 1.0 / a[1]), up(m, 1.0 / a[0])
    least, most = -m.most + 0.0 * a[0], m.most + 0.0 * a[1]
    above, below = (apart | (a[0] >= 0.0), apart | (a[1] <= 0.0)) if m.forks else (apart, apart)
    whole = m.where(above, low, least), m.where(below, high, most)
    if m.forks:  # over the pole, and at it: a place alone has both infinities for its sides
        on = (a[0] == 0.0) & (a[1] == 0.0)
        before, behind = (least, m.where(on, least, high)), (m.where(on, most, low), most)
        whole = one_side(m, on | ((a[0] < 0.0) & (a[1] > 0.0)), before, behind, whole)
    low, high = whole
    return _defined(m, a, _bounded(m, m.where(low == low, low, -m.most), m.where(high == high, high, m.most)))


def _quotient(m: Any, a: Interval, b: Interval) -> Interval:
    """a / b; next to a pole without end, however small a is."""
    if not m.forks:  # ∞ itself has no sine, and none is left of ∞ − ∞
        m.undefined((b[0] <= 0.0) & (b[1] >= 0.0))
    m.undefined(_large(m, a) & _large(m, b))  # nor of ∞ / ∞
    return multiply(m, a, reciprocal(m, b))


def magnitude(m: Any, a: Interval) -> Interval:
    """|a|."""
    return m.largest(m.largest(a[0], -a[1]), 0.0 * a[0]), m.largest(-a[0], a[1])


def _defined(m: Any, a: Interval, result: Interval) -> Interval:
    """A result, undefined where its operand is."""
    bad = a[0] != a[0]
    return m.where(bad, a[0], result[0]), m.where(bad, a[0], result[1])


def either(m: Any, first: Number, a: Interval, second: Number, b: Interval) -> Interval:
    """`a` where `first`, `b` where `second`, else what holds both."""
    whole = hull(m, a, b)
    low = m.where(first, a[0], m.where(second, b[0], whole[0]))
    return low, m.where(first, a[1], m.where(second, b[1], whole[1]))


def one_side(m: Any, jumps: Number, one: Interval, other: Interval, whole: Interval) -> Interval:
    """What an operation gives: where it jumps, one of its two sides in a mathematics that forks, else `whole`."""
    if not m.forks:
        return whole
    second = m.fork(jumps)
    sides = [m.where(second, other[k], one[k]) for k in range(2)]
    return m.where(jumps, sides[0], whole[0]), m.where(jumps, sides[1], whole[1])


def everything(m: Any, like: Interval) -> Interval:
    nothing = m.where(like[0] == like[0], 0.0 * like[0], like[0])
    return nothing - m.most, nothing + m.most


def choices(m: Any, op: int, a: Interval, b: Interval, c: Any = None) -> tuple[Number, Number]:
    """Where a choice is known: (only the first operand matters, only the second); for CHOOSE, whose operands `a` and `b` choose between,
    see `chosen`."""
    if op == Op.FILLET:
        return ((a[1] < b[0]) & (b[0] >= c[1])) | (b[0] != b[0]), ((b[1] < a[0]) & (a[0] >= c[1])) | (a[0] != a[0])
    if op == Op.MIN:
        return (a[1] < b[0]) | (b[0] != b[0]), (b[1] < a[0]) | (a[0] != a[0])
    return (a[0] > b[1]) | (a[0] != a[0]), (b[0] > a[1]) | (b[0] != b[0])


def chosen(m: Any, a: Interval) -> tuple[Number, Number]:
    """Where CHOOSE is known to take its first way, or its second, by what it asks."""
    return a[1] <= 0.0, (a[0] > 0.0) | (a[0] != a[0])


def interval(m: Any, op: int, a: Interval, b: Any = None, c: Any = None) -> Interval:
    """Bounds of an operation over intervals."""
    match op:
        case Op.COPY:
            return a
        case Op.ADD:
            return add(m, a, b)
        case Op.SUBTRACT:
            return subtract(m, a, b)
        case Op.MULTIPLY:
            return multiply(m, a, b)
        case Op.DIVIDE:
            return _quotient(m, a, b)
        case Op.NEGATE:
            return negate(a)
        case Op.ABS:
            return magnitude(m, a)
        case Op.SQUARE:
            low, high = magnitude(m, a)
            low, high = low * low, high * high
            m.unbounded(high > m.big)
            low, high = m.least(m.big, low), m.least(m.most, high)
            return (high_of(m, down(m, low), 0.0 * low), up(m, high)) if m.lost else outward(m, low, high)
        case Op.CUBE:
            low, high = _bounded(m, a[0] * a[0] * a[0], a[1] * a[1] * a[1])
            return (down(m, low, 1), up(m, high, 1)) if m.lost else (low - abs(low) * (2.25 * m.unit), high + abs(high) * (2.25 * m.unit))
        case Op.HYPOT:
            (la, ha), (lb, hb) = magnitude(m, a), magnitude(m, b)
            if m.lost:  # squares too small for it take no more than 2⁻⁶² from the root
                low, high = m.sqrt(la * la + lb * lb), m.sqrt(ha * ha + hb * hb)
                low, high = _bounded(m, low - 2.0**-62, high + 2.0**-62)
            else:
                low, high = _bounded(m, hypotenuse(m, la, lb), hypotenuse(m, ha, hb))
            return high_of(m, down(m, low, 2), 0.0 * low), up(m, high, 2)
        case Op.MIN:
            low = m.where(b[0] != b[0], a[0], low_of(m, a[0], b[0]))
            high = m.where(b[1] != b[1], a[1], low_of(m, a[1], b[1]))
            unsure = m.was_undefined(low)  # where one is undefined, the other counts
            return low, m.where(unsure, high_of(m, a[1], m.where(b[1] != b[1], a[1], b[1])), high)
        case Op.MAX:
            bad = m.where(a[0] != a[0], a[0], b[0])
            bad_too = bad != bad
            return m.where(bad_too, bad, high_of(m, a[0], b[0])), m.where(bad_too, bad, high_of(m, a[1], b[1]))
        case Op.EXP:
            low, high = _bounded(m, m.exp(a[0]), m.exp(a[1]))
            return high_of(m, down(m, low, ULPS), 0.0 * a[0]), up(m, high, ULPS)
        case Op.FLOOR | Op.CEIL | Op.SIGN:
            low, high = (point(m, op, bound) for bound in a)
            once = high == low + 1.0 if op != Op.SIGN else low < high
            if op == Op.SIGN and m.forks:  # which is 0 at a place alone
                low, high = m.where(once, -1.0 + 0.0 * low, low), m.where(once, 1.0 + 0.0 * high, high)
            return one_side(m, once, (low, low), (high, high), (low, high))
        case Op.ATAN:
            return down(m, m.atan(a[0]), ULPS), up(m, m.atan(a[1]), ULPS)
        case Op.CHOOSE:
            first, second = chosen(m, a)
            no_b, no_c = b[0] != b[0], c[0] != c[0]
            if not m.forks:  # where the other way is gone, nothing is defined
                m.undefined(~(first | second) & (no_b | no_c))
            whole = either(m, first | (no_c & ~second), b, second | (no_b & ~first), c)
            return one_side(m, ~(first | second), b, c, whole)
        case Op.FILLET:
            slack = fillet_slack(m, a, b, c)  # it rises with a and b, and falls with the radius
            no_a, no_b = a[0] != a[0], b[0] != b[0]
            low, high = point(m, op, a[0], b[0], c[1]) - slack, point(m, op, a[1], b[1], c[0]) + slack
            low, high = (low, high) if m.lost else _bounded(m, low, high)
            low, high = m.where(no_b, a[0], m.where(no_a, b[0], low)), m.where(no_b, a[1], m.where(no_a, b[1], high))
            unsure = m.was_undefined(low)
            return low, m.where(unsure, high_of(m, a[1], m.where(b[1] != b[1], a[1], b[1])), high)
    return _PARTIAL[Op(op)](m, op, a, b, c)


def fillet_slack(m: Any, a: Interval, b: Interval, radius: Interval) -> Number:
    """By how much FILLET may be off: not at all away from its arc, where it is a choice."""
    p, q = radius[1] - a[0], radius[1] - b[0]
    slack = (p + q + high_of(m, abs(radius[0]), abs(radius[1]))) * (4.0 * m.unit) + m.tiny
    return m.where((p > 0.0) & (q > 0.0), slack, 0.0 * slack)


def given(known: tuple[Number, Number], a: Any, b: Any) -> tuple[Any, ...]:
    return known[0], a, known[1], b


def _sqrt(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    low = high_of(m, down(m, m.sqrt(high_of(m, a[0], 0.0 * a[0]))), 0.0 * a[0])
    return _outside(m, a, a[0] < 0.0, a[1] < 0.0, (low, m.where(a[1] > m.big, m.most, up(m, m.sqrt(a[1])))))  # of ∞, too


def log(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    m.unbounded(a[0] <= m.tiny)
    least = m.tiny + 0.0 * a[0]
    positive_low, positive_high = m.where(a[0] > m.tiny, a[0], least), m.where(a[1] > m.tiny, a[1], least)
    low = m.where(a[0] > m.tiny, down(m, m.log(positive_low), ULPS), LEAST_LOG if m.forks else -m.most)  # 0 is met at a place alone
    return _outside(m, a, a[0] < 0.0, a[1] < 0.0, (low, m.where(a[1] > m.big, m.most, up(m, m.log(positive_high), ULPS))))


def _outside(m: Any, a: Interval, partly: Number, never: Number, found: Interval) -> Interval:
    """Undefined where `never`, and where the operand is; in a part of the box where `partly`. Only of that is there any doubt."""
    nan = math.nan + 0.0 * a[0]
    if not m.forks:
        m.undefined(partly & ~never)
    found = one_side(m, partly & ~never, (nan, nan), found, found)
    never = never | (a[0] != a[0])
    return m.where(never, nan, found[0]), m.where(never, nan, found[1])


def _wave(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    """Sine and cosine: the larger of the ends, or 1 where a crest lies between."""
    f = m.sin if op == Op.SIN else m.cos
    crest, trough = (0.25, 0.75) if op == Op.SIN else (0.0, 0.5)
    turn = 0.5 / math.pi
    u, v, slack = a[0] * turn, a[1] * turn, 4.0 * m.unit
    u, v = u - (abs(u) + 1.0) * slack, v + (abs(v) + 1.0) * slack
    far = (abs(u) > 0.01 / m.unit**0.5) | (abs(v) > 0.01 / m.unit**0.5)
    begin, end = f(a[0]), f(a[1])
    low, high = down(m, low_of(m, begin, end), ULPS), up(m, high_of(m, begin, end), ULPS)
    has_crest = (m.floor(v - crest) > m.floor(u - crest)) | far
    has_trough = (m.floor(v - trough) > m.floor(u - trough)) | far
    one = 1.0 + 0.0 * a[0]
    low, high = m.where(has_trough | (low < -1.0), -one, low), m.where(has_crest | (high > 1.0), one, high)
    return _defined(m, a, (low, high))


def _tan(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    u, v = a[0] / math.pi - 0.5, a[1] / math.pi - 0.5
    slack = 4.0 * m.unit
    u, v = u - (abs(u) + 1.0) * slack, v + (abs(v) + 1.0) * slack
    pole = (m.floor(v) > m.floor(u)) | (abs(u) > 0.01 / m.unit**0.5) | (abs(v) > 0.01 / m.unit**0.5)
    m.unbounded(pole)
    whole = everything(m, a)
    low, high = down(m, m.tan(a[0]), ULPS), up(m, m.tan(a[1]), ULPS)
    once = m.floor(v) == m.floor(u) + 1.0
    found = one_side(m, once, (low, whole[1]), (whole[0], high), (m.where(pole, whole[0], low), m.where(pole, whole[1], high)))
    return _defined(m, a, _bounded(m, *found))


def _arc(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    one = 1.0 + 0.0 * a[0]
    x, y = (m.where(p < -1.0, -one, m.where(p > 1.0, one, p)) for p in a)
    if op == Op.ACOS:
        x, y = y, x
    f = m.asin if op == Op.ASIN else m.acos
    return _outside(m, a, (a[0] < -1.0) | (a[1] > 1.0), (a[1] < -1.0) | (a[0] > 1.0), (down(m, f(x), ULPS), up(m, f(y), ULPS)))


def _angle(m: Any, op: int, y: Interval, x: Any, *_: Any) -> Interval:
    """The angle of a box: of its corners, unless it holds the origin, or crosses the cut of atan2; then all angles, or, where the cut does
    not matter, those from its upper edge on to its lower one. Of what is flat, y = 0 alone, it jumps from π to 0 where x does not."""
    across = (y[0] <= 0.0) & (y[1] >= 0.0)  # + 0.0 below: −0 counts as 0
    corners = [m.atan2(p + 0.0, q + 0.0) for p in y for q in x]
    low = low_of(m, low_of(m, corners[0], corners[1]), low_of(m, corners[2], corners[3]))
    high = high_of(m, high_of(m, corners[0], corners[1]), high_of(m, corners[2], corners[3]))
    turn = 2.0 * math.pi
    cut, middle = across & (x[0] < 0.0), across & (x[0] <= 0.0) & (x[1] >= 0.0)
    if op == Op.ATAN2:
        cut = cut & (y[0] < 0.0)  # on the cut itself it is π
    zero = 0.0 * low
    half = math.pi + zero
    flat = (y[0] == 0.0) & (y[1] == 0.0) & (x[0] < 0.0) & (x[1] >= 0.0)
    if op == Op.ANGLE:  # the box lies left of the origin: its upper corners, and its lower ones one turn on
        top = high_of(m, y[1], 0.0 * y[1]) + 0.0
        upper = low_of(m, m.atan2(top, x[0]), m.atan2(top, x[1]))
        lower = high_of(m, -m.atan2(-y[0], x[0]), -m.atan2(-y[0], x[1])) + turn
        low, high = m.where(cut, m.where(y[0] < 0.0, upper, low), low), m.where(cut & (y[0] < 0.0), lower, high)
        whole = m.where(middle, -half, low), m.where(middle, half, high)
        low, high = one_side(m, flat, (half, half), (zero, zero), whole)
    else:
        above, below = (low_of(m, p, q) for p, q in ((corners[2], corners[3]), (-corners[0], -corners[1])))
        whole = m.where(cut | middle, m.where(flat, zero, -half), low), m.where(cut | middle, half, high)
        one, other = (m.where(flat, half, above), half), (m.where(flat, zero, -half), m.where(flat, zero, -below))
        low, high = one_side(m, flat | (cut & (x[1] < 0.0)), one, other, whole)
    bad = m.where(x[0] == x[0], y[0], x[0])
    return _defined(m, (bad, bad), (down(m, low, ULPS), up(m, high, ULPS)))


def _mod(m: Any, op: int, a: Interval, b: Any, *_: Any) -> Interval:
    begin, end = periods(m, a, b)
    within = begin == end
    slack = (high_of(m, abs(a[0]), abs(a[1])) + high_of(m, abs(b[0]), abs(b[1]))) * (4.0 * m.unit)
    low, high = m.where(b[0] < 0.0, b[0], 0.0 * b[0]) - slack, m.where(b[1] > 0.0, b[1], 0.0 * b[1]) + slack
    times = [(b[0] * k, b[1] * k) for k in (begin, end)]
    first, last = ((a[0] - high_of(m, p, q) - slack, a[1] - low_of(m, p, q) + slack) for p, q in times)
    one, other = ((high_of(m, part[0], low), low_of(m, part[1], high)) for part in (first, last))
    whole = m.where(within, first[0], low), m.where(within, first[1], high)
    low, high = one_side(m, end == begin + 1.0, one, other, whole)
    if not m.forks:  # what b is 0 at is a place alone: tapes.Builder chooses where it stays so
        m.undefined((b[0] <= 0.0) & (b[1] >= 0.0))
    bad = m.where(b[0] == b[0], a[0], b[0])
    return _defined(m, (bad, bad), (low, high))


def periods(m: Any, a: Interval, b: Interval) -> Interval:
    """The numbers of the first and last period of b that a reaches; far apart where b may be 0."""
    corners = [p / q for p in a for q in b]
    u, v = low_of(m, low_of(m, *corners[:2]), low_of(m, *corners[2:])), high_of(m, high_of(m, *corners[:2]), high_of(m, *corners[2:]))
    # One number but for rounding, as a sum of floors is, has one period.
    alone = (b[0] == b[1]) & (a[1] - a[0] <= abs(a[0] + a[1]) * (4.0 * m.unit))
    middle = 0.5 * (u + v)
    begin, end = m.floor(m.where(alone, middle, down(m, u))), m.floor(m.where(alone, middle, up(m, v)))
    apart = (b[0] > 0.0) | (b[1] < 0.0)
    return m.where(apart, begin, 0.0 * begin), m.where(apart, end, 2.0 + 0.0 * end)


def _power(m: Any, op: int, a: Interval, b: Any, *_: Any) -> Interval:
    """For bases of at least 0 the extremes are at the corners; others have powers for whole exponents only."""
    single = b[0] == b[1]
    whole = single & (m.floor(b[0]) == b[0])
    broken = (m.floor(b[0]) == m.floor(b[1])) & (m.floor(b[0]) != b[0])
    broken = broken | ~single if m.forks else broken  # a whole number on the way is met at that place alone
    if not m.forks:
        m.undefined((a[0] < 0.0) & ~(broken | single))
    least = m.where(a[1] > 0.0, LEAST, 0.0 * a[0]) if m.forks else 0.0 * a[0]  # 0 is met at a place alone
    x, y = m.where(whole, abs(a[0]), m.where(a[0] > 0.0, a[0], least)), m.where(whole, abs(a[1]), m.where(a[1] > 0.0, a[1], 0.0 * a[1]))
    corners = [m.power(m.where(p > m.big, math.inf, p), q) for p in (x, y) for q in b]  # powers below 1 make less of what stands for ∞
    low = low_of(m, low_of(m, corners[0], corners[1]), low_of(m, corners[2], corners[3]))
    high = high_of(m, high_of(m, corners[0], corners[1]), high_of(m, corners[2], corners[3]))
    low, high = _bounded(m, low, high)
    found = high_of(m, down(m, low, ULPS), 0.0 * low), up(m, high, ULPS)
    ends = (up(m, _bounded(m, corners[k], corners[k])[1], ULPS) for k in (0, 2))
    found = either(m, ~whole | (a[0] >= 0.0), found, whole & (a[0] < 0.0), _whole_power(m, a, b[0], found, *ends))
    whole_line = everything(m, a)
    known = (a[0] >= 0.0) | broken | whole
    m.unbounded(~known)
    found = m.where(known, found[0], whole_line[0]), m.where(known, found[1], whole_line[1])
    return _outside(m, a, (a[0] < 0.0) & broken, (a[1] < 0.0) & broken, found)


def _whole_power(m: Any, a: Interval, n: Number, size: Interval, first: Number, last: Number) -> Interval:
    """Powers by one whole number n of bases some of which are below 0, by bounds of the ends' magnitudes and by each end's own."""
    over, odd, falls = a[1] > 0.0, m.floor(0.5 * n) != 0.5 * n, n < 0.0
    m.unbounded(over & falls)
    low, high = everything(m, a)
    even = m.where(over & (n > 0.0), 0.0 * size[0], size[0]), m.where(over & falls, high, size[1])
    through = m.where(falls, low, -first), m.where(falls, high, last)
    low, high = m.where(over, through[0], -size[1]), m.where(over, through[1], -size[0])
    return m.where(odd, low, even[0]), m.where(odd, high, even[1])


def _noise(m: Any, op: int, *boxes: Any) -> Interval:
    """By the mean value: the slope within the box is that at its middle, give or take its bends."""
    middle, half = middles(m, boxes)
    value, *ways = noise(m, *middle)
    reach = NOISE_CURVE * (half[0] + half[1] + half[2])
    span = sum((abs(way) + reach) * h for way, h in zip(ways, half, strict=True))
    most = NOISE_BOUND + 0.0 * value
    low, high = value - span - 64.0 * m.unit, value + span + 64.0 * m.unit
    return _all_defined(m, boxes, (m.where(low > -most, low, -most), m.where(high < most, high, most)))


def _all_defined(m: Any, boxes: Any, found: Interval) -> Interval:
    for box in boxes:
        found = _defined(m, box, found)
    return found


def middles(m: Any, boxes: Any) -> tuple[list[Number], list[Number]]:
    middle = [0.5 * (low + high) for low, high in boxes]
    return middle, [up(m, 0.5 * (high - low), 2) for low, high in boxes]


_PARTIAL = {
    Op.SQRT: _sqrt, Op.LOG: log, Op.SIN: _wave, Op.COS: _wave, Op.TAN: _tan, Op.ASIN: _arc, Op.ACOS: _arc, Op.ATAN2: _angle,
    Op.ANGLE: _angle, Op.MOD: _mod, Op.POWER: _power, Op.NOISE: _noise,
}  # fmt: skip
