"""How much light the limit on bounces cuts off: a few places of a picture followed much further, by the kernels that drew it.

What is cut is light on its way, so that it is measured where it would arrive: in blocks of pixels spread over the picture, samples are
drawn with the picture's limit and, by the same random numbers, with the longest one. Their difference is what the limit leaves out,
with the standard error that the blocks tell. Kernels hold nothing of this, and pictures are what they would be without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan.plan import Plan
from ...lang.schema.elements import MAX_BOUNCES
from ..image import metrics
from ..types import Film, Tile

BLOCKS = 64  # places of a picture that are looked at
SIDE = 4  # pixels of a block's side
SHARE = 1 / 512  # of a picture's samples that are drawn once more
MOST = 64  # samples of a pixel
PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # steps that spread points in a square evenly (Roberts 2018)


class Limited(Protocol):
    """A renderer (film.Renderer) whose rays can be followed further."""

    def limit(self, bounces: int) -> None:
        """Follow rays for so many bounces from now on."""
        ...

    def sample(self, tile: Tile, first: Any, count: Any, total: int, film: Film) -> None:
        """As film.Renderer has it."""
        ...


@dataclass(frozen=True, slots=True)
class Cut:
    """What a limit on bounces leaves out, at least."""

    share: float  # of a place's light, in the mean over the picture; light beyond the longest limit is not in it
    error: float  # its standard error
    allowed: float  # share that is nothing to be said of
    enough: int = 0  # bounces that leave out no more than that; 0: not asked, or not even half of the longest limit

    @property
    def matters(self) -> bool:
        """Whether more is left out than is allowed, and that is surely no noise."""
        return self.share - 2.0 * self.error > self.allowed


def measurable(plan: Plan) -> bool:
    """Whether a limit cuts off what can be measured: in a tree where matt surfaces light each other too many rays would go on."""
    branching = plan["transport"] == "whitted" and plan["interreflection"]
    return plan["backend"] == "ray" and 0 < plan["bounces"] < MAX_BOUNCES and not branching


def measured(renderer: Limited, plan: Plan, samples: int, allowed: float) -> Cut:
    """What the plan's limit leaves out of a picture for which so many samples were drawn; more than `allowed` is said with a remedy."""
    each = int(np.clip(SHARE * samples / (BLOCKS * SIDE * SIDE), 1, MOST))
    places = blocks(plan["crop"])

    def light(bounces: int) -> NDArray[np.float64]:
        renderer.limit(bounces)
        return _light(renderer, places, each)

    try:
        whole, limit = light(MAX_BOUNCES), int(plan["bounces"])
        cut = Cut(*_share(whole, light(limit)), allowed)
        while cut.matters and (limit := 2 * limit) < MAX_BOUNCES:
            if _share(whole, light(limit))[0] <= allowed:
                return replace(cut, enough=limit)
        return cut
    finally:
        renderer.limit(int(plan["bounces"]))


def joined(cuts: Sequence[Cut | None], pixels: NDArray[np.float64]) -> Cut | None:
    """What the limit leaves out of a picture in parts of so many pixels."""
    known = [cut for cut in cuts if cut is not None]
    if not known or len(known) < len(cuts):
        return None
    parts = pixels / pixels.sum()
    share, error = (np.array([getattr(cut, name) for cut in known]) * parts for name in ("share", "error"))
    return Cut(float(share.sum()), float(np.linalg.norm(error)), max(cut.allowed for cut in known), max(cut.enough for cut in known))


def blocks(crop: tuple[int, int, int, int]) -> list[Tile]:
    """Blocks of a crop that are spread over it evenly, whatever repeats in it; they are cut off at its edges, and may overlap."""
    x0, y0, x1, y1 = crop
    at = (0.5 + np.outer(np.arange(BLOCKS), PLASTIC)) % 1.0
    corner = (np.array([x0, y0]) + at * (np.array([x1 - x0, y1 - y0]) - SIDE).clip(0)).astype(int)
    return [Tile(x, y, min(x + SIDE, x1), min(y + SIDE, y1)) for x, y in corner.tolist()]


def _light(renderer: Limited, places: list[Tile], each: int) -> NDArray[np.float64]:
    """(blocks,) the mean light of each block. All on this thread: there is too little of it to share out."""
    found = np.zeros(len(places))
    for k, tile in enumerate(places):
        shape = tile.y1 - tile.y0, tile.x1 - tile.x0
        sums = Film(np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, np.int64))
        renderer.sample(tile, np.zeros(shape, np.int64), np.full(shape, each), each, sums)
        found[k] = sums.color.mean() / each
    return found


def _share(whole: NDArray[np.float64], kept: NDArray[np.float64]) -> tuple[float, float]:
    """(what share of `whole` is not in `kept`, in the mean of the blocks, its standard error); in the dark as √relMSE counts it."""
    least = metrics.EPSILON * float(whole.mean())
    if not least > 0.0:
        return 0.0, 0.0
    lost = (whole - kept) / np.hypot(whole, least)
    return float(lost.mean()), float(lost.std(ddof=1) / np.sqrt(len(lost)))
