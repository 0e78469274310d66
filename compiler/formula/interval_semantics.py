"""Interval semantics of opcodes: bounds of operations over boxes; one source for numpy and LLVM vectors.

interval_arithmetic.py says how bounds are rounded, and what they are where an operation is undefined, overflows or jumps.
"""

from __future__ import annotations

import math
from typing import Any

from .interval_arithmetic import (
    Interval,
    add,
    down,
    either,
    everything,
    high_of,
    is_saturated,
    low_of,
    magnitude,
    multiply,
    negate,
    one_side,
    outward,
    reciprocal,
    saturate,
    subtract,
    up,
    where_defined,
)
from .opcodes import LEAST_COSINE, Op
from .point_semantics import Number, hypotenuse, noise, point

ULPS = 4  # largest error of the elementary functions, with a margin (docs/simd.md)
LEAST = 2.3e-308  # the least normal number, rounded up
LEAST_LOG = -746.0  # below the logarithm of every positive number
NOISE_BOUND = 1.5  # bound of |noise|
NOISE_CURVE = 24.0  # bound of its second derivatives: fade″ ≤ 5.8, fade′ ≤ 1.9, differences of corners ≤ 4


def _quotient(m: Any, a: Interval, b: Interval) -> Interval:
    """a / b; unbounded next to a pole, however small a is."""
    if not m.forks:  # the sine of ∞ and ∞ − ∞ are undefined
        m.undefined((b[0] <= 0.0) & (b[1] >= 0.0))
    m.undefined(is_saturated(m, a) & is_saturated(m, b))  # ∞ / ∞
    return multiply(m, a, reciprocal(m, b))


def choices(m: Any, op: int, a: Interval, b: Interval, c: Any = None) -> tuple[Number, Number]:
    """Where MIN, MAX or an arc equal one operand over the whole box: (the first, the second). CHOOSE: see `branch_choices`."""
    if op == Op.ARC:
        return _suffices(m, a, b, c) | (b[0] != b[0]), _suffices(m, b, a, c) | (a[0] != a[0])
    if op == Op.QUARTER_ARC:
        return ((b[1] < a[0]) & (b[1] < 0.0)) | (b[0] != b[0]), ((a[1] < b[0]) & (a[1] < 0.0)) | (a[0] != a[0])
    if op == Op.MIN:
        return (a[1] < b[0]) | (b[0] != b[0]), (b[1] < a[0]) | (a[0] != a[0])
    return (a[0] > b[1]) | (a[0] != a[0]), (b[0] > a[1]) | (b[0] != b[0])


def _suffices(m: Any, large: Interval, small: Interval, c: Interval) -> Number:
    """Whether ARC is one operand over a box: it is the larger one, and the other lies below its product with the cosine."""
    cosines = m.clipped(c[0], LEAST_COSINE, 1.0), m.clipped(c[1], LEAST_COSINE, 1.0)
    products = [cosine * bound for cosine in cosines for bound in large]
    least = low_of(m, low_of(m, products[0], products[1]), low_of(m, products[2], products[3]))
    return (small[1] < large[0]) & (small[1] < down(m, least, 2))


def branch_choices(m: Any, a: Interval) -> tuple[Number, Number]:
    """Where CHOOSE takes its first branch, or its second, over the whole box of its condition."""
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
    return _BOUNDS[Op(op)](m, op, a, b, c)


