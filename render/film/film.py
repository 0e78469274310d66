"""Film: renders a picture tile by tile on all threads, with progress, cancellation and adaptive rounds.

A tile's samples depend on the tile alone, and decisions are made between rounds, without running threads. So the picture is bit-identical
for any number of threads, except with a budget of seconds.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan import decision
from ...compiler.plan.plan import Plan
from ..image import cryptomatte, image, metrics
from ..image.cryptomatte import Mattes
from ..jit import thread_pool
from ..simd import target
from ..types import Film, FirstHits, Tile, View
from . import accumulate, adaptive_sampling, aov
from .accumulate import PixelErrors, PixelSums
from .progress import Picture, Progress, Report

TILE = 32  # pixels
FIRST = 16  # samples a pixel before the first error estimate
CALL = 64  # samples a pixel of a tile between checks for cancellation and deadline

ESTIMATE = 2.0  # seconds between estimates of the error for callers

Counts = NDArray[np.int64]


class Renderer(Protocol):
    """The interface of a backend to the film."""

    by_tile: bool
    """Whether all pixels of a tile take the same number of samples."""

    block: int
    """Side in pixels of the blocks whose pixels take the same number of samples; 1: each pixel its own."""

    side: int
    """Side of a tile in pixels."""

    @property
    def whole(self) -> Whole | None:
        """The picture, if the backend renders it by itself with fixed samples; None: tile by tile."""
        ...

    @property
    def round(self) -> int | None:
        """Most samples a pixel between two calls of `refresh`; None: samples share nothing, and `refresh` is not called."""
        ...

    @property
    def single(self) -> Callable[[Tile, NDArray[np.float32]], int] | None:
        """Renders a tile of one sample a pixel into (h, w, 4) zeros, and returns the samples left out; None: `sample` does it."""
        ...

    def refresh(self, samples: int) -> None:
        """Recompute the data shared by the samples of a round; `samples` counts those of all pixels."""
        ...

    def continue_from(self, other: Any) -> None:
        """Take over the numbers of rounds from a renderer of the same picture that this one replaces."""
        ...

    def sample(self, tile: Tile, first: Counts, count: Counts, total: int, film: Film) -> None:
        """Add samples first … first + count - 1, (h, w) each, of `total` of every pixel of the tile; a single one lies at the center."""
        ...

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels, (h, w, k) each, at the pixels' centers."""
        ...

    def first(self, tile: Tile, sample: int, total: int) -> FirstHits:
        """Return the first hits of a sample of `total` of each pixel of a tile, in numpy lanes (h · w,)."""
        ...


class Unshared:
    """Base of renderers whose samples share nothing."""

    round: int | None = None
    single: Callable[[Tile, NDArray[np.float32]], int] | None = None

    def refresh(self, samples: int) -> None:
        """Do nothing."""

    def continue_from(self, other: Any) -> None:
        """Do nothing."""


class Whole(Protocol):
    """A picture that a backend renders by itself, in pieces."""

    rgba: NDArray[np.float32]

    half_difference: NDArray[np.float32] | None
    """(h, w, 3) error estimate of `rgba` from halves of the samples; None if there is none."""

    @property
    def jobs(self) -> Sequence[int]:
        """The pieces."""
        ...

    @property
    def error(self) -> float | None:
        """√relMSE from `half_difference`."""
        ...

    def draw(self, job: int) -> int:
        """Render one piece into `rgba`; return how many samples were left out because they were not finite."""
        ...

    def finish(self) -> None:
        """Set `rgba` to 0 where no piece was rendered."""
        ...


def run(
    renderer: Renderer, plan: Plan, view: View, report: Report | None = None, cancel: threading.Event | None = None,
    mattes: Mattes | None = None,
) -> image.Image:  # fmt: skip
    """Render plan["crop"] of a picture to plan["samples"], or until plan["error"] or plan["budget"] ends it.

    `report` is called from this thread; `mattes` are for the channels crypto_….
    Setting `cancel` ends the work; the partial picture is returned, with metadata["partial"]. An exception in a worker is raised here.
    """
    if renderer.whole is not None:
        return _in_pieces(renderer, renderer.whole, plan, view, report, cancel or threading.Event(), mattes)
    started = time.perf_counter()
    canvas = _Canvas(renderer, plan, cancel or threading.Event(), report, mattes)
    if decision.adaptive(plan):
        canvas.adaptive(plan["error"], started + plan["budget"])
    else:
        canvas.fixed()
    return canvas.finish(view)


