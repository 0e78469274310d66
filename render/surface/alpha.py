"""Opacity: how much of a surface is there, 0 to 1, at each of its points."""

from __future__ import annotations

from ...compiler import ir
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Surface, Tables
from . import interaction, material_inputs

OPACITY = int(ir.Slot.OPACITY)


@helper
def at(tables: Tables, point: Surface) -> Lane:
    """How much of a surface is there at a point: 0 or 1 where its material has a threshold, else as much as that says.

    It is looked at in points, never in the mean over a pixel: rays go on where it is 0, which they find without a pixel about them, and a
    mean would be all above a threshold, or all below. A picture's samples find the mean.
    """
    threshold = tables.materials.threshold[point.material]
    value = ops.clip(material_inputs.number_of(tables, interaction.spanning(point, None), OPACITY), 0.0, 1.0)
    return ops.where(threshold > 0.0, ops.where(value >= threshold, 1.0, 0.0), value)
