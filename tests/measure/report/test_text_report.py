"""The text report of a chart, as whole texts."""

from __future__ import annotations

import dataclasses

import pytest
from maquette.measure import formatting
from maquette.measure.records import Answer, Chart, Curve, Setting, Spread
from maquette.measure.report import text_report

from .. import charts


def test_the_answers_of_a_chart() -> None:
    assert text_report.answers(charts.room()) == [
        "2 %: ray, 256 samples, about 2.6 s (2.1 s to 2.8 s): maquette render room.scene --size 400x300 --backend ray --samples 256",
        "5 %: raster, 16 samples, about 120 ms (81 ms to 120 ms): maquette render room.scene --size 400x300 --backend raster --samples 16",
        "10 %: raster, 4 samples, about 60 ms: maquette render room.scene --size 400x300 --backend raster --samples 4",
        "1 %: ray, 1,024 samples, about 10 s (8.4 s to 11 s): maquette render room.scene --size 400x300 --backend ray --samples 1024",
        "30 % → raster, 1 sample, 35 ms: --backend raster --samples 1",
        "10 % → raster, 4 samples, 50 ms: --backend raster --samples 4",
        "3 % → ray, 256 samples, 2.6 s: --backend ray --samples 256",
        "1 % → ray, 1024 samples, 10 s: --backend ray --samples 1024",
        "0.3 % → not reached; the least measured is 0.48 %",
        "knee: ray, 256 samples: 1.9 % in 2.6 s: --backend ray --samples 256",
        "raster stops at 3.4 %: no interreflection: bias 3.1 %",
        "at 10 %, between measured points: raster 40 ms, ray 98 ms (2.5 times as long), mitsuba 510 ms (13 times as long),"
        " reference 20 s (490 times as long)",
        "not charted: povray: not installed: apt install povray",
    ]


def test_the_first_line_names_the_fastest_way_to_each_error() -> None:
    """Raster is faster and stops at 3.1 %."""
    assert first_line(charts.room()) == (
        "2 %: ray, 256 samples, about 2.6 s (2.1 s to 2.8 s); 5 %: raster, 16 samples, about 120 ms (81 ms to 120 ms); "
        "10 %: raster, 4 samples, about 60 ms; 1 %: ray, 1,024 samples, about 10 s (8.4 s to 11 s)"
    )


def first_line(chart: Chart) -> str:
    return text_report.first_line(text_report.answers_of(chart))


def test_the_first_line_follows_the_noise_where_nothing_reaches_the_error() -> None:
    """Noise of 31 % / 2^4 with 256 samples in 2.59 s: 1 % takes (1.94)² times as many."""
    chart = dataclasses.replace(charts.chart(Curve("ray", "samples", charts.sweep("ray", 0.03, 0.01, 0.31, 5))), target=0.01)
    assert first_line(chart).startswith("1 %: ray, 1,024 samples, about 10 s (7.8 s to 12 s); 2 %: ray, 256 samples, ")


def test_the_first_line_believes_no_bias() -> None:
    biased = Curve("raster", "samples", charts.sweep("raster", 0.03, 0.005, 0.12, 4, bias=0.031), "no interreflection: bias 3.1 %")
    assert first_line(charts.chart(biased)) == (
        "2 %: no command reaches it: raster: no interreflection: bias 3.1 %; 5 %: raster, 16 samples, about 120 ms (81 ms to 120 ms); "
        "10 %: raster, 4 samples, about 60 ms; 1 %: no command reaches it: raster: no interreflection: bias 3.1 %"
    )


def test_the_answers_of_a_chart_are_kept_and_their_basis_told() -> None:
    setting = Setting("ray", "denoised samples", 8, {"samples": 8})
    known = Answer(0.02, "ray with paths, 8 samples and denoising", setting, 8, 60.0, 50.0, 90.0)
    answers = (known, Answer(0.01, why="more than there are"))
    chart = dataclasses.replace(charts.room(), answers=answers, basis="fitted to runs of 4 samples")
    assert first_line(chart) == "2 %: ray with paths, 8 samples and denoising, about 60 s (50 s to 90 s); 1 %: more than there are"
    assert text_report.commands(chart.answers, chart.scene, chart.size) == [
        ("2 %", "60 s", "maquette render room.scene --size 400x300 --backend ray --samples 8")
    ]
    assert text_report.remarks(chart)[0] == "times and samples by the model of docs/charts.md, fitted to runs of 4 samples"


def test_one_reason_for_all_errors_is_told_once() -> None:
    nothing = [Answer(error, why="unknown: nothing was drawn in the budget") for error in (0.02, 0.05)]
    assert text_report.first_line(nothing) == "2 %: unknown: nothing was drawn in the budget"


