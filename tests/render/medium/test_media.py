"""Media: pictures against closed forms and quadratures, kept energy, cameras and lights inside, nested media."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.render.material import medium_stack

LOOK = "camera(position: [0, 0, 4], look_at: [0, 0, 0], fov: 0.2deg)\n"
SKY = "sky(radiance: 1)\n"


def seen(tmp_path: Path, text: str, **settings: Any) -> np.ndarray:
    """The mean of a small picture: red, green, blue, alpha."""
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    settings = {"size": (4, 4), "samples": 256, "denoise": False, "backend": "ray", **settings}
    return maquette.load(path).render(**settings).channels["rgba"].mean(axis=(0, 1))


def column(height: float, slope: float, top: float, falloff: float, distance: np.ndarray) -> np.ndarray:
    """The column of fog along a ray, by the trapezoidal rule over the last of the distances."""
    y = height + slope * distance
    over = np.exp(-np.maximum(y - top, 0) / falloff) if falloff else 0.0
    density = np.where(y <= top, 1.0, over)
    return np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(distance))])


@pytest.mark.parametrize("backend", ["ray", "reference"])
def test_absorption_follows_beer_and_lambert(tmp_path: Path, backend: str) -> None:
    ball = "sphere(1, medium: medium(absorption: [0.5, 1, 2]))\n"
    radiance = seen(tmp_path, LOOK + SKY + ball, backend=backend, samples=16)
    assert radiance[:3] == pytest.approx(np.exp([-1.0, -2.0, -4.0]), rel=2e-3)


def test_emission_follows_its_integral(tmp_path: Path) -> None:
    ball = "sphere(1, medium: medium(absorption: 1, emission: [1, 2, 3]))\n"
    radiance = seen(tmp_path, LOOK + SKY + ball, samples=16)
    assert radiance[:3] == pytest.approx((1 - math.exp(-2)) * np.array([1.0, 2, 3]) + math.exp(-2), rel=2e-3)


@pytest.mark.parametrize("density", ["", ", density: |x, y, z| max(0, 1 - 2 * abs(z)) + 0.2 * noise(8 * x, 8 * y, 8 * z)"])
@pytest.mark.parametrize("phase", [0, 0.8, -0.5])
def test_a_furnace_keeps_all_light(tmp_path: Path, phase: float, density: str) -> None:
    """A ball that absorbs nothing vanishes before a sky of radiance 1, in each colour."""
    ball = f"sphere(1, medium: medium(scattering: [4, 2, 1], absorption: 0, phase: {phase}{density}))\n"
    radiance = seen(tmp_path, LOOK.replace("0.2deg", "40deg") + SKY + ball, samples=512, size=(8, 8))
    assert radiance[:3] == pytest.approx(1.0, abs=0.02)


def test_a_furnace_of_glass_keeps_all_light(tmp_path: Path) -> None:
    ball = "sphere(1, material: glass(ior: 1.5), medium: medium(scattering: [2, 1, 0.5], absorption: 0, phase: 0.7))\n"
    assert seen(tmp_path, LOOK + SKY + ball, samples=1024)[:3] == pytest.approx(1.0, abs=0.02)


def test_a_density_by_a_formula_has_its_integral(tmp_path: Path) -> None:
    ball = "sphere(1, medium: medium(absorption: [1, 2, 3], density: |x, y, z| max(0, 1 - 2 * abs(z))))\n"
    assert seen(tmp_path, LOOK + SKY + ball, samples=4096)[:3] == pytest.approx(np.exp([-0.5, -1, -1.5]), abs=6e-3)


@pytest.mark.parametrize("block", ["scale(2)", "scale([1, 1, 3])", "rotate([0, 90deg, 0])", "translate([0, 0, -7])"])
def test_a_density_moves_with_its_shape(tmp_path: Path, block: str) -> None:
    """The formula has the frame of the shape, the coefficients are per metre of the world."""
    length = {"scale(2)": 2.0, "scale([1, 1, 3])": 3.0}.get(block, 1.0)
    wide = {"rotate([0, 90deg, 0])": "x"}.get(block, "z")
    text = f"{block} {{ sphere(1, medium: medium(absorption: 0.5, density: |x, y, z| abs({wide}))) }}\n"
    radiance = seen(tmp_path, LOOK.replace("0, 0, 4]", "0, 0, 9]") + SKY + text, samples=4096)
    assert radiance[0] == pytest.approx(math.exp(-0.5 * length), abs=6e-3)


@pytest.mark.parametrize(("top", "falloff"), [(2, 3), (2, 0), (20, 3)])
def test_fog_has_its_column(tmp_path: Path, top: float, falloff: float) -> None:
    """A camera above or in a layer of fog looks down on a shining plane."""
    text = "camera(position: [0, 10, 0], look_at: [10, 5, 0], fov: 0.1deg)\nplane(material: emissive(1))\n"
    text += f"fog(scattering: 0, absorption: [0.1, 0.2, 0.3], top: {top}m, falloff: {falloff}m)\n"
    length = column(10, -1 / math.sqrt(5), top, falloff, np.linspace(0, math.sqrt(500), 200_001))[-1]
    assert seen(tmp_path, text, samples=4)[:3] == pytest.approx(np.exp(-length * np.array([0.1, 0.2, 0.3])), rel=1e-3)


def test_the_sun_is_scattered_in_fog_once(tmp_path: Path) -> None:
    """Single scattering of parallel light in fog that falls off, by quadrature; albedo 0.01."""
    text = "camera(position: [0, 1, 0], look_at: [5, 2, 0], fov: 0.1deg)\ndirectional(from: [0, 1, 1], irradiance: 3.14159265)\n"
    text += "fog(scattering: [0.001, 0.002, 0.003], absorption: [0.099, 0.198, 0.297], top: 2m, falloff: 3m, phase: 0)\n"
    t = np.linspace(0, 400, 400_001)
    slope = 1 / math.sqrt(26)
    y = 1 + slope * t
    along = column(1, slope, 2, 3, t)
    above = np.minimum(y, 2) + 3 * (1 - np.exp(-np.maximum(y - 2, 0) / 3))
    density, to_sun = np.where(y <= 2, 1, np.exp(-(y - 2) / 3)), (5 - above) * math.sqrt(2)
    expected = [
        0.01 * sigma / (4 * math.pi) * math.pi * np.sum(density * np.exp(-sigma * (along + to_sun))) * t[1] for sigma in (0.1, 0.2, 0.3)
    ]
    assert seen(tmp_path, text, samples=16384, bounces=0)[:3] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("wall", ["", "box(size: [40, 40, 2], center: [0, 0, -3], material: lambert(0))\n"])
def test_a_point_light_is_scattered_in_fog_once(tmp_path: Path, wall: str) -> None:
    text = LOOK.replace("0.2deg", "0.1deg") + wall + "point([0, 0.05, 0], intensity: 10)\n"
    text += "fog(scattering: 0.0001, absorption: 0.0099, top: 1e6m, falloff: 0m, phase: 0)\n"
    t = np.linspace(0, 6 if wall else 600, 3_000_001)
    d = np.sqrt(0.05**2 + (4 - t) ** 2)
    expected = np.sum(0.0001 / (4 * math.pi) * 10 / d**2 * np.exp(-0.01 * (t + d))) * t[1]
    assert seen(tmp_path, text, samples=8192, bounces=0)[0] == pytest.approx(expected, rel=0.02)


def test_a_camera_inside_of_a_medium(tmp_path: Path) -> None:
    text = LOOK.replace("0, 0, 4]", "0, 0, 0.5]") + SKY + "sphere(1, medium: medium(absorption: [1, 2, 3]))\n"
    assert seen(tmp_path, text, samples=16)[:3] == pytest.approx(np.exp(-1.5 * np.array([1, 2, 3])), rel=0.02)


@pytest.mark.parametrize("priorities", [(0, 1, 2), (0, 0, 0)])
def test_three_nested_media(tmp_path: Path, priorities: tuple[int, int, int]) -> None:
    """The medium of the highest priority, or the smallest, fills the volume where three balls lie in one another, whatever their order."""
    sizes = zip((1.5, 1, 0.5), (0.1, 0.4, 2), priorities, strict=True)
    balls = [f"sphere({r}, medium: medium(absorption: {a}, priority: {p}))\n" for r, a, p in sizes]
    expected = math.exp(-(1.0 * 0.1 + 1.0 * 0.4 + 1.0 * 2))
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
        text = LOOK + SKY + "".join(balls[k] for k in order)
        assert seen(tmp_path, text, samples=16)[0] == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("inner", ["glass(ior: 1.5)", "subsurface(#c05030, radius: 2cm)", "openpbr(subsurface_weight: 1)"])
def test_what_is_in_a_box_of_haze_is_seen_in_any_order(tmp_path: Path, inner: str) -> None:
    """Glass and bodies have the priority of the haze. A box that came later hid them."""
    shapes = [f"sphere(0.4, material: {inner})\n", "box(2, medium: medium(scattering: 0.1, absorption: 0.1))\n"]
    for order, ball, box in ((shapes, 0, 1), (shapes[::-1], 1, 0)):
        (tmp_path / "a.scene").write_text(LOOK + SKY + "".join(order), encoding="utf-8")
        tables = maquette.load(tmp_path / "a.scene").tables
        media: Any = medium_stack.media(tables)
        number = media.number[tables.instances.material]
        assert number[ball] > number[box] > 0


def test_a_body_of_two_materials_has_one_medium(tmp_path: Path) -> None:
    """A ray enters at one material and leaves at another, which takes half of its light."""
    corners = "".join(f"v {x} {y} {z}\n" for z in (-1, 1) for y in (-1, 1) for x in (-1, 1))
    faces = "usemtl a\nf 5 6 8 7\nusemtl b\nf 2 1 3 4\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
    (tmp_path / "two.obj").write_text(f"mtllib a.mtl\n{corners}{faces}", encoding="utf-8")
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 1 1\nnewmtl b\nKd 1 1 1\n", encoding="utf-8")
    text = 'mesh("two.obj", medium: medium(absorption: [0.5, 1, 2]), materials: [["a", glass(ior: 1)], ["b", glass(0.5, ior: 1)]])\n'
    assert seen(tmp_path, LOOK + SKY + text, samples=16)[:3] == pytest.approx(0.5 * np.exp([-1.0, -2, -4]), rel=2e-3)


def test_light_without_shadows_is_attenuated(tmp_path: Path) -> None:
    """A lamp that casts no shadow shines through 3 m of a medium on a wall."""
    text = "camera(position: [0, 0, 0.5], look_at: [0, 0, 0], fov: 0.1deg)\n"
    text += "box(size: [9, 9, 1], center: [0, 0, -0.5], material: lambert(1))\n"
    text += "point([0, 0, 4], intensity: 16, shadows: false)\nsphere(0.75, center: [0, 0, 2], medium: medium(absorption: [1, 2, 3]))\n"
    assert seen(tmp_path, text, samples=16)[:3] == pytest.approx(np.exp(-1.5 * np.array([1, 2, 3])) / math.pi, rel=0.01)


def test_shadows_of_media_are_coloured(tmp_path: Path) -> None:
    text = "camera(position: [3, 0, 3], look_at: [0, 0, 0], fov: 0.1deg)\n"
    text += "box(size: [9, 9, 1], center: [0, 0, -0.5], material: lambert(1))\n"
    text += "directional(from: [0, 0, 1], irradiance: 3.14159265)\nsphere(0.5, center: [0, 0, 1], medium: medium(absorption: [1, 2, 3]))\n"
    assert seen(tmp_path, text, samples=64, bounces=0)[:3] == pytest.approx(np.exp(-np.array([1.0, 2, 3])), rel=0.02)


def albedo_of_half_space(albedo: float, cosine: float) -> float:
    """The share of white light from everywhere that a half space of even scattering sends one way: 1 - √(1 - ϖ) H(μ).

    Chandrasekhar 1960, Radiative Transfer, §33; H by iteration of its integral equation.
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)
    nodes, weights = 0.5 * (nodes + 1), 0.5 * weights
    root = math.sqrt(1 - albedo)
    h = np.ones(64)
    for _ in range(500):
        h = 1 / (root + 0.5 * albedo * (weights * nodes * h / (nodes + nodes[:, None])).sum(axis=1))
    return 1 - root / (root + 0.5 * albedo * (weights * nodes * h / (nodes + cosine)).sum())


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("cosine", [1.0, 0.3])
def test_a_half_space_reflects_by_the_h_function(tmp_path: Path, albedo: float, cosine: float) -> None:
    sine = math.sqrt(1 - cosine * cosine)
    text = f"camera(position: [0, {cosine}, {sine}], look_at: [0, 0, 0], up: [0, 0, -1], fov: 2deg)\n" + SKY
    text += f"box(size: 1000, center: [0, -500, 0], medium: medium(scattering: {albedo}, absorption: {1 - albedo}))\n"
    assert seen(tmp_path, text, samples=4096)[0] == pytest.approx(albedo_of_half_space(albedo, cosine), abs=0.01)


