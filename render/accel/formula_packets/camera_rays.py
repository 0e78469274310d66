"""Traces the camera rays of a tile against formula surfaces as packets that share bounds (formula/packets.py).

Rays through neighboring pixels are coherent: samples are ordered by squares of 4 × 4 pixels, these by squares of 16 × 16.
"""

from __future__ import annotations

import weakref
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import camera, simd
from ...formula import intersect, packet_state, packets
from ...jit.kernel import kernel
from ...jit.packed_struct import Handle
from ...lanes import crosslane, ops, ray_soa
from ...sampling import sobol
from ...types import Tile
from . import hits, shadow_rays
from .hits import Nothing, TileHits, packet_instances


class TileBuffers(NamedTuple):
    """Rays and hits of a tile, for a number of samples and a shape of tiles."""

    onward: NDArray[np.float64]  # rays to a light, in the layout of ray_soa
    shade: NDArray[np.float64]  # (n,) t of their hits
    rays: NDArray[np.float64]  # those of `primed`, in the layout of ray_soa
    primed: TileHits  # samples in the order of packets
    workspace: Handle  # the thread's workspace with `primed`


SPARE, SMALL = 4, 4 * packet_state.RAYS  # kinds of buffers reused by the next picture, and their samples at most
_spare: dict[tuple[int, ...], list[TileBuffers]] = {}  # allocating memory for each picture would take as long as filling it


class CameraPackets:
    """Traces the camera rays of one thread against the formula surfaces of a scene.

    `workspace` is the thread's workspace, `lights` the lights of shadow_rays.select_lights, `black` that of TileHits.
    """

    def __init__(self, accel: Handle, packed: Handle, workspace: Any, lights: list[int], black: bool) -> None:
        bvh = accel.tables
        self.accel, self.workspace, self.lights, self.black = accel, workspace, lights, black
        self.instances = packet_instances(bvh).tolist()
        self.casting = [k for k, i in enumerate(self.instances) if bvh.instance_rows[i, 0] & shadow_rays.CASTS]
        self.buffers: dict[tuple[int, ...], TileBuffers] = {}
        self.last_counts: tuple[Any, Any] = None, None  # the last sample counts, and their buffers
        weakref.finalize(self, _release, self.buffers).atexit = False
        self.inverses = [np.ascontiguousarray(bvh.inverse[i, :3]) for i in self.instances]
        self.geometries = [int(bvh.instance_rows[i, 2]) for i in self.instances]
        surfaces = {g: Handle(packet_state.allocate(bvh.forms, int(bvh.forms.of[g]))) for g in set(self.geometries)}
        self.surface_states = [surfaces[g] for g in self.geometries]
        buffers = allocate_packets(np.zeros((0, 0), np.int64), workspace, bool(lights), black)
        for handle, inverse in zip(self.surface_states, self.inverses, strict=True):  # compiles or loads kernels before a picture starts
            packets.trace(handle, buffers.rays, 0, 0, inverse, _hit_columns(buffers.primed, 0))
        self._find_hidden_lights(packed, buffers)

    def prime(self, packed: Any, frame: Any, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int) -> Handle:
        """Trace samples first … first + count − 1 of `total` of a tile's pixels, (rows, columns) each; return the workspace."""
        buffers = self._tile_buffers(count)
        found = buffers.primed
        hits.reset(first, tile.x0, tile.y0, found.first, found.corner, found.t, found.instance)
        generate_rays(packed, frame, total, found.first, found.corner, count.shape[1], found.items, buffers.rays)
        n = len(found.t)
        for k, i in enumerate(self.instances):
            self._trace_surface(k, buffers.rays, n, found, i)
        self._find_hidden_lights(packed, buffers)
        return buffers.workspace

    def _trace_surface(self, k: int, rays: NDArray[np.float64], n: int, found: Any, number: int) -> None:
        """Trace n rays against the k-th surface and store closer hits in `found`; see packets.HitColumns."""
        out, done = _hit_columns(found, number), 0
        while (done := packets.trace(self.surface_states[k], rays, done, n, self.inverses[k], out)) < n:
            many = min(packet_state.RAYS, n - done)
            trace_single(self.accel, self.geometries[k], rays, done, many, self.inverses[k], out)
            done += many

    def _find_hidden_lights(self, packed: Handle, buffers: TileBuffers) -> None:
        """Find the lights that surfaces hide from the hits."""
        found = buffers.primed
        if self.lights:
            found.hidden[:] = 0
        for light in self.lights:
            buffers.shade[:] = np.inf
            if shadow_rays.generate_rays(packed, light, buffers.rays, _hit_columns(found, 0), buffers.onward) > 0:
                for k in self.casting:
                    self._trace_surface(k, buffers.onward, len(buffers.shade), found._replace(t=buffers.shade), packet_state.ANY)
            shadow_rays.mark_hidden(light, buffers.onward, buffers.shade, found.hidden)

    def _tile_buffers(self, count: NDArray[np.int64]) -> TileBuffers:
        """The buffers of a tile; those of uniform sample counts are reused."""
        if count is self.last_counts[0]:  # the usual case: the film's own array
            return self.last_counts[1]
        buffers = self._uniform_buffers(count)
        self.last_counts = count, buffers
        return buffers

    def _uniform_buffers(self, count: NDArray[np.int64]) -> TileBuffers:
        rounds = int(count.flat[0]) if count.size else 0
        if (count != rounds).any():
            return allocate_packets(count, self.workspace, bool(self.lights), self.black)
        key = (*count.shape, rounds, len(self.lights) > 0)
        if key not in self.buffers:
            spare = _reuse(key)
            made = (
                allocate_packets(count, self.workspace, key[-1], self.black)
                if spare is None
                else _rebind(self.workspace, spare, self.black)
            )
            self.buffers[key] = made
        return self.buffers[key]


