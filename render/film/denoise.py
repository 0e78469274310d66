"""Denoising with Intel's Open Image Denoise, guided by albedo and normals.

The package pyoidn (extra `denoise`) contains the library; only this module loads it. Alpha is unchanged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ..image.image import Image
from ..jit import thread_pool
from ..lanes import ops
from ..simd import target
from ..surface import interaction
from ..surface.material_inputs import color_of
from ..types import FirstHits, Hit, Ray, Tile
from . import aov, film

SAMPLES = 16  # most samples of a pixel for the guides: 4 leave twice the error at texture edges
CLEAR = (int(ir.Slot.SPECULAR), int(ir.Slot.REFLECTION), int(ir.Slot.TRANSMISSION))  # colors of materials without a diffuse color


def denoise(image: Image, renderer: film.Renderer, plan: Plan) -> None:
    """Denoise a picture's color in place."""
    import pyoidn  # pyright: ignore[reportMissingImports]

    albedo, normal = guides(renderer, plan)
    rgba = image.channels["rgba"]
    color = np.ascontiguousarray(rgba[..., :3])
    rgba[..., :3] = pyoidn.denoise(color, albedo=albedo, normal=normal, hdr=True)
    image.metadata["denoised"] = True


def guides(renderer: film.Renderer, plan: Plan) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(albedo, normal) of first hits, (h, w, 3) each, averaged over samples."""
    x0, y0, x1, y1 = plan["crop"]
    found = np.zeros((2, y1 - y0, x1 - x0, 3))
    count = min(SAMPLES, int(plan["samples"]))

    def draw(tile: Tile) -> None:
        window = found[:, tile.y0 - y0 : tile.y1 - y0, tile.x0 - x0 : tile.x1 - x0]
        for s in range(count):
            window += _seen(renderer.first(tile, s, int(plan["samples"]))).reshape(window.shape) / count

    threads = int(plan["threads"]) or target.cores()
    thread_pool.parallel_for(draw, film.tiles((x0, y0, x1, y1)), threads)
    albedo, normal = found.astype(np.float32)
    return np.clip(albedo, 0.0, 1.0), normal


def _seen(first: FirstHits) -> NDArray[np.float64]:
    """(2, n, 3) albedo and normal of hits; 0 for misses. The albedo of mirrors and glass is their specular color."""
    tables, ray, hit = first
    out = np.zeros((2, len(hit.t), 3))
    here = np.flatnonzero(hit.instance >= 0)
    if len(here) == 0:
        return out
    part = Ray(aov.take_lanes(ray.origin, here, len(hit.t)), aov.take_lanes(ray.direction, here, len(hit.t)), 0.0, np.inf)
    with np.errstate(all="ignore"):
        at = interaction.make_interaction(tables, part, Hit(*(column[here] for column in hit)))
        albedo = ops.mul(color_of(tables, at, aov.DIFFUSE), at.color)
        for slot in CLEAR:
            albedo = ops.add(albedo, color_of(tables, at, slot))
        shines = np.max(color_of(tables, at, int(ir.Slot.EMISSION)), axis=0) > 0.0
    out[0, here] = np.where(shines[:, None], 1.0, np.stack(np.broadcast_arrays(*albedo), axis=1))
    out[1, here] = np.stack(np.broadcast_arrays(*at.normal), axis=1)
    return np.where(np.isfinite(out), out, 0.0)
