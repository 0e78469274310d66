"""Reports a chart as text: the cheapest setting for each error, stop reasons, times at equal error, and a table of all points.

Named settings were measured. Times at equal error are interpolated between points of a curve and never extrapolated.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ...lang.schema.picture_settings import BACKENDS
from .. import cost_model, formatting
from ..metric_table import METRICS

if TYPE_CHECKING:
    from ..records import Answer, Chart, Curve, Point

HEADINGS = ("error", "take", "time", "measured", "settings to copy")
TARGET_DIGITS = (1.0, 3.0)  # digits of the target errors in every decade
COMPARED_DIGITS = (1.0, 2.0, 3.0, 5.0, 7.0)  # digits of the errors at which times are compared
MAX_TARGETS = 6  # target errors
COMMANDS = ("error", "time", "command")  # headings of `commands`
MAX_ERROR = 1.0  # larger errors are not targets


def targets(chart: Chart) -> list[float]:
    """Round target errors, large first: those within the errors of our backends, and the next below; 0 if a point is exact."""
    errors = [p.error.median for p in _our_points(chart)]
    above = [v for v in errors if v > 0]
    if not above:
        return [0.0] if errors else []
    least, most = min(above), max(above)
    rounded = _round_values(least, most, TARGET_DIGITS)
    top = MAX_ERROR if METRICS[chart.metric].share else math.inf
    inside = [t for t in rounded if least <= t <= most and t < top] or [t for t in rounded if t >= least][-1:]
    below = [t for t in rounded if t < least][:1] if min(errors) > 0 else [0.0]
    return [*inside, *below][-MAX_TARGETS:]


def _round_values(least: float, most: float, steps: tuple[float, ...]) -> list[float]:
    """Numbers with these first digits from below `least` to above `most`, large ones first."""
    decades = range(math.floor(math.log10(least)) - 1, math.ceil(math.log10(most)) + 2)
    return sorted((step * 10.0**d for d in decades for step in steps), reverse=True)


def _our_points(chart: Chart) -> list[Point]:
    """The points of our backends, which `maquette render` can repeat."""
    return [p for p in chart.points if p.setting.backend in BACKENDS]


def cheapest(chart: Chart, target: float) -> Point | None:
    """Our fastest measured point with an error of at most `target`."""
    reaching = [p for p in _our_points(chart) if p.error.median <= target]
    return min(reaching, key=lambda p: p.seconds.median, default=None)


def answers_of(chart: Chart) -> tuple[Answer, ...]:
    """The answers of a chart; of an older one by the model of its points."""
    return chart.answers or cost_model.answers(cost_model.ways_of(chart.curves, {}), chart.target)


def first_line(answers: Sequence[Answer]) -> str:
    """Which way has each error in the least time: "2 %: ray with paths, 512 samples and denoising, about 3.0 min (2.1 min to 4.4 min)"."""
    same = len(answers) > 1 and all(one.setting is None and one.why == answers[0].why for one in answers)
    return "; ".join(f"{formatting.target('relmse', one.target)}: {_way(one)}" for one in (answers[:1] if same else answers))


def _way(answer: Answer) -> str:
    if answer.setting is None:
        return answer.why
    time, least, most = map(formatting.seconds, (answer.seconds, answer.least, answer.most))
    return f"{answer.how}, about {time}" + (f" ({least} to {most})" if least != most else "")


def commands(answers: Sequence[Answer], scene: str, size: tuple[int, int]) -> list[tuple[str, ...]]:
    """A row for each answer: error, time, the command of its picture; see COMMANDS."""
    return [
        (formatting.target("relmse", one.target), formatting.seconds(one.seconds), formatting.command_of(scene, size, one.setting))
        for one in answers if one.setting is not None
    ]  # fmt: skip


def advice(chart: Chart) -> list[tuple[str, ...]]:
    """A row for each target error with the setting to use. See HEADINGS."""
    rows = []
    for target in targets(chart):
        wanted, point = formatting.target(chart.metric, target), cheapest(chart, target)
        if point is None:
            best = min(_our_points(chart), key=lambda p: p.error.median)
            rows.append((wanted, "not reached", "", formatting.error(chart.metric, best.error.median), ""))
            continue
        time, far = formatting.seconds(point.seconds.median), formatting.error(chart.metric, point.error.median)
        rows.append((wanted, f"{point.setting.backend}, {formatting.setting(point.setting)}", time, far, point.setting.arguments()))
    return rows


def answers(chart: Chart) -> list[str]:
    """All lines of the report: the way to each error with its command, settings that were measured, and `remarks`."""
    found = answers_of(chart)
    rows = iter(commands(found, chart.scene, chart.size))
    lines = [f"{first_line([one])}" + (f": {next(rows)[2]}" if one.setting is not None else "") for one in found]
    lines += [
        f"{wanted} → {take}, {time}: {settings}" if settings else f"{wanted} → not reached; the least measured is {far}"
        for wanted, take, time, far, settings in advice(chart)
    ]
    return [*lines, *remarks(chart)]


def remarks(chart: Chart) -> list[str]:
    """The lines of `answers` without the settings."""
    return [*_basis(chart), *_knee(chart), *_stops(chart), *_times_at_equal_error(chart), *_floor(chart), *formatting.left_out(chart)]


def _basis(chart: Chart) -> Iterator[str]:
    if chart.basis:
        yield f"times and samples by the model of docs/charts.md, {chart.basis}"


def _knee(chart: Chart) -> Iterator[str]:
    if chart.knee is not None:
        point = chart.points[chart.knee]
        far = formatting.error(chart.metric, point.error.median)
        named = f"{point.setting.backend}, {formatting.setting(point.setting)}"
        settings = f": {point.setting.arguments()}" if point.setting.backend in BACKENDS else ""
        yield f"knee: {named}: {far} in {formatting.seconds(point.seconds.median)}{settings}"


def _stops(chart: Chart) -> Iterator[str]:
    for name, curves in formatting.stopped_curves(chart):
        least = min(p.error.median for curve in curves for p in curve.points)
        yield f"{name} at {formatting.error(chart.metric, least)}: {curves[0].stops}"


def _times_at_equal_error(chart: Chart) -> Iterator[str]:
    """Times of the backends' fastest sweeps at the smallest round error that most backends reach, fastest first."""
    best: tuple[float, dict[str, float]] | None = None
    errors = [p.error.median for p in chart.points if p.error.median > 0]
    for target in _round_values(min(errors), max(errors), COMPARED_DIGITS) if errors else ():
        times: dict[str, float] = {}
        for curve in chart.curves:
            if (time := seconds_at(curve, target)) is not None:
                times[curve.backend] = min(time, times.get(curve.backend, math.inf))
        if len(times) > 1 and (best is None or len(times) >= len(best[1])):
            best = target, times
    if best:
        (quickest, first), *rest = sorted(best[1].items(), key=lambda pair: pair[1])
        others = ", ".join(f"{name} {formatting.seconds(t)} ({formatting.digits(t / first)} times as long)" for name, t in rest)
        yield f"at {formatting.target(chart.metric, best[0])}, between measured points: {quickest} {formatting.seconds(first)}, {others}"


