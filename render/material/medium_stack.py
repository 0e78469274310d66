"""What light goes through inside of things: Beer and Lambert's law, and dielectrics one within another.

A ray carries the media that it is in, up to four, seven bits each in one whole number. Media are numbered by their priority: where
things overlap, the medium of the highest number is there, and a boundary that does not change which that is, is none (Schmidt and Budge
2002, Simple Nested Dielectrics in Ray Traced Images): wine may stand a little into its glass, without a gap of air. So a boundary's
indices are those of the highest number on each side. Only scenes with glass that absorbs or has a priority compile any of this: the
number that elsewhere stands for the media of a ray is None, which is a type.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_facts
from ..jit.kernel import HELPER, helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops, row_gather
from ..types import Lane, Surface, Tables, Vec

GLASS = int(ir.MaterialModel.GLASS)
IOR, ABSORPTION, PRIORITY = int(ir.Slot.IOR), int(ir.Slot.ABSORPTION), int(ir.Slot.PRIORITY)
BITS = 7
MASK = (1 << BITS) - 1  # the most media of a scene, too
DEPTH = 4  # media that a ray may be in at once; of more, the one that would be entered last counts as not entered

F64 = NDArray[np.float64]


class Air(NamedTuple):
    """Nothing absorbs, and no glass has a priority."""


class Media(NamedTuple):
    """The media of a scene; row 0 is the air around all."""

    number: NDArray[np.int64]  # (materials,) the medium that a material bounds, 0: none
    index: F64  # (media + 1,) index of refraction
    absorbed: F64  # (media + 1, 4) share per metre, natural logarithm; 0 at the end


def media(tables: ir.Tables) -> Media | Air:
    """What kernels read of a scene's media. Beyond MASK of them, those of the lowest priority are air."""
    values = tables.materials.values
    glass = tables.materials.model == GLASS
    used = scene_facts.used_materials(tables)
    special = (values[:, ABSORPTION].max(axis=1, initial=0.0) > 0.0) | (values[:, PRIORITY, 0] > 0.0)
    if not (glass & used & special).any():
        return Air()
    rows = np.flatnonzero(glass & used)
    rows = rows[np.argsort(values[rows, PRIORITY, 0], kind="stable")][-MASK:]
    number = np.zeros(len(glass), np.int64)
    number[rows] = np.arange(1, len(rows) + 1)
    index = np.concatenate([[1.0], values[rows, IOR, 0]])
    absorbed = np.zeros((len(rows) + 1, 4))
    absorbed[1:, :3] = values[rows, ABSORPTION]
    return Media(number, index, absorbed)


def is_used(tables: Any) -> bool:
    """Whether kernels' tables of this Numba type have media."""
    found = tables.field("materials.media") if isinstance(tables, HandleType) else None
    return found is not None and found[1] != ()


def outside(tables: Tables, like: Lane) -> Any:
    """What rays are in where they begin: the air; None in scenes without media."""
    return ops.int_like(like, 0) if isinstance(getattr(tables.materials, "media", None), Media) else None


@overload(outside, jit_options=HELPER)
def _outside_in_kernels(tables, like):
    if is_used(tables):
        return lambda tables, like: ops.int_like(like, 0)
    return lambda tables, like: None


# --- the list of media ---------------------------------------------------------------------------------------------------


@helper
def highest(inside: Lane) -> Lane:
    """The number of the medium that is there."""
    found = inside & MASK
    for k in range(1, DEPTH):
        found = ops.maximum(found, (inside >> (BITS * k)) & MASK)
    return found


@helper
def without(inside: Lane, number: Lane) -> Lane:
    """The list with one entry of a medium taken out; the others close up."""
    found, gone = inside & 0, number < 0
    for k in range(DEPTH):
        entry = (inside >> (BITS * k)) & MASK
        out = ops.not_(gone) & (entry == number) & (number > 0)
        kept = ops.where(gone, entry << (BITS * max(k - 1, 0)), entry << (BITS * k))
        found = found | ops.where(out, 0, kept)
        gone = gone | out
    return found


@helper
def added(inside: Lane, number: Lane) -> Lane:
    """The list with a medium put in front."""
    return ((inside << BITS) & ((1 << (BITS * DEPTH)) - 1)) | number


# --- what surfaces and ways ask ------------------------------------------------------------------------------------------


@helper
def _ratio(inside: Lane, plain: Lane, tables: Tables, point: Surface) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    number = ops.to_int(table.number[point.material])
    rest = without(inside, number)
    around = ops.where(point.front, highest(inside), highest(rest))
    real = number > around
    beside = plain / table.index[around]
    return ops.where(number > 0, ops.where(real, beside, 1.0), plain)


@helper
def _hidden(inside: Lane, plain: Lane, tables: Tables, point: Surface) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    number = ops.to_int(table.number[point.material])
    around = ops.where(point.front, highest(inside), highest(without(inside, number)))
    return (number > 0) & (number <= around)


@helper
def _crossed(inside: Lane, plain: Any, tables: Tables, point: Surface, direction: Vec) -> Lane:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    number = ops.to_int(table.number[point.material])
    through = (ops.dot(direction, point.geometric) < 0.0) & (number > 0)
    return ops.where(through, ops.where(point.front, added(inside, number), without(inside, number)), inside)


@helper
def _faded(inside: Lane, plain: Vec, tables: Tables, distance: Lane) -> Vec:
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    number = highest(inside)
    if ops.not_(ops.any_lane(number > 0)):
        return plain
    far = ops.where(number > 0, distance, 0.0)
    red, green, blue = row_gather.three_at(table.absorbed, number, 0)
    return (
        plain[0] * ops.exp(ops.maximum(-red * far, -80.0)), plain[1] * ops.exp(ops.maximum(-green * far, -80.0)),
        plain[2] * ops.exp(ops.maximum(-blue * far, -80.0)),
    )  # fmt: skip


# Each takes the media of a ray, what it would be without media, and:
ratio = specialize_if_present(_ratio)  # index inside over outside that counts at a boundary of index `plain`: tables, point
hidden = specialize_if_present(_hidden)  # whether a boundary is none: tables, point
crossed = specialize_if_present(_crossed)  # the media of a ray that leaves a surface: tables, point, direction
faded = specialize_if_present(_faded)  # `plain` after a distance in metres: tables, distance
