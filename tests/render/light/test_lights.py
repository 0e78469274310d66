"""Tests of light sampling against closed forms of irradiance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import LightData
from maquette.render.lanes import ops
from maquette.render.light import light_samples, lights
from maquette.render.sampling import sobol

from .. import tables as make

K = ir.LightKind
WHITE = (1.0, 1.0, 1.0)
UP = (0.0, 1.0, 0.0)


def arriving(light, position, u: Any = 0.5, v: Any = 0.5, frame=None):
    """The only light of a scene at positions, as lanes."""
    tables = make.scene(lights=[light], frame=frame)
    u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
    place = tuple(np.broadcast_to(np.asarray(c, float), u.shape) for c in position)
    with np.errstate(all="ignore"):
        return light_samples.sample(tables, 0, place, u, v)


def irradiance(light, position, normal, frame=None, n=400):
    """E by the midpoint rule over the light's two random numbers: the mean of what its samples give a tilted receiver."""
    u, v = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    samples = arriving(light, position, u, v, frame)
    cosine = sum(d * c for d, c in zip(samples.direction, normal, strict=True))
    return float(np.mean(samples.irradiance[0] * np.maximum(cosine, 0.0)))


def above(height, size=1.0):
    """The frame of an area light at a height over the origin, shining down."""
    return make.facing((0, height, 0), (0, 0, 0)) if size else make.matrix((0, height, 0))


@pytest.mark.parametrize(("h", "x"), [(1.0, 0.0), (2.0, 0.7), (0.3, 5.0)])
def test_a_point_light_over_a_floor_gives_ih_over_distance_cubed(h, x):
    sample = arriving(LightData(K.POINT, (3.0, 2.0, 1.0), position=(0, h, 0)), (x, 0.0, 0.0))
    d = math.hypot(h, x)
    cosine = sample.direction[1]
    assert sample.irradiance[0] * cosine == pytest.approx(3.0 * h / d**3, rel=1e-12)
    assert sample.irradiance[1] / sample.irradiance[0] == pytest.approx(2 / 3, rel=1e-14)
    assert d * (1 - 1e-6) < sample.distance < d


@pytest.mark.parametrize("d", [0.5, 1.0, 3.0])
def test_falloffs(d):
    def strength(falloff, coefficients=(0.0, 0.0, 0.0)):
        light = LightData(K.POINT, WHITE, position=(0, d, 0), falloff=falloff, coefficients=coefficients)
        return float(arriving(light, (0, 0, 0)).irradiance[1])

    assert strength(ir.FalloffKind.INVERSE_SQUARE) == pytest.approx(1 / d**2, rel=1e-12)
    assert strength(ir.FalloffKind.POLYNOMIAL, (1.0, 0.5, 0.25)) == pytest.approx(1 / (1 + 0.5 * d + 0.25 * d * d), rel=1e-12)
    assert strength(ir.FalloffKind.RAMP, (1.0, 2.0, 0.0)) == pytest.approx(min(1.0, max(0.0, 2.0 - d)), abs=1e-12)


def test_a_point_at_the_light_itself_is_finite():
    sample = arriving(LightData(K.POINT, WHITE), (0, 0, 0))
    assert np.isfinite(sample.direction).all()
    assert np.isfinite(np.asarray(sample.irradiance) * np.asarray(sample.direction)).all()


@pytest.mark.parametrize(("cone", "soft"), [(40.0, 10.0), (24.0, 6.0), (80.0, 80.0), (30.0, 0.0)])
def test_spot_flux(cone, soft):
    """The flux is 2πI[(1 − cos s) + (cos s − cos t)/2], s where the fade starts and t where it ends (pbrt-v4 §12.2.3)."""
    cos_end, cos_full = math.cos(math.radians(cone)), math.cos(math.radians(cone - soft))
    cosine = (np.arange(200_000) + 0.5) / 100_000 - 1.0  # over the whole sphere
    sine = np.sqrt(1 - cosine**2)
    light = LightData(K.SPOT, WHITE, direction=(0, -1, 0), cos_cone=cos_end, cos_full=cos_full)
    samples = arriving(light, (sine, -cosine, 0 * sine), u=0 * cosine)
    flux = 2 * math.pi * float(np.mean(samples.irradiance[0])) * 2
    assert flux == pytest.approx(2 * math.pi * ((1 - cos_full) + (cos_full - cos_end) / 2), rel=1e-4)


def test_a_spot_is_full_inside_and_nothing_outside():
    light = LightData(K.SPOT, WHITE, direction=(0, -1, 0), cos_cone=math.cos(0.5), cos_full=math.cos(0.4))
    for angle, expected in ((0.0, 1.0), (0.39, 1.0), (0.51, 0.0), (2.0, 0.0), (math.pi, 0.0)):
        place = (math.sin(angle), -math.cos(angle), 0.0)
        assert float(arriving(light, place).irradiance[0]) == pytest.approx(expected, abs=1e-12)


