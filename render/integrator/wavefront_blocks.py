"""Tiles drawn block by block: waves of paths that the pixels of a block share, see reuse.py."""

from __future__ import annotations

from .. import simd
from ..jit.kernel import helper, kernel
from ..lanes.soa import ROW, SIZE
from . import wavefront
from .path_reuse import BLOCK, SIDE


@helper
def _counted(of, x, y, tile):
    """What all pixels have of the block that begins at x, y."""
    return of[max(y - tile.y0, 0), max(x - tile.x0, 0)]


@kernel
def draw_tile(accel, scene, frame, tile, first, count, total, film, room):
    """As waves.draw_tile, where all pixels of a block have the same first sample and count.

    Blocks are the picture's, whatever the tile: what of them lies outside of it is drawn for the others' sake.
    """
    saved = simd.flush_denormals()
    filled = 0
    width = tile.x1 - tile.x0
    for y in range(tile.y0 // SIDE * SIDE, tile.y1, SIDE):
        for x in range(tile.x0 // SIDE * SIDE, tile.x1, SIDE):
            begin, more = _counted(first, x, y, tile), _counted(count, x, y, tile)
            for s in range(begin, begin + more):
                for k in range(BLOCK):
                    column, row = x + k % SIDE - tile.x0, y + k // SIDE - tile.y0
                    inside = (column >= 0) & (column < width) & (row >= 0) & (row < tile.y1 - tile.y0)
                    room.items[filled], room.items[ROW + filled] = tile.x0 + column, tile.y0 + row
                    room.items[2 * ROW + filled], room.items[3 * ROW + filled] = s, row * width + column if inside else -1
                    filled += 1
                if filled == SIZE:
                    filled = wavefront.render_wave(accel, scene, frame, total, film, room, filled, width)
    wavefront.render_wave(accel, scene, frame, total, film, room, filled, width)
    simd.restore_denormals(saved)
