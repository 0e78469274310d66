"""Cancels common factors of quotients and remainders: x · y / x, |x| / x, sin(x) / x, mod(3 x, x).

Interval bounds of 0 / 0 are everything, however short the segment of a ray, so no root there could be proved. A common factor cancels if
its zeros are isolated. sin(v) / v gets bounds from its Taylor series.
"""

from __future__ import annotations

from .graph import Graph
from .opcodes import Op
from .regularize import is_smooth

Factors = dict[int, int]  # powers of values


def divide(b: Graph, numerator: int, denominator: int) -> int:
    """numerator / denominator."""
    if denominator < 0:
        return b.op(Op.DIVIDE, numerator, denominator)
    above, below = _factors(b, numerator), _factors(b, denominator)
    extra: list[int] = []
    _cancel(b, above, below, extra)
    for name in list(above):
        op, of, _ = b.row(name)
        if op == Op.SIN and above[name] > 0 and is_smooth(b, of):
            angle = _factors(b, of)
            if all(below.get(part, 0) >= count for part, count in angle.items() if part >= 0):
                above[name] -= 1
                for part, count in angle.items():
                    if part >= 0:
                        below[part] -= count
                extra += [_sine_over_angle(b, of), _product(b, {part: count for part, count in angle.items() if part < 0})]
    if above == _factors(b, numerator) and below == _factors(b, denominator):
        return b.op(Op.DIVIDE, numerator, denominator)
    top = _product(b, above)
    for name in extra:
        top = b.multiply(top, name)
    return b.op(Op.DIVIDE, top, _product(b, below))


def remainder(b: Graph, numerator: int, denominator: int) -> int:
    """numerator mod denominator, with common factors in front: f p − f q ⌊f p / (f q)⌋ = f (p − q ⌊p / q⌋)."""
    above, below = _factors(b, numerator), _factors(b, denominator)
    both = {name: min(count, below[name]) for name, count in above.items() if name >= 0 and name in below and is_smooth(b, name)}
    if not both:
        return b.op(Op.MOD, numerator, denominator)
    for name, count in both.items():
        above[name], below[name] = above[name] - count, below[name] - count
    return b.multiply(_product(b, both), b.op(Op.MOD, _product(b, above), _product(b, below)))


def _cancel(b: Graph, above: Factors, below: Factors, signs: list[int]) -> None:
    """Cancel common factors, in place; a value over its magnitude is its sign, which `signs` takes."""
    for name in list(below):
        if name >= 0 and is_smooth(b, name):
            both = min(above.get(name, 0), below[name])
            above[name], below[name] = above.get(name, 0) - both, below[name] - both
    for these, those in ((above, below), (below, above)):
        for name in list(these):
            op, of, _ = b.row(name)
            if op == Op.ABS and is_smooth(b, of):
                both = min(these[name], those.get(of, 0))
                if both:
                    these[name], those[of] = these[name] - both, those[of] - both
                    signs += [b.op(Op.SIGN, of)] * (both % 2)
    for factors in (above, below):
        for name in [name for name, count in factors.items() if count == 0]:
            del factors[name]


def _factors(b: Graph, name: int) -> Factors:
    """The factors of a value, constants among them."""
    factors: Factors = {}
    waiting = [(name, 1)]
    while waiting:
        name, count = waiting.pop()
        op, left, right = b.row(name)
        if op == Op.MULTIPLY:
            waiting += [(right, count), (left, count)]
        elif op == Op.SQUARE:
            waiting.append((left, 2 * count))
        elif op == Op.CUBE:
            waiting.append((left, 3 * count))
        elif op == Op.NEGATE:
            waiting += [(left, count), (b.constant(-1.0), count)]
        else:
            factors[name] = factors.get(name, 0) + count
    return factors


def _product(b: Graph, factors: Factors) -> int:
    product = b.constant(1.0)
    for name, count in factors.items():
        if count:
            product = b.multiply(product, b.power(name, b.constant(float(count))))
    return product


def _sine_over_angle(b: Graph, angle: int) -> int:
    """sin(v) / v, and 1 where v is 0, clamped between 1 − v²/6 and 1 − v²/6 + v⁴/120 for tight bounds."""
    square = b.op(Op.SQUARE, angle)
    least = b.offset(b.scale(square, -1.0 / 6.0), 1.0)
    most = b.add(least, b.scale(b.op(Op.SQUARE, square), 1.0 / 120.0))
    quotient = b.op(Op.DIVIDE, b.op(Op.SIN, angle), angle)
    return b.op(Op.MAX, least, b.op(Op.MIN, most, quotient))
