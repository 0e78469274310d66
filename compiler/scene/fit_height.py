"""The transform that gives shapes a height: scaled evenly, as they are rotated, with their base at the origin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...shapes import SHAPES
from .. import ir
from . import transforms
from .builder import SceneBuilder

Kind = ir.GeometryKind


class Placed(NamedTuple):
    """A geometry (a row of the builder) and the transforms (n, 4, 4) of its copies."""

    geometry: int
    matrices: np.ndarray


def fitted(builder: SceneBuilder, shapes: Sequence[Placed], height: float, rotation: np.ndarray | None = None) -> np.ndarray | None:
    """(4, 4) transform F of shapes that are rotated afterwards by `rotation` (4, 4), so that rotation · F has the height and its base at 0.

    The middle of the bounds of the shapes before the rotation is above the origin, so that a turn about y moves nothing.
    None for shapes without a height, or of no bounds.
    """
    turned = np.eye(4) if rotation is None else rotation
    axes = np.eye(3)
    with np.errstate(invalid="ignore", over="ignore"):
        middle = [(_reach(builder, shapes, axis) - _reach(builder, shapes, -axis)) / 2 for axis in axes]
        up = turned[1, :3]
        top, base = _reach(builder, shapes, up), -_reach(builder, shapes, -up)
    if not (math.isfinite(top - base) and np.isfinite(middle).all()) or not top > base:
        return None
    x, _, z = turned[:3, :3] @ np.array(middle)
    factor = height / (top - base)
    fit = transforms.scaling((factor,) * 3) @ transforms.translation((-float(x), -base, -float(z)))
    return np.asarray(turned.T @ fit @ turned)


def _reach(builder: SceneBuilder, shapes: Sequence[Placed], direction: np.ndarray) -> float:
    """The largest coordinate of the shapes along a direction (3,)."""
    reach = -math.inf
    for geometry, matrices in shapes:
        kind, parameters, bounds, _ = builder.shape(geometry)
        forms, offsets = direction @ matrices[:, :3, :3], matrices[:, :3, 3] @ direction
        ends = forms[:, None] * bounds
        most = np.where(forms == 0, 0.0, ends.max(axis=1)).sum(axis=1) + offsets
        points = builder.triangles(geometry)[0] if kind == Kind.MESH else None
        for k in np.argsort(-most):
            if not most[k] > reach:
                break  # nor do the boxes of the others reach farther
            farthest = _support(kind, parameters, forms[k]) if points is None else float((points @ forms[k]).max())
            reach = max(reach, float(most[k]) if farthest is None else farthest + float(offsets[k]))
    return reach


def _support(kind: ir.GeometryKind, p: tuple[float, ...], form: np.ndarray) -> float | None:
    """The largest value of a linear form (3,) on an analytic shape; None where its box tells it, or no closed form does."""
    shape = SHAPES.get(kind)
    return None if shape is None or shape.support is None else shape.support(p, form)