def test_only_what_was_measured_is_advised() -> None:
    """A target between two steps names the more expensive one, which was measured, and no setting between them."""
    points = (charts.point("ray", "samples", 16, 1.0, 0.02), charts.point("ray", "samples", 64, 4.0, 0.005))
    chart = charts.chart(Curve("ray", "samples", points))
    assert text_report.advice(chart) == [
        ("1 %", "ray, 64 samples", "4.0 s", "0.50 %", "--backend ray --samples 64"),
        ("0.3 %", "not reached", "", "0.50 %", ""),
    ]


def test_what_is_exact_is_said_at_none() -> None:
    exact = dataclasses.replace(charts.point("raster", "samples", 1, 0.1, 1.0), error=Spread(0, 0, 0, 5))
    assert text_report.advice(charts.chart(Curve("raster", "samples", (exact,)))) == [
        ("0 %", "raster, 1 sample", "100 ms", "0 %", "--backend raster --samples 1"),
    ]


def test_an_exact_point_reaches_everything() -> None:
    rough, exact = charts.sweep("raster", 0.1, 0.1, 0.2, 2)
    chart = charts.chart(Curve("raster", "samples", (rough, dataclasses.replace(exact, error=Spread(0, 0, 0, 5)))))
    assert [row[:4] for row in text_report.advice(chart)] == [
        ("30 %", "raster, 1 sample", "200 ms", "20 %"),
        ("0 %", "raster, 4 samples", "500 ms", "0 %"),
    ]


def test_nobody_asks_for_an_error_of_all_there_is() -> None:
    noisy = charts.chart(Curve("ray", "samples", charts.sweep("ray", 0.1, 0.1, 2.4, 3)))
    assert [row[0] for row in text_report.advice(noisy)] == ["100 %", "30 %"]  # nothing better was measured
    better = charts.chart(Curve("ray", "samples", charts.sweep("ray", 0.1, 0.1, 2.4, 5)))
    assert [row[0] for row in text_report.advice(better)] == ["30 %", "10 %"]


def test_an_error_near_the_references_own_is_said() -> None:
    chart = charts.chart(Curve("ray", "samples", charts.sweep("ray", 0.1, 0.1, 0.02, 2)), floor=0.008)
    assert text_report.remarks(chart) == ["the reference's own uncertainty is 0.80 %: smaller differences are not significant"]


def test_time_at_equal_error_is_straight_on_logarithmic_axes_and_ends_with_the_points() -> None:
    points = (charts.point("ray", "samples", 1, 1.0, 0.4), charts.point("ray", "samples", 16, 16.0, 0.1))
    curve = Curve("ray", "samples", points)
    assert text_report.seconds_at(curve, 0.2) == pytest.approx(4.0)
    assert text_report.seconds_at(curve, 0.4) == 1.0
    assert text_report.seconds_at(curve, 0.1) == pytest.approx(16.0)
    assert text_report.seconds_at(curve, 0.41) is None
    assert text_report.seconds_at(curve, 0.099) is None


def test_every_point_is_a_row() -> None:
    chart = charts.room()
    headings, rows = text_report.points(chart)
    assert headings == ("backend", "setting", "time", "error", "bias", "noise", "settings to copy")
    assert len(rows) == len(chart.points)
    assert rows[12] == (
        "raster", "4 samples", "50 ms (45 ms to 55 ms)", "6.8 % (6.4 % to 7.1 %)", "3.1 % ± 0.60 %", "6.0 % ± 0.30 %",
        "--backend raster --samples 4",
    )  # fmt: skip


def test_a_bias_that_is_not_told_from_none_has_a_bound() -> None:
    point = charts.point("ray", "samples", 4, 1.0, 0.1, bias=0.0, bias_error=0.002, noise=0.1, noise_error=0.001)
    assert formatting.bias_and_noise(point) == [("bias", "below 0.20 %"), ("noise", "10 % ± 0.10 %")]
    assert formatting.bias_and_noise(charts.point("ray", "samples", 4, 1.0, 0.1)) == []


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0000853, "85 µs"), (0.00949, "9.5 ms"), (0.0996, "100 ms"), (0.949, "950 ms"), (0.96, "0.96 s"), (2.13, "2.1 s"), (9.96, "10 s"),
        (94.4, "94 s"), (96, "1.6 min"), (5999, "1.7 h"), (0, "0 µs"),
    ],
)  # fmt: skip
def test_times(value: float, text: str) -> None:
    assert formatting.seconds(value) == text


