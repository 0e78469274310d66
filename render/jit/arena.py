"""Reusable temporary memory, allocated once.

The page faults of fresh memory take a sixth of the time of building a BVH.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import simd

MAX_RETAINED = 1 << 28  # bytes
_retained: list[NDArray[np.uint8]] = []


class Scratch:
    """A block of memory for consecutive arrays."""

    def __init__(self, block: NDArray[np.uint8]) -> None:
        self._block, self._used = block, 0

    def empty(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """Allocate an uninitialized array, aligned to a cache line. Raises ValueError where the block is full."""
        first = self._used
        self._used = first + size_of(shape, dtype)
        if self._used > len(self._block):
            raise ValueError("the arena is too small")
        return self._block[first : first + math.prod(shape) * np.dtype(dtype).itemsize].view(dtype).reshape(shape)


def size_of(shape: tuple[int, ...], dtype: Any) -> int:
    """Bytes of a block that an array takes."""
    return -(-math.prod(shape) * np.dtype(dtype).itemsize // simd.CACHE_LINE) * simd.CACHE_LINE


@contextmanager
def arena(size: int) -> Iterator[Scratch]:
    """Lend a block of `size` bytes; its arrays must not outlive the `with` statement."""
    try:
        block = _retained.pop()
    except IndexError:
        block = np.empty(0, np.uint8)
    if len(block) < size:
        block = simd.paged_empty((size,), np.uint8)
    yield Scratch(block)
    if len(block) <= MAX_RETAINED and not _retained:
        _retained.append(block)
