"""Light links: complementary receivers sum to the picture without links, blockers, mirrors, and closed forms, on every backend."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render.image.image import Image

from .conftest import Draw

SCENE = """
camera(position: [0, 3, 8], look_at: [0, 1, 0], fov: 40deg)
plane(material: lambert(0.6), name: "floor")
sphere(1, center: [-1.5, 1, 0], material: {}, name: "left")
box([1.6, 1.6, 1.6], center: [1.5, 0.8, 0], material: mirror(0.7), name: "right")
sphere(0.4, center: [0, 0.4, 2], material: {}, name: "small")
disk(0.8, center: [0, 2.2, -1], material: lambert(0.4), name: "roof")
{}
"""
SHARP = ("phong(0.5, specular: 0.3, shininess: 20)", "glass(ior: 1.5)")
ROUGH = ('metal("gold", roughness: 0.3)', "principled(color: 0.5, roughness: 0.4)")
LIGHTS = {
    "point": "point([2, 4, 3], intensity: 60LINK)",
    "area": "area([2, 4, 3], look_at: [0, 0, 0], luminance: 20LINK)",
    "sun": "sun(from: [1, 2, 1], angle: 4degLINK)",
    "sky": "sky(luminance: 1LINK)",
    "dome": "dome(pattern: |x, y, z| 1 + 8 * max(y, 0)^8LINK)",
}
SOME, OTHERS = ', receivers: ["left", "small"]', ', receivers: ["!left", "!small"]'
ALONE = {"transport.caustics": "paths", "transport.path_reuse": "none"}  # as in scenes with links

each_light = pytest.mark.parametrize("light", LIGHTS)


def scene(light: str, links: str, materials: tuple[str, str] = SHARP) -> str:
    return SCENE.format(*materials, LIGHTS[light].replace("LINK", links))


def rgb(image: Image) -> np.ndarray:
    return image.channels["rgba"][..., :3].astype(np.float64)


def sums(draw: Draw, light: str, materials: tuple[str, str], **settings) -> None:
    """Compare pixels that show a surface: in others the camera sees the sky, in each picture."""
    settings |= {"samples": 4, "background": "transparent", "size": (20, 15)}
    whole, one, other = (draw(scene(light, links, materials), **settings) for links in ("", SOME, OTHERS))
    solid = whole.channels["rgba"][..., 3] > 0.999
    assert rgb(one)[solid].max() > 0.1
    assert rgb(other)[solid].max() > 0.1
    assert np.abs(rgb(one) + rgb(other) - rgb(whole))[solid].max() < 2e-6 * rgb(whole)[solid].max()


@pytest.mark.long
@each_light
def test_complementary_receivers_sum_to_the_whole(draw, light):
    sums(draw, light, SHARP)


@pytest.mark.long
@each_light
def test_complementary_receivers_of_paths_sum_to_the_whole(trace, tracer, light):
    """Light and BSDF samples of one light keep their weights: their sum over both sets is exact, sample by sample."""
    sums(trace, light, ROUGH, bounces=3, plan=ALONE if tracer == "ray" else None)


@pytest.mark.long
@each_light
def test_paths_of_ray_and_reference_agree(draw_on, light):
    links = f'{SOME}, blockers: ["right", "floor"]'
    settings = {"samples": 4, "bounces": 3, "size": (20, 15)}
    ray, reference = (rgb(draw_on(backend, scene(light, links, ROUGH), **settings)) for backend in ("ray", "reference"))
    assert np.abs(ray - reference).max() < 2e-3 * reference.max()


@pytest.mark.long
@each_light
def test_blockers_that_are_all_casters_change_nothing(draw, light):
    every, plain = (rgb(draw(scene(light, links), samples=4, size=(20, 15))) for links in (', blockers: ["*"]', ""))
    assert np.array_equal(every, plain)


FLOOR = """
camera(position: [0, 4, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 0.5)
disk(3, center: [0, 0, 0], material: lambert(0.5), name: "floor")
sphere(0.6, center: [0, 1, 0], material: lambert(0), name: "ball")
LIGHT
"""
BEHIND = "camera(position: [1.5, 0.5, 0], look_at: [0, 0, 0], width: 0.2)"


def floor(draw: Draw, light: str, **settings) -> float:
    """The mean radiance of the floor below a black ball, seen from the side."""
    text = FLOOR.replace(FLOOR.splitlines()[1], BEHIND).replace("LIGHT", light)
    return float(rgb(draw(text, samples=64, size=(8, 8), **settings)).mean())


@pytest.mark.parametrize("blockers", ['["floor"]', '["!ball"]', "[]"])
def test_what_is_no_blocker_casts_no_shadow(draw, blockers):
    """E = I / h² below a lamp; with the ball among the blockers it is 0."""
    light = "point([0, 20, 0], intensity: 400, blockers: {})"
    assert floor(draw, light.format(blockers)) == pytest.approx(0.5 / np.pi, rel=2e-4)
    assert floor(draw, light.format('["ball"]')) == 0.0


@pytest.mark.long
@pytest.mark.parametrize("bounces", [None, 2])
def test_a_sky_without_blockers_lights_as_the_open_sky(trace, bounces):
    """L = ρ: paths find the sky by light samples alone, as the ball would block BSDF samples."""
    settings = {} if bounces is None else {"bounces": bounces}
    assert floor(trace, "sky(luminance: 1, blockers: [])", **settings) == pytest.approx(0.5, rel=0.01)
    assert floor(trace, "sky(luminance: 1)", **settings) < 0.4


@pytest.mark.long
@pytest.mark.parametrize("bounces", [None, 2])
def test_an_area_light_without_blockers(trace, bounces):
    """A small distant disk: E = L A / h²."""
    settings = {} if bounces is None else {"bounces": bounces}
    light = 'area([0, 20, 0], shape: "disk", size: 1, luminance: 4000, blockers: [])'
    expected = 0.5 / np.pi * 4000 * np.pi * 0.25 / 400
    assert floor(trace, light, **settings) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("light", ["area([-3, 1, 4], look_at: [0, 1, 0], luminance: 5{})", "sky(luminance: 5{})"])
@pytest.mark.parametrize("bounces", [None, 2])
def test_a_mirror_does_not_show_a_light_that_does_not_light_it(trace, light, bounces):
    text = """
        camera(position: [3, 1, 4], look_at: [0, 1, 0], fov: 4deg)
        box([2, 2, 0.1], center: [0, 1, -0.05], material: mirror(0.5), name: "mirror")
        sphere(0.1, center: [0, -9, 0], material: lambert(0.5), name: "other")
        """
    settings = {"size": (8, 8)} | ({} if bounces is None else {"bounces": bounces})
    lit, dark = (rgb(trace(text + light.format(f', receivers: ["{name}"]'), **settings)).max() for name in ("mirror", "other"))
    assert (lit, dark) == (pytest.approx(2.5, rel=1e-5), 0.0)


def test_a_light_that_lights_nothing_is_seen(trace):
    """Links do not concern the eye, which sees the light through a clear pane that it does not light."""
    text = """
        camera(position: [0, 1, 6], look_at: [0, 1, 0], width: 0.4)
        box([2, 2, 0.1], center: [0, 1, 2], material: glass(ior: 1), name: "pane")
        area([0, 1, 0], look_at: [0, 1, 6], luminance: 5, receivers: [])
        """
    assert rgb(trace(text, size=(8, 8), bounces=4)) == pytest.approx(5.0, rel=1e-5)
