"""Camera rays of a tile meet formula surfaces all together, as bundles that share bounds (formulas/tiles.py).

Rays through neighbouring pixels go much the same way: samples are put in squares of 4 × 4 pixels, these in squares of 16 × 16.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import across, camera, lanes, rays, sampler
from .formulas import meet, tile_room, tiles
from .handles import Handle
from .kernels import kernel
from .primed import Primed, instances
from .records import Tile


class Bundles:
    """What one thread needs to meet the formula surfaces of a scene's trees."""

    def __init__(self, accel: Handle) -> None:
        trees = accel.tables
        self.accel = accel
        self.instances = instances(trees)
        surfaces = {int(trees.placed[i, 2]) for i in self.instances}
        self.rooms = {g: Handle(tile_room.room(trees.forms, int(trees.forms.of[g]))) for g in surfaces}
        nothing = np.zeros(0)
        for handle in self.rooms.values():  # compiled, or loaded, before a picture begins
            tiles.trace(handle, np.zeros((0, 3)), np.zeros((0, 3)), nothing, nothing, nothing, np.zeros(0, np.int64), nothing, nothing)

    def prime(self, packed: Any, frame: Any, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int) -> Primed:
        """Meet all samples first … first + count − 1 of `total` of a tile's pixels, (rows, columns) each."""
        rounds = int(count.max(initial=0))
        order = _order(*count.shape)
        slots, items = _listed(order, first, count, rounds, tile)
        n = items.shape[1]
        rows, columns = count.shape
        found = Primed(
            rounds, rows, columns, slots.ravel(), first.ravel(), np.array([tile.x0, tile.y0]), np.full(n, np.inf), np.full(n, -1),
            np.zeros(n, np.int64), np.zeros(n), np.zeros(n),
        )  # fmt: skip
        origin, direction, t_min, t_max = np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n)
        aim(packed, frame, total, items, origin, direction, t_min, t_max)
        for i in self.instances.tolist():
            self._meet(i, origin, direction, t_min, t_max, found)
        return found

    def _meet(self, i: int, origin: Any, direction: Any, t_min: Any, t_max: Any, found: Primed) -> None:
        trees, g = self.accel.tables, int(self.accel.tables.placed[i, 2])
        inverse = trees.inverse[i, :3]
        o, d = np.ascontiguousarray(origin @ inverse[:, :3].T + inverse[:, 3]), np.ascontiguousarray(direction @ inverse[:, :3].T)
        for begin in range(0, len(o), tile_room.RAYS):
            part = slice(begin, begin + tile_room.RAYS)
            until = np.minimum(t_max[part], found.t[part])
            m = len(until)
            met = np.empty(m), np.zeros(m, np.int64), np.zeros(m), np.zeros(m)
            if not tiles.trace(self.rooms[g], o[part], d[part], t_min[part], until, *met):
                one_by_one(self.accel, g, o[part], d[part], t_min[part], until, *met)
            nearer = met[0] < found.t[part]
            for column, values in ((found.t, met[0]), (found.spacing, met[1]), (found.u, met[2]), (found.v, met[3])):
                column[part][nearer] = values[nearer]
            found.instance[part][nearer] = i


@lru_cache(maxsize=16)
def _order(rows: int, columns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(row, column) of a tile's pixels, by squares of 16 × 16 and in these of 4 × 4."""
    y, x = (part.ravel() for part in np.mgrid[:rows, :columns])
    order = np.lexsort((x % 4, y % 4, x % 16 // 4, y % 16 // 4, x // 16, y // 16))
    return y[order], x[order]


def _listed(order: Any, first: Any, count: Any, rounds: int, tile: Tile) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(where each sample's result stands, (3, n) x, y and number of each sample), round by round."""
    y, x = order
    slots, parts, n = np.full((rounds, *count.shape), -1, np.int64), [], 0
    for k in range(rounds):
        here = count[y, x] > k
        row, column = y[here], x[here]
        slots[k, row, column] = np.arange(n, n + len(row))
        parts.append(np.stack([column + tile.x0, row + tile.y0, first[row, column] + k]))
        n += len(row)
    return slots, np.ascontiguousarray(np.concatenate([np.zeros((3, 0), np.int64), *parts], axis=1), np.int64)


@kernel
def aim(tables, frame, total, items, origin, direction, t_min, t_max):
    """The camera rays of samples: items (3, n) as in Primed.prime."""
    n = len(t_min)
    for start in range(0, n, across.WIDTH):
        rows = lanes.minimum(across.numbered(start), n - 1)
        x, y, s = items[0, rows], items[1, rows], items[2, rows]
        view, options = frame.picture, frame.options
        pixel, s = sampler.place(x, y, s, view.width, frame.order)
        dx, dy = sampler.offset(pixel, s, total, options.seed, frame.filter)
        time = sampler.moment(pixel, s, options.seed, frame.shutter)
        ray = camera.through(
            tables, view, frame.lens, lanes.to_float(x) + 0.5 + dx, lanes.to_float(y) + 0.5 + dy, pixel, s, options.seed, time
        )
        for j in range(min(across.WIDTH, n - start)):
            for axis in range(3):
                o, d = (ray.origin[0], ray.direction[0]) if axis == 0 else (ray.origin[1], ray.direction[1])
                if axis == 2:
                    o, d = ray.origin[2], ray.direction[2]
                origin[start + j, axis], direction[start + j, axis] = across.lane(o + 0.0 * dx, j), across.lane(d + 0.0 * dx, j)
            t_min[start + j], t_max[start + j] = across.lane(ray.t_min + 0.0 * dx, j), across.lane(lanes.full_like(dx, ray.t_max), j)


@kernel
def one_by_one(accel, g, origin, direction, t_min, t_max, t, spacing, u, v):
    """Meet rays that are no bundle with one surface."""
    n = len(t_min)
    for start in range(0, n, across.WIDTH):
        o, d = rays._three(origin, start, n), rays._three(direction, start, n)
        low, high = rays._one(t_min, start, n), rays._one(t_max, start, n)
        at, units, a, b, _ = meet.call(accel.meet, (accel.forms, np.int64(g), o, d, low, high))  # pyright: ignore[reportCallIssue]
        rays._put(t, start, n, at)
        rays._put(spacing, start, n, units)
        rays._put(u, start, n, a)
        rays._put(v, start, n, b)