def tiles(crop: tuple[int, int, int, int], side: int = TILE) -> list[Tile]:
    """Return the tiles of a crop, from the center outwards."""
    x0, y0, x1, y1 = crop
    every = [Tile(x, y, min(x + side, x1), min(y + side, y1)) for y in range(y0, y1, side) for x in range(x0, x1, side)]
    corners = np.array(every)
    away = (corners[:, 0] + corners[:, 2] - x0 - x1) ** 2 + (corners[:, 1] + corners[:, 3] - y0 - y1) ** 2
    return [every[i] for i in np.argsort(away, kind="stable")]


def _in_pieces(
    renderer: Renderer, whole: Whole, plan: Plan, view: View, report: Report | None, cancel: threading.Event, mattes: Mattes | None
) -> image.Image:  # fmt: skip
    """Render a `Whole` picture; other channels are rendered by tiles."""
    x0, y0, x1, y1 = crop = tuple(plan["crop"])
    names = tuple(plan["aov"])
    channels = {"rgba": whole.rgba, **image.blank(x1 - x0, y1 - y0, names)}
    threads = int(plan["threads"]) or target.cores()
    done = issues = 0
    extra = tiles(crop) if names else []
    total = len(whole.jobs) + len(extra)

    samples = int(plan["samples"])

    def count(_: Any, found: int) -> None:
        nonlocal done, issues
        done, issues = done + 1, issues + found
        if report is not None:
            report(Progress("rendering", done / total, samples * done / total, samples))

    def beside(tile: Tile) -> int:
        window = slice(tile.y0 - y0, tile.y1 - y0), slice(tile.x0 - x0, tile.x1 - x0)
        _draw_auxiliary(renderer, tile, {name: channels[name][window] for name in names}, int(plan["samples"]), mattes)
        return 0

    parts: Any = ((whole.draw, whole.jobs), (beside, extra))
    for draw, jobs in parts:
        thread_pool.parallel_for(draw, jobs, threads, cancel, count)
    whole.finish()
    if "samples" in channels:
        channels["samples"][...] = samples
    about: dict[str, Any] = {
        "size": (view.width, view.height), "crop": crop, "samples": samples, "samples_mean": float(samples),
        "error": whole.error if done == total else None, "partial": done < total,
        "variance": None if whole.half_difference is None else np.square(whole.half_difference),
        "rays": samples * (x1 - x0) * (y1 - y0), "issues": issues, "threads": threads,
    }  # fmt: skip
    return image.Image(x1 - x0, y1 - y0, channels, about)


def _draw_auxiliary(renderer: Renderer, tile: Tile, out: dict[str, NDArray[np.float32]], samples: int, mattes: Mattes | None) -> None:
    """Write the auxiliary channels of a tile."""
    names = tuple(name for name in out if name in aov.SEEN)
    if names:
        renderer.channels(tile, names, {name: out[name] for name in names})
    if mattes is not None:
        count = min(samples, cryptomatte.SAMPLES)
        seen = np.stack([renderer.first(tile, s, samples).hit.instance for s in range(count)])
        mattes.put(seen, {name: out[name] for name in mattes.channels})


def _film(tile: Tile) -> Film:
    shape = (tile.y1 - tile.y0, tile.x1 - tile.x0)
    return Film(np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, np.int64))


