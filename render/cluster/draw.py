"""Draws pictures on a cluster: one picture by the tiles of all workers, or whole pictures, each by one worker."""

from __future__ import annotations

import threading

from ...compiler import ir
from ...compiler.plan.plan import Plan
from .. import packing, render_scene
from ..film.checkpoint import Keeper
from ..film.deadline import Deadline
from ..film.progress import Progress, Report
from ..image.image import Image
from ..jit.cancellation import Cancelled
from ..raster import band_renderer
from . import messages
from .dask_cluster import Cluster
from .remote_renderer import RemoteRenderer
from .requests import Request


def draw(
    cluster: Cluster, scene: ir.Scene, plan: Plan, report: Report, cancel: threading.Event, keeper: Keeper | None = None,
    deadline: Deadline | None = None,
) -> Image:  # fmt: skip
    """The picture that render_scene.draw gives, bit for bit but for a deadline. Raises ClusterError, and Cancelled before the first sample.

    The bands of the rasterizer share memory: one worker draws such a picture.
    """
    report(Progress("building"))
    cluster.wait(cancel)
    if is_in_bands(plan):
        report(Progress("rendering"))
        return finish(begin(cluster, scene, plan, cancel))

    def remote(scene: ir.Scene, plan: Plan) -> RemoteRenderer:
        return RemoteRenderer(cluster, scene, plan, cancel)

    return render_scene.draw(scene, plan, report, cancel, keeper, remote=remote, deadline=deadline)


def is_in_bands(plan: Plan) -> bool:
    """Whether the rasterizer draws a picture as a whole."""
    return plan["backend"] == "raster" and band_renderer.can_draw(plan)


def begin(cluster: Cluster, scene: ir.Scene, plan: Plan, cancel: threading.Event) -> Request:
    """Ask for a whole picture, which one worker draws with all its threads."""
    x0, y0, x1, y1 = plan["crop"]
    cost = float((x1 - x0) * (y1 - y0) * plan["samples"])
    return cluster.ask(Request(cluster.work(scene, packing.plan_to(plan)), {"do": "picture"}, {}, cost, cancel))


def finish(request: Request) -> Image:
    """Wait for a picture. Raises ClusterError and Cancelled."""
    answer = request.wait()
    if answer is None:
        raise Cancelled
    return messages.image_from(*answer)
