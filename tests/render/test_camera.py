"""Cameras: pixels against the pinhole's and the orthographic formulas, and rays against the course's P · C⁻¹ · M · X."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import NO_PLANES, CameraData
from maquette.render import camera
from maquette.render.jit.kernel import kernel
from maquette.render.types import Float3, Frame, Options, Ray, View

from . import tables as make

ORTHO = ir.Projection.ORTHOGRAPHIC
FRAME = make.looking((3, 1, 4), (0.5, 0.2, -1), (0.1, 1, 0))
VIEW = View(0, 64, 48)


def scene(frame=FRAME, **camera_):
    camera_ = {"extent": 0.5, **camera_}
    return make.scene(camera=CameraData(transform=1, **camera_), frame=frame)


def vector(v):
    return np.stack(np.broadcast_arrays(*v), axis=-1)


def rays(tables, x, y, view=VIEW):
    ray = camera.generate_pinhole_ray(tables, view, np.asarray(x, float), np.asarray(y, float))
    return vector(ray.origin), vector(ray.direction), ray


def pixels_of(tables, points, view=VIEW):
    """Where points are in the picture, by P · C⁻¹ · X."""
    to_camera, projection = camera.projection_matrices(tables, view)
    clip = np.append(points, np.ones((len(points), 1)), axis=1) @ (projection @ to_camera).T
    ndc = clip[:, :3] / clip[:, 3:]
    return (ndc[:, 0] + 1) / 2 * view.width, (1 - ndc[:, 1]) / 2 * view.height, ndc[:, 2]


def test_pinhole():
    """x = W/2 + f X/z and y = H/2 − f Y/z with f = H / (2 tan(fov/2))."""
    fov = math.radians(50)
    tables = scene(make.IDENTITY, extent=math.tan(fov / 2))
    f = VIEW.height / 2 / math.tan(fov / 2)
    x, y = np.array([0.5, 10.0, 63.5]), np.array([0.5, 40.0, 24.0])
    origin, direction, _ = rays(tables, x, y)
    p = origin + 7 * direction / -direction[:, 2:]
    assert VIEW.width / 2 + f * p[:, 0] / 7 == pytest.approx(x, abs=1e-10)
    assert VIEW.height / 2 - f * p[:, 1] / 7 == pytest.approx(y, abs=1e-10)
    assert np.linalg.norm(direction, axis=1) == pytest.approx(1, abs=1e-15)


def test_orthographic_is_the_same_at_any_depth():
    tables = scene(make.IDENTITY, projection=ORTHO, fit=ir.Fit.HORIZONTAL, extent=2.0)
    origin, direction, _ = rays(tables, [0.0, 64.0, 32.0], [0.0, 48.0, 24.0])
    assert direction == pytest.approx(np.tile([0.0, 0.0, -1.0], (3, 1)), abs=1e-15)
    assert origin[:, :2] == pytest.approx(np.array([[-2, 1.5], [2, -1.5], [0, 0]]), abs=1e-12)


def test_fit_keeps_the_extent_it_names():
    for fit, wide, tall in ((ir.Fit.VERTICAL, 0.5 * 64 / 48, 0.5), (ir.Fit.HORIZONTAL, 0.5, 0.5 * 48 / 64)):
        _, direction, _ = rays(scene(make.IDENTITY, fit=fit), [64.0], [0.0])
        assert direction[0, :2] / -direction[0, 2] == pytest.approx([wide, tall], rel=1e-12)


def test_off_axis_frustum():
    """A shift of s shows what a frustum with l, r = (∓½ + s) · width of the near plane does: ndc = (2nX/z − r − l)/(r − l)."""
    tables = scene(make.IDENTITY, shift=(0.2, -0.1), near=1.0)
    half_x, half_y = 0.5 * 64 / 48, 0.5
    low_x, high_x = (-1 + 0.4) * half_x, (1 + 0.4) * half_x
    low, high = (-1 - 0.2) * half_y, (1 - 0.2) * half_y
    points = np.array([[0.3, 0.1, -2.0], [-0.1, 0.05, -1.5]])
    x, y, _ = pixels_of(tables, points)
    z = -points[:, 2]
    assert x / 32 - 1 == pytest.approx((2 * points[:, 0] / z - high_x - low_x) / (high_x - low_x), rel=1e-10)
    assert 1 - y / 24 == pytest.approx((2 * points[:, 1] / z - high - low) / (high - low), rel=1e-10)


@pytest.mark.parametrize("projection", list(ir.Projection))
@given(x=st.floats(-10, 80), y=st.floats(-10, 60), distance=st.floats(0.01, 1e4), sx=st.floats(-0.5, 0.5), sy=st.floats(-0.5, 0.5))
@settings(max_examples=50, deadline=None)
def test_matrices_put_each_ray_back_on_its_pixel(projection, x, y, distance, sx, sy):
    tables = scene(projection=projection, shift=(sx, sy))
    origin, direction, _ = rays(tables, [x], [y])
    px, py, _ = pixels_of(tables, origin + distance * direction)
    tolerance = 1e-9 if projection == ir.Projection.PERSPECTIVE and distance > 0.1 else 1e-6
    assert (px[0], py[0]) == pytest.approx((x, y), abs=tolerance)


def test_depth_is_along_the_axis_and_near_and_far_are_planes():
    tables = scene(near=0.5, far=9.0)
    origin, direction, ray = rays(tables, [0.5, 31.0, 63.0], [0.5, 20.0, 47.0])
    for t, expected in ((ray.t_min, 0.5), (ray.t_max, 9.0)):
        p = origin + np.asarray(t)[:, None] * direction
        assert camera.depth(tables, VIEW, tuple(p.T)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("projection", list(ir.Projection))
def test_without_near_and_far_rays_start_at_the_camera_and_have_no_end(projection):
    ray = camera.pinhole_ray(scene(projection=projection), VIEW, np.array([3.0]), np.array([4.0]))
    assert np.all(ray.t_max == np.inf)
    assert np.all(ray.t_min == 0.0)


def test_an_orthographic_camera_may_see_what_lies_behind_it():
    _, _, ray = rays(scene(projection=ORTHO, near=-3.0, far=5.0), [3.0], [4.0])
    assert ray.t_min == pytest.approx([-3.0])
    assert ray.t_max == pytest.approx([5.0])


# --- lenses and panoramas ---


def through(tables, x, y, samples, view=VIEW, time=None):
    """Rays of samples 0 … of pixel 7, seed 3, through one place in the picture."""
    n = np.arange(samples)
    lens = camera.lens_of(tables, view)
    ray = camera.generate_ray(tables, view, lens, np.full(samples, x), np.full(samples, y), np.full(samples, 7), n, 3, time)
    return vector(ray.origin), vector(ray.direction), ray


def test_rays_from_all_over_a_lens_meet_in_the_plane_in_focus():
    """Where the pinhole's ray meets the plane z = −focus of the camera's frame; their origins fill a disk of the lens' radius evenly."""
    tables, pinhole = scene(lens=0.25, focus=3.0, shift=(0.1, -0.2)), scene(shift=(0.1, -0.2))
    eye, axis = FRAME[:3, 3], -FRAME[:3, 2]
    for x, y in ((0.5, 0.5), (40.2, 31.0)):
        origin, direction, _ = through(tables, x, y, 4096)
        _, straight, _ = rays(pinhole, [x], [y])
        focused = eye + straight[0] * 3.0 / (straight[0] @ axis)
        closest = origin + direction * np.sum((focused - origin) * direction, axis=1)[:, None]
        assert np.abs(closest - focused).max() < 1e-12
        assert np.linalg.norm(direction, axis=1) == pytest.approx(1.0, abs=1e-14)
        place = (origin - eye) @ FRAME[:3, :3]
        assert np.abs(place[:, 2]).max() < 1e-14
        radius = np.hypot(place[:, 0], place[:, 1]) / 0.25
        assert radius.max() < 1.0
        assert np.mean(radius**2) == pytest.approx(0.5, abs=2e-3)
        assert np.mean(radius**4) == pytest.approx(1 / 3, abs=2e-3)
        assert np.abs(place[:, :2].mean(axis=0)).max() < 2e-3 * 0.25


