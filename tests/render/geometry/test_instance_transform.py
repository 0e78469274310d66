"""Motion blur: keys, swept bounds, rays with a time by BVH and by brute force, and known results."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir, load
from maquette.compiler.plan import plan, scene_facts
from maquette.compiler.scene import motion_keys, transforms
from maquette.lang.elements import AxisAngle
from maquette.render import camera, render_scene
from maquette.render.accel import intersect, scene_bvh
from maquette.render.accel import ray_queries as kernels
from maquette.render.accel.traverse import motion_alpha
from maquette.render.geometry import instance_transform
from maquette.render.geometry.bounds import swept_bounds
from maquette.render.jit.kernel import kernel
from maquette.render.jit.packed_struct import Handle
from maquette.render.lanes import crosslane, ops
from maquette.render.types import Hit, Ray, View

from ..surface.test_alpha import textured
from ..tables import matrix, scene
from ..tracing import random_rays, wavy
from .test_analytic_shapes import SHAPES


def moved(tables: ir.Tables, seed: int, keys: int = 3, share: float = 0.7) -> ir.Tables:
    """The tables with random keys for most of the transforms that instances use."""
    random = np.random.default_rng(seed)
    first, count = tables.transforms.first_key.copy(), tables.transforms.keys.copy()
    parts: list[tuple[np.ndarray, ...]] = []
    for row in np.unique(tables.instances.transform):
        if random.uniform() > share:
            continue
        begin = np.vstack([tables.transforms.matrix[row], [0, 0, 0, 1]])
        places = [begin]
        for _ in range(keys - 1):
            turn = transforms.rotation(AxisAngle(tuple(random.normal(size=3)), random.uniform(-2.5, 2.5)))
            grow = np.diag([*random.uniform(0.7, 1.4, 3), 1.0])
            place = places[-1] @ turn @ grow
            place[:3, 3] += random.uniform(-1.5, 1.5, 3)
            places.append(place)
        first[row], count[row] = sum(len(p[0]) for p in parts), keys
        parts.append(motion_keys.decompose(np.stack(places)[:, :3]))
    columns = [np.concatenate([p[k] for p in parts]) for k in range(3)]
    table = ir.table_of("transforms", {**tables.transforms._asdict(), "first_key": first, "keys": count})
    return tables._replace(transforms=table, keys=ir.table_of("keys", dict(zip(ir.Keys._fields, columns, strict=True))))


def everything(seed: int) -> ir.Tables:
    """All shapes and two meshes, some with holes, that move."""
    random = np.random.default_rng(seed)

    def place() -> np.ndarray:
        return matrix(random.uniform(-4, 4, 3), np.linalg.qr(random.normal(size=(3, 3)))[0] * random.uniform(0.3, 1.5))

    shapes = [(kind, parameters, place(), k % 4) for k, (kind, parameters) in enumerate(SHAPES.values())]
    return moved(scene(shapes, [(wavy(6), place(), 0), (wavy(3), place(), 2)], prepare=textured), seed)


@kernel
def closest_at(accel, columns, t, instance, primitive, share):
    """Hits of rays with a time, and their transmittance."""
    n = columns.shape[1]
    for start in range(0, n, crosslane.WIDTH):
        k = ops.minimum(crosslane.lane_indices(start), n - 1)
        origin, direction = (columns[0, k], columns[1, k], columns[2, k]), (columns[3, k], columns[4, k], columns[5, k])
        ray = Ray(origin, direction, columns[6, k], columns[7, k], columns[8, k])
        active = ops.bool_like(ray.t_max, True)
        hit = intersect.closest_hit(accel, accel, ray, active, 1)
        passed = intersect.transmittance(accel, accel, ray, active)
        for j in range(min(n - start, crosslane.WIDTH)):
            t[start + j], instance[start + j] = crosslane.lane(hit.t, j), crosslane.lane(hit.instance, j)
            primitive[start + j], share[start + j] = crosslane.lane(hit.primitive, j), crosslane.lane(passed, j)


def trace_kernels(tables: ir.Tables, ray: Ray, brute: bool = False) -> tuple[np.ndarray, ...]:
    accel = Handle(scene_bvh.build(tables, brute))
    motion_alpha.link(accel)
    n = len(ray.t_min)
    hits = np.empty(n), np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n)
    closest_at(accel, np.stack([*ray.origin, *ray.direction, ray.t_min, ray.t_max, ray.time]), *hits)
    return hits


# --- keys -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.long
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_decomposition_and_composition_are_inverse(seed):
    random = np.random.default_rng(seed)
    places = random.normal(size=(2, 3, 4)) * 10.0 ** random.uniform(-3, 3)
    parts = motion_keys.decompose(places)
    for k in (0, 1):
        np.testing.assert_allclose(motion_keys.interpolate(parts, float(k)), places[k], rtol=0, atol=1e-13 * np.abs(places).max())
    keys = ir.Keys(*parts)
    shares = random.uniform(0, 1, 5)
    matrices = np.stack(instance_transform.interpolate_keys(keys, 0, np.full(5, 2), shares), axis=1).reshape(-1, 3, 4)
    expected = np.stack([motion_keys.interpolate(parts, s) for s in shares])
    np.testing.assert_allclose(matrices, expected, rtol=0, atol=1e-12 * np.abs(places).max())


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.03, 1.0, 3.0])
def test_rotation_is_uniform_and_keeps_the_size(angle):
    """Interpolation of matrices would shrink it, halfway of a rotation by 3 rad to 7 %."""
    axis = (1.0, 2.0, -1.0)
    places = np.stack([transforms.rotation(AxisAngle(axis, a))[:3] for a in (0.0, angle)])
    for share in (0.25, 0.5, 0.9):
        expected = transforms.rotation(AxisAngle(axis, share * angle))[:3]
        np.testing.assert_allclose(
            motion_keys.interpolate(motion_keys.decompose(places), share), expected, atol=1e-15 if angle < 0.01 else 4e-15
        )


def test_inverses_between_keys():
    tables = everything(3)
    rows = np.flatnonzero(tables.transforms.first_key >= 0)
    place = instance_transform.transform_at(tables, rows, np.random.default_rng(1).uniform(0, 1, len(rows)))
    m, inverse = (np.stack(v, axis=1).reshape(-1, 3, 4) for v in place)
    both = np.einsum("nij,njk->nik", m[:, :, :3], inverse[:, :, :3])
    np.testing.assert_allclose(both, np.broadcast_to(np.eye(3), both.shape), atol=1e-12)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_swept_bounds_hold_all_positions(seed):
    tables = moved(scene([(ir.GeometryKind.BOX, [1, 0.1, 3], matrix((2, 0, 0)), 0)]), seed, share=1.0)
    box = swept_bounds(tables)[0]
    corners = np.array([[x, y, z, 1] for x in (-1, 1) for y in (-0.1, 0.1) for z in (-3, 3)])
    row = np.full(500, tables.instances.transform[0])
    m = np.stack(instance_transform.transform_at(tables, row, np.linspace(0, 1, 500)).matrix, axis=1).reshape(-1, 3, 4)
    points = (m @ corners.T).transpose(0, 2, 1).reshape(-1, 3)
    assert (points >= box[:3]).all()
    assert (points <= box[3:]).all()
    swept, size = np.concatenate([points.min(axis=0), points.max(axis=0)]), np.ptp(points, axis=0).max()
    assert np.abs(swept - box).max() < 0.1 * size  # and not much more


# --- rays -----------------------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_bvh_and_brute_force_agree_on_moving_instances(seed):
    tables = everything(seed)
    n = 2500
    ray = random_rays(n, seed)._replace(time=np.random.default_rng(seed).uniform(0, 1, n))
    active = np.ones(n, bool)
    expected: Hit = intersect.closest_hit(intersect.Brute(), tables, ray, active, 1)
    share = intersect.transmittance(intersect.Brute(), tables, ray, active)
    for brute in (False, True):
        t, instance, primitive, passed = trace_kernels(tables, ray, brute)
        np.testing.assert_array_equal(instance, expected.instance)
        np.testing.assert_array_equal(primitive, expected.primitive)
        np.testing.assert_allclose(t, expected.t, rtol=1e-12)
        np.testing.assert_allclose(passed, share, rtol=1e-12)
    assert 0.3 < np.mean(np.isfinite(expected.t)) < 1


def test_rays_without_a_time_use_the_opening():
    tables = everything(4)
    ray = random_rays(1500, 4)
    still = replace_keys(tables)
    what = np.stack(ray.origin, axis=1), np.stack(ray.direction, axis=1)
    for column, expected in zip(kernels.closest(kernels.build(tables), *what), kernels.closest(kernels.build(still), *what), strict=True):
        np.testing.assert_allclose(column, expected, rtol=1e-9, atol=1e-9)
    assert not motion_alpha.has_motion(kernels.build(still).type)


def replace_keys(tables: ir.Tables) -> ir.Tables:
    nothing = {"first_key": np.full(len(tables.transforms.keys), -1), "keys": np.zeros(len(tables.transforms.keys))}
    return tables._replace(transforms=ir.table_of("transforms", {**tables.transforms._asdict(), **nothing}))


# --- whole pictures ---------------------------------------------------------------------------------------------------------------


def picture(folder, text: str, **settings_: object) -> np.ndarray:
    """(h, w, 4) of a scene's text."""
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    scene = load.load(path)
    return render_scene.draw(scene, plan.make_plan(scene, ir.Settings(**settings_))).channels["rgba"].astype(float)  # type: ignore[arg-type]


