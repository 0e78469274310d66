"""Formats the figures of a chart for the picture, the page and the terminal: times, errors, settings, curves."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Callable
from pathlib import PurePath
from typing import TYPE_CHECKING

from ..lang.schema.picture_settings import BACKENDS
from .metric_table import METRICS

if TYPE_CHECKING:
    from .records import Chart, Curve, Point, Setting, Spread


def digits(value: float, count: int = 2) -> str:
    """`value` to `count` significant digits without an exponent: 0.0123, 1.2, 120."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    rounded = float(f"{value:.{count - 1}e}")
    return f"{rounded:.{max(count - 1 - math.floor(math.log10(abs(rounded))), 0)}f}"


def plain(value: float, count: int = 2) -> str:
    """`digits` without trailing zeros: 1, 0.5."""
    text = digits(value, count)
    return text.rstrip("0").rstrip(".") if "." in text else text


def seconds(value: float) -> str:
    """A time: 850 µs, 12 ms, 2.1 s, 3.5 min."""
    for limit, unit, scale in ((0.00095, "µs", 1e6), (0.95, "ms", 1e3), (95, "s", 1.0), (5700, "min", 1 / 60)):
        if value < limit:
            return f"{digits(value * scale)} {unit}"
    return f"{digits(value / 3600)} h"


def seconds_exactly(value: float) -> str:
    """A round time on an axis: 1 ms, 0.5 s → 500 ms, 20 s, 5 min."""
    for limit, unit, scale in ((0.00095, "µs", 1e6), (0.95, "ms", 1e3), (950, "s", 1.0)):
        if value < limit:
            return f"{plain(value * scale)} {unit}"
    return f"{plain(value, 4)} s"


def error(metric: str, value: float) -> str:
    """An error of `metric`: 1.2 %, 0.034 (FLIP), 1.5 px (silhouette)."""
    row = METRICS[metric]
    if row.share:
        return f"{digits(100 * value)} %"
    return f"{digits(value)} {row.unit}".rstrip()


def target(metric: str, value: float) -> str:
    """A round target error: 1 %, 0.3 %, 0.05."""
    row = METRICS[metric]
    return f"{plain(100 * value)} %" if row.share else f"{plain(value)} {row.unit}".rstrip()


def formatter(metric: str) -> Callable[[float], str]:
    """`error` of one metric; plain digits for an unknown metric."""
    return lambda value: error(metric, value) if metric in METRICS else digits(value)


def spread(times: Spread, say: Callable[[float], str]) -> str:
    """A median, with its quartiles if they differ: `2.1 s (2.0 s to 2.3 s)`."""
    low, high = say(times.low), say(times.high)
    return say(times.median) + (f" ({low} to {high})" if low != high else "")


def value(setting: Setting) -> str:
    """The value of a setting: `64`, `1 %`, `on`."""
    step = setting.value
    if isinstance(step, bool):
        return "on" if step else "off"
    if isinstance(step, float):
        return f"{plain(100 * step, 3)} %" if setting.knob == "error" else plain(step, 3)
    if isinstance(step, tuple | list):
        return " ".join(map(str, step))
    return str(step)


def setting(chosen: Setting) -> str:
    """A setting with its knob: `64 samples`, `1 sample`, `error 1 %`, `tolerance 0.25`."""
    step = value(chosen)
    if isinstance(chosen.value, int) and not isinstance(chosen.value, bool) and chosen.knob.endswith("s"):
        return f"{step} {chosen.knob[:-1] if chosen.value == 1 else chosen.knob}"
    return f"{chosen.knob} {step}"


def curve(drawn: Curve, chart: Chart) -> str:
    """A curve's name: `raster`, or `ray by samples` if its backend has several curves."""
    several = sum(other.backend == drawn.backend for other in chart.curves) > 1
    return f"{drawn.backend} by {drawn.knob}" if several else drawn.backend


