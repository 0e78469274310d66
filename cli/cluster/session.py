"""A session on a cluster: draws the pictures of a render job there, and several frames at a time."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import click

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ...lang.diagnostics import Diagnostic
from ...lang.plain_values import time_range
from ...render.cluster import dask_cluster, draw
from ...render.cluster.requests import Request
from ...render.film.checkpoint import Keeper
from ...render.film.deadline import Deadline
from ...render.film.progress import Progress, Report
from ...render.image.image import Image
from ...render.jit.cancellation import Cancelled
from .. import terminal
from ..job import checkpoints
from ..progress import Display
from ..render_job import Frame, Job, Reading


class Session:
    """See render_job.Cluster."""

    def __init__(self, cluster: dask_cluster.Cluster) -> None:
        self._cluster = cluster

    def draw(
        self, scene: ir.Scene, plan: Plan, report: Report, cancel: threading.Event, keeper: Keeper | None = None,
        deadline: Deadline | None = None,
    ) -> Image:  # fmt: skip
        """As render_scene.draw. Raises ClusterError."""
        return draw.draw(self._cluster, scene, plan, report, cancel, keeper, deadline)

    def notes(self) -> list[Diagnostic]:
        """Warnings about workers that draw nothing."""
        return self._cluster.notes()

    def takes_frames(self, job: Job, frames: list[Frame]) -> bool:
        """Whether there are as many frames as workers, and none needs this process: for denoising, or in strips."""
        if len(frames) < 2:
            return False
        with terminal.catch_interrupt() as cancel:
            try:
                self._cluster.wait(cancel)
            except Cancelled:
                raise KeyboardInterrupt from None
        path, _, moment = frames[0]
        first = job.read(path, moment)
        return len(frames) >= self._cluster.workers and len(first.parts) == 1 and first.plan["denoise"] == "off"

    def frames(self, job: Job, frames: list[Frame]) -> list[dict[str, Any]]:
        """Render frames, each on one worker, and write them in order. Returns the statistics of each. Raises KeyboardInterrupt."""
        sent: deque[tuple[Reading, Request]] = deque()
        pictures: list[dict[str, Any]] = []
        began = time.perf_counter()
        checkpoints.tell_of_none(job, "each frame is drawn by one worker", False)

        def take() -> None:
            read, request = sent.popleft()
            job.display.what = self._progress(len(pictures), len(frames), began)
            job.display(Progress("rendering", len(pictures) / len(frames)))
            image = draw.finish(request)
            about = image.metadata  # the budget of a frame is that of its worker: it waited for other frames
            read = read._replace(deadline=Deadline.ended(read.plan["budget"], about["elapsed"], about["elapsed_cpu"]))
            pictures.append(job.summarize(read.path, job.finish(read, image)))

        with terminal.catch_interrupt() as cancel, Display(job.quiet) as job.display:
            try:
                for path, _, moment in frames:
                    read = job.read(path, moment)
                    sent.append((read, draw.begin(self._cluster, read.scene, read.plan, cancel)))
                    while len(sent) >= 2 * max(self._cluster.workers, 1):
                        take()
                while sent:
                    take()
            except Cancelled:
                job.display.hide()
                click.echo(f"interrupted: {len(pictures)} of {len(frames)} frames are there; --resume draws the others", err=True)
                raise KeyboardInterrupt from None
            finally:
                terminal.report(self._cluster.notes())
        return pictures

    def _progress(self, done: int, count: int, began: float) -> str:
        remaining = f", all in {time_range((time.perf_counter() - began) / done * (count - done))}" if done else ""
        workers = self._cluster.workers
        return f"{done} of {count} frames on {workers} worker{'' if workers == 1 else 's'}{remaining}"


@contextmanager
def connect(address: str) -> Iterator[Session]:
    """A session on the cluster of a scheduler's address, or of `local` or `local:N`. Raises ClusterError."""
    with dask_cluster.connect(address) as cluster:
        yield Session(cluster)
