"""`implicit` and solids: what their tapes are inside and outside, the boxes around them, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.tape import Tape, load_tape, most_live
from maquette.lang.diagnostics import Diagnostics, SceneError


def loaded(tmp_path: Path, text: str) -> tuple[ir.Scene, list[str]]:
    path = tmp_path / "a.scene"
    path.write_text("camera(position: [0, 0, 9])\n" + text + "\n", encoding="utf-8")
    found = Diagnostics()
    scene = load.load(path, diagnostics=found)
    return scene, [d.message for d in found.items]


def refused(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(SceneError) as caught:
        loaded(tmp_path, text)
    return [f"{d.message} ({d.hint})" if d.hint else d.message for d in caught.value.diagnostics]


def field(scene: ir.Scene, *points: tuple[float, float, float]) -> list[float]:
    """The field of the first instance at points of the world."""
    tables = scene.tables
    g, row = int(tables.instances.geometry[0]), int(tables.instances.transform[0])
    local = np.array(points) @ tables.transforms.inverse[row][:, :3].T + tables.transforms.inverse[row][:, 3]
    tapes, pools, t = tables.tapes, tables.pools, int(tables.geometries.tape[g])
    first, begin = int(tapes.first[t]), int(tapes.first_constant[t])
    tape = Tape(
        pools.code[first : first + tapes.count[t]], pools.constants[begin : begin + tapes.constant_count[t]], (int(tapes.results[t, 0]),)
    )
    return numpy_interpreter.points(tape, *local.T)[0].tolist()


def bounds(scene: ir.Scene) -> np.ndarray:
    return scene.tables.geometries.bounds[scene.tables.instances.geometry[0]]


# --- implicit ---


@pytest.mark.long
def test_values_that_wait_for_others_are_few(tmp_path):
    """All of a long minimum's operands could be computed before the first comparison; they are not."""
    balls = ", ".join(f"hypot(x - {0.1 * k}, y + {0.1 * k}, z - {k}) - 0.5" for k in range(300))
    tables = loaded(tmp_path, f"implicit(|x, y, z| min({balls}) <= 0, within: 400)")[0].tables
    tape = Tape(tables.pools.code, tables.pools.constants, (int(tables.tapes.results[0, 0]),))
    assert most_live(tape) < 12


@pytest.mark.long
def test_more_values_at_a_time_than_there_is_room_for(tmp_path):
    waves = [[f"sin({k} * x + y)" for k in range(first, first + 20)] for first in range(1, 300, 20)]
    one, other = (" + ".join(f"({sign.join(row)})" for row in waves) for sign in (" + ", " - "))
    text = f"implicit(|x, y, z| ({one}) * ({other}) <= z, within: 1)"
    hint = "this formula is too large for one surface: write several"
    assert refused(tmp_path, text) == [f"the formula needs 306 values at a time, and there is room for 256 ({hint})"]


def test_a_files_unit_is_that_of_its_coordinates(tmp_path):
    scene, _ = loaded(tmp_path, "unit mm\nimplicit(|x, y, z| hypot(x, y, z) <= 20)")
    inside, outside = field(scene, (0.0199, 0, 0), (0.0201, 0, 0))
    assert inside < 0 < outside
    assert np.allclose(bounds(scene), np.array([[-0.02] * 3, [0.02] * 3]), rtol=0.2)


def test_a_solid_is_closed_where_its_bounds_cut_it(tmp_path):
    scene, _ = loaded(tmp_path, "implicit(|x, y, z| x <= 0.3, within: sphere(1, center: [0, 0.5, 0]))")
    assert [f < 0 for f in field(scene, (-0.9, 0.5, 0), (-1.01, 0.5, 0), (0.29, 0.5, 0), (0.31, 0.5, 0), (0, 1.51, 0))] == [
        True, False, True, False, False
    ]  # fmt: skip


def test_bounds_shrink_to_the_surface(tmp_path):
    scene, _ = loaded(tmp_path, "implicit(|x, y, z| x^4 + 16 * y^4 + z^4 <= 1, within: 50)")
    assert np.allclose(bounds(scene), [[-1, -0.5, -1], [1, 0.5, 1]], atol=0.2)


