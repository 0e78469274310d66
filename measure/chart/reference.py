"""What a chart's errors are measured against: a closed form where one is known, else a long run of the ray backend kept on disk.

A long run is many renders in float64 with seeds that no measured run has, so that its own variance is estimated from how they differ.
It is kept by the content of what it shows (the scene's tables, the plan's decisions that define the picture, the kernels' version),
and a later command with more time goes on where it ended. A file that cannot be read is made anew.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import tempfile
import threading
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.io import cache_dirs
from ...compiler.plan.plan import Plan
from ...compiler.scene import serialize
from ...render.jit import cache_key
from ..records import NothingMeasured, Reference
from . import bias, closed_form, runs
from .reference_light import Truth

FIRST_SEED = 10_000_000  # below it are the seeds of measured runs, from it on those of references
LEAST_SEEDS = 4  # fewer say too little of their variance
GOOD_SEEDS = 16  # aimed at
LEAST_SAMPLES, MOST_SAMPLES = 4, 4096  # of a seed
DEFINING = ("size", "camera", "crop", "bounces", "interreflection", "shadows", "shadows.lamps", "filter", "background", "horizon")
KEPT = 1 << 30  # bytes of references on disk; the oldest go
SAVED_EVERY = 30.0  # seconds
_UNREADABLE = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error)

Progress = Callable[[float], None]  # the share of the work that is done


class LongRun:
    """Renders of one picture with seeds of their own, `samples` each, as sums over those of even and of odd number."""

    def __init__(self, samples: int, halves: tuple[bias.Sums, bias.Sums] | None = None) -> None:
        self.samples = samples
        self.halves = halves or (bias.Sums(), bias.Sums())

    @property
    def count(self) -> int:
        """How many renders there are."""
        return sum(half.count for half in self.halves)

    def add(self, rgba: NDArray[np.floating]) -> None:
        """Take in the next seed's picture (h, w, 4)."""
        self.halves[self.count % 2].add(rgba)

    def reference(self, how: str) -> Reference:
        """The mean of all and its variance, from at least two renders."""
        whole = bias.joined(*self.halves)
        every = self.samples * whole.count
        seeds = tuple(range(FIRST_SEED, FIRST_SEED + whole.count))
        told = f"{every:,} samples a pixel of ray, float64, seeds {seeds[0]} to {seeds[-1]}; {how}"
        a, b = (half.mean for half in self.halves)
        return Reference(whole.mean[..., :3], whole.variance[..., :3] / whole.count, told, every, seeds, whole.mean[..., 3], (a, b))


def make(
    scene: ir.Scene, truth: Truth, seconds: float, aim: int, progress: Progress, cancel: threading.Event, folder: Path | None = None
) -> Reference:
    """The reference of a scene: at most about `seconds` of work, to `aim` samples a pixel. `folder` None: the user's cache.

    Raises NothingMeasured where even the shortest run would take longer, runs.Cancelled.
    """
    plan = truth.make(scene)
    known = closed_form.form(scene, plan)
    if known is not None:
        return _constant(plan, known)
    path = (default_folder() if folder is None else folder) / f"{key(scene, plan)}.npz"
    run = load(path, _shape(plan)) or LongRun(0)
    _extend(run, scene, truth, seconds, aim, progress, cancel, path)
    return run.reference(truth.how)


def key(scene: ir.Scene, plan: Plan) -> str:
    """What names the file: a hash of everything the picture depends on but its samples."""
    decided = {name: plan[name] for name in DEFINING}
    return hashlib.sha256(f"{serialize.content_hash(scene)} {json.dumps(decided)} {cache_key.version()}".encode()).hexdigest()[:32]


def default_folder() -> Path:
    """Beside the compiled kernels: MAQUETTE_CACHE, else the user's cache folder."""
    return cache_dirs.cache_root() / "references"


def load(path: Path, shape: tuple[int, int, int]) -> LongRun | None:
    """A long run from disk; None where there is none, or it is damaged or of another shape."""
    try:
        with np.load(path, allow_pickle=False) as data:
            halves = [bias.Sums(int(data[f"count{k}"]), data[f"mean{k}"], data[f"squares{k}"]) for k in (0, 1)]
            samples = int(data["samples"])
    except _UNREADABLE:
        return None
    sound = all(h.mean.shape == h.squares.shape == shape and h.mean.dtype == h.squares.dtype == np.float64 for h in halves)
    counted = samples > 0 and halves[1].count > 0 and halves[0].count - halves[1].count in (0, 1)
    return LongRun(samples, (halves[0], halves[1])) if sound and counted else None


