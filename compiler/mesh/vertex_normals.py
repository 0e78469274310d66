"""Computes vertex and corner normals: smooth across soft edges, split at creases."""

from __future__ import annotations

import numpy as np

from ..ir import F32, F64, I32

CREASE = np.radians(44.0)  # keeps a teapot smooth, and the edges of an octahedron, a hexagonal prism and a cube
_CHUNK = 1 << 20  # face pairs per batch


def corner_normals(positions: F64, triangles: I32, crease: float = CREASE, groups: I32 | None = None) -> F32:
    """Unit normals (t, 3, 3) at the corners of `triangles` (t, 3).

    A corner averages the faces at its vertex whose normals differ from its own face's by less than `crease` radians.
    Faces are weighted by their angle at the vertex (Thürmer and Wüthrich 1998).
    With `groups` (t,), a corner averages the faces of its smoothing group (OBJ) at any angle; group 0 is flat.
    """
    if not len(triangles):
        return np.zeros((0, 3, 3), np.float32)
    face, angles = _faces(np.asarray(positions, np.float64), triangles)
    weighted = (face[:, None, :] * angles[..., None]).reshape(-1, 3)
    corner_face = np.repeat(face, 3, axis=0)
    vertex = triangles.reshape(-1).astype(np.int64)
    smooth = _sum_by(vertex, weighted, len(positions))[vertex]
    if groups is not None:
        result = np.where(np.repeat(groups > 0, 3)[:, None], _within_groups(vertex, weighted, np.repeat(groups, 3)), corner_face)
    elif crease >= np.pi:
        result = smooth
    else:
        # Faces within half the crease angle of the vertex' mean normal are within the whole angle of each other.
        near = np.einsum("ij,ij->i", _unit(smooth), corner_face) >= np.cos(crease / 2)
        rough = np.bincount(vertex[~near], minlength=len(positions)) > 0
        result = smooth
        open_corners = np.flatnonzero(rough[vertex])
        result[open_corners] = _pairwise(vertex[open_corners], weighted[open_corners], corner_face[open_corners], np.cos(crease))
    result = _unit(result)
    lost = ~(np.einsum("ij,ij->i", result, result) > 0.5)
    result[lost] = corner_face[lost]
    return result.reshape(-1, 3, 3).astype(np.float32)


def vertex_normals(positions: F64, triangles: I32) -> F32:
    """Unit normals (v, 3) smooth across every edge; (0, 0, 1) at vertices without faces."""
    face, angles = _faces(np.asarray(positions, np.float64), triangles)
    weighted = (face[:, None, :] * angles[..., None]).reshape(-1, 3)
    normals = _unit(_sum_by(triangles.reshape(-1).astype(np.int64), weighted, len(positions)))
    normals[~(np.einsum("ij,ij->i", normals, normals) > 0.5)] = (0.0, 0.0, 1.0)
    return normals.astype(np.float32)


def _faces(positions: F64, triangles: I32) -> tuple[F64, F64]:
    """Unit face normals (t, 3) and the angle at each corner (t, 3)."""
    corners = positions[triangles]
    edges = _unit(np.roll(corners, -1, axis=1) - corners)
    normal = _unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    cosines = -np.einsum("tci,tci->tc", edges, np.roll(edges, 1, axis=1))
    return normal, np.arccos(np.clip(cosines, -1.0, 1.0))


def _sum_by(rows: np.ndarray, values: F64, count: int) -> F64:
    return np.stack([np.bincount(rows, values[:, k], count) for k in range(3)], axis=1, dtype=np.float64)


def _within_groups(vertex: np.ndarray, weighted: F64, groups: np.ndarray) -> F64:
    """Sums over corners of the same vertex and group."""
    pairs = vertex * (int(groups.max()) + 1) + groups
    _, rows = np.unique(pairs, return_inverse=True)
    return _sum_by(rows, weighted, int(rows.max()) + 1)[rows]


def _pairwise(vertex: np.ndarray, weighted: F64, face: F64, least: float) -> F64:
    """For each corner, the sum over corners of its vertex whose face normals have a cosine of at least `least` with its own."""
    result = np.zeros_like(weighted)
    order = np.argsort(vertex, kind="stable")
    _, first, size = np.unique(vertex[order], return_index=True, return_counts=True)
    for k in np.unique(size):
        fans = order[first[size == k][:, None] + np.arange(k)]  # (m, k) corners at a vertex
        for start in range(0, len(fans), max(1, _CHUNK // int(k * k))):
            fan = fans[start : start + max(1, _CHUNK // int(k * k))]
            together = np.einsum("mai,mbi->mab", face[fan], face[fan]) >= least
            result[fan.reshape(-1)] = np.einsum("mab,mbi->mai", together.astype(np.float64), weighted[fan]).reshape(-1, 3)
    return result


def _unit(vectors: F64) -> F64:
    length = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return vectors / np.where(length > 0, length, 1.0)[..., None]
