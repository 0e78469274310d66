"""Tapes evaluated without being compiled: one function for each of the programs, made once for a machine and kept on disk.

A function (code, rows, registers, constants, state) goes through rows of eight int32 (op, out, a, b, c, choice, 0, 0). Operands of 0
and more are registers of as many vectors as the program's values have; ~k is constant k, whose row of PARTS vectors holds its value
twice, then zeros. `state` is int64 words: the lanes in which something may be undefined, then for each choice the lanes that need its
first operand only, and those that need its second only.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from ...compiler import enclosures, tape_points, tapes
from ...compiler.tapes import Op, arity
from .. import kernels, machine
from ..simd.value import I64
from . import direct
from .programs import EMITTERS, WIDTHS
from .vectors import BYTES, INTERPRETER, LANES, POINTER, ROW, VectorMath, load, store

PARTS = 8  # vectors of a constant
_I32 = ir.IntType(32)


def module_of(program: str) -> ir.Module:
    """The interpreter of one program as LLVM code."""
    module = ir.Module(f"maquette.{program}")
    function = ir.Function(module, INTERPRETER, f"tape_{program}")
    for argument in function.args:
        if argument.type == POINTER:
            argument.add_attribute("noalias")
    code, count, registers, constants, state = function.args
    entry, head, again, done = (function.append_basic_block(name) for name in ("entry", "head", "again", "done"))
    b = ir.IRBuilder(entry)
    rows = b.bitcast(code, _I32.as_pointer())
    b.cbranch(b.icmp_signed(">", count, ir.Constant(I64, 0)), head, done)
    b.position_at_end(head)
    at = b.phi(I64)
    at.add_incoming(ir.Constant(I64, 0), entry)
    first = b.mul(at, ir.Constant(I64, ROW))
    fields = [b.sext(b.load(b.gep(rows, [b.add(first, ir.Constant(I64, k))])), I64) for k in range(6)]
    switch = b.switch(b.trunc(fields[0], _I32), again)
    for op in Op:
        block = function.append_basic_block(op.name.lower())
        switch.add_case(ir.Constant(_I32, int(op)), block)
        b.position_at_end(block)
        given = [_operand(b, program, name, registers, constants) for name in fields[2 : 2 + arity(op)]]
        parts = EMITTERS[program](VectorMath(b, state), op, given, fields[5])
        out = b.mul(fields[1], ir.Constant(I64, WIDTHS[program] * BYTES))
        for k, part in enumerate(parts):
            store(b, registers, b.add(out, ir.Constant(I64, k * BYTES)), part)
        b.branch(again)
    b.position_at_end(again)
    onward = b.add(at, ir.Constant(I64, 1))
    at.add_incoming(onward, again)
    b.cbranch(b.icmp_signed("<", onward, count), head, done)
    b.position_at_end(done)
    b.ret_void()
    return module


def _operand(b: Any, program: str, name: Any, registers: Any, constants: Any) -> list[Any]:
    """The vectors of an operand: a register's or a constant's."""
    width = WIDTHS[program]
    constant = b.icmp_signed("<", name, ir.Constant(I64, 0))
    base = b.select(constant, constants, registers)
    shift = BYTES if program == "turns" else 0  # value, 0, 0, 0 stands from the second vector on
    there = b.add(b.mul(b.not_(name), ir.Constant(I64, PARTS * BYTES)), ir.Constant(I64, shift))
    offset = b.select(constant, there, b.mul(name, ir.Constant(I64, width * BYTES)))
    return [load(b, base, b.add(offset, ir.Constant(I64, k * BYTES))) for k in range(width)]


# --- from code to addresses ---------------------------------------------------------------------------------------------

_engines: dict[str, Any] = {}


def address(program: str) -> int:
    """Where a program's interpreter is; made, or read from disk, the first time."""
    if program not in _engines:
        _engines[program] = _engine(program)
    return _engines[program].get_function_address(f"tape_{program}")


def _engine(program: str) -> Any:
    name = f"tape_{program}-{_sources()}.o"
    path = kernels.CACHE / name
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target())
    try:
        code = path.read_bytes()
    except OSError:
        made = direct.module() if program == direct.NAME else module_of(program)
        code = target().emit_object(optimized(str(made)))
        _keep(path, code)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def _sources() -> str:
    """Tells versions of what the code is made from apart, beside the folder's own name (see kernels.py)."""
    digest = hashlib.sha256(f"{LANES}".encode())
    for module in (tapes, tape_points, enclosures):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()[:16]


def _keep(path: Path, code: bytes) -> None:
    """Write whole or not at all; without a disk to write to, the next process makes it again."""
    part = path.with_suffix(f".{id(code):x}.part")
    try:
        part.write_bytes(code)
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)


def target(opt: int = 2) -> Any:
    """LLVM's description of the machine that kernels are compiled for."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = ",".join(f"{'+' if on else '-'}{name}" for name, on in sorted(machine.FEATURES.items()))
    found = llvm.Target.from_triple(llvm.get_process_triple())
    return found.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=opt, jit=True, codemodel="jitdefault")


def optimized(text: str, level: int = 2) -> Any:
    """A module of LLVM code after the passes of `level`."""
    module = llvm.parse_assembly(text)
    module.verify()
    builder = llvm.create_pass_builder(target(), llvm.create_pipeline_tuning_options(speed_level=level))
    builder.getModulePassManager().run(module, builder)
    return module
