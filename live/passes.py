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
from ..lang.schema.picture_channels import SEEN
from ..render.image.image import Image
from .channels import resized

FIRST = 0.1  # seconds that a whole first picture may take; where it takes longer, a coarse one comes before it
COARSE = 0.05  # seconds that a coarse picture may take
DRAGGED = 0.03  # seconds that the first picture may take while the camera moves
START = 0.004  # seconds of a picture of any size
SMALLEST = 16  # pixels of a side of the first picture
COARSEST = 16  # times that the first picture is smaller than the whole
PACE = 5e-7  # seconds a pixel at one sample, before any picture
SMALL = 20_000  # pixels of a picture whose channels are drawn with it
MAX_PIXELS = 1 << 25  # of a picture in the window


@dataclass(slots=True)
class Pace:
    """Seconds a pixel of pictures with one sample, from the last ones."""

    seconds: float = PACE

    def divisor(self, width: int, height: int, moving: bool) -> int:
        """How many times smaller each side of the first picture is; with `moving`, the camera is dragged."""
        seconds = width * height * self.seconds
        if seconds <= (DRAGGED if moving else FIRST):
            return 1
        wanted = math.ceil(math.sqrt(seconds / (DRAGGED if moving else COARSE)))
        return max(1, min(wanted, COARSEST, min(width, height) // SMALLEST))

    def add(self, pixels: int, seconds: float) -> None:
        """Take in a picture of one sample a pixel."""
        measured = max(seconds - START, 0.25 * seconds) / max(pixels, 1)
        self.seconds = measured if self.seconds == PACE else 0.5 * (self.seconds + measured)


@dataclass(frozen=True, eq=False, slots=True)
class Quick:
    """Plans of pictures with one sample a pixel, at parts of the size of the last picture."""

    scene: ir.Scene
    settings: ir.Settings
    overrides: Mapping[str, str]
    plan: Plan  # of the last picture
    channel: str  # that the window shows

    def first(self, pace: Pace, moving: bool) -> list[Plan]:
        """The plans before the last: coarse, if the whole one takes long, and whole. A crop has no coarse one.

        Channels take several times as long as a picture: only small pictures, and windows that show a channel, have them at once.
        """
        width, height = self.plan["size"]
        divisor = pace.divisor(width, height, moving) if self._is_whole() else 1
        at_once = self.channel in SEEN
        return [self._plan_of(part, at_once or width * height <= SMALL * part * part) for part in dict.fromkeys((divisor, 1))]

    def channels(self, full: bool) -> Plan | None:
        """The plan of channels for clicks and outlines, in full size or small; None where the first pictures have them."""
        width, height = self.plan["size"]
        if self.channel in SEEN or width * height <= SMALL:
            return None
        part = 1 if full or not self._is_whole() else math.ceil(math.sqrt(width * height / SMALL))
        return self._plan_of(part, True)

    def _is_whole(self) -> bool:
        return tuple(self.plan["crop"]) == (0, 0, *self.plan["size"])

    def _plan_of(self, part: int, with_channels: bool) -> Plan:
        width, height = self.plan["size"]
        decisions = {name: self.overrides[name] for name in self.overrides if name in self.plan.decisions}
        names = tuple(dict.fromkeys(("id", "depth", *([self.channel] if self.channel in SEEN else []))))
        quick = replace(self.scene, settings=replace(self.scene.settings, error=None, budget=None, aov=None, samples=1))
        size = (max(1, width // part), max(1, height // part))
        aovs = names if with_channels else None
        settings = replace(self.settings, size=size, samples=1, error=None, budget=None, aov=aovs, denoise=False)
        return planner.make_plan(quick, settings, decisions)


@dataclass(eq=False, slots=True)
class Shown:
    """What the window shows: linear light and channels at the resolution of the pass, (h, w, k) each."""

    rgba: NDArray[np.float32]
    channels: Mapping[str, NDArray[Any]]
    samples: NDArray[np.integer] | None = None  # (h, w)

    @staticmethod
    def from_image(image: Image, before: Mapping[str, NDArray[Any]]) -> Shown:
        """What a finished pass shows, with the channels of the pass before where it has none."""
        others = {name: image.channels[name] for name in image.channels if name != "rgba"}
        return Shown(image.channels["rgba"], others or before)

    def refined(self, rgba: NDArray[np.float32], samples: NDArray[np.integer]) -> Shown:
        """The picture of a pass that is not finished, over this one where it has no samples yet."""
        drawn = samples > 0
        if drawn.all():
            return Shown(rgba, self.channels, samples)
        before = resized(self.rgba, *rgba.shape[:2])
        return Shown(np.where(drawn[..., None], rgba, before), self.channels, samples)
