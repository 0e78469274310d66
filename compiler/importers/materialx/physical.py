"""MaterialX nodes that make inputs of BSDFs: roughness in two directions, metals by colours, black bodies.

Definitions: MaterialX Physically Based Shading Nodes 1.39 and the source of its library pbrlib.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...formula.opcodes import Op
from .elementary import dot
from .evaluator import Evaluator, handles
from .graph import Node

LEAST = 1e-8  # α of a polished surface
NARROWEST = 0.98  # anisotropy that counts at most
# Chromaticity x by 1000 K / T in two ranges (Kang and others 2002), y by x in three; XYZ to linear Rec. 709, its rows.
_X = ((-0.2661239, -0.2343580, 0.8776956, 0.179910), (-3.0258469, 2.1070379, 0.2226347, 0.240390))
_Y = (
    (-1.1063814, -1.34811020, 2.18555832, -0.20219683), (-0.9549476, -1.37418593, 2.09137015, -0.16748867),
    (3.0817580, -5.87338670, 3.75112997, -0.37001483),
)  # fmt: skip
_LIMITS, _MIDDLE, _LOW = (800.0, 25000.0), 4000.0, 2222.0
_RGB = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))


@handles("roughness_anisotropy")
def roughness_anisotropy(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """α along the tangent and across."""
    b, rough = e.builder, e.scalar(node, "roughness")
    alpha = b.clamp(b.multiply(rough, rough), b.constant(LEAST), b.constant(1.0))
    narrow = b.clamp(e.scalar(node, "anisotropy"), b.constant(0.0), b.constant(NARROWEST))
    aspect = b.op(Op.SQRT, b.subtract(b.constant(1.0), narrow))
    return [b.op(Op.MIN, b.divide(alpha, aspect), b.constant(1.0)), b.multiply(alpha, aspect)]


@handles("roughness_dual")
def roughness_dual(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    b, (along, across) = e.builder, e.input(node, "roughness", 2)
    across = b.op(Op.CHOOSE, b.op(Op.NEGATE, across), across, along)  # the first where the second is negative
    return [b.clamp(b.multiply(r, r), b.constant(LEAST), b.constant(1.0)) for r in (along, across)]


@handles("artistic_ior")
def artistic_ior(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """Gulbrandsen, Artist Friendly Metallic Fresnel, Journal of Computer Graphics Techniques 3 (4), 2014."""
    b, unity = e.builder, e.builder.constant(1.0)
    result = []
    for color, edge in zip(e.input(node, "reflectivity", 3), e.input(node, "edge_color", 3), strict=True):
        r = b.clamp(color, b.constant(0.0), b.constant(0.99))
        root = b.op(Op.SQRT, r)
        low = b.divide(b.subtract(unity, r), b.add(unity, r))
        high = b.divide(b.add(unity, root), b.subtract(unity, root))
        n = b.mix(high, low, edge)
        up, down = b.offset(n, 1.0), b.offset(n, -1.0)
        square = b.divide(b.subtract(b.multiply(r, b.multiply(up, up)), b.multiply(down, down)), b.subtract(unity, r))
        result.append(n if output == "ior" else b.op(Op.SQRT, b.op(Op.MAX, square, b.constant(0.0))))
    return result


@handles("blackbody")
def blackbody(e: Evaluator, node: Node, output: str, count: int) -> Sequence[int]:
    """The colour of a black body of luminance 1."""
    b = e.builder
    kelvin = b.clamp(e.scalar(node, "temperature", 5000.0), *map(b.constant, _LIMITS))

    def cubic(factors: Sequence[float], t: int) -> int:
        result = b.constant(factors[0])
        for factor in factors[1:]:
            result = b.offset(b.multiply(result, t), factor)
        return result

    t = b.divide(b.constant(1000.0), kelvin)
    warm, middle = b.subtract(kelvin, b.constant(_LOW)), b.subtract(kelvin, b.constant(_MIDDLE))
    x = b.op(Op.CHOOSE, middle, cubic(_X[0], t), cubic(_X[1], t))
    y = b.op(Op.CHOOSE, warm, cubic(_Y[0], x), b.op(Op.CHOOSE, middle, cubic(_Y[1], x), cubic(_Y[2], x)))
    z = b.subtract(b.subtract(b.constant(1.0), x), y)
    xyz = [b.divide(x, y), b.constant(1.0), b.divide(z, y)]
    return [b.op(Op.MAX, dot(e, [b.constant(factor) for factor in row], xyz), b.constant(0.0)) for row in _RGB]
