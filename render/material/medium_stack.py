"""Medium stack of rays: Beer-Lambert absorption and nested dielectrics.

A ray carries the media around it, up to four, seven bits each in one integer. Media are numbered by priority. Where shapes overlap, the
medium of the highest number fills the volume; a boundary that does not change it is ignored (Schmidt and Budge 2002, Simple Nested
Dielectrics in Ray Traced Images). So wine may overlap its glass, without a gap of air. The indices at a boundary are those of the highest
number on each side. Only scenes with glass that absorbs or has a priority compile this; elsewhere the stack is None, which is a type.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...materials import traits
from ...materials.contract import Lobes
from ..jit.kernel import helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops, row_gather
from ..simd.registration import overload
from ..types import Lane, Surface, Tables, Vec

IOR, ABSORPTION, PRIORITY = int(ir.Slot.IOR), int(ir.Slot.ABSORPTION), int(ir.Slot.PRIORITY)
BITS = 7
MASK = (1 << BITS) - 1  # also the most media of a scene
DEPTH = 4  # most media of a stack; beyond that, the oldest entry is dropped

F64 = NDArray[np.float64]


class Air(NamedTuple):
    """A scene without absorption and priorities."""


class Media(NamedTuple):
    """The media of a scene; row 0 is air."""

    number: NDArray[np.int64]  # (materials,) the medium that a material bounds, 0: none
    index: F64  # (media + 1,) index of refraction
    absorbed: F64  # (media + 1, 4) absorption coefficients per metre, and 0


def media(tables: ir.Tables, general: bool = False) -> Media | Air:
    """Return the media of a scene; without any Air, with `general` air alone.

    If there are more than MASK, those of lowest priority become air.
    """
    values = tables.materials.values
    glass = traits.has(tables, Lobes.GLASS)
    used = traits.used(tables)
    special = (values[:, ABSORPTION].max(axis=1, initial=0.0) > 0.0) | (values[:, PRIORITY, 0] > 0.0)
    if not (glass & used & special).any():
        return Media(np.zeros(len(glass), np.int64), np.ones(1), np.zeros((1, 4))) if general else Air()
    rows = np.flatnonzero(glass & used)
    rows = rows[np.argsort(values[rows, PRIORITY, 0], kind="stable")][-MASK:]
    number = np.zeros(len(glass), np.int64)
    number[rows] = np.arange(1, len(rows) + 1)
    index = np.concatenate([[1.0], values[rows, IOR, 0]])
    absorbed = np.zeros((len(rows) + 1, 4))
    absorbed[1:, :3] = values[rows, ABSORPTION]
    return Media(number, index, absorbed)


def is_used(tables: Any) -> bool:
    """Whether tables of this Numba type have media."""
    found = tables.field("materials.media") if isinstance(tables, HandleType) else None
    return found is not None and found[1] != ()


def initial_stack(tables: Tables, like: Lane) -> Any:
    """Return the stack of camera rays: air; None in scenes without media."""
    return ops.int_like(like, 0) if isinstance(getattr(tables.materials, "media", None), Media) else None


@overload(initial_stack)
def _outside_in_kernels(tables, like):
    if is_used(tables):
        return lambda tables, like: ops.int_like(like, 0)
    return lambda tables, like: None


# --- stack operations -----------------------------------------------------------------------------------------------------


@helper
def top(inside: Lane) -> Lane:
    """Return the number of the medium that fills the volume."""
    found = inside & MASK
    for k in range(1, DEPTH):
        found = ops.maximum(found, (inside >> (BITS * k)) & MASK)
    return found


@helper
def remove(inside: Lane, number: Lane) -> Lane:
    """Remove one entry of a medium."""
    found, gone = inside & 0, number < 0
    for k in range(DEPTH):
        entry = (inside >> (BITS * k)) & MASK
        out = ops.not_(gone) & (entry == number) & (number > 0)
        kept = ops.where(gone, entry << (BITS * max(k - 1, 0)), entry << (BITS * k))
        found = found | ops.where(out, 0, kept)
        gone = gone | out
    return found


@helper
def push(inside: Lane, number: Lane) -> Lane:
    """Push a medium."""
    return ((inside << BITS) & ((1 << (BITS * DEPTH)) - 1)) | number


# --- boundaries and absorption ------------------------------------------------------------------------------------------


@helper
def _relative_ior(inside: Lane, plain: Lane, tables: Tables, point: Surface) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1:
        return plain
    number = ops.to_int(table.number[point.material])
    rest = remove(inside, number)
    outer = ops.where(point.front, top(inside), top(rest))
    real = number > outer
    beside = plain / table.index[outer]
    return ops.where(number > 0, ops.where(real, beside, 1.0), plain)


@helper
def _is_ignored(inside: Lane, plain: Lane, tables: Tables, point: Surface) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1:
        return plain
    number = ops.to_int(table.number[point.material])
    outer = ops.where(point.front, top(inside), top(remove(inside, number)))
    return (number > 0) & (number <= outer)


@helper
def _cross_boundary(inside: Lane, plain: Any, tables: Tables, point: Surface, direction: Vec) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1:
        return inside
    number = ops.to_int(table.number[point.material])
    through = (ops.dot(direction, point.geometric) < 0.0) & (number > 0)
    return ops.where(through, ops.where(point.front, push(inside, number), remove(inside, number)), inside)


@helper
def _attenuate(inside: Lane, plain: Vec, tables: Tables, distance: Lane) -> Vec:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    if len(table.index) == 1:
        return plain
    number = top(inside)
    if ops.not_(ops.any_lane(number > 0)):
        return plain
    far = ops.where(number > 0, distance, 0.0)
    red, green, blue = row_gather.three_at(table.absorbed, number, 0)
    return (
        plain[0] * ops.exp(ops.maximum(-red * far, -80.0)), plain[1] * ops.exp(ops.maximum(-green * far, -80.0)),
        plain[2] * ops.exp(ops.maximum(-blue * far, -80.0)),
    )  # fmt: skip


# Each takes the stack of a ray, the result in scenes without media, and:
relative_ior = specialize_if_present(_relative_ior)  # (tables, point) → relative index at a boundary of index `plain`
is_ignored = specialize_if_present(_is_ignored)  # (tables, point) → whether a boundary is ignored
cross_boundary = specialize_if_present(_cross_boundary)  # (tables, point, direction) → stack of a ray that leaves a surface
attenuate = specialize_if_present(_attenuate)  # (tables, distance) → `plain` attenuated over a distance in metres