def walked_albedo(albedo: float, g: float, cosine: float, walkers: int = 100_000) -> float:
    """As `albedo_of_half_space` for the phase function of Henyey and Greenstein, by light that walks down from one direction."""
    rng = np.random.default_rng(7)
    depth, mu = np.zeros(walkers), np.full(walkers, -cosine)
    weight, escaped = np.ones(walkers), 0.0
    for _ in range(2000):
        depth = depth + mu * rng.exponential(size=len(mu))
        out = depth > 0
        escaped += weight[out].sum()
        depth, mu, weight = depth[~out], mu[~out], weight[~out] * albedo
        alive = rng.random(len(weight)) < np.minimum(10 * weight, 1)
        depth, mu, weight = depth[alive], mu[alive], weight[alive] / np.minimum(10 * weight[alive], 1)
        if not len(mu):
            break
        turn = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * rng.random(len(mu)))) ** 2) / (2 * g)
        sines = np.sqrt(np.maximum((1 - mu * mu) * (1 - turn * turn), 0))
        mu = mu * turn + sines * np.cos(2 * math.pi * rng.random(len(mu)))
    return escaped / walkers


@pytest.mark.parametrize(("albedo", "g"), [(0.5, 0.8), (0.9, 0.8), (0.99, 0.5), (0.9, -0.6)])
def test_a_half_space_reflects_as_light_that_walks(tmp_path: Path, albedo: float, g: float) -> None:
    text = "camera(position: [0, 1, 0], look_at: [0, 0, 0], up: [0, 0, -1], fov: 2deg)\n" + SKY
    text += f"box(size: 1000, center: [0, -500, 0], medium: medium(scattering: {albedo}, absorption: {1 - albedo}, phase: {g}))\n"
    assert seen(tmp_path, text, samples=4096)[0] == pytest.approx(walked_albedo(albedo, g, 1.0), abs=0.012)

