"""The first estimate of a chart: its answer, and a chart that ends at once where the budget is too small."""

from __future__ import annotations

import math
import re
import threading
import time
from dataclasses import replace
from typing import Any

import pytest
from maquette.compiler import ir
from maquette.compiler.plan.plan import Plan
from maquette.measure import cost_model
from maquette.measure.chart import contestant, engine, estimate, reference, reference_light, runs
from maquette.measure.cost_model import Seconds
from maquette.measure.records import NothingMeasured, Setting, Wanted
from maquette.measure.report import text_report
from maquette.render import render_scene
from maquette.render.film import bounce_error
from maquette.render.image.image import Image

ROOM = estimate.Estimate("ray with paths", 480 * 320, error=0.5, wrong=1.2, start=2.0, each=2e-6, cpu=1.5, kernels=Seconds(0.5, 0.4))
SETTINGS = {
    "samples": Setting("ray", "samples", 1, {"samples": 1}),
    "denoised samples": Setting("ray", "denoised samples", 4, {"denoise": True, "samples": 4}),
}


def test_noise_falls_with_the_root_of_the_samples_and_time_grows_with_them() -> None:
    (way,) = ROOM.ways(SETTINGS, Seconds(3.0, 4.0), estimate.Limit())
    count, low, high = way.samples(0.02) or (0, 0, 0)
    assert count == pytest.approx(625)
    assert low < 625 / 1.56 < 625 * 1.56 < high
    assert way.seconds(625) == pytest.approx((3.0 + 2.0 + 2e-6 * 480 * 320 * 625, 4.0 + 1.5 * (2.0 + 2e-6 * 480 * 320 * 625)))


def test_denoised_small_pictures_are_a_way_too() -> None:
    """Two seconds of denoising a picture of this size; the bounds are wide, as small pictures have more detail in a pixel."""
    both = replace(ROOM, denoised=((4, 0.1), (16, 0.06)), denoising=Seconds(2.0 / ROOM.pixels, 4.0 / ROOM.pixels))
    ways = both.ways(SETTINGS, Seconds(), estimate.Limit())
    assert [way.kind for way in ways] == ["samples", "denoised samples"]
    drawing = ROOM.seconds(16)
    assert ways[1].seconds(16) == pytest.approx((drawing + 2.0, 1.5 * drawing + 4.0))
    assert ways[1].doubt == 3.0
    assert len(both.ways({"samples": SETTINGS["samples"]}, Seconds(), estimate.Limit())) == 1


def test_light_beyond_the_limit_on_bounces_is_a_bias_that_samples_do_not_remove() -> None:
    cut = bounce_error.Cut(0.03, 0.001, 0.02, 16)
    limit = estimate.limit_of(cut, 4)
    assert limit == (0.03, "4 bounces leave out about 3 % of the light, at any number of samples: give more, such as --bounces 16")
    assert estimate.limit_of(replace(cut, enough=0), 1).reason == (
        "1 bounce leaves out about 3 % of the light, at any number of samples: give more, such as --bounces 4"
    )
    assert estimate.limit_of(replace(cut, error=0.02), 4) == estimate.limit_of(None, 4) == estimate.Limit()
    (way,) = ROOM.ways({"samples": SETTINGS["samples"]}, Seconds(), limit)
    assert way.samples(0.03) is None
    assert (way.samples(0.05) or [0])[0] == pytest.approx((0.5 / 0.04) ** 2)


