"""Graph: the interface of an expression graph that rewrites see, with the analysis of its values."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field

from .opcodes import KEEP_WHOLE, STEPS, Op, arity
from .operation_rows import OperationRows
from .piecewise_constant import NOWHERE, Values, constant_values, union
from .tape import INPUTS


@dataclass(eq=False)
class Graph(OperationRows):
    """Rows of operations without duplicates. Methods take and return names of values (tape.py)."""

    may_tie: bool = False  # the operands of any comparison may be equal over a region, even where the analysis finds no such values
    _integers: set[int] = field(default_factory=set)  # values that are whole numbers wherever they are defined
    _constant_values: dict[int, Values] = field(default_factory=dict)  # of values that may be constant over a region
    _choices: dict[int, tuple[int, ...]] = field(default_factory=dict)  # of MIN, MAX, CHOOSE and ABS, the values that they may equal

    @abstractmethod
    def less(self, a: int, b: int, strictly: bool) -> int:
        """A field that is at most 0 where a ≤ b, or a < b."""

    # --- values ---

    def row(self, name: int) -> tuple[Op, int, int]:
        """(operation, first operand, second operand) of a value; a coordinate is a COPY of itself."""
        return (Op(self.rows[name - INPUTS][0]), *self.rows[name - INPUTS][1:3]) if name >= INPUTS else (Op.COPY, name, 0)

    def constant_values(self, name: int) -> Values:
        """The numbers that a value may equal over a whole region."""
        return frozenset({self.constants[~name]}) if name < 0 else self._constant_values.get(name, frozenset())

    def may_be_zero(self, name: int) -> bool:
        """Whether a value may be 0 over a whole region."""
        values = self.constant_values(name)
        return values is None or 0.0 in values

    def is_integer(self, name: int) -> bool:
        """Whether a value is a whole number wherever it is defined."""
        return name in self._integers

    def _append(self, op: Op, a: int, b: int, c: int) -> int:
        """The name of a row, which is new or an equal one."""
        row = (int(op), a, b, c)
        if row not in self._names:
            self.rows.append(row)
            self._names[row] = INPUTS + len(self.rows) - 1
            self._analyse(op, (a, b, c)[: arity(op)])
        return self._names[row]

    def _analyse(self, op: Op, used: tuple[int, ...]) -> None:
        """Record whether the last row is a whole number, and its constant values."""
        name, operands = INPUTS + len(self.rows) - 1, used[1:] if op == Op.CHOOSE else used
        if op in STEPS or (op in KEEP_WHOLE and all(a in self._integers or (a < 0 and self.constants[~a].is_integer()) for a in operands)):
            self._integers.add(name)
        varies = op not in STEPS and not any(a < 0 or a in self._constant_values for a in operands)
        values = NOWHERE if varies else constant_values(op, [self.constant_values(a) for a in operands])
        if op in (Op.MIN, Op.MAX, Op.CHOOSE, Op.ABS):
            self._choices[name] = operands
        if op == Op.SUBTRACT and (self._may_be(operands[0], operands[1]) or self._may_be(operands[1], operands[0])):
            values = union(values, frozenset({0.0}))
        if values is None or values:
            self._constant_values[name] = values

    def _may_be(self, name: int, other: int) -> bool:
        """Whether a value may be another one, by one choice or several. Operands have lower names than their operation."""
        waiting, seen = [name], {name}
        while waiting:
            operands = self._choices.get(waiting.pop(), ())
            if other in operands:
                return True
            fresh = {a for a in operands if a > other} - seen
            seen |= fresh
            waiting += fresh
        return False
