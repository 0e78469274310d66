"""Watertight rasterization: neighbors cover each sample once, in all edge directions, beyond the guard band and behind the eye."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData, LightData

from .. import pictures
from ..tables import matrix, mesh, phong, scene

SIZE = (64, 48)
FLAT = CameraData(0, SIZE[1] / 2, ir.Projection.ORTHOGRAPHIC)  # a metre is a pixel
EYE = CameraData(0, 1.0)
LIGHT = LightData(ir.LightKind.AMBIENT, (1.0, 1.0, 1.0))
SAMPLES = (1, 4, 16)


def coverage(points: np.ndarray, triangles: np.ndarray, camera: CameraData, samples: int) -> np.ndarray:
    """Coverage of each pixel by a mesh of triangles, (h, w)."""
    tables = scene(meshes=[(mesh(points, triangles), matrix(), 0)], camera=camera, lights=[LIGHT], materials=[phong(1.0)])
    return pictures.picture(tables, size=SIZE, samples=samples, filter="box", background="transparent").channels["rgba"][..., 3]


def fan(center: list[float], rim: np.ndarray, camera: CameraData, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Coverage by the even and by the odd triangles of a closed fan."""
    count = len(rim)
    points = np.vstack([rim, [center]])
    triangles = np.array([[k, (k + 1) % count, count] for k in range(count)])
    triangles[::3] = triangles[::3, ::-1]  # either way round
    return coverage(points, triangles[::2], camera, samples), coverage(points, triangles[1::2], camera, samples)


def ring(radius: float, z: float, turned: float = 0.0) -> np.ndarray:
    """Points a degree apart."""
    angle = np.radians(np.arange(360) + turned)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(360, z)], axis=-1)


@pytest.mark.parametrize("samples", SAMPLES)
@pytest.mark.parametrize("center", [(0.5, -0.5), (0.0, 0.0), (0.3137, 7.7793)], ids=["on a sample", "on a corner", "anywhere"])
@pytest.mark.parametrize("radius", [60.0, 900.0, 5e4, 3e6, 1e9], ids=lambda radius: f"{radius:g}")
def test_edges_of_every_degree_are_shared(radius, center, samples):
    """Rims inside the picture, outside, and beyond the fixed-point range, where both neighbors are clipped."""
    even, odd = fan([*center, -5.0], ring(radius, -5.0) + [*center, 0.0], FLAT, samples)
    assert np.array_equal(even + odd, np.ones_like(even))
    assert even.mean() == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("samples", SAMPLES)
@pytest.mark.parametrize("near", [0.0, 0.5])
@pytest.mark.parametrize("behind", [0.0, 3.0], ids=["in the eye's plane", "behind the eye"])
def test_a_funnel_around_the_eye_is_closed(behind, near, samples):
    """Its tip is in front of the eye and its rim behind: each ray hits it once, or not where `near` clips it."""
    camera = CameraData(0, 1.0, near=near)
    tip = [0.01, -0.02, -2.0]
    even, odd = fan(tip, ring(4.0, behind, 0.37) + [0.02, 0.01, 0.0], camera, samples)
    assert (even + odd).max() == 1.0
    assert np.array_equal(even + odd, np.ones_like(even))


@pytest.mark.parametrize("samples", SAMPLES)
def test_a_strip_cut_by_near_has_an_even_edge(samples):
    """A floor of many triangles ends where `near` clips it, at one line of the picture, without cracks above."""
    side = np.linspace(-14.0, 14.0, 41)
    points = np.stack(np.meshgrid(side, [-1.0], -np.linspace(-1.0, 9.0, 31), indexing="ij"), axis=-1).reshape(-1, 3)
    first = (np.arange(40)[:, None] * 31 + np.arange(30)).ravel()
    triangles = np.concatenate([np.stack([first, first + 1, first + 31], axis=-1), np.stack([first + 1, first + 31, first + 32], axis=-1)])
    camera = CameraData(0, 1.0, near=1.25)
    covered = coverage(points, triangles, camera, samples)
    slope = (np.arange(SIZE[1]) + 0.5 - SIZE[1] / 2) / (SIZE[1] / 2)  # of rays down: the floor is 1 / slope away
    inside = (slope - 1 / 48 > 1 / 9) & (slope + 1 / 48 < 1 / 1.25)
    assert (covered[inside] == 1.0).all()
    assert (covered[(slope + 1 / 48 < 1 / 9) | (slope - 1 / 48 > 1 / 1.25)] == 0.0).all()


@pytest.mark.long
@pytest.mark.parametrize("camera", [FLAT, EYE], ids=["orthographic", "perspective"])
def test_triangles_without_area_cover_nothing(camera):
    """Collinear and coincident corners, in front of and across the eye's plane, cover no sample at any size."""
    for reach in (2.0**-7, 1.0, 32.0, 2.0**20):  # numbers of which float32 has the middle
        a, b = np.array([-0.75, 0.25, -3.0]) * [reach, reach, 1.0], np.array([0.5, -0.5, -3.0]) * [reach, reach, 1.0]
        behind = np.array([0.5, 0.25, 2.0])
        for corners in ([a, b, 0.5 * (a + b)], [a, b, b], [a, a, a], [a, behind, behind], [a, behind, 0.5 * (a + behind)]):
            assert coverage(np.array(corners), np.array([[0, 1, 2]]), camera, 16).max() == 0.0


@pytest.mark.parametrize("nearer", [0, 1])
@pytest.mark.parametrize("depth", [1e-3, 1.0, 1e5, 1e9])
def test_depths_differ_at_every_distance(depth, nearer):
    """Two walls of relative depth difference 4e-7, with the near plane at 0, are separated by 1 / depth in float32."""
    square = np.array([[-9.0, -9, -1], [9, -9, -1], [9, 9, -1], [-9, 9, -1]])
    walls = [(mesh(square * depth * (1.0 + (4e-7 if k != nearer else 0.0)), [[0, 1, 2], [0, 2, 3]]), matrix(), k) for k in range(2)]
    tables = scene(meshes=walls, camera=EYE, lights=[LIGHT], materials=[phong(0.25), phong(0.75)])
    seen = pictures.picture(tables, size=SIZE, samples=4, filter="box").channels["rgba"][..., 0]
    assert np.allclose(seen, 0.75 if nearer else 0.25)
