"""Media in the tables: coefficients, boundaries of shapes, frames of densities, and the fog; what cannot be filled is told."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.tape import load_tape

Slot, Model = ir.Slot, ir.MaterialModel
REST = "\ncamera([0, 1, 5])\n"
NO_SHADOW = int(ir.Visibility.CAMERA | ir.Visibility.REFLECTION)


def filled(scene: ir.Scene, instance: int = 0) -> dict[str, object]:
    """The medium of an instance's material, without columns that have their default."""
    media = scene.tables.media
    row = int(scene.tables.materials.medium[scene.tables.instances.material[instance]])
    assert row >= 0
    return {name: np.round(getattr(media, name)[row].astype(float), 12).tolist() for name in media._fields}


def test_a_medium_by_colour_and_depth(compiled) -> None:
    found = filled(compiled("sphere(1, medium: medium(rgb(1, 0.5, 0), 2cm, phase: -0.3))" + REST))
    assert found["scattering"] == [50, 25, 0]
    assert found["absorption"] == [0, 25, 50]
    assert (found["anisotropy"], found["everywhere"], found["density"]) == (-0.3, False, -1)


def test_white_with_a_mean_free_path_of_10_cm_is_the_default(compiled) -> None:
    found = filled(compiled("sphere(1, medium: medium())" + REST))
    assert (found["scattering"], found["absorption"], found["emission"]) == ([10] * 3, [0] * 3, [0] * 3)


def test_the_depth_may_differ_by_channel(compiled) -> None:
    assert filled(compiled("sphere(1, medium: medium(depth: [1cm, 2cm, 4cm]))" + REST))["scattering"] == [100, 50, 25]


@pytest.mark.parametrize(
    ("written", "per_metre"),
    [("3", [3] * 3), ("rgb(1, 2, 3)", [1, 2, 3]), ("[1, 2, 3]", [1, 2, 3]), ("[1, 2, 3] / 1mm", [1000, 2000, 3000]), ("2 / 50cm", [4] * 3)],
)
@pytest.mark.parametrize("unit", ["", "unit mm\n"])
def test_coefficients_are_per_metre_in_any_unit(compiled, written: str, per_metre: list[float], unit: str) -> None:
    found = filled(compiled(f"{unit}sphere(1m, medium: medium(scattering: {written}, absorption: {written}))" + REST))
    assert found["scattering"] == found["absorption"] == per_metre


def test_emission_alone_scatters_nothing(compiled) -> None:
    scene = compiled("sphere(1, medium: medium(emission: rgb(9, 5, 1)))" + REST)
    found = filled(scene)
    assert (found["scattering"], found["absorption"], found["emission"]) == ([0] * 3, [0] * 3, [9, 5, 1])
    assert not scene.photometric


def test_emission_with_a_unit_is_photometric(compiled) -> None:
    scene = compiled("sphere(1, medium: medium(emission: 100nit / 1cm))" + REST)
    assert filled(scene)["emission"] == [10_000] * 3
    assert scene.photometric


def test_a_number_as_density_scales_all_coefficients(compiled) -> None:
    found = filled(compiled("sphere(1, medium: medium(scattering: 1, absorption: 2, emission: 3, density: 2))" + REST))
    assert (found["scattering"], found["absorption"], found["emission"]) == ([2] * 3, [4] * 3, [6] * 3)


def test_without_a_material_the_boundary_is_not_seen_and_casts_no_shadow(compiled) -> None:
    tables = compiled("sphere(1, medium: medium(priority: 2))" + REST).tables
    row = int(tables.instances.material[0])
    assert tables.materials.model[row] == Model.GLASS
    inputs = {slot: tables.materials.values[row, slot].tolist() for slot in (Slot.TRANSMISSION, Slot.IOR, Slot.ROUGHNESS, Slot.PRIORITY)}
    assert list(inputs.values()) == [[1, 1, 1], [1, 0, 0], [0, 0, 0], [2, 0, 0]]
    assert tables.instances.visible.tolist() == [NO_SHADOW]
    assert tables.media.priority.tolist() == [2]


def test_glass_keeps_its_own_inputs_and_gives_its_priority(compiled) -> None:
    scene = compiled("sphere(1, material: glass(ior: 1.33, inside: rgb(0.5, 0.5, 1), priority: 3), medium: medium())" + REST)
    tables = scene.tables
    row = int(tables.instances.material[0])
    assert tables.materials.values[row, Slot.IOR, 0] == 1.33
    assert tables.materials.values[row, Slot.ABSORPTION].max() > 0
    assert tables.instances.visible.tolist() == [7]
    assert filled(scene)["priority"] == 3


def test_blocks_pass_a_medium_on_and_shapes_override_it(compiled) -> None:
    scene = compiled("group(medium: medium(scattering: 1)) { sphere(1); group { box(1, medium: medium(scattering: 2)) } }" + REST)
    assert [filled(scene, k)["scattering"] for k in (0, 1)] == [[1] * 3, [2] * 3]