def save(run: LongRun, path: Path) -> None:
    """Write a long run whole or not at all, and let the oldest go where there are too many. A disk that will not is no error."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}")
        try:
            with os.fdopen(handle, "wb") as file:
                arrays = {f"{part}{k}": getattr(h, part) for k, h in enumerate(run.halves) for part in ("count", "mean", "squares")}
                np.savez(file, samples=run.samples, **arrays)
            os.replace(name, path)
        finally:
            Path(name).unlink(missing_ok=True)
        _prune(path)
    except OSError:
        return


def _prune(newest: Path) -> None:
    files = sorted(newest.parent.glob("*.npz"), key=lambda p: p.stat().st_mtime, reverse=True)
    size = 0
    for path in files:
        size += path.stat().st_size
        if size > KEPT and path != newest:
            path.unlink(missing_ok=True)


def _constant(plan: Plan, known: closed_form.Constant) -> Reference:
    height, width, _ = _shape(plan)
    rgb = np.broadcast_to(np.array(known.rgb), (height, width, 3)).copy()
    return Reference(rgb, np.zeros_like(rgb), known.how, 0, (), np.full((height, width), known.alpha))


def _shape(plan: Plan) -> tuple[int, int, int]:
    x0, y0, x1, y1 = plan["crop"]
    return y1 - y0, x1 - x0, 4


def _extend(
    run: LongRun, scene: ir.Scene, truth: Truth, seconds: float, aim: int, progress: Progress, cancel: threading.Event, path: Path
) -> None:
    """Add seeds until the aim is reached or the time is over; `path` gets them on the way, too, so that a stop loses little."""
    began = saved = time.perf_counter()
    if run.samples == 0:
        run.samples = _samples_of_a_seed(scene, truth, seconds, aim, cancel)
    longest, before = 0.0, run.count
    try:
        while run.count * run.samples < aim or run.count < LEAST_SEEDS:
            now = time.perf_counter()
            if run.count >= LEAST_SEEDS and now - began + longest > seconds:
                break
            run.add(_drawn(scene, truth, run.samples, FIRST_SEED + run.count, cancel))
            done = time.perf_counter()
            longest = max(longest, done - now)
            progress(min(max(run.count * run.samples / aim, (done - began) / seconds if seconds > 0 else 1.0), 1.0))
            if done - saved > SAVED_EVERY and run.count > 1:
                save(run, path)
                saved = done
    finally:
        if run.count > max(before, 1):
            save(run, path)


def _samples_of_a_seed(scene: ir.Scene, truth: Truth, seconds: float, aim: int, cancel: threading.Event) -> int:
    """As many samples as let GOOD_SEEDS fit into the time and the aim, a power of two. Raises NothingMeasured where LEAST do not."""
    began = time.perf_counter()
    _drawn(scene, truth, LEAST_SAMPLES, FIRST_SEED - 1, cancel)
    spent = time.perf_counter() - began
    if spent * LEAST_SEEDS > seconds:
        raise NothingMeasured(
            f"a reference of {LEAST_SEEDS} times {LEAST_SAMPLES} samples alone would take {spent * LEAST_SEEDS:.3g} s of the "
            f"{seconds:.3g} s there are for it: give a longer --budget or a smaller --size"
        )
    affordable = min((seconds - spent) / (spent / LEAST_SAMPLES), float(aim)) / GOOD_SEEDS
    return int(np.clip(2 ** math.floor(math.log2(max(affordable, 1.0))), LEAST_SAMPLES, MOST_SAMPLES))


def _drawn(scene: ir.Scene, truth: Truth, samples: int, seed: int, cancel: threading.Event) -> NDArray[np.floating]:
    done = runs.run(scene, truth.make(scene, samples=samples, seed=seed, aov=(), error=None, budget=None), cancel)
    assert done.alpha is not None
    return np.dstack([done.rgb, done.alpha])
