"""The scene builder: rows and what they share, precision far from the origin, and rows that are not accepted."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene import builder as scene_builder
from maquette.compiler.scene import transforms
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
    lambert,
)
from maquette.lang.diagnostics import Span

TRIANGLE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
ONE = np.array([[0, 1, 2]])
SPAN = Span("a.scene", 3, 5, 3, 11)


def triangle(offset: float = 0.0, **more: object) -> MeshData:
    return MeshData(TRIANGLE + offset, ONE, **more)  # type: ignore[arg-type]


def test_an_empty_scene_has_the_identity_and_nothing_else() -> None:
    tables = scene_builder.SceneBuilder().finish("empty").tables
    assert np.array_equal(tables.transforms.matrix, [np.eye(3, 4)])
    assert {len(column) for name in ir.TABLES if name != "transforms" for column in getattr(tables, name)} == {0}


def test_columns_are_typed_contiguous_and_read_only() -> None:
    builder = scene_builder.SceneBuilder()
    builder.instance(InstanceData(builder.mesh(triangle())))
    tables = builder.finish().tables
    for name in ir.TABLES:
        for column, values in getattr(tables, name)._asdict().items():
            dtype, shape = ir.column_type(name, column)
            assert (values.dtype, values.shape[1:], values.flags.c_contiguous, values.flags.writeable) == (dtype, shape, True, False)


def test_a_mesh_is_a_range_about_an_origin() -> None:
    builder = scene_builder.SceneBuilder()
    assert [builder.mesh(triangle()), builder.mesh(triangle(offset=1e7))] == [0, 1]
    tables = builder.finish().tables
    assert tables.geometries.first_vertex.tolist() == [0, 3]
    assert tables.geometries.first_triangle.tolist() == [0, 1]
    assert tables.pools.triangles.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert tables.geometries.origin[1].tolist() == [1e7 + 0.5, 1e7 + 0.5, 1e7]
    assert np.array_equal(tables.pools.positions[3:] + tables.geometries.origin[1], TRIANGLE + 1e7)  # nothing lost so far away
    assert tables.geometries.bounds[1].tolist() == [[1e7, 1e7, 1e7], [1e7 + 1, 1e7 + 1, 1e7]]


@pytest.mark.long
def test_ten_thousand_copies_of_a_mesh_cost_one() -> None:
    side = 224  # 2 · 223² = 99 458 triangles
    grid = np.arange(side * side).reshape(side, side)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    points = np.stack([*np.meshgrid(np.arange(side), np.arange(side)), np.zeros((side, side))], -1).reshape(-1, 3)
    builder = scene_builder.SceneBuilder()
    for k in range(10_000):
        mesh = builder.shared("grid", lambda: builder.mesh(MeshData(points, triangles)))
        builder.instance(InstanceData(mesh, builder.transform(transforms.translation((0, 0, k)))))
    tables = builder.finish().tables
    assert len(tables.geometries.kind) == 1
    assert len(tables.pools.triangles) == 99_458
    assert len(tables.instances.geometry) == len(tables.transforms.matrix) == 10_000


def test_equal_rows_are_shared() -> None:
    builder = scene_builder.SceneBuilder()
    sphere, texture = ir.GeometryKind.SPHERE, TextureData(ir.TextureKind.CHECKER)
    assert builder.geometry(sphere, (1,)) == builder.geometry(sphere, (1.0,)) != builder.geometry(sphere, (2.0,))
    assert builder.transform(np.eye(4)) == builder.transform(np.diag([1.0, 1.0, 1.0, 1.0])) == 0
    assert builder.texture(texture) == builder.texture(TextureData(ir.TextureKind.CHECKER))
    assert builder.material(lambert((1, 1, 1))) == builder.material(lambert((1, 1, 1)))
    assert builder.material(lambert((1, 1, 1))) != builder.material(lambert((1, 1, 1), name="white"))
    assert builder.mesh(triangle()) == builder.mesh(triangle()) != builder.mesh(triangle(1.0))
    assert builder.mesh(triangle(uvs=MeshAttribute(np.zeros((3, 2))))) != builder.mesh(triangle(uvs=MeshAttribute(np.ones((3, 2)))))


def test_minus_zero_is_zero_in_a_transform() -> None:
    builder = scene_builder.SceneBuilder()
    assert builder.transform(transforms.translation((-0.0, 0.0, 0.0))) == 0


def test_a_flat_transform_is_said_and_left_out() -> None:
    builder = scene_builder.SceneBuilder()
    row = builder.transform(transforms.scaling((1, 1, 0)), SPAN)
    assert row == builder.instance(InstanceData(builder.mesh(triangle()), row)) == scene_builder.NONE
    assert builder.light(LightData(ir.LightKind.DOME, (1, 1, 1), transform=row)) == scene_builder.NONE
    assert builder.camera(CameraData(row, 1.0)) == scene_builder.NONE
    assert [(d.severity, d.message, d.span) for d in builder.diagnostics.items] == [
        ("warning", "this is flattened to nothing by its transform (no inverse): it is not drawn", SPAN)
    ]
    assert builder.count("instances") == 0


def test_a_mirrored_transform_flips() -> None:
    builder = scene_builder.SceneBuilder()
    builder.transform(transforms.scaling((-1, 1, 1)))
    assert builder.finish().tables.transforms.flips.tolist() == [False, True]


def test_attributes_are_ranges_of_values() -> None:
    builder = scene_builder.SceneBuilder()
    normals = MeshAttribute(np.tile([0.0, 0.0, 1.0], (3, 1)), ir.Interpolation.CORNER)
    uvs = MeshAttribute(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    colors = MeshAttribute(np.array([[0.1, 0.2, 0.3]]), ir.Interpolation.FACE)
    row = builder.mesh(triangle(normals=normals, uvs=uvs, colors=colors))
    scene = builder.finish()
    g, a = scene.tables.geometries, scene.tables.attributes
    assert (g.normals[row], g.uvs[row], g.colors[row]) == (0, 1, 2)
    assert a.first.tolist() == [0, 9, 15]
    assert (a.width.tolist(), a.count.tolist()) == ([3, 2, 3], [3, 3, 1])
    assert a.interpolation.tolist() == [ir.Interpolation.CORNER, ir.Interpolation.VERTEX, ir.Interpolation.FACE]
    assert scene.names.attributes == ("normals", "uvs", "colors")
    assert scene.tables.pools.values[15:].tolist() == pytest.approx([0.1, 0.2, 0.3])


def test_an_attribute_of_a_wrong_length_is_left_out() -> None:
    builder = scene_builder.SceneBuilder()
    row = builder.mesh(triangle(uvs=MeshAttribute(np.zeros((4, 2)))), SPAN)
    assert builder.finish().tables.geometries.uvs[row] == -1
    assert [d.message for d in builder.diagnostics.items] == ["the mesh has 4 uvs where 3 belong, one a vertex: they are left out"]


def test_outlines_follow_their_mesh() -> None:
    builder = scene_builder.SceneBuilder()
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    outlines = Outlines(np.arange(4), np.array([[0, 4]]), np.array([[0, 1, 0, 2]]))
    for offset in (0.0, 5.0):
        builder.mesh(MeshData(square + offset, np.array([[0, 1, 2], [0, 2, 3]]), outlines=outlines))
    t = builder.finish().tables
    assert t.polygons.first_loop.tolist() == [0, 1]
    assert t.polygons.first_triangle.tolist() == [0, 2]
    assert t.pools.loops.tolist() == [[0, 4], [4, 4]]
    assert t.pools.corners.tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    assert (t.geometries.first_polygon.tolist(), t.geometries.polygon_count.tolist()) == ([0, 1], [1, 1])


def test_a_mesh_without_triangles_is_said_and_left_out() -> None:
    builder = scene_builder.SceneBuilder()
    assert builder.mesh(MeshData(TRIANGLE, np.zeros((0, 3))), SPAN, "ghost") == scene_builder.NONE
    assert [d.message for d in builder.diagnostics.items] == ["the mesh `ghost` has no triangles: nothing is drawn"]


def test_things_without_a_material_get_the_default() -> None:
    builder = scene_builder.SceneBuilder()
    builder.instance(InstanceData(builder.mesh(triangle())))
    scene = builder.finish()
    assert scene.names.materials == ("default",)
    assert scene.tables.instances.material.tolist() == [0]
    assert scene.tables.materials.values[0, ir.Slot.DIFFUSE].tolist() == [0.8, 0.8, 0.8]


def test_a_material_is_its_slots() -> None:
    builder = scene_builder.SceneBuilder()
    inputs = {ir.Slot.DIFFUSE: Input(texture=7), ir.Slot.SHININESS: Input.number(20.0)}
    builder.material(MaterialData(ir.MaterialModel.PHONG, inputs, ir.Shading.FLAT, True))
    m = builder.finish().tables.materials
    assert (m.model[0], m.shading[0], m.normalized[0]) == (ir.MaterialModel.PHONG, ir.Shading.FLAT, True)
    assert m.values[0, ir.Slot.DIFFUSE].tolist() == [1, 1, 1]
    assert m.textures[0].tolist() == [-1, 7] + [-1] * (ir.SLOTS - 2)
    assert m.values[0, ir.Slot.SHININESS].tolist() == [20, 0, 0]
    assert m.values[0, ir.Slot.IOR, 0] == 1


def test_images_are_ranges_of_texels() -> None:
    builder = scene_builder.SceneBuilder()
    assert builder.image(np.zeros((2, 3, 4)), "a") == 0
    assert builder.image(np.ones((1, 1, 4)), "b") == 1
    images = builder.finish().tables.images
    assert (images.first.tolist(), images.width.tolist(), images.height.tolist()) == ([0, 6], [3, 1], [2, 1])
    assert images.texels.shape == (7, 4)


def test_a_light_knows_its_shape() -> None:
    builder = scene_builder.SceneBuilder()
    builder.instance(InstanceData(builder.mesh(triangle())))
    lamp = builder.light(LightData(ir.LightKind.SPHERE, (1, 1, 1), size=(1, 0)))
    sun = builder.light(LightData(ir.LightKind.SUN, (1, 1, 1)))
    builder.instance(InstanceData(builder.geometry(ir.GeometryKind.SPHERE, (1,)), light=lamp))
    lights = builder.finish().tables.lights
    assert (lights.instance[lamp], lights.instance[sun]) == (1, -1)


def test_rows_keep_where_they_come_from() -> None:
    builder = scene_builder.SceneBuilder()
    builder.instance(InstanceData(builder.mesh(triangle(), SPAN)), SPAN)
    builder.instance(InstanceData(builder.mesh(triangle(1.0))))
    scene = builder.finish()
    assert scene.spans.get("instances", 0) == scene.spans.get("geometries", 0) == SPAN
    assert scene.spans.get("instances", 1) is scene.spans.get("instances", 2) is scene.spans.get("nonsense", 0) is None


KINDS = ir.GeometryKind


@pytest.mark.parametrize(
    ("kind", "parameters", "half"),
    [
        (KINDS.SPHERE, (2,), (2, 2, 2)),
        (KINDS.BOX, (1, 2, 3), (1, 2, 3)),
        (KINDS.PLANE, (), (np.inf, 0, np.inf)),
        (KINDS.RECTANGLE, (1, 2), (1, 0, 2)),
        (KINDS.DISK, (2,), (2, 0, 2)),
        (KINDS.CYLINDER, (2, 3, 1), (2, 3, 2)),
        (KINDS.CONE, (1, 2, 3, 1), (2, 3, 2)),
        (KINDS.TORUS, (2, 0.5), (2.5, 0.5, 2.5)),
        (KINDS.CAPSULE, (1, 2), (1, 3, 1)),
        (KINDS.QUADRIC, (1, -1, 1, 0, 0, 0, 0, 0, 0, -1, 2, 3, 4), (2, 3, 4)),
    ],
)
def test_bounds_of_shapes(kind: ir.GeometryKind, parameters: tuple[float, ...], half: tuple[float, ...]) -> None:
    builder = scene_builder.SceneBuilder()
    builder.geometry(kind, parameters)
    assert builder.finish().tables.geometries.bounds[0].tolist() == [[-h for h in half], list(half)]


def test_bounds_of_a_skewed_ellipsoid_are_tight() -> None:
    """2x² + y² + z² + 2xy − 4z = 1: Q⁻¹ has the diagonal (1, 2, 1), c = (0, 0, 2), k = 5."""
    builder = scene_builder.SceneBuilder()
    builder.geometry(KINDS.QUADRIC, (2, 1, 1, 2, 0, 0, 0, 0, -4, -1, np.inf, np.inf, np.inf))
    half = np.sqrt([5, 10, 5])
    assert builder.finish().tables.geometries.bounds[0] == pytest.approx(np.array([-half, half]) + [0, 0, 2], rel=1e-8)


def test_world_bounds_leave_out_what_is_endless_or_beyond_a_camera() -> None:
    builder = scene_builder.SceneBuilder()
    builder.instance(InstanceData(builder.geometry(KINDS.PLANE)))
    assert builder.world_bounds() is None
    builder.instance(InstanceData(builder.geometry(KINDS.SPHERE, (1e30,))))
    assert builder.world_bounds() is None
    builder.instance(InstanceData(builder.geometry(KINDS.BOX, (1, 2, 3)), builder.transform(transforms.translation((10, 0, 0)))))
    bounds = builder.world_bounds()
    assert bounds is not None
    assert bounds.tolist() == [[9, -2, -3], [11, 2, 3]]


def test_transforms_together_are_the_rows_of_each() -> None:
    rng = np.random.default_rng(3)
    matrices = rng.normal(size=(40, 3, 4)).round(1)
    matrices[5] = matrices[9] = np.eye(3, 4)
    matrices[7, :, 0] = 0.0
    matrices[8] = np.inf
    matrices[20:30] = matrices[10:20]
    matrices[31, 0, 3] = -0.0
    one, together = scene_builder.SceneBuilder(), scene_builder.SceneBuilder()
    rows = [one.transform(matrix, SPAN) for matrix in matrices]
    assert together.transforms(matrices[:25], [SPAN] * 25) + together.transforms(matrices[25:], [SPAN] * 15) == rows
    assert rows[7] == rows[8] == -1
    assert rows[5] == rows[9] == 0
    assert together.diagnostics.items == one.diagnostics.items
    for column in ("matrix", "inverse", "flips"):
        a, b = (getattr(builder.finish("").tables.transforms, column) for builder in (one, together))
        assert a.tobytes() == b.tobytes()


def test_instances_together_leave_out_those_without_a_geometry_or_transform() -> None:
    builder = scene_builder.SceneBuilder()
    ball = builder.geometry(ir.GeometryKind.SPHERE, (1.0,))
    builder.instances([ball, -1, ball, ball], [0, 0, -1, 0], [-1, -1, -1, -1], ["a", "b", "c", "d"], [SPAN, None, None, None])
    scene = builder.finish("")
    assert scene.names.instances == ("a", "d")
    assert scene.spans.get("instances", 0) == SPAN
    assert scene.spans.get("instances", 1) is None
