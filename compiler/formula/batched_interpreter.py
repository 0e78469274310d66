"""Whole tapes on numpy arrays, equal operations side by side: what tape_walks gives, in a fraction of the calls where a tape is long."""

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

FEWEST_PLACES, MOST_NUMBERS = 512, 1 << 18  # that are gone through at a time: of short tapes more places
MOST_ROWS = 64  # for which an operation is done at a time: their numbers stay in the processor's cache


class Batches:
    """A tape in another order: by how many operations are below each, and among these by operation.

    Of its table's rows the first are constants, then come x, y and z.
    """

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

        given = row_of(tape.code[:, 1:]).tolist()
        self.result = int(row_of(np.array(tape.results[:1]))[0])
        self.rows, self.inputs = len(place), slice(len(self.constants), len(self.constants) + INPUTS)
        self._at_once = max(FEWEST_PLACES, MOST_NUMBERS // self.rows)
        self.steps: list[tuple[int, Any, list[Any]]] = []  # (operation, rows to fill, rows of each operand)
        for (_, op), whole in order:
            for begin in range(0, len(whole), MOST_ROWS):
                rows = whole[begin : begin + MOST_ROWS]
                operands = [_rows([given[i][k] for i in rows]) for k in range(arity(op))]
                self.steps.append((op, _rows(range(first, first + len(rows))), operands))
                first += len(rows)

    def _tables(self, places: int, count: int) -> list[np.ndarray]:
        """For the values at so many places, with the constants."""
        tables = [np.empty((self.rows, min(places, self._at_once))) for _ in range(count)]
        for table in tables:
            table[: len(self.constants)] = self.constants[:, None]
        return tables

    def _parts(self, places: int) -> list[slice]:
        return [slice(begin, min(begin + self._at_once, places)) for begin in range(0, places, self._at_once)]

    def points(self, places: np.ndarray) -> np.ndarray:
        """The first result at places (3, n): see tape_walks.points."""
        n = places.shape[1]
        found, (whole,), m = np.empty(n), self._tables(n, 1), NumpyMath()
        for part in self._parts(n):
            table = whole[:, : part.stop - part.start]
            table[self.inputs] = places[:, part]
            with np.errstate(all="ignore"):
                for op, to, given in self.steps:
                    table[to] = point(m, op, *(table[rows] for rows in given))
            found[part] = table[self.result]
        return found

    def boxes(self, low: np.ndarray, high: np.ndarray) -> tuple[Interval, np.ndarray]:
        """(bounds of the first result over boxes with corners (3, n), whether parts may be undefined): see tape_walks.boxes, than which
        they are wider where a choice comes before something else in the tape that may be undefined."""
        n = low.shape[1]
        least, most, maybe = np.empty(n), np.empty(n), np.empty(n, bool)
        tables = self._tables(n, 2)
        for part in self._parts(n):
            size = part.stop - part.start
            lows, highs = (table[:, :size] for table in tables)
            m = _Together((size,))
            lows[self.inputs], highs[self.inputs] = low[:, part], high[:, part]
            with np.errstate(all="ignore"):
                for op, to, given in self.steps:
                    lows[to], highs[to] = interval(m, op, *((lows[rows], highs[rows]) for rows in given))
            least[part], most[part], maybe[part] = lows[self.result], highs[self.result], m.maybe
        return (least, most), maybe


@lru_cache(maxsize=2)
def batches(tape: Tape) -> Batches:
    """A tape's, which is asked for several times in a row."""
    return Batches(tape)


class _Together(NumpyMath):
    """Arithmetic on several rows at a time: what is undefined in one of them is so for a place."""

    def undefined(self, mask: np.ndarray) -> None:
        super().undefined(mask.any(axis=0) if mask.ndim > 1 else mask)


def _rows(rows: Sequence[int]) -> Any:
    """Of one row its number, of neighbours a slice: numpy copies none of these."""
    if len(rows) == 1:
        return rows[0]
    return slice(rows[0], rows[-1] + 1) if list(rows) == list(range(rows[0], rows[0] + len(rows))) else np.array(rows)
