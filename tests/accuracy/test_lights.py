"""Known answers 12 to 17 and 19: lamps over floors, the flux of spots and balls, polygon, sphere and disk lights, penumbras."""

from __future__ import annotations

import math

import numpy as np
import pytest

from . import radiometry as rm

SPREAD = {"reference": 4, "ray": 4, "raster": 32}  # samples that go elsewhere with each seed: up to 16 of the rasterizer's never do
ABOVE = "camera(position: [0, 10, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: {})\n"
FLOOR = "plane(y: 0, material: lambert(1))\n"

every = pytest.mark.parametrize("backend", rm.EVERY)


# --- 12: lamps without extent: L = ρE/π ----------------------------------------------------------------------------------------------


@every
@pytest.mark.parametrize(("albedo", "place", "strength", "intensity"), [
    (1.0, (0.5, 2.0, -0.25), "intensity: 5", 5.0),
    (0.25, (0.5, 2.0, -0.25), f"flux: {20 * math.pi}lm", 5.0),
    (0.7, (-3.0, 0.02, 1.0), "intensity: 0.3", 0.3),
    (0.5, (20.0, 300.0, 40.0), "intensity: 80000", 80000.0),
])  # fmt: skip
def test_a_point_light_over_a_floor(tmp_path, measured, backend, albedo, place, strength, intensity):
    """E = I h / (h² + x²)^1.5; a flux of 4π I lumen is an intensity of I."""
    text = ABOVE.format(6) + f"plane(y: 0, material: lambert({albedo}))\npoint({list(place)}, {strength})\n"
    image = rm.picture(tmp_path, text, backend, aov=("position",))
    x, z = rm.position(image)
    h = place[1]
    expected = albedo / math.pi * intensity * h / (h * h + (x - place[0]) ** 2 + (z - place[2]) ** 2) ** 1.5
    error = float(np.max(np.abs(rm.grey(image) / expected - 1)))
    measured.answer(12, "point light over a floor", backend, error, rm.SINGLE, note="relative, the worst pixel")


@every
@pytest.mark.parametrize("way", [(0, 1, 0), (1, 1, 0), (3, 0.5, -2), (1, 0, 0), (0.2, -1, 0), (1, 1e-3, 0)])
def test_parallel_light_on_a_floor(tmp_path, measured, backend, way):
    """E = E⊥ max(0, cos θ): also along the floor, and from below."""
    text = ABOVE.format(6) + f"plane(y: 0, material: lambert(0.6))\ndirectional(from: {list(way)}, illuminance: 4)\n"
    cosine = max(0.0, way[1] / math.hypot(*way))
    expected = 0.6 * 4 / math.pi * cosine
    found = rm.grey(rm.picture(tmp_path, text, backend, size=(16, 16)))
    error = float(np.abs(found - expected).max()) / (expected or 1.0)
    measured.answer(12, "parallel light on a floor", backend, error, rm.SINGLE, note="relative, the worst pixel")


# --- 13: the flux of a spot ----------------------------------------------------------------------------------------------------------


@pytest.mark.long
@every
@pytest.mark.parametrize(("cone", "soft", "width"), [(40, 15, 2), (60, 60, 4), (25, 5, 1), (35, 0, 1.6)])
def test_the_flux_of_a_spot(tmp_path, measured, backend, cone, soft, width):
    """∫ E dA over the floor below it is 2πI [(1 − cos s) + (cos s − cos t)/2]: the mean of a smoothstep is one half (pbrt-v4 §12.2.3)."""
    text = ABOVE.format(width) + FLOOR + f"spot([0, 1, 0], cone: {cone}deg, soft: {soft}deg, intensity: 7)\n"
    scene = rm.load(tmp_path, text)
    full, end = math.cos(math.radians(cone - soft)), math.cos(math.radians(cone))
    answer = 2 * math.pi * 7 * ((1 - full) + (full - end) / 2)
    found = [
        math.pi * rm.grey(rm.picture(tmp_path, scene, backend, size=(64, 64), samples=SPREAD[backend], seed=k)).mean() * width**2
        for k in range(6)
    ]
    rm.within_error(measured, 13, "flux of a spot", backend, found, answer)


@pytest.mark.long
@every
@pytest.mark.parametrize(("cone", "soft"), [(40, 15), (20, 0), (58, 50)])
def test_a_spot_given_in_lumen_sends_that_flux(tmp_path, measured, backend, cone, soft):
    """The same the other way about: ∫ E dA is the flux that is written."""
    text = ABOVE.format(4) + FLOOR + f"spot([0, 1, 0], cone: {cone}deg, soft: {soft}deg, flux: 30lm)\n"
    scene = rm.load(tmp_path, text)
    pictures = [rm.picture(tmp_path, scene, backend, size=(96, 96), samples=SPREAD[backend], seed=k) for k in range(6)]
    found = [math.pi * rm.grey(each).mean() * 16 for each in pictures]
    rm.within_error(measured, 13, "flux of a spot in lumen", backend, found, 30.0)


