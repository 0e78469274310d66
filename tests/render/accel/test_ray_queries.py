"""Queries for arrays of rays: a ray's result depends neither on the other rays of the array nor on their order."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.bench import meshes
from maquette.compiler.ir import GeometryKind as K
from maquette.render.accel import ray_queries
from maquette.render.accel.traverse import packet, packet_nodes, ray_box, two_level
from maquette.render.jit.kernel import kernel
from maquette.render.jit.packed_struct import Handle
from maquette.render.lanes import affine, crosslane, ops
from numpy.typing import NDArray

from ..tables import matrix, mesh, scene

F64 = NDArray[np.float64]
COUNT = 16 * 500
MADE = meshes.knot(200, 40)  # inside of the unit sphere
KNOT = meshes.knot(60, 20)
PLACES = {
    "as it is": np.eye(4),
    "far away": matrix((1e5, -3e4, 2e5)),
    "tiny, turned and mirrored": np.array([[0.0, 3e-4, 0.0, 0.1], [-2e-4, 0.0, 1e-4, 0.2], [0.0, 0.0, -3e-4, -0.1], [0, 0, 0, 1]]),
}


def single(place: F64) -> Handle:
    """The BVH of one mesh."""
    return ray_queries.build(scene(meshes=[(mesh(MADE.positions.astype(np.float64), MADE.triangles), place, 0)]), keep=False)


def crowd(place: F64) -> Handle:
    """The BVH of a thousand small knots."""
    knot = mesh(KNOT.positions.astype(np.float64), KNOT.triangles)
    places = [place @ np.vstack([each, [0.0, 0.0, 0.0, 1.0]]) for each in meshes.boulders(1000)]
    accel = ray_queries.build(scene(meshes=[(knot, each, 0) for each in places]), keep=False)
    assert len(accel.tables.top.links) > two_level.SMALL
    return accel


def aimed(place: F64, spread: float, at_edges: bool) -> tuple[F64, F64, F64, F64]:
    """(origins, directions, least and most t) of rays, sixteen by sixteen to places near each other, or to ends and middles of edges."""
    random = np.random.default_rng(5)
    few = random.integers(0, len(MADE.triangles), COUNT // 16)
    corners = MADE.positions[MADE.triangles[few]].astype(np.float64)
    eye = np.repeat(3.0 * random.normal(size=(COUNT // 16, 3)), 16, axis=0) + 1e-3 * random.normal(size=(COUNT, 3))
    aim = np.repeat(corners.mean(axis=1), 16, axis=0) + spread * random.normal(size=(COUNT, 3))
    if at_edges:
        share = random.choice([0.0, 0.5, 1.0], COUNT)[:, None]
        aim = np.repeat(corners[:, 0], 16, axis=0) * share + np.repeat(corners[:, 1], 16, axis=0) * (1.0 - share)
    least = np.where(np.arange(COUNT) % 48 < 16, random.uniform(0.0, 1.2, COUNT), 0.0)
    most = np.where(np.arange(COUNT) % 48 < 32, random.uniform(0.8, 1.5, COUNT), np.inf)
    d = (aim - eye) @ place[:3, :3].T
    return eye @ place[:3, :3].T + place[:3, 3], d, least, most


def shot(n: int, place: F64) -> tuple[F64, F64]:
    """Origins and directions of rays from places that are seen from one point, as those to a light are."""
    random = np.random.default_rng(7)
    o = random.uniform(-1.0, 1.0, (n, 3))
    return o @ place[:3, :3].T + place[:3, 3], ([2.0, 3.0, 1.5] - o) @ place[:3, :3].T


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES.keys())
@pytest.mark.parametrize(("spread", "at_edges"), [(1e-3, False), (0.02, False), (0.0, True)], ids=["near", "apart", "at edges"])
def test_each_ray_hits_what_it_hits_in_any_order(place, spread, at_edges):
    """In order, rays form packets; shuffled, each is traced alone."""
    rays, accel = aimed(place, spread, at_edges), single(place)
    order = np.random.default_rng(1).permutation(COUNT)
    origin, direction, least, most = rays
    shuffled = (origin[order], direction[order], least[order], most[order])
    hits = ray_queries.closest(accel, *rays)
    assert COUNT // 5 < (hits.instance >= 0).sum() < COUNT
    for column, shuffled_column in zip(hits, ray_queries.closest(accel, *shuffled), strict=True):
        np.testing.assert_array_equal(column[order], shuffled_column)
    np.testing.assert_array_equal(ray_queries.occluded(accel, *rays)[order], ray_queries.occluded(accel, *shuffled))


@pytest.mark.parametrize("n", [1, crosslane.WIDTH, crosslane.WIDTH + 1, 2 * crosslane.WIDTH - 1, 4 * crosslane.WIDTH + 3])
def test_any_number_of_rays_to_one_mesh(n):
    rays, accel = aimed(np.eye(4), 1e-3, False), single(np.eye(4))
    some, every = ray_queries.closest(accel, rays[0][:n], rays[1][:n], rays[2][:n], rays[3][:n]), ray_queries.closest(accel, *rays)
    assert len(some.t) == n
    for a, b in zip(some, every, strict=True):
        np.testing.assert_array_equal(a, b[:n])


@pytest.mark.long
@pytest.mark.parametrize("n", [1, 255, 256, 257, 3000])
def test_any_number_of_rays_among_many_instances(n):
    accel = crowd(np.eye(4))
    o, d = shot(n, np.eye(4))
    np.testing.assert_array_equal(ray_queries.occluded(accel, o, d, 0.0, 1.0), ray_queries.closest(accel, o, d, 0.0, 1.0).instance >= 0)


@kernel
def count_packets(accel, origin, direction, least, most):
    """How many vectors of rays are traced through mesh 0 as one packet."""
    count = 0
    for start in range(0, len(least), crosslane.WIDTH):
        o = affine.transform_point(accel.inverse, 0, crosslane.load_rows3(origin, start))
        o = ops.sub(o, (accel.origin[0, 0], accel.origin[0, 1], accel.origin[0, 2]))
        d = affine.transform_vector(accel.inverse, 0, crosslane.load_rows3(direction, start))
        t_max = crosslane.load_row(most, start)
        rays, active = two_level.enter_mesh(accel, 0, o, d, crosslane.load_row(least, start), t_max, t_max)
        if packet.is_coherent(active, d, rays.box):
            count += packet_nodes.intersect_mesh_packet(accel, 0, accel.instance_rows[0, 4], rays, active, False)[4]
        else:
            count += active == 0
    return count


@pytest.mark.long
@pytest.mark.skipif(crosslane.WIDTH < packet.MIN_RAYS, reason="there are no packets")
def test_rays_near_each_other_are_one_packet():
    near, apart = (count_packets(single(np.eye(4)), *aimed(np.eye(4), spread, False)) for spread in (1e-3, 0.3))
    assert apart < 0.5 * COUNT / crosslane.WIDTH < 0.9 * COUNT / crosslane.WIDTH < near


def sheets(gap: float, count: int = 96) -> tuple[F64, NDArray[np.int32]]:
    """(corners, triangles) of triangles one behind the other, a little askew."""
    random = np.random.default_rng(9)
    corners = np.array([[-1.0, -1.0, 0.0], [1.2, -0.9, 0.0], [0.1, 1.3, 0.0]]) + random.normal(scale=1e-3, size=(count, 3, 3))
    corners[:, :, 2] = gap * (np.arange(count)[:, None] + random.uniform(-0.2, 0.2, (count, 3)))
    return corners.astype(np.float32).astype(np.float64).reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


@pytest.mark.parametrize("spread", [1e-3, 0.5], ids=["as packets", "each by itself"])
@pytest.mark.parametrize("gap", [1e-6, 1e-3], ids=["closer than single precision tells", "apart"])
@pytest.mark.parametrize("towards", [1.0, -1.0], ids=["up", "down"])
def test_stretches_that_begin_and_end_in_triangles(gap, spread, towards):
    """From one sheet to another a ray hits what lies between, and not the two themselves: t_min < t < t_max."""
    corners, triangles = sheets(gap)
    tables = scene(meshes=[(mesh(corners, triangles), np.eye(4), 0)])
    accel = ray_queries.build(tables, keep=False)
    random = np.random.default_rng(4)
    n = 16 * 60
    middle = np.repeat(random.uniform(-0.1, 0.1, (n // 16, 3)), 16, axis=0) + 1e-4 * random.normal(size=(n, 3))
    d = np.repeat(random.normal(scale=0.2, size=(n // 16, 3)), 16, axis=0) + spread * random.uniform(-0.3, 0.3, (n, 3))
    d[:, 2] = towards
    o = middle - 0.5 * d + [0.0, 0.0, gap * 48]
    crossings = [np.zeros(n)]
    for _ in range(12):
        crossings.append(ray_queries.closest(accel, o, d, crossings[-1]).t)
    begin, end = crossings[4], crossings[9]
    assert np.isfinite(end).all()
    assert (np.diff(crossings, axis=0) > 0.0).all()
    for least, most, expected in (
        (begin, end, crossings[5]), (begin, crossings[5], np.full(n, np.inf)), (np.nextafter(begin, 0.0), end, begin),
        (begin, np.nextafter(crossings[5], np.inf), crossings[5]),
    ):  # fmt: skip
        np.testing.assert_array_equal(ray_queries.closest(accel, o, d, least, most).t, expected)
        np.testing.assert_array_equal(ray_queries.occluded(accel, o, d, least, most), np.isfinite(expected))


@pytest.mark.long
@pytest.mark.parametrize("place", [np.eye(4), matrix((1e5, -3e4, 2e5)), np.diag([1e-3, 1e-3, 1e-3, 1.0])], ids=["as it is", "far", "tiny"])
def test_rays_that_end_or_begin_about_where_they_hit_something(place):
    """What counts is t_min < t < t_max, however close t is to these, and at edges, where single precision tells nothing."""
    accel = crowd(place)
    o, d = shot(4000, place)
    hits = ray_queries.closest(accel, o, d)
    hit = np.flatnonzero(hits.instance >= 0)
    assert len(hit) > 1000
    o, d, t = o[hit], d[hit], hits.t[hit]
    for off in (0.0, 1e-16, 1e-12, 1e-8, 1e-6, 1e-4):
        for t_min, t_max in ((0.0, t * (1.0 + off)), (0.0, t * (1.0 - off)), (t * (1.0 - off), np.inf), (t * (1.0 + off), np.inf)):
            blocked = ray_queries.occluded(accel, o, d, t_min, t_max)
            np.testing.assert_array_equal(blocked, ray_queries.closest(accel, o, d, t_min, t_max).instance >= 0)


@kernel
def count_narrow(origin, direction):
    """How many vectors of rays are narrow."""
    count = 0
    for start in range(0, len(origin), crosslane.WIDTH):
        o, d = crosslane.load_rows3(origin, start), crosslane.load_rows3(direction, start)
        zero = 0.0 * d[0]
        rays = ray_box.SceneRays(o, d, zero, zero + np.inf, o, d, ray_box.world_ray(o, d))
        count += two_level.is_narrow(rays, crosslane.bits(d[0] == d[0]))
    return count


@pytest.mark.long
@pytest.mark.skipif(crosslane.WIDTH < 4, reason="there are no packets")
@pytest.mark.parametrize("spread", [1e-4, 0.01, 0.2])
def test_rays_among_many_instances_of_all_kinds(spread):
    """Narrow shadow rays are traced as packets: closest and any hits agree."""
    random = np.random.default_rng(2)
    places = [np.vstack([each, [0.0, 0.0, 0.0, 1.0]]) for each in meshes.boulders(1200)]
    kinds = [(K.SPHERE, [0.7]), (K.BOX, [0.5, 0.4, 0.6]), (K.TORUS, [0.6, 0.2]), (K.CYLINDER, [0.4, 0.7])]
    knot = mesh(KNOT.positions.astype(np.float64), KNOT.triangles)
    shapes = [(kind, numbers, each, 0) for (kind, numbers), each in zip(kinds * 200, places, strict=False)]
    tables = scene(shapes, meshes=[(knot, each, 0) for each in places[800:]])
    accel = ray_queries.build(tables, keep=False)
    assert len(accel.tables.top.links) > two_level.SMALL
    n = 16 * 400
    o = np.repeat(random.uniform(-1.0, 1.0, (n // 16, 3)), 16, axis=0) + spread * random.uniform(-1.0, 1.0, (n, 3))
    d = [2.0, 3.0, 1.5] - o
    vectors = n // crosslane.WIDTH
    assert count_narrow(o, d) > 0.9 * vectors if spread < 0.1 else count_narrow(o, d) < 0.1 * vectors
    t_max = random.choice([-1.0, 0.3, 1.0, np.inf], n)
    blocked, hits = ray_queries.occluded(accel, o, d, 0.0, t_max), ray_queries.closest(accel, o, d, 0.0, t_max)
    np.testing.assert_array_equal(blocked, hits.instance >= 0)
    assert (np.bincount(tables.geometries.kind[tables.instances.geometry[hits.instance[blocked]]], minlength=3) > 20).sum() == 5


def narrow_shot() -> tuple[F64, F64]:
    """Rays as `shot`, in groups of sixteen whose vectors are narrow."""
    o, d = shot(600, np.eye(4))
    return np.repeat(o, 16, axis=0), np.repeat(d, 16, axis=0) + 1e-4 * np.random.default_rng(8).normal(size=(16 * 600, 3))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize(
    ("build", "rays"), [(crowd, shot(600, np.eye(4))), (crowd, narrow_shot()), (single, shot(600, np.eye(4))), (single, narrow_shot())],
    ids=["crowd", "crowd, narrow", "single", "single, narrow"],
)  # fmt: skip
def test_rays_from_nowhere_hit_nothing_and_disturb_no_other_ray(build, rays, bad):
    accel, (o, d) = build(np.eye(4)), rays
    sound = ray_queries.closest(accel, o, d, 0.0, 1.0).t
    others = np.arange(len(sound)) % 7 != 0
    assert 10 < np.isfinite(sound).sum() < len(sound)
    for which in (0, 1):  # origins, directions
        ray = (o.copy(), d.copy())
        ray[which][::7] = bad
        t, blocked = ray_queries.closest(accel, *ray, 0.0, 1.0).t, ray_queries.occluded(accel, *ray, 0.0, 1.0)
        assert not blocked[::7].any()
        np.testing.assert_array_equal(t, np.where(others, sound, np.inf))
        np.testing.assert_array_equal(blocked, np.isfinite(t))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES.keys())
def test_inactive_rays_of_a_packet_disturb_no_other_ray(place, bad):
    """Beside rays from surfaces, a vector has lanes that hit no surface. Those start nowhere and end before they begin."""
    accel, (o, d, least, most) = single(place), aimed(place, 1e-3, False)
    sound, blocked = ray_queries.closest(accel, o, d, least, most), ray_queries.occluded(accel, o, d, least, most)
    assert COUNT // 5 < blocked.sum() < COUNT
    inactive = np.random.default_rng(3).random(COUNT) < 0.3
    most[inactive] = -np.inf
    for which in (0, 1):  # origins, directions
        rays = (o.copy(), d.copy())
        rays[which][inactive] = bad
        for expected, column in zip(sound, ray_queries.closest(accel, *rays, least, most), strict=True):
            np.testing.assert_array_equal(column[~inactive], expected[~inactive])
        np.testing.assert_array_equal(ray_queries.occluded(accel, *rays, least, most), blocked & ~inactive)


@pytest.mark.parametrize("length", [0.0, 1e-300, 1e-40, 1e40, 1e300])
@pytest.mark.parametrize("alone", [True, False])
def test_rays_without_a_direction_hit_nothing_and_disturb_no_other_ray(length, alone):
    knot = mesh(KNOT.positions.astype(np.float64), KNOT.triangles)
    accel = ray_queries.build(scene(meshes=[(knot, np.eye(4), 0)]), keep=False) if alone else crowd(np.eye(4))
    o, d = shot(600, np.eye(4))
    sound = ray_queries.closest(accel, o, d).t
    d[::7] *= length
    others = np.arange(600) % 7 != 0
    t, blocked = ray_queries.closest(accel, o, d).t, ray_queries.occluded(accel, o, d)
    assert (t[::7] == np.inf).all()
    assert not blocked[::7].any()
    np.testing.assert_array_equal(t[others], sound[others])
    np.testing.assert_array_equal(blocked[others], sound[others] < np.inf)


@pytest.mark.parametrize("length", [1e-18, 1e-6, 1e6, 1e18])
def test_directions_may_have_any_length(length):
    accel = crowd(np.eye(4))
    o, d = shot(600, np.eye(4))
    once, scaled = ray_queries.closest(accel, o, d), ray_queries.closest(accel, o, length * d)
    np.testing.assert_array_equal(once.instance, scaled.instance)
    np.testing.assert_allclose(scaled.t * length, once.t, rtol=1e-12)
