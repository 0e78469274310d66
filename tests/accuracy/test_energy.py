"""Known answers 21 to 23, 33, 34, and 38: furnaces, albedos of lobes, samplers against their densities; and what waits for features."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import LightData
from maquette.render.lanes import ops
from maquette.render.light import light_samples, lights
from maquette.render.material import bsdf, microfacet
from maquette.render.material import energy_compensation as table
from maquette.render.sampling import sobol

from ..backends.views import alpha
from ..render import tables as make
from ..render.material import test_microfacet as facets
from ..render.material.test_bsdf import albedo, hemisphere, shader
from . import radiometry as rm

Array = rm.Array
BLINN = ir.MaterialModel.BLINN_PHONG
PHONG = ir.MaterialModel.PHONG
L = ir.LightKind
WHITE = (1.0, 1.0, 1.0)
UP = (0.0, 1.0, 0.0)

every = pytest.mark.parametrize("backend", rm.EVERY)

# --- 21: in a furnace of radiance 1 what loses nothing is not seen ---------------------------------------------------------------------

FURNACE = "camera(position: [0, 1, 4], look_at: [0, 0, 0], fov: 34deg)\nsky(luminance: 1)\n"
CONVEX = {
    "ball": "sphere(1, material: {})\n",
    "box": "box([1, 1.2, 0.8], rotate: [20deg, 30deg, 0], material: {})\n",
    "ellipsoid": "ellipsoid([0.9, 0.4, 0.7], rotate: [0, 0, 25deg], material: {})\n",
}


@every
@pytest.mark.parametrize("shape", CONVEX)
@pytest.mark.parametrize("material", ["lambert(1)", "mirror(1)", "phong(0.25, specular: 0, k_r: 0.75)"])
def test_what_loses_nothing_vanishes_in_a_furnace(tmp_path, measured, backend, shape, material):
    """Exactly, in every sample: cosine samples of an even sky are all alike."""
    text = FURNACE + CONVEX[shape].format(material) + "render(bounces: 1)\n"
    image = rm.picture(tmp_path, text, backend, samples=2)
    assert 100 < image.channels["rgba"][..., 3].sum() < 48 * 48  # it is there
    error = float(np.abs(rm.grey(image) - 1).max())
    measured.answer(21, f"furnace, {material.split('(')[0]}", backend, error, 1e-6, note="the worst pixel of a convex shape")


@every
@pytest.mark.parametrize(("shape", "ior"), [("ball", 1.5), ("ball", 1.33), ("ellipsoid", 1.5)])
def test_clear_glass_vanishes_in_a_furnace(tmp_path, measured, backend, shape, ior):
    """All paths together carry 1; what is missing are rays of a weight below 10⁻⁴, and those with more than 24 bounces: at a ball's rim
    F is near 1 and light goes round within, so that pixels there miss more than the mean of the picture."""
    text = FURNACE + CONVEX[shape].format(f"glass(ior: {ior})") + "render(bounces: 24)\n"
    found = rm.grey(rm.picture(tmp_path, text, backend))
    assert found.max() <= 1 + rm.SINGLE
    measured.answer(21, "furnace, lossless glass", backend, float(abs(found.mean() - 1)), 2e-3, note="mean of the picture")


@pytest.mark.parametrize("backend", rm.TRACERS)
def test_clear_glass_off_its_rim_vanishes_in_a_furnace(tmp_path, measured, backend):
    """Rays that could add less than 10⁻⁴ are not followed: of the series of those that leave a ball of reflectance r, (1 − r)² rᵏ,
    what is cut sums up to no more than 10⁻⁴/(1 − r), besides the one inside. Off the axis by less than 0.95 R, r is below 0.2."""
    text = "camera(position: [0, 0, 4], width: 2)\nsphere(1, material: glass(ior: 1.5))\nsky(luminance: 1)\n"
    found = rm.grey(rm.picture(tmp_path, text, backend, bounces=40))
    y, x = np.mgrid[0:48, 0:48] + 0.5
    within = np.hypot(x - 24, y - 24) < 0.95 * 24
    assert found.max() < 1 + 1e-6
    error = float(np.abs(found[within] - 1).max())
    measured.answer(21, "furnace, lossless glass but for its rim", backend, error, 1e-4 / 0.8 + 1e-4, note="the worst pixel")


@every
@pytest.mark.parametrize("albedo", [1.0, 0.8])
def test_a_matt_ball_under_an_even_sky(tmp_path, measured, backend, albedo):
    """Direct light of the sky alone: a convex body shows ρ of the sky's radiance, whatever its size and place."""
    text = FURNACE.replace("luminance: 1", "luminance: 3") + f"sphere(0.3, center: [0.4, 0.2, 1], material: lambert({albedo}))\n"
    image = rm.picture(tmp_path, text, backend, aov=("id",))
    found = rm.grey(image)[image.channels["id"][..., 0] == 0]
    assert found.size > 100
    measured.answer(21, "diffuse ball under a constant sky", backend, float(np.abs(found / (3 * albedo) - 1).max()), rm.SINGLE)


