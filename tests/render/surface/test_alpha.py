"""Opacity: hits, transmittance, thresholds and layers; BVH, numpy and closed forms agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, LightData, MaterialData, MeshAttribute, TextureData, lambert
from maquette.render.accel import intersect, ray_queries
from maquette.render.accel.traverse import motion_alpha

from ..closed import K
from ..geometry.test_analytic_shapes import SHAPES
from ..tables import OPTIONS, first_hit, grey, matrix, mesh, radiance, radiance_in_kernel, scene, turn
from ..tables import rays as lanes_of
from ..tracing import random_rays, same

CHECKED = TextureData(ir.TextureKind.CHECKER, size=0.3, channel=0)
FADING = TextureData(ir.TextureKind.STRIPES, size=0.2, channel=0, color_a=(1.0, 0, 0), color_b=(0.25, 0, 0))
SQUARE = [[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], [[0, 2, 1], [0, 3, 2]]
UV = MeshAttribute(np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float))


def veil(opacity: Input | float, threshold: float = 0.0, albedo: float = 1.0) -> MaterialData:
    """A white diffuse material with an opacity."""
    inputs = {**lambert(grey(albedo)).inputs, ir.Slot.OPACITY: opacity if isinstance(opacity, Input) else Input.number(opacity)}
    return MaterialData(ir.MaterialModel.LAMBERT, inputs, threshold=threshold)


def textured(builder) -> list[MaterialData]:
    """Materials by number: opaque, checkered, striped from 1 to 1/4, the same with a threshold of 1/2, and half transparent."""
    checked, fading = builder.texture(CHECKED), builder.texture(FADING)
    return [
        lambert(grey(1.0)), veil(Input.number(1.0, checked)), veil(Input.number(1.0, fading)), veil(Input.number(1.0, fading), 0.5),
        veil(0.5),
    ]  # fmt: skip


def everything(seed: int) -> ir.Tables:
    """Every shape and a mesh in every material, anywhere."""
    random = np.random.default_rng(seed)

    def place() -> np.ndarray:
        return matrix(random.uniform(-4, 4, 3), np.linalg.qr(random.normal(size=(3, 3)))[0] * random.uniform(0.3, 2))

    shapes = [(kind, parameters, place(), material) for kind, parameters in SHAPES.values() for material in range(5)]
    meshes = [(mesh(*SQUARE, uvs=UV), place(), material) for material in range(5) for _ in range(4)]
    return scene(shapes, meshes, prepare=textured)


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_bvh_and_brute_force_agree_on_all_shapes(seed):
    """Bit for bit: both evaluate opacity at the same points, by the same function."""
    t = same(everything(seed), random_rays(3000, seed))[0]
    assert 0.3 < np.mean(np.isfinite(t)) < 1


@pytest.mark.long
def test_transmittances_agree():
    tables, ray = everything(5), random_rays(2000, 6)
    active = np.ones(2000, bool)
    expected = intersect.transmittance(intersect.Brute(), tables, ray, active)
    accel = ray_queries.build(tables)
    what = np.stack(ray.origin, axis=1), np.stack(ray.direction, axis=1)
    shares = ray_queries.transmittance(accel, *what)
    np.testing.assert_allclose(shares, expected, rtol=1e-14, atol=0)
    assert len(np.unique(expected)) > 5
    np.testing.assert_array_equal(ray_queries.occluded(accel, *what), expected == 0)


def test_holes_are_not_hit():
    """A checker over a square: a ray hits it in the opaque cells."""
    tables = scene(meshes=[(mesh(*SQUARE, uvs=UV), matrix(), 0)], prepare=lambda b: [veil(Input.number(1.0, b.texture(CHECKED)))])
    places = np.random.default_rng(1).uniform(-1, 1, (4000, 2))
    ray = lanes_of(np.stack([places[:, 0], np.ones(4000), places[:, 1]], axis=1), [0, -1, 0])
    t = same(tables, ray)[0]
    cells = np.floor((places + 1) / 0.3).astype(int).sum(axis=1)
    inner = (np.abs((places + 1) / 0.3 - np.rint((places + 1) / 0.3)) > 1e-9).all(axis=1)
    np.testing.assert_array_equal(np.isfinite(t)[inner], (cells % 2 == 0)[inner])


def panes(count: int, material: MaterialData, behind: bool = True) -> ir.Tables:
    """Square panes over a floor, one above the other, lit from straight above."""
    placed = [(K.RECTANGLE, [2, 2], matrix((0, 1 + k, 0)), 0) for k in range(count)] + ([(K.PLANE, [], matrix(), 1)] if behind else [])
    sun = LightData(ir.LightKind.DIRECTIONAL, grey(np.pi))
    return scene(placed, materials=[material, lambert(grey(1.0))], lights=[sun])


@pytest.mark.parametrize("count", [1, 3, 7])
@pytest.mark.parametrize("bounces", [0, 2])
def test_panes_over_a_floor(count, bounces):
    """Pane k of opacity a gets (1 − a)ᵏ of the light, and that share is seen: L = Σ a (1 − a)²ᵏ + (1 − a)²ⁿ for k = 0 … n − 1."""
    a = 0.3
    tables = panes(count, veil(a))
    expected = sum(a * (1 - a) ** (2 * k) for k in range(count)) + (1 - a) ** (2 * count)
    ray = lanes_of([0.1, 50, 0.2], [0, -1, 0])
    for draw in (radiance, radiance_in_kernel):
        rgb, alpha = draw(tables, ray, OPTIONS._replace(bounces=bounces, layers=8))
        assert rgb[0, 0] == pytest.approx(np.full(3, expected), rel=1e-12)
        assert alpha[0, 0] == 1


@pytest.mark.parametrize("count", [1, 4])
def test_coverage_of_panes_before_nothing(count):
    ray = lanes_of([0.1, 50, 0.2], [0, -1, 0])
    for draw in (radiance, radiance_in_kernel):
        alpha = draw(panes(count, veil(0.25), behind=False), ray, OPTIONS._replace(layers=8))[1]
        assert alpha[0, 0] == pytest.approx(1 - 0.75**count, rel=1e-12)


@pytest.mark.long
def test_layers_beyond_the_queue_are_passed_at_random():
    """Forty mirroring panes: the mean of many samples equals the result with an unlimited ray queue."""
    count, samples = 40, 4000
    mirroring = veil(0.05)
    mirroring = replace(mirroring, model=ir.MaterialModel.PHONG, inputs={**mirroring.inputs, ir.Slot.REFLECTION: Input(grey(0.5))})
    tables, ray = panes(count, mirroring), lanes_of([0.1, 90, 0.2], [0, -1, 0])
    expected = radiance_in_kernel(tables, ray, OPTIONS._replace(bounces=1, layers=count))[0][0, 0, 0]
    rgb, _ = radiance_in_kernel(tables, ray, OPTIONS._replace(bounces=1, layers=8), samples)
    error = rgb[:, 0, 0].std() / np.sqrt(samples)
    assert 0 < error < 0.01 * expected
    assert abs(rgb[:, 0, 0].mean() - expected) < 4 * error


def test_a_threshold_is_all_or_nothing():
    ray = lanes_of([0.1, 50, 0.2], [0, -1, 0])
    for opacity, is_hit in ((0.4, False), (0.5, True), (0.7, True)):
        hit = first_hit(panes(1, veil(opacity, 0.5), behind=False), ray)
        assert bool(np.isfinite(hit.t[0])) == is_hit
        rgb, alpha = radiance_in_kernel(panes(1, veil(opacity, 0.5), behind=False), ray, OPTIONS._replace(layers=8))
        assert (rgb[0, 0, 0], alpha[0, 0]) == ((1, 1) if is_hit else (0, 0))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_rotated_and_scaled_instances_with_holes(seed):
    random = np.random.default_rng(seed)
    linear = turn(1, random.uniform(0, 6)) @ np.diag(random.uniform(0.2, 3, 3)) * np.array([1, -1, 1])
    tables = scene([(K.SPHERE, [1], matrix((1, 0, 0), linear), 1), (K.BOX, [1, 1, 1], matrix((-1, 0, 0), linear), 3)], prepare=textured)
    same(tables, random_rays(400, seed % 1000, 3.0))


def test_opaque_scenes_have_no_motion_alpha_bvh():
    assert not motion_alpha.is_used(ray_queries.build(scene([(K.SPHERE, [1], matrix(), 0)])).type)
    assert motion_alpha.is_used(ray_queries.build(panes(1, veil(0.5))).type)
