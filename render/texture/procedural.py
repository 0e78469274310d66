"""Patterns: textures that are formulas of the point, in the frame of the thing they are on; the same tape in every backend.

Where it is known what a pixel spans, a pattern is averaged over that, at the places of Roberts' R2 sequence ("The unreasonable
effectiveness of quasirandom sequences", 2018), which are spread evenly whatever number of them is taken.

Kernels reach the function that evaluates tapes by a slot that is filled when a scene has patterns: others neither compile nor
load it.
"""

from __future__ import annotations

import ctypes
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir as lir
from numba import types
from numba.core.typing.templates import signature
from numba.extending import overload
from numba.np.arrayobj import make_array

from ...compiler import ir
from .. import simd
from ..formula.llvm_math import DIRECT, LANES, POINTER
from ..jit.kernel import HELPER, noinline_helper
from ..lanes import crosslane, ops
from ..simd.llvm_expr import I64
from ..simd.vector_type import intrinsic
from ..types import Lane, Vec

FORMULA = int(ir.TextureKind.FORMULA)
MOST_ROWS = 509  # of a pattern's tape: with x, y and z as many values are kept
WITH_PLACES = 10  # lanes of a Surface's spread where it holds how far places go
SOME, MOST = 16, 64  # places that are looked at: these, and if they differ much these
ROUGH = 1 / 64  # of the mean: an error of it that asks for more places
STEP_A, STEP_B = 0.7548776662466927, 0.5698402909980532  # the powers of the plastic number's inverse: places spread evenly, however many
_ROOM = (MOST_ROWS + 3) * LANES
_SYMBOL = "maquette_direct_slot"
_slot = (ctypes.c_int64 * 1)(0)
llvm.add_symbol(_SYMBOL, ctypes.addressof(_slot))


def make_ready(tables: ir.Tables) -> None:
    """Make what kernels evaluate patterns with, where there are any."""
    if (tables.textures.kind == FORMULA).any():
        from ..formula import interpreter, point_interpreter  # what other scenes do not load

        _slot[0] = interpreter.address(point_interpreter.NAME)


# --- over what a pixel spans --------------------------------------------------------------------------------------------


@noinline_helper
def _over(tables: Any, row: Lane, p: Vec, spread: Any) -> Vec:
    """The mean over a parallelogram about p: of SOME places, or of MOST where these differ much."""
    right, down = (spread[4], spread[5], spread[6]), (spread[7], spread[8], spread[9])
    wide = abs(right[0]) + abs(right[1]) + abs(right[2]) + abs(down[0]) + abs(down[1]) + abs(down[2]) > 0.0
    zero = 0.0 * p[0]
    total, square, count = (zero, zero, zero), zero, zero
    open_ = ops.bool_like(zero, True)
    k = 0
    while ops.any_lane(open_):
        number, side = (k >> 1) + 1, 1.0 - 2.0 * (k & 1)  # each place and the one opposite: what is linear over a pixel has its mean
        a, b = side * ((0.5 + STEP_A * number) % 1.0 - 0.5), side * ((0.5 + STEP_B * number) % 1.0 - 0.5)
        q = ops.along(ops.along(p, right, zero + a), down, zero + b)
        r, g, b_ = texel(tables, row, q)
        grey = r + g + b_
        total = ops.where3(open_, ops.add(total, (r, g, b_)), total)
        square = ops.where(open_, square + grey * grey, square)
        count = ops.where(open_, count + 1.0, count)
        k += 1
        open_ = open_ & wide & (k < MOST)
        if k == SOME:  # their mean's error, were they random; they are not, and so it is less
            middle = (total[0] + total[1] + total[2]) / count
            open_ = open_ & (square / count - middle * middle > SOME * ROUGH * ROUGH * middle * middle)
    return ops.scale(total, 1.0 / count)


def seen(tables: Any, row: Lane, p: Vec, spread: Any) -> Vec:
    """The colour of patterns at points, over what a pixel spans there (Surface.spread) where that is known."""
    return texel(tables, row, p) if spread is None or len(spread) < WITH_PLACES else _over(tables, row, p, spread)


