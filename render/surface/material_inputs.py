"""Evaluates material inputs at a point: a constant times a texture."""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper
from ..lanes import ops, row_gather
from ..texture import textures
from ..types import Lane, Surface, Tables, Vec


@helper
def color_of(tables: Tables, surface: Surface, slot: int) -> Vec:
    """A color input: its constant times its texture, if it has one."""
    color = ops.like3(surface.offset, *row_gather.three_at(tables.materials.values, surface.material, 3 * slot))
    return _textured(tables, surface, surface.uv, slot, color)


@helper
def _textured(tables: Tables, surface: Surface, uv: Any, slot: int, color: Vec) -> Vec:
    """A color times a slot's texture; not compiled for surfaces without coordinates (None)."""
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
    """A scalar input."""
    return color_of(tables, surface, slot)[0]
