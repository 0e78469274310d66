"""Evaluates the opacity of a surface at a point, 0 to 1."""

from __future__ import annotations

from ...compiler import ir
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Surface, Tables
from . import interaction, material_inputs

OPACITY = int(ir.Slot.OPACITY)


@helper
def opacity_at(tables: Tables, point: Surface) -> Lane:
    """Opacity of a surface at a point: 0 or 1 where its material has a threshold, otherwise the input's value.

    It is evaluated at points, not filtered over a pixel: rays that pass a surface of opacity 0 have no footprint, and a mean would be
    entirely above or below a threshold. The samples of a pixel give the mean.
    """
    threshold = tables.materials.threshold[point.material]
    value = ops.clip(material_inputs.number_of(tables, interaction.replace_spread(point, None), OPACITY), 0.0, 1.0)
    return ops.where(threshold > 0.0, ops.where(value >= threshold, 1.0, 0.0), value)
