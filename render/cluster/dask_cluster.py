"""A Dask cluster: connects to a scheduler or starts one, and runs the dispatcher in a thread. Only this file uses Dask."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import queue
import signal
import threading
import time
import uuid
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from multiprocessing import resource_tracker
from typing import Any

from ...compiler import ir
from ...compiler.io import child_process
from ...lang.diagnostics import Diagnostic
from ...lang.distribution import install_command
from .. import packing
from ..jit.cancellation import Cancelled
from ..simd import target
from . import messages
from .dispatcher import Dispatcher, Lost, Unreadable
from .requests import ClusterError, Request, Work

LOCAL = "local"
SERVE = f"__import__('{__package__}.worker', fromlist=['serve']).serve(message)"
"""The task of a message. Dask ends a worker that cannot import a task's function; this one it can, and the error comes as an answer."""
POLL = 0.5  # seconds between two looks at the list of workers
CONNECT = 10.0  # seconds to connect to a scheduler
LATE = 3.0  # seconds that `wait` waits for a second worker


class Cluster:
    """The workers of a scheduler. Thread-safe."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self.address = client, address
        self._events: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._dispatcher = Dispatcher(self)
        self._closed = threading.Event()
        self._last: tuple[ir.Scene, messages.Parcel] | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self._start(self._poll())

    @property
    def threads(self) -> int:
        """Threads of all workers that draw."""
        return sum(worker.threads for worker in list(self._dispatcher.workers.values()) if worker.usable)

    @property
    def workers(self) -> int:
        """Workers that draw."""
        return sum(worker.usable for worker in list(self._dispatcher.workers.values()))

    def work(self, scene: ir.Scene, plan: list[list[Any]]) -> Work:
        """A picture to ask for."""
        if self._last is None or self._last[0] is not scene:
            self._last = scene, messages.parcel(scene)
        return Work(self._last[1], plan)

    def ask(self, request: Request) -> Request:
        """Send a request."""
        self._events.put(partial(self._dispatcher.ask, request))
        return request

    def unproved(self, work: Work) -> int:
        """Rays of a picture's workers that could not be proved; see render_scene.count_unproved."""
        return sum(count for (key, _), count in list(self._dispatcher.unproved.items()) if key == work.parcel.key)

    def wait(self, cancel: threading.Event) -> None:
        """Wait until workers can draw. Raises ClusterError if none can, and Cancelled."""
        first = math.inf
        while (fault := self._dispatcher.fault) is None:
            if cancel.is_set():
                raise Cancelled
            states = [(worker.usable, worker.state in ("new", "asked")) for worker in list(self._dispatcher.workers.values())]
            usable, unknown = any(is_usable for is_usable, _ in states), any(is_unknown for _, is_unknown in states)
            first = min(first, time.monotonic()) if usable else math.inf
            if usable and (not unknown or time.monotonic() - first > LATE):
                return
            time.sleep(0.02)
        raise fault

    def notes(self) -> list[Diagnostic]:
        """Warnings about workers that draw nothing."""
        return list(self._dispatcher.notes.values())

    def close(self) -> None:
        """End the thread."""
        self._closed.set()
        self._thread.join()

    # --- the dispatcher's thread ---

    def _run(self) -> None:
        try:
            while not self._closed.is_set():
                with contextlib.suppress(queue.Empty):
                    self._events.get(timeout=0.01 if self._dispatcher.pending else 0.1)()
                    while True:
                        self._events.get_nowait()()
                self._dispatcher.tick()
        except BaseException as fault:  # otherwise callers would wait for ever
            self._dispatcher.end(ClusterError(f"internal error of the cluster's client: {type(fault).__name__}: {fault}"))
            raise
        finally:
            self._dispatcher.end(ClusterError("the cluster was closed"))

    def send(self, worker: str, message: bytes, then: Callable[[Any], None]) -> Any:
        """See dispatcher.Wire."""
        future = self._client.submit(eval, SERVE, {"message": message}, key=f"maquette-{uuid.uuid4().hex}", workers=[worker], pure=False)
        self._start(self._follow(future, then))
        return future

    def drop(self, handle: Any) -> None:
        """See dispatcher.Wire."""
        self._start(self._cancel(handle))

    # --- Dask's thread ---

    def _start(self, work: Any) -> None:
        asyncio.run_coroutine_threadsafe(work, self._client.loop.asyncio_loop)

    async def _follow(self, future: Any, then: Callable[[Any], None]) -> None:
        from distributed import KilledWorker

        try:
            answer = await future.result()
            packing.unpack(answer)  # raises for what no worker of ours has sent
        except (asyncio.CancelledError, CancelledError, KilledWorker, OSError, TimeoutError) as fault:
            answer = Lost(str(fault))
        except Exception as fault:
            answer = Unreadable(f"{type(fault).__name__}: {fault}".splitlines()[0])
        self._events.put(partial(then, answer))

    async def _cancel(self, future: Any) -> None:
        with contextlib.suppress(Exception):
            await self._client.cancel([future], asynchronous=True)

    async def _poll(self) -> None:
        while not self._closed.is_set():
            workers: dict[str, Any] = {}
            with contextlib.suppress(OSError, AttributeError):  # without a connection, which Dask tries to make again
                workers = (await self._client.scheduler.identity(n_workers=-1))["workers"]
                rows = {name: (w["nthreads"], w["last_seen"], w["status"] != "running") for name, w in workers.items()}
                self._events.put(partial(self._dispatcher.update, rows))
            await asyncio.sleep(max(POLL, 0.005 * len(workers)))


