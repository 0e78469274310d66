"""Reads OFF files through trimesh, which reads this format without loss: it has no materials, outlines or packages."""

from __future__ import annotations

import io
import re

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ..mesh.polygon_mesh import PolyMesh


class OffError(Exception):
    """An OFF file that cannot be read."""


def read(data: bytes, diagnostics: Diagnostics, span: Span) -> PolyMesh:
    """The mesh of an OFF file, triangulated. Raises OffError."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(io.BytesIO(data), file_type="off", process=False)
        points, faces = np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)
    except Exception as failure:  # the parser raises exceptions of any type
        raise OffError(f"the OFF file cannot be read: {failure}") from None
    if points.ndim != 2 or points.shape[1] != 3 or faces.ndim != 2 or not len(faces):
        raise OffError("the OFF file holds no faces")
    lines = [line.split(b"#")[0].split() for line in data.splitlines()]
    tinted = any(len(words) > int(words[0]) + 1 for words in [w for w in lines if w][-len(faces) :] if words[0].isdigit())
    if tinted or re.match(rb"\s*(ST|C|N)+OFF", data):
        diagnostics.warning("the colours, normals and texture coordinates of OFF files are not drawn", span)
    return PolyMesh(points, np.full(len(faces), 3), faces.reshape(-1))
