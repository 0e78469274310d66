"""Ray hits of solids in closed form: the same as by interval bounds, entering and leaving, also where parts touch."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.render.accel import ray_queries
from maquette.render.formula import tables as formula_tables

from .test_surfaces import scene_of, some_rays

SOLIDS = {
    "box and hole": "difference { box([1.2, 0.8, 1]); cylinder(0.3, 4); sphere(0.5, center: [0.6, 0.4, 0.5]) }",
    "many holes": "difference { box(2); for (k in 0..7) { rotate([0, k * 45deg, 0]) { cylinder(0.15, 4, center: [0.75, 0, 0]) } } }",
    "tori": "difference { union { cone(0.9, 1.4); torus(0.8, 0.2) }; torus(0.5, 0.2, rotate: [40deg, 0, 10deg], scale: 1.1) }",
    "touching": "union { box(1); box(1, center: [1, 0, 0]); cylinder(0.5, 1, center: [0, 1, 0]) }",
    "hollow": "shell(0.1) { box(1, rotate: [20deg, 30deg, 0]); cylinder(0.3, 2) }",
    "saddle": "implicit(|x, y, z| x * y <= z, within: sphere(1.2))",
    "sheet": "implicit(|x, y, z| x^2 + y^2 == 0.4 + 0.3 * z^2, within: 1)",
}


@pytest.mark.parametrize("name", SOLIDS)
def test_hits_are_the_same_as_by_bounds(tmp_path, name):
    tables = scene_of(tmp_path, SOLIDS[name]).tables
    o, d = some_rays(4000, 5)
    trees = ray_queries.build(tables)
    assert (trees.tables.forms.parts.places[:, 1] > 0).all()
    first, other = ray_queries.closest(trees, o, d), ray_queries.closest(ray_queries.build(tables, closed=False), o, d)
    hit = np.isfinite(first.t)
    assert 500 < hit.sum() < 4000
    assert np.array_equal(hit, np.isfinite(other.t))
    assert np.abs(first.t[hit] - other.t[hit]).max() < 1e-11
    n, m = (_normals(which.u[hit], which.v[hit]) for which in (first, other))
    assert np.quantile(np.abs(n - m).max(axis=1), 0.999) < 1e-6  # at an edge, the normal of either side
    assert (first.primitive[hit] < 400).all()


def _normals(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Decode the octahedral map."""
    z = 1 - abs(u) - abs(v)
    x = np.where(z < 0, (1 - abs(v)) * np.where(u < 0, -1, 1), u)
    y = np.where(z < 0, (1 - abs(u)) * np.where(v < 0, -1, 1), v)
    n = np.stack([x, y, z], axis=1)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def test_chords_of_rays_give_the_volume(tmp_path):
    """∫ Σ (leaving − entering) over parallel rays: a box without a drilled hole. Each hit is the origin of the next ray."""
    tables = scene_of(tmp_path, "difference { box([1.2, 1, 0.8]); cylinder(0.3, 4) }").tables
    trees, n = ray_queries.build(tables), 260  # 5 mm a ray: edges of the box lie between rays
    g = (np.arange(n) + 0.5) / n * 1.3 - 0.65
    o = np.stack([a.ravel() for a in np.meshgrid(g, g)] + [np.full(n * n, 2.0)], axis=1)
    d = np.tile([0.0, 0.0, -1.0], (n * n, 1))
    first, total, inside = np.zeros(n * n), np.zeros(n * n), np.zeros(n * n, bool)
    for _ in range(6):
        t = ray_queries.closest(trees, o, d, first).t
        hit = np.isfinite(t)
        total += np.where(hit & inside, t - first, 0.0)
        first, inside = np.where(hit, t + 1e-12, 9.0), hit & ~inside
    assert np.isinf(t).all()
    volume = 1.2 * 1 * 0.8 - math.pi * 0.3**2 * 1
    assert total.sum() * (1.3 / n) ** 2 == pytest.approx(volume, rel=1e-3)


def test_a_thin_torus_from_far_away(tmp_path):
    """R = 1, r = 0.01 from 10⁴; every ray that enters leaves, and hits are on the surface."""
    tables = scene_of(tmp_path, "union { torus(1, 0.01, rotate: [30deg, 0, 20deg]) }").tables
    trees = ray_queries.build(tables)
    random = np.random.default_rng(6)
    o = random.normal(size=(4000, 3))
    o *= 1e4 / np.linalg.norm(o, axis=1, keepdims=True)
    angle = random.uniform(0, 2 * math.pi, 4000)
    aim = np.stack([np.cos(angle), random.uniform(-0.012, 0.012, 4000), np.sin(angle)], axis=1)
    x, z = math.radians(30), math.radians(20)
    turn = np.array([[math.cos(z), -math.sin(z), 0], [math.sin(z), math.cos(z), 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, math.cos(x), -math.sin(x)], [0, math.sin(x), math.cos(x)]]
    )
    d = aim @ turn.T - o
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    t, count = np.zeros(4000), np.zeros(4000, int)
    for _ in range(5):
        distance = ray_queries.closest(trees, o, d, t).t
        hit = np.isfinite(distance)
        count += hit
        p = (o[hit] + distance[hit, None] * d[hit]) @ turn
        assert np.abs(np.hypot(np.hypot(p[:, 0], p[:, 2]) - 1, p[:, 1]) - 0.01).max(initial=0) < 1e-10
        t = np.where(hit, distance + 1e-10, 3e4)
    assert (count % 2 == 0).all()
    assert (count > 0).sum() > 2000


def test_a_scene_with_closed_forms_and_other_surfaces(tmp_path):
    sharp = "union { box(0.8, center: [-0.5, 0, 0]); sphere(0.3) }"
    both = f"{sharp}\nunion(round: 0.1) {{ box(0.4, center: [0.6, 0, 0]); sphere(0.25, center: [0.6, 0.2, 0]) }}"
    tables = scene_of(tmp_path, both).tables
    o, d = some_rays(1000, 9)
    trees = ray_queries.build(tables)
    assert formula_tables.have_cells(trees.tables.forms).sum() == 1
    first, other = ray_queries.closest(trees, o, d), ray_queries.closest(ray_queries.build(tables, closed=False), o, d)
    assert np.array_equal(first.instance, other.instance)
    assert np.abs(first.t[first.instance >= 0] - other.t[first.instance >= 0]).max() < 1e-11
