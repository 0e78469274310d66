"""Renders a picture band by band: fills each band's visibility buffer, then shades each triangle once in each pixel.

All pixels have the same sample positions; a pixel's filter weights the samples around it. Each sample is shaded by itself where shadows or
textures have edges within triangles, or where light is sampled at random. More than sixteen samples take several passes of sixteen at
most, each at other positions.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ...compiler.plan import channels, decision
from ...compiler.plan.plan import Plan
from ..image.metrics import EPSILON, luminance
from ..types import NoAirlight, View
from . import (
    alternative_fills,
    band_memory,
    band_scheduler,
    deferred_shading,
    integrator_shading,
    meshlet_culling,
    triangle_setup,
)
from .fragments import NOT_FINITE
from .passes import Pass, passes

ROWS = {1: 64, 4: 32}  # rows of a band by samples: its buffer fits the second-level cache; else 16

MESHLET_SECONDS, SAMPLE_SECONDS = 3e-6, 1.5e-9  # estimated cost of a meshlet, and of a pixel, for each sample


def needs_no_rays(plan: Plan) -> bool:
    """Whether a picture needs neither a BVH nor the integrator."""
    return can_draw(plan) and plan["raster.precision"] == "float32" and not plan["aov"]


def can_draw(plan: Plan) -> bool:
    """Whether a picture is drawn in bands: equal sample positions in all pixels, no motion, a pinhole camera."""
    shared = not any(name.startswith((channels.LIGHT, "crypto_", "variance")) for name in plan["aov"])  # these need single samples
    once = shared and plan["denoise"] == "off" and not plan["motion_blur"] and plan["lens"] == "pinhole"
    return bool(once and not decision.adaptive(plan) and plan["raster.sample_positions"] == "shared")


class BandRenderer:
    """Renders one picture, band by band, in any number of threads. A band of `rgba` is undefined until `draw` or `finish`."""

    def __init__(self, prepared: Any, plan: Plan, view: View) -> None:
        self.prepared, self.view = prepared, view
        scene = prepared.raster
        samples = plan["samples"]
        x0, y0, x1, y1 = (int(c) for c in plan["crop"])
        self.corners = x0, y0, x1, y1
        self.crop = np.array(self.corners, np.int64)
        self.per_sample = samples > 1 and (plan["raster.shading"] == "sample" or plan["monte_carlo"])
        self.passes = passes(samples, plan["monte_carlo"], plan["filter"])
        self.reach = self.passes[0].weights.tables.reach
        self.margin = 4 * -(-self.reach // 4)
        self.rows = ROWS.get(len(self.passes[0].pattern.x), 16)
        self.first, self.bands = y0 // self.rows, meshlet_culling.count_bands(self.corners, self.rows)
        reused = scene.pool.take(self.bands)
        self.visible = meshlet_culling.find_visible(
            scene.projection, scene.meshlets, scene.meshlet_ranges, self.corners, self.reach, self.rows, reused
        )
        self.fill = None
        if plan["raster.coverage"] != "edges":
            meshlets = scene.meshlets.tables
            self.fill = alternative_fills.AlternativeFill(
                plan["raster.coverage"], prepared.tables, prepared.packed, view, scene.model, scene.ranges, meshlets
            )
        self.float32 = plan["raster.precision"] == "float32"
        self.background = plan["background"]
        shape = y1 - y0, x1 - x0
        self.rgba = scene.pool.picture((*shape, 4))
        self.half = len(self.passes) // 2  # the first pass of the second half
        self.half_difference = np.zeros((*shape, 3), np.float32) if self.half else None  # estimated error, from the halves of the samples
        self._drawn = np.zeros(self.bands, np.bool_)
        self._picture = object()
        columns, most = x1 - (x0 & ~3) + 2 * self.margin, len(self.visible.tables.instance)
        kinds = self.float32, scene.textured is not None, scene.colored is not None
        self.sizes = [
            band_memory.BufferSize(columns, self.rows + 2 * self.margin, len(raster_pass.pattern.x), *kinds, most)
            for raster_pass in self.passes
        ]
        self._queue = None
        single = len(self.passes) == 1 and self.fill is None and not len(scene.untessellated)
        if self.float32 and single and self.visible.tables.count[0] > 0:
            layout = band_scheduler.BandLayout(self.first, self.bands, self.rows, self.margin, self.reach)
            output = band_scheduler.ShadingTarget(self.per_sample, scene.textured, scene.colored, scene.flat, self.crop, self.rgba)
            self._queue = band_scheduler.BandQueue(layout, int(plan["threads"]), self._cost(), output)
        self.jobs: Sequence[int] = range(self._queue.jobs if self._queue else self.bands)

    @property
    def error(self) -> float | None:
        """√relMSE, estimated from the halves of the samples; None with a single pass."""
        if self.half_difference is None or not self.half_difference.size:
            return None
        light = self.rgba[..., :3].astype(np.float64)
        least = max((EPSILON * float(luminance(light).mean())) ** 2, float(np.finfo(np.float64).tiny))
        around = light.copy()
        for axis in (0, 1):
            padded = np.pad(around, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge")
            around = sum(padded.take(range(k, k + light.shape[axis]), axis) for k in range(3)) / 3.0
        scale = np.minimum(np.abs(light), np.abs(around))  # a single bright sample must not hide its own error
        return float(np.sqrt(np.mean(np.square(self.half_difference, dtype=np.float64) / (scale * scale + least))))

    def draw(self, job: int) -> int:
        """Draw one job's bands into `rgba`; returns the number of fragments omitted because they are not finite."""
        if self._queue is None:
            return self._draw_passes(job)
        with self._memory(0) as memory:
            numbers, issues = self._queue.draw(memory.filling, memory.shading)
        for number in numbers.tolist():
            self._composite(number)
        return issues

    def _draw_passes(self, number: int) -> int:
        """Draw all passes of a band."""
        top, bottom = self._row_range(number)
        window, issues = slice(top - self.corners[1], bottom - self.corners[1]), 0
        for k, raster_pass in enumerate(self.passes):
            if self.half_difference is not None and k == self.half:
                self.half_difference[window] = self.rgba[window, :, :3]
            with self._memory(k) as memory:
                issues += self._draw_pass(number, memory, raster_pass, top, bottom)
        if self.half_difference is not None:
            # T = h A + (1 - h) B of independent halves A, B has the error √(h (1 - h)) (A - B)
            h = self.passes[self.half].first / sum(len(raster_pass.pattern.x) for raster_pass in self.passes)
            self.half_difference[window] = (self.half_difference[window] - h * self.rgba[window, :, :3]) / np.sqrt(h * (1.0 - h))
        self._composite(number)
        return issues

    def _cost(self) -> float:
        """The estimated time in seconds of one thread."""
        x0, y0, x1, y1 = self.corners
        return self.sizes[0].samples * (int(self.visible.tables.start[-1]) * MESHLET_SECONDS + (x1 - x0) * (y1 - y0) * SAMPLE_SECONDS)

    @contextlib.contextmanager
    def _memory(self, k: int) -> Iterator[band_memory.BandMemory]:
        """Borrow buffers for pass k from the pool."""
        pool, size = self.prepared.raster.pool, self.sizes[k]
        memory = pool.take(size) or band_memory.BandMemory(size, self.prepared.options)
        memory.bind(self._picture, self.prepared, self.visible, self.passes[k])
        yield memory
        pool.give(size, memory)

    def finish(self) -> None:
        """End the picture: clears the bands not drawn."""
        self.prepared.raster.pool.give(self.bands, self.visible)
        if self._drawn.all():
            return
        for number in np.flatnonzero(~self._drawn).tolist():
            top, bottom = self._row_range(number)
            self.rgba[top - self.corners[1] : bottom - self.corners[1]] = 0.0

    def _row_range(self, number: int) -> tuple[int, int]:
        """The first row of a band's pixels, and the end."""
        return max((self.first + number) * self.rows, self.corners[1]), min((self.first + number + 1) * self.rows, self.corners[3])

    def _draw_pass(self, number: int, memory: band_memory.BandMemory, raster_pass: Pass, top: int, bottom: int) -> int:
        """Draw one pass of a band, pixel rows `top` to `bottom`; returns the number of fragments not finite."""
        _, y0, _, _ = self.corners
        band = memory.band.tables
        band_scheduler.set_band(band, self.first + number, self.rows, self.margin, self.reach, self.crop)
        scene, visible = self.prepared.raster, self.visible
        memory.fragments.tables.counts[NOT_FINITE] = 0
        if self.fill is None:
            triangle_setup.draw_band(memory.filling, number)
        else:
            self.fill.draw(memory.band, raster_pass.pattern, visible.tables)
        p = self.prepared
        shown = np.flatnonzero((scene.boxes[:, 1] < band.clip[3]) & (scene.boxes[:, 3] > band.clip[1])) if len(scene.untessellated) else ()
        if len(shown):
            integrator_shading.draw_untessellated(
                scene.model, scene.untessellated[shown], scene.boxes[shown], p.packed, p.accel, self.view, raster_pass.places, memory.band
            )
        if self.float32 and visible.tables.count[0] > 0:
            how = self.per_sample, raster_pass.first == 0, scene.textured, scene.colored, scene.flat
            deferred_shading.shade_band(memory.shading, *how, self.crop, self.rgba)
        elif raster_pass.first == 0:
            self.rgba[top - y0 : bottom - y0] = 0.0
        if not self.float32:
            integrator_shading.shade_band(memory.shading, self.per_sample, raster_pass.first, self.crop, self.rgba)
        return int(memory.fragments.tables.counts[NOT_FINITE])

    def _composite(self, number: int) -> None:
        """Composite a finished band over the background."""
        top, bottom = self._row_range(number)
        self._drawn[number] = True
        foggy = not isinstance(self.prepared.options.airlight, NoAirlight)
        if self.background == "transparent" and not foggy:
            return
        x0, y0, _, _ = self.corners
        window = self.rgba[top - y0 : bottom - y0]
        if self.background == "sky" or foggy:
            integrator_shading.composite_sky(self.prepared.packed, self.prepared.frame, x0, top, window.shape[1], window.reshape(-1))
        else:
            window[..., :3] += (1.0 - window[..., 3:]) * np.asarray(self.background, np.float32)
