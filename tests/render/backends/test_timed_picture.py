"""Pictures with a budget: resolution, filled pixels and what is reserved, by a renderer whose samples move the clock."""

from __future__ import annotations

import math
import threading
from typing import Any, NamedTuple

import numpy as np
import pytest
from maquette.compiler.plan.decision import Decision
from maquette.compiler.plan.plan import Plan
from maquette.render import picture_notes
from maquette.render.backends import timed_picture
from maquette.render.film import film
from maquette.render.film.deadline import Deadline
from maquette.render.film.denoise_time import Denoising
from maquette.render.image.image import Image
from maquette.render.jit import compile_events
from maquette.render.types import Film, Tile, View

SIZE = (96, 64)


class Ramp(film.Unshared):
    """Draws how far right a pixel is in the picture; a sample takes `each` seconds."""

    whole, by_tile, cell, side = None, False, 1, film.TILE

    def __init__(self, each: float, resizes: bool = True, size: tuple[int, int] = SIZE) -> None:
        self.each, self.resizes, self.now, self.size = each, resizes, 0.0, size
        self.limits: list[Deadline] = []

    def limit_time(self, deadline: Deadline) -> None:
        self.limits.append(deadline)

    def resize(self, width: int, height: int) -> bool:
        self.size = (width, height) if self.resizes else self.size
        return self.resizes

    def sample(self, tile: Tile, first: np.ndarray, count: np.ndarray, total: int, film: Film) -> None:
        x = (np.arange(tile.x0, tile.x1) + 0.5) / self.size[0]
        film.color[...] += (x[None, :] * count)[..., None]
        film.alpha[...] += count
        self.now += self.each * float(count.sum())

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, np.ndarray]) -> None:
        for name in names:
            out[name][...] = 7.0


def plan_of(budget: float, **more: Any) -> Plan:
    values = {
        "backend": "ray", "camera": 0, "size": SIZE, "crop": (0, 0, *SIZE), "aov": (), "samples": 1 << 20, "threads": 1, "error": 0.0,
        "budget": budget, "denoise": "off", "monte_carlo": True, **more,
    }  # fmt: skip
    return Plan({name: Decision(name, value, "") for name, value in values.items()})


def drawn(renderer: Ramp, budget: float, **more: Any) -> Image:
    plan = plan_of(budget, **more)
    work = timed_picture.Work(renderer, plan, View(0, *plan["size"]), None, threading.Event(), None, None, False)
    return timed_picture.run(work, Deadline(budget, 0.0, lambda: renderer.now), lambda image: None)


class Compiling(Ramp):
    """Its first call compiles a kernel for 20 seconds."""

    def sample(self, tile: Tile, first: np.ndarray, count: np.ndarray, total: int, film: Film) -> None:
        if self.now < 20.0:
            with compile_events.compiling("light"):
                self.now += 20.0
        super().sample(tile, first, count, total, film)


def expected() -> np.ndarray:
    return np.broadcast_to((np.arange(SIZE[0]) + 0.5) / SIZE[0], SIZE[::-1])


@pytest.mark.parametrize(("each", "resolution"), [(1e-5, 1), (6e-4, 1), (3e-3, 2), (1e-2, 4), (4e-2, 8)])
def test_the_picture_is_as_fine_as_the_time_allows(each: float, resolution: int) -> None:
    renderer = Ramp(each)
    image = drawn(renderer, 10.0)
    assert image.metadata["resolution"] == resolution
    assert renderer.now < 10.0 + 32 * 32 * each  # the first call of a new pace
    assert renderer.size == SIZE
    assert (image.width, image.height, image.metadata["size"]) == (*SIZE, SIZE)
    np.testing.assert_allclose(image.channels["rgba"][..., 0], expected(), atol=0.5 * resolution / SIZE[0] + 1e-6)
    warnings = picture_notes.budget_warnings(image.metadata, plan_of(10.0))
    width, height = SIZE[0] // resolution, SIZE[1] // resolution
    about = f"the budget of 10 s has no time for a sample of each pixel: the picture is drawn at {width}x{height} pixels and enlarged"
    assert [d.message for d in warnings] == ([] if resolution == 1 else [about])


def test_a_spent_budget_still_gives_a_picture() -> None:
    renderer = Ramp(1e-3)
    renderer.now = 99.0
    image = drawn(renderer, 5.0)
    assert 99.0 < renderer.now < 99.0 + 0.3 + 12 * 8 * 1e-3 * 2  # what a late picture may take, and a preview of 1/8 twice
    assert image.metadata["resolution"] == 8
    np.testing.assert_allclose(image.channels["rgba"][..., 0], expected(), atol=4.0 / SIZE[0] + 1e-6)


