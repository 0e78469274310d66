"""Tests of glossy_lights: solid angles, densities and MIS of light samples and lobe samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan
from maquette.render import camera, types
from maquette.render.backends import prepare
from maquette.render.integrator import glossy_lights
from maquette.render.light import light_samples
from maquette.render.material import bsdf, principled
from maquette.render.material.shader import evaluate_shader
from maquette.render.types import NoGlossyLights, Surface, View

from .. import tables as make

LAMPS = {
    "rectangle": "area([0.4, 3, 0.3], look_at: [0, 0.2, 0], size: [1.2, 0.5], luminance: 3)",
    "turned": "group(rotate: [20deg, 40deg, -10deg], scale: [1, 1.5, 2]) { area([0.4, 3, 0.3], size: [1, 0.6], look_at: [0, 0, 0]) }",
    "disk": 'area([0.2, 3, 0], look_at: [0, 0, 0], size: 1, luminance: 3, shape: "disk")',
    "ball": "sphere(0.6, center: [0.2, 2.5, 0.4], material: emissive(luminance: 2))",
    "sun": "sun(from: [0.2, 1, 0.3], illuminance: 2, angle: 8deg)",
}
LOOK = "camera(position: [0, 2, 3.2], look_at: [0, 0.2, 0], fov: 40deg)\nrender(size: [24, 24], samples: 16)\n"
METAL = "\nsphere(0.3, material: principled(metallic: 1))"
PLACE = (np.array([0.1]), np.array([0.5]), np.array([-0.2]))


def loaded(folder: Path, text: str) -> ir.Scene:
    path = folder / "a.scene"
    path.write_text(LOOK + text, encoding="utf-8")
    return maquette.load(path)


def tables_of(folder: Path, text: str) -> Any:
    return principled.tables_for(loaded(folder, text).tables)


def prepared(folder: Path, text: str) -> tuple[Any, View]:
    scene = loaded(folder, text)
    decided = plan.make_plan(scene, ir.Settings(backend="raster"))
    view = View(decided["camera"], 24, 24)
    return prepare.prepare(scene, decided, view), view


@pytest.fixture(params=LAMPS)
def lit(request, tmp_path) -> tuple[Any, int]:
    """The tables of a scene with a lamp that highlights meet, and its row."""
    tables = tables_of(tmp_path, LAMPS[request.param] + METAL)
    lamps: Any = glossy_lights.find_glossy_lights(tables)
    (row,) = lamps.rows
    return tables, int(row)


def place_of(count: int) -> tuple[Any, ...]:
    return tuple(np.repeat(p, count) for p in PLACE)


def test_samples_of_lamps_are_met(lit):
    tables, row = lit
    rng = np.random.default_rng(3)
    u, v = rng.uniform(0.001, 0.999, (2, 500))
    place = place_of(500)
    arriving = light_samples.sample(tables, row, place, u, v)
    distance, solid, bright = (np.broadcast_to(x, 500) for x in light_samples.intersect(tables, row, place, arriving.direction))
    assert np.all(solid > 0.0)
    assert distance == pytest.approx(np.broadcast_to(arriving.distance, 500), rel=1e-9)
    assert solid == pytest.approx(np.broadcast_to(arriving.angle, 500), rel=1e-6)
    color = tables.lights.color[row]
    assert color[1] * bright * solid == pytest.approx(np.broadcast_to(arriving.irradiance[1], 500), rel=1e-6)


def test_directions_that_meet_a_lamp_fill_its_solid_angle(lit):
    """∫ dω over those that meet it, from even directions, and 1 = ∫ density dω."""
    tables, row = lit
    rng = np.random.default_rng(5)
    n = 400_000
    direction = rng.normal(size=(3, n))
    direction /= np.linalg.norm(direction, axis=0)
    _, solid, _ = light_samples.intersect(tables, row, place_of(n), tuple(direction))
    met = solid > 0.0
    density = np.where(met, 1.0 / np.where(met, solid, 1.0), 0.0) * 4.0 * np.pi
    assert density.mean() == pytest.approx(1.0, abs=5.0 * density.std() / np.sqrt(n))


MATERIALS = {
    "metal": "principled(color: #ffd080, metallic: 1, roughness: 0.35)",
    "polish": "principled(color: #803020, roughness: 0.25, clearcoat: 0.5, clearcoat_roughness: 0.1)",
    "rough glass": "glass(roughness: 0.3)",
    "course": "blinn_phong(#806050, specular: 0.4, shininess: 60)",
}


@pytest.mark.parametrize("material", MATERIALS)
def test_the_parts_of_what_is_reflected_add_up_and_have_the_density_of_their_samples(tmp_path, material):
    things = f"\nsphere(1, material: principled(metallic: 1))\nsphere(1, material: {MATERIALS[material]})"
    tables = tables_of(tmp_path, LAMPS["ball"] + things)
    n = 300
    rng = np.random.default_rng(2)
    up = tuple(np.repeat([0.0, 1.0, 0.0], n).reshape(3, n))
    viewer = tuple(np.repeat(np.array([0.3, 0.9, 0.1]) / np.linalg.norm([0.3, 0.9, 0.1]), n).reshape(3, n))
    instance = np.full(n, 2)
    shader = evaluate_shader(tables, _point(tables, up, instance))
    u, v, which = rng.uniform(0.0, 1.0, (3, n))
    direction, share = bsdf.sample_lobe(shader, up, viewer, u, v, which)
    matt, shine, density = bsdf.eval_lobes_pdf(shader, up, direction, viewer)
    whole = bsdf.reflected(shader, up, direction, viewer)
    for k in range(3):
        assert np.broadcast_to(matt[k] + shine[k], n) == pytest.approx(np.broadcast_to(whole[k], n), rel=1e-12, abs=1e-15)
        if material != "course":
            counts = np.broadcast_to(share[k], n) > 0.0
            assert counts.any()
            found = np.broadcast_to(share[k] * np.pi * density, n)[counts]
            assert found == pytest.approx(np.broadcast_to(shine[k], n)[counts], rel=1e-9)


def _point(tables: Any, normal: Any, instance: np.ndarray) -> Surface:
    zero = 0.0 * normal[0]
    place = (zero, zero, zero)
    material = tables.instances.material[instance]
    one = zero + 1.0
    front, white = zero == 0.0, (one, one, one)
    return Surface(place, place, normal, normal, normal, (zero, zero), (one, one), front, instance, material, white, zero, None, None)


def pictures(made: Any, view: View, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """(samples, pixels, 3) through pixels' centres, with lamps met along highlights and without."""
    y, x = np.mgrid[0 : view.height, 0 : view.width].reshape(2, -1) + 0.5
    ray = camera.generate_pinhole_ray(made.tables, view, x, y)
    both = []
    for found in (made.options.glossy_lights, NoGlossyLights()):
        options = made.options._replace(glossy_lights=found, environment=types.SecondaryRays(), bounces=0)
        both.append(make.radiance_in_kernel(made.tables, ray, options, samples)[0])
    return both[0], both[1]


