"""Refitted BVHs: hits, rebuilds of bad ones, caching."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.render.accel.bvh_build import refit, tree_cache, wide_bvh
from maquette.render.accel.bvh_build.wide_bvh import EMPTY, WIDTH

from ...tables import matrix, scene
from ...tracing import coherent_rays, random_rays, same, wavy


@pytest.fixture(autouse=True)
def _forgotten():
    tree_cache.clear()
    yield
    tree_cache.clear()


def corners(cells: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    mesh = wavy(cells, seed)
    return mesh.positions.astype(np.float32), mesh.triangles.astype(np.int32)


def test_a_refit_to_the_same_vertices_is_identical():
    positions, triangles = corners(20, 1)
    tree = wide_bvh.build(positions, triangles)
    again = refit.refit(tree, positions, triangles)
    for a, b in zip(tree, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert refit.cost(again) == refit.cost(tree) > 1


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_boxes_enclose_their_subtrees(seed):
    random = np.random.default_rng(seed)
    positions, triangles = corners(8, 2)
    moved = (positions * random.uniform(0.1, 10, 3) + random.normal(size=positions.shape) * random.uniform(0, 0.3)).astype(np.float32)
    tree = refit.refit(wide_bvh.build(positions, triangles), moved, triangles)
    assert sorted(tree.rows[tree.rows >= 0].tolist()) == list(range(len(triangles)))
    planes = tree.nodes.reshape(-1, 3, 2, WIDTH)
    for node, i in np.argwhere(tree.links > EMPTY):
        link = tree.links[node, i]
        if link < 0:
            inner = moved[triangles[tree.rows[~link][tree.rows[~link] >= 0]]].reshape(-1, 3)
            low, high = inner.min(axis=0), inner.max(axis=0)
        else:
            used = tree.links[link] > EMPTY
            low, high = planes[link, :, 0, used].min(axis=0), planes[link, :, 1, used].max(axis=0)
        assert (planes[node, :, 0, i] <= low).all()
        assert (planes[node, :, 1, i] >= high).all()


@pytest.mark.long
@pytest.mark.parametrize("how", [0.02, 0.2])
def test_hits_match_brute_force(monkeypatch, how):
    """Bit for bit, with small and, where it would be rebuilt, large moves of vertices."""
    monkeypatch.setattr(refit, "MAX_COST_RATIO", np.inf)
    mesh = wavy(16, 3)
    same(scene(meshes=[(mesh, matrix(), 0)]), random_rays(64, 1))
    built = []
    monkeypatch.setattr(wide_bvh, "build", lambda *a: built.append(a))
    bent = mesh.positions + how * np.random.default_rng(4).normal(size=mesh.positions.shape)
    tables = scene(meshes=[(type(mesh)(bent, mesh.triangles), matrix(), 0)])
    same(tables, random_rays(3000, 5, 2.0))
    same(tables, coherent_rays(2000, 6, 2.0))
    assert not built


def test_a_bad_refit_is_rebuilt():
    positions, triangles = corners(24, 5)
    first = tree_cache.cached_mesh_bvh(positions, triangles)
    bent = (positions + 0.001).astype(np.float32)
    assert (tree_cache.cached_mesh_bvh(bent, triangles).links == first.links).all()
    shuffled = np.random.default_rng(6).permutation(positions).astype(np.float32)  # every triangle now goes across everything
    refitted, built = refit.refit(first, shuffled, triangles), wide_bvh.build(shuffled, triangles)
    assert refit.cost(refitted) > refit.MAX_COST_RATIO * refit.cost(first)
    cached = tree_cache.cached_mesh_bvh(shuffled, triangles)
    for a, b in zip(cached, built, strict=True):
        np.testing.assert_array_equal(a, b)
    assert tree_cache.cached_mesh_bvh(shuffled, triangles) is cached
