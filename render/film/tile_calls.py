"""Tiles that Python draws one by one: renderers without a kernel, slow pictures with a budget, and the workers of a cluster."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...lang.schema.picture_channels import SEEN
from ..image import cryptomatte
from ..image.cryptomatte import Mattes
from ..types import Film, Tile
from .deadline import Pace
from .remote import Remote
from .tile_queue import CALL

TILE = 32  # pixels

Counts = NDArray[np.int64]


def tiles(crop: tuple[int, int, int, int], side: int = TILE) -> list[Tile]:
    """Return the tiles of a crop, those of the picture's grid, from the center outwards."""
    x0, y0, x1, y1 = crop
    columns, rows = (np.arange(start // side * side, end, side) for start, end in ((x0, x1), (y0, y1)))
    y, x = (each.reshape(-1) for each in np.meshgrid(rows, columns, indexing="ij"))
    corners = np.stack([np.maximum(x, x0), np.maximum(y, y0), np.minimum(x + side, x1), np.minimum(y + side, y1)], axis=1)
    away = (corners[:, 0] + corners[:, 2] - x0 - x1) ** 2 + (corners[:, 1] + corners[:, 3] - y0 - y1) ** 2
    return [Tile(*corner) for corner in corners[np.argsort(away, kind="stable")].tolist()]


def draw_auxiliary(renderer: Any, tile: Tile, out: dict[str, NDArray[np.float32]], samples: int, mattes: Mattes | None) -> None:
    """Write the auxiliary channels of a tile."""
    if isinstance(renderer, Remote):
        renderer.auxiliary(tile, out, samples)
        return
    names = tuple(name for name in out if name in SEEN)
    if names:
        renderer.channels(tile, names, {name: out[name] for name in names})
    if mattes is not None:
        count = min(samples, cryptomatte.SAMPLES)
        instances = [first.hit.instance for first in renderer.first(tile, range(count), samples)]
        seen = np.concatenate(instances).reshape(count, -1)
        mattes.put(seen, {name: out[name] for name in mattes.channels})


def draw_batch(
    renderer: Any, tile: Tile, first: Counts, count: Counts, total: int, film: Film, stopped: Callable[[], bool],
    pace: Pace | None = None, clock: Callable[[], float] = time.perf_counter,
) -> int:  # fmt: skip
    """Add samples first … first + count - 1 of every pixel of a tile to its film, until `stopped`.

    With a `pace`, a call takes no longer than the pace expects of deadline.CALL seconds, and adds to it.
    Returns the number up to which each pixel's samples were drawn: at least the greatest count, unless it was stopped.
    """
    start, most = 0, int(count.max(initial=0))
    while start < most and not stopped():
        active = int(np.count_nonzero(count > start))
        call = CALL * max(1, count.size // active)
        if pace is None:
            renderer.sample(tile, first + start, np.clip(count - start, 0, call), total, film)
        else:
            call = min(call, max(pace.samples() // active, 1))
            some, began = np.clip(count - start, 0, call), clock()
            renderer.sample(tile, first + start, some, total, film)
            pace.add(int(some.sum()), clock() - began)
        start += call
    return start


def blank_film(tile: Tile) -> Film:
    """Return the film of a tile, without samples."""
    shape = (tile.y1 - tile.y0, tile.x1 - tile.x0)
    return Film(np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, np.int64))
