"""Pictures of few samples, drawn at full size by the ray backend: the chart's model of time and error is fitted to them.

Where no reference fits into the budget, they are the chart. Each is drawn as a command would draw it. It tells its own error, from two
halves of its samples, before denoising and after.
Fixed samples come first, four times as many each time, then an error as small as there is time for, with adaptive sampling.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...compiler import ir
from ...render import render_scene
from ...render.film import adaptive_sampling
from ...render.film.deadline import Deadline
from ...render.jit import cancellation
from .. import cost_model
from ..cost_model import DENOISED, ERROR, SAMPLES, Seconds, Way
from ..records import Curve, Point, Setting, Spread
from . import estimate, runs, setting_sweeps
from .reference_light import ReferenceLight

FIRST, FACTORS, MOST = 4, (4, 2), 4096  # samples of the first run of fixed samples, and times more each time, as there is time
BLACK = 64  # samples up to which a picture without any noise may be one that has found no light yet
FIXED_SHARE = 0.5  # of the time that is left, for the next run of fixed samples
SECOND_SHARE = 0.8  # of the time that is left, for the second one: one run tells no power
ADAPTIVE_SHARES = (0.25, 0.5)  # of the time that is left, for the runs until an error
LEAST_ADAPTIVE = 1.2  # times the error of the last run with adaptive sampling, that the next one must be smaller by
REFERENCE = "no reference: each picture tells its own error, from two halves of its samples"
TOLD = "the picture tells this error itself"


@dataclass(frozen=True, slots=True)
class ShortRun:
    """One run: the setting, its mean samples, the error that its picture tells, the whole time and what denoising takes of it."""

    setting: Setting
    samples: float
    error: float | None  # before denoising
    denoised: float | None  # after denoising
    time: Seconds
    denoising: Seconds
    stages: dict[str, float]
    about: dict[str, Any] = field(default_factory=dict)  # metadata of the picture


class ShortRuns:
    """The short runs of a scene."""

    def __init__(self, scene: ir.Scene, light: ReferenceLight, guess: estimate.Estimate | None, cancel: threading.Event) -> None:
        """`guess` tells how long the first run takes; None: unknown."""
        self.scene, self.light, self.guess, self.cancel = scene, light, guess, cancel
        self.settings = setting_sweeps.of_full_light(scene, light)
        self.fixed: list[ShortRun] = []
        self.adaptive: list[ShortRun] = []
        self.how = estimate.way_of(light.plan(scene))

    def draw(self, errors: Sequence[float], deadline: Deadline, progress: Callable[[], None]) -> None:
        """Draw runs until the deadline, or until the least of the errors is reached. Raises runs.Cancelled if cancelled."""
        stop, least = runs.Stop(self.cancel, deadline.is_over), min(errors)
        counts: tuple[int, ...] = (FIRST,)
        while samples := next((n for n in counts if n <= MOST and self._expected(n) <= self._share() * deadline.left()), 0):
            run = self._run(self._fixed_setting(samples), stop)
            if run is None:
                return
            self.fixed.append(run)
            progress()
            if run.error is None or (run.error <= least and (run.error > 0.0 or samples >= BLACK)):
                break
            counts = tuple(factor * samples for factor in FACTORS)
        for share in ADAPTIVE_SHARES if ERROR in self.settings and self.fixed else ():
            error = self._affordable_error(share * deadline.left(), least)
            if error is None:
                continue
            run = self._run(_valued(self.settings[ERROR], error), stop)
            if run is None:
                return
            self.adaptive.append(run)
            progress()

    def needed(self) -> float:
        """Seconds of the least runs from which the model follows: the first two of fixed samples."""
        return self._expected(FIRST) + self._expected(FIRST * FACTORS[0])

    def ways(self, start: Seconds) -> list[Way]:
        """The ways of this scene with what the runs tell; `start` is the time of a command beside drawing."""
        found = []
        limit, doubt = self.limit, self.doubt
        kinds = ((SAMPLES, self.fixed), (DENOISED, self.fixed), (ERROR, self.adaptive))
        for kind, drawn in kinds:
            told = [self._told(kind, run) for run in drawn if kind in self.settings]
            known = tuple(run for run in told if run is not None)
            if known:
                known = tuple(run._replace(error=math.hypot(run.error, limit.bias)) for run in known)
                found.append(Way(self.settings[kind], self.how, known, start, limit.bias, limit.reason, 1.0 if kind == DENOISED else doubt))
        return found

    @property
    def limit(self) -> estimate.Limit:
        """The light that the limit on bounces leaves out, as the run of most samples has measured it."""
        last = max([*self.fixed, *self.adaptive], key=lambda run: run.samples, default=None)
        return estimate.limit_of(last and last.about.get("cut"), int(self.light.plan(self.scene)["bounces"]))

    @property
    def doubt(self) -> float:
        """The factor by which stray bright samples of the last run widen the bounds."""
        few = self.fixed[-1].about.get("error_in_few", 0.0) if self.fixed else 0.0
        return min(1.0 / max(1.0 - few, 1e-6), estimate.STRAY)

    @property
    def basis(self) -> str:
        """What the answers are fitted to, as a clause."""
        counts = [f"{run.samples:g}" for run in self.fixed]
        fixed = f"{', '.join(counts)} samples a pixel" if counts else ""
        errors = [f"{100 * run.setting.value:g} %" for run in self.adaptive]
        until = f"of an error of {' and '.join(errors)}" if errors else ""
        left_out = next((run.about["left_out"] for run in self.fixed if run.about.get("left_out")), ())
        beside = "".join(f"; {clause}" for clause in left_out)
        return f"fitted to runs of {' and '.join(filter(None, (fixed, until)))}{beside}"

    def curves(self) -> tuple[Curve, ...]:
        """The runs as curves of a chart."""
        kinds = ((SAMPLES, self.fixed), (ERROR, self.adaptive), (DENOISED, self.fixed))
        drawn = ((kind, [point for run in found if (point := self._point(kind, run)) is not None]) for kind, found in kinds)
        return tuple(Curve("ray", kind, tuple(points)) for kind, points in drawn if points)

    # --- one run ----------------------------------------------------------------------------------------------------------

    def _fixed_setting(self, samples: int) -> Setting:
        return _valued(self.settings[DENOISED if DENOISED in self.settings else SAMPLES], samples)

    def _share(self) -> float:
        """Of the time that is left, for the next run of fixed samples."""
        return SECOND_SHARE if len(self.fixed) == 1 else FIXED_SHARE

    def _expected(self, samples: float) -> float:
        """Seconds of a run of fixed samples."""
        if self.fixed:
            return self._way_of_fixed().seconds(samples).wall
        return self.guess.seconds(samples) if self.guess is not None else 0.0

    def _way_of_fixed(self) -> Way:
        kind = DENOISED if DENOISED in self.settings else SAMPLES
        return Way(self.settings[kind], self.how, tuple(cost_model.Run(run.samples, run.error or 0.0, *run.time) for run in self.fixed))

    def _affordable_error(self, seconds: float, least: float) -> float | None:
        """The error that adaptive sampling is expected to reach in so many seconds, at least `least`; None: no run would tell more."""
        last = (self.adaptive or self.fixed)[-1]
        if not last.error or (self.adaptive and last.setting.value <= least):
            return None
        samples = seconds * last.samples / max(last.time.wall - last.denoising.wall, 1e-9)
        reached = max(last.error * math.sqrt(last.samples / max(samples, 1.0)), least)
        scale = 10.0 ** (math.floor(math.log10(reached)) - 1)
        asked = float(f"{math.ceil(reached / scale - 1e-6) * scale:.3g}")
        if asked >= 1.0 or samples < adaptive_sampling.first_samples(asked):
            return None
        return None if self.adaptive and last.error < LEAST_ADAPTIVE * asked else asked

    def _run(self, setting: Setting, stop: threading.Event) -> ShortRun | None:
        """Draw a picture; None if its time is over. Raises runs.Cancelled if cancelled."""
        plan = runs.make_plan(self.scene, self.light.settings, setting, len(self.fixed) + len(self.adaptive))
        stages = runs.Stages()
        try:
            about = render_scene.draw(self.scene, plan, stages.report, stop).metadata
        except cancellation.Cancelled:
            about = None
        if self.cancel.is_set():
            raise runs.Cancelled
        if about is None or about["partial"] or stop.is_set():
            return None
        spent, denoising = stages.spent(), stages.denoising()
        kept = {name: about.get(name) for name in ("cut", "error_in_few", "left_out", "seconds")}
        return ShortRun(
            setting, about["samples_mean"], about["error"], about.get("denoised_error"), spent, denoising, dict(about["seconds"]), kept
        )

    def _told(self, kind: str, run: ShortRun) -> cost_model.Run | None:
        """What a run tells of a kind of ways; None: nothing.

        A run until an error that takes the first samples alone tells the error of these, any other the error that it was to reach.
        """
        wall, cpu = run.time
        error = run.error
        if kind == DENOISED:
            error = run.denoised
        elif kind == SAMPLES:
            wall, cpu = wall - run.denoising.wall, cpu - run.denoising.cpu
        elif run.samples > 1.01 * adaptive_sampling.first_samples(run.setting.value):
            error = run.setting.value
        return None if error is None else cost_model.Run(run.samples, error, wall, cpu)

    def _point(self, kind: str, run: ShortRun) -> Point | None:
        error = run.denoised if kind == DENOISED else run.error
        told = self._told(kind, run)
        if error is None or told is None:
            return None
        setting = run.setting if kind == ERROR else _valued(self.settings[kind], run.setting.value)
        seconds, shown = Spread(told.wall, told.wall, told.wall, 1), Spread(error, error, error, 1)
        return Point(setting, seconds, shown, {"relmse": shown}, stages=run.stages, note=TOLD, cpu=told.cpu, samples=run.samples)


def _valued(setting: Setting, value: float) -> Setting:
    name = ERROR if setting.knob == ERROR else SAMPLES
    return replace(setting, value=value, options={**setting.options, name: value})


