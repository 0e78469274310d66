"""Memory of one thread for a band, reused by later bands and pictures."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..integrator import whitted
from ..jit.packed_struct import Handle
from ..lanes import crosslane
from . import band_buffer, deferred_shading, fragments, triangle_planes
from .passes import Pass
from .raster_scene import RasterScene
from .shading_points import points_for


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

    def serve(self, turn: object, scene: RasterScene, drawn: Handle, one: Pass) -> None:
        """Be of use to a pass of a picture from now on; `turn` stands for the picture, which is not kept."""
        if self.faces is not None and self._turn is not turn:
            triangle_planes.forget(self.faces.tables)
        if self._pass is not one:
            self._make(scene, drawn, one)
        elif self._drawn is not drawn:
            for handle in (self.filling, self.shading):
                if handle is not None:
                    handle.point("drawn", drawn)
        self._turn, self._pass, self._drawn = turn, one, drawn

    def _make(self, scene: RasterScene, drawn: Handle, one: Pass) -> None:
        self.filling = Handle(band_buffer.Filling(scene.shown, one.places, scene.meshlets, drawn, self.band))
        if self.faces is not None:
            self.shading = Handle(deferred_shading.Shading(
                scene.shown, one.places, scene.meshlets, drawn, scene.lit, scene.lamps, scene.look, one.weights, self.band, self.faces,
                self.items, self.points,
            ))  # fmt: skip