# --- 14: the phases of a matt ball ---------------------------------------------------------------------------------------------------


@pytest.mark.long
@every
@pytest.mark.parametrize(("albedo", "radius"), [(0.4, 2.5)])
def test_the_light_of_a_matt_ball_by_its_phase(tmp_path, measured, backend, albedo, radius):
    """∫ L dA over its picture is (2ρE R²/3π)(sin α + (π − α) cos α), α between light and viewer (Lambert 1760)."""
    worst, width = 0.0, 2.1 * radius
    full = 2 * albedo * 3 * radius**2 / 3
    for degrees in (0, 25, 60, 90, 130, 165):
        a = math.radians(degrees)
        text = f"camera(position: [0, 0, 9], look_at: [0, 0, 0], width: {width})\nsphere({radius}, material: lambert({albedo}))\n"
        text += f"directional(from: [{math.sin(a)!r}, 0, {math.cos(a)!r}], illuminance: 3)\n"
        found = rm.grey(rm.picture(tmp_path, text, backend, size=(128, 128), samples=4)).mean() * width**2
        answer = full / math.pi * (math.sin(a) + (math.pi - a) * math.cos(a))
        worst = max(worst, abs(found - answer) / full)
    measured.answer(14, "diffuse ball by its phase", backend, worst, 1e-3, note="relative to the full phase, the worst of six")


# --- 15: polygon lights --------------------------------------------------------------------------------------------------------------

RECTANGLES = {  # position, what it looks at, up (across), edges, where it is received, and the normal there
    "unit square 1 above": ((0, 1, 0), (0, 0, 0), (0, 0, 1), (1, 1), (0, 0, 0), (0, 1, 0)),
    "off its axis": ((0.9, 1.4, -0.3), (0.9, 0, -0.3), (0, 0, 1), (1.3, 0.4), (0.2, 0, 0.1), (0, 1, 0)),
    "tilted light and receiver": ((1, 2, 0), (0, 1, 0), (0, 0, 1), (0.8, 1.6), (0, 0, 0), (0.2, 1, -0.3)),
    "cut by the horizon": ((0.3, 1, 0), (0.3, 0, 0), (0, 0, 1), (2, 2), (0, 0, 0), (1, 0.3, 0.1)),
    "cut by the horizon, upright": ((1, 0.2, 0), (0, 0.2, 0), (0, 1, 0), (1.5, 1.2), (0, 0, 0), (0.3, 1, 0.4)),
}


@every
@pytest.mark.parametrize("name", RECTANGLES)
def test_a_rectangle_light_by_lamberts_formula(tmp_path, measured, backend, name):
    place, at, up, edges, point, normal = RECTANGLES[name]
    c, u = np.array(place, float), np.array(up, float)
    r = rm.unit(np.cross(u, np.array(at, float) - c))
    corners = [c + a * edges[0] / 2 * r + b * edges[1] / 2 * u for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    answer = 2 * rm.under_polygon(corners, point, normal) / math.pi
    if name == "unit square 1 above":
        assert answer / 2 == pytest.approx(0.239456, abs=5e-7)
    text = rm.receiver(point, normal) + f"area({list(place)}, look_at: {list(at)}, up: {list(up)}, size: {list(edges)}, luminance: 2)\n"
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(32, 32), samples=64))
    rm.within_error(measured, 15, f"rectangle light, {name}", backend, values, answer)


POLYGONS = {
    "triangle": [[-1.5, 1, -1], [2, 1.2, -0.8], [0.1, 0.9, 1.8]],
    "pentagon": [[1.5 * math.cos(0.3 + 0.4 * math.pi * k), 1.0, 1.5 * math.sin(0.3 + 0.4 * math.pi * k)] for k in range(5)],
    "triangle cut by the horizon": [[0.4, -1, -1], [0.5, 2, -1], [0.3, 0.4, 2]],
}


@pytest.mark.parametrize("backend", ["ray", pytest.param("reference", marks=pytest.mark.long)])
@pytest.mark.parametrize("name", POLYGONS)
def test_glowing_polygons_met_by_diffuse_rays(tmp_path, measured, backend, name):
    """The same formula for shapes that are no lamps: their light comes by one bounce."""
    answer = rm.under_polygon(POLYGONS[name]) / math.pi
    text = rm.receiver() + f"polygon({POLYGONS[name]}, material: emissive(1, luminance: 1))\nrender(bounces: 1)\n"
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(24, 24), samples=256))
    rm.within_error(measured, 15, f"emissive {name}, by a bounce", backend, values, answer)


# --- 16: sphere lights ---------------------------------------------------------------------------------------------------------------


