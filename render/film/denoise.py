"""Denoising with Intel's Open Image Denoise, guided by albedo and normals, and the error that is left.

The package pyoidn contains the library; only this module loads it. Alpha is unchanged.

The network blurs over MARGIN pixels. So a panorama gets margins of its own pixels before, as it goes on behind its left and right edges and
over its poles. Pixels without coverage, and dark places wider than DARK pixels, in which no sample found light, stay exactly 0.

The error left is measured by denoising half of the samples by themselves (`error_left`): how much the result changes with the samples, and
how far it is from the other half, whose noise is independent.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan.plan import Plan
from ..image import metrics
from ..image.image import Image
from ..jit import thread_pool
from ..simd import target
from ..types import Tile
from . import film, guide_kernels
from .remote import Remote

Pixels = NDArray[np.float32]

SPREAD = 0.3  # by how much the error left exceeds the change between half and all of the samples, by an e-fold of the noise removed
CERTAIN = 1.1  # factor of the estimated error left
DEVIATIONS = 2.0  # standard deviations by which blur must be seen
MEMORY = 1000  # megabytes of the network: it denoises large pictures in overlapping tiles, with the same result
ROWS = 64  # of the picture, whose errors are summed at once
SAMPLES = 16  # most samples of a pixel for the guides: 4 leave twice the error at texture edges
FEW = 2  # of a preview
SIDE = 64  # pixels of the tiles of guides
BLOCK = 8  # pixels of the blocks whose distances are compared
MARGIN = 96  # pixels over which the network blurs
DARK = 15  # pixels of the side of the least dark square: single samples without light are noise


def denoise(image: Image, renderer: film.Renderer | Remote, plan: Plan, most: int = SAMPLES, measures: bool = True) -> None:
    """Denoise a picture's color in place. Sets metadata "denoised" and "denoised_error", the √relMSE left, None where it is unknown.

    A picture that is denoised by default keeps its noise, and "denoised" is False, where the error left would be larger. The guides have
    at most `most` samples. Without `measures` the error left is unknown, which saves one of two runs of the filter.
    """
    clean = make_filter(*guides(renderer, plan, most), margins_of(plan))
    rgba, half = image.channels["rgba"], image.metadata["half_difference"]
    noisy, dark = rgba[..., :3].copy(), unlit(rgba)
    rgba[..., :3] = clean(noisy)
    rgba[dark, :3] = 0.0
    image.metadata.update(denoised=True, denoised_error=None)
    if measures and half is not None and np.isfinite(half).all():
        remaining_error = error_left(noisy, half, image.metadata["variance_share"], rgba[..., :3], clean)
        image.metadata["denoised_error"] = remaining_error
        if plan["denoise"] == "above_error" and remaining_error >= image.metadata["error"]:
            rgba[..., :3] = noisy
            image.metadata["denoised"] = False


class Margins(NamedTuple):
    """Where a picture goes on: a panorama over its sides, and over the poles at its top and bottom."""

    sides: bool = False
    top: bool = False
    bottom: bool = False

    def around(self, pixels: Pixels) -> tuple[Pixels, tuple[slice, slice]]:
        """(a picture with margins, (h, w, c), the part of it that is the picture)."""
        height, width = pixels.shape[:2]
        rows, columns = min(MARGIN, height), min(MARGIN, width)
        over = np.roll(pixels[::-1], width // 2, axis=1)  # behind a pole, the picture goes down the opposite side
        parts = [over[height - rows :]] * self.top + [pixels] + [over[:rows]] * self.bottom
        padded = np.concatenate(parts, axis=0) if len(parts) > 1 else pixels
        if self.sides:
            padded = np.concatenate([padded[:, width - columns :], padded, padded[:, :columns]], axis=1)
        up, first_column = rows * self.top, columns * self.sides
        return np.ascontiguousarray(padded, np.float32), (slice(up, up + height), slice(first_column, first_column + width))


ALONE = Margins()


def margins_of(plan: Plan) -> Margins:
    """The margins of a plan's picture; a crop of a panorama has those of the edges that it shares with all of it."""
    (width, height), (x0, y0, x1, y1) = plan["size"], plan["crop"]
    if plan["lens"] != "panorama" or x0 > 0 or x1 < width:
        return ALONE
    return Margins(True, y0 == 0, y1 == height)


