"""GraphBuilder: builds the tape of a texture graph; folds constants and shares equal operations.

Values are names, as on tapes. Methods do not change the meaning of an operation: a quotient by 0 is not finite, and textures draw 0 there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..formula.opcodes import Op, fold
from ..formula.operation_rows import OperationRows
from ..formula.tape import INPUTS, Tape
from . import noise
from .opcodes import CHANNELS, FIRST, MOST_ROWS, U, arity
from .opcodes import Op as GraphOp


class TooLarge(ValueError):
    """A graph of more operations than tapes of textures have."""


@dataclass(eq=False)
class GraphBuilder(OperationRows):
    """Rows of operations, without duplicates."""

    def op(self, op: int, *names: int) -> int:
        """The value of an operation."""
        numbers = [self.number(name) for name in names]
        if all(number is not None for number in numbers) and math.isfinite(value := _folded(op, numbers)):  # type: ignore[arg-type]
            return self.constant(value)
        if (simpler := self._simpler(op, names, numbers)) is not None:
            return simpler
        if op in (Op.ADD, Op.MULTIPLY) and names[0] > names[1]:
            names = names[1], names[0]
        return self._row((int(op), *names, *(0,) * (3 - len(names))))

    def _simpler(self, op: int, names: Sequence[int], numbers: Sequence[float | None]) -> int | None:
        """A name of the same value without an operation, or None."""
        if op == Op.ADD and 0.0 in numbers:
            return names[1] if numbers[0] == 0.0 else names[0]
        if op == Op.MULTIPLY and 1.0 in numbers:
            return names[1] if numbers[0] == 1.0 else names[0]
        if (op == Op.SUBTRACT and numbers[1] == 0.0) or (op in (Op.DIVIDE, Op.POWER) and numbers[1] == 1.0):
            return names[0]
        if op == Op.CHOOSE and numbers[0] is not None:
            return names[1] if numbers[0] <= 0.0 else names[2]
        return names[1] if op == Op.CHOOSE and names[1] == names[2] else None

    def _row(self, row: tuple[int, ...]) -> int:
        if row not in self._names:
            if len(self.rows) + INPUTS >= U:
                raise TooLarge(f"the graph has more than {MOST_ROWS} operations")
            self.rows.append(row)  # type: ignore[arg-type]
            self._names[row] = INPUTS + len(self.rows) - 1
        return self._names[row]

    def look_up(self, texture: int, s: int, t: int) -> tuple[int, int, int, int]:
        """Red, green, blue and alpha of an image texture at s and t."""
        row = (int(GraphOp.LOOK_UP), s, t, self.constant(texture))
        if (first := self._names.get(row)) is None:
            first = self._row(row)
            for _ in range(1, CHANNELS):
                self.rows.append((int(GraphOp.CHANNEL), 0, 0, 0))
        return first, first + 1, first + 2, first + 3

    # --- arithmetic ---------------------------------------------------------------------------------------------------------

    def divide(self, a: int, b: int) -> int:
        return self.op(Op.DIVIDE, a, b)

    def clamp(self, a: int, low: int, high: int) -> int:
        return self.op(Op.MIN, self.op(Op.MAX, a, low), high)

    def mix(self, low: int, high: int, share: int) -> int:
        """low (1 − share) + high share."""
        if low == high:
            return low
        if (number := self.number(share)) in (0.0, 1.0):
            return high if number else low
        return self.add(self.multiply(low, self.subtract(self.constant(1.0), share)), self.multiply(high, share))

    def at_most(self, a: int, b: int, yes: int, no: int) -> int:
        """`yes` where a ≤ b, else `no`."""
        return self.op(Op.CHOOSE, self.subtract(a, b), yes, no)

    def equal(self, a: int, b: int, yes: int, no: int) -> int:
        """`yes` where a = b, else `no`."""
        return self.op(Op.CHOOSE, self.op(Op.ABS, self.subtract(a, b)), yes, no)

    def total(self, names: Sequence[int]) -> int:
        """The sum of values."""
        result = names[0]
        for name in names[1:]:
            result = self.add(result, name)
        return result

    # --- values that depend on others ------------------------------------------------------------------------------------

    def _operands(self, name: int) -> list[int]:
        """The operands of a row; none of an input or a constant."""
        if not INPUTS <= name < U:
            return []
        if self.rows[name - INPUTS][0] == GraphOp.CHANNEL:
            return [self._first_of(name)]
        op, *operands = self.rows[name - INPUTS]
        return operands[: arity(op)]

    def reads(self, name: int, inputs: Sequence[int]) -> bool:
        """Whether a value depends on one of some inputs."""
        waiting, seen = [name], {name}
        while waiting:
            fresh = set(self._operands(waiting.pop())) - seen
            seen |= fresh
            waiting += fresh
        return bool(seen & set(inputs))

    def replayed(self, name: int, inputs: dict[int, int]) -> int:
        """A value again, with other values in place of some inputs."""
        places = dict(inputs)
        for row in range(INPUTS, name + 1 if name < U else INPUTS):
            op, *operands = self.rows[row - INPUTS]
            if op == GraphOp.CHANNEL:
                continue
            names = [places.get(operand, operand) for operand in operands[: arity(op)]]
            if names == operands[: arity(op)]:
                continue
            if op == GraphOp.LOOK_UP:
                texels = self.look_up(int(self.constants[~operands[2]]), names[0], names[1])
                places |= {row + k: texel for k, texel in enumerate(texels)}
            else:
                places[row] = self.op(op, *names)
        return places.get(name, name)

    # --- tapes --------------------------------------------------------------------------------------------------------------

    def finish(self, *results: int) -> Tape:
        """The tape of these values, with the rows that they need, in their order."""
        needed, waiting = set(), [name for name in results if INPUTS <= name < U]
        while waiting:
            name = self._first_of(waiting.pop())
            if name not in needed:
                needed.add(name)
                op, *operands = self.rows[name - INPUTS]
                waiting += [operand for operand in operands[: arity(op)] if INPUTS <= operand < U]
        order: list[int] = []
        for name in sorted(needed):
            order += [name + k for k in range(CHANNELS if self.rows[name - INPUTS][0] == GraphOp.LOOK_UP else 1)]
        place = {name: INPUTS + i for i, name in enumerate(order)}
        rows, numbers, used = [], [], {}
        for name in [*order, *results]:
            op, *operands = self.rows[name - INPUTS] if INPUTS <= name < U and name in place else (int(Op.COPY), name, 0, 0)
            for operand in (*operands[: arity(op)], name):
                if operand < 0 and operand not in used:
                    used[operand] = ~len(numbers)
                    numbers.append(self.constants[~operand])
        place |= used
        for name in order:
            op, *operands = self.rows[name - INPUTS]
            names = [place.get(operand, operand) for operand in operands[: arity(op)]]
            rows.append((op, *names, *[0] * (3 - len(names))))
        code = np.array(rows, np.int32).reshape(-1, 4)
        return Tape(code, np.array(numbers, np.float64), tuple(place.get(name, name) for name in results))

    def _first_of(self, name: int) -> int:
        """The name of a row, or of the look-up of a channel."""
        while self.rows[name - INPUTS][0] == GraphOp.CHANNEL:
            name -= 1
        return name


def _folded(op: int, numbers: Sequence[float]) -> float:
    """An operation on numbers; NaN where it is undefined."""
    if op < FIRST:
        return fold(Op(op), *numbers)
    if op >= GraphOp.LOOK_UP:
        return math.nan
    return float(noise.point(noise.NumpyMath(), op, *(np.array([number]) for number in numbers))[0])