def fluence(albedo: float, r: np.ndarray) -> np.ndarray:
    """The fluence at optical distance r of a point source of unit power in an endless medium of even scattering (Case and Zweifel 1967).

    Its part far from the source is exp(-κ r) / r with κ = ϖ artanh κ, where diffusion theory has κ² = 3 (1 - ϖ).
    """
    low, high, kappa = 1e-6, 1.0 - 1e-12, 0.5  # ϖ artanh κ is below κ at `low`, above it at `high`
    for _ in range(100):
        low, high = (kappa, high) if albedo * math.atanh(kappa) < kappa else (low, kappa)
        kappa = 0.5 * (low + high)
    far = 2 * kappa**2 / (albedo**2 * (1 / (1 - kappa**2) - 1 / albedo)) * np.exp(-kappa * r)
    decays = 1 + np.geomspace(1e-8, 40, 2000)
    spectrum = 1 / ((1 - albedo / decays * np.arctanh(1 / decays)) ** 2 + (albedo * math.pi / (2 * decays)) ** 2)
    near = np.trapezoid(spectrum * np.exp(-decays * r[..., None]), decays, axis=-1)
    return (far + near) / (4 * math.pi * r)


@pytest.mark.parametrize("albedo", [0.5, 0.9])
@pytest.mark.parametrize("r", [2.0, 4.0])
def test_light_far_from_a_point_decays_as_transport_says(tmp_path: Path, albedo: float, r: float) -> None:
    """Seen from within the medium, across the direction of the light. Samples near the point are few and bright: 16 means spread by 3 %."""
    text = f"""
    sphere(40, medium: medium(scattering: {albedo}, absorption: {1 - albedo:g}))
    point([0, 0, 0], intensity: {1 / (4 * math.pi)})
    camera(position: [{r}, 0, 0], look_at: [{r}, 1, 0], fov: 0.2deg)
    """
    t = np.linspace(0, 25, 2000)
    expected = albedo / (4 * math.pi) * np.trapezoid(fluence(albedo, np.hypot(r, t)) * np.exp(-t), t)
    assert seen(tmp_path, text, samples=16384)[0] == pytest.approx(expected, rel=0.08)


