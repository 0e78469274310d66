"""Lowers light meters: each becomes an ir.Meter, which no table of the scene holds."""

from __future__ import annotations

import math

import numpy as np

from ...lang.elements import Element
from ...lights.rectangle import EVEN
from .. import ir
from ..scene import transforms
from .context import Context
from .lights import rigid

MOST_CELLS = 512  # along an edge


def meter(lowering: Context, element: Element, block: np.ndarray, path: str) -> ir.Meter | None:
    """The meter of an element in a block with the matrix `block`; None after a diagnostic."""
    args = element.args
    name = path + (args["name"] or element.scope or "meter")
    if args["on"] is not None:
        identity = tuple(map(tuple, np.eye(4).tolist()))
        if not args["on"]:
            lowering.refuse(element, "`on` names no object", 'write on: ["floor"]')
            return None
        return ir.Meter(name, identity, on=tuple(args["on"]), back=args["side"] == "back", place=element.place)
    if "side" in element.given:
        lowering.refuse(element, "`side` goes with `on`: a rectangle receives light from where it faces", "write facing instead")
        return None
    frame = transforms.facing(args["center"], args["facing"], args["up"])
    if frame is None:
        lowering.refuse(element, "the meter faces no direction: `facing` is 0", "write facing: [0, 1, 0]")
        return None
    if transforms.inverse(block) is None:
        lowering.refuse(element, "the block around this meter flattens it to nothing", "a scale must not be 0")
        return None
    frame, scale, even = rigid(block @ frame)
    sides = args["size"]
    if sides is None:
        if args["grid"] is not None:
            lowering.refuse(element, "a meter at a point has no grid", "give it a size: [2, 1]")
            return None
        return ir.Meter(name, _rows(frame), place=element.place)
    if not even:
        lowering.refuse(element, "the block around it skews this meter: it is not a rectangle", "use an even scale, or turn the meter")
        return None
    size = (sides[0] * float(scale[0]), sides[1] * float(scale[2]))
    cells = args["grid"] or standard_grid(size)
    if max(cells) > MOST_CELLS:
        lowering.refuse(element, f"a grid of {cells[0]} by {cells[1]} cells is too fine", f"at most {MOST_CELLS} each way")
        return None
    return ir.Meter(name, _rows(frame), size, cells, place=element.place)


def standard_grid(size: tuple[float, float]) -> tuple[int, int]:
    """Cells of a rectangle of this size in metres, of at most p = 0.2 · 5^(log10 d), d the longer edge (EN 12464-1, 4.4).

    Long rectangles have d of their shorter edge.
    """
    longer, shorter = max(size), min(size)
    d = longer if longer < 2.0 * shorter else shorter
    p = 0.2 * 5.0 ** math.log10(d)
    x, z = (min(max(math.ceil(side / p * (1.0 - EVEN)), 1), MOST_CELLS) for side in size)
    return x, z


def _rows(frame: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, frame.tolist()))
