"""Denoising a picture with Intel's Open Image Denoise, where it is asked for: color guided by albedo and normals, averaged over samples.

The package pyoidn (`pip install maquette[denoise]`) brings the library; it is loaded here and nowhere else. Coverage stays as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ..image.image import Image
from ..jit import thread_pool
from ..lanes import ops
from ..material import bsdf
from ..simd import target
from ..surface import interaction
from ..types import FirstHits, Hit, Ray, Tile
from . import aov, film

SAMPLES = 16  # of a pixel, at the most, that guides are averaged over: 4 leave twice the error at edges of patterns
CLEAR = (int(ir.Slot.SPECULAR), int(ir.Slot.REFLECTION), int(ir.Slot.TRANSMISSION))  # what things that are not matt look like


def denoised(image: Image, renderer: film.Renderer, plan: Plan) -> None:
    """Replace a picture's color by what is left of it without noise."""
    import pyoidn  # pyright: ignore[reportMissingImports]

    albedo, normal = guides(renderer, plan)
    rgba = image.channels["rgba"]
    color = np.ascontiguousarray(rgba[..., :3])
    rgba[..., :3] = pyoidn.denoise(color, albedo=albedo, normal=normal, hdr=True)
    image.metadata["denoised"] = True


def guides(renderer: film.Renderer, plan: Plan) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(albedo, normal) of what is seen first, (h, w, 3) each, averaged as the picture's samples lie."""
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
    """(2, n, 3) albedo and normal of what rays hit; 0 of nothing. Mirrors and glass have the color they tint light with."""
    tables, ray, hit = first
    out = np.zeros((2, len(hit.t), 3))
    here = np.flatnonzero(hit.instance >= 0)
    if len(here) == 0:
        return out
    part = Ray(aov.some(ray.origin, here, len(hit.t)), aov.some(ray.direction, here, len(hit.t)), 0.0, np.inf)
    with np.errstate(all="ignore"):
        at = interaction.make_interaction(tables, part, Hit(*(column[here] for column in hit)))
        albedo = ops.mul(bsdf.color_of(tables, at, aov.DIFFUSE), at.color)
        for slot in CLEAR:
            albedo = ops.add(albedo, bsdf.color_of(tables, at, slot))
        shines = np.max(bsdf.color_of(tables, at, int(ir.Slot.EMISSION)), axis=0) > 0.0
    out[0, here] = np.where(shines[:, None], 1.0, np.stack(np.broadcast_arrays(*albedo), axis=1))
    out[1, here] = np.stack(np.broadcast_arrays(*at.normal), axis=1)
    return np.where(np.isfinite(out), out, 0.0)
