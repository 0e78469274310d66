"""Displacement of meshes: points move along their normals by a number or by a picture, at the mesh's own resolution.

Heights are lengths in the units of the stage, whatever the scale of the prim, as Storm applies them after the transform.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ... import ir
from ...ir import F64
from ...mesh import polygon_mesh, triangulate, vertex_normals
from ...scene.row_records import MeshAttribute, TextureData
from .geometry import Faces


def metric(matrix: F64) -> tuple[float, ...]:
    """The metric MᵀM of a transform (4, 4), row by row; rotations and mirrors have that of the identity. Rounded, to compare."""
    linear = np.asarray(matrix, np.float64)[:3, :3]
    return tuple((np.float32(linear.T @ linear) + np.float32(0.0)).ravel().tolist())


def displaced(faces: Faces, heights: float | tuple[TextureData, np.ndarray], metric: tuple[float, ...]) -> Faces:
    """Faces whose points are moved along smooth normals; points at the same place stay together. Normals become those of the result.

    `heights` is a length in the world, or a picture's mapping and texels (h, w, 4). A point has the mean of the heights at its corners.
    `metric` is the metric G of the prim's transform: the world's unit normal is G⁻¹n / √(nᵀG⁻¹n) in the frame of the prim.
    """
    mesh = faces.mesh
    indices = np.asarray(mesh.indices)
    used = np.unique(indices)
    places, where = np.unique(mesh.points[used], axis=0, return_inverse=True)
    of_point = np.zeros(len(mesh.points), np.int64)
    of_point[used] = where.reshape(-1)
    surface = polygon_mesh.PolyMesh(places, mesh.counts, of_point[indices])
    if not isinstance(heights, tuple):
        height = np.full(len(places), heights)
    elif mesh.uvs is None:
        return faces
    else:
        mapping, texels = heights
        corners = sample(mapping, texels, polygon_mesh.corner_values(mesh.uvs, np.asarray(mesh.counts), indices))
        total = np.bincount(of_point[indices], corners, len(places))
        height = total / np.maximum(np.bincount(of_point[indices], minlength=len(places)), 1)
    moved = np.array(mesh.points, np.float64)
    moved[used] = (places + height[:, None] * _world_normals(_normals(surface), metric))[of_point[used]]
    smooth = _normals(replace(surface, points=_welded(moved, used, of_point, len(places))))
    normals = np.zeros((len(moved), 3), np.float32)
    normals[used] = smooth[of_point[used]]
    return Faces(replace(mesh, points=moved, normals=MeshAttribute(normals)), faces.rows, False)


def _world_normals(normals: np.ndarray, of: tuple[float, ...]) -> F64:
    """Normals (n, 3) of a prim that have the length 1 in the world, in the frame of the prim; see `displaced`."""
    with np.errstate(divide="ignore", invalid="ignore"):
        along = normals @ np.linalg.pinv(np.array(of).reshape(3, 3))
        length = np.sqrt(np.einsum("ij,ij->i", along, normals))[:, None]
    return np.where(length > 0, along / np.where(length > 0, length, 1.0), 0.0)


def _welded(points: F64, used: np.ndarray, of_point: np.ndarray, count: int) -> F64:
    merged = np.zeros((count, 3))
    merged[of_point[used]] = points[used]
    return merged


def _normals(mesh: polygon_mesh.PolyMesh) -> np.ndarray:
    cut = triangulate.faces(mesh.points, mesh.indices, mesh.counts)
    return vertex_normals.vertex_normals(mesh.points, np.asarray(mesh.indices)[cut.corners])


def sample(mapping: TextureData, texels: np.ndarray, uvs: F64) -> F64:
    """The values (n,) of one channel of a picture at coordinates (n, 2), bilinear, with its frame, wrap modes, gain and bias."""
    frame = np.array(mapping.frame)
    s, t = (uvs @ frame[:, :2].T + frame[:, 2]).T
    height, width = texels.shape[:2]
    channel = texels[..., max(mapping.channel, 0)].astype(np.float64)
    x, y = s * width - 0.5, (1.0 - t) * height - 0.5
    left, top = np.floor(x), np.floor(y)
    fx, fy = x - left, y - top
    values = np.zeros(len(uvs))
    for across, share_x in ((left, 1.0 - fx), (left + 1, fx)):
        for down, share_y in ((top, 1.0 - fy), (top + 1, fy)):
            column, inside_x = _wrapped(across.astype(np.int64), width, mapping.wrap_u)
            row, inside_y = _wrapped(down.astype(np.int64), height, mapping.wrap_v)
            values += share_x * share_y * np.where(inside_x & inside_y, channel[row, column], 0.0)
    return mapping.gain[0] * values + mapping.bias[0]


def _wrapped(index: np.ndarray, size: int, wrap: ir.Wrap) -> tuple[np.ndarray, np.ndarray]:
    """(index in the picture, whether the picture is there)."""
    if wrap == ir.Wrap.REPEAT:
        return index % size, np.ones(len(index), bool)
    if wrap == ir.Wrap.MIRROR:
        turned = index % (2 * size)
        return np.minimum(turned, 2 * size - 1 - turned), np.ones(len(index), bool)
    return np.clip(index, 0, size - 1), np.full(len(index), True) if wrap == ir.Wrap.CLAMP else (index >= 0) & (index < size)
