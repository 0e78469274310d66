"""A scene's chart, measured: its reference, then every ladder of every backend and peer from cheap to dear, within one budget.

The budget bounds all of it. Half goes to the reference (what it lacks is kept on disk and added by the next command); then whoever's
next rung is expected to be cheapest goes first, so that all climb side by side, as far as LEAST runs of each rung fit. What time is
left brings all to GOOD runs, in rounds over all rungs, so that a machine that slows down slows all. Every run has a seed of its own,
which no other and no reference has and which its place on the chart alone decides; its picture is measured, added to sums and not
kept unless asked for.
Only compiling kernels, which happens once, may take more than the budget: half of it is then still spent on measuring.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...render.image import image_files
from .. import formatting
from ..peers import process, registry
from ..records import Chart, NothingMeasured, Reference, Setting, Wanted
from . import contestant, pareto, raw_images, reference, reference_light, runs, setting_ladders, summary
from .contestant import Contestant, Rung

LEAST, GOOD = 5, 16  # runs of a setting: quartiles need the first, bias told from noise the second
OF_REFERENCE = 0.5  # of the budget
RESERVE, MOST_RESERVED = 0.1, 2.5  # of the budget, and seconds of it at the most: for loading before measuring, and drawing after it
BETTER = 16  # times the samples of the dearest rung the reference has at least: its noise then adds 3 % to an error at the most
AIM = 100 * 4096  # samples a pixel of a reference that nothing is added to any more
RUNGS, RUNS = 16, 2048  # of a ladder and of a rung, at the most: room for their seeds
WIDE = 160  # pixels of the longer side where no size was asked for

Progress = Callable[[float, float], None]  # done, of


def measure(scene: ir.Scene, wanted: Wanted, progress: Progress | None = None, cancel: threading.Event | None = None) -> Chart:
    """Measure a chart. `progress(done, total)` is called between renders, never during one; setting `cancel` ends the work.

    Raises NothingMeasured where the budget is too short for anything or `cancel` came before the first point, planner.PlanError
    for a camera that is not there.
    """
    return _Work(scene, wanted, progress or (lambda done, total: None), cancel or threading.Event()).chart()


@dataclass(slots=True, eq=False)
class _Climb:
    """A ladder being climbed."""

    by: Contestant
    ladder: setting_ladders.Ladder
    first: float  # seconds its first rung is expected to take
    number: int  # among all
    rungs: list[Rung] = field(default_factory=list)
    skipped: str = ""  # why the next rung was not measured
    failed: bool = False

    @property
    def name(self) -> str:
        """As in "ray, samples"."""
        return f"{self.ladder.backend}, {self.ladder.name}"

    def place(self, rung: Rung) -> int:
        """Which rung it is, counted from the cheapest."""
        return self.ladder.settings.index(rung.setting)

    def next_setting(self) -> Setting | None:
        """The rung after the last, if there is one."""
        at = len(self.rungs)
        over = self.skipped or self.failed or at == len(self.ladder.settings)
        return None if over else self.ladder.settings[at]

    def expected(self) -> float:
        """Seconds the next rung will take: of the last, rendering grows as its cost does, the rest stays."""
        at, costs = len(self.rungs), self.ladder.costs
        if at == 0:
            return self.first
        last = self.rungs[-1]
        render = last.seconds[-1]
        return last.wall - render + render * costs[at] / costs[at - 1]


class _Work:
    """One measurement under way."""

    def __init__(self, scene: ir.Scene, wanted: Wanted, progress: Progress, cancel: threading.Event) -> None:
        self.began = time.perf_counter()
        self.deadline = self.began + wanted.budget - min(wanted.budget * RESERVE, MOST_RESERVED)
        self.wanted, self.progress, self.cancel = wanted, progress, cancel
        # A chart turns these itself, and what the scene says of them must not end a rung.
        self.scene = replace(scene, settings=replace(scene.settings, samples=None, error=None, budget=None, seed=None))
        self.settings = _sized(self.scene, replace(wanted.settings, backend=None, threads=runs.threads(wanted.settings)))
        common = registry.common(planner.make(self.scene, self.settings)) if wanted.peers else {}
        self.truth = reference_light.of(self.scene, self.settings, common)
        self.left_out: dict[str, str] = {}
        self.versions = runs.versions()
        self.exposure, self.floor = 0.0, dict[str, float]()
        asked = max(wanted.seeds or 0, wanted.repeats or 0)
        self.least, self.good = asked or LEAST, asked or GOOD
        self.keeper = raw_images.Keeper(wanted.keep) if wanted.keep is not None else None

    def chart(self) -> Chart:
        """All of it."""
        plan = self.truth.make(self.scene)
        try:
            contestants = self._contestants(plan)
            starts = [(by, *pair) for by in contestants for pair in zip(by.ladders, by.first, strict=True)]
            climbs = [_Climb(*start, number) for number, start in enumerate(starts)]
            against = self._reference()
        except runs.Cancelled:
            raise NothingMeasured("interrupted before anything was measured") from None
        self.exposure = image_files.metered(against.rgb) if plan["exposure"] == "metered" else float(plan["exposure"])
        self.floor = summary.floor(against, self.exposure)
        try:
            while self._climb(climbs, against):
                self._fill(climbs, against, self.least)
            self._fill(climbs, against, self.good)
        except runs.Cancelled:
            pass  # what was measured until now is charted
        if self.keeper is not None:
            self.keeper.done(against, self.exposure)
        return self._charted(climbs, plan, against)

    # --- who, and against what ------------------------------------------------------------------------------------------

    def _contestants(self, plan: planner.Plan) -> list[Contestant]:
        found = []
        for backend in self.wanted.backends:
            found.append(contestant.ours(self.scene, self.truth, backend, self.cancel))
            self._tell()
        self.deadline = max(self.deadline, time.perf_counter() + 0.5 * self.wanted.budget)
        for peer in registry.find(self.wanted.peers):
            why = contestant.without(peer, self.scene, plan)
            if why:
                self.left_out[peer.name] = why
            else:
                found.append(contestant.peer(peer, self.scene, self.truth))
                self.versions[peer.name] = peer.version
        return found

    def _reference(self) -> Reference:
        seconds = OF_REFERENCE * (self.deadline - time.perf_counter())
        return reference.make(self.scene, self.truth, seconds, AIM, lambda share: self._tell(), self.cancel)

    # --- measuring ------------------------------------------------------------------------------------------------------

    def _climb(self, climbs: list[_Climb], against: Reference) -> bool:
        """A first run of every rung that LEAST runs of are expected to fit, whoever is cheapest first; whether there were any.

        Asked again when those before have their runs, as these may have taken less time than was expected.
        """
        grown = False
        for climb in climbs:
            climb.skipped = ""
        while waiting := [climb for climb in climbs if climb.next_setting() is not None]:
            climb = min(waiting, key=_Climb.expected)
            setting = climb.next_setting()
            assert setting is not None
            climb.skipped = self._too_good(setting, against) or self._too_long(climb, climbs)
            rung = Rung(setting)
            if not climb.skipped and self._run(climb, rung, against):
                climb.rungs.append(rung)
                grown = True
        return grown

    def _too_good(self, setting: Setting, against: Reference) -> str:
        """Why the reference is not good enough to measure a setting; "" where it is.

        Ladders of other knobs are there for their bias, from which the reference's variance is taken anyway.
        """
        samples, enough = against.samples, int(setting.options.get("samples") or 0) * BETTER
        if samples and setting.knob == "error" and setting.value < 4.0 * self.floor.get("relmse", 0.0):
            return f"the reference is only certain to {formatting.error('relmse', self.floor['relmse'])}: a longer --budget improves it"
        if samples and setting.knob == "samples" and enough > samples:
            return f"the reference has only {samples:,} samples: a longer --budget improves it"
        return ""

    def _too_long(self, climb: _Climb, climbs: list[_Climb]) -> str:
        due = sum((self.least - rung.count) * rung.wall for other in climbs for rung in other.rungs)
        expected = climb.expected()
        if time.perf_counter() + due + self.least * expected <= self.deadline:
            return ""
        return f"{self.least} renders of about {formatting.seconds(expected)} do not fit into the budget of {self.wanted.budget:g} s"

    def _fill(self, climbs: list[_Climb], against: Reference, count: int) -> None:
        """Up to `count` runs of each as the time allows, in rounds over all rungs, cheap ones first."""
        rungs = sorted(((climb, rung) for climb in climbs for rung in climb.rungs), key=lambda pair: pair[1].wall)
        for goal in range(2, count + 1):
            for climb, rung in rungs:
                fits = time.perf_counter() + rung.wall <= self.deadline
                if rung.count < goal and not climb.failed and fits:
                    self._run(climb, rung, against)

    def _run(self, climb: _Climb, rung: Rung, against: Reference) -> bool:
        """One more run of a rung; False where its backend failed, which is left out from here on."""
        if self.cancel.is_set():
            raise runs.Cancelled
        seed = (self.wanted.settings.seed or 0) + (climb.number * RUNGS + climb.place(rung)) * RUNS + rung.count
        began = time.perf_counter()
        try:
            run = climb.by.draw(rung.setting, seed % reference.FIRST_SEED)
        except (process.PeerError, planner.PlanError) as problem:
            climb.failed = True
            self.left_out[climb.name] = str(problem)
            return False
        rung.add(run, against, self.exposure, self.wanted.metric)
        if self.keeper is not None:
            self.keeper.run(rung.setting, climb.ladder.name, run, rung.latest)
        rung.wall = time.perf_counter() - began
        self._tell()
        return True

    # --- the chart ------------------------------------------------------------------------------------------------------

    def _charted(self, climbs: list[_Climb], plan: planner.Plan, against: Reference) -> Chart:
        metric, curves = self.wanted.metric, []
        for climb in climbs:
            made = summary.curve(climb.ladder, climb.rungs, metric, against, climb.by.stages)
            if made is not None:
                curves.append(made)
            elif climb.rungs:
                self.left_out[climb.name] = f"its pictures do not have what `{metric}` measures"
            self._say_skipped(climb)
        points = [point for curve in curves for point in curve.points]
        if not points:
            raise NothingMeasured("; ".join(f"{name}: {why}" for name, why in self.left_out.items()) or "no backend was asked for")
        seconds, measured = ([p.seconds.median for p in points], [p.error.median for p in points])
        front = pareto.front(seconds, measured)
        return Chart(
            self.wanted.name, plan["size"], metric, self.floor.get(metric, 0.0), against.how, tuple(curves), front,
            pareto.knee(front, seconds, measured, self.floor.get(metric, 0.0)), self.left_out, runs.machine(self.settings), self.versions,
        )  # fmt: skip

    def _say_skipped(self, climb: _Climb) -> None:
        rest = climb.ladder.settings[len(climb.rungs) :]
        if climb.skipped and rest:
            said = formatting.setting(rest[0]) + (" and what follows" if len(rest) > 1 else "")
            self.left_out[f"{climb.name}: {said}" if climb.rungs else climb.name] = climb.skipped

    def _tell(self) -> None:
        whole = self.deadline - self.began
        self.progress(min(time.perf_counter() - self.began, whole), whole)


def _sized(scene: ir.Scene, settings: ir.Settings) -> ir.Settings:
    """With a size: the one asked for, else the scene's, made so small that many renders fit into a minute."""
    if settings.size is not None:
        return settings
    width, height = planner.make(scene, settings)["size"]
    share = min(WIDE / max(width, height), 1.0)
    return replace(settings, size=(max(round(width * share), 1), max(round(height * share), 1)))
