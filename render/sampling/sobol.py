"""Owen-scrambled Sobol sampler, and importance sampling of pixel filters.

Burley 2020, Practical Hash-based Owen Scrambling (JCGT 9, 4): each dimension pair uses the first two Sobol dimensions, with a hashed
shuffle of the sample index and hashed scrambles of the points. So pairs are stratified, and independent of each other. Numbers are a
function of (pixel, sample, dimension, seed) alone. All arithmetic is uint32, which wraps alike in numpy and in kernels.

If the number of samples is known, the pixels of a block share one sequence along a Z-curve, a range each (pbrt ZSobolSampler). Errors are
then blue noise (Ahmed & Wonka 2020, Screen-Space Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels).
The index shuffle, which is nested, replaces their permutations of quadrants.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper
from ..lanes import ops
from ..simd.registration import overload
from ..types import Lane, Shutter

TABLE = 4096  # entries of a filter's inverse distribution
BLOCK_BITS = 6  # blocks of 64 x 64 pixels share a sequence
SHARED_UP_TO = 18  # log2 of samples a pixel up to which a block's indices fit an int32
SUBPIXEL = 256.0  # sample positions are multiples of 1/256 pixel, the rasterizer's exact grid
FILTER_RADIUS = {"box": 0.5, "tent": 1.0, "gaussian": 1.5, "blackman-harris": 1.65}
FILTERS = tuple(FILTER_RADIUS)

ALONE = -1  # `order` of pixels with a sequence each
_TIME = 1  # dimension of a sample's time
_LENS = 0x10000FFF  # dimension of the lens position, beyond those of surfaces
_TO_UNIT = 1.0 / 4294967296.0
_TO_UNIT24 = 1.0 / 16777216.0  # of 24 bits, the precision of float32


def _u32(x: Lane) -> Lane:
    """Convert to uint32 modulo 2³²."""
    return np.asarray(x).astype(np.uint32)


@overload(_u32)
def _u32_in_kernels(x):
    return lambda x: simd.to_u32(x)


def _multiply(x: Lane, y: Lane) -> Lane:
    """The product modulo 2³²."""
    return _u32(np.multiply(x, y, dtype=np.uint64))


@overload(_multiply)
def _multiply_in_kernels(x, y):
    return lambda x, y: simd.to_u32(x * y)


def _add(x: Lane, y: Lane) -> Lane:
    """The sum modulo 2³²."""
    return _u32(np.add(x, y, dtype=np.uint64))


@overload(_add)
def _add_in_kernels(x, y):
    return lambda x, y: simd.to_u32(x + y)


def _to_unit_interval(x: Lane, like: Lane) -> Lane:
    """Convert uint32 to [0, 1), in the type of `like`."""
    return x * _TO_UNIT


@overload(_to_unit_interval)
def _to_unit_interval_in_kernels(x, like):
    if isinstance(like, simd.Vector) and like.bits == 32:
        return lambda x, like: simd.to_f32(simd.to_i32(x >> np.uint32(8))) * _TO_UNIT24
    return lambda x, like: simd.to_f64(x) * _TO_UNIT


@helper
def _hash(x: Lane) -> Lane:
    """A 32-bit integer hash (Wellons' lowbias32)."""
    x = _multiply(x ^ (x >> np.uint32(16)), np.uint32(0x7FEB352D))
    x = _multiply(x ^ (x >> np.uint32(15)), np.uint32(0x846CA68B))
    return x ^ (x >> np.uint32(16))


@helper
def _combine(seed: Lane, value: Lane) -> Lane:
    return _hash(seed ^ _add(_multiply(value, np.uint32(0x9E3779B9)), np.uint32(0x85EBCA6B)))


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
    x = x ^ _multiply(x, np.uint32(0x3D20ADEA))
    x = _add(x, seed)
    x = _multiply(x, (seed >> np.uint32(16)) | np.uint32(1))
    x = x ^ _multiply(x, np.uint32(0x05526C56))
    return x ^ _multiply(x, np.uint32(0x53A22864))


@helper
def sobol_second(index: Lane) -> Lane:
    """The second Sobol dimension as 32 bits: the index's bits by Pascal's triangle modulo 2, in five steps."""
    x = index
    x = x ^ ((x & np.uint32(0xAAAAAAAA)) >> np.uint32(1))
    x = x ^ ((x & np.uint32(0xCCCCCCCC)) >> np.uint32(2))
    x = x ^ ((x & np.uint32(0xF0F0F0F0)) >> np.uint32(4))
    x = x ^ ((x & np.uint32(0xFF00FF00)) >> np.uint32(8))
    x = x ^ ((x & np.uint32(0xFFFF0000)) >> np.uint32(16))
    return _reverse_bits(x)


@helper
def pair(pixel: Lane, sample: Lane, dimension: Lane, seed: int) -> tuple[Lane, Lane]:
    """Return two numbers in [0, 1) for a pixel and sample of `zorder_index`, dimension pair and seed."""
    high = _hash(_u32(seed >> 32) ^ np.uint32(0x3C6EF372))
    key = _combine(_combine(_hash(_u32(seed) ^ high), _u32(pixel)), _u32(dimension))
    index = _reverse_bits(_permute(_reverse_bits(_u32(sample)), key))
    first = _permute(index, _combine(key, np.uint32(1)))  # the first dimension is the index reversed, scrambled reversed again
    second = _permute(_reverse_bits(sobol_second(index)), _combine(key, np.uint32(2)))
    return _to_unit_interval(_reverse_bits(first), pixel), _to_unit_interval(_reverse_bits(second), pixel)


@helper
def hashed_pair(pixel: Lane, sample: Lane, dimension: Lane, seed: int) -> tuple[Lane, Lane]:
    """Return two independent hashed numbers: for deep path vertices, where stratification gains nothing."""
    high = _hash(_u32(seed >> 32) ^ np.uint32(0x3C6EF372))
    key = _combine(_combine(_combine(_hash(_u32(seed) ^ high), _u32(pixel)), _u32(sample)), _u32(dimension))
    return _to_unit_interval(key, pixel), _to_unit_interval(_hash(_add(key, np.uint32(0x9E3779B9))), pixel)


def order_of(samples: int) -> int:
    """Return the `order` of `zorder_index` for so many samples a pixel: log2 of a pixel's range of the sequence."""
    order = max(samples - 1, 0).bit_length()
    return order if order <= SHARED_UP_TO else ALONE


@helper
def zorder_index(x: Lane, y: Lane, sample: Lane, width: int, order: int) -> tuple[Lane, Lane]:
    """(pixel, sample) of this module's other functions, for a sample of the pixel x, y.

    With the order ALONE each pixel of a picture of this width has its own infinite sequence; else blocks of pixels share one.
    """
    if order < 0:
        return y * width + x, sample
    low = (1 << BLOCK_BITS) - 1
    block = (y >> BLOCK_BITS) * ((width + low) >> BLOCK_BITS) + (x >> BLOCK_BITS)
    return block, ((_interleave(x & low) | (_interleave(y & low) << 1)) << order) | sample


@helper
def _interleave(x: Lane) -> Lane:
    """Interleave the lowest eight bits with zeros (Morton code)."""
    x = (x | (x << 4)) & 0x0F0F
    x = (x | (x << 2)) & 0x3333
    return (x | (x << 1)) & 0x5555


@helper
def offset(pixel: Lane, sample: Lane, total: int, seed: int, table: NDArray[np.float64]) -> tuple[Lane, Lane]:
    """Sample the pixel filter; return the offset from the pixel's center, in pixels.

    A single sample lies at the center. `table` is from `filter_table`.
    """
    if total <= 1:
        zero = 0.0 * ops.to_float(pixel)
        return zero, zero
    u, v = pair(pixel, sample, 0, seed)
    return table[ops.to_int(u * TABLE)], table[ops.to_int(v * TABLE)]


def sample_time(pixel: Lane, sample: Lane, seed: int, shutter: Any) -> Lane | None:
    """Return a sample's Ray.time; None in scenes without motion."""
    return shutter.start + pair(pixel, sample, _TIME, seed)[0] * shutter.share if isinstance(shutter, Shutter) else None


@overload(sample_time)
def _sample_time_in_kernels(pixel, sample, seed, shutter):
    if shutter.layout:
        return lambda pixel, sample, seed, shutter: shutter.start + pair(pixel, sample, _TIME, seed)[0] * shutter.share
    return lambda pixel, sample, seed, shutter: None


@helper
def sample_lens(pixel: Lane, sample: Lane, seed: int) -> tuple[Lane, Lane]:
    """Sample a lens of radius 1 uniformly by the concentric map (Shirley & Chiu 1997)."""
    u, v = pair(pixel, sample, _LENS, seed)
    a, b = 2.0 * u - 1.0, 2.0 * v - 1.0
    flat = ops.absolute(a) > ops.absolute(b)
    radius, other = ops.where(flat, a, b), ops.where(flat, b, a)
    ratio = 0.25 * math.pi * other / ops.where(radius == 0.0, 1.0, radius)
    near, far = radius * ops.cos(ratio), radius * ops.sin(ratio)
    return ops.where(flat, near, far), ops.where(flat, far, near)


def filter_weight(name: str, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unnormalized 1D filter weight at x pixels from the center; filters are products over x and y."""
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
    """Return (TABLE,) quantiles of a pixel filter, in pixels from the center.

    With `on_grid` they are multiples of 1/SUBPIXEL as in the rasterizer, and edges are up to 1/512 pixel off for any number of samples.
    box: half a pixel each way; tent: one pixel; gaussian: σ = 0.5 cut at 1.5 pixels; blackman-harris: 1.65 pixels (Harris 1978).
    """
    radius = FILTER_RADIUS[name]
    x = np.linspace(-radius, radius, 16385)
    weight = filter_weight(name, x)
    total = np.concatenate([[0.0], np.cumsum((weight[1:] + weight[:-1]) / 2)])
    places = np.interp((np.arange(TABLE) + 0.5) / TABLE, total / total[-1], x)
    quantiles = np.floor(places * SUBPIXEL + 0.5) / SUBPIXEL if on_grid else places
    quantiles.flags.writeable = False  # shared by all pictures
    return quantiles
