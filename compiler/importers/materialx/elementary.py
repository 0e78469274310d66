"""MaterialX nodes of arithmetic, vectors, conditions, channels and colours. Definitions: MaterialX Specification 1.39, Standard Nodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ...formula.opcodes import Op
from . import library
from .evaluator import Evaluator, Names, handles
from .graph import Node

EPSILON = 1e-8  # smaller denominators of MaterialX' `burn`, `dodge` and `disjointover` count as 0
_CHANNELS = "rgba", "xyzw"
_UNARY = {
    "absval": Op.ABS, "sign": Op.SIGN, "floor": Op.FLOOR, "ceil": Op.CEIL, "sqrt": Op.SQRT, "sin": Op.SIN, "cos": Op.COS, "tan": Op.TAN,
    "asin": Op.ASIN, "acos": Op.ACOS, "exp": Op.EXP, "ln": Op.LOG,
}  # fmt: skip
_BINARY = {
    "add": Op.ADD, "subtract": Op.SUBTRACT, "multiply": Op.MULTIPLY, "divide": Op.DIVIDE, "modulo": Op.MOD, "power": Op.POWER,
    "min": Op.MIN, "max": Op.MAX,
}  # fmt: skip


@handles(*_UNARY)
def unary(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return [e.builder.op(_UNARY[library.category(node)], name) for name in e.input(node, "in", count)]


@handles(*_BINARY)
def binary(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    category = library.category(node)
    neutral = 1.0 if category in ("multiply", "divide", "power", "modulo") else 0.0
    if count in (9, 16) and category == "multiply":
        return _product(e, e.input(node, "in1", count), e.input(node, "in2", count), math.isqrt(count))
    pairs = zip(e.input(node, "in1", count), e.input(node, "in2", count, neutral), strict=True)
    return [e.builder.op(_BINARY[category], a, b) for a, b in pairs]


def _product(e: Evaluator, a: Names, b: Names, n: int) -> Sequence[int]:
    m = e.builder.multiply
    return [e.builder.total([m(a[i * n + k], b[k * n + j]) for k in range(n)]) for i in range(n) for j in range(n)]


@handles("atan2")
def atan2(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return [e.builder.op(Op.ATAN2, y, x) for y, x in zip(e.input(node, "iny", count), e.input(node, "inx", count), strict=True)]


@handles("round")
def rounded(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return [e.builder.op(Op.FLOOR, e.builder.offset(name, 0.5)) for name in e.input(node, "in", count)]


@handles("fract")
def fraction(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return [e.builder.op(Op.MOD, name, e.builder.constant(1.0)) for name in e.input(node, "in", count)]


@handles("invert")
def invert(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    pairs = zip(e.input(node, "amount", count, 1.0), e.input(node, "in", count), strict=True)
    return [e.builder.subtract(amount, name) for amount, name in pairs]


@handles("clamp")
def clamp(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    parts = (e.input(node, name, count, default) for name, default in (("in", 0.0), ("low", 0.0), ("high", 1.0)))
    return [e.builder.clamp(*names) for names in zip(*parts, strict=True)]


@handles("remap")
def remap(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b = e.builder
    parts = (e.input(node, n, count, d) for n, d in (("in", 0.0), ("inlow", 0.0), ("inhigh", 1.0), ("outlow", 0.0), ("outhigh", 1.0)))
    return [
        b.add(low, b.divide(b.multiply(b.subtract(name, in_low), b.subtract(high, low)), b.subtract(in_high, in_low)))
        for name, in_low, in_high, low, high in zip(*parts, strict=True)
    ]


@handles("smoothstep")
def smoothstep(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    parts = (e.input(node, name, count, default) for name, default in (("in", 0.0), ("low", 0.0), ("high", 1.0)))
    return [smooth(e, *names) for names in zip(*parts, strict=True)]


def smooth(e: Evaluator, value: int, low: int, high: int) -> int:
    """0 up to `low`, 1 from `high` on, a cubic between."""
    b = e.builder
    t = b.clamp(b.divide(b.subtract(value, low), b.subtract(high, low)), b.constant(0.0), b.constant(1.0))
    cubic = b.multiply(b.multiply(t, t), b.subtract(b.constant(3.0), b.scale(t, 2.0)))
    return b.at_most(high, value, b.constant(1.0), b.at_most(value, low, b.constant(0.0), cubic))


@handles("mix")
def mix(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    parts = (e.input(node, name, count) for name in ("bg", "fg", "mix"))
    return [e.builder.mix(*names) for names in zip(*parts, strict=True)]


# --- vectors and matrices -----------------------------------------------------------------------------------------------


def dot(e: Evaluator, a: Sequence[int], b: Sequence[int]) -> int:
    return e.builder.total([e.builder.multiply(p, q) for p, q in zip(a, b, strict=True)])


def cross(e: Evaluator, a: Names, b: Names) -> list[int]:
    m, s = e.builder.multiply, e.builder.subtract
    return [s(m(a[1], b[2]), m(a[2], b[1])), s(m(a[2], b[0]), m(a[0], b[2])), s(m(a[0], b[1]), m(a[1], b[0]))]


def length(e: Evaluator, a: Sequence[int]) -> int:
    return e.builder.op(Op.SQRT, dot(e, a, a))


def unit(e: Evaluator, a: Sequence[int]) -> list[int]:
    size = length(e, a)
    return [e.builder.divide(name, size) for name in a]


@handles("magnitude")
def magnitude(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return [length(e, e.input(node, "in"))]


@handles("normalize")
def normalize(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return unit(e, e.input(node, "in", count))


@handles("dotproduct")
def dotproduct(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    first = e.input(node, "in1")
    return [dot(e, first, e.input(node, "in2", len(first)))]


@handles("crossproduct")
def crossproduct(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return cross(e, e.input(node, "in1", 3), e.input(node, "in2", 3))


@handles("reflect")
def reflect(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, incident, normal = e.builder, e.input(node, "in", 3), e.input(node, "normal", 3)
    twice = b.scale(dot(e, incident, normal), 2.0)
    return [b.subtract(i, b.multiply(twice, n)) for i, n in zip(incident, normal, strict=True)]


@handles("rotate2d")
def rotate2d(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, (x, y) = e.builder, e.input(node, "in", 2)
    turn = b.scale(e.scalar(node, "amount"), math.pi / 180.0)
    s, c = b.op(Op.SIN, turn), b.op(Op.COS, turn)
    return [b.add(b.multiply(c, x), b.multiply(s, y)), b.subtract(b.multiply(c, y), b.multiply(s, x))]


@handles("rotate3d")
def rotate3d(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """By Rodrigues' formula; vectors are rows, so that the cross product is reversed."""
    b, point, axis = e.builder, e.input(node, "in", 3), tuple(unit(e, e.input(node, "axis", 3, (0.0, 1.0, 0.0))))
    turn = b.scale(e.scalar(node, "amount"), math.pi / 180.0)
    s, c = b.op(Op.SIN, turn), b.op(Op.COS, turn)
    along = b.multiply(dot(e, axis, point), b.subtract(b.constant(1.0), c))
    parts = zip(point, cross(e, point, axis), axis, strict=True)
    return [b.total([b.multiply(p, c), b.multiply(q, s), b.multiply(a, along)]) for p, q, a in parts]


