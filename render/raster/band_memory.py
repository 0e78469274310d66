"""Memory that pictures of one scene are drawn in, one after another: getting it from the system takes long."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..integrator import whitted
from ..jit.packed_struct import Handle
from ..lanes import crosslane
from ..simd import aligned_empty
from . import band_buffer, deferred_shading, fragments, triangle_planes
from .shading_points import points_for

if TYPE_CHECKING:
    from .band_renderer import Pass, Triangles

PICTURE_BYTES = 1 << 26  # of pictures whose memory is kept; filling it takes as long as getting it
UNUSED = 2  # references to the memory of an array that only the array and the question itself hold


class BufferPool:
    """What nobody uses now."""

    def __init__(self) -> None:
        self._free: dict[Any, list[Any]] = {}
        self._pictures: list[NDArray[np.float32]] = []  # the last ones drawn, which others may still have

    def take(self, size: Any) -> Any:
        """A thing of this size; None if there is none."""
        try:
            return self._free[size].pop()
        except (KeyError, IndexError):
            return None

    def give(self, size: Any, thing: Any) -> None:
        """Keep a thing that is used no more."""
        self._free.setdefault(size, []).append(thing)

    def picture(self, shape: tuple[int, int, int]) -> NDArray[np.float32]:
        """Memory for a picture: that of an earlier one that nobody has any more, or new one, which is kept unless it is large."""
        for made in self._pictures:
            if made.shape == shape and sys.getrefcount(made.base) <= UNUSED:
                return made[:]
        made = aligned_empty(shape, np.float32)
        if made.nbytes <= PICTURE_BYTES:
            self._pictures[:] = [*self._pictures[-1:], made]
        return made[:]


class Size(NamedTuple):
    """What a thread's memory depends on."""

    columns: int
    rows: int
    samples: int
    plain: bool
    patterned: bool
    colored: bool
    meshlets: int


class BandMemory:
    """What a thread needs to draw a band."""

    def __init__(self, size: Size, options: Any) -> None:
        self.band = Handle(band_buffer.band_for(size.columns, size.rows, size.samples))
        self.items = Handle(fragments.items_for(size.columns, size.samples))
        most = 2 * self.items.tables.half
        self.faces = Handle(triangle_planes.faces_for(size.meshlets, most, size.patterned, size.colored)) if size.plain else None
        self.stack = None if size.plain else whitted.stack_for(options, crosslane.WIDTH)
        self.points = Handle(points_for(size.patterned, size.colored))
        self.filling: Any = None
        self.shading: Any = None
        self._turn: object = None
        self._pass: Pass | None = None
        self._drawn: Handle | None = None

    def serve(self, turn: object, made: Triangles, drawn: Handle, one: Pass) -> None:
        """Be of use to a pass of a picture from now on; `turn` stands for the picture, which is not kept."""
        if self.faces is not None and self._turn is not turn:
            triangle_planes.forget(self.faces.tables)
        if self._pass is not one:
            self._make(made, drawn, one)
        elif self._drawn is not drawn:
            for handle in (self.filling, self.shading):
                if handle is not None:
                    handle.point("drawn", drawn)
        self._turn, self._pass, self._drawn = turn, one, drawn

    def _make(self, made: Triangles, drawn: Handle, one: Pass) -> None:
        self.filling = Handle(band_buffer.Filling(made.shown, one.places, made.meshlets, drawn, self.band))
        if self.faces is not None:
            self.shading = Handle(deferred_shading.Shading(
                made.shown, one.places, made.meshlets, drawn, made.lit, made.lamps, made.look, one.weights, self.band, self.faces,
                self.items, self.points,
            ))  # fmt: skip
