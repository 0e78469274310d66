"""A Dask cluster: two worker processes against one process, and the dispatcher with simulated workers."""

from __future__ import annotations

import heapq
import itertools
import math
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from .. import load
from ..compiler import ir
from ..compiler.plan import plan as planner
from ..render import packing, render_scene
from ..render.cluster import dask_cluster, dispatcher, draw, identity, messages, requests
from ..render.cluster.remote_renderer import MOST
from . import report
from .harness import OURS, Case, Contender, Disagreement, Effort, measure

TEXT = """
The Cornell box by `--cluster local:2`, two processes of one thread, against one process of two threads: the same picture, bit for bit. Both
are started and have their kernels. *Start*: the seconds until two workers are there. *A message*: 1,024 pixels of one sample each, the
wall time of a picture that sends each tile by itself, over its tiles; client and scheduler are one process there.
"""
MODEL = """
**Simulation.** The client's real dispatcher, with simulated workers of one thread and simulated time. {tasks:,} requests, of which
{window:,} are in work at a time; each takes its worker {seconds:g} s on average (log-normal, σ = {spread:g}). Client and scheduler serve
one message at a time, each {cost:.2g} s for a message and its answer: half of *a message* measured. The dispatcher's own processor time
counts as it is. {latency:g} s pass on the network each way. Nothing fails, the scene is there, and all bandwidth is enough. *Busy*: the
share of the workers' time that they draw.
"""
WORKERS = (1, 10, 30, 100, 300, 1000)
TASKS, SECONDS, SPREAD = 100_000, 0.1, 0.5
LATENCY = 0.001  # seconds, of a data centre
HEARTBEAT = 1.0  # seconds
BOX = Path(__file__).resolve().parent / "scenes" / "cornell.scene"


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure two workers, and simulate up to a thousand."""
    result = report.Section("cluster", "A cluster", TEXT)
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
        result.add("One picture", [measure(Case("Cornell box", sides, same), effort)], "", by="wall")
        message = message_seconds(cluster, scene, 256 if quick else 1024)
    result.blocks.append(f"Start: {start:.1f} s. A message: {message * 1e3:.2g} ms.")
    tasks = TASKS // 50 if quick else TASKS
    result.blocks += simulation(tasks, message / 2.0)
    return result


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


class Clock:
    """Simulated time, in place of the module `time`."""

    now = 0.0

    def monotonic(self) -> float:
        return self.now

    perf_counter = monotonic


class Cluster:
    """A scheduler and workers in simulated time; a Wire of the dispatcher. `cost`: seconds of client and scheduler for a message."""

    address = "a simulation"

    def __init__(self, clock: Clock, works: np.ndarray, cost: float) -> None:
        self.events: list[tuple[float, int, Callable[[float], None]]] = []
        self.messages = 0
        self.pace = 0.0  # processor seconds of the dispatcher
        self._clock, self._works, self._cost = clock, works, cost
        self._scheduler = 0.0  # when it is free
        self._workers: dict[str, float] = {}
        self._number = itertools.count()
        self._answers = {"identify": packing.pack(identity.identity()), "offer": packing.pack({"missing": []})}

    def send(self, worker: str, message: bytes, then: Callable[[Any], None]) -> None:
        """See dispatcher.Wire."""
        about, _ = packing.unpack(message)
        seconds, answer = 0.0, self._answers.get(about["do"], b"")
        self.messages += 1
        if about["do"] == "draw":
            seconds = float(sum(self._works[request["number"]] for request in about["requests"]))
            answer = packing.pack({"replies": [{} for _ in about["requests"]], "seconds": seconds})
        self._clock.now += 0.5 * self._cost

        def draw(now: float) -> None:
            self._workers[worker] = done = max(now, self._workers.get(worker, 0.0)) + seconds
            self._forward(done + LATENCY, lambda now: self._take(now, then, answer))

        self._forward(self._clock.now + LATENCY, draw)

    def drop(self, handle: Any) -> None:
        """See dispatcher.Wire."""

    def _later(self, when: float, then: Callable[[float], None]) -> None:
        heapq.heappush(self.events, (when, next(self._number), then))

    def _forward(self, when: float, then: Callable[[float], None]) -> None:
        """Let the scheduler pass a message on."""

        def serve(now: float) -> None:
            self._scheduler = max(now, self._scheduler) + 0.5 * self._cost
            self._later(self._scheduler + LATENCY, then)

        self._later(when, serve)

    def _take(self, now: float, then: Callable[[Any], None], answer: bytes) -> None:
        self._clock.now = max(self._clock.now, now) + 0.5 * self._cost
        self.run(lambda: then(answer))

    def run(self, work: Callable[[], None]) -> None:
        """Let the dispatcher work: its processor time passes in the simulation too."""
        began = time.process_time()
        work()
        cpu_seconds = time.process_time() - began
        self.pace += cpu_seconds
        self._clock.now += cpu_seconds


class Outcome(NamedTuple):
    """What a simulation took."""

    seconds: float
    messages: int
    dispatching: float  # processor seconds of the dispatcher


def simulate(workers: int, cost: float, works: np.ndarray) -> Outcome:
    """Draw all `works`, the seconds of each request, with so many workers."""
    clock = Clock()
    with mock.patch.object(dispatcher, "time", clock), mock.patch.object(requests, "time", clock):
        cluster = Cluster(clock, works, cost)
        dispatch = dispatcher.Dispatcher(cluster)
        work = requests.Work(messages.Parcel("scene", [], {}), [])
        waiting = (requests.Request(work, {"do": "batch", "number": k}, {}, 1.0) for k in range(len(works)))
        heard = -HEARTBEAT
        while True:
            if clock.now >= heard + HEARTBEAT:
                heard = clock.now
                heartbeats = {f"w{k}": (1, heard, False) for k in range(workers)}
                cluster.run(lambda heartbeats=heartbeats: dispatch.update(heartbeats))
            for request in itertools.islice(waiting, MOST - len(dispatch.requests)):
                dispatch.ask(request)
            if not dispatch.requests:
                return Outcome(clock.now, cluster.messages, cluster.pace)
            cluster.run(dispatch.tick)
            until = max(clock.now, min(cluster.events[0][0] if cluster.events else math.inf, heard + HEARTBEAT))
            clock.now = until
            while cluster.events and cluster.events[0][0] <= until:
                now, _, then = heapq.heappop(cluster.events)
                then(now)


def simulation(tasks: int, cost: float) -> list[str]:
    """The table of busy workers, and the model."""
    sigma = SPREAD
    works = np.random.default_rng(1).lognormal(math.log(SECONDS) - 0.5 * sigma * sigma, sigma, tasks)
    rows = []
    for workers in WORKERS:
        outcome = simulate(workers, cost, works)
        busy = float(works.sum()) / (workers * outcome.seconds)
        each = f"{1e3 * outcome.dispatching / outcome.messages:.2f} ms"
        rows.append((f"{workers:,}", f"{outcome.seconds:,.0f} s", f"{100.0 * busy:.1f} %", f"{outcome.messages:,}", each))
    about = MODEL.format(tasks=tasks, window=MOST, seconds=SECONDS, spread=sigma, cost=cost, latency=LATENCY)
    return [about.strip(), report.grid(("workers", "time", "busy", "messages", "dispatcher, a message"), rows)]
