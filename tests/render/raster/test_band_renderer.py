"""Bands against integer arithmetic: a triangle covers exactly the samples of the coverage rule."""

import gc
import threading
import weakref

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan
from maquette.compiler.scene.row_records import CameraData, LightData, MeshData
from maquette.render.backends import prepare, raster
from maquette.render.film import film
from maquette.render.image import metrics
from maquette.render.jit.packed_struct import Handle
from maquette.render.raster import (
    band_buffer,
    band_renderer,
    band_scheduler,
    coverage,
    meshlet_culling,
    meshlets,
    passes,
    raster_scene,
    triangle_setup,
)
from maquette.render.types import View

from .. import pictures, tables

SIZE = (70, 50)
SAMPLES = (1, 4, 16)


def seen(points: np.ndarray, triangles: np.ndarray, samples: int) -> np.ndarray:
    """(h, w, samples) the triangle that each sample sees, or -1. A metre is a pixel; z points to the eye."""
    width, height = SIZE
    positions = np.column_stack([points[:, 0] - width / 2, height / 2 - points[:, 1], points[:, 2]])
    camera = CameraData(0, height / 2, ir.Projection.ORTHOGRAPHIC)
    scene = tables.scene(meshes=[(MeshData(positions, triangles), tables.matrix((0, 0, -9)), 0)], camera=camera)
    built = raster_scene.build(scene, View(0, width, height), {})
    pattern, band = band_buffer.pattern(samples), band_buffer.band_buffer(width, height, samples)
    band.clip[:] = 0, 0, width, height
    drawn = meshlet_culling.find_visible(built.projection, built.meshlets, built.meshlet_ranges, (0, 0, width, height), 0, 64)
    filling = band_buffer.Filling(built.projection, Handle(pattern), built.meshlets, drawn, Handle(band))
    triangle_setup.draw_band(Handle(filling), 0)
    columns, rows = band.window[2:]
    ids = band.ids.reshape(rows // 4, columns // 4, samples, 4, 4).transpose(0, 4, 1, 3, 2).reshape(rows, columns, samples)
    ids = ids[:height, :width]
    some = np.maximum(ids, 0)
    slot = drawn.tables.first[some >> meshlets.SHIFT] + (some & ((1 << meshlets.SHIFT) - 1))
    return np.where(ids >= 0, built.meshlets.tables.corner[slot, 3], -1)


def by_rule(corners: np.ndarray, samples: int) -> np.ndarray:
    """(h, w, samples) coverage.inside_edges of a triangle with (3, 2) integer corners in 1/256 pixel, in Python integers."""
    (ax, ay), (bx, by), (cx, cy) = corners.tolist()
    if coverage.doubled_area(ax, ay, bx, by, cx, cy) < 0:
        bx, by, cx, cy = cx, cy, bx, by
    pattern = band_buffer.pattern(samples)
    out = np.zeros((SIZE[1], SIZE[0], samples), bool)
    if coverage.doubled_area(ax, ay, bx, by, cx, cy) == 0:
        return out
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]].astype(object) * 256
    for s in range(samples):
        px, py = x + int(pattern.x[s]), y + int(pattern.y[s])
        inside = np.ones(px.shape, bool)
        for (ux, uy), (vx, vy) in (((ax, ay), (bx, by)), ((bx, by), (cx, cy)), ((cx, cy), (ax, ay))):
            e = (vx - ux) * (py - uy) - (vy - uy) * (px - ux)
            inside &= (e >= (0 if coverage.owns(vx - ux, vy - uy) else 1)).astype(bool)
        out[..., s] = inside
    return out


@pytest.mark.long
@pytest.mark.parametrize("samples", SAMPLES)
@pytest.mark.parametrize("reach", [0.6, 3.0, 25.0, 400.0, 60000.0])
def test_triangles_of_every_size_cover_what_the_rule_says(reach: float, samples: int):
    """Sizes from far below a pixel to beyond 32 bits; some corners on samples, some horizontal and vertical edges."""
    rng = np.random.default_rng(int(reach * 10) + samples)
    covered = 0
    for _ in range(16):
        middle = rng.uniform(5, 45, 2)
        corners = np.round((middle + rng.uniform(-reach, reach, (3, 2))) * 256).astype(np.int64)
        snap = rng.random((3, 2)) < 0.3
        corners[snap] = corners[snap] // 256 * 256 + 128
        if rng.random() < 0.3:
            corners[1, 1] = corners[0, 1]
        if reach > 1000:
            corners = corners // 256 * 256  # what float32 has of numbers so large
        points = np.column_stack([corners / 256.0, np.zeros(3)])
        expected = by_rule(corners, samples)
        covered += expected.sum()
        assert np.array_equal(seen(points, np.array([[0, 1, 2]]), samples) == 0, expected)
    assert covered > 0


