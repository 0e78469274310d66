"""Refinement: renders a canvas in rounds, until an error is reached or a budget is spent.

Without a budget the rounds depend on the samples alone. With one, the first passes take 1, 2, 4 … samples of each pixel, and the clock
is read before each call of the renderer: the work ends within a call of the deadline. A call that it stops is whole, so each pixel has the
mean of its own number of samples, which time decides and not their light.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..types import Tile
from . import adaptive_sampling
from .accumulate import PixelSums
from .canvas import Canvas
from .deadline import Deadline
from .tile_calls import Counts
from .tile_queue import Batches


class Refinement:
    """The rounds of a picture."""

    def __init__(self, canvas: Canvas, error: float, deadline: Deadline, grants: bool = False) -> None:
        """`error` is the √relMSE that ends the rounds; 0: the deadline or the most samples end them.

        With `grants` each pixel has a sample in any case, otherwise those of the tile in the middle.
        """
        self.canvas, self.error, self.deadline = canvas, error, deadline
        canvas.deadline, canvas.grants = deadline, grants
        self.began = deadline.clock()
        self.whole = math.inf  # samples at the end, unknown before the first estimate
        self.sums = canvas.sums = canvas.sums or PixelSums.zeros(canvas.height, canvas.width)

    def run(self) -> None:
        """Render in rounds; the pixels of greatest benefit get two or four times their samples."""
        canvas, whole_sums, error = self.canvas, self.sums, self.error
        rounds = [(int(spent), float(mean)) for spent, mean in canvas.round.get("rounds", [])]  # samples, mean of `relative`
        started = canvas.round.get("goals")  # of a round that a checkpoint interrupted
        if started is None:
            canvas.refresh(canvas.first * whole_sums.samples.size)
        self._begin()
        cells = adaptive_sampling.Cells(canvas.crop, canvas.renderer.cell)
        least = min(2, canvas.most)
        while canvas.most > 1 and not canvas.cancel.is_set() and not self.deadline.is_over() and whole_sums.samples.min() >= least:
            again = started is not None
            if started is None:
                relative = cells.means(canvas.relative()) * adaptive_sampling.SELECTION**2
                excess = adaptive_sampling.excess(relative, error, canvas.renderer.cell) if error > 0.0 else 1.0
                rounds.append((canvas.spent, float(np.mean(relative))))
                canvas.error = math.sqrt(rounds[-1][1])
                if excess <= 0.0:
                    break
                pace = canvas.spent / (self.deadline.clock() - self.began)
                samples = cells.means(whole_sums.samples).astype(np.int64)
                affordable = max(self.deadline.left(), 0.0) * pace / canvas.renderer.cell**2
                goals = cells.spread(self._goals(relative, samples, excess, affordable))
                goals = np.clip(goals, whole_sums.samples, whole_sums.samples + (canvas.renderer.round or canvas.most))
            else:
                goals, excess, started = started, canvas.round["excess"], None
            canvas.refresh(int(np.sum(goals - whole_sums.samples)), goals=goals, rounds=rounds, excess=excess)
            added = {tile: int(np.sum(goals[canvas.window(tile)] - whole_sums.samples[canvas.window(tile)])) for tile in canvas.tiles}
            more = sorted((tile for tile in canvas.tiles if added[tile]), key=lambda tile: -added[tile])  # longest first, for load balance
            if not more and again:  # a checkpoint at the end of its round
                continue
            if not more:
                break

            if error > 0.0:
                expected = adaptive_sampling.expected_samples(rounds, excess)
                self.whole = max(int(goals.sum()), min(expected, canvas.most * canvas.samples.size))
            canvas.draw(more, Batches(goals=goals), self._share, whole_sums)

    def _share(self) -> float:
        """The share of the work that is done."""
        elapsed = self.deadline.clock() - self.began
        return max(self.canvas.spent / self.whole, elapsed / max(elapsed + self.deadline.left(), 1e-9))

    def _begin(self) -> None:
        """Render all tiles with the first samples, by doublings: one measures the error, two its decline."""
        canvas, first, timed = self.canvas, self.canvas.first, self.deadline.is_finite
        if timed:
            self.draw_channels()
            passes = [[goal] for goal in sorted({*(2**k for k in range(first.bit_length())), first})]
        else:
            goals = sorted({-(-first // 4), -(-first // 2), first})
            if canvas.progressive and canvas.renderer.round is None:
                canvas.preview(goals[0])
            passes = [[goal] for goal in goals] if canvas.progressive else [goals]
        for some in passes:
            extras = bool(canvas.names) and first in some and not timed
            canvas.draw(canvas.tiles, Batches(tuple(some), extras=extras), self._share, self.sums)

    def draw_channels(self) -> None:
        """Draw the channels of all tiles, until the budget is spent."""
        if self.canvas.names:
            self.canvas.work(self._draw_extras, self.canvas.tiles, self._share)

    def _draw_extras(self, tile: Tile) -> None:
        """Draw the channels of a tile, unless the budget is spent."""
        if not self.deadline.is_over():
            self.canvas.draw_extras(tile)
            self.canvas.with_extras.add(tile)

    def _goals(self, relative: NDArray[np.float64], samples: Counts, excess: float, affordable: float) -> Counts:
        """Return (h, w) samples of each pixel after the next round, so that `relative` falls by the share `excess`."""
        canvas = self.canvas
        if canvas.renderer.by_tile:
            estimate = relative.copy()
            for tile in canvas.tiles:
                estimate[canvas.window(tile)] = estimate[canvas.window(tile)].mean()
        elif canvas.renderer.cell > 1:
            estimate = relative  # means of many pixels
        else:
            estimate = adaptive_sampling.smooth(relative, samples, canvas.threads)
        if excess < 1.0:
            doublings = adaptive_sampling.doublings_for_error(estimate, samples, canvas.most, excess)
            if np.sum(samples * (2**doublings - 1)) <= affordable:
                return np.minimum(samples * 2**doublings, canvas.most)
        # A round at most doubles all samples: beyond that, pixels at four times their own leave samples to pixels without need.
        doublings = adaptive_sampling.doublings_for_samples(estimate, samples, canvas.most, min(affordable, float(samples.sum())))
        return np.minimum(samples * 2**doublings, canvas.most)