@pytest.mark.parametrize("within", [1.5, 3, 20])
def test_bounds_are_close_to_a_heart_and_cut_nothing_off(tmp_path, within):
    relation = "(x^2 + 2.25 * z^2 + y^2 - 1)^3 <= 0.9 * x^2 * y^3 + 0.1125 * z^2 * y^3"
    scene, _ = loaded(tmp_path, f"implicit(|x, y, z| {relation}, within: {within})")
    x, y, z = p = RANDOM.uniform(-1.5, 1.5, (3, 100_000))
    heart = p[:, (x**2 + 2.25 * z**2 + y**2 - 1) ** 3 <= 0.9 * x**2 * y**3 + 0.1125 * z**2 * y**3].T
    low, high = bounds(scene)
    assert len(heart) > 1000
    assert ((heart > low) & (heart < high)).all()
    assert (heart.min(axis=0) - low < 0.6).all()
    assert (high - heart.max(axis=0) < 0.6).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("implicit(|x, y, z| y <= sin(x))", "it is not known how far this surface reaches: it may be endless "
         "(write within: and how far from the origin it is to be drawn, like within: 2)"),
        ("implicit(|x, y, z| x + y)", "a surface's formula is a relation, and this one gives a number "
         "(write … <= 0 for a solid, … == 0 for a sheet)"),
        ("implicit(|x, y| x <= y)", "a surface's formula has three parameters, x, y and z, not 2 (write |x, y, z| …)"),
        ("union { }", "this union is empty (put shapes in it: union { sphere(1); box(1.5) })"),
        ("union { sphere(1), box(1) }",
         "`;` or the end of the line separates items, not `,` (write ; here, or a new line)"),
        ("union { disk(1) }", "`disk` cannot be a part of a solid: a disk has no inside "
         "(solids are made of shapes with an inside: sphere, box, cylinder, implicit with an inequality, closed mesh, …)"),
        ("intersection { plane(y: 0); sphere(1); implicit(|x, y, z| x == 0, within: 1) }",
         "this is a sheet, which has no inside (write an inequality that holds in a region: neither == nor a square <= 0)"),
        ("union { implicit(|x, y, z| (x + y)^2 <= 0, within: 1); sphere(1) }",
         "this is a sheet, which has no inside (write an inequality that holds in a region: neither == nor a square <= 0)"),
        ("union { plane(y: 0) }", "this union is endless (cut it by an intersection with a box or sphere)"),
        ("morph { sphere(1) }", "a morph is between two solids, got 1 (write morph(0.5) { sphere(1); box(1.5) })"),
        ("bend(200deg, over: 1) { box(3) }", "bent this far its ends go through each other (a smaller angle, or over a greater length)"),
    ],
)  # fmt: skip
def test_what_is_refused(tmp_path, text, message):
    assert refused(tmp_path, text) == [message]


@pytest.mark.parametrize(
    ("relation", "same", "left_out"),
    [
        ("(y - 0.2)^2 * (y + 0.2) <= 0", "y + 0.2 <= 0", True),
        ("(y - 0.2)^2 * (y + 0.2) < 0", "y + 0.2 < 0", False),
        ("-2 * (x - 0.1)^4 * y * abs(z) <= 0", "-y <= 0", True),
        ("(y - 0.2 * x)^3 <= 0", "y - 0.2 * x <= 0", False),
        ("(x * y)^2 * x * z <= 0", "x * z <= 0", True),
        ("min((y - 0.2)^2, x - z) <= 0", "x - z <= 0", True),
        ("x - z <= 0 or abs(y) < 0", "min(x - z, 1) <= 0", False),
        ("max(x - z, -(y^2)) <= 0", "max(x - z, -1) <= 0", False),
        ("max(x, 0)^2 * (y - 0.1) <= 0", "max(x, 0)^2 * (y - 0.1) <= 0", False),
        ("sqrt(x)^2 * y <= 0", "sqrt(x)^2 * y <= 0", False),
    ],
)
def test_squares_in_a_solids_product_are_no_part_of_what_has_an_inside(tmp_path, relation, same, left_out):
    """(y − 0.2)² (y + 0.2) is at most 0 on a plane, too, which has no inside: that is said. Where a factor has plateaus at 0 it stays."""
    made, said = loaded(tmp_path, f"implicit(|x, y, z| {relation}, within: 1)")
    plain = loaded(tmp_path, f"implicit(|x, y, z| {same}, within: 1)")[0]
    assert load_tape(made.tables, 0).structure() == load_tape(plain.tables, 0).structure()
    assert said == (["where a squared factor is 0 this holds on a sheet, too, of which nothing is drawn"] if left_out else [])


