"""Measures the light of a scene for `maquette measure`, and makes text, plain data and rows of it."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...compiler import ir
from ...lang.diagnostics import Diagnostic
from . import glare, illuminance, luminance, overcast
from .illuminance import Value
from .replicates import Effort

MOST_COLUMNS, MOST_ROWS = 12, 24  # of a grid that is printed
ROW = ("name", "quantity", "column", "row", "x", "y", "z", "value", "error", "unit")


@dataclass(frozen=True)
class Request:
    """What of light to measure."""

    meters: Sequence[ir.Meter]
    settings: ir.Settings
    illuminance: bool = True
    daylight: bool = False
    regions: tuple[tuple[int, int, int, int], ...] = ()
    glare: bool = False


@dataclass
class Light:
    """What was measured."""

    meters: list[illuminance.Reading] = field(default_factory=list)
    daylight: list[illuminance.Reading] = field(default_factory=list)
    luminance: list[luminance.Reading] = field(default_factory=list)
    glare: glare.Rating | None = None
    diagnostics: list[Diagnostic] = field(default_factory=list)


def measure(scene: ir.Scene, request: Request, effort: Effort) -> Light:
    """Measure the light of a scene. Raises sensors.MeterError, ValueError and PlanError."""
    light = Light(diagnostics=_about_lights(scene))
    remaining = request.illuminance + request.daylight + bool(request.regions) + request.glare

    def share() -> Effort:
        nonlocal remaining
        remaining -= 1
        return effort.share(remaining + 1)

    if request.illuminance:
        light.meters, notes = illuminance.read(scene, request.meters, share())
        light.diagnostics += notes
    if request.daylight:
        light.daylight, notes = overcast.read(scene, request.meters, share())
        light.diagnostics += notes
    if request.regions:
        light.luminance, notes = luminance.read(scene, request.settings, list(request.regions), share())
        light.diagnostics += notes
    if request.glare:
        light.glare, notes = glare.rate(scene, request.settings, share())
        light.diagnostics += notes
    light.diagnostics += _missed(light, effort)
    light.diagnostics = list(dict.fromkeys(light.diagnostics))
    return light


def _about_lights(scene: ir.Scene) -> list[Diagnostic]:
    if any(said.startswith("sun:") for said in scene.defaults):
        return [Diagnostic("note", "the scene has no light: readings are of the sun and the sky that pictures add", None, "place lights")]
    if not scene.photometric:
        message = "no light of the scene has a photometric unit: bare numbers count as candela, lumen, lux and nit"
        return [Diagnostic("note", message, None, "write 800lm, 300lx or 2000nit")]
    return []


def _missed(light: Light, effort: Effort) -> list[Diagnostic]:
    """Warnings about readings whose error is above the one asked for."""
    warnings = []
    for reading in (*light.meters, *light.daylight):
        mean = reading.mean
        if mean.error > effort.error * mean.value > 0.0:
            message = f"the error of `{reading.meter.name}` is {mean.error / mean.value:.2%}; {effort.error:.2%} was asked for"
            warnings.append(Diagnostic("warning", message, reading.meter.place, "a longer --budget, or a larger --error"))
    return warnings


# --- text --------------------------------------------------------------------------------------------------------------


def lines(light: Light) -> Iterator[str]:
    """The lines of a report."""
    for reading in light.meters:
        yield reading.meter.name
        yield from _lines(reading, "illuminance", "lx", 1.0)
    for reading in light.daylight:
        yield f"{reading.meter.name}, daylight factor under the CIE overcast sky"
        yield from _lines(reading, "mean", "%", 100.0)
    for region in light.luminance:
        yield _label(region.region)
        yield f"  luminance    {number(region.mean)} cd/m²"
        if region.least is not None and region.most is not None:
            yield f"  least        {number(region.least)} cd/m²"
            yield f"  greatest     {number(region.most)} cd/m²"
    if light.glare is not None:
        yield from _glare_lines(light.glare)


def _lines(reading: illuminance.Reading, what: str, unit: str, factor: float) -> Iterator[str]:
    rows, columns = reading.cells.shape
    cells = f", mean of {columns} × {rows} cells" if reading.cells.size > 1 else ", mean of the surface" if reading.meter.on else ""
    yield f"  {what:<12} {number(reading.mean, factor)} {unit}{cells}"
    for name, value in (("least", reading.least), ("greatest", reading.most)):
        if value is not None:
            yield f"  {name:<12} {number(value, factor)} {unit}"
    if reading.uniformity is not None:
        yield f"  uniformity   {number(reading.uniformity)}"
    if reading.flux is not None:
        yield f"  flux         {number(reading.flux)} lm on {reading.area:.4g} m²"
    if reading.cells.size > 1 and columns <= MOST_COLUMNS and rows <= MOST_ROWS:
        shown = [[f"{factor * v:.4g}" for v in row] for row in reading.cells.tolist()]
        wide = max(len(text) for row in shown for text in row)
        for k, row in enumerate(shown):
            yield f"  {'cells' if k == 0 else '':<12} {'  '.join(text.rjust(wide) for text in row)}"


def _glare_lines(rating: glare.Rating) -> Iterator[str]:
    yield "glare at the camera"
    if rating.ugr is None:
        why = "the camera sees no lamp" if not rating.sources else "there is no light behind the lamps"
        yield f"  UGR          none: {why}"
    else:
        yield f"  UGR          {number(rating.ugr)}"
    yield f"  background   {number(rating.background)} cd/m²"
    for source in rating.sources:
        angle = number(source.solid_angle)
        yield f"  {source.name}: {source.luminance:,.4g} cd/m², {angle} sr, position index {source.position:.3g}"


def number(value: Value, factor: float = 1.0) -> str:
    """A value rounded to two digits of its error, which follows."""
    mean, error = value.value * factor, value.error * factor
    if not error > 0.0:
        return f"{mean:.6g}"
    digits = 1 - math.floor(math.log10(error))
    return f"{round(mean, digits):,.{max(digits, 0)}f} ± {error:.2g}"


def _label(region: tuple[int, int, int, int]) -> str:
    x0, y0, x1, y1 = region
    return f"pixel {x0},{y0}" if (x1 - x0, y1 - y0) == (1, 1) else f"region {x0},{y0},{x1},{y1}"


# --- data --------------------------------------------------------------------------------------------------------------


def as_data(light: Light) -> dict[str, Any]:
    """Plain data: lux, lumen, candela a square metre, steradians, metres; daylight factors in percent."""
    data: dict[str, Any] = {}
    if light.meters:
        data["meters"] = [_reading_data(reading, 1.0) for reading in light.meters]
    if light.daylight:
        data["daylight_factors"] = [_reading_data(reading, 100.0) for reading in light.daylight]
    if light.luminance:
        data["luminance"] = [
            {"region": list(r.region), "mean": _pair(r.mean), "least": _pair(r.least), "greatest": _pair(r.most),
             "pixels": {"value": r.pixels.tolist(), "error": r.errors.tolist()}, "samples": r.samples}
            for r in light.luminance
        ]  # fmt: skip
    if light.glare is not None:
        data["glare"] = {
            "ugr": _pair(light.glare.ugr), "background": _pair(light.glare.background),
            "sources": [
                {"name": s.name, "luminance": s.luminance, "solid_angle": _pair(s.solid_angle), "position_index": s.position}
                for s in light.glare.sources
            ],
        }  # fmt: skip
    return data


def _reading_data(reading: illuminance.Reading, factor: float) -> dict[str, Any]:
    rows, columns = reading.cells.shape
    return {
        "name": reading.meter.name, "mean": _pair(reading.mean, factor), "least": _pair(reading.least, factor),
        "greatest": _pair(reading.most, factor), "uniformity": _pair(reading.uniformity), "flux": _pair(reading.flux),
        "area": reading.area or None, "samples": reading.samples,
        "cells": {
            "columns": columns, "rows": rows, "value": (factor * reading.cells).tolist(), "error": (factor * reading.errors).tolist(),
        },
    }  # fmt: skip


def _pair(value: Value | None, factor: float = 1.0) -> dict[str, float] | None:
    return None if value is None else {"value": factor * float(value.value), "error": factor * float(value.error)}


def as_csv(light: Light) -> str:
    """A row for each value, with its error and unit; cells have the place of their middle in metres."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(ROW)
    for reading in light.meters:
        writer.writerows(_rows(reading, "illuminance", "lx", 1.0))
    for reading in light.daylight:
        writer.writerows(_rows(reading, "daylight factor", "%", 100.0))
    for region in light.luminance:
        for name, value in (("luminance", region.mean), ("least luminance", region.least), ("greatest luminance", region.most)):
            writer.writerows(_row(_label(region.region), name, value, "cd/m²"))
    if light.glare is not None:
        writer.writerows(_row("camera", "UGR", light.glare.ugr, ""))
        writer.writerows(_row("camera", "background luminance", light.glare.background, "cd/m²"))
    return out.getvalue()