BAR = """
box(size: [W, 4, 1], center: [SPEED * time / 1s, 0, 0], material: emissive(1))
sun()
camera(position: [0, 0, 9], look_at: [0, 0, 0], width: 8m, shutter: 100ms)
render(bounces: 1)
"""


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "reference", "raster"])
@pytest.mark.parametrize(("width", "speed"), [(1.5, 20.0), (0.5, 30.0)])
def test_a_bar_that_moves_past_is_a_trapezoid(tmp_path, backend, width, speed):
    """A box of width w that moves by s covers a point for at most min(1, w/s) of the time, over w + s, with ramps of min(w, s)."""
    travelled = speed * 0.1
    text = BAR.replace("W", f"{width}").replace("SPEED", f"{speed}")
    samples = 64
    coverage = picture(tmp_path, text, backend=backend, samples=samples, size=(64, 2), filter="box")[..., 3].mean(axis=0)
    x = (np.arange(64) + 0.5) / 8 - 4
    edges = np.linspace(-0.5, 0.5, 65)[:-1] / 8
    positions = x[None] + edges[:, None]  # the filter is a box: the mean over each column
    covered = np.minimum(positions + width / 2, travelled) - np.maximum(positions - width / 2, 0)
    exact = np.mean(np.clip(covered, 0, None) / travelled, axis=0)
    assert exact.max() == pytest.approx(min(1, width / travelled), abs=0.02)
    steps = 0.1 if backend == "raster" else 0.0  # sixteen moments
    assert np.abs(coverage - exact).max() < 0.16 + steps  # 128 samples a column, stratified at best
    assert np.abs(coverage - exact).mean() < 0.025
    assert coverage.sum() / 8 == pytest.approx(width, rel=0.02)


