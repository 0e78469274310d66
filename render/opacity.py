"""Opacity: how much of a surface is there, 0 to 1, at each of its points."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import overload

from ..compiler import ir
from . import inputs, lanes, surface
from .kernels import HELPER, helper
from .records import Lane, Surface, Tables

OPACITY = int(ir.Slot.OPACITY)


@helper
def at(tables: Tables, point: Surface) -> Lane:
    """How much of a surface is there at a point: 0 or 1 where its material has a threshold, else as much as that says.

    What has one is looked at in points: where a pixel spans much of a texture its mean would be all above the threshold, or all below.
    """
    threshold = tables.materials.threshold[point.material]
    cut = threshold > 0.0
    value = lanes.clip(inputs.number_of(tables, surface.spanning(point, _none_of(point.spread, cut)), OPACITY), 0.0, 1.0)
    return lanes.where(cut, lanes.where(value >= threshold, 1.0, 0.0), value)


def _none_of(spread: Any, cut: Lane) -> Any:
    """Surface.spread with nothing in the lanes of a mask."""
    return None if spread is None else tuple(lanes.where(cut, 0.0, s) for s in spread)


@overload(_none_of, jit_options=HELPER)
def _none_of_in_kernels(spread, cut):
    if isinstance(spread, types.NoneType):
        return lambda spread, cut: None
    if len(spread) == 4:
        return lambda spread, cut: _four(spread, cut)
    return lambda spread, cut: (
        *_four(spread, cut), *lanes.where3(cut, _NOWHERE, spread[4:7]), *lanes.where3(cut, _NOWHERE, spread[7:10])
    )  # fmt: skip


_NOWHERE = (0.0, 0.0, 0.0)


@helper
def _four(spread: Any, cut: Lane) -> Any:
    a, b, c, d = spread[0], spread[1], spread[2], spread[3]
    return lanes.where(cut, 0.0, a), lanes.where(cut, 0.0, b), lanes.where(cut, 0.0, c), lanes.where(cut, 0.0, d)