@pytest.mark.parametrize("samples", SAMPLES)
def test_fans_and_strips_share_their_samples_out(samples: int):
    """Triangles drawn one by one cover each sample inside exactly once; corners lie on samples, edges pass through them."""
    corners = np.array([[10.5, 10.5], [50.5, 10.5], [60.5, 30.5], [40.5, 45.5], [20.5, 40.5], [5.5, 30.5]])
    fan = np.column_stack([np.vstack([corners, [[30.5, 20.5]]]), np.zeros(7)])
    total = np.zeros((SIZE[1], SIZE[0], samples), int)
    for k in range(6):
        total += seen(fan, np.array([[k, (k + 1) % 6, 6]]), samples) >= 0
    assert total.max() == 1
    expected = sum(by_rule(np.round(corners[[0, k, k + 1]] * 256).astype(np.int64), samples).astype(int) for k in range(1, 5))
    assert np.array_equal(total, expected)


@pytest.mark.long
def test_the_nearest_is_seen_whatever_its_size_and_order():
    """Overlapping tiny, small and large triangles: the z-buffer agrees with depths computed for each."""
    rng = np.random.default_rng(5)
    points, triangles = [], []
    for k in range(300):
        size = rng.choice([0.8, 6.0, 90.0], p=[0.5, 0.4, 0.1])
        corners = np.round((rng.uniform(5, 45, 2) + rng.uniform(-size, size, (3, 2))) * 256) / 256
        points.extend([*corner, float(k % 37) / 8 + (k // 37) / 64] for corner in corners)
        triangles.append([3 * k, 3 * k + 1, 3 * k + 2])
    points, triangles = np.array(points), np.array(triangles)
    best, depth = np.full((SIZE[1], SIZE[0], 1), -1), np.full((SIZE[1], SIZE[0], 1), -np.inf)
    for k, triangle in enumerate(triangles):
        z = points[triangle[0], 2]
        nearer = by_rule(np.round(points[triangle, :2] * 256).astype(np.int64), 1) & (z > depth)
        best, depth = np.where(nearer, k, best), np.where(nearer, z, depth)
    assert np.array_equal(seen(points, triangles, 1), best)


def test_sixteen_samples_are_a_net():
    """Each elementary interval of 1/16 pixel holds one sample."""
    pattern = band_buffer.pattern(16)
    for wide in (1, 2, 4, 8, 16):
        cells = pattern.x * wide // 256 * 16 + pattern.y * (16 // wide) // 256
        assert len(np.unique(cells)) == 16


def test_more_samples_lie_at_other_places():
    """Sixteen passes of sixteen samples hold all positions of a 16 × 16 grid; each pass is a net."""
    patterns = [each.pattern for each in passes.passes(256, False, "box")]
    assert len(patterns) == 16
    assert len({(x, y) for each in patterns for x, y in zip(each.x // 16, each.y // 16, strict=True)}) == 256
    for each in patterns:
        assert len(np.unique(each.x // 64 * 4 + each.y // 64)) == 16
    assert [len(each.pattern.x) for each in passes.passes(37, False, "box")] == [12, 12, 13]
    assert [each.first for each in passes.passes(16, True, "box")] == [0, 8]
    assert np.array_equal(passes.passes(16, False, "box")[0].pattern.x, band_buffer.pattern(16).x)


@pytest.mark.long
def test_soft_light_is_drawn_in_bands_and_tells_its_error():
    """An area light over a floor: the estimated error is close to the error against a long run, as of other backends."""
    area = LightData(ir.LightKind.RECTANGLE, (5.0, 5.0, 5.0), transform=1, size=(0.8, 0.8))
    shapes = [(ir.GeometryKind.PLANE, [], tables.matrix((0, -1, 0)), 0), (ir.GeometryKind.SPHERE, [0.5], tables.matrix((0, -0.5, -2)), 0)]
    scene = tables.scene(shapes, camera=CameraData(0, 0.5), lights=[area], frame=tables.facing((0, 2, -2), (0, -1, -2)))
    long = pictures.picture(scene, samples=1024, size=(32, 24)).channels["rgba"][..., :3]
    drawn = pictures.picture(scene, overrides={"raster.sample_positions": "shared"}, samples=32, size=(32, 24))
    estimate = drawn.metadata["error"]
    error = metrics.root_relmse(drawn.channels["rgba"][..., :3], long)
    assert 0.5 * error < estimate < 2.0 * error


@pytest.mark.parametrize("name", ["box", "tent", "gaussian", "blackman-harris"])
@pytest.mark.parametrize("samples", [1, 4, 5, 16])
def test_an_even_picture_stays_even_under_every_filter(name: str, samples: int):
    """A uniformly lit wall: every pixel, also at the border, equals one sample."""
    quad = MeshData(np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    scene = tables.scene(meshes=[(quad, tables.matrix((0, 0, -2)), 0)], camera=CameraData(0, 0.5), lights=[])
    drawn = pictures.picture(scene, samples=samples, filter=name, size=(21, 18)).channels["rgba"]
    assert np.allclose(drawn[..., 3], 1.0, atol=1e-6)
    assert np.ptp(drawn[..., :3]) < 1e-6


def test_many_sharp_samples_in_bands_cover_what_they_should():
    """A slanted edge through 24 pixels: 256 shared positions give its coverage to 1/256; the ray backend's are about as good."""
    quad = MeshData(np.array([[-9.0, -9, 0], [0.3, -9, 0], [-0.1, 9, 0], [-9, 9, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    scene = tables.scene(meshes=[(quad, tables.matrix((0, 0, -2)), 0)], camera=CameraData(0, 0.5, ir.Projection.ORTHOGRAPHIC), lights=[])
    x = 12 + 24 * (0.1 + 0.4 / 18 * (np.arange(24 * 64) + 0.5 - 12 * 64) / 24 / 64)
    exact = np.clip(x[:, None] - np.arange(24), 0, 1).reshape(24, 64, 24).mean(axis=1)
    per_pixel, shared = (
        pictures.picture(scene, overrides={"raster.sample_positions": how}, samples=256, size=(24, 24), filter="box")
        for how in ("per_pixel", "shared")
    )
    per_pixel, shared = (image.channels["rgba"][..., 3] for image in (per_pixel, shared))
    assert np.abs(shared - exact).max() < 2 / 256
    assert np.abs(per_pixel - shared).max() < 6 / 256


def test_places_are_not_asked_for_where_samples_are_not_counted():
    scene = tables.scene([(ir.GeometryKind.SPHERE, [0.5], tables.matrix((0, 0, -2)), 0)], camera=CameraData(0, 0.5))
    with pytest.raises(plan.PlanError, match=r"`raster\.sample_positions` cannot be shared; it can be: per_pixel"):
        pictures.picture(scene, overrides={"raster.sample_positions": "shared"}, error=0.1, samples=None)


def a_mesh_in_bands(threads: int = 1, crop: tuple[int, ...] | None = None) -> tuple:
    """(prepared, plan, view) of 300 triangles in five bands of 64 rows, on white."""
    points = np.random.default_rng(2).uniform(-1, 1, (900, 3))
    triangles = np.arange(900).reshape(-1, 3)
    sun = LightData(ir.LightKind.DIRECTIONAL, (1.0, 1.0, 1.0), direction=(0.0, 0.6, 0.8), shadows=False)
    scene = tables.scene(meshes=[(MeshData(points, triangles), tables.matrix((0, 0, -4)), 0)], lights=[sun])
    settings = {"size": (90, 300), "background": (1.0, 1.0, 1.0), "threads": threads, "crop": crop}
    prepared_scene, decided, view = pictures.planned(scene, "raster", **settings)
    return prepare.prepare(prepared_scene, decided, view, pictures.general()), decided, view


@pytest.mark.parametrize("seconds", [1e-9, 3e-4, 1.0])
def test_bands_are_the_same_however_many_are_drawn_at_once(seconds: float, monkeypatch: pytest.MonkeyPatch):
    """One band a call, several, or all, in one thread or several: the picture equals that of single bands."""
    single = []
    for top in range(0, 300, 64):
        prepared, decided, view = a_mesh_in_bands(crop=(0, top, 90, min(top + 64, 300)))
        band = film.run(raster.Renderer(prepared, decided, view), decided, view)
        single.append(band.channels["rgba"])
    alone = np.concatenate(single)
    monkeypatch.setattr(band_scheduler, "CALL_SECONDS", seconds)
    for threads in (1, 2, 5):
        prepared, decided, view = a_mesh_in_bands(threads)
        complete = film.run(raster.Renderer(prepared, decided, view), decided, view)
        assert np.array_equal(complete.channels["rgba"], alone)
    assert len(np.unique(alone)) > 100


def test_memory_that_is_kept_for_the_next_picture_does_not_keep_the_last():
    prepared, decided, view = a_mesh_in_bands()
    renderer = raster.Renderer(prepared, decided, view)
    film.run(renderer, decided, view)
    reference = weakref.ref(renderer.whole)
    assert reference() is not None
    del renderer
    gc.collect()
    assert reference() is None


def test_what_no_turn_has_drawn_is_empty(monkeypatch: pytest.MonkeyPatch):
    """A picture cancelled after its first call has that band, and 0 elsewhere."""
    monkeypatch.setattr(band_scheduler, "CALL_SECONDS", 1e-9)
    prepared, decided, view = a_mesh_in_bands()
    cancel = threading.Event()
    cut = film.run(raster.Renderer(prepared, decided, view), decided, view, lambda reached: cancel.set(), cancel)
    rows = np.flatnonzero((cut.channels["rgba"][..., 3] > 0.0).any(axis=1) | (cut.channels["rgba"][..., 0] > 0.0).any(axis=1))
    assert cut.metadata["partial"]
    assert rows.min() == 0
    assert rows.max() == band_renderer.ROWS[1] - 1