def unlit(rgba: Pixels) -> NDArray[np.bool_]:
    """(h, w) where a picture (h, w, 4) is surely black: without coverage and light, or in a DARK square without any light."""
    black = ~(rgba[..., :3] != 0.0).any(axis=2)
    core = _window_sums(~black, DARK // 2) == 0
    return uncovered(rgba) | (black & (_window_sums(core, DARK // 2) > 0))


def uncovered(rgba: Pixels) -> NDArray[np.bool_]:
    """(h, w) where a picture (h, w, 4) has neither coverage nor light."""
    return ~(rgba != 0.0).any(axis=2)


def _window_sums(marks: NDArray[np.bool_], reach: int) -> NDArray[np.int64]:
    """(h, w) number of marks in the square up to `reach` pixels from each pixel."""
    counts = marks.astype(np.int64)
    for axis, count in enumerate(marks.shape):
        sums = np.concatenate([np.zeros_like(counts.take([0], axis)), np.cumsum(counts, axis)], axis)
        place = np.arange(count)
        counts = sums.take(np.minimum(place + reach + 1, count), axis) - sums.take(np.maximum(place - reach, 0), axis)
    return counts


def make_filter(albedo: Pixels, normal: Pixels, margins: Margins = ALONE) -> Callable[[Pixels], Pixels]:
    """The filter of pictures with these guides; (h, w, 3) each."""
    import pyoidn  # pyright: ignore[reportMissingImports]

    albedo, normal = margins.around(albedo)[0], margins.around(normal)[0]

    def clean(color: Pixels) -> Pixels:
        color, inner = margins.around(np.asarray(color, np.float32))
        cleaned = np.empty_like(color)
        images = {"color": color, "albedo": albedo, "normal": normal, "output": cleaned}
        with pyoidn.Device() as device:
            device.commit()
            with pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT) as network:
                for name, pixels in images.items():
                    network.set_image(name, pixels, pyoidn.OIDN_FORMAT_FLOAT3)
                network.set_bool("hdr", True)
                network.set_int("maxMemoryMB", MEMORY)
                network.commit()
                network.execute()
            error = device.get_error()
        if error:
            raise RuntimeError(f"Open Image Denoise: {error}")
        return cleaned[inner]

    return clean


def error_left(noisy: Pixels, half: Pixels, share: float, denoised: Pixels, clean: Callable[[Pixels], Pixels]) -> float:
    """The √relMSE of a denoised picture, from the halves `noisy` ± `half` of its samples; (h, w, 3) each, `clean` denoises one.

    The picture's variance is `share` of half², as the halves of Sobol points complement each other; that of a half is (1 + `share`) half².

    The denoised half differs from the whole by a variance v / 2. A filter that changes nothing has 2 `share` half² = v, and leaves half
    of v. What a filter leaves beyond that grows with the logarithm of the noise that it removes: measured, docs/design/sampling.md. The
    blur of the half, which its distance from the other half shows beyond all noise, counts instead where it is more.
    """
    first = clean(np.maximum(noisy + half, 0.0))
    value = np.maximum(denoised, first)
    if not value.any():
        return 0.0  # a black picture has no error
    least = (metrics.EPSILON * float(metrics.luminance(value).mean())) ** 2
    change, noise, beyond = 0.0, 0.0, []
    for part in (slice(k, k + ROWS) for k in range(0, len(noisy), ROWS)):  # float64 of some rows at a time
        weights = np.maximum(np.square(value[part], dtype=np.float64) + least, np.finfo(np.float64).tiny)
        squares = np.square(half[part], dtype=np.float64)
        other = np.square(first[part] - np.maximum(noisy[part] - half[part], 0.0), dtype=np.float64)
        change += float(np.sum(np.square(first[part] - denoised[part], dtype=np.float64) / weights))
        noise += float(np.sum(squares / weights))
        beyond.append(metrics.block_means(((other - (1.0 + share) * squares) / weights).mean(axis=2), BLOCK).ravel())
    spread, removed, blocks = 2.0 * change / noisy.size, share * noise / noisy.size, np.concatenate(beyond)
    blur = float(blocks.mean()) - spread - DEVIATIONS * float(blocks.std()) / math.sqrt(len(blocks))
    by_change = removed if removed <= 0.5 * spread else spread * (0.5 + SPREAD * math.log(2.0 * removed / spread)) if spread > 0.0 else 0.0
    return CERTAIN * math.sqrt(max(by_change, 0.5 * spread + blur, 0.0))


def preview_filter(renderer: film.Renderer | Remote, plan: Plan, cancel: threading.Event) -> Callable[[Pixels], Pixels] | None:
    """A filter of pictures (h, w, 4) that are not finished, with guides of few samples; None if cancelled.

    It returns a new picture, and may be called in another thread.
    """
    features = guides(renderer, plan, FEW, cancel)
    if cancel.is_set():
        return None
    clean = make_filter(*features, margins_of(plan))

    def cleaned(rgba: Pixels) -> Pixels:
        color = clean(rgba[..., :3])
        color[uncovered(rgba)] = 0.0  # of few samples, many without light are noise
        return np.concatenate([color, rgba[..., 3:]], axis=2)

    return cleaned


def guides(
    renderer: film.Renderer | Remote, plan: Plan, most: int = SAMPLES, cancel: threading.Event | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(albedo, normal) of first hits, (h, w, 3) each, averaged over at most so many samples."""
    x0, y0, x1, y1 = plan["crop"]
    features = np.zeros((2, y1 - y0, x1 - x0, 3), np.float32)
    count, surfaces = min(most, int(plan["samples"])), guide_kernels.Surfaces()

    def draw(tile: Tile) -> None:
        window = features[:, tile.y0 - y0 : tile.y1 - y0, tile.x0 - x0 : tile.x1 - x0]
        window[...] = tile_guides(renderer, tile, count, int(plan["samples"]), surfaces)

    threads = renderer.threads if isinstance(renderer, Remote) else int(plan["threads"]) or target.cores()
    thread_pool.parallel_for(draw, film.tiles((x0, y0, x1, y1), SIDE), threads, cancel)
    albedo, normal = features
    return np.clip(albedo, 0.0, 1.0), normal


def tile_guides(
    renderer: film.Renderer | Remote, tile: Tile, count: int, total: int, surfaces: guide_kernels.Surfaces | None = None
) -> NDArray[np.float64]:  # fmt: skip
    """(2, h, w, 3) albedo and normal of a tile, averaged over the first `count` of `total` samples."""
    if isinstance(renderer, Remote):
        return renderer.guides(tile, count, total)
    rows, columns = tile.y1 - tile.y0, tile.x1 - tile.x0
    sums, surfaces = np.zeros((2, rows * columns, 3)), surfaces or guide_kernels.Surfaces()
    for first in renderer.first(tile, range(count), total):
        surfaces.add(first, count, sums)
    return sums.reshape(2, rows, columns, 3)
