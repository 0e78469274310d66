"""Geometries as shapes of the language, and meshes as .ply files beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....shapes import SHAPES
from ... import ir
from ..export import Export
from ..ply_file import encode
from . import words
from .files import Files

Kind = ir.GeometryKind
_LIKELY = 0.002, 20.0  # metres: sizes of meshes that are read without a note about their unit
Columns = dict[str, NDArray[Any]]


def _capped(text: float) -> str | None:
    return None if text else "false"


def _quadric(p: Sequence[float]) -> str:
    if np.isfinite(p[10]):
        return words.call("quadric", words.numbers(p[:10]), within=words.one_or_all([2 * v for v in p[10:13]]))
    return words.call("quadric", words.numbers(p[:10]))


def _rectangle(p: Sequence[float]) -> str:
    x, z = p[0], p[1]
    corners = [(-x, z), (x, z), (x, -z), (-x, -z)]
    points = f"[{', '.join(words.numbers((a, 0.0, b)) for a, b in corners)}]"
    return words.call("polygon", points, uv="[[0, 0], [1, 0], [1, 1], [0, 1]]")


_TEXTS: dict[int, Callable[[Sequence[float]], str]] = {
    Kind.SPHERE: lambda p: words.call("sphere", words.number(p[0])),
    Kind.BOX: lambda p: words.call("box", words.one_or_all([2 * v for v in p[:3]])),
    Kind.PLANE: lambda p: "plane(y: 0)",
    Kind.RECTANGLE: _rectangle,
    Kind.DISK: lambda p: words.call("disk", words.number(p[0])),
    Kind.CYLINDER: lambda p: words.call("cylinder", words.number(p[0]), words.number(2 * p[1]), capped=_capped(p[2])),
    Kind.CONE: lambda p: words.call(
        "cone", words.number(p[0]), words.number(2 * p[2]), top=words.number(p[1]) if p[1] else None, capped=_capped(p[3])
    ),
    Kind.TORUS: lambda p: words.call("torus", words.number(p[0]), words.number(p[1])),
    Kind.CAPSULE: lambda p: words.call("capsule", words.number(p[0]), words.number(2 * p[1])),
    Kind.QUADRIC: _quadric,
}


class Shapes:
    """The texts of geometries; meshes are written once."""

    def __init__(self, out: Export, files: Files, tessellate: Callable[[int], Any]) -> None:
        self.out, self.files, self.tables = out, files, out.scene.tables
        self._tessellate = tessellate
        self._texts: dict[Any, str | None] = {}

    def is_exact(self, g: int) -> bool:
        """Whether a geometry is a mesh, or a shape of the language."""
        return int(self.tables.geometries.kind[g]) in _TEXTS or self.tables.geometries.kind[g] == Kind.MESH

    def text(self, instance: int, source: str, single_sided: bool = False) -> str | None:
        """The call for the geometry of an instance, without its place; None, after a report, without one."""
        g = int(self.tables.instances.geometry[instance])
        key = (g, single_sided) if self.is_exact(g) else ("triangles", g, instance)
        if key not in self._texts:
            self._texts[key] = self._text(instance, g, source, single_sided)
        return self._texts[key]

    def _text(self, instance: int, g: int, source: str, single_sided: bool) -> str | None:
        geometries, kind = self.tables.geometries, int(self.tables.geometries.kind[g])
        if kind in _TEXTS:
            return _TEXTS[kind](geometries.parameters[g].tolist())
        if kind == Kind.MESH:
            names = self.out.scene.names.geometries
            columns, triangles = mesh_columns(self.tables, g)
            return self.mesh(columns, triangles, (names[g] if g < len(names) else "") or source, single_sided)
        if self.out.is_endless(instance):
            return None
        return self.triangles(instance, source)

    def triangles(self, instance: int, source: str, chosen: NDArray[np.intp] | None = None) -> str | None:
        """A shape that is no shape of the language as triangles, or some of them."""
        positions, triangles, normals, uvs, _ = self._tessellate(instance)
        if not len(triangles):
            self.out.cannot("this has no surface, or is thinner than the cells in which it is sampled: left out", "instances", instance)
            return None
        kind = ir.GeometryKind(int(self.tables.geometries.kind[self.tables.instances.geometry[instance]]))
        if kind not in SHAPES or not SHAPES[kind].EXACT:
            self.out.note(f"a {kind.name.lower()} is carried as {len(triangles)} triangles", "instances", instance)
        columns = _columns(positions, normals.astype(np.float32), uvs.astype(np.float32), None)
        return self.mesh(columns, triangles if chosen is None else triangles[chosen], source)

    def mesh(self, columns: Columns, triangles: NDArray[Any], source: str, single_sided: bool = False) -> str:
        """A mesh in a file beside the scene."""
        file = self.files.add(source, "mesh", ".ply", encode(columns, triangles))
        side = max(float(np.ptp(columns[axis])) for axis in "xyz")
        more = {} if _LIKELY[0] < side < _LIKELY[1] else {"unit": words.string("m"), "up": words.string("y")}
        return words.call("mesh", words.string(file), **more, single_sided="true" if single_sided else None)


def mesh_columns(tables: ir.Tables, g: int) -> tuple[Columns, NDArray[np.int32]]:
    """The properties of vertices and the triangles of a MESH geometry; vertices are doubled where their corners differ."""
    geometries = tables.geometries
    stored, triangles = ir.mesh_arrays(tables, g)
    positions = stored.astype(np.float64) + geometries.origin[g]
    rows = [int(column[g]) for column in (geometries.normals, geometries.uvs, geometries.colors)]
    vertex = ir.Interpolation.VERTEX
    if rows[0] >= 0 and all(row < 0 or tables.attributes.interpolation[row] == vertex for row in rows):
        values = [None if row < 0 else _stored(tables, row) for row in rows]
        return _columns(positions, *values), triangles
    corners = [None if row < 0 else _at_corners(tables, row, triangles) for row in rows]
    corners[0] = _flat(positions, triangles) if corners[0] is None else corners[0]
    index = triangles.reshape(-1)
    keys = np.concatenate([index[:, None].astype(np.float64), *(c for c in corners if c is not None)], axis=1)
    _, first, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return _columns(positions[index[first]], *(None if c is None else c[first] for c in corners)), number.reshape(-1, 3).astype(np.int32)


def _stored(tables: ir.Tables, row: int) -> NDArray[np.float32]:
    attributes, first, width = tables.attributes, int(tables.attributes.first[row]), int(tables.attributes.width[row])
    return tables.pools.values[first : first + int(attributes.count[row]) * width].reshape(-1, width)


def _at_corners(tables: ir.Tables, row: int, triangles: NDArray[np.int32]) -> NDArray[np.float32]:
    values, how = _stored(tables, row), ir.Interpolation(int(tables.attributes.interpolation[row]))
    if how == ir.Interpolation.CONSTANT:
        return np.repeat(values[:1], 3 * len(triangles), axis=0)
    if how == ir.Interpolation.FACE:
        return np.repeat(values, 3, axis=0)
    return values if how == ir.Interpolation.CORNER else values[triangles.reshape(-1)]


def _flat(positions: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float32]:
    """The normals of faces at their corners, for a mesh that has no others."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    return np.repeat(normals.astype(np.float32), 3, axis=0)


def _columns(positions: NDArray[Any], normals: Any, uvs: Any, colors: Any) -> Columns:
    columns: Columns = {axis: positions[:, k].astype(np.float64) for k, axis in enumerate("xyz")}
    tints = None if colors is None else _srgb(colors)
    for names, values in ((("nx", "ny", "nz"), normals), (("s", "t"), uvs), (("red", "green", "blue"), tints)):
        if values is not None:
            columns |= {name: values[:, k] for k, name in enumerate(names)}
    return columns


def _srgb(colors: NDArray[Any]) -> NDArray[np.float64]:
    """Encoded colours, as .ply files have them, with the digits that give the same linear ones."""
    linear = np.clip(colors.astype(np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