def test_without_another_size_pixels_show_the_nearest() -> None:
    image = drawn(Ramp(1e-3, resizes=False), 4.0)  # a pass takes 6 s
    assert 0.3 < image.metadata["filled"] < 0.9
    assert image.channels["rgba"][..., 3].min() == 1.0
    warnings = picture_notes.budget_warnings(image.metadata, plan_of(4.0))
    share = f"{image.metadata['filled']:.1%}"
    assert [d.message for d in warnings] == [f"the budget of 4 s ended before {share} of the pixels had a sample: they show what is near"]


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (64, 1), (37, 23), (64, 48)])
@pytest.mark.parametrize(("share", "bound"), [(0.02, 0.3), (0.3, 0.1), (0.9, 0.03)])
def test_holes_show_what_is_around(size: tuple[int, int], share: float, bound: float) -> None:
    w, h = size
    rows, columns = np.mgrid[:h, :w]
    ramp = np.stack([columns / w, rows / h, np.full((h, w), 0.25), np.ones((h, w))], axis=-1).astype(np.float32)
    drawn = np.random.default_rng(7).random((h, w)) < share
    drawn[h // 2, w // 2] = True
    pixels = np.where(drawn[..., None], ramp, np.float32(np.nan))
    timed_picture.fill_holes(pixels, ~drawn)
    assert np.all(pixels[drawn] == ramp[drawn])
    assert np.all(pixels[..., 2] == 0.25)
    assert np.all(pixels[..., 3] == 1.0)
    assert np.abs(pixels - ramp)[..., :2].mean() < bound


def test_holes_make_no_streaks() -> None:
    """A pixel that is there spreads as far along columns as along rows."""
    pixels, missing = np.zeros((65, 65, 1), np.float32), np.ones((65, 65), bool)
    for row, column in ((32, 32), (0, 0), (0, 64), (64, 0), (64, 64)):
        missing[row, column] = False
    pixels[32, 32] = 1.0
    timed_picture.fill_holes(pixels, missing)
    near = pixels[..., 0] > 0.5
    across, along = near.any(axis=0).sum(), near.any(axis=1).sum()
    assert 0.7 < across / along < 1.4


def test_a_crop_is_enlarged_in_its_place() -> None:
    image = drawn(Ramp(2e-2), 10.0, crop=(48, 16, 96, 64))
    assert image.metadata["resolution"] > 1
    np.testing.assert_allclose(image.channels["rgba"][..., 0], expected()[16:64, 48:], atol=0.5 * image.metadata["resolution"] / SIZE[0])


def test_channels_are_drawn_at_full_size() -> None:
    image = drawn(Ramp(1e-2), 10.0, aov=("depth", "samples"))
    assert image.metadata["resolution"] > 1
    assert np.all(image.channels["depth"] == 7.0)
    assert np.all(image.channels["samples"] == np.float32(image.metadata["samples_mean"]))


def test_a_denoised_picture_without_time_for_it_says_so() -> None:
    image = drawn(Ramp(1e-3), 1.0, denoise="on")
    assert image.metadata["denoising_left_out"]
    warnings = picture_notes.budget_warnings(image.metadata, plan_of(1.0, denoise="on"))
    assert ("warning", "the picture is not denoised: the budget of 1 s has no time for it") in [(d.severity, d.message) for d in warnings]


class Slow(NamedTuple):
    """Denoising takes `each` seconds a pixel."""

    each: float

    def plan(self, pixels: int) -> Denoising:
        return Denoising(1, False, pixels * self.each)


def test_each_pixel_has_a_sample_beside_the_time_of_denoising(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two samples of each pixel fit into the budget, but not beside the denoising of as many pixels."""
    monkeypatch.setattr(timed_picture, "DenoisingTime", lambda *arguments: Slow(6e-4))
    monkeypatch.setattr(timed_picture.denoise, "denoise", lambda *arguments: None)
    image = drawn(Ramp(7e-4), 10.0, denoise="on")
    assert image.metadata["resolution"] == 2
    assert not image.metadata.get("denoising_left_out")


def test_enlarged_keeps_what_is_even_and_linear() -> None:
    even = np.full((3, 5, 4), 2.5, np.float32)
    assert np.all(timed_picture.enlarged(even, (5, 3), (0, 0, 5, 3), (50, 30), (0, 0, 50, 30)) == 2.5)
    single = timed_picture.enlarged(np.ones((1, 1, 4), np.float32), (1, 1), (0, 0, 1, 1), (7, 5), (0, 0, 7, 5))
    assert single.shape == (5, 7, 4)


def test_a_kernel_that_compiles_in_the_first_call_leaves_half_of_the_budget() -> None:
    renderer = Compiling(1e-4)
    deadline = Deadline(10.0, 0.0, lambda: renderer.now)
    work = timed_picture.Work(renderer, plan_of(10.0), View(0, *SIZE), None, threading.Event(), None, None, False)
    with deadline.watch_compiler():
        image = timed_picture.run(work, deadline, lambda image: None)
    assert image.metadata["resolution"] == 1
    assert image.metadata["samples_mean"] > 3.0
    assert 23.0 < renderer.now < 25.5


def test_late_pictures_say_what_took_the_time() -> None:
    about: dict[str, Any] = {"seconds": {"compile_kernels": 0.1}, "ready": 1.0, "ready_cpu": 0.9}
    took = "the picture took 9.0 s, more than its budget of 5 s"

    def message(cpu: float = 8.0, **more: Any) -> str:
        (warning,) = picture_notes.late_warnings({**about, **more}, Deadline.ended(5.0, 9.0, cpu))
        return warning.message

    assert picture_notes.late_warnings(about, Deadline.ended(5.0, 5.4, 5.0)) == []
    assert picture_notes.late_warnings(about, Deadline.ended(math.inf, 9.0, 8.0)) == []
    assert picture_notes.late_warnings({**about, "partial": True}, Deadline.ended(5.0, 9.0, 8.0)) == []
    assert message() == took
    assert message(ready=6.0, ready_cpu=5.0) == f"{took}: reading and preparing the scene took 6.0 s"
    assert message(seconds={"compile_kernels": 3.0}) == f"{took}: compiling kernels took 3.0 s, once"
    assert message(seconds={"write": 3.5}) == f"{took}: writing the picture took 3.5 s"


def test_late_pictures_say_that_other_work_took_the_processor() -> None:
    about = {"seconds": {}, "ready": 102.4, "ready_cpu": 1.9}
    (warning,) = picture_notes.late_warnings(about, Deadline.ended(5.0, 105.0, 2.0))
    assert warning.message == (
        "the picture took 105.0 s, more than its budget of 5 s: reading and preparing the scene took 102.4 s, "
        "of which a processor worked 1.9 s"
    )
    assert warning.hint == "other work or a slow disk delays it: end that work, or give a longer --budget"
    (warning,) = picture_notes.late_warnings({}, Deadline.ended(5.0, 20.0, 3.0), "the chart")
    assert warning.message == "the chart took 20.0 s, more than its budget of 5 s, of which a processor worked 3.0 s"


def test_late_pictures_name_all_steps_that_matter() -> None:
    about = {"seconds": {"write": 3.5}, "ready": 2.3, "ready_cpu": 2.0}
    (warning,) = picture_notes.late_warnings(about, Deadline.ended(4.0, 7.5, 7.0))
    assert warning.message == (
        "the picture took 7.5 s, more than its budget of 4 s: reading and preparing the scene took 2.3 s; writing the picture took 3.5 s"
    )
    assert warning.hint == "a longer --budget or a smaller --size"


def test_a_picture_that_is_late_in_any_case_is_whole_where_that_takes_little() -> None:
    renderer = Ramp(1e-5)
    renderer.now = 9.0
    image = drawn(renderer, 5.0)
    assert image.metadata["resolution"] == 1
    assert image.metadata["filled"] == 0.0
    assert renderer.now < 9.4


@pytest.mark.parametrize("each", [1e-2, 1e-4])
def test_a_preview_of_a_large_picture_takes_little_of_the_budget(each: float) -> None:
    size = (1024, 768)  # of which a preview of 1/8 has 12,288 pixels
    renderer = Ramp(each, size=size)
    image = drawn(renderer, 10.0, size=size, crop=(0, 0, *size))
    assert renderer.now < 10.0 + 32 * 32 * each
    assert image.metadata["resolution"] == (32 if each == 1e-2 else 4)
    wide = np.broadcast_to((np.arange(size[0]) + 0.5) / size[0], size[::-1])
    np.testing.assert_allclose(image.channels["rgba"][..., 0], wide, atol=0.5 * image.metadata["resolution"] / size[0] + 1e-6)
