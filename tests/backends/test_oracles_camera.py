"""What every backend sees where: the known answers of projection, coverage, clipping and the channels beside the picture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import plan as planner

from .views import alpha, centres, channel

TAN20 = math.tan(math.radians(20))
LIT = "ambient(#ffffff, luminance: 1)\n"
FACING = LIT + "camera(position: [0, 0, 0], look_at: [0, 0, -1], {})\n"


def _plate(z: float) -> str:
    return f"disk(500, center: [0, 0, {-z}], normal: [0, 0, 1])\n"


@pytest.mark.parametrize("z", [0.5, 7.0, 300.0])
def test_a_pixel_sees_the_point_that_the_pinhole_maps_to_it(draw, z):
    """x = W/2 + f X/z and y = H/2 − f Y/z with f = H / (2 tan(fov/2))."""
    image = draw(FACING.format("fov: 40deg") + _plate(z), size=(50, 40), aov=("position", "depth"))
    x, y = centres(image)
    f = 40 / (2 * TAN20)
    position = channel(image, "position")
    assert np.abs(25 + f * position[..., 0] / z - x).max() < 1e-3
    assert np.abs(20 - f * position[..., 1] / z - y).max() < 1e-3
    assert channel(image, "depth") == pytest.approx(z, rel=1e-6)


def test_points_of_a_grid_fall_into_their_pixels(draw):
    """Small balls at the points that fall on the centres of pixels 3, 8, 13, … at depths of their own."""
    f, text = 40 / (2 * TAN20), FACING.format("fov: 40deg")
    expected = np.zeros((40, 40), bool)
    for i in range(3, 40, 5):
        for j in range(3, 40, 5):
            z = 2.0 + (7 * i + 3 * j) % 11
            expected[j, i] = True
            text += f"sphere({0.3 * z / f}, center: [{(i + 0.5 - 20) * z / f}, {(20 - j - 0.5) * z / f}, {-z}])\n"
    assert np.array_equal(alpha(draw(text, size=(40, 40))) == 1.0, expected)


@pytest.mark.parametrize("z", [0.5, 7.0, 3000.0])
def test_an_orthographic_picture_is_the_same_at_any_depth(draw, z):
    """x = W/2 + s X with s = W / width."""
    image = draw(FACING.format("width: 5") + _plate(z), size=(50, 40), aov=("position", "depth"))
    x, y = centres(image)
    position = channel(image, "position")
    assert np.abs(25 + 10 * position[..., 0] - x).max() < 1e-3
    assert np.abs(20 - 10 * position[..., 1] - y).max() < 1e-3
    assert channel(image, "depth") == pytest.approx(z, rel=1e-6)


def test_film_and_focal_length(draw):
    """36 mm of film 50 mm behind the lens: f = W · 50/36 pixels across; the same pixels are square."""
    image = draw(FACING.format("focal: 50mm, film: [36mm, 24mm]") + _plate(2), size=(48, 32), aov=("position",))
    x, y = centres(image)
    f = 48 * 50 / 36
    position = channel(image, "position")
    assert np.abs(24 + f * position[..., 0] / 2 - x).max() < 1e-3
    assert np.abs(16 - f * position[..., 1] / 2 - y).max() < 1e-3


@pytest.mark.parametrize("lens", ["fov: 40deg", f"width: {4 * TAN20}"])
def test_shift_moves_the_frame_over_the_scene(draw, lens):
    """An off-axis frustum: the frame moves right by 0.25 W and up by 0.1 H, straight lines and depths stay as they are."""
    text = FACING.format(f"{lens}, shift: [0.25, 0.1]") + _plate(2)
    image = draw(text, size=(40, 40), aov=("position", "depth"))
    x, y = centres(image)
    f = 40 / (2 * TAN20)
    position = channel(image, "position")
    assert np.abs(20 + f * position[..., 0] / 2 - 0.25 * 40 - x).max() < 1e-3
    assert np.abs(20 - f * position[..., 1] / 2 + 0.1 * 40 - y).max() < 1e-3
    assert channel(image, "depth") == pytest.approx(2.0, rel=1e-6)


def test_a_camera_that_looks_straight_down_keeps_its_up(draw):
    """Pitch 90°: x stays right, −z is up."""
    text = LIT + "camera(position: [3, 5, 1], look_at: [3, 0, 1], up: [0, 0, -1], width: 4)\nplane(y: 0)\n"
    image = draw(text, size=(40, 40), aov=("position",))
    x, y = centres(image)
    position = channel(image, "position")
    assert np.abs(3 + (x - 20) / 10 - position[..., 0]).max() < 1e-5
    assert np.abs(1 + (y - 20) / 10 - position[..., 2]).max() < 1e-5


# --- coverage -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("cx", "cy", "squared"), [(16, 16, 234.48), (15.5, 16, 222.74), (15.5, 15.5, 237.49)])
def test_the_pixels_of_a_disk(draw, cx, cy, squared):
    """Those with (i + ½ − cx)² + (j + ½ − cy)² ≤ R². None is nearer to the edge than the tessellation's 0.05 pixels."""
    radius = math.sqrt(squared)
    text = LIT + f"camera(position: [0, 0, 5], width: 32)\ndisk({radius}, center: [{cx - 16}, {16 - cy}, 0], normal: [0, 0, 1])\n"
    image = draw(text, size=(32, 32))
    x, y = centres(image)
    distance = np.hypot(x - cx, y - cy)
    assert np.abs(distance - radius).min() > 0.05
    assert np.array_equal(alpha(image) == 1.0, distance <= radius)


