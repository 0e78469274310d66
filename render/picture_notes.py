"""Diagnostics about a picture: effects left out, unproved rays, invalid samples, light beyond the limit on bounces, a missed error."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..compiler import ir
from ..compiler.plan import plan as planner
from ..compiler.plan.plan import Plan
from ..lang.diagnostics import Diagnostic
from ..lang.plain_values import time_range
from ..lang.schema.elements import MAX_BOUNCES

if TYPE_CHECKING:
    from .film.bounce_error import Cut

NOISY = 0.05  # √relMSE from which a note says how to lower it


def of_render(about: Mapping[str, Any], scene: ir.Scene, plan: Plan, asked: ir.Settings) -> list[Diagnostic]:
    """All diagnostics about a picture whose metadata is `about`, rendered with the settings `asked` for."""
    return [
        *(Diagnostic("note", message, scene.spans.at(table, row)) for message, table, row in about["notes"]),
        *unproved_warnings(about["unproved"]),
        *invalid_sample_warnings(about["issues"]),
        *bounce_limit_notes(about.get("cut"), scene, plan),
        *missed_error_warnings(about, plan),
        *([] if asked.samples or scene.settings.samples else noise_notes(about, plan)),
    ]


def plan_warnings(scene: ir.Scene, plan: Plan) -> list[Diagnostic]:
    """Notes on former names of decisions, and warnings about the scene."""
    notes = [Diagnostic("note", text) for text in plan.notes]
    return [*notes, *(Diagnostic("warning", text) for text in planner.warnings(scene, plan))]


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
    than = "is the error asked for" if plan["error"] else "noise hides"
    message = f"the limit of {plan['bounces']} bounces leaves out {cut.share:.1%} of a place's light (± {cut.error:.1%}), more than {than}"
    enough = cut.enough or MAX_BOUNCES
    hint = f"render(bounces: {enough}) or --bounces {enough} leaves out less" + ("" if cut.enough else "; here light does not fade")
    return [Diagnostic("warning" if plan["error"] else "note", message, scene.spans.at("settings", 0), hint)]


def missed_error_warnings(about: Mapping[str, Any], plan: Plan) -> list[Diagnostic]:
    """The warning about a picture that ended, by its budget or its most samples, above the error asked for."""
    asked, reached = plan["error"], about.get("error")
    if about.get("partial") or not asked or (reached is not None and reached <= asked):
        return []
    end = f"the budget of {plan['budget']:g} s" if math.isfinite(plan["budget"]) else f"the limit of {plan['samples']:,} samples a pixel"
    how = "before its error was known" if reached is None else f"at an error of {reached:.2%}"
    message = f"{end} ended the render {how}; {asked:.2%} was asked for"
    return [Diagnostic("warning", message, None, "a longer --budget or a larger --error")]


def noise_notes(about: Mapping[str, Any], plan: Plan) -> list[Diagnostic]:
    """The note about a noisy picture of the default number of samples: what less noise costs."""
    error = about.get("error")
    if not plan["monte_carlo"] or plan["denoise"] or plan["error"] or math.isfinite(plan["budget"]) or about.get("partial"):
        return []
    if error is None or error <= NOISY:
        return []
    longer = (error / NOISY) ** 2 * about["seconds"]["render"]
    message = f"the picture is noisy: its error is {error:.0%} with the default of {plan['samples']} samples a pixel"
    return [Diagnostic("note", message, None, f"--error {NOISY:.0%} takes about {time_range(longer)}; --denoise smooths it")]


def unproved_warnings(rays: int) -> list[Diagnostic]:
    """The warning about rays whose first hit of an implicit surface could not be proved."""
    if not rays:
        return []
    message = f"{rays:,} rays passed places where a formula's surface could neither be found nor ruled out"
    return [Diagnostic("warning", message, None, "--aov issues (in an .exr) shows where")]
