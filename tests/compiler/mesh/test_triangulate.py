"""Polygons cut into triangles: known cuts, and that any simple polygon is covered once and wound as it was."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler.mesh import triangulate

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def area(points, triangles):
    """The sum of the triangles' area vectors and the sum of their lengths."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    vectors = np.cross(b - a, c - a) / 2
    return vectors.sum(axis=0), np.linalg.norm(vectors, axis=1).sum()


def test_triangle_stays():
    assert triangulate.triangulate(SQUARE, [[2, 0, 1]]).tolist() == [[2, 0, 1]]


def test_square_is_a_fan_from_its_first_corner():
    assert triangulate.triangulate(SQUARE, [[0, 1, 2, 3]]).tolist() == [[0, 1, 2], [0, 2, 3]]
    assert triangulate.triangulate(SQUARE, [[3, 2, 1, 0]]).tolist() == [[3, 2, 1], [3, 1, 0]]


@pytest.mark.parametrize("turn", range(4))
def test_concave_quad_is_cut_at_its_reflex_corner(turn):
    points = np.array([[0, 0, 0], [4, 0, 0], [1, 1, 0], [0, 4, 0]], float)  # corner 2 is pushed in
    loop = np.roll([0, 1, 2, 3], turn).tolist()
    triangles = triangulate.triangulate(points, [loop])
    vector, total = area(points, triangles)
    assert vector == pytest.approx([0, 0, 4])
    assert total == pytest.approx(4)
    assert all(2 in t for t in triangles.tolist())


def test_hole_is_left_open():
    hole = SQUARE * 0.5 + [0.25, 0.25, 0]
    points = np.concatenate([SQUARE, hole])
    for inner in ([4, 5, 6, 7], [7, 6, 5, 4]):  # however the hole winds
        triangles = triangulate.triangulate(points, [[0, 1, 2, 3], inner])
        vector, total = area(points, triangles)
        assert vector == pytest.approx([0, 0, 0.75])
        assert total == pytest.approx(0.75)
        assert len(triangles) == 8


def test_collinear_and_repeated_corners_do_no_harm():
    points = np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    vector, total = area(points, triangulate.triangulate(points, [[0, 1, 2, 3, 4, 5]]))
    assert vector == pytest.approx([0, 0, 1])
    assert total == pytest.approx(1)


def test_faces_without_area_are_dropped_and_counted():
    points = np.concatenate([SQUARE, [[2.0, 0, 0], [np.nan, 0, 0]]])
    counts = np.array([3, 2, 3, 4, 3, 0])
    indices = np.array([0, 1, 2, 0, 1, 0, 1, 4, 0, 1, 4, 1, 0, 1, 5])  # good; two corners; in a line; in a line; not a number; none
    cut = triangulate.faces(points, indices, counts)
    assert cut.corners.tolist() == [[0, 1, 2]]
    assert cut.faces.tolist() == [0]
    assert cut.dropped == 5


def test_figure_of_eight_is_drawn_though_its_signed_area_is_nothing():
    cut = triangulate.faces(SQUARE, np.array([0, 2, 1, 3]), np.array([4]))
    assert cut.dropped == 0
    assert len(cut.corners) == 2


def test_corners_and_faces_of_a_mixed_mesh_are_in_order():
    points = np.concatenate([SQUARE, SQUARE + [2, 0, 0], [[0.5, 2, 0]]])
    indices = np.array([0, 1, 2, 3, 3, 2, 8, 4, 5, 6, 7])
    cut = triangulate.faces(points, indices, np.array([4, 3, 4]))
    assert cut.faces.tolist() == [0, 0, 1, 2, 2]
    assert cut.corners.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9], [7, 9, 10]]


def test_large_convex_face_is_a_fan():
    turn = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    points = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    triangles = triangulate.triangulate(points, [list(range(100))])
    assert len(triangles) == 98
    assert (triangles[:, 0] == 0).all()


def star(radii):
    """A simple polygon round the origin, with a corner in each direction."""
    turn = np.linspace(0, 2 * math.pi, len(radii), endpoint=False)
    return np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.array(radii)[:, None]


@st.composite
def placed_polygons(draw):
    """A star-shaped polygon in the plane, and the turned and moved one in space."""
    flat = star(draw(st.lists(st.floats(0.1, 10), min_size=3, max_size=24)))
    axis = np.array([draw(st.floats(-1, 1)) for _ in range(3)]) + [0.01, 0.02, 0.03]
    normal = axis / np.linalg.norm(axis)
    u = np.cross(np.eye(3)[np.argmin(abs(normal))], normal)
    u /= np.linalg.norm(u)
    return flat, flat @ np.stack([u, np.cross(normal, u)]) + draw(st.floats(-100, 100)), normal


@pytest.mark.long
@given(placed_polygons(), st.integers(0, 23))
def test_a_simple_polygon_is_covered_once(polygon, turn):
    """The signed areas add up to the polygon's, and so do the unsigned ones: nothing is covered twice or the wrong way round."""
    flat, points, normal = polygon
    x, y = flat.T
    expected = 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    loop = np.roll(np.arange(len(points)), turn % len(points)).tolist()
    vector, total = area(points, triangulate.triangulate(points, [loop]))
    assert vector @ normal == pytest.approx(expected, rel=1e-6)
    assert total == pytest.approx(expected, rel=1e-6)


@pytest.mark.long
@given(st.lists(st.floats(2, 10), min_size=3, max_size=12), st.lists(st.floats(0.1, 0.9), min_size=3, max_size=12))
def test_a_polygon_with_a_hole_is_covered_once(outer, inner):
    outline, hole = star(outer), star(inner)
    if min(np.hypot(*outline.T)) * math.cos(math.pi / len(outline)) <= 0.95:  # the outline's edges must pass outside of the hole
        return
    points = np.zeros((len(outline) + len(hole), 3))
    points[:, :2] = np.concatenate([outline, hole])
    rows = np.arange(len(points)).tolist()

    def shoelace(p):
        x, y = p.T
        return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))

    vector, total = area(points, triangulate.triangulate(points, [rows[: len(outline)], rows[len(outline) :]]))
    assert vector[2] == pytest.approx(shoelace(outline) - shoelace(hole), rel=1e-6)
    assert total == pytest.approx(vector[2], rel=1e-6)
