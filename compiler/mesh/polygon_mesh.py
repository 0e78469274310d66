"""Polygon mesh as read from a file, and its conversion to a triangle mesh."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .. import ir
from ..io import stage_cache
from ..scene.row_records import MeshAttribute, MeshData, Outlines
from . import triangulate, vertex_normals

_Kind = ir.Interpolation


@dataclass(frozen=True, slots=True, eq=False)
class PolyMesh:
    """A mesh of faces without holes, counter-clockwise from outside. Attributes count the file's own faces and corners:

    FACE has one value a polygon, CORNER one for each entry of `indices`.
    """

    points: np.ndarray  # (n, 3) float64
    counts: np.ndarray  # (f,) corners of each face
    indices: np.ndarray  # (sum of counts,) rows of points
    normals: MeshAttribute | None = None
    uvs: MeshAttribute | None = None
    colors: MeshAttribute | None = None
    groups: np.ndarray | None = None  # (f,) smoothing group of each face, 0: flat


def assemble(mesh: PolyMesh, crease: float = vertex_normals.CREASE, name: str = "") -> tuple[MeshData, int]:
    """Triangulates a polygon mesh: (mesh, number of faces dropped for zero area).

    Unused vertices are removed. Missing, non-finite or zero normals are computed. With `groups`, normals are smooth within each
    smoothing
    group. Without, they are smooth except across creases sharper than `crease` radians (0: flat faces).
    """
    return stage_cache.cached("meshes triangulated", (mesh, crease, name), lambda: _assemble(mesh, crease, name))


def _assemble(mesh: PolyMesh, crease: float, name: str) -> tuple[MeshData, int]:
    cut = triangulate.faces(mesh.points, mesh.indices, mesh.counts)
    triangles = np.asarray(mesh.indices)[cut.corners]
    used, triangles = _compact(triangles, len(mesh.points))
    points = np.asarray(mesh.points, dtype=np.float64)[used]
    attributes = {
        name: _spread(attribute, cut, used, triangles, len(points))
        for name, attribute in (("normals", mesh.normals), ("uvs", mesh.uvs), ("colors", mesh.colors))
    }
    groups = None if mesh.groups is None else np.asarray(mesh.groups)[cut.faces]
    attributes["normals"] = _normals(attributes["normals"], points, triangles, crease, groups)
    outlines = _outlines(mesh, cut, used) if (np.asarray(mesh.counts) > 3).any() else None
    return MeshData(points, triangles, attributes["normals"], attributes["uvs"], attributes["colors"], outlines, name), cut.dropped


def subset(mesh: PolyMesh, faces: np.ndarray) -> PolyMesh:
    """The mesh with only the faces of the given rows; all vertices stay."""
    counts = np.asarray(mesh.counts, dtype=np.int64)
    firsts = np.cumsum(counts) - counts
    taken = counts[faces]
    corners = np.repeat(firsts[faces] - (np.cumsum(taken) - taken), taken) + np.arange(int(taken.sum()))

    def pick(attribute: MeshAttribute | None) -> MeshAttribute | None:
        if attribute is None or attribute.interpolation in (_Kind.CONSTANT, _Kind.VERTEX):
            return attribute
        rows = faces if attribute.interpolation == _Kind.FACE else corners
        return MeshAttribute(attribute.values[rows], attribute.interpolation)

    groups = None if mesh.groups is None else mesh.groups[faces]
    return PolyMesh(mesh.points, taken, np.asarray(mesh.indices)[corners], pick(mesh.normals), pick(mesh.uvs), pick(mesh.colors), groups)


def split(mesh: PolyMesh, labels: np.ndarray) -> Iterator[tuple[int, PolyMesh]]:
    """(label, its faces as a mesh without other vertices) for the labels (f,) of a mesh's faces, ascending. Takes linear time in all."""
    order = np.argsort(labels, kind="stable")
    present, firsts = np.unique(labels[order], return_index=True)
    if len(present) <= 1:
        yield from ((int(label), mesh) for label in present)
        return
    ordered = subset(mesh, order)
    ends = np.cumsum(ordered.counts)
    for label, first, last in zip(present, firsts, [*firsts[1:], len(order)], strict=True):
        faces, corners = slice(first, last), slice(ends[first] - ordered.counts[first], ends[last - 1])
        used, indices = np.unique(ordered.indices[corners], return_inverse=True)
        rows = {_Kind.CONSTANT: slice(None), _Kind.VERTEX: used, _Kind.FACE: faces, _Kind.CORNER: corners}
        normals, uvs, colors = (
            a and MeshAttribute(a.values[rows[a.interpolation]], a.interpolation) for a in (ordered.normals, ordered.uvs, ordered.colors)
        )
        groups = None if ordered.groups is None else ordered.groups[faces]
        yield int(label), PolyMesh(ordered.points[used], ordered.counts[faces], indices, normals, uvs, colors, groups)


