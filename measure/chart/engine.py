"""Measures a chart: the reference, then the sweeps of all backends and peers, within a time budget.

- Small pictures give a first estimate, in a part of the budget. Where no reference fits into the budget, short runs at full size take its
  place (short_runs.py). Where not even these fit, it ends at once and says what they take.
- A model that is fitted to the runs answers which command has an error in the least time (../cost_model.py).
- Backends that are known to lack light are left out, unless they were named. Sweeps that are known to lack light come last.
- Half of the budget goes to the reference. Its runs are cached on disk, and later commands add to them.
- The sweep with the cheapest next step proceeds, as long as MIN_RUNS runs of each step fit.
- The remaining time brings all steps to TARGET_RUNS runs, in rounds over all steps, so that a slower machine slows all alike.
- The position of a run on the chart decides its seed. No other run and no reference has that seed.
- Pictures are measured, added to statistics, and written only on request.
- Only the compilation of kernels, once, may exceed the budget. Half of the budget then remains for measuring. At its end a run is
  interrupted, and does not count.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...render.film.deadline import Deadline
from ...render.image import image_files
from .. import cost_model, formatting
from ..cost_model import Seconds
from ..peers import process, registry
from ..records import Answer, Chart, Curve, NothingMeasured, Reference, Setting, Wanted
from . import contestant, estimate, pareto, raw_images, reference, reference_light, runs, setting_sweeps, short_runs, summary
from .contestant import Contestant, Step

MIN_RUNS, TARGET_RUNS = 5, 16  # runs of a setting: quartiles need the first, separation of bias and noise the second
ESTIMATE_SHARE = 0.2  # of the budget that is left, for the first estimate, and for the picture before it that loads kernels
SHORT_SHARE = 0.25  # of the budget that is left, for short runs beside a reference
CHART_FACTOR, CHART_START = 1.5, 5.0  # times these samples, and seconds more, that such a chart takes: first renders, measuring pictures
CHART_SAMPLES = 16  # samples of a setting at least, that a chart with a reference has time for
WRITING = Seconds(1e-6, 1e-6)  # of a pixel of a picture file
OUTSIDE = Seconds(0.5, 0.5)  # of the process of a command, beside reading and drawing
LONGER, USUAL = 5.0, 60.0  # times a budget, and seconds at least: that are named where nothing is known of a scene
UNHURRIED = 20.0  # seconds that are left, from which on the time of importing is measured
WARMUP_SHARE = 0.15  # of the budget that is left, for the first renders of a backend
REFERENCE_SHARE = 0.5  # of the budget
RESERVED_SHARE, MAX_RESERVED = 0.2, 2.5  # share of the budget, and seconds: for loading before and drawing after the measurement
REFERENCE_FACTOR = 16  # least samples of the reference over those of a step: its noise adds at most 3 % to an error
TARGET_SAMPLES = 100 * 4096  # samples a pixel of a complete reference
MAX_STEPS, MAX_RUNS = 16, 2048  # limits of a sweep and of a step, which separate their seeds
DEFAULT_WIDTH = 160  # pixels of the longer side where no size is given

Progress = Callable[[float, float], None]  # seconds done, seconds in all


def measure(scene: ir.Scene, wanted: Wanted, progress: Progress | None = None, cancel: threading.Event | None = None) -> Chart:
    """Measure a chart. `progress(done, total)` is called between renders; setting `cancel` ends the measurement.

    Raises NothingMeasured if the budget or `cancel` prevents the first point, planner.PlanError for an unknown camera.
    """
    return _Measurement(scene, wanted, progress or (lambda done, total: None), cancel or threading.Event()).chart()


@dataclass(slots=True, eq=False)
class _SweepProgress:
    """A sweep and its measured steps."""

    contestant: Contestant
    sweep: setting_sweeps.Sweep
    first: float  # expected seconds of its first step
    number: int  # among all sweeps; part of the seeds
    steps: list[Step] = field(default_factory=list)
    skipped: str = ""  # the reason why the next step was not measured
    failed: bool = False

    @property
    def name(self) -> str:
        """Backend and setting, as in "ray, samples"."""
        return f"{self.sweep.backend}, {self.sweep.name}"

    def place(self, step: Step) -> int:
        """The position of a step, counted from the cheapest."""
        return self.sweep.settings.index(step.setting)

    def next_setting(self) -> Setting | None:
        """The setting of the next step; None at the end of the sweep."""
        step = len(self.steps)
        over = self.skipped or self.failed or step == len(self.sweep.settings)
        return None if over else self.sweep.settings[step]

    def note_the_end(self, why: str) -> None:
        """Give the reason why the next step was not measured, if there is one and no reason yet."""
        if self.next_setting() is not None:
            self.skipped = why

    def expected(self) -> float:
        """Expected seconds of the next step: those of the last, with rendering scaled by the cost."""
        step, costs = len(self.steps), self.sweep.costs
        if step == 0:
            return self.first
        last = self.steps[-1]
        render = last.seconds[-1]
        return last.wall - render + render * costs[step] / costs[step - 1]


class _Measurement:
    """One running measurement."""

    def __init__(self, scene: ir.Scene, wanted: Wanted, progress: Progress, cancel: threading.Event) -> None:
        self.began = time.perf_counter() if wanted.began is None else wanted.began
        self.budget = Deadline(wanted.budget, self.began).earlier(min(wanted.budget * RESERVED_SHARE, MAX_RESERVED))
        self.wanted, self.progress, self.cancel = wanted, progress, cancel
        self.stop = runs.Stop(cancel, self.budget.is_over)
        # The sweeps set these; the scene's own values must not end a step.
        self.scene = replace(scene, settings=replace(scene.settings, samples=None, error=None, budget=None, seed=None))
        self.settings = _with_size(self.scene, replace(wanted.settings, backend=None, threads=runs.threads(wanted.settings)))
        common = registry.common_overrides(planner.make_plan(self.scene, self.settings)) if wanted.peers else {}
        self.light = reference_light.choose(self.scene, self.settings, common)
        self.before = 0.0  # seconds before short runs and the reference
        self.short: short_runs.ShortRuns | None = None
        self.left_out: dict[str, str] = {}
        self.lacking: set[tuple[str, str]] = set()  # backend and name of the sweeps that are known to lack light
        self.versions = runs.versions()
        self.exposure, self.floor = 0.0, dict[str, float]()
        self.guess: estimate.Estimate | None = None
        fixed = max(wanted.seeds or 0, wanted.repeats or 0)
        self.least, self.good = fixed or MIN_RUNS, fixed or TARGET_RUNS
        self.raw_images = raw_images.RawImageWriter(wanted.keep) if wanted.keep is not None else None

    @property
    def deadline(self) -> float:
        """The time of time.perf_counter at which measuring ends."""
        return self.budget.end

    def chart(self) -> Chart:
        """Measure and return the chart."""
        with self.budget.watch_compiler():
            return self._measured()

    def _measured(self) -> Chart:
        plan = self.light.plan(self.scene)
        try:
            self.guess, self.before = self._first_estimate(), self.wanted.budget - self.budget.left()
            if not self._reference_fits():
                return self._by_short_runs(plan)
            if self.guess is not None:
                self._draw_short_runs(self.budget.part(SHORT_SHARE))
            contestants = self._contestants(plan)
            starts = [(contestant, *pair) for contestant in contestants for pair in zip(contestant.sweeps, contestant.first, strict=True)]
            sweeps = [_SweepProgress(*start, number) for number, start in enumerate(starts)]
            self.lacking = {(active.sweep.backend, active.sweep.name) for active in sweeps if active.sweep.light}
            against = self._reference()
        except (runs.Cancelled, NothingMeasured) as reason:
            if self.short is not None and self.short.fixed:
                return self._short_chart(self.short, plan)
            if self.cancel.is_set():
                raise NothingMeasured("interrupted before anything was measured") from None
            why = str(reason) if isinstance(reason, NothingMeasured) else self._too_short()
            raise NothingMeasured(why, self._answers(), plan["size"]) from None
        self.exposure = image_files.auto_exposure(against.rgb) if plan["exposure"] == "metered" else float(plan["exposure"])
        self.floor = summary.reference_uncertainty(against, self.exposure)
        try:
            while self._add_steps(sweeps, against):
                self._add_runs(sweeps, against, self.least)
            self._add_runs(sweeps, against, self.good)
        except runs.Cancelled:  # the chart holds the points measured so far
            for active in sweeps:
                active.note_the_end("it was interrupted" if self.cancel.is_set() else self._ended())
        if self.raw_images is not None:
            self.raw_images.finish(against, self.exposure)
        return self._make_chart(sweeps, plan, against)

    # --- contestants and reference ------------------------------------------------------------------------------------------

    def _contestants(self, plan: planner.Plan) -> list[Contestant]:
        contestants = []
        for backend in self.wanted.backends:
            if why := self._lacks(backend):
                self.left_out[backend] = why
                continue
            limit = Deadline(math.inf if backend == "ray" else WARMUP_SHARE * max(self.budget.left(), 0.0))
            stop, imports = runs.Stop(self.stop, limit.is_over), self.budget.left() > UNHURRIED
            try:
                with limit.watch_compiler():
                    contestants.append(contestant.backend_contestant(self.scene, self.light, backend, stop, imports))
            except runs.Cancelled:
                if self.stop.is_set():
                    raise
                took = formatting.seconds(limit.seconds)
                self.left_out[backend] = f"its first renders take longer than {took}: a longer --budget has time for them"
            self._report_progress()
        for peer in registry.find(self.wanted.peers):
            why = contestant.unsupported_reason(peer, self.scene, plan)
            if why:
                self.left_out[peer.name] = why
            else:
                contestants.append(contestant.peer_contestant(peer, self.scene, self.light))
                self.versions[peer.name] = peer.version
        return contestants

    def _first_estimate(self) -> estimate.Estimate | None:
        """The estimate of small pictures; None without ray. Raises NothingMeasured, runs.Cancelled."""
        if "ray" not in self.wanted.backends:
            return None
        seconds = max(ESTIMATE_SHARE * self.budget.left(), 0.0)
        guess = self.guess = estimate.make(self.scene, self.light, self.cancel, seconds)
        if not math.isfinite(guess.error):
            raise NothingMeasured(self._too_short())
        return guess

    def _reference_fits(self) -> bool:
        """Whether a chart with a reference fits into the budget, as far as the first estimate tells."""
        return self.guess is None or self._needed(self.guess) <= self.budget.left()

    # --- without a reference ------------------------------------------------------------------------------------------------

    def _draw_short_runs(self, deadline: Deadline) -> None:
        """Draw short runs until a deadline. Raises runs.Cancelled."""
        self.short = short_runs.ShortRuns(self.scene, self.light, self.guess, self.cancel)
        self.short.draw(cost_model.targets(self.wanted.target), deadline, self._report_progress)

    def _by_short_runs(self, plan: planner.Plan) -> Chart:
        """The chart of runs that tell their own errors. Raises NothingMeasured if the budget has no time for them, runs.Cancelled."""
        assert self.guess is not None
        self._draw_short_runs(self.budget)
        assert self.short is not None
        if not self.short.fixed:
            least = max(self.before + self.short.needed() / short_runs.FIXED_SHARE, self.wanted.budget)
            runs_take, against = formatting.seconds(least), formatting.seconds(self.before + self._needed(self.guess))
            small = "small pictures" if self.guess.denoised else "small pictures, without denoising"
            raise NothingMeasured(
                f"this is estimated from {small}. Runs of the whole picture take about {runs_take}, and a chart against a reference "
                f"about {against}, of the {self.wanted.budget:g} s there are: give a longer --budget or a smaller --size"
            )
        return self._short_chart(self.short, plan)

    def _short_chart(self, drawn: short_runs.ShortRuns, plan: planner.Plan) -> Chart:
        """The chart of short runs, which says what it lacks."""
        assert self.guess is not None
        full = self.before + self._needed(self.guess)
        more = f"it takes about {formatting.seconds(full)}: a longer --budget has time for it"
        self.left_out["a reference picture"] = (
            "it was interrupted" if self.cancel.is_set() else more if full > self.wanted.budget else self._ended()
        )
        for backend in self.wanted.backends:
            if backend != "ray":
                self.left_out[backend] = self._lacks(backend) or "its bias is unknown without a reference"
        self.left_out.update(dict.fromkeys(self.wanted.peers, "there is no reference to compare it with"))
        if self.wanted.metric != "relmse":
            self.left_out[self.wanted.metric] = "it takes a reference"
        given = (("--keep", self.wanted.keep), ("--seeds", self.wanted.seeds), ("--repeats", self.wanted.repeats))
        self.left_out.update({name: "it is for charts with a reference" for name, value in given if value is not None})
        return self._charted(drawn.curves(), plan, "relmse", short_runs.REFERENCE, self._answers(), drawn.basis)

    def _start(self, plan: planner.Plan) -> Seconds:
        """The time of a command beside drawing: its process, reading the scene, loading kernels, writing the picture."""
        width, height = plan["size"]
        kernels = self.guess.kernels if self.guess is not None else estimate.KERNELS
        wall, cpu = (
            loading + kernel + write * width * height + outside
            for loading, kernel, write, outside in zip(self.wanted.loading, kernels, WRITING, OUTSIDE, strict=True)
        )
        return Seconds(wall, cpu)

    def _ended(self) -> str:
        return f"the budget of {self.wanted.budget:g} s ended before it: a longer --budget has time for it"

    def _too_short(self) -> str:
        longer = max(LONGER * self.wanted.budget, USUAL)
        return f"nothing was measured within {self.wanted.budget:g} s: give a longer --budget, such as {longer:g}s, or a smaller --size"

    def _answers(self, curves: Sequence[Curve] = ()) -> tuple[Answer, ...]:
        """The answers by the short runs of ray, else by measured curves, else by the first estimate; of other backends by curves."""
        guess, plan = self.guess, self.light.plan(self.scene)
        drawn = self.short.ways(self._start(plan)) if self.short is not None else []
        limit = estimate.limit_of(guess.cut, int(plan["bounces"])) if guess is not None else estimate.Limit()
        start, names = self._start(plan), {"ray": estimate.way_of(plan)}
        unbiased = [curve for curve in curves if (curve.backend, curve.knob) not in self.lacking or curve.points[-1].bias]
        unbiased = [curve for curve in unbiased if not (drawn and curve.backend == "ray")]
        ways = drawn + cost_model.ways_of(unbiased, names, start, limit.bias, limit.reason)
        if guess is not None and not any(way.setting.backend == "ray" for way in ways):
            ways += guess.ways(setting_sweeps.of_full_light(self.scene, self.light), start, limit)
        return cost_model.answers(ways, self.wanted.target)

    def _needed(self, guess: estimate.Estimate) -> float:
        """Seconds of a chart up to CHART_SAMPLES, with a reference, of which so many samples may be on disk."""
        missing = max(REFERENCE_FACTOR * CHART_SAMPLES - reference.known_samples(self.scene, self.light), 0.0)
        of_reference = guess.seconds(missing) + reference.MIN_SEEDS * guess.start if missing else 0.0
        steps = [CHART_SAMPLES / 4**k for k in range(3)]
        drawn = max(of_reference / REFERENCE_SHARE, of_reference + self.least * sum(map(guess.seconds, steps)))
        return CHART_FACTOR * drawn + CHART_START

    def _lacks(self, backend: str) -> str:
        """The reason why a backend that nobody named is not measured; "" if it is."""
        if self.wanted.backends_named or backend == "ray":
            return ""
        reference_plan, backend_plan = self.light.plan(self.scene), self.light.plan(self.scene, backend)
        if missing := reference_light.missing_light(reference_plan, backend_plan):
            return f"{missing}, as is known without measuring: --backends ray,{backend} measures it"
        if backend == "reference" and backend_plan["transport"] == "path":
            return "it draws the light of ray in numpy, and takes hundreds of times as long: --backends ray,reference measures it"
        return ""

    def _reference(self) -> Reference:
        seconds = REFERENCE_SHARE * (self.deadline - time.perf_counter())
        effort = reference.Effort(seconds, TARGET_SAMPLES, lambda share: self._report_progress(), self.stop, self._expected)
        return reference.make(self.scene, self.light, effort)

    def _expected(self, samples: int) -> float:
        """Seconds of a picture of so many samples a pixel, as estimated; 0 where unknown."""
        return 0.0 if self.guess is None else self.guess.seconds(samples)

    # --- measuring ------------------------------------------------------------------------------------------------------

    def _add_steps(self, sweeps: list[_SweepProgress], against: Reference) -> bool:
        """Run the first run of each step whose MIN_RUNS runs are expected to fit, cheapest first. Returns whether there were any.

        The caller repeats this after the steps have their runs, which may have taken less time than expected.
        """
        grown = False
        for active in sweeps:
            active.skipped = ""
        while waiting := [active for active in sweeps if active.next_setting() is not None]:
            active = min(waiting, key=lambda sweep: (bool(sweep.sweep.light), sweep.expected()))
            setting = active.next_setting()
            assert setting is not None
            active.skipped = self._reference_too_noisy(setting, against) or self._over_budget(active, sweeps)
            step = Step(setting)
            if not active.skipped and self._run(active, step, against):
                active.steps.append(step)
                grown = True
        return grown

    def _reference_too_noisy(self, setting: Setting, against: Reference) -> str:
        """The reason why the reference is too noisy for a setting; "" if it is not.

        Sweeps of other knobs show bias, from which the reference's variance is subtracted anyway.
        """
        samples, enough = against.samples, int(setting.options.get("samples") or 0) * REFERENCE_FACTOR
        if samples and setting.knob == "error" and setting.value < 4.0 * self.floor.get("relmse", 0.0):
            return f"the reference is only certain to {formatting.error('relmse', self.floor['relmse'])}: a longer --budget improves it"
        if samples and setting.knob == "samples" and enough > samples:
            return f"the reference has only {samples:,} samples: a longer --budget improves it"
        return ""

    def _over_budget(self, active: _SweepProgress, sweeps: list[_SweepProgress]) -> str:
        due = sum((self.least - step.count) * step.wall for other in sweeps for step in other.steps)
        expected = active.expected()
        if time.perf_counter() + due + self.least * expected <= self.deadline:
            return ""
        return f"{self.least} renders of about {formatting.seconds(expected)} do not fit into the budget of {self.wanted.budget:g} s"

    def _add_runs(self, sweeps: list[_SweepProgress], against: Reference, count: int) -> None:
        """Bring all steps to at most `count` runs while time remains, in rounds, cheap steps first."""
        steps = sorted(((active, step) for active in sweeps for step in active.steps), key=lambda pair: pair[1].wall)
        for goal in range(2, count + 1):
            for active, step in steps:
                fits = time.perf_counter() + step.wall <= self.deadline
                if step.count < goal and not active.failed and fits:
                    self._run(active, step, against)

    def _run(self, active: _SweepProgress, step: Step, against: Reference) -> bool:
        """Add a run to a step. Returns False if the backend failed; it is then left out."""
        if self.stop.is_set():
            raise runs.Cancelled
        seed = (self.wanted.settings.seed or 0) + (active.number * MAX_STEPS + active.place(step)) * MAX_RUNS + step.count
        began = time.perf_counter()
        try:
            run = active.contestant.draw(step.setting, seed % reference.FIRST_SEED)
        except (process.PeerError, planner.PlanError) as problem:
            active.failed = True
            self.left_out[active.name] = str(problem)
            return False
        step.add(run, against, self.exposure, self.wanted.metric)
        if self.raw_images is not None:
            self.raw_images.write_run(step.setting, active.sweep.name, run, step.latest)
        step.wall = time.perf_counter() - began
        self._report_progress()
        return True

    # --- the chart ------------------------------------------------------------------------------------------------------

    def _make_chart(self, sweeps: list[_SweepProgress], plan: planner.Plan, against: Reference) -> Chart:
        metric, curves = self.wanted.metric, []
        for active in sweeps:
            swept = summary.make_curve(active.sweep, active.steps, metric, against, active.contestant.stages)
            if swept is not None:
                curves.append(swept)
            elif active.steps:
                self.left_out[active.name] = f"its pictures do not have what `{metric}` measures"
            self._note_skipped(active)
        if not curves and self.short is not None and self.short.fixed:
            return self._short_chart(self.short, plan)
        if not curves:
            reasons = "; ".join(f"{name}: {why}" for name, why in self.left_out.items()) or self._too_short()
            raise NothingMeasured(reasons, self._answers(), plan["size"])
        others = "fitted to what was measured against the reference"
        basis = self.short.basis if self.short is not None and self.short.fixed else others
        return self._charted(tuple(curves), plan, metric, against.how, self._answers(curves), basis)

    def _charted(
        self, curves: tuple[Curve, ...], plan: planner.Plan, metric: str, how: str, answers: tuple[Answer, ...], basis: str
    ) -> Chart:  # fmt: skip
        points = [point for curve in curves for point in curve.points]
        seconds, measured = ([p.seconds.median for p in points], [p.error.median for p in points])
        front, floor = pareto.front(seconds, measured), self.floor.get(metric, 0.0)
        return Chart(
            self.wanted.name, plan["size"], metric, floor, how, curves, front, pareto.knee(front, seconds, measured, floor), self.left_out,
            runs.machine(self.settings), self.versions, self.wanted.target, "", answers, basis,
        )  # fmt: skip

    def _note_skipped(self, active: _SweepProgress) -> None:
        rest = active.sweep.settings[len(active.steps) :]
        if active.skipped and rest:
            skipped = formatting.setting(rest[0]) + (" and what follows" if len(rest) > 1 else "")
            self.left_out[f"{active.name}: {skipped}" if active.steps else active.name] = active.skipped

    def _report_progress(self) -> None:
        total = self.deadline - self.began
        self.progress(min(time.perf_counter() - self.began, total), total)


def _with_size(scene: ir.Scene, settings: ir.Settings) -> ir.Settings:
    """The settings with a size: the given one, else the scene's, reduced so that many renders fit into a minute."""
    if settings.size is not None:
        return settings
    width, height = planner.make_plan(scene, settings)["size"]
    share = min(DEFAULT_WIDTH / max(width, height), 1.0)
    return replace(settings, size=(max(round(width * share), 1), max(round(height * share), 1)))
