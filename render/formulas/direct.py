"""Tapes as they stand in the IR, evaluated at points without anything prepared: for patterns, of which each point is asked once.

A function (code, rows, constants, registers): rows of four int32 (op, a, b, c), a register for each of x, y, z and each row.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from ...compiler.tapes import INPUTS, Op, arity
from ..simd.value import F64, I64, Value
from .programs import EMITTERS
from .vectors import BYTES, DIRECT, LANES, VectorMath, load, store

NAME = "direct"
_I32 = ir.IntType(32)


def module() -> ir.Module:
    """The function as LLVM code."""
    made = ir.Module("maquette.direct")
    function = ir.Function(made, DIRECT, f"tape_{NAME}")
    code, count, constants, registers = function.args
    entry, head, again, done = (function.append_basic_block(name) for name in ("entry", "head", "again", "done"))
    b = ir.IRBuilder(entry)
    rows = b.bitcast(code, _I32.as_pointer())
    b.cbranch(b.icmp_signed(">", count, ir.Constant(I64, 0)), head, done)
    b.position_at_end(head)
    at = b.phi(I64)
    at.add_incoming(ir.Constant(I64, 0), entry)
    first = b.mul(at, ir.Constant(I64, 4))
    fields = [b.sext(b.load(b.gep(rows, [b.add(first, ir.Constant(I64, k))])), I64) for k in range(4)]
    switch = b.switch(b.trunc(fields[0], _I32), again)
    for op in Op:
        block = function.append_basic_block(op.name.lower())
        switch.add_case(ir.Constant(_I32, int(op)), block)
        b.position_at_end(block)
        given = [[_operand(b, name, constants, registers)] for name in fields[1 : 1 + arity(op)]]
        (value,) = EMITTERS["points"](VectorMath(b), op, given, ir.Constant(I64, 0))
        out = b.add(at, ir.Constant(I64, INPUTS))
        store(b, registers, b.mul(out, ir.Constant(I64, BYTES)), value)
        b.branch(again)
    b.position_at_end(again)
    onward = b.add(at, ir.Constant(I64, 1))
    at.add_incoming(onward, again)
    b.cbranch(b.icmp_signed("<", onward, count), head, done)
    b.position_at_end(done)
    b.ret_void()
    return made


def _operand(b: Any, name: Any, constants: Any, registers: Any) -> Value:
    """A register, or a constant in every lane."""
    zero = ir.Constant(I64, 0)
    constant = b.icmp_signed("<", name, zero)
    register = load(b, registers, b.mul(b.select(constant, zero, name), ir.Constant(I64, BYTES)))
    place = b.gep(b.bitcast(constants, F64.as_pointer()), [b.not_(name)])
    number = b.load(b.select(constant, place, b.bitcast(registers, F64.as_pointer())))  # never read where there is none
    return Value(b, b.select(constant, Value(b, number, "f", 64).splat(LANES).raw, register.raw), "f", 64)