@every
@pytest.mark.parametrize("half", [50, 5000])
def test_a_wide_floor_of_triangles_in_a_furnace(tmp_path, measured, backend, half):
    """A white square of two triangles under a sky of 1 shows 1, however wide it is."""
    corners = [[-half, 0, -half], [-half, 0, half], [half, 0, half], [half, 0, -half]]
    text = "camera(position: [0.3, 0.5, 0.2], look_at: [0.3, 0, 0.2], up: [0, 0, -1], fov: 60deg)\nsky(luminance: 1)\n"
    found = rm.grey(rm.picture(tmp_path, text + f"polygon({corners}, material: lambert(1))\n", backend, samples=4))
    measured.answer(21, "furnace, wide floor of triangles", backend, float(np.abs(found - 1).max()), rm.SINGLE)


# --- 22 --------------------------------------------------------------------------------------------------------------------------------


def test_the_albedo_of_ggx(measured):
    """α = 1, F = 1, along the normal: one bounce gives back 1 − ln 2, by Smith's correlated function; with that of the viewer alone what
    facets turn back, upwards or downwards, is all there is: 1. And with the light of further bounces a metal is white in a white room."""
    e, _ = table.integrals(np.array(1.0), np.array(1.0), 200)
    off = abs(float(e) - (1 - math.log(2)))
    measured.answer(22, "GGX's albedo 1 − ln 2, by one bounce", "quadrature", off, 1e-4)
    (x, y, z), solid = hemisphere(200)
    half = ops.normalize((x, y + 1.0, z))
    down = ops.normalize((x, 1.0 - y, z))
    up = tuple(np.broadcast_to(c, x.shape) for c in UP)
    one = np.ones_like(x)
    facets = [microfacet.ggx_distribution(h, up, one) * 0.5 / (1.0 + one) for h in (half, down)]
    off = abs(float(np.sum((facets[0] + facets[1]) * solid)) - 1.0)
    measured.answer(22, "GGX's weak furnace, both sides", "quadrature", off, 1e-4)


@pytest.mark.long
@every
def test_rough_metal_in_a_furnace(tmp_path, measured, backend):
    """A metal that reflects all, α = 1, under a sky of 1."""
    text = FURNACE + "sphere(1, material: principled(rgb(1, 1, 1), metallic: 1, roughness: 1))\n"
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(24, 24), samples=64))
    rm.within_error(measured, 22, "furnace, rough metal with all its bounces", backend, values, 1.0)


# --- 23: albedos at normal incidence ---------------------------------------------------------------------------------------------------


def share_of(model: ir.MaterialModel, n: float) -> float:
    """∫ lobe cos dω / π at normal incidence.

    The list's 2π/(n + 2) and 8π (2^(−n/2) + n)/((n + 2)(n + 4)) are of a lobe that gets irradiance E⊥; the course's models here get
    I = E⊥/π, so that k_d = 1 reflects all of it: both are divided by π.
    """
    if model == BLINN:
        return 8 * (2 ** (-n / 2) + n) / ((n + 2) * (n + 4))
    return 2 / (n + 2)


@pytest.mark.parametrize("model", [PHONG, BLINN])
@pytest.mark.parametrize("n", [1.0, 8.0, 60.0, 250.0])
def test_albedo_of_the_courses_lobes_at_normal_incidence(measured, model, n):
    """By quadrature over the material's own function."""
    error = abs(albedo(make.phong(0, 0.5, n, model), 0.0) / (0.5 * share_of(model, n)) - 1)
    measured.answer(23, "albedo of Phong's lobe" if model == PHONG else "albedo of Blinn-Phong's lobe", "quadrature", error, 1e-6)


