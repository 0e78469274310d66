"""A material's inputs at a point: constants times textures."""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper
from ..lanes import ops, row_gather
from ..texture import textures
from ..types import Lane, Surface, Tables, Vec


@helper
def color_of(tables: Tables, surface: Surface, slot: int) -> Vec:
    """A material input: its constant times its texture, if it has one."""
    color = ops.like3(surface.offset, *row_gather.three_at(tables.materials.values, surface.material, 3 * slot))
    return _patterned(tables, surface, surface.uv, slot, color)


@helper
def _patterned(tables: Tables, surface: Surface, uv: Any, slot: int, color: Vec) -> Vec:
    """A colour times a slot's texture; surfaces without coordinates (None) have none, and nothing of this is compiled for them."""
    if uv is None:
        return color
    if len(tables.textures.kind) > 0:
        texture = tables.materials.textures[surface.material, slot]
        textured = texture >= 0
        if ops.any_lane(textured):
            color = ops.where3(textured, ops.mul(color, textures.value(tables, texture, surface)), color)
    return color


@helper
def number_of(tables: Tables, surface: Surface, slot: int) -> Lane:
    """An input that is a number."""
    return color_of(tables, surface, slot)[0]