SPINNING = """
box(size: [4, 0.4, 0.4], rotate: [0, 0, 900deg / 1s * time], material: emissive(1))
sun()
camera(position: [0, 0, 9], look_at: [0, 0, 0], width: 5m, shutter: 400ms)
render(bounces: 1)
"""


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
def test_a_whole_turn_is_a_disk(tmp_path, backend):
    """A rotating bar covers radius r for 2 a · sin⁻¹(h/r)/π of the time: it neither shrinks nor stops between keys."""
    text = SPINNING
    coverage = picture(tmp_path, text, backend=backend, samples=64, size=(50, 50), filter="box")[..., 3]
    y, x = (np.mgrid[0:50, 0:50] + 0.5 - 25) / 10
    r = np.hypot(x, y)
    ring = (r > 0.5) & (r < 1.7)
    expected = 2 * np.arcsin(np.clip(0.2 / r, 0, 1)) / np.pi
    assert np.abs((coverage - expected)[ring].mean()) < 0.01
    assert np.abs((coverage - expected)[ring]).mean() < 0.05
    assert coverage[r > 2.2].max() == 0


def test_moving_the_camera_is_moving_everything(tmp_path):
    """A moving camera blurs a static scene like a moving scene blurs before a static camera."""
    box = "box(size: [1, 4, 1], center: [A, 0, 0], material: emissive(1))\nsun()\nrender(bounces: 1)\n"
    camera = "camera(position: [B, 0, 9], look_at: [B, 0, 0], width: 8m, shutter: 100ms)\n"
    way = "10 * time / 1s"
    by_object = picture(tmp_path, box.replace("A", way) + camera.replace("B", "0"), samples=16, size=(32, 2))
    by_camera = picture(tmp_path, box.replace("A", "0") + camera.replace("B", f"-({way})"), samples=16, size=(32, 2))
    np.testing.assert_allclose(by_object, by_camera, atol=1e-6)
    assert by_object[..., 3].std() > 0.01


