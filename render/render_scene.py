"""Renders one picture of a scene: prepares it, runs a backend's renderer on the film, post-processes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.plan import channels, decision, emissive_shapes, omitted_light, single_sided
from ..compiler.plan.plan import Plan
from . import camera, types, working_space
from .backends import accumulation, kernel_choice, light_groups
from .film import bloom, bounce_error, film, picture_statistics
from .film.checkpoint import Keeper
from .film.deadline import Deadline
from .film.progress import Progress, Report
from .film.remote import Remote
from .image import color_channels, cryptomatte
from .image.image import Image
from .jit import cancellation, compile_events, kernel_cache
from .simd import target

LONGER = 2.0  # times a sample of the picture, that one of the measurement of light beyond the limit on bounces takes
MISSING_LIGHT = 0.02  # share of a pixel's light that the limit on bounces may leave out, unless an error was asked for


def draw(
    scene: ir.Scene, plan: Plan, report: Report | None = None, cancel: threading.Event | None = None, keeper: Keeper | None = None,
    quick: bool = False, progressive: bool = False, remote: Callable[[ir.Scene, Plan], Remote] | None = None,
    deadline: Deadline | None = None,
) -> Image:  # fmt: skip
    """Render a validated scene under a plan, until the deadline, by default plan["budget"] from now.

    Calls `report` in the calling thread. `keeper` writes checkpoints, and brings the one to go on from; pictures by light groups, and
    those that a backend draws as a whole, have none. `remote` makes a renderer that draws in other processes. Setting `cancel` ends the
    work; the picture is then partial, as `metadata["partial"]` says; before its first sample Cancelled is raised between two BVHs of
    meshes. Other metadata: the "seconds" of "build", "compile_kernels" and "render"; samples; the error reached; "notes" on effects
    that are not drawn, each (message, table, row); the number of rays "unproved"; "cut", the light lost to the limit on
    bounces, a bounce_error.Cut, or None if not measured, as of `quick` pictures, which others replace soon; "bias", the share of light
    that the picture is known to lack, None where light of unknown size is left out; "left_out", clauses about that; "brightness", the
    greatest red, green or blue; "ready" and "ready_cpu", the seconds of the budget, and of CPU, before the first sample; "elapsed" and
    "elapsed_cpu", those at the end; those of the plan that files need. `progressive` refines all tiles together, for viewers. Light is
    computed in the plan's working space; pictures are linear Rec.709.
    """
    scene, plan = working_space.scene_in(scene, plan)
    seconds: dict[str, float] = {}
    width, height = plan["size"]
    view = types.View(plan["camera"], width, height)
    tell = report or (lambda _: None)
    tell(Progress("building"))
    if remote is None:
        compile_events.expect(_expected_kernels(scene, plan))
    deadline = deadline or Deadline(plan["budget"])
    if plan["bloom"] > 0.0 and deadline.is_finite:
        deadline = deadline.earlier(bloom.time_of(width * height))
    lit = channels.light_groups(plan)
    with deadline.watch_compiler():
        with cancellation.cancelled_by(cancel), kernel_cache.timed(seconds, "build"):
            by_moments = _is_by_moments(plan)
            seen, undrawn = single_sided.seen_from(scene, plan["camera"], plan["transport"] == "path")
            renderer = remote(seen, plan) if remote is not None else choose_renderer(seen, plan, view)
            layers = [name for name in plan["aov"] if name in cryptomatte.LAYERS]
            mattes = cryptomatte.Mattes(scene, layers) if layers else None
        with kernel_cache.timed(seconds, "render"):
            reporter = _with_denoiser(report, renderer, plan, cancel) if report and progressive and decision.may_denoise(plan) else report
            reporter = _in_rec709(reporter, plan["working_space"])
            checkpoint = None if lit or by_moments else keeper
            write_groups = renderer.put if lit else lambda image: None
            ready = {"ready": deadline.spent(), "ready_cpu": deadline.cpu_spent()}
            work = (renderer, plan, view, reporter, cancel or threading.Event(), mattes, checkpoint, progressive)
            image = _draw_in_time(work, deadline, write_groups) if deadline.is_finite else _draw(work, write_groups)
    tell(Progress("finishing"))
    color_channels.to_rec709(image, plan["working_space"])
    notes = _notes(scene, plan) + [(single_sided.LEFT, "instances", undrawn)] * (undrawn >= 0)
    notes += accumulation.notes(scene, plan) if by_moments else []
    unproved, cut = count_unproved(renderer), None if quick else _measure_bounce_error(renderer, plan, image, deadline)
    if plan["bloom"] > 0.0:
        _add_bloom(scene, plan, image)
    image.metadata.update(
        backend=plan["backend"], seconds=seconds, notes=notes, unproved=unproved, cut=cut, **ready, **_for_files(plan),
        brightness=_brightness(image, plan["background"] == "transparent", int(plan["threads"])), **_omitted(scene, plan, cut),
        elapsed=deadline.spent(), elapsed_cpu=deadline.cpu_spent(),
    )  # fmt: skip
    if mattes is not None:
        image.metadata["attributes"] = mattes.attributes
    return image


def _draw(work: tuple[Any, ...], write_groups: Callable[[Image], None]) -> Image:
    """A picture without a budget; `work` are the arguments of film.run, `write_groups` writes the channels of light groups."""
    renderer, plan, _, report, *_ = work
    image = film.run(*work)
    write_groups(image)
    if decision.denoises(plan, image.metadata["error"], image.metadata["partial"]):
        from .film import denoise  # loads pyoidn

        if report is not None:
            report(Progress("denoising"))
        denoise.denoise(image, renderer, plan)
    return image


def _draw_in_time(work: tuple[Any, ...], deadline: Deadline, write_groups: Callable[[Image], None]) -> Image:
    """As _draw, with a budget."""
    from .backends import timed_picture  # loads the denoiser

    return timed_picture.run(timed_picture.Work(*work), deadline, write_groups)


def _add_bloom(scene: ir.Scene, plan: Plan, image: Image) -> None:
    """Scatter the plan's share of the light, of the picture and of the channels of light groups."""
    _, half_height = camera.half_extent(scene.tables, types.View(plan["camera"], *plan["size"]))
    _, top, _, bottom = plan["crop"]
    pixel = 2.0 * half_height / plan["size"][1] * (bottom - top) / max(len(image.channels["rgba"]), 1)
    bloom.add(image, plan["bloom"], pixel, ("rgba", *(name for name in image.channels if name.startswith(channels.LIGHT))))


