"""Hits by BVH against brute force: all kinds of shapes, ties, grids, duplicates, many instances."""

from __future__ import annotations

import math
import os
import subprocess
import sys
import time

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import CameraData, InstanceData, MeshData, lambert
from maquette.render.accel import intersect, scene_bvh
from maquette.render.accel.bvh_build import parallel_build, tlas, tree_cache, wide_bvh
from maquette.render.geometry.bounds import world_bounds

from ..tables import matrix, rays, scene
from ..tracing import coherent_rays, random_rays, same, trace_kernels, wavy

K = ir.GeometryKind
EVERY = [
    (K.SPHERE, [1.3]), (K.BOX, [1.0, 0.5, 0.8]), (K.PLANE, []), (K.RECTANGLE, [1.0, 2.0]), (K.DISK, [1.5]),
    (K.CYLINDER, [1.0, 0.7, 1.0]), (K.CONE, [1.0, 0.2, 0.7, 0.0]), (K.TORUS, [1.0, 0.3]), (K.CAPSULE, [0.5, 0.8]),
    (K.QUADRIC, [1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2, 1, 1, 1]),
    (K.QUADRIC, [0, 0, 0, 0, 0, 1, 0, -1, 0, 0, np.inf, np.inf, np.inf]),
]  # fmt: skip


def anywhere(rng: np.random.Generator) -> np.ndarray:
    """A random transform: rotated, scaled unevenly, mirrored half of the time."""
    turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    sheared = np.eye(3) + 0.3 * rng.normal(size=(3, 3))
    return matrix(rng.uniform(-5, 5, 3), turned @ sheared @ np.diag(rng.uniform(0.4, 1.5, 3) * rng.choice([-1, 1], 3)))


