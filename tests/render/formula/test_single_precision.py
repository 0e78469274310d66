"""float32 programs: bounds of values and slopes hold at all points of a box, and errors of values stay within their bound."""

from __future__ import annotations

import os

import numpy as np
import pytest
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.opcodes import Op, arity
from maquette.compiler.formula.tape import Tape
from maquette.render.formula import interpreter, interval_grid, scene_surfaces
from maquette.render.formula.evaluator_calls import interpret
from maquette.render.formula.op_codegen import WIDTHS
from maquette.render.jit.kernel import kernel

BOXES = int(os.environ.get("MAQUETTE_BOXES", "6400"))  # of each operation; a million with `make bounds`
VECTORS, LANES = 4, 16
SIDE_BY_SIDE = VECTORS * LANES


@kernel
def run(address, code, registers, constants, state):
    interpret(address, code, np.int64(0), np.int64(len(code)), registers, constants, np.int64(0), state, np.int64(VECTORS))


def evaluate(program: str, tape: Tape, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(parts of the result (width, 64), lanes that may be undefined) of a program; inputs (3, width, 64)."""
    rows = scene_surfaces.names_of(tape)
    width = WIDTHS[program]
    names, code, tapes = np.array(rows), np.zeros((len(rows), 8), np.int32), np.zeros((1, 4), np.int64)
    tapes[0, 1] = len(rows)
    assert interval_grid.allocate_registers(names, code, tapes, 0) == 0
    registers = np.zeros((interpreter.KNOWN + 1, width, SIDE_BY_SIDE), np.float32)
    registers[:3] = inputs
    if width > 1:
        registers[interpreter.UNKNOWN :, 0], registers[interpreter.UNKNOWN :, 1] = -np.inf, np.inf
    flat, state = registers.reshape(-1), np.zeros(2 * len(rows) + 3, np.int64)
    run(interpreter.address(program), code, flat, scene_surfaces.single_rows(tape), state)
    unsure = (int(state[0]) >> np.arange(SIDE_BY_SIDE).astype(object)) & 1
    return flat.reshape(registers.shape)[tapes[0, 2]], unsure.astype(bool)


def check_bounds(tape: Tape, low: np.ndarray, high: np.ndarray, random: np.random.Generator, turn: float = 0.0) -> None:
    """Check the results of spans32 and points32 over float32 boxes (3, 64) at points of the boxes."""
    way = random.normal(size=low.shape)
    way = (way / np.linalg.norm(way, axis=0)).astype(np.float32)
    spans = np.stack([low, high, way, way, np.zeros_like(low)], axis=1)
    (least, most, falls, rises, off), unsure = evaluate("spans32", tape, spans)
    for share in (0.0, 1.0, random.random(low.shape), random.random(low.shape)):
        p = np.clip((low + share * (high.astype(np.float64) - low)).astype(np.float32), low, high)
        value, gradient = numpy_interpreter.gradients(tape, *p.astype(np.float64))
        sure = ~unsure & np.isfinite(value)
        inside = (value >= least) & (value <= most)
        for other in (turn, -turn) if turn else ():
            inside |= (value + other >= least) & (value + other <= most)
        assert inside[sure].all()
        assert (unsure | np.isnan(least))[np.isnan(value)].all()
        with np.errstate(invalid="ignore"):
            slope = (gradient * way).sum(axis=0)
        if not isinstance(share, float):  # within a box: at the ends of its domain an operation may have no derivative
            slack = 1e-5 * (1 + np.abs(slope))
            has_slope = sure & np.isfinite(slope)
            assert ((slope >= falls - slack) & (slope <= rises + slack))[has_slope].all()
        values, _ = evaluate("points32", tape, p[:, None])
        error = 1.01 * off + 2.0**-23 * (np.abs(least) + np.abs(most))
        with np.errstate(invalid="ignore"):
            apart = np.abs(values[0] - value)
        for other in (turn, -turn) if turn else ():
            apart = np.minimum(apart, np.abs(values[0] - value + other))
        assert (apart <= error)[sure].all()


@pytest.mark.parametrize("op", list(Op), ids=lambda op: op.name.lower())
def test_bounds_of_each_operation(op):
    random = np.random.default_rng(int(op))
    code = np.array([[op, 0, 1 if arity(op) > 1 else 0, 2 if arity(op) > 2 else 0]], np.int32)
    for _ in range(0, BOXES, SIDE_BY_SIDE):
        low = random.uniform(-3, 3, (3, SIDE_BY_SIDE)).astype(np.float32)
        high = (low + 10.0 ** random.uniform(-6, 0, low.shape)).astype(np.float32)
        if op == Op.MOD:
            high[1] = low[1]
        if op == Op.POWER:
            low[0], high[0] = abs(low[0]), abs(low[0]) + (high[0] - low[0])
        check_bounds(Tape(code, np.zeros(0), (3,)), low, high, random, 2 * np.pi if op == Op.ANGLE else 0.0)


@pytest.mark.parametrize("constant", [0.0, 0.3, -2.25, 1 / 3, -1e-7, 1e-18, 3.3e-30, 1e-31, -1e-40, 1e-46, 1e9, -1.1e13, 1e17, 1e19, 1e39])
def test_bounds_of_products_with_a_constant(constant):
    random = np.random.default_rng(5)
    b = Builder()
    number = b.constant(constant)
    tapes = [b.finish(b.op(Op.ADD, b.op(Op.MULTIPLY, *pair), 1)) for pair in ((0, number), (number, 0))]
    for _ in range(0, BOXES // 10, SIDE_BY_SIDE):
        low = (random.uniform(-3, 3, (3, SIDE_BY_SIDE)) * 10.0 ** random.uniform(-12, 9, (3, SIDE_BY_SIDE))).astype(np.float32)
        low[:, ::5] = 0.0
        high = low + (abs(low) * 10.0 ** random.uniform(-6, 1, low.shape)).astype(np.float32)
        high[:, ::7] = low[:, ::7]
        for tape in tapes:
            check_bounds(tape, low, high, random)


def random_tape(random: np.random.Generator, rows: int = 30) -> Tape:
    """A tape of random operations on earlier values."""
    b = Builder()
    names = [0, 1, 2]
    operations = [
        Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.MIN, Op.MAX, Op.ABS, Op.SQUARE, Op.HYPOT, Op.SIN, Op.COS, Op.ATAN, Op.NEGATE, Op.SQRT,
        Op.DIVIDE, Op.EXP, Op.FLOOR, Op.NOISE, Op.CHOOSE, Op.ARC, Op.QUARTER_ARC,
    ]  # fmt: skip
    for _ in range(rows):
        op = operations[random.integers(len(operations))]
        operands = [names[random.integers(max(0, len(names) - 6), len(names))] for _ in range(arity(op))]
        result = b.op(op, *operands)
        names.append(b.op(Op.SIN, result) if op in (Op.SQUARE, Op.MULTIPLY, Op.EXP, Op.DIVIDE) else result)
    return b.finish(b.add(names[-1], b.scale(names[-2], 0.37)))


@pytest.mark.parametrize("seed", range(12))
def test_bounds_of_random_tapes(seed):
    random = np.random.default_rng(seed)
    tape = random_tape(random)
    for _ in range(0, BOXES // 10, SIDE_BY_SIDE):
        low = random.uniform(-2, 2, (3, SIDE_BY_SIDE)).astype(np.float32)
        high = (low + 10.0 ** random.uniform(-6, -0.5, low.shape)).astype(np.float32)
        check_bounds(tape, low, high, random)
