"""What a chart is made of: settings, runs, the reference, figures with their spread, points, curves, the chart. Plain data, no drawing.

Errors are in the metric's own unit; bias and noise are √relMSE-like: its square is about bias² + noise². Seconds are wall time.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir


class NothingMeasured(Exception):
    """Not one point could be measured; the message says why, and what to change."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a chart is asked for. `settings` hold size, camera, threads and bounces, the same for everybody; None: as the scene says."""

    name: str  # the scene with its options as typed on a command line; the chart's title
    settings: ir.Settings
    backends: tuple[str, ...] = ("ray", "raster", "reference")
    peers: tuple[str, ...] = ()
    metric: str = "relmse"  # "relmse", "flip", "max" or "silhouette"
    budget: float = 60.0  # seconds of everything, the reference too
    seeds: int | None = None  # renders a setting with seeds of their own; None: as many as the split of bias and noise needs
    repeats: int | None = None  # timed renders a setting, at the least
    keep: Path | None = None  # a folder for the raw images


@dataclass(frozen=True, slots=True)
class Setting:
    """One rung of a ladder: `value` of `knob`, as fields of compiler.ir.Settings (`options`) and overrides of the plan."""

    backend: str  # "ray", "raster", "reference", or a peer's name
    knob: str  # "samples", "error", "bounces", "tolerance", …
    value: Any
    options: Mapping[str, Any] = field(default_factory=dict)
    plan: Mapping[str, str] = field(default_factory=dict)

    def arguments(self) -> str:
        """To copy behind `maquette render SCENE`: `--backend ray --samples 64`."""
        options = [("backend", self.backend), *((n, v) for n, v in self.options.items() if n != "backend")]
        words = [f"--{name}" if value is True else f"--{name} {shlex.quote(_written(name, value))}" for name, value in options]
        return " ".join([*words, *(f"--plan {shlex.quote(f'{name}={value}')}" for name, value in self.plan.items())])


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One render: linear `rgb` (h, w, 3) float32, wall `seconds` by stage ("render" is charted), `cpu` seconds, its `seed`.

    `alpha` (h, w) is coverage, None where nobody says; `notes` are what the backend says it does not draw.
    """

    rgb: NDArray[np.float32]
    seconds: Mapping[str, float]
    cpu: float
    seed: int
    alpha: NDArray[np.float32] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """What errors are measured against: `rgb` and its `variance`, both (h, w, 3) float64; the variance of a closed form is 0.

    `alpha` (h, w) is coverage. `halves` are the means (h, w, 4) of either half of the seeds, None of a closed form: what they differ
    by, halved, is the reference's own uncertainty in any metric.
    """

    rgb: NDArray[np.float64]
    variance: NDArray[np.float64]
    how: str
    samples: int
    seeds: tuple[int, ...]
    alpha: NDArray[np.float64] | None = None
    halves: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None


@dataclass(frozen=True, slots=True)
class Spread:
    """A figure over `count` runs: its median and quartiles (25 %, 75 %)."""

    median: float
    low: float
    high: float
    count: int


@dataclass(frozen=True, slots=True)
class Point:
    """A setting, measured. `errors` holds every metric, `error` the charted one.

    Bias and noise come with their standard errors; None where they were not told apart. Of a bias that is not told from 0, `bias_error`
    is what it would be at most.
    """

    setting: Setting
    seconds: Spread
    error: Spread
    errors: Mapping[str, Spread]
    bias: float | None = None
    bias_error: float | None = None
    noise: float | None = None
    noise_error: float | None = None
    stages: Mapping[str, float] = field(default_factory=dict)  # median seconds: import, compile_kernels, build, render, …
    note: str = ""
    bias_squared: float | None = None  # as estimated, before its root: below 0 where noise alone is met by accident
    bias_squared_error: float | None = None
    bias_block: int | None = None  # pixels square over which means were taken to see it: 1, or else the bias is at least so much
    cpu: float | None = None  # median CPU seconds of building and rendering, all threads together


@dataclass(frozen=True, slots=True)
class Curve:
    """A backend on one ladder, cheap settings first. `stops` says why it cannot get better: "no interreflection: bias 3.1 %"; or ""."""

    backend: str
    knob: str
    points: tuple[Point, ...]
    stops: str = ""
    slope: float | None = None  # d log noise² / d log samples: -1 of random numbers, steeper of Sobol points


@dataclass(frozen=True, slots=True)
class Chart:
    """A scene's chart. `front` and `knee` count points through all curves in order."""

    scene: str  # as typed: the file with its options
    size: tuple[int, int]
    metric: str
    floor: float  # the reference's own uncertainty in the metric
    reference: str  # how it was made
    curves: tuple[Curve, ...]
    front: tuple[int, ...] = ()
    knee: int | None = None
    left_out: Mapping[str, str] = field(default_factory=dict)  # by backend or peer: why
    machine: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def points(self) -> tuple[Point, ...]:
        """All points, curve by curve."""
        return tuple(point for curve in self.curves for point in curve.points)


def _written(name: str, value: Any) -> str:
    """An option's value as the command line reads it."""
    if name == "size":
        return "x".join(map(str, value))
    if isinstance(value, tuple | list):
        return ",".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
