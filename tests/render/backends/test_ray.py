"""The ray backend: equal bits with any threads, BVH and crop; focal points; a requested error."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan
from maquette.compiler.scene.row_records import CameraData, LightData, MeshData
from maquette.render.backends import kernel_choice
from maquette.render.film import denoise
from maquette.render.image import metrics
from maquette.render.types import Tile, View

from ..pictures import picture
from ..tables import looking, matrix, phong, scene, turn

K = ir.GeometryKind
Model = ir.MaterialModel


def still_life() -> ir.Tables:
    """Every kind of shape except the unbounded quadric, a mesh, glass, a mirror; a sun, a point light and a sky."""
    shapes = [
        (K.PLANE, [], matrix((0, -1, 0)), 0),
        (K.SPHERE, [0.5], matrix((-1, -0.5, 0)), 1),
        (K.BOX, [0.3, 0.5, 0.3], matrix((0.2, -0.5, -1)), 2),
        (K.CYLINDER, [0.3, 0.4, 1], matrix((1.2, -0.6, 0)), 3),
        (K.CONE, [0.4, 0.1, 0.4, 1], matrix((0.3, -0.6, 0.4)), 1),
        (K.TORUS, [0.4, 0.12], matrix((-0.4, 0.5, -0.5), turn(0, 1.0)), 2),
        (K.CAPSULE, [0.15, 0.3], matrix((0.8, 0.3, 0.2), turn(2, 0.7)), 0),
        (K.QUADRIC, [1, -1, 1, 0, 0, 0, 0, 0, 0, -0.02, 0.3, 0.3, 0.3], matrix((-1.2, 0.4, -0.3)), 3),
    ]
    corner = MeshData(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]]))
    lights = [
        LightData(ir.LightKind.SUN, (2.0, 1.9, 1.8), direction=(0.4, 0.8, 0.45), angle=0.02),
        LightData(ir.LightKind.POINT, (1.0, 1.0, 1.5), position=(-1.0, 2.0, 2.0)),
        LightData(ir.LightKind.SKY, (0.3, 0.4, 0.6)),
    ]
    return scene(
        shapes,
        meshes=[(corner, matrix((0.6, -0.9, 1.0), 0.5 * turn(1, 0.5)), 2)],
        materials=[
            phong(0.6),
            phong(0.3, 0.4, 40.0),
            phong(model=Model.MIRROR, reflection=0.8),
            phong(model=Model.GLASS, transmission=1.0, ior=1.5),
        ],
        lights=lights,
        camera=CameraData(transform=1, extent=0.5),
        frame=looking((0.5, 0.8, 4.0), (0.0, -0.2, 0.0)),
    )


def ray(tables: ir.Tables, overrides: dict[str, str] | None = None, **settings: Any) -> Any:
    complete = {"size": (60, 44), "samples": 4, "background": "sky", "aov": ("depth", "normal", "id"), **settings}
    return picture(tables, "ray", overrides, **complete)


def same(a: Any, b: Any) -> None:
    for name, channel in a.channels.items():
        np.testing.assert_array_equal(channel, b.channels[name])


@pytest.mark.long
def test_threads_and_trees_change_no_bit() -> None:
    tables = still_life()
    single = ray(tables, threads=1)
    assert single.metadata["issues"] == 0
    assert len(np.unique(single.channels["id"][..., 0])) >= 9
    for other in (ray(tables, threads=2), ray(tables, threads=5), ray(tables, {"accelerator": "brute_force"})):
        same(single, other)


def test_an_adaptive_picture_is_the_same_for_any_number_of_threads() -> None:
    settings = {"samples": None, "error": 0.15}
    by_one, by_two, by_five = (ray(still_life(), threads=n, **settings) for n in (1, 2, 5))
    same(by_one, by_two)
    same(by_one, by_five)
    assert by_one.metadata["samples_mean"] == by_two.metadata["samples_mean"]


def test_a_crop_is_a_part_of_the_whole() -> None:
    complete, part = ray(still_life()), ray(still_life(), crop=(7, 5, 50, 41))
    for name, channel in part.channels.items():
        np.testing.assert_array_equal(channel, complete.channels[name][5:41, 7:50])


@pytest.mark.long
def test_the_error_asked_for_is_reached() -> None:
    tables = still_life()
    truth = ray(tables, samples=512, aov=()).channels["rgba"][..., :3]
    for error in (0.2, 0.1):
        image = ray(tables, samples=None, error=error, aov=(), seed=7)
        assert metrics.root_relmse(image.channels["rgba"][..., :3], truth) < 1.15 * error
        assert image.metadata["error"] < error


def focus_of_a_ball(height: float, index: float) -> float:
    """The distance from a ball of radius 1 to where a ray parallel to the axis crosses the axis behind it (Snell twice)."""
    inward = np.arcsin(height)
    within = np.arcsin(height / index)
    turned = 2.0 * (inward - within)
    exit_angle = inward - 2.0 * within  # of the exit point below the axis, seen from the centre
    x, y = np.cos(exit_angle), -np.sin(exit_angle)
    return float(x + y / np.tan(turned) - 1.0)


def test_where_a_glass_ball_brings_rays_together() -> None:
    """A small emissive sphere where rays of height 0.3 R cross the axis appears as a ring at that height."""
    assert focus_of_a_ball(0.3, 1.5) == pytest.approx(0.461978, abs=1e-6)
    assert focus_of_a_ball(1e-6, 1.5) == pytest.approx(0.5, abs=1e-9)
    size = 401
    tables = scene(
        [(K.SPHERE, [1.0], np.eye(4), 0), (K.SPHERE, [0.0005], matrix((0, 0, -1.461978)), 1)],
        materials=[phong(model=Model.GLASS, transmission=1.0, ior=1.5), phong(model=Model.EMISSIVE, emission=1.0)],
        camera=CameraData(transform=1, extent=0.5, projection=ir.Projection.ORTHOGRAPHIC),
        frame=matrix((0, 0, 5)),
    )
    shown = picture(tables, "ray", size=(size, size), bounces=2).channels["rgba"][..., 0]
    place = (np.arange(size) + 0.5) / size - 0.5
    height = np.hypot(*np.meshgrid(place, place))
    ring = (shown > 0.5) & (height > 0.05)
    assert ring.sum() > 200
    assert height[ring].mean() == pytest.approx(0.3, abs=2e-3)
    assert np.abs(height[ring] - 0.3).max() < 0.01
    through = 1.0 - ((1.5 - 1.0) / 2.5) ** 2  # at normal incidence; a little less at 17 degrees
    assert shown[ring].mean() == pytest.approx(through**2, abs=2e-3)


def test_guides_are_of_the_size_that_is_drawn(tmp_path):
    """They were of the size before: a picture of a budget was denoised by the edges of a part of it."""
    path = tmp_path / "a.scene"
    text = "sphere(1, material: lambert(#c04020))\nplane(y: -1)\ncamera(position: [0, 1, 5], look_at: [0, 0, 0])\n"
    path.write_text(text, encoding="utf-8")
    loaded = load.load(path)

    def renderer(width: int, height: int) -> Any:
        decided = plan.make_plan(loaded, ir.Settings(size=(width, height)))
        return kernel_choice.make_renderer(loaded, decided, View(decided["camera"], width, height), False)

    resized, small = renderer(32, 24), Tile(0, 0, 16, 12)
    denoise.tile_guides(resized, Tile(0, 0, 32, 24), 1, 1)
    assert resized.resize(16, 12)
    assert np.array_equal(denoise.tile_guides(resized, small, 1, 1), denoise.tile_guides(renderer(16, 12), small, 1, 1))