ABOVE_HORIZON = [(0.4, 1.118, 40), (0.4, 1.118, 0), (5, 60, 70), (1, 1.01, 8)]  # radius, distance, degrees from the normal
ACROSS_HORIZON = [(1.0, 1.5, 70), (1.0, 1.5, 90), (1.0, 1.2, 120), (2.0, 5.0, 95), (1.0, 1.05, 60)]
SPHERES = [
    *[("ray", *case) for case in ABOVE_HORIZON + ACROSS_HORIZON],
    *[("reference", *case) for case in ABOVE_HORIZON[1:] + ACROSS_HORIZON[1:]],
    *[("raster", *case) for case in (ABOVE_HORIZON[0], ACROSS_HORIZON[2])],
]


@pytest.mark.parametrize(("backend", "radius", "distance", "degrees"), SPHERES)
def test_a_sphere_light_above_and_across_the_horizon(tmp_path, measured, backend, radius, distance, degrees):
    """E = πL (R/d)² cos ω where all of it is above, and Snyder's form where the horizon cuts it."""
    w = math.radians(degrees)
    text = rm.receiver(normal=(math.sin(w), math.cos(w), 0))
    text += f"sphere({radius}, center: [0, {distance}, 0], material: emissive(1, luminance: 2))\n"
    answer = 2 * rm.under_sphere(radius, distance, w) / math.pi
    cut = abs(math.cos(w)) * distance < radius
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(32, 32), samples=64))
    rm.within_error(measured, 16, "sphere light, cut by the horizon" if cut else "sphere light above the horizon", backend, values, answer)


# --- 17: disk lights -----------------------------------------------------------------------------------------------------------------


@every
@pytest.mark.parametrize(("radius", "height", "offset"), [(0.6, 1, 0), (0.6, 1, 0.5), (1.2, 0.8, 1.1), (1, 3, 4)])
def test_a_parallel_disk_off_its_axis(tmp_path, measured, backend, radius, height, offset):
    text = rm.receiver((offset, 0, 0)) + f'area([0, {height}, 0], size: {2 * radius}, shape: "disk", luminance: 3)\n'
    answer = 3 * rm.under_disk(radius, height, offset) / math.pi
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(32, 32), samples=64))
    rm.within_error(measured, 17, "parallel disk light", backend, values, answer)


# --- 19: penumbras -------------------------------------------------------------------------------------------------------------------


def seen_share(t: float) -> float:
    """The share of a disk on the near side of a chord at t radii from its middle: ½ + (t √(1 − t²) + asin t)/π."""
    return 0.5 + (t * math.sqrt(1 - t * t) + math.asin(t)) / math.pi


def under_part_of_disk(radius: float, height: float, chord: float) -> float:
    """E, for radiance 1, of the part of a disk straight above with x below a chord: ∫∫ h²/(h² + x² + y²)² dx dy, in y in closed form."""
    angle, weight = rm.legendre(-math.pi / 2, math.asin(chord / radius), 64)  # x = R sin angle: no root at the disk's ends
    a = height**2 + (radius * np.sin(angle)) ** 2
    y = radius * np.cos(angle)
    inner = height**2 * (y / (a * (a + y * y)) + np.arctan(y / np.sqrt(a)) / a**1.5)
    return float(np.sum(inner * y * weight))


@pytest.mark.long
@every
@pytest.mark.parametrize("t", [-0.6, 0.0, 0.35, 0.9])
@pytest.mark.parametrize(("radius", "height"), [(0.02, 1.0), (1.0, 1.0)])
def test_the_penumbra_of_a_half_plane(tmp_path, measured, backend, t, radius, height):
    """Half way up a half-plane hides what of the disk is beyond t radii.

    The list's form is the share of the disk's area: it is the share of its light where the disk is small or far (R/h = 0.02 here: the
    weights of its parts differ by less than R²/h² = 0.04 %). A wide disk weighs its parts by (h/d)⁴: there the answer is the integral.
    """
    edge = t * radius / 2
    text = rm.receiver() + f'area([0, {height}, 0], size: {2 * radius}, shape: "disk", luminance: 1)\n'
    text += f"polygon([[{edge}, {height / 2}, -9], [{edge}, {height / 2}, 9], [9, {height / 2}, 9], [9, {height / 2}, -9]])\n"
    open_ = rm.under_disk(radius, height, 0) / math.pi
    answer = under_part_of_disk(radius, height, t * radius) / math.pi
    assert under_part_of_disk(radius, height, radius) / math.pi == pytest.approx(open_, rel=1e-12)
    name = "penumbra, wide disk by its integral"
    if radius < 0.1:
        assert answer == pytest.approx(open_ * seen_share(t), abs=4e-4 * open_)
        answer, name = open_ * seen_share(t), "penumbra of a half-plane"
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(32, 32), samples=64))
    rm.within_error(measured, 19, name, backend, values, answer, scale=open_, note="relative to the open light")
