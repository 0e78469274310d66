"""Summarizes runs: points with bias and noise, curves with their stop reason, the uncertainty of the reference."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...lang.schema.picture_settings import BACKENDS
from .. import errors, formatting
from ..records import Curve, Point, Reference
from . import bias, contestant, setting_sweeps
from .contestant import Step

DOMINANT_SHARE = 0.5  # share of the squared error above which bias stops a curve
CENTRE_SAMPLES = "one sample a pixel is its centre: edges are not smoothed"
BLOCK_BIAS = "the bias is seen only in means over many pixels: it is at least so much"


def make_point(step: Step, metric: str, reference: Reference, once: dict[str, float]) -> Point | None:
    """The point of a step; None if the metric is not known. `once` has seconds of stages that a process runs once."""
    if metric not in step.errors:
        return None
    names = dict.fromkeys([*once, *(name for stages in step.stages for name in stages)])
    stages = {name: once.get(name) or step.seconds_of(name) for name in names}
    spreads = {name: contestant.spread(values) for name, values in step.errors.items()}
    split = bias.decompose(step.sums, reference)
    figures = {} if split is None else {
        "bias": split.bias, "bias_error": split.bias_error, "noise": split.noise, "noise_error": split.noise_error,
        "bias_squared": split.bias_squared, "bias_squared_error": split.bias_squared_error,
        "bias_block": split.block,
    }  # fmt: skip
    centres = step.setting.options.get("samples") == 1 and step.setting.backend in BACKENDS
    note = "; ".join(text for text, true in ((CENTRE_SAMPLES, centres), (BLOCK_BIAS, split is not None and split.block > 1)) if true)
    return Point(
        step.setting, contestant.spread(step.seconds), spreads[metric], spreads, **figures,
        stages=stages, note=note, cpu=float(np.median(step.cpu)),
        samples=float(np.median(step.samples)) or None,
    )  # fmt: skip


def make_curve(
    sweep: setting_sweeps.Sweep, steps: Sequence[Step], metric: str, reference: Reference, once: dict[str, float]
) -> Curve | None:
    """The curve of a sweep's measured steps; None without points."""
    measured = [(step, point) for step in steps if (point := make_point(step, metric, reference, once)) is not None]
    if not measured:
        return None
    points = tuple(point for _, point in measured)
    slope = None
    if sweep.settings[0].knob == "samples":
        random = [p for p in points if p.setting.value > 1]  # one sample may be the pixel's centre
        slope = bias.slope([float(p.setting.value) for p in random], [p.noise or 0.0 for p in random])
    return Curve(sweep.backend, sweep.name, points, _stop_reason(sweep, *measured[-1]), slope)


def _stop_reason(sweep: setting_sweeps.Sweep, step: Step, last: Point) -> str:
    """The reason why more time would not reduce the error of the most expensive step; "" if it would."""
    if last.setting != sweep.settings[-1] and (sweep.settings[0].knob != "samples" or last.setting.value == 1):
        return ""  # the next step would draw another picture
    if not last.bias or last.bias**2 < DOMINANT_SHARE * (last.bias**2 + (last.noise or 0.0) ** 2):
        return ""
    why = [sweep.light, *step.notes, CENTRE_SAMPLES if CENTRE_SAMPLES in last.note else ""]
    if sweep.backend not in BACKENDS:
        why.append("what it computes differs")
    named = "; ".join(filter(None, why)) or f"{formatting.setting(last.setting)}: another picture than the reference"
    return f"{named}: bias {formatting.error('relmse', last.bias)}"


def reference_uncertainty(reference: Reference, exposure: float) -> dict[str, float]:
    """The uncertainty of the reference in each metric: √relMSE from its variance, the others from the difference of its halves.

    Means over a and b seeds differ by σ √(1/a + 1/b). The mean of all is off by σ / √(a + b), which is √(a b) / (a + b) times as much.
    """
    if reference.halves is None:
        return {}
    first, second = reference.halves
    a = math.ceil(len(reference.seeds) / 2)
    b = len(reference.seeds) - a
    share = math.sqrt(a * b) / (a + b)
    apart = errors.measures(first[..., :3], first[..., 3], second[..., :3], second[..., 3], exposure)
    reference_error = float(np.sqrt(np.mean(bias.weights(reference.rgb) * reference.variance)))
    return {**{name: value * share for name, value in apart.items()}, "relmse": reference_error}
