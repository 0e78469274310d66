"""Shapes and blocks in the tables: every kind's numbers, frames composed by hand, inherited materials, shared geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.mesh import polygon_mesh
from maquette.lang.diagnostics import Diagnostics, SceneError, Span

Kind = ir.GeometryKind
REST = "\ncamera([0, 1, 5])\nsun()\n"


def towards(point: str) -> str:
    """REST, with a camera that looks at a point."""
    return REST.replace("[0, 1, 5]", f"[0, 1, 5], look_at: {point}")


def placed(scene: ir.Scene, row: int = 0) -> np.ndarray:
    """The (3, 4) matrix of an instance."""
    return scene.tables.transforms.matrix[scene.tables.instances.transform[row]]


@pytest.mark.parametrize(
    ("text", "kind", "parameters"),
    [
        ("sphere(2)", Kind.SPHERE, [2]),
        ("box([1, 2, 3])", Kind.BOX, [0.5, 1, 1.5]),
        ("box(size: 60cm)", Kind.BOX, [0.3, 0.3, 0.3]),
        ("disk(2)", Kind.DISK, [2]),
        ("cylinder(0.5, 3, capped: false)", Kind.CYLINDER, [0.5, 1.5, 0]),
        ("cone(0.5, 3)", Kind.CONE, [0.5, 0, 1.5, 1]),
        ("cone(0.5, 3, top: 0.2, capped: false)", Kind.CONE, [0.5, 0.2, 1.5, 0]),
        ("torus(2, 0.5)", Kind.TORUS, [2, 0.5]),
        ("capsule(0.3, 1)", Kind.CAPSULE, [0.3, 0.5]),
        ("plane(y: 1)", Kind.PLANE, []),
        ("quadric([1, 1, -1, 0, 0, 0, 0, 0, 0, -1], within: [2, 4, 6])", Kind.QUADRIC, [1, 1, -1, 0, 0, 0, 0, 0, 0, -1, 1, 2, 3]),
    ],
)
def test_parameters(compiled, text: str, kind: ir.GeometryKind, parameters: list[float]) -> None:
    geometries = compiled(text + REST).tables.geometries
    assert geometries.kind.tolist() == [kind]
    assert geometries.parameters[0].tolist() == pytest.approx(parameters + [0] * (ir.PARAMETERS - len(parameters)))


def test_center_moves_a_shape_before_its_own_transform(compiled) -> None:
    scene = compiled("sphere(1, center: [1, 2, 3], scale: 2, rotate: [0, 90deg, 0], translate: [10, 0, 0])" + towards("[16, 4, -2]"))
    assert placed(scene) @ [0, 0, 0, 1] == pytest.approx([16, 4, -2])  # center (1, 2, 3) · 2 → (2, 4, 6), turned → (6, 4, −2)


def test_an_ellipsoid_is_a_sphere_under_scale(compiled) -> None:
    scene = compiled("ellipsoid([1, 2, 3], center: [0, 5, 0])" + REST)
    assert scene.tables.geometries.kind.tolist() == [Kind.SPHERE]
    assert placed(scene).tolist() == [[1, 0, 0, 0], [0, 2, 0, 5], [0, 0, 3, 0]]


def test_a_disk_faces_its_normal(compiled) -> None:
    assert placed(compiled("disk(1, center: [1, 2, 3], normal: [0, 0, 4])" + REST)) @ [0, 1, 0, 0] == pytest.approx([0, 0, 1])


@pytest.mark.parametrize(
    "text",
    ["plane(normal: [1, 2, 2], point: [1, 1, 1])", "plane(a: 1, b: 2, c: 2, d: -5)", "plane(a: -2, b: -4, c: -4, d: 10)"],
)
def test_every_form_of_a_plane_lies_where_it_says(compiled, text: str) -> None:
    m = placed(compiled(text + REST))
    normal, point = m[:, 1], m[:, 3]
    assert abs(normal @ [1, 2, 2]) == pytest.approx(3)
    assert point @ [1, 2, 2] == pytest.approx(5)


def test_blocks_compose_outside_in(compiled) -> None:
    scene = compiled("translate([1, 0, 0]) { rotate([0, 0, 90deg]) { scale(2) { box(1, translate: [3, 0, 0]) } } }" + REST)
    assert placed(scene) == pytest.approx(np.array([[0, -2, 0, 1], [2, 0, 0, 6], [0, 0, 2, 0]]))


def test_a_transform_block_scales_rotates_then_translates(compiled) -> None:
    scene = compiled("transform(translate: [5, 0, 0], rotate: [0, 0, 90deg], scale: [2, 1, 1]) { sphere(1) }" + REST)
    assert placed(scene) @ [1, 0, 0, 1] == pytest.approx([5, 2, 0])


def test_a_matrix_block(compiled) -> None:
    scene = compiled("transform(matrix: [[1, 0.5, 0, 20cm], [0, 1, 0, 0], [0, 0, 1, 0]]) { sphere(1) }" + REST)
    assert placed(scene).tolist() == [[1, 0.5, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0]]


def test_materials_are_inherited_from_the_nearest_block(compiled) -> None:
    scene = compiled(
        "let red = lambert(#ff0000)\n"
        "group(material: red) {\n"
        "sphere(1); group(material: mirror()) { sphere(2); sphere(3, material: glass()) }; translate([1,0,0]) { sphere(4) } }\n"
        "sphere(5)" + REST
    )
    models = scene.tables.materials.model[scene.tables.instances.material].tolist()
    M = ir.MaterialModel
    assert models == [M.LAMBERT, M.MIRROR, M.GLASS, M.LAMBERT, M.LAMBERT]
    assert scene.names.materials[scene.tables.instances.material[4]] == "default"
    assert len(scene.names.materials) == 4


def test_names_are_paths_of_blocks_parts_or_kinds(compiled) -> None:
    scene = compiled('let wheel() = group() { torus(1, 0.2) }\ngroup(name: "car") { sphere(1, name: "body"); box(1) }\nwheel()' + REST)
    assert scene.names.instances == ("car/body", "car/box", "wheel")


def test_copies_share_geometry(compiled) -> None:
    scene = compiled(
        "for (k in 0..9) { mesh(points: [[0,0,0],[1,0,0],[0,1,0]], faces: [[0,1,2]], translate: [k, 0, 0])\n"
        "sphere(1, translate: [k, 2, 0]) }" + REST
    )
    assert len(scene.tables.geometries.kind) == 2
    assert len(scene.tables.instances.geometry) == 20


@pytest.mark.parametrize(
    "text", ["revolve([[0, 0], [1, 0], [0, 1]])", 'text("once")', "heightfield([[0, 1], [1, 0]])", "curve([[0,0,0], [1,1,1]], 1)"]
)
def test_equal_shapes_are_made_once(compiled, monkeypatch, text) -> None:
    calls = []
    monkeypatch.setattr(polygon_mesh, "assemble", lambda *args, made=polygon_mesh.assemble, **more: calls.append(0) or made(*args, **more))
    one = text[:-1]
    scene = compiled(f"for (k in 0..9) {{ {one}, translate: [k, 0, 0], name: \"a\") }}\n{one}, material: mirror())" + REST)
    assert len(calls) == 1
    assert len(set(scene.tables.instances.geometry.tolist())) == 1
    assert len(scene.tables.instances.geometry) == 11


def test_a_triangle(compiled) -> None:
    scene = compiled("triangle([[0, 0, 0], [2, 0, 0], [0, 2, 0]], normals: [[0,0,1],[0,0,1],[0,0,1]])" + REST)
    t = scene.tables
    points = t.pools.positions[t.pools.triangles[0]] + t.geometries.origin[0]
    assert points.tolist() == [[0, 0, 0], [2, 0, 0], [0, 2, 0]]
    assert t.pools.values.tolist() == [0, 0, 1] * 3 + [0, 0, 1, 0, 0, 1]  # normals, then its own uv


def area(scene: ir.Scene) -> float:
    a, b, c = (scene.tables.pools.positions[scene.tables.pools.triangles[:, k]].astype(float) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_a_concave_polygon_with_a_hole(compiled) -> None:
    """An L of area 3 with a hole of area 1/4, both wound the same way."""
    scene = compiled(
        "polygon([[0,0,0],[2,0,0],[2,1,0],[1,1,0],[1,2,0],[0,2,0]], holes: [[[0.25,0.25,0],[0.75,0.25,0],[0.75,0.75,0],[0.25,0.75,0]]])"
        + REST
    )
    t = scene.tables
    assert area(scene) == pytest.approx(2.75)
    assert t.pools.loops.tolist() == [[0, 6], [6, 4]]
    assert (t.polygons.loop_count.tolist(), t.polygons.triangle_count.tolist()) == ([2], [len(t.pools.triangles)])
    a, b, c = (t.pools.positions[t.pools.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()  # wound as the outline


def test_a_polygon_has_coordinates_over_its_extent(compiled) -> None:
    scene = compiled("polygon([[0,0,0],[4,0,0],[4,0,-2],[0,0,-2]])" + REST)
    assert scene.tables.pools.values.reshape(-1, 2).tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_a_mesh_from_points_and_faces(compiled) -> None:
    scene = compiled(
        "mesh(points: [[0,0,0],[1,0,0],[1,1,0],[0,1,0]], faces: [[0,1,2,3]], uv: [[0,0],[1,0],[1,1],[0,1]],\n"
        "colors: [[1,0,0],[0,1,0],[0,0,1],[1,1,1]])" + REST
    )
    t = scene.tables
    assert len(t.pools.triangles) == 2
    assert t.polygons.triangle_count.tolist() == [2]
    assert min(t.geometries.uvs[0], t.geometries.colors[0]) >= 0


CUBE = """v 0 0 0\nv 2 0 0\nv 2 4 0\nv 0 4 0\nv 0 0 2\nv 2 0 2\nv 2 4 2\nv 0 4 2
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 1 5 8 4
"""


def test_height_scales_and_grounds_a_mesh(compiled, tmp_path) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    scene = compiled('mesh("cube.obj", height: 1m, translate: [0, 3, 0])' + REST)
    m = placed(scene)
    corners = np.array([[0, 0, 0, 1], [2, 4, 2, 1]]) @ m.T
    assert corners.tolist() == [[-0.25, 3, -0.25], [0.25, 4, 0.25]]


def test_a_mesh_file_is_read_once(compiled, tmp_path) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    scene = compiled('for (k in 1..100) { mesh("cube.obj", translate: [4 * k, 0, 0], material: mirror()) }' + REST)
    assert len(scene.tables.geometries.kind) == 1
    assert len(scene.tables.instances.geometry) == 100
    assert set(scene.tables.materials.model.tolist()) == {ir.MaterialModel.MIRROR}
    assert [name for name in scene.files if name.endswith("cube.obj")] == [str(tmp_path / "cube.obj")]


def test_what_is_wrong_in_a_mesh_file_says_which_mesh_it_is(tmp_path) -> None:
    (tmp_path / "cube.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2\n")
    (tmp_path / "a.scene").write_text('sphere(1)\nmesh("cube.obj")\n')
    found = Diagnostics()
    with pytest.raises(SceneError):
        load.load(tmp_path / "a.scene", diagnostics=found)
    told = found.items[0]
    assert told.message == "the OBJ file has no faces that can be drawn"
    assert told.trace == (("mesh", Span(str(tmp_path / "a.scene"), 2, 1, 2, 17)),)


def test_a_file_is_looked_for_beside_the_source_that_names_it(compiled, tmp_path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "cube.obj").write_text(CUBE)
    (tmp_path / "parts" / "block.scene").write_text('mesh("cube.obj", height: 1)\n')
    assert len(compiled('use "parts/block.scene"\nblock()' + REST).tables.instances.geometry) == 1


def test_deep_blocks_need_no_stack(compiled) -> None:
    """A part that wraps what it is given, a hundred times over."""
    text = "let up(n) = if n > 0 then translate([0, 1, 0]) { up(n - 1) } else sphere(1)\nup(100)"
    assert placed(compiled(text + towards("[0, 100, 0]")))[1, 3] == 100


CORNERS = "points: [[0,0,0],[1,0,0],[0,1,0]]"


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("plane(y: 0, d: 1)", "a plane is given one way: `y` does not go with `d`", "write y, or normal and point, or a, b, c and d"),
        ("plane(a: 0, b: 0)", "the plane's normal (a, b, c) is 0", "give at least one of a, b and c"),
        ("quadric([1, 2])", "a quadric has the ten coefficients A … J, got 2", ""),
        ("quadric([0,0,0,0,0,0,0,0,0,1])", "the quadric's coefficients A … I are all 0: there is no surface", ""),
        ("triangle([[0,0,0],[1,0,0]])", "a triangle has three points, got 2", ""),
        ("triangle([[0,0,0],[1,0,0],[3,0,0]])", "the triangle's corners lie on one line: it has no area", ""),
        ("polygon([[0,0,0],[1,0,0]])", "a polygon has three corners or more, got 2", ""),
        ("polygon([[0,0,0],[1,0,0],[2,0,0]])", "the polygon has no area", ""),
        (
            "polygon([[0,0,0],[1,0,0],[0,1,0]], uv: [[0,0]])",
            "the polygon has 3 corners and 1 texture coordinate: there is one for each corner",
            "",
        ),
        ("mesh()", "a mesh needs a file, or points and faces", 'write mesh("bunny.obj") or mesh(points: […], faces: […])'),
        ('mesh("a.obj", uv: [[0,0]])', "`uv` goes with `points`, not with a file: the file brings its own", ""),
        (f"mesh({CORNERS}, faces: [[0,1,3]])", "face 0 names vertex 3, and there are 3 (counted from 0)", ""),
        (f"mesh({CORNERS}, faces: [[0,1,2], [0,1]])", "face 1 has 2 vertices: a face has three or more", ""),
        (f"mesh({CORNERS}, faces: [[0,1,2]], uv: [[0,0]])", "the mesh has 3 points and 1 uv: there is one for each point", ""),
        (
            "mesh(points: [[0,0,0],[1,0,0],[0,0,1]], faces: [[0,1,2]], height: 1)",
            "the mesh is flat: it has no height that could be scaled",
            "use scale instead of height",
        ),
        ('mesh("nothing.obj")', "there is no mesh `nothing.obj`", "looked in {folder}"),
        ('mesh("../a.obj")', "`../a.obj` lies outside of the scene's folder", "use --allow {above} to let scenes read it"),
    ],
)
def test_messages(said, tmp_path, text: str, message: str, hint: str) -> None:
    hint = hint.format(folder=tmp_path, above=tmp_path.parent)
    assert said(text + REST) == f"a.scene:1:1: error: {message}\n   1 | {text}\n     | {'^' * len(text)} {hint}".rstrip()


def test_a_bent_polygon_is_warned_about(said) -> None:
    message = said("polygon([[0,0,0],[1,0,0],[1,1,0.5],[0,1,0]])" + REST)
    assert message.startswith("a.scene:1:1: warning: the polygon is not flat: its corners are up to 0.236 m off its plane\n")


def test_a_message_in_a_part_shows_the_calls(said) -> None:
    assert said("let bad(n) = quadric([n])\nbad(1)" + REST) == (
        "a.scene:1:14: error: a quadric has the ten coefficients A … J, got 1\n"
        "   1 | let bad(n) = quadric([n])\n"
        "     |              ^^^^^^^^^^^^\n"
        "  in bad, called at a.scene:2:1"
    )


def test_a_flattening_matrix_is_warned_about(said) -> None:
    text = "transform(matrix: [[1,0,0,0],[0,1,0,0],[0,0,0,0]]) { sphere(1); point([0,1,0]) }\nbox(1)"
    assert said(text + REST) == (
        "a.scene:1:54: warning: this is flattened to nothing by its transform (no inverse): it is not drawn\n"
        "   1 | transform(matrix: [[1,0,0,0],[0,1,0,0],[0,0,0,0]]) { sphere(1); point([0,1,0]) }\n"
        "     |                                                      ^^^^^^^^^ a scale must not be 0 along any axis\n"
        "a.scene:1:65: warning: the block around this light flattens it to nothing: it is left out\n"
        "   1 | transform(matrix: [[1,0,0,0],[0,1,0,0],[0,0,0,0]]) { sphere(1); point([0,1,0]) }\n"
        "     |                                                                 ^^^^^^^^^^^^^^ a scale must not be 0"
    )


def test_numbers_too_big_to_reckon_with(said) -> None:
    text = "sphere(1e20)"
    assert said(text + REST) == (
        "a.scene:1:1: error: `radius` holds 1e+20: that is too big to be drawn\n   1 | sphere(1e20)\n     | ^^^^^^^^^^^^ at most 1e+18"
    )
    message = said("scale(1e15) { scale(1e15) { scale(1e15) { sphere(1) } } }" + REST)
    assert message.splitlines()[0] == (
        "a.scene:1:29: error: the blocks around this make it bigger, or move it farther, than can be drawn"
    )


def test_radians_and_metres_are_the_units_of_the_tables(compiled) -> None:
    scene = compiled("unit mm\nsphere(20, center: [1000, 0, 0], rotate: [0, 180deg, 0])" + towards("[-1000, 0, 0]"))
    assert scene.tables.geometries.parameters[0, 0] == pytest.approx(0.02)
    assert placed(scene)[:, 3] == pytest.approx([-1, 0, 0], abs=1e-15)
    assert math.isclose(scene.tables.cameras.extent[0], math.tan(math.radians(20)))