def _omitted(scene: ir.Scene, plan: Plan, cut: bounce_error.Cut | None) -> dict[str, Any]:
    """Metadata on light that the picture leaves out: "bias" and "left_out"."""
    left_out = omitted_light.unmeasured(scene, plan, cut is not None)
    share = max(cut.share, 0.0) if cut is not None else None if left_out else 0.0
    return {"bias": share, "left_out": left_out}


def _with_denoiser(report: Report, renderer: Any, plan: Plan, cancel: threading.Event | None) -> Report:
    """`report`, with Progress.denoiser."""

    def denoiser() -> Callable[[Any], Any] | None:
        from .film import denoise  # loads pyoidn

        return denoise.preview_filter(renderer, plan, cancel or threading.Event())

    return lambda progress: report(progress._replace(denoiser=denoiser))


def _for_files(plan: Plan) -> dict[str, Any]:
    """The decisions that files of the picture need."""
    names = ("exposure", "view", "white", "working_space", "ocio", "display", "look")
    return {**{name: plan[name] for name in names}, "transparent": plan["background"] == "transparent"}


def _in_rec709(report: Report | None, space: str) -> Report | None:
    """`report`, with pictures so far in linear Rec.709."""
    if report is None or space == working_space.REC709:
        return report

    def converted(progress: Progress) -> None:
        picture = progress.picture
        if picture is not None:
            picture = picture._replace(rgba=color_channels.rgba_to_rec709(picture.rgba, space))
        report(progress._replace(picture=picture))

    return converted


