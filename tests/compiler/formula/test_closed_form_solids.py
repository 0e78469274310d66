"""Solids of planes, quadrics and tori recognised in tapes: the same points inside, and what is no such solid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import load
from maquette.compiler.formula import closed_form_solids, numpy_interpreter
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.opcodes import Op, arity
from maquette.compiler.formula.tape import Tape, load_tape

SOLIDS = {  # how many relations each is
    "union { box([1, 1.4, 0.8]) }": 3,
    "union { cylinder(0.5, 1.2) }": 2,
    "union { cone(0.6, 1, top: 0.2) }": 3,
    "union { torus(0.8, 0.3, rotate: [20deg, 30deg, 0], scale: 1.2) }": 1,
    "implicit(|x, y, z| (hypot(x, z) - 0.7)^2 + y^2 <= 0.09)": 1,
    "difference { box(1.6, rotate: [0, 0, 45deg]); translate([0.5, 0, 0]) { union { sphere(0.4); cylinder(0.2, 4) } } }": 6,
    "shell(0.1) { box([1, 1.4, 0.8]); cylinder(0.2, 2) }": 10,
    "offset(0.1) { cone(0.6, 1, top: 0.2); torus(0.9, 0.1) }": 4,
    "difference { box(2); torus(0.7, 0.2) }": 4,
    "repeat([0.7, 0, 0], count: 8) { sphere(0.3) }": 8,
    "mirrored([1, 1, 0]) { cone(0.5, 1, center: [0.4, 0, 0]) }": 6,
    "implicit(|x, y, z| not (x^2 + y^2 > 1) and max(x, y, z) - z <= 1 and z^2 <= 1)": 4,
    "implicit(|x, y, z| x * y <= z - 0.1 and 3 >= 2 * hypot(x, y, z) + y, within: 2)": 6,
}


def stored(folder: Path, text: str) -> Tape:
    path = folder / "a.scene"
    path.write_text(f"camera(position: [0, 0, 9])\n{text}\n", encoding="utf-8")
    tables = load.load(path).tables
    return load_tape(tables, int(tables.geometries.tape[tables.instances.geometry[0]]))


@pytest.mark.parametrize("text", SOLIDS)
def test_the_same_points_are_inside(tmp_path, text):
    tape = stored(tmp_path, text)
    found = closed_form_solids.solid(tape)
    assert found is not None
    assert len(found.leaves) == SOLIDS[text]
    points = np.random.default_rng(5).uniform(-1.6, 1.6, (20_000, 3))
    field = numpy_interpreter.points(tape, *points.T)[0]
    clear = np.abs(field) > 1e-9
    inside = closed_form_solids.holds(found, points)
    assert 100 < inside.sum() < 19_900
    assert (inside == (field <= 0))[clear].all()


@pytest.mark.parametrize(
    "text",
    [
        "union(round: 0.1) { box(1); sphere(0.7) }",
        "twist(90deg) { box(1) }",
        "implicit(|x, y, z| sin(x) <= y, within: 1)",
        "implicit(|x, y, z| (hypot(x, 2 * z) - 0.7)^2 + y^2 <= 0.09)",  # of an oval ring
        "implicit(|x, y, z| x^3 <= y, within: 1)",
        "implicit(|x, y, z| min(y, sqrt(x) - 1) <= 0, within: 2)",  # a root of what may be negative
        "union { " + "; ".join(f"sphere(0.1, center: [{k / 40}, 0, 0])" for k in range(60)) + " }",
    ],
)
def test_what_is_something_else(tmp_path, text):
    assert closed_form_solids.solid(stored(tmp_path, text)) is None


def test_a_sheet_that_only_touches_0_has_no_sides():
    b = Builder()
    line = b.add(0, b.offset(1, -0.3))
    once, twice = b.finish(b.offset(b.op(Op.SQUARE, line), -0.1)), b.finish(b.multiply(line, b.scale(line, 2.0)))
    assert closed_form_solids.solid(once, sheet=True) is not None
    assert closed_form_solids.solid(twice) is not None
    assert closed_form_solids.solid(twice, sheet=True) is None


@pytest.mark.long
@settings(max_examples=120, deadline=None)
@given(st.data())
def test_whatever_is_recognised_holds_at_the_same_points(data):
    """Fields of random operations, most of them of solids: never a wrong answer, whatever is recognised."""
    b = Builder()
    names = [0, 1, 2]
    number = st.floats(-2, 2).map(lambda x: round(x, 3))
    for _ in range(data.draw(st.integers(3, 14))):
        op = data.draw(st.sampled_from([Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.NEGATE, Op.ABS, Op.SQUARE, Op.HYPOT, Op.SQRT, Op.MIN, Op.MAX]))
        one, other = data.draw(st.sampled_from(names)), data.draw(st.one_of(st.sampled_from(names), number.map(b.constant)))
        names.append(b.op(op, one) if arity(op) == 1 else b.op(op, one, other))
    tape = b.finish(b.offset(names[-1], data.draw(number)))
    found = closed_form_solids.solid(tape)
    if found is None:
        return
    points = np.random.default_rng(1).uniform(-2, 2, (500, 3))
    with np.errstate(all="ignore"):
        field = numpy_interpreter.points(tape, *points.T)[0]
    clear = np.abs(field) > 1e-6 * (1 + np.abs(field))
    assert (closed_form_solids.holds(found, points) == (field <= 0))[clear & ~np.isnan(field)].all()


@pytest.mark.long
def test_long_chains_of_operations():
    """Half of the space: 30,000 sums of x and y are at most 0; and a union of as many spheres has too many relations."""
    builder = Builder()
    total = 0
    for k in range(30_000):
        total = builder.add(total, k % 2)
    found = closed_form_solids.solid(builder.finish(total))
    assert found is not None
    points = np.random.default_rng(1).uniform(-1, 1, (100, 3))
    assert (closed_form_solids.holds(found, points) == (15_001 * points[:, 0] + 15_000 * points[:, 1] <= 0)).all()
    builder = Builder()
    balls = [builder.offset(builder.op(Op.SQUARE, builder.offset(0, -k)), -0.1) for k in range(30_000)]
    assert closed_form_solids.solid(builder.finish(builder.reduce(Op.MIN, balls))) is None
