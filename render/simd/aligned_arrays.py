"""Arrays whose memory begins where vectors want it."""

from __future__ import annotations

import math
import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

CACHE_LINE = 64
_LARGE = 1 << 22  # bytes from which on numpy asks for huge pages


def aligned_empty(shape: int | tuple[int, ...], dtype: Any, alignment: int = CACHE_LINE) -> NDArray[Any]:
    """An array like np.empty whose data start at a multiple of `alignment` bytes, as `load_aligned` wants."""
    whole = (shape,) if isinstance(shape, int) else shape
    size = math.prod(whole) * np.dtype(dtype).itemsize
    block = np.empty(size + alignment, np.uint8)
    start = -block.ctypes.data % alignment
    return block[start : start + size].view(dtype).reshape(whole)


def paged_empty(shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
    """The same, never in huge pages.

    numpy asks for these for all that is large, and a system whose memory is in use may take longer to make one than to fill it.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    if size < _LARGE or not hasattr(mmap, "MAP_PRIVATE"):
        return aligned_empty(shape, dtype)
    block = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return np.frombuffer(block, np.uint8).view(dtype).reshape(shape)
