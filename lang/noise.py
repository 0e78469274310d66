"""Improved gradient noise (Perlin, SIGGRAPH 2002) in plain Python: the reference definition of `noise`."""

from __future__ import annotations

import math

_WORD = (1 << 64) - 1

# Perlin's permutation of 0..255.
PERMUTATION = (
    151, 160, 137, 91, 90, 15, 131, 13, 201, 95, 96, 53, 194, 233, 7, 225, 140, 36, 103, 30, 69, 142, 8, 99, 37, 240, 21, 10, 23,
    190, 6, 148, 247, 120, 234, 75, 0, 26, 197, 62, 94, 252, 219, 203, 117, 35, 11, 32, 57, 177, 33, 88, 237, 149, 56, 87, 174,
    20, 125, 136, 171, 168, 68, 175, 74, 165, 71, 134, 139, 48, 27, 166, 77, 146, 158, 231, 83, 111, 229, 122, 60, 211, 133, 230,
    220, 105, 92, 41, 55, 46, 245, 40, 244, 102, 143, 54, 65, 25, 63, 161, 1, 216, 80, 73, 209, 76, 132, 187, 208, 89, 18, 169,
    200, 196, 135, 130, 116, 188, 159, 86, 164, 100, 109, 198, 173, 186, 3, 64, 52, 217, 226, 250, 124, 123, 5, 202, 38, 147, 118,
    126, 255, 82, 85, 212, 207, 206, 59, 227, 47, 16, 58, 17, 182, 189, 28, 42, 223, 183, 170, 213, 119, 248, 152, 2, 44, 154,
    163, 70, 221, 153, 101, 155, 167, 43, 172, 9, 129, 22, 39, 253, 19, 98, 108, 110, 79, 113, 224, 232, 178, 185, 112, 104, 218,
    246, 97, 228, 251, 34, 242, 193, 238, 210, 144, 12, 191, 179, 162, 241, 81, 51, 145, 235, 249, 14, 239, 107, 49, 192, 214, 31,
    181, 199, 106, 157, 184, 84, 204, 176, 115, 121, 50, 45, 127, 4, 150, 254, 138, 236, 205, 93, 222, 114, 67, 29, 24, 72, 243,
    141, 128, 195, 78, 66, 215, 61, 156, 180,
)  # fmt: skip


def noise(x: float, y: float = 0.0, z: float = 0.0) -> float:
    """Gradient noise in -1..1, 0 at integer coordinates, of period 256."""
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    xi, yi, zi = fx & 255, fy & 255, fz & 255
    x, y, z = x - fx, y - fy, z - fz
    u, v, w = _fade(x), _fade(y), _fade(z)

    def corner(i: int, j: int, k: int) -> float:
        p = PERMUTATION
        h = p[(p[(p[(xi + i) & 255] + yi + j) & 255] + zi + k) & 255]
        return _gradient(h, x - i, y - j, z - k)

    def row(j: int, k: int) -> float:
        return _mix(u, corner(0, j, k), corner(1, j, k))

    return _mix(w, _mix(v, row(0, 0), row(1, 0)), _mix(v, row(0, 1), row(1, 1)))


def _fade(t: float) -> float:
    return t * t * t * (t * (t * 6 - 15) + 10)


def _mix(t: float, a: float, b: float) -> float:
    return a + t * (b - a)


def _gradient(h: int, x: float, y: float, z: float) -> float:
    h &= 15
    u = x if h < 8 else y
    v = y if h < 4 else (x if h in (12, 14) else z)
    return (u if h & 1 == 0 else -u) + (v if h & 2 == 0 else -v)


def lattice_offset(seed: int) -> tuple[int, int, int]:
    """The lattice offset of a seed: (0, 0, 0) for 0, else a hash of the seed (splitmix64)."""
    if seed == 0:
        return 0, 0, 0
    z = (seed * 0x9E3779B97F4A7C15) & _WORD
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _WORD
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _WORD
    z ^= z >> 31
    return z & 255, z >> 8 & 255, z >> 16 & 255