@pytest.mark.parametrize("model", [PHONG, BLINN])
@pytest.mark.parametrize("n", [0.0, 1.0, 20.0, 300.0])
def test_normalized_lobes_conserve_energy(measured, model, n):
    """1 at normal incidence, and nowhere more."""
    lobe = make.phong(0, 1.0, n, model, normalized=True)
    error = abs(albedo(lobe, 0.0) - 1)
    for tilt in (0.3, 0.8, 1.2, 1.5):
        error = max(error, albedo(lobe, tilt) - 1)
    measured.answer(23, "albedo of a normalized lobe", "quadrature", error, 1e-6, note="1 at normal incidence, at most 1 elsewhere")


@every
@pytest.mark.parametrize(("model", "n"), [("phong", 8), ("phong", 3), ("blinn_phong", 8)])
def test_albedo_of_the_courses_lobes_in_pictures(tmp_path, measured, backend, model, n):
    """The same from pictures: a floor under parallel light from straight above, seen from Gauss and Legendre's angles.

    In the cosine of the viewer c, cⁿ⁺¹ and ((1 + c)/2)^(n/2) c are polynomials: six nodes integrate them exactly.
    """
    cosines, weights = rm.legendre(0, 1, 6)
    total = 0.0
    for c, w in zip(cosines, weights, strict=True):
        text = f"camera(position: [{math.sqrt(1 - c * c)!r}, {float(c)!r}, 0], look_at: [0, 0, 0], up: [0, 0, 1], width: 0.001)\n"
        text += f"plane(y: 0, material: {model}(0, specular: 0.5, shininess: {n}))\ndirectional(from: [0, 1, 0], illuminance: 2)\n"
        total += 2 * math.pi * w * c * float(rm.grey(rm.picture(tmp_path, text, backend, size=(2, 2))).mean())
    error = abs(total / 2 / (0.5 * share_of(BLINN if model == "blinn_phong" else PHONG, n)) - 1)
    measured.answer(23, f"albedo of {'Phong' if model == 'phong' else 'Blinn-Phong'}'s lobe, by pictures", backend, error, 1e-6)


@every
@pytest.mark.parametrize(("model", "normalized", "n"), [
    ("phong", "true", 30), ("blinn_phong", "true", 30), ("phong", "false", 7), ("blinn_phong", "false", 12),
])  # fmt: skip
def test_a_lobe_under_an_even_sky(tmp_path, measured, backend, model, normalized, n):
    """Seen along the normal a normalized lobe reflects k_s of an even sky; the course's, without its cosine, ∫ lobe dω/π: 2/(n + 1) for
    Phong and 8(1 − 2^(−n/2−1))/(n + 2) for Blinn-Phong, by c = cos(θ/2)² its half vector's cosine squared."""
    answer = 1.0
    if normalized == "false":
        answer = 2 / (n + 1) if model == "phong" else 8 * (1 - 2 ** (-n / 2 - 1)) / (2 * (n / 2 + 1))
    surface = f"plane(y: 0, material: {model}(0, specular: 0.8, shininess: {n}, normalized: {normalized}))\n"
    text = rm.receiver(surface=surface) + "sky(luminance: 1)\n"
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(32, 32), samples=64))
    rm.within_error(measured, 23, "lobe under a constant sky", backend, values, 0.8 * answer)


@pytest.mark.long
def test_the_albedo_of_a_preview_surface(measured):
    """∫ f cos dω of both workflows, with and without a coat, of all roughnesses and tilts: at most 1, but for what tables are off."""
    most = 0.0
    for model, slots in ((ir.MaterialModel.PRINCIPLED, {"ior": 1.5}), (ir.MaterialModel.PRINCIPLED_SPECULAR, {"specular": 0.5})):
        for coat, rough in ((0.0, 0.2), (0.0, 0.6), (0.0, 1.0), (1.0, 0.5)):
            made = facets.given(model, diffuse=1.0, roughness=rough, coat=coat, coat_roughness=0.4, **slots)
            shade = facets.point_of(made)[1]
            out, solid = hemisphere(120)
            for tilt in (0.0, 0.8, 1.3):
                found = bsdf.reflected(shade, UP, out, facets.towards(tilt))[0]
                most = max(most, float(np.sum(found * solid)) / math.pi)
    measured.answer(23, "UsdPreviewSurface's albedo by quadrature, at most 1", "quadrature", max(most - 1.0, 0.0), 0.004)


