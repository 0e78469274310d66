"""numpy evaluation of texture graphs: the definition that kernels are tested against."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..formula.tape import Tape
from . import noise
from .opcodes import CHANNELS, Op, U, arity

LookUp = Callable[[int, np.ndarray, np.ndarray], Sequence[np.ndarray]]
"""(row of an image texture, s, t) → red, green, blue, alpha."""


def values(tape: Tape, inputs: Sequence[Any], look_up: LookUp) -> dict[int, np.ndarray]:
    """The values of all rows of a tape by name, at points with the inputs x, y, z, u, v and the three parts of the normal."""
    m = noise.NumpyMath()
    arrays = np.broadcast_arrays(*(np.asarray(number, np.float64) for number in inputs))
    named: dict[int, Any] = dict(enumerate(arrays[:3])) | {U + k: stream for k, stream in enumerate(arrays[3:])}
    shape = arrays[0].shape

    def value(name: int) -> np.ndarray:
        return named[name] if name >= 0 else np.broadcast_to(np.float64(tape.constants[~name]), shape)

    with np.errstate(all="ignore"):
        for row, (op, *operands) in enumerate(tape.code.tolist()):
            if op == Op.LOOK_UP:
                texels = look_up(int(tape.constants[~operands[2]]), value(operands[0]), value(operands[1]))
                named |= {3 + row + k: np.broadcast_to(texels[k], shape) for k in range(CHANNELS)}
            elif op != Op.CHANNEL:
                named[3 + row] = noise.point(m, op, *(value(name) for name in operands[: arity(op)]))
    return named | {~k: np.broadcast_to(number, shape) for k, number in enumerate(tape.constants)}


def results(tape: Tape, inputs: Sequence[Any], look_up: LookUp) -> list[np.ndarray]:
    """The results of a tape at points; NaN where undefined."""
    named = values(tape, inputs, look_up)
    return [named[name] for name in tape.results]