def _square(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    low, high = magnitude(m, a)
    low, high = low * low, high * high
    m.unbounded(high > m.big)
    low, high = m.least(m.big, low), m.least(m.most, high)
    return (high_of(m, down(m, low), 0.0 * low), up(m, high)) if m.lost else outward(m, low, high)


def _cube(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    low, high = saturate(m, a[0] * a[0] * a[0], a[1] * a[1] * a[1])
    return (down(m, low, 1), up(m, high, 1)) if m.lost else (low - abs(low) * (2.25 * m.unit), high + abs(high) * (2.25 * m.unit))


def _hypot(m: Any, op: int, a: Interval, b: Any, *_: Any) -> Interval:
    (la, ha), (lb, hb) = magnitude(m, a), magnitude(m, b)
    if m.lost:  # an underflow of the squares changes the root by 2⁻⁶² at most
        low, high = m.sqrt(la * la + lb * lb), m.sqrt(ha * ha + hb * hb)
        low, high = saturate(m, low - 2.0**-62, high + 2.0**-62)
    else:
        low, high = saturate(m, hypotenuse(m, la, lb), hypotenuse(m, ha, hb))
    return high_of(m, down(m, low, 2), 0.0 * low), up(m, high, 2)


def _minimum(m: Any, op: int, a: Interval, b: Any, *_: Any) -> Interval:
    low = m.where(b[0] != b[0], a[0], low_of(m, a[0], b[0]))
    high = m.where(b[1] != b[1], a[1], low_of(m, a[1], b[1]))
    return low, _high_of_choice(m, low, a, b, high)


def _high_of_choice(m: Any, low: Number, a: Interval, b: Interval, high: Number) -> Number:
    """The upper bound of MIN: that of the other operand where one may be undefined."""
    unsure = m.was_undefined(low)
    return m.where(unsure, high_of(m, a[1], m.where(b[1] != b[1], a[1], b[1])), high)


def _maximum(m: Any, op: int, a: Interval, b: Any, *_: Any) -> Interval:
    bad = m.where(a[0] != a[0], a[0], b[0])
    undefined = bad != bad
    return m.where(undefined, bad, high_of(m, a[0], b[0])), m.where(undefined, bad, high_of(m, a[1], b[1]))


def _exp(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    low, high = saturate(m, m.exp(a[0]), m.exp(a[1]))
    return high_of(m, down(m, low, ULPS), 0.0 * a[0]), up(m, high, ULPS)


def _step(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    low, high = (point(m, op, bound) for bound in a)
    once = high == low + 1.0 if op != Op.SIGN else low < high
    if op == Op.SIGN and m.forks:  # 0 at an isolated point
        low, high = m.where(once, -1.0 + 0.0 * low, low), m.where(once, 1.0 + 0.0 * high, high)
    return one_side(m, once, (low, low), (high, high), (low, high))


def _atan(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    return down(m, m.atan(a[0]), ULPS), up(m, m.atan(a[1]), ULPS)


def _choose(m: Any, op: int, a: Interval, b: Any, c: Any) -> Interval:
    first, second = branch_choices(m, a)
    no_b, no_c = b[0] != b[0], c[0] != c[0]
    if not m.forks:  # the branch that is undefined may be taken
        m.undefined(~(first | second) & (no_b | no_c))
    whole = either(m, first | (no_c & ~second), b, second | (no_b & ~first), c)
    return one_side(m, ~(first | second), b, c, whole)


def _arc_length(m: Any, op: int, a: Interval, b: Any, c: Any) -> Interval:
    slack = arc_slack(m, a, b)  # grows with a and b, falls with the cosine
    no_a, no_b = a[0] != a[0], b[0] != b[0]
    least, most = (None, None) if op == Op.QUARTER_ARC else c
    low, high = point(m, op, a[0], b[0], most) - slack, point(m, op, a[1], b[1], least) + slack
    low, high = (low, high) if m.lost else saturate(m, low, high)
    low, high = m.where(no_b, a[0], m.where(no_a, b[0], low)), m.where(no_b, a[1], m.where(no_a, b[1], high))
    unsure = m.was_undefined(low)  # one operand alone, or the cosine 1, where another may be undefined
    return m.where(unsure, low_of(m, a[0], m.where(no_b, a[0], b[0])), low), high


def arc_slack(m: Any, a: Interval, b: Interval) -> Number:
    """Error of ARC and QUARTER_ARC."""
    size = high_of(m, high_of(m, abs(a[0]), abs(a[1])), high_of(m, abs(b[0]), abs(b[1])))
    return size * (16.0 * m.unit) + m.tiny


def select_operands(known: tuple[Number, Number], a: Any, b: Any) -> tuple[Any, ...]:
    return known[0], a, known[1], b


def _sqrt(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    low = high_of(m, down(m, m.sqrt(high_of(m, a[0], 0.0 * a[0]))), 0.0 * a[0])
    return _outside(m, a, a[0] < 0.0, a[1] < 0.0, (low, m.where(a[1] > m.big, m.most, up(m, m.sqrt(a[1])))))  # of ∞, too


def log(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    m.unbounded(a[0] <= m.tiny)
    least = m.tiny + 0.0 * a[0]
    positive_low, positive_high = m.where(a[0] > m.tiny, a[0], least), m.where(a[1] > m.tiny, a[1], least)
    low = m.where(a[0] > m.tiny, down(m, m.log(positive_low), ULPS), LEAST_LOG if m.forks else -m.most)  # 0 occurs at isolated points
    return _outside(m, a, a[0] < 0.0, a[1] < 0.0, (low, m.where(a[1] > m.big, m.most, up(m, m.log(positive_high), ULPS))))


def _outside(m: Any, a: Interval, partly: Number, never: Number, found: Interval) -> Interval:
    """A result that is undefined where `never` or where its operand is, and in a part of the box where `partly`."""
    nan = math.nan + 0.0 * a[0]
    if not m.forks:
        m.undefined(partly & ~never)
    found = one_side(m, partly & ~never, (nan, nan), found, found)
    never = never | (a[0] != a[0])
    return m.where(never, nan, found[0]), m.where(never, nan, found[1])


def _wave(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    """Sine and cosine: bounds of the ends, and ±1 where a crest or trough lies between."""
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
    return where_defined(m, a, (low, high))


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
    return where_defined(m, a, saturate(m, *found))


def _arc(m: Any, op: int, a: Interval, *_: Any) -> Interval:
    one = 1.0 + 0.0 * a[0]
    x, y = (m.where(p < -1.0, -one, m.where(p > 1.0, one, p)) for p in a)
    if op == Op.ACOS:
        x, y = y, x
    f = m.asin if op == Op.ASIN else m.acos
    return _outside(m, a, (a[0] < -1.0) | (a[1] > 1.0), (a[1] < -1.0) | (a[0] > 1.0), (down(m, f(x), ULPS), up(m, f(y), ULPS)))


def _angle(m: Any, op: int, y: Interval, x: Any, *_: Any) -> Interval:
    """The angle of a box: bounds of its corners, unless the box contains the origin or crosses the branch cut of atan2.

    Then all angles; for ANGLE, whose branch cut does not matter, those from the upper edge on to the lower one. A flat box, y = 0 alone,
    has the angles π and 0.
    """
    across = (y[0] <= 0.0) & (y[1] >= 0.0)  # + 0.0 below: −0 becomes 0
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
    if op == Op.ANGLE:  # left of the origin: the upper corners, and the lower ones a turn later
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
    return where_defined(m, (bad, bad), (down(m, low, ULPS), up(m, high, ULPS)))


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
    if not m.forks:  # b is 0 at isolated points: Builder handles zeros over regions
        m.undefined((b[0] <= 0.0) & (b[1] >= 0.0))
    bad = m.where(b[0] == b[0], a[0], b[0])
    return where_defined(m, (bad, bad), (low, high))


def periods(m: Any, a: Interval, b: Interval) -> Interval:
    """The numbers of the first and last period of b that a reaches; two apart where b may be 0."""
    corners = [p / q for p in a for q in b]
    u, v = low_of(m, low_of(m, *corners[:2]), low_of(m, *corners[2:])), high_of(m, high_of(m, *corners[:2]), high_of(m, *corners[2:]))
    # A single number up to rounding, such as a sum of floors, has one period.
    alone = (b[0] == b[1]) & (a[1] - a[0] <= abs(a[0] + a[1]) * (4.0 * m.unit))
    middle = 0.5 * (u + v)
    begin, end = m.floor(m.where(alone, middle, down(m, u))), m.floor(m.where(alone, middle, up(m, v)))
    apart = (b[0] > 0.0) | (b[1] < 0.0)
    return m.where(apart, begin, 0.0 * begin), m.where(apart, end, 2.0 + 0.0 * end)


def _power(m: Any, op: int, a: Interval, b: Any, *_: Any) -> Interval:
    """Non-negative bases have their extremes at the corners; negative ones have powers for whole exponents alone."""
    single = b[0] == b[1]
    whole = single & (m.floor(b[0]) == b[0])
    broken = (m.floor(b[0]) == m.floor(b[1])) & (m.floor(b[0]) != b[0])
    broken = broken | ~single if m.forks else broken  # whole exponents in between occur at isolated points
    if not m.forks:
        m.undefined((a[0] < 0.0) & ~(broken | single))
    least = m.where(a[1] > 0.0, LEAST, 0.0 * a[0]) if m.forks else 0.0 * a[0]  # 0 occurs at isolated points
    x, y = m.where(whole, abs(a[0]), m.where(a[0] > 0.0, a[0], least)), m.where(whole, abs(a[1]), m.where(a[1] > 0.0, a[1], 0.0 * a[1]))
    corners = [m.power(m.where(p > m.big, math.inf, p), q) for p in (x, y) for q in b]  # exponents below 1 shrink a bound that stands for ∞
    low = low_of(m, low_of(m, corners[0], corners[1]), low_of(m, corners[2], corners[3]))
    high = high_of(m, high_of(m, corners[0], corners[1]), high_of(m, corners[2], corners[3]))
    low, high = saturate(m, low, high)
    found = high_of(m, down(m, low, ULPS), 0.0 * low), up(m, high, ULPS)
    ends = (up(m, saturate(m, corners[k], corners[k])[1], ULPS) for k in (0, 2))
    found = either(m, ~whole | (a[0] >= 0.0), found, whole & (a[0] < 0.0), _whole_power(m, a, b[0], found, *ends))
    whole_line = everything(m, a)
    known = (a[0] >= 0.0) | broken | whole
    m.unbounded(~known)
    found = m.where(known, found[0], whole_line[0]), m.where(known, found[1], whole_line[1])
    return _outside(m, a, (a[0] < 0.0) & broken, (a[1] < 0.0) & broken, found)


def _whole_power(m: Any, a: Interval, n: Number, size: Interval, first: Number, last: Number) -> Interval:
    """Powers of partly negative bases by a whole exponent n, from bounds of the magnitudes (`size`) and of each end's."""
    over, odd, falls = a[1] > 0.0, m.floor(0.5 * n) != 0.5 * n, n < 0.0
    m.unbounded(over & falls)
    low, high = everything(m, a)
    even = m.where(over & (n > 0.0), 0.0 * size[0], size[0]), m.where(over & falls, high, size[1])
    through = m.where(falls, low, -first), m.where(falls, high, last)
    low, high = m.where(over, through[0], -size[1]), m.where(over, through[1], -size[0])
    return m.where(odd, low, even[0]), m.where(odd, high, even[1])


def _noise(m: Any, op: int, *boxes: Any) -> Interval:
    """Mean value form: the value in the middle, and the derivative there with the bound of the second derivatives."""
    middle, half = middles(m, boxes)
    value, *ways = noise(m, *middle)
    reach = NOISE_CURVE * (half[0] + half[1] + half[2])
    span = sum((abs(way) + reach) * h for way, h in zip(ways, half, strict=True))
    most = NOISE_BOUND + 0.0 * value
    low, high = value - span - 64.0 * m.unit, value + span + 64.0 * m.unit
    return _all_defined(m, boxes, (m.where(low > -most, low, -most), m.where(high < most, high, most)))


def _all_defined(m: Any, boxes: Any, found: Interval) -> Interval:
    for box in boxes:
        found = where_defined(m, box, found)
    return found


def middles(m: Any, boxes: Any) -> tuple[list[Number], list[Number]]:
    middle = [0.5 * (low + high) for low, high in boxes]
    return middle, [up(m, 0.5 * (high - low), 2) for low, high in boxes]


_BOUNDS = {
    Op.SQUARE: _square, Op.CUBE: _cube, Op.HYPOT: _hypot, Op.MIN: _minimum, Op.MAX: _maximum, Op.EXP: _exp, Op.FLOOR: _step, Op.CEIL: _step,
    Op.SIGN: _step, Op.ATAN: _atan, Op.CHOOSE: _choose, Op.ARC: _arc_length, Op.QUARTER_ARC: _arc_length, Op.SQRT: _sqrt, Op.LOG: log,
    Op.SIN: _wave, Op.COS: _wave, Op.TAN: _tan, Op.ASIN: _arc,
    Op.ACOS: _arc, Op.ATAN2: _angle, Op.ANGLE: _angle, Op.MOD: _mod, Op.POWER: _power, Op.NOISE: _noise,
}  # fmt: skip