@pytest.mark.parametrize("seed", [1, 2])
def test_bvh_and_brute_force_agree_on_every_kind_of_shape(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = [(kind, parameters, anywhere(rng), 0) for kind, parameters in EVERY * 2]
    meshes = [(wavy(6, k), anywhere(rng), 0) for k in range(3)]
    _, instance, *_ = same(scene(shapes, meshes), random_rays(3000, seed))
    assert len(np.unique(instance)) > 20


def test_rays_on_the_grid_of_boxes_and_triangles_miss_nothing() -> None:
    """An orthographic view along -z at integers, through the faces, edges and corners of unit boxes and a flat mesh."""
    boxes = [(K.BOX, [0.5, 0.5, 0.5], matrix((x, y, 0.0)), 0) for x in range(4) for y in range(4)]
    points = np.array([[x, y, -3.0] for x in range(5) for y in range(5)]) - [0.5, 0.5, 0.0]
    i = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    flat = MeshData(points, np.concatenate([np.stack([i, i + 5, i + 6], 1), np.stack([i, i + 6, i + 1], 1)]))
    line = np.arange(0.0, 4.01, 0.25) - 0.5
    x, y = (g.ravel() for g in np.meshgrid(line, line))
    origin = np.stack([x, y, np.full(len(x), 9.0)], axis=1)
    for direction in ((0.0, 0.0, -1.0), (-0.0, -0.0, -1.0)):
        t, *_ = same(scene(boxes), rays(origin, direction))
        np.testing.assert_array_equal(t, 8.5)
        t, *_ = same(scene(meshes=[(flat, np.eye(4), 0)]), rays(origin, direction))
        np.testing.assert_array_equal(t, 12.0)


def test_of_equal_hits_the_first_instance_and_the_first_triangle_win() -> None:
    mesh = wavy(4)
    twice = MeshData(mesh.positions, np.concatenate([mesh.triangles, mesh.triangles]))
    ray = random_rays(1500, 3, reach=2.0)
    tables = scene(meshes=[(twice, np.eye(4), 0)])
    _, instance, primitive, *_ = same(tables, ray)
    assert np.all(primitive[instance >= 0] < len(mesh.triangles))
    spheres = [(K.SPHERE, [1.0], np.eye(4), 0)] * 9
    _, instance, *_ = same(scene(spheres), ray)
    assert set(instance) == {-1, 0}


@pytest.mark.parametrize("count", [0, 1, 2])
def test_scenes_of_no_and_one_instance(count: int) -> None:
    tables = scene([(K.SPHERE, [1.0], matrix((3.0 * k, 0, 0)), 0) for k in range(count)])
    t, instance, *_, blocked = same(tables, rays((0, 0, 5), (0, 0, -1)))
    assert (t[0], instance[0], blocked[0]) == ((4.0, 0, True) if count else (np.inf, -1, False))
    endless = scene([(K.PLANE, [], np.eye(4), 0)] * count)
    assert same(endless, rays((0, 2, 5), (0, -1, 0)))[0][0] == (2.0 if count else np.inf)


def test_each_ray_hits_only_instances_visible_to_it() -> None:
    tables = scene([(K.SPHERE, [1.0], matrix((0, 0, -3.0 * k)), 0) for k in range(3)])
    bits = [ir.Visibility.CAMERA, ir.Visibility.SHADOW, ir.Visibility.REFLECTION]
    tables = tables._replace(instances=tables.instances._replace(visible=np.array(bits, np.int32)))
    ray = rays((0, 0, 5), (0, 0, -1), t_max=20.0)
    for k, bit in ((0, ir.Visibility.CAMERA), (2, ir.Visibility.REFLECTION)):
        _, instance, *_, blocked = same(tables, ray, int(bit))
        assert instance[0] == k
        assert blocked[0]
    nearer = rays((0, 0, 5), (0, 0, -1), t_max=6.5)  # ends before the one that throws a shadow
    assert not same(tables, nearer)[-1][0]


def test_inactive_rays_have_no_hits() -> None:
    tables = scene([(K.SPHERE, [1.0], np.eye(4), 0)])
    ray = rays([(0, 0, 5), (0, 0, 5)], (0, 0, -1))
    active = np.array([True, False])
    hit = intersect.closest_hit(intersect.Brute(), tables, ray, active, 1)
    np.testing.assert_array_equal(hit.t, [4.0, np.inf])
    np.testing.assert_array_equal(hit.instance, [0, -1])
    np.testing.assert_array_equal(intersect.occluded(intersect.Brute(), tables, ray, active), active)


# --- trees ---------------------------------------------------------------------------------------------------------------


def check_top(tree: tlas.Top, boxes: np.ndarray) -> int:
    """Check that each instance is in one leaf and inside all boxes above it; return the depth."""
    seen, deepest = [], 0
    boxes = (boxes - np.tile(tree.frame[:3], 2)) * tree.frame[3]

    def around(node: int, depth: int) -> tuple[np.ndarray, np.ndarray]:
        nonlocal deepest
        deepest = max(deepest, depth)
        planes = tree.nodes[node].reshape(3, 2, wide_bvh.WIDTH).astype(np.float64)
        around_all = np.array([[np.inf] * 3, [-np.inf] * 3])
        for k in np.flatnonzero(tree.links[node] > wide_bvh.EMPTY):
            link = int(tree.links[node, k])
            low, high = around(link, depth + 1) if link >= 0 else (boxes[~link, :3], boxes[~link, 3:])
            off = np.concatenate([low - planes[:, 0, k], planes[:, 1, k] - high])
            assert np.all((off > 0.8 * tlas.SLACK) & (off < 1.2 * tlas.SLACK))
            around_all[0], around_all[1] = np.minimum(around_all[0], low), np.maximum(around_all[1], high)
            if link < 0:
                seen.append(~link)
        assert np.all(planes[:, 0, tree.links[node] <= wide_bvh.EMPTY] == np.inf)
        assert np.all(planes[:, 1, tree.links[node] <= wide_bvh.EMPTY] == -np.inf)
        return around_all[0], around_all[1]

    low, high = around(0, 0)
    assert 0.45 < max(-low.min(), high.max()) <= 1.0
    assert sorted(seen) == list(range(len(boxes)))
    return deepest


@pytest.mark.parametrize("n", [1, 2, 8, 9, 60, 5000])
def test_the_instance_bvh_holds_each_instance_once_inside_its_boxes(n: int) -> None:
    rng = np.random.default_rng(n)
    low = rng.uniform(-1, 1, (n, 3)) * 10.0 ** rng.uniform(-3, 3, (n, 1))
    boxes = np.concatenate([low, low + rng.uniform(0, 1, (n, 3))], axis=1)
    boxes[0, :3], boxes[0, 3:] = -1e6, 1e6  # a wide ground
    tree = tlas.build(boxes, np.arange(n, dtype=np.int32))
    assert check_top(tree, boxes) <= 1 + 3 * math.log(n, 8)
    for threads in (1, 2, 5):
        np.testing.assert_array_equal(tlas.build(boxes, np.arange(n, dtype=np.int32), threads).links, tree.links)
    moved = boxes + rng.uniform(0, 1, (n, 1))
    tlas.refit(tree, moved)
    check_top(tree, moved)


@pytest.mark.long
@pytest.mark.parametrize(("shape", "count"), [("sphere", 300), ("mesh", 200), ("sphere", 70), ("mesh", 70)])
def test_thousands_of_rays_among_many_instances(shape: str, count: int) -> None:
    """Coherent, nearly coherent and incoherent rays, with inactive lanes."""
    rng = np.random.default_rng(11)
    if shape == "sphere":
        tables = scene([(K.SPHERE, [0.6], anywhere(rng), 0) for _ in range(count)] + [(K.PLANE, [], matrix((0, -4, 0)), 0)])
    else:
        tables = scene(meshes=[(wavy(3, k), anywhere(rng), 0) for k in range(count)])
    for ray in (random_rays(4000, 5), coherent_rays(4000, 6), coherent_rays(4000, 7, spread=0.0), coherent_rays(4000, 8, spread=0.1)):
        t_max = np.where(rng.random(4000) < 0.2, -1.0, np.inf)
        _, instance, *_ = same(tables, ray._replace(t_max=t_max))
        assert len(np.unique(instance)) > (40 if count > 70 else 20)
        assert np.all(instance[t_max < 0] == -1)


@pytest.mark.long
@pytest.mark.parametrize("spread", [0.0, 1e-4, 3e-3, 0.03])
def test_packets_through_a_mesh_hit_what_single_rays_hit(spread: float) -> None:
    """Packets as narrow as a leaf and much wider, at edges and corners, with early ends, and for any hit."""
    rng = np.random.default_rng(3)
    mesh = wavy(40)
    tables = scene(meshes=[(mesh, anywhere(rng), 0), (mesh, anywhere(rng), 0)])
    matrices = tables.transforms.matrix[tables.instances.transform]
    local = mesh.positions[rng.integers(len(mesh.positions), size=500)]  # towards corners, where six triangles meet
    target = np.einsum("ij,nj->ni", matrices[0][:, :3], local) + matrices[0][:, 3]
    eye = rng.uniform(-9, 9, (500, 3))
    origin, towards = np.repeat(eye, 8, axis=0), np.repeat(target - eye, 8, axis=0)
    towards = towards + spread * rng.uniform(-1, 1, towards.shape) * np.linalg.norm(towards, axis=1, keepdims=True)
    towards[::8] = (target - eye)
    t_max = np.where(rng.random(4000) < 0.3, rng.uniform(0.5, 1.5, 4000), np.inf)
    _, instance, *_ = same(tables, rays(origin, towards)._replace(t_max=t_max))
    assert np.mean(instance >= 0) > 0.5


@pytest.mark.long
def test_axis_aligned_rays_from_one_point() -> None:
    """Directions with zeros of both signs, where 1 / 0 is infinite."""
    tables = scene([(K.BOX, [0.5, 0.5, 0.5], matrix((x, y, 0.0)), 0) for x in range(8) for y in range(8)])
    line = np.arange(-1.0, 9.01, 0.125)
    x, y = (g.ravel() for g in np.meshgrid(line, line))
    for direction in ((0.0, 0.0, -1.0), (-0.0, 0.0, -1.0), (0.0, 0.0, -3e5)):
        t, *_ = same(tables, rays(np.stack([x, y, np.full(len(x), 1e5)], axis=1), direction))
        inside = (x >= -0.5) & (x <= 7.5) & (y >= -0.5) & (y <= 7.5)
        np.testing.assert_array_equal(np.isfinite(t), inside)


def check_wide(tree: wide_bvh.Wide, triangles: np.ndarray) -> int:
    """Check that each triangle (t, 3, 3) is in one leaf and inside all boxes above it; return the depth."""
    seen, deepest = [], 0
    stack = [(0, np.full(3, -np.inf), np.full(3, np.inf), 0)]
    while stack:
        node, lo, hi, depth = stack.pop()
        deepest = max(deepest, depth)
        planes = tree.nodes[node].reshape(3, 2, wide_bvh.WIDTH)
        for k in np.flatnonzero(tree.links[node] > wide_bvh.EMPTY):
            low, high, link = planes[:, 0, k], planes[:, 1, k], int(tree.links[node, k])
            assert np.all(low >= lo)
            assert np.all(high <= hi)
            if link >= 0:
                stack.append((link, low, high, depth + 1))
                continue
            rows = tree.rows[~link]
            held = tree.corners[~link][:, :, rows >= 0]
            rows = rows[rows >= 0]
            np.testing.assert_array_equal(held.transpose(2, 0, 1), triangles[rows])
            assert np.all(held > low[:, None])
            assert np.all(held < high[:, None])
            seen.extend(rows)
        assert np.all(planes[:, 0, tree.links[node] <= wide_bvh.EMPTY] == np.inf)
        assert np.all(planes[:, 1, tree.links[node] <= wide_bvh.EMPTY] == -np.inf)
    assert sorted(seen) == list(range(len(triangles)))
    return deepest


def corners_of(tables: ir.Tables) -> np.ndarray:
    return tables.pools.positions[tables.pools.triangles]


def test_a_mesh_bvh_holds_each_triangle_once_inside_its_boxes() -> None:
    tables = scene(meshes=[(wavy(40), np.eye(4), 0)])
    tree = scene_bvh.build(tables)
    assert check_wide(tree.wide, corners_of(tables)) < 12
    assert check_top(tree.top, world_bounds(tables)) == 0


@pytest.mark.long
@pytest.mark.parametrize("what", ["duplicates", "coplanar", "a needle fan", "spread over 30 powers of two"])
def test_bvhs_of_degenerate_triangles_are_shallow_and_quick(what: str) -> None:
    n = 50_000
    rng = np.random.default_rng(7)
    if what == "duplicates":
        points, triangles = np.eye(3), np.tile([0, 1, 2], (n, 1))
    elif what == "coplanar":
        points = rng.uniform(-1, 1, (3 * n, 3)) * [1, 0, 1]
        triangles = np.arange(3 * n).reshape(-1, 3)
    elif what == "a needle fan":
        turn = np.linspace(0, 2 * math.pi, n + 1)
        points = np.concatenate([[[0, 0, 0]], np.stack([np.cos(turn), 0 * turn, np.sin(turn)], 1)])
        triangles = np.stack([np.zeros(n, int), np.arange(1, n + 1), np.arange(2, n + 2)], 1)
    else:
        points = rng.uniform(0, 1, (3 * n, 3)) * 2.0 ** -np.repeat(np.linspace(0, 30, n), 3)[:, None]
        triangles = np.arange(3 * n).reshape(-1, 3)
    tables = scene(meshes=[(MeshData(points, triangles), np.eye(4), 0)])
    scene_bvh.build(scene(meshes=[(wavy(2), np.eye(4), 0)]))  # compiled
    started = time.process_time()
    tree = scene_bvh.build(tables)
    assert time.process_time() - started < 3.0
    assert check_wide(tree.wide, corners_of(tables)) < 24
    assert tree.wide.nbytes < 64 * n


@pytest.mark.long
def test_the_bvh_is_the_same_on_any_number_of_threads() -> None:
    mesh = wavy(150)
    positions, triangles = mesh.positions.astype(np.float32), mesh.triangles.astype(np.int32)
    assert len(triangles) > 40_000  # parts of it are built apart
    by_one, by_two, by_five = (wide_bvh.build(positions, triangles, threads=threads) for threads in (1, 2, 5))
    assert check_wide(by_one, positions[triangles]) < 12
    for other in (by_two, by_five):
        for a, b in zip(by_one, other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_writable_and_readonly_arrays_share_compiled_code() -> None:
    positions, triangles = np.eye(3, dtype=np.float32), np.arange(3, dtype=np.int32)[None]
    wide_bvh.build(positions, triangles)
    before = len(wide_bvh.collapse.loaded), len(parallel_build.build_worker.loaded)
    for each in (positions, triangles):
        each.flags.writeable = False
        wide_bvh.build(positions, triangles)
    assert (len(wide_bvh.collapse.loaded), len(parallel_build.build_worker.loaded)) == before


@pytest.mark.parametrize("n", [1, 2, 7, 8, 9, 60])
def test_bvhs_of_few_triangles(n: int) -> None:
    corners = np.random.default_rng(n).uniform(-1, 1, (n, 3, 3)).astype(np.float32)
    check_wide(wide_bvh.build(corners.reshape(-1, 3), np.arange(3 * n, dtype=np.int32).reshape(-1, 3)), corners)


def test_bvhs_of_two_meshes_share_a_pool() -> None:
    tree_cache.clear()  # or trees would be refitted ones of other tests' meshes
    tables = scene(meshes=[(wavy(20), np.eye(4), 0), (wavy(10), np.eye(4), 0)])
    tree = scene_bvh.build(tables)
    assert tree.instance_rows[:, 4].tolist() == [0, len(wide_bvh.build(tables.pools.positions, tables.pools.triangles[:800]).nodes)]
    assert sorted(tree.wide.rows[tree.wide.rows >= 0]) == list(range(1000))


@pytest.mark.long
def test_ten_thousand_instances_share_a_bvh() -> None:
    builder = SceneBuilder()
    mesh = builder.mesh(wavy(224))
    material = builder.material(lambert((1.0, 1.0, 1.0)))
    rng = np.random.default_rng(8)
    for _ in range(10_000):
        builder.instance(InstanceData(mesh, builder.transform(matrix(rng.uniform(-200, 200, 3))), material))
    builder.camera(CameraData(transform=0, extent=1.0))
    tables = builder.finish().tables
    assert len(tables.pools.triangles) == 100_352
    tree = scene_bvh.build(tables)
    nodes = tree.top.nodes.nbytes + tree.top.links.nbytes
    assert tree.wide.nbytes + nodes + sum(array.nbytes for array in tree if isinstance(array, np.ndarray)) < 20e6
    assert np.count_nonzero(tree.wide.rows >= 0) == 100_352
    t, instance, primitive, *_ = trace_kernels(tables, random_rays(300, 9, reach=100.0))
    some = np.flatnonzero(instance >= 0)[:40]
    assert len(some) > 10
    for k in some:  # against the triangle itself
        ray = random_rays(300, 9, reach=100.0)
        i, row = instance[k], tables.instances.transform[instance[k]]
        corners = tables.pools.positions[tables.pools.triangles[primitive[k]]] + tables.geometries.origin[0]
        corners = corners + tables.transforms.matrix[row][:, 3]
        p = np.array([c[k] for c in ray.origin]) + t[k] * np.array([c[k] for c in ray.direction])
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        assert abs((p - corners[0]) @ normal) < 1e-9 * np.linalg.norm(normal), i


@pytest.mark.long
@pytest.mark.parametrize("isa", ["avx2", "sse", "scalar"])
def test_bvh_and_brute_force_agree_on_narrower_machines(isa: str) -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__]
    done = subprocess.run(command, env={**os.environ, "MAQUETTE_SIMD": isa}, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout
