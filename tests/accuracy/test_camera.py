"""Known answers 1 to 7, 9 and 40: where points fall, what filters weigh, how much shapes cover, and the channels beside the picture."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.render.sampling import sobol

from ..backends.views import alpha, centres, channel
from . import radiometry as rm

Array = rm.Array
TAN20 = math.tan(math.radians(20))
LIT = "ambient(#ffffff, luminance: 1)\n"
FACING = "unit m\n" + LIT + "camera(position: [0, 0, 0], look_at: [0, 0, -1], {})\n"
PIXEL = 1e-3  # pixels
DEPTH = 1e-6  # relative
SAMPLES = 64  # a pixel, where areas are summed up
AREA = 1e-3  # relative
CHORDS = "chords lie inside of outlines; the bound includes their share"  # of the raster backend

every = pytest.mark.parametrize("backend", rm.EVERY)


def plate(z: float) -> str:
    """It fills the picture at a depth."""
    return f"disk(9000, center: [0, 0, {-z}], normal: [0, 0, 1])\n"


def worst(*differences: Array | float) -> float:
    return max(float(np.abs(d).max()) for d in differences)


# --- 1: the pinhole ------------------------------------------------------------------------------------------------------------------


@every
@pytest.mark.parametrize("z", [0.5, 7.0, 300.0])
def test_a_pixel_sees_the_point_that_the_pinhole_maps_to_it(tmp_path, measured, backend, z):
    """x = W/2 + f X/z and y = H/2 − f Y/z with f = H / (2 tan(fov/2))."""
    image = rm.picture(tmp_path, FACING.format("fov: 40deg") + plate(z), backend, size=(50, 40), aov=("position", "depth"))
    (x, y), p, f = centres(image), channel(image, "position"), 40 / (2 * TAN20)
    off = worst(25 + f * p[..., 0] / z - x, 20 - f * p[..., 1] / z - y)
    measured.answer(1, "pinhole: the point that a pixel sees", backend, off, PIXEL, "px", "the worst pixel")
    assert worst(channel(image, "depth") / z - 1) <= DEPTH


@every
def test_points_of_a_grid_fall_into_their_pixels(tmp_path, measured, backend):
    """Balls of 0.3 pixels at the points that fall on the centres of pixels 3, 8, 13, … at depths of their own: those and no other."""
    f, text = 40 / (2 * TAN20), FACING.format("fov: 40deg")
    expected = np.zeros((40, 40), bool)
    for i in range(3, 40, 5):
        for j in range(3, 40, 5):
            z = 2.0 + (7 * i + 3 * j) % 11
            expected[j, i] = True
            text += f"sphere({0.3 * z / f}, center: [{(i + 0.5 - 20) * z / f}, {(20 - j - 0.5) * z / f}, {-z}])\n"
    covered = alpha(rm.picture(tmp_path, text, backend, size=(40, 40)))
    wrong = np.count_nonzero(covered != expected)
    measured.answer(1, "pinhole: a grid of points, their pixels", backend, wrong, 0, "pixels wrong", "of 1600")


@every
def test_film_and_focal_length(tmp_path, measured, backend):
    """36 mm of film 50 mm behind the lens: f = W · 50/36 pixels across; the same pixels are square."""
    text = FACING.format("focal: 50mm, film: [36mm, 24mm]") + plate(2)
    image = rm.picture(tmp_path, text, backend, size=(48, 32), aov=("position",))
    (x, y), p, f = centres(image), channel(image, "position"), 48 * 50 / 36
    off = worst(24 + f * p[..., 0] / 2 - x, 16 - f * p[..., 1] / 2 - y)
    measured.answer(1, "pinhole: by film and focal length", backend, off, PIXEL, "px", "the worst pixel")


# --- 2: orthographic -----------------------------------------------------------------------------------------------------------------


@every
@pytest.mark.parametrize("z", [0.5, 7.0, 3000.0])
def test_an_orthographic_picture_is_the_same_at_any_depth(tmp_path, measured, backend, z):
    """x = W/2 + s X with s = W / width; relative to half the width."""
    image = rm.picture(tmp_path, FACING.format("width: 5") + plate(z), backend, size=(50, 40), aov=("position", "depth"))
    (x, y), p = centres(image), channel(image, "position")
    off = worst(25 + 10 * p[..., 0] - x, 20 - 10 * p[..., 1] - y) / 25
    measured.answer(2, "orthographic, at any depth", backend, off, rm.SINGLE, note="relative to half the width, the worst pixel")
    assert worst(channel(image, "depth") / z - 1) <= DEPTH


@every
def test_a_camera_that_looks_straight_down_keeps_its_up(tmp_path, measured, backend):
    """Pitch 90°: x stays right, −z is up."""
    text = LIT + "camera(position: [3, 5, 1], look_at: [3, 0, 1], up: [0, 0, -1], width: 4)\nplane(y: 0)\n"
    image = rm.picture(tmp_path, text, backend, size=(40, 40), aov=("position",))
    (x, y), p = centres(image), channel(image, "position")
    off = worst(3 + (x - 20) / 10 - p[..., 0], 1 + (y - 20) / 10 - p[..., 2]) / 2
    measured.answer(2, "orthographic, straight down", backend, off, rm.SINGLE / 2, note="relative to half the width, the worst pixel")


# --- 3: frames off the axis ----------------------------------------------------------------------------------------------------------


@every
@pytest.mark.parametrize("lens", ["fov: 40deg", f"width: {4 * TAN20}"])
def test_shift_moves_the_frame_over_the_scene(tmp_path, measured, backend, lens):
    """ndc = (2nX/z − r − l)/(r − l). A frame moved right by 0.25 W and up by 0.1 H has (r + l)/(r − l) = 0.5 and, upwards, 0.2, and
    (r − l)/n = 2 tan 20°; straight lines and depths stay as they are. Relative to half the picture, whose ndc is 1.

    An orthographic picture of that width at depth 2 is the same.
    """
    text = FACING.format(f"{lens}, shift: [0.25, 0.1]") + plate(2)
    image = rm.picture(tmp_path, text, backend, size=(40, 40), aov=("position", "depth"))
    (x, y), p = centres(image), channel(image, "position")
    off = worst((p[..., 0] / 2) / TAN20 - 0.5 - (x / 20 - 1), (p[..., 1] / 2) / TAN20 - 0.2 - (1 - y / 20))
    name = "frame off the axis, pinhole" if lens.startswith("fov") else "frame off the axis, orthographic"
    measured.answer(3, name, backend, off, rm.SINGLE, note="of half the picture, the worst pixel")
    assert worst(channel(image, "depth") / 2 - 1) <= DEPTH


# --- 4: filters ----------------------------------------------------------------------------------------------------------------------

FILTERS = ("box", "tent", "gaussian", "blackman-harris")


def share(filter_: str, a: Array | float) -> Array:
    """What a half-plane whose edge lies a pixels beyond a pixel's centre gives it: ∫ w up to a, of a filter w whose integral is 1.

    box: ½ + a, of width 1. tent: ½ + a − a |a|/2, of width 2. gaussian: of e^(−2x²) − e^(−2r²), r = 1.5, by erf. blackman-harris: of
    Σ cₖ cos(kπx/r + kπ), r = 1.65, by sines.
    """
    r = {"box": 0.5, "tent": 1.0, "gaussian": 1.5, "blackman-harris": 1.65}[filter_]
    x = np.clip(np.asarray(a, float), -r, r)
    if filter_ == "box":
        return 0.5 + x
    if filter_ == "tent":
        return 0.5 + x - x * np.abs(x) / 2
    if filter_ == "gaussian":
        bell = np.array([math.erf(math.sqrt(2) * v) for v in x.ravel()]).reshape(x.shape) * math.sqrt(math.pi / 8)
        whole = 2 * (math.erf(math.sqrt(2) * r) * math.sqrt(math.pi / 8) - r * math.exp(-2 * r * r))
        return 0.5 + (bell - x * math.exp(-2 * r * r)) / whole
    waves = sum(c / k * np.sin(k * math.pi * x / r) for k, c in ((1, 0.48829), (2, 0.14128), (3, 0.01168)))
    return 0.5 + (0.35875 * x + r / math.pi * waves) / (0.35875 * 2 * r)


@pytest.mark.parametrize("filter_", FILTERS)
def test_where_samples_of_a_filter_lie(measured, filter_):
    """Samples are drawn as the filter weighs, from 4096 places at even steps of its distribution, rounded to 1/256 of a pixel.

    Midway between the grid's places the share of those up to a is off by half a step of 4096, and by what 16384 trapezoids are off.
    """
    places = np.sort(sobol.filter_table(filter_))
    a = np.arange(-511.5, 512) / 256
    off = worst(np.searchsorted(places, a) / len(places) - share(filter_, a))
    measured.answer(4, f"half-plane under the {filter_} filter", "functions", off, 0.5 / sobol.TABLE + 1e-6, note="of the pixel")


@pytest.mark.long
@every
@pytest.mark.parametrize("filter_", FILTERS)
@pytest.mark.parametrize("a", [77.5 / 256, -100.5 / 256, 10.5 / 256])
def test_a_half_plane_under_a_filter(tmp_path, measured, backend, filter_, a):
    """An upright edge a pixels right of the centre of column 12, in 48 pixels of independent samples; colour times coverage.

    It runs between the places that samples have, 1/256 apart: one that meets them gives a pixel half a step more or less.
    """
    edge = 0.5 + a
    text = "camera(position: [0, 0, 5], width: 24)\n"
    text += f"polygon([[-90, -90, 0], [{edge!r}, -90, 0], [{edge!r}, 90, 0], [-90, 90, 0]], material: emissive(1, luminance: 2))\n"
    image = rm.picture(tmp_path, text, backend, size=(24, 48), samples=SAMPLES, filter=filter_, background="transparent")
    covered = alpha(image)
    assert np.array_equal(rm.grey(image), 2 * covered)
    assert np.array_equal(covered[:, :10], np.ones((48, 10)))
    assert np.array_equal(covered[:, 15:], np.zeros((48, 9)))
    for column in (11, 12, 13):
        answer = float(share(filter_, 12 + a - column))
        rm.within_error(measured, 4, f"half-plane under the {filter_} filter", backend, covered[:, column], answer, 1.0, "of the pixel")


@pytest.mark.parametrize("filter_", FILTERS)
def test_paths_have_no_grid_of_samples(tmp_path, measured, filter_):
    """An edge at places that samples on the rasterizer's grid have: there they would give it 1/512 too much. Paths are off by noise.

    At least half a step of 4096 is allowed; of 1024 points in a net, coverage of a filter is off by a thousandth.
    """
    a = 77.02 / 256
    text = "camera(position: [0, 0, 5], width: 8)\nplane(y: -99, material: lambert(0.5))\n"
    text += f"polygon([[-90, -90, 0], [{a + 0.5!r}, -90, 0], [{a + 0.5!r}, 90, 0], [-90, 90, 0]], material: emissive(1, luminance: 2))\n"
    image = rm.picture(tmp_path, text, "ray", size=(8, 64), samples=1024, filter=filter_, bounces=1, background="transparent")
    for column in (3, 4, 5):
        answer, found = float(share(filter_, 4 + a - column)), float(alpha(image)[:, column].mean())
        measured.answer(4, f"half-plane under the {filter_} filter, by paths", "ray", abs(found - answer), 3e-4, note="of the pixel")


@every
@pytest.mark.parametrize("filter_", FILTERS)
def test_every_filter_keeps_what_is_even(tmp_path, measured, backend, filter_):
    """Weights add up to one."""
    text = "camera(position: [0, 0, 5], width: 2)\nplane(normal: [0, 0, 1], point: [0, 0, 0], material: emissive(0.7, luminance: 1))\n"
    image = rm.picture(tmp_path, text, backend, samples=16, filter=filter_)
    measured.answer(4, "a constant picture under every filter", backend, worst(rm.grey(image) / 0.7 - 1), rm.SINGLE, note="relative")


# --- 5: a disk -----------------------------------------------------------------------------------------------------------------------


@every
@pytest.mark.parametrize(("cx", "cy", "squared"), [(16, 16, 234.48), (15.5, 16, 222.74), (15.5, 15.5, 237.49)])
def test_the_pixels_of_a_disk(tmp_path, measured, backend, cx, cy, squared):
    """Those with (i + ½ − cx)² + (j + ½ − cy)² ≤ R². None is nearer to the edge than the tessellation's 0.05 pixels."""
    radius = math.sqrt(squared)
    text = LIT + f"camera(position: [0, 0, 5], width: 32)\ndisk({radius}, center: [{cx - 16}, {16 - cy}, 0], normal: [0, 0, 1])\n"
    image = rm.picture(tmp_path, text, backend, size=(32, 32))
    x, y = centres(image)
    distance = np.hypot(x - cx, y - cy)
    assert np.abs(distance - radius).min() > 0.05
    wrong = np.count_nonzero(alpha(image) != (distance <= radius))
    measured.answer(5, "disk: its pixels", backend, wrong, 0, "pixels wrong", "of 1024")


def lost(backend: str, radius: float) -> float:
    """What an outline of chords within 0.05 pixels leaves out of a disk: 2/3 of the height of each, so at most 4/3 · 0.05/R of its area
    (2/3 h · 2πR / πR²)."""
    return 4 / 3 * 0.05 / radius if backend == "raster" else 0.0


@pytest.mark.long
@every
def test_coverage_adds_up_to_the_area_of_a_disk(tmp_path, measured, backend):
    text = LIT + "camera(position: [0, 0, 5], width: 48)\ndisk(20, center: [0.3, -0.2, 0], normal: [0, 0, 1])\n"
    share = float(alpha(rm.picture(tmp_path, text, backend, samples=SAMPLES)).sum()) / (math.pi * 20**2)
    assert share < 1 + AREA
    measured.answer(5, "disk: sum of its coverage πR²", backend, abs(share - 1), AREA + lost(backend, 20), note=f"relative; {CHORDS}")


# --- 6: a ball off the axis ----------------------------------------------------------------------------------------------------------


@pytest.mark.long
@every
@pytest.mark.parametrize(("degrees", "distance", "radius"), [(24, 5.0, 0.6), (0, 4.0, 1.2), (33, 3.0, 0.3)])
def test_an_off_axis_ball_is_the_ellipse_it_should_be(tmp_path, measured, backend, degrees, distance, radius):
    """sin α = R/d at an angle θ, Δ = cos²θ − sin²α: centre f sinθ cosθ/Δ, half axes f sinα cosα/Δ and f sinα/√Δ."""
    theta, sine = math.radians(degrees), radius / distance
    text = FACING.format("fov: 80deg")
    text += f"sphere({radius}, center: [{distance * math.sin(theta)!r}, 0, {-distance * math.cos(theta)!r}])\n"
    image = rm.picture(tmp_path, text, backend, size=(96, 96), samples=SAMPLES, background="transparent")
    f = 48 / math.tan(math.radians(40))
    delta = math.cos(theta) ** 2 - sine**2
    a, b = f * sine * math.sqrt(1 - sine**2) / delta, f * sine / math.sqrt(delta)
    covered, (x, y) = alpha(image), centres(image)
    area = float(covered.sum())
    ratio = area / (math.pi * a * b)
    middle = (48 + f * math.sin(theta) * math.cos(theta) / delta, 48.0)
    off = max(abs(float((covered * x).sum()) / area - middle[0]), abs(float((covered * y).sum()) / area - middle[1]))
    assert ratio < 1 + AREA
    bound = AREA + lost(backend, b)
    measured.answer(6, "ball off the axis: area of its ellipse", backend, abs(ratio - 1), bound, note=f"relative; {CHORDS}")
    measured.answer(6, "ball off the axis: centre of its ellipse", backend, off, 0.02, "px")


# --- 9 and 40: channels --------------------------------------------------------------------------------------------------------------


@every
def test_channels_of_a_tilted_plane(tmp_path, measured, backend):
    """Depth is n·(p − o) / n·d for d with unit depth; its inverse is affine over the picture; the normal is n."""
    text = FACING.format("fov: 50deg") + "plane(normal: [0.2, 0.5, 1], point: [0, 0, -4])\n"
    image = rm.picture(tmp_path, text, backend, aov=("depth", "normal"))
    (x, y), f = centres(image), 48 / (2 * math.tan(math.radians(25)))
    direction = np.stack([(x - 24) / f, (24 - y) / f, -np.ones_like(x)], axis=-1)
    normal = np.array([0.2, 0.5, 1.0])
    depth = channel(image, "depth")
    off = worst(depth / (normal @ np.array([0, 0, -4.0]) / (direction @ normal)) - 1)
    measured.answer(9, "depth of a tilted plane", backend, off, rm.SINGLE, note="relative, the worst pixel")
    bent = worst(np.diff(1 / depth, n=2, axis=0), np.diff(1 / depth, n=2, axis=1))
    measured.answer(9, "1/depth is affine over the picture", backend, bent, DEPTH, "1/m", "second differences")
    off = worst(channel(image, "normal") - rm.unit(normal))
    measured.answer(9, "normal of a tilted plane", backend, off, 1e-6, note="the worst component")


@every
def test_normals_and_places_of_a_ball(tmp_path, measured, backend):
    """|p − c| = R and n = (p − c) / R wherever it is seen well inside its outline."""
    text = FACING.format("fov: 40deg") + "sphere(1.5, center: [0.4, -0.3, -6])\n"
    image = rm.picture(tmp_path, text, backend, aov=("position", "normal", "id"))
    out, normal = channel(image, "position") - np.array([0.4, -0.3, -6]), channel(image, "normal")
    toward = -(normal * channel(image, "position")).sum(-1)
    inside = (channel(image, "id")[..., 0] == 0) & (toward > 0.3 * 6)
    assert inside.sum() > 200
    off = worst(np.linalg.norm(out[inside], axis=-1) / 1.5 - 1)
    measured.answer(9, "positions on a ball", backend, off, DEPTH, note="relative to its radius, the worst pixel")
    measured.answer(9, "normals of a ball", backend, worst(normal[inside] - out[inside] / 1.5), 1e-6, note="the worst component")


@every
def test_texture_coordinates_are_perspective_correct(tmp_path, measured, backend):
    """A wall from depth 1 to depth 9 over the whole width: in the middle u = z₀/(z₀ + z₁) = 0.1, not 0.5."""
    text = FACING.format("fov: 90deg") + (
        "polygon([[-1, -90, -1], [9, -90, -9], [9, 90, -9], [-1, 90, -1]], uv: [[0, 0], [1, 0], [1, 1], [0, 1]])\n"
    )
    image = rm.picture(tmp_path, text, backend, size=(49, 49), aov=("uv",))
    screen = (2 * centres(image)[0] / 49 - 1)[24]
    expected = (1 + screen) / (10 - 8 * screen)  # −1 + 10 u = screen · (1 + 8 u)
    assert expected[24] == pytest.approx(0.1)
    u = channel(image, "uv")[24, :, 0]
    off = abs(u[24] / 0.1 - 1)
    measured.answer(40, "perspective: the middle of a wall from 1 to 9 m", backend, off, rm.SINGLE, note="relative to u = 0.1")
    measured.answer(40, "perspective: u across that wall", backend, worst(u - expected), rm.SINGLE, note="of 0 … 1, the worst pixel")


# --- 39: what is out of focus --------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "reference"])
@pytest.mark.parametrize("z", [2.0, 9.0])
def test_the_blur_of_an_edge_out_of_focus(tmp_path, measured, backend, z):
    """A half-plane at depth z, its edge on the axis, through a lens of radius A in focus at zf.

    A ray from a place l of the lens through s on the plane in focus is at s·z/zf + l·(1 − z/zf) at depth z: the edge blurs over a disk
    of radius r = A |z − zf| / z there, so that s sees ½ − (t √(1 − t²) + asin t)/π of it, t = s/r.
    """
    lens, focus = 0.3, 4.0
    text = f"camera(position: [0, 0, 0], look_at: [0, 0, -1], focal: 60mm, film: [36mm, 24mm], aperture: 0.1, focus: {focus}m)\n"
    text += f"polygon([[-90, -90, {-z}], [0, -90, {-z}], [0, 90, {-z}], [-90, 90, {-z}]], material: emissive(1))\n"
    image = rm.picture(tmp_path, text, backend, size=(48, 32), samples=256, background="transparent", crop=(16, 0, 36, 32))
    covered = np.pad(alpha(image), ((0, 0), (16, 12)), mode="edge")
    radius, pixel = lens * abs(z - focus) / z, focus * 36 / 60 / 48
    for column in (24, 25, 27, 29, 31):
        s = (column - 24 + (np.arange(512) + 0.5) / 512) * pixel
        t = np.clip(s / radius, -1, 1)
        answer = float(np.mean(0.5 - (t * np.sqrt(1 - t * t) + np.arcsin(t)) / math.pi))
        name = "blur of an edge out of focus, A |z − zf| / z"
        rm.within_error(measured, 39, name, backend, covered[:, column], answer, 1.0, "of the pixel")
    gone = 24 + math.ceil(radius / pixel)
    assert np.all(covered[:, gone:] == 0.0)
    assert np.all(covered[:, : 48 - gone] == 1.0)


@pytest.mark.long
def test_raster_draws_what_is_out_of_focus_from_points_of_the_lens(tmp_path):
    """Sixteen of them: an edge's blur has sixteen steps; what is in focus is as sharp as through a pinhole."""
    def text(aperture: str, z: float) -> str:
        shape = f"polygon([[-90, -90, {-z}], [0.1, -90, {-z}], [0.1, 90, {-z}], [-90, 90, {-z}]], material: emissive(1))\n"
        return f"camera(position: [0, 0, 0], look_at: [0, 0, -4], focal: 60mm, film: [36mm, 24mm]{aperture})\n" + shape

    def covered(aperture: str, z: float, backend: str = "raster") -> np.ndarray:
        image = rm.picture(tmp_path, text(aperture, z), backend, size=(48, 32), samples=64, background="transparent")
        return alpha(image).mean(axis=0)

    assert covered(", aperture: 0.1", 4.0) == pytest.approx(covered("", 4.0), abs=0.02)
    found = covered(", aperture: 0.1", 9.0)
    true = covered(", aperture: 0.1", 9.0, "ray")
    assert np.abs(found - true).max() < 1.5 / 16
    assert np.abs(found - true).mean() < 0.01
