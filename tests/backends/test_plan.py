"""Every plan decision that can be overridden leaves the picture unchanged, or within the bound it declares."""

from __future__ import annotations

import math

import numpy as np
import pytest

from . import scenes
from .views import alpha, channel, rgb

pytestmark = pytest.mark.usefixtures("files")


def _same(a, b) -> None:
    for name in a.channels:
        assert np.array_equal(a.channels[name], b.channels[name]), name


@pytest.mark.long
@pytest.mark.parametrize("name", ["instances", "every shape", "near and far"])
def test_a_tree_or_every_primitive(draw_on, name):
    """The BVH skips only what a ray cannot hit."""
    for backend in ("ray", "raster"):
        text, channels = scenes.DIRECT[name], ("depth", "normal", "id")
        tree, brute = (draw_on(backend, text, {"accelerator": how}, samples=2, aov=channels) for how in ("bvh", "brute_force"))
        _same(tree, brute)


def test_rays_along_the_faces_of_boxes(draw_on):
    """Orthographic rays exactly in faces and on edges of boxes: 0 · ∞ must not hide the surfaces beside."""
    boxes = "".join(
        f"box([2, 2, 1], center: [{2 * i - 5}, {2 * j - 5}, {-((i * 5 + j * 3) % 4)}])\n" for i in range(6) for j in range(6) if (i + j) % 5
    )
    text = "ambient(#ffffff)\ncamera(position: [0, 0, 9], look_at: [0, 0, 0], width: 13)\n" + boxes
    # 26 pixels over 13 metres: centres at multiples of a half, ± a quarter; 13 pixels: centres on the faces at odd metres.
    for size in ((26, 26), (13, 13)):
        tree, brute = (draw_on("ray", text, {"accelerator": how}, size=size, aov=("depth", "id")) for how in ("bvh", "brute_force"))
        exact = draw_on("reference", text, size=size, aov=("depth", "id"))
        _same(tree, brute)
        assert np.array_equal(channel(tree, "depth"), channel(exact, "depth"))
    assert alpha(tree).sum() > 60


@pytest.mark.long
@pytest.mark.parametrize("name", [*scenes.DIRECT, "sun and sky"])
def test_the_three_ways_to_fill(draw_on, name):
    """Edge functions, sub-areas and scanlines cover the same samples."""
    text = {**scenes.DIRECT, **scenes.SOFT}[name]
    pictures = [draw_on("raster", text, {"raster.coverage": how}, samples=2, aov=("depth", "id")) for how in ("edges", "areas", "scanline")]
    if name == "gouraud":  # at outlines front and back are equally near but for rounding, and each side has its own light
        assert np.array_equal(alpha(pictures[0]), alpha(pictures[1]))
        assert np.mean(np.any(rgb(pictures[0]) != rgb(pictures[1]), axis=-1)) < 0.005
    else:
        _same(pictures[0], pictures[1])
    if name in ("every shape", "hard lights", "near and far", "orthographic", "far from the origin", "sun and sky", "OBJ", "instances"):
        # Whole polygons: a hit's triangle may be another beside a diagonal, which rounds differently.
        assert np.array_equal(alpha(pictures[0]), alpha(pictures[2]))
        assert np.array_equal(pictures[0].channels["id"], pictures[2].channels["id"])
        assert np.allclose(rgb(pictures[0]), rgb(pictures[2]), rtol=1e-4, atol=1e-6)
    else:
        assert np.array_equal(alpha(pictures[0]), alpha(pictures[2]))


def test_shadow_rays_where_nothing_stands_before_a_light(draw):
    """One convex object: without shadows nothing changes (except how often the rasterizer would shade a pixel)."""
    text = "camera(position: [0, 0, 4], fov: 40deg)\nsphere(1, material: blinn_phong(#d04030))\npoint([3, 5, 4], intensity: 60)\n"
    often = {"raster.shading": "sample"}
    _same(draw(text, {"shadows": "on", **often}, samples=2), draw(text, {"shadows": "off", **often}, samples=2))


def test_shadow_rays_that_no_light_asks_for(draw):
    """All lights with shadows: false: the plan omits shadow rays; enabling them gives the same picture."""
    text = scenes.CAMERA + scenes.FLOOR + scenes.SHAPES + "point([3, 5, 4], intensity: 60, shadows: false)\n"
    _same(draw(text), draw(text, {"shadows": "on"}))


