"""A picture in bands: each is filled with what its samples see, then what they see is lit, once for each triangle in each pixel.

Samples lie at the same places in every pixel, and a pixel's filter weighs those around it. Where shadows or patterns run across
triangles, or light is found with random numbers, every sample is lit for itself. More than sixteen samples are drawn sixteen at a time,
each time at other places.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...compiler.plan import plan as planner
from ...compiler.plan.plan import Plan
from ..image.metrics import EPSILON, luminance
from ..types import View
from . import (
    alternative_fills,
    band_memory,
    band_scheduler,
    deferred_shading,
    integrator_shading,
    meshlet_culling,
    triangle_setup,
)
from .passes import Pass, passes

ROWS = {1: 64, 4: 32}  # rows of a band by samples, where its buffer still fits the second cache; else 16

MESHLET_SECONDS, SAMPLE_SECONDS = 3e-6, 1.5e-9  # seconds a sample


def needs_no_rays(plan: Plan) -> bool:
    """Whether a picture takes nothing but its triangles: no trees, no integrator."""
    return can_draw(plan) and plan["raster.precision"] == "float32" and not plan["aov"]


def can_draw(plan: Plan) -> bool:
    """Whether a picture is drawn in bands: samples at the same places in all pixels, one moment, one point."""
    alike = not any(name.startswith((planner.LIGHT, "crypto_", "variance")) for name in plan["aov"])  # nothing is told sample by sample
    once = alike and not plan["denoise"] and not plan["motion"] and plan["lens"] == "pinhole"
    return bool(once and not planner.adaptive(plan) and plan["raster.places"] == "shared")


class BandRenderer:
    """One picture to be drawn, band by band, by any number of threads. `rgba` is not filled before a band is drawn, or all is finished."""

    def __init__(self, prepared: Any, plan: Plan, view: View) -> None:
        self.prepared, self.view = prepared, view
        made = prepared.triangles
        samples = plan["samples"]
        x0, y0, x1, y1 = (int(c) for c in plan["crop"])
        self.corners = x0, y0, x1, y1
        self.crop = np.array(self.corners, np.int64)
        self.per_sample = samples > 1 and (plan["raster.shading"] == "sample" or plan["random numbers"])
        self.passes = passes(samples, plan["random numbers"], plan["filter"])
        self.reach = self.passes[0].weights.tables.reach
        self.margin = 4 * -(-self.reach // 4)
        self.rows = ROWS.get(len(self.passes[0].pattern.x), 16)
        self.first, self.bands = y0 // self.rows, meshlet_culling.count_bands(self.corners, self.rows)
        known = made.pool.take(self.bands)
        self.visible = meshlet_culling.find_visible(
            made.projection, made.meshlets, made.meshlet_ranges, self.corners, self.reach, self.rows, known
        )
        self.fill = None
        if plan["raster.fill"] != "edges":
            meshlets = made.meshlets.tables
            self.fill = alternative_fills.AlternativeFill(
                plan["raster.fill"], prepared.tables, prepared.packed, view, made.model, made.ranges, meshlets
            )
        self.plain = plan["raster.precision"] == "float32"
        self.background = plan["background"]
        shape = y1 - y0, x1 - x0
        self.rgba = made.pool.picture((*shape, 4))
        self.half = len(self.passes) // 2  # passes after which `apart` is told
        self.half_difference = np.zeros((*shape, 3), np.float32) if self.half else None  # how far the mean of all may be off, by its halves
        self._drawn = np.zeros(self.bands, np.bool_)
        self._picture = object()
        columns, most = x1 - (x0 & ~3) + 2 * self.margin, len(self.visible.tables.instance)
        kinds = self.plain, made.textured is not None, made.colored is not None
        self.sizes = [band_memory.BufferSize(columns, self.rows + 2 * self.margin, len(one.pattern.x), *kinds, most) for one in self.passes]
        self._queue = None
        if self.plain and self.fill is None and not len(made.untessellated) and len(self.passes) == 1 and self.visible.tables.count[0] > 0:
            layout = band_scheduler.BandLayout(self.first, self.bands, self.rows, self.margin, self.reach)
            output = band_scheduler.ShadingTarget(self.per_sample, made.textured, made.colored, made.flat, self.crop, self.rgba)
            self._queue = band_scheduler.BandQueue(layout, int(plan["threads"]), self._cost(), output)
        self.jobs: Sequence[int] = range(self._queue.jobs if self._queue else self.bands)

    @property
    def error(self) -> float | None:
        """√relMSE as the halves of the samples tell it; None where all are drawn at once."""
        if self.half_difference is None or not self.half_difference.size:
            return None
        light = self.rgba[..., :3].astype(np.float64)
        least = max((EPSILON * float(luminance(light).mean())) ** 2, float(np.finfo(np.float64).tiny))
        around = light.copy()
        for axis in (0, 1):
            there = np.pad(around, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
            around = sum(there.take(range(k, k + light.shape[axis]), axis) for k in range(3)) / 3.0
        known = np.minimum(np.abs(light), np.abs(around))  # a stray bright sample does not excuse itself
        return float(np.sqrt(np.mean(np.square(self.half_difference, dtype=np.float64) / (known * known + least))))

    def draw(self, job: int) -> int:
        """Draw a band into `rgba`, or those that are a turn's; how many of their items were not finite and left out."""
        if self._queue is None:
            return self._draw_passes(job)
        with self._memory(0) as memory:
            numbers, issues = self._queue.draw(memory.filling, memory.shading)
        for number in numbers.tolist():
            self._complete(number)
        return issues

    def _draw_passes(self, number: int) -> int:
        """Draw a band, pass by pass."""
        top, bottom = self._between(number)
        window, issues = slice(top - self.corners[1], bottom - self.corners[1]), 0
        for k, one in enumerate(self.passes):
            if self.half_difference is not None and k == self.half:
                self.half_difference[window] = self.rgba[window, :, :3]
            with self._memory(k) as memory:
                issues += self._draw(number, memory, one, top, bottom)
        if self.half_difference is not None:
            # of T = h A + (1 - h) B, the difference of independent halves A - B tells √(h (1 - h)) (A - B)
            h = self.passes[self.half].first / sum(len(one.pattern.x) for one in self.passes)
            self.half_difference[window] = (self.half_difference[window] - h * self.rgba[window, :, :3]) / np.sqrt(h * (1.0 - h))
        self._complete(number)
        return issues

    def _cost(self) -> float:
        """Seconds that one thread takes, about."""
        x0, y0, x1, y1 = self.corners
        return self.sizes[0].samples * (int(self.visible.tables.start[-1]) * MESHLET_SECONDS + (x1 - x0) * (y1 - y0) * SAMPLE_SECONDS)

    @contextlib.contextmanager
    def _memory(self, k: int) -> Iterator[band_memory.BandMemory]:
        """Memory for pass k that nobody else uses."""
        pool, size = self.prepared.triangles.pool, self.sizes[k]
        memory = pool.take(size) or band_memory.BandMemory(size, self.prepared.options)
        memory.serve(self._picture, self.prepared, self.visible, self.passes[k])
        yield memory
        pool.give(size, memory)

    def finish(self) -> None:
        """Empty the bands that have not been drawn; no more will be."""
        self.prepared.triangles.pool.give(self.bands, self.visible)
        if self._drawn.all():
            return
        for number in np.flatnonzero(~self._drawn).tolist():
            top, bottom = self._between(number)
            self.rgba[top - self.corners[1] : bottom - self.corners[1]] = 0.0

    def _between(self, number: int) -> tuple[int, int]:
        """Rows of pixels that a band has."""
        return max((self.first + number) * self.rows, self.corners[1]), min((self.first + number + 1) * self.rows, self.corners[3])

    def _draw(self, number: int, memory: band_memory.BandMemory, one: Pass, top: int, bottom: int) -> int:
        """Draw a pass of a band's rows `top` to `bottom`."""
        _, y0, _, _ = self.corners
        band = memory.band.tables
        band_scheduler.set_band(band, self.first + number, self.rows, self.margin, self.reach, self.crop)
        made, visible = self.prepared.triangles, self.visible
        memory.fragments.tables.counts[3] = 0
        if self.fill is None:
            triangle_setup.draw_band(memory.filling, number)
        else:
            self.fill.draw(memory.band, one.pattern, visible.tables)
        p = self.prepared
        here = np.flatnonzero((made.boxes[:, 1] < band.clip[3]) & (made.boxes[:, 3] > band.clip[1])) if len(made.untessellated) else ()
        if len(here):
            integrator_shading.draw_untessellated(
                made.model, made.untessellated[here], made.boxes[here], p.packed, p.accel, self.view, one.places, memory.band
            )
        if self.plain and visible.tables.count[0] > 0:
            how = self.per_sample, one.first == 0, made.textured, made.colored, made.flat
            deferred_shading.shade_band(memory.shading, *how, self.crop, self.rgba)
        elif one.first == 0:
            self.rgba[top - y0 : bottom - y0] = 0.0
        if not self.plain:
            integrator_shading.shade_band(memory.shading, self.per_sample, one.first, self.crop, self.rgba)
        return int(memory.fragments.tables.counts[3])

    def _complete(self, number: int) -> None:
        """Put the background behind a band, which is drawn now."""
        top, bottom = self._between(number)
        self._drawn[number] = True
        if self.background == "transparent":
            return
        x0, y0, _, _ = self.corners
        window = self.rgba[top - y0 : bottom - y0]
        if self.background == "sky":
            integrator_shading.composite_sky(self.prepared.packed, self.prepared.frame, x0, top, window.shape[1], window.reshape(-1))
        else:
            window[..., :3] += (1.0 - window[..., 3:]) * np.asarray(self.background, np.float32)
