"""Draws tiles of the `ray` backend in scenes with formulas: packets find the hits of a tile's camera rays before it is shaded."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..accel.formula_packets.camera_rays import CameraPackets, ThreadMemory, trace_tile
from ..film.tile_queue import CALL, COUNTS, FILM, TILE, TileKernel
from ..jit.function_pointer import DeclaredPointer, compiled_address
from ..jit.kernel import kernel
from ..jit.packed_struct import Handle
from ..jit.value_types import INT64, NONE
from ..types import Film, Tile
from . import ray_samples
from .ray_samples import Workspace

_draw = DeclaredPointer(NONE).call


class TileScene(NamedTuple):
    """Inputs of `draw_tile`; addresses are those of handles."""

    draw: int  # address of ray_samples.draw_tile
    packets: Handle
    tables: int
    accel: int
    light: int
    frame: int


class TileDrawing:
    """The kernels of tiles for a picture, and memory for threads."""

    def __init__(self, prepared: Any, black: bool, side: int, samples: int) -> None:
        """`black` is that of TileHits; a picture has at most `samples` samples a pixel."""
        p = prepared
        self.prepared, self.side, self.most = p, side, side * side * min(samples, CALL)
        self.packets = CameraPackets(p.accel, p.packed, p.frame, p.packet_lights, black, side)
        kinds = p.packed.type, p.accel.type, p.vertex_light.type, p.frame.type
        thread_memory = self.memory(0)
        self.kind, workspace = thread_memory.type, thread_memory.tables.workspace.type
        drawn = compiled_address(ray_samples.draw_tile, *kinds, TILE, COUNTS, COUNTS, INT64, FILM, workspace)
        self.scene = Handle(TileScene(
            drawn, self.packets.scene, p.packed.address, p.accel.address, p.vertex_light.address, p.frame.address
        ))  # fmt: skip

    def memory(self, samples: int | None = None) -> ThreadMemory:
        """Allocate the memory of a thread, for tiles of so many samples."""
        return self.packets.memory(Workspace.allocate(self.prepared.options), self.most if samples is None else samples)

    def sample(self, tile: Tile, first: Any, count: Any, total: int, film: Film, local: Any) -> None:
        """Add samples to the film of a tile, see film.Renderer.sample; `local` is a threading.local that keeps the thread's memory."""
        needed = int(count.sum())
        if needed > getattr(local, "samples", -1):
            local.samples = max(needed, self.side * self.side)
            local.memory = self.memory(local.samples)
        draw_tile(self.scene, tile, first, count, total, film, local.memory)

    def link(self) -> TileKernel:
        """The kernel of tiles."""
        return TileKernel.link(draw_tile, [self.scene], self.memory, self.kind)._replace(owners=self)


@kernel
def draw_tile(scene, tile, first, count, total, film, memory):
    """Add samples to the film of a tile; see film.Renderer.sample."""
    trace_tile(scene.packets, memory, tile, first, count, total)
    of_scene = scene.tables, scene.accel, scene.light, scene.frame
    _draw(scene.draw, of_scene + (tile, first, count, total, film, memory.workspace))
