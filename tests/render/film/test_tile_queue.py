"""Tiles drawn by kernels: the same bits as one call for each tile, on any number of threads, and after cancelling at any moment."""

from __future__ import annotations

import math
import random
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.render import render_scene
from maquette.render.film import checkpoint, film, tile_queue
from maquette.render.jit.kernel import kernel
from maquette.render.jit.loader import KernelError
from maquette.render.jit.packed_struct import Handle
from maquette.render.types import View

BALL = """plane(y: 0, material: lambert(checker(#eee, #888, size: 50cm)))
sphere(1, center: [0, 1, 0], material: plastic(#d0402a, roughness: 0.15))
sun(from: [2, 4, 3], illuminance: 20000lx)
sky(color: #87b5e0, luminance: 3000nit)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
"""
ROOM = """box([4, 3, 4], center: [0, 1.5, 0], material: lambert(#808080))
sphere(0.4, center: [0, 0.6, 0], material: glass())
area(position: [0, 2.8, 0], look_at: [0, 0, 0], size: [0.6, 0.6], luminance: 30)
camera(position: [1, 1.2, 1.8], look_at: [0, 0.6, 0], fov: 50deg)
"""
HEART = """implicit(|x, y, z| (x^2 + 2.25 * z^2 + y^2 - 1)^3 <= x^2 * y^3 + 0.1125 * z^2 * y^3, within: 1.5)
plane(y: -1.2, material: lambert(#999))
point(position: [2, 4, 3], intensity: 900)
sky(color: #87b5e0, luminance: 1500nit)
camera(position: [0, 0.4, 5], look_at: [0, 0, 0], fov: 35deg)
"""
GROUPS = BALL.replace("20000lx", '20000lx, group: "key"')
MOVING = BALL.replace("center: [0, 1, 0]", "center: [15 * time / 1s, 1, 0]").replace("fov: 35deg", "fov: 35deg, shutter: 20ms")
LENS = BALL.replace("fov: 35deg", "focal: 50mm, aperture: 0.1, focus: 4m")
SIZE = 150, 70  # five by three tiles, of which eight are at an edge
KINDS = {
    "rays": (BALL, {"backend": "ray", "samples": 7}, {}),
    "rays to an error": (BALL, {"backend": "ray", "error": 0.06}, {}),
    "one sample": (BALL, {"backend": "ray", "samples": 1}, {}),
    "triangles": (BALL, {"backend": "raster", "samples": 5}, {}),
    "triangles to an error": (BALL, {"backend": "raster", "error": 0.1}, {}),
    "polygons by scanlines": (BALL + "box(0.5, center: [1, 2, 0])\n", {"backend": "raster", "samples": 5}, {"raster.coverage": "scanline"}),
    "paths": (ROOM, {"backend": "ray", "samples": 6}, {"transport.path_reuse": "none"}),
    "shared paths": (ROOM, {"backend": "ray", "samples": 6}, {}),
    "packets": (HEART, {"backend": "ray", "samples": 7}, {}),
    "packets to an error": (HEART, {"backend": "ray", "error": 0.04}, {}),
    "packets of one sample": (HEART, {"backend": "ray", "samples": 1}, {}),
    "packets of most samples": (HEART, {"backend": "ray", "samples": 160, "size": (70, 20)}, {}),
    "light groups": (GROUPS, {"backend": "ray", "samples": 7, "aov": ("lights",)}, {}),
    "light groups of paths": (ROOM, {"backend": "ray", "samples": 3, "aov": ("lights",)}, {}),
    "light groups of triangles to an error": (GROUPS, {"backend": "raster", "error": 0.2, "aov": ("lights",)}, {}),
    "light groups of packets": (HEART, {"backend": "ray", "samples": 5, "aov": ("lights",)}, {}),
    "motion of triangles": (MOVING, {"backend": "raster", "samples": 20}, {}),
    "a lens of triangles": (LENS, {"backend": "raster", "samples": 20}, {}),
    "a lens of triangles, to an error": (LENS, {"backend": "raster", "error": 0.2}, {}),
    "a crop": (BALL, {"backend": "ray", "samples": 3, "crop": (5, 3, 77, 61)}, {}),
}


def scene_of(folder: Path, text: str) -> Any:
    (folder / "queue.scene").write_text(text, encoding="utf-8")
    return maquette.load(folder / "queue.scene")


def planned(scene: Any, settings: dict[str, Any], overrides: dict[str, str]) -> Any:
    complete = ir.Settings(**{"size": SIZE, "denoise": False, "threads": 1, **settings})
    return planner.make_plan(scene, complete, overrides)


