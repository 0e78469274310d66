"""Bodies of varying colour: patches have the colour of their texture, no light is added, backends and threads agree."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from .test_media import LOOK, SKY, seen

pytestmark = pytest.mark.long
WALL = "box([40, 40, 4], center: [{x}, 0, -2], material: subsurface({color}, radius: 2cm{more}))\n"
PATCHES = "pattern(|x, y, z| rgb(0.5 + 0.3 * sign(x), 0.6 - 0.1 * sign(x), 0.25 - 0.15 * sign(x)))"


@pytest.mark.parametrize(("x", "color"), [(-9, [0.8, 0.5, 0.1]), (9, [0.2, 0.7, 0.4])])
def test_a_patch_of_a_half_space_has_its_colour(tmp_path: Path, x: float, color: list[float]) -> None:
    wall = WALL.format(x=x, color=PATCHES, more="")
    assert seen(tmp_path, LOOK + SKY + wall, samples=2048)[:3] == pytest.approx(color, rel=0.015)


@pytest.mark.parametrize("more", [", scale: pattern(|x, y, z| 0.5 + max(sign(x), 0))", ", scale: 0.3"])
def test_the_radius_does_not_change_the_colour_of_a_half_space(tmp_path: Path, more: str) -> None:
    wall = WALL.format(x=9, color="rgb(0.7, 0.5, 0.3)", more=more)
    assert seen(tmp_path, LOOK + SKY + wall, samples=2048)[:3] == pytest.approx([0.7, 0.5, 0.3], rel=0.015)


def test_a_furnace_adds_no_light(tmp_path: Path) -> None:
    """A white ball vanishes before a sky of radiance 1; one whose patches are coloured is darker in each channel."""
    look = LOOK.replace("0.2deg", "20deg")
    white = "sphere(1, material: subsurface(pattern(|x, y, z| 1 + 0 * x), radius: 30cm))\n"
    assert seen(tmp_path, look + SKY + white, samples=512)[:3] == pytest.approx(1.0, abs=0.01)
    patches = f"sphere(1, material: subsurface({PATCHES}, radius: 30cm))\n"
    assert (seen(tmp_path, look + SKY + patches, samples=512)[:3] < 1.0).all()


def test_a_pattern_of_one_colour_is_that_colour(tmp_path: Path) -> None:
    """Walks in thin parts, too: equal random numbers, and coefficients that differ by rounding alone."""
    balls = [f"sphere(1, material: subsurface({color}, radius: 50cm))\n" for color in ("rgb(0.6, 0.6, 0.6)", "pattern(|x, y, z| 0.6)")]
    first, second = (seen(tmp_path, LOOK + SKY + ball, samples=256) for ball in balls)
    assert first == pytest.approx(second, rel=1e-3)


def test_backends_and_threads_agree(tmp_path: Path) -> None:
    text = LOOK.replace("0.2deg", "30deg") + SKY + f"sphere(1, material: subsurface({PATCHES}, radius: 40cm))\n"
    text += "sphere(0.3, center: [0, 0, 0.4], material: emissive(2))\n"  # a lamp inside of the body
    settings = {"samples": 64, "bounces": 40}
    ray, single = (seen(tmp_path, text, **settings, threads=n) for n in (2, 1))
    assert (ray == single).all()
    assert seen(tmp_path, text, **settings, backend="reference") == pytest.approx(ray, rel=2e-3)


def test_a_camera_inside_of_a_body(tmp_path: Path) -> None:
    text = LOOK.replace("0, 0, 4]", "0, 0, 0.2]") + SKY + "sphere(1, material: subsurface(checker(#ffffff, #808080), radius: 1m))\n"
    inside = seen(tmp_path, text, samples=64)
    assert np.isfinite(inside).all()
    assert 0.1 < inside[0] <= 1.01


@pytest.mark.parametrize("roughness", [0, 0.3, 1])
def test_a_furnace_of_bodies_with_a_highlight(tmp_path: Path, roughness: float) -> None:
    look = LOOK.replace("0.2deg", "20deg")
    ball = f"sphere(1, material: subsurface(#ffffff, radius: 30cm, roughness: {roughness}, ior: 1.5))\n"
    assert seen(tmp_path, look + SKY + ball, samples=512)[:3] == pytest.approx(1.0, abs=0.012)


@pytest.mark.parametrize("light", ["sky(radiance: 1)", "point([1, 2, 3], intensity: 10)", "directional(from: [0, 1, 0.3])"])
@pytest.mark.parametrize("roughness", [0, 0.15, 0.6])
def test_a_black_body_has_the_highlight_of_principled(tmp_path: Path, light: str, roughness: float) -> None:
    """Reflectance by angle, and light samples that find the highlight."""
    look, pictures = LOOK.replace("0.2deg", "30deg") + light + "\n", []
    for kind in ("subsurface", "principled"):
        thin = ", radius: 0.1mm" if kind == "subsurface" else ""  # of light that leaves beside where it entered
        ball = f"sphere(1, material: {kind}(#000000, roughness: {roughness}, ior: 1.6{thin}))\n"
        pictures.append(seen(tmp_path, look + ball, samples=1024)[:3])
    assert pictures[0] == pytest.approx(pictures[1], rel=0.02, abs=1e-6)


def test_without_a_highlight_the_index_does_not_count(tmp_path: Path) -> None:
    balls = [f"sphere(1, material: subsurface(#ffaa80, radius: 30cm{more}))\n" for more in ("", ", roughness: 0.2, ior: 1")]
    first, second = (seen(tmp_path, LOOK + SKY + ball, samples=64) for ball in balls)
    assert (first == second).all()


def test_backends_agree_on_highlights(tmp_path: Path) -> None:
    text = LOOK.replace("0.2deg", "30deg") + SKY + "point([1, 2, 3], intensity: 10)\n"
    text += "sphere(1, material: subsurface(#c08060, radius: 40cm, roughness: 0.3))\n"
    ray, reference = (seen(tmp_path, text, samples=16, bounces=30, backend=backend) for backend in ("ray", "reference"))
    assert reference == pytest.approx(ray, rel=2e-3)


def test_overlapping_bodies_add_no_light(tmp_path: Path) -> None:
    """Where bodies overlap, the boundary of the one that does not count is passed once; glass elsewhere makes kernels ask for that."""
    balls = "".join(f"sphere(0.8, center: [{x}, 0, 0], material: subsurface(#ffffff, radius: 30cm{more}))\n" for x, more in (
        (-0.3, ""), (0.3, ", priority: 1"), (0, ", roughness: 0.3"),
    ))  # fmt: skip
    text = LOOK.replace("0.2deg", "20deg") + SKY + "sphere(0.1, center: [0, 0, 9], material: glass())\n" + balls
    assert seen(tmp_path, text, samples=512)[:3] == pytest.approx(1.0, abs=0.012)
