"""Sample numbers: Owen-scrambled Sobol pairs, a function of (pixel, sample, dimension, seed) alone, and pixel filters.

Burley 2020, Practical Hash-based Owen Scrambling (JCGT 9, 4): each dimension pair takes the first two Sobol dimensions with the
sample index shuffled and the points scrambled by hashes, so that pairs are well spread by themselves and independent of each
other. All arithmetic is uint32, which wraps alike in numpy and in kernels.

Where the number of samples is known beforehand the pixels of a block share one sequence, of which each takes a stretch, in the order of a
Z-curve: what is missing in one pixel is in its neighbours, and errors are blue noise (Ahmed & Wonka 2020, Screen-Space Blue-Noise
Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels). The shuffling of indices, which keeps halves of halves
together, takes the place of their permutations of quadrants.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import HELPER, helper
from ..lanes import ops
from ..types import Lane, Shutter

TABLE = 4096  # entries of a filter's inverse distribution
BLOCK_BITS = 6  # blocks of 64 x 64 pixels share a sequence
SHARED_UP_TO = 18  # log2 of samples a pixel up to which a block's indices fit an int32
SUBPIXEL = 256.0  # sample positions of what it can draw are multiples of 1/256 pixel, where the rasterizer's arithmetic is exact
FILTER_RADIUS = {"box": 0.5, "tent": 1.0, "gaussian": 1.5, "blackman-harris": 1.65}
FILTERS = tuple(FILTER_RADIUS)

ALONE = -1  # `order` of pixels whose number of samples is not known beforehand
_MOMENT = 1  # the dimension of a sample's time
_LENS = 0x10000FFF  # that of where on the lens a ray begins: far from those of surfaces
_TO_UNIT = 1.0 / 4294967296.0
_TO_UNIT24 = 1.0 / 16777216.0  # float32 has no room for more


def _u32(x: Lane) -> Lane:
    """As uint32, higher bits dropped."""
    return np.asarray(x).astype(np.uint32)


@overload(_u32, jit_options=HELPER)
def _u32_in_kernels(x):
    return lambda x: simd.to_u32(x)


def _times(x: Lane, y: Lane) -> Lane:
    """The product modulo 2³²."""
    return _u32(np.multiply(x, y, dtype=np.uint64))


@overload(_times, jit_options=HELPER)
def _times_in_kernels(x, y):
    return lambda x, y: simd.to_u32(x * y)


def _plus(x: Lane, y: Lane) -> Lane:
    """The sum modulo 2³²."""
    return _u32(np.add(x, y, dtype=np.uint64))


@overload(_plus, jit_options=HELPER)
def _plus_in_kernels(x, y):
    return lambda x, y: simd.to_u32(x + y)


def _share(x: Lane, like: Lane) -> Lane:
    """uint32 as a number in [0, 1), as wide as `like`."""
    return x * _TO_UNIT


@overload(_share, jit_options=HELPER)
def _share_in_kernels(x, like):
    if isinstance(like, simd.Vector) and like.bits == 32:
        return lambda x, like: simd.to_f32(simd.to_i32(x >> np.uint32(8))) * _TO_UNIT24
    return lambda x, like: simd.to_f64(x) * _TO_UNIT


@helper
def _hash(x: Lane) -> Lane:
    """A 32-bit integer hash (Wellons' lowbias32)."""
    x = _times(x ^ (x >> np.uint32(16)), np.uint32(0x7FEB352D))
    x = _times(x ^ (x >> np.uint32(15)), np.uint32(0x846CA68B))
    return x ^ (x >> np.uint32(16))


@helper
def _combine(seed: Lane, value: Lane) -> Lane:
    return _hash(seed ^ _plus(_times(value, np.uint32(0x9E3779B9)), np.uint32(0x85EBCA6B)))


@helper
def _reverse_bits(x: Lane) -> Lane:
    x = ((x >> np.uint32(1)) & np.uint32(0x55555555)) | _u32((x & np.uint32(0x55555555)) << np.uint32(1))
    x = ((x >> np.uint32(2)) & np.uint32(0x33333333)) | _u32((x & np.uint32(0x33333333)) << np.uint32(2))
    x = ((x >> np.uint32(4)) & np.uint32(0x0F0F0F0F)) | _u32((x & np.uint32(0x0F0F0F0F)) << np.uint32(4))
    x = ((x >> np.uint32(8)) & np.uint32(0x00FF00FF)) | _u32((x & np.uint32(0x00FF00FF)) << np.uint32(8))
    return (x >> np.uint32(16)) | _u32(x << np.uint32(16))


@helper
def _permute(x: Lane, seed: Lane) -> Lane:
    """The Laine-Karras permutation with Burley's constants: a nested scramble of bits in reversed order."""
    x = x ^ _times(x, np.uint32(0x3D20ADEA))
    x = _plus(x, seed)
    x = _times(x, (seed >> np.uint32(16)) | np.uint32(1))
    x = x ^ _times(x, np.uint32(0x05526C56))
    return x ^ _times(x, np.uint32(0x53A22864))


@helper
def _sobol_second(index: Lane) -> Lane:
    """The second Sobol dimension as 32 bits: the index' bits by Pascal's triangle modulo 2, five steps for five bits of place."""
    x = index
    x = x ^ ((x & np.uint32(0xAAAAAAAA)) >> np.uint32(1))
    x = x ^ ((x & np.uint32(0xCCCCCCCC)) >> np.uint32(2))
    x = x ^ ((x & np.uint32(0xF0F0F0F0)) >> np.uint32(4))
    x = x ^ ((x & np.uint32(0xFF00FF00)) >> np.uint32(8))
    x = x ^ ((x & np.uint32(0xFFFF0000)) >> np.uint32(16))
    return _reverse_bits(x)


@helper
def pair(pixel: Lane, sample: Lane, dimension: Lane, seed: int) -> tuple[Lane, Lane]:
    """Two numbers in [0, 1) for a pixel and sample as `place` gives them, dimension pair and seed."""
    high = _hash(_u32(seed >> 32) ^ np.uint32(0x3C6EF372))
    key = _combine(_combine(_hash(_u32(seed) ^ high), _u32(pixel)), _u32(dimension))
    index = _reverse_bits(_permute(_reverse_bits(_u32(sample)), key))
    first = _permute(index, _combine(key, np.uint32(1)))  # the first dimension is the index reversed, scrambled reversed again
    second = _permute(_reverse_bits(_sobol_second(index)), _combine(key, np.uint32(2)))
    return _share(_reverse_bits(first), pixel), _share(_reverse_bits(second), pixel)


@helper
def hashed_pair(pixel: Lane, sample: Lane, dimension: Lane, seed: int) -> tuple[Lane, Lane]:
    """The same without any order among samples: for the far ends of paths, where good spread is lost anyway."""
    high = _hash(_u32(seed >> 32) ^ np.uint32(0x3C6EF372))
    key = _combine(_combine(_combine(_hash(_u32(seed) ^ high), _u32(pixel)), _u32(sample)), _u32(dimension))
    return _share(key, pixel), _share(_hash(_plus(key, np.uint32(0x9E3779B9))), pixel)


def order_of(samples: int) -> int:
    """What `place` takes where each pixel is given so many samples: log2 of the stretch of a sequence that is a pixel's own."""
    order = max(samples - 1, 0).bit_length()
    return order if order <= SHARED_UP_TO else ALONE


@helper
def zorder_index(x: Lane, y: Lane, sample: Lane, width: int, order: int) -> tuple[Lane, Lane]:
    """(pixel, sample) as the functions here take them, of a sample of the pixel x, y; ints, as their arguments.

    ALONE: each pixel of a picture of this width has a sequence of its own, without end. Else blocks of pixels share one.
    """
    if order < 0:
        return y * width + x, sample
    low = (1 << BLOCK_BITS) - 1
    block = (y >> BLOCK_BITS) * ((width + low) >> BLOCK_BITS) + (x >> BLOCK_BITS)
    return block, ((_apart(x & low) | (_apart(y & low) << 1)) << order) | sample


@helper
def _apart(x: Lane) -> Lane:
    """The lowest eight bits of an int with a zero between each two."""
    x = (x | (x << 4)) & 0x0F0F
    x = (x | (x << 2)) & 0x3333
    return (x | (x << 1)) & 0x5555


@helper
def offset(pixel: Lane, sample: Lane, total: int, seed: int, table: NDArray[np.float64]) -> tuple[Lane, Lane]:
    """Where in (or near) its pixel a sample lies, from the pixel's centre: spread as the filter weighs.

    One sample in all is the centre. `table` is from `filter_table`.
    """
    if total <= 1:
        zero = 0.0 * ops.to_float(pixel)
        return zero, zero
    u, v = pair(pixel, sample, 0, seed)
    return table[ops.to_int(u * TABLE)], table[ops.to_int(v * TABLE)]


def sample_time(pixel: Lane, sample: Lane, seed: int, shutter: Any) -> Lane | None:
    """When a sample is taken, as Ray.time; None where nothing moves while the shutter is open."""
    return shutter.start + pair(pixel, sample, _MOMENT, seed)[0] * shutter.share if isinstance(shutter, Shutter) else None


@overload(sample_time, jit_options=HELPER)
def _moment_in_kernels(pixel, sample, seed, shutter):
    if shutter.layout:
        return lambda pixel, sample, seed, shutter: shutter.start + pair(pixel, sample, _MOMENT, seed)[0] * shutter.share
    return lambda pixel, sample, seed, shutter: None


@helper
def sample_lens(pixel: Lane, sample: Lane, seed: int) -> tuple[Lane, Lane]:
    """Where on a lens of radius 1 a sample's ray begins: evenly over the disk (Shirley & Chiu 1997, which keeps what is near together)."""
    u, v = pair(pixel, sample, _LENS, seed)
    a, b = 2.0 * u - 1.0, 2.0 * v - 1.0
    flat = ops.absolute(a) > ops.absolute(b)
    radius, other = ops.where(flat, a, b), ops.where(flat, b, a)
    ratio = 0.25 * math.pi * other / ops.where(radius == 0.0, 1.0, radius)
    near, far = radius * ops.cos(ratio), radius * ops.sin(ratio)
    return ops.where(flat, near, far), ops.where(flat, far, near)


def filter_weight(name: str, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much what lies x pixels from a pixel's centre counts for it, up to a factor; a filter is the product of x's and y's."""
    radius = FILTER_RADIUS[name]
    if name == "box":
        weight = np.ones_like(x)
    elif name == "tent":
        weight = 1.0 - np.abs(x)
    elif name == "gaussian":
        weight = np.exp(-2.0 * x * x) - math.exp(-2.0 * radius * radius)
    else:
        t = (x + radius) / (2.0 * radius) * 2.0 * np.pi
        weight = 0.35875 - 0.48829 * np.cos(t) + 0.14128 * np.cos(2 * t) - 0.01168 * np.cos(3 * t)
    return np.where(np.abs(x) <= radius, weight, 0.0)


@lru_cache(maxsize=16)
def filter_table(name: str, on_grid: bool = True) -> NDArray[np.float64]:
    """(TABLE,) places at even steps of a pixel filter's cumulative distribution, in pixels from the centre.

    On the grid of SUBPIXEL, where the rasterizer has the same; there edges lie up to 1/512 of a pixel off, however many samples there are.
    box: half a pixel each way; tent: one pixel; gaussian: σ = 0.5 cut at 1.5 pixels; blackman-harris: 1.65 pixels (Harris 1978).
    """
    radius = FILTER_RADIUS[name]
    x = np.linspace(-radius, radius, 16385)
    weight = filter_weight(name, x)
    total = np.concatenate([[0.0], np.cumsum((weight[1:] + weight[:-1]) / 2)])
    places = np.interp((np.arange(TABLE) + 0.5) / TABLE, total / total[-1], x)
    made = np.floor(places * SUBPIXEL + 0.5) / SUBPIXEL if on_grid else places
    made.flags.writeable = False  # all pictures share it
    return made
