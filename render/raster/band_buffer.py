"""The visibility buffer of a band, and sample patterns.

A band is as wide as the picture; its buffer fits the processor's second-level cache. Bands are independent of each other. The buffer holds
the nearest triangle's key (larger is nearer) and id for each sample, in blocks of 4×4 pixels.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper
from ..jit.packed_struct import Handle
from . import scalar_raster

ROWS = 64  # of pixels in a band, at most; a power of two
TILE = 64  # pixels, side of the tiles of large triangles
QUEUE = 256  # capacity for small triangles
LARGE = 4096  # capacity for large triangles
NO_KEY = np.float32(-np.inf)


class Projection(NamedTuple):
    """The transform and the triangles of a view, for kernels."""

    matrix: NDArray[np.float64]  # (instances, 5, 4) to clip space, see view_geometry.py
    planes: NDArray[np.float64]  # (p, 5) clip planes
    perspective: bool
    near: float  # nearer and farther triangles are clipped
    far: float
    positions: NDArray[np.float64]  # of the Model, for clipped and large triangles
    triangles: NDArray[np.int32]


class Pattern(NamedTuple):
    """Sample positions in a pixel, in 1/256 from its top left corner, and their range."""

    x: NDArray[np.int32]
    y: NDArray[np.int32]
    low_x: int
    high_x: int
    low_y: int
    high_y: int


class Band(NamedTuple):
    """A thread's visibility buffer and its queues of triangles. Pixel (x, y) of the picture is (x - x0, y - y0) here."""

    key: NDArray[np.float32]  # (blocks · samples · 16,)
    ids: NDArray[np.int32]  # visible meshlet << meshlets.SHIFT | triangle; -1: empty
    vertices: NDArray[np.int32]  # (256 · 4,) a meshlet's vertices: x, y in 1/256 pixel, bits of the key, 0
    small_ints: NDArray[np.int32]  # (13 · (QUEUE + 32),) queue of small triangles, see triangle_setup.queue_small
    small_floats: NDArray[np.float32]  # (6 · (QUEUE + 32),)
    offsets: NDArray[np.float32]  # 0, 4, 8 … pixels
    large: NDArray[np.int32]  # (LARGE + 32,) queue of large triangles: ids
    small_mask: NDArray[np.int32]  # bits: the valid triangles of each sixteen in the queue
    tiny: NDArray[np.int32]  # (48,) key bits, places and ids of sixteen samples of tiny triangles
    tile_key: NDArray[np.float32]  # (tiles,) lower bound of the keys in a tile (hierarchical z)
    window: NDArray[np.int64]  # (4,) x0, y0, columns, rows of the buffer: multiples of 4
    clip: NDArray[np.int64]  # (4,) pixels x0 <= x < x1, y0 <= y < y1 to fill
    rows: NDArray[np.int64]  # (2,) rows of the picture y0 <= y < y1 to write
    work: scalar_raster.Workspace


class Filling(NamedTuple):
    """Inputs and buffer of `triangle_setup.draw_band` in one thread: a Handle each."""

    projection: Handle
    pattern: Handle
    meshlets: Handle
    visible: Handle  # VisibleMeshlets
    band: Handle


def band_buffer(columns: int, rows: int, samples: int) -> Band:
    """A buffer of `columns` × `rows` pixels, rounded up to blocks."""
    columns, rows = (columns + 3) & ~3, (rows + 3) & ~3
    size = columns * rows * samples
    tiles = -(-columns // TILE) * -(-rows // TILE)
    work = scalar_raster.Workspace(
        np.empty((3, 5)), np.empty((16, 5)), np.empty((16, 5)), np.empty(16, np.int64), np.empty(16, np.int64),
        np.empty(16, np.int64), np.empty((1, 5)), np.empty((1, 3), np.int64), np.empty((1, 3), np.int64),
    )  # fmt: skip
    return Band(
        simd.aligned_empty(size, np.float32), simd.aligned_empty(size, np.int32), simd.aligned_empty(1024, np.int32),
        np.empty(13 * (QUEUE + 32), np.int32), np.empty(6 * (QUEUE + 32), np.float32), 4.0 * np.arange(32, dtype=np.float32),
        np.empty(LARGE + 32, np.int32), np.empty((QUEUE >> 4) + 2, np.int32), np.empty(48, np.int32), np.empty(tiles, np.float32),
        np.array([0, 0, columns, rows]), np.zeros(4, np.int64), np.zeros(2, np.int64), work,
    )  # fmt: skip


def pattern(samples: int) -> Pattern:
    """The pattern of 1, 4 or up to 16 samples: the pixel's centre; that of Direct3D and OpenGL; a (0, 4, 2)-net (Sobol 1967)."""
    if samples == 1:
        return _pattern_at([128], [128])
    if samples == 4:
        return _pattern_at([96, 224, 32, 160], [224, 160, 96, 32])  # 6, 14, 2, 10 sixteenths; from below 2, 6, 10, 14
    return pattern_from(0, samples)


def pattern_from(first: int, samples: int) -> Pattern:
    """Points first … first + samples - 1 of a sequence of 256; each aligned group of 2ᵐ is a (0, m, 2)-net."""
    k = np.arange(first, first + samples) & 255
    return _pattern_at(_sobol(_IDENTITY, k) ^ 8, _sobol(_PASCAL, k) ^ 8)  # the first sixteen lie at centres of sixteenths


def _pattern_at(x: Any, y: Any) -> Pattern:
    x, y = np.array(x, np.int32), np.array(y, np.int32)
    return Pattern(x, y, int(x.min()), int(x.max()), int(y.min()), int(y.max()))


_IDENTITY = (128, 64, 32, 16, 8, 4, 2, 1)  # direction numbers of Sobol's first two dimensions
_PASCAL = (128, 192, 160, 240, 136, 204, 170, 255)


def _sobol(columns: tuple[int, ...], k: NDArray[np.int64]) -> NDArray[np.int64]:
    """One coordinate of points k, in 1/256."""
    out = np.zeros_like(k)
    for bit, number in enumerate(columns):
        out ^= np.where(k >> bit & 1, number, 0)
    return out


@helper
def in_block(lane):
    """The column and row of a lane's pixel in its 4×4 block. Lanes go column by column: a transpose makes rows of pixels."""
    return lane >> 2, lane & 3


def to_rows(samples: NDArray[Any], rows: int, columns: int) -> NDArray[Any]:
    """A buffer of one sample a pixel as (rows, columns)."""
    return samples.reshape(rows // 4, columns // 4, 4, 4).transpose(0, 3, 1, 2).reshape(rows, columns)
