"""Luminance of pixels of a camera's picture, with its error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...compiler.plan import single_sided
from ...lang.diagnostics import Diagnostic
from .illuminance import Value, extremes, missing_light
from .replicates import Effort, Sampler

Region = tuple[int, int, int, int]  # x0, y0, x1, y1 in pixels from the top left


@dataclass(frozen=True)
class Reading:
    """The luminance of a region in candela a square metre. `pixels` and `errors` are (h, w)."""

    region: Region
    pixels: NDArray[np.float64]
    errors: NDArray[np.float64]
    mean: Value
    least: Value | None  # None of a single pixel
    most: Value | None
    samples: int  # of a pixel


def read(
    scene: ir.Scene, settings: ir.Settings, regions: list[Region], effort: Effort
) -> tuple[list[Reading], list[Diagnostic]]:  # fmt: skip
    """The luminance of regions of the picture with these settings. Raises ValueError for one outside of it."""
    if not regions:
        return [], []
    merged = settings.over(scene.settings)
    plain = replace(scene, settings=ir.Settings(background=merged.background))
    chosen = ir.Settings(size=merged.size, camera=merged.camera, background=merged.background)
    plan = planner.make_plan(plain, chosen)
    width, height = plan["size"]
    for x0, y0, x1, y1 in regions:
        if x1 > width or y1 > height:
            where = f"the pixel {x0},{y0}" if (x1 - x0, y1 - y0) == (1, 1) else f"the region {x0},{y0},{x1},{y1}"
            raise ValueError(f"{where} is outside of the picture of {width}x{height} pixels")
    sampler = Sampler(single_sided.seen_from(plain, plan["camera"], True).scene, chosen, effort)
    readings = []
    for k, region in enumerate(regions):
        sampler.effort = effort.share(len(regions) - k)
        readings.append(_read(sampler, region, (width, height)))
    return readings, missing_light(scene, sampler)


def _read(sampler: Sampler, region: Region, size: tuple[int, int]) -> Reading:
    camera = [sampler.view.camera]
    estimate = sampler.estimate(camera, size, region, every=False)
    lost = sampler.unbounced(camera, size, region)
    errors = estimate.error + lost * estimate.value
    mean = Value(estimate.mean, estimate.mean_error + lost * estimate.mean)
    least, most = extremes(estimate.value, errors) if estimate.value.size > 1 else (None, None)
    return Reading(region, estimate.value, errors, mean, least, most, estimate.samples)