def test_near_and_far_of_a_lens_are_planes():
    tables = scene(lens=0.25, focus=3.0, near=1.0, far=4.0)
    origin, direction, ray = through(tables, 3.0, 4.0, 64)
    for t, depth in ((ray.t_min, 1.0), (ray.t_max, 4.0)):
        assert camera.depth(tables, VIEW, tuple((origin + direction * t[:, None]).T)) == pytest.approx(depth, abs=1e-12)


@pytest.mark.parametrize("turn", [0.0, 0.125])
def test_the_directions_of_a_panorama(turn):
    """Longitude (x/W − ½ + turn)·360° to the right of straight ahead, latitude (½ − y/H)·180°; all rays start at the camera."""
    tables, view = scene(make.IDENTITY, projection=ir.Projection.PANORAMIC, shift=(turn, 0.0)), View(0, 8, 4)
    y, x = (c.ravel() + 0.5 for c in np.mgrid[:4, :8])
    ray = camera.pinhole_ray(tables, view, x, y)
    longitude, latitude = (x / 8 - 0.5 + turn) * 2 * np.pi, (0.5 - y / 4) * np.pi
    expected = np.stack([np.cos(latitude) * np.sin(longitude), np.sin(latitude), -np.cos(latitude) * np.cos(longitude)], axis=1)
    assert vector(ray.direction) == pytest.approx(expected, abs=1e-15)
    assert np.all(vector(ray.origin) == 0.0)