def _rows(reading: illuminance.Reading, what: str, unit: str, factor: float) -> Iterator[list[Any]]:
    name = reading.meter.name
    yield from _row(name, f"mean {what}", reading.mean, unit, factor)
    yield from _row(name, f"least {what}", reading.least, unit, factor)
    yield from _row(name, f"greatest {what}", reading.most, unit, factor)
    yield from _row(name, f"uniformity of {what}", reading.uniformity, "")
    yield from _row(name, "flux", reading.flux, "lm")
    rows, columns = reading.cells.shape
    if reading.cells.size == 1:
        return
    frame, (x, z) = reading.meter.frame, reading.meter.size
    for row in range(rows):
        for column in range(columns):
            along, across = x * ((column + 0.5) / columns - 0.5), z * ((row + 0.5) / rows - 0.5)
            place = [f"{line[3] + along * line[0] + across * line[2]:.6g}" for line in frame[:3]]
            value, error = factor * reading.cells[row, column], factor * reading.errors[row, column]
            yield [name, what, column, row, *place, f"{value:.6g}", f"{error:.2g}", unit]


def _row(name: str, what: str, value: Value | None, unit: str, factor: float = 1.0) -> Iterator[list[Any]]:
    if value is not None:
        yield [name, what, "", "", "", "", "", f"{factor * value.value:.6g}", f"{factor * value.error:.2g}", unit]
