"""About how much memory a picture takes, before it is rendered.

Bytes a pixel are those of the arrays that live at once (film/canvas.py); they were checked against the largest resident memory of
pictures of 2000² to 8000² pixels. Bytes of the scene are those of its tables, with a factor for trees and copies.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ..compiler import ir
from ..compiler.plan import decision
from ..compiler.plan.plan import Plan
from .film import denoise
from .image import image

PROGRAM = 450_000_000  # bytes of the program, with what compiles kernels
SCENE = 3.0  # bytes of trees, records and tables, over those of tables
MESHES = 10.0  # the same of meshes, with those of their files
RGBA, ERRORS, SUMS, PHOTONS, WHOLE = 17, 51, 48, 18, 20  # bytes a pixel
FLOAT, CODE = 4, 4
GUIDES, NETWORK = 52, 600  # bytes a pixel of denoising: guides and copies; Open Image Denoise itself, up to denoise.MEMORY


class Estimate(NamedTuple):
    """Bytes of a process: `fixed`, and for each pixel that is rendered at once."""

    fixed: int
    pixel: int

    def total(self, pixels: int) -> int:
        """Bytes for this many pixels at once."""
        return self.fixed + self.pixel * pixels

    def most_pixels(self, memory: int) -> int:
        """The pixels that fit; may be negative."""
        return (memory - self.fixed) // self.pixel


def loaded(scene: ir.Scene) -> int:
    """Bytes that the process has already when a scene is loaded."""
    return PROGRAM + sum(array.nbytes for array in _arrays(scene.tables))


def estimate(scene: ir.Scene, plan: Plan, linear: bool) -> Estimate:
    """The estimate for a picture that is written as floats (`linear`) or as codes."""
    meshes = sum(array.nbytes for array in _arrays(scene.tables.pools))
    x0, y0, x1, y1 = plan["crop"]
    denoises = plan["denoise"] != "off"
    network = min(NETWORK * (x1 - x0) * (y1 - y0), 1_000_000 * denoise.MEMORY) if denoises else 0
    fixed = PROGRAM + network + int(SCENE * sum(array.nbytes for array in _arrays(scene.tables)) + (MESHES - SCENE) * meshes)
    channels = (GUIDES if denoises else 0) + FLOAT * sum(image.WIDTHS.get(name, image.LIGHT) for name in plan["aov"])
    encoded = channels + 4 * FLOAT if linear else CODE
    in_bands = plan["backend"] == "raster" and plan["lens"] == "pinhole" and plan["raster.sample_positions"] == "shared"
    if in_bands and not denoises:  # as of band_renderer.can_draw
        return Estimate(fixed, WHOLE + channels + encoded)
    pixel = RGBA + channels + encoded
    if plan["samples"] > 1:
        pixel += ERRORS
    photons = plan["transport"] == "path"
    if photons or decision.adaptive(plan):
        pixel += SUMS
    return Estimate(fixed, pixel + (PHOTONS if photons else 0))


def _arrays(value: Any) -> Iterator[np.ndarray]:
    if isinstance(value, np.ndarray):
        yield value
    elif hasattr(value, "_fields"):
        for field in value:
            yield from _arrays(field)
