"""Large polygons are split along diagonals, and covered once by triangles."""

import numpy as np
import pytest
from maquette.compiler.mesh import polygon_split, triangulate


def circle(count: int) -> np.ndarray:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def coast(count: int) -> np.ndarray:
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = 1 + 0.2 * np.sin(angles * 37) + 0.1 * np.sin(angles * 531) + 0.02 * np.sin(angles * 5003)
    return circle(count) * radius[:, None]


def comb(count: int) -> np.ndarray:
    x = np.arange(count - 2)
    return np.concatenate([np.stack([x, x % 2 * 10.0], axis=1), [[count - 3, -1], [0, -1]]])[::-1]


def spiral(count: int) -> np.ndarray:
    angles = np.linspace(0, 40, count // 2)
    inner, outer = (np.stack([np.cos(angles), np.sin(angles)], axis=1) * (start + angles)[:, None] for start in (1, 1.5))
    return np.concatenate([inner, outer[::-1]])[::-1]


SHAPES = {
    "circle": circle(20_000),
    "rounded circle": np.round(circle(20_000), 5),
    "star": circle(20_000) * (1 + 0.5 * (np.arange(20_000) % 2))[:, None],
    "coast": coast(20_000),
    "comb": comb(20_000),
    "spiral": spiral(20_000),
}


def area(loop: np.ndarray) -> float:
    after = np.roll(loop, -1, axis=0)
    return float(loop[:, 0] @ after[:, 1] - loop[:, 1] @ after[:, 0]) / 2


def areas(corners: np.ndarray) -> np.ndarray:
    """Signed areas of triangles (m, 3, 2)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("name", SHAPES)
def test_a_large_polygon_is_covered_once(name, turn):
    loop = SHAPES[name][::turn]
    points = np.concatenate([loop, np.full((len(loop), 1), 3.0)], axis=1)
    cut = triangulate.faces(points, np.arange(len(loop)), np.array([len(loop)]))
    covered = areas(loop[cut.corners])
    assert covered.sum() == pytest.approx(area(loop), rel=1e-9)
    assert np.abs(covered).sum() == pytest.approx(abs(area(loop)), rel=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_pieces_of_a_polygon_have_its_area(name):
    loop = SHAPES[name]
    found = polygon_split.pieces(loop)
    assert len(found) > 1
    assert all(area(loop[rows]) >= 0 for rows in found)
    assert sum(area(loop[rows]) for rows in found) == pytest.approx(area(loop), rel=1e-9)


def test_small_polygons_are_whole():
    (rows,) = polygon_split.pieces(circle(polygon_split.LARGE))
    assert rows.tolist() == list(range(polygon_split.LARGE))


@pytest.mark.long
def test_a_large_polygon_that_crosses_itself_ends():
    loop = np.random.default_rng(1).random((40_000, 2))
    found = polygon_split.pieces(loop)
    assert max(map(len, found)) <= polygon_split.WHOLE


def test_corners_that_repeat_three_points_are_a_fan():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    count = 30_000
    cut = triangulate.faces(points, np.tile(np.arange(3), count // 3), np.array([count]))
    assert 0 < len(cut.corners) <= count - 2
    assert np.abs(areas(points[np.arange(3)[cut.corners % 3], :2])).max() == 0.5
