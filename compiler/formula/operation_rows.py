"""Rows of operations without duplicates, and the arithmetic that graphs of formulas and of textures share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from .opcodes import Op

MOST_FACTORS = 64  # whole powers up to this are products


@dataclass(eq=False)
class OperationRows(ABC):
    """Rows of operations and constants. Methods take and return names of values (tape.py)."""

    rows: list[tuple[int, int, int, int]] = field(default_factory=list)
    constants: list[float] = field(default_factory=list)
    _names: dict[Any, int] = field(default_factory=dict)  # by constant or row

    @abstractmethod
    def op(self, op: Any, a: int, b: int = 0, c: int = 0) -> int:
        """The name of an operation's value, simplified."""

    def constant(self, number: float) -> int:
        number = float(number) + 0.0  # −0 and 0 are the same
        if number not in self._names:
            self._names[number] = ~len(self.constants)
            self.constants.append(number)
        return self._names[number]

    def number(self, name: int) -> float | None:
        """The value of a constant; None for others."""
        return self.constants[~name] if name < 0 else None

    def add(self, a: int, b: int) -> int:
        return self.op(Op.ADD, a, b)

    def subtract(self, a: int, b: int) -> int:
        return self.op(Op.SUBTRACT, a, b)

    def multiply(self, a: int, b: int) -> int:
        return self.op(Op.MULTIPLY, a, b)

    def scale(self, a: int, factor: float) -> int:
        return self.op(Op.MULTIPLY, a, self.constant(factor))

    def offset(self, a: int, by: float) -> int:
        return self.op(Op.ADD, a, self.constant(by))

    def power(self, a: int, b: int) -> int:
        """a to the b: products for whole b, a root for b = ½."""
        exponent = self.number(b)
        if exponent == 0.5:
            return self.op(Op.SQRT, a)
        if exponent is None or exponent != int(exponent) or not abs(exponent) <= MOST_FACTORS or exponent == 0.0:
            return self.op(Op.POWER, a, b)
        product, square, remaining = None, a, abs(int(exponent))
        while remaining % 3 == 0:
            square, remaining = self.op(Op.CUBE, square), remaining // 3
        while remaining:
            if remaining & 1:
                product = square if product is None else self.multiply(product, square)
            remaining >>= 1
            square = self.op(Op.SQUARE, square) if remaining else square
        assert product is not None
        return product if exponent > 0 else self.op(Op.DIVIDE, self.constant(1.0), product)

    def reduce(self, op: Op, names: Sequence[int]) -> int:
        """MIN, MAX or HYPOT of any number of values."""
        total = names[0]
        for name in names[1:]:
            total = self.op(op, total, name)
        return self.op(Op.ABS, total) if op == Op.HYPOT and len(names) == 1 else total

    def linear(self, terms: Sequence[tuple[float, int]], offset: float = 0.0) -> int:
        """Σ factor · value + offset."""
        total = None
        for factor, name in terms:
            if factor:
                part = self.scale(name, factor)
                total = part if total is None else self.add(total, part)
        return self.constant(offset) if total is None else self.offset(total, offset)
