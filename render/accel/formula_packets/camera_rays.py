"""Traces the camera rays of a tile against formula surfaces as packets that share bounds (formula/packets.py).

Rays through neighboring pixels are coherent: samples are ordered by squares of 4 × 4 pixels, these by squares of 16 × 16. A packet holds
samples of one number, of several numbers where few pixels take samples. Its hits are found in memory of its own, and go to those of the
tile.
"""

from __future__ import annotations

import weakref
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import camera, simd
from ...formula import intersect, packet_state, packets
from ...jit.function_pointer import DeclaredPointer, compiled_address
from ...jit.kernel import helper, kernel, noinline_helper
from ...jit.packed_struct import Handle
from ...jit.value_types import INT64, NONE, TYPE_OF, array_type, tuple_type
from ...lanes import crosslane, ops, ray_soa
from ...sampling import sobol
from ...types import Tile
from ..bvh_build.scene_layout import GEOMETRY, VISIBILITY
from . import hits, packet_memory, shadow_rays
from .hits import COLUMNS, PACKET, ROUNDS, ROWS, SAMPLES, Nothing, TileHits, packet_instances

_generate, _trace_single, _mark = (DeclaredPointer(NONE).call for _ in range(3))
_trace, _send_to_light = (DeclaredPointer(INT64).call for _ in range(2))
_INTEGERS, _FLOATS, _RAYS = array_type(np.int64, 1), array_type(np.float64, 1), array_type(np.float64, 2)
_COLUMNS = tuple_type(packets.HitColumns, (_FLOATS, _INTEGERS, _INTEGERS, _FLOATS, _FLOATS, INT64))
ANY = packet_state.ANY


class Steps(NamedTuple):
    """Addresses of the kernels of a packet; 0 for those that the scene does not need."""

    generate: int
    single: int
    to_light: int
    mark: int


class PacketScene(NamedTuple):
    """The surfaces and lights of a picture that packets test; addresses are those of handles."""

    steps: Steps
    tables: int
    accel: int
    frame: int
    order: NDArray[np.int64]  # (side², 2) rows and columns of a tile's pixels, in the order of packets
    instance: NDArray[np.int64]  # (surfaces,)
    geometry: NDArray[np.int64]  # (surfaces,)
    trace: NDArray[np.int64]  # (surfaces,) addresses of packets.trace
    inverse: NDArray[np.float64]  # (surfaces, 3, 4) transforms to the surfaces' frames
    casting: NDArray[np.int64]  # the surfaces that cast shadows
    lights: NDArray[np.int64]  # those of shadow_rays.select_lights


class PacketMemory(NamedTuple):
    """A thread's tile, and the packet in work."""

    workspace: Handle  # with `found`
    hits: TileHits
    states: NDArray[np.int64]  # (surfaces,) addresses of packet_memory.PacketState
    pixels: NDArray[np.int64]  # (side²,) numbers of pixels that take further samples
    hidden: NDArray[np.int64]  # of `found`, empty without lights
    onward: NDArray[np.float64]  # (8, …) rays to a light, in the layout of ray_soa
    shade: NDArray[np.float64]  # (PACKET,) t of their hits
    t: NDArray[np.float64]  # (PACKET,) hits
    instance: NDArray[np.int64]
    spacing: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    light_bits: NDArray[np.int64]  # hidden lights


class ThreadMemory(Handle):
    """The packed PacketMemory of a thread, with the states of its surfaces."""

    __slots__ = ("__weakref__", "surfaces")


TYPE_OF[ThreadMemory] = TYPE_OF[Handle]
SPARE, SMALL = 4, 4 * PACKET  # memories of finished pictures that the next reuse, and their samples at most
_spare: list[TileHits] = []  # allocating memory for each picture would take as long as filling it


