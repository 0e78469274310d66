"""numpy interpreter that evaluates equal opcodes in one call: much faster than numpy_interpreter on long tapes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from .interval_arithmetic import Interval
from .interval_semantics import interval
from .opcodes import arity
from .point_semantics import NumpyMath, point
from .tape import INPUTS, Tape

FEWEST_PLACES, MOST_NUMBERS = 512, 1 << 18  # of a batch: short tapes have more points in one
MOST_ROWS = 64  # of an operation in one call: their values stay in the cache


class Batches:
    """A tape sorted by depth, then by opcode. The rows of its table are constants, then x, y and z, then operations."""

    def __init__(self, tape: Tape) -> None:
        self.constants = np.asarray(tape.constants, np.float64)
        first, code = len(self.constants) + INPUTS, tape.code.tolist()
        groups: dict[tuple[int, int], list[int]] = {}
        levels = [0] * INPUTS
        for i, (op, *operands) in enumerate(code):
            level = 1 + max([levels[name] if name >= 0 else 0 for name in operands[: arity(op)]])
            levels.append(level)
            groups.setdefault((level, op), []).append(i)
        order = sorted(groups.items())
        place = np.arange(first + len(code))
        place[[first + i for _, rows in order for i in rows]] = np.arange(first, len(place))

        def row_of(names: np.ndarray) -> np.ndarray:
            return place[np.where(names < 0, ~names, names + len(self.constants))]

        operand_rows = row_of(tape.code[:, 1:]).tolist()
        self.result = int(row_of(np.array(tape.results[:1]))[0])
        self.rows, self.inputs = len(place), slice(len(self.constants), len(self.constants) + INPUTS)
        self._at_once = max(FEWEST_PLACES, MOST_NUMBERS // self.rows)
        self.steps: list[tuple[int, Any, list[Any]]] = []  # (operation, rows to fill, rows of each operand)
        for (_, op), members in order:
            for begin in range(0, len(members), MOST_ROWS):
                rows = members[begin : begin + MOST_ROWS]
                operands = [_rows([operand_rows[i][k] for i in rows]) for k in range(arity(op))]
                self.steps.append((op, _rows(range(first, first + len(rows))), operands))
                first += len(rows)

    def _tables(self, places: int, count: int) -> list[np.ndarray]:
        """Tables of values for a number of points, with the constants filled in."""
        tables = [np.empty((self.rows, min(places, self._at_once))) for _ in range(count)]
        for table in tables:
            table[: len(self.constants)] = self.constants[:, None]
        return tables

    def _parts(self, places: int) -> list[slice]:
        return [slice(begin, min(begin + self._at_once, places)) for begin in range(0, places, self._at_once)]

    def points(self, places: np.ndarray) -> np.ndarray:
        """The first result at points (3, n): see numpy_interpreter.points."""
        n = places.shape[1]
        values, (buffer,), m = np.empty(n), self._tables(n, 1), NumpyMath()
        for part in self._parts(n):
            table = buffer[:, : part.stop - part.start]
            table[self.inputs] = places[:, part]
            with np.errstate(all="ignore"):
                for op, to, operands in self.steps:
                    table[to] = point(m, op, *(table[rows] for rows in operands))
            values[part] = table[self.result]
        return values

    def boxes(self, low: np.ndarray, high: np.ndarray) -> tuple[Interval, np.ndarray]:
        """(bounds of the first result over boxes with corners (3, n), whether parts may be undefined): see numpy_interpreter.boxes.

        They are wider where a choice precedes another operation that may be undefined.
        """
        n = low.shape[1]
        least, most, maybe = np.empty(n), np.empty(n), np.empty(n, bool)
        tables = self._tables(n, 2)
        for part in self._parts(n):
            size = part.stop - part.start
            lows, highs = (table[:, :size] for table in tables)
            m = _Together((size,))
            lows[self.inputs], highs[self.inputs] = low[:, part], high[:, part]
            with np.errstate(all="ignore"):
                for op, to, operands in self.steps:
                    lows[to], highs[to] = interval(m, op, *((lows[rows], highs[rows]) for rows in operands))
            least[part], most[part], maybe[part] = lows[self.result], highs[self.result], m.maybe
        return (least, most), maybe


@lru_cache(maxsize=2)
def batches(tape: Tape) -> Batches:
    """The cached batches of a tape."""
    return Batches(tape)


class _Together(NumpyMath):
    """Arithmetic on several rows: a point is undefined where any row is."""

    def undefined(self, mask: np.ndarray) -> None:
        super().undefined(mask.any(axis=0) if mask.ndim > 1 else mask)


def _rows(rows: Sequence[int]) -> Any:
    """An index of rows: a number or a slice where possible, which numpy does not copy."""
    if len(rows) == 1:
        return rows[0]
    return slice(rows[0], rows[-1] + 1) if list(rows) == list(range(rows[0], rows[0] + len(rows))) else np.array(rows)
