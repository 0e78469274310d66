"""Learns which part of the sky the places of a room see: small panoramas, drawn by the picture's own kernel."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import sky_visibility
from .. import camera
from ..image import metrics
from ..integrator import wave_memory, wavefront
from ..integrator.wave_memory import WaveScene
from ..jit import thread_pool
from ..jit.packed_struct import Handle
from ..light import lights, sky_openings
from ..light.sky_openings import FACES, SIDE
from ..types import ClippingPlanes, Film, Frame, Lens, Tile, View

SHARE = 0.85  # of samples that aim at openings; the others find openings that no panorama saw
PLACES = 48  # about so many panoramas
WIDTH, HEIGHT = 64, 32  # of a panorama
SEED = 0x6D61_7175  # panoramas and picture have different random numbers


def learn(
    tables: ir.Tables, accel: Handle, scene: Any, frame: Frame, kind: type, threads: int, reuses: bool = False
) -> sky_openings.Openings:  # fmt: skip
    """Learn where the sky is seen from a grid of places in the room.

    `accel`, `scene` and `frame` are those of `wavefront.draw_tile`, `kind` their floating-point type. With `reuses` the kernel is
    `draw_tile_in_groups`. The result does not depend on the number of threads.
    """
    low, high, _ = sky_visibility.find_room(tables, frame.picture.camera)
    size = high - low
    count = np.clip(np.round(size / (np.prod(size) / PLACES) ** (1.0 / 3.0)), 1, 16).astype(int)
    axes = np.meshgrid(*(low[k] + (np.arange(count[k]) + 0.5) / count[k] * size[k] for k in range(3)), indexing="ij")
    places = np.stack([axis.ravel() for axis in axes], axis=1)
    seen = _draw(accel, Handle(_seen_from(places, scene)), frame, len(places), kind, threads, reuses)
    light = _luminance(tables)
    seen_light, all_of_it = (np.sum(some * np.sin(np.pi * (np.arange(HEIGHT) + 0.5) / HEIGHT)[:, None]) for some in (seen * light, light))
    share = float(seen_light / max(all_of_it * max(seen.any(axis=(1, 2)).sum(), 1), 1e-30))
    return sky_openings.make(low, high, _by_cell(low, high, places, seen * light), SHARE, share)


def _directions() -> NDArray[np.float64]:
    """(HEIGHT, WIDTH, 3) directions of the pixels of a panorama."""
    rise = np.pi * (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT)[:, None]
    turn = 2.0 * np.pi * ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5)[None]
    level = np.cos(rise)
    return np.stack(np.broadcast_arrays(level * np.sin(turn), np.sin(rise), -level * np.cos(turn)), axis=-1)


def _luminance(tables: ir.Tables) -> NDArray[np.float64]:
    """(HEIGHT, WIDTH) luminance of the sky."""
    radiance = lights.background(tables, tuple(np.moveaxis(_directions(), -1, 0)), lights.SHADOWED)[0]
    return np.maximum(np.tensordot(metrics.LUMINANCE, np.stack(radiance), 1), 0.0)


def _by_cell(
    low: NDArray[np.float64], high: NDArray[np.float64], places: NDArray[np.float64], light: NDArray[np.float64]
) -> NDArray[np.float64]:  # fmt: skip
    """(FACES · SIDE, SIDE) mean light that passes each cell of the faces, times its area, of the places that see the sky."""
    lit = light.any(axis=(1, 2))
    towards = _directions().reshape(-1, 3)
    weight = np.repeat(np.cos(np.pi * (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT)), WIDTH)
    cells = FACES * SIDE * SIDE
    passed, shot = np.zeros(cells), np.full(cells, 1e-30)
    for place, place_light in zip(places[lit], light[lit], strict=True):
        reach = (np.where(towards > 0.0, high, low) - place) / np.where(towards == 0.0, 1e-20, towards)
        axis = np.argmin(reach, axis=1)
        point = np.clip((place + reach.min(axis=1)[:, None] * towards - low) / (high - low), 0.0, 1.0 - 1e-9)
        row = np.arange(len(axis))
        face = 2 * axis + (towards[row, axis] > 0.0)
        r, c = (point[row, (axis + 1) % 3] * SIDE).astype(int), (point[row, (axis + 2) % 3] * SIDE).astype(int)
        cell = (face * SIDE + r) * SIDE + c
        shot += np.bincount(cell, weight, cells)
        passed += np.bincount(cell, weight * place_light.ravel(), cells)
    size = high - low
    areas = np.repeat([size[1] * size[2], size[2] * size[0], size[0] * size[1]], 2)
    return _widened((passed / shot).reshape(FACES, SIDE, SIDE) * areas[:, None, None]).reshape(FACES * SIDE, SIDE)


def _widened(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Histograms with the largest of their neighbors: rays meet some cells only."""
    padded = np.pad(weights, ((0, 0), (1, 1), (1, 1)))
    near = [padded[:, 1 + i : 1 + i + SIDE, 1 + j : 1 + j + SIDE] for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return np.where(weights > 0.0, weights, 0.25 * np.max(near, axis=0))


def _seen_from(places: NDArray[np.float64], scene: WaveScene) -> WaveScene:
    """A scene with a panorama camera at each place."""
    tables, n = scene.tables, len(places)
    old, cameras = tables.transforms, tables.cameras
    matrix, inverse = np.repeat(np.eye(3, 4)[None], n, axis=0), np.repeat(np.eye(3, 4)[None], n, axis=0)
    matrix[:, :, 3], inverse[:, :, 3] = places, -places
    added = {"matrix": matrix, "inverse": inverse, "flips": np.zeros(n, bool), "first_key": np.full(n, -1), "keys": np.zeros(n)}
    columns = {name: np.repeat(column[:1], n, axis=0) for name, column in cameras._asdict().items()}
    columns |= {"projection": np.full(n, camera.PANORAMIC), "transform": len(old.matrix) + np.arange(n)}
    columns |= {"near": np.zeros(n), "far": np.full(n, np.inf), "shift": np.zeros((n, 2))}
    joined = {name: np.concatenate([column, added[name].astype(column.dtype)]) for name, column in old._asdict().items()}
    transforms = type(old)(*(np.ascontiguousarray(column) for column in joined.values()))
    cameras = type(cameras)(*(np.ascontiguousarray(columns[name], column.dtype) for name, column in cameras._asdict().items()))
    return scene._replace(tables=tables._replace(transforms=transforms, cameras=cameras))


def _draw(
    accel: Handle, packed: Handle, frame: Frame, places: int, kind: type, threads: int, reuses: bool
) -> NDArray[np.float64]:  # fmt: skip
    """(places, HEIGHT, WIDTH) share of the rays from each place that leave the scene."""
    seen = np.zeros((places, HEIGHT, WIDTH))
    first, count = np.zeros((HEIGHT, WIDTH), np.int64), np.ones((HEIGHT, WIDTH), np.int64)
    options, local = frame.options._replace(bounces=0), threading.local()
    drawn = wavefront.draw_tile_in_groups if reuses else wavefront.draw_tile
    unclipped = frame.lens.planes._replace(count=0) if isinstance(frame.lens.planes, ClippingPlanes) else frame.lens.planes

    def draw(place: int) -> None:
        seed = int(np.random.default_rng([SEED, options.seed & 0xFFFFFFFF, place]).integers(1 << 31))
        view, lens = View(place, WIDTH, HEIGHT), Lens(camera.PANORAMA, planes=unclipped)
        packed_frame = Handle(frame._replace(picture=view, options=options._replace(seed=seed), order=-1, lens=lens))
        film = Film(np.zeros((HEIGHT, WIDTH, 3)), np.zeros((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH), np.int64))
        if not hasattr(local, "memory"):
            local.memory = Handle(wave_memory.WaveMemory.of(kind, reuses))
        drawn(accel, packed, packed_frame, Tile(0, 0, WIDTH, HEIGHT), first, count, 1, film, local.memory)
        seen[place] = np.clip(1.0 - film.alpha, 0.0, 1.0)

    thread_pool.parallel_for(draw, range(places), threads)
    return seen
