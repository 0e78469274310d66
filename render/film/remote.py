"""Remote: base of renderers that draw in other processes; a request takes as long as a message, so they draw whole batches of samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..image.image import Image
from ..types import Film, Tile
from .deadline import Deadline

Counts = NDArray[np.int64]


class Remote:
    """A film.Renderer without `channels` and `first`, which draws whole batches, channels and guides of a tile. Thread-safe.

    Calls wait for their result. `threads` calls keep all processes at work.
    """

    by_tile: bool
    cell: int
    side: int
    threads: int
    single = None
    unproved = 0
    """Number of rays with an interval that could not be proved free of implicit-surface hits."""

    def put(self, image: Image) -> None:
        """Write the channels of light groups, after the samples; see light_groups.Sums."""
        raise NotImplementedError

    def limit_time(self, deadline: Deadline) -> None:
        """Do nothing: workers share no clock."""

    def resize(self, width: int, height: int) -> bool:
        """It cannot."""
        return False

    def batch(self, tile: Tile, first: Counts, count: Counts, total: int, film: Film, deadline: float) -> int:
        """Add samples as tile_calls.draw_batch does. `deadline` is a time of time.perf_counter."""
        raise NotImplementedError

    def auxiliary(self, tile: Tile, out: dict[str, NDArray[np.float32]], samples: int) -> None:
        """Write the channels of a tile, as tile_calls.draw_auxiliary does."""
        raise NotImplementedError

    def guides(self, tile: Tile, count: int, total: int) -> NDArray[Any]:
        """Return the guides of the denoiser, as denoise.tile_guides does."""
        raise NotImplementedError
