"""Known answers 24 to 28: Fresnel's shares, slabs, prisms and balls of glass, clear and absorbing."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.render.image.image import Image
from maquette.render.lanes import ops
from maquette.render.material.fresnel import fresnel as fresnel_in_lanes
from maquette.render.material.fresnel import refract

from ..backends.views import centres, rgb
from ..files import write_image
from ..render.closed import K, hit
from . import radiometry as rm

Array = rm.Array
N = 1.5  # of the glass, if not said
EXACT = 1e-10  # relative, in double precision
DARK = "ambient(#ffffff, luminance: 1)\n"  # in place of the default sun and sky; what is clear shows none of it
CLEAR = f"phong(0, specular: 0, transmission: 1, ior: {N})"  # refracts all: one path, no Fresnel
LAMP = "material: emissive(1, luminance: 1))\n"

tracers = pytest.mark.parametrize("backend", rm.TRACERS)


@pytest.fixture
def ramp(tmp_path: Path) -> None:
    """a.exr: red is linear in u, so that what is seen tells where a ray ended; green is 1."""
    pixels = np.ones((2, 4096, 3), np.float32)
    pixels[..., 0] = (np.arange(4096) + 0.5) / 4096
    write_image(tmp_path / "a.exr", pixels)


def screen(z: float, half: float) -> str:
    """A wall at z on which red is (x + half) / (2 half)."""
    return (
        f"polygon([[{-half}, {-half}, {z!r}], [{half}, {-half}, {z!r}], [{half}, {half}, {z!r}], [{-half}, {half}, {z!r}]], "
        'uv: [[0, 0], [1, 0], [1, 1], [0, 1]], material: emissive(image("a.exr", wrap: "clamp")))\n'
    )


def ends(image: Image, half: float) -> Array:
    """Where on a screen's x axis the pixels' rays end."""
    assert np.allclose(rgb(image)[..., 1], 1.0, rtol=1e-6)
    return 2 * half * rgb(image)[..., 0] - half


def refracted(d: Any, normal: Any, eta: float) -> Any:
    """The renderer's own, by Snell's law; `normal` is on the incoming side."""
    cosine = np.float64(-ops.dot(d, normal))
    _, bent, total = fresnel_in_lanes(cosine, np.float64(eta))
    assert not total
    return refract(d, normal, cosine, bent, eta)


# --- 24: Fresnel ---------------------------------------------------------------------------------------------------------------------


def reflectance(cosine: Any, n1: float, n2: float) -> Any:
    """The renderer's own."""
    return fresnel_in_lanes(np.asarray(cosine, float), np.full(np.shape(cosine), n1 / n2))[0]


def fresnel(angle: float, n1: float, n2: float) -> float:
    """½ (Rs + Rp) by sines and tangents: sin²(i − r)/sin²(i + r) and tan²(i − r)/tan²(i + r); 1 beyond the critical angle."""
    if angle == 0:
        return ((n1 - n2) / (n1 + n2)) ** 2
    if math.sin(angle) * n1 >= n2:
        return 1.0
    r = math.asin(math.sin(angle) * n1 / n2)
    return 0.5 * ((math.sin(angle - r) / math.sin(angle + r)) ** 2 + (math.tan(angle - r) / math.tan(angle + r)) ** 2)


def mean(cosine_weight: Callable[[Array], Array], low: float, high: float) -> float:
    """∫ over a cosine by Gauss and Legendre, nodes crowded at `low`, where F rises as a root."""
    s, w = rm.legendre(0, 1, 400)
    cosine = low + (high - low) * s * s
    return float(np.sum(cosine_weight(cosine) * 2 * s * (high - low) * w))


