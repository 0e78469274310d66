"""Exports a scene as PLY in metres with y up, with colours of vertices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...mesh.parts import Part, corner_colors, joined
from .. import ply_file
from ..export import Export
from ..export_job import ExportJob
from . import triangle_files
from .triangle_files import Format


def export(job: ExportJob) -> Export:
    """The file of a scene. Raises ExportError."""
    return triangle_files.export(job, Format(encode, single=True))


def encode(parts: Sequence[Part], out: Export) -> bytes:
    """Binary PLY with sRGB colours of vertices; those between materials are there once for each colour."""
    positions, triangles = joined(parts)
    colors = np.concatenate([corner_colors(part) for part in parts])
    key = triangles.astype(np.int64) * (1 << 24) + colors.astype(np.int64) @ [1 << 16, 1 << 8, 1]
    used, corners = np.unique(key, return_inverse=True)
    vertices = positions[used >> 24]
    columns = {name: vertices[:, k].astype(np.float32) for k, name in enumerate("xyz")}
    columns |= {name: (used >> shift & 255).astype(np.uint8) for name, shift in (("red", 16), ("green", 8), ("blue", 0))}
    return ply_file.encode(columns, corners.reshape(-1, 3))
