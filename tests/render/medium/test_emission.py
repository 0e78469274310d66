"""Media that emit as lights: closed forms, light samples against paths, obstacles, bounces and light groups."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler.plan import plan as planner
from maquette.render.backends import prepare
from maquette.render.medium import emitting_cells
from maquette.render.types import View

DARK = "sky(radiance: 0.000001)\n"
DOWN = "camera(position: [0.7, 0.6, 0], look_at: [0.7, 0, 0], fov: 1deg)\n"
FLOOR = "plane(y: 0, material: lambert(1))\n"
BALL = "sphere(0.5, center: [0, 2, 0], medium: medium(emission: [1, 2, 3]))\n"
FLAME = "box([0.6, 1.2, 0.6], center: [0, 0.7, 0], medium: medium(emission: 5, absorption: 1, density: |x, y, z| max(0, 0.5 - y)))\n"


def drawn(tmp_path: Path, text: str, **settings: Any) -> Any:
    """A small picture."""
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    settings = {"size": (8, 8), "samples": 64, "denoise": False, "backend": "reference", "bounces": 4, **settings}
    return maquette.load(path).render(**settings)


def mean(image: Any) -> np.ndarray:
    return image.channels["rgba"][..., :3].mean(axis=(0, 1))


def error(image: Any) -> np.ndarray:
    """The standard error of the mean of a picture."""
    variance = image.metadata["variance"]
    return np.sqrt(variance.reshape(-1, 3).sum(axis=0)) / (image.width * image.height)


def emitters(tmp_path: Path, text: str) -> Any:
    """The table of emitters of a scene."""
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    scene = maquette.load(path)
    plan = planner.make_plan(scene, maquette.compiler.ir.Settings(size=(4, 4), samples=4, backend="reference", denoise=False))
    return prepare.prepare(scene, plan, View(plan["camera"], 4, 4)).paths.emitters


def test_a_ball_lights_a_plane_as_a_point_in_its_centre_does(tmp_path: Path) -> None:
    """By the shell theorem: the light of all its points arrives as the field of a mass does. It absorbs nothing."""
    intensity, away = np.array([1.0, 2, 3]) * 4 / 3 * math.pi * 0.5**3, math.hypot(0.7, 2)
    image = drawn(tmp_path, DARK + DOWN + FLOOR + BALL, samples=128)
    assert mean(image) == pytest.approx(intensity * 2 / away**3 / math.pi, rel=0.012)


@pytest.mark.parametrize("frame", ["scale(2)", "rotate([0, 30deg, 20deg])", "translate([0.2, 0, 0])"])
def test_strategies_agree_on_a_density_in_a_frame(tmp_path: Path, frame: str) -> None:
    """Light samples alone, paths alone and both together have one mean: behind an obstacle, and where a ball stands in the medium."""
    obstacles = "sphere(0.15, center: [0.4, 0.4, 0.1], material: lambert(0.5))\nsphere(0.2, center: [0, 0.6, 0], material: lambert(0.5))\n"
    text = DARK + DOWN.replace("1deg", "50deg") + FLOOR + frame + " { " + FLAME.strip() + " }\n" + obstacles
    images = [drawn(tmp_path, text, samples=16, plan={"mis": mis}, seed=7, size=(6, 6)) for mis in ("power", "light", "bsdf")]
    for image in images[1:]:
        assert np.all(np.abs(mean(image) - mean(images[0])) < 4 * np.hypot(error(image), error(images[0]))), frame


@pytest.mark.parametrize(
    "media",
    [
        "fog(scattering: 0.3, top: 1m)\nsphere(0.3, center: [0, 1, 0], medium: medium(absorption: 4, emission: 3))\n",
        "sphere(0.4, center: [0, 1, 0], medium: medium(emission: 3, scattering: 2))\n"
        "sphere(0.2, center: [0, 0.7, 0], medium: medium(absorption: 6, emission: 1, priority: 2))\n",
        "sphere(0.3, center: [0, 1, 0], material: glass(ior: 1.3), medium: medium(emission: 3))\n",
        "for (k in 0..69) { sphere(0.05, center: [0.1 * k - 3, 0.6, 0], medium: medium(emission: 3)) }\n",
    ],
    ids=["fog", "nested", "glass", "many"],
)
def test_strategies_agree_on_media(tmp_path: Path, media: str) -> None:
    text = DARK + DOWN.replace("1deg", "50deg") + FLOOR + media
    images = [drawn(tmp_path, text, samples=16, plan={"mis": mis}, seed=5, size=(6, 6)) for mis in ("power", "bsdf")]
    assert np.all(np.abs(mean(images[0]) - mean(images[1])) < 4 * np.hypot(error(images[0]), error(images[1])))


def test_light_samples_have_less_noise_than_paths(tmp_path: Path) -> None:
    small = BALL.replace("0.5", "0.1")
    both, paths = (drawn(tmp_path, DARK + DOWN + FLOOR + small, samples=32, plan={"mis": mis}) for mis in ("power", "bsdf"))
    assert np.all(error(both) < 0.1 * error(paths))


def test_one_bounce_has_all_the_direct_light(tmp_path: Path) -> None:
    few, many = (mean(drawn(tmp_path, DARK + DOWN + FLOOR + BALL, bounces=bounces)) for bounces in (1, 8))
    assert few == pytest.approx(many, rel=1e-3)


def test_an_obstacle_casts_a_shadow(tmp_path: Path) -> None:
    plate = "box([2, 0.01, 2], center: [0, 1, 0], material: lambert(0))\n"
    assert np.all(mean(drawn(tmp_path, DARK + DOWN.replace("0.6, 0]", "0.9, 0]") + FLOOR + BALL + plate)) < 1e-5)


def test_both_backends_have_equal_light(tmp_path: Path) -> None:
    glow = "sphere(0.3, center: [0, 0.7, 0], medium: medium(emission: 5, scattering: 1))\nfog(scattering: 0.1, top: 3m)\n"
    text = DARK + DOWN.replace("1deg", "50deg") + FLOOR + glow + BALL.replace("emission", "absorption: 1, emission")
    ray, exact = (drawn(tmp_path, text, backend=backend, samples=4).channels["rgba"] for backend in ("ray", "reference"))
    assert np.mean(np.abs(ray - exact) > 1e-4 * (1 + exact)) < 0.02


def test_threads_draw_equal_bits(tmp_path: Path) -> None:
    text = DARK + DOWN.replace("1deg", "50deg") + FLOOR + FLAME
    first, second = (drawn(tmp_path, text, backend="ray", samples=4, size=(40, 40), threads=n).channels["rgba"] for n in (1, 2))
    assert np.array_equal(first, second)


def test_its_light_is_in_the_group_of_lights_without_one(tmp_path: Path) -> None:
    text = DARK + DOWN.replace("1deg", "50deg") + FLOOR + BALL
    point = 'point([1, 1, 1], intensity: 1, group: "lamp")\n'
    image, alone = drawn(tmp_path, text + point, aov=("lights",), samples=16), drawn(tmp_path, text, samples=16)
    without_group, of_lamp = (image.channels[f"light:{name}"].mean(axis=(0, 1)) for name in ("rest", "lamp"))
    assert without_group == pytest.approx(mean(alone), rel=1e-3)
    assert of_lamp == pytest.approx(of_lamp[0], rel=1e-4)  # white: without the light of the ball
    assert mean(image) == pytest.approx(without_group + of_lamp, rel=1e-5)


def test_a_medium_that_emits_is_the_light_of_a_scene(tmp_path: Path) -> None:
    """No other light is added by default where light bounces, as with emissive shapes."""
    path = tmp_path / "a.scene"
    path.write_text(DOWN + FLOOR + BALL + "render(bounces: 4)\n", encoding="utf-8")
    assert len(maquette.load(path).tables.lights.kind) == 0


def test_what_light_samples_find(tmp_path: Path) -> None:
    """Media behind glass are found by paths alone; power follows the volume and what a thick medium absorbs of its own light."""
    start = DARK + DOWN + FLOOR
    assert not isinstance(emitters(tmp_path, start + BALL).media, emitting_cells.NoCells)
    assert isinstance(emitters(tmp_path, start + BALL.replace("medium:", "material: glass(), medium:")).media, emitting_cells.NoCells)
    assert isinstance(emitters(tmp_path, start + "sphere(1, medium: medium(scattering: 1))\n").media, emitting_cells.NoCells)
    thin = emitters(tmp_path, start + BALL)
    thick = emitters(tmp_path, start + BALL.replace("emission", "absorption: 100, emission"))
    assert thin.color[-1] == pytest.approx([1, 2, 3])  # the box of a metre
    assert thick.color[-1][0] == pytest.approx(0.015, rel=1e-3)  # over the depth of 100 / 1.5


def test_the_density_of_directions_integrates_to_one(tmp_path: Path) -> None:
    """Of all directions from a point, also from within a cell grid."""
    table = emitters(tmp_path, DARK + DOWN + FLOOR + FLAME)
    rng = np.random.default_rng(3)
    way = rng.normal(size=(3, 200_000))
    way /= np.linalg.norm(way, axis=0)
    rows = np.full(way.shape[1], len(table.kind) - 1)
    for place in ((0.9, 0.1, 0.2), (0.05, 0.8, 0.1)):
        places = tuple(np.full(way.shape[1], x) for x in place)
        density = emitting_cells.density(table.media, rows, places, (*way,))
        deviation = density.std() / math.sqrt(len(density))
        assert 4 * math.pi * density.mean() == pytest.approx(1.0, abs=4 * 4 * math.pi * deviation)
