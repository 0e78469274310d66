"""Curves of control points: their ends, known points, exactness for polynomials, and tolerance."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler.mesh import splines

POINTS = np.array([[0.0, 0, 0], [1, 2, 0], [3, 1, 1], [4, 4, 2], [6, 0, 1], [7, 1, 0], [8, 0, 0]])


@pytest.mark.parametrize("kind", splines.KINDS)
def test_an_open_curve_has_the_ends_of_its_points(kind):
    line = splines.polyline(POINTS, kind, False, 1e-3)
    assert line[[0, -1]] == pytest.approx(POINTS[[0, -1]])


@pytest.mark.parametrize("kind", ["linear", "catmull_rom"])
@pytest.mark.parametrize("closed", [False, True])
def test_an_interpolating_curve_has_every_point(kind, closed):
    line = splines.polyline(POINTS, kind, closed, 1e-3)
    assert np.linalg.norm(line[:, None] - POINTS, axis=2).min(axis=0) == pytest.approx(0, abs=1e-12)


def test_a_bezier_piece_is_its_polynomial():
    """Control points 0, 1/3, 2/3, 1 in x make x = t; (0, 0, 0, 1) in y makes y = t³."""
    line = splines.polyline(np.array([[0, 0], [1 / 3, 0], [2 / 3, 0], [1, 1]]), "bezier", False, 1e-4)
    assert line[:, 1] == pytest.approx(line[:, 0] ** 3)


def test_a_bspline_of_four_points_is_their_bezier_piece():
    (piece,) = splines.pieces(POINTS[:4], "bspline", False)
    assert piece == pytest.approx(POINTS[:4])


def test_a_bspline_has_continuous_curvature():
    """Second derivatives of neighbouring pieces agree where the knots are uniform: 6 (b2 − 2 b1 + b0) at t = 0."""
    made = splines.pieces(np.concatenate([POINTS, POINTS + [9, 0, 0]]), "bspline", False)[3:-3]
    for before, after in itertools.pairwise(made):
        assert before[3] == pytest.approx(after[0])
        assert before[3] - 2 * before[2] + before[1] == pytest.approx(after[2] - 2 * after[1] + after[0])


def test_a_closed_bspline_of_a_regular_polygon_is_nearly_a_circle():
    """At a knot its radius is (4 + 2 cos(2π/n)) / 6 of the polygon's."""
    n = 12
    turn = 2 * math.pi * np.arange(n) / n
    line = splines.polyline(np.stack([np.cos(turn), np.sin(turn)], axis=1), "bspline", True, 1e-6)
    radius = (4 + 2 * math.cos(2 * math.pi / n)) / 6
    assert np.linalg.norm(line, axis=1) == pytest.approx(radius, rel=1e-3)
    assert np.linalg.norm(line, axis=1).max() >= radius - 1e-12


def test_a_catmull_rom_spline_of_points_on_a_line_is_the_line():
    line = splines.polyline(np.array([[0.0, 0], [1, 1], [5, 5], [6, 6]]), "catmull_rom", False, 1e-3)
    assert line[:, 1] == pytest.approx(line[:, 0])
    assert (np.diff(line[:, 0]) >= 0).all()


def test_a_curve_turns_by_about_what_is_asked():
    circle = splines.polyline(np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]), "bspline", True, 1.0, turn=math.radians(10))
    legs = np.roll(circle, -1, axis=0) - circle
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    assert (legs * np.roll(legs, 1, axis=0)).sum(axis=1).min() >= math.cos(math.radians(12))


coordinates = st.floats(-10, 10).map(lambda x: round(x, 3))


@pytest.mark.long
@given(st.lists(st.tuples(coordinates, coordinates), min_size=4, max_size=4), st.floats(1e-3, 1))
def test_the_polyline_is_within_the_tolerance(points, tolerance):
    control = np.array(points)
    line = splines.polyline(control, "bezier", False, tolerance)
    if len(line) > splines.MOST_STEPS:
        return
    t = np.linspace(0, 1, 12 * (len(line) - 1) + 1)[:, None]
    exact = (1 - t) ** 3 * control[0] + 3 * t * (1 - t) ** 2 * control[1] + 3 * t**2 * (1 - t) * control[2] + t**3 * control[3]
    share = (t * (len(line) - 1)) % 1
    row = np.minimum((t * (len(line) - 1)).astype(int), len(line) - 2)[:, 0]
    chords = (1 - share) * line[row] + share * line[row + 1]
    chords[-1] = line[-1]
    assert np.linalg.norm(exact - chords, axis=1).max() <= tolerance * (1 + 1e-6) + 1e-9


@pytest.mark.parametrize(
    ("count", "kind", "closed", "message"),
    [
        (1, "linear", False, "a curve has two points or more, got 1"),
        (2, "bspline", True, "a closed curve has three points or more, got 2"),
        (5, "bezier", False, "a Bézier curve has 2, 3, 4, 7, 10, 13, … points, got 5"),
        (4, "bezier", True, "a closed Bézier curve has 3, 6, 9, … points, got 4"),
    ],
)
def test_counts_that_make_no_curve(count, kind, closed, message):
    with pytest.raises(splines.SplineError) as failure:
        splines.pieces(POINTS[:count], kind, closed)
    assert str(failure.value) == message
