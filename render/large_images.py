"""Pictures too large to be held: strips of rows, each drawn as a crop and given on before the next.

A sample depends on its pixel's place in the whole picture, never on a crop, so that strips are what the whole would be. An error that
is asked for is each strip's own, and a budget is shared out by rows.
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
from . import render_scene
from .film import bounce_error, film
from .image.image import Image

HELD = 1 << 27  # pixels of a picture that is held whole: 2 GiB of red, green, blue and coverage
STRIP = 1 << 24  # of a strip
STEPS = 100  # of progress in a strip


def plans(plan: Plan) -> list[Plan]:
    """The plan itself, or one for each strip, from the top down."""
    x0, y0, x1, y1 = plan["crop"]
    if (x1 - x0) * (y1 - y0) <= HELD:
        return [plan]
    rows = max(STRIP // (x1 - x0) // film.TILE, 1) * film.TILE  # tiles are those of the whole picture
    ends = [(y, min(y + rows, y1)) for y in range(y0, y1, rows)]
    return [_changed(plan, crop=(x0, top, x1, end), budget=plan["budget"] * (end - top) / (y1 - y0)) for top, end in ends]


def refusal(plan: Plan) -> str:
    """Why a plan cannot be drawn in strips: what needs the whole picture at once; "" where nothing does."""
    if plan["denoise"]:
        return "denoising needs the whole picture: leave it out"
    if plan["exposure"] == "metered":
        return "metering needs the whole picture: give --exposure"
    return ""


def images(
    scene: ir.Scene, strips: Sequence[Plan], progress: Callable[[int, int], None], cancel: threading.Event
) -> Iterator[Image]:  # fmt: skip
    """Draw one strip after the other; what is left when `cancel` is set comes empty and partial."""
    for k, plan in enumerate(strips):

        def told(done: int, total: int, before: int = k) -> None:
            progress(before * STEPS + done * STEPS // total, len(strips) * STEPS)

        yield render_scene.draw(scene, plan, told, cancel)


def joined(about: Sequence[dict[str, Any]], plan: Plan) -> dict[str, Any]:
    """What the strips' metadata come to for all of them, as draw.draw tells it of one picture."""
    pixels = np.array([(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in (one["crop"] for one in about)], np.float64)
    errors = [one["error"] for one in about]
    known = all(error is not None for error in errors)
    seconds: dict[str, float] = {}
    for one in about:
        for stage, spent in one["seconds"].items():
            seconds[stage] = seconds.get(stage, 0.0) + spent
    sums = {name: sum(one[name] for one in about) for name in ("rays", "issues", "unproved")}
    return {
        **about[0], **sums, "crop": plan["crop"], "samples": max(one["samples"] for one in about),
        "samples_mean": float(np.average([one["samples_mean"] for one in about], weights=pixels)),
        "error": math.sqrt(float(np.average(np.square(errors), weights=pixels))) if known else None,
        "partial": any(one["partial"] for one in about), "seconds": seconds, "variance": None,
        "cut": bounce_error.joined([one["cut"] for one in about], pixels),
    }  # fmt: skip


def _changed(plan: Plan, **values: Any) -> Plan:
    return Plan({**plan.decisions, **{name: replace(plan.decisions[name], value=value) for name, value in values.items()}})
