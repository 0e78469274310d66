"""The three fills: each agrees with exact fractions on every sample, all with each other, and polygons with their triangulations."""

from fractions import Fraction

import mapbox_earcut
import numpy as np
import pytest
from maquette.render import fill
from maquette.render.kernels import kernel

TINY = Fraction(1, 1 << 80)  # less than any distance there is between fixed-point samples and edges


@kernel
def cover(how, triangles, samples, out):
    """out[t, s]: whether triangle t, (x, y) × 3 either way round, covers samples[t, s]."""
    sorted_x = np.empty(8, np.int64)
    for t in range(len(triangles)):
        x, y = triangles[t, 0::2].copy(), triangles[t, 1::2].copy()
        area = fill.doubled_area(x[0], y[0], x[1], y[1], x[2], y[2])
        if area < 0:
            x[1], x[2], y[1], y[2] = x[2], x[1], y[2], y[1]
        for s in range(samples.shape[1]):
            px, py = samples[t, s, 0], samples[t, s, 1]
            if area == 0:
                out[t, s] = False
            elif how == fill.EDGES:
                out[t, s] = fill.inside_edges(x[0], y[0], x[1], y[1], x[2], y[2], px, py)
            elif how == fill.AREAS:
                out[t, s] = fill.inside_areas(x[0], y[0], x[1], y[1], x[2], y[2], px, py)
            else:
                out[t, s] = fill.inside_crossings(sorted_x, fill.crossings(x, y, 0, 3, py, sorted_x, 0), px)


def covered(how: int, triangles: np.ndarray, samples: np.ndarray) -> np.ndarray:
    out = np.empty(samples.shape[:2], np.bool_)
    cover(how, triangles, samples, out)
    return out


