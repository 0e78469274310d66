"""Who is measured on which settings: our backends and peers behind one door, and what each setting has shown so far."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ...compiler import ir
from ...compiler.plan import plan as planner
from .. import errors
from ..peers.registry import Peer
from ..records import Reference, Run, Setting, Spread
from . import bias, runs, setting_ladders
from .reference_light import Truth

Draw = Callable[[Setting, int], Run]  # a setting and a seed
FEW = 3
WARM = 32  # pixels square of the first render of a backend, which compiles its kernels or loads them


@dataclass(frozen=True, slots=True, eq=False)
class Contestant:
    """A backend or a peer: its ladders, how it draws, and the seconds the first rung of each ladder is expected to take (`first`)."""

    name: str
    ladders: tuple[setting_ladders.Ladder, ...]
    draw: Draw
    first: tuple[float, ...] = ()
    stages: dict[str, float] = field(default_factory=dict)  # seconds paid once a process, or with kernels that are not compiled yet


@dataclass(slots=True, eq=False)
class Rung:
    """A setting and its runs: figures of each, and sums of their pictures."""

    setting: Setting
    seconds: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    stages: list[dict[str, float]] = field(default_factory=list)
    errors: dict[str, list[float]] = field(default_factory=dict)
    sums: bias.Sums = field(default_factory=bias.Sums)
    latest: dict[str, float] = field(default_factory=dict)  # errors of the last run
    notes: tuple[str, ...] = ()
    wall: float = 0.0  # of the last run with measuring it: what another will take

    @property
    def count(self) -> int:
        """Runs so far."""
        return len(self.seconds)

    def add(self, run: Run, reference: Reference, exposure: float, metric: str) -> None:
        """Take in a run and measure it. FLIP, unless it is the metric charted, is measured of the first FEW runs alone."""
        with_flip = metric == "flip" or self.count < FEW
        measured = errors.measures(run.rgb, run.alpha, reference.rgb, reference.alpha, exposure, with_flip)
        self.seconds.append(run.seconds["render"])
        self.cpu.append(run.cpu)
        self.stages.append(dict(run.seconds))
        self.latest = measured
        for name, value in measured.items():
            self.errors.setdefault(name, []).append(value)
        self.sums.add(run.rgb)
        self.notes = run.notes

    def seconds_of(self, stage: str) -> float:
        """Median over the runs."""
        return float(np.median([s.get(stage, 0.0) for s in self.stages]))


def spread(values: list[float]) -> Spread:
    """Median and quartiles; where some are endless, those values that are nearest."""
    method = "linear" if np.isfinite(values).all() else "nearest"
    low, median, high = (float(np.quantile(values, q, method=method)) for q in (0.25, 0.5, 0.75))
    return Spread(median, low, high, len(values))


def ours(scene: ir.Scene, light: Truth, backend: str, cancel: threading.Event) -> Contestant:
    """One of our backends, warmed up: its kernels are compiled and loaded. Raises runs.Cancelled."""

    def draw(setting: Setting, seed: int) -> Run:
        return runs.run(scene, runs.plan_of(scene, light.settings, setting, seed), cancel)

    ladders = tuple(setting_ladders.ladders(scene, light, backend))
    crop = light.make(scene)["crop"]
    middle = _middle(crop)
    share = (crop[2] - crop[0]) * (crop[3] - crop[1]) / ((middle[2] - middle[0]) * (middle[3] - middle[1]))

    def warm(ladder: setting_ladders.Ladder) -> dict[str, float]:
        cheapest = ladder.settings[0]
        part = replace(cheapest, options={**cheapest.options, "crop": middle})
        return dict(runs.run(scene, runs.plan_of(scene, light.settings, part, 0), cancel).seconds)

    stages = {"import": runs.import_seconds(), "compile_kernels": warm(ladders[0])["compile_kernels"]}
    first = [warm(ladder) for ladder in ladders]
    return Contestant(backend, ladders, draw, tuple(s["build"] + s["render"] * share for s in first), stages)


def peer(of: Peer, scene: ir.Scene, light: Truth) -> Contestant:
    """A peer that is installed and can express the scene."""
    plan = light.make(scene, threads=runs.threads(light.settings))
    settings = of.ladder(scene, plan)
    costs = tuple(float(s.value) for s in settings)

    def draw(setting: Setting, seed: int) -> Run:
        return of.run(scene, plan, setting, seed)

    return Contestant(of.name, (setting_ladders.Ladder(of.name, settings[0].knob, settings, costs, ""),), draw, (0.0,))


def without(peer: Peer, scene: ir.Scene, plan: planner.Plan) -> str:
    """Why a peer is not measured; "" where it is."""
    if peer.missing:
        return peer.missing
    lost = peer.express(scene, plan)
    return "; ".join(lost)


def _middle(crop: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """At most WARM by WARM pixels in the middle."""
    x0, y0, x1, y1 = crop
    width, height = min(x1 - x0, WARM), min(y1 - y0, WARM)
    left, top = (x0 + x1 - width) // 2, (y0 + y1 - height) // 2
    return left, top, left + width, top + height
