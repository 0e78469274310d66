"""Filling a picture: tiles from one queue, threads, progress, cancelling, and how many samples each tile needs.

A tile's samples depend on nothing but the tile, and decisions are taken between rounds, when all threads are done: the picture
is the same bit for bit with any number of threads (a budget of seconds apart, which the clock ends).
"""

from __future__ import annotations

import math
import os
import queue
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..compiler.plan import Plan
from . import image, metrics
from .records import Film, Tile, View

TILE = 32  # pixels
BATCH = 4  # samples whose mean is one draw of the error estimate, at the least
ROUND = 2  # batches in which an adaptive round is drawn
FIRST = 16  # samples before the error is asked for the first time
BATCHES = 8  # into which a fixed number of samples is parted, to know its error

Progress = Callable[[int, int], None]


class Renderer(Protocol):
    """What a backend gives the film."""

    def sample(self, tile: Tile, first: int, count: int, total: int, film: Film) -> None:
        """Add samples first … first + count - 1 of `total` of every pixel of the tile; one in all is the pixel's centre."""
        ...

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels, (h, w, k) each, as seen at the pixels' centres."""
        ...


def run(renderer: Renderer, plan: Plan, view: View, progress: Progress | None = None, cancel: threading.Event | None = None) -> image.Image:
    """Draw plan["crop"] of a picture to plan["samples"], or until plan["error"] or plan["budget"] ends it.

    `progress(done, total)` in tiles is called from this thread. Setting `cancel` ends the work; what is done is returned, with
    metadata["partial"]. An exception in a worker is raised here.
    """
    started = time.perf_counter()
    canvas = _Canvas(renderer, plan, cancel or threading.Event(), progress)
    if plan["error"] > 0.0 or math.isfinite(plan["budget"]):
        canvas.adaptive(plan["error"], started + plan["budget"])
    else:
        canvas.fixed()
    return canvas.finish(view)


def tiles(crop: tuple[int, int, int, int]) -> list[Tile]:
    """The tiles of a crop, from the middle outwards."""
    x0, y0, x1, y1 = crop
    every = [Tile(x, y, min(x + TILE, x1), min(y + TILE, y1)) for y in range(y0, y1, TILE) for x in range(x0, x1, TILE)]
    corners = np.array(every)
    away = (corners[:, 0] + corners[:, 2] - x0 - x1) ** 2 + (corners[:, 1] + corners[:, 3] - y0 - y1) ** 2
    return [every[i] for i in np.argsort(away, kind="stable")]


@dataclass(eq=False)
class _Sums:
    """What a tile's samples add up to, and how far the means of the last round's batches lie apart (Welford's way, weighed by samples).

    Sobol points make the mean of many samples better than so many means of few: the larger the batches, the nearer the
    estimate is to the true error, from above. So each round forgets the smaller batches of the one before.
    """

    film: Film
    latest: NDArray[np.float64]  # (h, w, 3) sum of the last round's samples
    apart: NDArray[np.float64]  # (h, w, 3)
    samples: int = 0
    recent: int = 0  # samples in the last round
    batches: int = 0  # in the last round

    @classmethod
    def of(cls, tile: Tile) -> _Sums:
        shape = (tile.y1 - tile.y0, tile.x1 - tile.x0, 3)
        return cls(_film(tile), np.zeros(shape), np.zeros(shape))

    def begin(self) -> None:
        """Start a round."""
        self.latest[:], self.apart[:] = 0.0, 0.0
        self.recent = self.batches = 0

    def add(self, batch: Film, count: int) -> None:
        """Take in a batch of `count` samples a pixel."""
        mean = batch.color / count
        before = mean - self.latest / max(self.recent, 1)
        self.film.color[:] += batch.color
        self.film.alpha[:] += batch.alpha
        self.film.issues[:] += batch.issues
        self.latest += batch.color
        self.samples += count
        self.recent += count
        self.batches += 1
        if self.batches > 1:
            self.apart += count * before * (mean - self.latest / self.recent)

    def variance(self) -> NDArray[np.float64]:
        """(h, w, 3) of the pixels' means; inf after a single batch, which says nothing."""
        if self.batches < 2:
            return np.full(self.apart.shape, np.inf)
        return np.maximum(self.apart, 0.0) / (self.samples * (self.batches - 1))