@pytest.mark.parametrize(
    ("metric", "value", "text"),
    [
        ("relmse", 0.0103, "1.0 %"), ("relmse", 0.00099, "0.099 %"), ("relmse", 3.21, "320 %"), ("flip", 0.0345, "0.035"),
        ("max", 12.4, "12"), ("silhouette", 0.123, "0.12 px"), ("relmse", 0.0, "0 %"),
    ],
)  # fmt: skip
def test_errors(metric: str, value: float, text: str) -> None:
    assert formatting.error(metric, value) == text


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        (Setting("ray", "samples", 1, {}), "1 sample"), (Setting("ray", "samples", 64, {}), "64 samples"),
        (Setting("ray", "error", 0.005, {}), "error 0.5 %"), (Setting("ray", "bounces", 3, {}), "3 bounces"),
        (Setting("raster", "tolerance", 0.25, {}), "tolerance 0.25"), (Setting("raster", "tiles", True, {}), "tiles on"),
        (Setting("ray", "fill", "areas", {}), "fill areas"),
    ],
)  # fmt: skip
def test_settings(setting: Setting, text: str) -> None:
    assert formatting.setting(setting) == text


def test_arguments_are_what_the_command_line_reads() -> None:
    setting = Setting("raster", "tolerance", 0.5, {"samples": 4, "size": (80, 60), "error": 0.01}, {"raster.coverage": "areas"})
    assert setting.arguments() == "--backend raster --samples 4 --size 80x60 --error 1% --plan raster.coverage=areas"
    assert formatting.command(charts.room(), setting).startswith("maquette render room.scene --size 400x300 --backend raster --samples 4")


def test_a_quicker_peer_is_told_of_and_not_advised() -> None:
    ours = Curve("ray", "samples", charts.sweep("ray", 0, 0.1, 0.2, 3))
    peer = Curve("mitsuba", "samples", charts.sweep("mitsuba", 0, 0.05, 0.2, 3))
    assert text_report.answers(charts.chart(ours, peer, knee=4))[4:] == [
        "10 % → ray, 4 samples, 400 ms: --backend ray --samples 4",
        "3 % → not reached; the least measured is 5.0 %",
        "knee: mitsuba, 4 samples: 10 % in 200 ms",
        "at 5 %, between measured points: mitsuba 800 ms, ray 1.6 s (2.0 times as long)",
    ]


def test_who_stops_for_one_reason_stands_together() -> None:
    def curve(backend: str, knob: str, stops: str) -> Curve:
        return Curve(backend, knob, charts.sweep(backend, 0.1, 0.1, 0.2, 2, bias=0.1), stops)

    why = "no interreflection: bias 10 %"
    chart = charts.chart(
        curve("ray", "samples", why), curve("ray", "bounces", ""), curve("raster", "samples", why), curve("raster", "tolerance", why),
        curve("reference", "samples", "one sample a pixel is its centre: bias 12 %"),
    )  # fmt: skip
    assert [name for name, _ in formatting.stopped_curves(chart)] == ["ray by samples and raster stop", "reference stops"]
    assert [len(curves) for _, curves in formatting.stopped_curves(chart)] == [3, 1]


def test_sweeps_that_end_early_are_counted() -> None:
    cut = {
        "ray, samples: 4096 samples": "5 renders of about 9 s do not fit",
        "raster, samples: 4096 samples": "the same",
        "povray: glass": "x",
    }
    chart = charts.chart(Curve("ray", "samples", charts.sweep("ray", 0.1, 0.1, 0.2, 2)), left_out={"mitsuba": "not installed", **cut})
    assert formatting.left_out(chart) == [
        "not charted: mitsuba: not installed",
        "3 sweeps stop before the most expensive settings (the .json lists them): a longer --budget continues them",
    ]


def test_reasons_are_told_briefly_on_the_picture() -> None:
    why = "/a/room.scene:6:15: the highlight is not carried; /a/room.scene:7:1: nor is glass; std/room:20:3: nor a lamp"
    chart = charts.chart(
        Curve("ray", "samples", charts.sweep("ray", 0.1, 0.1, 0.2, 2)), left_out={"mitsuba": why, "povray": "not installed"}
    )
    assert formatting.left_out(chart) == [f"not charted: mitsuba: {why}", "not charted: povray: not installed"]
    brief = ["not charted: mitsuba: the highlight is not carried (and 2 more reasons)", "not charted: povray: not installed"]
    assert formatting.left_out(chart, brief=True) == brief


def test_a_title_has_no_folder() -> None:
    chart = dataclasses.replace(charts.room(), scene="'/a b/room.scene' --set 'hour=20 min'")
    assert formatting.title(chart) == "room.scene --set hour=20 min"
