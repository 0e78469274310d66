"""What the lane helpers of shapes share: `ops`, and roots of simple surfaces.

A helper here is a plain function: render/geometry/analytic_shapes.py makes helpers of kernels of all. `ops` is imported when a ray is
traced, for it takes LLVM: `maquette check` loads the shapes without it.
"""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .contract import Lane, Vec

if TYPE_CHECKING:
    from ..render.lanes import ops
else:

    def _lazy(name: str) -> Any:
        """A module of the package that is loaded when an attribute is first read."""
        spec = importlib.util.find_spec(name, __package__)
        if spec.name in sys.modules:
            return sys.modules[spec.name]
        loader = spec.loader = importlib.util.LazyLoader(spec.loader)
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
        loader.exec_module(module)
        return module

    ops = _lazy("..render.lanes.ops")

INF = math.inf
TURN = 2.0 * math.pi
HELPERS: list[Callable[..., Any]] = []
"""All lane helpers of shapes."""


def helper(function: Callable[..., Any]) -> Any:
    """Mark a function that runs in kernels, in lanes; outside of them it runs as Python on numpy arrays. See jit.kernel.helper."""
    HELPERS.append(function)
    return function


@helper
def up(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
    """The normal of flat shapes, +y."""
    zero = 0.0 * point[0]
    return zero, zero + 1.0, zero


@helper
def nearest(lo: Lane, hi: Lane, t_min: Lane, t_max: Lane) -> Lane:
    """The first of two ordered roots strictly between t_min and t_max, inf if neither is; NaN never is."""
    second = ops.where((hi > t_min) & (hi < t_max), hi, INF)
    return ops.where((lo > t_min) & (lo < t_max), lo, second)


@helper
def slab(o: Lane, d: Lane, half: Lane) -> tuple[Lane, Lane]:
    """(lo, hi) of t with |o + t d| <= half, or (inf, -inf) without any.

    A ray parallel to the slab (d = ±0) is inside everywhere or nowhere; 0 · inf is not evaluated.
    """
    a = (-half - o) / d
    b = (half - o) / d
    inside = (o >= -half) & (o <= half)
    lo = ops.where(d > 0.0, a, ops.where(d < 0.0, b, ops.where(inside, -INF, INF)))
    hi = ops.where(d > 0.0, b, ops.where(d < 0.0, a, ops.where(inside, INF, -INF)))
    return lo, hi


@helper
def component(v: Vec, axis: Lane) -> Lane:
    """v[axis], with an axis for each lane."""
    return ops.where(axis == 0, v[0], ops.where(axis == 1, v[1], v[2]))


@helper
def ordered_roots(a: Lane, b: Lane, c: Lane, discriminant: Lane) -> tuple[Lane, Lane]:
    """Roots of a t² - 2 b t + c = 0, lower first; NaN where the discriminant (b² - a c) is negative."""
    root = ops.sqrt(discriminant)
    q = ops.where(b < 0.0, b - root, b + root)
    far = q / a
    near = ops.where(q == 0.0, far, c / q)
    return ops.where(near < far, near, far), ops.where(near < far, far, near)


@helper
def plane_root(origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> Lane:
    """t of the plane y = 0. Only exactly parallel rays miss it; any other slope has a t, however large."""
    t = -origin[1] / direction[1]
    return ops.where((direction[1] != 0.0) & (t > t_min) & (t < t_max), t, INF)
