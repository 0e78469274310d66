"""Subdivision surfaces: Catmull–Clark, Loop and bilinear, with creases, corners, boundaries and face-varying data.

Rules: OpenSubdiv 3.6 (Pixar), after Catmull and Clark 1978, Loop 1987, DeRose, Kass and Truong 1998 (semi-sharp creases),
and Halstead, Kass and DeRose 1993 (limit positions and normals).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .. import ir
from ..ir import F64, I64
from ..scene.row_records import MeshAttribute
from .polygon_mesh import PolyMesh
from .subdivision_rules import SHARP, Cage, child_cage, limit_normals, limit_positions, refine_values

_At = ir.Interpolation
MOST_FACES = 1 << 22  # of a refined mesh


@dataclass(frozen=True, slots=True, eq=False)
class Scheme:
    """How a mesh is subdivided; the names are those of UsdGeomMesh."""

    name: str = "catmullClark"  # or loop, bilinear
    crease_edges: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))  # (e, 2) vertices
    crease_sharpness: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (e,) SHARP and above: infinitely sharp
    corners: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))  # (c,) vertices
    corner_sharpness: np.ndarray = field(default_factory=lambda: np.zeros(0))
    boundary: str = "edgeAndCorner"  # or edgeOnly, none
    face_varying: str = "cornersPlus1"  # or none, cornersOnly, cornersPlus2, boundaries, all
    smooth_triangles: bool = False  # triangleSubdivisionRule
    linear: frozenset[str] = frozenset()  # attributes ("uvs", "colors") of interpolation varying: linear in each face


def levels_within(faces: int, corners: int, wanted: int, scheme: str) -> int:
    """The number of refinements, at most `wanted`, after which a mesh has at most MOST_FACES faces."""
    level, refined = 0, 4 * faces if scheme == "loop" else corners
    while level < wanted and refined * 4**level <= MOST_FACES:
        level += 1
    return level


def refine(mesh: PolyMesh, scheme: Scheme, level: int) -> tuple[PolyMesh, I64]:
    """The mesh after `level` refinements, its vertices moved to the limit surface: (triangles, face of `mesh` of each triangle).

    `level` is 1 or more; for Loop all faces are triangles. Normals are those of the limit surface at smooth vertices; at creases and
    boundaries they are means over the faces of a side. A bilinear mesh has no normals. Faces that `boundary` none leaves undefined are
    left out.
    """
    cage = Cage.from_faces(np.asarray(mesh.indices, np.int64), np.asarray(mesh.counts, np.int64), len(mesh.points))
    sharpened = _sharpened(cage, scheme)
    smooth = [("points", np.asarray(mesh.points, np.float64))]
    smooth += [(n, a.values) for n, a in _of(mesh, _At.VERTEX) if n not in scheme.linear]
    columns = np.cumsum([0] + [v.shape[1] for _, v in smooth])
    values, last = _run(sharpened, np.concatenate([v for _, v in smooth], axis=1).astype(np.float64), scheme, level)
    parents = np.repeat(np.arange(len(mesh.counts)), _children(np.asarray(mesh.counts, np.int64), scheme.name, level))
    linear = scheme.name == "bilinear"
    normals = None if linear else limit_normals(last, values[:, :3], scheme.name)
    if not linear:
        values = limit_positions(last, values, scheme.name)
    attributes = {name: MeshAttribute(values[:, a:b]) for (name, _), a, b in zip(smooth, columns[:-1], columns[1:], strict=True)}
    for name, attribute in _of(mesh, _At.VERTEX):
        if name in scheme.linear:
            plain = Scheme("bilinear" if scheme.name != "loop" else "linear loop")
            attributes[name] = MeshAttribute(_run(cage, attribute.values.astype(np.float64), plain, level)[0])
    for name, attribute in _of(mesh, _At.CORNER):
        attributes[name] = MeshAttribute(_face_varying(cage, sharpened, attribute.values, scheme, level), _At.CORNER)
    for name, attribute in _of(mesh, _At.FACE):
        attributes[name] = MeshAttribute(attribute.values[parents], _At.FACE)
    for name, attribute in _of(mesh, _At.CONSTANT):
        attributes[name] = attribute
    points = attributes["points"].values
    refined = PolyMesh(
        points, last.counts, last.indices, None if normals is None else MeshAttribute(normals, _At.CORNER),
        attributes.get("uvs"), attributes.get("colors"),
    )  # fmt: skip
    defined = np.ones(len(mesh.counts), bool)
    if scheme.boundary == "none" and not linear:
        on_boundary = np.zeros(len(mesh.points), bool)
        on_boundary[cage.edges[cage.faces_at_edge != 2].reshape(-1)] = True
        defined[cage.face_of[on_boundary[cage.indices]]] = False
    return _triangles(refined, parents, defined)


def _of(mesh: PolyMesh, kind: _At) -> list[tuple[str, MeshAttribute]]:
    candidates = (("uvs", mesh.uvs), ("colors", mesh.colors))
    return [(name, attribute) for name, attribute in candidates if attribute is not None and attribute.interpolation == kind]


def _children(counts: I64, scheme: str, level: int) -> I64:
    """Refined faces of each face."""
    return np.full(len(counts), 4**level) if scheme == "loop" else counts * 4 ** (level - 1)


def _sharpened(cage: Cage, scheme: Scheme) -> Cage:
    """The cage with the sharpness of its edges and vertices. Boundary and non-manifold edges are infinitely sharp."""
    edge = np.zeros(len(cage.edges))
    creases = np.sort(np.asarray(scheme.crease_edges, np.int64).reshape(-1, 2), axis=1)
    keys = cage.edges[:, 0] * (cage.vertices + 1) + cage.edges[:, 1]
    wanted = creases[:, 0] * (cage.vertices + 1) + creases[:, 1]
    if len(keys) and len(wanted):
        nearest = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        exists = keys[nearest] == wanted
        np.maximum.at(edge, nearest[exists], np.asarray(scheme.crease_sharpness, np.float64)[exists])
    edge[~cage.manifold] = SHARP
    vertex = np.zeros(cage.vertices)
    rows = np.asarray(scheme.corners, np.int64)
    inside = (rows >= 0) & (rows < cage.vertices)
    np.maximum.at(vertex, rows[inside], np.asarray(scheme.corner_sharpness, np.float64)[inside])
    if scheme.boundary != "edgeOnly":
        vertex[np.bincount(cage.indices, minlength=cage.vertices) == 1] = SHARP
    return cage.with_sharpness(np.clip(edge, 0.0, SHARP), np.clip(vertex, 0.0, SHARP))


def _run(cage: Cage, values: F64, scheme: Scheme, level: int) -> tuple[F64, Cage]:
    """Values (n, k) at vertices after `level` refinements, and the last cage."""
    for _ in range(level):
        values = refine_values(cage, values, scheme.name, scheme.smooth_triangles)
        cage = child_cage(cage, scheme.name)
    return values, cage


def _face_varying(cage: Cage, sharpened: Cage, values: np.ndarray, scheme: Scheme, level: int) -> np.ndarray:
    """Values (c', k) at the refined corners. Equal values at a vertex are one value; between others lies a boundary."""
    keys = np.column_stack([cage.indices.astype(np.float64), values])
    unique, rows = np.unique(keys, axis=0, return_inverse=True)
    rows = rows.reshape(-1)
    value_cage = Cage.from_faces(rows.astype(np.int64), cage.counts, len(unique))
    if scheme.face_varying == "all" or scheme.name == "bilinear":
        plain = Scheme("linear loop" if scheme.name == "loop" else "bilinear")
        refined, last = _run(value_cage, unique[:, 1:], plain, level)
        return refined[last.indices]
    edge = np.zeros(len(value_cage.edges))
    edge[value_cage.edge_of] = sharpened.edge_sharpness[cage.edge_of]
    edge[~value_cage.manifold] = SHARP
    of_vertex = unique[:, 0].astype(np.int64)
    vertex = np.where(sharpened.vertex_sharpness[of_vertex] < SHARP, sharpened.vertex_sharpness[of_vertex], 0.0)
    explicit = np.zeros(cage.vertices, bool)
    explicit[np.asarray(scheme.corners, np.int64)[np.asarray(scheme.corner_sharpness) >= SHARP]] = True
    vertex[explicit[of_vertex]] = SHARP
    vertex[_linear_corners(value_cage, of_vertex, cage.vertices, scheme.face_varying)] = SHARP
    refined, last = _run(value_cage.with_sharpness(edge, vertex), unique[:, 1:], scheme, level)
    return limit_positions(last, refined, scheme.name)[last.indices]


def _linear_corners(value_cage: Cage, of_vertex: I64, vertices: int, rule: str) -> np.ndarray:
    """(n,) which face-varying values keep their place, by faceVaryingLinearInterpolation."""
    faces = np.bincount(value_cage.indices, minlength=value_cage.vertices)
    at_boundary = np.zeros(value_cage.vertices, bool)
    at_boundary[value_cage.edges[~value_cage.manifold].reshape(-1)] = True
    if rule == "boundaries":
        return at_boundary
    corner = (faces == 1) & at_boundary
    if rule == "none":
        return np.zeros(value_cage.vertices, bool)
    regions = np.bincount(of_vertex, minlength=vertices)[of_vertex]
    if rule in ("cornersPlus1", "cornersPlus2"):
        corner = corner | (regions > 2)
    if rule == "cornersPlus2":
        beside = np.zeros(vertices, bool)
        beside[of_vertex[(faces == 1) & at_boundary]] = True
        corner = corner | (beside[of_vertex] & (regions == 2)) | ((regions == 1) & at_boundary & (value_cage.boundary_edges() == 1))
    return corner


def _triangles(mesh: PolyMesh, parents: I64, defined: np.ndarray) -> tuple[PolyMesh, I64]:
    """The faces of the kept parents; quads as two triangles each."""
    faces = np.flatnonzero(defined[parents])
    size = int(mesh.counts[0])
    cut = np.array([[0, 1, 2], [0, 2, 3]] if size == 4 else [[0, 1, 2]])
    corners = (faces[:, None, None] * size + cut).reshape(-1)
    owners = np.repeat(faces, len(cut))

    def resampled(attribute: MeshAttribute | None) -> MeshAttribute | None:
        if attribute is None or attribute.interpolation in (_At.VERTEX, _At.CONSTANT):
            return attribute if attribute is None else MeshAttribute(attribute.values.astype(np.float32), attribute.interpolation)
        rows = owners if attribute.interpolation == _At.FACE else corners
        return MeshAttribute(attribute.values[rows].astype(np.float32), attribute.interpolation)

    indices = np.asarray(mesh.indices)[corners]
    normals, uvs, colors = (resampled(attribute) for attribute in (mesh.normals, mesh.uvs, mesh.colors))
    return PolyMesh(mesh.points, np.full(len(owners), 3), indices, normals, uvs, colors), parents[owners]
