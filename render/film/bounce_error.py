"""Estimate of the light lost to the bounce limit (truncation bias).

Blocks of pixels spread over the picture are rendered with the picture's limit and, with the same random numbers, with the greatest limit.
The mean difference is the loss; its standard error is that of the blocks. Pictures are unaffected, and no other kernels are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan.plan import Plan
from ...lang.schema.picture_settings import MAX_BOUNCES
from ..image import metrics
from ..jit import thread_pool
from ..types import Film, Tile
from .remote import Remote

BLOCKS = 64  # of a picture
CELLS = 16  # of a picture whose pixels share paths, instead of blocks
SIDE = 4  # pixels of a block's side
SHARE = 1 / 512  # of a picture's samples, spent on the estimate
MOST = 64  # samples of a pixel
PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # steps of a low-discrepancy sequence in a square (Roberts 2018)


class Limited(Protocol):
    """A film.Renderer with an adjustable bounce limit."""

    cell: int

    def limit(self, bounces: int) -> None:
        """Set the bounce limit."""
        ...

    def sample(self, tile: Tile, first: Any, count: Any, total: int, film: Film) -> None:
        """As film.Renderer.sample."""
        ...


@dataclass(frozen=True, slots=True)
class Cut:
    """A lower bound of the light that a bounce limit loses."""

    share: float  # of a block's light, mean over the picture; light beyond the greatest limit excluded
    error: float  # its standard error
    allowed: float  # share below which there is no warning
    enough: int = 0  # bounces that lose no more than that; 0: unknown, or more than half of the greatest limit

    @property
    def matters(self) -> bool:
        """Whether the loss exceeds `allowed` by two standard errors."""
        return self.share - 2.0 * self.error > self.allowed


def measurable(plan: Plan) -> bool:
    """Whether the loss can be estimated: not in branching trees of diffuse interreflection, which have too many rays."""
    branching = plan["transport"] == "whitted" and plan["interreflection"]
    return plan["backend"] == "ray" and 0 < plan["bounces"] < MAX_BOUNCES and not branching


def measure(renderer: Limited, plan: Plan, samples: int, allowed: float) -> Cut:
    """Estimate the loss of a plan's bounce limit, and the bounces that lose at most `allowed`; `samples` counts those of the picture."""
    places, each = _work(plan, renderer.cell, samples)
    threads = renderer.threads if isinstance(renderer, Remote) else 1

    def light(bounces: int) -> NDArray[np.float64]:
        renderer.limit(bounces)
        return _light(renderer, places, each, threads)

    try:
        unlimited, limit = light(MAX_BOUNCES), int(plan["bounces"])
        cut = Cut(*_share(unlimited, light(limit)), allowed)
        while cut.matters and (limit := 2 * limit) < MAX_BOUNCES:
            if _share(unlimited, light(limit))[0] <= allowed:
                return replace(cut, enough=limit)
        return cut
    finally:
        renderer.limit(int(plan["bounces"]))


def cost(plan: Plan, cell: int, samples: int) -> int:
    """The samples that `measure` takes at least, of a picture with `samples`, in one thread; `cell` is that of the renderer."""
    places, each = _work(plan, cell, samples)
    return 2 * each * sum((tile.x1 - tile.x0) * (tile.y1 - tile.y0) for tile in places)


def _work(plan: Plan, cell: int, samples: int) -> tuple[list[Tile], int]:
    """(blocks, samples of each of their pixels)"""
    places = blocks(plan["crop"], cell)
    pixels = sum((tile.x1 - tile.x0) * (tile.y1 - tile.y0) for tile in places)
    return places, int(np.clip(SHARE * samples / pixels, 1, MOST))


def combine(cuts: Sequence[Cut | None], pixels: NDArray[np.float64]) -> Cut | None:
    """Return the loss of a picture from those of its parts of so many pixels."""
    measured = [cut for cut in cuts if cut is not None]
    if not measured or len(measured) < len(cuts):
        return None
    parts = pixels / pixels.sum()
    share, error = (np.array([getattr(cut, name) for cut in measured]) * parts for name in ("share", "error"))
    return Cut(float(share.sum()), float(np.linalg.norm(error)), max(cut.allowed for cut in measured), max(cut.enough for cut in measured))


def blocks(crop: tuple[int, int, int, int], cell: int = 1) -> list[Tile]:
    """Return blocks spread evenly and aperiodically over a crop; they are cropped at its edges, and may overlap.

    Where the pixels of a cell share paths, different cells, of which at least two lie in the crop.
    """
    x0, y0, x1, y1 = crop
    positions = (0.5 + np.outer(np.arange(BLOCKS), PLASTIC)) % 1.0
    if cell > 1:
        corners = np.floor((np.array([x0, y0]) + positions * np.array([x1 - x0, y1 - y0])) / cell).astype(int) * cell
        places = [Tile(max(x, x0), max(y, y0), min(x + cell, x1), min(y + cell, y1)) for x, y in corners.tolist()]
        if len(different := list(dict.fromkeys(places))[:CELLS]) > 1:
            return different
    corner = (np.array([x0, y0]) + positions * (np.array([x1 - x0, y1 - y0]) - SIDE).clip(0)).astype(int)
    return [Tile(x, y, min(x + SIDE, x1), min(y + SIDE, y1)) for x, y in corner.tolist()]


def _light(renderer: Limited, places: list[Tile], each: int, threads: int) -> NDArray[np.float64]:
    """(blocks,) mean light of each block."""
    means = np.zeros(len(places))

    def draw(k: int) -> None:
        tile = places[k]
        shape = tile.y1 - tile.y0, tile.x1 - tile.x0
        sums = Film(np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, np.int64))
        renderer.sample(tile, np.zeros(shape, np.int64), np.full(shape, each), each, sums)
        means[k] = sums.color.mean() / each

    thread_pool.parallel_for(draw, range(len(places)), threads)
    return means


def _share(unlimited: NDArray[np.float64], limited: NDArray[np.float64]) -> tuple[float, float]:
    """(mean share of `unlimited` that `limited` lacks, its standard error) over blocks; dark blocks are weighted as in √relMSE."""
    least = metrics.EPSILON * float(unlimited.mean())
    if not least > 0.0:
        return 0.0, 0.0
    lost = (unlimited - limited) / np.hypot(unlimited, least)
    return float(lost.mean()), float(lost.std(ddof=1) / np.sqrt(len(lost)))
