"""What the tests of meshes read out of the tables: triangles and attributes, corner by corner."""

from __future__ import annotations

import numpy as np
from maquette.compiler import ir


def corners(tables: ir.Tables, geometry: int = 0) -> np.ndarray:
    """The corners of a mesh's triangles where they were written, (t, 3, 3)."""
    rows = tables.geometries
    first, count = rows.first_triangle[geometry], rows.triangle_count[geometry]
    return tables.pools.positions[tables.pools.triangles[first : first + count]] + rows.origin[geometry]


def has(tables: ir.Tables, name: str, geometry: int = 0) -> bool:
    """Whether a mesh has an attribute: normals, uvs or colors."""
    return bool(getattr(tables.geometries, name)[geometry] >= 0)


def attribute(tables: ir.Tables, name: str, geometry: int = 0) -> np.ndarray:
    """Values of a mesh's attribute at its triangles' corners, (t, 3, width)."""
    assert has(tables, name, geometry)
    a, rows = tables.attributes, tables.geometries
    row = getattr(rows, name)[geometry]
    width, first = int(a.width[row]), a.first[row]
    values = tables.pools.values[first : first + width * a.count[row]].reshape(-1, width)
    start, count = rows.first_triangle[geometry], int(rows.triangle_count[geometry])
    kind = ir.Interpolation(a.interpolation[row])
    if kind == ir.Interpolation.VERTEX:
        return values[tables.pools.triangles[start : start + count] - rows.first_vertex[geometry]]
    if kind == ir.Interpolation.CORNER:
        return values.reshape(-1, 3, width)
    if kind == ir.Interpolation.FACE:
        return np.repeat(values[:, None], 3, axis=1)
    return np.broadcast_to(values, (count, 3, width))
