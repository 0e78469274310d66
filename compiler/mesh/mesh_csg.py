"""Mesh CSG: boolean operations on closed triangle meshes, by manifold3d.

Manifold (Lalish and others) selects the output triangles exactly: closed meshes give closed meshes, also for touching or coincident
faces. Analytic shapes and formulas combined with a mesh are contoured first. Solids without meshes do not use this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .. import ir
from ..formula import dual_contouring
from ..formula.solid_fields import NoSolid
from ..formula.tape import Tape
from ..io import stage_cache
from ..scene.row_records import MeshAttribute, MeshData, Piece
from ..scene.validate_meshes import FLAT
from . import built_geometry

if TYPE_CHECKING:
    from ..scene.builder import SceneBuilder

Manifold = Any
FINENESS = 8000  # extent / FINENESS is the largest deviation of contoured analytic shapes
MAX_CELLS = 128  # cells along an axis
CONTOUR_SHARE = 0.75  # of a tolerance, for the contour of a field; simplification uses the rest
FEW_LOOPS = 64  # that are triangulated and united at once
SHARP = 40.0  # degrees; edges with a larger dihedral angle get split normals, so that meshes of round things with ten sides stay smooth


class Solid(NamedTuple):
    """A closed mesh."""

    manifold: Manifold
    deviation: float = 0.0  # metres: largest distance of its triangles from the surfaces that they stand for

    def moved(self, matrix: np.ndarray) -> Solid:
        """The solid in the frame of a (4, 4) matrix, which may scale unevenly: by its largest singular value at most."""
        size = float(np.linalg.norm(matrix[:3, :3], 2))
        return Solid(self.manifold.transform(np.ascontiguousarray(matrix[:3])), self.deviation * size)


def solid_of_pieces(builder: SceneBuilder, pieces: Sequence[Piece]) -> tuple[Solid, bool]:
    """(solid of meshes that are closed together, whether they were inside out). Raises NoSolid for open or non-manifold meshes."""
    positions, triangles, count, off = [], [], 0, 0.0
    for piece in pieces:
        off = max(off, builder.shape(piece.geometry)[1][0] * float(np.linalg.norm(piece.matrix[:3, :3], 2)))
        corners, faces = builder.triangles(piece.geometry)
        corners = corners @ piece.matrix[:3, :3].T + piece.matrix[:3, 3]
        flipped = np.linalg.det(piece.matrix[:3, :3]) < 0
        positions.append(corners)
        triangles.append((faces[:, ::-1] if flipped else faces) + count)
        count += len(corners)
    joined, index = np.unique(np.concatenate(positions), axis=0, return_inverse=True)
    faces = index.reshape(-1)[np.concatenate(triangles)]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    leaks, sides = dual_contouring.open_edges(faces), edges(faces)
    if leaks:
        crowded = int((sides > 2).sum())
        if crowded:
            raise NoSolid(f"{crowded} of the mesh's {len(sides)} edges {_have(crowded)} more than two triangles")
        bare = int((sides == 1).sum())
        if bare:
            raise NoSolid(f"the mesh is open: {bare} of its {len(sides)} edges {_have(bare)} a triangle on one side only")
        raise NoSolid("neighbouring triangles of the mesh face opposite sides")
    inside_out = volume(joined, faces) < 0
    return Solid(of_triangles(joined, faces[:, ::-1] if inside_out else faces), off), inside_out


def _have(count: int) -> str:
    return "has" if count == 1 else "have"


def edges(faces: np.ndarray) -> np.ndarray:
    """Number of triangles at each edge."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(sides, axis=0, return_counts=True)[1]


