"""Rays that start close to a surface: the float32 filter rejects the surface they leave, or defers to double precision."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.bench import meshes
from maquette.render.types import Ray

from ...tables import matrix, mesh, scene
from ...tracing import same

MADE = meshes.knot(60, 20)  # inside of the unit sphere
PLACES = {"as it is": np.eye(4), "far away": matrix((1e5, -3e4, 2e5)), "tiny": np.diag([1e-3, -1e-3, 1e-3, 1.0])}
SHAPES = {
    "a knot": (MADE.positions.astype(np.float64), MADE.triangles),
    "needles": (MADE.positions.astype(np.float64) * [1.0, 1e-3, 1.0], MADE.triangles),
}
GAPS = np.array([0.0, 1e-15, 1e-9, 1e-7, 1e-6, 3e-6, 1e-5, 1e-4, 1e-2])


def leaving(positions, triangles, spread, seed=3):
    """(rays that start close to triangles on either side, sixteen from each triangle, `spread` apart; their distances)."""
    random = np.random.default_rng(seed)
    n = 16 * 250
    corners = positions[triangles[np.repeat(random.integers(0, len(triangles), n // 16), 16)]]
    weights = random.dirichlet([1.0, 1.0, 1.0], n // 16).repeat(16, axis=0) + spread * random.normal(size=(n, 3))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    gap = np.repeat(random.choice(GAPS, n // 16) * random.choice([-1.0, 1.0], n // 16), 16)
    towards = random.normal(size=(n // 16, 3)).repeat(16, axis=0) + spread * random.normal(size=(n, 3))
    return np.einsum("nk,nkj->nj", weights, corners) + gap[:, None] * normal, towards


@pytest.mark.long
@pytest.mark.parametrize("spread", [1e-4, 0.3], ids=["as packets", "each by itself"])
@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES.keys())
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES.keys())
def test_rays_that_leave_a_surface_match_brute_force(shape, place, spread):
    positions, triangles = shape
    o, d = leaving(positions, triangles, spread)
    o, d = o @ place[:3, :3].T + place[:3, 3], d @ place[:3, :3].T
    tables = scene(meshes=[(mesh(positions, triangles), place, 0)])
    n = len(o)
    ray = Ray(tuple(o.T), tuple(d.T), np.zeros(n), np.full(n, np.inf), None)
    distances = same(tables, ray)[0]
    assert 0.1 * n < np.isfinite(distances).sum()
