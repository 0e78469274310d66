"""Short runs in place of a reference: what is drawn within a budget, and the chart of a renderer whose errors and times are known."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan.plan import Plan
from maquette.measure import cost_model
from maquette.measure.chart import engine, estimate, reference, reference_light, short_runs
from maquette.measure.cost_model import Seconds
from maquette.measure.records import NothingMeasured, Wanted
from maquette.measure.report import html_page, json_format, plot, text_report
from maquette.render import quality_settings, render_scene
from maquette.render.film import bounce_error
from maquette.render.film.deadline import Deadline
from maquette.render.film.progress import Progress
from maquette.render.image.image import Image
from maquette.render.jit import cancellation

NOW = time.perf_counter
SCENE = """\
box([4, 3, 4], center: [0, 1.5, 0], material: lambert(0.7))
sphere(0.5, center: [0, 0.5, 0], material: lambert(#c04030))
area([0, 2.8, 0], look_at: [0, 0, 0], size: [1, 1], luminance: 20)
camera(position: [0, 1.6, 1.9], look_at: [0, 1, 0], fov: 60deg)
render(bounces: 6)
"""


@pytest.fixture
def scene(tmp_path: Path) -> ir.Scene:
    path = tmp_path / "a.scene"
    path.write_text(SCENE, encoding="utf-8")
    return maquette.load(path)


class Clock:
    """The time of a renderer that takes none."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Model:
    """A renderer of 1 s a sample of each pixel, 3 s of denoising, an error of 80 % at a sample, half of it after denoising."""

    def __init__(self, clock: Clock, cut: bounce_error.Cut | None = None, few: float = 0.0) -> None:
        self.clock, self.cut, self.few = clock, cut, few
        self.drawn: list[Any] = []

    def draw(self, scene: ir.Scene, plan: Plan, report: Any, cancel: threading.Event, **more: Any) -> Image:
        width, height = plan["size"]
        asked, denoise = plan["error"], plan["denoise"] == "on"
        samples = (0.6 / asked) ** 2 if asked else plan["samples"]
        self.drawn.append(f"error {asked:g}" if asked else f"{samples}{' denoised' if denoise else ''}")
        report(Progress("rendering"))
        self.clock.now += 2.0 + samples
        if denoise:
            report(Progress("denoising"))
            self.clock.now += 3.0
        report(Progress("finishing"))
        if cancel.is_set():
            raise cancellation.Cancelled
        error = asked or 0.8 * samples**-0.5
        about = {
            "seconds": {"build": 0.5, "render": samples}, "samples_mean": samples, "error": error, "partial": False, "cut": self.cut,
            "denoised_error": 0.4 * samples**-0.4 if denoise else None, "error_in_few": self.few, "left_out": ("caustics are left out",),
        }  # fmt: skip
        return Image(width, height, {}, about)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(time, "perf_counter", made)
    monkeypatch.setattr(time, "process_time", lambda: 2.0 * made.now)
    monkeypatch.setattr(quality_settings, "can_denoise", lambda: True)
    return made


GUESS = estimate.Estimate("ray with paths", 48 * 36, error=0.8, wrong=1.2, start=2.0, each=1.0 / (48 * 36))


def drawn(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, model: Model, seconds: float) -> short_runs.ShortRuns:
    monkeypatch.setattr(render_scene, "draw", model.draw)
    light = reference_light.choose(scene, ir.Settings(size=(48, 36), bounces=6))
    found = short_runs.ShortRuns(scene, light, GUESS, threading.Event())
    found.draw(cost_model.targets(0.02), Deadline(seconds, None, model.clock), lambda: None)
    return found


def test_the_law_of_a_known_renderer_is_found(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, clock: Clock) -> None:
    model = Model(clock)
    found = drawn(monkeypatch, scene, model, 400.0)
    assert model.drawn == ["4 denoised", "16 denoised", "64 denoised", "128 denoised", "error 0.13", "error 0.074"]
    ways = {way.kind: way for way in found.ways(Seconds(5.0, 7.0))}
    assert ways["samples"].seconds(100) == pytest.approx((5.0 + 102.0, 7.0 + 204.0))
    assert ways["denoised samples"].seconds(100) == pytest.approx((5.0 + 105.0, 7.0 + 210.0))
    assert (ways["samples"].samples(0.02) or [0])[0] == pytest.approx(1600)
    assert (ways["error"].samples(0.05) or [0])[0] == pytest.approx(144, rel=0.05)
    assert ways["denoised samples"].power()[0] == pytest.approx(0.425)
    assert found.basis == (
        "fitted to runs of 4, 16, 64, 128 samples a pixel and of an error of 13 % and 7.4 %; caustics are left out"
    )


def test_what_does_not_fit_is_not_begun(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, clock: Clock) -> None:
    model = Model(clock)
    found = drawn(monkeypatch, scene, model, 11.0)  # the first run takes 6 s as expected: more than half
    assert (model.drawn, found.fixed, found.ways(Seconds())) == ([], [], [])
    assert found.needed() == 6.0 + 18.0


def test_a_second_run_takes_most_of_the_time_as_one_tells_no_power(
    monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, clock: Clock
) -> None:  # fmt: skip
    """The first run takes 9 s. By it alone 8 samples take 18 s: more than half of the 25 s that are left, and less than 80 %."""
    assert [run.samples for run in drawn(monkeypatch, scene, Model(clock), 34.0).fixed] == [4, 8]
    assert [run.samples for run in drawn(monkeypatch, scene, Model(clock), 24.0).fixed] == [4]


def test_runs_end_where_the_least_error_is_reached(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, clock: Clock) -> None:
    model = Model(clock)
    found = drawn(monkeypatch, scene, model, 1e6)
    assert model.drawn == ["4 denoised", "16 denoised", "64 denoised", "256 denoised", "1024 denoised", "4096 denoised", "error 0.01"]
    assert [run.setting.value for run in found.adaptive] == [0.01]


def test_stray_samples_and_missing_light_are_known(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, clock: Clock) -> None:
    found = drawn(monkeypatch, scene, Model(clock, bounce_error.Cut(0.03, 0.001, 0.02, 24), 0.5), 100.0)
    assert found.doubt == 2.0
    first, larger, *_ = cost_model.answers(found.ways(Seconds()), 0.02)
    assert first.why == "6 bounces leave out about 3 % of the light, at any number of samples: give more, such as --bounces 24"
    assert larger.setting is not None  # 5 % holds 4 % of noise and 3 % of bias


def test_a_chart_without_a_reference(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, clock: Clock) -> None:
    model = Model(clock)
    monkeypatch.setattr(render_scene, "draw", model.draw)
    monkeypatch.setattr(estimate, "make", lambda *given: GUESS)
    monkeypatch.setattr(reference, "known_samples", lambda *given: 0)
    wanted = Wanted(
        "a.scene", ir.Settings(size=(48, 36), threads=1, bounces=6), budget=200.0, metric="flip", seeds=3, backends_named=False,
        loading=(4.0, 5.0), began=NOW(),
    )  # fmt: skip
    chart = engine.measure(scene, wanted)
    assert (chart.metric, chart.floor, chart.reference) == ("relmse", 0.0, short_runs.REFERENCE)
    assert [(curve.backend, curve.knob, len(curve.points)) for curve in chart.curves] == [
        ("ray", "samples", 3), ("ray", "error", 2), ("ray", "denoised samples", 3),
    ]  # fmt: skip
    assert set(chart.left_out) == {"a reference picture", "raster", "reference", "flip", "--seeds"}
    assert chart.left_out["--seeds"] == "it is for charts with a reference"
    assert text_report.first_line(chart.answers).startswith("2 %: ray with paths, ")
    assert json_format.read(json_format.dump(chart)) == chart
    drawing = plot.svg(chart)
    assert "2&#xA0;%: ray with paths" in drawing.replace("\N{NO-BREAK SPACE}", "&#xA0;")
    assert "maquette render a.scene --size 48x36 --backend ray " in html_page.html(chart, drawing)


def test_a_budget_without_time_for_whole_pictures(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene, clock: Clock) -> None:
    monkeypatch.setattr(estimate, "make", lambda *given: GUESS)
    monkeypatch.setattr(reference, "known_samples", lambda *given: 0)
    wanted = Wanted("a.scene", ir.Settings(size=(48, 36), threads=1, bounces=6), budget=10.0, began=NOW())
    with pytest.raises(NothingMeasured, match="Runs of the whole picture take about 50 s, and a chart against a reference about 13 min"):
        engine.measure(scene, wanted)