# --- 34: samplers against their densities, χ² ------------------------------------------------------------------------------------------

COUNT = 1_000_000
SAMPLERS: dict[str, Callable[[], tuple[Array, Array]]] = {}  # name: numbers found in bins, and their shares by integration


def numbers(dimension: int) -> tuple[Array, Array]:
    """Independent pairs of the renderer's own: a sample each of a million pixels."""
    with np.errstate(all="ignore"):
        u, v = sobol.pair(np.arange(COUNT), np.zeros(COUNT, int), np.full(COUNT, dimension), 5)
    return np.asarray(u, float), np.asarray(v, float)


def share_above(x: float, freedom: int) -> float:
    """The share of χ² above a value (Wilson and Hilferty 1931: its cube root is nearly normal; to 10⁻⁴ for the hundreds here)."""
    spread = 2 / (9 * freedom)
    return 0.5 * math.erfc(((x / freedom) ** (1 / 3) - 1 + spread) / math.sqrt(2 * spread))


def chi_squared(found: Array, shares: Array) -> float:
    """p of the counts; bins that expect less than 10 go together."""
    expected = shares.ravel() * COUNT
    counts, rare = found.ravel(), expected < 10
    assert counts.sum() == COUNT
    assert expected.sum() == pytest.approx(COUNT, rel=1e-5)
    rest, missing = counts[rare].sum(), expected[rare].sum()
    statistic = float(np.sum((counts[~rare] - expected[~rare]) ** 2 / expected[~rare]))
    if missing >= 10:
        statistic += float((rest - missing) ** 2 / missing)
    else:
        assert rest <= missing + 6 * math.sqrt(missing) + 3
    return share_above(statistic, int(np.count_nonzero(~rare)) - (0 if missing >= 10 else 1))


def directions(axis: Any, way: Any, low: float, density: Any, bins: int = 20, fine: int = 12) -> tuple[Array, Array]:
    """Counts of directions by cosine with an axis (from `low` to 1, and one for all below) and turn about it, and the integrals of a
    density (n, 3) → (n,) over the same bins by Gauss and Legendre's rule; what is left of 1 is the share below."""
    z = rm.unit(axis)
    x = rm.across(z)
    y = np.cross(z, x)
    d = np.stack(np.broadcast_arrays(*way), axis=-1)
    cosine, turn = d @ z, np.arctan2(d @ y, d @ x)
    turns = np.linspace(-math.pi, math.pi, bins + 1)
    found = np.histogram2d(cosine, turn, [np.linspace(low, 1 + 1e-12, bins + 1), turns])[0].ravel()
    nodes, weights = rm.legendre(0, 1, fine)
    inner = (np.arange(bins)[:, None] + nodes).ravel() / bins
    c, t = low + (1 - low) * inner, -math.pi + 2 * math.pi * inner
    c, t = np.meshgrid(c, t, indexing="ij")
    s = np.sqrt(1 - c * c)
    points = c[..., None] * z + (s * np.cos(t))[..., None] * x + (s * np.sin(t))[..., None] * y
    cells = density(points).reshape(bins, fine, bins, fine) * weights[:, None, None] * weights * (1 - low) * 2 * math.pi / bins**2
    inside = cells.sum(axis=(1, 3)).ravel()
    return np.append(found, COUNT - found.sum()), np.append(inside, max(0.0, 1 - inside.sum()))


def plane_bins(x: Array, y: Array) -> tuple[Array, Array]:
    """Counts of what should be even over [0, 1)²."""
    return np.histogram2d(x, y, 24, [[0, 1], [0, 1]])[0], np.full(24 * 24, 1 / 576)


NORMAL = tuple(rm.unit((0.3, 0.8, -0.5)))


def as_lanes(vector: Any) -> Any:
    return tuple(np.full(COUNT, float(c)) for c in vector)


def cosine_directions() -> tuple[Array, Array]:
    way, cosine = lights.cosine_sample(as_lanes(NORMAL), *numbers(1))
    assert np.allclose(cosine, sum(a * b for a, b in zip(way, NORMAL, strict=True)), atol=1e-12)
    return directions(NORMAL, way, 0.0, lambda d: np.maximum(d @ np.array(NORMAL), 0) / math.pi)


