"""Builder: an expression graph that folds constants, shares equal operations and keeps comparisons exact; it finishes as a Tape."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from . import step_functions
from .graph import Graph
from .opcodes import COMMUTES, STEPS, Op, arity, fold
from .tape import INPUTS, Tape, X, Y, Z, mark_periodic_angles

HUGE = 1e35  # stands for a quotient by 0 over a region


class Builder(Graph):
    """Builds a tape from operations."""

    @classmethod
    def from_tape(cls, tape: Tape) -> tuple[Builder, tuple[int, ...]]:
        """(a builder with a tape's operations as they are, the tape's results). Their constant values are not known."""
        builder = cls([tuple(row) for row in tape.code.tolist()], tape.constants.tolist())
        builder._names |= {number: ~k for k, number in enumerate(builder.constants)}
        builder._names |= {row: INPUTS + i for i, row in enumerate(builder.rows)}
        return builder, tape.results

    def op(self, op: Op, a: int, b: int = 0, c: int = 0) -> int:
        simpler = self._simplify(op, a, b, c)
        if simpler is not None:
            return simpler
        if op in COMMUTES and b < a:
            a, b = b, a
        if op == Op.MOD and a in self._integers and self.rows[a - INPUTS][0] not in STEPS:
            a = self.op(Op.FLOOR, self.offset(a, 0.5))  # the same value, with bounds of one number
        if op in (Op.LOG, Op.POWER) and self.may_be_zero(a):  # interval bounds assume that 0 occurs at isolated points
            at_zero = self._append(op, self.op(Op.MIN, a, self.constant(0.0)), b, c)
            return self.op(Op.CHOOSE, a, at_zero, self._append(op, a, b, c))
        if op == Op.MOD and self.may_be_zero(b):  # undefined there
            return self.op(Op.CHOOSE, self.op(Op.ABS, b), self._undefined(), self._append(op, a, b, c))
        if op == Op.DIVIDE and (sign := step_functions.sign_of_zero(self, b)):  # ∞ there, whose bounds are everything
            at_zero = self.scale(self.op(Op.SIGN, a), sign * HUGE)
            if self.may_be_zero(a):
                at_zero = self.op(Op.CHOOSE, self.op(Op.ABS, a), self._undefined(), at_zero)
            return self.op(Op.CHOOSE, self.op(Op.ABS, b), at_zero, self._append(op, a, b, c))
        return self._append(op, a, b, c)

    def _undefined(self) -> int:
        return self.op(Op.SQRT, self.constant(-1.0))

    def less(self, a: int, b: int, strictly: bool) -> int:
        """A field that is at most 0 where a ≤ b, or a < b, and is 0 over no region: where a = b its sign is the answer."""
        while self.row(a)[0] == Op.EXP == self.row(b)[0]:  # increasing, and defined everywhere
            a, b = self.row(a)[1], self.row(b)[1]
        with_choice = step_functions.compare_choice(self, a, b, strictly)
        if with_choice is not None:
            return with_choice
        field = self.subtract(a, b)
        values = self.constant_values(field)
        if field < 0:
            holds = self.constants[~field] < 0.0 or (self.constants[~field] == 0.0 and not strictly)
            return self.constant(-1.0 if holds else 1.0)
        if field in self._integers:
            return self.offset(field, 0.5 if strictly else -0.5)
        return step_functions.separate_equal(self, field, strictly) if self.may_tie or values is None or 0.0 in values else field

    def integer_is_zero(self, name: int) -> int:
        """A field that is at most 0 where a whole number is 0."""
        return self.offset(self.op(Op.ABS, name), -0.5)

    # --- simplification ---

    def _simplify(self, op: Op, a: int, b: int, c: int) -> int | None:
        """An equal value of fewer operations, or None."""
        used = (a, b, c)[: arity(op)]
        if all(name < 0 for name in used):
            value = fold(op, *(self.constants[~name] for name in used))
            if math.isfinite(value):
                return self.constant(value)
        if op in (Op.ADD, Op.SUBTRACT):
            return self._simplify_sum(op, a, b)
        if op in (Op.MULTIPLY, Op.DIVIDE):
            return self._simplify_product(a, b) if op == Op.MULTIPLY else self._simplify_quotient(a, b)
        if op == Op.NEGATE and a >= INPUTS and self.rows[a - INPUTS][0] == Op.NEGATE:
            return self.rows[a - INPUTS][1]
        if op in (Op.MIN, Op.MAX) and a == b:
            return a
        if op in (Op.MIN, Op.MAX) and self._is_negative_of(a, b):
            size = self.op(Op.ABS, b if self.row(a)[0] == Op.NEGATE else a)
            return size if op == Op.MAX else self.op(Op.NEGATE, size)
        if op == Op.ARC and self.number(c) == 0.0:
            return self.op(Op.QUARTER_ARC, a, b)
        if op == Op.CHOOSE and c >= INPUTS and self.rows[c - INPUTS][:2] == (Op.CHOOSE, a):
            return self.op(Op.CHOOSE, a, b, self.rows[c - INPUTS][3])
        if op == Op.SQRT and self.row(a)[0] == Op.SQUARE:
            return self.op(Op.ABS, self.row(a)[1])
        return None

    def _simplify_sum(self, op: Op, a: int, b: int) -> int | None:
        x, y = self.number(a), self.number(b)
        if op == Op.ADD and (x == 0.0 or y == 0.0):
            return b if x == 0.0 else a
        if op == Op.SUBTRACT and y == 0.0:
            return a
        if op == Op.SUBTRACT and x == 0.0:
            return self.op(Op.NEGATE, b)
        if shared := self._common_factor(a, b):
            factor, first, second = shared
            return self.op(Op.MULTIPLY, factor, self.op(op, first, second))  # its bounds are never wider
        return None

    def _simplify_product(self, a: int, b: int) -> int | None:
        x, y = self.number(a), self.number(b)
        if x == 1.0 or y == 1.0:
            return b if x == 1.0 else a
        if a == b:
            return self.op(Op.SQUARE, a)
        if self.row(a)[:2] == (Op.SQUARE, b) or self.row(b)[:2] == (Op.SQUARE, a):
            return self.op(Op.CUBE, b if self.row(a)[:2] == (Op.SQUARE, b) else a)
        if x == -1.0 or y == -1.0:
            return self.op(Op.NEGATE, b if x == -1.0 else a)
        return None

    def _simplify_quotient(self, a: int, b: int) -> int | None:
        y = self.number(b)
        if y is not None and y != 0.0 and math.frexp(y)[0] in (0.5, -0.5):
            return self.op(Op.MULTIPLY, a, self.constant(1.0 / y))  # by a power of two: exact
        if self.row(b)[:2] == (Op.ABS, a) or self.row(a)[:2] == (Op.ABS, b):
            of = a if self.row(b)[:2] == (Op.ABS, a) else b
            return None if self.may_be_zero(of) else self.op(Op.SIGN, of)
        return None

    def _common_factor(self, a: int, b: int) -> tuple[int, int, int] | None:
        """(a factor of two products, the other factor of each). Constants do not count: they may be equal by chance."""
        first, second = self.row(a), self.row(b)
        if first[0] == Op.MULTIPLY == second[0]:
            for k, m in ((1, 1), (1, 2), (2, 1), (2, 2)):
                if first[k] == second[m] >= 0:
                    return first[k], first[3 - k], second[3 - m]
        return None

    def _is_negative_of(self, a: int, b: int) -> bool:
        """Whether one value is the other's negative, to the bit."""
        first, second = self.row(a), self.row(b)
        negated = first[0] == Op.SUBTRACT and second == (Op.SUBTRACT, first[2], first[1])
        if shared := self._common_factor(a, b):
            negated = self._is_negative_of(*shared[1:])
        return negated or first[:2] == (Op.NEGATE, b) or second[:2] == (Op.NEGATE, a)

    # --- tapes ---

    def inline(self, tape: Tape, inputs: Sequence[int]) -> tuple[int, ...]:
        """The results of another tape, with `inputs` for x, y and z."""
        names = list(inputs)

        def value(name: int) -> int:
            return names[name] if name >= 0 else self.constant(tape.constants[~name])

        for op, *operands in tape.code.tolist():
            names.append(self.op(Op(op), *(value(name) for name in operands[: arity(op)])))
        return tuple(value(name) for name in tape.results)

    def finish(self, *results: int) -> Tape:
        """The tape of these values: the code and constants that they need, in an order that holds few values at a time."""
        order, needed = self._schedule(results)
        place = {X: X, Y: Y, Z: Z} | {name: INPUTS + i for i, name in enumerate(order)}
        numbers = sorted((name for name in needed if name < 0), reverse=True)
        place |= {name: ~k for k, name in enumerate(numbers)}
        rows = []
        for name in order:
            op, *operands = self.rows[name - INPUTS]
            used = [place[operand] for operand in operands[: arity(op)]]
            rows.append((op, *used, *[0] * (3 - len(used))))
        constants = np.array([self.constants[~name] for name in numbers], np.float64)
        tape = Tape(np.array(rows, np.int32).reshape(-1, 4), constants, tuple(place[name] for name in results))
        mark_periodic_angles(tape)
        return tape

    def _schedule(self, results: Sequence[int]) -> tuple[list[int], set[int]]:
        """(rows that results need, in the order of evaluation; all names that they need).

        The operand that needs most registers comes first: Sethi and Ullman, "The Generation of Optimal Code for Arithmetic Expressions",
        Journal of the ACM 1970.
        """
        operands = [row[1 : 1 + arity(row[0])] for row in self.rows]
        registers = [0] * INPUTS
        for used in operands:
            most = 1
            for i, count in enumerate(sorted([registers[name] for name in used if name >= INPUTS], reverse=True)):
                most = max(most, count + i)
            registers.append(most)
        order: list[int] = []
        needed: set[int] = set()
        waiting = [(name, False) for name in reversed(results)]
        while waiting:
            name, ready = waiting.pop()
            if ready:
                order.append(name)
            elif name not in needed:
                needed.add(name)
                if name >= INPUTS:
                    waiting.append((name, True))
                    used = operands[name - INPUTS]
                    if len(used) > 1:
                        used = sorted(used, key=lambda name: registers[name] if name >= 0 else 0)
                    waiting += [(operand, False) for operand in used]
        return order, needed
