"""From runs to a chart's figures: points with bias and noise, curves and why they stop, the reference's own uncertainty in every metric."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .. import errors, formatting
from ..records import Curve, Point, Reference
from . import bias, contestant, setting_ladders
from .contestant import Rung

DOMINANT = 0.5  # share of the squared error from which on a bias is what stops a curve
CENTRES = "one sample a pixel is its centre: edges are not smoothed"
BLOCKS = "the bias is seen only in means over many pixels: it is at least so much"


def point(rung: Rung, metric: str, reference: Reference, once: dict[str, float]) -> Point | None:
    """A rung as a point; None where the metric cannot be had of it. `once` are stages paid by the first picture of a process."""
    if metric not in rung.errors:
        return None
    names = dict.fromkeys([*once, *(name for stages in rung.stages for name in stages)])
    stages = {name: once.get(name) or rung.seconds_of(name) for name in names}
    spreads = {name: contestant.spread(values) for name, values in rung.errors.items()}
    split = bias.split(rung.sums, reference)
    told = {} if split is None else {
        "bias": split.bias, "bias_error": split.bias_error, "noise": split.noise, "noise_error": split.noise_error,
        "bias_squared": split.bias_squared, "bias_squared_error": split.bias_squared_error,
        "bias_block": split.block,
    }  # fmt: skip
    centres = rung.setting.options.get("samples") == 1 and rung.setting.backend in formatting.BACKENDS
    note = "; ".join(said for said, true in ((CENTRES, centres), (BLOCKS, split is not None and split.block > 1)) if true)
    return Point(
        rung.setting, contestant.spread(rung.seconds), spreads[metric], spreads, **told,
        stages=stages, note=note, cpu=float(np.median(rung.cpu)),
    )  # fmt: skip


def curve(ladder: setting_ladders.Ladder, rungs: Sequence[Rung], metric: str, reference: Reference, once: dict[str, float]) -> Curve | None:
    """A ladder as far as it was climbed; None where nothing of it can be charted."""
    found = [(rung, made) for rung in rungs if (made := point(rung, metric, reference, once)) is not None]
    if not found:
        return None
    points = tuple(made for _, made in found)
    slope = None
    if ladder.settings[0].knob == "samples":
        random = [p for p in points if p.setting.value > 1]  # one sample may be the pixel's centre
        slope = bias.slope([float(p.setting.value) for p in random], [p.noise or 0.0 for p in random])
    return Curve(ladder.backend, ladder.name, points, _stops(ladder, *found[-1]), slope)


def _stops(ladder: setting_ladders.Ladder, rung: Rung, last: Point) -> str:
    """Why the error of the dearest rung is no noise and what follows would not change that; else ""."""
    if last.setting != ladder.settings[-1] and (ladder.settings[0].knob != "samples" or last.setting.value == 1):
        return ""  # what would have come next draws another picture
    if not last.bias or last.bias**2 < DOMINANT * (last.bias**2 + (last.noise or 0.0) ** 2):
        return ""
    why = [ladder.light, *rung.notes, CENTRES if CENTRES in last.note else ""]
    if ladder.backend not in formatting.BACKENDS:
        why.append("what it computes differs")
    named = "; ".join(filter(None, why)) or f"{formatting.setting(last.setting)}: another picture than the reference"
    return f"{named}: bias {formatting.error('relmse', last.bias)}"


def floor(reference: Reference, exposure: float) -> dict[str, float]:
    """The reference's own uncertainty in each metric: √relMSE from its variance, the others from how its halves differ.

    Means over a and b seeds differ by σ √(1/a + 1/b), the mean of all is off by σ / √(a + b): √(a b) / (a + b) times as much.
    """
    if reference.halves is None:
        return {}
    one, other = reference.halves
    a = math.ceil(len(reference.seeds) / 2)
    b = len(reference.seeds) - a
    share = math.sqrt(a * b) / (a + b)
    apart = errors.measures(one[..., :3], one[..., 3], other[..., :3], other[..., 3], exposure)
    own = float(np.sqrt(np.mean(bias.weights(reference.rgb) * reference.variance)))
    return {**{name: value * share for name, value in apart.items()}, "relmse": own}
