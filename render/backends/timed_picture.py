"""Renderer for --budget: plans samples, resolution and denoising so that the picture is complete at the deadline.

A preview of 1/8 of the size measures the pace, a smaller one where that takes long. Where a sample of each pixel does not fit into the
time, a smaller picture is enlarged.
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
COARSE = 2048  # pixels at most of a first preview, from which the pace tells how large the preview is
SOON, BRIEF = 0.05, 0.1  # of the seconds left: in which the preview takes more than a sample, and that a sample of its pixels may take
ENOUGH = 1.5  # samples a pixel that must be affordable
ENLARGE = 4e-8  # seconds for each pixel of an enlarged picture
LATER = 0.05, 0.3  # share of the seconds spent, and seconds at most, that a picture takes after the end: it is late in any case
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


def run(work: Work, deadline: Deadline, write_groups: Callable[[Image], None]) -> Image:
    """Draw a picture, and denoise it as its plan says; `write_groups` writes the channels of light groups.

    Metadata beside that of film.run: "resolution", the divisor of its sides, 1 where each pixel is drawn; "filled", the share of the
    pixels that show others; "denoising_left_out", whether there was no time for it.
    """
    renderer, plan = work.renderer, work.plan
    renderer.limit_time(deadline)
    grace = min(GRACE, 0.1 * deadline.seconds) if isinstance(renderer, Remote) else 0.0
    ends = deadline.earlier(AFTER * deadline.seconds + grace)
    ends.leave(min(LATER[0] * deadline.spent(), LATER[1]))
    times = DenoisingTime(renderer, plan, ends) if decision.may_denoise(plan) else None
    resumes = work.keeper is not None and work.keeper.saved_state is not None
    preview, compiled = None, compile_events.compiled()
    if not resumes and not isinstance(renderer, Remote):
        preview = _draw_preview(work, ends)
        if compile_events.compiled() > compiled:  # it measured the compiler
            preview = _draw_preview(work, ends)
    divisor = 1 if preview is None else _divisor(preview, plan, ends, times)
    if divisor == 1:
        return _draw(work, 1, (preview, times), ends, write_groups)
    ends = ends.earlier(ENLARGE * _pixels(plan, 1))
    ends.leave(0.0)
    extras = film.run_channels(renderer, plan, work.cancel, work.mattes, ends) if plan["aov"] else None
    return _at_full_size(plan, _draw(work, divisor, (preview, times), ends, write_groups), divisor, extras)


def _draw_preview(work: Work, ends: Deadline) -> Image | None:
    """A picture of 1/PREVIEW of the size or less, which measures the pace; None if the renderer cannot draw it.

    Its pixels have a sample in any case, and more if that takes little time. Metadata: "resolution", as of `run`.
    """
    coarsest = PREVIEW
    while _pixels(work.plan, coarsest) > COARSE:
        coarsest *= 2
    preview = _draw_small(work, coarsest, ends)
    if preview is None or coarsest == PREVIEW:
        return preview
    affordable = _affordable(preview, work.plan, BRIEF * ends.left())
    divisor = next(d for d in _divisors(PREVIEW, coarsest) if d == coarsest or affordable >= _pixels(work.plan, d))
    return preview if divisor == coarsest else _draw_small(work, divisor, ends)


def _draw_small(work: Work, divisor: int, ends: Deadline) -> Image | None:
    """A picture of 1/divisor of the size; None if the renderer cannot draw it."""
    small = _reduced(work.plan, divisor, samples=PREVIEW_SAMPLES, aov=())
    if not work.renderer.resize(*small["size"]):
        return None
    try:
        soon = Deadline(max(SOON * ends.left(), 0.0), None, ends.clock)
        image = film.run(work.renderer, small, _view(small), None, work.cancel, deadline=soon, grants=True)
    finally:
        work.renderer.resize(*work.plan["size"])
    image.metadata["resolution"] = divisor
    return image


def _divisor(preview: Image, plan: Plan, ends: Deadline, times: DenoisingTime | None) -> int:
    """How many times smaller the sides of the picture are that there is time for, with its denoising."""
    coarsest = preview.metadata["resolution"]

    def fits(divisor: int) -> bool:
        pixels = _pixels(plan, divisor)
        planned = None if times is None else times.plan(round(pixels))
        seconds = ends.left() - (0.0 if planned is None else planned.seconds)
        if divisor > 1:
            seconds -= ENLARGE * _pixels(plan, 1)
        return _affordable(preview, plan, seconds) >= ENOUGH * pixels

    return next(d for d in (1, *_divisors(2, coarsest)) if d == coarsest or fits(d))


def _divisors(first: int, last: int) -> list[int]:
    """The powers of two from `first` to `last`, which are such."""
    return [1 << k for k in range(first.bit_length() - 1, last.bit_length())]


def _affordable(preview: Image, plan: Plan, seconds: float) -> float:
    """The samples that there are seconds for, at the pace of the preview."""
    threads = min(int(plan["threads"]) or target.cores(), target.cores())
    return max(seconds, 0.0) * threads / max(preview.metadata["pace"], 1e-12)


def _pixels(plan: Plan, divisor: int) -> float:
    """The pixels of a picture of 1/divisor of the size."""
    x0, y0, x1, y1 = plan["crop"]
    return max((x1 - x0) / divisor, 1.0) * max((y1 - y0) / divisor, 1.0)


def _draw(
    work: Work, divisor: int, measured: tuple[Image | None, DenoisingTime | None], ends: Deadline, write_groups: Callable[[Image], None]
) -> Image:  # fmt: skip
    """The picture at 1/divisor of its size, denoised if there is time."""
    preview, times = measured
    plan = work.plan if divisor == 1 else _reduced(work.plan, divisor, aov=())
    x0, y0, x1, y1 = plan["crop"]
    planned = times.plan((x1 - x0) * (y1 - y0)) if times is not None else None
    until = ends.earlier(planned.seconds) if planned is not None else ends
    if divisor > 1:
        work.renderer.resize(*plan["size"])
    try:
        of_whole = (work.mattes, work.keeper, work.progressive) if divisor == 1 else (None, None, False)
        image = film.run(work.renderer, plan, _view(plan), work.report if divisor == 1 else None, work.cancel, *of_whole, until)
        write_groups(image)
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
    """Fill pixels without a sample: from the preview, else from the pixels around."""
    missing = image.metadata.pop("undrawn")
    image.metadata.update(filled=0.0 if missing is None else float(missing.mean()), resolution=1)
    if missing is None:
        return
    rgba = image.channels["rgba"]
    if preview is not None:
        about = preview.metadata
        rgba[missing] = enlarged(preview.channels["rgba"], about["size"], about["crop"], plan["size"], plan["crop"])[missing]
    elif not missing.all():
        for name, channel in image.channels.items():
            if name == "rgba" or name.startswith("light:"):
                fill_holes(channel, missing)


def fill_holes(pixels: Pixels, missing: NDArray[np.bool_]) -> None:
    """Fill the missing pixels of (h, w, k) from means of those around: push-pull, Gortler and others, "The Lumigraph", 1996.

    At least one pixel must be there.
    """
    if not missing.any():
        return
    h, w = missing.shape
    tall, wide = (h + 1) // 2, (w + 1) // 2
    values = np.zeros((2 * tall, 2 * wide, pixels.shape[2] + 1), np.float32)
    values[:h, :w, :-1], values[:h, :w, -1] = np.where(missing[..., None], 0.0, pixels), ~missing
    sums = values.reshape(tall, 2, wide, 2, -1).sum((1, 3))
    half = sums[..., :-1] / np.maximum(sums[..., -1:], 1.0)
    fill_holes(half, sums[..., -1] == 0.0)
    between = enlarged(half, (wide, tall), (0, 0, wide, tall), (2 * wide, 2 * tall), (0, 0, w, h))
    pixels[missing] = np.clip(between, half.min((0, 1)), half.max((0, 1)))[missing]  # rounding makes no alpha of 1 smaller


def enlarged(
    pixels: Pixels, size: tuple[int, int], crop: tuple[int, int, int, int], to_size: tuple[int, int], to_crop: tuple[int, int, int, int]
) -> Pixels:  # fmt: skip
    """The crop of a picture of `to_size`, (h, w, k), between the pixels of a crop of the picture of `size`, linearly."""
    (low, high, share), (lows, highs, shares) = (_between(pixels.shape[1 - k], size, crop, to_size, to_crop, k) for k in (0, 1))
    wide = np.take(pixels, low, 1) * (1.0 - share[:, None]) + np.take(pixels, high, 1) * share[:, None]
    out = np.empty((to_crop[3] - to_crop[1], *wide.shape[1:]), np.float32)
    part = np.empty_like(wide[0])
    for y in range(len(out)):  # one row after the other, in the cache of a processor
        np.multiply(wide[lows[y]], np.float32(1.0) - shares[y], out=out[y])
        out[y] += np.multiply(wide[highs[y]], shares[y], out=part)
    return out


def _between(
    count: int, size: tuple[int, int], crop: tuple[int, int, int, int], to_size: tuple[int, int], to_crop: tuple[int, int, int, int], k: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:  # fmt: skip
    """For each row or column of an enlarged picture: the two of `count` that it is between, and the share of the second."""
    positions = (np.arange(to_crop[k], to_crop[k + 2]) + 0.5) * (size[k] / to_size[k]) - 0.5 - crop[k]
    positions = np.clip(positions, 0.0, count - 1.0)
    low = np.minimum(positions.astype(np.int64), max(count - 2, 0))
    return low, np.minimum(low + 1, count - 1), (positions - low).astype(np.float32)


def _reduced(plan: Plan, divisor: int, **values: Any) -> Plan:
    """The plan at 1/divisor of the size."""
    width, height = plan["size"]
    size = max(round(width / divisor), 1), max(round(height / divisor), 1)
    x0, y0, x1, y1 = plan["crop"]
    low = [min(int(v * part / full), part - 1) for v, part, full in ((x0, size[0], width), (y0, size[1], height))]
    high = [max(math.ceil(v * part / full), start + 1) for v, part, full, start in (
        (x1, size[0], width, low[0]), (y1, size[1], height, low[1]))]  # fmt: skip
    values |= {"size": size, "crop": (*low, *high)}
    return Plan({**plan.decisions, **{name: replace(plan.decisions[name], value=value) for name, value in values.items()}})


def _view(plan: Plan) -> View:
    return View(plan["camera"], *plan["size"])
