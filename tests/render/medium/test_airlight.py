"""Fog and absorbing media without paths: transmittance, airlight of suns and lamps against quadratures, two-stream radiance."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.render.medium import two_stream

WHITTED = {"transport": "whitted"}
BACKENDS = (  # the first compiles nothing
    pytest.param({"backend": "reference", "plan": WHITTED}, id="reference"),
    pytest.param({"backend": "raster"}, id="raster", marks=pytest.mark.long),
    pytest.param({"backend": "ray", "plan": WHITTED}, id="whitted", marks=pytest.mark.long),
)


def seen(tmp_path: Path, text: str, **settings: Any) -> np.ndarray:
    """The mean of a small picture: red, green, blue, alpha."""
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    settings = {"size": (4, 4), "samples": 4, "denoise": False, **settings}
    return maquette.load(path).render(**settings).channels["rgba"].mean(axis=(0, 1))


def density(y: np.ndarray, top: float, falloff: float) -> np.ndarray:
    return np.where(y <= top, 1.0, np.exp(-np.maximum(y - top, 0) / falloff) if falloff else 0.0)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("top", "falloff"), [(2, 3), (2, 0), (20, 3)])
def test_fog_has_its_column(tmp_path: Path, top: float, falloff: float, backend: dict[str, Any]) -> None:
    text = "camera(position: [0, 10, 0], look_at: [10, 5, 0], fov: 0.1deg)\nplane(material: emissive(1))\n"
    text += f"fog(scattering: 0, absorption: [0.1, 0.2, 0.3], top: {top}m, falloff: {falloff}m)\n"
    t = np.linspace(0, math.sqrt(500), 200_001)
    length = np.sum(density(10 - t / math.sqrt(5), top, falloff)) * t[1]
    assert seen(tmp_path, text, **backend)[:3] == pytest.approx(np.exp(-length * np.array([0.1, 0.2, 0.3])), rel=2e-3)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_sun_is_scattered_in_fog_once(tmp_path: Path, backend: dict[str, Any]) -> None:
    """Single scattering of parallel light by quadrature; the albedo is 0.01. Nothing is behind: alpha is the fog's opacity."""
    text = "camera(position: [0, 1, 0], look_at: [5, 2, 0], fov: 0.1deg)\ndirectional(from: [0, 1, 1], irradiance: 3.14159265)\n"
    text += "fog(scattering: [0.001, 0.002, 0.003], absorption: [0.099, 0.198, 0.297], top: 2m, falloff: 3m, phase: 0)\n"
    t = np.linspace(0, 400, 400_001)
    y = 1 + t / math.sqrt(26)
    along = np.cumsum(density(y, 2, 3)) * t[1]
    above = np.minimum(y, 2) + 3 * (1 - np.exp(-np.maximum(y - 2, 0) / 3))
    way = along + (5 - above) * math.sqrt(2)
    expected = [0.01 * sigma / 4 * np.sum(density(y, 2, 3) * np.exp(-sigma * way)) * t[1] for sigma in (0.1, 0.2, 0.3)]
    passed = np.mean(np.exp(-along[-1] * np.array([0.1, 0.2, 0.3])))
    assert seen(tmp_path, text, **backend) == pytest.approx([*expected, 1 - passed], rel=0.015)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("wall", ["", "box(size: [40, 40, 2], center: [0, 0, -3], material: lambert(0))\n"])
def test_a_point_light_is_scattered_in_fog_once(tmp_path: Path, wall: str, backend: dict[str, Any]) -> None:
    text = "camera(position: [0, 0, 4], look_at: [0, 0, 0], fov: 0.1deg)\n" + wall + "point([0, 0.05, 0], intensity: 10)\n"
    text += "fog(scattering: 0.0001, absorption: 0.0099, top: 1e6m, falloff: 0m, phase: 0)\n"
    t = np.linspace(0, 6 if wall else 600, 3_000_001)
    d = np.sqrt(0.05**2 + (4 - t) ** 2)
    expected = np.sum(0.0001 / (4 * math.pi) * 10 / d**2 * np.exp(-0.01 * (t + d))) * t[1]
    assert seen(tmp_path, text, **backend)[0] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("backend", [{"backend": "raster", "plan": {"raster.secondary_rays": "trace"}, "bounces": 4}, *BACKENDS[::2]])
def test_an_absorbing_ball_follows_beer_and_lambert(tmp_path: Path, backend: dict[str, Any]) -> None:
    text = "camera(position: [0, 0, 4], look_at: [0, 0, 0], fov: 0.2deg)\nsky(radiance: 1)\n"
    radiance = seen(tmp_path, text + "sphere(1, medium: medium(absorption: [0.5, 1, 2]))\n", **backend)
    assert radiance[:3] == pytest.approx(np.exp([-1.0, -2.0, -4.0]), rel=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("fog", ["visibility: 130m, top: 2m, falloff: 9m, phase: 0.7", "visibility: 300m"])
@pytest.mark.parametrize("height", [0.2, 1.0])
def test_an_open_landscape_has_the_light_of_paths(tmp_path: Path, fog: str, height: float) -> None:
    """Nothing casts a shadow: what is left is the error of the two-stream approximation."""
    text = f"""
    fog({fog})
    plane(material: lambert(#3a4a30))
    sun(from: [-0.45, {height}, -1], illuminance: 40klx)
    sky(turbidity: 4, sun: [-0.45, {height}, -1], luminance: 2200nit)
    camera(position: [0, 2, 8], look_at: [0, 4, -20], fov: 50deg)
    """
    raster, paths = (seen(tmp_path, text, size=(24, 16), backend=name, samples=k)[:3] for name, k in (("raster", 4), ("ray", 1024)))
    assert raster == pytest.approx(paths, rel=0.25)


def test_a_layer_that_absorbs_nothing_between_sky_and_white_ground_has_the_radiance_of_the_sky() -> None:
    depths = np.linspace(0, 20, 65)[:, None] * np.ones(3)
    mean = two_stream.mean_radiance(depths, np.ones(3), 0.7, [], np.full(3, math.pi), np.ones(3))
    assert mean == pytest.approx(np.ones((65, 3)), rel=1e-6)


@pytest.mark.parametrize("g", [0.0, 0.5, 0.85])
def test_a_layer_without_absorption_sends_on_all_light(g: float) -> None:
    """Over black ground, what leaves at the top and at the bottom is what the sun sends in, minus what it sends through."""
    depth, cosine = 3.0, 0.6
    depths = np.linspace(0, depth, 257)[:, None] * np.ones(3)
    mean = two_stream.mean_radiance(depths, np.ones(3), g, [two_stream.Beam(cosine, np.ones(3))], np.zeros(3), np.zeros(3))
    flux = 2 * math.pi * mean[[0, -1], 0]  # one of both streams is 0 at either end
    scaled = (1 - g * g) * depth
    assert flux.sum() == pytest.approx(cosine * (1 - math.exp(-scaled / cosine)), rel=1e-3)


def test_nothing_comes_from_above_into_a_fog_without_a_top(tmp_path: Path) -> None:
    text = "camera(position: [0, 1, 0], look_at: [5, 2, 0])\nsun(from: [0, 1, 1], irradiance: 3)\n"
    text += "fog(visibility: 30m, top: 1e9m, falloff: 0m)\n"
    assert seen(tmp_path, text, backend="reference", plan=WHITTED)[:3] == pytest.approx(np.zeros(3), abs=1e-3)
