"""Computed normals: hard where a mesh has creases, smooth where it is round, by smoothing groups where there are some."""

import numpy as np
import pytest
from maquette.compiler.mesh import polygon_mesh, vertex_normals

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]]).astype(np.int32)


def ball(rings=12, around=24):
    """A sphere of quads about z, without its poles."""
    up = np.linspace(0.2, np.pi - 0.2, rings)
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    points = np.stack([np.outer(np.sin(up), np.cos(turn)), np.outer(np.sin(up), np.sin(turn)), np.outer(np.cos(up), np.ones(around))], -1)
    row, column = np.arange(rings - 1)[:, None] * around, np.arange(around)
    after = np.roll(column, -1)
    quads = np.stack([row + column, row + around + column, row + around + after, row + after], axis=-1).reshape(-1, 4)
    return points.reshape(-1, 3), quads


def face_normals(points, triangles):
    a, b, c = (points[triangles[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def test_a_cube_has_edges():
    made = vertex_normals.corner_normals(CORNERS, CUBE)
    assert made == pytest.approx(np.repeat(face_normals(CORNERS, CUBE)[:, None], 3, axis=1), abs=1e-6)


def test_a_ball_is_smooth():
    points, quads = ball()
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    made = vertex_normals.corner_normals(points, triangles)
    inner = (np.abs(points[triangles][..., 2]) < 0.9)[..., None]
    assert np.abs(np.where(inner, made - points[triangles], 0)).max() < 0.06
    assert polygon_mesh.by_vertex(made.reshape(-1, 3), triangles, len(points)).interpolation.name == "VERTEX"


def test_a_ridge_is_smooth_below_the_crease_angle_and_sharp_above():
    for bend, smooth in ((40.0, True), (50.0, False)):
        t = np.radians(bend)
        points = np.array([[0, 0, 0], [0, 0, -1], [-1, 0, 0], [np.cos(t), -np.sin(t), 0]])
        triangles = np.array([[0, 1, 2], [0, 3, 1]], np.int32)
        made = vertex_normals.corner_normals(points, triangles)
        assert np.allclose(made[0, 0], made[1, 0], atol=1e-6) == smooth


def test_every_edge_is_smooth_where_asked():
    made = vertex_normals.vertex_normals(CORNERS, CUBE)
    assert made == pytest.approx(CORNERS / np.sqrt(3), abs=0.2)
    assert np.linalg.norm(made, axis=1) == pytest.approx(1, abs=1e-6)


def test_smoothing_groups_decide_whatever_the_angle():
    groups = np.array([1, 1, 0, 2, 2, 2] * 2)
    made = vertex_normals.corner_normals(CORNERS, CUBE, groups=groups)
    flat = face_normals(CORNERS, CUBE)
    assert made[2] == pytest.approx(np.repeat(flat[2:3], 3, axis=0), abs=1e-6)  # group 0 is flat
    assert made[0] == pytest.approx(np.repeat(flat[0:1], 3, axis=0), abs=1e-6)  # its group's other face is across
    shared = made[3][CUBE[3] == 7][0]  # the corner where the three faces of group 2 do not all meet: of +y and +z
    assert shared[0] == pytest.approx(0, abs=1e-6)
    assert shared[1] > 0.3
    assert shared[2] > 0.3


def test_vertices_of_no_face_have_some_normal():
    made = vertex_normals.vertex_normals(np.concatenate([CORNERS, [[9.0, 9, 9]]]), CUBE)
    assert made[8].tolist() == [0, 0, 1]


def test_given_normals_are_kept_and_broken_ones_computed():
    mesh = polygon_mesh.PolyMesh(
        CORNERS, np.full(6, 4), QUADS.reshape(-1),
        polygon_mesh.MeshAttribute(np.where(np.arange(24)[:, None] < 4, 0.0, [0.0, 0.0, 2.0]), polygon_mesh.ir.Interpolation.CORNER),
    )  # fmt: skip
    made, dropped = polygon_mesh.assemble(mesh)
    assert dropped == 0
    assert made.normals is not None
    assert made.normals.interpolation.name == "CORNER"
    assert made.normals.values[:6] == pytest.approx(np.repeat([[-1.0, 0, 0]], 6, axis=0), abs=1e-6)  # face 0 had none
    assert made.normals.values[6:] == pytest.approx(np.repeat([[0.0, 0, 1]], 30, axis=0))
