"""Bakes the patterns of a scene: a picture for each texture of a material on a mesh, in an atlas of that mesh.

Objects share a picture where they have one mesh, one material and one scale along each axis: a pattern lies in the frame of the object.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ... import ir
from ...ir import F64
from ...mesh.shells import Converters, Shell
from ..bodies import Bodies, Body, part_of
from ..export import Export
from . import mixture, pixels
from .atlas import Atlas, make_atlas
from .extension import Extension

Slot = ir.Slot
SIDE = 1024  # texels of the largest picture, by default
MOST = 16  # of the area of the largest picture: all pictures of one input together
SMALLEST = 0.5  # side of the smallest picture over that of the largest
_LEVEL = 1.0 / 1024.0  # a texture whose values differ by less of the largest is a constant
_LARGEST = 1e30
_UNBOUNDED = frozenset(
    (
        Slot.SHININESS,
        Slot.IOR,
        Slot.COAT_IOR,
        Slot.FILM_IOR,
        Slot.FILM_THICKNESS,
        Slot.RADIUS,
        Slot.ROTATION,
        Slot.COAT_ROTATION,
    )
)  # numbers that may exceed 1
NO_ROOM = "its patterns are left out: the mesh has more separate parts than its picture has texels"
_HINT = "--bake gives the side of the largest picture"


class Style(NamedTuple):
    """What a format needs baked."""

    side: int  # texels of the largest picture; 0: nothing is baked
    slots: frozenset[ir.Slot]  # inputs that have pictures in the format
    is_needed: Callable[[int], bool]  # whether the format lacks a texture (a row) of these
    together: tuple[frozenset[ir.Slot], ...] = ()  # inputs that are channels of one picture
    has_graph: Callable[[int], bool] = lambda texture: False  # whether the format has a texture as nodes, too, beside the picture


class Baked(NamedTuple):
    """A scene whose bodies have baked materials."""

    out: Export
    bodies: list[Body]
    coordinates: dict[int, F64]  # (m, 3, 2) corners of triangles in the picture of a baked texture (a row)
    sources: dict[int, int]  # of baked materials that are no mixtures (rows): the materials with formulas


class _Job(NamedTuple):
    """A material on a part of a mesh."""

    row: int
    instance: int
    shell: Shell
    stretch: F64  # (3,)
    slots: list[ir.Slot]
    area: float  # m², times the square of the fineness
    fineness: F64 | None  # (m,) of the triangles; see make_charts


def bodies_of(out: Export, converters: Converters, side: int) -> Bodies:
    """The bodies of a scene, for `bake`: without pictures (a side of 0), blends are divided by triangles."""
    return Bodies(out, converters, lambda instance: side > 0 and mixture.is_mixture(out, instance))


def bake(out: Export, bodies: list[Body], converters: Converters, style: Style) -> Baked:
    """Bakes what the format lacks. Reports the size of the pictures at each material."""
    jobs: dict[Hashable, _Job] = {}
    keys: dict[tuple[int, int], Hashable] = {}  # of a body and a part of it
    for k, body in enumerate(bodies):
        stretch = np.linalg.norm(body.matrix[:3, :3], axis=0)
        for part, (row, chosen) in enumerate(body.parts):
            is_mixed = out.scene.tables.materials.model[row] == ir.MaterialModel.BLEND
            slots = [] if is_mixed else _slots(out.scene.tables, row, style)
            if (is_mixed or slots) and out.scene.tables.instances.light[body.instance] < 0:
                key = keys[k, part] = (body.key, part, stretch.astype(np.float32).tobytes())
                if key not in jobs:
                    shell = part_of(body.shell, chosen)
                    fineness = _fineness(out.scene.tables, body.instance, shell)
                    jobs[key] = _Job(row, body.instance, shell, stretch, slots, _area(shell, stretch, fineness), fineness)
    if not jobs:
        return Baked(out, bodies, {}, {})
    bakery = _Bakery(out, converters, style.has_graph)
    sides = _sides([job.area for job in jobs.values()], style.side)
    rows = {key: bakery.material(job, side) for (key, job), side in zip(jobs.items(), sides, strict=True)}
    bakery.report()
    changed = []
    for k, body in enumerate(bodies):
        parts = [(rows[keys[k, part]] if (k, part) in keys else row, chosen) for part, (row, chosen) in enumerate(body.parts)]
        changed.append(body._replace(parts=parts, key=(body.key, tuple(row for row, _ in parts))))
    return Baked(replace(out, scene=bakery.rows.scene), changed, bakery.coordinates, bakery.sources)


def _slots(tables: ir.Tables, row: int, style: Style) -> list[ir.Slot]:
    """The inputs of a material that are baked: those whose textures the format lacks, and their companions."""
    textures = tables.materials.textures[row]
    if not style.side:
        return []
    needed = {slot for slot in style.slots if textures[slot] >= 0 and style.is_needed(int(textures[slot]))}
    needed |= {slot for group in style.together if needed & group for slot in group if textures[slot] >= 0}
    is_formula = textures[Slot.BUMP] >= 0 and tables.textures.kind[textures[Slot.BUMP]] == ir.TextureKind.FORMULA
    if is_formula and textures[Slot.NORMAL] < 0:
        needed.add(Slot.BUMP)
    return sorted(needed)


def _fineness(tables: ir.Tables, instance: int, shell: Shell) -> F64 | None:
    """Factors of the density of texels on an endless plane, which falls with the distance from its middle; None of other shapes."""
    if tables.geometries.kind[tables.instances.geometry[instance]] != ir.GeometryKind.PLANE:
        return None
    away = np.abs(shell.positions - shell.positions.mean(axis=0)).max(axis=1)[shell.triangles].max(axis=1)
    return np.exp2(np.round(np.log2(away.min() / away)))


def _area(shell: Shell, stretch: F64, fineness: F64 | None) -> float:
    a, b, c = (shell.positions[shell.triangles[:, k]] * stretch for k in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float((areas if fineness is None else areas * fineness**2).sum())


def _sides(areas: list[float], side: int) -> list[int]:
    """Texels of the sides of pictures: even over all surfaces, from SMALLEST of the largest on, and no more than MOST together."""
    shares = np.sqrt(np.nan_to_num(areas) / max(float(np.nan_to_num(areas).max()), 1e-300)).clip(SMALLEST, 1.0)
    shares *= min(1.0, (MOST / float((shares**2).sum())) ** 0.5)
    return np.maximum(np.round(side * shares), 8).astype(int).tolist()


class _Surface:
    """The points of a job at the texels of its atlas, and values of textures there."""

    def __init__(self, job: _Job, atlas: Atlas, points: pixels.SurfacePoints, converters: Converters) -> None:
        self.job, self.atlas, self._points, self._converters = job, atlas, points, converters
        self._known: dict[int, F64] = {}

    def values(self, texture: int) -> F64:
        """(k, 3) values of a texture (a row); 0 where it has none."""
        if texture not in self._known:
            self._known[texture] = np.nan_to_num(self._converters.texture(texture, self.job.instance, self._points))
        return self._known[texture]

    def normals(self, texture: int, factor: float) -> F64:
        """(k, 3) normals of the heights of a texture times a factor."""

        def heights(points: pixels.SurfacePoints) -> F64:
            return factor * self._converters.texture(texture, self.job.instance, points)

        return pixels.normals_of_heights(self._points, self.job.shell, self.atlas, self.job.stretch, heights)


class _Bakery:
    """New materials with pictures, and the sizes of these."""

    def __init__(self, out: Export, converters: Converters, has_graph: Callable[[int], bool]) -> None:
        self.out, self.tables, self._converters, self._has_graph = out, out.scene.tables, converters, has_graph
        self.rows = Extension(out.scene)
        self.coordinates: dict[int, F64] = {}
        self.sources: dict[int, int] = {}
        self._without_graphs = set[int]()  # rows of materials some of whose patterns have pictures alone
        self._atlases: dict[int, list[Atlas]] = {}  # of rows of materials

    def material(self, job: _Job, side: int) -> int:
        """The row of the material of a job, with pictures in place of its patterns."""
        m = self.tables.materials
        is_mixed = m.model[job.row] == ir.MaterialModel.BLEND
        atlas = make_atlas(job.shell.positions * job.stretch, job.shell.triangles, side, job.fineness)
        if atlas is None:
            self.out.cannot(NO_ROOM, "materials", job.row, _HINT)
            return next(mixture.parts_of(self.tables, job.row)) if is_mixed else job.row
        surface = _Surface(job, atlas, pixels.surface_points(job.shell, atlas), self._converters)
        if is_mixed:
            self.out.note(mixture.NOTE, "materials", job.row)
            columns = self._mixed(surface)
        else:
            columns = self._of_pictures(surface)
        if (columns["textures"] >= len(self.tables.textures.kind)).any():
            self._atlases.setdefault(job.row, []).append(atlas)
        if is_mixed or not all(slot != Slot.BUMP and self._has_graph(int(m.textures[job.row, slot])) for slot in job.slots):
            self._without_graphs.add(job.row)
        row = self.rows.material(job.row, columns)
        if not is_mixed:
            self.sources[row] = job.row
        return row

    def _of_pictures(self, surface: _Surface) -> dict[str, Any]:
        """Inputs of a material with pictures in place of its textures."""
        m, job = self.tables.materials, surface.job
        values, textures = m.values[job.row].copy(), m.textures[job.row].copy()
        for slot in job.slots:
            source = int(textures[slot])
            if slot == Slot.BUMP:
                textures[slot], values[slot] = -1, 0.0
                normals = surface.normals(source, float(m.values[job.row, slot, 0]))
                values[Slot.NORMAL], textures[Slot.NORMAL] = 1.0, self._directions(surface.atlas, normals, source)
            else:
                values[slot], textures[slot] = self._input(surface.atlas, slot, values[slot], surface.values(source), source)
        return {"values": values, "textures": textures}

    def _mixed(self, surface: _Surface) -> dict[str, Any]:
        """Columns of the material of a blend, as one surface."""
        row = surface.job.row
        values, textures = np.zeros((ir.SLOTS, 3)), np.full(ir.SLOTS, -1, np.int32)
        source = max(int(self.tables.materials.textures[row, Slot.WEIGHT]), 0)
        for slot, mixed in mixture.inputs(self.out, row, surface.values).items():
            values[slot], textures[slot] = self._input(surface.atlas, slot, np.ones(3), mixed, source)
        normals = mixture.slopes(self.tables, row, surface.values, surface.normals)
        if normals is not None:
            values[Slot.NORMAL], textures[Slot.NORMAL] = 1.0, self._directions(surface.atlas, normals, source)
        columns = {"values": values, "textures": textures, "model": int(mixture.MODEL), "first": -1, "second": -1}
        return columns | {"textured": bool((textures >= 0).any()), "shading": int(ir.Shading.SMOOTH)}

    def _directions(self, atlas: Atlas, normals: F64, source: int) -> int:
        """The row of a normal map."""
        return self._picture(atlas, 0.5 * normals + 0.5, source, True)

    def _input(self, atlas: Atlas, slot: ir.Slot, factor: F64, values: F64, source: int) -> tuple[F64, int]:
        """(constant, texture) of an input with values (k, 3) times a factor."""
        if slot not in ir.COLOR_SLOTS:
            values = np.repeat(values[:, :1], 3, axis=1)
            if slot not in _UNBOUNDED:
                values = np.minimum(values, 1.0 / max(float(factor[0]), 1e-9))
        values = values.clip(0.0, _LARGEST)
        peak = float(values.max(initial=0.0))
        if float(np.ptp(values, axis=0).max()) <= _LEVEL * peak:
            return factor * values.mean(axis=0), -1
        return factor * peak, self._picture(atlas, values / peak, source, False)

    def _picture(self, atlas: Atlas, values: F64, source: int, is_direction: bool) -> int:
        row = self.rows.picture(pixels.picture(atlas, values), source, is_direction)
        self.coordinates[row] = atlas.coordinates
        return row

    def report(self) -> None:
        """Report the sizes of pictures, once for a material."""
        for row, atlases in self._atlases.items():
            coarse = min(atlases, key=lambda atlas: atlas.density)
            size = f"{coarse.width} × {coarse.height} texels of {1000.0 / coarse.density:.2g} mm"
            often = f", and {len(atlases) - 1} more that are finer" if len(atlases) > 1 else ""
            message = f"patterns are baked into pictures of {size}{often}"
            if row in self._without_graphs:
                self.out.cannot(f"{message}: smaller details are lost", "materials", row, _HINT)
            else:
                self.out.note(f"{message}, for programs that do not read graphs", "materials", row)
