"""Ray intersection, normals and surface coordinates of analytic shapes in their own frames, in lanes: generated from shapes/.

`Hit.primitive` numbers the parts of a shape, as its `hit` does. Directions need no unit length: t is in lengths of the direction.
Surface coordinates (u right, v up, seen from outside with y up) are from 0 to 1, unless a shape's `uv` says another thing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from ...compiler import ir
from ...shapes import SHAPES, Shape
from ...shapes.lanes import TURN
from ...shapes.torus_roots import crossings as torus_crossings
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec
from .triangle_hit import triangle

__all__ = ["intersect", "normal", "torus_crossings", "triangle", "uv"]

INF = math.inf
PLANE = int(ir.GeometryKind.PLANE)  # the last of the usual shapes


def _groups(shapes: Mapping[int, Shape], name: str) -> dict[Callable[..., Any], str]:
    """The functions of a name, each with the test of the kinds that it serves."""
    kinds: dict[Callable[..., Any], list[str]] = {}
    for kind, shape in shapes.items():
        kinds.setdefault(getattr(shape, name), []).append(f"(kind == {int(kind)})")
    return {function: " | ".join(tests) for function, tests in kinds.items()}


def _make(name: str, head: tuple[str, ...], branch: tuple[str, ...], shapes: Mapping[int, Shape], tail: str) -> Any:
    """A helper with a branch for each function `name` of shapes: `call` is that function, `own` the mask of its lanes."""
    lines, scope = list(head), {"INF": INF, "ops": ops, "TURN": TURN}
    for n, (function, test) in enumerate(_groups(shapes, name).items()):
        scope[f"{name}_{n}"] = function
        lines += [f"own = {test}", "if ops.any_lane(own):", *(f"    {line.replace('call', f'{name}_{n}')}" for line in branch)]
    exec("\n    ".join([*lines, tail]), scope)
    return helper(scope[f"any_{name}"])


def _make_hit(shapes: Mapping[int, Shape]) -> Any:
    head = "def any_hit(kind, parameters, g, origin, direction, t_min, t_max):", "t, part = INF + 0.0 * (kind + t_max), kind * 0"
    branch = (
        "s, of = call(kind, parameters, g, origin, direction, t_min, t_max)",
        "t, part = ops.where(own, s, t), ops.where(own, of, part)",
    )
    return _make("hit", head, branch, shapes, "return t, part")


usual = _make_hit({kind: shape for kind, shape in SHAPES.items() if kind <= PLANE})
"""`intersect` for spheres, boxes and planes, the usual shapes."""
rare = _make_hit({kind: shape for kind, shape in SHAPES.items() if kind > PLANE})
"""`intersect` for all other shapes."""
_any_normal = _make(
    "normal",
    ("def any_normal(kind, parameters, g, part, p):", "zero = 0.0 * p[0]", "n = (zero, zero + 1.0, zero)"),
    ("n = ops.where3(own, call(kind, parameters, g, part, p), n)",),
    {kind: shape for kind, shape in SHAPES.items() if not shape.FLAT},
    "return ops.normalize(n)",
)
_any_uv = _make(
    "uv",
    (
        "def any_uv(kind, parameters, g, part, p):", "rho = ops.sqrt(p[0] * p[0] + p[2] * p[2])",
        "longitude = 0.5 + ops.atan2(p[0], p[2]) / TURN", "u, v, du = p[0], -p[2], 1.0 + 0.0 * p[0]", "dv = du",
    ),
    (
        "(a, b), (da, db) = call(kind, parameters, g, part, p, rho, longitude)",
        "u, v, du, dv = ops.where(own, a, u), ops.where(own, b, v), ops.where(own, da, du), ops.where(own, db, dv)",
    ),
    {kind: shape for kind, shape in SHAPES.items() if kind != PLANE},
    "return (u, v), (du, dv)",
)  # fmt: skip


@helper
def intersect(kind: Lane, parameters, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    """(t, part) of the first hit with shape `g` with t_min < t < t_max; t is inf without a hit.

    `parameters` is Geometries.parameters. It does not handle meshes: see `triangle`.
    """
    t, part = usual(kind, parameters, g, origin, direction, t_min, t_max)
    if ops.any_lane(kind > PLANE):
        other_t, other_part = rare(kind, parameters, g, origin, direction, t_min, t_max)
        t, part = ops.where(kind > PLANE, other_t, t), ops.where(kind > PLANE, other_part, part)
    return t, part


@helper
def normal(kind: Lane, parameters, g: Lane, part: Lane, p: Vec) -> Vec:
    """Unit normal of shape `g` at its point p, outward; +y for flat shapes, the gradient's direction for quadrics."""
    return _any_normal(kind, parameters, g, part, p)


@helper
def uv(kind: Lane, parameters, g: Lane, part: Lane, p: Vec) -> tuple[tuple[Lane, Lane], tuple[Lane, Lane]]:
    """((u, v), (metres per u, metres per v)) at the point p of shape `g`.

    Where the length of u varies over the shape, it is the largest one (a sphere's equator).
    """
    return _any_uv(kind, parameters, g, part, p)
