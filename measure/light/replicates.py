"""Estimates of luminance from independent replicates of a renderer's paths, and the errors that their spread tells.

Each replicate is a randomized quasi-Monte Carlo estimate with a seed of its own (Owen 1997), so that their means are independent and equal
in distribution. An error is the half width of a 95 % confidence interval by Student's t.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...compiler.plan import transport_rules
from ...compiler.plan.plan import Plan
from ...lang.schema.picture_settings import MAX_BOUNCES
from ...materials import traits
from ...render import render_scene
from ...render.film import film as films
from ...render.image import metrics
from ...render.jit import thread_pool
from ...render.simd import target
from ...render.types import Film, Tile, View
from .sensors import BIAS, REPLICATES

QUANTILE = 2.131  # of Student's t with REPLICATES - 1 degrees of freedom: 95 % two-sided
SIDE = 8  # pixels of a tile: small pictures take all threads
FIRST = 32  # samples of a pixel in the first round of a replicate
FEW = 16  # cameras of a group in the first round
MOST = 1 << 14  # samples of a pixel in a replicate
MARGIN = 1.4  # of the light beyond the limit on bounces, whose estimate is noisy and a few percent too small
EACH = 3.0  # times the error of a mean, that is asked for of each pixel
PLAN = {"interreflection": "true", "transport": "path", "transport.path_reuse": "none", "transport.caustics": "paths"}
F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Effort:
    """How long to measure: until the relative `error`, MOST samples, or the time `ends` of time.monotonic."""

    error: float = 0.01
    ends: float = math.inf
    threads: int | None = None
    seed: int = 0

    def share(self, readings: int) -> Effort:
        """The effort for one of some readings, which share the remaining time."""
        now = time.monotonic()
        return replace(self, ends=now + max(self.ends - now, 0.0) / readings)


@dataclass(frozen=True)
class Estimate:
    """Luminance (h, w) in candela a square metre with its error, and that of the mean over pixels."""

    value: F64
    error: F64
    mean: float
    mean_error: float
    samples: int  # of a pixel, of all replicates together


class Sampler:
    """A prepared scene, whose cameras draw replicates of the luminance of pixels."""

    def __init__(self, scene: ir.Scene, settings: ir.Settings, effort: Effort, overrides: Mapping[str, str] | None = None) -> None:
        """`overrides` go over PLAN. Raises planner.PlanError."""
        self._scatters = traits.participates(scene.tables)
        self.most_bounces = transport_rules.MEDIA_BOUNCES if self._scatters else MAX_BOUNCES
        request = replace(
            settings, backend="ray", samples=FIRST, bounces=self.most_bounces, denoise=False, filter="box", aov=(), error=None, budget=None,
            threads=effort.threads, seed=effort.seed,
        )  # fmt: skip
        plain = planner.make_plan(scene, replace(request, seed=0), {"interreflection": "true", "transport": "path"})
        self.lacks_caustics = plain["transport.caustics"] == "photons"
        possible = {name: value for name, value in PLAN.items() if name != "transport.caustics" or self.lacks_caustics}
        self.plan: Plan = planner.make_plan(scene, request, {**possible, **(overrides or {})})
        self.view = View(self.plan["camera"], *self.plan["size"])
        self.effort = effort  # that of the next estimate
        self.threads = int(self.plan["threads"]) or target.cores()
        self._renderer: Any = render_scene.choose_renderer(scene, self.plan, self.view)

    def limit(self, bounces: int) -> None:
        """Set the limit on bounces."""
        self._renderer.limit(bounces)

    def _is_late(self) -> bool:
        """Whether the seconds of the effort are over."""
        return time.monotonic() > self.effort.ends

    def draw(self, camera: int, size: tuple[int, int], crop: tuple[int, int, int, int], seed: int, first: int, count: int) -> F64:
        """(h, w) sums of the luminance of `count` samples from the sample `first` on, of the pixels of a crop of a camera's picture."""
        frame = self._renderer.frame
        frame.put("picture.camera", camera)
        frame.put("options.seed", seed)
        self._renderer.view = View(camera, *size)
        self._renderer.resize(*size)
        x0, y0, x1, y1 = crop
        sums = np.zeros((y1 - y0, x1 - x0))

        def draw(tile: Tile) -> None:
            shape = tile.y1 - tile.y0, tile.x1 - tile.x0
            film = Film(np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, np.int64))
            total = max(first + count, 2)
            self._renderer.sample(tile, np.full(shape, first, np.int64), np.full(shape, count, np.int64), total, film)
            sums[tile.y0 - y0 : tile.y1 - y0, tile.x0 - x0 : tile.x1 - x0] = metrics.luminance(film.color)

        places = films.tiles(crop, SIDE)
        if len(places) == 1:
            draw(places[0])
        else:
            thread_pool.parallel_for(draw, places, self.threads)
        return sums

    def estimate(
        self, cameras: Sequence[int], size: tuple[int, int], crop: tuple[int, int, int, int] | None = None, every: bool = True
    ) -> Estimate:  # fmt: skip
        """The luminance of the pixels of a crop, by default of all; see `replicates`."""
        return self.replicates(cameras, size, crop, every)[0]

    def replicates(
        self, cameras: Sequence[int], size: tuple[int, int], crop: tuple[int, int, int, int] | None = None, every: bool = True
    ) -> tuple[Estimate, F64]:  # fmt: skip
        """The luminance of the pixels of a crop, by default of all, and that of each replicate (REPLICATES, h, w).

        The error asked for is that of the mean; with `every`, EACH times as much is that of each pixel, too.

        Several cameras are REPLICATES groups of equal numbers of them: a replicate is the mean over its group, from its first ones on.
        """
        crop = crop or (0, 0, *size)
        sums = np.zeros((REPLICATES, crop[3] - crop[1], crop[2] - crop[0]))
        most = MOST if len(cameras) == 1 else FIRST * (len(cameras) // REPLICATES)
        count, step = 0, FIRST if len(cameras) == 1 else FEW * FIRST
        while True:
            for k in range(REPLICATES):
                if len(cameras) == 1:
                    sums[k] += self.draw(cameras[0], size, crop, self._seed(k), count, step)
                    continue
                begin = k * (len(cameras) // REPLICATES)
                for camera in cameras[begin + count // FIRST : begin + (count + step) // FIRST]:
                    sums[k] += self.draw(camera, size, crop, self._seed(k) + camera, 0, FIRST)
            count += step
            estimate = as_estimate(sums / count, count)
            cell = float(np.sqrt(np.mean(np.square(estimate.error)))) / EACH if every else 0.0
            if count >= most or self._is_late() or max(cell, estimate.mean_error) <= self.effort.error * estimate.mean:
                return estimate, sums / count
            step = count

    def direct(self, cameras: Sequence[int], size: tuple[int, int], count: int) -> F64:
        """The luminance of each replicate of one camera by `count` samples of direct light alone, with the same random numbers."""
        self.limit(0)
        pictures = [self.draw(cameras[0], size, (0, 0, *size), self._seed(k), 0, count) / count for k in range(REPLICATES)]
        self.limit(self.most_bounces)
        return np.array(pictures)

    def unbounced(self, cameras: Sequence[int], size: tuple[int, int], crop: tuple[int, int, int, int] | None = None) -> float:
        """The share of the mean light that the greatest limit on bounces leaves out.

        The difference of the whole and the half limit tells it. Between surfaces light fades by one factor every half limit. In media that
        absorb little, the light of n collisions fades as n^(−3/2) only: what is beyond the limit is 1/(√2 − 1) of the difference.
        """
        crop, some = crop or (0, 0, *size), list(cameras)[:: max(1, len(cameras) // REPLICATES)]
        light = []
        for bounces in (self.most_bounces, self.most_bounces // 2):
            self.limit(bounces)
            light.append(sum(float(self.draw(c, size, crop, self._seed(k), 0, FIRST).mean()) for k in range(4) for c in some))
        self.limit(self.most_bounces)
        full, half = light
        share = max(1.0 - half / full, 0.0) if full > 0.0 else 0.0
        if self._scatters:
            return MARGIN * share / (math.sqrt(2.0) - 1.0)
        fade = min(share / max(1.0 - share, 1e-9), 0.99)
        return MARGIN * fade**2 / (1.0 - fade**2)

    def _seed(self, replicate: int) -> int:
        return (self.effort.seed * REPLICATES + replicate + 1) * 7919


def as_estimate(means: F64, count: int = 0) -> Estimate:
    """The estimate of the means of replicates (REPLICATES, h, w) of `count` samples each."""
    value, full = means.mean(axis=0), means.mean(axis=(1, 2))
    mean = float(full.mean())
    error = QUANTILE * means.std(axis=0, ddof=1) / math.sqrt(len(means)) + BIAS * np.abs(value)
    mean_error = QUANTILE * float(full.std(ddof=1)) / math.sqrt(len(means)) + BIAS * abs(mean)
    return Estimate(value, error, mean, mean_error, count * len(means))
