"""Recognizes formulas of ellipsoids: a quadratic polynomial becomes a sphere under a transform."""

from __future__ import annotations

import numpy as np

from .opcodes import Op, arity
from .tape import INPUTS, Tape

Quadratic = np.ndarray  # (4, 4) symmetric: p ↦ (p, 1) · Q · (p, 1)
_TINY = 1e-12


def ellipsoid(tape: Tape) -> np.ndarray | None:
    """The matrix (4, 4) from the unit ball to the solid of a tape, if that is an ellipsoid; else None."""
    with np.errstate(over="ignore", invalid="ignore"):
        q = quadratic(tape)
    if q is None or not np.isfinite(q).all():
        return None
    form, linear, rest = q[:3, :3], q[:3, 3], q[3, 3]
    values, axes = np.linalg.eigh(form)
    if not (values[0] > _TINY * values[2] and np.isfinite(values).all()):
        return None
    center = -np.linalg.solve(form, linear)
    level = -(rest + float(linear @ center))
    if not level > _TINY * float(np.abs(center) @ np.abs(form) @ np.abs(center)):
        return None
    if np.ptp(values) < _TINY * values[2]:
        axes = np.eye(3)  # a ball has no preferred axes
    elif np.abs(form - np.diag(np.diag(form))).max() < _TINY * values[2]:
        axes, values = np.eye(3), np.diag(form)
    elif np.linalg.det(axes) < 0:
        axes = axes * [1.0, 1.0, -1.0]
    matrix = np.eye(4)
    matrix[:3, :3] = axes * np.sqrt(level / values)
    matrix[:3, 3] = center
    return matrix


def quadratic(tape: Tape) -> Quadratic | None:
    """The polynomial of a tape, of degree 2 at most; None for other functions."""
    values: list[Quadratic | None] = []
    for axis in range(INPUTS):
        coordinate = np.zeros((4, 4))
        coordinate[axis, 3] = coordinate[3, axis] = 0.5
        values.append(coordinate)

    def named(name: int) -> Quadratic | None:
        if name >= 0:
            return values[name]
        constant = np.zeros((4, 4))
        constant[3, 3] = tape.constants[~name]
        return constant

    for op, *operands in tape.code.tolist():
        values.append(_applied(Op(op), [named(name) for name in operands[: arity(op)]]))
        if values[-1] is None and len(tape.results) == 1:
            return None  # a tape has no unused rows
    return named(tape.results[0])


def _applied(op: Op, operands: list[Quadratic | None]) -> Quadratic | None:
    a, b = operands[0], operands[-1]
    if a is None or b is None or len(operands) > 2:
        return None
    match op:
        case Op.COPY:
            return a
        case Op.NEGATE:
            return -a
        case Op.ADD:
            return a + b
        case Op.SUBTRACT:
            return a - b
        case Op.MULTIPLY | Op.SQUARE:
            return _product(a, b)
        case Op.DIVIDE:
            return a / b[3, 3] if not _bends(b) and not b[:3, 3].any() and b[3, 3] else None
    return None


def _bends(a: Quadratic) -> bool:
    return bool(a[:3, :3].any())


def _product(a: Quadratic, b: Quadratic) -> Quadratic | None:
    """The product of two linear functions, or of a quadratic one and a constant."""
    if not _bends(a) and not a[:3, 3].any():
        return b * a[3, 3]
    if not _bends(b) and not b[:3, 3].any():
        return a * b[3, 3]
    if _bends(a) or _bends(b):
        return None
    first, second = (np.append(2 * f[:3, 3], f[3, 3]) for f in (a, b))
    return 0.5 * (np.outer(first, second) + np.outer(second, first))
