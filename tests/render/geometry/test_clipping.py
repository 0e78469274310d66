"""Clipping: the four cases of an edge, homogeneous planes before division, crossings shared by neighbours."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.render.geometry import clipping

RIGHT = np.array([[-1.0, 0.0, 1.0]])  # keeps x <= 1 of rows (x, y, 1)


def rows(*points: tuple[float, float]) -> np.ndarray:
    return np.array([(x, y, 1.0) for x, y in points])


def test_the_course_example():
    """1 and 4 inside, 2 and 3 outside one plane: the result is a, b, 4, 1, in that order."""
    v1, v2, v3, v4 = (0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)
    a, b = (1.0, 0.0), (1.0, 1.0)
    assert np.array_equal(clipping.clip_polygon(rows(v1, v2, v3, v4), RIGHT), rows(a, b, v4, v1))


@pytest.mark.parametrize(
    ("start", "end", "added"),
    [
        ((0.0, 0.0), (0.5, 0.0), [(0.5, 0.0)]),  # inside to inside: the end
        ((0.0, 0.0), (2.0, 0.0), [(1.0, 0.0)]),  # inside to outside: the crossing
        ((2.0, 0.0), (3.0, 0.0), []),  # outside to outside: nothing
        ((2.0, 0.0), (0.0, 0.0), [(1.0, 0.0), (0.0, 0.0)]),  # outside to inside: the crossing and the end
    ],
)
def test_the_four_cases(start, end, added):
    segment = rows(start, end)
    out = np.empty((8, 3))
    count = clipping.clip_to_plane(segment, 2, RIGHT[0], out)
    back = clipping.clip_to_plane(rows(end, start), 2, RIGHT[0], np.empty((8, 3)))
    assert count == back
    assert out[: len(added)].tolist() == [[x, y, 1.0] for x, y in added]


def test_a_picture_cuts_a_triangle_to_a_hexagon():
    borders = np.array([[1.0, 0, 0], [-1.0, 0, 4], [0, 1.0, 0], [0, -1.0, 4]])
    cut = clipping.clip_polygon(rows((-1.0, 2.0), (2.0, -1.0), (5.0, 5.0)), borders)
    x, y = cut[:, 0], cut[:, 1]
    area = 0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    assert (cut[:, :2] >= 0).all()
    assert (cut[:, :2] <= 4).all()
    # the triangle's part of the square: all but a corner of legs 1 and two slivers of legs 4, 2 less what the corners share
    assert area == pytest.approx(16 - 0.5 - 2 * (0.5 * 3 * 1.5), rel=1e-12)


def test_nothing_is_left_outside():
    assert clipping.clip_polygon(rows((2.0, 0.0), (3.0, 0.0), (3.0, 1.0)), RIGHT).shape == (0, 3)


def test_points_behind_the_eye_are_cut_before_the_division():
    """z = -1, 0.01 and 5: division before clipping would mirror the corner behind the eye."""
    triangle = np.array([[0.0, 1.0, -1.0], [0.0, 0.0, 0.01], [2.0, 0.0, 5.0]])  # (x, y, w = z)
    cut = clipping.clip_polygon(triangle, np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1e3], [-1.0, 0.0, 1e3], [0.0, 1.0, 1e3], [0.0, -1.0, 1e3]]))
    assert (cut[:, 2] > 0).all()
    projected = cut[:, :2] / cut[:, 2:]
    assert (np.abs(projected) <= 1e3 * (1 + 1e-12)).all()


def test_attributes_are_carried_along():
    square = np.array([[0.0, 0, 1, 10], [2.0, 0, 1, 30], [2.0, 1, 1, 30], [0.0, 1, 1, 10]])
    cut = clipping.clip_polygon(square, np.array([[-1.0, 0.0, 1.5]]))
    assert np.allclose(cut[:, 3], 10 + 10 * cut[:, 0], rtol=0, atol=1e-12)


corner = st.tuples(st.floats(-10, 10), st.floats(-10, 10))


@pytest.mark.long
@given(corner, corner, corner, corner)
def test_neighbours_get_the_same_crossing(a, b, c, d):
    """Two triangles with the edge a-b, in opposite directions, share bit-identical points after clipping."""
    border = np.array([[0.3, -0.7, 0.11]])
    first, second = clipping.clip_polygon(rows(a, b, c), border), clipping.clip_polygon(rows(b, a, d), border)
    distances = rows(a, b) @ border[0]
    if (distances[0] >= 0) != (distances[1] >= 0):
        shared = {tuple(p) for p in first.tolist()} & {tuple(p) for p in second.tolist()}
        assert len(shared) >= 2


@given(st.lists(corner, min_size=3, max_size=8))
def test_what_is_left_is_inside_and_holds_every_corner_that_was(points):
    cut = clipping.clip_polygon(rows(*points), RIGHT)
    assert (cut @ RIGHT[0] >= -1e-12).all()
    vertices = {tuple(p) for p in cut.tolist()}
    assert {(x, y, 1.0) for x, y in points if x <= 1.0} <= vertices
