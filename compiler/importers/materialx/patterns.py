"""MaterialX nodes of noise, ramps and the geometry. Definitions: MaterialX Specification 1.39; noise as in its mx_noise.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from ...formula.opcodes import Op
from ...texture_graph.opcodes import Op as GraphOp
from ...texture_graph.opcodes import U
from . import library
from .elementary import smooth
from .evaluator import Evaluator, Names, NotDrawn, handles
from .graph import Node

MOST_OCTAVES = 16
_PERLIN = {
    2: (GraphOp.PERLIN2, (GraphOp.PERLIN2_R, GraphOp.PERLIN2_G, GraphOp.PERLIN2_B)),
    3: (GraphOp.PERLIN3, (GraphOp.PERLIN3_R, GraphOp.PERLIN3_G, GraphOp.PERLIN3_B)),
}
_CELLS3 = (GraphOp.CELL4_0, GraphOp.CELL4_1, GraphOp.CELL4_2)
_FARTHEST = 1e6  # squared distance before the first cell of Worley's noise


def _place(e: Evaluator, node: Node) -> Names:
    """The point at which a noise of two or three dimensions is evaluated."""
    return e.input(node, "texcoord", 2) if library.category(node).endswith("2d") else e.input(node, "position", 3)


def _moved(e: Evaluator, place: Names, by: tuple[float, ...]) -> Names:
    return tuple(e.builder.offset(name, d) for name, d in zip(place, by, strict=False))


def perlin(e: Evaluator, place: Names, count: int, aside: tuple[float, float, float]) -> list[int]:
    """Gradient noise of `count` numbers; the fourth one is that of a place `aside`."""
    single, channels = _PERLIN[len(place)]
    if count == 1:
        return [e.builder.op(single, *place)]
    names = [e.builder.op(channel, *place) for channel in channels[: min(count, 3)]]
    return names if count < 4 else [*names, e.builder.op(single, *_moved(e, place, aside))]


@handles("noise2d", "noise3d")
def noise(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    if e.kind(node, output).startswith("color"):
        return e.implemented(node, output)
    b, pivot = e.builder, e.scalar(node, "pivot")
    place = _place(e, node)
    values = perlin(e, place, count, (19.0, 73.0, 29.0))
    return [b.add(b.multiply(v, a), pivot) for v, a in zip(values, e.input(node, "amplitude", count, 1.0), strict=True)]


@handles("fractal2d", "fractal3d")
def fractal(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    if e.kind(node, output).startswith("color"):
        return e.implemented(node, output)
    b, octaves = e.builder, int(e.fixed(node, "octaves", 3))
    if octaves > MOST_OCTAVES:
        e.host.tell(f"{octaves} octaves of {node.definition} are drawn as {MOST_OCTAVES}", node.place)
    lacunarity, diminish = e.scalar(node, "lacunarity", 2.0), e.scalar(node, "diminish", 0.5)
    place, weight = _place(e, node), b.constant(1.0)
    aside = (19.0, 193.0, 17.0)
    if count == 2:  # MaterialX takes the second of two numbers from another place
        places, single = [place, _moved(e, place, aside)], True
    else:
        places, single = ([place, _moved(e, place, aside)] if count == 4 else [place]), count == 1
    sums = [b.constant(0.0)] * count
    for _ in range(min(max(octaves, 0), MOST_OCTAVES)):
        if single:
            values = [b.op(_PERLIN[len(place)][0], *each) for each in places]
        else:
            values = perlin(e, places[0], 3, aside) + [b.op(_PERLIN[len(place)][0], *each) for each in places[1:]]
        sums = [b.add(s, b.multiply(weight, v)) for s, v in zip(sums, values, strict=True)]
        weight = b.multiply(weight, diminish)
        places = [tuple(b.multiply(name, lacunarity) for name in each) for each in places]
    return [b.multiply(s, a) for s, a in zip(sums, e.input(node, "amplitude", count, 1.0), strict=True)]


@handles("cellnoise2d", "cellnoise3d")
def cellnoise(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    place = _place(e, node)
    return [e.builder.op(GraphOp.CELL2 if len(place) == 2 else GraphOp.CELL3, *place)]


def _random(e: Evaluator, cell: Names) -> list[int]:
    """mx_cell_noise_vec3 of two or three numbers; of two of them two numbers."""
    if len(cell) == 2:
        return [e.builder.op(GraphOp.CELL3, *cell, e.builder.constant(k)) for k in range(3)]
    return [e.builder.op(op, *cell) for op in _CELLS3]


@handles("worleynoise2d", "worleynoise3d")
def worley(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """Distances to the nearest points, one a cell; in style 1 random numbers of the nearest one."""
    b, place, jitter = e.builder, _place(e, node), e.scalar(node, "jitter", 1.0)
    style = e.fixed(node, "style", 0.0)
    cells = [b.op(Op.FLOOR, name) for name in place]
    local = [b.subtract(name, cell) for name, cell in zip(place, cells, strict=True)]
    best, nearest = [b.constant(_FARTHEST)] * count, [b.constant(0.0)] * len(place)
    for number in range(3 ** len(place)):
        steps = [float(number // 3 ** (len(place) - 1 - k) % 3 - 1) for k in range(len(place))]
        random = _random(e, tuple(b.offset(cell, step) for cell, step in zip(cells, steps, strict=True)))
        away = [
            b.subtract(b.offset(b.multiply(b.offset(r, -0.5), jitter), 0.5 + step), inside)
            for r, step, inside in zip(random, steps, local, strict=False)
        ]
        square = b.total([b.multiply(name, name) for name in away])
        if style == 1:
            nearest = [b.at_most(best[0], square, old, new) for old, new in zip(nearest, away, strict=True)]
        later = square
        for k in range(count):
            best[k], later = b.op(Op.MIN, best[k], later), b.op(Op.MAX, best[k], later)
    if style == 1:
        hit = tuple(b.add(name, way) for name, way in zip(place, nearest, strict=True))
        return [b.op(GraphOp.CELL2 if len(hit) == 2 else GraphOp.CELL3, *hit)] if count == 1 else _random(e, hit)[:count]
    return [b.op(Op.SQRT, name) for name in best]


# --- ramps --------------------------------------------------------------------------------------------------------------


@handles("ramplr", "ramptb", "splitlr", "splittb")
def ramp(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """A step of width 0 in place of MaterialX' step over a pixel: the texture is averaged over the pixel."""
    b, category = e.builder, library.category(node)
    first, second = ("valuel", "valuer") if category.endswith("lr") else ("valueb", "valuet")
    along = e.input(node, "texcoord", 2)[0 if category.endswith("lr") else 1]
    if category.startswith("ramp"):
        share = b.clamp(along, b.constant(0.0), b.constant(1.0))
    else:
        share = b.at_most(e.scalar(node, "center", 0.5), along, b.constant(1.0), b.constant(0.0))
    pairs = zip(e.input(node, first, count), e.input(node, second, count), strict=True)
    return [b.mix(low, high, share) for low, high in pairs]


