"""How a mesh is stored: the digest that finds equal meshes, the origin of its float32 positions, and their bounds."""

from __future__ import annotations

import hashlib

import numpy as np

from .row_records import MeshData


def digest(mesh: MeshData) -> bytes:
    """Hash of a mesh's content."""
    hashed = hashlib.blake2b(digest_size=16)
    outlines = mesh.outlines
    arrays = [mesh.positions, mesh.triangles] + ([outlines.corners, outlines.loops, outlines.polygons] if outlines else [])
    for attribute in (mesh.normals, mesh.uvs, mesh.colors):
        arrays += [np.array([-1 if attribute is None else int(attribute.interpolation)])] + ([attribute.values] if attribute else [])
    for array in arrays:
        values = np.ascontiguousarray(array)
        hashed.update(f"{values.dtype.str}{values.shape}".encode())
        hashed.update(values.data if values.size else b"")
    return hashed.digest()


def bounds(positions: np.ndarray) -> np.ndarray:
    """(2, 3) float64 bounds of the finite positions (n, 3); 0 without any."""
    finite = positions if np.isfinite(positions).all() else positions[np.isfinite(positions).all(axis=1)]
    return np.stack([finite.min(axis=0), finite.max(axis=0)]).astype(np.float64) if len(finite) else np.zeros((2, 3))


def origin(positions: np.ndarray) -> np.ndarray:
    """(3,) origin of a mesh's stored positions (n, 3): the center of its bounds.

    With outliers a thousand times as far out as the median vertex, it is the median, so that most vertices keep their precision.
    """
    box = bounds(positions)
    some = positions[:: max(1, len(positions) // 1024)]
    some = some[np.isfinite(some).all(axis=1)]
    if not len(some):
        return box.mean(axis=0)
    crowd = np.median(some, axis=0)
    away = np.median(np.abs(some - crowd).max(axis=1))
    return crowd if (box[1] - box[0]).max() > 1000.0 * away > 0.0 else box.mean(axis=0)
