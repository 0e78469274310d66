"""Memory for what is thrown away soon: asked of the system once, and kept for the next time.

To fill memory that the system has just given takes a sixth of the time of building a tree, by as many interruptions as it has pages.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import simd

MOST = 1 << 28  # bytes that are kept
_kept: list[NDArray[np.uint8]] = []


class Scratch:
    """A block of memory from which arrays are taken, one behind the other."""

    def __init__(self, block: NDArray[np.uint8]) -> None:
        self._block, self._used = block, 0

    def empty(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """An array that is not filled, at the beginning of a cache line."""
        first = self._used
        self._used = first + size_of(shape, dtype)
        if self._used > len(self._block):
            raise ValueError("more memory is taken than was asked for")
        return self._block[first : first + math.prod(shape) * np.dtype(dtype).itemsize].view(dtype).reshape(shape)


def size_of(shape: tuple[int, ...], dtype: Any) -> int:
    """How many bytes of a block an array takes."""
    return -(-math.prod(shape) * np.dtype(dtype).itemsize // simd.CACHE_LINE) * simd.CACHE_LINE


@contextmanager
def arena(size: int) -> Iterator[Scratch]:
    """So many bytes, of which nobody may keep an array afterwards."""
    try:
        block = _kept.pop()
    except IndexError:
        block = np.empty(0, np.uint8)
    if len(block) < size:
        block = simd.paged_empty((size,), np.uint8)
    yield Scratch(block)
    if len(block) <= MOST and not _kept:
        _kept.append(block)