def test_fresnel_at_angles_that_are_known(measured):
    """R₀ = ((n − 1)/(n + 1))² = 0.04 from both sides; at tan θ = n Rp = 0 and half of Rs = ((n² − 1)/(n² + 1))² is left; all at grazing."""
    off = max(abs(float(reflectance(1.0, *pair)) / 0.04 - 1) for pair in ((1, N), (N, 1)))
    measured.answer(24, "Fresnel at normal incidence, 0.04", "functions", off, 1e-12, note="relative")
    brewster = 1 / math.sqrt(1 + N * N)
    assert math.degrees(math.acos(brewster)) == pytest.approx(56.3099, abs=1e-4)
    half = 0.5 * ((N * N - 1) / (N * N + 1)) ** 2
    off = abs(float(reflectance(brewster, 1, N)) / half - 1)
    measured.answer(24, "Fresnel at Brewster's angle 56.3099°: only Rs/2", "functions", off, 1e-12, note="relative")
    assert reflectance(0.0, 1.0, N) == 1.0


def test_the_critical_angle(measured):
    """asin(1/n) = 41.8103°, by halving between what goes through and what does not."""
    low, high = 0.0, 90.0
    while high - low > 1e-12:
        middle = (low + high) / 2
        total = bool(fresnel_in_lanes(np.float64(math.cos(math.radians(middle))), np.float64(N))[2])
        low, high = (low, middle) if total else (middle, high)
    assert high == pytest.approx(41.8103, abs=5e-5)
    measured.answer(24, "critical angle 41.8103°", "functions", abs(high - math.degrees(math.asin(1 / N))), 1e-6, "°")


@pytest.mark.parametrize(("side", "n1", "n2", "expected"), [("outside", 1.0, N, 0.0917780), ("inside", N, 1.0, 0.5963458)])
def test_the_diffuse_mean_of_fresnel(measured, side, n1, n2, expected):
    """2 ∫ F cos d cos, with the critical angle as a border of the rule; the same by sines and tangents."""
    border = math.sqrt(max(0.0, 1 - (n2 / n1) ** 2))
    found = sum(mean(lambda c: 2 * c * reflectance(c, n1, n2), *span) for span in ((0.0, border), (border, 1.0)))
    closed = np.vectorize(lambda c: fresnel(math.acos(c), n1, n2))
    assert sum(mean(lambda c: 2 * c * closed(c), *span) for span in ((0.0, border), (border, 1.0))) == pytest.approx(expected, abs=1e-7)
    measured.answer(24, f"diffuse mean of Fresnel, {side}: {expected:.7f}", "quadrature", abs(found / expected - 1), 1e-6)


@tracers
@pytest.mark.parametrize("degrees", [0, 30, math.degrees(math.atan(N)), 80])
@pytest.mark.parametrize("inside", [False, True])
def test_the_reflection_of_a_lamp_in_a_surface_of_glass(tmp_path, measured, backend, degrees, inside):
    """Half of space is glass; what is seen at an angle is F of a lamp there, and nothing of what goes through."""
    up = -1 if inside else 1
    a = math.radians(degrees)
    x, y = math.sin(a), up * math.cos(a)
    text = DARK + f"camera(position: [{-5 * x!r}, {5 * y!r}, 0], look_at: [0, 0, 0], up: [0, 0, 1], width: 0.1, near: 1cm)\n"
    text += f"plane(y: 0, material: glass(ior: {N}))\n"
    text += f"disk(1, center: [{9 * x!r}, {9 * y!r}, 0], normal: [{-x!r}, {-y!r}, 0], {LAMP}"
    answer = fresnel(a, *((N, 1) if inside else (1, N)))
    off = float(np.abs(rm.grey(rm.picture(tmp_path, text, backend, size=(4, 4))) / answer - 1).max())
    name = "a light's reflection in glass, " + ("from within" if inside else "from outside")
    measured.answer(24, name, backend, off, rm.SINGLE, note="relative, at 0°, 30°, 56.3° and 80°")