def flip(mesh: PolyMesh) -> PolyMesh:
    """The mesh with reversed winding; corner attributes follow."""
    counts = np.asarray(mesh.counts, dtype=np.int64)
    firsts = np.cumsum(counts) - counts
    order = np.repeat(2 * firsts + counts - 1, counts) - np.arange(int(counts.sum()))

    def reordered(attribute: MeshAttribute | None) -> MeshAttribute | None:
        if attribute is None or attribute.interpolation != _Kind.CORNER:
            return attribute
        return MeshAttribute(attribute.values[order], _Kind.CORNER)

    indices = np.asarray(mesh.indices)[order]
    return PolyMesh(mesh.points, counts, indices, reordered(mesh.normals), reordered(mesh.uvs), reordered(mesh.colors), mesh.groups)


def _compact(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of used vertices, and the triangles renumbered to them."""
    seen = np.zeros(count, dtype=bool)
    seen[triangles.reshape(-1)] = True
    if seen.all():
        return np.arange(count), triangles.astype(np.int32)
    renumbered = np.cumsum(seen) - 1
    return np.flatnonzero(seen), renumbered[triangles].astype(np.int32)


def _spread(
    attribute: MeshAttribute | None, cut: triangulate.Cut, used: np.ndarray, triangles: np.ndarray, count: int
) -> MeshAttribute | None:
    """Resamples an attribute of polygons to triangles."""
    if attribute is None or attribute.interpolation == _Kind.CONSTANT:
        return attribute
    values = np.asarray(attribute.values, dtype=np.float32)
    if attribute.interpolation == _Kind.VERTEX:
        return MeshAttribute(values[used], _Kind.VERTEX)
    if attribute.interpolation == _Kind.FACE:
        return MeshAttribute(values[cut.faces], _Kind.FACE)
    return by_vertex(values[cut.corners.reshape(-1)], triangles, count)


def by_vertex(values: np.ndarray, triangles: np.ndarray, count: int) -> MeshAttribute:
    """Values (3t, width) at corners as VERTEX values where all corners of each vertex agree, else as CORNER values."""
    rows = triangles.reshape(-1)
    at_vertices = np.zeros((count, values.shape[1]), dtype=values.dtype)
    at_vertices[rows] = values
    if np.array_equal(at_vertices[rows], values):
        return MeshAttribute(at_vertices, _Kind.VERTEX)
    return MeshAttribute(values, _Kind.CORNER)


def _normals(
    attribute: MeshAttribute | None, points: np.ndarray, triangles: np.ndarray, crease: float, groups: np.ndarray | None
) -> MeshAttribute | None:
    if attribute is not None:
        with np.errstate(all="ignore"):
            length = np.linalg.norm(attribute.values, axis=1)
            good = np.isfinite(length) & (length > 1e-12)
            unit = np.where(good[:, None], attribute.values / np.where(good, length, 1.0)[:, None], 0.0).astype(np.float32)
        if good.all():
            return MeshAttribute(unit, attribute.interpolation)
        if not good.any():
            return _normals(None, points, triangles, crease, groups)
        attribute = MeshAttribute(unit, attribute.interpolation)
    elif crease <= 0 and groups is None:
        return None
    computed = vertex_normals.corner_normals(points, triangles, max(crease, 1e-6), groups).reshape(-1, 3)
    if attribute is not None:
        at_corners = corner_values(attribute, 3, triangles.reshape(-1))
        missing = ~np.any(at_corners != 0, axis=1)
        computed = np.where(missing[:, None], computed, at_corners)
    return by_vertex(computed, triangles, len(points))


def corner_values(attribute: MeshAttribute, counts: np.ndarray | int, indices: np.ndarray) -> np.ndarray:
    """Values (c, width) at the corners of faces with `counts` corners each, whose vertices are `indices` (c,)."""
    if attribute.interpolation == _Kind.VERTEX:
        return attribute.values[indices]
    if attribute.interpolation == _Kind.FACE:
        return np.repeat(attribute.values, counts, axis=0)
    if attribute.interpolation == _Kind.CONSTANT:
        return np.repeat(attribute.values[:1], len(indices), axis=0)
    return attribute.values


def _outlines(mesh: PolyMesh, cut: triangulate.Cut, used: np.ndarray) -> Outlines:
    """Outlines of the triangulated faces."""
    drawn, first_triangle, triangle_count = np.unique(cut.faces, return_index=True, return_counts=True)
    visible = subset(PolyMesh(mesh.points, mesh.counts, mesh.indices), drawn)
    renumbered = np.zeros(len(mesh.points), dtype=np.int32)
    renumbered[used] = np.arange(len(used), dtype=np.int32)
    loops = np.stack([np.cumsum(visible.counts) - visible.counts, visible.counts], axis=1)
    polygons = np.stack([np.arange(len(drawn)), np.ones(len(drawn), np.int64), first_triangle, triangle_count], axis=1)
    # Collinear corners that ear clipping skipped are not among the vertices: remove them too.
    return _without_unused(renumbered[visible.indices], np.isin(visible.indices, used), loops, polygons)


def _without_unused(corners: np.ndarray, present: np.ndarray, loops: np.ndarray, polygons: np.ndarray) -> Outlines:
    if not present.all():
        sizes = np.add.reduceat(present.astype(np.int64), loops[:, 0])
        loops = np.stack([np.cumsum(sizes) - sizes, sizes], axis=1)
        corners = corners[present]
    return Outlines(corners.astype(np.int32), loops.astype(np.int32), polygons.astype(np.int32))
