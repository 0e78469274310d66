"""A first estimate of a chart: small pictures of the ray backend tell how many samples an error takes, and how long.

Noise falls as n^(-1/2) with n samples a pixel (Monte Carlo), slower than Sobol points in practice; bias does not fall. Time grows with
n and with the pixels. Tiny pictures come first, then larger ones, of SAMPLES of each pixel, as far as they fit into the time: their
difference separates the time of samples from that of photons and tiles, and checks the model of the noise.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, replace
from typing import NamedTuple

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ...render import render_scene
from ...render.film.deadline import Deadline
from ...render.jit import cancellation
from .. import formatting
from . import runs
from .reference_light import ReferenceLight

DIVISOR, SMALLEST, TINY = 4, 48, 16  # of the size of the pictures, and pixels of their shorter side, and of that of the tiny one
SAMPLES = (4, 16)
SPREAD = 1.3  # factor of the samples, either way, beyond the disagreement of both pictures
ALONE, TINY_ALONE = 2.0, 4.0  # in place of that disagreement, where one picture was drawn, and where that was the tiny one
LOADING = 3.0  # seconds in which the first picture loads kernels, on a busy machine
CLEAR = 0.1  # seconds that one picture takes longer than another, from which on other work on the machine hides it no more
STRAY = 4.0  # most of the factor by which stray bright samples widen it


@dataclass(frozen=True, slots=True)
class Estimate:
    """How the ray backend's noise and time depend on the samples of a picture."""

    how: str  # "paths", or "" without
    pixels: int
    error: float  # √relMSE with one sample a pixel; inf: unknown
    wrong: float  # factor, at least 1, by which the square of `error` may be wrong, either way
    start: float  # seconds of a picture without samples: BVHs, photons
    each: float  # seconds of a sample of one pixel

    def samples(self, target: float) -> tuple[float, float, float]:
        """(samples a pixel for a target error, at least, at most)."""
        count = max((self.error / target) ** 2, 1.0)
        factor = SPREAD * self.wrong
        return count, max(count / factor, 1.0), count * factor

    def seconds(self, samples: float) -> float:
        """Seconds of a picture."""
        return self.start + self.each * self.pixels * samples

    def answer(self, target: float) -> str:
        """The answer to "which setting has this error in the least time?"."""
        wanted, ray = formatting.target("relmse", target), f"ray{f' with {self.how}' if self.how else ''}"
        if not math.isfinite(self.error):
            return f"{wanted}: {ray}, unknown: the budget has no time for a first estimate"
        count, low, high = self.samples(target)
        times = [formatting.seconds(self.seconds(n)) for n in (count, low, high)]
        return (
            f"{wanted}: {ray}, about {_round(count)} samples ({_round(low)} to {_round(high)}), "
            f"about {times[0]} ({times[1]} to {times[2]}), estimated from small pictures"
        )


def _round(samples: float) -> str:
    return f"{float(f'{samples:.2g}'):,.0f}"


class _Picture(NamedTuple):
    """A small picture that was drawn, or a part of it."""

    samples: int  # of a pixel
    rays: int
    pixels: int
    build: float  # seconds
    render: float  # seconds
    error: float | None
    pace: float  # seconds of a sample, by the calls of the renderer
    stray: float  # share of the squared error in stray bright samples
    tiny: bool


def make(scene: ir.Scene, light: ReferenceLight, cancel: threading.Event, seconds: float = math.inf) -> Estimate | None:
    """The estimate of a scene, in so many seconds after the first picture; None where the pictures have no noise.

    The first picture takes as long, or LOADING seconds if that is more. Raises runs.Cancelled.
    """
    plan, limit = light.plan(scene), Deadline(max(seconds, LOADING))
    small, tiny = _size(plan, SMALLEST), _size(plan, TINY)
    pictures: list[_Picture] = []
    with limit.watch_compiler():
        for size, samples in [(size, samples) for size in (tiny, small) for samples in SAMPLES]:
            if pictures:
                estimate = _fitted(plan, pictures)
                if estimate.start + estimate.each * size[0] * size[1] * samples > limit.left():
                    break
            of_size = replace(light, settings=replace(light.settings, size=size, crop=None))
            picture = _draw(scene, of_size, samples, runs.Stop(cancel, limit.is_over))
            if cancel.is_set():
                raise runs.Cancelled
            if picture is None or picture.rays < picture.pixels * samples:
                break
            if picture.error is None or not picture.error > 1e-6:
                return None
            if not pictures:
                limit = Deadline(seconds)
            pictures.append(picture._replace(tiny=size != small))
    return _fitted(plan, pictures) if pictures else Estimate(_how(plan), _pixels(plan), math.inf, 1.0, limit.spent(), 0.0)


def _size(plan: Plan, least: int) -> tuple[int, int]:
    """The size of a picture, its shorter side `least` pixels, or 1/DIVISOR of the whole if that is more than SMALLEST."""
    width, height = plan["size"]
    side = min(width, height)
    divisor = max(side / least, 1.0) if least < SMALLEST else max(min(DIVISOR, side // least), 1)
    return max(int(width / divisor), 1), max(int(height / divisor), 1)


def _draw(scene: ir.Scene, light: ReferenceLight, samples: int, stop: threading.Event) -> _Picture | None:
    """A picture, or the part that was drawn before `stop`; None if that ended its preparation."""
    plan = light.plan(scene, samples=samples, seed=0, aov=(), error=None, budget=None, denoise=False)
    try:
        about = render_scene.draw(scene, plan, None, stop, quick=True).metadata
    except cancellation.Cancelled:
        return None
    build, render = (about["seconds"][stage] for stage in ("build", "render"))
    pace = about["pace"] / about["threads"]
    return _Picture(samples, about["rays"], _pixels(plan), build, render, about["error"], pace, about["error_in_few"], False)


def _fitted(plan: Plan, pictures: list[_Picture]) -> Estimate:
    """The estimate from the last one or two pictures. The first one has loaded kernels: its time tells least."""
    last, error = pictures[-1], _of_one_sample(pictures[-1])
    each = last.pace or last.render / last.rays
    wrong = TINY_ALONE if last.tiny else ALONE
    if len(pictures) > 2:
        more = last.render - pictures[-2].render
        each = more / max(last.rays - pictures[-2].rays, 1) if more > CLEAR else each
    if len(pictures) > 1:
        disagreement = max(error / _of_one_sample(pictures[-2]), _of_one_sample(pictures[-2]) / error) ** 2
        wrong = max(disagreement, wrong) if pictures[-2].tiny else disagreement
    wrong *= min(1.0 / max(1.0 - last.stray, 1e-6), STRAY)
    start = last.build + max(last.render - each * last.rays, 0.0) if len(pictures) > 1 else 0.0
    return Estimate(_how(plan), _pixels(plan), error, wrong, start, each)


def _of_one_sample(picture: _Picture) -> float:
    return (picture.error or 1e-6) * math.sqrt(picture.samples)


def _how(plan: Plan) -> str:
    return "paths" if plan["transport"] == "path" else ""


def _pixels(plan: Plan) -> int:
    x0, y0, x1, y1 = plan["crop"]
    return (x1 - x0) * (y1 - y0)
