"""A first estimate of a chart: two small pictures of the ray backend tell how many samples an error takes, and how long.

Noise falls as n^(-1/2) with n samples a pixel (Monte Carlo), slower than Sobol points in practice; bias does not fall. Time grows with
n and with the pixels. The pictures have SAMPLES of each pixel; their difference separates the time of samples from that of photons and
tiles, and checks the model of the noise.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, replace

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ...render import render_scene
from .. import formatting
from . import runs
from .reference_light import ReferenceLight

DIVISOR, SMALLEST = 4, 48  # of the size of the pictures, and pixels of their shorter side
SAMPLES = (4, 16)
SPREAD = 1.3  # factor of the samples, either way, beyond the disagreement of both pictures


@dataclass(frozen=True, slots=True)
class Estimate:
    """How the ray backend's noise and time depend on the samples of a picture."""

    how: str  # "paths", or "" without
    pixels: int
    error: float  # √relMSE with one sample a pixel
    wrong: float  # factor, at least 1, by which both pictures disagree about the square of `error`
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
        count, low, high = self.samples(target)
        times = [formatting.seconds(self.seconds(n)) for n in (count, low, high)]
        return (
            f"{formatting.target('relmse', target)}: ray{f' with {self.how}' if self.how else ''}, about {_round(count)} samples "
            f"({_round(low)} to {_round(high)}), about {times[0]} ({times[1]} to {times[2]}), estimated from small pictures"
        )


def _round(samples: float) -> str:
    return f"{float(f'{samples:.2g}'):,.0f}"


def make(scene: ir.Scene, light: ReferenceLight, cancel: threading.Event) -> Estimate | None:
    """The estimate of a scene; None where the pictures have no noise. Raises runs.Cancelled."""
    plan = light.plan(scene)
    width, height = plan["size"]
    divisor = max(min(DIVISOR, min(width, height) // SMALLEST), 1)
    small = replace(light, settings=replace(light.settings, size=(max(width // divisor, 1), max(height // divisor, 1))))
    errors, times, rays = [], [], []
    for samples in SAMPLES:
        drawn = small.plan(scene, samples=samples, seed=0, aov=(), error=None, budget=None, denoise=False)
        image = render_scene.draw(scene, drawn, None, cancel, quick=True)
        if image.metadata["partial"]:
            raise runs.Cancelled
        errors.append(image.metadata["error"])
        times.append(image.metadata["seconds"]["render"])
        rays.append(image.metadata["rays"])
    if any(error is None or not error > 1e-6 for error in errors):
        return None
    return _of(plan, errors, times, rays, image.metadata["seconds"]["build"])


def _of(plan: Plan, errors: list[float], times: list[float], rays: list[int], build: float) -> Estimate:
    """The estimate from the errors, seconds and samples of two pictures."""
    ones = [error * math.sqrt(samples) for error, samples in zip(errors, SAMPLES, strict=True)]
    each = (times[1] - times[0]) / (rays[1] - rays[0])
    each = each if each > 0.0 else times[1] / rays[1]
    x0, y0, x1, y1 = plan["crop"]
    wrong = max(ones[0] / ones[1], ones[1] / ones[0]) ** 2
    start = build + max(times[1] - each * rays[1], 0.0)
    return Estimate("paths" if plan["transport"] == "path" else "", (x1 - x0) * (y1 - y0), ones[1], wrong, start, each)