@pytest.mark.long
def test_truths_compared_again_and_again_are_read_once_each(tmp_path):
    text = "(x > 0)"
    for k in range(30):  # each of which is used twice: 2³⁰ ways to the first
        text = f"({text} == (y > {k / 40 - 0.5:.3f}))"
    made, said = loaded(tmp_path, f"implicit(|x, y, z| {text}, within: 1)")
    assert len(load_tape(made.tables, 0).code) < 500
    assert said == []


@pytest.mark.parametrize("relation", ["abs(y) <= 0 and hypot(x, z) <= 0.5", "max((x - y)^2, z) <= 0", "x^2 <= 0 or (y - z)^2 <= 0"])
def test_what_holds_on_a_surface_alone_is_refused_in_a_larger_relation(tmp_path, relation):
    text = f"implicit(|x, y, z| {relation}, within: 1)"
    hint = "write how thick it is to be, like abs(y) <= 0.01"
    assert refused(tmp_path, text) == [f"this relation holds on a surface alone, which has no inside ({hint})"]


@pytest.mark.parametrize(
    ("relation", "sheet"),
    [
        ("(x^2 + y^2 - 0.5)^2 * abs(z - y) <= 0", True),
        ("0 >= max(y^3 - x, x - y^3)", True),
        ("0 >= max(y^3 - x, -(y^3 - x))", True),
        ("max(x^2 + y^2 - 0.5, 0)^2 <= 0", False),
        ("abs(abs(x) + abs(y) - abs(x + y)) <= 0", False),
        ("(x > 0) == (y^3 > 0)", False),
    ],
)
def test_what_is_never_below_0_is_a_sheet_where_it_is_0_on_a_surface_alone(tmp_path, relation, sheet):
    tables = loaded(tmp_path, f"implicit(|x, y, z| {relation}, within: 1)")[0].tables
    assert bool(tables.geometries.parameters[0, 0]) is sheet


def test_nothing_left_is_said(tmp_path):
    nothing = "intersection { sphere(1); sphere(1, center: [3, 0, 0]) }\nimplicit(|x, y, z| x^2 <= -1, within: 2)"
    _, said = loaded(tmp_path, f"sphere(1)\n{nothing}")
    assert said == [
        "nothing is left of this intersection: it is not drawn", "there is no surface within these bounds: nothing is drawn"
    ]  # fmt: skip


def test_bounds_that_lie_in_a_solid_are_warned_about(tmp_path):
    solid = "implicit(|x, y, z| x^4 + y^4 + z^4 <= 1, within: {})"
    assert loaded(tmp_path, solid.format(0.1))[1] == ["all points within these bounds are inside: the picture shows the box or ball itself"]
    assert loaded(tmp_path, solid.format(0.9))[1] == []


def test_an_ellipsoid_is_a_sphere_under_a_transform(tmp_path):
    """Turned, moved and stretched: where the formula holds and where the shape is are the same points."""
    relation = "2 * (x - 0.3)^2 + (y + z)^2 + 3 * (y - z - 0.2)^2 + (x - 0.3) * y <= 0.8"
    scene, _ = loaded(tmp_path, f"unit cm\nimplicit(|x, y, z| {relation})")
    tables = scene.tables
    assert tables.geometries.kind.tolist() == [ir.GeometryKind.SPHERE]
    inverse = tables.transforms.inverse[tables.instances.transform[0]]
    p = RANDOM.uniform(-1.5, 1.5, (4000, 3))
    x, y, z = p.T
    holds = 2 * (x - 0.3) ** 2 + (y + z) ** 2 + 3 * (y - z - 0.2) ** 2 + (x - 0.3) * y <= 0.8
    inside = np.linalg.norm(0.01 * p @ inverse[:, :3].T + inverse[:, 3], axis=1) <= 1
    assert np.array_equal(holds, inside)
    assert holds.any()
    cut, _ = loaded(tmp_path, f"implicit(|x, y, z| {relation}, within: 0.5)")
    assert cut.tables.geometries.kind.tolist() == [ir.GeometryKind.FORMULA]