def test_a_panorama_has_straight_ahead_in_its_middle_and_right_beside_it():
    tables, view = scene(projection=ir.Projection.PANORAMIC), View(0, 80, 40)
    ray = camera.pinhole_ray(tables, view, np.array([40.0, 60.0, 20.0, 40.0]), np.array([20.0, 20.0, 20.0, 0.0]))
    right, up, back = FRAME[:3, 0], FRAME[:3, 1], FRAME[:3, 2]
    assert vector(ray.direction) == pytest.approx(np.stack([-back, right, -right, up]), abs=1e-12)
    assert camera.depth(tables, view, tuple(FRAME[:3, 3] + 2.5 * back)) == pytest.approx(2.5)


def test_depth_order_of_the_matrices():
    for projection in (ir.Projection.PERSPECTIVE, ORTHO):
        tables = scene(make.IDENTITY, projection=projection, near=1.0, far=100.0)
        z = pixels_of(tables, np.array([[0, 0, -1.0], [0, 0, -10], [0, 0, -99]]))[2]
        assert z[0] == pytest.approx(1.0)
        assert z[0] > z[1] > z[2] > 0


@kernel
def _rays(tables, view, x, y, out):
    for k in range(len(x)):
        ray = camera.generate_pinhole_ray(tables, view, x[k], y[k])
        out[k, 0], out[k, 1], out[k, 2] = ray.origin
        out[k, 3], out[k, 4], out[k, 5] = ray.direction
        out[k, 6], out[k, 7] = ray.t_min, ray.t_max


@pytest.mark.parametrize("projection", list(ir.Projection))
def test_kernels_and_numpy_make_the_same_rays(projection):
    tables = scene(projection=projection, near=0.1, far=50.0, shift=(0.1, 0.0))
    x, y = np.random.default_rng(1).uniform(0, 48, (2, 50))
    out = np.empty((50, 8))
    _rays(make.Handle(tables), VIEW, x, y, out)
    ray: Ray = camera.generate_pinhole_ray(tables, VIEW, x, y)
    expected = np.stack(np.broadcast_arrays(*ray.origin, *ray.direction, ray.t_min, ray.t_max), axis=1)
    assert np.abs(out - expected).max() < 1e-12


# --- clipping planes and pixels that are not square ---

