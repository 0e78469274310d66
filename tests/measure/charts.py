"""Hand-made charts: a scene measured on five curves, and small charts with one feature each."""

from __future__ import annotations

import math
from typing import Any

from maquette.measure.records import Chart, Curve, Point, Setting, Spread


def spread(median: float, share: float = 0.1, count: int = 5) -> Spread:
    return Spread(median, median * (1 - share), median * (1 + share), count)


def point(backend: str, knob: str, value: Any, seconds: float, error: float, **more: Any) -> Point:
    setting = Setting(backend, knob, value, {knob: value}, more.pop("plan", {}))
    errors = {"relmse": spread(error, 0.05), "flip": spread(error / 3, 0.05)}
    return Point(setting, spread(seconds), errors["relmse"], errors, stages={"build": 0.01, "render": seconds}, **more)


def sweep(backend: str, first: float, each: float, error: float, steps: int, bias: float = 0.0) -> tuple[Point, ...]:
    """4^i samples: `first` seconds and `each` a sample; noise falls by half a step, bias stays."""
    return tuple(
        point(
            backend, "samples", 4**i, first + each * 4**i, math.hypot(error / 2**i, bias),
            bias=bias, bias_error=error / 2**i / 10, noise=error / 2**i, noise_error=error / 2**i / 20,
        )
        for i in range(steps)
    )  # fmt: skip


def room() -> Chart:
    """Two knobs of ray, a raster that stops, a slow reference, one peer."""
    adaptive = tuple(point("ray", "error", v, 0.00081 / v / v, v * 1.1) for v in (0.1, 0.03, 0.01, 0.005))
    curves = (
        Curve("ray", "samples", sweep("ray", 0.03, 0.01, 0.31, 7)),
        Curve("ray", "error", adaptive),
        Curve("raster", "samples", sweep("raster", 0.03, 0.005, 0.12, 4, bias=0.031), "no interreflection: bias 3.1 %"),
        Curve("reference", "samples", sweep("reference", 0, 1.8, 0.33, 3)),
        Curve("mitsuba", "samples", sweep("mitsuba", 0.4, 0.015, 0.25, 6)),
    )
    return chart(
        *curves, floor=0.0012, front=(11, 12, 2, 3, 4, 5, 6), knee=4,
        left_out={"povray": "not installed: apt install povray"},
    )  # fmt: skip


def chart(*curves: Curve, floor: float = 0.0, **more: Any) -> Chart:
    about = {"machine": "2 threads of a machine", "versions": {"maquette": "0.1.0", "numpy": "2.4.6"}}
    return Chart("room.scene", (400, 300), "relmse", floor, "262144 samples of ray, seeds 1000 to 1015", curves, **{**about, **more})
