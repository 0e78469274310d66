"""numpy interpreter of tapes: values, gradients and interval bounds, operation by operation.

It defines the meaning of formulas; kernels are tested against it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .derivative_bounds import slope_intervals
from .interval_arithmetic import Interval
from .interval_semantics import interval
from .opcodes import arity
from .point_semantics import NumpyMath, point, slopes
from .tape import Tape

Look = Callable[[int, list[Any], list[list[Any]]], None]


def points(tape: Tape, x: Any, y: Any, z: Any) -> list[np.ndarray]:
    """The results of a tape at points; NaN where undefined, without warnings."""
    m = NumpyMath()
    values: list[Any] = list(np.broadcast_arrays(*(np.asarray(p, np.float64) for p in (x, y, z))))
    shape = values[0].shape
    with np.errstate(all="ignore"):
        for op, *operands in tape.code.tolist():
            values.append(point(m, op, *(_operand(tape, values, name) for name in operands[: arity(op)])))
        return [np.broadcast_to(_operand(tape, values, name), shape) for name in tape.results]


def gradients(tape: Tape, x: Any, y: Any, z: Any, look: Look | None = None) -> tuple[np.ndarray, np.ndarray]:
    """(value, (3, …) gradient) of a tape's first result. `look` is called for each operation with its operands and their gradients."""
    m = NumpyMath()
    values: list[Any] = list(np.broadcast_arrays(*(np.asarray(p, np.float64) for p in (x, y, z))))
    zero = np.zeros(values[0].shape)
    turns: list[list[Any]] = [[zero + (k == n) for n in range(3)] for k in range(3)]

    def turn(name: int) -> list[Any]:
        return turns[name] if name >= 0 else [zero, zero, zero]

    with np.errstate(all="ignore"):
        for op, *operands in tape.code.tolist():
            names = operands[: arity(op)]
            given, ways = [_operand(tape, values, name) + zero for name in names], [turn(name) for name in names]
            if look:
                look(op, given, ways)
            value = point(m, op, *given)
            turns.append(slopes(m, op, given, value, ways))
            values.append(value)
        result = tape.results[0]
        return _operand(tape, values, result) + zero, np.stack(np.broadcast_arrays(*turn(result)))


def _operand(tape: Tape, values: list[Any], name: int) -> Any:
    """The value of a name."""
    return values[name] if name >= 0 else tape.constants[~name]


def boxes(tape: Tape, low: Any, high: Any, along: Any = None, ways: Any = None) -> tuple[Interval, Interval, np.ndarray]:
    """Bounds of a tape's first result over boxes with corners (3, n): ((low, high), bounds of its slope, whether parts may be undefined).

    The slope is the derivative along `along` (3, n); without it that pair is NaN. With `ways` (n,), operations that jump take one side in
    each box, by the binary digits of these integers; see interval_arithmetic.one_side.
    """
    n = np.shape(low)[-1]
    m = NumpyMath((n,), ways)
    zero = np.zeros(n)
    values: list[Interval] = [(np.asarray(low[k], np.float64), np.asarray(high[k], np.float64)) for k in range(3)]
    turns: list[Interval] = [(zero, zero) if along is None else (along[k] + zero, along[k] + zero) for k in range(3)]

    def named(name: int) -> Interval:
        return values[name] if name >= 0 else (zero + tape.constants[~name],) * 2

    def turn(name: int) -> Interval:
        return turns[name] if name >= 0 else (zero, zero)

    with np.errstate(all="ignore"):
        for op, *operands in tape.code.tolist():
            used = operands[: arity(op)]
            given = [named(name) for name in used]
            value = interval(m, op, *given)
            if along is not None:
                turns.append(slope_intervals(m, op, given, value, [[turn(name)] for name in used])[0])
            values.append(value)
    result = tape.results[0]
    slope = turn(result) if along is not None else (zero + np.nan, zero + np.nan)
    return named(result), slope, m.maybe
