"""About how much memory a picture takes besides that of the loaded scene, before it is rendered.

Bytes a pixel are those of the arrays that live at once (film/canvas.py). All figures were fitted to the peak resident memory of the
pictures in tests/render/memory_cases.py, with compiled kernels. The compiler takes COMPILER more where it is needed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ..compiler import ir
from ..compiler.plan import channels, decision
from ..compiler.plan.plan import Plan
from .film import denoise, tile_queue
from .image import image
from .simd import target

MB = 1_000_000
COMPILER = 300 * MB  # bytes of Numba and LLVM
WHITTED, PATHS, RASTER, FORMULAS = 30 * MB, 50 * MB, 65 * MB, 60 * MB  # bytes of modules, kernels and memory of threads
THREAD, THREADS = 3 * MB, 2  # bytes of a thread, and the threads whose bytes are in the figures above
PACKET, GUIDE = 44, 104  # bytes of the hit of a sample with formulas, and of a sample in the guides of denoising
PIXELS, FEWEST = 64**2, 8  # of a tile in packets, and the samples of each whose hits there is memory for at least
SCENE = 3.0  # bytes of trees, records and tables, over those of tables
MESHES = 6.0  # the same of meshes
PYRAMIDS = 1.65  # bytes of smaller copies of pictures and of their parts, over those of pictures
RGBA, ERRORS, SUMS, ROUNDS, WHOLE = 26, 55, 71, 101, 20  # bytes a pixel; sums of adaptive samples, rounds of paths
FLOAT, CODE = 4, 4
GROUP = 28  # bytes a pixel of the sums of a light group
GUIDES, NETWORK = 52, 600  # bytes a pixel of denoising: guides and copies; Open Image Denoise itself, up to denoise.MEMORY


class Estimate(NamedTuple):
    """Bytes that drawing takes: `fixed`, and for each pixel that is rendered at once."""

    fixed: int
    pixel: int

    def total(self, pixels: int) -> int:
        """Bytes for this many pixels at once."""
        return self.fixed + self.pixel * pixels

    def most_pixels(self, memory: int) -> int:
        """The pixels that fit; may be negative."""
        return (memory - self.fixed) // self.pixel


def estimate(scene: ir.Scene, plan: Plan, linear: bool) -> Estimate:
    """The estimate for a picture that is written as floats (`linear`) or as codes."""
    fixed, denoises = _fixed(scene, plan), plan["denoise"] != "off"
    others = (GUIDES if denoises else 0) + FLOAT * sum(image.WIDTHS.get(name, image.LIGHT) for name in plan["aov"])
    encoded = others + 4 * FLOAT if linear else CODE
    in_bands = plan["backend"] == "raster" and plan["lens"] == "pinhole" and plan["raster.sample_positions"] == "shared"
    if in_bands and not denoises:  # as of band_renderer.can_draw
        return Estimate(fixed, WHOLE + others + encoded)
    pixel = RGBA + others + encoded + GROUP * _groups(plan)
    if plan["samples"] > 1:
        pixel += ERRORS
    if plan["transport"] == "path":
        pixel += ROUNDS
    elif decision.adaptive(plan):
        pixel += SUMS
    return Estimate(fixed, pixel)


def _fixed(scene: ir.Scene, plan: Plan) -> int:
    """Bytes that do not depend on the number of pixels, but for denoising."""
    tables = scene.tables
    texels, meshes = tables.images.texels.nbytes, sum(array.nbytes for array in _arrays(tables.pools))
    others = sum(array.nbytes for array in _arrays(tables)) - texels - meshes
    paths = plan["transport"] == "path"
    total = SCENE * others + MESHES * meshes
    if plan["texture_filter"] == "footprint" and not (paths and plan["backend"] == "ray"):
        total += PYRAMIDS * texels
    total += RASTER if plan["backend"] == "raster" else PATHS if paths else WHITTED
    formulas = bool((tables.geometries.kind == ir.GeometryKind.FORMULA).any())
    if formulas:
        total += FORMULAS
    total += _of_more_threads(plan, formulas)
    if plan["denoise"] != "off":
        x0, y0, x1, y1 = plan["crop"]
        total += min(NETWORK * (x1 - x0) * (y1 - y0), MB * denoise.MEMORY)
    return int(total)


def _of_more_threads(plan: Plan, formulas: bool) -> int:
    """Bytes of the threads beyond THREADS."""
    packets = guides = 0
    parts = max(_groups(plan), 1)  # each with memory of its own where that depends on the scene
    alone = THREAD * (parts if plan["backend"] == "raster" else 1)
    if formulas and plan["backend"] == "ray" and plan["transport"] != "path":
        packets = parts * PACKET * PIXELS * min(max(int(plan["samples"]), FEWEST), tile_queue.CALL)
    if plan["denoise"] != "off":  # after the samples
        guides = GUIDE * denoise.SIDE**2 * min(int(plan["samples"]), denoise.SAMPLES)
    return (alone + max(packets, guides)) * max((int(plan["threads"]) or target.cores()) - THREADS, 0)


def _groups(plan: Plan) -> int:
    """Light groups that are drawn, with that of all others; 0 for a picture without."""
    named = channels.light_groups(plan)
    return len(named) + 1 if named else 0


def _arrays(value: Any) -> Iterator[np.ndarray]:
    if isinstance(value, np.ndarray):
        yield value
    elif hasattr(value, "_fields"):
        for field in value:
            yield from _arrays(field)
