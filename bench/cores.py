"""Pictures on more cores: Python time of a tile, serial seconds, and the gain that both allow on 4, 16 and 64 threads."""

from __future__ import annotations

import gc
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import load
from ..compiler import ir
from ..compiler.plan import plan
from ..render import render_scene
from ..render.image import image_files
from ..render.image.image import Image
from ..render.jit import loader, thread_pool
from ..render.simd import target
from . import report
from .harness import OURS, Effort

TEXT = """
Pictures without denoising, kernels on disk, with their preparation and a PNG file. One thread draws. Its CPU time is divided into that of
kernels inside of jobs of the thread pool, that of Python inside of jobs and between them, and the rest, which is *serial*. Of metering and
writing the file, which two threads do, *file* is the CPU time of the thread that waits for the other: it is part of what is serial; the
rest counts as kernels. A tile has 32 × 32 pixels.
Python's lock lets one thread at a time run Python, so n threads take at least serial + max((kernels + Python) / n, Python). From this come
the *predicted* gains. *Measured* is by wall time of drawing on the cores of this machine, medians of the rounds in turns. The pictures are
equal, bit for bit.
"""
THREADS = 4, 16, 64
TILE = 32  # pixels
EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


class Picture(NamedTuple):
    """A picture to draw."""

    name: str
    scene: ir.Scene
    settings: ir.Settings


class Division(NamedTuple):
    """The CPU seconds of a picture on one thread."""

    tiles: float  # of 32 × 32 pixels
    kernels: float  # inside of tiles
    python: float  # inside of tiles and between them
    serial: float
    file: float  # of `serial`, to meter and write the picture

    def gain(self, threads: int) -> float:
        """How many times as fast `threads` threads are at most."""
        shared = self.kernels + self.python
        return (self.serial + shared) / (self.serial + max(shared / threads, self.python))


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure all pictures."""
    result = report.Section("cores", "All cores", TEXT)
    rows, most = [], target.cores()
    for picture in pictures(quick):
        first = draw(picture, 1)  # loads or compiles the kernels
        division = divide(picture)
        single, several = [], []
        for _ in range(effort.rounds if quick else 3):
            seconds, image = _timed(picture, 1)
            single.append(seconds)
            seconds, other = _timed(picture, most)
            several.append(seconds)
            if not (np.array_equal(first, image) and np.array_equal(first, other)):
                result.refused.append(f"{picture.name}: one and {most} threads made different pictures")
        total = division.serial + division.kernels + division.python
        rows.append((
            picture.name, f"{division.tiles:.0f}", f"{1e6 * division.python / max(division.tiles, 1):.0f}", f"{total:.2f}",
            f"{division.serial:.2f}", f"{division.file:.2f}", f"{100 * division.serial / total:.1f}",
            *(f"{division.gain(n):.1f}" for n in THREADS),
            f"{division.gain(most):.2f}", f"{statistics.median(single) / statistics.median(several):.2f}",
        ))  # fmt: skip
    predicted = (f"gain on {n}" for n in THREADS)
    parts = "tiles", "Python, µs a tile", "CPU, s", "serial, s", "file, s", "serial, %"
    head = ("", *parts, *predicted, f"on {most}", f"measured on {most}")
    result.blocks += [f"**{OURS}, {most} cores**", report.grid(head, rows)]
    return result


def pictures(quick: bool) -> Sequence[Picture]:
    """hello by both backends, a solid of formulas, and a path-traced box."""
    size, samples = ((64, 48), 2) if quick else ((1600, 1200), 16)
    hello, box = load(EXAMPLES / "hello.scene"), load(Path(__file__).with_name("scenes") / "cornell.scene")
    side, small = ((32, 32), (64, 48)) if quick else ((512, 512), (640, 480))
    return (
        Picture("hello, ray", hello, ir.Settings(size=size, samples=samples, backend="ray", denoise=False)),
        Picture("hello, raster", hello, ir.Settings(size=size, samples=samples, backend="raster", denoise=False)),
        Picture("gear, ray", load(EXAMPLES / "gear.scene"), ir.Settings(size=small, samples=samples, backend="ray", denoise=False)),
        Picture("Cornell box, ray", box, ir.Settings(size=side, samples=4 * samples, backend="ray", denoise=False)),
    )


def draw(picture: Picture, threads: int) -> NDArray[np.float32]:
    """The picture on so many threads."""
    return _image(picture, threads).channels["rgba"]


def _image(picture: Picture, threads: int) -> Image:
    return render_scene.draw(picture.scene, plan.make_plan(picture.scene, replace(picture.settings, threads=threads)))


def _timed(picture: Picture, threads: int) -> tuple[float, NDArray[np.float32]]:
    began = time.perf_counter()
    image = draw(picture, threads)
    return time.perf_counter() - began, image


def divide(picture: Picture) -> Division:
    """Draw a picture on one thread, and measure what its CPU time is spent on."""
    with _counted_kernels() as kernels, _counted_jobs(kernels) as jobs:
        began = time.thread_time()
        image = _image(picture, 1)
        total = time.thread_time() - began
    file, beside = _write(image)
    assert picture.settings.size is not None
    tiles = picture.settings.size[0] * picture.settings.size[1] / TILE**2
    return Division(tiles, jobs.kernels + beside, jobs.python, total - jobs.kernels - jobs.python + file, file)


def _write(image: Image) -> tuple[float, float]:
    """CPU seconds of writing a picture on two threads: of the caller's, and of the other."""
    with tempfile.TemporaryDirectory() as folder:
        caller, all_threads = time.thread_time(), time.process_time()
        exposure = image_files.auto_exposure(image.channels["rgba"], 2)
        image_files.write(image, Path(folder, "a.png"), image_files.Look(exposure), {}, 2)
        caller, all_threads = time.thread_time() - caller, time.process_time() - all_threads
    return caller, all_threads - caller


