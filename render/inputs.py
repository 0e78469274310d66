"""A material's inputs at a point: constants times textures."""

from __future__ import annotations

from . import lanes, textures
from .kernels import helper
from .records import Lane, Surface, Tables, Vec


@helper
def color_of(tables: Tables, surface: Surface, slot: int) -> Vec:
    """A material input: its constant times its texture, if it has one."""
    m = surface.material
    zero = lanes.full_like(surface.offset, 0.0)
    red, green, blue = lanes.three_at(tables.materials.values, m, 3 * slot)
    color = (red + zero, green + zero, blue + zero)
    if len(tables.textures.kind) > 0:
        texture = tables.materials.textures[m, slot]
        textured = texture >= 0
        if lanes.any_lane(textured):
            color = lanes.where3(textured, lanes.mul(color, textures.value(tables, texture, surface)), color)
    return color


@helper
def number_of(tables: Tables, surface: Surface, slot: int) -> Lane:
    """An input that is a number."""
    return color_of(tables, surface, slot)[0]