class CameraPackets:
    """Traces the camera rays of a picture against its formula surfaces.

    `lights` are those of shadow_rays.select_lights, `black` is that of TileHits, `side` the pixels of a tile's side.
    """

    def __init__(self, accel: Handle, packed: Handle, frame: Handle, lights: list[int], black: bool, side: int) -> None:
        bvh, self.kept = accel.tables, (accel, packed, frame)
        self.forms, self.black, self.side, self.lit = bvh.forms, black, side, bool(lights)
        instances = packet_instances(bvh)
        casting = np.flatnonzero(bvh.instance_rows[instances, VISIBILITY] & shadow_rays.CASTS)
        self.geometries = bvh.instance_rows[instances, GEOMETRY].astype(np.int64)
        trace = [self._trace_address(state) for state in self._states()]
        self.scene = Handle(PacketScene(
            self._steps(accel, packed, frame), packed.address, accel.address, frame.address, _pixel_order(side),
            instances.astype(np.int64), self.geometries, np.array(trace, np.int64), np.ascontiguousarray(bvh.inverse[instances, :3]),
            casting.astype(np.int64), np.array(lights, np.int64),
        ))  # fmt: skip

    def _states(self) -> list[Handle]:
        """The states of the surfaces, one for each geometry."""
        geometries = sorted(set(self.geometries.tolist()))
        states = packet_memory.allocate_shared(self.forms, [int(self.forms.surface_of[g]) for g in geometries])
        handles = dict(zip(geometries, map(Handle, states), strict=True))
        return [handles[g] for g in self.geometries.tolist()]

    def _trace_address(self, state: Handle) -> int:
        return compiled_address(packets.trace, state.type, _RAYS, INT64, INT64, _RAYS, _COLUMNS)

    def _steps(self, accel: Handle, packed: Handle, frame: Handle) -> Steps:
        to_light = marking = 0
        if self.lit:
            to_light = compiled_address(shadow_rays.generate_rays, packed.type, INT64, _RAYS, _COLUMNS, _RAYS)
            marking = compiled_address(shadow_rays.mark_hidden, INT64, _RAYS, _FLOATS, _INTEGERS)
        return Steps(
            compiled_address(generate_rays, packed.type, frame.type, INT64, _INTEGERS, _INTEGERS, INT64, _INTEGERS, _RAYS),
            compiled_address(trace_single, accel.type, INT64, _RAYS, INT64, INT64, _RAYS, _COLUMNS), to_light, marking,
        )  # fmt: skip

    def memory(self, workspace: Any, samples: int) -> ThreadMemory:
        """Allocate the memory of a thread for tiles of so many samples; `workspace` is the thread's, a NamedTuple with `primed`."""
        hits = self._hits(samples)._replace(black=self.black)
        states, rays = self._states(), (8, packet_state.SPACED)
        hidden = hits.hidden if self.lit else np.zeros(0, np.int64)
        shade, t, u, v = np.zeros((4, PACKET))
        instance, spacing, light_bits = np.zeros((3, PACKET), np.int64)
        thread_memory = ThreadMemory(PacketMemory(
            Handle(workspace._replace(primed=hits)), hits, np.array([each.address for each in states], np.int64),
            np.zeros(self.side**2, np.int64), hidden, np.zeros(rays), shade, t, instance, spacing, u, v, light_bits,
        ))  # fmt: skip
        thread_memory.surfaces = states
        weakref.finalize(thread_memory, _release, hits).atexit = False
        return thread_memory

    def _hits(self, samples: int) -> TileHits:
        """Memory of hits: that of a finished picture, or new."""
        kind = self.side, samples, self.lit
        for k, spare in enumerate(_spare):
            if (int(len(spare.start) ** 0.5), len(spare.t), isinstance(spare.hidden, np.ndarray)) == kind:
                return _spare.pop(k)
        return allocate_hits(self.side, samples, self.lit, self.black)


def _release(hits: TileHits) -> None:
    """Keep the memory of a finished picture for reuse."""
    if 0 < len(hits.t) <= SMALL:
        _spare.insert(0, hits)
        del _spare[SPARE:]