def exactly(triangle: np.ndarray, sample: np.ndarray) -> bool:
    """The rule in exact arithmetic: left edges own their samples, then level top edges, so a sample stands for a point
    infinitely little to its right, and infinitely less below it, which is strictly inside or strictly outside."""
    px, py = Fraction(int(sample[0])) + TINY, Fraction(int(sample[1])) + TINY * TINY
    (ax, ay), (bx, by), (cx, cy) = (tuple(map(int, p)) for p in triangle.reshape(3, 2))
    signs = {
        (bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0,
        (cx - bx) * (py - by) - (cy - by) * (px - bx) > 0,
        (ax - cx) * (py - cy) - (ay - cy) * (px - cx) > 0,
    }
    return len(signs) == 1 and (bx - ax) * (cy - ay) != (by - ay) * (cx - ax)


def random_triangles(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of all sizes, some with level, upright or no edges, and samples in them, on their edges and on their corners."""
    random = np.random.default_rng(seed)
    size = 2 ** random.uniform(1, 14, (count, 1))
    triangles = np.rint(random.uniform(-1, 1, (count, 6)) * size).astype(np.int64)
    triangles[::7, 3] = triangles[::7, 1]  # level
    triangles[1::7, 2] = triangles[1::7, 0]  # upright
    triangles[2::7, 4:] = 2 * triangles[2::7, 2:4] - triangles[2::7, :2]  # no area
    corners = triangles.reshape(count, 3, 2)
    weights = random.dirichlet([1, 1, 1], (count, 3))
    inside = np.rint(np.einsum("nsc,ncd->nsd", weights, corners)).astype(np.int64)
    middles = (corners + np.roll(corners, 1, axis=1)) // 2
    around = np.rint(random.uniform(-1, 1, (count, 3, 2)) * size[:, :, None]).astype(np.int64)
    return triangles, np.concatenate([corners, inside, middles, around], axis=1)


@pytest.fixture(scope="module")
def ten_thousand():
    triangles, samples = random_triangles(10_000, seed=1)
    pairs = zip(triangles, samples, strict=True)
    return triangles, samples, np.array([[exactly(t, s) for s in row] for t, row in pairs])


@pytest.mark.parametrize("name", fill.NAMES)
def test_every_sample_agrees_with_fractions(name, ten_thousand):
    triangles, samples, expected = ten_thousand
    assert 0.2 < expected.mean() < 0.6
    assert np.array_equal(covered(fill.NAMES[name], triangles, samples), expected)


@pytest.mark.parametrize("name", fill.NAMES)
def test_far_corners_do_not_overflow(name):
    """Corners at the guard band, 2²⁰ pixels away, still give exact answers."""
    far = fill.ONE << 20
    triangles = np.array([[-far, -far, far, far - 1, -far + 1, far], [far, -far, -far, far, far, far]])
    samples = np.array([[[0, 0], [1, 0], [-1, 0], [0, 1], [7, -7]]] * 2)
    expected = [[exactly(t, s) for s in row] for t, row in zip(triangles, samples, strict=True)]
    assert covered(fill.NAMES[name], triangles, samples).tolist() == expected


def star(random: np.random.Generator, low: float, high: float, corners: int) -> np.ndarray:
    """A concave loop about the origin in whole numbers, with some level edges."""
    angle = np.sort(random.uniform(0, 2 * np.pi, corners) * 0.02 + np.arange(corners) * 2 * np.pi / corners)
    radius = random.uniform(low, high, corners)
    loop = np.rint(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)).astype(np.int64)
    level = random.integers(0, corners)
    loop[level, 1] = loop[level - 1, 1] if abs(loop[level, 1] - loop[level - 1, 1]) < 0.1 * low else loop[level, 1]
    return loop


@pytest.mark.parametrize("seed", range(40))
def test_scanline_covers_polygons_with_holes_as_their_triangulation_does(seed):
    random = np.random.default_rng(seed)
    corners = int(random.integers(5, 24))
    loops = [star(random, 1500, 5000, corners), star(random, 300, 1000, int(random.integers(3, 9)))[::-1]]
    points = np.concatenate(loops)
    ends = np.cumsum([len(loop) for loop in loops]).astype(np.uint32)
    triangles = points[mapbox_earcut.triangulate_float64(points.astype(np.float64), ends).reshape(-1, 3)].reshape(-1, 6)
    grid = np.stack(np.meshgrid(np.arange(-5000, 5000, 131), np.arange(-5000, 5000, 127)), axis=-1).reshape(-1, 2)
    samples = np.concatenate([grid, points, points + [1, 0], points - [1, 0]])
    owners = np.sum([covered(fill.EDGES, t[None], samples[None])[0] for t in triangles], axis=0)
    assert owners.max() == 1  # no sample of an inner edge belongs to two triangles
    x, y = points[:, 0].copy(), points[:, 1].copy()
    sorted_x = np.empty(len(points), np.int64)
    for (px, py), owner in zip(samples.tolist(), owners, strict=True):
        found = fill.crossings(x, y, 0, len(loops[0]), py, sorted_x, 0)
        found = fill.crossings(x, y, len(loops[0]), len(loops[1]), py, sorted_x, found)
        assert found % 2 == 0
        assert fill.inside_crossings(sorted_x, found, px) == bool(owner), (px, py)


def test_a_fan_covers_each_sample_once():
    """Triangles about one point, and the quads of a strip: additive coverage is 1 inside, whatever the samples meet."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rim = np.rint(2000 * np.stack([np.cos(turn), np.sin(turn)], axis=1)).astype(np.int64)
    triangles = np.concatenate([np.zeros((24, 2), np.int64), rim, np.roll(rim, -1, axis=0)], axis=1)
    grid = np.stack(np.meshgrid(np.arange(-1400, 1401, 25), np.arange(-1400, 1401, 25)), axis=-1).reshape(1, -1, 2)
    inside = (grid[0] ** 2).sum(axis=1) < 1900**2
    for how in fill.NAMES.values():
        assert (covered(how, triangles, np.repeat(grid, 24, axis=0)).sum(axis=0)[inside] == 1).all()


def naive_lines(triangle: np.ndarray, sample: np.ndarray) -> bool | None:
    """The course's a x - y + b > 0 with float slopes; None where an upright edge has no slope."""
    corners = [tuple(float(v) for v in p) for p in triangle.reshape(3, 2) / fill.ONE]
    px, py = (float(v) / fill.ONE for v in sample)
    for k in range(3):
        (x1, y1), (x2, y2), (x3, y3) = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
        if x1 == x2:
            return None
        a = (y2 - y1) / (x2 - x1)
        b = y1 - a * x1
        if (a * px - py + b > 0) != (a * x3 - y3 + b > 0):
            return False
    return True


def test_the_lines_with_slopes_fail(ten_thousand):
    """y = a x + b: upright edges have no answer, samples on an edge have a wrong one."""
    triangles, samples, expected = ten_thousand
    answers = [[naive_lines(t, s) for s in row] for t, row in zip(triangles[:2000], samples[:2000], strict=True)]
    flat = np.array([[-1 if a is None else int(a) for a in row] for row in answers])
    assert (flat == -1).mean() > 0.1  # divides by zero
    decided = flat >= 0
    assert (flat[decided] != expected[:2000][decided]).mean() > 0.05


def test_the_areas_with_equality_fail(ten_thousand):
    """S1 + S2 + S3 = S in floating point misses a large share of the samples inside."""
    triangles, samples, expected = ten_thousand
    scale = 1.0 / 3.0  # any unit in which corners are not whole numbers
    corners = triangles.reshape(-1, 1, 3, 2) * scale
    p = samples[:, :, None, :] * scale

    def area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        return 0.5 * np.abs((b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0]))

    a, b, c, q = corners[:, :, 0], corners[:, :, 1], corners[:, :, 2], p[:, :, 0]
    equal = area(q, b, c) + area(a, q, c) + area(a, b, q) == area(a, b, c)
    assert (~equal)[expected].mean() > 0.3
