"""Backends and peers as contestants with one interface, and the accumulated runs of a setting."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ...compiler import ir
from ...compiler.plan import plan as planner
from .. import errors
from ..metric_table import METRICS
from ..peers.registry import Peer
from ..records import Reference, Run, Setting, Spread
from . import bias, runs, setting_sweeps
from .reference_light import ReferenceLight

Draw = Callable[[Setting, int], Run]  # a setting and a seed
FLIP_RUNS = 3
WARMUP_SIZE = 32  # pixels: side of a backend's first render, which compiles or loads its kernels


@dataclass(frozen=True, slots=True, eq=False)
class Contestant:
    """A backend or a peer: its sweeps, its `draw`, and the expected seconds of each sweep's first step (`first`)."""

    name: str
    sweeps: tuple[setting_sweeps.Sweep, ...]
    draw: Draw
    first: tuple[float, ...] = ()
    stages: dict[str, float] = field(default_factory=dict)  # seconds of stages that a process runs once: import, compilation


@dataclass(slots=True, eq=False)
class Step:
    """A setting with the figures of its runs and the statistics of their pictures."""

    setting: Setting
    seconds: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    samples: list[float] = field(default_factory=list)  # mean of a pixel
    stages: list[dict[str, float]] = field(default_factory=list)
    errors: dict[str, list[float]] = field(default_factory=dict)
    sums: bias.RunningStats = field(default_factory=bias.RunningStats)
    latest: dict[str, float] = field(default_factory=dict)  # errors of the last run
    notes: tuple[str, ...] = ()
    wall: float = 0.0  # seconds of the last run and its measurement; the estimate for another

    @property
    def count(self) -> int:
        """The number of runs."""
        return len(self.seconds)

    def add(self, run: Run, reference: Reference, exposure: float, metric: str) -> None:
        """Add and measure a run. Unless FLIP is the charted metric, only the first FLIP_RUNS runs have it."""
        with_slow = METRICS[metric].slow or self.count < FLIP_RUNS
        measured = errors.measures(run.rgb, run.alpha, reference.rgb, reference.alpha, exposure, with_slow)
        self.seconds.append(run.seconds["render"])
        self.cpu.append(run.cpu)
        self.samples.append(run.samples)
        self.stages.append(dict(run.seconds))
        self.latest = measured
        for name, value in measured.items():
            self.errors.setdefault(name, []).append(value)
        self.sums.add(run.rgb)
        self.notes = run.notes

    def seconds_of(self, stage: str) -> float:
        """The median seconds of a stage."""
        return float(np.median([s.get(stage, 0.0) for s in self.stages]))


def spread(values: list[float]) -> Spread:
    """Median and quartiles; nearest values where some are not finite."""
    method = "linear" if np.isfinite(values).all() else "nearest"
    low, median, high = (float(np.quantile(values, q, method=method)) for q in (0.25, 0.5, 0.75))
    return Spread(median, low, high, len(values))


def backend_contestant(scene: ir.Scene, light: ReferenceLight, backend: str, cancel: threading.Event, imports: bool = True) -> Contestant:
    """One of our backends after a warm-up render, with kernels compiled and loaded. Raises runs.Cancelled.

    Without `imports`, the time of importing is not measured, and 0.
    """

    def draw(setting: Setting, seed: int) -> Run:
        return runs.run(scene, runs.make_plan(scene, light.settings, setting, seed), cancel)

    sweeps = tuple(setting_sweeps.sweeps(scene, light, backend))
    crop = light.plan(scene)["crop"]
    middle = _center_crop(crop)
    share = (crop[2] - crop[0]) * (crop[3] - crop[1]) / ((middle[2] - middle[0]) * (middle[3] - middle[1]))

    def warm(sweep: setting_sweeps.Sweep) -> dict[str, float]:
        cheapest = sweep.settings[0]
        part = replace(cheapest, options={**cheapest.options, "crop": middle})
        return dict(runs.run(scene, runs.make_plan(scene, light.settings, part, 0), cancel).seconds)

    stages = {"import": runs.import_seconds() if imports else 0.0, "compile_kernels": warm(sweeps[0])["compile_kernels"]}
    first = [warm(sweep) for sweep in sweeps]
    return Contestant(backend, sweeps, draw, tuple(s["build"] + s["render"] * share for s in first), stages)


def peer_contestant(peer: Peer, scene: ir.Scene, light: ReferenceLight) -> Contestant:
    """An installed peer that supports the scene."""
    plan = light.plan(scene, threads=runs.threads(light.settings))
    settings = peer.sweep(scene, plan)
    costs = tuple(float(s.value) for s in settings)

    def draw(setting: Setting, seed: int) -> Run:
        return peer.run(scene, plan, setting, seed)

    return Contestant(peer.name, (setting_sweeps.Sweep(peer.name, settings[0].knob, settings, costs, ""),), draw, (0.0,))


def unsupported_reason(peer: Peer, scene: ir.Scene, plan: planner.Plan) -> str:
    """The reason why a peer is not measured; "" if it is."""
    if peer.missing:
        return peer.missing
    lost = peer.unsupported(scene, plan)
    return "; ".join(lost)


def _center_crop(crop: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """The crop of at most WARMUP_SIZE × WARMUP_SIZE pixels at the centre."""
    x0, y0, x1, y1 = crop
    width, height = min(x1 - x0, WARMUP_SIZE), min(y1 - y0, WARMUP_SIZE)
    x, y = (x0 + x1 - width) // 2, (y0 + y1 - height) // 2
    return x, y, x + width, y + height