def _tessellation_share(backend: str, radius: float) -> float:
    """What an outline of chords within 0.05 pixels leaves out of a disk: at most 4/3 · tolerance / R of its area."""
    return 4 / 3 * 0.05 / radius if backend == "raster" else 0.0


def test_coverage_adds_up_to_the_area_of_a_disk(draw, backend):
    text = LIT + "camera(position: [0, 0, 5], width: 48)\ndisk(20, center: [0.3, -0.2, 0], normal: [0, 0, 1])\n"
    image = draw(text, samples=64, filter="box")
    share = float(alpha(image).sum()) / (math.pi * 20**2)
    assert 1 - 1e-3 - _tessellation_share(backend, 20) < share < 1 + 1e-3


def test_an_off_axis_sphere_is_the_ellipse_it_should_be(draw, backend):
    """sin α = R/d at an angle θ, Δ = cos²θ − sin²α: centre f sinθ cosθ/Δ, half axes f sinα cosα/Δ and f sinα/√Δ."""
    theta, distance, radius = math.radians(24), 5.0, 0.6
    centre = (distance * math.sin(theta), -distance * math.cos(theta))
    text = FACING.format("fov: 70deg") + f"sphere({radius}, center: [{centre[0]}, 0, {centre[1]}])\n"
    image = draw(text, size=(96, 96), samples=64, filter="box", background="transparent")
    f = 96 / (2 * math.tan(math.radians(35)))
    sine = radius / distance
    delta = math.cos(theta) ** 2 - sine**2
    a, b = f * sine * math.sqrt(1 - sine**2) / delta, f * sine / math.sqrt(delta)
    covered = alpha(image)
    x, y = centres(image)
    area = covered.sum()
    lost = _tessellation_share(backend, b)
    assert 1 - 1e-3 - lost < area / (math.pi * a * b) < 1 + 1e-3
    assert (covered * x).sum() / area == pytest.approx(48 + f * math.sin(theta) * math.cos(theta) / delta, abs=0.02)
    assert (covered * y).sum() / area == pytest.approx(48, abs=0.02)


def test_alpha_is_coverage_and_the_background_is_black_where_there_is_none(draw):
    """A half plane's edge at 0.25 of pixel 12: the column is covered to 3/4, colour times coverage."""
    text = """
    camera(position: [0, 0, 5], width: 24)
    polygon([[0.25, -50, 0], [50, -50, 0], [50, 50, 0], [0.25, 50, 0]], material: emissive(#ffffff, luminance: 2))
    """
    image = draw(text, size=(24, 24), samples=64, filter="box", background="transparent")
    covered = alpha(image)
    assert np.array_equal(covered[:, :12], np.zeros((24, 12)))
    assert np.array_equal(covered[:, 13:], np.ones((24, 11)))
    assert covered[:, 12] == pytest.approx(0.75, abs=1 / 64)
    assert np.array_equal(image.channels["rgba"][..., 0], 2 * image.channels["rgba"][..., 3])


# --- clipping -----------------------------------------------------------------------------------------------------------


def test_the_near_plane_opens_what_it_cuts(draw):
    """A box 2 m deep, its front at 2 m; near at 3 m: its back wall at 4 m is seen where the front was, never anything nearer."""
    text = "box(2, center: [0, 0, -3])\n"
    whole = draw(FACING.format("fov: 40deg") + text, aov=("depth",))
    cut = draw(FACING.format("fov: 40deg, near: 3") + text, aov=("depth",))
    assert channel(whole, "depth")[24, 24] == pytest.approx(2.0, rel=1e-6)
    assert channel(cut, "depth")[24, 24] == pytest.approx(4.0, rel=1e-6)
    assert channel(cut, "depth").min() >= 3.0


def test_the_far_plane_ends_the_floor(draw):
    """An endless floor 1 m below the eye, far 5 m: rows that meet it at a depth below 5 are covered, the others are not."""
    image = draw(FACING.format("fov: 40deg, far: 5") + "plane(y: -1)\n", aov=("depth",))
    _, y = centres(image)
    f = 48 / (2 * TAN20)
    z = np.where(y > 24, f / np.maximum(y - 24, 1e-9), np.inf)
    assert np.array_equal(alpha(image) == 1.0, z < 5)
    assert np.allclose(channel(image, "depth")[z < 5], z[z < 5], rtol=1e-6)
    assert np.isinf(channel(image, "depth")[z > 5]).all()


