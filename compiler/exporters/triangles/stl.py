"""Exports a scene as binary STL, in millimetres with z up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...mesh.parts import Part
from ..export import Export
from ..export_job import ExportJob
from . import triangle_files
from .triangle_files import Format


def export(job: ExportJob) -> Export:
    """The file of a scene. Raises ExportError."""
    return triangle_files.export(job, Format(encode, single=True, printed=True, colored=False))


def encode(parts: Sequence[Part], out: Export) -> bytes:
    """Binary STL: 80 bytes, a count, and for each triangle its normal, its corners and two zero bytes."""
    corners = np.concatenate([part.positions[part.triangles] for part in parts])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.zeros(len(corners), np.dtype([("numbers", "<f4", (4, 3)), ("nothing", "<u2")]))
    rows["numbers"][:, 0] = normal / np.where(length > 0, length, 1.0)
    rows["numbers"][:, 1:] = corners
    return b"maquette: millimetres, z up".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()
