"""The three coverage tests sample by sample, the same rule in exact fractions, and random triangles and loops."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from maquette.render.jit.kernel import kernel
from maquette.render.raster import coverage

TINY = Fraction(1, 1 << 80)  # less than any distance there is between fixed-point samples and edges


@kernel
def cover(how, triangles, samples, out):
    """Write whether triangle t, (x, y) × 3 in either order, covers samples[t, s] to out[t, s]."""
    sorted_x = np.empty(8, np.int64)
    for t in range(len(triangles)):
        x, y = triangles[t, 0::2].copy(), triangles[t, 1::2].copy()
        area = coverage.doubled_area(x[0], y[0], x[1], y[1], x[2], y[2])
        if area < 0:
            x[1], x[2], y[1], y[2] = x[2], x[1], y[2], y[1]
        for s in range(samples.shape[1]):
            px, py = samples[t, s, 0], samples[t, s, 1]
            if area == 0:
                out[t, s] = False
            elif how == coverage.EDGES:
                out[t, s] = coverage.inside_edges(x[0], y[0], x[1], y[1], x[2], y[2], px, py)
            elif how == coverage.AREAS:
                out[t, s] = coverage.inside_areas(x[0], y[0], x[1], y[1], x[2], y[2], px, py)
            else:
                out[t, s] = coverage.inside_crossings(sorted_x, coverage.crossings(x, y, 0, 3, py, sorted_x, 0), px)


def covered(how: int, triangles: np.ndarray, samples: np.ndarray) -> np.ndarray:
    out = np.empty(samples.shape[:2], np.bool_)
    cover(how, triangles, samples, out)
    return out


def exactly(triangle: np.ndarray, sample: np.ndarray) -> bool:
    """The top-left rule in exact arithmetic, by a point infinitesimally right of the sample and, to second order, below it."""
    px, py = Fraction(int(sample[0])) + TINY, Fraction(int(sample[1])) + TINY * TINY
    (ax, ay), (bx, by), (cx, cy) = (tuple(map(int, p)) for p in triangle.reshape(3, 2))
    signs = {
        (bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0,
        (cx - bx) * (py - by) - (cy - by) * (px - bx) > 0,
        (ax - cx) * (py - cy) - (ay - cy) * (px - cx) > 0,
    }
    return len(signs) == 1 and (bx - ax) * (cy - ay) != (by - ay) * (cx - ax)


def random_triangles(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of all sizes, some with horizontal or vertical edges or without area; samples inside, on edges and on corners."""
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


def star(random: np.random.Generator, low: float, high: float, corners: int) -> np.ndarray:
    """A concave loop around the origin in integers, with some horizontal edges."""
    angle = np.sort(random.uniform(0, 2 * np.pi, corners) * 0.02 + np.arange(corners) * 2 * np.pi / corners)
    radius = random.uniform(low, high, corners)
    loop = np.rint(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)).astype(np.int64)
    level = random.integers(0, corners)
    loop[level, 1] = loop[level - 1, 1] if abs(loop[level, 1] - loop[level - 1, 1]) < 0.1 * low else loop[level, 1]
    return loop
