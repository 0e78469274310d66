"""Clipping, fill, depth and attributes of triangles against determinants in float64: near, far, behind the eye, far out, in each other.

In the eye's frame the ray through a pixel is d = u a + v b + w c for a triangle's corners: by Cramer's rule the weights are ratios of
determinants, whatever is behind the eye, and the depth at which the ray meets it is det(a, b, c) over their sum.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData, MeshAttribute
from maquette.render.image.image import Image

from .. import pictures
from ..tables import matrix, mesh, scene

SIZE = (37, 29)  # no multiple of anything
FINE = 1.5 / 256  # of a pixel: corners are snapped to 1/256
EYE = CameraData(0, 1.0)


class Seen(NamedTuple):
    """The hits of rays through positions of the picture, (h, w) each."""

    triangle: np.ndarray  # -1: nothing
    depth: np.ndarray
    weights: np.ndarray  # (h, w, 2) of the second and third corner
    every: np.ndarray  # (triangles, h, w) depths of all of them, inf where they are not


def met(corners: np.ndarray, camera: CameraData, size: tuple[int, int], dx: float = 0.0, dy: float = 0.0) -> Seen:
    """The hits of rays through points (dx, dy) from pixel centres with (n, 3, 3) triangles in the eye's frame."""
    w, h = size
    y, x = np.mgrid[0:h, 0:w] + 0.5
    step = 2.0 * camera.extent / h
    d = np.stack([(x + dx - w / 2) * step, (h / 2 - y - dy) * step, -np.ones((h, w))], axis=-1)
    a, b, c = (corners[:, k, None, None] for k in range(3))
    with np.errstate(all="ignore"):
        parts = np.stack([np.sum(d * np.cross(*pair), axis=-1) for pair in ((b, c), (c, a), (a, b))], axis=-1)
        volume = np.sum(a * np.cross(b, c), axis=-1)
        weights = parts / parts.sum(axis=-1, keepdims=True)
        depth = volume / parts.sum(axis=-1)
        near = max(camera.near, 0.0)
        inside = (weights >= 0).all(axis=-1) & (depth > near) & (depth <= camera.far)
    every = np.where(inside, depth, np.inf)
    first = every.argmin(axis=0)
    is_hit = np.isfinite(every.min(axis=0))
    j, i = np.indices(first.shape)
    return Seen(np.where(is_hit, first, -1), every.min(axis=0), weights[first, j, i, 1:], every)


def drawn(corners: np.ndarray, camera: CameraData = EYE, size: tuple[int, int] = SIZE) -> tuple[Image, np.ndarray]:
    """A picture with an instance for each triangle, whose uv are its corners' weights; and the corners as stored."""
    uvs = MeshAttribute(np.array([[0.0, 0], [1, 0], [0, 1]]))
    tables = scene(meshes=[(mesh(t, [[0, 1, 2]], uvs=uvs), matrix(), 0) for t in corners], camera=camera)
    rows = tables.pools.positions.astype(np.float64)[tables.pools.triangles]
    stored = rows + tables.geometries.origin[:, None]
    return pictures.picture(tables, size=size, aov=("id", "depth", "uv")), stored


def check(corners: np.ndarray, camera: CameraData = EYE, size: tuple[int, int] = SIZE) -> int:
    """Every pixel shows the first hit of a ray next to it, with its depth and weights; returns the number of pixels with a hit."""
    image, stored = drawn(corners, camera, size)
    id_, depth, uv = image.channels["id"][..., 0].astype(int), image.channels["depth"][..., 0], image.channels["uv"]
    middle = met(stored, camera, size)
    around = [met(stored, camera, size, sx * FINE, sy * FINE) for sx in (-1, 0, 1) for sy in (-1, 0, 1)]
    good = np.any([id_ == seen.triangle for seen in around], axis=0)
    j, i = np.nonzero(~good & (id_ >= 0))
    tied = np.zeros_like(good)  # at depths that floats hardly tell apart
    with np.errstate(invalid="ignore"):
        tied[j, i] = middle.every[id_[j, i], j, i] <= middle.depth[j, i] * (1 + 1e-6)
    assert (good | tied).all(), f"{np.sum(~(good | tied))} pixels, first {np.argwhere(~(good | tied))[0]}"
    calm = np.all([seen.triangle == middle.triangle for seen in around], axis=0) & (id_ == middle.triangle) & (id_ >= 0)
    assert np.allclose(depth[calm], middle.depth[calm], rtol=1e-5)
    assert np.allclose(uv[calm], middle.weights[calm], atol=1e-4)
    return int(calm.sum())


def across_the_eye(random: np.random.Generator) -> np.ndarray:
    """Corners on both sides of the eye's plane, near and far."""
    return random.normal(size=(12, 3, 3)) * 10.0 ** random.uniform(-2, 2, (12, 3, 1))


def in_the_plane_of_the_eye(random: np.random.Generator) -> np.ndarray:
    """A corner, or two, where w is 0."""
    corners = random.normal(size=(12, 3, 3)) * 3
    corners[:6, 0, 2] = 0.0
    corners[6:, :2, 2] = 0.0
    return corners


