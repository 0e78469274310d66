"""RemoteRenderer: a renderer of the film whose tiles are drawn by the workers of a cluster."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import channels, decision
from ...compiler.plan.plan import Plan
from .. import packing
from ..backends import light_groups
from ..film import tile_calls
from ..film.remote import Remote
from ..image.image import Image
from ..jit.cancellation import Cancelled
from ..types import Film, Tile
from . import messages
from .dask_cluster import Cluster
from .requests import Request

LEAST, EACH, MOST = 128, 64, 4096  # tiles in work at a time: at least, for each thread of the workers, at most
GRACE = 1.0  # seconds after a deadline in which samples drawn before it arrive

Counts = NDArray[np.int64]


class RemoteRenderer(Remote):
    """See film.Renderer."""

    def __init__(self, cluster: Cluster, scene: ir.Scene, plan: Plan, cancel: threading.Event | None) -> None:
        self._cluster, self._cancel = cluster, cancel
        self._work = cluster.work(scene, packing.plan_to(plan))
        self._sums = light_groups.Sums(plan) if channels.light_groups(plan) else None
        self._setting: list[Any] = [None, 0, -1]  # of worker.Setting
        self._next: Request | None = None  # for the state after this round
        answer = self._ask({"do": "facts"}, {}, 1.0).wait()
        if answer is None:
            raise Cancelled
        facts, _ = answer
        self.by_tile, self.cell, self.side, self.round = facts["by_tile"], facts["cell"], facts["side"], facts["round"]
        self._shared: tuple[int, ...] = tuple(facts["shared"])
        self._tile_by_tile = self.round is None and not decision.adaptive(plan)  # tiles that are begun come first, and are whole sooner
        self.threads = min(max(LEAST, EACH * cluster.threads), MOST)

    @property
    def unproved(self) -> int:
        """See Remote. Tiles that were drawn twice count twice."""
        return self._cluster.unproved(self._work)

    def refresh(self, samples: int) -> None:
        """See film.Renderer. Each worker makes the data of the round when it draws the first tile."""
        self._setting = [self.shared(), samples, -1]
        self._next = self._ask({"do": "refresh"}, {}, 1.0)

    def shared(self) -> tuple[int, ...]:
        """See film.Renderer."""
        if self._next is not None:
            answer, self._next = self._next.wait(), None
            self._shared = self._shared if answer is None else tuple(answer[0]["shared"])
        return self._shared

    def share(self, state: tuple[int, ...]) -> None:
        """See film.Renderer."""
        self._shared, self._next = state, None

    def limit(self, bounces: int) -> None:
        """Set the limit on bounces."""
        self._setting = [*self._setting[:2], bounces]

    def sample(self, tile: Tile, first: Counts, count: Counts, total: int, film: Film) -> None:
        """Add samples to the film, and to the sums of light groups; see film.Renderer."""
        answer = self._ask_samples("sample", tile, first, count, total, {}).wait()
        if answer is None:
            return
        _, arrays = answer
        _add(film, arrays)
        if self._sums is not None:
            groups = {name.removeprefix(channels.LIGHT): light for name, light in arrays.items() if name.startswith(channels.LIGHT)}
            self._sums.add(tile, count, groups)

    def batch(self, tile: Tile, first: Counts, count: Counts, total: int, film: Film, deadline: float) -> int:
        """See Remote. Light groups add each call's samples by themselves, as one process does."""
        if self._sums is not None:
            return tile_calls.draw_batch(self, tile, first, count, total, film, lambda: self._is_over(deadline))
        begun = self._tile_by_tile and bool(first.any())
        answer = self._ask_samples("batch", tile, first, count, total, {"seconds": None}, deadline, begun).wait()
        if answer is None:
            return 0
        about, arrays = answer
        _add(film, arrays)
        return about["reached"]

    def auxiliary(self, tile: Tile, out: dict[str, NDArray[np.float32]], samples: int) -> None:
        """See Remote."""
        pixels = (tile.x1 - tile.x0) * (tile.y1 - tile.y0)
        about = {"do": "auxiliary", "tile": list(tile), "names": list(out), "samples": samples}
        answer = self._ask(about, {}, pixels).wait()
        for name, array in () if answer is None else answer[1].items():
            out[name][...] = array

    def guides(self, tile: Tile, count: int, total: int) -> NDArray[Any]:
        """See Remote."""
        shape = tile.y1 - tile.y0, tile.x1 - tile.x0
        answer = self._ask({"do": "guides", "tile": list(tile), "count": count, "total": total}, {}, shape[0] * shape[1] * count).wait()
        return np.zeros((2, *shape, 3)) if answer is None else answer[1]["guides"]

    def put(self, image: Image) -> None:
        """Write the channels of light groups; see light_groups.Sums."""
        assert self._sums is not None
        self._sums.put(image)

    def _is_over(self, deadline: float) -> bool:
        return time.perf_counter() > deadline or (self._cancel is not None and self._cancel.is_set())

    def _ask_samples(
        self, kind: str, tile: Tile, first: Counts, count: Counts, total: int, more: dict[str, Any], deadline: float = math.inf,
        urgent: bool = False,
    ) -> Request:  # fmt: skip
        starts, numbers = messages.counts_to("first", first), messages.counts_to("samples", count)
        about = {"do": kind, "tile": list(tile), "total": total, **starts[0], **numbers[0], **more}
        return self._ask(about, starts[1] | numbers[1], float(count.sum()), deadline, urgent)

    def _ask(
        self, about: dict[str, Any], arrays: packing.Arrays, cost: float, deadline: float = math.inf, urgent: bool = False
    ) -> Request:  # fmt: skip
        about["setting"] = self._setting
        request = Request(self._work, about, arrays, cost, self._cancel, deadline + GRACE)
        request.urgent = urgent
        return self._cluster.ask(request)


def _add(film: Film, arrays: packing.Arrays) -> None:
    for name, sums in film._asdict().items():
        if name in arrays:
            sums += arrays[name]