@tracers
def test_total_reflection_in_a_prism(tmp_path, measured, backend):
    """A right-angled prism is a mirror that shows all of a lamp beside it, but for what its two other faces reflect.

    In at one face and out at another, both at right angles, and to and fro between the two: as through a slab, 2n/(n² + 1).
    Rays of a weight below 10⁻⁴ are not followed.
    """
    text = DARK + (
        "camera(position: [0, 0, 5], width: 1)\nmesh(points: [[-1, -1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, 1], [-1, -1, -1], [-1, 1, -1]], "
        f"faces: [[0, 2, 3, 1], [0, 1, 5, 4], [2, 4, 5, 3], [0, 4, 2], [1, 3, 5]], material: glass(ior: {N}))\n"
        f"box([0.1, 4, 4], center: [-3, 0, 0], {LAMP}"
    )
    off = float(np.abs(rm.grey(rm.picture(tmp_path, text, backend, size=(8, 8))) - 2 * N / (N * N + 1)).max())
    measured.answer(24, "total reflection in a right-angled prism", backend, off, 1e-4, note="of the light")


# --- 25: slabs -----------------------------------------------------------------------------------------------------------------------


@tracers
def test_a_slab_lets_through_what_fresnel_says(tmp_path, measured, backend):
    """T = 2n/(n² + 1) = 0.923077 with all reflections between its faces, and R = 1 − T of a lamp behind the eye.

    Rays of a weight below 10⁻⁴ are not followed.
    """
    text = DARK + f"camera(position: [0, 0, 1], width: 1, near: 1cm)\nbox([40, 40, 0.1], material: glass(ior: {N}))\n"
    through = 2 * N / (N * N + 1)
    lamp = "disk(30, center: [0, 0, {}], normal: [0, 0, {}], " + LAMP
    behind, before = (rm.grey(rm.picture(tmp_path, text + lamp.format(z, -z), backend, size=(8, 8))) for z in (-3, 3))
    off, back = float(np.abs(behind - through).max()), float(np.abs(before - (1 - through)).max())
    measured.answer(25, "through a slab, 2n/(n² + 1)", backend, off, 1e-4, note="of the light")
    measured.answer(25, "back from a slab, 1 − 2n/(n² + 1)", backend, back, 1e-4, note="of the light")


@tracers
@pytest.mark.usefixtures("ramp")
@pytest.mark.parametrize("degrees", [0, 20, 45, 70])
def test_a_slab_shifts_what_is_seen_through_it(tmp_path, measured, backend, degrees):
    """By s sin θ (1 − cos θ/√(n² − sin²θ)), whatever the place; directions stay."""
    angle, thick = math.radians(degrees), 0.7
    text = "camera(position: [0, 0, 9], width: 1)\n" + screen(-4, 2)
    text += f"box([20, 20, {thick}], rotate: [0, {degrees}deg, 0], material: {CLEAR})\n"
    image = rm.picture(tmp_path, text, backend, size=(16, 16))
    shift = thick * math.sin(angle) * (1 - math.cos(angle) / math.sqrt(N * N - math.sin(angle) ** 2))
    moved = (centres(image)[0] - 8) / 16 - ends(image, 2)  # the slab's front is turned to the right, and rays bend against its normal
    measured.answer(25, "shift by a slab of 0.7 m", backend, float(np.abs(moved - shift).max()), 2e-6, "m", "the worst of 0° to 70°")


@tracers
def test_an_absorbing_slab(tmp_path, measured, backend):
    """Half of the light is left after its thickness: with all reflections between its faces (1 − r)²τ/(1 − r²τ²)."""
    text = DARK + "camera(position: [0, 0, 1], width: 1, near: 1cm)\n"
    text += f"box([40, 40, 0.1], material: glass(ior: {N}, inside: rgb(0.5, 0.5, 0.5)))\n"
    text += "disk(30, center: [0, 0, -3], normal: [0, 0, 1], " + LAMP
    turned, left = ((N - 1) / (N + 1)) ** 2, 0.5
    through = (1 - turned) ** 2 * left / (1 - turned**2 * left**2)
    off = float(np.abs(rm.grey(rm.picture(tmp_path, text, backend, size=(8, 8))) - through).max())
    measured.answer(25, "absorbing slab, (1 − r)²τ/(1 − r²τ²)", backend, off, 1e-4, note="of the light")


