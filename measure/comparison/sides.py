"""The sides of a comparison: a picture file or a rendered scene, with its ids, coverage and noise."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...lang.diagnostics import Diagnostic
from ...render import render_scene
from ...render.film.progress import Report
from ...render.image import image_files, image_reader
from ...render.image.image import Image
from ...render.sampling import sobol

OBJECT_CHANNELS = ("id", "depth")  # channels that identify the object of a pixel


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One side. `noise` is its estimated √relMSE, None if unknown; `notes` are messages on features that its backend does not draw.

    `changes` describe the conversions that made it comparable. Renders have `scene` and `plan`.
    """

    name: str
    image: Image
    noise: float | None = None
    scene: ir.Scene | None = None
    plan: planner.Plan | None = None
    notes: tuple[Diagnostic, ...] = ()
    changes: tuple[str, ...] = ()

    @property
    def rgb(self) -> NDArray[np.float64]:
        """(h, w, 3) linear."""
        return self.image.channels["rgba"][..., :3].astype(np.float64)

    @property
    def coverage(self) -> NDArray[np.float64] | None:
        """(h, w) alpha; None if the file has none."""
        return self.image.channels["rgba"][..., 3].astype(np.float64) if self.image.metadata.get("alpha", True) else None

    @property
    def ids(self) -> NDArray[np.int64] | None:
        """(h, w) instance at each pixel centre, -1 for none; None without the channel."""
        channel = self.image.channels.get("id")
        return None if channel is None else channel[..., 0].astype(np.int64)

    @property
    def depth(self) -> NDArray[np.float64]:
        """(h, w) metres; inf for the background or without the channel."""
        channel = self.image.channels.get("depth")
        return np.full(self.rgb.shape[:2], np.inf) if channel is None else channel[..., 0].astype(np.float64)

    @property
    def variance(self) -> NDArray[np.float64] | None:
        """(h, w, 3) variance of the pixels; None if any is unknown."""
        if self.noise == 0.0:
            return np.zeros_like(self.rgb)
        recorded = self.image.metadata.get("variance")
        return recorded.astype(np.float64) if recorded is not None and np.isfinite(recorded).all() else None

    @property
    def warnings(self) -> list[Diagnostic]:
        """What of a picture file is missing, not read, or read by a guess."""
        return [Diagnostic("warning", message, None, hint) for message, hint in self.image.metadata.get("faults", ())]

    @property
    def bits(self) -> int:
        """Bits a channel of an 8 or 16-bit picture; 0 for linear light."""
        return int(self.image.metadata.get("bits", 0))

    @property
    def reach(self) -> int:
        """The radius of the pixel filter in pixels, rounded up."""
        if self.plan is None:
            return 2  # the default filter's
        return math.ceil(float(np.abs(sobol.filter_table(self.plan["filter"])).max())) if self.plan["samples"] > 1 else 1

    def about(self) -> str:
        """Name, backend, samples and seed, as in "hello.scene, ray, 16 samples, seed 0"."""
        recorded = self.image.metadata.get("about", {})
        if self.plan is None:
            details = [recorded[key] if key == "backend" else f"{recorded[key]} {key}" for key in ("backend", "samples") if key in recorded]
            return ", ".join([self.name, *details, *([f"seed {recorded['seed']}"] if "seed" in recorded else [])])
        mean = self.image.metadata["samples_mean"]
        samples = f"{mean:.4g} sample{'' if mean == 1 else 's'}"
        return f"{self.name}, {self.plan['backend']}, {samples}, seed {self.plan['seed']}"


def read(path: Path) -> Side:
    """The side of a picture file. Raises image_files.FormatError for an unreadable file."""
    image = image_reader.read(path)
    try:
        noise = float(image.metadata["about"]["error"])
    except (KeyError, ValueError):
        noise = None
    return Side(str(path), image, noise)


def make_plan(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str] | None = None) -> planner.Plan:
    """A plan with the channels that identify objects, without denoising unless it is asked for. Raises planner.PlanError."""
    return planner.make_plan(scene, replace(settings, aov=OBJECT_CHANNELS, denoise=bool(settings.denoise)), overrides)


def render(
    scene: ir.Scene,
    plan: planner.Plan,
    name: str = "",
    report: Report | None = None,
    cancel: threading.Event | None = None,
) -> Side:
    """Render a scene with a plan of `make_plan`. metadata["partial"] of the image is true if `cancel` ended it."""
    image = render_scene.draw(scene, plan, report, cancel)
    notes = tuple(Diagnostic("note", message, scene.spans.get(table, row)) for message, table, row in image.metadata["notes"])
    return Side(name or scene.name, image, _noise(plan, image), scene, plan, notes)


def _noise(plan: planner.Plan, image: Image) -> float | None:
    if image.metadata["samples"] == 1 and not plan["area_lights"] and not plan["interreflection"]:
        return 0.0  # one sample at the pixel centre, without randomness
    return image.metadata["error"]


def zero_shared_nonfinite(a: Side, b: Side) -> tuple[Side, Side]:
    """Both sides with 0 where they hold the same inf or nan, so that sums stay finite."""
    first, second = a.image.channels["rgba"], b.image.channels["rgba"]
    if first.shape != second.shape or np.isfinite(second).all():
        return a, b
    same = ((first == second) | (np.isnan(first) & np.isnan(second))) & ~np.isfinite(second)
    return _with_pixels(a, np.where(same, 0.0, first)), _with_pixels(b, np.where(same, 0.0, second))


def _with_pixels(side: Side, rgba: NDArray[np.floating], **metadata: object) -> Side:
    channels = {**side.image.channels, "rgba": rgba.astype(np.float32)}
    return replace(side, image=replace(side.image, channels=channels, metadata={**side.image.metadata, **metadata}))


def match_encoding(a: Side, b: Side, exposure: float | None = None) -> tuple[Side, Side]:
    """Both sides in one encoding: if only one has 8 or 16 bits, the other is exposed and clipped alike.

    `exposure` is in stops; by default the recorded one of the integer picture, else of the other.
    """
    if (a.bits == 0) == (b.bits == 0):
        return a, b
    return (_expose(a, b, exposure), b) if a.bits == 0 else (a, _expose(b, a, exposure))


def recorded_exposure(side: Side) -> float | None:
    """The stops that a picture was written with or a render's plan has; None if unknown."""
    if side.plan is not None:
        exposure = side.plan["exposure"]
        return image_files.auto_exposure(side.image.channels["rgba"]) if exposure == "metered" else float(exposure)
    try:
        return float(side.image.metadata["about"]["exposure"])
    except (KeyError, ValueError):
        return None


def _expose(linear: Side, shown: Side, exposure: float | None) -> Side:
    stops = next((stops for stops in (exposure, recorded_exposure(shown), recorded_exposure(linear)) if stops is not None), 0.0)
    gain = np.float32(2.0**stops)
    rgba = linear.image.channels["rgba"].copy()
    rgba[..., :3] = np.clip(rgba[..., :3] * gain, 0.0, 1.0)
    variance = linear.image.metadata.get("variance")
    change = f"exposed by {stops:+g} stops and clipped to 0..1, as {shown.name} holds {shown.bits} bits a channel"
    side = _with_pixels(linear, rgba, bits=shown.bits, variance=None if variance is None else variance * gain**2)
    return replace(side, changes=(*linear.changes, change))
