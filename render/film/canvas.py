"""Canvas: a picture that is being rendered, its sums and error estimates, and the order of the work."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan import decision
from ...compiler.plan.plan import Plan
from ..image import image, metrics
from ..image.cryptomatte import Mattes
from ..jit import thread_pool
from ..simd import target
from ..types import Tile, View
from . import accumulate, adaptive_sampling, picture_statistics, stray_samples
from .accumulate import PixelSums
from .checkpoint import Keeper, State
from .deadline import Deadline, Pace
from .progress import Picture, Progress, Report
from .remote import Remote
from .tile_calls import Counts, blank_film, draw_auxiliary, draw_batch, tiles
from .tile_queue import Batches, Target, TileKernel, TileQueue

EXTRAS = 8  # tiles for each thread, after which their channels are drawn
ROWS = 64  # of pixels, whose errors a thread computes at a time
KNOWN = 0.5  # of the pixels, whose variance tells that of the others
ESTIMATE = 2.0  # seconds between estimates of the error for callers


class Canvas:
    """A picture that is being rendered."""

    def __init__(
        self, renderer: Any, plan: Plan, cancel: threading.Event, report: Report | None, mattes: Mattes | None = None,
        keeper: Keeper | None = None, progressive: bool = False,
    ) -> None:  # fmt: skip
        """`renderer` is a film.Renderer. With a `keeper`, checkpoints are written, and the work goes on from the one it found.

        `progressive` draws few samples of all tiles before more of any, for viewers. The finished picture is the same.
        """
        self.mattes, self.keeper, self.progressive = mattes, keeper, progressive
        self.renderer, self.cancel, self.report = renderer, cancel, report
        self.crop = tuple(plan["crop"])
        self.names = tuple(plan["aov"])
        self.most = int(plan["samples"])
        self.threads = renderer.threads if isinstance(renderer, Remote) else int(plan["threads"]) or target.cores()
        self.width, self.height = self.crop[2] - self.crop[0], self.crop[3] - self.crop[1]
        self.channels = image.blank(self.width, self.height, ("rgba", *self.names))
        several = (self.height, self.width, 3) if self.most > 1 else (0, 0, 3)  # one sample has no error estimate
        self.differences = np.full(several, np.inf, np.float32)  # of halves, their squares the variance of means; inf after one batch
        self.samples: NDArray[Any] = np.zeros((self.height, self.width), np.int64 if self.most > 1 else np.int8)
        self.first = min(adaptive_sampling.first_samples(plan["error"]), self.most)
        adaptive = decision.adaptive(plan)
        self.least = 0.0  # ε², after the first round
        self.tiles = tiles(self.crop, renderer.side)
        self.rows = {tile: k for k, tile in enumerate(self.tiles)}
        self.boxes = np.array(self.tiles, np.int64).reshape(-1, 4)
        self.issues, self.drawn = np.zeros((2, len(self.tiles)), np.int64)  # by tile: not finite, and samples of all pixels
        self.decline = adaptive_sampling.Decline(self.tiles, self.first.bit_length() if adaptive else 0)
        self._local = threading.local()
        self.settled = not adaptive
        self.reuses = renderer.cell > 1
        self.limit = self.most if decision.by_default(plan) else 0
        self.error: float | None = None  # √relMSE so far, for `report`
        self.estimate_at = time.perf_counter() + ESTIMATE
        self.sums: PixelSums | None = None  # of the whole picture, where it is drawn in rounds
        self.round: dict[str, Any] = {}  # what a checkpoint needs to go on with the round
        self.deadline, self.pace, self.grants = Deadline(), Pace(), False
        self.queue = TileQueue(renderer.side, self.threads, self.pace)
        self.with_extras: set[Tile] = set()  # tiles with their channels, where a budget may leave some out
        self.lock = threading.Lock()  # a checkpoint is made between two batches
        self.resumed = keeper.saved_state if keeper is not None and self.most > 1 else None
        if self.resumed is not None:
            self._restore(self.resumed)

    def fixed(self) -> None:
        """Render with the same number of samples for every pixel."""
        goals = dict.fromkeys(-(-self.most // share) for share in (4, 2, 1))  # one doubling measures the error, two its decline
        if self.renderer.round is not None:
            self._in_rounds(sorted({*goals, *range(self.renderer.round, self.most, self.renderer.round)}))
            return
        pixels = self.width * self.height
        if self.progressive and self.most > 1:
            self.preview(min(goals))
            self._in_rounds(list(goals))
            return
        done = self._finished().tolist()
        finished = [tile for tile, is_finished in zip(self.tiles, done, strict=True) if is_finished]
        unfinished = [tile for tile, is_finished in zip(self.tiles, done, strict=True) if not is_finished]
        self.draw(unfinished, Batches(tuple(goals), extras=bool(self.names)), lambda: self.spent / (self.most * pixels))
        self.work(self.draw_extras, finished, lambda: 1.0)

    @property
    def spent(self) -> int:
        """Samples of all pixels, of finished batches."""
        return int(self.drawn.sum())

    def _finished(self) -> NDArray[np.bool_]:
        """(tiles,) whether a tile of fixed samples is whole."""
        x0, y0, x1, y1 = self.boxes.T
        return self.drawn == self.most * (y1 - y0) * (x1 - x0)

    def _draw_single(self, tile: Tile) -> None:
        """Render a tile of one sample a pixel, with memory of the thread."""
        shape = tile.y1 - tile.y0, tile.x1 - tile.x0
        window = self.window(tile)
        if getattr(self._local, "shape", None) != shape:
            self._local.shape, self._local.film = shape, blank_film(tile)
            self._local.counts = np.zeros(shape, np.int64), np.ones(shape, np.int64)
        first, count = self._local.counts
        self.renderer.sample(tile, first, count, 1, self._local.film)
        self.issues[self.rows[tile]] = accumulate.set_first(self._local.film, self.channels["rgba"][window])
        self.samples[window] = 1
        self.drawn[self.rows[tile]] = shape[0] * shape[1]

    def preview(self, first: int) -> None:
        """Render all tiles with 1/4ᵏ of the `first` samples, in pictures of rising quality that the work begins anew after."""
        shares = [4**k for k in range(1, 16) if first >= 2 * 4**k]
        for goal in (-(-first // share) for share in reversed(shares)):
            self.draw(self.tiles, Batches((goal,)), lambda: 0.0)
            self.drawn[:] = 0

    def _in_rounds(self, goals: Sequence[int]) -> None:
        """Render all tiles up to each of the `goals`, samples of every pixel, with `Renderer.refresh` before each."""
        self.sums = self.sums or PixelSums.zeros(self.height, self.width)
        pixels, before = self.width * self.height, 0
        for goal in goals:
            if self.round and goal < self.round["goal"]:  # done before the checkpoint
                before = goal
                continue
            self.refresh((goal - before) * pixels, goal=goal)
            self.draw(self.tiles, Batches((goal,)), lambda: self.spent / (self.most * pixels), self.sums)
            if self.cancel.is_set():
                return
            before = goal
        self.round = {"goal": self.most + 1}
        self.work(self.draw_extras, self.tiles if self.names else (), lambda: 1.0)

    def draw(self, jobs: Sequence[Tile], batches: Batches, fraction: Callable[[], float], sums: PixelSums | None = None) -> None:
        """Render batches of samples of tiles on all threads, added to `sums` of the whole picture, and report the `fraction` done.

        Without `sums` the tiles begin with no samples.
        """
        timed, fresh = self.deadline.is_finite, not self.drawn.any()

        def by_python(tile: Tile) -> None:
            if self.most == 1:
                self._draw_single(tile)
            elif sums is not None:
                self._draw_batches(tile, sums.window(self.window(tile)), batches)
            else:
                self._draw_batches(tile, PixelSums.zeros(tile.y1 - tile.y0, tile.x1 - tile.x0), batches)
            if batches.extras:
                self.draw_extras(tile)

        drawing: TileKernel | None = None if isinstance(self.renderer, Remote) or not jobs else self.renderer.tile_kernel
        if drawing is not None and timed and self.pace.seconds == 0.0:
            self.work(by_python, jobs[:1], fraction)
            jobs = jobs[1:]
        if drawing is None or (timed and self.pace.samples() < self.queue.side**2):  # slow: by rows, see _blocks
            self.work(by_python, jobs, fraction)
            return
        size = EXTRAS * self.threads if batches.extras else max(len(jobs), 1)
        for some in (jobs[k : k + size] for k in range(0, len(jobs), size)):
            self._draw_queue(some, batches, fraction, sums, drawing, fresh)
            if batches.extras:
                self.work(self.draw_extras, some, fraction)

    def _draw_queue(
        self, jobs: Sequence[Tile], batches: Batches, fraction: Callable[[], float], sums: PixelSums | None, drawing: TileKernel,
        fresh: bool,
    ) -> None:  # fmt: skip
        """`draw` by a kernel; `fresh`: no tile but the one in the middle has samples."""
        alone, none = self.most == 1, np.zeros((0, 0), np.int64)
        target = Target(
            np.zeros(1, np.int64), np.array([self.rows[tile] for tile in jobs], np.int64), self.boxes, np.array(batches.steps, np.int64),
            batches.goals, sums or PixelSums.zeros(0, 0), self.channels["rgba"], self.differences, none if alone else self.samples,
            self.samples if alone else none.astype(np.int8), self.drawn, self.issues, self.decline.shown, self.least, self.crop[0],
            self.crop[1], self.most,
        )  # fmt: skip

        def is_stopped(row: int) -> bool:
            if self.cancel.is_set():
                return True
            granted = fresh and self.grants and (row < 0 or not self.drawn[row])
            return self.deadline.is_over() and not granted

        def report() -> None:
            self._report(fraction())
            if self.keeper is not None and self.keeper.due():
                self.keep()

        def keeps() -> bool:
            return not (self.keeper is not None and self.cancel.is_set())  # a checkpoint holds whole batches

        self.pace.limits, self.queue.clock = self.deadline.is_finite, self.deadline.clock
        self.queue.run(drawing, target, is_stopped, keeps, report)

    def _draw_batches(self, tile: Tile, part: PixelSums, batches: Batches) -> None:
        """Render the batches of a tile."""
        row = self.rows[tile]
        if not batches.steps:
            goals = batches.goals[self.window(tile)]
            for _ in range(adaptive_sampling.MOST_DOUBLINGS):
                step = np.minimum(goals, 2 * part.samples)
                if self.deadline.is_over() or np.array_equal(step, part.samples):
                    break
                self.draw_tile(tile, part, step)
        for goal in batches.steps:
            if self.deadline.is_over() and (self.drawn[row] or not self.is_granted(tile)):
                return
            if self.drawn[row] < goal * part.samples.size:
                self.draw_tile(tile, part, np.full(part.samples.shape, goal))
            if part.samples.min() < goal:
                break  # cancelled: all samples in one batch would tell no error

    def draw_tile(self, tile: Tile, part: PixelSums, goals: Counts) -> None:
        """Render the pixels of a tile up to their goals as one batch; less if cancelled or after the deadline."""
        granted = self.is_granted(tile) and not part.samples.any()
        for rows in self._blocks(tile):
            some = goals if rows is None else np.where(rows, goals, part.samples)
            self._draw_batch(tile, part, some, self.cancel.is_set if granted else self._is_stopped)
            if self._is_stopped() and not granted:
                break

    def is_granted(self, tile: Tile) -> bool:
        """Whether a tile without samples is drawn after the deadline, too."""
        return self.grants or tile == self.tiles[0]

    def _blocks(self, tile: Tile) -> Sequence[NDArray[np.bool_] | None]:
        """Masks (h, 1) of rows, of which a sample a pixel fits into a call of deadline.CALL seconds; None: the whole tile does."""
        height = tile.y1 - tile.y0
        if not self.deadline.is_finite or self.renderer.by_tile or self.renderer.cell > 1 or isinstance(self.renderer, Remote):
            return (None,)
        rows = max(self.pace.samples() // (tile.x1 - tile.x0), 1) if self.pace.seconds > 0.0 else height
        if rows >= height:
            return (None,)
        row_numbers = np.arange(height)[:, None]
        return [(row_numbers >= start) & (row_numbers < start + rows) for start in range(0, height, rows)]

    def _is_stopped(self) -> bool:
        return self.cancel.is_set() or self.deadline.is_over()

    def _draw_batch(self, tile: Tile, part: PixelSums, goals: Counts, stopped: Callable[[], bool]) -> None:
        film, count = blank_film(tile), goals - part.samples
        most = int(count.max(initial=0))
        if isinstance(self.renderer, Remote):
            start = self.renderer.batch(tile, part.samples, count, self.most, film, self.deadline.end)
        else:
            pace, clock = self.pace, self.deadline.clock
            pace.limits = self.deadline.is_finite
            stopped = stopped if pace.limits else self.cancel.is_set
            start = draw_batch(self.renderer, tile, part.samples, count, self.most, film, stopped, pace, clock)
        if start < most:
            count = np.minimum(count, start)
        window = self.window(tile)
        with self.lock:
            if start < most and self.keeper is not None and self.cancel.is_set():
                return  # a checkpoint holds whole batches
            rgba, differences = self.channels["rgba"][window], self.differences[window]
            row = self.rows[tile]
            accumulate.add_samples(film, count, part, differences, rgba, self.least, self.decline.shown, row)
            self.samples[window] = part.samples
            self.drawn[row], self.issues[row] = int(part.samples.sum()), int(part.issues.sum())

    def draw_extras(self, tile: Tile) -> None:
        if self.names:
            window = self.window(tile)
            draw_auxiliary(self.renderer, tile, {name: self.channels[name][window] for name in self.names}, self.most, self.mattes)

    def window(self, tile: Tile) -> tuple[slice, slice]:
        x0, y0 = self.crop[:2]
        return slice(tile.y0 - y0, tile.y1 - y0), slice(tile.x0 - x0, tile.x1 - x0)

    def relative(self, passing: bool = False) -> NDArray[np.float64]:
        """(h, w) variance / (light² + ε²) of all pixels, ε as in metrics.root_relmse; sets `least`, ε², unless `passing`."""
        rgba = self.channels["rgba"]
        mean = np.einsum("ijk->k", rgba, dtype=np.float64) / (rgba.size // rgba.shape[-1])
        luminance = float(mean[:3] @ metrics.LUMINANCE)
        least = max((metrics.EPSILON * luminance) ** 2, float(np.finfo(np.float64).tiny))
        if not passing:
            self.least = least
        out = np.empty(self.samples.shape)
        shares = self.decline.shares()

        def some(top: int) -> None:
            accumulate.relative_error(self.differences, rgba, self.samples, shares, least, out, top, top + ROWS)

        thread_pool.parallel_for(some, range(0, len(out), ROWS), self.threads)
        return out

    def _shares(self) -> NDArray[np.float64]:
        """(h, w) variance of pixels over the square of their differences."""
        shares = self.decline.shares()
        if self.samples.size and self.samples.min() == self.samples.max():
            return np.broadcast_to(shares[max(int(self.samples.flat[0]), 1).bit_length() - 1], self.samples.shape)
        return shares[np.log2(np.maximum(self.samples, 1)).astype(int)]

    def work(self, draw: Callable[[Tile], None], jobs: Sequence[Tile], fraction: Callable[[], float]) -> None:
        """Render tiles on all threads, and report the `fraction` done after each; the first exception is raised here."""

        def count(tile: Tile, _: None) -> None:
            self._report(fraction())
            if self.keeper is not None and self.keeper.due():
                self.keep()

        thread_pool.parallel_for(draw, jobs, self.threads, self.cancel, count, waits=isinstance(self.renderer, Remote))

    # --- checkpoints ---

    def refresh(self, samples: int, **round_: Any) -> None:
        """Begin a round of this many samples, or go on with the one of a checkpoint, with the same data shared by its samples."""
        if self.renderer.round is not None:
            if self.keeper is not None:
                before = self.renderer.shared()
                if self.resumed is not None and "samples" in self.resumed.numbers:
                    before, samples = tuple(self.resumed.numbers["shared"]), int(self.resumed.numbers["samples"])
                    self.renderer.share(before)
                round_ |= {"shared": before, "samples": samples}
            self.renderer.refresh(samples)
        self.round, self.resumed = round_, None

    def keep(self) -> None:
        """Write a checkpoint, if there is a keeper and anything to keep."""
        if self.keeper is not None and self.most > 1 and (self.spent if self.sums is not None else self._finished().any()):
            with ExitStack() as held:  # without copies: threads wait at the end of their batches, and of their calls
                for lock in (self.lock, *(worker.lock for worker in self.queue.workers.values())):
                    held.enter_context(lock)
                self.keeper.save(self._state())

    def _state(self) -> State:
        arrays = {"rgba": self.channels["rgba"], "differences": self.differences, "samples": self.samples}
        arrays["decline"] = self.decline.shown
        arrays["finished"] = self._finished() | (self.sums is not None)
        arrays["issues"] = self.issues
        if self.sums is not None:
            arrays |= {f"sums.{name}": array for name, array in self.sums._asdict().items()}
        numbers = {name: value for name, value in self.round.items() if name != "goals"}
        if "goals" in self.round:
            arrays["goals"] = self.round["goals"]
        return State(arrays, {**numbers, "least": self.least, "error": self.error})

    def _restore(self, state: State) -> None:
        """Go on from a checkpoint. Tiles of fixed samples that were not finished begin anew."""
        arrays = state.arrays
        for row, tile in enumerate(self.tiles):
            if arrays["finished"][row]:
                window = self.window(tile)
                self.channels["rgba"][window], self.samples[window] = arrays["rgba"][window], arrays["samples"][window]
                self.differences[window] = arrays["differences"][window]
                self.decline.shown[row], self.issues[row] = arrays["decline"][row], arrays["issues"][row]
                self.drawn[row] = arrays["samples"][window].sum()
        self.least, self.error = state.numbers["least"], state.numbers["error"]
        if "sums.color" in arrays:
            self.sums = PixelSums(*(arrays[f"sums.{name}"] for name in PixelSums._fields))
        self.round = dict(state.numbers)
        if "goals" in arrays:
            self.round["goals"] = arrays["goals"]

    def _report(self, fraction: float) -> None:
        if self.report is None:
            return
        if self.settled and self.most > 1 and time.perf_counter() > self.estimate_at:
            began = time.perf_counter()
            relative = self.relative(passing=True)
            finite = relative[np.isfinite(relative)]
            self.error = math.sqrt(float(np.mean(finite))) if finite.size else None
            self.estimate_at = 20.0 * time.perf_counter() - 19.0 * began + ESTIMATE  # takes at most 5 % of the time
        samples = self.spent / (self.width * self.height)
        most, picture = self.most if self.settled else 0, Picture(self.channels["rgba"], self.samples)
        self.report(Progress("rendering", min(fraction, 1.0), samples, most, self.error, picture, self.limit))

    def _final_error(self) -> tuple[float | None, float]:
        """(√relMSE, share of its square in few pixels with stray bright samples); None for the first if it is unknown.

        Where a budget ended the work, pixels of one sample take twice the variance of those of two, if these are KNOWN of all.
        """
        relative = self.relative() if self.most > 1 else np.full((1, 1), np.inf)
        is_measured = np.isfinite(relative)
        finite = relative if is_measured.all() else relative[is_measured]
        if finite.size < relative.size and (not self.deadline.is_finite or finite.size < KNOWN * relative.size):
            return None, 0.0
        alone = int(np.count_nonzero(self.samples)) - finite.size
        mean = float(np.sum(finite) + 2.0 * alone * np.mean(finite)) / (finite.size + alone)
        sparse = 0.0
        if relative.shape == self.samples.shape:
            picture = relative, self.channels["rgba"], self.differences
            hidden = stray_samples.share_in_dark_pixels(*picture, self.samples, self._shares(), self.least, self.threads)
            sparse = max(stray_samples.share_of_error(*picture), hidden)
        return (1.0 if self.settled else adaptive_sampling.SELECTION) * math.sqrt(mean), sparse

    def finish(self, view: View) -> image.Image:
        """Return the picture with its metadata."""
        partial = self.cancel.is_set() and bool(self.samples.min() == 0 or self.samples.min() < self.most)
        error, sparse = self._final_error()
        self.error = error
        if self.reuses:  # samples of path reuse may be negative; few pixels of few samples are
            np.maximum(self.channels["rgba"][..., :3], 0.0, out=self.channels["rgba"][..., :3])
        if not partial:
            self._report(1.0)
        rays = int(self.samples.sum() if self.most > 1 else np.count_nonzero(self.samples))
        if "samples" in self.channels:
            self.channels["samples"][..., 0] = self.samples
        variance = picture_statistics.squares(self.differences, self.threads) if self.most > 1 else None
        if "variance" in self.channels and variance is not None:
            scaled_variance = np.where(np.isfinite(variance), variance, 0.0) * self._shares()[..., None]
            self.channels["variance"][...] = np.minimum(scaled_variance, accumulate.LARGEST)
        about: dict[str, Any] = {
            "size": (view.width, view.height), "crop": self.crop, "samples": int(self.samples.max()),
            "samples_mean": rays / self.samples.size, "error": error, "partial": partial, "error_in_few": sparse,
            "variance": variance, "half_difference": self.differences if self.most > 1 else None,
            "variance_share": float(np.mean(self._shares())) if self.most > 1 else 1.0,
            "rays": rays, "issues": int(self.issues.sum()), "threads": self.threads, "pace": self.pace.warm,
            "undrawn": self.samples == 0 if self.samples.min() == 0 and not partial else None,
            "without_channels": len(self.tiles) - len(self.with_extras) if self.names and self.deadline.is_finite else 0,
        }  # fmt: skip
        return image.Image(self.width, self.height, self.channels, about)
