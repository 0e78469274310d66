"""The two sides of a comparison: a picture from a file or a scene as drawn, with what is known of its objects, outlines and noise."""

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
from ...render.image import image_files
from ...render.image.image import Image
from ...render.sampling import sobol

KNOWN = ("id", "depth")  # channels that tell which object a pixel shows


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One of the two. `noise` is the estimated √relMSE of its own noise, None where unknown; `notes` what its backend does not draw.

    `changes` are sentences on what was done to it to make it comparable with the other. `scene` and `plan` are there for renders.
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
        """(h, w) alpha; None where the file has none."""
        return self.image.channels["rgba"][..., 3].astype(np.float64) if self.image.metadata.get("alpha", True) else None

    @property
    def ids(self) -> NDArray[np.int64] | None:
        """(h, w) the instance that each pixel's centre shows, -1 for none; None where the picture does not say."""
        found = self.image.channels.get("id")
        return None if found is None else found[..., 0].astype(np.int64)

    @property
    def depth(self) -> NDArray[np.float64]:
        """(h, w) metres, inf where nothing is or nobody said."""
        found = self.image.channels.get("depth")
        return np.full(self.rgb.shape[:2], np.inf) if found is None else found[..., 0].astype(np.float64)

    @property
    def variance(self) -> NDArray[np.float64] | None:
        """(h, w, 3) of the pixels, None where it is not known everywhere."""
        if self.noise == 0.0:
            return np.zeros_like(self.rgb)
        found = self.image.metadata.get("variance")
        return found.astype(np.float64) if found is not None and np.isfinite(found).all() else None

    @property
    def bits(self) -> int:
        """Of an 8 or 16-bit picture; 0 where the numbers are linear light."""
        return int(self.image.metadata.get("bits", 0))

    @property
    def reach(self) -> int:
        """How many pixels from its centre a pixel takes light from, rounded up."""
        if self.plan is None:
            return 2  # the default filter's
        return math.ceil(float(np.abs(sobol.filter_table(self.plan["filter"])).max())) if self.plan["samples"] > 1 else 1

    def about(self) -> str:
        """The name with what is known of how it came to be: "hello.scene, ray, 16 samples, seed 0"."""
        said = self.image.metadata.get("about", {})
        if self.plan is None:
            known = [said[key] if key == "backend" else f"{said[key]} {key}" for key in ("backend", "samples") if key in said]
            return ", ".join([self.name, *known, *([f"seed {said['seed']}"] if "seed" in said else [])])
        mean = self.image.metadata["samples_mean"]
        samples = f"{mean:.4g} sample{'' if mean == 1 else 's'}"
        return f"{self.name}, {self.plan['backend']}, {samples}, seed {self.plan['seed']}"


def picture(path: Path) -> Side:
    """A picture's file. Raises output.FormatError where there is none to read."""
    image = image_files.read(path)
    try:
        noise = float(image.metadata["about"]["error"])
    except (KeyError, ValueError):
        noise = None
    return Side(str(path), image, noise)


def plan_of(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str] | None = None) -> planner.Plan:
    """A plan that also asks for the channels by which objects are known. Raises planner.PlanError."""
    return planner.make(scene, replace(settings, aov=KNOWN), overrides)


def drawn(
    scene: ir.Scene,
    plan: planner.Plan,
    name: str = "",
    progress: render_scene.Progress | None = None,
    cancel: threading.Event | None = None,
) -> Side:
    """A scene, drawn as a plan of `plan_of` says. metadata["partial"] of its image tells that `cancel` ended it."""
    image = render_scene.draw(scene, plan, progress, cancel)
    notes = tuple(Diagnostic("note", message, scene.spans.at(table, row)) for message, table, row in image.metadata["notes"])
    return Side(name or scene.name, image, _noise(plan, image), scene, plan, notes)


def _noise(plan: planner.Plan, image: Image) -> float | None:
    if image.metadata["samples"] == 1 and not plan["soft lights"] and not plan["interreflection"]:
        return 0.0  # one sample at the pixel's centre and nothing left to chance
    return image.metadata["error"]


def without_shared_endless(a: Side, b: Side) -> tuple[Side, Side]:
    """Both with 0 where they hold the same inf or nan: there they are alike, and no sum should suffer from it."""
    one, other = a.image.channels["rgba"], b.image.channels["rgba"]
    if one.shape != other.shape or np.isfinite(other).all():
        return a, b
    same = ((one == other) | (np.isnan(one) & np.isnan(other))) & ~np.isfinite(other)
    return _with_pixels(a, np.where(same, 0.0, one)), _with_pixels(b, np.where(same, 0.0, other))


def _with_pixels(side: Side, rgba: NDArray[np.floating], **metadata: object) -> Side:
    channels = {**side.image.channels, "rgba": rgba.astype(np.float32)}
    return replace(side, image=replace(side.image, channels=channels, metadata={**side.image.metadata, **metadata}))


def alike(a: Side, b: Side, exposure: float | None = None) -> tuple[Side, Side]:
    """Both in one kind of light: where one alone is an 8 or 16-bit picture, the other is exposed and clipped as that one was.

    `exposure` in stops; None: what the picture was written with, or else the other's own.
    """
    if (a.bits == 0) == (b.bits == 0):
        return a, b
    return (_displayed(a, b, exposure), b) if a.bits == 0 else (a, _displayed(b, a, exposure))


def exposure_said(side: Side) -> float | None:
    """The stops a picture was written with, or a render's own plan has; None where nobody said."""
    if side.plan is not None:
        asked = side.plan["exposure"]
        return image_files.metered(side.image.channels["rgba"]) if asked == "metered" else float(asked)
    try:
        return float(side.image.metadata["about"]["exposure"])
    except (KeyError, ValueError):
        return None


def _displayed(linear: Side, shown: Side, exposure: float | None) -> Side:
    stops = next((stops for stops in (exposure, exposure_said(shown), exposure_said(linear)) if stops is not None), 0.0)
    gain = np.float32(2.0**stops)
    rgba = linear.image.channels["rgba"].copy()
    rgba[..., :3] = np.clip(rgba[..., :3] * gain, 0.0, 1.0)
    variance = linear.image.metadata.get("variance")
    said = f"exposed by {stops:+g} stops and clipped to 0..1, as {shown.name} holds {shown.bits} bits a channel"
    side = _with_pixels(linear, rgba, bits=shown.bits, variance=None if variance is None else variance * gain**2)
    return replace(side, changes=(*linear.changes, said))
