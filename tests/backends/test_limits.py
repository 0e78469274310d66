"""Extreme scenes: every backend renders them with finite values, and known answers hold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from .views import alpha, channel, grey, rgb

EYE = "camera(position: [0, 2, 5], look_at: [0, 0, 0], fov: 40deg)\n"

STRANGE = {
    "nothing": EYE,
    "nothing but light": EYE + "point([0, 1, 0])\nambient(#ffffff)\n",
    "a lamp on a surface": EYE + "sphere(1)\nplane(y: -1)\npoint([0, 1, 0])\narea([0, -1, 0], size: 1)\nsphere(0.1, center: [1, 0, 0], "
    "material: emissive(1))\n",
    "a lamp in the eye": EYE + "sphere(1)\npoint([0, 2, 5])\narea([0, 2, 5], look_at: [0, 0, 0], up: [0, 0, 1])\n",
    "the eye on a ball": "camera(position: [0, 0, 1], look_at: [0, 0, 0])\nsphere(1)\npoint([0, 0, 0])\npoint([0, 3, 3])\n",
    "the eye in a plane": "camera(position: [0, 0, 1], look_at: [0, 0, 0])\nplane(y: 0)\nsphere(0.2)\npoint([0, 3, 3])\n",
    "the eye in glass": "camera(position: [0, 0, 0.5], look_at: [0, 0, 0])\nsphere(3, material: glass())\nsphere(2)\npoint([0, 0, 0])\n",
    "a very wide lens": "camera(position: [0, 0, 3], fov: 179.9deg)\nsphere(1)\nplane(y: -1)\n",
    "a very long lens": "camera(position: [0, 0, 1e9], fov: 1e-7deg)\nsphere(1)\n",
    "a slanting plane through all": EYE + "plane(normal: [1e-6, 1, 1e-9], point: [0, 0, 0])\npoint([0, 1e-7, 0])\n",
    "huge and tiny": EYE + "sphere(1e12, center: [0, -1e12, 0])\nsphere(1e-30, center: [2, 0, 0])\npoint([0, 4, 0], intensity: 1e-30)\n",
    "stretched without measure": EYE + "scale([1e-12, 1e12, 1]) { sphere(1) }\nscale(-1) { box(1) }\n",
    "glass that cannot be": EYE + "sphere(1, center: [-1, 0, 0], material: glass(ior: 1e-9))\nsphere(1, center: [1, 0, 0], "
    "material: glass(ior: 1e9))\nsky()\n",
    "highlights that cannot be": EYE + "sphere(1, center: [-1, 0, 0], material: phong(#fff, shininess: 0))\nsphere(1, center: [1, 0, 0], "
    "material: blinn_phong(#fff, specular: 1e9, shininess: 1e9))\n",
    "normals and coordinates of nought": EYE + "mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 2]], "
    "normals: [[0, 0, 0], [0, 0, 0], [0, 0, 0]], uv: [[0, 0], [0, 0], [0, 0]], material: lambert(checker(size: 1mm)))\n",
    "quadrics that are planes or nothing": EYE + "quadric([0, 0, 0, 0, 0, 0, 0, 1, 0, 0])\n"
    "quadric([1, 1, 1, 0, 0, 0, 0, 0, 0, 1], within: 2)\n"
    "quadric([1, 0, 0, 0, 0, 0, 0, 0, 0, -1], within: 3)\n",
}


@pytest.mark.parametrize("name", STRANGE)
def test_strange_scenes_are_drawn(draw, draw_on, backend, name):
    """`draw` checks that all values are finite. Backends agree with the reference, except on outlines."""
    image = draw(STRANGE[name], size=(24, 18), samples=2, aov=("id", "normal"))
    assert np.isfinite(channel(image, "normal")).all()
    assert rgb(image).min() >= 0
    if backend != "reference":
        exact = draw_on("reference", STRANGE[name], size=(24, 18), samples=2, aov=("id",))
        assert np.count_nonzero(np.any(image.channels["id"] != exact.channels["id"], axis=-1)) <= 8
        if backend == "ray":
            assert np.allclose(rgb(image), rgb(exact), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("size", [(1, 1), (1, 100), (100, 1), (33, 1)])
def test_pictures_of_any_shape(draw, size):
    image = draw("camera(position: [0, 0, 5], look_at: [0, 0, 0])\nbox(99)\nambient(#ffffff, luminance: 0.5)\n", size=size, samples=3)
    assert image.channels["rgba"].shape == (size[1], size[0], 4)
    assert np.allclose(grey(image), 0.8 * 0.5, rtol=1e-6)


@pytest.mark.parametrize("at", ["[1.37, -2.91, 4.03]", "[-3.3, 0.7, 1.9]", "[0.11, 5.2, 3.3]"])
def test_a_lamp_in_the_eye_does_not_cover_the_picture(draw, at):
    """A plate in the plane of the lens is neither before nor behind the eye, whatever the rounding."""
    text = f"camera(position: {at}, look_at: [0, 0, 0], fov: 40deg)\nsphere(1)\narea({at}, look_at: [0, 0, 0])\n"
    image = draw(text, aov=("id",))
    assert set(np.unique(channel(image, "id")[..., 0])) == {-1, 0}


@pytest.mark.parametrize("far", [1e5, 1e9])
def test_a_scene_far_away_is_the_scene_at_home(draw, far):
    """float64 resolves 1e-7 m at 1e9 m: all pixels except on outlines have equal depth and light."""
    text = (
        "camera(position: [{0}, {0} + 2, {0} + 5], look_at: [{0}, {0}, {0}], fov: 40deg)\nsphere(1, center: [{0}, {0}, {0}])\n"
        "box(1, center: [{0} + 1.5, {0}, {0}])\nplane(y: {0} - 1)\npoint([{0} + 2, {0} + 4, {0} + 3], shadows: false)\n"
        "mesh(points: [[-3, 0, 0], [-1.5, 0, 0], [-2, 1.3, -0.4]], faces: [[0, 1, 2]], translate: [{0}, {0}, {0}])\n"
    )
    home, away = draw(text.format("0"), aov=("id", "depth")), draw(text.format(f"{far:.0f}"), aov=("id", "depth"))
    same = np.all(home.channels["id"] == away.channels["id"], axis=-1)
    assert (~same).sum() <= 12
    near = same & np.isfinite(channel(home, "depth"))
    assert alpha(home).mean() > 0.5
    assert np.allclose(channel(home, "depth")[near], channel(away, "depth")[near], rtol=1e-5)
    assert np.allclose(grey(home)[near], grey(away)[near], rtol=2e-3, atol=1e-5)


def test_of_things_in_the_same_place_one_is_seen(draw, draw_on):
    """Two equal boxes and two equal floors: the same one wins in every pixel on every backend."""
    text = EYE + "".join(
        f"box(1, material: emissive({color}))\nplane(y: -0.5, material: emissive({color}))\n" for color in ("rgb(1, 0, 0)", "rgb(0, 1, 0)")
    )
    image, exact = draw(text, aov=("id",)), draw_on("reference", text, aov=("id",))
    boxes, floors = np.isin(channel(image, "id")[..., 0], (0, 2)), np.isin(channel(image, "id")[..., 0], (1, 3))
    assert len(np.unique(channel(image, "id")[..., 0][boxes])) == 1
    assert len(np.unique(channel(image, "id")[..., 0][floors])) == 1
    assert np.count_nonzero(np.any(image.channels["id"] != exact.channels["id"], axis=-1)) <= 2


def test_inside_a_lamp_all_is_as_bright_as_the_lamp(draw):
    """The eye and a white ball inside a ball of luminance L: E = πL for every direction, within 4 standard errors."""
    text = "camera(position: [0, 0, 0.1], look_at: [0, 0, 0])\nsphere(1, material: emissive(1, luminance: 5))\n"
    image = draw(text + "sphere(0.02, material: lambert(1))\n", samples=4, filter="box", aov=("id",))
    ball = alpha(image) == 1
    values = grey(image)[ball & (channel(image, "id")[..., 0] == 1)]
    assert grey(image)[0, 0] == pytest.approx(5)
    assert abs(values.mean() - 5) <= 4 * values.std(ddof=1) / math.sqrt(len(values))


@pytest.mark.long
def test_mirrors_that_face_each_other_end(trace):
    """A closed room of mirrors: the bounce limit ends paths, whose weight is then below one percent of the light's."""
    text = (
        "camera(position: [0, 0, 0.5], look_at: [0.3, 0.2, -1])\nbox(4, material: mirror(rgb(0.9, 0.9, 0.9)))\n"
        "sphere(0.3, center: [1, 0, 0], material: emissive(1))\n"
    )
    image = trace(text, size=(16, 16), bounces=64)
    levels = np.log(grey(image)[grey(image) > 0]) / math.log(0.9)
    assert np.allclose(levels, np.round(levels), atol=1e-4)
    assert levels.max() > 10


@pytest.mark.long
def test_a_thousand_instances_of_nothing_much(draw):
    """Ten balls at each of a hundred positions: ties and duplicates neither stall the BVH nor change the picture."""
    balls = "for (k in 0..999) { sphere(0.2, center: [mod(k, 10) - 4.5, 0, floor(mod(k, 100) / 10) - 4.5]) }\n"
    text = EYE + "ambient(#ffffff, luminance: 1)\n" + balls
    once = text.replace("0..999", "0..99")
    assert np.allclose(grey(draw(text, size=(24, 18))), grey(draw(once, size=(24, 18))), rtol=1e-6)