def volume(positions: np.ndarray, faces: np.ndarray) -> float:
    """Enclosed volume of a closed mesh; negative if its triangles face inwards."""
    a, b, c = (positions[faces[:, k]] - positions.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def of_field(tape: Tape, bounds: np.ndarray, tolerance: float | None) -> Solid:
    """The solid of a scalar field within a bounding box, with triangles within `tolerance` metres as far as cells allow.

    Without a tolerance it has even triangles for pictures, fine enough for the default of FINENESS or MAX_CELLS.
    """
    default, most = float((bounds[1] - bounds[0]).max()) / FINENESS, MAX_CELLS if tolerance is None else dual_contouring.MOST
    within = default if tolerance is None else CONTOUR_SHARE * tolerance
    with built_geometry.part("made into triangles"):
        contour = stage_cache.cached(
            "surfaces contoured", (tape, bounds, within, most), lambda: dual_contouring.within(tape, bounds, within, most)
        )
        if tolerance is None:
            return Solid(of_triangles(contour.positions, contour.triangles), contour.furthest)
        positions, triangles, off = simplify(tape, contour, tolerance)
    return Solid(of_triangles(positions, triangles), off)


def of_box(bounds: np.ndarray) -> Solid:
    """The box of bounds (2, 3)."""
    mesh_ = built_geometry.box(*bounds, closed=True)
    return Solid(of_triangles(mesh_.positions, mesh_.triangles))


def of_triangles(positions: np.ndarray, faces: np.ndarray) -> Manifold:
    """The manifold of a closed mesh: positions (n, 3), faces (m, 3). Raises NoSolid."""
    import manifold3d

    mesh = manifold3d.Mesh64(np.array(positions, np.float64, order="C"), np.array(faces, np.uint64, order="C"))  # writable ones
    manifold = manifold3d.Manifold(mesh)
    if manifold.status() != manifold3d.Error.NoError:
        raise NoSolid(f"its triangles do not enclose anything ({manifold.status().name})")
    return manifold


def simplify(tape: Tape, surface: dual_contouring.Contour, tolerance: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Simplifies a contour: (positions, triangles, deviation) with as few triangles as `tolerance` allows.

    Flat regions get large triangles. A contour without volume stays unchanged. A contour that already deviates by more than `tolerance`
    keeps its deviation.
    """
    allowance, limit = max(tolerance - surface.furthest, 0.5 * tolerance), max(tolerance, surface.furthest)
    try:
        manifold = of_triangles(surface.positions, surface.triangles) if tolerance > 0.0 and len(surface.triangles) else None
    except NoSolid:
        manifold = None
    while manifold is not None and allowance > tolerance / 32:
        mesh = manifold.simplify(allowance).to_mesh64()
        positions, faces = np.asarray(mesh.vert_properties)[:, :3].copy(), np.asarray(mesh.tri_verts).astype(np.int64)
        furthest, _ = dual_contouring.deviation(tape, positions, faces)
        if furthest <= limit and dual_contouring.open_edges(faces) == 0:
            return positions, faces, furthest
        allowance /= 2
    return surface.positions, surface.triangles, surface.furthest


def triangulate(loops: Sequence[np.ndarray]) -> np.ndarray:
    """Triangles (m, 3) of plane loops (n, 2), outlines counter-clockwise and holes clockwise, as rows of all points in order.

    Every point is a corner of a triangle, also one between two on a line, so that sides meet the loops without gaps.
    """
    import manifold3d

    starts = np.cumsum([0, *map(len, loops)])
    parts = []
    for group in _separated(loops):
        triangles = np.asarray(manifold3d.triangulate([np.ascontiguousarray(loops[k], np.float64) for k in group])).astype(np.int64)
        rows = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in group])
        parts.append(rows[triangles.reshape(-1, 3)])
    return np.concatenate(parts)


def union_of_outlines(contours: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Simple polygons (n, 2) of the area that contours wind around: outlines counter-clockwise, holes clockwise."""
    import manifold3d

    if not contours:
        return []
    polygons: list[np.ndarray] = []
    for group in _separated(contours):
        loops = [np.ascontiguousarray(contours[k], np.float64) for k in group]
        area = manifold3d.CrossSection(loops, manifold3d.FillRule.NonZero)
        polygons += [np.asarray(loop) for loop in area.to_polygons()]
    return polygons


def _separated(loops: Sequence[np.ndarray]) -> list[list[int]]:
    """Rows of loops in groups that lines along x or y separate, for work that takes quadratic time; few loops are one group."""
    if len(loops) <= FEW_LOOPS:
        return [list(range(len(loops)))]
    low, high = (np.array([getattr(loop, end)(axis=0) for loop in loops]) for end in ("min", "max"))
    groups: list[list[int]] = []
    waiting = [(np.arange(len(loops)), 0, 0)]
    while waiting:
        rows, axis, tries = waiting.pop()
        if tries == 2 or len(rows) == 1:
            groups.append(sorted(rows.tolist()))
            continue
        rows = rows[np.argsort(low[rows, axis], kind="stable")]
        gaps = np.flatnonzero(low[rows[1:], axis] > np.maximum.accumulate(high[rows, axis])[:-1]) + 1
        waiting += [(part, 1 - axis, 0 if len(gaps) else tries + 1) for part in np.split(rows, gaps)]
    return sorted(groups)


def combine(kind: str, parts: Sequence[Solid]) -> Solid:
    """Union, intersection or difference (the first part minus all others). Each triangle of it is one of a part."""
    from manifold3d import Manifold, OpType

    how = {"union": OpType.Add, "intersection": OpType.Intersect, "difference": OpType.Subtract}[kind]

    def make() -> Manifold:
        manifold = Manifold.batch_boolean([part.manifold for part in parts], how)
        manifold.num_tri()  # otherwise it is made when it is asked for
        return manifold

    off = max((part.deviation for part in parts), default=0.0)
    with built_geometry.part("combined"):
        if not stage_cache.is_active():
            return Solid(make(), off)
        return Solid(stage_cache.cached("solids combined", (kind, *map(_content, parts)), make), off)


def _content(solid: Solid) -> bytes:
    """The digest of a solid's triangles."""
    arrays = solid.manifold.to_mesh64()
    return stage_cache.digest(np.asarray(arrays.vert_properties), np.asarray(arrays.tri_verts))


def bounds(solid: Solid) -> np.ndarray:
    """(2, 3) bounding box; from inf to −inf for an empty solid."""
    return np.array(solid.manifold.bounding_box()).reshape(2, 3)


def mesh(solid: Solid) -> MeshData:
    """The solid's triangles, with normals smooth except across sharp edges."""
    if stage_cache.is_active():
        mesh_ = stage_cache.cached("solids made meshes", (_content(solid),), lambda: _mesh(solid))
        return replace(mesh_, deviation=solid.deviation)
    return _mesh(solid)


def _mesh(solid: Solid) -> MeshData:
    arrays = solid.manifold.calculate_normals(0, SHARP).to_mesh64(0)
    numbers = np.asarray(arrays.vert_properties)
    normals = MeshAttribute(numbers[:, 3:6].copy(), ir.Interpolation.VERTEX)
    points, triangles = numbers[:, :3].copy(), np.asarray(arrays.tri_verts).astype(np.int64)
    return MeshData(points, triangles[_has_area(points, triangles)], normals, deviation=solid.deviation)


def _has_area(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Mask of the triangles that keep an area when their corners are stored as float32."""
    a, b, c = (points.astype(np.float32).astype(np.float64)[triangles[:, k]] for k in range(3))
    longest = np.max([((q - p) ** 2).sum(axis=1) for p, q in ((a, b), (a, c), (b, c))], axis=0)
    return (np.cross(b - a, c - a) ** 2).sum(axis=1) > (FLAT * longest) ** 2