def stopped_curves(chart: Chart) -> list[tuple[str, list[Curve]]]:
    """Titles such as `raster stops` with the curves that cannot improve, grouped by reason and error."""
    groups: dict[str, list[Curve]] = {}
    for drawn in chart.curves:
        if drawn.stops:
            groups.setdefault(drawn.stops, []).append(drawn)
    return [(_stop_title(curves, chart), curves) for curves in groups.values()]


def _stop_title(curves: list[Curve], chart: Chart) -> str:
    """`raster stops`, `raster and ray by samples stop`; a backend whose curves all stop has its own name."""
    names = []
    for drawn in curves:
        alone = all(other in curves for other in chart.curves if other.backend == drawn.backend)
        names.append(drawn.backend if alone else curve(drawn, chart))
    names = list(dict.fromkeys(names))
    return f"{', '.join(names[:-1])} and {names[-1]} stop" if len(names) > 1 else f"{names[0]} stops"


def title(chart: Chart) -> str:
    """The scene's file name with its options, without its folder."""
    file, *options = shlex.split(chart.scene) or [""]
    return " ".join([PurePath(file).name, *options])


def left_out(chart: Chart, brief: bool = False) -> list[str]:
    """Lines on contestants that are not charted, with reasons, and on the number of incomplete sweeps.

    `brief`: only the first of several reasons, without its source position.
    """
    cut = [name for name in chart.left_out if ": " in name]  # steps: "ray, samples: 4096 samples"
    reasons = {name: _first(why) if brief else why for name, why in chart.left_out.items() if name not in cut}
    lines = [f"not charted: {name}: {why}" for name, why in reasons.items()]
    if cut:
        sweeps = "1 sweep stops" if len(cut) == 1 else f"{len(cut)} sweeps stop"
        lines.append(f"{sweeps} before the most expensive settings (the .json lists them): a longer --budget continues them")
    return lines


def _first(reasons: str) -> str:
    """The first of several reasons, without its source position: `glass is not carried (and 2 more reasons)`."""
    first, *others = reasons.split("; ")
    more = f" (and {len(others)} more reason{'' if len(others) == 1 else 's'})" if others else ""
    return re.sub(r"^\S+:\d+:\d+: ", "", first) + more


def point(measured: Point, metric: str) -> str:
    """One line about a point: `ray, 64 samples: 2.1 s (2.0 s to 2.3 s), 1.0 % (0.9 % to 1.1 %)`."""
    chosen, error = measured.setting, spread(measured.error, formatter(metric))
    return f"{chosen.backend}, {setting(chosen)}: {spread(measured.seconds, seconds)}, {error}"


def bias_and_noise(measured: Point) -> list[tuple[str, str]]:
    """Bias and noise of a point by name, as √relMSE with standard errors; unknown ones are left out."""
    named = (("bias", measured.bias, measured.bias_error), ("noise", measured.noise, measured.noise_error))
    return [(name, _with_standard_error(value, standard_error)) for name, value, standard_error in named if value is not None]


def _with_standard_error(value: float, standard_error: float | None) -> str:
    """A √relMSE with its standard error, or its upper bound where it is not significant."""
    if not standard_error:
        return error("relmse", value)
    return f"{error('relmse', value)} ± {error('relmse', standard_error)}" if value else f"below {error('relmse', standard_error)}"


def command(chart: Chart, chosen: Setting) -> str:
    """The command that renders a point's picture; for a peer its settings."""
    return command_of(chart.scene, chart.size, chosen)


def command_of(scene: str, size: tuple[int, int], chosen: Setting) -> str:
    """The command that renders a setting's picture; for a peer its settings."""
    if chosen.backend not in BACKENDS:
        return chosen.arguments()
    return f"maquette render {scene} --size {size[0]}x{size[1]} {chosen.arguments()}"


def size(chart: Chart) -> str:
    """`800×600`."""
    return f"{chart.size[0]}×{chart.size[1]}"
