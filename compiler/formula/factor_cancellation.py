"""Quotients of what is 0 at the same place: x · y / x, |x| / x and sin(x) / x; and remainders, as of 3 x by x.

Bounds of 0 / 0 are everything, however short the piece of a ray, so that none that passes there could be proved. What both sides have for
a factor goes, where it is 0 at places alone; of a sine over its angle it is known how near to 1 it stays.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .opcodes import Op
from .regularize import is_smooth

if TYPE_CHECKING:
    from .tape import Builder

Factors = dict[int, int]  # names, and how often each is a factor


def divided(b: Builder, over: int, under: int) -> int:
    """over / under."""
    if under < 0:
        return b.op(Op.DIVIDE, over, under)
    above, below = _factors(b, over), _factors(b, under)
    found: list[int] = []
    _cancelled(b, above, below, found)
    for name in list(above):
        op, of, _ = b.row(name)
        if op == Op.SIN and above[name] > 0 and is_smooth(b, of):
            angle = _factors(b, of)
            if all(below.get(part, 0) >= count for part, count in angle.items() if part >= 0):
                above[name] -= 1
                for part, count in angle.items():
                    if part >= 0:
                        below[part] -= count
                found += [_sine_over_angle(b, of), _product(b, {part: count for part, count in angle.items() if part < 0})]
    if above == _factors(b, over) and below == _factors(b, under):
        return b.op(Op.DIVIDE, over, under)
    top = _product(b, above)
    for name in found:
        top = b.multiply(top, name)
    return b.op(Op.DIVIDE, top, _product(b, below))


def remaindered(b: Builder, over: int, under: int) -> int:
    """over modulo under: what both have for a factor goes before it, f p − f q ⌊f p / (f q)⌋ = f (p − q ⌊p / q⌋)."""
    above, below = _factors(b, over), _factors(b, under)
    both = {name: min(count, below[name]) for name, count in above.items() if name >= 0 and name in below and is_smooth(b, name)}
    if not both:
        return b.op(Op.MOD, over, under)
    for name, count in both.items():
        above[name], below[name] = above[name] - count, below[name] - count
    return b.multiply(_product(b, both), b.op(Op.MOD, _product(b, above), _product(b, below)))


def _cancelled(b: Builder, above: Factors, below: Factors, found: list[int]) -> None:
    """Take away what both have; a value over its magnitude is its sign."""
    for name in list(below):
        if name >= 0 and is_smooth(b, name):
            both = min(above.get(name, 0), below[name])
            above[name], below[name] = above.get(name, 0) - both, below[name] - both
    for one, other in ((above, below), (below, above)):
        for name in list(one):
            op, of, _ = b.row(name)
            if op == Op.ABS and is_smooth(b, of):
                both = min(one[name], other.get(of, 0))
                if both:
                    one[name], other[of] = one[name] - both, other[of] - both
                    found += [b.op(Op.SIGN, of)] * (both % 2)
    for factors in (above, below):
        for name in [name for name, count in factors.items() if count == 0]:
            del factors[name]


def _factors(b: Builder, name: int) -> Factors:
    """What a value is the product of, constants among them."""
    found: Factors = {}
    waiting = [(name, 1)]
    while waiting:
        name, count = waiting.pop()
        op, one, other = b.row(name)
        if op == Op.MULTIPLY:
            waiting += [(other, count), (one, count)]
        elif op == Op.SQUARE:
            waiting.append((one, 2 * count))
        elif op == Op.CUBE:
            waiting.append((one, 3 * count))
        elif op == Op.NEGATE:
            waiting += [(one, count), (b.constant(-1.0), count)]
        else:
            found[name] = found.get(name, 0) + count
    return found


def _product(b: Builder, factors: Factors) -> int:
    made = b.constant(1.0)
    for name, count in factors.items():
        if count:
            made = b.multiply(made, b.power(name, b.constant(float(count))))
    return made


def _sine_over_angle(b: Builder, angle: int) -> int:
    """sin(v) / v, and 1 where v is 0: it lies between 1 − v²/6 and 1 − v²/6 + v⁴/120, which say so to bounds."""
    square = b.op(Op.SQUARE, angle)
    least = b.shifted(b.scaled(square, -1.0 / 6.0), 1.0)
    most = b.add(least, b.scaled(b.op(Op.SQUARE, square), 1.0 / 120.0))
    quotient = b.op(Op.DIVIDE, b.op(Op.SIN, angle), angle)
    return b.op(Op.MAX, least, b.op(Op.MIN, most, quotient))
