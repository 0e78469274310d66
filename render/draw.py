"""One picture: camera, preparation, backend, film, in that order."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from ..compiler import ir
from ..compiler.plan import Plan
from . import film, prepare, raster, ray, records, reference
from .image import Image

RENDERERS = {"ray": ray.Renderer, "raster": raster.Renderer, "reference": reference.Renderer}

Progress = Callable[[int, int], None]  # tiles done, tiles in all


def draw(scene: ir.Scene, plan: Plan, progress: Progress | None = None, cancel: threading.Event | None = None) -> Image:
    """Draw a validated scene as the plan says.

    `progress(done, total)` is called from the calling thread; setting `cancel` ends the work and returns what is done, with
    `metadata["partial"]`. `metadata` also holds seconds by part, the samples taken, the error reached and notes on what
    the backend does not draw, each (message, table, row).
    """
    started = time.perf_counter()
    width, height = plan["size"]
    view = records.View(plan["camera"], width, height)
    backend = plan["backend"]
    prepared = prepare.prepare(scene, plan, view)
    renderer = RENDERERS[backend](prepared, plan, view)
    image = film.run(renderer, plan, view, progress, cancel)
    seconds = {**prepared.seconds, **image.metadata.get("seconds", {})}
    seconds["draw"] = time.perf_counter() - started
    image.metadata.update(backend=backend, seconds=seconds, notes=raster.notes(scene, plan) if backend == "raster" else [])
    return image