def test_both_backends_draw_the_same_media(tmp_path: Path) -> None:
    """A medium by a formula in fog, a glass of milk, and a body beside a lamp, with the same random numbers."""
    path = tmp_path / "a.scene"
    text = LOOK.replace("0.2deg", "60deg") + SKY + "point([0, 2, 1], intensity: 9)\nplane(y: -1)\nfog(visibility: 20m)\n"
    text += "sphere(0.6, medium: medium(#fff, 30cm, density: |x, y, z| 1 - z))\n"
    text += "sphere(0.5, center: [1.2, 0, 0], material: subsurface(#a85))\n"
    text += "sphere(0.5, center: [-1.2, 0, 0], material: glass(ior: 1.33), medium: medium(#fed, 20cm))\n"
    path.write_text(text, encoding="utf-8")
    ours, reference = (
        maquette.load(path)
        .render(size=(24, 16), samples=2, bounces=16, denoise=False, backend=backend, plan=plan)
        .channels["rgba"]
        for backend, plan in (("ray", {"transport.caustics": "paths"}), ("reference", {}))
    )
    assert np.mean(np.abs(ours - reference)) < 1e-3


@pytest.mark.parametrize("threads", [1, 3])
def test_media_have_the_same_bits_on_any_number_of_threads(tmp_path: Path, threads: int) -> None:
    path = tmp_path / "a.scene"
    text = LOOK.replace("0.2deg", "40deg") + SKY + "point([0, 1, 1], intensity: 3)\nplane(y: -1)\nfog(visibility: 20m)\n"
    path.write_text(text + "sphere(1, medium: medium(#fff, 30cm, density: |x, y, z| 1 - z))\n", encoding="utf-8")
    first, second = (
        maquette.load(path).render(size=(70, 40), samples=4, denoise=False, threads=k).channels["rgba"] for k in (threads, 2)
    )
    assert np.array_equal(first, second)


