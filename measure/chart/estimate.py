"""A first estimate of a chart: small pictures of the ray backend tell how many samples an error takes, and how long.

Noise falls as n^(-1/2) with n samples a pixel (Monte Carlo), slower than Sobol points in practice; bias does not fall. Time grows with
n and with the pixels. Tiny pictures come first, then larger ones, of SAMPLES of each pixel, as far as they fit into the time: their
difference separates the time of samples from that of photons and tiles, and checks the model of the noise.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ...lang.schema.picture_settings import MAX_BOUNCES
from ...render import quality_settings, render_scene
from ...render.film import bounce_error
from ...render.film.deadline import Deadline
from ...render.jit import cancellation, compile_events
from .. import cost_model
from ..cost_model import Seconds, Way
from ..records import Setting
from . import runs
from .reference_light import ReferenceLight

DIVISOR, SMALLEST, TINY = 4, 48, 16  # of the size of the pictures, and pixels of their shorter side, and of that of the tiny one
SAMPLES = (4, 16)
SPREAD = 1.3  # factor of the samples, either way, beyond the disagreement of both pictures
ALONE, TINY_ALONE = 2.0, 4.0  # in place of that disagreement, where one picture was drawn, and where that was the tiny one
LOADING = 3.0  # CPU seconds in which the first picture loads kernels
CLEAR = 0.1  # seconds that one picture takes longer than another, from which on other work on the machine hides it no more
LEAST = 1e-6  # √relMSE of a picture without noise: pictures are float32
STRAY = 4.0  # most of the factor by which stray bright samples widen it
KERNELS = Seconds(0.3, 0.3)  # of loading kernels, where this process has compiled them
DENOISED_DOUBT = 3.0  # factor of the samples of denoised pictures: small ones have more detail in a pixel than the whole


@dataclass(frozen=True, slots=True)
class Estimate:
    """How the ray backend's noise and time depend on the samples of a picture."""

    how: str  # "ray with paths"
    pixels: int
    error: float  # √relMSE with one sample a pixel; inf: unknown
    wrong: float  # factor, at least 1, by which the square of `error` may be wrong, either way
    start: float  # seconds of a picture without samples: BVHs, photons
    each: float  # seconds of a sample of one pixel
    cpu: float = 1.0  # CPU seconds of a second
    kernels: Seconds = cost_model.NO_TIME  # of loading kernels from disk
    cut: bounce_error.Cut | None = None  # light beyond the limit on bounces; None: not measured
    denoised: tuple[tuple[int, float], ...] = ()  # (samples, √relMSE after denoising) of small pictures
    denoising: Seconds = cost_model.NO_TIME  # of a pixel

    def seconds(self, samples: float) -> float:
        """Seconds of a picture."""
        return self.start + self.each * self.pixels * samples

    def ways(self, settings: Mapping[str, Setting], start: Seconds, limit: Limit) -> list[Way]:
        """The ways of a number of samples by this estimate, without denoising and with it; `settings` are some of their sweeps."""
        if not math.isfinite(self.error):
            return [Way(settings[cost_model.SAMPLES], self.how, (), start)]
        noise = tuple((n, self.error / n**0.5) for n in SAMPLES)
        doubts = SPREAD * self.wrong, max(DENOISED_DOUBT, SPREAD * self.wrong)
        sides = ((cost_model.SAMPLES, noise, Seconds(), doubts[0]), (cost_model.DENOISED, self.denoised, self.denoising, doubts[1]))
        found = []
        for kind, errors, after, doubt in sides:
            drawn = [(n, math.hypot(error, limit.bias), self.seconds(n)) for n, error in errors]
            beside = [part * self.pixels for part in after]
            points = tuple(cost_model.Run(n, error, wall + beside[0], self.cpu * wall + beside[1]) for n, error, wall in drawn)
            if kind in settings and points:
                found.append(Way(settings[kind], self.how, points, start, limit.bias, limit.reason, doubt))
        return found


class Limit(NamedTuple):
    """The light that a limit on bounces is known to leave out: its share, and what to do about it."""

    bias: float = 0.0
    reason: str = ""


def limit_of(cut: bounce_error.Cut | None, bounces: int) -> Limit:
    """The light beyond a limit on bounces, where it is measured and more than its standard errors."""
    if cut is None or not cut.share > 2.0 * cut.error:
        return Limit()
    more = cut.enough or min(4 * max(bounces, 1), MAX_BOUNCES)
    told = f"{bounces} bounce{' leaves' if bounces == 1 else 's leave'} out about {100 * cut.share:.2g} % of the light"
    return Limit(cut.share, f"{told}, at any number of samples: give more, such as --bounces {more}")


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
    cpu: float  # CPU seconds of a second
    kernels: Seconds
    cut: bounce_error.Cut | None
    denoised: float | None  # √relMSE after denoising
    denoising: Seconds


