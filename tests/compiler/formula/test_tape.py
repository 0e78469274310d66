"""Tapes: what relations become, and that bounds over boxes hold what the formula is at every point of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler.formula import bounding_box, derivative_bounds, interval_semantics, numpy_interpreter
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.from_formula import NotASurface
from maquette.compiler.formula.opcodes import Op, arity
from maquette.compiler.formula.point_semantics import NumpyMath
from maquette.compiler.formula.relation import surface
from maquette.compiler.formula.tape import Tape
from maquette.lang import formula_graph as formulas

from ...lang.eval.evaluating import elements

BOXES = 30_000


def tape_of(relation: str) -> tuple[Tape, bool]:
    (element,) = elements(f"implicit(|x, y, z| {relation}, within: 9)")
    return surface(element.args["formula"])[:2]


def recorded(relation: str) -> formulas.Formula:
    (element,) = elements(f"implicit(|x, y, z| {relation}, within: 9)")
    return element.args["formula"]


# --- relations ---


@pytest.mark.parametrize(
    "relation",
    [
        "x^2 + y^2 <= z", "x < 1 and y > 0.2 or not (z >= x)", "hypot(x, y, z) <= 1", "if x < y then z < 1 else z > 2",
        "(if x < y then z else -z) <= 0.3", "min(x, y, z) <= 0 and max(x, y) > -1", "x^-2 <= y", "mod(x, 0.7) <= 0.3", "round(x) <= y",
        "noise(x, y, z) <= 0.1", "sign(x) * y <= 0.4", "clamp(x, 0, 1) <= y", "x^2.5 <= y", "atan2(y, x) <= 1",
        "floor(3 * x) < 2", "floor(3 * x) > 2", "not (ceil(3 * x) <= 2)", "floor(5 * x) / 5 < 0.4", "floor(5 * x) / 5 <= 0.4",
        "mod(floor(3 * x) + floor(3 * y) - floor(3 * z), 2) < 1", "floor(x) + floor(y) + floor(z) <= 0", "sign(x) * sign(y) < 1",
        "(if floor(x) < 0 then y else z) < 0.5", "max(floor(x), 0.2 * y) < 1", "sqrt(floor(3 * x)) < 1", "sqrt(floor(3 * x)) <= 1",
        "1 - floor(5 * x) / 3 >= 0.2", "0.25 > -floor(4 * x) / 4", "floor(4 * x) / 4 < floor(2 * z) / 2",
        "floor(4 * x) / 4 + floor(z) / 2 < 0.5",
        "sin(floor(6 * x)) < sin(floor(6 * y))", "max(floor(4 * x) / 3, -0.2) + min(floor(3 * z) / 7, 0.3) >= 0.3",
        "clamp(x, -0.5, 0.5) < 0.5", "clamp(x, -0.5, 0.5) <= -0.5", "max(x, 0) * y < 0",
        "not (max(x, y, 0) <= 0)", "min(x, 1) + max(y, 2) < 3",
        "max(x, y) > x", "min(x, y) < x", "max(x, y) <= x", "min(x, y) >= x", "max(x, y) < x", "min(x, y) > x",
        "abs(x) > x", "abs(x) <= x",
        "y > abs(y)", "(if x < 0 then 1 else 2) < 2", "abs(x) < abs(y)",
    ],
)  # fmt: skip
def test_a_field_is_at_most_0_where_the_relation_holds(relation):
    tape, sheet = tape_of(relation)
    whole = recorded(relation)
    points = np.random.default_rng(5).uniform(-2, 2, (300, 3))
    found = numpy_interpreter.points(tape, *points.T)[0]
    assert not sheet
    for p, field in zip(points, found, strict=True):
        assert (field <= 0) == formulas.evaluate(whole, p)


@pytest.mark.parametrize(
    "numbers", ["floor(5 * x)", "floor(x) / 5", "sign(y) * 3 / 7", "mod(floor(3 * x) - floor(3 * y) - 2, 4)", "1 / floor(x + 1)"]
)
def test_past_a_jump_steps_are_one_number_on_each_side(numbers):
    """Boxes around x = y = 1, of which all ways past jumps are gone: bounds are as narrow as rounding makes them."""
    tape, _ = tape_of(f"{numbers} <= 0.1234")
    low, high = np.array([[1 - 1e-12], [0.9], [0.3]]) + np.zeros((1, 8)), np.array([[1 + 1e-12], [0.95], [0.3]]) + np.zeros((1, 8))
    (least, most), _, maybe = numpy_interpreter.boxes(tape, low, high, ways=np.arange(8, 16))
    assert (most - least < 1e-13).all()
    assert not maybe.any()
    sides = {float(numpy_interpreter.points(tape, x, 0.92, 0.3)[0]) for x in (1 - 1e-13, 1 + 1e-13)}
    assert all(any(a <= side <= b for a, b in zip(least, most, strict=True)) for side in sides)


@pytest.mark.parametrize(
    ("relation", "rows"),
    [
        ("floor(5 * x) / 5 < 0.4", ["MULTIPLY", "FLOOR", "ADD"]),
        ("max(x, y) > x", ["SUBTRACT"]),
        ("max(abs(x) - 1, 0)^2 + max(abs(y) - 1, 0)^2 < 0.01", 2 * ["ABS", "SUBTRACT", "MAX", "SQUARE"] + ["ADD", "SUBTRACT"]),
        ("min(x, y) < 0.5", ["MIN", "SUBTRACT"]),
    ],
)
def test_what_is_equal_over_no_region_needs_no_more(relation, rows):
    """Rounded boxes have plateaus, but not at the number that they are compared with; a step is compared as a whole number."""
    tape, _ = tape_of(relation)
    assert sorted(Op(row[0]).name for row in tape.code) == sorted(rows)


@pytest.mark.parametrize(
    "relation",
    ["floor(5 * x) / 5 < 0.4", "floor(4 * x) / 3 + floor(3 * z) / 7 <= 1 / 3", "clamp(x, -0.5, 0.5) < 0.5", "abs(x) > x",
     "max(x, 0) * y < 0"],
)  # fmt: skip
def test_bounds_tell_on_which_side_a_plateau_is(relation):
    tape, _ = tape_of(relation)
    low = np.random.default_rng(3).uniform(-2, 2, (3, 3000))
    (least, most), _, _ = numpy_interpreter.boxes(tape, low, low + 1e-6)
    assert ((least > 0) | (most < 0)).mean() > 0.99


def test_sheets_have_a_field_whose_sign_changes():
    for relation in ("x^2 == 4", "(x - 1)^2 == 0", "abs(x - y) == 0", "sqrt(x^2 + y^2 - 4) == 0", "min(abs(x), abs(y - z)) == 0"):
        tape, sheet = tape_of(relation)
        signs = np.sign(numpy_interpreter.points(tape, *np.random.default_rng(1).uniform(-4, 4, (3, 400)))[0])
        assert sheet
        assert {-1.0, 1.0} <= set(signs.tolist())


@pytest.mark.parametrize(
    ("relation", "message"),
    [
        ("x", "a surface's formula is a relation, and this one gives a number"),
        ("x == 1 and y < 2", "`==` cannot be part of a larger relation: it holds on a surface, which has no inside"),
        ("max(x^2 - 1, 0) == 0", "both sides of this `==` are equal all over a region: that is not a surface"),
        ("abs(x - y) == x - y", "both sides of this `==` are equal all over a region: that is not a surface"),
        ("mod(y, 0.1) == 0", "a `mod` that is compared with 0 jumps where it is 0, and passes through it nowhere"),
        ("x != 1", "`!=` cannot be part of a larger relation: it holds on a surface, which has no inside"),
    ],
)
def test_what_is_no_surface(relation, message):
    with pytest.raises(NotASurface) as caught:
        tape_of(relation)
    assert str(caught.value) == message


def test_equal_operations_are_one_and_numbers_stand_in_a_table():
    one, _ = tape_of("sin(2 * x) + sin(2 * x) * y <= 3 * (1 + 1)")
    other, _ = tape_of("sin(5 * x) + sin(5 * x) * y <= 7")
    assert [Op(row[0]).name for row in one.code] == ["MULTIPLY", "SIN", "MULTIPLY", "ADD", "SUBTRACT"]
    assert one.structure() == other.structure()
    assert sorted(other.constants) == [5.0, 7.0]


@pytest.mark.parametrize(
    ("relation", "operations"),
    [
        ("x * y + z * y <= 1", "ADD MULTIPLY SUBTRACT"),
        ("sin(x) * y - cos(z) * sin(x) <= 1", "SIN COS SUBTRACT MULTIPLY SUBTRACT"),
        ("0.3 * x^2 * y^3 + 0.1 * z^2 * y^3 <= 1", "SQUARE MULTIPLY SQUARE MULTIPLY ADD CUBE MULTIPLY SUBTRACT"),
        ("0.3 * x + 0.3 * y <= 1", "MULTIPLY MULTIPLY ADD SUBTRACT"),  # numbers may be equal by chance
        ("max(x * y - x * z, x * z - x * y) <= 1", "SUBTRACT MULTIPLY ABS SUBTRACT"),
    ],
)
def test_what_products_share_is_multiplied_once(relation, operations):
    tape, _ = tape_of(relation)
    assert sorted(Op(row[0]).name for row in tape.code) == sorted(operations.split())


def test_the_cut_of_atan2_is_hidden_where_only_waves_see_it():
    def angle(relation: str) -> Op:
        return Op(next(row[0] for row in tape_of(relation)[0].code if row[0] in (Op.ATAN2, Op.ANGLE)))

    assert angle("hypot(x, z) + cos(18 * atan2(z, x) + y) <= 1") == Op.ANGLE
    assert angle("hypot(x, z) + cos(2.5 * atan2(z, x)) <= 1") == Op.ATAN2
    assert angle("hypot(x, z) + atan2(z, x) <= 1") == Op.ATAN2


# --- bounds ---


def single(op: Op) -> Tape:
    """A tape of one operation on x, y, z."""
    return Tape(np.array([[op, 0, 1 if arity(op) > 1 else 0, 2 if arity(op) > 2 else 0]], np.int32), np.zeros(0), (3,))


def boxes_for(op: Op, scale: float, count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    low = random.uniform(-scale, scale, (3, count))
    wide = 10.0 ** random.uniform(-8, 0.3, (3, count)) * 0.2 * scale
    high = low + wide
    if op == Op.MOD:
        low[1] = high[1] = np.round(low[1], 1) + 0.05
    if op == Op.POWER:
        low[0], low[1] = np.abs(low[0]) - 0.1, low[1] / scale
        high = np.stack([low[0] + wide[0], low[1] + np.where(random.random(count) < 0.5, 0.0, wide[1] / scale), high[2]])
    return low, high


def check(tape: Tape, low: np.ndarray, high: np.ndarray, random: np.random.Generator, turn: float = 0.0) -> None:
    """Values and slopes at points of boxes lie in their bounds; what is undefined is announced. `turn`: values may be off by as much."""
    way = random.normal(size=low.shape)
    if turn == 0.0 and tape.code[0, 0] == Op.MOD:
        way[1] = 0.0
    (least, most), (down, up), maybe = numpy_interpreter.boxes(tape, low, high, way)
    for _ in range(4):
        share = random.random(low.shape)
        at = np.clip(low + np.where(random.random(low.shape) < 0.3, np.round(share), share) * (high - low), low, high)
        value, gradient = numpy_interpreter.gradients(tape, *at)
        slope = (gradient * way).sum(axis=0)
        defined = np.isfinite(value)
        inside = (value >= least) & (value <= most)
        for off in (turn, -turn) if turn else ():
            inside |= (value + off >= least) & (value + off <= most)
        assert inside[defined].all()
        assert (maybe | np.isnan(least))[np.isnan(value)].all()
        known = defined & np.isfinite(slope) & (np.abs(slope) < 1e280)
        slack = 1e-12 * np.abs(slope)
        assert ((slope >= down - slack) & (slope <= up + slack))[known].all()


@pytest.mark.parametrize("op", list(Op), ids=lambda op: op.name.lower())
@pytest.mark.parametrize("scale", [1.0, 50.0])
def test_bounds_of_an_operation_hold(op, scale):
    random = np.random.default_rng(int(op))
    low, high = boxes_for(op, scale, BOXES, random)
    check(single(op), low, high, random, 2 * np.pi if op == Op.ANGLE else 0.0)


@pytest.mark.parametrize("op", list(Op), ids=lambda op: op.name.lower())
def test_an_operation_spreads_what_it_is_given_as_its_slopes_say(op):
    random = np.random.default_rng(int(op))
    low, high = boxes_for(op, 1.0, BOXES, random)
    boxes = list(zip(low, high, strict=True))[: arity(op)]
    off = list(10.0 ** random.uniform(-9, 0, (len(boxes), BOXES)))
    m = NumpyMath((BOXES,))
    with np.errstate(all="ignore"):
        value = interval_semantics.interval(m, op, *boxes)
        ((least, most),) = derivative_bounds.slope_intervals(m, op, boxes, value, [[(-e, e)] for e in off])
        found = derivative_bounds.spread(m, op, boxes, value, off)
    np.testing.assert_array_equal(found, np.maximum(np.abs(least), np.abs(most)))


def test_bounds_of_whole_powers_of_negative_numbers_hold():
    random = np.random.default_rng(9)
    low = random.uniform(-3, 3, (3, BOXES))
    high = low + 10.0 ** random.uniform(-8, 0.5, (3, BOXES))
    low[1] = high[1] = random.integers(-4, 5, BOXES)
    (least, most), (down, up), maybe = numpy_interpreter.boxes(single(Op.POWER), low, high, np.array([[1.0], [0.0], [0.0]]) + 0 * low)
    at = low + random.random(low.shape) * (high - low)
    value = at[0] ** at[1]
    assert ((value >= least) & (value <= most)).all()
    assert (np.abs([least, most]) < 1e13)[:, low[0] * high[0] > 0.01].all()
    slope = at[1] * at[0] ** (at[1] - 1)
    assert ((slope >= down - 1e-12 * abs(slope)) & (slope <= up + 1e-12 * abs(slope))).all()
    assert not maybe.any()


@pytest.mark.parametrize("op", [Op.CHOOSE, Op.ARC, Op.QUARTER_ARC])
def test_what_is_undefined_on_one_way_hides_nothing_on_the_other(op):
    """Over a box where either way may be gone, one of which is nowhere defined, the other's values count."""
    builder = Builder()
    never, other = builder.op(Op.SQRT, builder.constant(-1.0)), builder.offset(1, 0.25)
    for ways in ((never, other), (other, never)):
        operands = {Op.CHOOSE: (0, *ways), Op.ARC: (*ways, builder.constant(0.1)), Op.QUARTER_ARC: ways}[op]
        tape = builder.finish(builder.op(op, *operands))
        (least, most), _, _ = numpy_interpreter.boxes(tape, [[-1.0], [-1.0], [0.0]], [[1.0], [1.0], [0.0]])
        assert least[0] <= -0.75
        assert most[0] >= 1.25