BALLS = "".join(
    f"\nsphere(0.5, center: [{k - 1}, 0, 0], material: {MATERIALS[name]})" for k, name in enumerate(("metal", "polish", "rough glass"))
)


@pytest.mark.long
@pytest.mark.parametrize("lamp", LAMPS)
def test_both_ways_to_lamps_find_the_same_light(tmp_path, lamp):
    """In the mean over each material's third of the picture, within four standard errors of both."""
    made, view = prepared(tmp_path, LAMPS[lamp] + BALLS)
    for both, alone in zip(*(_thirds(picture, view) for picture in pictures(made, view, 256)), strict=True):
        error = np.hypot(both.std(), alone.std()) / np.sqrt(len(both))
        assert both.mean() > 0.0
        assert abs(both.mean() - alone.mean()) < 4.0 * error + 1e-9


def _thirds(picture: np.ndarray, view: View) -> list[np.ndarray]:
    """(samples,) means of the left, the middle and the right of (samples, pixels, 3)."""
    rows = picture.reshape(len(picture), view.height, 3, view.width // 3, 3)
    return [rows[:, :, k].mean(axis=(1, 2, 3)) for k in range(3)]


@pytest.mark.long
def test_polish_under_a_lamp_has_less_noise(tmp_path):
    """Variance of α = 0.0025 under a rectangle: at least a tenth."""
    unseen = f"\nsphere(0.1, center: [0, -9, 0], material: {MATERIALS['rough glass']})"  # so that kernels are those of the tests above
    made, view = prepared(tmp_path, LAMPS["rectangle"] + "\nsphere(0.8, material: principled(metallic: 1, roughness: 0.05))" + unseen)
    both, alone = (p.var(axis=0).mean() for p in pictures(made, view, 256))
    assert 0.0 < both < 0.1 * alone


def test_scenes_without_microfacets_or_wide_lamps_meet_none(tmp_path):
    assert isinstance(
        glossy_lights.find_glossy_lights(tables_of(tmp_path, LAMPS["ball"] + "\nsphere(1, material: blinn_phong(#ffffff))")), NoGlossyLights
    )
    assert isinstance(glossy_lights.find_glossy_lights(tables_of(tmp_path, "point([0, 3, 0], intensity: 4)" + METAL)), NoGlossyLights)
