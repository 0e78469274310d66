"""Hits by BVH in kernels and by brute force in numpy, checked against each other; meshes and rays for such tests."""

from __future__ import annotations

import numpy as np
from maquette.compiler import ir
from maquette.compiler.scene.row_records import MeshData
from maquette.render.accel import intersect
from maquette.render.accel import ray_queries as kernels
from maquette.render.types import Ray

from .tables import rays


def trace_kernels(tables: ir.Tables, ray: Ray, bit: int = 1, brute: bool = False) -> tuple[np.ndarray, ...]:
    """(t, instance, primitive, u, v, blocked) by kernels."""
    accel = kernels.build(tables, brute)
    what = np.stack(ray.origin, axis=1), np.stack(ray.direction, axis=1), ray.t_min, ray.t_max
    return (*kernels.closest(accel, *what, bit), kernels.occluded(accel, *what))


def by_brute_force(tables: ir.Tables, ray: Ray, bit: int = 1) -> tuple[np.ndarray, ...]:
    active = np.ones(len(ray.t_min), bool)
    hit = intersect.closest_hit(intersect.Brute(), tables, ray, active, bit)
    return (*hit, intersect.occluded(intersect.Brute(), tables, ray, active))


def same(tables: ir.Tables, ray: Ray, bit: int = 1) -> tuple[np.ndarray, ...]:
    """Hits of rays, after BVH, brute force in a kernel and numpy agreed bit for bit."""
    expected = by_brute_force(tables, ray, bit)
    for brute in (False, True):
        for column, expected_column in zip(trace_kernels(tables, ray, bit, brute), expected, strict=True):
            np.testing.assert_array_equal(column, expected_column)
    return expected


def random_rays(n: int, seed: int, reach: float = 7.0) -> Ray:
    rng = np.random.default_rng(seed)
    return rays(rng.uniform(-reach, reach, (n, 3)), rng.normal(size=(n, 3)))


def coherent_rays(n: int, seed: int, reach: float = 7.0, spread: float = 0.05) -> Ray:
    """Rays as `random_rays`, in coherent groups of eight."""
    rng = np.random.default_rng(seed)
    few = random_rays(-(-n // 8), seed, reach)

    def eight(x: np.ndarray) -> np.ndarray:
        return np.repeat(x, 8)[:n] + spread * rng.uniform(-1, 1, n)

    origin, direction = (tuple(eight(x) for x in v) for v in (few.origin, few.direction))
    return few._replace(origin=origin, direction=direction, t_min=np.zeros(n), t_max=np.full(n, np.inf))


def wavy(cells: int, seed: int = 0) -> MeshData:
    """A square of 2 · cells² triangles over -1 … 1 with a random height."""
    rng = np.random.default_rng(seed)
    line = np.linspace(-1, 1, cells + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    points = np.stack([x, rng.uniform(-0.2, 0.2, x.shape), z], axis=-1).reshape(-1, 3)
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    return MeshData(points, np.concatenate([np.stack([i, i + 1, i + cells + 2], 1), np.stack([i, i + cells + 2, i + cells + 1], 1)]))
