"""Rows of operations without duplicates, and the arithmetic that graphs of formulas and of textures share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

from .opcodes import Op


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
