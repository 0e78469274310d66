"""Cameras and settings in the tables: lenses, frames, and what render and animate ask for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir

REST = "\nsphere(1)\nsun()\n"


def test_a_camera_looks_down_minus_z(compiled) -> None:
    t = compiled("camera(position: [0, 3, 4], look_at: [0, 0, 0])" + REST).tables
    m = t.transforms.matrix[t.cameras.transform[0]]
    assert -m[:, 2] == pytest.approx([0, -0.6, -0.8])
    assert m[:, 1] == pytest.approx([0, 0.8, -0.6])
    assert m[:, 3].tolist() == [0, 3, 4]


def test_a_rolled_camera(compiled) -> None:
    t = compiled("camera([0, 0, 5], up: [1, 0, 0])" + REST).tables
    assert t.transforms.matrix[t.cameras.transform[0]][:, 0] == pytest.approx([0, -1, 0])


@pytest.mark.parametrize(
    ("arguments", "lens", "focus"),
    [
        ("", 0.0, 1.0),
        (", focal: 50mm, aperture: 2", 0.0125, 5.0),
        (", focal: 100mm, aperture: 4, focus: 3m", 0.0125, 3.0),
        (", fov: 90deg, aperture: 1.2", 0.005, 5.0),
    ],
)
def test_apertures(compiled, arguments: str, lens: float, focus: float) -> None:
    """focal/N across; of a `fov` that of a film 24 mm high; in focus what is looked at, unless said."""
    c = compiled(f"camera([0, 0, 5]{arguments})" + REST).tables.cameras
    assert c.lens[0] == pytest.approx(lens)
    assert c.focus[0] == pytest.approx(focus)


def test_panoramas_and_what_lies_behind(compiled) -> None:
    c = compiled('camera([0, 0, 5], projection: "panoramic")\ncamera([0, 0, 5], width: 2, near: -3)' + REST).tables.cameras
    assert c.projection.tolist() == [ir.Projection.PANORAMIC, ir.Projection.ORTHOGRAPHIC]
    assert c.aspect[0] == 2
    assert c.near.tolist() == [0, -3]


@pytest.mark.parametrize(
    ("arguments", "extent", "fit", "aspect", "projection"),
    [
        ("", math.tan(math.radians(20)), ir.Fit.VERTICAL, 0, ir.Projection.PERSPECTIVE),
        (", fov: 90deg", 1, ir.Fit.VERTICAL, 0, ir.Projection.PERSPECTIVE),
        (", focal: 50mm", 0.24, ir.Fit.VERTICAL, 1.5, ir.Projection.PERSPECTIVE),
        (", focal: 50mm, film: [40mm, 20mm]", 0.2, ir.Fit.VERTICAL, 2, ir.Projection.PERSPECTIVE),
        (", width: 4", 2, ir.Fit.HORIZONTAL, 0, ir.Projection.ORTHOGRAPHIC),
        (', width: 4, projection: "orthographic"', 2, ir.Fit.HORIZONTAL, 0, ir.Projection.ORTHOGRAPHIC),
    ],
)
def test_lenses(compiled, arguments: str, extent: float, fit: ir.Fit, aspect: float, projection: ir.Projection) -> None:
    c = compiled(f"camera([0, 0, 5]{arguments})" + REST).tables.cameras
    assert c.extent[0] == pytest.approx(extent)
    assert (c.fit[0], c.projection[0]) == (fit, projection)
    assert c.aspect[0] == pytest.approx(aspect)
    assert (c.near[0], c.far[0], c.shift[0].tolist()) == (0, np.inf, [0, 0])
    assert math.isnan(c.exposure[0])


def test_the_rest_of_a_camera(compiled) -> None:
    scene = compiled('camera([0,0,5], near: 1, far: 20, shift: [0.1, -0.2], exposure: 2, name: "main", view: "AgX")' + REST)
    c = scene.tables.cameras
    assert (c.near[0], c.far[0], c.shift[0].tolist(), c.exposure[0]) == (1, 20, [0.1, -0.2], 2)
    assert (scene.names.cameras, scene.settings.view) == (("main",), "AgX")


def test_cameras_keep_their_order(compiled) -> None:
    scene = compiled('camera([0,0,5], name: "a")\ncamera([0,0,9], name: "b")' + REST)
    assert scene.names.cameras == ("a", "b")


def test_settings(compiled) -> None:
    scene = compiled(
        'render(size: [640, 480], backend: "ray", samples: 4, error: 1%, budget: 20s, bounces: 3, seed: 7, filter: "box", '
        'background: rgb(0, 0.5, 1), crop: [10, 20, 100, 200], aov: ["depth", "id"])\n'
        "animate(duration: 12s, fps: 30)\ncamera([0,0,5])" + REST
    )
    assert scene.settings == ir.Settings(
        size=(640, 480), backend="ray", samples=4, error=0.01, budget=20, bounces=3, seed=7, filter="box", background=(0, 0.5, 1),
        crop=(10, 20, 100, 200), aov=("depth", "id"),
    )  # fmt: skip
    assert (scene.duration, scene.fps) == (12, 30)


def test_nothing_said_is_nothing_set(compiled) -> None:
    scene = compiled("camera([0,0,5])" + REST)
    assert scene.settings == ir.Settings()
    assert (scene.duration, scene.fps) == (None, 24)


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        (
            "camera([0,0,5], look_at: [0,0,5])",
            "the camera looks at where it is: it has no direction",
            "give it another position or look_at",
        ),
        ("camera([0,0,5], near: 3, far: 2)", "the camera's near (3 m) is not before its far (2 m)", ""),
        ("camera([0,0,5], film: [1, 1])", "`film` goes with `focal`", "write focal: 50mm, film: [36mm, 24mm]"),
        ("camera([0,0,5], near: -1)", "the camera's near (-1 m) lies behind it", "only orthographic cameras show objects behind them"),
        (
            'camera([0,0,5], projection: "panoramic", fov: 90deg)', "a panoramic camera shows all directions: it has no `fov`",
            "leave it out",
        ),
        (
            'camera([0,0,5], projection: "panoramic", aperture: 2)', "only perspective cameras have an aperture",
            "leave it out: everything is in focus",
        ),
        ("camera([0,0,5], width: 2, aperture: 2)", "only perspective cameras have an aperture", "leave it out: everything is in focus"),
        ("camera([0,0,5], focus: 2)", "`focus` goes with `aperture`", "write aperture: 2.8, focus: 3m"),
        (
            'camera([0,0,5], width: 2, projection: "perspective")',
            '`width` makes a camera orthographic: it does not go with projection: "perspective"',
            "write fov instead",
        ),
        ('camera([0,0,5], projection: "orthographic")', "an orthographic camera has a `width`", "write width: 4m"),
        ("render(crop: [0, 0, 10])", "a crop is the four whole numbers x0, y0, x1, y1", "pixels, from the top left"),
        (
            "render(size: [20, 10], crop: [0, 0, 21, 10])",
            "the crop [0, 0, 21, 10] does not lie inside the picture of 20 by 10 pixels",
            "x0 < x1 and y0 < y1",
        ),
        ("render(crop: [5, 0, 5, 10])", "the crop [5, 0, 5, 10] does not lie inside the picture", "x0 < x1 and y0 < y1"),
        ("render(size: [10, 100000])", "a picture of 10 by 100000 pixels is too big", "at most 65536 each way"),
        ('render(aov: ["depht"])', "no channel is called `depht`", "did you mean `depth`?"),
        ('render(aov: ["x"])', "no channel is called `x`", "there are "
            "depth, normal, position, albedo, uv, id, transmittance, scatter_depth, "
            "variance, samples, cryptomatte, lights, issues"),
    ],
)
def test_messages(said, text: str, message: str, hint: str) -> None:
    assert said(text + REST) == f"a.scene:1:1: error: {message}\n   1 | {text}\n     | {'^' * len(text)} {hint}".rstrip()


@pytest.mark.parametrize(("text", "value"), [("4000", 4000.0), ("kelvin(2700)", 2700.0), ('"auto"', "auto")])
def test_white_balance(compiled, text: str, value: float | str) -> None:
    assert compiled(f"sphere(1)\ncamera([0, 0, 5], white: {text})").settings.white == value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('"warm"', 'expected temperature in kelvin or "auto", got the string "warm"'),
        ("20", "`white` must be 800..40000 kelvin, got 20"),
        ("#ff8800", "`white` takes the light of a black body, and this is another colour"),
    ],
)
def test_wrong_white_balance(said, text: str, message: str) -> None:
    assert message in said(f"sphere(1)\ncamera([0, 0, 5], white: {text})")