# --- 26: prisms ----------------------------------------------------------------------------------------------------------------------

APEX = math.radians(60)
LEAST = 2 * math.asin(N * math.sin(APEX / 2)) - APEX  # the least deviation


def test_the_least_deviation_of_a_prism(measured):
    """2 asin(n sin(A/2)) − A = 37.1808°; at it the ray runs symmetrically, and beside it more is turned."""

    def deviation(incidence: float) -> float:
        left, right = ((s * math.cos(APEX / 2), math.sin(APEX / 2), 0.0) for s in (-1, 1))  # outward normals
        d = start = (math.cos(incidence - APEX / 2), math.sin(incidence - APEX / 2), 0.0)
        d = refracted(refracted(d, left, 1 / N), (-right[0], -right[1], 0.0), N)
        return math.acos(min(1.0, ops.dot(start, d)))

    assert math.degrees(LEAST) == pytest.approx(37.1808, abs=5e-5)
    symmetric = (LEAST + APEX) / 2
    assert deviation(symmetric + 0.02) > LEAST
    assert deviation(symmetric - 0.02) > LEAST
    measured.answer(26, "least deviation of a prism, 37.1808°", "functions", abs(deviation(symmetric) / LEAST - 1), EXACT, note="relative")


@tracers
@pytest.mark.usefixtures("ramp")
def test_the_least_deviation_of_a_prism_in_pictures(tmp_path, measured, backend):
    """The ray inside is parallel to the base and half the deviation off the ray outside. Where it goes is read from two screens one
    metre apart."""
    corners = [(0.5 * math.sin(a), 0.5 * math.cos(a)) for a in (math.radians(90 + 120 * k) + LEAST / 2 for k in range(3))]
    points = ", ".join(f"[{x!r}, {y}, {z!r}]" for y in (3, -3) for x, z in corners)
    text = (
        f"camera(position: [0, 0, 9], width: 1cm)\nmesh(points: [{points}], "
        f"faces: [[0, 1, 2], [3, 5, 4], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]], material: {CLEAR})\n"
    )
    places = [ends(rm.picture(tmp_path, text + screen(z, 8), backend, size=(8, 8)), 8) for z in (-3.0, -4.0)]
    off = float(np.abs(np.arctan(places[0] - places[1]) / LEAST - 1).max())
    measured.answer(26, "least deviation of a prism, 37.1808°", backend, off, rm.SINGLE, note="relative")


# --- 27: balls -----------------------------------------------------------------------------------------------------------------------


def focus(height: float) -> float:
    """How far behind a ball of radius 1 a ray at a height crosses the axis: it is turned by i − r twice, and its line passes the middle
    at that height, so that it meets the axis at height/sin 2(i − r) from there. (2 − n)/(2 (n − 1)) for small heights."""
    turned = 2 * (math.asin(height) - math.asin(height / N))
    return height / math.sin(turned) - 1


def through_ball(height: float, n: float, reflections: int = 0) -> tuple[Any, Any]:
    """(place, direction) of a ray along −z as it leaves a ball of radius 1, by the renderer's own functions."""
    o, d = (height, 0.0, 3.0), (0.0, 0.0, -1.0)

    def met() -> Any:
        t, _ = hit(K.SPHERE, [1.0], o, d, 1e-6)
        return tuple(float(c) for c in ops.along(o, d, t[0]))

    o = met()
    d = refracted(d, o, 1 / n)
    for _ in range(reflections):
        o = met()
        d = ops.reflect(d, o)
    o = met()
    return o, refracted(d, ops.negate(o), n)