def above_horizon(tilt: float) -> tuple[Array, Array]:
    """Bins stand about the horizon's pole, so that its edge is a border of bins and the density only has a kink at the surface's own."""
    pole = (0.0, 1.0, 0.0)
    normal = np.array([math.sin(tilt), math.cos(tilt), 0.0])
    way, share = lights.cosine_sample_above(as_lanes(normal), as_lanes(pole), np.full(COUNT, True), *numbers(2))
    assert np.allclose(share, (1 + math.cos(tilt)) / 2, rtol=1e-12)
    assert float(np.min(way[1])) >= -1e-12
    way = (way[0], np.maximum(way[1], 0), way[2])  # on the horizon but for rounding
    return directions(pole, way, 0.0, lambda d: np.maximum(d @ normal, 0) / (math.pi * share[0]))


def lobe(model: ir.MaterialModel, n: float, tilt: float) -> tuple[Array, Array]:
    """Phong's density (n + 1)/2π (R·D)ⁿ about the mirrored viewer; Blinn-Phong's, above the surface, (n + 1)/2π (N·H)ⁿ / (4 V·H), with
    all that goes below in one bin."""
    viewer = np.array([math.sin(tilt), math.cos(tilt), 0.0])
    with np.errstate(all="ignore"):
        way, share = bsdf.sample_lobe(shader(make.phong(0, 0.8, n, model)), UP, tuple(viewer), *numbers(3), np.full(COUNT, 0.5))
    if model == PHONG:
        mirrored = np.array([-viewer[0], viewer[1], 0.0])

        def density(d: Array) -> Array:
            return (n + 1) / (2 * math.pi) * np.maximum(d @ mirrored, 0) ** n

        axis = mirrored
    else:

        def density(d: Array) -> Array:
            h = d + viewer
            h = h / np.linalg.norm(h, axis=-1, keepdims=True)
            return (n + 1) / (2 * math.pi) * np.maximum(h[..., 1], 0) ** n / (4 * (h @ viewer))

        axis = np.array(UP)
    d = np.stack(np.broadcast_arrays(*way), axis=-1)[:5000]
    above = d[:, 1] > 1e-6
    with np.errstate(all="ignore"):
        value = bsdf.reflected(shader(make.phong(0, 0.8, n, model)), UP, tuple(d[above].T), tuple(viewer))[0]
    assert np.allclose(share[0][:5000][above], value / (math.pi * density(d[above])), rtol=1e-6)  # what a sample is given
    return directions(axis, way, 0.0, density)


def lamp(light: LightData, frame: Any, position: Any = (0, 0, 0)) -> Any:
    """(direction, distance, irradiance) of samples of a light at a place."""
    with np.errstate(all="ignore"):
        return light_samples.sample(make.scene(lights=[light], frame=frame), 0, as_lanes(position), *numbers(10 + int(light.kind)))


def sphere_from_outside() -> tuple[Array, Array]:
    """Even over the cone it fills, and weighed by its solid angle."""
    centre, radius = np.array([1.0, 2.0, -0.5]), 1.2
    found = lamp(LightData(L.SPHERE, WHITE, transform=1, size=(radius, 0.0)), make.matrix(centre))
    low = math.sqrt(1 - radius**2 / float(centre @ centre))
    solid = 2 * math.pi * (1 - low)
    assert np.allclose(found.irradiance[0], solid, rtol=1e-12)
    assert float(np.min(sum(a * b for a, b in zip(found.direction, rm.unit(centre), strict=True)))) >= low - 1e-12
    return directions(centre, found.direction, low - 1e-13, lambda d: np.full(d.shape[:-1], 1 / solid))


def sphere_from_inside() -> tuple[Array, Array]:
    found = lamp(LightData(L.SPHERE, WHITE, transform=1, size=(2.0, 0.0)), make.matrix((0.4, 0.2, 1.0)))
    assert np.allclose(found.irradiance[0], 4 * math.pi, rtol=1e-12)
    return directions(UP, found.direction, -1.0 - 1e-12, lambda d: np.full(d.shape[:-1], 1 / (4 * math.pi)))


def sun_disk() -> tuple[Array, Array]:
    angle, axis = math.radians(30), rm.unit((1, 2, 3))
    found = lamp(LightData(L.SUN, WHITE, direction=tuple(axis), angle=angle), None)
    solid = 2 * math.pi * (1 - math.cos(angle))
    return directions(axis, found.direction, math.cos(angle) - 1e-13, lambda d: np.full(d.shape[:-1], 1 / solid))


