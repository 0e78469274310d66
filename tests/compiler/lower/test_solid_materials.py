"""Materials of the parts of solids: the surface has the material of the part that it came from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.tape import load_tape
from maquette.lang.diagnostics import Diagnostics, SceneError

RED, BLUE, GREEN = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
COLORS = "let red = lambert(rgb(1, 0, 0))\nlet blue = lambert(rgb(0, 0, 1))\nlet green = lambert(rgb(0, 1, 0))\n"
TETRAHEDRON = "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def loaded(tmp_path: Path, text: str) -> tuple[ir.Scene, list[str]]:
    path = tmp_path / "a.scene"
    path.write_text("camera(position: [0, 0, 9])\n" + COLORS + text + "\n", encoding="utf-8")
    found = Diagnostics()
    scene = load.load(path, diagnostics=found)
    return scene, [d.message for d in found.items if not d.message.endswith("is never used")]


def color(scene: ir.Scene, at: tuple[float, float, float]) -> tuple[float, ...]:
    """The diffuse colour of the first instance at a point: that of its material, or the mixture of a blend's."""
    tables = scene.tables

    def of(row: int) -> np.ndarray:
        m = tables.materials
        if m.model[row] != ir.MaterialModel.BLEND:
            return m.values[row, ir.Slot.DIFFUSE]
        tape = load_tape(tables, int(tables.textures.tape[m.textures[row, ir.Slot.WEIGHT]]))
        weight = float(np.clip(numpy_interpreter.points(tape, *at)[0], 0, 1))
        return (1 - weight) * of(int(m.first[row])) + weight * of(int(m.second[row]))

    return tuple(np.round(of(int(tables.instances.material[0])), 12).tolist())


def test_each_part_of_a_union_has_its_material(tmp_path):
    text = "union { box(2, material: red); sphere(0.7, center: [1, 0, 0], material: blue); cylinder(0.3, 4, material: green) }"
    scene, said = loaded(tmp_path, text)
    assert said == []
    assert [color(scene, at) for at in ((0, 0, 1), (1.7, 0, 0), (0, 2, 0), (0.3, 1.5, 0))] == [RED, BLUE, GREEN, GREEN]


def test_what_a_difference_cuts_has_the_material_of_the_tool(tmp_path):
    scene, _ = loaded(tmp_path, "difference { box(2, material: red); cylinder(0.5, 4, material: blue) }")
    assert [color(scene, at) for at in ((1, 0, 0), (0.8, 1, 0.2), (0.5, 0, 0), (0, 0.9, -0.5))] == [RED, RED, BLUE, BLUE]


def test_an_intersection_shows_the_outermost_part(tmp_path):
    scene, _ = loaded(tmp_path, "intersection { box(2, material: red); sphere(1.2, material: blue) }")
    assert color(scene, (1, 0, 0)) == RED
    assert color(scene, (0.7, 0.7, np.sqrt(1.44 - 0.98))) == BLUE


@pytest.mark.parametrize(
    ("text", "material"),
    [
        ("union(material: green) { box(2, material: red); sphere(0.7, center: [1, 0, 0]) }", GREEN),
        ("group(material: green) { union { box(2, material: red); sphere(0.7, center: [1, 0, 0]) } }", GREEN),
        ("union { box(2, material: red); group(material: green) { sphere(0.7, center: [1, 0, 0]) } }", GREEN),
        ("union { box(2, material: red); union(material: green) { sphere(0.7, center: [1, 0, 0]) } }", GREEN),
    ],
)  # fmt: skip
def test_a_part_without_one_has_that_of_what_is_around_it(tmp_path, text, material):
    scene, _ = loaded(tmp_path, text)
    assert (color(scene, (0, 0, 1)), color(scene, (1.7, 0, 0))) == (RED, material)


def test_parts_of_nothing_else_have_the_default_one(tmp_path):
    scene, _ = loaded(tmp_path, "union { box(2, material: red); sphere(0.7, center: [1, 0, 0]) }\nsphere(1, center: [0, 9, 0])")
    default = scene.tables.materials.values[scene.tables.instances.material[1], ir.Slot.DIFFUSE]
    assert color(scene, (1.7, 0, 0)) == pytest.approx(tuple(default))


def test_where_faces_coincide_the_first_part_has_them(tmp_path):
    scene, _ = loaded(tmp_path, "union { box(2, material: red); box([1, 2, 5], material: blue) }")
    random = np.random.default_rng(1).uniform(-0.49, 0.49, (50, 2))
    assert {color(scene, (x, 1.0, z)) for x, z in random} == {RED}


