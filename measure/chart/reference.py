"""The reference of a chart: a closed form where one is known, else many runs of the ray backend, cached on disk.

The runs are float64 and have seeds that no measured run has. Their differences estimate the variance of their mean. The cache key is a
hash of the scene's tables, the decisions that define the picture, and the version of the kernels. A later command with more time adds
runs. An unreadable file is replaced.
"""

from __future__ import annotations

import hashlib
import json
import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.io import array_files, cache_dirs
from ...compiler.io.replace_file import replacing
from ...compiler.plan.plan import Plan
from ...compiler.scene import serialize
from ...render.jit import cache_key
from ..records import NothingMeasured, Reference
from . import bias, closed_form, runs
from .reference_light import ReferenceLight

FIRST_SEED = 10_000_000  # measured runs have lower seeds, references this and higher ones
MIN_SEEDS = 4  # fewer do not estimate their variance
TARGET_SEEDS = 16  # the preferred number
MIN_SAMPLES, MAX_SAMPLES = 4, 4096  # samples a pixel of a seed
DEFINING_DECISIONS = (
    "size", "camera", "crop", "bounces", "interreflection", "shadows", "shadows.light_shapes", "filter", "background", "ground_plane",
)  # fmt: skip
CACHE_BYTES = 1 << 30  # bytes of references on disk; the oldest are deleted
SAVE_INTERVAL = 30.0  # seconds
_UNREADABLE = (ValueError, KeyError, TypeError, array_files.ArrayFileError)

Progress = Callable[[float], None]  # the completed share of the work


class Effort(NamedTuple):
    """How much work a reference may take."""

    seconds: float  # about, at most
    aim: int  # samples a pixel
    progress: Progress
    cancel: threading.Event
    expected: Callable[[int], float] = lambda samples: 0.0  # seconds of a picture of so many samples a pixel, before the first one


class Accumulation:
    """Statistics of renders with different seeds and `samples` samples each, separately for even and odd numbers."""

    def __init__(self, samples: int, halves: tuple[bias.RunningStats, bias.RunningStats] | None = None) -> None:
        self.samples = samples
        self.halves = halves or (bias.RunningStats(), bias.RunningStats())

    @property
    def count(self) -> int:
        """The number of renders."""
        return sum(half.count for half in self.halves)

    def add(self, rgba: NDArray[np.floating]) -> None:
        """Add the picture (h, w, 4) of the next seed."""
        self.halves[self.count % 2].add(rgba)

    def reference(self, how: str) -> Reference:
        """The mean of all renders and its variance; needs at least two."""
        merged = bias.merge(*self.halves)
        every = self.samples * merged.count
        seeds = tuple(range(FIRST_SEED, FIRST_SEED + merged.count))
        description = f"{every:,} samples a pixel of ray, float64, seeds {seeds[0]} to {seeds[-1]}; {how}"
        a, b = (half.mean for half in self.halves)
        rgb, variance = merged.mean[..., :3], merged.variance[..., :3] / merged.count
        return Reference(rgb, variance, description, every, seeds, merged.mean[..., 3], (a, b))


def make(scene: ir.Scene, light: ReferenceLight, effort: Effort, folder: Path | None = None) -> Reference:
    """The reference of a scene. `folder` defaults to the user's cache.

    Raises NothingMeasured if even the shortest reference would take longer, runs.Cancelled.
    """
    plan = light.plan(scene)
    constant = closed_form.recognize(scene, plan)
    if constant is not None:
        return _constant(plan, constant)
    path = (default_folder() if folder is None else folder) / f"{cache_name(scene, plan)}.npz"
    run = load(path, _shape(plan)) or Accumulation(0)
    _extend(run, scene, light, effort, path)
    return run.reference(light.how)


def known_samples(scene: ir.Scene, light: ReferenceLight) -> int:
    """The samples a pixel of a reference that is known or on disk already; MIN_SEEDS · MAX_SAMPLES of a closed form."""
    plan = light.plan(scene)
    if closed_form.recognize(scene, plan) is not None:
        return MIN_SEEDS * MAX_SAMPLES
    stored = load(default_folder() / f"{cache_name(scene, plan)}.npz", _shape(plan))
    return 0 if stored is None else stored.samples * stored.count


def cache_name(scene: ir.Scene, plan: Plan) -> str:
    """The file name: a hash of everything that the picture depends on but its samples."""
    decided = {name: plan[name] for name in DEFINING_DECISIONS}
    return hashlib.sha256(f"{serialize.content_hash(scene)} {json.dumps(decided)} {cache_key.version()}".encode()).hexdigest()[:32]