plane = st.tuples(*[st.sampled_from([-1.0, -0.3, 0.0, 0.4, 1.0])] * 3, st.floats(-3, 3)).filter(lambda p: any(p[:3]))


def clipped(planes, **camera_):
    return scene(planes=(*planes, *NO_PLANES[len(planes) :]), near=0.1, far=9.0, **camera_)


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(st.lists(plane, max_size=ir.CLIP_PLANES), st.sampled_from([ir.Projection.PERSPECTIVE, ORTHO, ir.Projection.PANORAMIC]))
def test_rays_see_the_positive_side_of_all_clipping_planes(planes, projection):
    tables = clipped(planes, projection=projection)
    ray = camera.pinhole_ray(tables, VIEW, np.arange(0.5, 64, 7), np.arange(0.5, 48, 5))
    unclipped = camera.pinhole_ray(scene(near=0.1, far=9.0, projection=projection), VIEW, np.arange(0.5, 64, 7), np.arange(0.5, 48, 5))
    t = np.linspace(0, 12, 97)[:, None]
    points = vector(ray.origin) + t[..., None] * vector(ray.direction)
    local = (points - FRAME[:3, 3]) @ FRAME[:3, :3]
    heights = np.array([local @ p[:3] + p[3] for p in planes]).reshape(-1, *local.shape[:2])
    unsure = (np.abs(heights) < 1e-9).any(axis=0)
    seen = (heights > 0).all(axis=0) & (unclipped.t_min < t) & (t < unclipped.t_max)
    assert np.all(((ray.t_min < t) & (t < ray.t_max) == seen) | unsure)
    assert np.all(ray.t_min <= ray.t_max)


@kernel
def _lens_rays(tables, frame, x, y, out):
    for k in range(len(x)):
        ray = camera.generate_ray(tables, frame.picture, frame.lens, x[k], y[k], k, 0, 3, None)
        out[k, 0], out[k, 1] = ray.t_min, ray.t_max


@pytest.mark.parametrize("general", [False, True])
@pytest.mark.parametrize("planes", [[], [(1.0, 0.0, 0.3, 0.5)], [(0.0, 1.0, 0.0, 1.0), (0.0, 0.2, 1.0, 4.0), (0.0, 0.0, -1.0, 1e9)]])
def test_kernels_clip_as_numpy_does(planes, general):
    tables = clipped(planes, lens=0.2, focus=3.0)
    x, y = np.random.default_rng(1).uniform(0, 48, (2, 50))
    out, lens = np.empty((50, 2)), camera.lens_of(tables, VIEW, general)
    frame = Frame(VIEW, Options(3, 0, False, True, 0, Float3(0, 0, 0)), np.zeros(2), lens=lens)
    _lens_rays(make.Handle(tables), make.Handle(frame), x, y, out)
    ray = camera.generate_ray(tables, VIEW, camera.lens_of(tables, VIEW), x, y, np.arange(50), np.zeros(50, int), 3, None)
    assert out == pytest.approx(np.stack(np.broadcast_arrays(ray.t_min, ray.t_max), axis=1), rel=1e-12)


@pytest.mark.parametrize("fit", list(ir.Fit))
def test_a_picture_of_wide_pixels_is_that_of_more_square_ones(fit):
    """40 by 48 pixels of aspect 2 show what 80 by 48 square ones do."""
    wide, square = scene(fit=fit, pixel_aspect=2.0), scene(fit=fit)
    x, y = np.array([0.5, 10.0, 40.0]), np.array([3.0, 20.0, 47.0])
    _, direction, _ = rays(wide, x, y, View(0, 40, 48))
    _, expected, _ = rays(square, 2 * x, y, View(0, 80, 48))
    assert direction == pytest.approx(expected, abs=1e-15)
    points = np.array([[0.3, 0.2, -2.0], [1.0, -0.5, -1.0]])
    across, down, _ = pixels_of(wide, points, View(0, 40, 48))
    assert np.array([2 * across, down]) == pytest.approx(np.array(pixels_of(square, points, View(0, 80, 48))[:2]))
