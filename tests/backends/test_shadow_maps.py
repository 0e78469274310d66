"""Shadow maps of the raster backend, and no shadows, against traced shadows."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.compiler.plan.plan import PlanError

from .views import rgb

MAP, NONE = {"raster.shadows": "map"}, {"raster.shadows": "none"}
FLOOR = "plane(y: 0, material: lambert(#ffffff))\n"
ABOVE = "camera(position: [0, 5, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 4, projection: \"orthographic\")\n"
THINGS = (
    "sphere(0.5, center: [-0.6, 0.5, 0], material: lambert(#ffffff))\nbox(0.7, center: [0.6, 0.35, 0.3], rotate: [0, 20deg, 0])\n"
    "torus(0.4, 0.1, center: [0, 0.6, 0.9], rotate: [50deg, 0, 0], material: lambert(#ffffff))\n"
)
LAMPS = {
    "parallel": "directional(from: [2, 3, 1], illuminance: 3)\n",
    "grazing": "directional(from: [3, 0.15, 1], illuminance: 30)\n",
    "spot": "spot([-2, 4, 1], look_at: [0, 0, 0], cone: 40deg, soft: 5deg, intensity: 60)\n",
    "wide spot": "spot([-1, 2, 1], look_at: [0, 0, 0], cone: 80deg, soft: 5deg, intensity: 20)\n",
    "point": "point([0.1, 1.6, -0.4], intensity: 10)\n",
}


@pytest.mark.long
@pytest.mark.parametrize("lamp", LAMPS.values(), ids=list(LAMPS))
def test_flat_and_round_things_do_not_shade_themselves(draw_on, lamp):
    """A tilted square, a floor and a ball on the lit side have no self-shadowing, to rounding."""
    text = ABOVE + FLOOR + lamp
    assert np.array_equal(rgb(draw_on("raster", text, MAP)), rgb(draw_on("raster", text, NONE)))
    corners = [[x, 0.2 * x - 0.13 * z, z] for x, z in ((-4, -4), (-4, 4), (4, 4), (4, -4))]
    tilted = ABOVE + f"polygon({corners}, material: lambert(#ffffff))\n" + lamp
    assert np.allclose(rgb(draw_on("raster", tilted, MAP)), rgb(draw_on("raster", tilted, NONE)), rtol=1e-5)  # light in float64 and float32
    ball = ABOVE + "sphere(1.5, center: [0, 0, 0], material: lambert(#ffffff))\n" + lamp.replace("1.6", "2.6").replace("2, 1]", "4, 1]")
    a, b = rgb(draw_on("raster", ball, MAP)), rgb(draw_on("raster", ball, NONE))
    assert np.allclose(a, b, rtol=0.02, atol=0.01 * b.max())


@pytest.mark.long
@pytest.mark.parametrize("lamp", LAMPS.values(), ids=list(LAMPS))
def test_shadows_are_where_rays_find_them(draw_on, lamp):
    """Every point has the light of traced shadows, except at edges, which are two texels soft; the means agree."""
    text = ABOVE + FLOOR + THINGS + lamp
    a, b = (rgb(draw_on("raster", text, plan, size=(96, 96), samples=4)) for plan in (MAP, {}))
    bare = rgb(draw_on("raster", text, NONE, size=(96, 96), samples=4))
    shade = np.abs(bare - b).max(axis=2) > 0.05 * b.max()
    assert 0.02 < shade.mean() < 0.9
    different = np.abs(a - b).max(axis=2) > 0.02 * np.maximum(b.max(axis=2), 0.02 * b.max())
    edges = np.zeros_like(shade)
    edges[1:-1, 1:-1] = np.any(
        [shade[1 + j : 95 + j, 1 + i : 95 + i] != shade[1:-1, 1:-1] for j in (-1, 0, 1) for i in (-1, 0, 1)], axis=0
    )
    inside = ~edges
    inside[[0, -1]] = inside[:, [0, -1]] = False
    assert (different & inside).mean() < 0.02
    assert a.mean() == pytest.approx(b.mean(), rel=0.01)


def test_the_edge_of_a_shadow_is_a_texel_off_at_most(draw_on):
    """A thin wall's edge at x = 0 under light from above: half the light at 0, all and none two texels beside."""
    wall = "polygon([[-5, 1, -5], [-5, 1, 5], [0, 1, 5], [0, 1, -5]], material: lambert(#ffffff))\n"
    view = "camera(position: [0, 0.5, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 0.12, projection: \"orthographic\")\n"
    image = rgb(draw_on("raster", view + FLOOR + wall + "directional(from: [0, 1, 0], illuminance: 3)\n", MAP, size=(96, 96)))[48, :, 0]
    texel = 10 / 2048
    x = (np.arange(96) + 0.5) / 96 * 0.12 - 0.06
    share = image / image.max()
    assert (np.diff(share) >= -1e-6).all()
    assert (share[x < -2.5 * texel] == 0).all()
    assert (share[x > 2.5 * texel] == 1).all()
    assert abs(float(np.interp(0.5, share, x))) < texel


def test_without_shadows_light_goes_through_everything(draw_on):
    text = ABOVE + FLOOR + THINGS + LAMPS["point"]
    bare = rgb(draw_on("raster", text, NONE))
    free = rgb(draw_on("raster", text.replace("intensity: 10", "intensity: 10, shadows: false")))
    assert np.allclose(bare, free, rtol=1e-5)
    assert bare.mean() > 1.02 * rgb(draw_on("raster", text)).mean()


@pytest.mark.long
def test_soft_lights_keep_rays_and_the_sun_loses_its_penumbra(draw_on):
    area = ABOVE + FLOOR + THINGS + "area([0, 3, 0], look_at: [0, 0, 0], size: [1, 1], luminance: 5)\n"
    assert np.array_equal(rgb(draw_on("raster", area, MAP, samples=4)), rgb(draw_on("raster", area, samples=4)))
    sun = ABOVE + FLOOR + THINGS + "sun(from: [2, 3, 1], illuminance: 2, angle: 4deg)\n"
    notes = draw_on("raster", sun, MAP).metadata["notes"]
    assert [message for message, _, _ in notes] == ["raster draws the sun's shadows from a map, without their penumbra"]


def test_maps_are_not_for_what_lets_light_through(tmp_path):
    path = tmp_path / "a.scene"
    path.write_text(ABOVE + FLOOR + "sphere(1, material: lambert(#fff, opacity: 0.5))\npoint([0, 3, 0], intensity: 9)\n", encoding="utf-8")
    scene = load.load(path)
    with pytest.raises(PlanError, match=r"`raster\.shadows` cannot be map; it can be: rays, none"):
        planner.make_plan(scene, ir.Settings(backend="raster"), MAP)