def _film(tile: Tile) -> Film:
    shape = (tile.y1 - tile.y0, tile.x1 - tile.x0)
    return Film(np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, np.int64))


class _Canvas:
    """A picture being drawn."""

    def __init__(self, renderer: Renderer, plan: Plan, cancel: threading.Event, progress: Progress | None) -> None:
        self.renderer, self.cancel, self.progress = renderer, cancel, progress
        self.crop = tuple(plan["crop"])
        self.names = tuple(plan["aov"])
        self.most = int(plan["samples"])
        self.threads = int(plan["threads"]) or os.cpu_count() or 1
        self.width, self.height = self.crop[2] - self.crop[0], self.crop[3] - self.crop[1]
        self.channels = image.blank(self.width, self.height, ("rgba", *self.names))
        self.variance = np.full((self.height, self.width, 3), np.inf, np.float32) if self.most > 1 else None
        self.tiles = tiles(self.crop)
        self.counts = dict.fromkeys(self.tiles, 0)
        self.issues = dict.fromkeys(self.tiles, 0)
        self.spent = 0.0  # samples drawn, in tiles
        self.shown = 0  # tiles, as last told to `progress`

    def fixed(self) -> None:
        """The same number of samples for every pixel; sums live only while their tile is drawn."""
        batch = -(-self.most // BATCHES)

        def draw(tile: Tile) -> None:
            self._draw(tile, _Sums.of(tile), self.most, batch)
            self._extras(tile)

        self._work(draw, self.tiles, lambda: self.spent / (self.most * len(self.tiles)))

    def adaptive(self, error: float, deadline: float) -> None:
        """Rounds, each of twice the samples of the one before, over the tiles whose error is above what was asked."""
        sums = {tile: _Sums.of(tile) for tile in self.tiles}
        first = min(FIRST if math.isinf(deadline) else BATCH, self.most)
        goal, active, ahead = first, self.tiles, float(first * len(self.tiles))
        while active and not self.cancel.is_set():

            def draw(tile: Tile, goal: int = goal, late: bool = goal > first) -> None:
                if late and time.perf_counter() > deadline:
                    return
                self._draw(tile, sums[tile], goal, max(BATCH, (goal - sums[tile].samples) // ROUND))
                if not late:
                    self._extras(tile)

            before, began = self.spent, time.perf_counter()
            self._work(draw, active, lambda whole=self.spent + ahead: self.spent / max(whole, self.spent))
            now = time.perf_counter()
            if now >= deadline or goal == self.most:
                break
            if error > 0.0 and goal >= min(FIRST, self.most):
                relative = self._relative()
                shares = {tile: float(np.mean(relative[self._window(tile)])) for tile in active}
                if float(np.mean(relative)) <= error * error:
                    break
                active = [tile for tile in active if shares[tile] > error * error]
                ahead = sum(min(shares[tile] / error**2 * goal, self.most) - goal for tile in active)
            if math.isfinite(deadline):
                pace = (now - began) / max(self.spent - before, 1e-9)
                ahead = (deadline - now) / pace
                affordable = int(ahead / len(active)) // BATCH * BATCH if active else 0
                goal = min(goal + max(min(goal, affordable), BATCH), self.most)
            else:
                goal = min(2 * goal, self.most)

    def _draw(self, tile: Tile, sums: _Sums, goal: int, batch: int) -> None:
        """Bring a tile to `goal` samples, in a round of its own, and show what it has."""
        sums.begin()
        while sums.samples < goal and not (self.cancel.is_set() and sums.samples):
            count = min(batch, goal - sums.samples)
            film = _film(tile)
            self.renderer.sample(tile, sums.samples, count, self.most, film)
            sums.add(film, count)
        window = self._window(tile)
        self.channels["rgba"][(*window, slice(0, 3))] = sums.film.color / sums.samples
        self.channels["rgba"][(*window, 3)] = sums.film.alpha / sums.samples
        if self.variance is not None:
            self.variance[window] = sums.variance()
        self.counts[tile] = sums.samples
        self.issues[tile] = int(sums.film.issues.sum())

    def _extras(self, tile: Tile) -> None:
        if self.names:
            window = self._window(tile)
            self.renderer.channels(tile, self.names, {name: self.channels[name][window] for name in self.names})

    def _window(self, tile: Tile) -> tuple[slice, slice]:
        x0, y0 = self.crop[:2]
        return slice(tile.y0 - y0, tile.y1 - y0), slice(tile.x0 - x0, tile.x1 - x0)

    def _relative(self) -> NDArray[np.float64]:
        """(h, w, 3) variance / (value² + ε²) of what has been drawn, ε as in metrics.root_relmse."""
        value = self.channels["rgba"][..., :3].astype(np.float64)
        epsilon = metrics.EPSILON * float(metrics.luminance(value).mean())
        below = value**2 + epsilon**2
        return self.variance / np.where(below > 0.0, below, 1.0)

    def _work(self, draw: Callable[[Tile], None], jobs: Iterable[Tile], fraction: Callable[[], float]) -> None:
        """Draw tiles on all threads; `fraction` of the whole is told on after each. The first exception ends it, here."""
        take, lock = iter(jobs), threading.Lock()
        stop = threading.Event()
        results: queue.SimpleQueue[tuple[Tile | None, BaseException | None]] = queue.SimpleQueue()

        def loop() -> None:
            try:
                while not (stop.is_set() or self.cancel.is_set()):
                    with lock:
                        tile = next(take, None)
                    if tile is None:
                        break
                    draw(tile)
                    results.put((tile, None))
            except BaseException as problem:  # whatever it is, it is raised in the caller's thread
                stop.set()
                results.put((None, problem))
            else:
                results.put((None, None))

        workers = [threading.Thread(target=loop, name=f"tiles {k}", daemon=True) for k in range(self.threads)]
        failure: BaseException | None = None
        known = dict(self.counts)
        try:
            for worker in workers:
                worker.start()
            running = len(workers)
            while running:
                tile, problem = results.get()
                if tile is None:
                    running -= 1
                    failure = failure or problem
                    continue
                self.spent += self.counts[tile] - known[tile]
                self._tell(fraction())
        finally:
            stop.set()
            for worker in workers:
                worker.join()
        if failure is not None:
            raise failure

    def _tell(self, fraction: float) -> None:
        done = int(min(fraction, 1.0) * len(self.tiles) + 1e-9)
        if self.progress is not None and done > self.shown:
            self.progress(done, len(self.tiles))
            self.shown = done

    def finish(self, view: View) -> image.Image:
        """The picture with what is known about it."""
        counts = list(self.counts.values())
        partial = self.cancel.is_set() and (min(counts) == 0 or min(counts) < self.most)
        error = None
        if self.variance is not None and np.isfinite(self.variance).all():
            error = math.sqrt(float(np.mean(self._relative())))
        if not partial:
            self._tell(1.0)
        rays = sum(n * (t.x1 - t.x0) * (t.y1 - t.y0) for t, n in self.counts.items())
        about: dict[str, Any] = {
            "size": (view.width, view.height), "crop": self.crop, "samples": max(counts), "samples_mean": rays / (self.width * self.height),
            "error": error, "variance": self.variance, "partial": partial,
            "rays": rays, "issues": sum(self.issues.values()), "threads": self.threads,
        }  # fmt: skip
        return image.Image(self.width, self.height, self.channels, about)
