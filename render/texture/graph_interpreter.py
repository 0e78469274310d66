"""Interpreter of texture graphs: one LLVM function, compiled once for a machine and stored as an object file.

Its arguments are (code, rows, constants, registers, first): rows of four int32 (op, a, b, c), the number of the first one, and a register
of a vector for each name. It passes over look-ups, which the kernel makes between two calls.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from llvmlite import ir

from ...compiler.formula.tape import INPUTS
from ...compiler.texture_graph import noise
from ...compiler.texture_graph.opcodes import Op, arity
from ..formula.interpreter import optimize, point_operand
from ..formula.llvm_math import BYTES, LANES, POINTER, VectorMath, store
from ..formula.loop_codegen import over_rows
from ..jit import cache_key, compile_lock, kernel_cache, loader
from ..jit.kernel_file import Code
from ..jit.value_types import NONE
from ..simd.llvm_expr import I64, Value, select
from ..simd.polynomials import to_integer

GRAPH = ir.FunctionType(ir.VoidType(), [POINTER, I64, POINTER, POINTER, I64])
_NAME = "tape_graph"
_OPS = tuple(int(op) for op in Op if op < Op.LOOK_UP)


class GraphMath(VectorMath):
    """Arithmetic on vectors, with the integers of MaterialX's hash."""

    def to_bits(self, x: Value) -> Value:
        bounded = select(abs(x) < 2.0**31, x, x.constant(0.0))
        return to_integer(bounded).to("u", 32)

    def from_bits(self, x: Value) -> Value:
        return x.to("f", 64)


def module() -> ir.Module:
    """LLVM code of the interpreter."""
    result = ir.Module("maquette.graph")

    def row(b: Any, op: Any, numbers: list[Any], arguments: Any) -> None:
        constants, registers, first = arguments[2:]
        operands = [point_operand(b, name, constants, registers) for name in numbers[1 : 1 + arity(op)]]
        value = noise.point(GraphMath(b), op, *operands)
        out = b.add(b.add(numbers[0], first), ir.Constant(I64, INPUTS))
        store(b, registers, b.mul(out, ir.Constant(I64, BYTES)), value)

    over_rows(result, _NAME, GRAPH, 4, row, _OPS)
    return result


@cache
def address() -> int:
    """Address of the interpreter, compiled or read from disk at the first call."""
    engine = loader.load_object(_code().code)
    _engines.append(engine)
    return engine.get_function_address(_NAME)


_engines: list[Any] = []  # kept alive


def _code() -> Code:
    name = f"{_NAME}-{cache_key.key(__name__)}-{LANES}{kernel_cache.SUFFIX}"
    code = kernel_cache.read(name)
    if code is None:
        if kernel_cache.must_be_compiled():
            raise kernel_cache.NotCompiled("interpreter of texture graphs")
        with compile_lock.compiling(kernel_cache.CACHE / name):
            code = kernel_cache.read(name)  # another process may have compiled it
            if code is None:
                data = loader.target_machine(1).emit_object(optimize(str(module())))
                code = Code(_NAME, _NAME, NONE, (), data)
                kernel_cache.write(name, code)
    return code
