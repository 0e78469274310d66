"""Renders an exported scene with Mitsuba in a separate process: `python mitsuba_worker.py SCENE.xml OUT.npz SETTINGS-JSON`.

Import, loading, and compilation (a first render, discarded) are timed separately from the render.
"""

from __future__ import annotations

import importlib
import json
import math
import sys
import time
from typing import Any

import numpy as np

LANES = 1 << 23  # rays in flight; more take more memory, not less time


def main(scene_file: str, out: str, request: dict[str, Any]) -> None:
    """Render and save; `request` is a dict of "variant", "samples", "seed" and "threads"."""
    seconds = {}
    started = time.perf_counter()
    mi = importlib.import_module("mitsuba")
    dr = importlib.import_module("drjit")
    mi.set_variant(request["variant"])
    dr.set_thread_count(request["threads"])
    seconds["import"] = time.perf_counter() - started
    started = time.perf_counter()
    scene = mi.load_file(scene_file)
    dr.sync_thread()
    seconds["build"] = time.perf_counter() - started
    passes = _passes(scene.sensors()[0].film().crop_size(), request["samples"])
    started = time.perf_counter()
    _render(mi, scene, passes[0], request["seed"])
    seconds["compile_kernels"] = time.perf_counter() - started
    cpu, started = time.process_time(), time.perf_counter()
    total = sum(_render(mi, scene, spp, request["seed"] + 7919 * k) * (spp / request["samples"]) for k, spp in enumerate(passes))
    seconds["render"] = time.perf_counter() - started
    seconds["compile_kernels"] = max(seconds["compile_kernels"] - seconds["render"] / len(passes), 0.0)
    np.savez(out, rgb=np.asarray(total, np.float32), about=json.dumps({"seconds": seconds, "cpu": time.process_time() - cpu}))


def _passes(size: Any, samples: int) -> list[int]:
    """The samples a pixel of each pass."""
    most = max(LANES // (int(size[0]) * int(size[1])), 1)
    count = math.ceil(samples / most)
    return [samples // count + (k < samples % count) for k in range(count)]


def _render(mi: Any, scene: Any, samples: int, seed: int) -> np.ndarray:
    return np.array(mi.render(scene, spp=samples, seed=seed & 0x7FFFFFFF), np.float64)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], json.loads(sys.argv[3]))