class _Kernels(threading.local):
    """CPU seconds of kernels that this thread has called."""

    seconds = 0.0


@contextmanager
def _counted_kernels() -> Iterator[_Kernels]:
    """Count the time of all kernels that are loaded."""
    counted = _Kernels()
    gc.unfreeze()  # after a compilation, collections leave out what there was
    loaded = [each for each in gc.get_objects() if isinstance(each, loader.Loaded)]
    entries = [each._entry for each in loaded]
    for each, entry in zip(loaded, entries, strict=True):
        each._entry = _counting(entry, counted)
    try:
        yield counted
    finally:
        for each, entry in zip(loaded, entries, strict=True):
            each._entry = entry


def _counting(entry: Callable[[int], int], counted: _Kernels) -> Any:
    def call(address: int) -> int:
        began = time.thread_time()
        status = entry(address)
        counted.seconds += time.thread_time() - began
        return status

    return call


class _Jobs:
    """CPU seconds of the jobs of thread_pool.parallel_for."""

    kernels, python = 0.0, 0.0


@contextmanager
def _counted_jobs(kernels: _Kernels) -> Iterator[_Jobs]:
    """Count the jobs of thread pools, with what is done after each."""
    jobs, parallel_for = _Jobs(), thread_pool.parallel_for

    def counted(draw: Any, items: Any, threads: int, cancel: Any = None, on_done: Any = None, waits: bool = False) -> None:
        def call(*arguments: Any, function: Any) -> Any:
            began, native = time.thread_time(), kernels.seconds
            result = function(*arguments)
            inside = kernels.seconds - native
            jobs.kernels += inside
            jobs.python += time.thread_time() - began - inside
            return result

        def job(item: Any) -> Any:
            return call(item, function=draw)

        after = None if on_done is None else lambda item, result: call(item, result, function=on_done)
        parallel_for(job, items, threads, cancel, after, waits)

    thread_pool.parallel_for = counted
    try:
        yield jobs
    finally:
        thread_pool.parallel_for = parallel_for
