"""Dispatcher: gives requests to workers, and gives them again to others where workers die, stall or are slow. It knows nothing of Dask.

Requests about one picture go together in messages of about `AIM` seconds. The last ones of a round go to a second worker too, if the first
takes long (backup tasks: Dean and Ghemawat, MapReduce, 2004). All that happens is an event of one thread.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from ...lang.diagnostics import Diagnostic
from .. import packing
from . import identity, messages
from .requests import ClusterError, Request, Work

AIM = 0.5  # seconds of a message's work
COALESCE = 0.02  # seconds that a request waits for others if no thread of a worker is idle
BACKUP = 4.0  # times its expected duration, after which a message is sent to a second worker
LEAST = 2.0  # seconds before that
SILENCE = 15.0  # seconds without a heartbeat after which a worker counts as stalled
CHECK = 0.2  # seconds between two looks for requests that nobody waits for
PATIENCE = 30.0  # seconds without a worker after which the render ends
TRIES = 3  # of a request that ends in an error
LOSSES = 10  # workers that end while they have the same request, which then is the cause


class Wire(Protocol):
    """Sends messages to workers; see dask_pool.py."""

    address: str

    def send(self, worker: str, message: bytes, then: Callable[[Any], None]) -> Any:
        """Send a message; `then` receives the answer as bytes, or an exception, as an event of the dispatcher. Returns a handle."""
        ...

    def drop(self, handle: Any) -> None:
        """Tell that an answer is not wanted any more."""
        ...


class Lost(Exception):
    """The worker ended before it answered."""


class Unreadable(Exception):
    """The worker cannot answer any message: it has no maquette, or another one."""


@dataclass(eq=False)
class Parcelled:
    """Requests in one message to a worker."""

    worker: Worker
    requests: list[Request]
    cost: float
    began: float = 0.0
    handle: Any = None
    counts: bool = True  # in `Request.running`: not of a worker that stalls


@dataclass(eq=False)
class Worker:
    """A worker as the dispatcher knows it."""

    address: str
    threads: int
    state: str = "new"  # then "asked"; then "ready" or "refused"
    running: list[Parcelled] = field(default_factory=list)
    scenes: dict[str, str] = field(default_factory=dict)  # by parcel: "sending", "ready"
    waiting: list[Parcelled] = field(default_factory=list)  # for their scene
    last_seen: float = 0.0  # of the scheduler's clock
    heard: float = 0.0  # when that changed
    paused: bool = False
    silent: bool = False

    @property
    def usable(self) -> bool:
        """Whether it gets requests."""
        return self.state == "ready" and not self.silent and not self.paused

    @property
    def load(self) -> int:
        """Messages that it has."""
        return len(self.running) + len(self.waiting)

    def room(self, entire: bool) -> bool:
        """Whether it takes another message: one more than its threads do at a time, so that none waits for the network."""
        if entire:
            return self.load < (2 if self.threads == 1 else 1)
        return self.load < 2 * self.threads and not any(p.requests[0].whole for p in (*self.running, *self.waiting))


class Dispatcher:
    """The state of a cluster, and what happens at each event. For one thread."""

    def __init__(self, wire: Wire) -> None:
        self.wire, self.client = wire, identity.identity()
        self.workers: dict[str, Worker] = {}
        self.pending: deque[Request] = deque()
        self.requests: set[Request] = set()  # without an answer
        self.notes: dict[str, Diagnostic] = {}  # about workers, by reason
        self.unproved: dict[tuple[str, str], int] = {}  # rays, by parcel and worker
        self.fault: ClusterError | None = None
        self.alive = time.monotonic()  # when a worker was usable
        self.ever = False  # whether one was
        self.reached = time.monotonic()  # when the scheduler last answered
        self._pace: dict[str, float] = {}  # seconds a sample, by kind of request
        self._checked = 0.0  # when requests that nobody waits for were last looked for

    # --- events ---

    def ask(self, request: Request) -> None:
        """Take a request."""
        if self.fault is not None:
            request.finish(None, self.fault)
            return
        self.requests.add(request)
        if request.urgent:
            self.pending.appendleft(request)
        else:
            self.pending.append(request)

    def update(self, reported: Mapping[str, tuple[int, float, bool]]) -> None:
        """Take the workers that the scheduler knows: (threads, time of the last heartbeat, whether it is paused)."""
        now = self.reached = time.monotonic()
        for address in self.workers.keys() - reported.keys():
            self._lose(self.workers.pop(address))
        for address, (threads, seen, paused) in reported.items():
            worker = self.workers.setdefault(address, Worker(address, threads, heard=now))
            worker.threads, worker.paused = threads, paused
            if seen != worker.last_seen:
                worker.last_seen, worker.heard = seen, now
            silent = now - worker.heard > SILENCE + 0.02 * len(reported)
            if silent and not worker.silent:
                self._again([*worker.running, *worker.waiting])
            worker.silent = silent
            if worker.state == "new":
                worker.state = "asked"
                self.wire.send(address, packing.pack({"do": "identify"}), lambda answer, worker=worker: self._identified(worker, answer))

    def tick(self) -> None:
        """Do what is due: end requests that nobody waits for, give a cluster up, send requests."""
        now = time.monotonic()
        if now - self._checked > CHECK:
            self._checked, moment = now, time.perf_counter()
            for request in [request for request in self.requests if request.is_unwanted(moment)]:
                self._finish(request, None)
        if any(worker.usable for worker in self.workers.values()):
            self.alive, self.ever = now, True
        if now - min(self.alive, self.reached) > PATIENCE and self.fault is None:
            self.end(self._no_worker())
        self._dispatch()

    def end(self, fault: ClusterError) -> None:
        """Answer all requests, now and later, with an error."""
        self.fault = self.fault or fault
        for request in list(self.requests):
            self._finish(request, None, fault)
        self.pending.clear()

    # --- workers ---

    def _identified(self, worker: Worker, answer: Any) -> None:
        if isinstance(answer, Unreadable):
            worker.state = "refused"
            why = f"cannot draw ({answer})"
            self._note(worker, why, f"install maquette {self.client['maquette']} with the extra `cluster` there")
            return
        if isinstance(answer, Exception):
            worker.state = "new"  # asked again, if it is still there
            return
        about, _ = packing.unpack(answer)
        why, hint = identity.difference(about, self.client)
        worker.state = "refused" if why else "ready"
        if why:
            self._note(worker, why, hint)

    def _note(self, worker: Worker, why: str, hint: str) -> None:
        self.notes.setdefault(why, Diagnostic("warning", f"worker {worker.address} {why}: it draws nothing", None, hint))

    def _no_worker(self) -> ClusterError:
        """The reason why no worker draws."""
        fix = f"start {'others' if self.workers else 'some'} with `dask worker {self.wire.address}`"
        refused = [note.message for note in self.notes.values()]
        if time.monotonic() - self.reached > PATIENCE:
            return ClusterError(f"the scheduler {self.wire.address} does not answer any more")
        if self.ever:
            return ClusterError(f"no worker of {self.wire.address} {'answers' if self.workers else 'is left'}: {fix}")
        if refused:
            return ClusterError(f"{self.wire.address} has no worker that can draw this picture: {refused[0]}")
        if self.workers:
            return ClusterError(f"no worker of {self.wire.address} answers: {fix}")
        return ClusterError(f"{self.wire.address} has no workers: {fix}")

    def _lose(self, worker: Worker) -> None:
        """Give the requests of a worker that ended to others."""
        lost = [*worker.running, *worker.waiting]
        for parcelled in worker.running:
            self.wire.drop(parcelled.handle)
            for request in parcelled.requests:
                request.losses += 1
                if request.losses >= LOSSES:
                    why = f"{LOSSES} workers ended while they drew the same part of the picture, often for want of memory: see their logs"
                    self._finish(request, None, ClusterError(why))
        worker.running, worker.waiting, worker.state = [], [], "lost"
        self._again(lost)

    def _again(self, lost: Iterable[Parcelled]) -> None:
        """Queue the requests of messages without answers, before others, unless another worker has them."""
        for parcelled in lost:
            for request in reversed(parcelled.requests):
                request.running -= parcelled.counts
                if not request.done and not request.running and request not in self.pending:
                    self.pending.appendleft(request)
            parcelled.counts = False

    # --- messages ---

    def _dispatch(self) -> None:
        now = time.perf_counter()
        free = sorted((w for w in self.workers.values() if w.usable), key=lambda w: w.load / w.threads)
        for worker in free:
            while self.pending:
                first = self.pending[0]
                if first.done:
                    self.pending.popleft()
                    continue
                if not worker.room(first.whole):
                    break
                if worker.load >= worker.threads and not first.whole and now - first.asked < COALESCE and len(self.pending) < 64:
                    break
                self._assign(worker, self._take(first))
            if not self.pending and worker.load < worker.threads:
                self._back_up(worker)

    def _take(self, first: Request) -> list[Request]:
        """Requests from the queue for one message: of one picture and kind, for about AIM seconds and a fair share of the threads."""
        pace, threads = self._pace.get(first.kind), sum(w.threads for w in self.workers.values() if w.usable)
        most = 1 if first.whole or pace is None else max(1, len(self.pending) // max(threads, 1))
        batch, cost = [], 0.0
        while self.pending and len(batch) < most and (not batch or (cost + self.pending[0].cost) * (pace or 0.0) <= AIM):
            request = self.pending[0]
            if request.done:
                self.pending.popleft()
                continue
            if request.kind != first.kind or request.work is not first.work:
                break
            batch.append(self.pending.popleft())
            cost += request.cost
        return batch

    def _assign(self, worker: Worker, requests: list[Request]) -> None:
        """Send requests to a worker, after the scene if it lacks that."""
        parcelled = Parcelled(worker, requests, sum(request.cost for request in requests), time.perf_counter())
        for request in requests:
            request.running += 1
        parcel = requests[0].work.parcel
        if worker.scenes.get(parcel.key) == "ready":
            self._send(parcelled)
            return
        worker.waiting.append(parcelled)
        if parcel.key not in worker.scenes:
            worker.scenes[parcel.key] = "sending"
            offer = packing.pack({"do": "offer", "scene": parcel.key, "rows": parcel.rows})
            self.wire.send(worker.address, offer, lambda answer: self._offered(worker, parcel, answer))

    def _offered(self, worker: Worker, parcel: messages.Parcel, answer: Any) -> None:
        """Send the arrays of a scene that a worker lacks, in parts."""
        about = self._read(worker, parcel, answer)
        if about is None:
            return
        parts = [(digest, start) for digest in about["missing"] for start in range(0, parcel.arrays[digest].nbytes or 1, messages.PART)]
        self._send_parts(worker, parcel, deque(parts))

    def _send_parts(self, worker: Worker, parcel: messages.Parcel, parts: deque[tuple[str, int]], answer: Any = b"") -> None:
        """Send the next part, after the last one has arrived; then the requests that wait for the scene."""
        if answer and self._read(worker, parcel, answer) is None:
            return
        if parts:
            digest, start = parts.popleft()
            array = parcel.arrays[digest]
            part = array.reshape(-1).view("uint8")[start : start + messages.PART] if array.size else array.view("uint8")
            about = {"do": "keep", "hash": digest, "dtype": array.dtype.str, "shape": array.shape, "start": start}
            message = packing.pack(about, {"part": part})
            self.wire.send(worker.address, message, lambda answer: self._send_parts(worker, parcel, parts, answer))
            return
        worker.scenes[parcel.key] = "ready"
        ready = [p for p in worker.waiting if p.requests[0].work.parcel.key == parcel.key]
        worker.waiting = [p for p in worker.waiting if p not in ready]
        for parcelled in ready:
            self._send(parcelled)

    def _read(self, worker: Worker, parcel: messages.Parcel, answer: Any) -> dict[str, Any] | None:
        """The data of an answer about a scene; None after an error, which the requests that wait for the scene get."""
        if worker.state != "ready":
            return None
        about = {"error": str(answer)} if isinstance(answer, Exception) else packing.unpack(answer)[0]
        if "error" not in about:
            return about
        del worker.scenes[parcel.key]
        failed = [p for p in worker.waiting if p.requests[0].work.parcel.key == parcel.key]
        worker.waiting = [p for p in worker.waiting if p not in failed]
        for parcelled in failed:
            self._fail(parcelled, None if isinstance(answer, Lost) else about["error"])
        return None

    def _send(self, parcelled: Parcelled) -> None:
        worker, now = parcelled.worker, time.perf_counter()
        work: Work = parcelled.requests[0].work
        requests = [
            request.about | ({"seconds": _left(request, now)} if "seconds" in request.about else {}) for request in parcelled.requests
        ]
        arrays = {f"{k}.{name}": array for k, request in enumerate(parcelled.requests) for name, array in request.arrays.items()}
        about = {"do": "draw", "scene": work.parcel.key, "plan": work.plan, "threads": worker.threads, "requests": requests}
        parcelled.began = now
        worker.running.append(parcelled)
        parcelled.handle = self.wire.send(worker.address, packing.pack(about, arrays), lambda answer: self._answered(parcelled, answer))

    def _answered(self, parcelled: Parcelled, answer: Any) -> None:
        worker = parcelled.worker
        if parcelled not in worker.running:
            return  # of a worker that was lost
        worker.running.remove(parcelled)
        if isinstance(answer, Exception):
            self._fail(parcelled, None if isinstance(answer, Lost) else str(answer))
            return
        about, arrays = packing.unpack(answer)
        if "error" in about:
            self._fail(parcelled, about["error"])
            return
        if about.get("missing"):
            worker.scenes.pop(parcelled.requests[0].work.parcel.key, None)
            self._fail(parcelled, None)
            return
        first = parcelled.requests[0]
        self._learn(first.kind, about["seconds"] / max(parcelled.cost, 1.0))
        key = first.work.parcel.key, worker.address
        self.unproved[key] = max(self.unproved.get(key, 0), about.get("unproved", 0))
        for k, (request, reply) in enumerate(zip(parcelled.requests, about["replies"], strict=True)):
            request.running -= parcelled.counts
            start = f"{k}."
            self._finish(request, (reply, {name.removeprefix(start): a for name, a in arrays.items() if name.startswith(start)}))

    def _fail(self, parcelled: Parcelled, error: str | None) -> None:
        """Queue the requests of a message without an answer again; after TRIES errors they end with it."""
        for request in parcelled.requests:
            request.failures += error is not None
            if request.failures >= TRIES:
                self._finish(request, None, ClusterError(f"worker {parcelled.worker.address}: {error}"))
        self._again([parcelled])

    def _finish(self, request: Request, answer: Any, fault: ClusterError | None = None) -> None:
        request.finish(answer, fault)
        self.requests.discard(request)

    def _learn(self, kind: str, pace: float) -> None:
        before = self._pace.get(kind)
        self._pace[kind] = pace if before is None else 0.8 * before + 0.2 * pace

    # --- backup ---

    def _back_up(self, worker: Worker) -> None:
        """Send the message that has been on its way longest to an idle worker too, if it takes longer than expected."""
        now = time.perf_counter()
        for other in self.workers.values():
            for parcelled in (*other.running, *other.waiting):
                pace = self._pace.get(parcelled.requests[0].kind)
                requests = [request for request in parcelled.requests if not request.done and request.running < 2]
                if other is worker or pace is None or not requests:
                    continue
                if now - parcelled.began > max(LEAST, BACKUP * pace * parcelled.cost) and worker.room(requests[0].whole):
                    self._assign(worker, requests)
                    return


def _left(request: Request, now: float) -> float | None:
    """Seconds until a request's deadline; None: no deadline."""
    return None if request.deadline == float("inf") else max(request.deadline - now, 0.0)
