"""Linear blend skinning and blend shapes of points and normals (Magnenat-Thalmann, Laperrière and Thalmann 1988)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .. import ir
from ..scene.row_records import MeshAttribute
from .polygon_mesh import PolyMesh

_At = ir.Interpolation


def blended_matrices(joints: np.ndarray, indices: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n, 4, 4) the weighted means of the joints (j, 4, 4) of each point; `indices` and `weights` are (n, k)."""
    blended = np.zeros((len(indices), 4, 4))
    for k in range(indices.shape[1]):
        blended += weights[:, k, None, None] * joints[indices[:, k]]
    return blended


def deformed_points(points: np.ndarray, joints: np.ndarray, indices: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Points (n, 3) under their joints."""
    matrices = blended_matrices(joints, indices, weights)
    return np.einsum("nij,nj->ni", matrices[:, :3, :3], points) + matrices[:, :3, 3]


def deformed_normals(mesh: PolyMesh, joints: np.ndarray, indices: np.ndarray, weights: np.ndarray) -> PolyMesh:
    """The mesh with its normals under the inverse transposes of the joints' matrices."""
    if mesh.normals is None or mesh.normals.interpolation not in (_At.VERTEX, _At.CORNER):
        return mesh if mesh.normals is None else replace(mesh, normals=None)
    linear = joints[:, :3, :3]
    turns = np.tile(np.eye(4), (len(joints), 1, 1))
    sound = np.abs(np.linalg.det(linear)) > 1e-12
    turns[sound, :3, :3] = np.linalg.inv(linear[sound]).transpose(0, 2, 1)
    matrices = blended_matrices(turns, indices, weights)[:, :3, :3]
    if mesh.normals.interpolation == _At.CORNER:
        matrices = matrices[np.asarray(mesh.indices)]
    return replace(mesh, normals=MeshAttribute(np.einsum("nij,nj->ni", matrices, mesh.normals.values), mesh.normals.interpolation))


def blended_normals(mesh: PolyMesh, offsets: np.ndarray | None) -> PolyMesh:
    """The mesh with offsets (n, 3) of blend shapes added to its normals."""
    if mesh.normals is None or offsets is None or mesh.normals.interpolation not in (_At.VERTEX, _At.CORNER):
        return mesh
    added = offsets if mesh.normals.interpolation == _At.VERTEX else offsets[np.asarray(mesh.indices)]
    return replace(mesh, normals=MeshAttribute(mesh.normals.values + added, mesh.normals.interpolation))
