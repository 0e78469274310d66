"""Equal operations side by side: the values and bounds that the definition, operation by operation, gives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.bench.formulas import models
from maquette.compiler.formula import batched_interpreter, numpy_interpreter
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.opcodes import Op, arity
from maquette.compiler.formula.tape import Tape

MODELS = models()
PARTIAL = (Op.SQRT, Op.LOG, Op.ASIN, Op.ACOS, Op.POWER, Op.DIVIDE, Op.MOD, Op.CHOOSE)


@st.composite
def tapes(draw: st.DrawFn, but: tuple[Op, ...] = ()) -> Tape:
    builder = Builder()
    names = [0, 1, 2, builder.constant(draw(st.floats(-2, 2))), builder.constant(0.5)]
    for _ in range(draw(st.integers(0, 40))):
        op = draw(st.sampled_from([op for op in Op if op not in (*but, Op.COPY)]))
        operands = [draw(st.sampled_from(names)) for _ in range(arity(op))]
        names.append(builder.op(op, *operands))
    return builder.finish(names[-1])


def boxes(seed: int, count: int = 300) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    low = random.uniform(-2, 2, (3, count))
    return low, low + 10.0 ** random.uniform(-6, 0, (3, count))


def check_same(tape: Tape, low: np.ndarray, high: np.ndarray) -> None:
    bounds, _, maybe = numpy_interpreter.boxes(tape, low, high)
    found, unsure = batched_interpreter.Batches(tape).boxes(low, high)
    assert np.array_equal(found, bounds, equal_nan=True)
    assert np.array_equal(unsure, maybe)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("count", [1, 2, 513])
def test_models(name: str, count: int) -> None:
    tape = MODELS[name]
    low, high = boxes(1, count)
    check_same(tape, low, high)
    assert np.array_equal(batched_interpreter.Batches(tape).points(low), numpy_interpreter.points(tape, *low)[0], equal_nan=True)


def test_more_places_than_are_gone_through_at_a_time() -> None:
    tape = MODELS["100 balls"]
    low, high = boxes(2, 2 * batched_interpreter.FEWEST_PLACES + 1)
    check_same(tape, low, high)
    assert np.array_equal(batched_interpreter.Batches(tape).points(low), numpy_interpreter.points(tape, *low)[0])


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(tapes(but=PARTIAL), st.integers(0, 2**32 - 1))
def test_tapes_that_are_defined_everywhere(tape: Tape, seed: int) -> None:
    low, high = boxes(seed)
    check_same(tape, low, high)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(tapes(but=(Op.POWER,)), st.integers(0, 2**32 - 1))
def test_any_tape(tape: Tape, seed: int) -> None:
    """Bounds may differ where something is undefined: that may come before a choice here, and after it there."""
    low, high = boxes(seed)
    assert np.array_equal(batched_interpreter.Batches(tape).points(low), numpy_interpreter.points(tape, *low)[0], equal_nan=True)
    bounds, _, maybe = numpy_interpreter.boxes(tape, low, high)
    found, unsure = batched_interpreter.Batches(tape).boxes(low, high)
    assert np.array_equal(unsure, maybe)
    for one, other in zip(found, bounds, strict=True):
        assert np.array_equal(one[~maybe], other[~maybe], equal_nan=True)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(tapes(but=(Op.ANGLE, Op.MOD, Op.POWER)), st.integers(0, 2**32 - 1))
def test_values_lie_in_their_bounds(tape: Tape, seed: int) -> None:
    low, high = boxes(seed)
    (least, most), unsure = batched_interpreter.Batches(tape).boxes(low, high)
    for share in np.random.default_rng(seed).random((3, *low.shape)):
        value = numpy_interpreter.points(tape, *(low + share * (high - low)))[0]
        defined = np.isfinite(value) & (np.abs(value) < 1e280)
        assert ((value >= least) & (value <= most) | unsure)[defined].all()
        assert (~(value <= 0) | (least <= 0))[defined].all()


@pytest.mark.parametrize("exponent", [0.5, 2.0, 3.7, -1.0])
def test_powers(exponent: float) -> None:
    """To the last digits: numpy takes roots and squares where an exponent is one number, not many."""
    builder = Builder()
    tape = builder.finish(builder.add(builder.op(Op.POWER, 0, builder.constant(exponent)), builder.op(Op.POWER, 1, 2)))
    low, high = boxes(4)
    np.testing.assert_allclose(batched_interpreter.Batches(tape).points(low), numpy_interpreter.points(tape, *low)[0], rtol=1e-14)
    check_same(tape, low, high)


def test_results_that_are_no_operation() -> None:
    low, high = boxes(3, 5)
    check_same(Builder().finish(1), low, high)
    builder = Builder()
    check_same(builder.finish(builder.constant(2.5)), low, high)