class _Canvas:
    """A picture that is being rendered."""

    def __init__(
        self, renderer: Renderer, plan: Plan, cancel: threading.Event, report: Report | None, mattes: Mattes | None = None
    ) -> None:  # fmt: skip
        self.mattes = mattes
        self.renderer, self.cancel, self.report = renderer, cancel, report
        self.crop = tuple(plan["crop"])
        self.names = tuple(plan["aov"])
        self.most = int(plan["samples"])
        self.threads = int(plan["threads"]) or target.cores()
        self.width, self.height = self.crop[2] - self.crop[0], self.crop[3] - self.crop[1]
        self.channels = image.blank(self.width, self.height, ("rgba", *self.names))
        several = (self.height, self.width, 3) if self.most > 1 else (0, 0, 3)  # one sample has no error estimate
        self.variance = np.full(several, np.inf)  # of the means; inf after one batch
        self.value = np.zeros(several, np.float32)  # denominator of relative errors
        self.samples = np.zeros((self.height, self.width), np.int64 if self.most > 1 else np.int8)
        self.decline = adaptive_sampling.Decline()
        self.least = 0.0  # ε², after the first round
        self.tiles = tiles(self.crop, renderer.side)
        self.issues = dict.fromkeys(self.tiles, 0)
        self.drawn = dict.fromkeys(self.tiles, 0)  # samples of all pixels
        self.spent = 0  # samples of all finished tiles
        self._local = threading.local()
        self.settled = not decision.adaptive(plan)
        self.error: float | None = None  # √relMSE so far, for `report`
        self.estimate_at = time.perf_counter() + ESTIMATE

    def fixed(self) -> None:
        """Render with the same number of samples for every pixel."""
        if self.renderer.round is not None:
            self._in_rounds(self.renderer.round)
            return
        if self.most == 1:
            self._work(self._draw_single, self.tiles, lambda: self.spent / (self.width * self.height))
            return
        goals = dict.fromkeys(-(-self.most // share) for share in (4, 2, 1))  # one doubling measures the error, two its decline

        def draw(tile: Tile) -> None:
            part = PixelSums.zeros(tile.y1 - tile.y0, tile.x1 - tile.x0)
            for goal in goals:
                self._draw(tile, part, np.full(part.samples.shape, goal))
            self._draw_extras(tile)

        whole = self.most * self.width * self.height
        self._work(draw, self.tiles, lambda: self.spent / whole)

    def _draw_single(self, tile: Tile) -> None:
        """Render a tile of one sample a pixel, with memory of the thread."""
        shape = tile.y1 - tile.y0, tile.x1 - tile.x0
        window = self._window(tile)
        if self.renderer.single is not None:
            self.issues[tile] = self.renderer.single(tile, self.channels["rgba"][window])
        else:
            if getattr(self._local, "shape", None) != shape:
                self._local.shape, self._local.film = shape, _film(tile)
                self._local.counts = np.zeros(shape, np.int64), np.ones(shape, np.int64)
            first, count = self._local.counts
            self.renderer.sample(tile, first, count, 1, self._local.film)
            self.issues[tile] = accumulate.set_first(self._local.film, self.channels["rgba"][window])
        self.samples[window] = 1
        self.drawn[tile] = shape[0] * shape[1]
        self._draw_extras(tile)

    def _in_rounds(self, most: int) -> None:
        """Render all tiles in rounds of equally many samples, with `Renderer.refresh` before each."""
        whole_sums = PixelSums.zeros(self.height, self.width)
        goals = sorted({-(-self.most // share) for share in (4, 2, 1)} | set(range(most, self.most, most)))
        pixels, before = self.width * self.height, 0
        for goal in goals:
            self.renderer.refresh((goal - before) * pixels)

            def draw(tile: Tile, goal: int = goal) -> None:
                part = whole_sums.window(self._window(tile))
                self._draw(tile, part, np.full(part.samples.shape, goal))

            self._work(draw, self.tiles, lambda: self.spent / (self.most * pixels))
            before = goal
        self._work(self._draw_extras, self.tiles, lambda: 1.0)

    def adaptive(self, error: float, deadline: float) -> None:
        """Render in rounds; the pixels of greatest benefit get two or four times their samples."""
        whole_sums = PixelSums.zeros(self.height, self.width)
        first = min(FIRST, self.most)
        began = time.perf_counter()

        def begin(tile: Tile) -> None:
            part = whole_sums.window(self._window(tile))
            for goal in dict.fromkeys((-(-first // 2), first)):
                if goal == first and time.perf_counter() > deadline:
                    break
                self._draw(tile, part, np.full(part.samples.shape, goal))
            self._draw_extras(tile)

        whole = math.inf  # samples at the end, unknown before the first estimate
        rounds: list[tuple[int, float]] = []  # samples and mean of `relative`
        if self.renderer.round is not None:
            self.renderer.refresh(first * whole_sums.samples.size)

        def share() -> float:
            return max(self.spent / whole, (time.perf_counter() - began) / (deadline - began))

        self._work(begin, self.tiles, share)
        blocks = adaptive_sampling.Blocks(self.crop, self.renderer.block)
        while self.most > 1 and not self.cancel.is_set() and (now := time.perf_counter()) < deadline:
            relative = blocks.means(self._relative())
            excess = adaptive_sampling.excess(relative, error) if error > 0.0 else 1.0
            rounds.append((self.spent, float(np.mean(relative))))
            self.error = math.sqrt(rounds[-1][1])
            if excess <= 0.0:
                break
            pace = self.spent / (now - began)
            samples = blocks.means(whole_sums.samples).astype(np.int64)
            goals = blocks.spread(self._goals(relative, samples, excess, (deadline - now) * pace / self.renderer.block**2))
            goals = np.maximum(goals, whole_sums.samples)
            if self.renderer.round is not None:
                self.renderer.refresh(int(np.sum(goals - whole_sums.samples)))
            added = {tile: int(np.sum(goals[self._window(tile)] - whole_sums.samples[self._window(tile)])) for tile in self.tiles}
            more = sorted((tile for tile in self.tiles if added[tile]), key=lambda tile: -added[tile])  # longest first, for load balance
            if not more:
                break

            def draw(tile: Tile, goals: Counts = goals) -> None:
                window = self._window(tile)
                self._double(tile, whole_sums.window(window), goals[window], deadline)

            if error > 0.0:
                expected = adaptive_sampling.expected_samples(rounds, excess)
                whole = max(int(goals.sum()), min(expected, self.most * self.samples.size))
            self._work(draw, more, share)

    def _double(self, tile: Tile, part: PixelSums, goals: Counts, deadline: float) -> None:
        """Render a tile's pixels up to their goals, by doublings."""
        for _ in range(adaptive_sampling.MOST_DOUBLINGS):
            step = np.minimum(goals, 2 * part.samples)
            if np.array_equal(step, part.samples):
                break
            self._draw(tile, part, step, deadline)

    def _goals(self, relative: NDArray[np.float64], samples: Counts, excess: float, affordable: float) -> Counts:
        """Return (h, w) samples of each pixel after the next round, so that `relative` falls by the share `excess`."""
        if self.renderer.by_tile:
            known = relative.copy()
            for tile in self.tiles:
                known[self._window(tile)] = known[self._window(tile)].mean()
        else:
            known = adaptive_sampling.smooth(relative, samples)
        if excess < 1.0:
            doublings = adaptive_sampling.doublings_for_error(known, samples, self.most, excess)
            if np.sum(samples * (2**doublings - 1)) <= affordable:
                return np.minimum(samples * 2**doublings, self.most)
        # A round at most doubles all samples: beyond that, pixels at four times their own leave samples to pixels without need.
        doublings = adaptive_sampling.doublings_for_samples(known, samples, self.most, min(affordable, float(samples.sum())))
        return np.minimum(samples * 2**doublings, self.most)

    def _draw(self, tile: Tile, part: PixelSums, goals: Counts, deadline: float = math.inf) -> None:
        """Render the pixels of a tile up to their goals as one batch; less if cancelled or after the deadline."""
        film, count = _film(tile), goals - part.samples
        start, most = 0, int(count.max(initial=0))
        while start < most and not (self.cancel.is_set() or time.perf_counter() > deadline):
            call = CALL * max(1, count.size // int(np.count_nonzero(count > start)))
            self.renderer.sample(tile, part.samples + start, np.clip(count - start, 0, call), self.most, film)
            start += call
        if start < most:
            count = np.minimum(count, start)
        window = self._window(tile)
        errors = PixelErrors(self.variance[window], self.value[window])
        accumulate.add_samples(film, count, part, errors, self.channels["rgba"][window], self.least, self.decline.of(tile))
        self.samples[window] = part.samples
        self.drawn[tile] = int(part.samples.sum())
        self.issues[tile] = int(part.issues.sum())

    def _draw_extras(self, tile: Tile) -> None:
        if self.names:
            window = self._window(tile)
            _draw_auxiliary(self.renderer, tile, {name: self.channels[name][window] for name in self.names}, self.most, self.mattes)

    def _window(self, tile: Tile) -> tuple[slice, slice]:
        x0, y0 = self.crop[:2]
        return slice(tile.y0 - y0, tile.y1 - y0), slice(tile.x0 - x0, tile.x1 - x0)

    def _relative(self, passing: bool = False) -> NDArray[np.float64]:
        """(h, w) variance / (value² + ε²) of all pixels, ε as in metrics.root_relmse; sets `least`, ε², unless `passing`."""
        rgba = self.channels["rgba"]
        mean = np.einsum("ijk->k", rgba, dtype=np.float64) / (rgba.size // rgba.shape[-1])
        luminance = float(mean[:3] @ metrics.LUMINANCE)
        least = max((metrics.EPSILON * luminance) ** 2, float(np.finfo(np.float64).tiny))
        if not passing:
            self.least = least
        out = np.empty(self.samples.shape)
        accumulate.relative_error(self.variance, self.value, rgba, self.samples, self.decline.shares(), least, out)
        return out

    def _work(self, draw: Callable[[Tile], None], jobs: Sequence[Tile], fraction: Callable[[], float]) -> None:
        """Render tiles on all threads, and report the `fraction` done after each; the first exception is raised here."""
        known = dict(self.drawn)

        def count(tile: Tile, _: None) -> None:
            self.spent += self.drawn[tile] - known[tile]
            self._report(fraction())

        thread_pool.parallel_for(draw, jobs, self.threads, self.cancel, count)

    def _report(self, fraction: float) -> None:
        if self.report is None:
            return
        if self.settled and self.most > 1 and time.perf_counter() > self.estimate_at:
            began = time.perf_counter()
            relative = self._relative(passing=True)
            known = relative[np.isfinite(relative)]
            self.error = math.sqrt(float(np.mean(known))) if known.size else None
            self.estimate_at = 20.0 * time.perf_counter() - 19.0 * began + ESTIMATE  # takes at most 5 % of the time
        samples = self.spent / (self.width * self.height)
        most, picture = self.most if self.settled else 0, Picture(self.channels["rgba"], self.samples)
        self.report(Progress("rendering", min(fraction, 1.0), samples, most, self.error, picture))

    def finish(self, view: View) -> image.Image:
        """Return the picture with its metadata."""
        partial = self.cancel.is_set() and bool(self.samples.min() == 0 or self.samples.min() < self.most)
        error = None
        if self.most > 1 and np.isfinite(self.variance).all():
            error = math.sqrt(float(np.mean(self._relative())))
        self.error = error
        if not partial:
            self._report(1.0)
        rays = int(self.samples.sum() if self.most > 1 else np.count_nonzero(self.samples))
        if "samples" in self.channels:
            self.channels["samples"][..., 0] = self.samples
        if "variance" in self.channels and self.most > 1:
            shares = self.decline.shares()[np.log2(np.maximum(self.samples, 1)).astype(int)]
            known = np.where(np.isfinite(self.variance), self.variance, 0.0) * shares[..., None]
            self.channels["variance"][...] = np.minimum(known, accumulate.LARGEST)
        about: dict[str, Any] = {
            "size": (view.width, view.height), "crop": self.crop, "samples": int(self.samples.max()),
            "samples_mean": rays / self.samples.size, "error": error, "partial": partial,
            "variance": self.variance if self.most > 1 else None,
            "rays": rays, "issues": sum(self.issues.values()), "threads": self.threads,
        }  # fmt: skip
        return image.Image(self.width, self.height, self.channels, about)
