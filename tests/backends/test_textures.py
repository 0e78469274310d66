"""Textures on every backend: orientation, mappings, wrap modes and filters by their formulas, procedural ones in metres."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from .views import centres, channel, rgb

RED, GREEN, BLUE, YELLOW = (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)
FOUR = np.array([[RED, GREEN], [BLUE, YELLOW]])  # red top left, green top right, blue bottom left, yellow bottom right
UPRIGHT = [[RED, GREEN], [BLUE, YELLOW]]


def _corners(image) -> list[list[tuple[int, ...]]]:
    """The colours at the centres of the picture's quarters."""
    color, h, w = rgb(image), image.height, image.width
    return [[tuple(color[j, i].round(6).astype(int).tolist()) for i in (w // 4, 3 * w // 4)] for j in (h // 4, 3 * h // 4)]


def _shining(**more: Any) -> str:
    """A material that shows the picture unchanged."""
    given = "".join(f", {name}: {json.dumps(value)}" for name, value in more.items())
    return f'emissive(image("a.exr", filter: "nearest"{given}))'


VIEWS = {  # where the camera stands, what is up
    "front": ([0, 0, 5], [0, 1, 0]),
    "right": ([5, 0, 0], [0, 1, 0]),
    "back": ([0, 0, -5], [0, 1, 0]),
    "left": ([-5, 0, 0], [0, 1, 0]),
    "top": ([0, 5, 0], [0, 0, -1]),
    "bottom": ([0, -5, 0], [0, 0, 1]),
}


def _from(view: str, width: float) -> str:
    position, up = VIEWS[view]
    return f"camera(position: {position}, up: {up}, width: {width})\n"


@pytest.mark.parametrize("mapping", ["uv", "box"])
@pytest.mark.parametrize("view", VIEWS)
def test_a_picture_stands_upright_on_each_face_of_a_box(draw, picture, view, mapping):
    picture("a.exr", FOUR)
    text = f"box([2, 2, 2], material: {_shining(mapping=mapping)})\n"
    assert _corners(draw(_from(view, 2) + text, size=(16, 16))) == UPRIGHT


def test_the_net_folds_to_a_cube(draw, picture):
    """-x, +z, +x, -z in the middle row, +y above +z and -y below it, seen from outside."""
    net = np.zeros((6, 8, 3))
    places = {"left": (0, 1), "front": (1, 1), "right": (2, 1), "back": (3, 1), "top": (1, 0), "bottom": (1, 2)}
    for k, (column, row) in enumerate(places.values()):
        net[2 * row : 2 * row + 2, 2 * column : 2 * column + 2] = FOUR * (k + 1)
    picture("a.exr", net)
    for k, view in enumerate(places):
        text = f"box([2, 2, 2], material: {_shining(mapping='net')})\n"
        seen = _corners(draw(_from(view, 2) + text, size=(16, 16)))
        assert seen == [[tuple((k + 1) * c for c in color) for color in row] for row in UPRIGHT]


@pytest.mark.parametrize("view", ["front", "right", "back", "left"])
@pytest.mark.parametrize("mapping", ["uv", "latlong"])
def test_a_map_stands_upright_on_a_sphere(draw, picture, view, mapping):
    """u = ½ + atan2(x, z)/2π: the picture's centre is at +z, its right half to the right."""
    first = {"left": 1, "front": 2, "right": 3, "back": 4}[view]
    strip = np.zeros((2, 8, 3))
    for column in range(8):
        strip[0, column] = (1, column, 0)
        strip[1, column] = (2, column, 0)
    picture("a.exr", strip)
    text = f"sphere(1, material: {_shining(mapping=mapping)})\n"
    seen = _corners(draw(_from(view, 2) + text, size=(16, 16)))
    left, right = 2 * first - 1, (2 * first) % 8
    assert seen == [[(1, left, 0), (1, right, 0)], [(2, left, 0), (2, right, 0)]]


def test_a_picture_on_a_polygon_goes_where_its_coordinates_say(draw, picture):
    picture("a.exr", FOUR)
    text = "polygon([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], uv: {}, material: " + _shining() + ")\n"
    plain = draw(_from("front", 2) + text.format("[[0, 0], [1, 0], [1, 1], [0, 1]]"), size=(16, 16))
    turned = draw(_from("front", 2) + text.format("[[1, 0], [1, 1], [0, 1], [0, 0]]"), size=(16, 16))
    assert _corners(plain) == UPRIGHT
    assert _corners(turned) == [[BLUE, RED], [YELLOW, GREEN]]


# --- mappings and wraps by formula ----------------------------------------------------------------------------------------

NOISE = np.random.default_rng(7).uniform(0.1, 1.0, (4, 8, 3)).astype(np.float32)

WRAPS: dict[str, Callable[[np.ndarray, int], np.ndarray]] = {
    "repeat": lambda k, n: k % n,
    "clamp": lambda k, n: np.clip(k, 0, n - 1),
    "mirror": lambda k, n: np.where(k % (2 * n) < n, k % (2 * n), 2 * n - 1 - k % (2 * n)),
    "black": lambda k, n: np.where((k >= 0) & (k < n), k, -1),
}


def _nearest(u: np.ndarray, v: np.ndarray, wrap: str) -> tuple[np.ndarray, np.ndarray]:
    """(colour, certain) of NOISE at u, v; uncertain within 1e-4 of a texel's edge."""
    s, t = u * 8, (1 - v) * 4
    column, row = WRAPS[wrap](np.floor(s).astype(int), 8), WRAPS[wrap](np.floor(t).astype(int), 4)
    color = np.where(((column >= 0) & (row >= 0))[..., None], NOISE[row, column], 0)
    return color, (np.abs(s - np.round(s)) > 1e-4) & (np.abs(t - np.round(t)) > 1e-4)


def _agree(image, u: Any, v: Any, wrap: str, where: np.ndarray) -> None:
    color, sure = _nearest(u, v, wrap)
    sure &= where
    assert sure.sum() > 400
    assert np.array_equal(rgb(image)[sure], color[sure].astype(np.float64))


@pytest.mark.parametrize("wrap", WRAPS)
def test_wraps_outside_of_a_picture(draw, picture, wrap):
    picture("a.exr", NOISE)
    text = "polygon([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], uv: [[-2.3, -1.7], [2.9, -1.7], [2.9, 3.1], [-2.3, 3.1]], material: "
    image = draw(_from("front", 2) + text + _shining(wrap=wrap) + ")\n")
    x, y = centres(image)
    _agree(image, -2.3 + 5.2 * x / 48, 3.1 - 4.8 * y / 48, wrap, np.ones_like(x, bool))


def test_the_courses_projection_of_a_sphere(draw, picture):
    """u = x/|p|, v = y/|p| in the shape's frame, for every shape: here an ellipsoid and a torus."""
    picture("a.exr", NOISE)
    for shape in ("sphere(1.5, scale: [1, 0.6, 1.2]", "torus(1, 0.4, rotate: [90deg, 0, 0]"):
        image = draw(_from("front", 3) + f"{shape}, material: {_shining(mapping='projected', wrap='mirror')})\n", aov=("position", "id"))
        p = channel(image, "position")
        if shape.startswith("sphere"):
            p = p / np.array([1, 0.6, 1.2])
        else:
            p = np.stack([p[..., 0], p[..., 2], -p[..., 1]], axis=-1)  # back by −90° about x
        p = p / np.maximum(np.linalg.norm(p, axis=-1, keepdims=True), 1e-12)
        _agree(image, p[..., 0], p[..., 1], "mirror", channel(image, "id")[..., 0] == 0)


def test_latitude_and_longitude_of_any_shape(draw, picture):
    picture("a.exr", NOISE)
    text = f"box([1, 2, 1.5], material: {_shining(mapping='latlong')})\n"
    image = draw("camera(position: [3, 2, 4], fov: 30deg)\n" + text, aov=("position", "id"))
    p = channel(image, "position")
    p = p / np.maximum(np.linalg.norm(p, axis=-1, keepdims=True), 1e-12)
    u, v = 0.5 + np.arctan2(p[..., 0], p[..., 2]) / (2 * math.pi), 0.5 + np.arcsin(p[..., 1]) / math.pi
    _agree(image, u, v, "repeat", channel(image, "id")[..., 0] == 0)


def test_scale_and_offset_repeat_and_move_a_picture(draw, picture):
    """(u, v) → scale · ((u, v) − offset): the corner moves to the offset."""
    picture("a.exr", NOISE)
    text = f"box([2, 2, 2], material: {_shining(scale=[3, 2], offset=[0.3, -0.2])})\n"
    image = draw(_from("front", 2) + text)
    x, y = centres(image)
    _agree(image, 3 * (x / 48 - 0.3), 2 * (1 - y / 48 + 0.2), "repeat", np.ones_like(x, bool))


def test_a_ramp_is_linear_between_pixel_centres(draw, picture):
    """Bilinear filtering: a picture linear in u and v is linear on the surface, up to half a texel from its edges."""
    s, t = (np.arange(8) + 0.5) / 8, 1 - (np.arange(4) + 0.5) / 4
    ramp = np.zeros((4, 8, 3))
    ramp[..., 0], ramp[..., 1] = s[None, :], t[:, None]
    picture("a.exr", ramp)
    image = draw(_from("front", 2) + 'box([2, 2, 2], material: emissive(image("a.exr", wrap: "clamp")))\n')
    x, y = centres(image)
    u, v = x / 48, 1 - y / 48
    inner = (np.abs(u - 0.5) < 0.5 - 1 / 16) & (np.abs(v - 0.5) < 0.5 - 1 / 8)
    assert np.allclose(rgb(image)[inner][:, 0], u[inner], atol=1e-6)
    assert np.allclose(rgb(image)[inner][:, 1], v[inner], atol=1e-6)


# --- patterns -----------------------------------------------------------------------------------------------------------


def test_checkers_have_the_size_they_are_given(draw):
    """Cells of 50 cm on an unbounded floor, with a corner at its origin; unfiltered, so that there are two colours."""
    text = "camera(position: [0.13, 3, 0.21], look_at: [0.13, 0, 0.21], up: [0, 0, -1], width: 6)\n"
    text += "plane(y: 0, material: emissive(checker(rgb(1, 1, 1), rgb(0.25, 0.25, 0.25), size: 50cm)))\n"
    image = draw(text, {"texture_filter": "point"}, aov=("position",))
    p = channel(image, "position")
    odd = (np.floor(p[..., 0] / 0.5) + np.floor(p[..., 2] / 0.5)) % 2 == 1
    seen = rgb(image)[..., 0] == 1
    assert np.array_equal(seen, odd) or np.array_equal(seen, ~odd)
    assert set(np.unique(rgb(image)).tolist()) == {0.25, 1.0}


def test_stripes_have_the_size_they_are_given(draw):
    text = "camera(position: [0.13, 0.1, 5], look_at: [0.13, 0.1, 0], width: 2)\n"
    text += "polygon([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], uv: [[0, 0], [1, 0], [1, 1], [0, 1]], "
    image = draw(text + "material: emissive(stripes(#fff, #000, size: 20cm)))\n", {"texture_filter": "point"}, aov=("position",))
    column = np.floor((channel(image, "position")[..., 0] + 2) / 0.2)
    assert np.array_equal(rgb(image)[..., 0] == 1, column % 2 == 0)
