"""Renderer for --budget: plans samples, resolution and denoising so that the picture is complete at the deadline.

A preview of 1/8 of the size measures the pace. Where a sample of each pixel does not fit into the time, a smaller picture is enlarged.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan import decision
from ...compiler.plan.plan import Plan
from ..film import accumulate, denoise, film
from ..film.deadline import Deadline
from ..film.denoise_time import Denoising, DenoisingTime
from ..film.progress import Progress, Report
from ..film.remote import Remote
from ..image.cryptomatte import Mattes
from ..image.image import Image
from ..jit import compile_events
from ..simd import target
from ..types import View

PREVIEW, PREVIEW_SAMPLES = 8, 8  # times that the preview is smaller, and the most samples of its pixels
SOON = 0.05  # of the seconds left, in which the preview takes more than a sample
DIVISORS = (1, 2, 4, 8)
ENOUGH = 1.5  # samples a pixel that must be affordable
WRITE_START, WRITE = 0.15, 2.5e-7  # seconds of writing a picture, and for each pixel of each channel
AFTER = 0.02  # of the budget, for measuring the light beyond the limit on bounces
MOSTLY = 0.05  # share of filled pixels, up to which a picture is denoised
GRACE = 1.0  # seconds at most, in which the answers of a cluster arrive

Pixels = NDArray[np.float32]


class Work(NamedTuple):
    """How a picture is drawn; the arguments of film.run."""

    renderer: Any
    plan: Plan
    view: View
    report: Report | None
    cancel: threading.Event
    mattes: Mattes | None
    keeper: Any
    progressive: bool


def run(work: Work, deadline: Deadline, put: Callable[[Image], None]) -> Image:
    """Draw a picture, and denoise it as its plan says; `put` writes the channels of light groups.

    Metadata beside that of film.run: "resolution", the divisor of its sides, 1 where each pixel is drawn; "filled", the share of the
    pixels that show others; "denoising_left_out", whether there was no time for it.
    """
    renderer, plan = work.renderer, work.plan
    renderer.limit_time(deadline)
    x0, y0, x1, y1 = plan["crop"]
    pixels = (x1 - x0) * (y1 - y0)
    grace = min(GRACE, 0.1 * deadline.seconds) if isinstance(renderer, Remote) else 0.0
    after = WRITE_START + WRITE * pixels * (4 + 3 * len(plan["aov"])) + AFTER * deadline.seconds + grace
    ends = deadline.earlier(min(after, 0.3 * deadline.seconds))
    times = DenoisingTime(renderer, plan, ends) if decision.may_denoise(plan) else None
    resumes = work.keeper is not None and work.keeper.found is not None
    preview, compiled = None, compile_events.compiled()
    if not resumes and not isinstance(renderer, Remote):
        preview = _draw_preview(work, ends)
        if compile_events.compiled() > compiled:  # it measured the compiler
            preview = _draw_preview(work, ends)
    divisor = 1 if preview is None else _divisor(preview, plan, pixels, ends)
    if divisor == 1:
        return _draw(work, 1, (preview, times), ends, put)
    extras = film.run_channels(renderer, plan, work.cancel, work.mattes, ends) if plan["aov"] else None
    return _at_full_size(plan, _draw(work, divisor, (preview, times), ends, put), divisor, extras)


def _draw_preview(work: Work, ends: Deadline) -> Image | None:
    """A picture of 1/PREVIEW of the size, which measures the pace; None if the renderer cannot draw it.

    Its pixels have a sample in any case, and more if that takes little time.
    """
    small = _reduced(work.plan, PREVIEW, samples=PREVIEW_SAMPLES, aov=())
    if not work.renderer.resize(*small["size"]):
        return None
    try:
        soon = Deadline(max(SOON * ends.left(), 0.0), None, ends.clock)
        return film.run(work.renderer, small, _view(small), None, work.cancel, deadline=soon, grants=True)
    finally:
        work.renderer.resize(*work.plan["size"])


def _divisor(preview: Image, plan: Plan, pixels: int, ends: Deadline) -> int:
    """How many times smaller the sides of the picture are that there is time for."""
    threads = min(int(plan["threads"]) or target.cores(), target.cores())
    affordable = max(ends.left(), 0.0) * threads / max(preview.metadata["pace"], 1e-12)
    return next((divisor for divisor in DIVISORS if affordable * divisor**2 >= ENOUGH * pixels), DIVISORS[-1])


def _draw(
    work: Work, divisor: int, known: tuple[Image | None, DenoisingTime | None], ends: Deadline, put: Callable[[Image], None]
) -> Image:  # fmt: skip
    """The picture at 1/divisor of its size, denoised if there is time."""
    preview, times = known
    plan = work.plan if divisor == 1 else _reduced(work.plan, divisor, aov=())
    x0, y0, x1, y1 = plan["crop"]
    planned = times.plan((x1 - x0) * (y1 - y0)) if times is not None else None
    until = ends.earlier(planned.seconds) if planned is not None else ends
    if divisor > 1:
        work.renderer.resize(*plan["size"])
    try:
        of_whole = (work.mattes, work.keeper, work.progressive) if divisor == 1 else (None, None, False)
        image = film.run(work.renderer, plan, _view(plan), work.report if divisor == 1 else None, work.cancel, *of_whole, until)
        put(image)
        _fill(image, preview, plan)
        _denoise(work, image, plan, planned, ends)
    finally:
        if divisor > 1:
            work.renderer.resize(*work.plan["size"])
    return image


def _denoise(work: Work, image: Image, plan: Plan, planned: Denoising | None, ends: Deadline) -> None:
    """Denoise the picture, if its error asks for it and there is time."""
    if not decision.denoises(plan, image.metadata["error"], image.metadata["partial"]):
        return
    if planned is None or image.metadata["filled"] > MOSTLY or ends.left() < 0.5 * planned.seconds:
        image.metadata["denoising_left_out"] = True
        return
    if work.report is not None:
        work.report(Progress("denoising"))
    denoise.denoise(image, work.renderer, plan, planned.samples, planned.measures)


def _at_full_size(plan: Plan, small: Image, divisor: int, extras: Image | None) -> Image:
    """The picture enlarged, with the other channels of `extras`."""
    about = dict(small.metadata)
    x0, y0, x1, y1 = plan["crop"]
    width, height = x1 - x0, y1 - y0
    channels = {"rgba": enlarged(small.channels["rgba"], about["size"], about["crop"], plan["size"], plan["crop"])}
    if extras is not None:
        channels |= {name: channel for name, channel in extras.channels.items() if name != "rgba"}
        about["without_channels"] = extras.metadata["without_channels"]
    share = about["rays"] / (width * height)
    for name, value in (("samples", share), ("variance", accumulate.LARGEST)):
        if name in channels:
            channels[name][...] = value
    about.update(
        size=tuple(plan["size"]), crop=tuple(plan["crop"]), resolution=divisor, samples_mean=share, samples=share, variance=None,
        half_difference=None, filled=1.0 - (1.0 - about["filled"]) / divisor**2,
    )  # fmt: skip
    return Image(width, height, channels, about)


def _fill(image: Image, preview: Image | None, plan: Plan) -> None:
    """Fill pixels without a sample: from the preview, else from the nearest pixels of their rows and columns."""
    missing = image.metadata.pop("undrawn")
    image.metadata.update(filled=0.0 if missing is None else float(missing.mean()), resolution=1)
    if missing is None:
        return
    rgba = image.channels["rgba"]
    if preview is not None:
        about = preview.metadata
        rgba[missing] = enlarged(preview.channels["rgba"], about["size"], about["crop"], plan["size"], plan["crop"])[missing]
    elif not missing.all():
        rows, columns = _nearest(missing)
        for name, channel in image.channels.items():
            if name == "rgba" or name.startswith("light:"):
                channel[...] = channel[rows, columns]


def _nearest(missing: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(rows, columns) (h, w) of the pixel that each shows: the nearest in its row that is not missing, in the nearest row with such."""
    width = missing.shape[1]
    some = ~missing.all(axis=1)
    row: NDArray[np.int64] = _nearest_in_rows(some.reshape(1, -1)).reshape(-1)
    column = _nearest_in_rows(~missing[row])
    return np.repeat(row[:, None], width, axis=1), column


