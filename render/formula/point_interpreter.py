"""Point interpreter of unprepared tapes from the IR, for patterns, which are evaluated once at a point.

The function has the arguments (code, rows, constants, registers): rows of four int32 (op, a, b, c), a register for each of x, y, z and each
row.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from ...compiler.formula.opcodes import Op, arity
from ...compiler.formula.tape import INPUTS
from ..simd.llvm_expr import F64, I64, Value
from .llvm_math import BYTES, DIRECT, LANES, VectorMath, load, store
from .loop_codegen import over_rows
from .op_codegen import EMITTERS

NAME = "direct"


def module() -> ir.Module:
    """LLVM code of the interpreter."""
    made = ir.Module("maquette.direct")

    def row(b: Any, op: Op, numbers: list[Any], arguments: Any) -> None:
        constants, registers = arguments[2:]
        given = [[_operand(b, name, constants, registers)] for name in numbers[1 : 1 + arity(op)]]
        (value,) = EMITTERS["points"](VectorMath(b), op, given, ir.Constant(I64, 0))
        out = b.add(numbers[0], ir.Constant(I64, INPUTS))
        store(b, registers, b.mul(out, ir.Constant(I64, BYTES)), value)

    over_rows(made, f"tape_{NAME}", DIRECT, 4, row)
    return made


def _operand(b: Any, name: Any, constants: Any, registers: Any) -> Value:
    """Load a register, or broadcast a constant."""
    zero = ir.Constant(I64, 0)
    constant = b.icmp_signed("<", name, zero)
    register = load(b, registers, b.mul(b.select(constant, zero, name), ir.Constant(I64, BYTES)))
    place = b.gep(b.bitcast(constants, F64.as_pointer()), [b.not_(name)])
    number = b.load(b.select(constant, place, b.bitcast(registers, F64.as_pointer())))  # for a register, an unused load
    return Value(b, b.select(constant, Value(b, number, "f", 64).splat(LANES).raw, register.raw), "f", 64)
