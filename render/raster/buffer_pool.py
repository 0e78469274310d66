"""Pool of buffers and pictures that later pictures of a scene reuse."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..simd import aligned_empty

PICTURE_BYTES = 1 << 26  # the largest picture to reuse: beyond, filling memory takes as long as allocating it
UNUSED = 2  # references to an array that only its owner and the test itself hold


class BufferPool:
    """Free buffers by key, and the last pictures. Each method is atomic under Python's lock."""

    def __init__(self) -> None:
        self._free: dict[Any, list[Any]] = {}
        self._pictures: list[NDArray[np.float32]] = []  # the last ones; callers may still hold them

    def take(self, key: Any) -> Any:
        """Remove and return a free buffer; None if there is none."""
        try:
            return self._free[key].pop()
        except (KeyError, IndexError):
            return None

    def give(self, key: Any, buffer: Any) -> None:
        """Add a free buffer."""
        self._free.setdefault(key, []).append(buffer)

    def picture(self, shape: tuple[int, int, int]) -> NDArray[np.float32]:
        """An uninitialized picture: an earlier one that nobody references, or a new one."""
        for made in self._pictures:
            if made.shape == shape and sys.getrefcount(made.base) <= UNUSED:
                return made[:]
        made = aligned_empty(shape, np.float32)
        if made.nbytes <= PICTURE_BYTES:
            self._pictures[:] = [*self._pictures[-1:], made]
        return made[:]