def _nearest_in_rows(there: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(h, w) the nearest column that is there, in rows with at least one."""
    width = there.shape[1]
    at = np.arange(width)
    before = np.maximum.accumulate(np.where(there, at, -width), axis=1)
    after = np.minimum.accumulate(np.where(there, at, 2 * width)[:, ::-1], axis=1)[:, ::-1]
    return np.where(at - before <= after - at, before, after)


def enlarged(
    pixels: Pixels, size: tuple[int, int], crop: tuple[int, int, int, int], to_size: tuple[int, int], to_crop: tuple[int, int, int, int]
) -> Pixels:  # fmt: skip
    """The crop of a picture of `to_size`, (h, w, k), between the pixels of a crop of the picture of `size`, linearly."""
    out = pixels
    for axis in (0, 1):
        k = 1 - axis
        at = (np.arange(to_crop[k], to_crop[k + 2]) + 0.5) * (size[k] / to_size[k]) - 0.5 - crop[k]
        at = np.clip(at, 0.0, out.shape[axis] - 1.0)
        low = np.minimum(at.astype(int), max(out.shape[axis] - 2, 0))
        high = np.minimum(low + 1, out.shape[axis] - 1)
        share = (at - low).astype(np.float32).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        out = np.take(out, low, axis) * (1.0 - share) + np.take(out, high, axis) * share
    return np.ascontiguousarray(out, np.float32)


def _reduced(plan: Plan, divisor: int, **values: Any) -> Plan:
    """The plan at 1/divisor of the size."""
    width, height = plan["size"]
    size = max(round(width / divisor), 1), max(round(height / divisor), 1)
    x0, y0, x1, y1 = plan["crop"]
    low = [min(int(v * part / whole), part - 1) for v, part, whole in ((x0, size[0], width), (y0, size[1], height))]
    high = [max(math.ceil(v * part / whole), start + 1) for v, part, whole, start in (
        (x1, size[0], width, low[0]), (y1, size[1], height, low[1]))]  # fmt: skip
    values |= {"size": size, "crop": (*low, *high)}
    return Plan({**plan.decisions, **{name: replace(plan.decisions[name], value=value) for name, value in values.items()}})


def _view(plan: Plan) -> View:
    return View(plan["camera"], *plan["size"])