def test_numbers_too_large_for_bounds_are_not_taken_for_equal():
    """Of e^400x − e^400z over a box where both exceed what bounds tell apart nothing is known, and of a quotient little."""
    builder = Builder()
    p, q = (builder.op(Op.EXP, builder.scale(name, 400.0)) for name in (0, 2))
    for field in (builder.subtract(p, q), builder.offset(builder.op(Op.DIVIDE, p, q), -1.0)):
        (least, most), _, _ = numpy_interpreter.boxes(builder.finish(field), [[0.6], [0.0], [0.6]], [[0.61], [0.0], [0.61]])
        assert least[0] < 0 < most[0]


def test_what_may_stay_0_has_logarithms_and_powers_of_0_by_themselves():
    """Bounds take 0 for a place alone: where it is a plateau, what is there is chosen."""
    for relation, chosen in (("log(max(x, 0)) <= y", 1), ("max(x, 0)^y <= z", 1), ("log(x * x) <= y", 0), ("abs(x)^y <= z", 0)):
        tape, _ = tape_of(relation)
        assert (tape.code[:, 0] == Op.CHOOSE).sum() == chosen
        x, y, z = np.random.default_rng(2).uniform(-1, 1, (3, 200))
        with np.errstate(all="ignore"):
            holds = eval(relation.replace("^", "**"), {"log": np.log, "max": np.maximum, "abs": np.abs, "x": x, "y": y, "z": z})
        assert np.array_equal(numpy_interpreter.points(tape, x, y, z)[0] <= 0, holds)


