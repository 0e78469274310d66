"""Time estimate of denoising, from measured speed and picture size; decides which denoising runs fit a budget."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...compiler.plan.plan import Plan
from ..simd import target
from . import denoise, film
from .deadline import Deadline
from .remote import Remote

LEAST = 1.5  # seconds left, from which the speeds are measured
SIDE = 128  # pixels of the picture whose filtering is measured
CAREFUL = 1.4  # factor of the measured seconds: other work may slow the machine
CHOICES = (  # (samples of the guides, whether the error left is measured, most of the seconds left)
    (denoise.SAMPLES, True, 0.15), (4, True, 0.2), (1, True, 0.25), (1, False, 0.3),
)  # fmt: skip
ASKED = (1, False, 0.8)  # of a picture that is denoised on request


class Denoising(NamedTuple):
    """What of the denoising there is time for, and the seconds that it takes."""

    samples: int  # of the guides
    measures: bool  # whether the error left is measured
    seconds: float


class DenoisingTime:
    """The measured speeds of denoising the pictures of a renderer."""

    def __init__(self, renderer: film.Renderer | Remote, plan: Plan, deadline: Deadline) -> None:
        """Measure, unless too little time is left."""
        self.deadline, self.asked = deadline, plan["denoise"] == "on"
        self.known = deadline.left() >= LEAST
        if not self.known:
            return
        rng, clock = np.random.default_rng(1), deadline.clock
        color, albedo, normal = (rng.random((SIDE, SIDE, 3), np.float32) for _ in range(3))
        clean = denoise.make_filter(albedo, normal)
        self.filter = min(_time(lambda: clean(color), clock) for _ in range(2)) / color[..., 0].size
        tile = film.tiles(tuple(plan["crop"]))[0]
        threads = renderer.threads if isinstance(renderer, Remote) else int(plan["threads"]) or target.cores()
        once = min(_time(lambda: denoise.tile_guides(renderer, tile, 1, int(plan["samples"])), clock) for _ in range(2))
        self.guide = once / ((tile.x1 - tile.x0) * (tile.y1 - tile.y0)) / max(min(threads, target.cores()), 1)

    def plan(self, pixels: int) -> Denoising | None:
        """What there is time for in a picture of so many pixels; None: nothing."""
        if not self.known:
            return None
        for samples, measures, share in (*CHOICES, *([ASKED] if self.asked else [])):
            seconds = CAREFUL * pixels * (self.guide * samples + self.filter * (2 if measures else 1))
            if seconds <= share * self.deadline.left():
                return Denoising(samples, measures, seconds)
        return None


def _time(work: Callable[[], object], clock: Callable[[], float]) -> float:
    began = clock()
    work()
    return clock() - began
