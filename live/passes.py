"""Passes of a picture: a small or coarse whole picture at once, then one sample a pixel, then the picture asked for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.plan import plan as planner
from ..compiler.plan.plan import Plan
from ..render.film import aov
from ..render.image.image import Image
from .channels import resized

FIRST = 0.08  # seconds that the first picture may take
SMALLEST = 16  # pixels of a side of the first picture
COARSEST = 16  # times that the first picture is smaller than the whole
PACE = 5e-7  # seconds a pixel at one sample, before any picture
SMALL = 20_000  # pixels of a picture whose channels are drawn with it
MAX_PIXELS = 1 << 25  # of a picture in the window


@dataclass(slots=True)
class Pace:
    """Seconds a pixel of pictures with one sample, from the last ones."""

    seconds: float = PACE

    def divisor(self, width: int, height: int) -> int:
        """How many times smaller each side of the first picture is."""
        wanted = math.ceil(math.sqrt(width * height * self.seconds / FIRST))
        return max(1, min(wanted, COARSEST, min(width, height) // SMALLEST))

    def add(self, pixels: int, seconds: float) -> None:
        """Take in a picture of one sample a pixel."""
        measured = seconds / max(pixels, 1)
        self.seconds = measured if self.seconds == PACE else 0.5 * (self.seconds + measured)


def first_plans(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str], plan: Plan, pace: Pace, channel: str) -> list[Plan]:
    """The plans of the pictures before the last, with one sample a pixel: coarse, whole, and whole with the channels for clicks.

    Channels take several times as long as the picture, so the whole picture comes first without them, unless `channel` is one.
    A small picture has the last plan alone; a crop has no coarse one.
    """
    width, height = plan["size"]
    known = {name: overrides[name] for name in overrides if name in plan.decisions}
    names = tuple(dict.fromkeys(("id", "depth", *([channel] if channel in aov.SEEN else []))))
    quick = replace(scene, settings=replace(scene.settings, error=None, budget=None, aov=None, samples=1))
    cropped = tuple(plan["crop"]) != (0, 0, width, height)
    divisor = 1 if cropped else pace.divisor(width, height)
    parts = [(divisor, True)] if divisor > 1 else []
    if channel not in aov.SEEN and width * height > SMALL:
        parts.append((1, False))
    plans = []
    for part, with_channels in (*parts, (1, True)):
        size = (max(1, width // part), max(1, height // part))
        asked = replace(settings, size=size, samples=1, error=None, budget=None, aov=names if with_channels else None, denoise=False)
        plans.append(planner.make_plan(quick, asked, known))
    return plans


@dataclass(eq=False, slots=True)
class Shown:
    """What the window shows: linear light and channels at the resolution of the pass, (h, w, k) each."""

    rgba: NDArray[np.float32]
    channels: Mapping[str, NDArray[Any]]
    samples: NDArray[np.integer] | None = None  # (h, w)

    @staticmethod
    def of(image: Image, before: Mapping[str, NDArray[Any]]) -> Shown:
        """What a finished pass shows, with the channels of the pass before where it has none."""
        found = {name: image.channels[name] for name in image.channels if name != "rgba"}
        return Shown(image.channels["rgba"], found or before)

    def refined(self, rgba: NDArray[np.float32], samples: NDArray[np.integer]) -> Shown:
        """The picture of a pass that is not finished, over this one where it has no samples yet."""
        drawn = samples > 0
        if drawn.all():
            return Shown(rgba, self.channels, samples)
        before = resized(self.rgba, *rgba.shape[:2])
        return Shown(np.where(drawn[..., None], rgba, before), self.channels, samples)