@handles("transformmatrix")
def transformmatrix(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """A row vector times a matrix; a vector of fewer numbers than rows is a point."""
    b, point, matrix = e.builder, e.input(node, "in", count), e.input(node, "mat")
    side = math.isqrt(max(len(matrix), 1))
    if side < count:
        return point
    full = (*point, *(b.constant(1.0),) * (side - count))
    return [dot(e, full, [matrix[i * side + j] for i in range(side)]) for j in range(count)]


@handles("creatematrix")
def creatematrix(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    side = math.isqrt(count)
    rows = [e.input(node, f"in{k + 1}", 0, tuple(float(k == i) for i in range(side))) for k in range(side)]
    filled = [(*row, *(e.builder.constant(float(k == i)) for i in range(len(row), side))) for k, row in enumerate(rows)]
    return [name for row in filled for name in row]


@handles("transformpoint", "transformvector", "transformnormal")
def transform(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    before, after = ("object" if name == "model" else name for name in (e.text(node, "fromspace"), e.text(node, "tospace")))
    names = e.input(node, "in", count)
    if "" in (before, after) or before == after:
        return names
    if {before, after} == {"object", "world"}:
        return e.moved(names, library.category(node).removeprefix("transform"), node.place, back=before == "world")
    e.host.tell(f"the spaces {before} and {after} of {node.definition} are drawn as the frame of the object", node.place)
    return names


# --- channels and conditions --------------------------------------------------------------------------------------------


@handles("constant")
def constant(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return e.input(node, "value", count)


@handles("dot")
def dotted(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return e.input(node, "in")


@handles("convert")
def convert(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return e.implemented(node, output) or e.input(node, "in")


@handles("combine2", "combine3", "combine4")
def combine(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    return [name for k in range(4) if e.port(node, f"in{k + 1}") is not None for name in e.input(node, f"in{k + 1}")]


@handles("separate2", "separate3", "separate4")
def separate(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    names = e.input(node, "in")
    index = next((channels.index(output[-1]) for channels in _CHANNELS if output[-1:] and output[-1] in channels), 0)
    return [names[min(index, len(names) - 1)]]


@handles("extract")
def extract(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    names, index, b = e.input(node, "in"), e.scalar(node, "index"), e.builder
    result = names[0]
    for k, name in enumerate(names[1:], 1):
        result = b.at_most(b.constant(k - 0.5), index, name, result)
    return [result]


@handles("swizzle")
def swizzle(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """Of MaterialX before 1.39."""
    names, b = e.input(node, "in"), e.builder
    chosen = []
    for letter in e.text(node, "channels"):
        index = next((channels.index(letter) for channels in _CHANNELS if letter in channels), None)
        chosen.append(b.constant(float(letter == "1")) if index is None else names[min(index, len(names) - 1)])
    return chosen


_CONDITIONS: dict[str, Callable[..., int]] = {
    "ifgreater": lambda b, x, y, yes, no: b.at_most(x, y, no, yes),
    "ifgreatereq": lambda b, x, y, yes, no: b.at_most(y, x, yes, no),
    "ifequal": lambda b, x, y, yes, no: b.equal(x, y, yes, no),
}


@handles(*_CONDITIONS)
def condition(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, choose = e.builder, _CONDITIONS[library.category(node)]
    x, y = e.scalar(node, "value1", 1.0), e.scalar(node, "value2")
    if e.port(node, "in1") is None and e.port(node, "in2") is None:
        return [choose(b, x, y, b.constant(1.0), b.constant(0.0))]
    parts = zip(e.input(node, "in1", count), e.input(node, "in2", count), strict=True)
    return [choose(b, x, y, yes, no) for yes, no in parts]


@handles("and", "or", "not", "logical_and", "logical_or", "logical_not")
def logic(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, category = e.builder, library.category(node).removeprefix("logical_")
    if category == "not":
        return [b.subtract(b.constant(1.0), e.scalar(node, "in"))]
    return [b.op(Op.MIN if category == "and" else Op.MAX, e.scalar(node, "in1"), e.scalar(node, "in2"))]


# --- colours ------------------------------------------------------------------------------------------------------------


@handles("luminance")
def luminance(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    names = e.input(node, "in", count)
    grey = dot(e, names[:3], e.input(node, "lumacoeffs", 3, (0.2722287, 0.6740818, 0.0536895)))
    return [grey, grey, grey, *names[3:]]


@handles("rgbtohsv")
def rgbtohsv(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, names = e.builder, e.input(node, "in", count)
    r, g, blue = names[:3]
    zero = b.constant(0.0)
    top, low = b.op(Op.MAX, r, b.op(Op.MAX, g, blue)), b.op(Op.MIN, r, b.op(Op.MIN, g, blue))
    chroma = b.subtract(top, low)

    def sector(first: int, second: int, offset: float) -> int:
        return b.offset(b.divide(b.subtract(first, second), chroma), offset)

    hue = b.at_most(top, r, sector(g, blue, 0.0), b.at_most(top, g, sector(blue, r, 2.0), sector(r, g, 4.0)))
    hue = b.op(Op.MOD, b.scale(hue, 1.0 / 6.0), b.constant(1.0))
    saturation = b.at_most(top, zero, zero, b.divide(chroma, top))
    return [b.at_most(saturation, zero, zero, hue), saturation, top, *names[3:]]


@handles("hsvtorgb")
def hsvtorgb(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, names = e.builder, e.input(node, "in", count)
    hue, saturation, value = names[:3]
    unity, zero = b.constant(1.0), b.constant(0.0)
    sector = b.scale(b.op(Op.MOD, hue, unity), 6.0)

    def channel(shift: float) -> int:
        """The value less a trapezium over the sectors: v − v s max(0, min(k, 4 − k, 1)), k = (sector + shift) mod 6."""
        k = b.op(Op.MOD, b.offset(sector, shift), b.constant(6.0))
        rise = b.op(Op.MAX, zero, b.op(Op.MIN, b.op(Op.MIN, k, b.subtract(b.constant(4.0), k)), unity))
        return b.subtract(value, b.multiply(b.multiply(value, saturation), rise))

    return [channel(5.0), channel(3.0), channel(1.0), *names[3:]]


@handles("premult", "unpremult")
def premultiply(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    *color, alpha = e.input(node, "in", 4)
    change = e.builder.multiply if library.category(node) == "premult" else e.builder.divide
    return [*(change(name, alpha) for name in color), alpha]


def _burn(e: Evaluator, fg: int, bg: int) -> int:
    b = e.builder
    return b.subtract(b.constant(1.0), b.divide(b.subtract(b.constant(1.0), bg), fg))


_BLENDS: dict[str, Callable[[Evaluator, int, int], int]] = {
    "plus": lambda e, fg, bg: e.builder.add(bg, fg),
    "minus": lambda e, fg, bg: e.builder.subtract(bg, fg),
    "difference": lambda e, fg, bg: e.builder.op(Op.ABS, e.builder.subtract(bg, fg)),
    "burn": _burn,
    "dodge": lambda e, fg, bg: e.builder.divide(bg, e.builder.subtract(e.builder.constant(1.0), fg)),
    "screen": lambda e, fg, bg: e.builder.subtract(e.builder.add(fg, bg), e.builder.multiply(fg, bg)),
}


@handles(*_BLENDS)
def blend(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, category = e.builder, library.category(node)
    share, result = e.scalar(node, "mix", 1.0), []
    for fg, bg in zip(e.input(node, "fg", count), e.input(node, "bg", count), strict=True):
        name = b.mix(bg, _BLENDS[category](e, fg, bg), share)
        if category in ("burn", "dodge"):
            zero_at = fg if category == "burn" else b.subtract(b.constant(1.0), fg)
            name = b.at_most(b.op(Op.ABS, zero_at), b.constant(EPSILON), b.constant(0.0), name)
        result.append(name)
    return result


@handles("inside", "outside")
def masked(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, mask = e.builder, e.scalar(node, "mask", 1.0)
    weight = mask if library.category(node) == "inside" else b.subtract(b.constant(1.0), mask)
    return [b.multiply(name, weight) for name in e.input(node, "in", count)]


@handles("in", "out", "mask", "matte", "over", "disjointover")
def composite(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """Porter and Duff's operations on colours with alpha."""
    b, category = e.builder, library.category(node)
    fg, bg, share = e.input(node, "fg", 4), e.input(node, "bg", 4), e.scalar(node, "mix", 1.0)
    unity = b.constant(1.0)
    rest = b.subtract(unity, fg[3])
    if category in ("in", "out"):
        weight = bg[3] if category == "in" else b.subtract(unity, bg[3])
        mixed = [b.multiply(name, weight) for name in fg]
    elif category == "mask":
        mixed = [b.multiply(name, fg[3]) for name in bg]
    elif category == "over":
        mixed = [b.add(f, b.multiply(g, rest)) for f, g in zip(fg, bg, strict=True)]
    elif category == "matte":
        mixed = [b.add(b.multiply(f, fg[3]), b.multiply(g, rest)) for f, g in zip(fg[:3], bg[:3], strict=True)]
        mixed.append(b.add(fg[3], b.multiply(bg[3], rest)))
    else:
        alpha = b.add(fg[3], bg[3])
        share_of_bg = b.at_most(alpha, unity, unity, b.divide(rest, bg[3]))
        empty = b.at_most(alpha, unity, b.constant(-1.0), b.subtract(b.op(Op.ABS, bg[3]), b.constant(EPSILON)))
        sums = [b.add(f, b.multiply(g, share_of_bg)) for f, g in zip(fg[:3], bg[:3], strict=True)]
        opaque = b.at_most(alpha, unity, b.constant(1.0), empty)
        mixed = [b.op(Op.CHOOSE, opaque, b.constant(0.0), name) for name in sums] + [b.op(Op.MIN, alpha, unity)]
    return [b.mix(g, name, share) for g, name in zip(bg, mixed, strict=True)]


@handles("blur")
def blur(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    e.host.tell(f"the blur of {node.definition} is not drawn: its input is", node.place)
    return e.input(node, "in", count)


@handles("time", "frame")
def moment(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    e.host.tell(f"{node.definition} is drawn as 0", node.place)
    return [e.builder.constant(0.0)]
