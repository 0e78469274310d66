"""Two vectors of rays as one bundle: what they meet of a mesh that stands alone is, to the last bit, what each meets by itself."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.bench import meshes
from maquette.render.accel import double_packet, ray_queries, scene_bvh
from maquette.render.accel.traverse import motion_alpha
from maquette.render.jit.kernel import helper, kernel
from maquette.render.jit.packed_struct import Handle
from maquette.render.lanes import crosslane
from maquette.render.types import Ray
from numpy.typing import NDArray

from ..tables import matrix, mesh, scene

F64 = NDArray[np.float64]
COUNT = 16 * 500
MADE = meshes.knot(200, 40)  # inside of the unit sphere
PLACES = {
    "as it is": np.eye(4),
    "far away": matrix((1e5, -3e4, 2e5)),
    "tiny, turned and mirrored": np.array([[0.0, 3e-4, 0.0, 0.1], [-2e-4, 0.0, 1e-4, 0.2], [0.0, 0.0, -3e-4, -0.1], [0, 0, 0, 1]]),
}


def trees(place: NDArray[np.float64], alone: bool) -> Handle:
    """Trees of a mesh, that say that it stands alone, or do not."""
    tables = scene(meshes=[(mesh(MADE.positions.astype(np.float64), MADE.triangles), place, 0)])
    built = scene_bvh.build(tables, keep=False)
    assert built.alone == 0
    accel = Handle(built if alone else built._replace(alone=-1))
    motion_alpha.link(accel)
    return accel


def aimed(place: NDArray[np.float64], spread: float, at_edges: bool) -> tuple[F64, F64, F64, F64]:
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


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES.keys())
@pytest.mark.parametrize(("spread", "at_edges"), [(1e-3, False), (0.02, False), (0.0, True)], ids=["near", "apart", "at edges"])
def test_each_ray_meets_what_it_meets_by_itself(place, spread, at_edges):
    asked = aimed(place, spread, at_edges)
    apart, together = trees(place, alone=False), trees(place, alone=True)
    met = ray_queries.closest(apart, *asked)
    assert COUNT // 5 < (met.instance >= 0).sum() < COUNT
    for one, other in zip(met, ray_queries.closest(together, *asked), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(ray_queries.occluded(apart, *asked), ray_queries.occluded(together, *asked))


@pytest.mark.parametrize("n", [1, crosslane.WIDTH, crosslane.WIDTH + 1, 2 * crosslane.WIDTH - 1, 4 * crosslane.WIDTH + 3])
def test_any_number_of_rays(n):
    o, d, least, most = aimed(np.eye(4), 1e-3, False)
    one, other = (ray_queries.closest(trees(np.eye(4), alone), o[:n], d[:n], least[:n], most[:n]) for alone in (False, True))
    assert len(one.t) == n
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@helper
def taken(origin, direction, least, most, start):
    o, d = crosslane.load_rows3(origin, start), crosslane.load_rows3(direction, start)
    return Ray(o, d, crosslane.load_row(least, start), crosslane.load_row(most, start), None)


@kernel
def count(accel, origin, direction, least, most):
    """Of how many pairs of vectors of rays are one bundle."""
    found = 0
    for start in range(0, len(least), 2 * crosslane.WIDTH):
        first, second = taken(origin, direction, least, most, start), taken(origin, direction, least, most, start + crosslane.WIDTH)
        found += double_packet.as_bundle(accel, 0, double_packet.seen(accel, 0, first, second), False)[1]
    return found


@pytest.mark.skipif(crosslane.WIDTH == 1, reason="there are no vectors")
def test_rays_near_each_other_are_one_bundle():
    near, apart = (count(trees(np.eye(4), alone=True), *aimed(np.eye(4), spread, False)) for spread in (1e-3, 0.3))
    assert apart < 0.5 * COUNT / (2 * crosslane.WIDTH) < 0.9 * COUNT / (2 * crosslane.WIDTH) < near


def sheets(gap: float, count: int = 96) -> tuple[F64, NDArray[np.int32]]:
    """(corners, triangles) of triangles one behind the other, a little askew."""
    random = np.random.default_rng(9)
    corners = np.array([[-1.0, -1.0, 0.0], [1.2, -0.9, 0.0], [0.1, 1.3, 0.0]]) + random.normal(scale=1e-3, size=(count, 3, 3))
    corners[:, :, 2] = gap * (np.arange(count)[:, None] + random.uniform(-0.2, 0.2, (count, 3)))
    return corners.astype(np.float32).astype(np.float64).reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


@pytest.mark.parametrize("spread", [1e-3, 0.5], ids=["as bundles", "each by itself"])
@pytest.mark.parametrize("gap", [1e-6, 1e-3], ids=["closer than single precision tells", "apart"])
@pytest.mark.parametrize("towards", [1.0, -1.0], ids=["up", "down"])
def test_stretches_that_begin_and_end_in_triangles(gap, spread, towards):
    """From one sheet to another a ray meets what lies between, and of the two themselves nothing: t_min < t < t_max."""
    corners, triangles = sheets(gap)
    tables = scene(meshes=[(mesh(corners, triangles), np.eye(4), 0)])
    accel = ray_queries.trees(tables, keep=False)
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
