"""One picture: camera, preparation, backend, film, in that order."""

from __future__ import annotations

import threading
from collections.abc import Callable

from ..compiler import ir
from ..compiler.plan import Plan
from . import film, kernels, prepare, raster, ray, records, reference
from .image import Image

RENDERERS = {"ray": ray.Renderer, "raster": raster.Renderer, "reference": reference.Renderer}

Progress = Callable[[int, int], None]  # tiles done, tiles in all


def draw(scene: ir.Scene, plan: Plan, progress: Progress | None = None, cancel: threading.Event | None = None) -> Image:
    """Draw a validated scene as the plan says.

    `progress(done, total)` is called from the calling thread; setting `cancel` ends the work and returns what is done, with
    `metadata["partial"]`. `metadata` also holds the "seconds" it took to "build", "compile_kernels" and "render", the samples
    taken, the error reached and notes on what the backend does not draw, each (message, table, row).
    """
    seconds: dict[str, float] = {}
    width, height = plan["size"]
    view = records.View(plan["camera"], width, height)
    backend = plan["backend"]
    with kernels.timed(seconds, "build"):
        renderer = RENDERERS[backend](prepare.prepare(scene, plan, view), plan, view)
    with kernels.timed(seconds, "render"):
        image = film.run(renderer, plan, view, progress, cancel)
    image.metadata.update(backend=backend, seconds=seconds, notes=raster.notes(scene, plan) if backend == "raster" else [])
    return image