@overload(seen, jit_options=HELPER)
def _seen_in_kernels(tables, row, p, spread):
    if isinstance(spread, types.BaseTuple) and len(spread) >= WITH_PLACES:
        return lambda tables, row, p, spread: _over(tables, row, p, spread)
    return lambda tables, row, p, spread: texel(tables, row, p)


# --- at points ----------------------------------------------------------------------------------------------------------


def texel(tables: Any, row: Lane, p: Vec) -> Vec:
    """The colour of patterns (rows of Textures) at points in the things' own frames; a number is grey. 0 where it is not defined."""
    from ...compiler.formula import numpy_interpreter
    from ...compiler.formula.tape import load_tape

    shape = np.broadcast(*p).shape
    found = np.zeros((3, *shape))
    rows = np.broadcast_to(row, shape)
    for one in np.unique(rows):
        tape = tables.textures.tape[one]
        if tape < 0:
            continue
        here = rows == one
        values = numpy_interpreter.points(load_tape(tables, int(tape)), *(np.broadcast_to(x, shape)[here] for x in p))
        for k in range(3):
            found[k][here] = values[min(k, len(values) - 1)]
    found = np.where(np.isfinite(found), found, 0.0)
    return found[0], found[1], found[2]


@overload(texel, jit_options=HELPER)
def _texel(tables, row, p):
    if isinstance(p[0], simd.Vector) and p[0].bits == 32:
        return _of_none
    return _of_many if isinstance(row, simd.Vector) else _of_one


def _of_none(tables, row, p):
    """In lanes of float32, which the plan's `precision` and `raster.precision` give to no scene with patterns."""
    zero = 0.0 * p[0]
    return zero, zero, zero


def _of_one(tables, row, p):
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


def _of_many(tables, row, p):
    zero = 0.0 * p[0]
    found = (zero, zero, zero)
    rest = ops.bool_like(zero, True)
    while ops.any_lane(rest):
        one, here = crosslane.uniform_group(row, rest)
        found = ops.where3(here, texel(tables, one, p), found)
        rest = rest & ops.not_(here)
    return found


def _result(tables: Any, tape: Any, k: int, begin: Any, registers: Any, like: Lane) -> Lane:
    raise NotImplementedError("in kernels only")


@overload(_result, jit_options=HELPER)
def _result_kernel(tables, tape, k, begin, registers, like):
    whole = isinstance(like, simd.Vector)

    def result(tables, tape, k, begin, registers, like):
        name = np.int64(tables.tapes.results[tape, k])
        found = ops.full_like(like, tables.pools.constants[begin + ~name]) if name < 0 else _of_register(registers, name, like)
        return ops.where(ops.is_finite(found), found, 0.0)

    def number(tables, tape, k, begin, registers, like):
        name = np.int64(tables.tapes.results[tape, k])
        found = tables.pools.constants[begin + ~name] if name < 0 else simd.read(registers, name * LANES)
        return found if abs(found) < np.inf else 0.0

    return result if whole else number


def _of_register(registers: Any, name: Any, like: Lane) -> Lane:
    raise NotImplementedError("in kernels only")


@overload(_of_register, jit_options=HELPER)
def _of_register_kernel(registers, name, like):
    return lambda registers, name, like: crosslane.load(registers, name)


@intrinsic
def _run(typingctx, code, first, rows, constants, begin, registers):
    """Evaluate the rows of a tape; see formulas/direct.py."""

    def place(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
        data = make_array(kind)(context, builder, array).data
        return builder.bitcast(builder.gep(data, [index]), POINTER)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        module = builder.module
        slot = module.globals.get(_SYMBOL) or lir.GlobalVariable(module, I64, _SYMBOL)
        function = builder.inttoptr(builder.load(slot), DIRECT.as_pointer())
        zero = lir.Constant(I64, 0)
        given = [
            place(context, builder, code, args[0], builder.mul(args[1], lir.Constant(I64, 4))),
            args[2],
            place(context, builder, constants, args[3], args[4]),
            place(context, builder, registers, args[5], zero),
        ]
        builder.call(function, given)
        return context.get_dummy_value()

    i = types.int64
    return signature(types.void, code, i, i, constants, i, registers), generate
