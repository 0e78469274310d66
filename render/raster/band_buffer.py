"""The visibility buffer of a band of a picture, and the places of samples in it.

A band is as wide as the picture and so high that its buffer stays in the processor's second cache. Threads take bands; what is in one
depends on no other. The buffer keeps, for each sample, the nearest triangle's key (larger is nearer) and id, in blocks of 4×4 pixels.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper
from ..jit.packed_struct import Handle
from . import scalar_raster

ROWS = 64  # of pixels in a band at the most; a power of two
TILE = 64  # pixels of a tile's side, in which large triangles are filled
QUEUE = 256  # places for small triangles that are set up, sixteen at a time, before they are filled
LARGE = 4096  # large ones
NO_KEY = np.float32(-np.inf)


class Projection(NamedTuple):
    """How a view takes triangles to the picture, for kernels."""

    matrix: NDArray[np.float64]  # (instances, 5, 4), see raster_setup
    planes: NDArray[np.float64]
    perspective: bool
    near: float  # what is nearer or farther than these goes through the clipper
    far: float
    positions: NDArray[np.float64]  # Model's, for what is clipped or large
    triangles: NDArray[np.int32]


class Pattern(NamedTuple):
    """Where samples lie in every pixel, in 1/256 from its top left corner."""

    x: NDArray[np.int32]
    y: NDArray[np.int32]
    low_x: int
    high_x: int
    low_y: int
    high_y: int


class Band(NamedTuple):
    """A thread's buffer, and what waits to be filled into it. Pixel (x, y) of the picture is (x - x0, y - y0) here."""

    key: NDArray[np.float32]  # (blocks · samples · 16,)
    ids: NDArray[np.int32]  # -1: nothing
    vertices: NDArray[np.int32]  # (256 · 4,) a meshlet's vertices: x, y, key's bits, 0
    small_ints: NDArray[np.int32]  # (13 · (QUEUE + 32),) of small triangles that wait, see fill_small
    small_floats: NDArray[np.float32]  # (6 · (QUEUE + 32),)
    offsets: NDArray[np.float32]  # 0, 4, 8 … pixels
    large: NDArray[np.int32]  # (LARGE + 32,) ids
    small_mask: NDArray[np.int32]  # bits: which of each sixteen places have a small triangle
    tiny: NDArray[np.int32]  # (48,) sixteen samples of tiny triangles
    tile_key: NDArray[np.float32]  # (tiles,) keys below which nothing is seen in a tile
    window: NDArray[np.int64]  # (4,) x0, y0, columns, rows: multiples of 4
    clip: NDArray[np.int64]  # (4,) pixels x0 <= x < x1, y0 <= y < y1 whose samples are wanted
    rows: NDArray[np.int64]  # (2,) rows of the picture's pixels y0 <= y < y1 that are drawn here
    work: scalar_raster.Workspace


class Filling(NamedTuple):
    """What fills bands of one picture in one thread: a handle of each."""

    projection: Handle  # Projection
    pattern: Handle
    meshlets: Handle
    visible: Handle
    band: Handle


def band_buffer(columns: int, rows: int, samples: int) -> Band:
    """A buffer of so many pixels, whose numbers are rounded up to blocks."""
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
    """The places of 1, 4 or up to 16 samples: the pixel's centre; those of Direct3D and OpenGL; a (0, 4, 2)-net (Sobol 1967)."""
    if samples == 1:
        return _pattern_at([128], [128])
    if samples == 4:
        return _pattern_at([96, 224, 32, 160], [224, 160, 96, 32])  # 6, 14, 2, 10 and, from below, 2, 6, 10, 14 sixteenths
    return pattern_from(0, samples)


def pattern_from(first: int, samples: int) -> Pattern:
    """Points first … first + samples - 1 of a sequence of 256: each 2ᵐ of them from a multiple of 2ᵐ on are a (0, m, 2)-net."""
    k = np.arange(first, first + samples) & 255
    return _pattern_at(_sobol(_IDENTITY, k) ^ 8, _sobol(_PASCAL, k) ^ 8)  # the first sixteen in the middle of sixteenths


def _pattern_at(x: Any, y: Any) -> Pattern:
    x, y = np.array(x, np.int32), np.array(y, np.int32)
    return Pattern(x, y, int(x.min()), int(x.max()), int(y.min()), int(y.max()))


_IDENTITY = (128, 64, 32, 16, 8, 4, 2, 1)  # direction numbers of Sobol's first two dimensions
_PASCAL = (128, 192, 160, 240, 136, 204, 170, 255)


def _sobol(columns: tuple[int, ...], k: NDArray[np.int64]) -> NDArray[np.int64]:
    """A dimension of points k, in 1/256."""
    out = np.zeros_like(k)
    for bit, number in enumerate(columns):
        out ^= np.where(k >> bit & 1, number, 0)
    return out


@helper
def in_block(lane):
    """Which pixel of its block of 4×4 a lane is: column and line. Blocks go column by column, so that transposing makes rows of pixels."""
    return lane >> 2, lane & 3


def to_rows(samples: NDArray[Any], rows: int, columns: int) -> NDArray[Any]:
    """A band's buffer of one sample a pixel as (rows, columns)."""
    return samples.reshape(rows // 4, columns // 4, 4, 4).transpose(0, 3, 1, 2).reshape(rows, columns)
