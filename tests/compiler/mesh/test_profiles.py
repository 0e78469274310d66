"""Profiles: orientation and area, points inside, crossings found as by exact arithmetic, nesting of holes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler.mesh import profiles

SQUARE = [(0, 0), (2, 0), (2, 2), (0, 2)]


@pytest.mark.parametrize("points", [SQUARE, SQUARE[::-1], [*SQUARE, (0, 0)], [(0, 0), (0, 0), *SQUARE[1:]]])
def test_an_outline_is_counter_clockwise_without_repetitions(points):
    loop = profiles.outline(points)
    assert len(loop) == 4
    assert profiles.signed_area(loop) == pytest.approx(4)


def test_a_point_inside():
    star = np.array([(0.0, 0), (4, 0), (4, 4), (2, 1), (0, 4)])
    assert profiles.inside(star, np.array([2, 0.5]))
    assert not profiles.inside(star, np.array([2, 2.0]))


def exact_meeting(points: list[tuple[int, int]]) -> bool:
    """Whether two edges that are no neighbours have a point in common, or neighbours fold back, in rational numbers."""
    n = len(points)
    edges = [(points[k], points[(k + 1) % n]) for k in range(n)]

    def cross(a, b, c):
        return Fraction(b[0] - a[0]) * (c[1] - a[1]) - Fraction(b[1] - a[1]) * (c[0] - a[0])

    def on(a, b, c):
        return cross(a, b, c) == 0 and min(a[0], b[0]) <= c[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= c[1] <= max(a[1], b[1])

    for i in range(n):
        (a, b), (_, c) = edges[i], edges[(i + 1) % n]
        if cross(a, b, c) == 0 and (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1]) < 0:
            return True
        for j in range(i + 2, n):
            if (j + 1) % n == i:
                continue
            c, d = edges[j]
            if cross(a, b, c) * cross(a, b, d) < 0 and cross(c, d, a) * cross(c, d, b) < 0:
                return True
            if on(a, b, c) or on(a, b, d) or on(c, d, a) or on(c, d, b):
                return True
    return False


whole = st.integers(0, 6)


@given(st.lists(st.tuples(whole, whole), min_size=3, max_size=8, unique=True))
def test_crossings_are_those_of_exact_arithmetic(points):
    loop = np.array(points, dtype=np.float64)
    assert (profiles.crossing_of(loop) is not None) == exact_meeting(points)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0), (1, 1)], "the profile has three points or more, got 2"),
        ([(1, 1)] * 3, "the points of the profile are the same"),
        ([(0, 0), (1, 1), (2, 2)], "the profile has no area: its points lie on one line"),
        ([(0, 0), (2, 2), (2, 0), (0, 2)], "the profile crosses or touches itself near [1, 1] m"),
        ([(0, 0), (2, 0), (2, 2), (2, 0.5), (0, 2)], "the profile crosses or touches itself near [2, 2] m"),
    ],
)
def test_profiles_that_enclose_nothing(points, message):
    with pytest.raises(profiles.ProfileError) as failure:
        profiles.outline(points)
    assert str(failure.value) == message


def square(x: float, y: float, size: float) -> np.ndarray:
    return np.array([(x, y), (x + size, y), (x + size, y + size), (x, y + size)], dtype=np.float64)


def test_holes_are_clockwise():
    loops = profiles.with_holes(square(0, 0, 4), [square(1, 1, 1), square(2.5, 1, 1)])
    assert [profiles.signed_area(loop) for loop in loops] == pytest.approx([16, -1, -1])


@pytest.mark.parametrize(
    ("holes", "message"),
    [
        ([square(5, 5, 1)], "hole 1 lies outside of the outline"),
        ([square(3.5, 1, 1)], "hole 1 meets the outline near [4, 1] m"),
        ([square(1, 1, 1), square(1.5, 1.5, 1)], "holes 1 and 2 meet near [2, 1.5] m"),
        ([square(1.2, 1.2, 0.5), square(1, 1, 2)], "hole 1 lies inside hole 2"),
        ([square(1, 1, 2), square(1.2, 1.2, 0.5)], "hole 2 lies inside hole 1"),
    ],
)
def test_holes_that_do_not_fit(holes, message):
    with pytest.raises(profiles.ProfileError) as failure:
        profiles.with_holes(square(0, 0, 4), holes)
    assert str(failure.value) == message
