"""How many photons a picture needs: from the noise of a small picture that different photons, and different paths, leave."""

from __future__ import annotations

import math
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..integrator import wave_memory, wavefront
from ..integrator.photons.tracer import Tracer
from ..jit import thread_pool
from ..jit.packed_struct import Handle
from ..types import Film, Frame, Tile, View

WIDTH = 48  # pixels of the small picture
SAMPLES, STRIDE = 4, 4  # of each pixel, and between their numbers, so that they read different maps
DARK = 1e-2  # share of the mean light below which a pixel's noise counts less
SEED = 0x70_686F_746F  # the small picture and the large one have different random numbers
EQUAL_FACTOR = 7.0  # the factor where a map's estimate and a sample have the same variance, in a picture of 2¹⁵ pixels
LEAST, MOST = 1.0, 32.0  # factors of the number of photons


def measure(accel: Handle, scene: Any, frame: Frame, tracer: Tracer, kind: type, threads: int, reuses: bool) -> float:
    """Return the factor of the number of photons for the least noise in a given time.

    `accel`, `scene` and `frame` are as for `wavefront.draw_tile`, `kind` is their floating-point type. With `reuses` the kernel is
    `draw_tile_in_groups`. The result does not depend on the number of threads.

    The variance v of n samples of p pixels, and w of N photons, fall as v / n and w N^(−2/3). For the least error of pixels in a time,
    N / n ∝ √(w / v), and less in large pictures, whose pixels share the photons. Noise of photons shows as blotches, and is not
    denoised: so N / n ∝ w / v here.
    """
    small = _frame(frame)
    unchanged = Handle(small._replace(picture=frame.picture))
    tracer.widen(unchanged)
    lit = [scene._replace(light=scene.light._replace(photons=tracer.make_pilot_maps(k, unchanged))) for k in range(2)]
    first, second = (_draw(accel, each, small, kind, threads, reuses) for each in lit)
    mean = first.mean(axis=0), second.mean(axis=0)
    light = np.maximum(0.5 * (mean[0] + mean[1]), 0.0)
    scale = np.square(light) + np.square(DARK * light.mean()) + 1e-300
    of_photons = _mean(0.5 * np.square(first - second).mean(axis=0) / scale)
    of_paths = _mean(((first - mean[0]) * (second - mean[1])).sum(axis=0) / (SAMPLES - 1) / scale)
    pixels = frame.picture.width * frame.picture.height
    factor = EQUAL_FACTOR * of_photons / max(of_paths, 1e-3 * of_photons, 1e-300) * (pixels / 2**15) ** (-1.0 / 3.0)
    # Steps, so that the rounding errors of another processor do not change the number of photons.
    return float(np.clip(2.0 ** (round(2.0 * math.log2(max(factor, LEAST))) / 2.0), LEAST, MOST))


def _mean(relative: NDArray[np.float64]) -> float:
    """Return the mean over the pixels. A pixel that one of its SAMPLES alone lights has SAMPLES at most; no other counts more."""
    return float(np.clip(relative, -SAMPLES, SAMPLES).mean())


def _frame(frame: Frame) -> Frame:
    height = int(np.clip(round(WIDTH * frame.picture.height / frame.picture.width), 8, 2 * WIDTH))
    seed = int(np.random.default_rng([SEED, frame.options.seed & 0xFFFFFFFF]).integers(1 << 31))
    return frame._replace(picture=View(frame.picture.camera, WIDTH, height), options=frame.options._replace(seed=seed), order=-1)


def _draw(accel: Handle, scene: Any, frame: Frame, kind: type, threads: int, reuses: bool) -> NDArray[np.float64]:
    """(SAMPLES, height, width) brightness of single samples."""
    height, width = frame.picture.height, frame.picture.width
    packed_frame, packed, local = Handle(frame), Handle(scene), threading.local()
    shown = np.zeros((SAMPLES, height, width))
    drawn = wavefront.draw_tile_in_groups if reuses else wavefront.draw_tile

    def draw(k: int) -> None:
        if not hasattr(local, "memory"):
            local.memory = Handle(wave_memory.WaveMemory.of(kind, reuses))
        film = Film(np.zeros((height, width, 3)), np.zeros((height, width)), np.zeros((height, width), np.int64))
        first, count = np.full((height, width), k * STRIDE, np.int64), np.ones((height, width), np.int64)
        drawn(accel, packed, packed_frame, Tile(0, 0, width, height), first, count, SAMPLES * STRIDE, film, local.memory)
        shown[k] = film.color.mean(axis=2)

    thread_pool.parallel_for(draw, range(SAMPLES), threads)
    return shown
