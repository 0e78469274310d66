"""Renders pictures too large for memory as strips of rows, one after the other.

Each strip is a crop. Samples depend on the pixel's position in the whole picture, not on the crop, so strips equal the whole picture.
Each strip meets a requested error by itself; what is left of a budget is divided by the rows that are left.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.plan.plan import Plan
from .film import bounce_error, film
from .film.deadline import Deadline
from .film.progress import Progress, Report
from .image.image import Image

MAX_PIXELS = 1 << 27  # of a picture rendered at once: 2 GiB of red, green, blue and coverage
STRIP_PIXELS = 1 << 24

Draw = Callable[..., Image]  # render_scene.draw, or one with its parameters


def strip_plans(plan: Plan, most: int = MAX_PIXELS) -> list[Plan]:
    """The plan itself, or one for each strip from the top; `most` pixels fit into memory."""
    x0, y0, x1, y1 = plan["crop"]
    if (x1 - x0) * (y1 - y0) <= min(most, MAX_PIXELS):
        return [plan]
    rows = max(min(STRIP_PIXELS, most) // (x1 - x0) // film.TILE, 1) * film.TILE  # the same tiles as of the whole picture
    ends = [(y, min(y + rows, y1)) for y in range(y0, y1, rows)]
    overrides = {} if plan["denoise"] == "on" else {"denoise": "off"}  # the default needs the whole picture
    return [_with_values(plan, crop=(x0, top, x1, end), **overrides) for top, end in ends]


def refusal(plan: Plan, exposed: bool = True) -> str:
    """The message why a plan cannot be rendered in strips to a file that shows light `exposed`; "" if it can."""
    if plan["denoise"] == "on":
        return "denoising needs the whole picture: leave it out"
    if plan["bloom"] > 0.0:
        return "bloom needs the whole picture: leave it out"
    if exposed and plan["exposure"] == "metered":
        return "metering needs the whole picture: give --exposure"
    return ""


def draw_strips(
    draw: Draw, scene: ir.Scene, strips: Sequence[Plan], report: Report, cancel: threading.Event, deadline: Deadline
) -> Iterator[Image]:  # fmt: skip
    """Yield the picture of each strip, as `draw` draws it. After `cancel` is set, the remaining strips are empty and partial."""
    end = strips[-1]["crop"][3]
    for k, plan in enumerate(strips):
        _, top, _, bottom = plan["crop"]
        part = deadline.part((bottom - top) / (end - top))

        def of_all(progress: Progress, before: int = k) -> None:
            report(progress._replace(share=(before + progress.share) / len(strips)))

        image = draw(scene, plan, of_all, cancel, deadline=part)
        if k == 0:  # what came before the strips counts, too
            image.metadata["ready"] += part.began - deadline.began
            image.metadata["ready_cpu"] += part.processed - deadline.processed
        yield image


def join_metadata(about: Sequence[dict[str, Any]], plan: Plan) -> dict[str, Any]:
    """The metadata of the whole picture, as render_scene.draw gives it, from those of its strips."""
    pixels = np.array([(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in (strip["crop"] for strip in about)], np.float64)
    errors = [strip["error"] for strip in about]
    all_known = all(error is not None for error in errors)
    seconds: dict[str, float] = {}
    bright = [strip["brightness"] for strip in about if strip["brightness"] is not None]
    for strip in about:
        for stage, spent in strip["seconds"].items():
            seconds[stage] = seconds.get(stage, 0.0) + spent
    sums = {name: sum(strip[name] for strip in about) for name in ("rays", "issues", "unproved")}
    reduced = {  # of a budget, in the words of backends/timed_picture.run; the worst strip
        "resolution": max(strip.get("resolution", 1) for strip in about),
        "without_channels": sum(strip.get("without_channels", 0) for strip in about),
        "filled": float(np.average([strip.get("filled", 0.0) for strip in about], weights=pixels)),
        "denoising_left_out": any(strip.get("denoising_left_out") for strip in about),
    }  # fmt: skip
    return {
        **about[0], **sums, **reduced, "crop": plan["crop"], "samples": max(strip["samples"] for strip in about),
        "samples_mean": float(np.average([strip["samples_mean"] for strip in about], weights=pixels)),
        "error": math.sqrt(float(np.average(np.square(errors), weights=pixels))) if all_known else None,
        "partial": any(strip["partial"] for strip in about), "seconds": seconds,
        "variance": None, "half_difference": None, "error_in_few": 0.0,
        "brightness": max(bright, default=None),
        "cut": (cut := bounce_error.combine([strip["cut"] for strip in about], pixels)),
        "bias": about[0]["bias"] if cut is None else max(cut.share, 0.0),
    }  # fmt: skip


def _with_values(plan: Plan, **values: Any) -> Plan:
    return Plan({**plan.decisions, **{name: replace(plan.decisions[name], value=value) for name, value in values.items()}})