def far_out(random: np.random.Generator) -> np.ndarray:
    """Corners up to 10⁹ pixels out: beyond the guard band."""
    corners = random.normal(size=(12, 3, 3)) * 10.0 ** random.uniform(0, 6, (12, 3, 1))
    corners[..., 2] = -np.abs(corners[..., 2]) * 10.0 ** random.uniform(-6, 0, (12, 3))
    return corners


def in_each_other(random: np.random.Generator) -> np.ndarray:
    """Large triangles that intersect each other before the eye."""
    corners = random.uniform(-6, 6, (10, 3, 3))
    corners[..., 2] -= 8
    return corners


def slivers(random: np.random.Generator) -> np.ndarray:
    """Aspect ratios from a hundred to a million."""
    start, end = random.uniform(-3, 3, (2, 40, 3)) - [0, 0, 4]
    side = start + random.normal(size=(40, 3)) * 10.0 ** random.uniform(-5, -1, (40, 1))
    return np.stack([start, end, side], axis=1)


def deep(random: np.random.Generator) -> np.ndarray:
    """One corner at 10⁻² to 1 m, another at 10³ to 10⁵ m."""
    corners = random.uniform(-1, 1, (10, 3, 3))
    depth = np.stack([10.0 ** random.uniform(-2, 0, 10), 10.0 ** random.uniform(3, 5, 10), 10.0 ** random.uniform(-2, 5, 10)], axis=1)
    corners[..., 2] = -1.0
    return corners * depth[..., None]


def crumbs(random: np.random.Generator) -> np.ndarray:
    """From a tenth of a pixel to a few."""
    middle = random.uniform(-1.2, 1.2, (60, 1, 3)) * [1, 1, 0] + [0, 0, -3]
    return middle + random.normal(size=(60, 3, 3)) * 10.0 ** random.uniform(-2, 0, (60, 1, 1)) * 0.3


KINDS: list[Callable[[np.random.Generator], np.ndarray]] = [
    across_the_eye, in_the_plane_of_the_eye, far_out, in_each_other, slivers, deep, crumbs,
]  # fmt: skip
CAMERAS = {
    "": EYE, "near and far": CameraData(0, 1.0, near=1.0, far=6.0), "wide": CameraData(0, 40.0), "narrow": CameraData(0, 0.01),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=list(CAMERAS))
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_triangles_are_where_determinants_say(kind, camera):
    calm = sum(check(kind(np.random.default_rng(seed)), camera) for seed in range(8))
    assert calm > 0 or (camera.extent > 1 and kind in (slivers, crumbs))  # of which little is seen from so wide a view


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (50, 1), (3, 5), (130, 66)])
def test_pictures_of_any_size(size):
    for kind in (across_the_eye, in_each_other):
        check(kind(np.random.default_rng(7)), EYE, size)


@pytest.mark.parametrize("samples", [1, 4, 16])
@pytest.mark.parametrize("reach", [0.02, 0.3, 30.0])
def test_of_equal_depths_the_first_is_seen_in_either_order(reach, samples):
    """The same triangle twice, tiny, small and large: the first instance wins every sample."""
    corners = np.array([[-0.7, -0.9, 0], [0.8, -0.6, 0], [0.1, 0.9, 0]]) * reach + [0.01, 0.02, -1.0]
    first, second = mesh(corners, [[0, 1, 2]]), mesh(corners[[1, 2, 0]], [[0, 1, 2]])
    for pair in ((first, second), (second, first)):
        tables = scene(meshes=[(m, matrix(), 0) for m in pair], camera=EYE)
        image = pictures.picture(tables, size=(64, 64), samples=samples, aov=("id",))
        assert set(np.unique(image.channels["id"][..., 0])) <= {-1.0, 0.0}
        alone = pictures.picture(scene(meshes=[(pair[0], matrix(), 0)], camera=EYE), size=(64, 64), samples=samples)
        assert np.array_equal(image.channels["rgba"], alone.channels["rgba"])


@pytest.mark.long
def test_closed_meshes_are_met_once_from_each_side():
    """Each pixel covered by a closed mesh is covered by as many front faces as back faces."""
    from maquette.render.tessellation import analytic_shapes

    ball = analytic_shapes.tessellate(ir.GeometryKind.SPHERE, [0.8], 1e-3)
    points, triangles = ball.positions[:, :3] + [0.03, -0.02, -2.5], ball.triangles
    area = np.einsum("ij,ij->i", points[triangles[:, 0]], np.cross(points[triangles[:, 1]], points[triangles[:, 2]]))
    sides = [triangles[area < 0], triangles[area > 0]]
    size = (96, 96)
    covered = []
    for side in sides:
        tables = scene(meshes=[(mesh(points, side), matrix(), 0)], camera=EYE)
        covered.append(pictures.picture(tables, size=size, aov=("id",)).channels["id"][..., 0] >= 0)
    assert covered[0].sum() > 500
    assert np.array_equal(covered[0], covered[1])
    parts = np.zeros(size[::-1], int)  # and cut into eight pieces along no line of pixels, added up: once each
    for k in range(8):
        tables = scene(meshes=[(mesh(points, sides[0][k::8]), matrix(), 0)], camera=EYE)
        parts += pictures.picture(tables, size=size, aov=("id",)).channels["id"][..., 0] >= 0
    assert np.array_equal(parts, covered[0].astype(int))
