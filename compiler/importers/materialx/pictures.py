"""MaterialX nodes of pictures: image, tiled by hexagons, and longitude and latitude."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ...formula.opcodes import Op
from .elementary import dot
from .evaluator import Evaluator, Names, handles
from .graph import Node

_CONTRAST = 7.0  # power of the weights of hexagons: Mikkelsen 2022
_SKEW, _HEIGHT = 0.57735027, 1.15470054
_FIT = 2.0 * math.sqrt(3.0)


def _texels(e: Evaluator, row: int, frame: Any, s: int, t: int) -> Names:
    """Red, green, blue and alpha of a picture at s and t, by the frame of its file."""
    b = e.builder
    placed = [b.linear([(float(line[0]), s), (float(line[1]), t)], float(line[2])) for line in frame]
    return b.look_up(row, placed[0], placed[1])


def _file(e: Evaluator, node: Node) -> tuple[int, Any] | None:
    port = e.port(node, "file")
    while port is not None and port.source is not None and "value" in port.source.inputs:
        port = port.source.inputs["value"]
    if port is None:
        return None
    wraps = e.text(node, "uaddressmode", "periodic"), e.text(node, "vaddressmode", "periodic")
    return e.host.picture(node, port, wraps, e.text(node, "filtertype") == "closest")


def _of_type(e: Evaluator, texels: Names, count: int) -> Sequence[int]:
    return texels[:count] if count != 1 else texels[:1]


@handles("image")
def image(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    picture = _file(e, node)
    if picture is None:
        return e.input(node, "default", count)
    s, t = e.input(node, "texcoord", 2)
    return _of_type(e, _texels(e, *picture, s, t), count)


@handles("hextiledimage")
def hextiled(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """Morten S. Mikkelsen, Practical Real-Time Hex-Tiling, Journal of Computer Graphics Techniques 11 (2), 2022, as in mx_hextile.glsl."""
    picture = _file(e, node)
    if picture is None:
        return e.input(node, "default", count)
    b = e.builder
    tiling = e.input(node, "tiling", 2, 1.0)
    place = [b.multiply(name, k) for name, k in zip(e.input(node, "texcoord", 2), tiling, strict=True)]
    corners = _hexagons(e, place)
    colors = [_texels(e, *picture, *_in_hexagon(e, node, place, cell)) for cell, _ in corners]
    coefficients = e.input(node, "lumacoeffs", 3, (0.2722287, 0.6740818, 0.0536895))
    contrast, falloff = e.scalar(node, "falloffcontrast", 0.5), e.scalar(node, "falloff", 0.5)
    plain = [b.op(Op.POWER, b.op(Op.MAX, weight, b.constant(0.0)), b.constant(_CONTRAST)) for _, weight in corners]
    bright = [b.mix(b.constant(1.0), dot(e, color[:3], coefficients), contrast) for color in colors]
    weights = _with_falloff(e, [b.multiply(p, q) for p, q in zip(plain, bright, strict=True)], falloff)
    channels = [b.total([b.multiply(w, c[k]) for w, c in zip(weights, colors, strict=True)]) for k in range(3)]
    if count == 4:
        even = _with_falloff(e, plain, falloff)
        channels.append(b.total([b.multiply(w, c[3]) for w, c in zip(even, colors, strict=True)]))
    return channels[:count]


def _hexagons(e: Evaluator, place: Sequence[int]) -> list[tuple[Names, int]]:
    """The three corners of the triangle around a place: (whole coordinates in the skewed grid, weight)."""
    b, unity = e.builder, e.builder.constant(1.0)
    x, y = (b.scale(name, _FIT) for name in place)
    skewed = b.subtract(x, b.scale(y, _SKEW)), b.scale(y, _HEIGHT)
    base = [b.op(Op.FLOOR, name) for name in skewed]
    p, q = (b.subtract(name, low) for name, low in zip(skewed, base, strict=True))
    r = b.subtract(b.subtract(unity, p), q)
    s = b.at_most(r, b.constant(0.0), unity, b.constant(0.0))
    sign, t = b.offset(b.scale(s, 2.0), -1.0), b.subtract(unity, s)
    weights = [b.op(Op.NEGATE, b.multiply(r, sign)), b.subtract(s, b.multiply(q, sign)), b.subtract(s, b.multiply(p, sign))]
    cells = [(s, s), (s, t), (t, s)]
    return [((b.add(base[0], i), b.add(base[1], j)), w) for (i, j), w in zip(cells, weights, strict=True)]


def _in_hexagon(e: Evaluator, node: Node, place: Sequence[int], cell: Names) -> list[int]:
    """The coordinates of a picture turned, scaled and moved at random around the middle of a hexagon."""
    b = e.builder
    middle = b.scale(b.add(cell[0], b.scale(cell[1], 0.5)), 1.0 / _FIT), b.scale(cell[1], 1.0 / (_HEIGHT * _FIT))
    random = _hash(e, *(b.offset(name, 0.12345) for name in cell))
    turns = [b.scale(name, math.pi / 180.0) for name in e.input(node, "rotationrange", 2, (0.0, 360.0))]
    turn = b.mix(turns[0], turns[1], b.multiply(random[0], e.scalar(node, "rotation", 1.0)))
    sine, cosine = b.op(Op.SIN, turn), b.op(Op.COS, turn)
    sizes = e.input(node, "scalerange", 2, (0.5, 2.0))
    size = b.mix(b.constant(1.0), b.mix(sizes[0], sizes[1], random[1]), e.scalar(node, "scale", 1.0))
    offset, limits = e.scalar(node, "offset", 1.0), e.input(node, "offsetrange", 2, (0.0, 1.0))
    x, y = (b.subtract(name, at) for name, at in zip(place, middle, strict=True))
    turned = b.subtract(b.multiply(x, cosine), b.multiply(y, sine)), b.add(b.multiply(x, sine), b.multiply(y, cosine))
    return [
        b.total([b.divide(name, size), at, b.mix(limits[0], limits[1], b.multiply(number, offset))])
        for name, at, number in zip(turned, middle, random, strict=True)
    ]


def _hash(e: Evaluator, x: int, y: int) -> Sequence[int]:
    b, unity = e.builder, e.builder.constant(1.0)
    p = [b.op(Op.MOD, b.scale(name, k), unity) for name, k in ((x, 0.1031), (y, 0.1030), (x, 0.0973))]
    shift = dot(e, p, [b.offset(name, 33.33) for name in (p[1], p[2], p[0])])
    p = [b.add(name, shift) for name in p]
    return [b.op(Op.MOD, b.multiply(b.add(p[0], q), r), unity) for q, r in ((p[1], p[2]), (p[2], p[1]))]


def _with_falloff(e: Evaluator, weights: list[int], falloff: int) -> list[int]:
    """Weights with a sum of 1, by Schlick's gain where the falloff is not ½."""
    b = e.builder

    def scaled(names: list[int]) -> list[int]:
        total = b.total(names)
        return [b.divide(name, total) for name in names]

    rate = b.clamp(falloff, b.constant(0.001), b.constant(0.999))
    slope = b.offset(b.divide(b.constant(1.0), rate), -2.0)

    def gain(x: int) -> int:
        a = b.multiply(slope, b.subtract(b.constant(1.0), b.scale(x, 2.0)))
        high = b.divide(b.subtract(a, x), b.offset(a, -1.0))
        return b.at_most(b.constant(0.5), x, high, b.divide(x, b.offset(a, 1.0)))

    even = scaled(weights)
    if b.number(falloff) == 0.5:
        return even
    return [b.equal(falloff, b.constant(0.5), x, y) for x, y in zip(even, scaled([gain(x) for x in even]), strict=True)]
