"""Types of the IR's columns, and tables from lists or arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np

from . import tables
from .kinds import CLIP_PLANES, PARAMETERS, SLOTS
from .tables import Tables

_FLOAT64 = {
    "matrix", "inverse", "parameters", "bounds", "origin", "frame", "size", "color_a", "color_b", "gain", "bias", "color", "position",
    "direction", "cos_cone", "cos_full", "angle", "coefficients", "extent", "aspect", "near", "far", "shift", "exposure",
    "threshold", "move", "turn", "stretch", "opening", "shutter", "constants", "lens", "focus",
    "pixel_aspect", "planes", "scattering", "absorption", "emission", "anisotropy", "draine", "priority", "top",
}  # fmt: skip
_FLOAT32 = {"positions", "texels"}
_INT64 = {"first", "first_constant"}
_BOOL = {"flips", "normalized", "nearest", "shadows", "textured", "everywhere"}
_SHAPE: dict[tuple[str, str], tuple[int, ...]] = {
    ("transforms", "matrix"): (3, 4),
    ("transforms", "inverse"): (3, 4),
    ("keys", "move"): (3,),
    ("keys", "turn"): (4,),
    ("keys", "stretch"): (3, 3),
    ("pools", "positions"): (3,),
    ("pools", "triangles"): (3,),
    ("pools", "loops"): (2,),
    ("pools", "code"): (4,),
    ("tapes", "results"): (4,),
    ("geometries", "parameters"): (PARAMETERS,),
    ("geometries", "bounds"): (2, 3),
    ("geometries", "origin"): (3,),
    ("materials", "values"): (SLOTS, 3),
    ("materials", "textures"): (SLOTS,),
    ("media", "scattering"): (3,),
    ("media", "absorption"): (3,),
    ("media", "emission"): (3,),
    ("media", "draine"): (4,),
    ("media", "bounds"): (2, 3),
    ("textures", "frame"): (2, 3),
    ("textures", "color_a"): (3,),
    ("textures", "color_b"): (3,),
    ("textures", "gain"): (3,),
    ("textures", "bias"): (3,),
    ("images", "texels"): (4,),
    ("lights", "color"): (3,),
    ("lights", "position"): (3,),
    ("lights", "direction"): (3,),
    ("lights", "size"): (2,),
    ("lights", "coefficients"): (3,),
    ("cameras", "shift"): (2,),
    ("cameras", "planes"): (CLIP_PLANES, 4),
}
TABLES: dict[str, type] = {
    "transforms": tables.Transforms, "keys": tables.Keys, "pools": tables.Pools, "attributes": tables.Attributes,
    "polygons": tables.Polygons, "tapes": tables.Tapes,
    "geometries": tables.Geometries, "instances": tables.Instances, "materials": tables.Materials, "media": tables.Media,
    "textures": tables.Textures,
    "images": tables.Images, "lights": tables.Lights, "cameras": tables.Cameras,
}  # fmt: skip


def is_in(column: np.ndarray, kinds: Iterable[int]) -> np.ndarray:
    """Whether each number of a column is one of a few kinds; several times as fast as np.isin."""
    matches = np.zeros(np.shape(column), bool)
    for kind in kinds:
        matches |= column == kind
    return matches


@cache
def column_type(table: str, column: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """The dtype of a column, and the shape of one row."""
    if table == "materials" and column == "values":
        kind: type = np.float64
    elif table == "pools" and column == "values":
        kind = np.float32
    elif table == "materials" and column == "first":
        kind = np.int32
    elif table == "media" and column == "falloff":
        kind = np.float64
    else:
        named = ((np.float64, _FLOAT64), (np.float32, _FLOAT32), (np.int64, _INT64), (np.bool_, _BOOL))
        kind = next((t for t, names in named if column in names), np.int32)
    return np.dtype(kind), _SHAPE.get((table, column), ())


def mesh_arrays(tables: Tables, g: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3), before `origin`, and triangles (m, 3), numbered from 0, of a MESH geometry."""
    geometries, pools = tables.geometries, tables.pools
    vertex, vertices = int(geometries.first_vertex[g]), int(geometries.vertex_count[g])
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    return pools.positions[vertex : vertex + vertices], pools.triangles[first : first + count] - np.int32(vertex)


def table_of(table: str, columns: Mapping[str, Any]) -> Any:
    """A table from lists or arrays by column name: typed, contiguous, read-only."""
    return _fill(table, columns) if columns else _empty(table)


@cache
def _empty(table: str) -> Any:
    return _fill(table, {})


def _fill(table: str, columns: Mapping[str, Any]) -> Any:
    filled = {}
    for column in TABLES[table]._fields:  # type: ignore[attr-defined]
        dtype, shape = column_type(table, column)
        array = np.ascontiguousarray(np.asarray(columns.get(column, ()), dtype=dtype).reshape((-1, *shape)))
        array = array.view()
        array.flags.writeable = False
        filled[column] = array
    return TABLES[table](**filled)


def empty_tables() -> Tables:
    """Tables without rows, except the identity transform."""
    identity = np.eye(3, 4)[None]
    tables = {name: table_of(name, {}) for name in TABLES}
    row = {"matrix": identity, "inverse": identity, "flips": [False], "first_key": [-1], "keys": [0]}
    tables["transforms"] = table_of("transforms", row)
    return Tables(**tables)