def plate(kind: ir.LightKind) -> tuple[Array, Array]:
    """Even over its area, and weighed by cosine · area / distance²; bins of a disk are of r² and turn."""
    frame, size, place = make.facing((0.5, 2.0, 0.3), (0, 0, 0)), (0.7, 0.4), np.array([0.1, -0.2, 0.6])
    found = lamp(LightData(kind, WHITE, transform=1, size=size), frame, place)
    way, distance = np.stack(found.direction, axis=-1), np.asarray(found.distance)
    local = (place + way * distance[:, None] - frame[:3, 3]) @ frame[:3, :3]
    assert np.abs(local[:, 1]).max() < 1e-8
    area = math.pi * size[0] ** 2 if kind == L.DISK else 4 * size[0] * size[1]
    cosine = -(way @ frame[:3, 1])
    assert np.allclose(found.irradiance[0], cosine * area / distance**2, rtol=1e-8)
    if kind == L.DISK:
        r2 = (local[:, 0] ** 2 + local[:, 2] ** 2) / size[0] ** 2
        return plane_bins(np.clip(r2, 0, 1), np.arctan2(local[:, 2], local[:, 0]) / (2 * math.pi) + 0.5)
    return plane_bins(np.clip(local[:, 0] / size[0] / 2 + 0.5, 0, 1), np.clip(local[:, 2] / size[1] / 2 + 0.5, 0, 1))


SAMPLERS.update({
    "cosine": cosine_directions,
    "cosine above a horizon, 40° off": lambda: above_horizon(math.radians(40)),
    "cosine above a horizon, 130° off": lambda: above_horizon(math.radians(130)),
    "Phong's lobe": lambda: lobe(PHONG, 12.0, 0.9),
    "Blinn-Phong's lobe": lambda: lobe(BLINN, 20.0, 0.9),
    "sphere light": sphere_from_outside,
    "sphere light from inside": sphere_from_inside,
    "sun": sun_disk,
    "rectangle light": lambda: plate(L.RECTANGLE),
    "disk light": lambda: plate(L.DISK),
})  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", SAMPLERS)
def test_a_sampler_against_its_density(measured, name):
    """χ² of a million samples over some hundred bins: p above 1 % for all samplers together (Šidák 1967: 1 − 0.99^(1/m) for each)."""
    p = chi_squared(*SAMPLERS[name]())
    least = 1 - 0.99 ** (1 / len(SAMPLERS))
    strain = math.inf if p == 0 else -math.log10(p)
    measured.answer(34, f"χ² of the sampler: {name}", "functions", strain, -math.log10(least), "−log₁₀ p", "of 10⁶ samples")


@pytest.mark.long
def test_the_test_of_samplers_finds_a_wrong_one():
    """One sample in fifty drawn even over the hemisphere, not by the cosine: found out."""
    way, _ = lights.cosine_sample(as_lanes(UP), *numbers(1))
    u, v = numbers(9)
    wrong = np.arange(COUNT) % 50 == 0
    side, turn = np.sqrt(1 - u * u), 2 * math.pi * v
    mixed = tuple(np.where(wrong, other, c) for other, c in zip((side * np.cos(turn), u, side * np.sin(turn)), way, strict=True))
    assert chi_squared(*directions(UP, mixed, 0.0, lambda d: np.maximum(d[..., 1], 0) / math.pi)) < 1e-6


def test_a_hemisphere_of_directions_is_whole():
    """The quadrature of the albedos: 2π, and π with the cosine."""
    way, solid = hemisphere()
    assert float(solid.sum()) == pytest.approx(2 * math.pi, rel=1e-12)
    assert float((solid * way[1]).sum()) == pytest.approx(math.pi, rel=1e-12)


