"""Shadow rays by the array, sorted by where they begin: what each is told is what it is told by itself."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.bench import meshes
from maquette.compiler.ir import GeometryKind as K
from maquette.render import simd
from maquette.render.accel import ray_queries, ray_sort
from maquette.render.accel.ray_sort import BLOCK
from maquette.render.accel.traverse import ray_box, two_level
from maquette.render.jit.kernel import kernel
from maquette.render.jit.packed_struct import Handle
from maquette.render.lanes import crosslane
from numpy.typing import NDArray

from ..tables import matrix, mesh, scene

F64 = NDArray[np.float64]
KNOT = meshes.knot(60, 20)


def crowd(place: F64) -> Handle:
    """Trees of a thousand small knots."""
    made = mesh(KNOT.positions.astype(np.float64), KNOT.triangles)
    places = [place @ np.vstack([each, [0.0, 0.0, 0.0, 1.0]]) for each in meshes.boulders(1000)]
    accel = ray_queries.trees(scene(meshes=[(made, each, 0) for each in places]), keep=False)
    assert len(accel.tables.top.links) > two_level.SMALL
    return accel


def shot(n: int, place: F64) -> tuple[F64, F64]:
    """Origins and directions of rays from places that are seen from one point, as those to a lamp are."""
    random = np.random.default_rng(7)
    o = random.uniform(-1.0, 1.0, (n, 3))
    return o @ place[:3, :3].T + place[:3, 3], ([2.0, 3.0, 1.5] - o) @ place[:3, :3].T


@kernel
def sorted_rows(origin, first, n, found):
    rows = simd.stack_array(np.int64, BLOCK)
    ray_sort.order(origin, first, n, rows)
    for k in range(len(found)):
        found[k] = simd.read(rows, k)


@pytest.mark.parametrize("n", [1, 2, crosslane.WIDTH, 100, BLOCK])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_each_row_comes_once_and_the_last_fills_up(n, kind):
    origin = np.random.default_rng(n).normal(size=(n + 7, 3)).astype(kind)
    found = np.zeros(-(-n // (2 * crosslane.WIDTH)) * 2 * crosslane.WIDTH, np.int64)
    sorted_rows(origin, 5, n, found)
    assert sorted(found[:n]) == list(range(5, 5 + n))
    assert (found[n:] == found[n - 1]).all()


def test_neighbours_are_near_each_other():
    random = np.random.default_rng(3)
    origin = random.uniform(size=(BLOCK, 3))
    found = np.zeros(BLOCK, np.int64)
    sorted_rows(origin, 0, BLOCK, found)
    apart = np.linalg.norm(np.diff(origin[found], axis=0), axis=1).mean()
    assert apart < 0.4 * np.linalg.norm(np.diff(origin, axis=0), axis=1).mean()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_places_without_order_are_rows_too(bad):
    origin = np.random.default_rng(1).normal(size=(64, 3))
    origin[::5, 1] = bad
    found = np.zeros(64, np.int64)
    sorted_rows(origin, 0, 64, found)
    assert sorted(found) == list(range(64))


@pytest.mark.parametrize("n", [1, BLOCK - 1, BLOCK, BLOCK + 1, 3000])
def test_any_number_of_rays(n):
    accel = crowd(np.eye(4))
    o, d = shot(n, np.eye(4))
    np.testing.assert_array_equal(ray_queries.occluded(accel, o, d, 0.0, 1.0), ray_queries.closest(accel, o, d, 0.0, 1.0).instance >= 0)


@pytest.mark.parametrize("place", [np.eye(4), matrix((1e5, -3e4, 2e5)), np.diag([1e-3, 1e-3, 1e-3, 1.0])], ids=["as it is", "far", "tiny"])
def test_rays_that_end_or_begin_about_where_they_meet_something(place):
    """What counts is t_min < t < t_max, however close t is to these, and at edges, where single precision tells nothing."""
    accel = crowd(place)
    o, d = shot(4000, place)
    met = ray_queries.closest(accel, o, d)
    hit = np.flatnonzero(met.instance >= 0)
    assert len(hit) > 1000
    o, d, t = o[hit], d[hit], met.t[hit]
    for off in (0.0, 1e-16, 1e-12, 1e-8, 1e-6, 1e-4):
        for t_min, t_max in ((0.0, t * (1.0 + off)), (0.0, t * (1.0 - off)), (t * (1.0 - off), np.inf), (t * (1.0 + off), np.inf)):
            blocked = ray_queries.occluded(accel, o, d, t_min, t_max)
            np.testing.assert_array_equal(blocked, ray_queries.closest(accel, o, d, t_min, t_max).instance >= 0)


@kernel
def together(accel, origin, direction):
    """Of how many pairs of vectors of rays all go one way."""
    found = 0
    for start in range(0, len(origin), 2 * crosslane.WIDTH):
        d = crosslane.load_rows3(direction, start)
        d = crosslane.joined3(d, crosslane.load_rows3(direction, start + crosslane.WIDTH))
        o = crosslane.load_rows3(origin, start)
        o = crosslane.joined3(o, crosslane.load_rows3(origin, start + crosslane.WIDTH))
        all_ = d[0] == d[0]
        found += two_level.is_narrow(ray_box.world_ray(o, d), d, all_, crosslane.bits(all_))
    return found


@pytest.mark.skipif(crosslane.WIDTH < 4, reason="there are no bundles")
@pytest.mark.parametrize("spread", [1e-4, 0.01, 0.2])
def test_pairs_of_vectors_among_many_things_of_all_kinds(spread):
    """Shadow rays that go one way do so two vectors at a time: meshes meet both at once, other shapes one after the other."""
    random = np.random.default_rng(2)
    places = [np.vstack([each, [0.0, 0.0, 0.0, 1.0]]) for each in meshes.boulders(1200)]
    kinds = [(K.SPHERE, [0.7]), (K.BOX, [0.5, 0.4, 0.6]), (K.TORUS, [0.6, 0.2]), (K.CYLINDER, [0.4, 0.7])]
    made = mesh(KNOT.positions.astype(np.float64), KNOT.triangles)
    shapes = [(kind, numbers, each, 0) for (kind, numbers), each in zip(kinds * 200, places, strict=False)]
    tables = scene(shapes, meshes=[(made, each, 0) for each in places[800:]])
    accel = ray_queries.trees(tables, keep=False)
    assert len(accel.tables.top.links) > two_level.SMALL
    n = 16 * 400
    o = np.repeat(random.uniform(-1.0, 1.0, (n // 16, 3)), 16, axis=0) + spread * random.uniform(-1.0, 1.0, (n, 3))
    d = [2.0, 3.0, 1.5] - o
    pairs = n // (2 * crosslane.WIDTH)
    assert together(accel, o, d) > 0.9 * pairs if spread < 0.1 else together(accel, o, d) < 0.1 * pairs
    t_max = random.choice([-1.0, 0.3, 1.0, np.inf], n)
    blocked, met = ray_queries.occluded(accel, o, d, 0.0, t_max), ray_queries.closest(accel, o, d, 0.0, t_max)
    np.testing.assert_array_equal(blocked, met.instance >= 0)
    assert (np.bincount(tables.geometries.kind[tables.instances.geometry[met.instance[blocked]]], minlength=3) > 20).sum() == 5


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_rays_from_nowhere_meet_nothing_and_disturb_nobody(bad):
    accel = crowd(np.eye(4))
    sound = ray_queries.occluded(accel, *shot(600, np.eye(4)), 0.0, 1.0)
    kept = np.arange(600) % 7 != 0
    for which in (0, 1):  # origins, directions
        ray = shot(600, np.eye(4))
        ray[which][::7] = bad
        blocked = ray_queries.occluded(accel, *ray, 0.0, 1.0)
        assert not blocked[::7].any()
        np.testing.assert_array_equal(blocked[kept], sound[kept])


@pytest.mark.parametrize("length", [0.0, 1e-300, 1e-40, 1e40, 1e300])
@pytest.mark.parametrize("alone", [True, False])
def test_rays_without_a_direction_meet_nothing_and_disturb_nobody(length, alone):
    made = mesh(KNOT.positions.astype(np.float64), KNOT.triangles)
    accel = ray_queries.trees(scene(meshes=[(made, np.eye(4), 0)]), keep=False) if alone else crowd(np.eye(4))
    o, d = shot(600, np.eye(4))
    sound = ray_queries.closest(accel, o, d).t
    d[::7] *= length
    kept = np.arange(600) % 7 != 0
    met, blocked = ray_queries.closest(accel, o, d).t, ray_queries.occluded(accel, o, d)
    assert (met[::7] == np.inf).all()
    assert not blocked[::7].any()
    np.testing.assert_array_equal(met[kept], sound[kept])
    np.testing.assert_array_equal(blocked[kept], sound[kept] < np.inf)


@pytest.mark.parametrize("length", [1e-18, 1e-6, 1e6, 1e18])
def test_directions_may_have_any_length(length):
    accel = crowd(np.eye(4))
    o, d = shot(600, np.eye(4))
    once, scaled = ray_queries.closest(accel, o, d), ray_queries.closest(accel, o, length * d)
    np.testing.assert_array_equal(once.instance, scaled.instance)
    np.testing.assert_allclose(scaled.t * length, once.t, rtol=1e-12)
