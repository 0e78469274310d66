"""Corners on edges that do not know them: counted where they are, and nowhere else."""

from __future__ import annotations

import itertools

import maquette
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler.scene import t_junctions
from maquette.lang.diagnostics import Diagnostics

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def count(points, triangles) -> int:
    return t_junctions.count(np.asarray(points, np.float32), np.asarray(triangles, np.int32))


def grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """(n + 1)² corners and 2 n² triangles."""
    y, x = np.mgrid[0 : n + 1, 0 : n + 1] / n
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), triangles


@pytest.mark.parametrize("between", [1, 2, 5])
def test_a_long_edge_beside_short_ones(between: int):
    """A triangle below, as many more above as its edge is cut into."""
    short = [[k / (between + 1), 0, 0] for k in range(1, between + 1)]
    line = [0, *range(4, 4 + between), 1]
    fan = [[a, b, 2] for a, b in itertools.pairwise(line)]
    found = count([*SQUARE[:2], [0.5, 1, 0], [0.5, -1, 0], *short], [[1, 0, 3], *fan])
    assert found == (between if between <= 1 else 2)  # the first from either end


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_a_corner_anywhere_on_any_edge(seed: int):
    random = np.random.default_rng(seed)
    a, b, up, down = random.normal(size=(4, 3)) * 10.0 ** random.integers(-2, 4)
    middle = a + (b - a) * random.uniform(0.05, 0.95)
    assert count([a, b, up, down, middle], [[1, 0, 3], [0, 4, 2], [4, 1, 2]]) == 1


@pytest.mark.parametrize("n", [1, 2, 7])
def test_open_borders_have_none(n: int):
    points, triangles = grid(n)
    assert count(points, triangles) == 0
    assert count(points[triangles].reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)) == 0  # each with corners of its own


def test_two_grids_that_meet_with_other_steps():
    """A border of 4 beside one of 2: of three corners on it one is shared."""
    fine, a = grid(4)
    coarse, b = grid(2)
    assert count(np.concatenate([fine, coarse + [1, 0, 0]]), np.concatenate([a, b + len(fine)])) == 2


def test_a_closed_mesh_has_none():
    assert count([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]) == 0


def test_it_is_told(tmp_path):
    path = tmp_path / "a.scene"
    path.write_text(
        "camera(position: [0, 0, 5])\n"
        "mesh(points: [[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], [0.5, 0, 0]], faces: [[1, 0, 3], [0, 4, 2], [4, 1, 2]])\n"
    )
    found = Diagnostics()
    maquette.load(path, diagnostics=found)
    (said,) = found.items
    assert said.message == "shape: 1 corner lies on the edge of a triangle that goes on: the seam may show cracks"
    assert said.hint == "split the edge there"
    assert said.span is not None
    assert said.span.line == 2
