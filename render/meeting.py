"""Where rays meet one shape that is no mesh, in kernels: by its closed form, or, of a formula, by what `link` told the trees of."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from ..compiler import ir
from . import across, lanes, shapes
from .formulas.forms import MET, TORUS
from .handles import Handle
from .kernels import helper
from .links import FLOAT, INT, VEC, Answering, Promised
from .records import Lane, Vec

FORMULA = int(ir.GeometryKind.FORMULA)
AFTER = 8.0 * 2.0**-52  # of the largest coordinate and for each unit of a meeting's spacing: how far on the next meeting may be


def link(accel: Handle) -> None:
    """Compile or load what meets formula surfaces, and rare shapes, where a scene has any; others do neither."""
    if (accel.tables.placed[:, 3] > shapes.PLANE).any():
        accel.put("rare", rare.link(accel.part("parameters"), types.int64, types.int64, VEC, VEC, FLOAT, FLOAT))
    if len(accel.tables.forms.places):
        accel.put("meet", _formulas(accel))


def _formulas(accel: Handle) -> int:
    """The address of what meets formula surfaces: of the two ways, what there are surfaces for."""
    parts, given = accel.tables.forms.parts, (accel.part("forms"), types.int64, VEC, VEC, FLOAT, FLOAT)
    closed = parts.places[:, 1] > 0
    if not closed.any():
        from .formulas import meet

        return meet.meet.link(*given)
    from .formulas import exact

    if (parts.kinds >= TORUS).any():
        parts.ways[2] = exact.crossings.link(accel.part("forms.parts.numbers"), types.int64, VEC, VEC)
    parts.ways[0] = exact.met.link(*given)
    if closed.all():
        return int(parts.ways[0])
    from .formulas import meet

    parts.ways[1] = meet.meet.link(*given)
    return exact.either.link(*given)


def _rare(parameters, kind, g, o, d, t_min, t_max):
    t, part = shapes.rare(kind, parameters, g, o, d, t_min, t_max)
    return t, lanes.int_like(t, 0) + part


call_meet = Promised(MET).call
rare = Answering(_rare, (FLOAT, INT))
call_rare = rare.call


@helper
def shape(accel: Any, kind: int, g: int, o: Vec, d: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(t, primitive, u, v) of the first meeting of rays with shape g in its own frame, as records.Hit has them."""
    zero = lanes.full_like(t_min, 0.0)
    if kind == FORMULA:
        t, spacing, u, v, _ = call_meet(accel.meet, (accel.forms, np.int64(g), o, d, t_min, t_max))  # pyright: ignore[reportCallIssue]
        return t, spacing, u, v
    if kind > shapes.PLANE:
        t, part = call_rare(accel.rare, (accel.parameters, np.int64(kind), np.int64(g), o, d, t_min, t_max))  # pyright: ignore[reportCallIssue]
        return t, part, zero, zero
    t, part = shapes.usual(kind, accel.parameters, g, o, d, t_min, t_max)
    return t, lanes.int_like(zero, 0) + part, zero, zero


@helper
def formula(accel: Any, g: int, o: Vec, d: Vec, t_min: Any, t_max: Any) -> tuple[Any, Any, Any, Any, Any]:
    """(t, primitive, u, v, where the next meeting may be) of the first meeting of one ray, of numbers, with a formula's surface."""
    zero = 0.0 * lanes.to_float(across.numbered(0))
    way, begin = lanes.like3(zero, d[0], d[1], d[2]), lanes.full_like(zero, t_min)
    start, end = lanes.like3(zero, o[0], o[1], o[2]), lanes.full_like(zero, t_max)
    t, spacing, u, v, _ = call_meet(accel.meet, (accel.forms, np.int64(g), start, way, begin, end))  # pyright: ignore[reportCallIssue]
    first, units = across.lane(t, 0), across.lane(spacing, 0)
    return first, np.int64(units), across.lane(u, 0), across.lane(v, 0), after(accel.parameters[g, 5], d, first, units)


@helper
def after(reach: Any, d: Vec, t: Lane, spacing: Lane) -> Lane:
    """Where the next meeting of rays with a formula's surface may be; `reach` is its largest coordinate, d is in its own frame."""
    return t + AFTER * (t + reach / lanes.maximum(lanes.length(d), 1e-300) * (spacing + 8.0))
