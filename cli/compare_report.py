"""The text output of `compare`: figures, location of the difference, noise, unsupported features, changes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import click

from ..measure.metric_table import Metric, compared
from . import terminal

if TYPE_CHECKING:
    from ..measure.comparison.compare import Comparison

MAX_OBJECTS = 8
MAX_CHANGES = 12
OF_OBJECTS = ("geometries", "materials", "textures")  # tables whose added and removed rows belong to listed objects


def show(comparison: Comparison) -> None:
    """Print a comparison to stdout."""
    for letter, side in (("A", comparison.a), ("B", comparison.b)):
        click.echo(f"{letter}  {side.about()}")
        for change in side.changes:
            click.echo(f"   {change}")
    for name, text in (*_figures(comparison), *_places(comparison), *_noise(comparison)):
        click.echo(f"{name:<12}{text}")
    _objects(comparison)
    for line in (*_unsupported(comparison), *_changes(comparison)):
        click.echo(line)


def percent(value: float) -> str:
    """A share with three digits: 0.0312%, 3.12%, 312%."""
    return f"{100 * value:.0f}%" if 10 <= abs(value) < math.inf else f"{100 * value:.3g}%"


def _with_doubt(value: float, doubt: float | None) -> str:
    return f"{'+' if value > 0 else ''}{percent(value)}" + (f" ± {percent(doubt)}" if doubt else "")


def _figures(comparison: Comparison) -> Iterator[tuple[str, str]]:
    """A line for each metric that is known, with the bias after the maximum, and the number of different pixels."""
    details: dict[str, Callable[[float], tuple[str, str]]] = {
        "relmse": lambda value: ("√relMSE", f"{value:.6g} ({value:.4%})"),
        "blocks": lambda value: ("blocks", f"{value:.6g} ({value:.4%}): √relMSE of means over 4 × 4 pixels"),
        "flip": lambda value: ("FLIP", f"{value:.4g}" + (f" (at {comparison.exposure:+g} stops)" if comparison.exposure else "")),
        "maximum": lambda value: ("maximum", f"{value:.6g} at pixel {comparison.at[0]},{comparison.at[1]}{_owner(comparison, value)}"),
        "silhouette": lambda value: ("silhouette", f"{value:.4g} pixels apart"),
    }
    for name, value in comparison.figures.items():
        if value is not None:
            yield details[name](value) if name in details else (name, _plain(compared()[name], value))
        if name == "maximum":
            yield "bias", _bias(comparison)
    yield "differing", f"{comparison.differing} of {comparison.pixels} pixels"


def _plain(metric: Metric, value: float) -> str:
    return f"{percent(value) if metric.share else f'{value:.6g} {metric.unit}'.rstrip()}: {metric.noun or metric.name}"


def _owner(comparison: Comparison, maximum: float) -> str:
    return f" on {comparison.largest_on}" if comparison.largest_on and maximum else ""


def _bias(comparison: Comparison) -> str:
    doubts = comparison.bias.standard_error or (None, None, None)
    colours = zip(("red", "green", "blue"), comparison.bias.channels, doubts, strict=True)
    return ", ".join(f"{name} {_with_doubt(value, doubt)}" for name, value, doubt in colours)


def _places(comparison: Comparison) -> Iterator[tuple[str, str]]:
    """The shares of the squared error on pixels with outlines and on the other pixels."""
    for name, region in (("outlines", comparison.outline), ("inside", comparison.interior)):
        if region is not None and comparison.error > 0:
            share = f"{percent(region.pixels / comparison.pixels)} of the pixels"
            yield name, f"{percent(region.share)} of the squared error on {share}, √relMSE {percent(region.error)} there"


def _noise(comparison: Comparison) -> Iterator[tuple[str, str]]:
    noise = comparison.noise
    if noise.a is None and noise.b is None:
        return
    shown = ["not known" if n is None else "none" if n == 0 else percent(n) for n in (noise.a, noise.b)]
    yield "noise", f"A {shown[0]}, B {shown[1]} (estimated √relMSE of each)"
    if comparison.error > 0 and noise.ratio is not None and (noise.a or noise.b):
        yield from (("", line) for line in _verdict(comparison))


def _verdict(comparison: Comparison) -> Iterator[str]:
    """Whether the difference is within the noise."""
    size = f"the difference is {comparison.noise.ratio:.3g} times what noise alone makes"
    if comparison.noise.shared:
        yield f"{size}; the random numbers are the same: the rest is a rendering difference"
    else:
        yield f"{size}: {'within' if comparison.within_noise else 'above'} the noise"
    if comparison.biased or (comparison.biased is not None and not comparison.noise.shared):
        verdict = "a bias" if comparison.biased else "no significant bias"
        yield f"the means differ by {comparison.bias.significance:.3g} standard errors: {verdict}"


def _objects(comparison: Comparison) -> None:
    shown = [entry for entry in comparison.objects if entry.share > 0][:MAX_OBJECTS]
    if not shown:
        return
    rows = [
        (str(c), percent(c.share), percent(c.pixels / comparison.pixels), percent(c.error), _with_doubt(c.bias, c.standard_error))
        for c in shown
    ]
    click.echo()
    terminal.table(("object at the pixel's centre", "of the squared error", "of the pixels", "√relMSE", "bias"), rows)
    rest = [entry for entry in comparison.objects[len(shown) :] if entry.share > 0]
    if rest:
        click.echo(f"… {len(rest)} more with {percent(sum(entry.share for entry in rest))}")


def _unsupported(comparison: Comparison) -> list[str]:
    sides = (("A", comparison.a), ("B", comparison.b))
    lines = [f"  {letter}: {note.message}{f' ({note.span})' if note.span else ''}" for letter, side in sides for note in side.notes]
    return ["", "not rendered", *lines] if lines else []


def _changes(comparison: Comparison) -> list[str]:
    counts = Counter(str(change) for change in comparison.changes if change.what == "changed" or change.table not in OF_OBJECTS)
    lines = [f"  {f'{count} × ' if count > 1 else ''}{line}" for line, count in counts.items()]
    rest = [f"  … {len(lines) - MAX_CHANGES} more"] if len(lines) > MAX_CHANGES else []
    return ["", "changes from A to B", *lines[:MAX_CHANGES], *rest] if lines else []
