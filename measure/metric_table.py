"""The metrics of a picture against a reference, a row each. Charts, comparisons and their options read them; errors.py computes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric.

    `axis` is its name on an axis, `name` in a table, `noun` in a sentence. Its value is a share, shown as a percentage, or a number with a
    unit; None where the pair lacks what it needs. `compare` calls it `key` in its option and its JSON ("": as here). A `slow` metric
    takes longer than all others together. `option`: whether --metric names it and `compare` prints it; a chart's JSON has all.
    """

    axis: str
    name: str
    value: Callable[[Any], float | None]  # of an errors.Pair
    noun: str = ""
    share: bool = False
    unit: str = ""
    key: str = ""
    slow: bool = False
    option: bool = True


METRICS = {
    "relmse": Metric("error, √relMSE", "√relMSE", lambda pair: pair.relmse(), share=True),
    "relmse 99.9%": Metric(
        "error, √relMSE of 99.9 % of the pixels", "√relMSE of 99.9 %", lambda pair: pair.trimmed(), share=True, option=False
    ),
    "blocks": Metric(
        "error of 4 × 4 pixel means, √relMSE", "√relMSE of 4 × 4", lambda pair: pair.blocks(), "√relMSE of 4 × 4 blocks", share=True
    ),
    "flip": Metric("error a person sees, mean FLIP", "FLIP", lambda pair: pair.flip(), slow=True),
    "max": Metric("largest error of a pixel, linear light", "largest", lambda pair: pair.largest(), "the maximum", key="maximum"),
    "silhouette": Metric(
        "how far outlines lie apart, pixels", "outlines apart", lambda pair: pair.silhouette(), "the silhouette difference", unit="px"
    ),
}  # fmt: skip


def option_names() -> tuple[str, ...]:
    """The metrics that `maquette chart --metric` names."""
    return tuple(name for name, metric in METRICS.items() if metric.option)


def compared() -> dict[str, Metric]:
    """The metrics of a comparison by the names that `compare` has for them."""
    return {metric.key or name: metric for name, metric in METRICS.items() if metric.option}
