"""The validator: good scenes pass untouched, broken ones are repaired or refused with a message, and nothing makes it raise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene import builder as scene_builder
from maquette.compiler.scene import dump, transforms, validate
from maquette.compiler.scene.row_records import (
    CameraData,
    Input,
    InstanceData,
    LightData,
    MaterialData,
    MeshAttribute,
    MeshData,
    Outlines,
    TextureData,
)
from maquette.lang.diagnostics import Span

SPAN = Span("a.scene", 3, 5, 3, 11)
Change = Callable[[dict[str, dict[str, np.ndarray]]], object]  # of the columns of each table, in place
QUAD = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def quad(positions: np.ndarray = QUAD, triangles: Any = ((0, 1, 2), (0, 2, 3)), **more: Any) -> MeshData:
    return MeshData(np.asarray(positions, dtype=float), np.array(triangles), **more)


def filled() -> scene_builder.SceneBuilder:
    """A builder with something in every table."""
    b = scene_builder.SceneBuilder()
    outlines = Outlines(np.arange(4), np.array([[0, 4]]), np.array([[0, 1, 0, 2]]))
    faces = MeshAttribute(np.array([[1.0, 0, 0], [0, 1, 0]]), ir.Interpolation.FACE)
    corners = MeshAttribute(np.arange(12.0).reshape(6, 2), ir.Interpolation.CORNER)
    normals = MeshAttribute(np.tile([0.0, 0, 1], (4, 1)))
    mesh = b.mesh(quad(normals=normals, uvs=corners, colors=faces, outlines=outlines), SPAN, "tile")
    image = b.image(np.ones((2, 3, 4)), "white")
    texture = b.texture(TextureData(ir.TextureKind.IMAGE, image))
    b.texture(TextureData(ir.TextureKind.CHECKER, size=0.5))
    inputs = {ir.Slot.DIFFUSE: Input(texture=texture), ir.Slot.SHININESS: Input.number(9)}
    material = b.material(MaterialData(ir.MaterialModel.PHONG, inputs))
    moved = b.transform(transforms.translation((1, 2, 3)) @ transforms.scaling((1, -2, 3)))
    b.instance(InstanceData(mesh, moved, material, name="tile"), SPAN)
    lamp = b.light(LightData(ir.LightKind.SPHERE, (1, 1, 1), size=(0.5, 0)), SPAN)
    b.instance(InstanceData(b.geometry(ir.GeometryKind.SPHERE, (0.5,), SPAN), 0, material, lamp, 5), SPAN)
    for kind, parameters in (
        (ir.GeometryKind.BOX, (1, 2, 3)),
        (ir.GeometryKind.PLANE, ()),
        (ir.GeometryKind.CONE, (1, 0, 1, 1)),
        (ir.GeometryKind.QUADRIC, (1, 1, 1, 0, 0, 0, 0, 0, 0, -1, np.inf, np.inf, np.inf)),
    ):
        b.instance(InstanceData(b.geometry(kind, parameters)))
    b.light(LightData(ir.LightKind.SPOT, (1, 1, 1), direction=(0, -1, 0), cos_cone=0.8, cos_full=0.9))
    b.light(LightData(ir.LightKind.POINT, (1, 1, 1), falloff=ir.FalloffKind.RAMP, coefficients=(1, 2, 0)))
    b.light(LightData(ir.LightKind.DOME, (1, 1, 1), image=image))
    b.camera(CameraData(moved, 0.5))
    return b


def scene(change: Change | None = None, builder: scene_builder.SceneBuilder | None = None) -> ir.Scene:
    """The full scene with its tables changed."""
    made = (builder or filled()).finish("a")
    tables = {name: {c: v.copy() for c, v in getattr(made.tables, name)._asdict().items()} for name in ir.TABLES}
    if change:
        change(tables)
    return replace(made, tables=ir.Tables(**{name: ir.TABLES[name](**columns) for name, columns in tables.items()}))


def messages(checked: ir.Scene) -> list[tuple[str, str]]:
    return [(d.severity, d.message) for d in validate.validate(checked)[1].items]


def test_a_good_scene_is_the_very_same() -> None:
    made = filled().finish("a")
    checked, found = validate.validate(made)
    assert found.items == []
    assert checked is made


@pytest.mark.parametrize(
    ("table", "column", "row", "value", "message"),
    [
        ("instances", "geometry", 0, 99, "instance `tile`: its geometry is not a row of geometries"),
        ("instances", "geometry", 0, -1, "instance `tile`: its geometry is not a row of geometries"),
        ("instances", "transform", 1, 7, "instance: its transform is not a row of transforms"),
        ("instances", "material", 0, 5, "instance `tile`: its material is not a row of materials"),
        ("instances", "light", 0, 9, "instance `tile`: its light is not a row of lights"),
        ("instances", "visible", 0, 8, "instance `tile`: its visibility has bits that mean nothing"),
        ("attributes", "interpolation", 0, 4, "attribute `normals`: its interpolation is none of constant, face, vertex, corner"),
        ("geometries", "normals", 0, 3, "shape `tile`: its normals is not a row of attributes"),
        ("geometries", "first_triangle", 0, 1, "shape `tile`: its range of triangle rows is not in the pool"),
        ("geometries", "vertex_count", 0, 2**31 - 1, "shape `tile`: its range of vertex rows is not in the pool"),
        ("geometries", "parameters", 1, 0, "shape: its measures are not finite, or not above 0"),
        ("geometries", "parameters", 1, np.nan, "shape: its measures are not finite, or not above 0"),
        ("geometries", "origin", 1, 1, "shape: only meshes have an origin"),
        ("geometries", "origin", 0, np.inf, "shape `tile`: its origin is not finite"),
        ("attributes", "count", 0, 10**6, "attribute `normals`: its values are not in the pool"),
        ("images", "width", 0, 100, "image `white`: its pixels are not among the texels"),
        ("images", "first", 0, -1, "image `white`: its pixels are not among the texels"),
        ("materials", "model", 0, 99, "material: its model is none of " + ", ".join(m.name.lower() for m in ir.MaterialModel)),
        ("materials", "textures", 0, 2, "material: its textures is not a row of textures"),
        ("materials", "values", 0, np.nan, "material: its values is not a finite number"),
        ("materials", "values", 0, -0.5, "material: it has a negative coefficient"),
        ("textures", "image", 0, -1, "texture: it has no picture"),
        ("textures", "channel", 0, 4, "texture: its channel is none of -1 … 3"),
        ("lights", "color", 0, np.inf, "light: its color is not a finite number"),
        ("lights", "color", 0, -1, "light: its strength is negative"),
        ("lights", "size", 0, 0, "light: it has no area: it gives no light"),
        ("lights", "direction", 1, 0, "light: its direction is not of length 1"),
        ("lights", "receivers", 0, 8, "light: its links have bits that mean nothing"),
        ("lights", "blockers", 0, -1, "light: its links have bits that mean nothing"),
        ("lights", "cos_cone", 1, 0.95, "light: its cone is none: −1 ≤ cos_cone ≤ cos_full ≤ 1 does not hold"),
        ("lights", "coefficients", 2, 1, "light: its fall-off is none"),
        ("lights", "image", 3, -1, "light: a dome has a picture"),
        ("lights", "instance", 0, 0, "light: the instance that is its shape does not say so"),
        ("cameras", "extent", 0, 0, "camera: its field of view is not above 0"),
        ("cameras", "near", 0, np.nan, "camera: its near is not a finite number"),
        ("cameras", "far", 0, 0, "camera: its near and far are in the wrong order"),
        ("cameras", "exposure", 0, np.inf, "camera: its exposure is not finite"),
        ("transforms", "matrix", 1, 0, "transform: it flattens to nothing (no inverse)"),
        ("transforms", "matrix", 1, np.nan, "transform: its matrix is not a finite number"),
    ],
)
def test_what_cannot_be_repaired(table: str, column: str, row: int, value: float, message: str) -> None:
    def change(tables: dict[str, dict[str, np.ndarray]]) -> None:
        tables[table][column][row] = value

    assert ("error", message) in messages(scene(change))


def test_messages_point_at_the_source() -> None:
    checked = scene(lambda t: t["instances"]["geometry"].__setitem__(slice(0, 2), 99))
    (found,) = validate.validate(checked)[1].items
    assert (found.message, found.span) == ("instance `tile`: its geometry is not a row of geometries (and 1 more)", SPAN)


def test_tables_must_have_one_length_and_type() -> None:
    cut = scene(lambda t: t["instances"].update(light=t["instances"]["light"][:-1]))
    assert messages(cut) == [("error", "the IR's table instances has columns of different lengths: 5, 6")]
    typed = scene(lambda t: t["instances"].update(light=t["instances"]["light"].astype(float)))
    assert messages(typed) == [("error", "the IR's column instances.light has not the type it should have")]
    assert messages(replace(scene(), names=ir.Names()))[0] == ("error", "the IR has 6 geometries and 0 names of them")


def test_a_scene_has_a_camera_and_the_identity() -> None:
    assert ("error", "the scene has no camera") in messages(scene_builder.SceneBuilder().finish())
    moved = scene(lambda t: t["transforms"]["matrix"].__setitem__((0, 0, 3), 1.0))
    assert messages(moved) == [("error", "the IR's first transform is not the identity")]


def repaired(change: Change) -> tuple[ir.Tables, list[str]]:
    """The tables after a repair, and what was said; the result has nothing wrong any more."""
    checked, found = validate.validate(scene(change))
    assert {d.severity for d in found.items} == {"warning"}
    again, nothing = validate.validate(checked)
    assert nothing.items == []
    assert again is checked
    return checked.tables, [d.message for d in found.items]


def test_wrong_inverses_and_orientations_are_computed_again() -> None:
    tables, said = repaired(lambda t: (t["transforms"]["inverse"].fill(0), t["transforms"]["flips"].fill(False)))
    assert said == [
        "transform: its inverse was not its inverse: computed again (and 1 more)",
        "transform: its orientation was wrong: computed again",
    ]
    assert tables.transforms.flips.tolist() == [False, True]
    assert np.allclose(tables.transforms.inverse[1], [[1, 0, 0, -1], [0, -0.5, 0, 1], [0, 0, 1 / 3, -1]])


def test_wrong_bounds_are_computed_again() -> None:
    tables, said = repaired(lambda t: t["geometries"]["bounds"].fill(0))
    assert said == [
        "shape: its bounds did not hold it: computed again (and 4 more)",
        "shape `tile`: its bounds did not hold it: computed again",
    ]
    assert tables.geometries.bounds[:2].tolist() == [[[0, 0, 0], [1, 1, 0]], [[-0.5] * 3, [0.5] * 3]]


@pytest.mark.parametrize("bad", [(0, 1, 1), (0, 0, 0)])
def test_a_triangle_with_a_repeated_corner_is_dropped_with_what_hangs_on_it(bad: tuple[int, int, int]) -> None:
    tables, said = repaired(lambda t: t["pools"]["triangles"].__setitem__(0, bad))
    assert said == ["shape `tile`: 1 triangle has no area or no finite corners: dropped"]
    g, a, p = tables.geometries, tables.attributes, tables.pools
    assert p.triangles.tolist() == [[0, 2, 3]]
    assert g.triangle_count[0] == 1
    uvs, colors = (p.values[a.first[row] :][: a.count[row] * a.width[row]].tolist() for row in (g.uvs[0], g.colors[0]))
    assert (uvs, colors) == ([6, 7, 8, 9, 10, 11], [0, 1, 0])  # the second triangle's
    assert (tables.polygons.first_triangle.tolist(), tables.polygons.triangle_count.tolist()) == ([0], [1])


def test_lines_and_not_numbers_are_no_triangles() -> None:
    tables, said = repaired(lambda t: t["pools"]["positions"].__setitem__(1, [np.nan, 0, 0]))
    assert said == ["shape `tile`: 1 triangle has no area or no finite corners: dropped"]
    assert np.isfinite(tables.pools.positions).all()
    flat = scene_builder.SceneBuilder()
    line = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2], [0, 1, 0]])
    flat.instance(InstanceData(flat.mesh(quad(line, [[0, 1, 2], [0, 1, 3]]), SPAN)))
    flat.camera(CameraData(0, 1.0))
    checked, found = validate.validate(flat.finish())
    assert [d.message for d in found.items] == ["shape: 1 triangle has no area or no finite corners: dropped"]
    assert found.items[0].span == SPAN
    assert checked.tables.geometries.triangle_count.tolist() == [1]


def test_tiny_and_thin_triangles_stay() -> None:
    b = scene_builder.SceneBuilder()
    b.mesh(quad(QUAD * 1e-15))
    b.mesh(quad(QUAD * [1.0, 1e-6, 1.0]))
    b.camera(CameraData(0, 1.0))
    made = b.finish()
    assert validate.validate(made)[0] is made


def test_triangles_that_name_absent_vertices_are_dropped() -> None:
    tables, said = repaired(lambda t: t["pools"]["triangles"].__setitem__((1, 2), 4))
    assert said == ["shape `tile`: 1 triangle names vertices that are not there: dropped"]
    assert tables.pools.triangles.tolist() == [[0, 1, 2]]


def test_an_instance_of_nothing_is_left_out_and_lights_follow() -> None:
    def change(t: dict[str, dict[str, np.ndarray]]) -> None:
        t["pools"]["triangles"][:] = 0

    checked, found = validate.validate(scene(change))
    assert [d.message for d in found.items] == [
        "shape `tile`: 2 triangles have no area or no finite corners: dropped",
        "instance `tile`: its mesh has no triangle that can be drawn: it is left out",
    ]
    assert len(checked.tables.instances.geometry) == len(checked.names.instances) == len(checked.spans.rows["instances"]) == 5
    assert checked.tables.lights.instance.tolist() == [0, -1, -1, -1]
    assert validate.validate(checked)[1].items == []


def test_attributes_and_outlines_that_do_not_go_with_their_mesh_are_left_out() -> None:
    tables, said = repaired(lambda t: (t["attributes"]["width"].__setitem__(1, 3), t["attributes"]["count"].__setitem__(1, 4)))
    assert said == ["shape `tile`: its uvs do not go with its vertices and faces: they are left out"]
    assert tables.geometries.uvs[0] == -1
    for column, value in (("corners", 9), ("loops", 7)):
        tables, said = repaired(lambda t, column=column, value=value: t["pools"][column].fill(value))
        assert said == ["shape `tile`: its outlines do not go with its vertices: they are left out"]
        assert tables.geometries.polygon_count[0] == 0


def test_values_that_are_not_finite_count_as_nothing() -> None:
    tables, said = repaired(lambda t: (t["pools"]["values"].__setitem__(0, np.nan), t["images"]["texels"].__setitem__((0, 1), np.inf)))
    assert said == [
        "1 texels' values are not finite: they are drawn as 0",
        "1 values of meshes' normals, texture coordinates or colours are not finite: they count as 0",
    ]
    assert (tables.pools.values[0], tables.images.texels[0, 1]) == (0, 0)


def test_dark_lights_are_warned_about() -> None:
    assert messages(scene(lambda t: t["lights"]["color"].__setitem__(2, 0))) == [("warning", "light: its strength is 0: it gives no light")]


COLUMNS = [(table, column) for table, made in ir.TABLES.items() for column in made._fields]  # type: ignore[attr-defined]
NUMBERS = [0, 1, -1, 2, 3, 7, 100, 2**31 - 1, -(2**31), 0.5, 1e-30, 1e30, 1e300, -1e300, np.nan, np.inf, -np.inf]


@pytest.mark.long
@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.sampled_from(COLUMNS), st.integers(0, 50), st.sampled_from(NUMBERS)), min_size=1, max_size=6))
def test_whatever_stands_in_the_tables_the_validator_answers(changes: list) -> None:
    def change(tables: dict[str, dict[str, np.ndarray]]) -> None:
        with np.errstate(all="ignore"):
            for (table, column), at, number in changes:
                flat = tables[table][column].reshape(-1)
                if len(flat):
                    whole = int(np.clip(np.nan_to_num(number, posinf=9, neginf=-9), -(2**31), 2**31 - 1))
                    flat[at % len(flat)] = whole if flat.dtype.kind == "i" else np.array(number).astype(flat.dtype)

    checked, found = validate.validate(scene(change))
    if not found.failed:
        again, nothing = validate.validate(checked)
        assert [d for d in nothing.items if d.severity == "error" or "strength" not in d.message] == []
        assert again is checked
        assert dump.text(checked)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(COLUMNS), st.sampled_from(["short", "long", "empty", "float16", "object", "flat", "strided"]))
def test_whatever_shape_the_tables_have_the_validator_answers(where: tuple[str, str], how: str) -> None:
    def change(tables: dict[str, dict[str, np.ndarray]]) -> None:
        values = tables[where[0]][where[1]]
        tables[where[0]][where[1]] = {
            "short": lambda: values[:-1],
            "long": lambda: np.concatenate([values, values, values]),
            "empty": lambda: values[:0],
            "float16": lambda: values.astype(np.float16),
            "object": lambda: values.astype(object),
            "flat": lambda: values.reshape(-1),
            "strided": lambda: np.repeat(values, 2, axis=0)[::2],
        }[how]()

    with np.errstate(all="ignore"):
        broken = scene(change)
    checked, found = validate.validate(broken)
    if not found.failed:
        arrays = [column for name in ir.TABLES for column in getattr(checked.tables, name)]
        assert all(a.flags.c_contiguous for a in arrays)
