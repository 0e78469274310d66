"""Tight bounds of rotated instances: they hold all vertices, with no more margin than the boxes of leaves."""

from functools import partial

import numpy as np
import pytest
from maquette.bench import meshes
from maquette.render.accel import ray_queries, scene_bvh
from maquette.render.accel.traverse import instance_extent
from maquette.render.geometry.bounds import SLACK, world_bounds

COUNT = instance_extent.MIN_ROTATED + 8


@pytest.fixture(scope="module")
def knots():
    """A mesh far from its origin, with rotated, sheared and mirrored transforms."""
    knot = meshes.knot(200, 40)
    rng = np.random.default_rng(3)
    places = np.concatenate([rng.normal(size=(COUNT, 3, 3)), rng.normal(size=(COUNT, 3, 1)) * 100.0], axis=2)
    places[0, :, :3] = np.diag([2.0, -3.0, 0.5])  # its box is tight as it is
    return knot, places


def boxes_of(knot, places):
    """(world bounds, tight bounds, vertices in the world (instances, vertices, 3))."""
    tables = meshes.scene(knot, places).tables
    loose = world_bounds(tables)
    tree, roots, _ = scene_bvh.mesh_bvhs(tables, np.unique(tables.instances.geometry))
    close = loose.copy()
    which = np.arange(len(places))
    instance_extent.tighten_bounds(close, which, tree, roots[tables.instances.geometry], partial(scene_bvh.frames, tables), SLACK)
    points = tables.pools.positions.astype(np.float64) + tables.geometries.origin[tables.instances.geometry[0]]
    return loose, close, np.einsum("nij,vj->nvi", places[:, :, :3], points) + places[:, None, :, 3]


@pytest.mark.long
def test_tight_bounds_hold_all_vertices_and_little_more(knots) -> None:
    loose, close, corners = boxes_of(*knots)
    low, high = corners.min(axis=1), corners.max(axis=1)
    assert (close[:, :3] <= low).all()
    assert (close[:, 3:] >= high).all()
    volumes = [np.prod(high - low, axis=1), np.prod(close[:, 3:] - close[:, :3], axis=1), np.prod(loose[:, 3:] - loose[:, :3], axis=1)]
    assert np.median(volumes[1] / volumes[0]) < 1.3 < 1.8 < np.median(volumes[2] / volumes[0])
    assert (close[:, :3] >= loose[:, :3]).all()
    assert (close[:, 3:] <= loose[:, 3:]).all()
    assert np.array_equal(close[0], loose[0])


def test_few_instances_keep_world_bounds(knots) -> None:
    knot, places = knots
    loose, close, _ = boxes_of(knot, places[:5])
    assert np.array_equal(loose, close)


def test_hits_in_tight_bounds_match_brute_force(knots) -> None:
    knot, places = knots
    tables = meshes.scene(knot, places).tables
    rng = np.random.default_rng(8)
    origin, aim = rng.normal(size=(512, 3)) * 300.0, places[rng.integers(0, COUNT, 512), :, 3]
    with_tree = ray_queries.closest(ray_queries.build(tables, keep=False), origin, aim - origin)
    without = ray_queries.closest(ray_queries.build(tables, brute=True, keep=False), origin, aim - origin)
    assert (with_tree.instance >= 0).sum() > 50
    for a, b in zip(with_tree, without, strict=True):
        assert np.array_equal(a, b)
