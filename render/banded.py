"""A picture in bands: each is filled with what its samples see, then what they see is lit, once for each triangle in each pixel.

Samples lie at the same places in every pixel, and a pixel's filter weighs those around it; nothing here is random. Where shadows
or patterns run across triangles every sample is lit for itself.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler import plan as planner
from ..compiler.plan import Plan
from . import across, bands, camera, classic, deferred, faces, fill, integrate, meshlets, raster_setup, sampler, setup, traced
from .handles import Handle
from .records import View

MOST_SAMPLES = 16
ROWS = {1: 64, 4: 32}  # rows of a band by samples, where its buffer still fits the second cache; else 16

EXACT = 2.0**22  # weights are whole numbers over this, so that sums of them are exact in float32, and what is covered wholly is 1


class Triangles(NamedTuple):
    """What a view draws as triangles: made once, kept with what else is prepared."""

    model: Handle  # of a raster_setup.Model
    ranges: NDArray[np.int64]  # (instances, 2) triangles of the model
    meshlets: Handle
    placed: NDArray[np.int64]  # (instances, 2) meshlets
    shown: Handle  # of a bands.Projection
    lit: Handle  # what deferred.py reads of the tables
    look: Handle
    rooms: dict[Any, list[_Room]]  # memory of threads that nobody uses now, by its size


def triangles(tables: ir.Tables, view: View, shells: dict[int, Any]) -> Triangles:
    """The triangles of meshes and of tessellated shapes, as a model and as meshlets."""
    model, ranges = raster_setup.model(tables, view, shells)
    made, placed = meshlets.build(tables, model.positions, model.triangles, ranges, shells)
    near, far = raster_setup.ends(tables, view)
    shown = bands.Projection(model.matrix, model.planes, model.perspective, near, far, model.positions, model.triangles)
    eye = tables.transforms.matrix[tables.cameras.transform[view.camera], :, 3]
    lit, look = Handle(deferred.single(tables, eye)), Handle(_look(tables, view, eye))
    return Triangles(Handle(model), ranges, Handle(made), placed, Handle(shown), lit, look, {})


def needs_no_rays(plan: Plan) -> bool:
    """Whether a picture takes nothing but its triangles: no trees, no integrator."""
    return can_draw(plan) and plan["raster.precision"] == "float32" and not plan["aov"]


def can_draw(plan: Plan) -> bool:
    """Whether a picture is drawn in bands: a few samples at fixed places, one moment, one point, and light without random numbers."""
    alike = not any(name.startswith((planner.LIGHT, "crypto_", "variance")) for name in plan["aov"])  # nothing is told sample by sample
    once = alike and not plan["denoise"] and not plan["motion"] and plan["lens"] == "pinhole"
    return bool(once and not planner.adaptive(plan) and plan["samples"] <= MOST_SAMPLES and not plan["soft lights"])


class Bands:
    """One picture to be drawn, band by band, by any number of threads."""

    def __init__(self, prepared: Any, plan: Plan, view: View, endless: NDArray[np.intp]) -> None:
        self.prepared, self.view, self.endless = prepared, view, endless
        tables, made = prepared.tables, prepared.triangles
        samples = plan["samples"]
        x0, _, x1, _ = plan["crop"]
        self.crop = np.array(plan["crop"], np.int64)
        self.each = samples > 1 and plan["raster.shading"] == "sample"
        self.places, self.weights = _weights(plan["filter"], samples)
        self.pattern, self.splat = self.places.tables, self.weights.tables
        self.margin = 4 * -(-self.splat.reach // 4)
        self.rows = ROWS.get(samples, 16)
        self.drawn = Handle(bands.drawn(made.shown, made.meshlets, made.placed, plan["crop"], self.splat.reach, self.rows))
        self.patterned = True if _patterned(tables) else None
        how, self.fill = plan["raster.fill"], None
        if how != "edges":
            self.fill = classic.Fill(how, tables, prepared.packed, view, made.model, made.ranges, made.meshlets.tables)
        self.plain = plan["raster.precision"] == "float32"
        self.background = plan["background"]
        self.rgba = np.zeros((self.crop[3] - self.crop[1], self.crop[2] - self.crop[0], 4), np.float32)
        self.jobs: Sequence[int] = range(int(self.crop[1]) // self.rows, -(-int(self.crop[3]) // self.rows))

        columns, most = x1 - (x0 & ~3) + 2 * self.margin, int(made.placed[:, 1].sum())
        self.size = _Size(columns, self.rows + 2 * self.margin, samples, self.plain, self.patterned is not None, most)
        self.turn = object()

    def draw(self, job: int) -> int:
        """Draw a band into `rgba`; how many of its items were not finite and left out."""
        free = self.prepared.triangles.rooms.setdefault(self.size, [])
        try:
            room = free.pop()
        except IndexError:
            room = _Room(self)
        issues = self._draw(job, room)
        free.append(room)
        return issues

    def _draw(self, job: int, room: _Room) -> int:
        x0, y0, x1, y1 = (int(c) for c in self.crop)
        reach = self.splat.reach
        top, bottom = max(job * self.rows, y0), min((job + 1) * self.rows, y1)
        band = room.band.tables
        band.place[:2] = (x0 & ~3) - self.margin, job * self.rows - self.margin  # on a grid of blocks that no crop moves
        band.clip[:] = x0 - reach, top - reach, x1 + reach, bottom + reach
        band.rows[:] = top, bottom
        made, drawn = self.prepared.triangles, self.drawn
        room.serve(self)
        if self.fill is None:
            setup.draw_band(room.filling, job - self.jobs[0])
        else:
            self.fill.draw(room.band, self.pattern, drawn.tables)
        p = self.prepared
        if len(self.endless):
            traced.draw_endless(made.model, self.endless, p.packed, p.accel, self.view, self.places, room.band)
        if self.plain and len(drawn.tables.first) == 0:
            pass  # an empty picture, maybe of an empty scene
        elif self.plain:
            deferred.shade_band(room.shading, self.each, self.patterned, self.crop, self.rgba)
        else:
            traced.shade_band(
                made.model, self.places, self.each, made.meshlets, drawn, p.packed, p.accel, p.gouraud, p.frame, self.weights, room.band,
                room.items, room.stack, self.crop, self.rgba,
            )  # fmt: skip
        self._behind(top, bottom)
        return int(room.items.tables.counts[3])

    def _behind(self, top: int, bottom: int) -> None:
        """Put the background behind rows of pixels."""
        x0, y0, _, _ = (int(c) for c in self.crop)
        window = self.rgba[top - y0 : bottom - y0]
        if self.background == "transparent":
            return
        if self.background == "sky":
            traced.sky_behind(self.prepared.packed, self.prepared.frame, x0, top, window)
        else:
            window[..., :3] += (1.0 - window[..., 3:]) * np.asarray(self.background, np.float32)


class _Size(NamedTuple):
    """What a thread's memory depends on."""

    columns: int
    rows: int
    samples: int
    plain: bool
    patterned: bool
    meshlets: int


