"""Symbolic gradients agree with the interpreter's."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler.fillets.gradients import Gradients
from maquette.compiler.formula import numpy_interpreter, solid_fields
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.opcodes import Op, arity
from maquette.compiler.ir import GeometryKind as Kind
from maquette.shapes import SHAPES as MODULES

SHAPES = {
    "sphere": (Kind.SPHERE, (0.7,)), "cylinder": (Kind.CYLINDER, (0.6, 0.5, 1.0)), "cone": (Kind.CONE, (0.7, 0.2, 0.6, 1.0)),
    "torus": (Kind.TORUS, (0.6, 0.2)), "capsule": (Kind.CAPSULE, (0.3, 0.5)), "box": (Kind.BOX, (0.5, 0.6, 0.7)),
}  # fmt: skip


def check(b: Builder, name: int, at: np.ndarray, tolerance: float = 1e-6) -> None:
    gradients = Gradients(b, 1e-6)
    gradient = gradients.gradient_of(name)
    values = [gradients.value(term, gradient.over) for term in gradient.along]
    symbolic = np.stack(numpy_interpreter.points(b.finish(*values), *at))
    numeric = numpy_interpreter.gradients(b.finish(name), *at)[1]
    known = np.isfinite(numeric).all(axis=0) & (abs(numeric).max(axis=0) < 1e3)
    off = abs(symbolic - numeric)[:, known]
    assert known.any()
    assert np.quantile(off, 0.999) < tolerance  # but for points within the width of a change from one operand to the other


@pytest.mark.parametrize("name", SHAPES)
def test_gradients_of_shapes(name):
    b = Builder()
    kind, numbers = SHAPES[name]
    check(b, MODULES[kind].field(b, numbers, (0, 1, 2)), np.random.default_rng(1).uniform(-1, 1, (3, 5000)))


@pytest.mark.parametrize("op", [op for op in Op if op not in (Op.NOISE, Op.CHOOSE, Op.ARC)], ids=lambda op: op.name.lower())
def test_gradients_of_operations(op):
    b = Builder()
    operands = [b.linear([(0.3, 0), (0.2, 1)], 0.45), b.linear([(0.1, 1), (0.2, 2)], 0.5), b.constant(0.3)][: arity(op)]
    if op in (Op.POWER, Op.MOD):
        operands[1] = b.constant(0.7)
    check(b, b.op(op, *operands), np.random.default_rng(2).uniform(-0.8, 0.8, (3, 2000)))


def test_the_gradient_of_an_arc_has_its_direction():
    """Of unit gradients: the direction of the shortest vector; where no arc is, that of the larger operand."""
    b = Builder()
    p, q = b.linear([(-1.0, solid_fields.length(b, (0, 1, 2)))], 1.0), b.linear([(-0.6, 0), (-0.8, 1)], 0.4)
    normals = [Gradients(b, 1e-6).gradient_of(name) for name in (p, q)]
    at = np.random.default_rng(3).uniform(0.1, 0.9, (3, 4000))
    cosine = Gradients(b, 1e-6).dot(*normals)
    name = b.op(Op.ARC, p, q, Gradients(b, 1e-6).value(cosine.along[0], cosine.over))
    gradients = Gradients(b, 1e-6)
    gradient = gradients.gradient_of(name)
    symbolic = np.stack(numpy_interpreter.points(b.finish(*(gradients.value(term, gradient.over) for term in gradient.along)), *at))
    values = np.stack(numpy_interpreter.points(b.finish(p, q), *at))
    single = (values.max(axis=0) > 0) & (values.min(axis=0) < -0.9 * values.max(axis=0))
    larger = np.where(values[0] > values[1], -at / np.linalg.norm(at, axis=0), np.array([[-0.6], [-0.8], [0.0]]))
    assert single.sum() > 20
    assert abs(symbolic - larger)[:, single].max() < 1e-6
    assert abs(np.linalg.norm(symbolic, axis=0) - 1)[values.max(axis=0) > 0.01].max() < 1e-6


def test_noise_and_steps_count_as_constant():
    b = Builder()
    smooth = solid_fields.length(b, (0, 1, 2))
    bumpy = b.add(smooth, b.add(b.op(Op.NOISE, 0, 1, 2), b.op(Op.FLOOR, 0)))
    assert Gradients(b, 1e-3).gradient_of(bumpy) == Gradients(b, 1e-3).gradient_of(smooth)