@pytest.mark.long
def test_ray_and_reference_are_the_same_picture(tmp_path):
    text = """
    plane(y: -1, material: lambert(0.5))
    sphere(radius: 0.6, center: [time / 1s * 8, 0, 0], material: phong(0.5, specular: 0.5))
    torus(1, 0.2, rotate: [time / 1s * 400deg, 0, 0], material: lambert(0.7, opacity: checker(#ffffff, #000000)))
    sun(from: [1, 3, 2])
    camera(position: [0, 1, 6], look_at: [time / 1s, 0, 0], shutter: 100ms)
    """
    rays, reference = (picture(tmp_path, text, backend=b, samples=8, size=(40, 30)) for b in ("ray", "reference"))
    assert np.mean(np.abs(rays - reference) > 1e-5) < 0.002  # a corner of a checker's cell apart


def test_static_scenes_plan_no_motion(tmp_path):
    """The plan drops motion where the shutter is open and nothing moves, and where it is not open."""
    path = tmp_path / "a.scene"
    for text, moves, why in (
        ("sphere(1)\ncamera([0, 0, 5], shutter: 10ms)", False, "nothing moves in the 0.01 s that the shutter is open"),
        ("sphere(1, translate: [time / 1s, 0, 0])\ncamera([0, 0, 5])", False, "the shutter is open for no time"),
        (
            "sphere(1, translate: [time / 1s, 0, 0])\ncamera([0, 0, 5], shutter: 10ms)",
            True,
            "moving in the 0.01 s of the shutter: 1 object; each ray has a time",
        ),
    ):
        path.write_text(text)
        scene = load.load(path)
        decision = plan.make_plan(scene, ir.Settings()).decisions["motion_blur"]
        assert (decision.value, decision.reason) == (moves, why)
        assert motion_alpha.has_motion(Handle(scene_bvh.build(scene.tables)).type) == moves
    off = plan.make_plan(scene, ir.Settings(size=(8, 8), samples=1), {"motion_blur": "off"})
    assert render_scene.draw(scene, off).channels["rgba"].shape == (8, 8, 4)


@pytest.mark.long
def test_number_of_keys(tmp_path):
    """Straight motion has two keys; a rotation by 900° at most a third of a turn a key; a distant axis more."""
    path = tmp_path / "a.scene"
    counts = []
    far = "rotate: [0, 90deg / 100ms * time, 0], center: [9, 0, 0]"
    for place in ("translate: [time / 1s, 0, 0]", "rotate: [0, 0, 9000deg / 1s * time]", far):
        path.write_text(f"box(1, {place})\ncamera([0, 0, 5], shutter: 100ms)")
        counts.append(int(load.load(path).tables.transforms.keys.max()))
    assert counts[0] == 2
    assert 900 / (counts[1] - 1) < 180
    assert 4 < counts[2] < 66


def test_missing_blur_is_reported(tmp_path):
    from maquette.lang.diagnostics import Diagnostics

    path = tmp_path / "a.scene"
    texts = {
        "sphere(1 + time / 1s)": "this changes its shape while the shutter is open: it is drawn as it is at the opening",
        "sphere(1)\npoint([time / 1s, 3, 0])": "this light moves or changes while the shutter is open: it is drawn as it is at the opening",
        "sphere(1, material: lambert(time / 1s))": "this material changes while the shutter is open: it is drawn as it is at the opening",
        "for (k in 0..floor(time / 10ms)) { sphere(1) }": "objects appear or vanish while the shutter is open: nothing blurs",
    }
    for text, message in texts.items():
        path.write_text(text + "\ncamera([0, 0, 5], shutter: 100ms)\n")
        diagnostics = Diagnostics()
        load.load(path, diagnostics=diagnostics)
        assert [d.message for d in diagnostics.items] == [message]


