"""Opacity: how much of a surface is there, 0 to 1, at each of its points."""

from __future__ import annotations

from ..compiler import ir
from . import inputs, lanes
from .kernels import helper
from .records import Lane, Surface, Tables

OPACITY = int(ir.Slot.OPACITY)


@helper
def at(tables: Tables, point: Surface) -> Lane:
    """How much of a surface is there at a point: 0 or 1 where its material has a threshold, else as much as that says."""
    value = lanes.clip(inputs.number_of(tables, point, OPACITY), 0.0, 1.0)
    threshold = tables.materials.threshold[point.material]
    return lanes.where(threshold > 0.0, lanes.where(value >= threshold, 1.0, 0.0), value)