def test_a_call_of_a_part_takes_a_medium(compiled) -> None:
    scene = compiled("let ball(r = 1) = sphere(r)\nball(2, medium: medium(scattering: 7))" + REST)
    assert filled(scene)["scattering"] == [7] * 3


def test_equal_media_are_one_row(compiled) -> None:
    scene = compiled("let m = medium()\nfor (k in 0..5) { sphere(0.2, [k, 0, 0], medium: m) }" + REST)
    assert len(scene.tables.media.anisotropy) == 1
    assert len(set(scene.tables.instances.material.tolist())) == 1


def test_a_density_is_in_the_frame_of_each_instance(compiled) -> None:
    boxes = "for (k in 0..1) { box([2, 4, 6], [5, 0, 0], translate: [k, 0, 0], scale: 2, medium: m) }"
    tables = compiled("unit cm\nlet m = medium(scattering: 1, density: |x, y, z| x)\n" + boxes + REST).tables
    rows = tables.materials.medium[tables.instances.material]
    assert sorted(rows.tolist()) == [0, 1]
    assert tables.media.transform[rows].tolist() == tables.instances.transform.tolist()
    assert np.allclose(tables.media.bounds[rows], np.array([[-0.01, -0.02, -0.03], [0.01, 0.02, 0.03]]))
    tape = load_tape(tables, int(tables.textures.tape[tables.media.density[0]]))
    values = numpy_interpreter.points(tape, np.array([0.01, 0.003, -0.01]), np.zeros(3), np.zeros(3))[0]
    assert np.allclose(values, [1.0, 0.3, 0.0])  # in the unit of the file; 0 in place of negative densities


def test_a_pattern_is_a_density(compiled) -> None:
    assert filled(compiled("sphere(1, medium: medium(density: pattern(|x, y, z| y)))" + REST))["density"] == 0


@pytest.mark.parametrize(
    "shape",
    [
        "box(1", "torus(1, 0.2", "cone(1, 2", "cylinder(1, 2", "capsule(0.5, 1", 'text("ab"', "implicit(|x, y, z| x^4 + y^4 + z^4 <= 1",
        "extrude([[0, 0], [1, 0], [0, 1]], 1", "revolve([[0, 0], [0.5, 0], [0.3, 1], [0, 1]]", "curve([[0, 0, 0], [1, 0, 0]], 0.1",
        "heightfield([[0, 1], [1, 0]], base: 1",
        "mesh(points: [[0,0,0],[1,0,0],[0,1,0],[0,0,1]], faces: [[0,2,1],[0,1,3],[0,3,2],[1,2,3]]",
    ],
)  # fmt: skip
def test_every_closed_shape_holds_a_medium(compiled, shape: str) -> None:
    scene = compiled(f"{shape}, medium: medium(density: |x, y, z| 1 + x, scattering: 1))" + REST)
    assert filled(scene)["scattering"] == [1] * 3
    assert scene.tables.instances.visible.tolist() == [NO_SHADOW]


def test_solids_hold_a_medium_and_parts_with_a_material_are_seen(compiled) -> None:
    solids = "union(medium: m) { box(1); sphere(0.6) }\nunion(medium: m) { box(1); sphere(0.6, material: glass()) }"
    scene = compiled("let m = medium()\n" + solids + REST)
    filled(scene, 0)
    filled(scene, 1)
    assert scene.tables.instances.visible.tolist() == [NO_SHADOW, 7]


def test_fog(compiled) -> None:
    tables = compiled("fog(rgb(1, 0.5, 0), 391.2)\nsphere(1)" + REST).tables
    media = tables.media
    assert np.allclose(media.scattering, [[0.01, 0.005, 0.0]])
    assert np.allclose(media.absorption, [[0.0, 0.005, 0.01]])
    assert media.everywhere.tolist() == [True]
    assert (media.top[0], media.falloff[0], media.anisotropy[0]) == (0, 48.9, 0.5)
    assert tables.materials.medium.tolist() == [-1]


@pytest.mark.parametrize(
    ("written", "top", "falloff"),
    [("top: 3", 3, 0), ("falloff: 2", 0, 2), ("top: 3, falloff: 2", 3, 2), ("scattering: 3.912", 0, 0.125), ("visibility: 8", 0, 1)],
)
def test_top_and_falloff_of_fog(compiled, written: str, top: float, falloff: float) -> None:
    media = compiled(f"fog({written})\nsphere(1)" + REST).tables.media
    assert (media.top[0], round(float(media.falloff[0]), 12)) == (top, falloff)