def test_usd_time_samples_blur(tmp_path):
    path = tmp_path / "a.usda"
    path.write_text(
        '#usda 1.0\n( startTimeCode = 0\n endTimeCode = 10\n timeCodesPerSecond = 10\n upAxis = "Y" )\n'
        'def Sphere "S" {\n double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (20, 0, 0) }\n'
        ' uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
        'def Camera "main_cam" {\n double shutter:open = 0\n double shutter:close = 0.5\n'
        ' double3 xformOp:translate = (0, 0, 20)\n uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    )
    tables = load.load(path).tables
    assert tables.cameras.shutter[0] == pytest.approx(0.05)
    assert tables.keys.move.tolist() == [[0, 0, 0], [1, 0, 0]]
    assert math.isclose(load.load(path, time=0.5).tables.keys.move[0, 0], 10)


def test_the_saved_form_keeps_keys(tmp_path):
    from maquette.compiler.scene import serialize

    path = tmp_path / "a.scene"
    path.write_text("sphere(1, translate: [time / 1s, 0, 0])\ncamera([0, 0, 5], shutter: 10ms)\n")
    scene = load.load(path)
    serialize.save(scene, tmp_path / "a.npz")
    assert serialize.content_hash(load.load(tmp_path / "a.npz")) == serialize.content_hash(replace(scene))


def test_usd_shutters_open_on_time(tmp_path):
    """A sphere that moves 2 m a frame, exposed from a quarter frame before to a quarter after; another camera opens later."""
    path = tmp_path / "a.usda"
    eye = """def Camera "NAME" {
 float focalLength = 50
 float horizontalAperture = 36
 float verticalAperture = 24
 double shutter:open = OPEN
 double shutter:close = CLOSE
 double3 xformOp:translate = (0, 0, 20)
 uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    text = "#usda 1.0\n(\n startTimeCode = 0\n endTimeCode = 10\n timeCodesPerSecond = 10\n)\n"
    text += 'def Sphere "S" {\n double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (20, 0, 0) }\n'
    text += ' uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    for name, start, end in (("main_cam", -0.25, 0.25), ("late", 0.5, 0.75)):
        text += eye.replace("NAME", name).replace("OPEN", str(start)).replace("CLOSE", str(end))
    path.write_text(text)
    scene = load.load(path, code=5)
    tables = scene.tables
    assert tables.cameras.opening == pytest.approx([-0.025, 0.05])
    assert tables.cameras.shutter == pytest.approx([0.05, 0.025])
    row = int(tables.instances.transform[0])
    assert tables.transforms.matrix[row, 0, 3] == pytest.approx(10.0)
    for moment, x in ((0.0, 9.5), (1.0, 11.5)):
        assert instance_transform.transform_at(tables, row, np.array([moment])).matrix[3] == pytest.approx(x)
    assert scene_facts.open_during(tables, 0) == pytest.approx((0.0, 0.5))
    assert scene_facts.open_during(tables, 1) == pytest.approx((0.75, 0.25))


def test_a_lens_moves_with_its_camera(tmp_path):
    """Each ray starts on the lens at the ray's time, and goes to the plane of focus at that time."""
    path = tmp_path / "a.scene"
    path.write_text(
        "sphere(1)\ncamera(position: [20 * time / 1s, 0, 5], look_at: [20 * time / 1s, 0, 0], aperture: 0.05, focus: 2m, shutter: 100ms)\n"
    )
    tables = load.load(path).tables
    view, time = View(0, 40, 30), np.linspace(0, 1, 64)
    lens, n = camera.lens_of(tables, view), np.arange(64)
    ray = camera.generate_ray(tables, view, lens, np.full(64, 9.0), np.full(64, 4.0), n, n, 1, time)
    radius = float(tables.cameras.lens[0])
    away = np.hypot(ray.origin[0] - 2.0 * time, ray.origin[1])
    assert away.max() < radius
    assert away.max() > 0.9 * radius
    assert ray.origin[2] == pytest.approx(np.full(64, 5.0))
    share = 2.0 / -ray.direction[2]  # to the plane in focus
    px, py = camera.image_plane(tables, view, 9.0, 4.0)
    assert ray.origin[0] + share * ray.direction[0] - 2.0 * time == pytest.approx(np.full(64, 2.0 * px))
    assert ray.origin[1] + share * ray.direction[1] == pytest.approx(np.full(64, 2.0 * py))