SMOOTH = [op for op in Op if op not in (Op.ANGLE, Op.MOD, Op.POWER, Op.COPY)]


@st.composite
def tapes(draw: st.DrawFn) -> Tape:
    builder = Builder()
    names = [0, 1, 2, builder.constant(draw(st.floats(-2, 2))), builder.constant(0.5)]
    for _ in range(draw(st.integers(1, 14))):
        op = draw(st.sampled_from(SMOOTH))
        operands = [draw(st.sampled_from(names)) for _ in range(arity(op))]
        names.append(builder.op(op, *operands))
    return builder.finish(names[-1])


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(tapes(), st.integers(0, 2**32 - 1))
def test_bounds_of_whole_tapes_hold(tape, seed):
    if not len(tape.code):
        return
    random = np.random.default_rng(seed)
    low = random.uniform(-2, 2, (3, 200))
    check_values(tape, low, low + 10.0 ** random.uniform(-6, 0, (3, 200)), random)


def test_the_angle_of_a_zero_with_a_sign_is_that_of_zero():
    """ceil(−½) is −0: on the cut the angle is π all the same, as bounds have it."""
    builder = Builder()
    tape = builder.finish(builder.op(Op.ATAN2, builder.op(Op.CEIL, 0), 0))
    x = np.linspace(-0.9, -0.1, 9)
    assert (numpy_interpreter.points(tape, x, 0 * x, 0 * x)[0] == np.pi).all()
    check_values(tape, np.stack([x - 0.05, 0 * x, 0 * x]), np.stack([x + 0.05, 0 * x, 0 * x]), np.random.default_rng(1))