def _release(finished: dict[tuple[int, ...], TileBuffers]) -> None:
    """Keep the buffers of a finished picture for reuse, up to two of a kind."""
    for key, buffers in finished.items():
        if len(buffers.primed.t) <= SMALL:
            _spare[key] = [buffers, *_spare.pop(key, [])][:2]
    for key in tuple(_spare)[:-SPARE]:
        _spare.pop(key, None)


def _reuse(key: tuple[int, ...]) -> TileBuffers | None:
    """Unused buffers of a kind, or None."""
    try:
        return _spare[key].pop()
    except LookupError:
        return None


def _rebind(workspace: Any, buffers: TileBuffers, black: bool) -> TileBuffers:
    """The buffers for another workspace."""
    primed = buffers.primed._replace(black=black)
    return buffers._replace(primed=primed, workspace=Handle(workspace._replace(primed=primed)))


def allocate_packets(count: NDArray[np.int64], workspace: Any, lights: bool, black: bool) -> TileBuffers:
    """Memory for the packets of a tile with `count` (h, w) samples a pixel."""
    rows, columns = count.shape
    rounds = int(count.max(initial=0))
    y, x = _pixel_order(rows, columns)
    slots, parts, n = np.full((rounds, rows, columns), -1, np.int64), [np.zeros((3, 0), np.int64)], 0
    for k in range(rounds):
        here = count[y, x] > k
        row, column = y[here], x[here]
        slots[k, row, column] = np.arange(n, n + len(row))
        parts.append(np.stack([column, row, np.full(len(row), k)]))
        n += len(row)
    items = np.ascontiguousarray(np.concatenate(parts, axis=1), np.int64).ravel()
    rays = np.zeros((8, -(-n // packet_state.VECTOR) * packet_state.VECTOR))
    primed = TileHits(
        rounds, rows, columns, slots.ravel(), np.zeros(rows * columns, np.int64), np.zeros(3, np.int64), items, rays.ravel(),
        np.full(n, np.inf), np.full(n, -1), np.zeros(n, np.int64), np.zeros(n), np.zeros(n), black,
        np.zeros(n, np.int64) if lights else Nothing(),
    )  # fmt: skip
    onward, shade = (np.zeros_like(rays), np.zeros(n)) if lights else (np.zeros((8, 0)), np.zeros(0))
    return TileBuffers(onward, shade, rays, primed, Handle(workspace._replace(primed=primed)))


def _hit_columns(found: Any, i: int) -> packets.HitColumns:
    return packets.HitColumns(found.t, found.instance, found.spacing, found.u, found.v, i)


@lru_cache(maxsize=16)
def _pixel_order(rows: int, columns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(row, column) of a tile's pixels, ordered by squares of 64 × 64, within these of 16 × 16, within these of 4 × 4."""
    y, x = (part.ravel() for part in np.mgrid[:rows, :columns])
    order = np.lexsort((x % 4, y % 4, x % 16 // 4, y % 16 // 4, x % 64 // 16, y % 64 // 16, x // 64, y // 64))
    return y[order], x[order]


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
def trace_single(accel, g, rays, at, n, inverse, out):
    """Trace n incoherent rays from `at` on against one surface, as packets.trace does."""
    for start in range(0, n, crosslane.WIDTH):
        o, d, low, high = packet_state.to_local(rays, at + start, inverse)
        high = ops.minimum(high, out.t[at + ops.minimum(crosslane.lane_indices(start), n - 1)])
        t, units, u, v, _ = intersect.call(accel.formula_kernel, (accel.forms, np.int64(g), o, d, low, high))  # pyright: ignore[reportCallIssue]
        left = crosslane.bits((t < high) & (crosslane.lane_indices(start) < n))
        while left != 0:
            j = simd.trailing_zeros(left)
            left &= left - 1
            i = at + start + j
            if out.number == packet_state.ANY:
                out.t[i] = -np.inf
                continue
            out.t[i], out.instance[i], out.spacing[i] = crosslane.lane(t, j), out.number, crosslane.lane(units, j)
            out.u[i], out.v[i] = crosslane.lane(u, j), crosslane.lane(v, j)