def _brightness(image: Image, transparent: bool, threads: int) -> float | None:
    """The greatest red, green or blue of all pixels, which tells whether a picture shows anything.

    Of a `transparent` picture, pixels that nothing covers do not count. None where nothing covers any pixel, without
    finite pixels, and for an enlarged picture, whose pixels may be brighter.
    """
    if image.metadata.get("resolution", 1) > 1:
        return None
    rgba = image.channels["rgba"]
    most, covered = picture_statistics.brightest(rgba, transparent, threads or target.cores())
    return most if (covered or most > 0.0) and np.isfinite(most) else None


def choose_renderer(scene: ir.Scene, plan: Plan, view: types.View) -> Any:
    """The renderer of a picture on this machine: by light groups, by moments of motion, or of a backend; see film.Renderer."""

    def made(scene: ir.Scene, plan: Plan) -> Any:
        def still(scene: ir.Scene) -> Any:
            return kernel_choice.choose_renderer(scene, plan, view)

        return accumulation.Renderer(scene, plan, view, still) if _is_by_moments(plan) else still(scene)

    return light_groups.Renderer(scene, plan, made) if channels.light_groups(plan) else made(scene, plan)


def why_without_checkpoint(plan: Plan) -> str:
    """Why a picture has no checkpoints, as a clause; "" if it has some."""
    if channels.light_groups(plan):
        return "it has channels of light groups"
    if _is_by_moments(plan):
        return f"the rasterizer draws its {'motion' if plan['motion_blur'] else 'depth of field'}"
    if plan["samples"] == 1:
        return "it has one sample a pixel"
    if plan["backend"] == "raster":
        from .raster import band_renderer

        if band_renderer.can_draw(plan):
            return "the rasterizer draws it as a whole"
    return ""


def _is_by_moments(plan: Plan) -> bool:
    return plan["backend"] == "raster" and (plan["motion_blur"] or plan["lens"] == "thin")


def _expected_kernels(scene: ir.Scene, plan: Plan) -> int:
    """About how many kernels a picture of this kind needs, to say how far their compilation is."""
    if plan["backend"] == "reference":
        return 2
    count = 10 if plan["backend"] == "raster" else 6 if plan["transport"] == "path" else 5
    kinds = scene.tables.geometries.kind
    meshes, formulas = (bool((kinds == kind).any()) for kind in (ir.GeometryKind.MESH, ir.GeometryKind.FORMULA))
    return count + 3 * meshes + 5 * formulas


def _measure_bounce_error(renderer: Any, plan: Plan, image: Image, deadline: Deadline) -> bounce_error.Cut | None:
    """The light lost to the limit on bounces; None for partial pictures, light groups, which have a renderer each, and lack of time."""
    grouped = bool(channels.light_groups(plan))
    if image.metadata["partial"] or grouped or not bounce_error.measurable(plan) or not hasattr(renderer, "limit"):
        return None
    if deadline.is_finite:
        seconds = LONGER * image.metadata["pace"] * bounce_error.cost(plan, renderer.cell, image.metadata["rays"])
        if seconds > deadline.left():
            return None
    allowed = decision.error_asked(plan) or max(image.metadata["error"] or 0.0, MISSING_LIGHT)
    return bounce_error.measure(renderer, plan, image.metadata["rays"], allowed)


def count_unproved(renderer: Any) -> int:
    """The number of rays with an interval that could not be proved free of implicit-surface hits; 0 for the reference."""
    if isinstance(renderer, Remote):
        return renderer.unproved
    prepared = getattr(renderer, "prepared", None)  # accumulation has several
    trees = getattr(prepared.accel, "tables", None) if prepared is not None else None
    forms = getattr(trees, "forms", None)  # no BVH where the primitive list holds all instances
    return 0 if forms is None else int(forms.unproved[0])


def _notes(scene: ir.Scene, plan: Plan) -> list[tuple[str, str, int]]:
    """Effects that the plan or the backend does not draw."""
    dark = emissive_shapes.without_effect(scene, plan)
    notes_of_scene = [] if dark is None else [(dark.message, "instances", dark.instance)]
    if plan["backend"] != "raster":
        return notes_of_scene
    from .backends.raster import notes

    return [*notes_of_scene, *notes(scene, plan)]