def test_a_budget_that_is_too_small_is_told_at_once(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    def refuse(*given: Any) -> None:
        raise AssertionError("something is measured")

    monkeypatch.setattr(estimate, "make", lambda *given: ROOM)
    monkeypatch.setattr(reference, "known_samples", lambda *given: 0)
    monkeypatch.setattr(reference, "make", refuse)
    monkeypatch.setattr(contestant, "backend_contestant", refuse)
    with pytest.raises(NothingMeasured) as raised:
        engine.measure(scene, Wanted("a.scene", ir.Settings(size=(480, 320)), budget=6.0))
    assert text_report.first_line(raised.value.answers[:1]) == (
        "2 %: ray with paths, 1,024 samples, about 5.3 min (90 s to 7.3 min)"
    )
    assert raised.value.size == (480, 320)
    assert re.fullmatch(
        r"this is estimated from small pictures, without denoising\. Runs of the whole picture take about 2\d s, and a chart against a "
        r"reference about 4\.\d min, of the 6 s there are: give a longer --budget or a smaller --size",
        str(raised.value),
    )


def test_a_reference_on_disk_makes_a_chart_cheaper(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    monkeypatch.setattr(estimate, "make", lambda *given: ROOM)
    monkeypatch.setattr(reference, "known_samples", lambda *given: 1 << 20)
    with pytest.raises(NothingMeasured, match=r"and a chart against a reference about (9\d s|1\.\d min), of the 5 s there are"):
        engine.measure(scene, Wanted("a.scene", ir.Settings(size=(480, 320)), budget=5.0))


class Model:
    """A renderer with a known error and time of each picture."""

    def __init__(self, error: float = 0.8, start: float = 0.5, build: float = 0.25, each: float = 1e-3, stray: float = 0.0) -> None:
        self.error, self.start, self.build, self.each, self.stray = error, start, build, each, stray
        self.drawn: list[tuple[tuple[int, int], int]] = []

    def draw(self, scene: ir.Scene, plan: Plan, *given: Any, **more: Any) -> Image:
        (width, height), samples = plan["size"], plan["samples"]
        self.drawn.append(((width, height), samples))
        rays = width * height * samples
        about = {
            "seconds": {"build": self.build, "render": self.start + self.each * rays}, "rays": rays, "error": self.error / samples**0.5,
            "error_in_few": self.stray, "partial": False, "threads": 2, "pace": 2.0 * self.each,
        }  # fmt: skip
        return Image(width, height, {}, about)


def made(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, model: Model, seconds: float) -> estimate.Estimate:
    monkeypatch.setattr(render_scene, "draw", model.draw)
    light = reference_light.choose(scene, ir.Settings(size=(480, 320)))
    return estimate.make(scene, light, threading.Event(), seconds)


def test_noise_and_time_of_a_known_renderer_are_found(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    model = Model()
    found = made(monkeypatch, scene, model, 1e9)
    assert model.drawn == [((24, 16), 4), ((24, 16), 16), ((120, 80), 4), ((120, 80), 16)]
    assert (found.error, found.wrong, found.each, found.start) == pytest.approx((0.8, 1.0, 1e-3, 0.75))
    assert found.seconds(100) == pytest.approx(0.75 + 1e-3 * 480 * 320 * 100)


def test_pictures_that_do_not_fit_into_the_time_are_left_out_and_widen_the_bounds(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    model = Model(start=0.02, each=1e-2)
    found = made(monkeypatch, scene, model, 300.0)  # the third takes 384 s: the pace of the first two tells
    assert model.drawn == [((24, 16), 4), ((24, 16), 16)]
    assert (found.error, found.wrong, found.each) == pytest.approx((0.8, 4.0, 1e-2))
    two = made(monkeypatch, scene, Model(each=1e-3), 100.0)  # the last takes 154 s
    assert (two.wrong, two.each, two.start) == pytest.approx((2.0, 1e-3, 0.75))


def test_the_time_of_the_first_picture_is_that_of_loading(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    found = made(monkeypatch, scene, Model(start=30.0, build=40.0), 0.5)  # the second would take 6 s by its pace
    assert (found.error, found.wrong, found.each, found.start) == pytest.approx((0.8, 4.0, 1e-3, 0.0))


def test_pictures_without_noise_have_no_error(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    estimated = made(monkeypatch, scene, Model(error=0.0), 1e9)
    assert estimated.error < 1e-5
    (way,) = estimated.ways({"samples": SETTINGS["samples"]}, Seconds(), estimate.Limit())
    assert way.samples(0.01) == (4.0, 4.0, 4.0)


def test_stray_bright_samples_widen_the_bounds(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    assert made(monkeypatch, scene, Model(stray=0.5), 1e9).wrong == pytest.approx(2.0)
    assert made(monkeypatch, scene, Model(stray=1.0), 1e9).wrong == pytest.approx(4.0)


def test_an_estimate_without_time_is_unknown(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    monkeypatch.setattr(estimate, "LOADING", 0.0)
    light = reference_light.choose(scene, ir.Settings(size=(480, 320)))
    found = estimate.make(scene, light, threading.Event(), 0.0)
    assert found.error == math.inf
    assert text_report.first_line(cost_model.answers(found.ways(SETTINGS, Seconds(), estimate.Limit()), 0.02)) == (
        "2 %: unknown: nothing was drawn in the budget"
    )


@pytest.mark.long
def test_a_run_at_the_end_of_the_budget_is_interrupted_and_the_question_answered(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    def run(scene: ir.Scene, plan: Plan, cancel: threading.Event) -> Any:
        while not cancel.is_set():
            time.sleep(0.01)
        raise runs.Cancelled

    quick = replace(ROOM, start=0.0, each=1e-9)
    monkeypatch.setattr(estimate, "make", lambda *given: quick)
    monkeypatch.setattr(runs, "run", run)
    monkeypatch.setattr(runs, "import_seconds", lambda: 0.0)
    began = time.monotonic()
    with pytest.raises(NothingMeasured) as raised:
        engine.measure(scene, Wanted("a.scene", ir.Settings(size=(48, 32)), budget=1.0))
    assert time.monotonic() - began < 2.0
    assert str(raised.value) == "nothing was measured within 1 s: give a longer --budget, such as 60s, or a smaller --size"
    assert raised.value.answers[0].how == "ray with paths, 1,024 samples"


@pytest.fixture
def scene(tmp_path: Any) -> ir.Scene:
    from maquette import load

    path = tmp_path / "a.scene"
    path.write_text("sphere(1, material: lambert(0.5))\nsun()\ncamera(position: [0, 1, 5], look_at: [0, 0, 0])\n", encoding="utf-8")
    return load(path)
