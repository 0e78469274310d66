"""Diagnostics about a picture: effects left out, unproved rays, invalid samples, light beyond the limit on bounces, a missed error."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..compiler import ir
from ..compiler.plan import decision
from ..compiler.plan import plan as planner
from ..compiler.plan.plan import Plan
from ..lang.diagnostics import Diagnostic
from ..lang.distribution import install_command
from ..lang.plain_values import time_range
from ..lang.schema.picture_settings import MAX_BOUNCES
from .film.deadline import Deadline
from .jit import cache_folder, kernel_cache

if TYPE_CHECKING:
    from .film.bounce_error import Cut

NOISY = 0.05  # √relMSE from which a note says how to lower it
BLACK, BRIGHT = 0.001, 0.7  # brightness after exposure: below which a note calls a picture black, and that with its hint
LATE, LATE_SHARE = 0.5, 0.1  # seconds, and share of a budget, from which a warning tells of a later end
MATTERS = 0.3  # share of the seconds that a picture is late, from which a step is named
WAITING = 0.5  # CPU seconds a second, below which a process mostly waits
SLOWED = "other work or a slow disk delays it: end that work, or give a longer --budget"
SPARSE, SEEN = 0.4, 0.02  # share of the squared error in few pixels, and error, from which a note calls the estimate uncertain


def of_render(about: Mapping[str, Any], scene: ir.Scene, plan: Plan, settings: ir.Settings) -> list[Diagnostic]:
    """All diagnostics about a picture with the metadata `about`, drawn with these settings, without those of `plan_warnings`."""
    planned = {note.message for note in planner.notes(scene, plan)}
    return [
        *(Diagnostic("note", message, scene.spans.get(table, row)) for message, table, row in about["notes"] if message not in planned),
        *unproved_warnings(about["unproved"]),
        *invalid_sample_warnings(about["issues"]),
        *bounce_limit_notes(about.get("cut"), scene, plan),
        *budget_warnings(about, plan),
        *missed_error_warnings(about, plan),
        *sparse_error_notes(about),
        *exposure_notes(about),
        *cropped_notes(about, plan),
        *unkept_kernel_notes(),
        *([] if settings.samples or scene.settings.samples else noise_notes(about, plan)),
    ]


def plan_warnings(scene: ir.Scene, plan: Plan) -> list[Diagnostic]:
    """Notes on parts without effect, and warnings about the scene."""
    return [*planner.notes(scene, plan), *(Diagnostic("warning", text) for text in planner.warnings(scene, plan))]


def invalid_sample_warnings(samples: int) -> list[Diagnostic]:
    """The warning about samples with infinite or nan radiance."""
    if not samples:
        return []
    are = "the light of 1 sample was" if samples == 1 else f"the light of {samples:,} samples was"
    message = f"{are} infinite or no number, and left out of the picture"
    return [Diagnostic("warning", message, None, "some intensity or size is too large")]


def bounce_limit_notes(cut: Cut | None, scene: ir.Scene, plan: Plan) -> list[Diagnostic]:
    """The note about light lost by the limit on bounces; a warning if an error target is set."""
    if cut is None or not cut.matters:
        return []
    target = decision.error_asked(plan)
    than = "is the error asked for" if target else "noise hides"
    message = f"the limit of {plan['bounces']} bounces leaves out {cut.share:.1%} of a place's light (± {cut.error:.1%}), more than {than}"
    enough = cut.enough or MAX_BOUNCES
    hint = f"render(bounces: {enough}) or --bounces {enough} leaves out less" + ("" if cut.enough else "; here light does not fade")
    return [Diagnostic("warning" if target else "note", message, scene.spans.get("settings", 0), hint)]


def budget_warnings(about: Mapping[str, Any], plan: Plan) -> list[Diagnostic]:
    """Warnings about what a picture lacks as its budget had no time for it."""
    budget, warnings, divisor = f"the budget of {plan['budget']:g} s", [], about.get("resolution", 1)
    if about.get("partial"):
        return []
    if divisor > 1:
        width, height = (max(round(side / divisor), 1) for side in plan["size"])
        message = f"{budget} has no time for a sample of each pixel: the picture is drawn at {width}x{height} pixels and enlarged"
        warnings.append(Diagnostic("warning", message, None, f"a longer --budget, or --size {width}x{height}"))
    elif about.get("filled", 0.0) > 0.0:
        message = f"{budget} ended before {about['filled']:.1%} of the pixels had a sample: they show what is near"
        warnings.append(Diagnostic("warning", message, None, "a longer --budget or a smaller --size"))
    if about.get("without_channels"):
        message = f"{budget} ended before the channels of {about['without_channels']} tiles were drawn: they are empty"
        warnings.append(Diagnostic("warning", message, None, "a longer --budget or a smaller --size"))
    if about.get("denoising_left_out"):
        kind = "warning" if plan["denoise"] == "on" else "note"
        warnings.append(Diagnostic(kind, f"the picture is not denoised: {budget} has no time for it", None, "a longer --budget"))
    return warnings


def late_warnings(about: Mapping[str, Any], deadline: Deadline, what: str = "the picture") -> list[Diagnostic]:
    """The warning about a picture, or another `what`, that was ready after the end of its budget, with what took the time.

    `about` is the metadata of a picture. Without its "seconds" and "ready" no step is named.
    """
    spent = deadline.spent()
    late = spent - deadline.seconds
    if about.get("partial") or not deadline.is_finite or late < max(LATE, LATE_SHARE * deadline.seconds):
        return []
    compiling, ready, writing = about.get("seconds", {}).get("compile_kernels", 0.0), about.get("ready", 0.0), _writing(about)
    message = f"{what} took {spent:.1f} s, more than its budget of {deadline.seconds:g} s"
    if compiling > 0.5 * late:
        return [Diagnostic("warning", f"{message}: compiling kernels took {compiling:.1f} s, once", None, "render again")]
    steps, slow = [], ""
    if ready > MATTERS * late:
        slow = _without_processor(ready, about.get("ready_cpu", ready))
        steps.append(", ".join(filter(None, (f"reading and preparing the scene took {ready:.1f} s", slow))))
    if writing > MATTERS * late:
        steps.append(f"writing the picture took {writing:.1f} s")
    reason = f": {'; '.join(steps)}"
    if not steps:
        slow = _without_processor(spent, deadline.cpu_spent())
        if not slow:
            return [Diagnostic("warning", message, None, "other work slows this machine, or a step took longer than measured")]
        reason = f", {slow}"
    hint = SLOWED if slow else "a longer --budget or a smaller --size" if writing > ready else "a longer --budget"
    return [Diagnostic("warning", message + reason, None, hint)]


def _writing(about: Mapping[str, Any]) -> float:
    return about.get("seconds", {}).get("write", 0.0)


def late_drawing_warnings(about: Mapping[str, Any], plan: Plan, what: str = "the picture") -> list[Diagnostic]:
    """As late_warnings, of a picture that counts until it is drawn, not written."""
    return late_warnings(about, Deadline.ended(plan["budget"], about["elapsed"], about["elapsed_cpu"]), what)


def _without_processor(seconds: float, cpu: float) -> str:
    """A clause about seconds in which the process mostly waited for a processor or a disk; "" if it did not."""
    return f"of which a processor worked {cpu:.1f} s" if cpu < WAITING * seconds else ""


def missed_error_warnings(about: Mapping[str, Any], plan: Plan) -> list[Diagnostic]:
    """The warning about a picture that ended, by its budget or its most samples, above the error asked for."""
    target, reached = decision.error_asked(plan), about.get("error")
    if about.get("partial") or not target or (reached is not None and reached <= target):
        return []
    end = f"the budget of {plan['budget']:g} s" if math.isfinite(plan["budget"]) else f"the limit of {plan['samples']:,} samples a pixel"
    how = "before its error was known" if reached is None else f"at an error of {reached:.2%}"
    message = f"{end} ended the render {how}; {target:.2%} was asked for"
    return [Diagnostic("warning", message, None, "a longer --budget or a larger --error")]


def sparse_error_notes(about: Mapping[str, Any]) -> list[Diagnostic]:
    """The note about an error that stray bright samples decide: how many a picture has, and which it lacks, is chance."""
    if about.get("partial") or (about.get("error") or 0.0) < SEEN or about.get("error_in_few", 0.0) < SPARSE:
        return []
    message = f"{about['error_in_few']:.0%} of the squared error is in 0.1 % of the pixels: stray bright samples, so the error is uncertain"
    return [Diagnostic("note", message, None, "larger lights, rougher glass and metals, or more samples have fewer of them")]


def exposure_notes(about: Mapping[str, Any]) -> list[Diagnostic]:
    """The note about a picture that its exposure shows as black; not if pixels without a sample may be brighter."""
    bright, stops = about.get("brightness"), about.get("exposure")
    if about.get("partial") or bright is None or isinstance(stops, str) or stops is None or bright * 2.0**stops >= BLACK:
        return []
    if about.get("resolution", 1) > 1 or about.get("filled", 0.0) > 0.0:
        return []
    size = about.get("size", (0, 0))
    what, shown = ("picture", "the camera sees") if tuple(about.get("crop", (0, 0, *size))) == (0, 0, *size) else ("crop", "it shows")
    if bright <= 0.0:
        return [Diagnostic("note", f"the {what} is black: no light reaches what {shown}", None, "--aov depth shows the shapes")]
    message = f"the {what} is black: its brightest pixels have {bright:.2g} of the light of white, at an exposure of {stops:g}"
    return [Diagnostic("note", message, None, f"--exposure {math.log2(BRIGHT / bright):.0f} shows it, or brighter lights")]


def cropped_notes(about: Mapping[str, Any], plan: Plan) -> list[Diagnostic]:
    """The note about a crop that was denoised without the picture around it."""
    (width, height), (x0, y0, x1, y1) = plan["size"], plan["crop"]
    if not about.get("denoised") or (x0 <= 0 and y0 <= 0 and x1 >= width and y1 >= height):
        return []
    message = "the crop is denoised without the pixels around it: at its edges it may differ from the whole picture"
    return [Diagnostic("note", message, None, "a crop that is 96 pixels larger on each side has the same pixels inside, or --no-denoise")]


def unkept_kernel_notes() -> list[Diagnostic]:
    """The note about compiled kernels that could not be kept for later runs."""
    count, reason = kernel_cache.unkept()
    if not count:
        return []
    kernels = "1 kernel was" if count == 1 else f"{count} kernels were"
    message = f"{kernels} compiled and cannot be kept for the next run in {kernel_cache.CACHE}: {reason}"
    hint = "MAQUETTE_CACHE_SIZE takes more" if cache_folder.VARIABLE in reason else "MAQUETTE_CACHE names another folder"
    return [Diagnostic("note", message, None, hint)]


def noise_notes(about: Mapping[str, Any], plan: Plan) -> list[Diagnostic]:
    """The note about a picture that is noisy, or was before denoising, after the default samples or a budget: what less noise costs."""
    error, default, by_error = about.get("error"), decision.by_default(plan), plan["denoise"] == "above_error"
    if not plan["monte_carlo"] or plan["denoise"] == "on" or about.get("partial") or about.get("resolution", 1) > 1:
        return []
    if decision.adaptive(plan) and not default and not by_error:
        return []
    if about.get("denoised") and error is None:
        message = f"the picture is denoised: {_limit_of(plan)} ended before its error was known"
        return [Diagnostic("note", message, None, "a longer --budget leaves less noise; --no-denoise shows it")]
    target = decision.denoised_above(plan) if default or by_error else NOISY
    if error is None or error <= target:
        return []
    longer = f"--error {target:.0%} takes about {time_range((error / target) ** 2 * about['seconds']['render'])}"
    work, remaining = _limit_of(plan), about.get("denoised_error")
    if about.get("denoised"):
        after = "there was no time to measure what is left" if remaining is None else f"about {remaining:.1%} are left"
        now = f"its error was {error:.1%}, and {after}"
        return [Diagnostic("note", f"the picture was noisy after {work}, and is denoised: {now}", None, f"{longer} without denoising")]
    if remaining is not None:
        hint = f"{longer}; denoising would leave an error of about {remaining:.0%}"
        return [Diagnostic("note", f"the picture is noisy: its error is {error:.0%} with {work}", None, hint)]
    smooth = "--denoise smooths it" if importlib.util.find_spec("pyoidn") else f"{install_command('denoise')} smooths it"
    return [Diagnostic("note", f"the picture is noisy: its error is {error:.0%} with {work}", None, f"{longer}; {smooth}")]


def _limit_of(plan: Plan) -> str:
    """The limit that ended a picture whose error was not asked for."""
    if math.isfinite(plan["budget"]):
        return f"a budget of {plan['budget']:g} s"
    return f"the default of {'at most ' if decision.by_default(plan) else ''}{plan['samples']} samples a pixel"


def unproved_warnings(rays: int) -> list[Diagnostic]:
    """The warning about rays whose first hit of an implicit surface could not be proved."""
    if not rays:
        return []
    message = f"{rays:,} rays passed places where a formula's surface could neither be found nor ruled out"
    return [Diagnostic("warning", message, None, "--aov issues (in an .exr) shows where")]
