"""Channels and guides behind media: the first real surface, the light that passes straight, and the depth of the first scattering."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler.plan import plan as planner
from maquette.render.backends import prepare, reference
from maquette.render.film import denoise
from maquette.render.types import View

LOOK = "camera(position: [0, 0, 4], look_at: [0, 0, 0], fov: 10deg)\n"
WALL = "box([9, 9, 1], center: [0, 0, -2.5], material: lambert(rgb(0.2, 0.4, 0.6)))\n"  # 6 m before the camera
SURFACES = ("depth", "normal", "albedo", "id", "position")
MEDIA = ("transmittance", "scatter_depth")
ODD = (3, 3)  # the ray of the middle pixel is the camera's axis


def channels(tmp_path: Path, text: str, names: tuple[str, ...], **settings: Any) -> dict[str, np.ndarray]:
    """The channels of the middle of a small picture."""
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    settings = {"size": ODD, "samples": 1, "denoise": False, "backend": "reference", "bounces": 1, **settings}
    drawn = maquette.load(path).render(aov=names, **settings).channels
    return {name: drawn[name][1, 1] for name in names}


def mean_depth(sigma: float, near: float, far: float, end: float) -> float:
    """The mean of the distance to the first collision between two distances, or of the end."""
    passed = math.exp(-sigma * (far - near))
    return near * (1 - passed) + (1 - passed) / sigma - (far - near) * passed + passed * end


def test_invisible_boundaries_are_not_seen(tmp_path: Path) -> None:
    media = "box([2, 2, 2], medium: medium(scattering: 1))\nsphere(0.5, center: [0, 0, 2], medium: medium(absorption: 1))\n"
    behind, alone = (channels(tmp_path, LOOK + WALL + text, SURFACES) for text in (media, ""))
    for name in SURFACES:
        assert np.array_equal(behind[name], alone[name]), name


def test_media_have_the_closed_forms_of_their_coefficients(tmp_path: Path) -> None:
    """A ball between the distances 3 and 5, before a wall at 6."""
    ball = "sphere(1, medium: medium(scattering: [1, 2, 0], absorption: [0, 1, 0.5]))\n"
    layers = channels(tmp_path, LOOK + WALL + ball, MEDIA)
    assert layers["transmittance"] == pytest.approx(np.exp([-2.0, -6.0, -1.0]), rel=1e-5)
    expected = np.mean([mean_depth(1, 3, 5, 6), mean_depth(2, 3, 5, 6), 6.0])
    assert layers["scatter_depth"] == pytest.approx(expected, rel=1e-5)


def test_a_density_by_a_formula_is_summed(tmp_path: Path) -> None:
    """A density of |z| / 2 along two metres has the column 1/2."""
    ball = "sphere(1, medium: medium(scattering: 2, absorption: 1, density: |x, y, z| 0.5 * abs(z)))\n"
    layers = channels(tmp_path, LOOK + WALL + ball, MEDIA)
    assert layers["transmittance"] == pytest.approx(math.exp(-1.5), rel=1e-3)
    t = np.linspace(3, 5, 100_001)
    share = np.exp(-2 * 0.5 * np.cumsum(np.abs(t - 4)) * (t[1] - t[0]))
    mean = np.sum(-np.diff(share) * 0.5 * (t[1:] + t[:-1])) + share[-1] * 6
    assert layers["scatter_depth"] == pytest.approx(mean, rel=1e-3)


@pytest.mark.parametrize(
    "settings", [{}, {"plan": {"transport": "whitted"}}, pytest.param({"backend": "raster"}, marks=pytest.mark.long)], ids=str
)
@pytest.mark.parametrize("falloff", [0, 2])
def test_fog_in_front_of_the_sky_has_the_depth_of_what_scatters(tmp_path: Path, falloff: float, settings: dict[str, Any]) -> None:
    """A ray that rises through fog and hits nothing: its light scatters somewhere, or never."""
    look = "camera(position: [0, 0, 0], look_at: [0, 1, -1], fov: 10deg)\nsky(radiance: 1)\n"
    fog = f"fog(scattering: 0.2, absorption: 0.1, top: 3m, falloff: {falloff}m)\n"
    layers = channels(tmp_path, look + fog, (*MEDIA, "depth"), **settings)
    t = np.linspace(0, 120, 400_001)
    over = np.maximum(t / math.sqrt(2) - 3, 0)
    density = np.where(over > 0, np.exp(-over / falloff) if falloff else 0.0, 1.0)
    column = np.concatenate([[0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(t))])
    share = np.exp(-0.2 * column)
    assert layers["transmittance"] == pytest.approx(math.exp(-0.3 * column[-1]), rel=1e-4)
    assert layers["scatter_depth"] == pytest.approx(np.sum(-np.diff(share) * 0.5 * (t[1:] + t[:-1])) / (1 - share[-1]), rel=2e-3)
    assert np.isinf(layers["depth"]).all()


@pytest.mark.parametrize("backend", ["ray", "reference", "raster"])
def test_without_media_all_light_passes(tmp_path: Path, backend: str) -> None:
    layers = channels(tmp_path, LOOK + WALL, (*MEDIA, "depth"), backend=backend)
    assert np.array_equal(layers["transmittance"], [1, 1, 1])
    assert np.array_equal(layers["scatter_depth"], layers["depth"])
    empty = channels(tmp_path, LOOK + "sky(radiance: 1)\nsphere(1, center: [0, 9, 0])\n", MEDIA, backend=backend)
    assert np.array_equal(empty["transmittance"], [1, 1, 1])
    assert np.isinf(empty["scatter_depth"]).all()


def test_raster_sees_no_boundary_of_media_that_it_does_not_draw(tmp_path: Path) -> None:
    ball = "sphere(1, medium: medium(scattering: 1))\n"
    layers = channels(tmp_path, LOOK + WALL + ball, ("depth", *MEDIA), backend="raster")
    assert layers["depth"] == pytest.approx(6.0)
    assert np.array_equal(layers["transmittance"], [1, 1, 1])


def test_glass_around_a_medium_is_a_surface(tmp_path: Path) -> None:
    ball = "sphere(1, material: glass(ior: 1.33), medium: medium(scattering: 1))\n"
    layers = channels(tmp_path, LOOK + WALL + ball, ("depth", *MEDIA))
    assert layers["depth"] == pytest.approx(3.0, rel=1e-5)
    assert np.array_equal(layers["transmittance"], [1, 1, 1])


def test_a_camera_inside_of_two_media_sees_that_of_higher_priority(tmp_path: Path) -> None:
    """The camera stands in both; the inner ends 1 m before it, the outer at 4.5 m, and the wall is at 6 m."""
    media = "box([9, 9, 9], center: [0, 0, 4], medium: medium(absorption: 0.1))\n"
    media += "sphere(1, center: [0, 0, 4], medium: medium(absorption: 1, priority: 2))\n"
    layers = channels(tmp_path, LOOK + WALL + media, MEDIA)
    assert layers["transmittance"] == pytest.approx(math.exp(-1 - 0.35), rel=1e-5)
    assert layers["scatter_depth"] == pytest.approx(6.0)


def test_both_backends_have_equal_channels(tmp_path: Path) -> None:
    media = "sphere(1, medium: medium(scattering: 1, density: |x, y, z| 1 + x))\nfog(scattering: 0.1, top: 1m, falloff: 1m)\n"
    path = tmp_path / "a.scene"
    path.write_text(LOOK.replace("10deg", "60deg") + WALL.replace("9, 9", "3, 3") + "sky(radiance: 1)\n" + media, encoding="utf-8")
    names = (*SURFACES, *MEDIA)
    ray, exact = (
        maquette.load(path).render(size=(9, 7), samples=1, aov=names, backend=backend, denoise=False, bounces=1).channels
        for backend in ("ray", "reference")
    )
    for name in names:
        assert ray[name] == pytest.approx(exact[name], rel=1e-5, abs=1e-6), name


def test_guides_blend_the_surface_with_the_medium(tmp_path: Path) -> None:
    """Half of the light of a wall of albedo 0.2, 0.4, 0.6 passes a medium of albedo 0.5."""
    path = tmp_path / "a.scene"
    rate = 0.5 * math.log(2)
    box = f"box([8, 8, 2], medium: medium(scattering: {rate / 2}, absorption: {rate / 2}))\n"
    path.write_text(LOOK.replace("10deg", "1deg") + WALL + box, encoding="utf-8")
    scene = maquette.load(path)
    plan = planner.make_plan(scene, maquette.compiler.ir.Settings(size=ODD, samples=4, backend="reference", denoise=False))
    view = View(plan["camera"], *ODD)
    albedo, normal = denoise.guides(reference.Renderer(prepare.prepare(scene, plan, view), plan, view), plan)
    assert albedo[1, 1] == pytest.approx(0.5 * np.array([0.2, 0.4, 0.6]) + 0.25, rel=1e-3)
    assert normal[1, 1] == pytest.approx([0, 0, 0.5], abs=1e-3)