def seconds_at(curve: Curve, target: float) -> float | None:
    """The time of a curve at error `target`, interpolated on logarithmic axes between the first two enclosing points; else None."""
    for before, after in itertools.pairwise(curve.points):
        high, low = before.error.median, after.error.median
        if high >= target >= low > 0:
            share = math.log(high / target) / math.log(high / low) if high > low else 0.0
            return before.seconds.median * (after.seconds.median / before.seconds.median) ** share
    return None


def _floor(chart: Chart) -> Iterator[str]:
    points = chart.points
    least = min((p.error.median for p in points), default=0.0)
    if chart.floor > 0 and least < 2 * chart.floor:
        yield f"the reference's own uncertainty is {formatting.error(chart.metric, chart.floor)}: smaller differences are not significant"


def points(chart: Chart) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """(headings, a row for each point in the order of `front`'s indices)."""
    headings = ("backend", "setting", "time", "error", "bias", "noise", "settings to copy")
    rows = []
    for point in chart.points:
        figures = dict(formatting.bias_and_noise(point))
        rows.append(
            (
                point.setting.backend,
                formatting.setting(point.setting),
                formatting.spread(point.seconds, formatting.seconds),
                formatting.spread(point.error, formatting.formatter(chart.metric)),
                figures.get("bias", ""),
                figures.get("noise", ""),
                point.setting.arguments(),
            )
        )
    return headings, rows
