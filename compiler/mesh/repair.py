"""Repairs polygon meshes: merges vertices, removes doubled faces, winds faces one way and outwards, fills holes.

trimesh does the same face by face and needs networkx; this is done on arrays. Nothing is repaired without a word.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from ..ir import F64, I64
from ..scene.row_records import MeshAttribute
from . import mesh_csg, triangulate
from .polygon_mesh import PolyMesh
from .topology import connected_vertices, winding_number

NEAR = 1e-6  # of the extent: vertices nearer to each other are merged
LARGEST_HOLE = 0.5  # of the area of the connected surface that it is in
MOST_SIDES = 10_000  # of a hole
MOST_BODIES = 64  # whose places in each other are looked at
_Kind = ir.Interpolation


@dataclass(eq=False)
class Repair:
    """What was repaired and what could not be, in words."""

    done: list[str] = field(default_factory=list)
    unrepaired: list[str] = field(default_factory=list)

    def did(self, count: int, singular: str, plural: str) -> None:
        """Add `count` repairs, if any."""
        if count:
            self.done.append(f"{count:,} {singular if count == 1 else plural}")

    def tell(self, what: str, diagnostics: Diagnostics, span: Span | None) -> None:
        """A note of what was repaired in `what`, and a warning of what stays."""
        if self.done or not self.unrepaired:
            diagnostics.note(f"repaired {what}: {', '.join(self.done)}" if self.done else f"{what} needs no repair", span)
        if self.unrepaired:
            diagnostics.warning(f"not repaired in {what}: {'; '.join(self.unrepaired)}", span)

    def could_not(self, count: int, singular: str, plural: str) -> None:
        """Add `count` faults that stay, if any."""
        if count:
            self.unrepaired.append(f"{count:,} {singular if count == 1 else plural}")


def repaired(mesh: PolyMesh, fill: bool = True) -> tuple[PolyMesh, I64 | None, Repair]:
    """(the repaired mesh of triangles, the face of the file that each stands for, what was done). Without repairs: the mesh, None.

    A hole is filled if its boundary is closed, and its area is at most LARGEST_HOLE of that of the connected surface that it is in.
    """
    said = Repair()
    cut = triangulate.faces(mesh.points, mesh.indices, mesh.counts)
    said.did(cut.dropped, "face without area removed", "faces without area removed")
    corners, owner = cut.corners.astype(np.int64), cut.faces.astype(np.int64)
    points, vertex = _merged(np.asarray(mesh.points, np.float64), said)
    faces = vertex[np.asarray(mesh.indices, np.int64)[corners]]
    distinct = _kept(faces, said)
    faces, corners, owner = faces[distinct], corners[distinct], owner[distinct]
    turned = _turned(faces, said)
    faces[turned], corners[turned] = faces[turned][:, ::-1], corners[turned][:, ::-1]
    new, beside = _filled(points, faces, said) if fill else (faces[:0], owner[:0])
    inwards = _inwards(points, np.concatenate([faces, new]), said)
    old = inwards[: len(faces)]
    faces[old], corners[old] = faces[old][:, ::-1], corners[old][:, ::-1]
    new[inwards[len(faces) :]] = new[inwards[len(faces) :]][:, ::-1]
    if not said.done:
        return mesh, None, said
    at_vertex = np.zeros(len(points), np.int64)
    at_vertex[faces] = corners
    corners, owner = np.concatenate([corners, at_vertex[new]]), np.concatenate([owner, owner[beside]])
    all_faces = np.concatenate([faces, new])
    normals, uvs, colors = (_at_corners(a, mesh, corners, owner) for a in (mesh.normals, mesh.uvs, mesh.colors))
    if normals is not None:
        normals = _facing(normals, points, all_faces, turned ^ old, len(faces))
    groups = None if mesh.groups is None else np.asarray(mesh.groups)[owner]
    result = PolyMesh(points, np.full(len(all_faces), 3, np.int64), all_faces.reshape(-1), normals, uvs, colors, groups)
    return result, owner, said


def _merged(points: F64, said: Repair) -> tuple[F64, I64]:
    """(points, the row of each given point): equal ones are one, and so are those nearer than NEAR, by eight shifted grids."""
    places, index = np.unique(points, axis=0, return_inverse=True)
    finite = np.asarray(np.isfinite(places).all(axis=1))
    cell = 2.0 * NEAR * float(np.ptp(places[finite], axis=0).max(initial=0.0)) if finite.any() else 0.0
    if cell <= 0.0:
        return places, index.reshape(-1)
    pairs = []
    for shift in np.ndindex(2, 2, 2):
        cells = np.floor(np.where(finite[:, None], places, 0.0) / cell + 0.5 * np.array(shift))
        cells[~finite] = np.inf
        _, first, inverse = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        pairs.append(np.stack([np.arange(len(places)), np.where(finite, first[inverse.reshape(-1)], np.arange(len(places)))], axis=1))
    label = connected_vertices(len(places), np.concatenate(pairs))
    said.did(len(places) - len(np.unique(label)), "vertex merged with one beside it", "vertices merged with others beside them")
    return places, label[index.reshape(-1)]


def _kept(faces: I64, said: Repair) -> I64:
    """Rows of the faces that have three corners and are the first on these."""
    distinct = np.flatnonzero((faces != np.roll(faces, 1, axis=1)).all(axis=1))
    said.did(len(faces) - len(distinct), "face that the merging closed removed", "faces that the merging closed removed")
    _, first = np.unique(np.sort(faces[distinct], axis=1), axis=0, return_index=True)
    said.did(len(distinct) - len(first), "doubled face removed", "doubled faces removed")
    return distinct[np.sort(first)]


def _sides(faces: I64) -> tuple[I64, I64, I64]:
    """(sides (3 m, 2) of faces in turn, their order by edge, the number of sides at the edge of each in that order)"""
    sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    _, edge, count = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    return sides, order, count[edge[order]]


def _turned(faces: I64, said: Repair) -> np.ndarray:
    """(m,) which faces are wound against most of those that they are connected with."""
    m = len(faces)
    sides, order, count = _sides(faces)
    first, second = order[count == 2].reshape(-1, 2).T
    same = (sides[first, 0] == sides[second, 0]).astype(np.int64)
    a, b = first // 3, second // 3
    label = connected_vertices(2 * m, np.concatenate([np.stack([a, b + m * same], axis=1), np.stack([a + m, b + m * (1 - same)], axis=1)]))
    part = np.minimum(label[:m], label[m:])
    one_sided = label[:m] == label[m:]
    turned = (label[:m] != part) & ~one_sided
    against, together = np.bincount(part, turned, 2 * m), np.bincount(part, minlength=2 * m)
    turned ^= (2 * against > together)[part] & ~one_sided
    said.did(int(turned.sum()), "face turned round to match its neighbours", "faces turned round to match their neighbours")
    said.could_not(len(np.unique(part[one_sided])), "surface has one side alone, as a Möbius strip", "surfaces have one side alone")
    return turned


def _inwards(points: F64, faces: I64, said: Repair) -> np.ndarray:
    """(m,) the faces of closed bodies that face inwards, and of the bodies in these.

    Of more than MOST_BODIES bodies all are turned, if their volume is negative together.
    """
    part = _closed_parts(faces)
    corners = points[faces] - points[faces[:1, :1]].reshape(-1, 1, 3)
    volume = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    bodies, inward = np.unique(part[part >= 0]).tolist(), np.zeros(len(faces), bool)
    if len(bodies) > MOST_BODIES:
        inward = (part >= 0) & (volume[part >= 0].sum() < 0.0)
        bodies = []
    volumes = {body: float(volume[part == body].sum()) for body in bodies}
    for body in bodies:
        point = corners[part == body][0].mean(axis=0)
        around = [other for other in bodies if other != body and round(winding_number(corners[part == other] - point))]
        if volumes[max(around, key=lambda other: abs(volumes[other]), default=body)] < 0.0:
            inward |= part == body
    said.did(int(inward.sum()), "face turned outwards", "faces turned outwards")
    return inward


def _closed_parts(faces: I64) -> I64:
    """(m,) a number for each closed surface that is wound one way; -1 of the others."""
    sides, order, count = _sides(faces)
    first, second = order[count == 2].reshape(-1, 2).T
    part = connected_vertices(len(faces), np.stack([first // 3, second // 3], axis=1))
    sound = np.zeros(len(sides), bool)
    sound[first] = sound[second] = sides[first, 0] != sides[second, 0]
    faults = np.bincount(part, ~sound.reshape(-1, 3).all(axis=1), len(faces))
    return np.where(faults[part] == 0, part, -1)


def _filled(points: F64, faces: I64, said: Repair) -> tuple[I64, I64]:
    """(triangles of the holes that are filled, for each the face whose attributes it gets).

    A filled hole makes its surface larger, and another of its holes may be small enough then: repeated until none is.
    """
    holes, new, beside = 0, faces[:0], np.arange(len(faces))
    while True:
        last = Repair()
        triangles, near, count = _holes(points, np.concatenate([faces, new]), last)
        if not count:
            break
        holes += count
        new, beside = np.concatenate([new, triangles]), np.concatenate([beside, beside[near]])
    said.did(holes, "hole filled", "holes filled")
    said.unrepaired += last.unrepaired
    return new, beside[len(faces) :]


def _holes(points: F64, faces: I64, said: Repair) -> tuple[I64, I64, int]:
    """(triangles of the holes that are filled, for each the face beside it, number of holes)"""
    sides, order, count = _sides(faces)
    border = order[count == 1]
    loops, astray = _loops(sides[border][:, ::-1], border // 3)
    said.could_not(astray, "edge stays open: it is on no closed boundary", "edges stay open: they are on no closed boundary")
    said.could_not(int((count > 2).sum()), "side is at an edge with more than two faces", "sides are at edges with more than two faces")
    a, b, c = (points[faces[:, k]] for k in range(3))
    label = connected_vertices(len(points), faces) if len(faces) else np.arange(len(points))
    twice = np.bincount(label[faces[:, 0]], np.linalg.norm(np.cross(b - a, c - a), axis=1), len(points))
    at_border = np.zeros(len(points), bool)
    at_border[sides[border]] = True
    present = set(map(tuple, np.sort(faces[at_border[faces].all(axis=1)], axis=1).tolist()))
    fillings, beside, wide, hard = [faces[:0]], [border[:0]], 0, 0
    for (loop, near), normal in zip(loops, _normals(points, [loop for loop, _ in loops]), strict=True):
        corners, size = points[loop], math.sqrt(normal @ normal)
        if size > LARGEST_HOLE * twice[label[loop[0]]]:
            wide += 1
            continue
        triangles = _flat(corners, normal / size) if size > 0.0 and len(loop) <= MOST_SIDES else np.zeros((0, 3), np.int64)
        rows = set(map(tuple, np.sort(loop[triangles], axis=1).tolist()))
        if len(triangles) != len(loop) - 2 or len(rows) < len(triangles) or rows & present or not _has_area(corners[triangles]):
            hard += 1
            continue
        present |= rows
        fillings.append(loop[triangles])
        beside.append(np.full(len(triangles), near))
    said.could_not(wide, "hole is left: it is larger than half of the surface", "holes are left: they are larger than half of the surface")
    said.could_not(hard, "hole is left: no flat faces fill it", "holes are left: no flat faces fill them")
    return np.concatenate(fillings), np.concatenate(beside), len(fillings) - 1


def _has_area(corners: F64) -> bool:
    """Whether each triangle (n, 3, 3) has an area."""
    a, b, c = corners.transpose(1, 0, 2)
    return bool(np.any(np.cross(b - a, c - a) != 0.0, axis=1).all())


def _normals(points: F64, loops: list[I64]) -> F64:
    """(n, 3) Newell normals of loops, twice as long as their area."""
    if not loops:
        return np.zeros((0, 3))
    counts = np.array([len(loop) for loop in loops])
    starts = np.cumsum(counts) - counts
    corners = points[np.concatenate(loops)] - np.repeat(points[[loop[0] for loop in loops]], counts, axis=0)
    following = np.arange(1, len(corners) + 1)
    following[starts + counts - 1] = starts
    return np.add.reduceat(np.cross(corners, corners[following]), starts)


def _loops(edges: I64, face: I64) -> tuple[list[tuple[I64, int]], int]:
    """(closed runs of directed edges (n, 2), each with a face at it; edges in none). A run that meets itself is cut there."""
    after: dict[int, list[int]] = {}
    for k, start in enumerate(edges[:, 0].tolist()):
        after.setdefault(start, []).append(k)
    ends, loops, astray = edges[:, 1].tolist(), [], 0
    for start in list(after):
        while after[start]:
            path, taken, place = [start], [], {start: 0}
            while after.get(path[-1]):
                k = after[path[-1]].pop()
                taken.append(k)
                end = ends[k]
                if end in place:
                    begin = place[end]
                    loops.append((np.array(path[begin:], np.int64), int(face[taken[begin]])))
                    for vertex in path[begin + 1 :]:
                        del place[vertex]
                    path, taken = path[: begin + 1], taken[:begin]
                else:
                    place[end] = len(path)
                    path.append(end)
            astray += len(taken)
    short = sum(len(loop) for loop, _ in loops if len(loop) < 3)
    return [row for row in loops if len(row[0]) >= 3], astray + short


def _flat(corners: F64, normal: F64) -> I64:
    """Triangles of a loop (n, 3), as it is seen along its normal."""
    u = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    u /= np.linalg.norm(u)
    try:
        return np.asarray(mesh_csg.triangulate([(corners - corners[0]) @ np.stack([u, np.cross(normal, u)], axis=1)]), np.int64)
    except (ValueError, RuntimeError):
        return np.zeros((0, 3), np.int64)


def _at_corners(attribute: MeshAttribute | None, mesh: PolyMesh, corners: I64, owner: I64) -> MeshAttribute | None:
    """An attribute of polygons at the corners of triangles."""
    if attribute is None or attribute.interpolation == _Kind.CONSTANT:
        return attribute
    values = np.asarray(attribute.values)
    if attribute.interpolation == _Kind.FACE:
        return replace(attribute, values=values[owner])
    rows = corners.reshape(-1)
    return MeshAttribute(values[np.asarray(mesh.indices)[rows] if attribute.interpolation == _Kind.VERTEX else rows], _Kind.CORNER)


def _facing(normals: MeshAttribute, points: F64, faces: I64, turned: np.ndarray, old: int) -> MeshAttribute:
    """The normals on the side of the faces that were turned; none of the faces of holes, which are computed then."""
    if normals.interpolation != _Kind.CORNER:
        return normals
    values = np.array(normals.values, np.float64).reshape(len(faces), 3, 3)
    a, b, c = (points[faces[:old][turned][:, k]] for k in range(3))
    behind = np.einsum("mkc,mc->mk", values[:old][turned], np.cross(b - a, c - a)) < 0.0
    values[:old][turned] = np.where(behind[..., None], -values[:old][turned], values[:old][turned])
    values[old:] = 0.0
    return MeshAttribute(values.reshape(-1, 3), _Kind.CORNER)
