"""Wavefront path tracing block by block, for path reuse."""

from __future__ import annotations

from .. import simd
from ..jit.kernel import helper, kernel
from ..lanes.soa import ROW, SIZE
from . import wavefront
from .path_reuse import BLOCK, SIDE


@helper
def _of_block(of, x, y, tile):
    """The entry of the block at x, y, equal for all of its pixels."""
    return of[max(y - tile.y0, 0), max(x - tile.x0, 0)]


@kernel
def draw_tile(accel, scene, frame, tile, first, count, total, film, memory):
    """As wavefront.draw_tile, for equal first samples and counts of all pixels of a block.

    Blocks are those of the picture's grid; their pixels outside the tile are traced for path reuse alone.
    """
    saved = simd.flush_denormals()
    filled = 0
    width = tile.x1 - tile.x0
    for y in range(tile.y0 // SIDE * SIDE, tile.y1, SIDE):
        for x in range(tile.x0 // SIDE * SIDE, tile.x1, SIDE):
            begin, more = _of_block(first, x, y, tile), _of_block(count, x, y, tile)
            for s in range(begin, begin + more):
                for k in range(BLOCK):
                    column, row = x + k % SIDE - tile.x0, y + k // SIDE - tile.y0
                    inside = (column >= 0) & (column < width) & (row >= 0) & (row < tile.y1 - tile.y0)
                    memory.items[filled], memory.items[ROW + filled] = tile.x0 + column, tile.y0 + row
                    memory.items[2 * ROW + filled], memory.items[3 * ROW + filled] = s, row * width + column if inside else -1
                    filled += 1
                if filled == SIZE:
                    filled = wavefront.render_wave(accel, scene, frame, total, film, memory, filled, width)
    wavefront.render_wave(accel, scene, frame, total, film, memory, filled, width)
    simd.restore_denormals(saved)