@pytest.mark.parametrize("backend", ["ray", "reference"])
def test_fog_alone_is_drawn(tmp_path: Path, backend: str) -> None:
    """A scene that holds nothing but fog has no instance."""
    text = "camera(position: [0, 1, 0], look_at: [0, 5, 0.0001], fov: 1deg)\n" + SKY
    text += "fog(scattering: 0, absorption: [0.1, 0.2, 0.3], top: 2m, falloff: 3m)\n"
    assert seen(tmp_path, text, samples=4, backend=backend)[:3] == pytest.approx(np.exp(-4 * np.array([0.1, 0.2, 0.3])), rel=2e-3)


@pytest.mark.long
def test_voxels_are_lit_by_a_point(tmp_path: Path) -> None:
    """Beside air and a floor, whose lanes have no voxels; both backends. Their kernels ended with an access outside of memory."""
    np.save(tmp_path / "smoke.npy", np.full((7, 9, 5), 3, np.uint8))
    text = LOOK.replace("0.2deg", "50deg") + "point([1, 2, 1], intensity: 10)\nplane(y: -1, material: lambert(0.5))\n" + SKY
    text += 'box([1, 1.5, 1], medium: medium(scattering: 0.5, density: volume("smoke.npy")))\n'
    ray = seen(tmp_path, text, samples=64, size=(24, 24), bounces=8)
    assert np.isfinite(ray).all()
    assert seen(tmp_path, text, samples=64, size=(24, 24), bounces=8, backend="reference") == pytest.approx(ray, rel=0.02)