def test_a_triangle_that_passes_the_eye_is_drawn_where_rays_meet_it(draw, draw_on):
    """Corners at depths −1, 0.01 and 5: divided by w without clipping this is garbage."""
    text = FACING.format("fov: 60deg") + "triangle([[0.3, -0.5, 1], [-0.004, 0.001, -0.01], [1.5, 2, -5]])\n"
    here, exact = draw(text, aov=("depth",)), draw_on("reference", text, aov=("depth",))
    assert 50 < alpha(exact).sum() < 48 * 48 - 50
    assert np.count_nonzero(alpha(here) != alpha(exact)) <= 2  # a corner snapped to 1/256 pixel may take or give an edge's sample
    both = (alpha(here) == 1) & (alpha(exact) == 1)
    assert np.allclose(channel(here, "depth")[both], channel(exact, "depth")[both], rtol=1e-5)


# --- channels -----------------------------------------------------------------------------------------------------------


def test_channels_of_a_tilted_plane(draw):
    """Depth is n·(p − o) / n·d for d with unit depth; its inverse is affine over the picture; the normal is n."""
    text = FACING.format("fov: 50deg") + "plane(normal: [0.2, 0.5, 1], point: [0, 0, -4])\n"
    image = draw(text, aov=("depth", "normal"))
    x, y = centres(image)
    f = 48 / (2 * math.tan(math.radians(25)))
    direction = np.stack([(x - 24) / f, (24 - y) / f, -np.ones_like(x)], axis=-1)
    normal = np.array([0.2, 0.5, 1.0])
    expected = normal @ np.array([0, 0, -4.0]) / (direction @ normal)
    depth = channel(image, "depth")
    assert np.allclose(depth, expected, rtol=1e-5)
    inverse = 1 / depth
    assert np.abs(np.diff(inverse, n=2, axis=0)).max() < 1e-6
    assert np.abs(np.diff(inverse, n=2, axis=1)).max() < 1e-6
    assert np.allclose(channel(image, "normal"), normal / np.linalg.norm(normal), atol=1e-6)


def test_normals_and_places_of_a_sphere(draw):
    """|p − c| = R and n = (p − c) / R wherever it is seen well inside its outline."""
    text = FACING.format("fov: 40deg") + "sphere(1.5, center: [0.4, -0.3, -6])\n"
    image = draw(text, aov=("position", "normal", "id"))
    out = channel(image, "position") - np.array([0.4, -0.3, -6])
    toward = -(channel(image, "normal") * channel(image, "position")).sum(-1)
    inside = (channel(image, "id")[..., 0] == 0) & (toward > 0.3 * 6)
    assert inside.sum() > 200
    assert np.allclose(np.linalg.norm(out[inside], axis=-1), 1.5, rtol=1e-6)
    assert np.allclose(channel(image, "normal")[inside], out[inside] / 1.5, atol=1e-6)


def test_texture_coordinates_are_perspective_correct(draw):
    """A wall from depth 1 to depth 9 over the whole width: in the middle u = z₀/(z₀ + z₁) = 0.1, not 0.5."""
    text = FACING.format("fov: 90deg") + (
        "polygon([[-1, -90, -1], [9, -90, -9], [9, 90, -9], [-1, 90, -1]], uv: [[0, 0], [1, 0], [1, 1], [0, 1]])\n"
    )
    image = draw(text, size=(49, 49), aov=("uv",))
    x, _ = centres(image)
    screen = (2 * x / 49 - 1)[24]
    expected = (1 + screen) / (10 - 8 * screen)  # −1 + 10 u = screen · (1 + 8 u)
    assert expected[24] == pytest.approx(0.1)
    assert np.allclose(channel(image, "uv")[24, :, 0], expected, atol=1e-5)


def test_ids_are_rows_of_instances_and_materials(draw):
    text = FACING.format("fov: 40deg") + (
        "box(1, center: [-1, 0, -4], material: lambert(#ff0000))\nbox(1, center: [1, 0, -4], material: lambert(#00ff00))\n"
    )
    image = draw(text, aov=("id", "albedo", "depth"))
    ids, albedo = channel(image, "id"), channel(image, "albedo")
    assert ids[24, 14].tolist() == [0, 0]
    assert ids[24, 34].tolist() == [1, 1]
    assert ids[0, 0].tolist() == [-1, -1]
    assert albedo[24, 14].tolist() == [1, 0, 0]
    assert albedo[24, 34].tolist() == [0, 1, 0]
    assert math.isinf(channel(image, "depth")[0, 0])


def test_a_crop_outside_the_picture_is_refused(draw):
    with pytest.raises(planner.PlanError, match="does not lie inside"):
        draw(FACING.format("fov: 40deg") + _plate(1), crop=(0, 0, 99, 99))