@pytest.mark.parametrize(
    "relation", ["x^2 + y^2 <= 1 + z^2", "x^2 + y^2 + z^2 + 1 <= 0.5", "1 - x^2 - y^2 - z^2 <= 0", "x^2 * y + z^2 <= 1"]
)
def test_what_is_no_ellipsoid_is_not_taken_for_one(tmp_path, relation):
    scene, _ = loaded(tmp_path, f"sphere(1)\nimplicit(|x, y, z| {relation}, within: 2)")
    assert ir.GeometryKind.SPHERE not in scene.tables.geometries.kind.tolist()[1:]


# --- solids ---

RANDOM = np.random.default_rng(8)
SHAPES = {  # a shape of the language, and whether points are inside
    "sphere(0.9, center: [0.2, 0, 0])": lambda p: np.linalg.norm(p - [0.2, 0, 0], axis=1) - 0.9,
    "box([1, 1.4, 0.8])": lambda p: (np.abs(p) - [0.5, 0.7, 0.4]).max(axis=1),
    "cylinder(0.5, 1.2)": lambda p: np.maximum(np.hypot(p[:, 0], p[:, 2]) - 0.5, np.abs(p[:, 1]) - 0.6),
    "cone(0.6, 1, top: 0.2)": lambda p: np.maximum(np.hypot(p[:, 0], p[:, 2]) - 0.4 + 0.4 * p[:, 1], np.abs(p[:, 1]) - 0.5),
    "torus(0.8, 0.3)": lambda p: np.hypot(np.hypot(p[:, 0], p[:, 2]) - 0.8, p[:, 1]) - 0.3,
    "capsule(0.3, 0.8)": lambda p: np.linalg.norm(p - np.clip(p, [0, -0.4, 0], [0, 0.4, 0]), axis=1) - 0.3,
    "ellipsoid([0.9, 0.5, 0.7])": lambda p: np.linalg.norm(p / [0.9, 0.5, 0.7], axis=1) - 1,
    "quadric([1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2], within: 1.6)": lambda p: np.maximum(
        p[:, 0] ** 2 - p[:, 1] ** 2 + p[:, 2] ** 2 - 0.2, np.abs(p).max(axis=1) - 0.8
    ),
}


def agree(scene: ir.Scene, inside, spread: float = 1.4) -> None:
    points = RANDOM.uniform(-spread, spread, (2000, 3))
    expected = inside(points)
    clear = np.abs(expected) > 1e-9
    assert ((np.array(field(scene, *points)) < 0) == (expected < 0))[clear].all()
    assert (expected < 0).any()
    low, high = bounds(scene)
    within = points[expected < 0]
    assert ((within >= low) & (within <= high)).all()


@pytest.mark.parametrize("text", SHAPES, ids=lambda text: text.partition("(")[0])
def test_each_shape_is_a_part_of_solids(tmp_path, text):
    scene, said = loaded(tmp_path, f"union {{ {text} }}")
    assert said == []
    agree(scene, SHAPES[text])


@pytest.mark.parametrize(
    ("how", "of"), [("union", np.minimum), ("intersection", np.maximum), ("difference", lambda a, b: np.maximum(a, -b))]
)
def test_two_shapes_combine(tmp_path, how, of):
    one, other = "box([1, 1.4, 0.8])", "torus(0.8, 0.3)"
    scene, _ = loaded(tmp_path, f"{how} {{ {one}; {other} }}")
    agree(scene, lambda p: of(SHAPES[one](p), SHAPES[other](p)))