def make(scene: ir.Scene, light: ReferenceLight, cancel: threading.Event, seconds: float = math.inf) -> Estimate:
    """The estimate of a scene, in so many seconds after the first picture.

    The first picture takes as long in CPU seconds, or LOADING if that is more: other work on the machine does not shorten it.
    Raises runs.Cancelled.
    """
    plan, limit = light.plan(scene), Deadline(max(seconds, LOADING), None, time.process_time)
    small, tiny = _size(plan, SMALLEST), _size(plan, TINY)
    pictures: list[_Picture] = []
    with limit.watch_compiler():
        for size, samples in [(size, samples) for size in (tiny, small) for samples in SAMPLES]:
            if pictures:
                estimate = _fitted(plan, pictures)
                if estimate.start + estimate.each * size[0] * size[1] * samples > limit.left():
                    break
            of_size = replace(light, settings=replace(light.settings, size=size, crop=None))
            picture = _draw(scene, of_size, samples, runs.Stop(cancel, limit.is_over), size == tiny)
            if cancel.is_set():
                raise runs.Cancelled
            if picture is None or picture.rays < picture.pixels * samples:
                break
            if picture.error is None:
                break
            if not pictures:
                limit = Deadline(seconds)
            pictures.append(picture._replace(tiny=size != small))
    return _fitted(plan, pictures) if pictures else Estimate(way_of(plan), _pixels(plan), math.inf, 1.0, limit.spent(), 0.0)


def _size(plan: Plan, least: int) -> tuple[int, int]:
    """The size of a picture, its shorter side `least` pixels, or 1/DIVISOR of the whole if that is more than SMALLEST."""
    width, height = plan["size"]
    side = min(width, height)
    divisor = max(side / least, 1.0) if least < SMALLEST else max(min(DIVISOR, side // least), 1)
    return max(int(width / divisor), 1), max(int(height / divisor), 1)


def _draw(scene: ir.Scene, light: ReferenceLight, samples: int, stop: threading.Event, quick: bool) -> _Picture | None:
    """A picture, or the part that was drawn before `stop`; None if that ended its preparation."""
    denoise = not quick and quality_settings.can_denoise()
    plan = light.plan(scene, samples=samples, seed=0, aov=(), error=None, budget=None, denoise=denoise)
    stages, compiled = runs.Stages(), compile_events.compiled()
    try:
        about = render_scene.draw(scene, plan, stages.report, stop, quick=quick).metadata
    except cancellation.Cancelled:
        return None
    (wall, cpu), denoising = stages.spent(), stages.denoising()
    loading = about["seconds"].get("compile_kernels", 0.0)
    kernels = KERNELS if compile_events.compiled() > compiled else Seconds(loading, loading * min(cpu / max(wall, 1e-9), 1.0))
    build, render = about["seconds"]["build"], about["seconds"]["render"] - denoising.wall
    pace = about["pace"] / about["threads"]
    wall, cpu = wall - denoising.wall, cpu - denoising.cpu
    busy, left = cpu / wall if wall > 0.0 else 1.0, about.get("denoised_error")
    figures = (build, render, about["error"], pace, about["error_in_few"], False, busy, kernels, about.get("cut"), left, denoising)
    return _Picture(samples, about["rays"], _pixels(plan), *figures)


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
    cut = next((picture.cut for picture in reversed(pictures) if picture.cut is not None), None)
    denoised = tuple((picture.samples, picture.denoised) for picture in pictures if picture.denoised is not None)
    after = Seconds(*(part / last.pixels for part in last.denoising))
    return Estimate(way_of(plan), _pixels(plan), error, wrong, start, each, last.cpu, pictures[0].kernels, cut, denoised, after)


def _of_one_sample(picture: _Picture) -> float:
    return max(picture.error or 0.0, LEAST) * math.sqrt(picture.samples)


def way_of(plan: Plan) -> str:
    """The backend of a plan and its transport: "ray with paths"."""
    return f"{plan['backend']} with paths" if plan["transport"] == "path" and plan["backend"] == "ray" else str(plan["backend"])


def _pixels(plan: Plan) -> int:
    x0, y0, x1, y1 = plan["crop"]
    return (x1 - x0) * (y1 - y0)
