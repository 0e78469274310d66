"""The model of error and time: its laws, its bounds, and the choice of the fastest command."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from maquette.measure import cost_model
from maquette.measure.cost_model import Run, Seconds, Way
from maquette.measure.records import Answer, Setting

from . import charts

START = Seconds(2.0, 3.0)


def setting(knob: str, **fixed: object) -> Setting:
    option = "error" if knob == "error" else "samples"
    return Setting("ray", knob, 4, {option: 4, **fixed})


def by_samples(error: float = 0.8, *counts: int, bias: float = 0.0, power: float = 0.5, **more: object) -> Way:
    """Noise `error` at one sample, 0.5 s before samples and 0.1 s each, twice that of CPU."""
    runs = tuple(
        Run(n, math.hypot(error * n**-power, bias), 0.5 + 0.1 * n, 1.0 + 0.2 * n) for n in counts or (4, 16)
    )
    return Way(setting("samples"), "ray", runs, START, bias, **more)  # type: ignore[arg-type]


def answered(way: Way, target: float) -> Answer:
    found = way.answer(target)
    assert found is not None
    return found


def test_noise_falls_with_the_root_of_the_samples_and_time_grows_with_them() -> None:
    count, low, high = by_samples().samples(0.02) or (0, 0, 0)
    assert count == pytest.approx(1600)
    assert low < count / 1.15 < count * 1.15 < high
    found = answered(by_samples(), 0.02)
    assert found.samples == 2048  # the next power of two
    assert (found.seconds, found.cpu) == pytest.approx((2.0 + 0.5 + 204.8, 3.0 + 1.0 + 409.6))
    assert found.least < found.seconds < found.most
    assert found.how == "ray, 2,048 samples"
    assert found.setting == Setting("ray", "samples", 2048, {"samples": 2048})


def test_a_bias_is_subtracted_and_never_reached() -> None:
    way = by_samples(0.8, 4, 16, 64, bias=0.03, bias_reason="4 bounces leave out 3 %: give more")
    count, *_ = way.samples(0.05) or (0, 0, 0)
    assert count == pytest.approx((0.8 / 0.04) ** 2)
    assert way.samples(0.03) is None
    assert cost_model.answers([way], 0.02)[0] == Answer(0.02, why="4 bounces leave out 3 %: give more")
    assert cost_model.answers([replace(way, bias_reason="")], 0.02)[0].why == (
        "no command reaches it: a bias of 3 % stays at any number of samples"
    )


def test_a_faster_decline_that_runs_tell_counts_in_part() -> None:
    """Sobol points at edges: noise falls as n^-0.6; 0.7 of the excess over n^-0.5 is believed for more samples."""
    power, unsure = by_samples(0.8, 4, 16, 64, power=0.6).power()
    assert (power, unsure) == pytest.approx((0.57, 0.05))


def test_between_runs_the_samples_are_interpolated_and_the_first_ones_suffice() -> None:
    way = by_samples(0.8, 4, 16, 64)
    assert (way.samples(0.15) or [0])[0] == pytest.approx((0.8 / 0.15) ** 2)
    assert answered(way, 0.15).samples == 32
    assert answered(way, 0.8 / 33**0.5).samples == 32  # a little more than a power of two
    plain = answered(way, 0.9)
    assert (plain.samples, plain.how) == (4, "ray, 4 samples")
    exact = Way(setting("samples"), "ray", (Run(1, 0.0, 0.1, 0.1),), START)
    assert (answered(exact, 0.01).samples, answered(exact, 0.01).how) == (1, "ray, 1 sample")


def test_denoised_pictures_follow_the_decline_of_their_own_runs() -> None:
    runs = tuple(Run(n, 0.3 * n**-0.3, 1.0 + 0.1 * n, 2.0) for n in (4, 16, 64))
    way = Way(setting("denoised samples", denoise=True), "ray with paths", runs, START)
    assert way.power() == pytest.approx((0.375, 0.075))
    found = answered(way, 0.06)
    assert (way.samples(0.06) or [0])[0] == pytest.approx(64 * (0.3 * 64**-0.3 / 0.06) ** (1 / 0.375))
    assert found.how == f"ray with paths, {found.samples:.0f} samples and denoising"
    assert found.setting is not None
    assert found.setting.arguments() == f"--backend ray --samples {found.samples:.0f} --denoise"


def test_an_error_that_is_asked_for_takes_its_first_samples_at_least() -> None:
    way = Way(setting("error"), "ray", (Run(16, 0.004, 1.0, 1.0),), START)
    found = answered(way, 0.02)
    assert (found.samples, found.how) == (16, "ray, about 16 samples as needed")
    biased = Way(setting("error"), "ray", (Run(20, math.hypot(0.04, 0.012), 1.0, 1.0),), START, 0.012)
    asked = answered(biased, 0.02).setting
    assert asked is not None
    assert asked.value == 0.016  # 1.6 % of noise and 1.2 % of bias are 2 %


def test_too_many_samples_are_no_answer() -> None:
    assert cost_model.answers([by_samples(40.0)], 0.02)[-1].why == (
        "no command reaches it with 1,048,576 samples a pixel, the most there are"
    )
    assert cost_model.answers([Way(setting("samples"), "ray", ())], 0.02)[0].why == "unknown: nothing was drawn in the budget"


def test_the_fastest_way_is_chosen_for_each_error() -> None:
    denoised = tuple(Run(n, 0.1 * n**-0.2, 3.0 + 0.5 * n, 3.0) for n in (4, 16, 64))
    ways = [by_samples(0.8, 4, 16, 64), Way(setting("denoised samples", denoise=True), "ray", denoised, START)]
    found = cost_model.answers(ways, 0.02)
    assert [one.target for one in found] == [0.02, 0.05, 0.1, 0.01]
    assert ["denoising" in one.how for one in found] == [False, True, True, False]


@pytest.mark.parametrize(
    ("asked", "order"),
    [
        (0.02, (0.02, 0.05, 0.1, 0.01)), (0.03, (0.03, 0.05, 0.1, 0.02, 0.01)), (0.1, (0.1, 0.05, 0.02, 0.01)),
        (0.5, (0.5, 0.1, 0.05, 0.02, 0.01)),
    ],
)  # fmt: skip
def test_the_error_asked_for_comes_first(asked: float, order: tuple[float, ...]) -> None:
    assert cost_model.targets(asked) == order


def test_measured_curves_are_ways() -> None:
    """Raster stops at 3.1 %, which its points show as a bias; one sample at the centre of a pixel tells nothing of more."""
    ways = cost_model.ways_of(charts.room().curves, {"ray": "ray with paths"}, START)
    assert [(way.setting.backend, way.kind, way.how) for way in ways] == [
        ("ray", "samples", "ray with paths"), ("raster", "samples", "raster"), ("reference", "samples", "reference"),
    ]  # fmt: skip
    assert [len(way.runs) for way in ways] == [6, 3, 2]
    assert [way.bias for way in ways] == [0.0, 0.031, 0.0]
    assert cost_model.ways_of(charts.room().curves, {}, bias=0.04)[1].bias == pytest.approx(math.hypot(0.031, 0.04))