def check_values(tape: Tape, low: np.ndarray, high: np.ndarray, random: np.random.Generator) -> None:
    (least, most), _, maybe = numpy_interpreter.boxes(tape, low, high)
    for _ in range(3):
        value = numpy_interpreter.points(tape, *(low + random.random(low.shape) * (high - low)))[0]
        defined = np.isfinite(value) & (np.abs(value) < 1e280)
        assert ((value >= least) & (value <= most) | maybe)[defined].all()
        assert (~(value > 0) | ~(most < 0) | maybe)[defined].all()
        assert (~(value <= 0) | (least <= 0))[defined].all()  # also where a part is undefined, or a way not to be gone


# --- how far surfaces reach ---


@pytest.mark.parametrize(
    ("relation", "half"),
    [
        ("x^2 + y^2 + z^2 <= 1", 1.0), ("x^4 + 16 * y^4 + z^4 <= 625", 5.0), ("hypot(x, y, z) <= 1e-3", 1e-3),
        ("abs(x) + abs(y) + abs(z) <= 300", 300),
    ],
)
def test_a_surface_that_ends_is_found(relation, half):
    found = bounding_box.find_bounds(tape_of(relation)[0])
    assert found is not None
    assert (found[1] >= 0.999 * half * np.array([1, 0.4, 1])).all()
    assert (np.abs(found) <= 1.2 * half).all()