def test_directional_light_is_irradiance_facing_it_from_everywhere_the_same():
    light = LightData(K.DIRECTIONAL, (2.0, 2.0, 2.0), direction=(0.6, 0.8, 0.0))
    sample = arriving(light, (1e5, -3.0, 0.0))
    assert sample.irradiance[0] == 2.0
    assert float(sample.direction[1]) == pytest.approx(0.8)
    assert np.isinf(sample.distance)


def test_sun_samples_fill_its_disk_evenly():
    angle = math.radians(5)
    light = LightData(K.SUN, WHITE, direction=UP, angle=angle)
    u, v = np.meshgrid((np.arange(100) + 0.5) / 100, (np.arange(100) + 0.5) / 100)
    samples = arriving(light, (0, 0, 0), u, v)
    cosine = samples.direction[1]
    assert np.all(cosine >= math.cos(angle) - 1e-12)
    # Evenly over solid angle, 1 − cos is uniform from 0 to 1 − cos(angle).
    below = np.sort(((1 - cosine) / (1 - math.cos(angle))).ravel())
    assert np.max(np.abs(below - np.linspace(0, 1, below.size))) < 0.011
    assert irradiance(light, (0, 0, 0), UP) == pytest.approx(1.0, abs=(1 - math.cos(angle)))


# --- area lights ---


@pytest.mark.parametrize(("x", "z"), [(0.0, 0.0), (0.5, 0.5), (1.3, -0.4)])
def test_rectangle_against_lamberts_polygon_formula(x, z):
    """E = (L/2) |Σ βᵢ n·Γᵢ|, Γᵢ = unit(vᵢ × vᵢ₊₁), βᵢ the angle between them (Lambert 1760)."""
    height, half = 1.0, (0.5, 0.3)
    frame = above(height)
    corners = [(-half[0], -half[1]), (half[0], -half[1]), (half[0], half[1]), (-half[0], half[1])]
    place = np.array([x, 0.0, z])
    v = [(frame @ [a, 0, b, 1])[:3] - place for a, b in corners]
    total = 0.0
    for a, b in zip(v, v[1:] + v[:1], strict=True):
        crossed = np.cross(a, b)
        total += math.atan2(np.linalg.norm(crossed), a @ b) * crossed[1] / np.linalg.norm(crossed)
    light = LightData(K.RECTANGLE, WHITE, transform=1, size=half)
    assert irradiance(light, (x, 0, z), UP, frame) == pytest.approx(abs(total) / 2, rel=2e-5)


def test_unit_square_at_height_one():
    light = LightData(K.RECTANGLE, WHITE, transform=1, size=(0.5, 0.5))
    assert irradiance(light, (0, 0, 0), UP, above(1.0)) == pytest.approx(0.239456 * math.pi, rel=1e-5)


@pytest.mark.parametrize("q", [0.0, 0.5, 2.0])
def test_parallel_disk_with_an_offset(q):
    """E = ½πL [1 − (h² + q² − R²)/√((h² + q² + R²)² − 4R²q²)]."""
    h, r = 1.0, 0.8
    light = LightData(K.DISK, WHITE, transform=1, size=(r, 0.0))
    expected = 0.5 * math.pi * (1 - (h * h + q * q - r * r) / math.sqrt((h * h + q * q + r * r) ** 2 - 4 * r * r * q * q))
    assert irradiance(light, (q, 0, 0), UP, above(h)) == pytest.approx(expected, rel=2e-5)


@pytest.mark.parametrize("tilt", [0.0, 0.4, 1.0])
def test_sphere_wholly_above_the_horizon(tilt):
    """E = πL (R/d)² cos ω while the sphere does not cross the horizon: sin-1(R/d) + ω ≤ π/2."""
    r, d = 0.4, 1.5
    light = LightData(K.SPHERE, WHITE, transform=1, size=(r, 0.0))
    normal = (math.sin(tilt), math.cos(tilt), 0.0)
    expected = math.pi * (r / d) ** 2 * math.cos(tilt)
    assert irradiance(light, (0, 0, 0), normal, make.matrix((0, d, 0))) == pytest.approx(expected, rel=1e-4)


def test_sphere_that_crosses_the_horizon():
    """With H = d/R, x = √(H² − 1), y = −x cot ω (Snyder 1996, as in the view factor catalogues):
    E/πL = [cos ω acos(y) − x sin ω √(1 − y²)]/(πH²) + atan(sin ω √(1 − y²)/x)/π."""
    r, d, w = 1.0, 1.5, 1.3
    big_h = d / r
    x = math.sqrt(big_h**2 - 1)
    y = -x / math.tan(w)
    s = math.sqrt(1 - y * y)
    expected = (math.cos(w) * math.acos(y) - x * math.sin(w) * s) / (math.pi * big_h**2) + math.atan(math.sin(w) * s / x) / math.pi
    light = LightData(K.SPHERE, WHITE, transform=1, size=(r, 0.0))
    computed = irradiance(light, (0, 0, 0), (math.sin(w), math.cos(w), 0.0), make.matrix((0, d, 0)))
    assert computed == pytest.approx(math.pi * expected, rel=2e-4)


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.1), (0.999, 0.0, 0.0)])
def test_inside_a_sphere_light_irradiance_is_pi(place):
    light = LightData(K.SPHERE, WHITE, transform=1, size=(1.0, 0.0))
    assert irradiance(light, place, UP, make.matrix()) == pytest.approx(math.pi, rel=1e-4)


