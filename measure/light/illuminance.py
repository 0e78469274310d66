"""Illuminance on the meters of a scene: of each cell, their mean, least, greatest, uniformity and luminous flux, each with its error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...lang.diagnostics import Diagnostic
from ...lights import AMBIENT
from . import sensors
from .replicates import Effort, Sampler

F64 = NDArray[np.float64]


class Value(NamedTuple):
    """A value and the half width of its 95 % confidence interval."""

    value: float
    error: float


@dataclass(frozen=True)
class Reading:
    """What a meter reads, in lux and lumen. `cells` and `errors` are (rows along z, columns along x)."""

    meter: ir.Meter
    cells: F64
    errors: F64
    mean: Value
    least: Value | None  # None where there are no cells: at a point and on a surface
    most: Value | None
    uniformity: Value | None
    flux: Value | None  # None at a point
    area: float
    samples: int  # of a cell

    def over(self, illuminance: float) -> Reading:
        """The reading as shares of an illuminance."""

        def part(value: Value | None) -> Value | None:
            return None if value is None else Value(value.value / illuminance, value.error / illuminance)

        return replace(
            self, cells=self.cells / illuminance, errors=self.errors / illuminance, mean=part(self.mean), least=part(self.least),
            most=part(self.most), flux=None,
        )  # fmt: skip


def read(scene: ir.Scene, meters: Sequence[ir.Meter], effort: Effort) -> tuple[list[Reading], list[Diagnostic]]:
    """The readings of meters, and warnings about light that they lack. Raises sensors.MeterError."""
    if not meters:
        return [], []
    seen, placed = sensors.with_sensors(scene, meters, effort.seed)
    sampler = Sampler(seen, ir.Settings(size=(1, 1), camera="0"), effort, precision(scene, meters))
    readings = []
    for k, sensor in enumerate(placed):
        sampler.effort = effort.share(len(placed) - k)
        readings.append(_read(sensor, sampler))
    return readings, missing_light(scene, sampler) + [note for reading in readings for note in _dark(reading)]


def precision(scene: ir.Scene, meters: Sequence[ir.Meter]) -> dict[str, str]:
    """The precision of the scene's own pictures, as a choice of the plan: sensors at points are small, but nothing hits them.

    float64 far from the origin, where a sensor would be as coarse as its coordinates.
    """
    if sensors.is_far(scene, meters):
        return {"precision": "float64"}
    paths = {"interreflection": "true", "transport": "path"}
    return {"precision": planner.make_plan(scene, ir.Settings(backend="ray", bounces=1), paths)["precision"]}


def _read(sensor: sensors.Sensor, sampler: Sampler) -> Reading:
    estimate = sampler.estimate(sensor.cameras, sensor.cells)
    lost = sampler.unbounced(sensor.cameras, sensor.cells)
    lost += sensor.height_error
    cells, errors = math.pi * estimate.value, math.pi * (estimate.error + lost * estimate.value)
    mean = Value(math.pi * estimate.mean, math.pi * (estimate.mean_error + lost * estimate.mean))
    flux = None
    if sensor.area:
        flux = Value(mean.value * sensor.area, mean.error * sensor.area + mean.value * sensor.area_error)
    least = most = uniformity = None
    if cells.size > 1:
        least, most = extremes(cells, errors)
        uniformity = _ratio(least, mean)
    return Reading(sensor.meter, cells, errors, mean, least, most, uniformity, flux, sensor.area, estimate.samples)


def extremes(values: F64, errors: F64) -> tuple[Value, Value]:
    """The least and the greatest of values with errors.

    The least of noisy values is too small on average. Its interval holds the least value if each value lies in its own, widened to
    those of all values together.
    """
    wide = errors * math.sqrt(1.0 + 0.5 * math.log(values.size))
    least, most = float(values.min()), float(values.max())
    below, above = least - float((values - wide).min()), float((values + wide).min()) - least
    low = Value(least, max(below, above))
    below, above = most - float((values - wide).max()), float((values + wide).max()) - most
    return low, Value(most, max(below, above))


def _ratio(a: Value, b: Value) -> Value | None:
    if b.value <= 0.0:
        return None
    ratio = a.value / b.value
    return Value(ratio, math.hypot(a.error, ratio * b.error) / b.value)


def missing_light(scene: ir.Scene, sampler: Sampler) -> list[Diagnostic]:
    """Warnings about light that readings lack or find by chance."""
    warnings = []
    if sampler.lacks_caustics:
        message = "small lights shine through glass or off mirrors here: paths find that light by chance, and that of points not at all"
        hint = "larger lamps have true errors: give points a radius, or draw the picture, whose photons find it"
        warnings.append(Diagnostic("warning", f"{message}; values and their errors may be too small", None, hint))
    ambient = np.flatnonzero(ir.is_in(scene.tables.lights.kind, AMBIENT))
    if len(ambient):
        message = "an ambient light has no direction: a meter receives only what other surfaces reflect of it"
        warnings.append(Diagnostic("warning", message, scene.spans.get("lights", int(ambient[0])), "a sky lights meters, too"))
    return warnings


def _dark(reading: Reading) -> list[Diagnostic]:
    if reading.mean.value > 0.0:
        return []
    message = f"no light reaches the meter `{reading.meter.name}`"
    hint = "it may face away from the light, or lie inside of an object: `facing` turns it"
    return [Diagnostic("note", message, reading.meter.place, hint)]