@handles("curveadjust", "curvelookup")
def curve(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """A linear or smooth curve through knots."""
    b, port = e.builder, e.port(node, "knots")
    values = e.port(node, "knotvalues")
    if port is None or not isinstance(port.value, Sequence) or values is None or not isinstance(values.value, Sequence):
        raise NotDrawn(f"{node.definition} without knots is not drawn")
    knots, numbers = list(port.value), list(values.value)
    width = len(numbers) // max(len(knots), 1)
    step = e.text(node, "interpolation", "linear")
    result = []
    for k, x in enumerate(e.input(node, "in", count)):
        heights = [float(numbers[i * width + min(k, width - 1)]) for i in range(len(knots))]
        name = b.constant(heights[0])
        for (low, high), (a, c) in zip(pairwise(knots), pairwise(heights), strict=True):
            if high <= low:
                continue
            ends = b.constant(low), b.constant(high)
            share = smooth(e, x, *ends) if step == "smooth" else b.clamp(
                b.scale(b.offset(x, -low), 1.0 / (high - low)), b.constant(0.0), b.constant(1.0))  # fmt: skip
            name = b.add(name, b.scale(share, c - a))
        result.append(name)
    return result


# --- geometry -----------------------------------------------------------------------------------------------------------


@handles("position", "normal", "tangent", "bitangent")
def geometry(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    category, space = library.category(node), e.text(node, "space", "object")
    names = e.geometry({"position": "P", "normal": "N", "tangent": "T", "bitangent": "B"}[category])
    return e.moved(names, "point" if category == "position" else "normal", node.place) if space == "world" else names


@handles("texcoord")
def texcoord(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    if e.scalar(node, "index") != e.builder.constant(0.0):
        e.host.tell("texture coordinates of an index above 0 are drawn as the first ones", node.place)
    return e.coordinates()


@handles("geompropvalue", "UsdPrimvarReader", "geomcolor")
def primvar(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    name = e.text(node, "geomprop") or e.text(node, "varname") or ("displayColor" if library.category(node) == "geomcolor" else "")
    kind = e.kind(node, output)
    if kind == "vector2":
        return e.coordinates(name)
    if kind == "float" and e.host.is_u(name):
        return [U]
    fallback = e.input(node, "default" if "default" in node.inputs else "fallback", count)
    numbers = [e.builder.number(each) or 0.0 for each in fallback]
    return [e.builder.constant(number) for number in e.host.primvar(name, kind, numbers, node.place)]


@handles("viewdirection")
def view(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return e.view(e.text(node, "space", "world") == "world", node.place)


@handles("normalmap", "bump", "heighttonormal", "hextilednormalmap")
def bent(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    raise NotDrawn(f"{node.definition} is drawn as the normal of a surface alone")


@handles("flake2d", "flake3d")
def flake(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    raise NotDrawn(f"the shader `{node.definition}` is not drawn")
