"""Tape interpreters: one LLVM function for each program, compiled once for a machine and stored as an object file.

A function (code, rows, registers, constants, state, vectors) executes rows of eight int32: op (Op or SCALE), out, a, b, c, choice,
whether the row is a minimum or maximum whose value goes only into minima and maxima, 0. An operand ≥ 0 is a register of as many parts as
the program's values have, each part `vectors` vectors. An operand ~k is constant k, a row of PARTS vectors: its value twice, then zeros; in
float32 its bounds, zeros, and the numbers of op_codegen.NEAREST. `state` is int64 words: the lanes in which a value may be undefined, then
for each choice the lanes that need its first operand only, and the lanes that need its second only. In float32, up to four vectors of
sixteen lanes share these words.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir

from ...compiler.formula.opcodes import Op, arity
from ...compiler.formula.tape import INPUTS
from ..jit import cache_key, compile_lock, compile_process, kernel_cache, loader
from ..jit.kernel_file import Code
from ..jit.value_types import NONE
from ..simd.llvm_expr import F64, I64, Value
from .llvm_math import BYTES, DIRECT, INTERPRETER, LANES, POINTER, ROW, SINGLE, VectorMath, load, store
from .loop_codegen import over_rows, over_vectors
from .op_codegen import EMITTERS, LARGEST_PART, NEAREST, SCALE, WIDTHS, emit_scaled, form_of

PARTS = 8  # vectors of a constant
POINT = "direct"  # the program of patterns
UNKNOWN, KNOWN = 256, 257
"""Registers, in float32, of −∞ and ∞, and of known bounds of the result, which decide operands of minima and maxima."""
SHIFTS = {"gradients": 1, "points32": 5}
"""First vector of a constant's row for a program: "gradients" reads value, 0, 0, 0; "points32" skips the bounds."""


def module_of(program: str) -> ir.Module:
    """LLVM code of the interpreter of one program."""
    module = ir.Module(f"maquette.{program}")
    form, width = form_of(program), WIDTHS[program]

    def row(b: Any, op: Any, numbers: list[Any], arguments: Any) -> None:
        if op == SCALE and program == "spans32":
            return _scale(b, numbers, arguments)
        op = Op.MULTIPLY if op == SCALE else op
        registers, constants, state, vectors = arguments[2:]
        stride = b.mul(vectors, ir.Constant(I64, form.bytes))  # between the parts of a register
        operands = [_operand(b, program, name, registers, constants, stride) for name in numbers[2 : 2 + arity(op)]]
        out = b.gep(registers, [b.mul(b.mul(numbers[1], stride), ir.Constant(I64, width))])

        def vector(k: Any) -> None:
            offset = b.mul(k, ir.Constant(I64, form.bytes))
            values = [operand(offset) for operand in operands]
            m = VectorMath(b, state, form, k if form == SINGLE else None, forks=program == "forks")
            if form == SINGLE and op in (Op.MIN, Op.MAX) and width > 1:
                place = b.mul(b.mul(b.add(numbers[6], ir.Constant(I64, UNKNOWN)), stride), ir.Constant(I64, width))
                m.result = [load(b, registers, b.add(b.add(place, offset), b.mul(stride, ir.Constant(I64, part))), form) for part in (0, 1)]
            for part, value in enumerate(EMITTERS[program](m, op, values, numbers[5])):
                store(b, out, b.add(offset, b.mul(stride, ir.Constant(I64, part))), value)

        over_vectors(b, vectors, vector)

    function = over_rows(module, f"tape_{program}", INTERPRETER, ROW, row, (SCALE,))
    for argument in function.args:
        if argument.type == POINTER:
            argument.add_attribute("noalias")
    return module


def _scale(b: Any, numbers: list[Any], arguments: Any) -> None:
    """Emit the product of a register and a constant, in spans32."""
    registers, constants, state, vectors = arguments[2:]
    size = SINGLE.bytes
    stride, width = b.mul(vectors, ir.Constant(I64, size)), ir.Constant(I64, WIDTHS["spans32"])
    source, out = (b.gep(registers, [b.mul(b.mul(name, stride), width)]) for name in (numbers[2], numbers[1]))
    number = b.gep(constants, [b.mul(b.not_(numbers[3]), ir.Constant(I64, PARTS * size))])
    nearest, largest = (load(b, number, part * size, SINGLE) for part in (NEAREST, LARGEST_PART))

    def vector(k: Any) -> None:
        places = [b.add(b.mul(k, ir.Constant(I64, size)), b.mul(stride, ir.Constant(I64, part))) for part in range(WIDTHS["spans32"])]
        product = emit_scaled(VectorMath(b, state, SINGLE, k), [load(b, source, place, SINGLE) for place in places], nearest, largest)
        for place, value in zip(places, product, strict=True):
            store(b, out, place, value)

    over_vectors(b, vectors, vector)


def _operand(b: Any, program: str, name: Any, registers: Any, constants: Any, stride: Any) -> Callable[[Any], list[Any]]:
    """Loader of an operand, a register or a constant: maps an offset in bytes into its parts to the parts' vectors."""
    form, width = form_of(program), WIDTHS[program]
    constant = b.icmp_signed("<", name, ir.Constant(I64, 0))
    shift = ir.Constant(I64, SHIFTS.get(program, 0) * form.bytes)
    constant_offset = b.add(b.mul(b.not_(name), ir.Constant(I64, PARTS * form.bytes)), shift)
    register_offset = b.mul(b.mul(name, stride), ir.Constant(I64, width))
    base = b.gep(b.select(constant, constants, registers), [b.select(constant, constant_offset, register_offset)])
    step, mask = b.select(constant, ir.Constant(I64, form.bytes), stride), b.select(constant, ir.Constant(I64, 0), ir.Constant(I64, -1))

    def parts(offset: Any) -> list[Any]:
        return [load(b, base, b.add(b.and_(offset, mask), b.mul(step, ir.Constant(I64, k))), form) for k in range(width)]

    return parts


def _point_module() -> ir.Module:
    """LLVM code of the interpreter of unprepared tapes from the IR, for patterns, which are evaluated once at a point.

    Its arguments are (code, rows, constants, registers): rows of four int32 (op, a, b, c), a register for each of x, y, z and each row.
    """
    module = ir.Module(f"maquette.{POINT}")

    def row(b: Any, op: Op, numbers: list[Any], arguments: Any) -> None:
        constants, registers = arguments[2:]
        operands = [[point_operand(b, name, constants, registers)] for name in numbers[1 : 1 + arity(op)]]
        (value,) = EMITTERS["points"](VectorMath(b), op, operands, ir.Constant(I64, 0))
        out = b.add(numbers[0], ir.Constant(I64, INPUTS))
        store(b, registers, b.mul(out, ir.Constant(I64, BYTES)), value)

    over_rows(module, f"tape_{POINT}", DIRECT, 4, row)
    return module


def point_operand(b: Any, name: Any, constants: Any, registers: Any) -> Value:
    """Load a register, or broadcast a constant."""
    zero = ir.Constant(I64, 0)
    constant = b.icmp_signed("<", name, zero)
    register = load(b, registers, b.mul(b.select(constant, zero, name), ir.Constant(I64, BYTES)))
    place = b.gep(b.bitcast(constants, F64.as_pointer()), [b.not_(name)])
    number = b.load(b.select(constant, place, b.bitcast(registers, F64.as_pointer())))  # for a register, an unused load
    return Value(b, b.select(constant, Value(b, number, "f", 64).splat(LANES).raw, register.raw), "f", 64)


# --- object files and addresses ------------------------------------------------------------------------------------------

_engines: dict[str, Any] = {}
SEVERAL = 3  # missing interpreters that this process compiles alone


def address(program: str) -> int:
    """Address of a program's interpreter, compiled or read from disk at the first call."""
    if program not in _engines:
        _engines[program] = _engine(program)
    return _engines[program].get_function_address(f"tape_{program}")


def compile_missing(threads: int) -> None:
    """Compile missing interpreters in another process, from the last one on, if there are several."""
    missing = [program for program in WIDTHS if program not in _engines and not is_compiled(program)]
    if len(missing) > SEVERAL and not kernel_cache.must_be_compiled():
        compile_process.run_in_background(threads, compile_programs, tuple(reversed(missing)))


def compile_programs(programs: tuple[str, ...]) -> None:
    """Compile the programs that are not on disk yet."""
    for program in programs:
        if not is_compiled(program):
            address(program)


def is_compiled(program: str) -> bool:
    """Return whether a program's interpreter is on disk."""
    return kernel_cache.has(_file_name(program))


@cache
def _file_name(program: str) -> str:
    """File name with the digest of the modules that the interpreters are compiled from, and their vector width."""
    return f"tape_{program}-{cache_key.key(__name__)}-{LANES}{kernel_cache.SUFFIX}"


def _engine(program: str) -> Any:
    return loader.load_object(code_of(program).code)


def code_of(program: str) -> Code:
    """Code of a program's interpreter, compiled or read from disk."""
    code = kernel_cache.read(_file_name(program))
    if code is None:
        if kernel_cache.must_be_compiled():
            raise kernel_cache.NotCompiled(f"interpreter {program}")
        with compile_lock.compiling(kernel_cache.CACHE / _file_name(program)):
            code = kernel_cache.read(_file_name(program))  # another process may have compiled it
            if code is None:
                code = _compile(program)
                kernel_cache.write(_file_name(program), code)
    return code


def _compile(program: str) -> Code:
    module = _point_module() if program == POINT else module_of(program)
    machine = loader.target_machine(1)  # level 2 takes twice the compile time and renders no faster
    name = f"tape_{program}"
    return Code(name, name, NONE, (), machine.emit_object(optimize(str(module))))


def optimize(text: str, level: int = 2) -> Any:
    """Parse LLVM code and run the passes of `level`."""
    module = llvm.parse_assembly(text)
    module.verify()
    builder = llvm.create_pass_builder(loader.target_machine(), llvm.create_pipeline_tuning_options(speed_level=level))
    builder.getModulePassManager().run(module, builder)
    return module
