"""Faces of single-sided meshes that a camera sees from behind are taken away, and what is left casts the right shadows."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.ir.single_sided import SINGLE_SIDED
from maquette.compiler.plan import single_sided
from maquette.compiler.scene import transforms
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import CameraData, Input, InstanceData, MaterialData, MeshAttribute, MeshData

CAMERA, SHADOW, REFLECTION = (int(bit) for bit in ir.Visibility)
QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])  # outward
BOX = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)


def seen(triangles, eye=(0.0, 0.0, 9.0), points=CORNERS, matrix=None, opacity=1.0, projection=ir.Projection.PERSPECTIVE, **attributes):
    """The scene that a camera at `eye` sees, which looks at the origin, of one single-sided mesh."""
    builder = SceneBuilder()
    row = builder.mesh(MeshData(points, np.array(triangles), **attributes))
    material = builder.material(MaterialData(inputs={ir.Slot.OPACITY: Input.number(opacity)}))
    placed = transforms.identity()
    place = builder.transform(placed if matrix is None else matrix)
    builder.instance(InstanceData(row, place, material, name="thing"))
    builder.single_sided.add(row)
    at = transforms.looking(eye, (0.0, 0.0, 0.0), (0.0, 1.0, 0.1))
    assert at is not None
    builder.camera(CameraData(builder.transform(at), 0.5, projection))
    scene = builder.finish()
    assert scene.tables.instances.visible.tolist() == [7 | SINGLE_SIDED]
    found = single_sided.seen_from(scene, 0)
    assert found.left == -1
    return found.scene.tables


def drawn(tables, bit):
    """The triangles (t, 3, 3) of the instances with a bit of visibility, in the frame of the mesh."""
    rows = np.flatnonzero(tables.instances.visible & bit)
    return np.concatenate([single_sided_corners(tables, i) for i in rows]) if len(rows) else np.zeros((0, 3, 3))


def single_sided_corners(tables, i):
    g = tables.instances.geometry[i]
    first, count = tables.geometries.first_triangle[g], tables.geometries.triangle_count[g]
    return tables.pools.positions[tables.pools.triangles[first : first + count]] + tables.geometries.origin[g]


def test_a_closed_box_seen_from_outside_stays_whole():
    tables = seen(BOX)
    assert tables.instances.visible.tolist() == [7]
    assert len(drawn(tables, CAMERA)) == 12


@pytest.mark.parametrize("projection", [ir.Projection.PERSPECTIVE, ir.Projection.ORTHOGRAPHIC])
def test_the_near_faces_of_a_box_inside_out_are_not_there(projection):
    tables = seen(BOX[:, ::-1], (0.1, 0.2, 9.0), projection=projection)
    near = (1.0, 1.0, 1.0) if projection == ir.Projection.ORTHOGRAPHIC else (9.0, 9.0, 1.0)  # from the front alone its side is seen
    for bit in (CAMERA, SHADOW, REFLECTION):
        found = drawn(tables, bit)
        assert not (found[..., 2] == 1).all(axis=1).any(), near
        assert (found[..., 2] == -1).all(axis=1).any()


def test_a_room_seen_from_inside_stays_whole():
    assert seen(BOX[:, ::-1], (0.1, 0.2, 0.9)).instances.visible.tolist() == [7]


def test_a_closed_box_is_not_seen_from_inside():
    tables = seen(BOX, (0.1, 0.2, 0.3))
    assert len(drawn(tables, CAMERA)) == 0
    assert len(drawn(tables, SHADOW)) == len(drawn(tables, REFLECTION)) == 12


@pytest.mark.parametrize("mirror", [False, True])
def test_a_square_is_seen_from_its_front_alone(mirror):
    """Under a mirror too: the winding counts in the frame of the mesh, as the sign of the determinant in glTF (3.7.4)."""
    square = [(1, 5, 7), (1, 7, 3)]  # z = 1, towards +z
    matrix = np.diag([-1.0, 1.0, 1.0, 1.0]) if mirror else None
    front, back = seen(square, matrix=matrix), seen(square, (0.0, 0.0, -9.0), matrix=matrix)
    assert front.instances.visible.tolist() == [7]
    assert (len(drawn(back, CAMERA)), len(drawn(back, SHADOW)), len(drawn(back, REFLECTION))) == (0, 2, 2)


def test_an_open_box_keeps_the_shadow_of_its_far_side():
    tables = seen([t for t in BOX.tolist() if set(t) - {0, 2, 4, 6}])  # without the far face
    assert len(drawn(tables, CAMERA)) == 2
    assert len(drawn(tables, SHADOW)) == len(drawn(tables, REFLECTION)) == 10
    assert tables.instances.material.tolist() == [0, 0]


def test_a_closed_box_that_is_see_through_shows_no_far_side():
    tables = seen(BOX, opacity=0.5)
    assert (len(drawn(tables, CAMERA)), len(drawn(tables, REFLECTION)), len(drawn(tables, SHADOW))) == (2, 2, 12)


def test_a_part_inside_out_of_a_closed_mesh_is_found():
    points = np.concatenate([4 * CORNERS, CORNERS + [9, 0, 0]])
    tables = seen(np.concatenate([BOX, BOX[:, ::-1] + 8]), points=points)
    assert (drawn(tables, CAMERA)[..., 0] > 7).any(axis=1).sum() == 10 - 2  # its near side, and the side that turns away from the camera
    assert not single_sided.is_closed_outward(points, np.concatenate([BOX, BOX[:, ::-1] + 8]))
    assert single_sided.is_closed_outward(points, np.concatenate([BOX, BOX + 8]))


def test_points_at_one_place_close_a_mesh():
    apart = CORNERS[BOX].reshape(-1, 3)
    rows = np.arange(36, dtype=np.int32).reshape(-1, 3)
    assert single_sided.is_closed_outward(apart, rows)
    assert not single_sided.is_closed_outward(apart, rows[:-1])
    assert not single_sided.is_closed_outward(np.zeros((0, 3)), np.zeros((0, 3), int))


@pytest.mark.parametrize("how", ["FACE", "CORNER", "VERTEX", "CONSTANT"])
def test_values_stay_with_their_faces(how):
    faces = BOX[:, ::-1]
    count = {"FACE": 12, "CORNER": 36, "VERTEX": 8, "CONSTANT": 1}[how]
    values = np.stack([np.arange(count)] * 3, axis=1).astype(np.float32)
    tables = seen(faces, colors=MeshAttribute(values, ir.Interpolation[how]))
    g = tables.instances.geometry[0]
    row = tables.geometries.colors[g]
    first, n = tables.attributes.first[row], tables.attributes.count[row]
    found = tables.pools.values[first : first + 3 * n].reshape(-1, 3)[:, 0]
    kept = tables.pools.triangles[tables.geometries.first_triangle[g] :][: tables.geometries.triangle_count[g]]
    rows = [int(np.flatnonzero((faces == t).all(axis=1))[0]) for t in kept]
    assert 0 < len(rows) < 12
    expected = {"FACE": rows, "CORNER": [3 * r + k for r in rows for k in range(3)], "VERTEX": list(range(8)), "CONSTANT": [0]}[how]
    assert found.tolist() == expected
