"""Compares the tangents of a glTF mesh with those of its texture coordinates, in which normal maps are drawn."""

from __future__ import annotations

import numpy as np

_ALONG = 0.8  # least cosine between tangents that are alike
_MOST = 0.1  # share of the area that may differ


def differ(points: np.ndarray, triangles: np.ndarray, uvs: np.ndarray, tangents: np.ndarray) -> bool:
    """Whether tangents (n, 4), with their handedness, differ from those of coordinates (n, 2), v down, on much of the area.

    The tangent of a triangle is the way in which u grows; the handedness is 1 where v grows along the normal × the tangent (§3.7.2.1).
    """
    a, b, c = points[triangles].transpose(1, 0, 2)
    (u1, v1), (u2, v2) = (uvs[triangles[:, k]].T - uvs[triangles[:, 0]].T for k in (1, 2))
    det = (u1 * v2 - u2 * v1)[:, None]
    along = ((b - a) * v2[:, None] - (c - a) * v1[:, None]) * np.sign(det)
    file_tangents = tangents[triangles].mean(axis=1)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(along, axis=1) * np.linalg.norm(file_tangents[:, :3], axis=1)
    nondegenerate = (size > 0) & (det[:, 0] != 0)
    cosine = np.einsum("ij,ij->i", along, file_tangents[:, :3]) / np.where(nondegenerate, size, 1.0)
    alike = (cosine > _ALONG) & (np.sign(file_tangents[:, 3]) == -np.sign(det[:, 0]))
    area = np.where(nondegenerate, np.linalg.norm(normal, axis=1), 0.0)
    return bool(area[~alike].sum() > _MOST * area.sum())
