"""Mirrors, metals and glass on the raster backend: traced rays, or the sky and the ground's light."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.compiler.plan import transport_rules
from maquette.compiler.plan.plan import PlanError

from . import scenes
from .views import interior, relative, rgb, show

pytestmark = pytest.mark.usefixtures("files")
TRACE = {"raster.secondary_rays": "trace"}
EVEN = "plane(y: 0, material: lambert(#808080))\nsky(color: #ffffff, luminance: 1, shadows: false)\n"
GREY = ((0x80 / 255 + 0.055) / 1.055) ** 2.4
VIEW = "camera(position: [0, 1, 4], look_at: [0, 1, 0], fov: 20deg)\n"


@pytest.mark.long
@pytest.mark.parametrize("name", ["glass", "formula of glass", "mirrors"])
def test_traced_rays_find_what_the_ray_backend_finds(draw_on, name):
    a = draw_on("raster", scenes.RAYS[name], TRACE, aov=("id",))
    b = draw_on("ray", scenes.RAYS[name], aov=("id",))
    assert a.metadata["notes"] == []
    inside = interior(a, b)
    different = inside & (relative(rgb(a), rgb(b)) > 1e-3)
    assert different.sum() <= 5, show(different, 5)  # a root of glass may fall to the other side of an edge seen through it


@pytest.mark.long
def test_light_between_surfaces_is_traced_too(draw_on):
    text = scenes.RAYS["interreflection"]
    a = draw_on("raster", text, TRACE, samples=16, size=(24, 24))
    b = draw_on("ray", text, {"transport": "whitted"}, samples=64, size=(24, 24))
    assert rgb(a).mean() == pytest.approx(rgb(b).mean(), rel=0.01)
    assert rgb(a).mean() > 1.03 * rgb(draw_on("raster", text, samples=16, size=(24, 24))).mean()


MATERIALS = {
    "mirror": "mirror(#ffffff)",
    "polished": "principled(#ffffff, metallic: 1, roughness: 0)",
    "rough": "principled(#ffffff, metallic: 1, roughness: 0.2)",
}


@pytest.mark.parametrize("material", MATERIALS.values(), ids=list(MATERIALS))
def test_above_is_the_sky_and_below_the_light_of_the_ground(draw_on, material):
    """A perfectly reflecting ball: L at its top, from the sky, and ρL at its bottom, from the ground."""
    text = VIEW + EVEN + f"sphere(0.5, center: [0, 1, 0], material: {material})\n"
    image = rgb(draw_on("raster", text, samples=16))
    assert np.allclose(image[14, 24], 1.0, atol=0.02)
    assert np.allclose(image[34, 24], GREY, atol=0.02)


@pytest.mark.long
def test_rough_glass_is_not_black(draw_on):
    text = VIEW + EVEN + "sphere(0.5, center: [0, 1, 0], material: glass(roughness: 0.4))\n"
    image = rgb(draw_on("raster", text, samples=16))
    assert 0.5 * GREY < image[24, 24].min() <= image[24, 24].max() < 1.0


def test_without_a_ground_all_around_is_sky(draw_on):
    text = VIEW + "sky(color: #ffffff, luminance: 1)\nsphere(0.5, center: [0, 1, 0], material: mirror(#ffffff))\n"
    assert np.allclose(rgb(draw_on("raster", text)), 1.0, atol=1e-6)


def test_the_plan_says_what_is_traced(tmp_path):
    path = tmp_path / "a.scene"
    path.write_text(VIEW + EVEN + "sphere(0.5, center: [0, 1, 0], material: mirror(#ffffff))\n", encoding="utf-8")
    scene = load.load(path)
    settings = ir.Settings(backend="raster")
    made = planner.make_plan(scene, settings)
    assert (made["raster.secondary_rays"], made["bounces"]) == ("none", 0)
    traced = planner.make_plan(scene, settings, TRACE)
    decided = (traced["raster.secondary_rays"], traced["bounces"], traced["transport"])
    assert decided == ("trace", transport_rules.SPECULAR_BOUNCES, "whitted")
    with pytest.raises(PlanError, match=r"`raster\.secondary_rays` cannot be half; it can be: none, trace"):
        planner.make_plan(scene, settings, {"raster.secondary_rays": "half"})