def test_seams_are_sharp_or_blended_over_the_fillet(tmp_path):
    parts = "{ box([4, 1, 4], center: [0, -0.5, 0], material: red); box([1, 4, 4], center: [-0.5, 0, 0], material: blue) }"
    sharp, _ = loaded(tmp_path, f"union(round: 0.4) {parts}")
    mixed, _ = loaded(tmp_path, f"union(round: 0.4, seams: \"blended\") {parts}")
    middle, low, high = 0.4 - 0.4 / np.sqrt(2), 0.4 - 0.4 * np.sin(0.3), 0.4 - 0.4 * np.cos(0.3)
    assert (color(sharp, (low, high, 0)), color(sharp, (high, low, 0))) == (RED, BLUE)
    assert color(mixed, (middle, middle, 0)) == pytest.approx((0.5, 0, 0.5))
    assert [color(mixed, at) for at in ((0.4, 0, 0), (0, 0.4, 0), (1, 0, 0), (0, 1, 0))] == [RED, BLUE, RED, BLUE]
    assert 0.5 < color(mixed, (low, high, 0))[0] < 1


@pytest.mark.parametrize(
    ("solid", "places"),
    [
        ("twist(90deg, over: 2) { union { box([2, 2, 0.4], material: red); box([0.4, 2, 2], material: blue) } }",
         {(0.99 / np.sqrt(2), 0.5, -0.99 / np.sqrt(2)): RED, (0.99 / np.sqrt(2), 0.5, 0.99 / np.sqrt(2)): BLUE}),
        ("repeat([3, 0, 0], count: 3) { union { box(1, material: red); sphere(0.3, center: [0, 0.5, 0], material: blue) } }",
         {(6.5, 0, 0): RED, (6, 0.8, 0): BLUE, (3, 0.8, 0): BLUE, (2.5, 0, 0): RED}),
        ("mirrored([1, 0, 0]) { union { box(1, center: [2, 0, 0], material: red); sphere(0.3, center: [2.5, 0, 0], material: blue) } }",
         {(-2.8, 0, 0): BLUE, (-1.5, 0, 0): RED, (2.8, 0, 0): BLUE}),
        ("shell(0.1) { union { box(2, material: red); box([1, 3, 1], material: blue) } }", {(0.9, 0, 0): RED, (0, 1.4, 0): BLUE}),
        ("offset(0.1) { union { box(2, material: red); box([1, 3, 1], material: blue) } }", {(1.1, 0, 0): RED, (0, 1.6, 0): BLUE}),
        ("morph(0.25) { box(2, material: red); sphere(1, material: blue) }", {(1, 0, 0): (0.75, 0, 0.25)}),
        ("difference { union { box(2, material: red); box([1, 3, 1], material: blue) }; cylinder(0.2, 9, material: green) }",
         {(1, 0, 0): RED, (0.4, 1.5, 0): BLUE, (0.2, 1.2, 0): GREEN, (0.2, 0, 0): GREEN}),
    ],
)  # fmt: skip
def test_materials_follow_what_is_done_to_a_solid(tmp_path, solid, places):
    scene, _ = loaded(tmp_path, solid)
    assert [color(scene, at) for at in places] == [pytest.approx(expected) for expected in places.values()]


def test_a_solid_of_one_material_has_no_blend(tmp_path):
    scene, _ = loaded(tmp_path, "union { box(2, material: red); sphere(0.7, center: [1, 0, 0], material: red) }")
    assert not (scene.tables.materials.model == ir.MaterialModel.BLEND).any()
    assert len(scene.tables.textures.kind) == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("union { box(1); sphere(1, material: lambert(rgb(1, 0, 0), opacity: 0.5)) }",
         "materials of a solid's parts have no opacity of their own (give all parts one material)"),
        ('union { box(1); sphere(1, material: lambert(rgb(1, 0, 0), shading: "gouraud")) }',
         'light of a solid\'s parts is computed at points, not at vertices (leave out `shading: "gouraud"`)'),
        ('difference { mesh("a.off", material: red); sphere(1, material: blue) }',
         "the parts of a solid with a mesh in it are of one material (give it to the difference, or draw the parts beside each other)"),
    ],
)  # fmt: skip
def test_what_is_refused(tmp_path, text, message):
    (tmp_path / "a.off").write_text(TETRAHEDRON, encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        loaded(tmp_path, text)
    said = [f"{d.message} ({d.hint})" if d.hint else d.message for d in caught.value.diagnostics]
    assert message in said


@pytest.mark.parametrize(
    "solid",
    [
        'mirrored([1, 0, 0]) { mesh("a.off", material: red) }', 'repeat([3, 0, 0], count: 2) { mesh("a.off", material: red) }',
        'difference(translate: [0, 1, 0]) { mesh("a.off", material: red); sphere(0.2, material: red) }',
        'union { translate([0, 3, 0]) { mesh("a.off", material: red) } }',
    ],
)  # fmt: skip
def test_a_solid_of_meshes_has_their_material(tmp_path, solid):
    (tmp_path / "a.off").write_text(TETRAHEDRON, encoding="utf-8")
    scene, _ = loaded(tmp_path, solid)
    assert color(scene, (0, 0, 0)) == RED


def test_blended_seams_need_a_fillet(tmp_path):
    _, said = loaded(tmp_path, 'union(seams: "blended") { box(2, material: red); sphere(0.7, center: [1, 0, 0], material: blue) }')
    assert said == ["without `round` there is no fillet to mix materials over"]
