"""Procedural textures from formulas of the point, in the frame of the instance; the same tape in every backend.

With a footprint, a pattern is averaged over it, see pixel_mean.py.

Kernels call the tape evaluator through a pointer that is set for scenes with patterns; other scenes neither compile nor load it.
"""

from __future__ import annotations

import ctypes
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir as lir

from ...compiler import ir
from .. import simd
from ..formula.llvm_math import DIRECT, LANES, POINTER
from ..jit.kernel import separate_helper
from ..lanes import crosslane, ops
from ..simd.llvm_expr import I64
from ..simd.registration import intrinsic, make_array, overload, signature, types
from ..types import Lane, Vec
from . import pixel_mean
from .pixel_mean import WITH_PLACES

FORMULA = int(ir.TextureKind.FORMULA)
MOST_ROWS = 509  # of a pattern's tape; x, y and z take further registers
_ROOM = (MOST_ROWS + 3) * LANES
_SYMBOL = "maquette_direct_slot"
_slot = (ctypes.c_int64 * 1)(0)
llvm.add_symbol(_SYMBOL, ctypes.addressof(_slot))


def link(tables: ir.Tables) -> None:
    """Link the evaluator of patterns, if the scene has any."""
    if (tables.textures.kind == FORMULA).any():
        from ..formula import interpreter  # other scenes do not load these

        _slot[0] = interpreter.address(interpreter.POINT)


# --- over a footprint --------------------------------------------------------------------------------------------


@separate_helper
def _mean_over_pixel(tables: Any, row: Lane, p: Vec, spread: Any) -> Vec:
    """The mean over a parallelogram around p."""
    right, down = (spread[4], spread[5], spread[6]), (spread[7], spread[8], spread[9])
    wide = abs(right[0]) + abs(right[1]) + abs(right[2]) + abs(down[0]) + abs(down[1]) + abs(down[2]) > 0.0
    zero = 0.0 * p[0]
    mean, k = pixel_mean.begin(zero), 0
    while ops.any_lane(mean.open):
        a, b = pixel_mean.offset(k)
        mean = pixel_mean.add(mean, evaluate(tables, row, ops.along(ops.along(p, right, zero + a), down, zero + b)), k, wide)
        k += 1
    return pixel_mean.result(mean)


def evaluate_filtered(tables: Any, row: Lane, p: Vec, spread: Any) -> Vec:
    """The color of patterns at points, averaged over the footprint (Surface.spread) if there is one."""
    return evaluate(tables, row, p) if spread is None or len(spread) < WITH_PLACES else _mean_over_pixel(tables, row, p, spread)


@overload(evaluate_filtered)
def _evaluate_filtered_in_kernels(tables, row, p, spread):
    if isinstance(spread, types.BaseTuple) and len(spread) >= WITH_PLACES:
        return lambda tables, row, p, spread: _mean_over_pixel(tables, row, p, spread)
    return lambda tables, row, p, spread: evaluate(tables, row, p)


# --- at points ----------------------------------------------------------------------------------------------------------


def evaluate(tables: Any, row: Lane, p: Vec) -> Vec:
    """The color of patterns (rows of Textures) at points in instance frames; numbers are gray, undefined values 0."""
    from ...compiler.formula import numpy_interpreter
    from ...compiler.formula.tape import load_tape

    shape = np.broadcast(*p).shape
    color = np.zeros((3, *shape))
    rows = np.broadcast_to(row, shape)
    for pattern in np.unique(rows):
        tape = tables.textures.tape[pattern]
        if tape < 0:
            continue
        lanes = rows == pattern
        values = numpy_interpreter.points(load_tape(tables, int(tape)), *(np.broadcast_to(x, shape)[lanes] for x in p))
        for k in range(3):
            color[k][lanes] = values[min(k, len(values) - 1)]
    color = np.where(np.isfinite(color), color, 0.0)
    return color[0], color[1], color[2]


