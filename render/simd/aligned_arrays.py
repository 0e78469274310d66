"""Allocation of aligned numpy arrays."""

from __future__ import annotations

import math
import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

CACHE_LINE = 64
_LARGE = 1 << 22  # bytes from which numpy requests huge pages


def aligned_empty(shape: int | tuple[int, ...], dtype: Any, alignment: int = CACHE_LINE) -> NDArray[Any]:
    """Allocate an uninitialized array whose data start at a multiple of `alignment` bytes, for `load_aligned`."""
    dimensions = (shape,) if isinstance(shape, int) else shape
    size = math.prod(dimensions) * np.dtype(dtype).itemsize
    block = np.empty(size + alignment, np.uint8)
    start = -block.ctypes.data % alignment
    return block[start : start + size].view(dtype).reshape(dimensions)


def paged_empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """`aligned_empty` without huge pages.

    numpy requests huge pages for large arrays; a system short of free memory may take longer to make one than to fill it.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < _LARGE or not hasattr(mmap, "MAP_PRIVATE"):
        return aligned_empty(shape, dtype)
    block = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return np.frombuffer(block, np.uint8).view(dtype).reshape(shape)
