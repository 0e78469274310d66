"""Meshes in place of analytic shapes whose material is shaded at vertices (Gouraud)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler import ir
from . import analytic_shapes
from .view import ViewTessellator


def replace_vertex_shaded(tables: ir.Tables, tessellator: ViewTessellator) -> ir.Tables:
    """Tables with a mesh for each bounded analytic instance whose material is shaded at vertices."""
    instances = tables.instances
    chosen = tables.materials.shading[instances.material] == ir.Shading.GOURAUD
    chosen &= tables.geometries.kind[instances.geometry] != ir.GeometryKind.MESH
    if chosen.any():
        chosen &= np.isfinite(tessellator.tolerances)
    if not chosen.any():
        return tables
    geometry = instances.geometry.copy()
    rows: dict[tuple[int, float], int] = {}
    meshes: list[tuple[int, analytic_shapes.Tessellation]] = []
    for i in np.flatnonzero(chosen):
        key = tessellator.key(int(i))
        if key not in rows:
            rows[key] = len(tables.geometries.kind) + len(meshes)
            meshes.append((key[0], tessellator.tessellate(int(i))))
        geometry[i] = rows[key]
    placed = ir.table_of("instances", {**instances._asdict(), "geometry": geometry})
    return _add_meshes(tables, meshes)._replace(instances=placed)


def _add_meshes(tables: ir.Tables, meshes: list[tuple[int, analytic_shapes.Tessellation]]) -> ir.Tables:
    """Tables with one more mesh geometry for each (geometry it replaces, triangles), with normals and uvs at vertices."""
    pools, attributes, geometries = tables.pools, tables.attributes, tables.geometries
    vertices, triangles, values = len(pools.positions), len(pools.triangles), len(pools.values)
    positions_of, triangles_of, values_of = [pools.positions], [pools.triangles], [pools.values]
    attribute_rows: list[tuple[int, int, int, int]] = []
    geometry_rows: dict[str, list[Any]] = {name: [] for name in geometries._fields}
    for original, mesh in meshes:
        count = len(mesh.positions)
        row = {
            "kind": ir.GeometryKind.MESH, "parameters": np.zeros(ir.PARAMETERS),
            "bounds": geometries.bounds[original], "origin": np.zeros(3),
            "first_vertex": vertices, "vertex_count": count, "first_triangle": triangles, "triangle_count": len(mesh.triangles),
            "first_polygon": 0, "polygon_count": 0, "colors": -1, "tape": -1,
        }  # fmt: skip
        for name, data in (("normals", mesh.normals), ("uvs", mesh.uvs)):
            row[name] = len(attributes.width) + len(attribute_rows)
            attribute_rows.append((ir.Interpolation.VERTEX, data.shape[1], values, count))
            values_of.append(data.astype(np.float32).ravel())
            values += data.size
        for name, value in row.items():
            geometry_rows[name].append(value)
        positions_of.append(mesh.positions[:, :3].astype(np.float32))
        triangles_of.append(mesh.triangles + np.int32(vertices))
        vertices += count
        triangles += len(mesh.triangles)
    columns = ("interpolation", "width", "first", "count")
    more_attributes: dict[str, Any] = {name: [row[k] for row in attribute_rows] for k, name in enumerate(columns)}
    grown = {"positions": positions_of, "triangles": triangles_of, "values": values_of}
    return tables._replace(
        pools=ir.table_of("pools", {**pools._asdict(), **{name: np.concatenate(rows) for name, rows in grown.items()}}),
        attributes=_append("attributes", attributes, more_attributes),
        geometries=_append("geometries", geometries, geometry_rows),
    )


def _append(table: str, rows: Any, more: dict[str, Any]) -> Any:
    """A table with more rows at its end."""
    return ir.table_of(table, {name: np.concatenate([getattr(rows, name), np.asarray(more[name])]) for name in rows._fields})