@pytest.mark.long
@given(st.floats(-6, 6), st.floats(0, 0.999999), st.floats(0, 0.999999))
@settings(max_examples=100, deadline=None)
def test_a_sphere_light_is_met_at_the_distance_it_says(power, u, v):
    """From 1e-6 radii off its surface to 1e6 away; the direction really meets the sphere there."""
    d = 1.0 + 10.0**power
    sample = arriving(LightData(K.SPHERE, WHITE, transform=1, size=(1.0, 0.0)), (0.0, -d, 0.0), u, v, make.matrix())
    p = np.array([c * float(sample.distance) for c in sample.direction]) + [0, -d, 0]
    assert np.linalg.norm(p) == pytest.approx(1.0, abs=3e-7 + 4e-9 * d)
    assert all(np.isfinite(c) for c in sample.irradiance)


def test_plates_shine_to_their_plus_y_only():
    behind = (0, 3, 0)
    for kind in (K.RECTANGLE, K.DISK):
        light = LightData(kind, WHITE, transform=1, size=(0.5, 0.5))
        assert irradiance(light, behind, (0, -1, 0), above(1.0)) == 0.0


def test_samples_of_the_sampler_agree_with_the_closed_form():
    """The same sum with the sampler's own numbers, within four standard errors of plain random numbers' spread."""
    n = 4096
    u, v = sobol.pair(np.full(n, 7), np.arange(n), np.full(n, 3), 0)
    samples = arriving(LightData(K.RECTANGLE, WHITE, transform=1, size=(0.5, 0.5)), (0, 0, 0), u, v, above(1.0))
    values = samples.irradiance[0] * samples.direction[1]
    assert abs(values.mean() - 0.239456 * math.pi) <= 4 * values.std() / math.sqrt(n)


# --- skies ---


def dome(texels, frame=None):
    """A dome with a picture (h, w, 4), its frame row 1."""
    row = {}

    def pictures(builder):
        row["image"] = builder.image(np.asarray(texels, np.float32))

    return make.scene(lights=[LightData(K.DOME, (2.0, 2.0, 2.0), transform=1, image=0)], frame=frame, prepare=pictures)


def radiance_of(tables, *directions):
    d = tuple(np.array(c, float) for c in zip(*directions, strict=True))
    return lights.sky_radiance(tables, 0, d)[0]


def test_a_domes_picture_has_plus_z_in_its_middle_and_plus_x_left_of_it():
    """OpenEXR's latitude-longitude map: longitude +π at the left edge, 0 (+z) in the middle, π/2 is +x."""
    picture = np.zeros((64, 128, 4))
    picture[32, :, 0] = picture[31, :, 0] = np.arange(128) + 0.5
    tables = dome(picture)
    columns = radiance_of(tables, (0, 0, 1), (1, 0, 0), (-1, 0, 0)) / 2.0
    assert columns == pytest.approx([64, 32, 96], abs=1e-6)


def test_a_domes_top_row_is_up():
    picture = np.zeros((8, 16, 4))
    picture[0, :, 0] = 1.0
    assert radiance_of(dome(picture), (0, 1, 0), (0, -1, 0)) == pytest.approx([2.0, 0.0])


def test_a_domes_frame_turns_it():
    picture = np.zeros((64, 128, 4))
    picture[31:33, :, 0] = np.arange(128) + 0.5
    turned = make.matrix(linear=make.turn(1, math.pi / 2))  # +z goes to +x
    assert radiance_of(dome(picture, turned), (1, 0, 0))[0] / 2 == pytest.approx(64, abs=1e-6)


def test_ambient_lights_add_up():
    tables = make.scene(lights=[LightData(K.AMBIENT, (0.1, 0.2, 0.3)), LightData(K.AMBIENT, WHITE), LightData(K.SKY, WHITE)])
    assert lights.ambient(tables) == pytest.approx((1.1, 1.2, 1.3))


@given(st.floats(0, 0.9999999), st.floats(0, 0.9999999), st.integers(0, 2**32))
@settings(max_examples=100, deadline=None)
def test_cosine_directions_are_unit_and_above(u, v, seed):
    n = np.random.default_rng(seed).normal(size=3)
    n = tuple(n / np.linalg.norm(n))
    d, cosine = lights.cosine_sample(n, np.float64(u), np.float64(v))
    assert float(ops.length(d)) == pytest.approx(1.0, abs=1e-12)
    assert float(ops.dot(d, n)) == pytest.approx(float(cosine), abs=1e-12)