OPEN = """\
let m = medium()
disk(1, medium: m)
cylinder(1, 2, capped: false, medium: m)
triangle([[0, 0, 0], [1, 0, 0], [0, 1, 0]], medium: m)
implicit(|x, y, z| x^2 + y^2 + sin(z) == 1, within: 1, medium: m)
heightfield([[0, 1], [1, 0]], medium: m)
mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], faces: [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], medium: m)
group(medium: m) { plane() }
union { box(1); sphere(1, medium: m) }
"""
TOLD = """\
a.scene:2:1: error: this disk has no thickness: a medium fills a closed shape
   2 | disk(1, medium: m)
     | ^^^^^^^^^^^^^^^^^^ a flat `cylinder` has an inside
a.scene:3:1: error: this cylinder has no caps: a medium fills a closed shape
   3 | cylinder(1, 2, capped: false, medium: m)
     | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ leave out `capped: false`
a.scene:4:1: error: this triangle is open at 3 edges: a medium fills a closed shape
   4 | triangle([[0, 0, 0], [1, 0, 0], [0, 1, 0]], medium: m)
     | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^ a thin `box` has an inside
"""


def test_what_cannot_hold_a_medium_is_told(said) -> None:
    found = said(OPEN + REST)
    assert found.startswith(TOLD)
    messages = [line.partition(": ")[2] for line in found.splitlines() if line.startswith("a.scene:")]
    assert messages[3:] == [
        "error: this implicit is a surface without an inside: a medium fills a closed shape",
        "error: this heightfield is open at 4 edges: a medium fills a closed shape",
        "error: the faces of this mesh point inwards, or enclose nothing: a medium fills a closed shape",
        "warning: this plane has no end: a medium fills a closed shape, so this one gets none of its block",
        "error: a part of a solid has no medium of its own",
    ]


def test_a_medium_behind_an_opaque_material_is_told(said) -> None:
    text = "sphere(1, material: emissive(), medium: medium())\ngroup(medium: medium()) { sphere(1, material: mirror()) }"
    messages = [line.partition(": ")[2] for line in said(text + REST).splitlines() if line.startswith("a.scene:")]
    assert messages == ["warning: the medium of this sphere is never seen: no light passes its material"] * 2


def test_wrong_numbers_are_told(said) -> None:
    text = (
        "sphere(1, medium: medium(density: |x, y| x))\nsphere(1, medium: medium(density: |x, y, z| rgb(x, 1, 1)))\n"
        "sphere(1, medium: medium(rgb(1.5, 1, 1)))\nfog(scattering: 0)"
    )
    messages = [line.partition(": ")[2] for line in said(text + REST).splitlines() if line.startswith("a.scene:")]
    assert messages == [
        "error: a density's formula has three parameters, x, y and z, not 2",
        "error: a density here gives a number, not a color",
        "error: a medium sends on no more light than it gets: a channel of its colour is 1.5",
        "warning: this fog neither scatters nor absorbs light: it is left out",
    ]


UNBOUNDED = ["1 / x", "1 / hypot(x, y, z)", "exp(1000 * x)", "tan(3 * x)"]


@pytest.mark.parametrize("formula", UNBOUNDED)
def test_a_density_without_a_bound_is_told_once(said, formula: str) -> None:
    text = f"let m = medium(density: |x, y, z| {formula})\nfor (k in 0..3) {{ sphere(1, [k, 0, 0], medium: m) }}"
    lines = [line for line in said(text + REST).splitlines() if line.startswith("a.scene:")]
    message = "the density of this medium may exceed 1e+09 in the box around its shape, as by a division by 0"
    assert [line.partition("error: ")[2] for line in lines] == [message]


BOUNDED = ["1 / (x * x + 0.01)", "1 / (3 + x - y * x)", "1 / max(hypot(x, y, z), 0.1)", "exp(9 * x)", "1 / (x + 1.02)"]


@pytest.mark.parametrize("formula", BOUNDED)
def test_a_bounded_density_is_taken(compiled, formula: str) -> None:
    assert filled(compiled(f"sphere(1, medium: medium(density: |x, y, z| {formula}))" + REST))["density"] == 0


def test_more_media_than_rays_carry_are_told(said) -> None:
    text = "for (k in 0..129) { sphere(0.2, [k, 0, 0], medium: medium(scattering: k)) }"
    lines = [line for line in said(text + REST).splitlines() if "warning" in line]
    assert lines == ["warning: 130 materials of this scene have a medium inside: 127 are drawn, those of the highest priority"]


def test_several_materials_around_one_medium_have_it(said, tmp_path) -> None:
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl a\nf 1 3 2\nf 1 2 4\nusemtl b\nf 1 4 3\nf 2 3 4\n"
    (tmp_path / "two.obj").write_text(text, encoding="utf-8")
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n", encoding="utf-8")
    both = 'materials: [["a", glass()], ["b", glass(roughness: 0.3)]]'
    assert "warning" not in said(f'mesh("two.obj", medium: medium(), {both})' + REST)


def test_what_an_opacity_lets_pass_enters_no_medium(said) -> None:
    text = "sphere(1, material: lambert(0.5, opacity: 0.5), medium: medium())"
    message = "warning: the medium of this sphere is never seen: light that passes by an opacity does not enter it"
    assert message in said(text + REST)