@contextmanager
def connect(address: str) -> Iterator[Cluster]:
    """The cluster of a scheduler, tcp://host:8786, or one that is started: local or local:N, with N workers. Raises ClusterError."""
    try:
        import distributed
        from distributed.versions import VersionMismatchWarning
    except ImportError:
        raise ClusterError(f"--cluster needs Dask: {install_command('cluster')}") from None
    for logger in ("asyncio", "tornado", "distributed", "distributed.client"):  # Dask's configuration gives the second its own level
        logging.getLogger(logger).setLevel(logging.CRITICAL)
    warnings.filterwarnings("ignore", message="Sending large graph", category=UserWarning)
    warnings.filterwarnings("ignore", category=VersionMismatchWarning)  # identity.difference says more
    with contextlib.ExitStack() as stack:
        if address.partition(":")[0] == LOCAL:
            started = stack.enter_context(_start_local(workers_of(address)))
            client = stack.enter_context(distributed.Client(started, set_as_default=False))
        else:
            try:
                asyncio.run(_handshake(address))
                client = stack.enter_context(distributed.Client(address, timeout=CONNECT, set_as_default=False))
            except Exception as fault:
                raise ClusterError(f"no scheduler answers at {address}: {_reason(address, fault)}") from None
        cluster = Cluster(client, address)
        try:
            yield cluster
        finally:
            cluster.close()


async def _handshake(address: str) -> None:
    """Connect to a scheduler once, within a time limit. Dask's client waits without end for the handshake of another server."""
    from distributed import Security
    from distributed.comm.core import connect

    sent = connect(address, timeout=CONNECT, **Security().get_connection_args("client"))
    (await asyncio.wait_for(sent, CONNECT + 1)).abort()


def _reason(address: str, fault: Exception) -> str:
    """Why no scheduler answers."""
    if isinstance(fault, TypeError) and address.startswith("tls:"):
        return "Dask's configuration has no certificates: see https://distributed.dask.org/en/stable/tls.html"
    if isinstance(fault, (OSError, ValueError)) and (lines := str(fault).splitlines()):
        return lines[0]
    return "something else listens there, or it is stopped"


def workers_of(address: str) -> int:
    """N of local:N; of local one for each four cores, but at least two. Raises ClusterError."""
    _, colon, number = address.partition(":")
    if colon and not (number.isdecimal() and 1 <= int(number) <= 1024):
        raise ClusterError(f"--cluster {address}: write {LOCAL} or {LOCAL}:N with the number of workers, such as {LOCAL}:4")
    return int(number) if colon else max(2, target.cores() // 4)


def _start_local(workers: int) -> Any:
    """A scheduler in this process and worker processes, which talk by TLS: nobody else on the machine can send them work.

    Worker processes inherit that SIGINT is blocked: Ctrl-C, which a terminal sends to them too, is for this process.
    """
    import distributed

    threads = math.ceil(target.cores() / workers)
    options: dict[str, Any] = {"dashboard_address": "127.0.0.1:0", "memory_limit": 0, "silence_logs": logging.CRITICAL}
    with child_process.isolated():
        resource_tracker.ensure_running()  # otherwise it is started with the first worker, and unblocks SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if hasattr(signal, "pthread_sigmask") else None
    try:
        with child_process.isolated():
            return distributed.LocalCluster(
                n_workers=workers, threads_per_worker=threads, security=distributed.Security.temporary(), **options
            )  # fmt: skip
    finally:
        if before is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