@pytest.mark.long
def test_a_finer_tolerance_comes_nearer_to_the_outline(draw_on):
    """The raster backend's coverage of a ball is short by at most 4/3 · tolerance / R of its area, and never larger."""
    text = "ambient(#ffffff)\ncamera(position: [0, 0, 9], width: 2.4)\nsphere(1)\n"
    radius = 20.0
    missing = []
    for tolerance in (0.4, 0.05, 0.005):
        image = draw_on("raster", text, {"tolerance": str(tolerance)}, samples=64, filter="box")
        share = 1 - alpha(image).sum() / (math.pi * radius**2)
        assert -1e-3 < share < 4 / 3 * tolerance / radius + 1e-3
        missing.append(share)
    assert missing[0] > missing[2]


def test_rays_draw_the_same_at_any_tolerance(draw_on):
    """The tolerance applies to tessellations; rays hit analytic shapes exactly."""
    text = scenes.DIRECT["every shape"]
    _same(draw_on("ray", text, {"tolerance": "0.5"}), draw_on("ray", text, {"tolerance": "0.05"}))


@pytest.mark.parametrize("backend", ["ray", "raster", "reference"])
def test_a_plane_that_bounds_the_scene_from_below(draw_on, backend):
    """The sky below the horizon is not sampled: a ball on the ground gets exactly ρ L (1 + cos θ) / 2 at one sample a pixel."""
    text = (
        "transform(rotate: [20deg, 0, 10deg]) { plane(y: 0, material: lambert(#000000))\n"
        "sphere(1, center: [0, 1, 0], material: lambert(#ffffff))\n"
        "}\ncamera(position: [0, 1, 6], look_at: [-0.1, 0.9, 0.3], fov: 28deg)\nsky(color: #ffffff, luminance: 2)"
    )
    size = {"size": (24, 24), "samples": 1, "aov": ("normal", "id")}
    picture = draw_on(backend, text, **size)
    ball = picture.channels["id"][..., 0] == 1
    a, b = math.radians(20), math.radians(10)
    up = np.array([-math.cos(a) * math.sin(b), math.cos(a) * math.cos(b), math.sin(a)])  # y turned about x, then z
    assert ball.sum() > 200
    assert np.allclose(rgb(picture)[ball], (1.0 + picture.channels["normal"][ball] @ up)[:, None], rtol=2e-6, atol=1e-6)


@pytest.mark.long
def test_sampling_only_the_sky_above_a_plane_is_right_in_the_mean(draw_on):
    """The picture is equal with and without the decision, except for noise; it is not taken with objects below the plane."""
    scene = "plane(y: 0)\nbox([1, 1, 1], center: [0, {}, 0], rotate: [0, 30deg, 0])\nsphere(0.6, center: [1.2, 0.6, 0.4])\n"
    rest = "sky(color: #ffe0c0, luminance: 1)\ncamera(position: [0, {}, 5], look_at: [0, 0.6, 0], fov: 40deg)"
    for height, eye, taken in ((0.5, 2.0, True), (0.5, -2.0, True), (0.4, 2.0, False)):
        text = scene.format(height) + rest.format(eye)
        pictures = [draw_on("ray", text, plan, size=(32, 32), samples=512) for plan in ({}, {"ground_plane": "off"} if taken else {})]
        assert np.abs(np.mean(rgb(pictures[0]) - rgb(pictures[1]))) < 1e-3
        assert np.abs(rgb(pictures[0]) - rgb(pictures[1])).max() < 0.1
        assert np.array_equal(rgb(pictures[0]), rgb(pictures[1])) == (not taken or eye < 0)


def test_light_in_single_precision(draw_on):
    """Lights without shadows on meshes in float32 relative to the eye: within 1e-5 of float64's largest value."""
    text = scenes.CAMERA + (
        "mesh(points: [[-2, 0, -2], [2, 0, -2], [2, 1, 2], [-2, 0, 2]], faces: [[0, 3, 2, 1]],\n"
        "material: blinn_phong(#d04030, specular: 0.5))\n"
        "point([3, 5, 4], intensity: 60, shadows: false)\nspot([-3, 4, 1], look_at: [0, 0, 0], intensity: 90, shadows: false)\n"
        "directional(from: [-1, 1, 1], irradiance: 2, shadows: false)\nambient(#102030)\n"
    )
    quick, exact = (draw_on("raster", text, {"raster.precision": how}, samples=4) for how in ("float32", "float64"))
    assert rgb(exact).max() > 0.5
    assert np.array_equal(alpha(quick) > 0, alpha(exact) > 0)
    assert np.abs(rgb(quick) - rgb(exact)).max() < 1e-5 * rgb(exact).max()
