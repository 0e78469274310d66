"""Records of a chart: settings, runs, reference, figures with quartiles, points, curves, chart. Plain data.

Errors are in the unit of the metric. Bias and noise are √relMSE: its square is about bias² + noise². Seconds are wall time.
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
from ..lang.schema.picture_settings import BACKENDS


class NothingMeasured(Exception):
    """No point could be measured. The message has the reason and a remedy; `answers` are what is known without, for a picture of `size`."""

    def __init__(self, message: str, answers: tuple[Answer, ...] = (), size: tuple[int, int] = (0, 0)) -> None:
        super().__init__(message)
        self.answers, self.size = answers, size


@dataclass(frozen=True, slots=True)
class Wanted:
    """The request of a chart. `settings` hold size, camera, threads and bounces for all contestants; None: the scene's."""

    name: str  # the scene and its options as on the command line; the title
    settings: ir.Settings
    backends: tuple[str, ...] = BACKENDS
    peers: tuple[str, ...] = ()
    metric: str = "relmse"  # of metric_table.METRICS
    budget: float = 60.0  # seconds in all, including the reference
    seeds: int | None = None  # renders of a setting with different seeds; None: as many as bias and noise need
    repeats: int | None = None  # the least number of timed renders of a setting
    keep: Path | None = None  # a folder for the raw images
    target: float = 0.02  # √relMSE that the question is about
    backends_named: bool = True  # whether the backends were named: otherwise those that are known to lack light are left out
    began: float | None = field(default=None, compare=False)  # time.perf_counter() from which the budget counts; None: when measured
    loading: tuple[float, float] = field(default=(0.0, 0.0), compare=False)  # wall and CPU seconds of importing and reading the scene


@dataclass(frozen=True, slots=True)
class Setting:
    """One step of a sweep: `value` of `knob`, as fields of compiler.ir.Settings (`options`) and overrides of the plan (`plan`)."""

    backend: str  # of BACKENDS, or a peer's name
    knob: str  # "samples", "error", "bounces", "tolerance", …
    value: Any
    options: Mapping[str, Any] = field(default_factory=dict)
    plan: Mapping[str, str] = field(default_factory=dict)

    def arguments(self) -> str:
        """Arguments of `maquette render SCENE`: `--backend ray --samples 64`."""
        options = [("backend", self.backend), *((n, v) for n, v in self.options.items() if n != "backend")]
        words = [f"--{name}" if value is True else f"--{name} {shlex.quote(_written(name, value))}" for name, value in options]
        return " ".join([*words, *(f"--plan {shlex.quote(f'{name}={value}')}" for name, value in self.plan.items())])


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One render: linear `rgb` (h, w, 3) float32, wall `seconds` by stage ("render" is charted), `cpu` seconds, its `seed`.

    `alpha` (h, w) is coverage, None if unknown; `notes` are the backend's messages on features it does not draw. `samples` is the mean
    number of a pixel, 0 if unknown.
    """

    rgb: NDArray[np.float32]
    seconds: Mapping[str, float]
    cpu: float
    seed: int
    alpha: NDArray[np.float32] | None = None
    notes: tuple[str, ...] = ()
    samples: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The reference picture: `rgb` and its `variance`, both (h, w, 3) float64; the variance of a closed form is 0.

    `alpha` (h, w) is coverage. `halves` are the means (h, w, 4) of the two halves of the seeds, None for a closed form. Half of their
    difference is the uncertainty of the reference in any metric.
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
    """A measured setting. `errors` holds every metric, `error` the charted one.

    Bias and noise have standard errors; None where they are unknown. For a bias that is not significant `bias_error` is its upper bound.
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
    bias_squared: float | None = None  # the estimate; below 0 by chance where there is only noise
    bias_squared_error: float | None = None
    bias_block: int | None = None  # side in pixels of the blocks of the bias; above 1 the bias is a lower bound
    cpu: float | None = None  # median CPU seconds of building and rendering, all threads
    samples: float | None = None  # mean samples of a pixel, median over the runs


@dataclass(frozen=True, slots=True)
class Curve:
    """A backend's sweep, cheap settings first. `stops` is the reason why it cannot improve: "no interreflection: bias 3.1 %"; or ""."""

    backend: str
    knob: str
    points: tuple[Point, ...]
    stops: str = ""
    slope: float | None = None  # d log noise² / d log samples: -1 for random numbers, steeper for Sobol points


@dataclass(frozen=True, slots=True)
class Answer:
    """The command that has an error in the least time, by a model that is fitted to runs; or why there is none.

    Times are those of the whole command, with the bounds of the model; CPU seconds count all threads.
    """

    target: float  # √relMSE
    how: str = ""  # "ray with paths, 512 samples and denoising"
    setting: Setting | None = None  # None: no command is known, for the reason `why`
    samples: float = 0.0  # mean samples of a pixel
    seconds: float = 0.0
    least: float = 0.0
    most: float = 0.0
    cpu: float = 0.0
    least_cpu: float = 0.0
    most_cpu: float = 0.0
    why: str = ""


@dataclass(frozen=True, slots=True)
class Chart:
    """The chart of a scene. `front` and `knee` are indices into the points of all curves in order."""

    scene: str  # the file and its options as on the command line
    size: tuple[int, int]
    metric: str
    floor: float  # the uncertainty of the reference in the metric
    reference: str  # how it was made
    curves: tuple[Curve, ...]
    front: tuple[int, ...] = ()
    knee: int | None = None
    left_out: Mapping[str, str] = field(default_factory=dict)  # backend or peer: reason
    machine: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)
    target: float = 0.02  # √relMSE that the question is about
    estimate: str = ""  # the answer of older versions before anything was measured
    answers: tuple[Answer, ...] = ()  # to `target` and to other errors
    basis: str = ""  # what the answers are fitted to

    @property
    def points(self) -> tuple[Point, ...]:
        """All points, curve by curve."""
        return tuple(point for curve in self.curves for point in curve.points)


def _written(name: str, value: Any) -> str:
    """An option's value as the command line reads it."""
    if name == "error":
        return f"{100.0 * value:g}%"
    if name == "size":
        return "x".join(map(str, value))
    if isinstance(value, tuple | list):
        return ",".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)