@pytest.mark.long
@pytest.mark.parametrize("name", KINDS)
def test_pictures_are_those_of_single_tiles_on_any_number_of_threads(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text, settings, overrides = KINDS[name]
    scene = scene_of(tmp_path, text)
    drawn = {}
    for threads in (1, 3, 16, 40):
        image = render_scene.draw(scene, planned(scene, {**settings, "threads": threads}, overrides))
        drawn[threads] = image.channels["rgba"], image.metadata["error"], image.metadata["issues"]
    chosen = render_scene.choose_renderer

    def without_kernel(*arguments: Any) -> Any:
        renderer = chosen(*arguments)
        assert renderer.tile_kernel is not None
        renderer.__class__ = type("Single", (type(renderer),), {"tile_kernel": None})
        return renderer

    monkeypatch.setattr(render_scene, "choose_renderer", without_kernel)
    image = render_scene.draw(scene, planned(scene, settings, overrides))
    for picture, error, issues in drawn.values():
        assert np.array_equal(picture, image.channels["rgba"])
        assert (error, issues) == (image.metadata["error"], image.metadata["issues"])


def cancel_at_random(scene: Any, plan: Any, reference: np.ndarray, times: int) -> int:
    """Cancel a picture at random moments; returns how many pictures were partial."""
    view, chance, partial = View(0, *SIZE), random.Random(1), 0
    renderer = render_scene.choose_renderer(scene, plan, view)
    begin, once = renderer.shared(), math.inf  # photons of a picture follow those before it
    for _ in range(3):
        renderer.share(begin)
        began = time.perf_counter()
        film.run(renderer, plan, view)
        once = min(once, time.perf_counter() - began)
    for _ in range(times):
        cancel = threading.Event()
        timer = threading.Timer(chance.uniform(0.0, 1.2 * once), cancel.set)
        timer.start()
        renderer.share(begin)
        image = film.run(renderer, plan, view, cancel=cancel)
        timer.cancel()
        rgba = image.channels["rgba"]
        assert np.isfinite(rgba).all()
        partial += image.metadata["partial"]
        samples = image.channels["samples"][..., 0]
        assert (rgba[samples == 0] == 0.0).all()
        assert np.array_equal(rgba[samples == plan["samples"]], reference[samples == plan["samples"]])
    return partial


@pytest.mark.long
@pytest.mark.parametrize("name", ["rays", "triangles", "shared paths", "packets"])
def test_cancelling_at_random_moments_leaves_whole_calls(name: str, tmp_path: Path) -> None:
    text, settings, overrides = KINDS[name]
    scene = scene_of(tmp_path, text)
    plan = planned(scene, {**settings, "threads": 3, "aov": ("samples",)}, overrides)
    reference = render_scene.draw(scene, plan).channels["rgba"]
    assert cancel_at_random(scene, plan, reference, 25) > 0
    assert np.array_equal(render_scene.draw(scene, plan).channels["rgba"], reference)


@pytest.mark.long
def test_a_picture_is_cancelled_a_thousand_times(tmp_path: Path) -> None:
    text, settings, overrides = KINDS["rays"]
    scene = scene_of(tmp_path, text)
    plan = planned(scene, {**settings, "threads": 4, "aov": ("samples",)}, overrides)
    reference = render_scene.draw(scene, plan).channels["rgba"]
    assert cancel_at_random(scene, plan, reference, 1000) > 100
    assert np.array_equal(render_scene.draw(scene, plan).channels["rgba"], reference)


def test_a_cancelled_picture_goes_on_from_its_checkpoint_with_the_same_bits(tmp_path: Path) -> None:
    text, settings, overrides = KINDS["rays"]
    scene = scene_of(tmp_path, text)
    plan, view, path = planned(scene, {**settings, "threads": 2}, overrides), View(0, *SIZE), tmp_path / "checkpoint"
    reference = render_scene.draw(scene, plan).channels["rgba"]
    renderer = render_scene.choose_renderer(scene, plan, view)
    for _ in range(4):
        cancel = threading.Event()
        keeper = checkpoint.Keeper(path, lambda: "key", 0.0, 0.0, resume=True)  # one is due after every call
        image = film.run(renderer, plan, view, lambda _, cancel=cancel: cancel.set(), cancel, keeper=keeper)
        if not image.metadata["partial"]:
            break
    keeper = checkpoint.Keeper(path, lambda: "key", math.inf, math.inf, resume=True)
    image = film.run(renderer, plan, view, keeper=keeper)
    assert np.array_equal(image.channels["rgba"], reference)


@pytest.mark.long
def test_a_budget_ends_a_picture_and_each_pixel_has_a_mean(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, BALL)
    began = time.perf_counter()
    plan = planned(scene, {"backend": "ray", "samples": 1 << 20, "budget": 1.0, "threads": 2, "size": (96, 64)}, {})
    image = render_scene.draw(scene, plan)
    assert time.perf_counter() - began < 30.0  # a machine may be busy; without an end it takes hours
    reference = render_scene.draw(scene, planned(scene, {"backend": "ray", "samples": 64, "size": (96, 64)}, {}))
    assert image.metadata["samples"] > 1
    assert image.channels["rgba"][..., :3].mean() == pytest.approx(reference.channels["rgba"][..., :3].mean(), rel=0.02)


class Calls(NamedTuple):
    """Calls of `fail` so far."""

    calls: np.ndarray


@kernel
def fail(inputs, tile, first, count, total, film, memory):
    """A kernel that ends with an error in its third tile."""
    inputs.calls[0] += 1
    if inputs.calls[0] == 3:
        raise ValueError("no memory is left")


@pytest.mark.long
def test_an_error_in_a_tile_is_raised_and_stops_all_threads(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, BALL)
    plan, view = planned(scene, {"backend": "ray", "samples": 4, "threads": 3}, {}), View(0, *SIZE)
    renderer = render_scene.choose_renderer(scene, plan, view)
    inputs = Handle(Calls(np.zeros(1, np.int64)))
    failing = tile_queue.TileKernel.link(fail, [inputs], lambda: inputs, inputs.type)
    renderer.__class__ = type("Failing", (type(renderer),), {"tile_kernel": failing})
    with pytest.raises(KernelError, match="draw_tiles"):
        film.run(renderer, plan, view)
    assert film.run(render_scene.choose_renderer(scene, plan, view), plan, view).metadata["partial"] is False
