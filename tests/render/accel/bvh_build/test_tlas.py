"""BVH over instances where float32 is least precise: far away, at any scale, on a wide ground, in planes of faces."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.render.accel import scene_bvh
from maquette.render.accel.bvh_build import tlas
from maquette.render.accel.traverse import two_level
from maquette.render.types import Ray

from ...tables import matrix, rays, scene
from ...tracing import coherent_rays, random_rays, trace_kernels, wavy

K = ir.GeometryKind
MANY = 400


def placed(rng: np.random.Generator, offset: float, scale: float, side: float) -> np.ndarray:
    """Random transforms in a cube of 8 · scale around (at, -at, at / 2), for instances of size `scale`."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    middle = scale * rng.uniform(-4, 4, 3) + np.array([offset, -offset, 0.5 * offset])
    return np.hstack([scale * side * turn, middle[:, None]])


def crowd(offset: float = 0.0, scale: float = 1.0, side: float = 0.3) -> ir.Tables:
    rng = np.random.default_rng(5)
    places = [placed(rng, offset, scale, side) for _ in range(MANY)]
    spheres = [(K.SPHERE, [1.0], place, 0) for place in places[::2]]
    return scene(spheres, meshes=[(wavy(2, k), place, 0) for k, place in enumerate(places[1::2])])


def moved(ray: Ray, offset: float, scale: float, back: float = 0.0) -> Ray:
    """Rays among what `crowd` makes; `back`: how far before, in sizes of the scene."""
    middle = np.array([offset, -offset, 0.5 * offset])
    origin = tuple(scale * (o - back * d) + m for o, d, m in zip(ray.origin, ray.direction, middle, strict=True))
    return ray._replace(origin=origin)


def same(tables: ir.Tables, ray: Ray) -> tuple[np.ndarray, ...]:
    """Hits of rays, after BVH and brute force agreed bit for bit."""
    expected = trace_kernels(tables, ray, brute=True)
    for column, expected_column in zip(trace_kernels(tables, ray), expected, strict=True):
        np.testing.assert_array_equal(column, expected_column)
    return expected


def big_enough(tables: ir.Tables) -> None:
    assert len(scene_bvh.build(tables).top.links) > two_level.SMALL  # else all rays go together


@pytest.mark.long
@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1.0, 1e6, 1e12])
@pytest.mark.parametrize("away", [0.0, 1e3, 1e7])
def test_hits_match_brute_force_at_any_scale_and_place(scale: float, away: float) -> None:
    offset = away * scale
    tables = crowd(offset, scale)
    big_enough(tables)
    for ray in (random_rays(1500, 1), coherent_rays(1500, 2, spread=0.3)):
        _, instance, *_ = same(tables, moved(ray, offset, scale))
        assert np.mean(instance >= 0) > 0.1


@pytest.mark.parametrize("back", [30.0, 1e4, 1e7])
def test_hits_match_from_far_away(back: float) -> None:
    tables = crowd()
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(2000, 3))
    ray = rays(rng.uniform(-4, 4, (2000, 3)), direction / np.linalg.norm(direction, axis=1, keepdims=True))
    _, instance, *_ = same(tables, moved(ray, 0.0, 1.0, back))
    assert np.mean(instance >= 0) > 0.1


def test_hits_match_between_t_min_and_t_max() -> None:
    tables = crowd()
    rng = np.random.default_rng(3)
    ray = random_rays(3000, 4, reach=4.0)
    t_min = rng.uniform(0, 3, 3000)
    _, instance, *_, blocked = same(tables, ray._replace(t_min=t_min, t_max=t_min + rng.uniform(0, 2, 3000)))
    assert 0.05 < np.mean(instance >= 0) < 0.6
    np.testing.assert_array_equal(blocked, instance >= 0)


def test_rays_along_the_axes_in_the_faces_of_boxes() -> None:
    """Rays in the face planes of touching cubes, at coordinates that float32 cannot represent, and one rounding beside."""
    third = 1.0 / 3.0
    tables = scene([(K.BOX, [0.5 * third] * 3, matrix((third * x, third * y, 0.1 * (x - y))), 0) for x in range(20) for y in range(20)])
    big_enough(tables)
    line = third * (np.arange(-1, 41) - 1) / 2.0
    x, y = (g.ravel() for g in np.meshgrid(np.concatenate([line, np.nextafter(line, 99), np.nextafter(line, -99)]), line))
    for axis in ((0, 0, -1), (0, 0, 1)):
        _, instance, *_ = same(tables, rays(np.stack([x, y, -9.0 * axis[2] + 0.0 * x], axis=1), axis))
        assert np.mean(instance >= 0) > 0.7
    same(tables, rays(np.stack([0.0 * x - 9.0, y, x - third], axis=1), (1, 0, 0)))


@pytest.mark.parametrize("wide", [1e2, 1e5, 1e8])
def test_small_instances_on_a_wide_ground(wide: float) -> None:
    rng = np.random.default_rng(9)
    small = [(K.SPHERE, [1.0], placed(rng, 0.0, 1.0, 0.05), 0) for _ in range(MANY)]
    tables = scene([*small, (K.BOX, [wide, 0.1, wide], matrix((0, -4.2, 0)), 0)])
    built = scene_bvh.build(tables)
    assert built.unbounded.tolist() == ([MANY] if wide > 1e4 else [])
    _, instance, *_ = same(tables, random_rays(3000, 6, reach=4.0))
    assert np.mean(instance == MANY) > 0.2
    assert len(np.unique(instance)) > 50


def test_only_few_instances_stay_outside() -> None:
    small = np.tile([0.0, 0.0, 0.0, 1e-3, 1e-3, 1e-3], (100, 1)) + np.arange(100.0)[:, None] * 1e-3
    large = np.tile([-1e4, -1e4, -1e4, 1e4, 1e4, 1e4], (9, 1))
    assert tlas.too_large(np.concatenate([small, large[:8]])).tolist() == [False] * 100 + [True] * 8
    assert not tlas.too_large(np.concatenate([small, large])).any()
    assert not tlas.too_large(np.concatenate([small[:5], large[:2]])).any()  # one node holds them
    assert not tlas.too_large(small).any()
