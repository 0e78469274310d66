"""A scalar port of MaterialX 1.39's libraries/stdlib/genglsl/lib/mx_noise.glsl, in Python's integers."""

from __future__ import annotations

import math

WORD = 0xFFFFFFFF


def rotl(x, k):
    return ((x << k) | (x >> (32 - k))) & WORD


def bjmix(a, b, c):
    a = (a - c) & WORD
    a ^= rotl(c, 4)
    c = (c + b) & WORD
    b = (b - a) & WORD
    b ^= rotl(a, 6)
    a = (a + c) & WORD
    c = (c - b) & WORD
    c ^= rotl(b, 8)
    b = (b + a) & WORD
    a = (a - c) & WORD
    a ^= rotl(c, 16)
    c = (c + b) & WORD
    b = (b - a) & WORD
    b ^= rotl(a, 19)
    a = (a + c) & WORD
    c = (c - b) & WORD
    c ^= rotl(b, 4)
    b = (b + a) & WORD
    return a, b, c


def bjfinal(a, b, c):
    c = ((c ^ b) - rotl(b, 14)) & WORD
    a = ((a ^ c) - rotl(c, 11)) & WORD
    b = ((b ^ a) - rotl(a, 25)) & WORD
    c = ((c ^ b) - rotl(b, 16)) & WORD
    a = ((a ^ c) - rotl(c, 4)) & WORD
    b = ((b ^ a) - rotl(a, 14)) & WORD
    return ((c ^ b) - rotl(b, 24)) & WORD


def hash_int(*integers):
    count = len(integers)
    a = b = c = (0xDEADBEEF + (count << 2) + 13) & WORD
    a = (a + integers[0]) & WORD
    b = (b + integers[1]) & WORD if count > 1 else b
    c = (c + integers[2]) & WORD if count > 2 else c
    if count > 3:
        a, b, c = bjmix(a, b, c)
        a = (a + integers[3]) & WORD
    return bjfinal(a, b, c)


def cell(point):
    """mx_cell_noise_float of one to four numbers."""
    return hash_int(*(math.floor(x) for x in point)) / WORD


def cell_vec3(point):
    """mx_cell_noise_vec3 of two or three numbers."""
    return tuple(hash_int(*(math.floor(x) for x in point), k) / WORD for k in range(3))


def gradient(bits, *p):
    if len(p) == 2:
        h, (x, y) = bits & 7, p
        u, v = (x, 2 * y) if h < 4 else (y, 2 * x)
    else:
        h, (x, y, z) = bits & 15, p
        u = x if h < 8 else y
        v = y if h < 4 else x if h in (12, 14) else z
    return (-u if h & 1 else u) + (-v if h & 2 else v)


def perlin(point):
    """(mx_perlin_noise_float, mx_perlin_noise_vec3) of two or three numbers."""
    cells = [math.floor(x) for x in point]
    parts = [x - c for x, c in zip(point, cells, strict=True)]
    fades = [t * t * t * (t * (t * 6 - 15) + 10) for t in parts]
    sums = [0.0] * 4
    for corner in range(2 ** len(point)):
        steps = [corner >> k & 1 for k in range(len(point))]
        bits = hash_int(*(c + s for c, s in zip(cells, steps, strict=True)))
        away = [x - s for x, s in zip(parts, steps, strict=True)]
        weight = math.prod(f if s else 1 - f for f, s in zip(fades, steps, strict=True))
        for k, h in enumerate((bits, bits & 255, bits >> 8 & 255, bits >> 16 & 255)):
            sums[k] += weight * gradient(h, *away)
    scale = 0.6616 if len(point) == 2 else 0.9820
    return scale * sums[0], tuple(scale * s for s in sums[1:])


def _nearest(point, jitter):
    """(distance to the nearest point of the cells around, the way to it)."""
    cells = [math.floor(x) for x in point]
    local = [x - c for x, c in zip(point, cells, strict=True)]
    best, way = 1e6, (0.0,) * len(point)
    for corner in range(3 ** len(point)):
        steps = [corner // 3**k % 3 - 1 for k in range(len(point))]
        offsets = cell_vec3([s + c for s, c in zip(steps, cells, strict=True)])[: len(point)]
        away = [s + (o - 0.5) * jitter + 0.5 - x for s, o, x in zip(steps, offsets, local, strict=True)]
        square = sum(a * a for a in away)
        if square < best:
            best, way = square, away
    return math.sqrt(best), way


def worley(point, jitter=1.0):
    """mx_worley_noise_float of two or three numbers, with the metric 0 and the style 0."""
    return _nearest(point, jitter)[0]


def nearest(point, jitter=1.0):
    """The place whose cell noise is Worley's noise of the style 1."""
    return [a + x for a, x in zip(_nearest(point, jitter)[1], point, strict=True)]
