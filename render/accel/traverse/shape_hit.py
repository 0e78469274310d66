"""Ray intersection of single analytic shapes and formula surfaces, in kernels."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....compiler import ir
from ...formula.tables import HIT, TORUS
from ...geometry import analytic_shapes
from ...jit.function_pointer import DeclaredKernel, DeclaredPointer
from ...jit.kernel import helper
from ...jit.packed_struct import Handle
from ...jit.value_types import INT64
from ...lanes import crosslane, ops
from ...lanes.kinds import FLOAT, INT, VEC
from ...types import Lane, Vec
from ..bvh_build.scene_layout import KIND

FORMULA = int(ir.GeometryKind.FORMULA)
AFTER = 8.0 * 2.0**-52  # distance to the next hit, relative to the largest coordinate and per unit of a hit's spacing


def link(accel: Handle) -> None:
    """Compile or load the kernels for formula surfaces and rare shapes where the scene has any; store their addresses."""
    if (accel.tables.instance_rows[:, KIND] > analytic_shapes.PLANE).any():
        accel.put("rare_kernel", rare.link(accel.part("parameters"), INT64, INT64, VEC, VEC, FLOAT, FLOAT))
    if len(accel.tables.forms.places):
        accel.put("formula_kernel", _link_formulas(accel))


def _link_formulas(accel: Handle) -> int:
    """Link the formula kernels that the scene needs, by closed form or by search; return the address of their entry."""
    parts, argument_types = accel.tables.forms.parts, (accel.part("forms"), INT64, VEC, VEC, FLOAT, FLOAT)
    closed = parts.places[:, 1] > 0
    if not closed.any():
        from ...formula import intersect

        return intersect.first_hit.link(*argument_types)
    from ...formula import closed_form_hits

    if (parts.kinds >= TORUS).any():
        parts.kernels[2] = closed_form_hits.crossings.link(accel.part("forms.parts.numbers"), INT64, VEC, VEC)
    parts.kernels[0] = closed_form_hits.first_hit.link(*argument_types)
    if closed.all():
        return int(parts.kernels[0])
    from ...formula import intersect

    parts.kernels[1] = intersect.first_hit.link(*argument_types)
    return closed_form_hits.dispatch_hit.link(*argument_types)


def _rare(parameters, kind, g, o, d, t_min, t_max):
    t, part = analytic_shapes.rare(kind, parameters, g, o, d, t_min, t_max)
    return t, ops.int_like(t, 0) + part


call_formula = DeclaredPointer(HIT).call
rare = DeclaredKernel(_rare, (FLOAT, INT))
call_rare = rare.call


@helper
def intersect_shape(accel: Any, kind: int, g: int, o: Vec, d: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(t, primitive, u, v) of the first hits of rays with shape g in its own frame, as in types.Hit."""
    zero = ops.full_like(t_min, 0.0)
    if kind == FORMULA:
        t, spacing, u, v, _ = call_formula(accel.formula_kernel, (accel.forms, np.int64(g), o, d, t_min, t_max))  # pyright: ignore[reportCallIssue]
        return t, spacing, u, v
    if kind > analytic_shapes.PLANE:
        t, part = call_rare(accel.rare_kernel, (accel.parameters, np.int64(kind), np.int64(g), o, d, t_min, t_max))  # pyright: ignore[reportCallIssue]
        return t, part, zero, zero
    t, part = analytic_shapes.usual(kind, accel.parameters, g, o, d, t_min, t_max)
    return t, ops.int_like(zero, 0) + part, zero, zero


@helper
def intersect_formula(accel: Any, g: int, o: Vec, d: Vec, t_min: Any, t_max: Any) -> tuple[Any, Any, Any, Any, Any]:
    """(t, primitive, u, v, smallest t of a next hit) of the first hit of one scalar ray with a formula surface."""
    zero = 0.0 * ops.to_float(crosslane.lane_indices(0))
    way, begin = ops.like3(zero, d[0], d[1], d[2]), ops.full_like(zero, t_min)
    start, end = ops.like3(zero, o[0], o[1], o[2]), ops.full_like(zero, t_max)
    t, spacing, u, v, _ = call_formula(accel.formula_kernel, (accel.forms, np.int64(g), start, way, begin, end))  # pyright: ignore[reportCallIssue]
    first, units = crosslane.lane(t, 0), crosslane.lane(spacing, 0)
    return first, np.int64(units), crosslane.lane(u, 0), crosslane.lane(v, 0), next_t(accel.parameters[g, 5], d, first, units)


@helper
def next_t(reach: Any, d: Vec, t: Lane, spacing: Lane) -> Lane:
    """Smallest t of the next hit with a formula surface of largest coordinate `reach`; d is in its own frame."""
    return t + AFTER * (t + reach / ops.maximum(ops.length(d), 1e-300) * (spacing + 8.0))