@overload(evaluate)
def _texel(tables, row, p):
    if isinstance(p[0], simd.Vector) and p[0].bits == 32:
        return _evaluate_float32
    return _evaluate_lanes if isinstance(row, simd.Vector) else _evaluate_scalar


def _evaluate_float32(tables, row, p):
    """For float32 lanes, which no scene with patterns gets from the plan."""
    zero = 0.0 * p[0]
    return zero, zero, zero


def _evaluate_scalar(tables, row, p):
    tape = np.int64(tables.textures.tape[row])
    zero = 0.0 * p[0]
    if tape < 0:
        return zero, zero, zero
    registers = simd.stack_array(np.float64, _ROOM)
    wide = ops.to_float(crosslane.lane_indices(0)) * 0.0
    crosslane.store(registers, 0, wide + p[0])
    crosslane.store(registers, 1, wide + p[1])
    crosslane.store(registers, 2, wide + p[2])
    first, begin = np.int64(tables.tapes.first[tape]), np.int64(tables.tapes.first_constant[tape])
    _run(tables.pools.code, first, np.int64(tables.tapes.count[tape]), tables.pools.constants, begin, registers)
    several = tables.tapes.result_count[tape] > 1
    r = _result(tables, tape, 0, begin, registers, p[0])
    if not several:
        return r, r, r
    return r, _result(tables, tape, 1, begin, registers, p[0]), _result(tables, tape, 2, begin, registers, p[0])


def _evaluate_lanes(tables, row, p):
    zero = 0.0 * p[0]
    color = (zero, zero, zero)
    pending = ops.bool_like(zero, True)
    while ops.any_lane(pending):
        pattern, group = crosslane.uniform_group(row, pending)
        color = ops.where3(group, evaluate(tables, pattern, p), color)
        pending = pending & ops.not_(group)
    return color


def _result(tables: Any, tape: Any, k: int, begin: Any, registers: Any, like: Lane) -> Lane:
    raise NotImplementedError("in kernels only")


@overload(_result)
def _result_kernel(tables, tape, k, begin, registers, like):
    is_vector = isinstance(like, simd.Vector)

    def result(tables, tape, k, begin, registers, like):
        name = np.int64(tables.tapes.results[tape, k])
        value = ops.full_like(like, tables.pools.constants[begin + ~name]) if name < 0 else _of_register(registers, name, like)
        return ops.where(ops.is_finite(value), value, 0.0)

    def number(tables, tape, k, begin, registers, like):
        name = np.int64(tables.tapes.results[tape, k])
        value = tables.pools.constants[begin + ~name] if name < 0 else simd.read(registers, name * LANES)
        return value if abs(value) < np.inf else 0.0

    return result if is_vector else number


def _of_register(registers: Any, name: Any, like: Lane) -> Lane:
    raise NotImplementedError("in kernels only")


@overload(_of_register)
def _of_register_kernel(registers, name, like):
    return lambda registers, name, like: crosslane.load(registers, name)


def place_in_array(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Emit the address of an array's element."""
    data = make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), POINTER)


@intrinsic
def _run(typingctx, code, first, rows, constants, begin, registers):
    """Evaluate the rows of a tape; see formula/interpreter.py."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        module = builder.module
        slot = module.globals.get(_SYMBOL) or lir.GlobalVariable(module, I64, _SYMBOL)
        function = builder.inttoptr(builder.load(slot), DIRECT.as_pointer())
        zero = lir.Constant(I64, 0)
        arguments = [
            place_in_array(context, builder, code, args[0], builder.mul(args[1], lir.Constant(I64, 4))),
            args[2],
            place_in_array(context, builder, constants, args[3], args[4]),
            place_in_array(context, builder, registers, args[5], zero),
        ]
        builder.call(function, arguments)
        return context.get_dummy_value()

    i = types.int64
    return signature(types.void, code, i, i, constants, i, registers), generate