@pytest.mark.parametrize(("height", "expected"), [(1e-5, 0.5), (0.3, 0.461978), (0.7, focus(0.7))])
def test_a_ball_brings_rays_together_behind_it(measured, height, expected):
    """n = 1.5: near the axis at R/2, 0.461978 R for a ray 0.3 R off it."""
    assert focus(height) == pytest.approx(expected, abs=5e-7)
    o, d = through_ball(height, N)
    found = -(o[2] - o[0] / d[0] * d[2]) - 1
    name = "focus of a ball near its axis, R/2" if height < 0.01 else "focus of a ball off its axis"
    answer = 0.5 if height < 0.01 else focus(height)
    measured.answer(27, name, "functions", abs(found - answer), EXACT, "R")


@tracers
@pytest.mark.usefixtures("ramp")
@pytest.mark.parametrize(("height", "half"), [(0.003, 0.01), (0.3, 1)])
def test_a_ball_brings_rays_together_in_pictures(tmp_path, measured, backend, height, half):
    """A screen stands where they meet: what a ray is off the axis there, over its slope. At 0.003 R the focus is 4·10⁻⁶ R from R/2."""
    text = f"camera(position: [{height}, 0, 9], look_at: [{height}, 0, 0], width: 0.0001)\nsphere(1, material: {CLEAR})\n"
    answer = 0.5 if height < 0.01 else focus(height)
    image = rm.picture(tmp_path, text + screen(-1 - answer, half), backend, size=(9, 9))
    off = abs(float(ends(image, half)[4, 4])) * (1 + answer) / height
    name = "focus of a ball near its axis, R/2" if height < 0.01 else "focus of a ball off its axis"
    measured.answer(27, name, backend, off, rm.SINGLE, "R")


@pytest.mark.long
def test_the_angle_of_the_rainbow(measured):
    """The least deviation after one reflection inside, π + 2i − 4r where sin²i = (4 − n²)/3 (Descartes 1637): 137.9219° for n = 1.333."""
    n = 1.333

    def deviation(height: float) -> float:
        _, d = through_ball(height, n, 1)
        return math.pi - abs(math.atan2(d[0], d[2]))

    sine = math.sqrt((4 - n * n) / 3)
    expected = math.pi + 2 * math.asin(sine) - 4 * math.asin(sine / n)
    assert math.degrees(expected) == pytest.approx(137.9219, abs=5e-5)
    found = min(deviation(h) for h in sine + np.linspace(-1e-3, 1e-3, 2001))
    measured.answer(27, "rainbow at 137.9219°, n = 1.333", "functions", abs(found / expected - 1), EXACT, note="relative")


# --- 28: absorption ------------------------------------------------------------------------------------------------------------------


@tracers
def test_beer_and_lamberts_law(tmp_path, measured, backend):
    """A ball of index 1 of which a third is left after a radius: what is seen through it is 3^(−2√(1 − b²)), b from its middle."""
    text = DARK + "camera(position: [0, 0, 5], width: 2.2)\nsphere(1, material: glass(ior: 1, inside: rgb(1/3, 1/3, 1/3), depth: 1))\n"
    text += "disk(30, center: [0, 0, -3], normal: [0, 0, 1], " + LAMP
    image = rm.picture(tmp_path, text, backend, size=(40, 40))
    x, y = ((c - 20) / 40 * 2.2 for c in centres(image))
    inside = 1 - x * x - y * y
    expected = np.where(inside > 0, 3.0 ** (-2 * np.sqrt(np.maximum(inside, 0))), 1.0)
    sound = np.abs(inside) > 1e-3
    off = float(np.abs(rm.grey(image) / expected - 1)[sound].max())
    measured.answer(28, "Beer–Lambert: a ball of index 1, exp(−2σ√(R² − b²))", backend, off, rm.SINGLE, note="relative")
