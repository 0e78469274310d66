"""LLVM loops: the dispatch loop over tape rows with an opcode switch, and the loop over vectors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir

from ...compiler.formula.opcodes import Op
from ..simd.llvm_expr import I64

_I32 = ir.IntType(32)


Row = Callable[[Any, Any, list[Any], Any], None]


def over_rows(module: ir.Module, name: str, kind: Any, row: int, emit: Row, more: tuple[int, ...] = ()) -> Any:
    """Add a function `name` of type `kind` that executes the rows of a tape; its first arguments are the rows and their number.

    A row has `row` int32 numbers. `emit(builder, operation, numbers as int64, arguments)` emits a row's code for each operation of Op and
    `more`; numbers[0] is the row's index.
    """
    function = ir.Function(module, kind, name)
    code, count = function.args[:2]
    entry, head, again, done = (function.append_basic_block(block) for block in ("entry", "head", "again", "done"))
    b = ir.IRBuilder(entry)
    rows = b.bitcast(code, _I32.as_pointer())
    b.cbranch(b.icmp_signed(">", count, ir.Constant(I64, 0)), head, done)
    b.position_at_end(head)
    index = b.phi(I64)
    index.add_incoming(ir.Constant(I64, 0), entry)
    first = b.mul(index, ir.Constant(I64, row))
    numbers = [b.sext(b.load(b.gep(rows, [b.add(first, ir.Constant(I64, k))])), I64) for k in range(min(row, 7))]
    switch = b.switch(b.trunc(numbers[0], _I32), again)
    for op in (*Op, *more):
        block = function.append_basic_block(op.name.lower() if isinstance(op, Op) else f"more{op}")
        switch.add_case(ir.Constant(_I32, int(op)), block)
        b.position_at_end(block)
        emit(b, op, [index, *numbers[1:]], function.args)
        b.branch(again)
    b.position_at_end(again)
    onward = b.add(index, ir.Constant(I64, 1))
    index.add_incoming(onward, again)
    b.cbranch(b.icmp_signed("<", onward, count), head, done)
    b.position_at_end(done)
    b.ret_void()
    return function


def over_vectors(b: Any, count: Any, body: Callable[[Any], None]) -> None:
    """Emit a loop of body(vector number) over 0 … count − 1; it runs at least once."""
    before = b.block
    again, done = b.function.append_basic_block("vector"), b.function.append_basic_block("after")
    b.branch(again)
    b.position_at_end(again)
    k = b.phi(I64)
    k.add_incoming(ir.Constant(I64, 0), before)
    body(k)
    onward = b.add(k, ir.Constant(I64, 1))
    k.add_incoming(onward, b.block)
    b.cbranch(b.icmp_signed("<", onward, count), again, done)
    b.position_at_end(done)
