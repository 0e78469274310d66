"""One picture: camera, preparation, backend, film, in that order."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from ..compiler import ir
from ..compiler.plan import plan as planner
from ..compiler.plan.plan import Plan
from . import types
from .backends import accumulation, light_groups, prepare
from .film import bounce_error, film
from .image import cryptomatte
from .image.image import Image
from .jit import kernel_cache

Progress = Callable[[int, int], None]  # tiles done, tiles in all


def draw(scene: ir.Scene, plan: Plan, progress: Progress | None = None, cancel: threading.Event | None = None) -> Image:
    """Draw a validated scene as the plan says.

    `progress(done, total)` is called from the calling thread; setting `cancel` ends the work and returns what is done, with
    `metadata["partial"]`. `metadata` also holds the "seconds" it took to "build", "compile_kernels" and "render", the samples
    taken, the error reached, notes on what the backend does not draw, each (message, table, row), the rays "unproved", and
    what the limit on bounces "cut": a truncation.Cut, None where it was not measured.
    """
    seconds: dict[str, float] = {}
    width, height = plan["size"]
    view = types.View(plan["camera"], width, height)
    backend = plan["backend"]
    with kernel_cache.timed(seconds, "build"):
        backend_of, notes_of = _backend(backend)

        def made(scene: ir.Scene, plan: Plan) -> Any:
            def still(scene: ir.Scene) -> Any:
                return backend_of(prepare.prepare(scene, plan, view), plan, view)

            return accumulation.Renderer(scene, plan, view, still) if by_moments else still(scene)

        lit = planner.light_groups(plan)
        by_moments = backend == "raster" and (plan["motion"] or plan["lens"] == "thin")
        renderer = light_groups.Renderer(scene, plan, made) if lit else made(scene, plan)
        layers = [name for name in plan["aov"] if name in cryptomatte.LAYERS]
        mattes = cryptomatte.Mattes(scene, layers) if layers else None
    with kernel_cache.timed(seconds, "render"):
        image = film.run(renderer, plan, view, progress, cancel, mattes)
        if lit:
            renderer.put(image)
        if plan["denoise"]:
            from .film import denoise  # and with it the package, which others do without

            denoise.denoised(image, renderer, plan)
    notes = notes_of(scene, plan) + (accumulation.notes(scene, plan) if by_moments else [])
    image.metadata.update(backend=backend, seconds=seconds, notes=notes, unproved=_unproved(renderer), cut=_cut(renderer, plan, image))
    if mattes is not None:
        image.metadata["attributes"] = mattes.attributes
    return image


def _cut(renderer: Any, plan: Plan, image: Image) -> bounce_error.Cut | None:
    """What the limit on bounces leaves out, where the whole picture was drawn by one renderer: of light groups each has its own."""
    if image.metadata["partial"] or not bounce_error.measurable(plan) or not hasattr(renderer, "limit"):
        return None
    allowed = plan["error"] or max(image.metadata["error"] or 0.0, planner.UNSEEN)
    return bounce_error.measured(renderer, plan, image.metadata["rays"], allowed)


def _unproved(renderer: Any) -> int:
    """Rays of which a stretch could not be proved to be without a root of a formula (the reference counts none)."""
    prepared = getattr(renderer, "prepared", None)  # of several moments there are several
    trees = getattr(prepared.accel, "tables", None) if prepared is not None else None
    forms = getattr(trees, "forms", None)  # where all things are pieces there are no trees
    return 0 if forms is None else int(forms.unproved[0])


def _backend(name: str) -> tuple[Any, Callable[[ir.Scene, Plan], list[tuple[str, str, int]]]]:
    """A backend's renderer, and what tells what it does not draw."""
    if name == "raster":
        from .backends.raster import Renderer, notes

        return Renderer, notes
    if name == "reference":
        from .backends.reference import Renderer
    else:
        from .backends.ray import Renderer
    return Renderer, lambda scene, plan: []
