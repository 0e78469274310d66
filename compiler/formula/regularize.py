"""Relations that hold on a surface alone, in a part or as a whole: what is left of them has an inside.

(y − 1)² · y ≤ 0 holds where y ≤ 0, and on the plane y = 1, which no sign tells from what is around it. Squares and magnitudes that are
factors change no sign, and a part that is never below 0 has no inside.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .opcodes import Op, arity

if TYPE_CHECKING:
    from .tape import Builder

INPUTS = 3
SMOOTH = frozenset({Op.COPY, Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.NEGATE, Op.SQUARE, Op.CUBE, Op.EXP, Op.SIN, Op.COS, Op.ATAN, Op.HYPOT})


def with_inside(b: Builder, field: int) -> tuple[int | None, bool]:
    """(a field that is at most 0 in the inside of where another one is, and around it; whether sheets beside it are left out): None where
    it has no inside."""
    known: dict[int, tuple[int | None, bool]] = {}
    waiting = [field]
    while waiting:  # no recursion, however deep, and nothing twice
        name = waiting[-1]
        op, one, other = b.row(name)
        parts = [part for part in (one, other) if part not in known] if op in (Op.MIN, Op.MAX) else []
        if parts:
            waiting += parts
            continue
        waiting.pop()
        known[name] = _of_parts(b, op, name, known[one], known[other]) if op in (Op.MIN, Op.MAX) else _of_factors(b, name)
    return known[field]


def _of_parts(b: Builder, op: Op, field: int, one: tuple[int | None, bool], other: tuple[int | None, bool]) -> tuple[int | None, bool]:
    """The same of the least or largest of two parts of which it is known."""
    (first, cut), (second, cut_too) = one, other
    if first is None or second is None:
        left = None if op == Op.MAX else second if first is None else first
        return left, left is not None
    return (field if (first, second) == b.row(field)[1:] else b.op(op, first, second)), cut or cut_too


def _of_factors(b: Builder, field: int) -> tuple[int | None, bool]:
    """The same of a product: each factor once that it holds an odd number of times, and none that it holds an even number of times."""
    times: dict[int, int] = {}
    negative, waiting = False, [(field, 1)]
    while waiting:
        name, count = waiting.pop()
        op, one, other = b.row(name)
        number = b.number(name)
        if number == 0.0:
            return field, False
        if op == Op.NEGATE or (number or 0.0) < 0.0:
            negative ^= count % 2 == 1
        if op == Op.MULTIPLY:
            waiting += [(other, count), (one, count)]
        elif op in (Op.SQUARE, Op.ABS) and is_smooth(b, one):
            waiting.append((one, 2 * count))
        elif op == Op.CUBE:
            waiting.append((one, 3 * count))
        elif op == Op.NEGATE:
            waiting.append((one, count))
        elif number is None:
            times[name] = times.get(name, 0) + count
    if all(count == 1 for count in times.values()):
        return field, False
    kept = [name for name, count in times.items() if count % 2]
    others = [name for name, count in times.items() if count % 2 == 0]
    left_out = any(is_smooth(b, name) for name in others)
    kept += [b.op(Op.SQUARE, name) for name in others if not is_smooth(b, name)]
    if not kept:
        return (b.constant(-1.0), False) if negative else (None, False)
    product = kept[0]
    for name in kept[1:]:
        product = b.multiply(product, name)
    return b.op(Op.NEGATE, product) if negative else product, left_out


def is_smooth(b: Builder, name: int) -> bool:
    """Whether a value is defined everywhere, and 0 over no region, as sums and products of smooth functions are."""
    waiting, seen = [name], {name}
    while waiting:
        name = waiting.pop()
        if name < INPUTS:
            continue
        op, *operands = b.rows[name - INPUTS]
        used = operands[: arity(op)]
        by_number = op == Op.DIVIDE and b.number(used[1])
        if not (by_number or op in SMOOTH) or (op == Op.HYPOT and (used[0] == used[1] or min(used) < 0)):
            return False
        waiting += [other for other in used if other not in seen]
        seen.update(used)
    return True
