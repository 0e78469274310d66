"""What rays meet, by trees in kernels and by brute force in numpy, and that both say the same; meshes and rays to try them on."""

from __future__ import annotations

import numpy as np
from maquette.compiler import ir
from maquette.compiler.rows import MeshData
from maquette.render import bvh, trace
from maquette.render.handles import Handle
from maquette.render.kernels import kernel
from maquette.render.records import Ray

from .tables import rays


@kernel
def in_kernel(accel, tables, columns, bit, t, instance, primitive, u, v, blocked):
    for k in range(columns.shape[1]):
        c = columns[:, k]
        ray = Ray((c[0], c[1], c[2]), (c[3], c[4], c[5]), c[6], c[7])
        t[k], instance[k], primitive[k], u[k], v[k] = trace.closest(accel, tables, ray, True, bit)
        blocked[k] = trace.occluded(accel, tables, ray, True)


def through_trees(tables: ir.Tables, ray: Ray, bit: int = 1, brute: bool = False) -> tuple[np.ndarray, ...]:
    """(t, instance, primitive, u, v, blocked) by kernels."""
    n = len(ray.t_min)
    t, u, v = np.empty((3, n))
    instance, primitive = np.empty((2, n), np.int64)
    blocked = np.empty(n, bool)
    packed = Handle(bvh.build(tables, brute)), Handle(tables)  # kept until the kernel is done
    in_kernel(*packed, np.stack([*ray.origin, *ray.direction, ray.t_min, ray.t_max]), bit, t, instance, primitive, u, v, blocked)
    return t, instance, primitive, u, v, blocked


def by_brute_force(tables: ir.Tables, ray: Ray, bit: int = 1) -> tuple[np.ndarray, ...]:
    active = np.ones(len(ray.t_min), bool)
    hit = trace.closest(trace.Brute(), tables, ray, active, bit)
    return (*hit, trace.occluded(trace.Brute(), tables, ray, active))


def same(tables: ir.Tables, ray: Ray, bit: int = 1) -> tuple[np.ndarray, ...]:
    """What rays meet, after trees, a loop in a kernel and numpy have agreed to the last bit."""
    expected = by_brute_force(tables, ray, bit)
    for brute in (False, True):
        for found, wanted in zip(through_trees(tables, ray, bit, brute), expected, strict=True):
            np.testing.assert_array_equal(found, wanted)
    return expected


def random_rays(n: int, seed: int, reach: float = 7.0) -> Ray:
    rng = np.random.default_rng(seed)
    return rays(rng.uniform(-reach, reach, (n, 3)), rng.normal(size=(n, 3)))


def wavy(cells: int, seed: int = 0) -> MeshData:
    """A square of 2 · cells² triangles over -1 … 1 with a random height."""
    rng = np.random.default_rng(seed)
    line = np.linspace(-1, 1, cells + 1)
    x, z = np.meshgrid(line, line, indexing="ij")
    points = np.stack([x, rng.uniform(-0.2, 0.2, x.shape), z], axis=-1).reshape(-1, 3)
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    return MeshData(points, np.concatenate([np.stack([i, i + 1, i + cells + 2], 1), np.stack([i, i + cells + 2, i + cells + 1], 1)]))
