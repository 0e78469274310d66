"""MaterialX's noise: Perlin's gradient noise and cell noise by Bob Jenkins' hash; one source for numpy and LLVM vectors.

Definition: MaterialX 1.39, libraries/stdlib/genglsl/lib/mx_noise.glsl, after Open Shading Language's oslnoise.h. The backend `m` is a
NumpyMath or VectorMath (compiler/formula/point_semantics.py) that also has `to_bits`, which makes a 32-bit integer of a whole
number, and `from_bits`, the reverse.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..formula import point_semantics
from .opcodes import FIRST, Op

Number = Any  # a numpy array, or an LLVM vector
_SEED = 0xDEADBEEF + 13  # plus four times the number of hashed integers
_SCALE = {2: 0.6616, 3: 0.9820}  # MaterialX's measured factors to the range -1 to 1
_LARGEST = 2.0**31


class NumpyMath(point_semantics.NumpyMath):
    """Numeric backend on float64 arrays."""

    def to_bits(self, x: Number) -> Number:
        """A whole number as 32 bits; 0 beyond the range of an int."""
        return np.where(np.abs(x) < _LARGEST, x, 0.0).astype(np.int64).astype(np.uint32)

    def from_bits(self, x: Number) -> Number:
        return x.astype(np.float64)


def point(m: Any, op: int, a: Number, b: Number = None, c: Number = None) -> Number:
    """The value of an operation of a texture graph, but for look-ups."""
    if op < FIRST:
        return point_semantics.point(m, op, a, b, c)
    if op <= Op.PERLIN3_B:
        operands = (a, b) if op <= Op.PERLIN2_B else (a, b, c)
        return perlin(m, operands, (op - Op.PERLIN2) % 4 - 1)
    cells = [m.to_bits(m.floor(x)) for x in (a, b, c) if x is not None]
    if op in (Op.CELL4_0, Op.CELL4_1, Op.CELL4_2):
        cells.append(0 * cells[0] + (op - Op.CELL4_0))
    return m.from_bits(hashed(cells)) * (1.0 / 4294967295.0)


# --- hash ---------------------------------------------------------------------------------------------------------------


def _rotated(x: Any, k: int) -> Any:
    return (x << k) | (x >> (32 - k))


def hashed(cells: list[Any]) -> Any:
    """32 bits from one to four integers."""
    seed = (_SEED + 4 * len(cells)) & 0xFFFFFFFF
    zero = 0 * cells[0]
    a, b, c = (cells[k] + seed if k < len(cells) else zero + seed for k in range(3))
    if len(cells) == 4:
        a, b, c = _mixed(a, b, c)
        a = a + cells[3]
    c = (c ^ b) - _rotated(b, 14)
    a = (a ^ c) - _rotated(c, 11)
    b = (b ^ a) - _rotated(a, 25)
    c = (c ^ b) - _rotated(b, 16)
    a = (a ^ c) - _rotated(c, 4)
    b = (b ^ a) - _rotated(a, 14)
    return (c ^ b) - _rotated(b, 24)


def _mixed(a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
    a, c = (a - c) ^ _rotated(c, 4), c + b
    b, a = (b - a) ^ _rotated(a, 6), a + c
    c, b = (c - b) ^ _rotated(b, 8), b + a
    a, c = (a - c) ^ _rotated(c, 16), c + b
    b, a = (b - a) ^ _rotated(a, 19), a + c
    c, b = (c - b) ^ _rotated(b, 4), b + a
    return a, b, c


# --- gradient noise -----------------------------------------------------------------------------------------------------


def perlin(m: Any, point: tuple[Number, ...], channel: int) -> Number:
    """Gradient noise in two or three dimensions: of one number (channel -1), or a channel of three."""
    floors = [m.floor(x) for x in point]
    cells = [m.to_bits(x) for x in floors]
    parts = [x - low for x, low in zip(point, floors, strict=True)]
    fades = [t * t * t * (t * (t * 6.0 - 15.0) + 10.0) for t in parts]
    corners: list[Number] = []
    for corner in range(1 << len(point)):
        steps = [corner >> axis & 1 for axis in range(len(point))]
        bits = hashed([cell + step for cell, step in zip(cells, steps, strict=True)])
        if channel >= 0:
            bits = (bits >> (8 * channel)) & 0xFF
        corners.append(_gradient(m, bits, [part - float(step) for part, step in zip(parts, steps, strict=True)]))
    for fade in fades:
        corners = [(1.0 - fade) * low + fade * high for low, high in zip(corners[::2], corners[1::2], strict=True)]
    return corners[0] * _SCALE[len(point)]


def _gradient(m: Any, bits: Any, away: list[Number]) -> Number:
    """The product of a corner's gradient with the vector from it."""
    x, y = away[:2]
    low = (bits & 4) == 0
    if len(away) == 2:
        u, v = m.where(low, x, y), 2.0 * m.where(low, y, x)
    else:
        z, high = away[2], (bits & 8) == 0
        diagonal = ((bits & 15) == 12) | ((bits & 15) == 14)
        u, v = m.where(high, x, y), m.where(low & high, y, m.where(diagonal, x, z))
    return m.where((bits & 1) == 0, u, -u) + m.where((bits & 2) == 0, v, -v)