# --- 38: a moving box ---------------------------------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("backend", rm.EVERY)
def test_a_moving_box(tmp_path, measured, backend):
    """A box w = 1 m wide that moves s = 2 m while the shutter is open: half covered at the most, along w + s = 3 m, 1 m in all."""
    text = (
        "box(size: [1, 9, 1], center: [-1 + 20 * time / 1s, 0, 0], material: emissive(1))\nambient(#ffffff, luminance: 1)\n"
        "camera(position: [0, 0, 9], look_at: [0, 0, 0], width: 4m, shutter: 100ms)\nrender(bounces: 1)\n"
    )
    image = rm.picture(tmp_path, text, backend, size=(32, 16), samples=64, filter="box")
    covered = alpha(image).mean(axis=0)
    x = np.linspace(-2, 2, 33)

    def until(at: Array) -> Array:
        """The integral of the trapezoid that rises from -3/2 to -1/2, stays at 1/2 and falls from 1/2 to 3/2."""
        up, flat, down = (np.clip(at - begin, 0, 1) for begin in (-1.5, -0.5, 0.5))
        return up**2 / 4 + flat / 2 + down / 2 - down**2 / 4

    wanted = np.diff(until(x)) * 8
    noise = 4 * 0.5 / math.sqrt(16 * 64)  # of a column, were its samples not spread
    measured.answer(38, "a moving box's trapezoid", backend, np.abs(covered - wanted).max(), noise, "", "the worst column of 1024 samples")
    area = float(covered.sum() / 8)
    measured.answer(38, "a moving box's area", backend, abs(area - 1), 4 * 0.5 / math.sqrt(512 * 64), "m", "of 1 m")


LAMPS = {
    ", a rectangle": "area([0, 1, 0], size: [0.8, 0.5], luminance: 5)",
    ", a disk": "disk(0.4, center: [0, 0.3, 0], normal: [0.2, -1, 0.1], material: emissive(luminance: 5))",
    ", a triangle": "polygon([[-0.5, 0.2, 0], [0.6, 0.3, 0.1], [0, 0.5, -0.5]], material: emissive(luminance: 5))",
    ", a cylinder": "cylinder(0.1, 1, rotate: [20deg, 0, 70deg], translate: [0, 0.4, 0], material: emissive(luminance: 5))",
    ", a box": "box([0.5, 0.2, 0.3], rotate: [20deg, 30deg, 0], translate: [0, 0.4, 0], material: emissive(luminance: 5))",
    ", an open cone": "cone(0.3, 0.4, top: 0.15, rotate: [20deg, 0, 30deg], translate: [0, 0.5, 0], capped: false, "
    "material: emissive(luminance: 5))",
    ", a closed cone": "cone(0.3, 0.4, rotate: [160deg, 0, 0], translate: [0, 0.5, 0], material: emissive(luminance: 5))",
    ", a torus": "torus(0.3, 0.1, rotate: [30deg, 0, 0], translate: [0, 0.5, 0], material: emissive(luminance: 5))",
    ", an ellipsoid": "sphere(0.2, scale: [1, 0.5, 1.5], rotate: [30deg, 0, 0], translate: [0, 0.5, 0], material: emissive(luminance: 5))",
    ", a capsule": "capsule(0.1, 0.8, rotate: [70deg, 30deg, 0], translate: [0, 0.5, 0], material: emissive(luminance: 5))",
    ", a screen with a pattern": "box([0.8, 0.05, 0.5], center: [0, 0.5, 0], material: emissive(checker(#ffffff, #101010, size: 20cm), "
    "luminance: 5))",
}
PAIRS = (("light", "bsdf"), ("light", "balance"), ("bsdf", "power"), ("balance", "power"))


@pytest.mark.long
@pytest.mark.parametrize(("lamp", "ways"), [*((", a rectangle", ways) for ways in PAIRS), *((lamp, PAIRS[0]) for lamp in list(LAMPS)[1:])])
def test_multiple_importance_sampling(tmp_path, measured, lamp, ways):
    """A matt floor under what shines: the means of two estimators, apart by less than four standard errors of 8 runs each."""
    text = f"plane(y: 0, material: lambert(0.6))\n{LAMPS[lamp]}\n"
    text += "camera(position: [0, 0.6, 3], look_at: [0, 0, 0], fov: 30deg)\nrender(bounces: 1)\n"
    means, errors = [], []
    for way in ways:
        runs = [rm.grey(rm.picture(tmp_path, text, "ray", samples=256, seed=seed, plan={"mis": way})).mean() for seed in range(8)]
        means.append(np.mean(runs))
        errors.append(np.std(runs, ddof=1) / math.sqrt(len(runs)))
    error = math.hypot(*errors)
    assert error < 0.003 * means[0]
    apart = abs(means[0] - means[1]) / means[0]
    measured.answer(33, f"{ways[0]} and {ways[1]} agree{lamp}", "ray", apart, 4 * error / means[0], "", "relative")
