"""A Dask cluster: two worker processes against one process, and a simulation of many workers with the measured costs of messages."""

from __future__ import annotations

import heapq
import math
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from .. import load
from ..compiler import ir
from ..compiler.plan import plan as planner
from ..render import render_scene
from ..render.cluster import dask_cluster, dispatcher, draw
from . import report
from .harness import OURS, Case, Contender, Disagreement, Effort, measure

TEXT = """
The Cornell box by `--cluster local:2`, two processes of one thread, against one process of two threads: the same picture, bit for bit. Both
are started and have their kernels. *Start*: the seconds until two workers are there. *A message*: 1,024 pixels of one sample each, the
wall time of a picture that sends each tile by itself, over its tiles; client and scheduler are one process there.
"""
MODEL = """
**Simulation.** {tasks:,} requests; each takes its worker {seconds:g} s on average (log-normal, σ = {spread:g}). Client and scheduler serve
one message at a time, each {cost:.2g} s for a message and its answer: half of *a message* measured. {latency:g} s pass on the network
each way. A worker has one thread, and one message more than it draws. Nothing fails, the scene is there, and all bandwidth is enough.
*Busy*: the share of the workers' time that they draw. *{aim:g} s*: requests go together in messages of that much work, at most a fair
share; *single*: one by one.
"""
WORKERS = (1, 10, 30, 100, 300, 1000)
TASKS, SECONDS, SPREAD = 100_000, 0.1, 0.5
LATENCY = 0.001  # seconds, of a data centre
SEND, FORWARD, DRAW, ANSWER, TAKE = range(5)  # stages of a message: client, scheduler, worker, scheduler, client
STAGES = 5
BOX = Path(__file__).resolve().parent / "scenes" / "cornell.scene"


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure two workers, and simulate up to a thousand."""
    found = report.Section("cluster", "A cluster", TEXT)
    side, samples = (48, 8) if quick else (512, 2048)  # a minute on two cores
    scene = load(BOX)
    began = time.perf_counter()
    with dask_cluster.connect("local:2") as cluster:
        cluster.wait(threading.Event())
        start = time.perf_counter() - began
        plan = planner.make_plan(scene, ir.Settings(size=(side, side), samples=samples, bounces=6, backend="ray", threads=2, denoise=False))
        sides = [
            Contender(OURS, lambda: _draw(cluster, scene, plan), np.asarray, note="two workers"),
            Contender("one process", lambda: render_scene.draw(scene, plan), np.asarray),
        ]
        found.add("One picture", [measure(Case("Cornell box", sides, same), effort)], "", by="wall")
        message = message_seconds(cluster, scene, 256 if quick else 1024)
    found.blocks.append(f"Start: {start:.1f} s. A message: {message * 1e3:.2g} ms.")
    tasks = TASKS // 50 if quick else TASKS
    found.blocks += simulation(tasks, message / 2.0)
    return found


def _draw(cluster: dask_cluster.Cluster, scene: ir.Scene, plan: Any) -> Any:
    return draw.draw(cluster, scene, plan, lambda _: None, threading.Event())


def same(answers: Mapping[str, Any]) -> str:
    """Check that the pictures are equal bit for bit."""
    first, *others = answers.values()
    if any(not np.array_equal(first, other) for other in others):
        raise Disagreement("the cluster's picture differs from that of one process")
    return "the same, bit for bit"


def message_seconds(cluster: dask_cluster.Cluster, scene: ir.Scene, side: int) -> float:
    """The wall time of a message of one tile with one sample a pixel, where the messages follow each other as fast as they can."""
    plan = planner.make_plan(scene, ir.Settings(size=(side, side), samples=1, bounces=0, backend="ray", denoise=False))
    _draw(cluster, scene, plan)
    with mock.patch.object(dispatcher, "AIM", 0.0), mock.patch.object(dispatcher, "COALESCE", 0.0):
        began = time.perf_counter()
        _draw(cluster, scene, plan)
        return (time.perf_counter() - began) / math.ceil(side / 32) ** 2


# --- simulation ------------------------------------------------------------------------------------------------------------


class Model(NamedTuple):
    """A cluster of equal workers of one thread."""

    workers: int
    cost: float  # seconds of the client, and of the scheduler, for a message and its answer
    aim: float  # seconds of work in a message; 0: one request
    latency: float = LATENCY


class Server:
    """Serves one piece of work after the other, in the order in which they come."""

    def __init__(self) -> None:
        self.free = 0.0

    def serve(self, now: float, cost: float) -> float:
        """The time at which a piece of work that comes now is done."""
        self.free = max(self.free, now) + cost
        return self.free


def simulate(model: Model, works: np.ndarray) -> float:
    """The seconds until all `works`, the seconds of each request, are done."""
    client, scheduler, workers = Server(), Server(), [Server() for _ in range(model.workers)]
    most = max(1, round(model.aim / float(works.mean())))
    events = [(0.0, k, SEND, k % model.workers, 0.0) for k in range(2 * model.workers)]  # time, number, stage, worker, seconds of work
    number, at, now = len(events), 0, 0.0
    while events:
        now, _, stage, worker, work = heapq.heappop(events)
        if stage == SEND:
            if at == len(works):
                continue
            count = min(most, max(1, (len(works) - at) // model.workers))
            work, at = float(works[at : at + count].sum()), at + count
            now = client.serve(now, 0.5 * model.cost) + model.latency
        elif stage in (FORWARD, ANSWER):
            now = scheduler.serve(now, 0.5 * model.cost) + model.latency
        elif stage == DRAW:
            now = workers[worker].serve(now, work) + model.latency
        else:
            now = client.serve(now, 0.5 * model.cost)
        number += 1
        heapq.heappush(events, (now, number, (stage + 1) % STAGES, worker, work))
    return now


def simulation(tasks: int, cost: float) -> list[str]:
    """The table of busy workers, and the model."""
    sigma = SPREAD
    works = np.random.default_rng(1).lognormal(math.log(SECONDS) - 0.5 * sigma * sigma, sigma, tasks)
    rows = []
    for workers in WORKERS:
        busy = [float(works.sum()) / (workers * simulate(Model(workers, cost, aim), works)) for aim in (dispatcher.AIM, 0.0)]
        rows.append((f"{workers:,}", *(f"{100.0 * share:.1f} %" for share in busy)))
    about = MODEL.format(tasks=tasks, seconds=SECONDS, spread=sigma, cost=cost, latency=LATENCY, aim=dispatcher.AIM)
    return [about.strip(), report.grid(("workers", f"busy, {dispatcher.AIM:g} s", "busy, single"), rows)]