@pytest.mark.parametrize("relation", ["x <= 1", "x^2 + y^2 <= 1", "sin(x) <= y", "x^2 - y^2 <= z", "hypot(x, y, z) >= 1"])
def test_one_that_does_not_is_not(relation):
    assert bounding_box.find_bounds(tape_of(relation)[0]) is None


@pytest.mark.parametrize(
    ("relation", "same"),
    [
        ("x * y / x <= z", "y <= z"),
        ("x^2 * abs(y) / (3 * x * y) <= z", "x * sign(y) / 3 <= z"),
        ("x / (x^3 * y) <= z", "1 / (x^2 * y) <= z"),
        ("max(x, 0) / max(x, 0) <= z", None),
        ("sqrt(x) * y / sqrt(x) <= z", None),
        ("1 / x <= z", None),
        ("mod(5 * x * y, x) <= z", "x * mod(5 * y, 1) <= z"),
        ("mod(2 * x, x^2) <= z", "x * mod(2, x) <= z"),
        ("mod(x, max(x, 0)) <= z", None),
    ],
)
def test_factors_of_both_sides_of_a_quotient_go_where_they_are_0_at_places_alone(relation, same):
    tape = tape_of(relation)[0]
    if same is None:
        assert {Op.DIVIDE, Op.MOD} & set(tape.code[:, 0].tolist())
    else:
        assert tape.structure() == tape_of(same)[0].structure()


def test_a_sine_over_its_angle_is_1_where_that_is_0_and_bounds_know():
    tape = tape_of("sin(5 * x * y) / (2 * x * y) <= 0")[0]
    at = np.array([0.0, 1e-200, 1e-9, 1e-3, 0.1, 2.0]), np.array([3.0, 1.0, 1.0, 1.0, 1.0, 0.7])
    expected = 2.5 * np.sinc(5 * at[0] * at[1] / np.pi)
    np.testing.assert_allclose(numpy_interpreter.points(tape, *at, np.zeros(6))[0], expected, rtol=1e-14)
    corners = (np.tile(np.array([corner]).T, 8) for corner in ([-1e-3, 0.5, 0.0], [1e-3, 1.0, 0.0]))
    (low, high), _, _ = numpy_interpreter.boxes(tape, *corners, ways=np.arange(8, 16))  # on every side of what jumps, see search._passes
    assert (low > 2.4999).all()
    assert (high < 2.5001).all()