def default_folder() -> Path:
    """The folder of references, beside the compiled kernels: in MAQUETTE_CACHE, else in the user's cache folder."""
    return cache_dirs.cache_root() / "references"


def load(path: Path, shape: tuple[int, int, int]) -> Accumulation | None:
    """An accumulation from disk; None if it is missing, damaged or of another shape."""
    try:
        data = array_files.read(path)
        halves = [bias.RunningStats(int(data[f"count{k}"]), data[f"mean{k}"], data[f"squares{k}"]) for k in (0, 1)]
        samples = int(data["samples"])
    except _UNREADABLE:
        return None
    sound = all(h.mean.shape == h.squares.shape == shape and h.mean.dtype == h.squares.dtype == np.float64 for h in halves)
    counted = samples > 0 and halves[1].count > 0 and halves[0].count - halves[1].count in (0, 1)
    return Accumulation(samples, (halves[0], halves[1])) if sound and counted else None


def save(run: Accumulation, path: Path) -> None:
    """Write an accumulation atomically and delete the oldest files beyond CACHE_BYTES. A disk error is ignored."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        arrays = {f"{part}{k}": getattr(h, part) for k, h in enumerate(run.halves) for part in ("count", "mean", "squares")}
        with replacing(path) as partial, partial.open("wb") as file:
            np.savez(file, samples=run.samples, **arrays)
        _prune(path)
    except OSError:
        return


def _prune(newest: Path) -> None:
    files = sorted(newest.parent.glob("*.npz"), key=lambda p: p.stat().st_mtime, reverse=True)
    size = 0
    for path in files:
        size += path.stat().st_size
        if size > CACHE_BYTES and path != newest:
            path.unlink(missing_ok=True)


def _constant(plan: Plan, constant: closed_form.ConstantPicture) -> Reference:
    height, width, _ = _shape(plan)
    rgb = np.broadcast_to(np.array(constant.rgb), (height, width, 3)).copy()
    return Reference(rgb, np.zeros_like(rgb), constant.how, 0, (), np.full((height, width), constant.alpha))


def _shape(plan: Plan) -> tuple[int, int, int]:
    x0, y0, x1, y1 = plan["crop"]
    return y1 - y0, x1 - x0, 4


def _extend(run: Accumulation, scene: ir.Scene, light: ReferenceLight, effort: Effort, path: Path) -> None:
    """Add seeds up to the aim or the end of the time. Saves to `path` on the way, so that an interruption loses little."""
    seconds, aim, progress, cancel, expected = effort
    began = saved = time.perf_counter()
    if run.samples == 0:
        run.samples = _samples_per_seed(scene, light, effort)
    longest, before = expected(run.samples), run.count
    try:
        while run.count * run.samples < aim or run.count < MIN_SEEDS:
            now = time.perf_counter()
            if run.count >= MIN_SEEDS and now - began + longest > seconds:
                break
            run.add(_render(scene, light, run.samples, FIRST_SEED + run.count, cancel))
            done = time.perf_counter()
            longest = max(longest, done - now)
            progress(min(max(run.count * run.samples / aim, (done - began) / seconds if seconds > 0 else 1.0), 1.0))
            if done - saved > SAVE_INTERVAL and run.count > 1:
                save(run, path)
                saved = done
    finally:
        if run.count > max(before, 1):
            save(run, path)


def _samples_per_seed(scene: ir.Scene, light: ReferenceLight, effort: Effort) -> int:
    """The samples of a seed, a power of two, with which TARGET_SEEDS fit. Raises NothingMeasured if MIN_SEEDS do not fit."""
    seconds, began = effort.seconds, time.perf_counter()
    _render(scene, light, MIN_SAMPLES, FIRST_SEED - 1, effort.cancel)
    spent = time.perf_counter() - began
    if spent * MIN_SEEDS > seconds:
        raise NothingMeasured(
            f"a reference of {MIN_SEEDS} times {MIN_SAMPLES} samples alone would take {spent * MIN_SEEDS:.3g} s of the "
            f"{seconds:.3g} s there are for it: give a longer --budget or a smaller --size"
        )
    affordable = min((seconds - spent) / (spent / MIN_SAMPLES), float(effort.aim)) / TARGET_SEEDS
    return int(np.clip(2 ** math.floor(math.log2(max(affordable, 1.0))), MIN_SAMPLES, MAX_SAMPLES))


def _render(scene: ir.Scene, light: ReferenceLight, samples: int, seed: int, cancel: threading.Event) -> NDArray[np.floating]:
    done = runs.run(scene, light.plan(scene, samples=samples, seed=seed, aov=(), error=None, budget=None), cancel)
    assert done.alpha is not None
    return np.dstack([done.rgb, done.alpha])
