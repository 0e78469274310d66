"""Buffers for bands and pictures, and the pool from which later pictures of a scene reuse them."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..integrator import ray_stack
from ..jit.packed_struct import Handle
from ..lanes import crosslane
from ..simd import aligned_empty
from . import band_buffer, deferred_shading, fragments, integrator_shading, triangle_planes
from .passes import Pass
from .shading_points import point_buffer

PICTURE_BYTES = 1 << 26  # the largest picture to reuse: beyond, filling memory takes as long as allocating it
UNUSED = 2  # references to an array that only its owner and the test itself hold


class BufferPool:
    """Free buffers by key, and the last pictures. Each method is atomic under Python's lock."""

    def __init__(self) -> None:
        self._free: dict[Any, list[Any]] = {}
        self._pictures: list[NDArray[np.float32]] = []  # the last ones; callers may still hold them

    def take(self, key: Any) -> Any:
        """Remove and return a free buffer; None if there is none."""
        try:
            return self._free[key].pop()
        except (KeyError, IndexError):
            return None

    def give(self, key: Any, buffer: Any) -> None:
        """Add a free buffer."""
        self._free.setdefault(key, []).append(buffer)

    def picture(self, shape: tuple[int, int, int]) -> NDArray[np.float32]:
        """An uninitialized picture: an earlier one that nobody references, or a new one."""
        for picture in self._pictures:
            if picture.shape == shape and sys.getrefcount(picture.base) <= UNUSED:
                return picture[:]
        picture = aligned_empty(shape, np.float32)
        if picture.nbytes <= PICTURE_BYTES:
            self._pictures[:] = [*self._pictures[-1:], picture]
        return picture[:]


class BufferSize(NamedTuple):
    """The sizes that a thread's buffers depend on."""

    columns: int
    rows: int
    samples: int
    float32: bool  # deferred shading in float32, else the integrator
    textured: bool
    colored: bool
    meshlets: int


class BandMemory:
    """Buffers of one thread, and the arguments of the kernels that fill and shade a band."""

    def __init__(self, size: BufferSize, options: Any) -> None:
        self.band = Handle(band_buffer.band_buffer(size.columns, size.rows, size.samples))
        self.fragments = Handle(fragments.fragment_buffer(size.columns, size.samples))
        most = 2 * self.fragments.tables.half
        self.planes = Handle(triangle_planes.plane_cache(size.meshlets, most, size.textured, size.colored)) if size.float32 else None
        self.stack = ray_stack.stack_for(options, crosslane.WIDTH) if self.planes is None else None
        self.points = Handle(point_buffer(size.textured, size.colored))
        self.filling: Any = None
        self.shading: Any = None
        self._picture: object = None
        self._pass: Pass | None = None
        self._visible: Handle | None = None

    def bind(self, picture: object, prepared: Any, visible: Handle, raster_pass: Pass) -> None:
        """Set the kernels' arguments for a pass of a picture; `picture` is a token of the picture, compared by identity."""
        if self.planes is not None and self._picture is not picture:
            triangle_planes.clear(self.planes.tables)
        if self._pass is not raster_pass:
            self._bind_pass(prepared, visible, raster_pass)
        elif self._visible is not visible:
            for handle in (self.filling, self.shading):
                handle.point("visible", visible)
        self._picture, self._pass, self._visible = picture, raster_pass, visible

    def _bind_pass(self, prepared: Any, visible: Handle, raster_pass: Pass) -> None:
        scene = prepared.raster
        self.filling = Handle(band_buffer.Filling(scene.projection, raster_pass.places, scene.meshlets, visible, self.band))
        if self.planes is not None:
            self.shading = Handle(deferred_shading.Shading(
                scene.projection, raster_pass.places, scene.meshlets, visible, scene.shading_tables, scene.sources, scene.rays,
                raster_pass.weights,
                self.band, self.planes, self.fragments, self.points,
            ))  # fmt: skip
        elif self.stack is not None:
            self.shading = Handle(integrator_shading.IntegratorShading(
                scene.model, raster_pass.places, scene.meshlets, visible, prepared.packed, prepared.accel, prepared.vertex_light,
                prepared.frame,
                raster_pass.weights, self.band, self.fragments, self.stack,
            ))  # fmt: skip