class _Room:
    """What a thread needs to draw a band. It is kept for the next picture: getting memory from the system takes long."""

    def __init__(self, of: Bands) -> None:
        size = of.size
        self.band = Handle(bands.band_for(size.columns, size.rows, size.samples))
        self.items = Handle(deferred.items_for(size.columns, size.samples))
        most = 2 * self.items.tables.half
        self.faces = Handle(faces.faces_for(size.meshlets, most, size.patterned)) if size.plain else None
        self.stack = None if size.plain else integrate.stack_for(of.prepared.options, across.WIDTH)
        self._turn: object = None

    def serve(self, of: Bands) -> None:
        """Be of use to a picture from now on."""
        if self._turn is of.turn:
            return
        self._turn, made = of.turn, of.prepared.triangles
        self.filling = Handle(bands.Filling(made.shown, of.places, made.meshlets, of.drawn, self.band))
        if self.faces is not None:
            faces.forget(self.faces.tables)
            self.shading = Handle(deferred.Shading(
                made.shown, of.places, made.meshlets, of.drawn, made.lit, made.look, of.weights, self.band, self.faces, self.items,
            ))  # fmt: skip


@functools.cache
def _weights(name: str, samples: int) -> tuple[Handle, Handle]:
    """Handles of a bands.Pattern and of its Splat."""
    pattern = bands.pattern(samples)
    return Handle(pattern), Handle(_splat(name, pattern))


def _splat(name: str, pattern: bands.Pattern) -> deferred.Splat:
    """How a pixel's samples count for the pixels around it; all of what counts for a pixel adds up to 1."""
    side, count = deferred.SIDE, len(pattern.x)
    reach = int(np.ceil(sampler.FILTER_RADIUS[name] - 0.5)) if count > 1 else 0
    away = np.arange(side) - deferred.REACH
    dx = (pattern.x / fill.ONE - 0.5)[:, None] - away
    dy = (pattern.y / fill.ONE - 0.5)[:, None] - away
    weight = sampler.filter_weight(name, dy)[:, :, None] * sampler.filter_weight(name, dx)[:, None, :]
    if count == 1:
        weight = np.zeros_like(weight)
        weight[0, deferred.REACH, deferred.REACH] = 1.0
    weight = np.round(weight / weight.sum() * EXACT) / EXACT
    weight[np.unravel_index(weight.argmax(), weight.shape)] += 1.0 - weight.sum()
    table = np.zeros((4, 16, side * side))
    for s in range(count):
        for bits in range(16):
            if bits >> (s % 4) & 1:
                table[s // 4, bits] += weight[s].ravel()
    return deferred.Splat(table.astype(np.float32), reach, -(-count // 4))


def _patterned(tables: ir.Tables) -> bool:
    """Whether a material has a texture or a mesh colours of its own."""
    return bool((tables.materials.textures >= 0).any() or (tables.geometries.colors >= 0).any())


def _look(tables: ir.Tables, view: View, eye: NDArray[np.float64]) -> faces.Look:
    """Rays through three pixel corners, in the world about the eye."""
    ray = camera.ray(tables, view, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    start, direction = (np.stack([np.broadcast_to(c, 3) for c in vector], axis=1) for vector in (ray.origin, ray.direction))
    axis = -tables.transforms.inverse[tables.cameras.transform[view.camera], 2, :3]
    direction = direction / (direction @ axis)[:, None]
    start = start - eye - direction * ((start - eye) @ axis)[:, None]  # from the plane of the eye on, as depths count
    steps = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    inverse = tables.transforms.inverse[tables.instances.transform]
    local = inverse.copy()
    local[:, :, 3] += np.einsum("nij,j->ni", inverse[:, :, :3], eye)
    return faces.Look(*(np.ascontiguousarray(a, np.float32) for a in (steps @ direction, steps @ start, local)))
