"""Binary PLY files of triangles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

_TYPES = {"<f4": "float", "<f8": "double", "|u1": "uchar"}


def encode(columns: Mapping[str, NDArray[np.generic]], triangles: NDArray[np.integer]) -> bytes:
    """A file with these properties of vertices, (n,) float32, float64 or uint8 each, and triangles (m, 3)."""
    count = len(next(iter(columns.values())))
    vertices = np.empty(count, np.dtype([(name, values.dtype.newbyteorder("<")) for name, values in columns.items()]))
    for name, values in columns.items():
        vertices[name] = values
    faces = np.empty(len(triangles), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property {_TYPES[values.dtype.newbyteorder('<').str]} {name}" for name, values in columns.items()]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    return ("\n".join(header) + "\n").encode() + vertices.tobytes() + faces.tobytes()