def test_blocks_transforms_and_nested_solids(tmp_path):
    text = "difference { box(1.6, rotate: [0, 0, 45deg]); translate([0.5, 0, 0]) { union { sphere(0.4); cylinder(0.2, 4) } } }"
    scene, _ = loaded(tmp_path, text)

    def inside(p):
        turned = np.stack([p[:, 0] + p[:, 1], p[:, 1] - p[:, 0], math.sqrt(2) * p[:, 2]], axis=1) / math.sqrt(2)
        moved = p - [0.5, 0, 0]
        hole = np.minimum(np.linalg.norm(moved, axis=1) - 0.4, np.maximum(np.hypot(moved[:, 0], moved[:, 2]) - 0.2, np.abs(p[:, 1]) - 2))
        return np.maximum(np.abs(turned).max(axis=1) - 0.8, -hole)

    agree(scene, inside)


def test_a_blend_is_an_arc_of_its_radius_and_nothing_beyond(tmp_path):
    """Two perpendicular walls and a fillet of radius r: a circle about (r, r) between them; r away from either all is as it was."""
    scene, _ = loaded(tmp_path, "union(round: 0.3) { box([2, 0.2, 2], center: [0, -0.1, 0]); box([0.2, 2, 2], center: [-0.1, 0, 0]) }")
    for angle in (200, 225, 250):
        x, y = (0.3 + 0.3 * f(math.radians(angle)) for f in (math.cos, math.sin))
        assert field(scene, (x, y, 0))[0] == pytest.approx(0, abs=1e-12)
    sharp, _ = loaded(tmp_path, "union { box([2, 0.2, 2], center: [0, -0.1, 0]); box([0.2, 2, 2], center: [-0.1, 0, 0]) }")
    beyond = [(0.31, 0.05, 0), (0.05, 0.31, 0), (0.6, 0.01, 0.2)]
    assert field(scene, *beyond) == pytest.approx(field(sharp, *beyond), abs=1e-12)


def test_what_changes_a_solid(tmp_path):
    ball = SHAPES["sphere(0.9, center: [0.2, 0, 0])"]
    made = "sphere(0.9, center: [0.2, 0, 0])"
    agree(loaded(tmp_path, f"shell(0.2) {{ {made} }}")[0], lambda p: np.maximum(ball(p), -0.2 - ball(p)))
    agree(loaded(tmp_path, f"offset(0.1) {{ {made} }}")[0], lambda p: ball(p) - 0.1)
    agree(loaded(tmp_path, f"mirrored([1, 0, 0]) {{ {made} }}")[0], lambda p: np.minimum(ball(p), ball(p * [-1, 1, 1])))
    agree(loaded(tmp_path, "repeat([0.7, 0, 0], count: 3) { sphere(0.3) }")[0],
          lambda p: np.min([np.linalg.norm(p - [0.7 * k, 0, 0], axis=1) - 0.3 for k in range(3)], axis=0))  # fmt: skip
    agree(loaded(tmp_path, f"morph(0.25) {{ {made}; box(1) }}")[0],
          lambda p: 0.75 * ball(p) + 0.25 * (np.abs(p).max(axis=1) - 0.5))  # fmt: skip


def test_twisted_and_bent(tmp_path):
    def turned(p):
        a = -math.radians(90) * p[:, 1]
        back = np.stack([np.cos(a) * p[:, 0] + np.sin(a) * p[:, 2], p[:, 1], np.cos(a) * p[:, 2] - np.sin(a) * p[:, 0]], axis=1)
        return (np.abs(back) - [0.5, 1, 0.2]).max(axis=1)

    agree(loaded(tmp_path, "twist(90deg) { box([1, 2, 0.4]) }")[0], turned)
    radius = 1 / math.radians(60)
    angle = math.radians(25)
    scene, _ = loaded(tmp_path, "bend(60deg) { box([2, 0.2, 0.4]) }")
    middle = (radius * math.sin(angle), radius - radius * math.cos(angle), 0.1)  # of a box's axis, arc length R · angle from the origin
    assert field(scene, middle)[0] == pytest.approx(-0.1, abs=1e-12)
    other, _ = loaded(tmp_path, "bend(-60deg) { box([2, 0.2, 0.4]) }")
    assert field(other, (middle[0], -middle[1], 0.1))[0] == pytest.approx(-0.1, abs=1e-12)