def allocate_hits(side: int, samples: int, lights: bool, black: bool) -> TileHits:
    """Memory for the hits of `samples` samples of a tile of side × side pixels."""
    pixels = side * side
    blocks = -(-pixels // PACKET)
    start, first = np.zeros((2, pixels), np.int64)
    t, u, v = (np.zeros(samples) for _ in range(3))
    return TileHits(
        np.zeros(4, np.int64), start, first, np.zeros(3, np.int64), np.zeros(3 * PACKET * blocks, np.int64),
        np.zeros((blocks, 8, packet_state.SPACED)), t, np.zeros(samples, np.int32), np.zeros(samples, np.int64), u, v, black,
        np.zeros(samples, np.int64) if lights else Nothing(),
    )  # fmt: skip


@lru_cache(maxsize=4)
def _pixel_order(side: int) -> NDArray[np.int64]:
    """(side², 2) rows and columns of a tile's pixels, ordered by squares of 64 × 64, within these of 16 × 16, within these of 4 × 4."""
    y, x = (part.ravel() for part in np.mgrid[:side, :side])
    order = np.lexsort((x % 4, y % 4, x % 16 // 4, y % 16 // 4, x % 64 // 16, y % 64 // 16, x // 64, y // 64))
    return np.ascontiguousarray(np.stack([y[order], x[order]], axis=1), np.int64)


@helper
def trace_tile(scene: Any, memory: Any, tile: Tile, first: Any, count: Any, total: int) -> None:
    """Trace samples first … first + count − 1 (rows, columns) of `total` of a tile's pixels, and set `memory.hits`.

    Raises ValueError for more samples than fit there.
    """
    hits, items = memory.hits, memory.hits.items
    many = _begin(scene, memory, tile, first, count)
    rounds, columns = hits.extent[ROUNDS], hits.extent[COLUMNS]
    if hits.extent[SAMPLES] > len(hits.t):
        raise ValueError("more samples of a tile than its memory holds")
    packet, filled = 0, 0
    for k in range(rounds):
        remaining = 0
        for i in range(many):
            pixel = memory.pixels[i]
            row, column = pixel // columns, pixel % columns
            if count[row, column] > k:
                memory.pixels[remaining] = pixel
                remaining += 1
                place = (3 * PACKET * packet if rounds == 1 else 0) + filled
                items[place], items[place + PACKET], items[place + 2 * PACKET] = column, row, k
                filled += 1
                if filled == PACKET:
                    _trace_packet(scene, memory, packet, filled, total)
                    packet, filled = packet + 1, 0
        many = remaining
    if filled > 0:
        _trace_packet(scene, memory, packet, filled, total)


@helper
def _begin(scene: Any, memory: Any, tile: Tile, first: Any, count: Any) -> int:
    """Set the slots of a tile's pixels, and the list of those that take samples; returns their number."""
    hits, rows, columns = memory.hits, tile.y1 - tile.y0, tile.x1 - tile.x0
    rounds, samples, many, same = 0, 0, 0, first[0, 0] if rows * columns > 0 else -1
    for row in range(rows):
        for column in range(columns):
            pixel, number = row * columns + column, first[row, column]
            hits.first[pixel], hits.start[pixel] = number, samples
            same = same if number == same else -1
            rounds, samples = max(rounds, count[row, column]), samples + count[row, column]
    for i in range(len(scene.order)):
        row, column = scene.order[i, 0], scene.order[i, 1]
        if row < rows and column < columns and count[row, column] > 0:
            memory.pixels[many] = row * columns + column
            many += 1
    if rounds == 1:
        for i in range(many):
            hits.start[memory.pixels[i]] = i
    hits.corner[0], hits.corner[1], hits.corner[2] = tile.x0, tile.y0, same
    hits.extent[ROUNDS], hits.extent[ROWS], hits.extent[COLUMNS], hits.extent[SAMPLES] = rounds, rows, columns, samples
    return many


@noinline_helper
def _trace_packet(scene, memory, packet, n, total):
    """Trace the n samples of a packet, whose items are set, and store their hits in the tile's."""
    hits = memory.hits
    alone = hits.extent[ROUNDS] == 1
    block = packet if alone else 0
    first_item = 3 * PACKET * block
    for row in range(1, 3):  # the rows of a packet with fewer samples follow each other
        for i in range(n):
            hits.items[first_item + row * n + i] = hits.items[first_item + row * PACKET + i]
    items, rays, columns = hits.items[first_item : first_item + 3 * n], hits.rays[block], hits.extent[COLUMNS]
    t, instance, spacing, u, v = memory.t[:n], memory.instance[:n], memory.spacing[:n], memory.u[:n], memory.v[:n]
    for i in range(n):
        t[i], instance[i] = np.inf, -1
    _generate(scene.steps.generate, (scene.tables, scene.frame, total, hits.first, hits.corner, columns, items, rays))
    for k in range(len(scene.instance)):
        _trace_surface(scene, memory, k, rays, n, packets.HitColumns(t, instance, spacing, u, v, scene.instance[k]))
    _find_hidden_lights(scene, memory, rays, n)
    for i in range(n):
        slot = packet * PACKET + i
        if not alone:
            slot = hits.start[items[n + i] * columns + items[i]] + items[2 * n + i]
        hits.t[slot], hits.instance[slot], hits.spacing[slot] = t[i], instance[i], spacing[i]
        hits.u[slot], hits.v[slot] = u[i], v[i]
        if len(memory.hidden) > 0:
            memory.hidden[slot] = memory.light_bits[i]
    samples = hits.extent[SAMPLES]
    for slot in range(samples, min(samples + crosslane.WIDTH, len(hits.t))):  # vectors read them
        hits.t[slot], hits.instance[slot] = np.inf, -1


@helper
def _trace_surface(scene: Any, memory: Any, k: int, rays: Any, n: int, out: Any) -> None:
    """Trace n rays against the k-th surface and store closer hits; see packets.HitColumns."""
    inverse = scene.inverse[k]
    if _trace(scene.trace[k], (memory.states[k], rays, 0, n, inverse, out)) < n:
        _trace_single(scene.steps.single, (scene.accel, scene.geometry[k], rays, 0, n, inverse, out))


@helper
def _find_hidden_lights(scene: Any, memory: Any, rays: Any, n: int) -> None:
    """Find the lights that surfaces hide from the hits of a packet."""
    t, instance, spacing, u, v = memory.t[:n], memory.instance[:n], memory.spacing[:n], memory.u[:n], memory.v[:n]
    shade, light_bits = memory.shade[:n], memory.light_bits[:n]
    for i in range(n):
        light_bits[i] = 0
    for j in range(len(scene.lights)):
        light = scene.lights[j]
        for i in range(n):
            shade[i] = np.inf
        hits = packets.HitColumns(t, instance, spacing, u, v, 0)
        if _send_to_light(scene.steps.to_light, (scene.tables, light, rays, hits, memory.onward)) > 0:
            for k in range(len(scene.casting)):
                hiding = packets.HitColumns(shade, instance, spacing, u, v, ANY)
                _trace_surface(scene, memory, scene.casting[k], memory.onward, n, hiding)
        _mark(scene.steps.mark, (light, memory.onward, shade, light_bits))


@kernel
def generate_rays(tables, frame, total, first, corner, width, items, rays):
    """Generate the camera rays of a tile's samples; `first`, `corner` and `items` are those of TileHits."""
    n = len(items) // 3
    for start in range(0, n, crosslane.WIDTH):
        x, y, s = hits.load_pixels(items, start)
        s += hits.first_samples(corner, first, width, x, y)
        x, y = x + corner[0], y + corner[1]
        view, options = frame.picture, frame.options
        pixel, s = sobol.zorder_index(x, y, s, view.width, frame.order)
        dx, dy = sobol.offset(pixel, s, total, options.seed, frame.filter)
        time = sobol.sample_time(pixel, s, options.seed, frame.shutter)
        ray = camera.generate_ray(
            tables, view, frame.lens, ops.to_float(x) + 0.5 + dx, ops.to_float(y) + 0.5 + dy, pixel, s, options.seed, time
        )
        zero = (0.0 * dx, 0.0 * dx, 0.0 * dx)
        far = ops.full_like(dx, ray.t_max)
        ray_soa.put(rays, start, ops.add(ray.origin, zero), ops.add(ray.direction, zero), ray.t_min + zero[0], far)


@kernel
def trace_single(accel, g, rays, first_ray, n, inverse, out):
    """Trace n incoherent rays from `first_ray` on against one surface, as packets.trace does."""
    for start in range(0, n, crosslane.WIDTH):
        o, d, low, high = packet_state.to_local(rays, first_ray + start, inverse)
        high = ops.minimum(high, out.t[first_ray + ops.minimum(crosslane.lane_indices(start), n - 1)])
        t, units, u, v, _ = intersect.call(accel.formula_kernel, (accel.forms, np.int64(g), o, d, low, high))  # pyright: ignore[reportCallIssue]
        hit_lanes = crosslane.bits((t < high) & (crosslane.lane_indices(start) < n))
        while hit_lanes != 0:
            j = simd.trailing_zeros(hit_lanes)
            hit_lanes &= hit_lanes - 1
            i = first_ray + start + j
            if out.number == packet_state.ANY:
                out.t[i] = -np.inf
                continue
            out.t[i], out.instance[i], out.spacing[i] = crosslane.lane(t, j), out.number, crosslane.lane(units, j)
            out.u[i], out.v[i] = crosslane.lane(u, j), crosslane.lane(v, j)
