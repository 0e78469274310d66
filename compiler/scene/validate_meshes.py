"""Validates meshes: drops degenerate triangles with their attributes and outlines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from .. import ir
from ..io import stage_cache
from . import mesh_storage, t_junctions
from .check import Check, Columns

FLAT = 1e-12  # 2 · area / longest edge² below which a triangle is degenerate
T = TypeVar("T")
MAX_SEARCHED_TRIANGLES = 1 << 18  # largest mesh, in triangles, to search for T-junctions: 0.1 s
_WIDTHS = {"normals": 3, "uvs": 2, "colors": 3}


def validate(check: Check) -> None:
    """Check meshes, drop degenerate triangles, and repair attributes, outlines and bounds."""
    table = check.tables["geometries"]
    meshes = np.flatnonzero(table["kind"] == ir.GeometryKind.MESH)
    if not len(meshes):
        return
    _attributes(check, meshes)
    keep = np.ones(len(check.tables["pools"]["triangles"]), dtype=bool)
    missing, flat = np.zeros(len(table["kind"]), dtype=np.int64), np.zeros(len(table["kind"]), dtype=np.int64)
    for row in meshes:
        first, count = int(table["first_triangle"][row]), int(table["triangle_count"][row])
        absent, degenerate = _cached(check, int(row), "meshes checked", partial(_faulty, check, int(row), first, count))
        missing[row], flat[row] = np.count_nonzero(absent), np.count_nonzero(degenerate)
        keep[first : first + count] &= ~(absent | degenerate)
    _say(check, missing, ("names", "name"), "vertices that are not there")
    _say(check, flat, ("has", "have"), "no area or no finite corners")
    if not keep.all():
        _drop(check, meshes, keep)
    _outlines(check, meshes)
    _positions(check)
    _bounds(check, meshes)
    _t_junctions(check, meshes)


def _cached(check: Check, row: int, stage: str, make: Callable[[], T]) -> T:
    """make() of a mesh's vertices and triangles, or its result of the last compilation."""
    table, pools = check.tables["geometries"], check.tables["pools"]
    low, first = int(table["first_vertex"][row]), int(table["first_triangle"][row])
    end, last = low + int(table["vertex_count"][row]), first + int(table["triangle_count"][row])
    return stage_cache.cached(stage, (low, pools["positions"][low:end], pools["triangles"][first:last]), make)


def _say(check: Check, counts: np.ndarray, verbs: tuple[str, str], what: str) -> None:
    total = int(counts.sum())
    who = f"1 triangle {verbs[0]}" if total == 1 else f"{total} triangles {verbs[1]}"
    check.bad("geometries", counts > 0, f"{who} {what}: dropped", "warning")


def _faulty(check: Check, row: int, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Masks of a mesh's triangles with invalid vertices, and of those without area."""
    table, pools = check.tables["geometries"], check.tables["pools"]
    triangles = pools["triangles"][first : first + count]
    low, high = int(table["first_vertex"][row]), int(table["first_vertex"][row]) + int(table["vertex_count"][row])
    absent = np.zeros(count, dtype=bool)
    if count and (int(triangles.min()) < low or int(triangles.max()) >= high):
        absent = ((triangles < low) | (triangles >= high)).any(axis=1)
    safe = np.where(absent[:, None], low, triangles) if absent.any() else triangles
    if not len(safe) or high == low:
        return absent, np.zeros(count, dtype=bool)
    a, b, c = (np.ascontiguousarray(pools["positions"][safe[:, k]].T, dtype=np.float64) for k in range(3))  # by coordinate, for speed
    u, v, w = b - a, c - a, c - b
    longest = np.maximum(np.maximum(_squared(u), _squared(v)), _squared(w))
    area = np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
    solid = _squared(area) > (FLAT * longest) ** 2
    return absent, ~solid & ~absent


def _squared(vectors: np.ndarray) -> np.ndarray:
    """Squared lengths of vectors (3, k)."""
    return vectors[0] * vectors[0] + vectors[1] * vectors[1] + vectors[2] * vectors[2]


def _attributes(check: Check, meshes: np.ndarray) -> None:
    """Attributes have the width and length their mesh needs; others are removed."""
    table, attributes = check.tables["geometries"], check.tables["attributes"]
    if not len(attributes["width"]):
        return
    for name, width in _WIDTHS.items():
        rows = table[name]
        clamped = np.maximum(rows, 0)
        kind = attributes["interpolation"][clamped]
        expected = np.choose(kind, [np.ones_like(rows), table["triangle_count"], table["vertex_count"], 3 * table["triangle_count"]])
        wrong = (rows >= 0) & ((attributes["width"][clamped] != width) | (attributes["count"][clamped] != expected))
        wrong &= np.isin(np.arange(len(rows)), meshes)
        if check.bad("geometries", wrong, f"its {name} do not go with its vertices and faces: they are left out", "warning"):
            check.set("geometries", name, np.where(wrong, -1, rows).astype(np.int32))
    values = check.tables["pools"]["values"]
    lost = int(np.count_nonzero(~np.isfinite(values)))
    if lost:
        check.diagnostics.warning(f"{lost} values of meshes' normals, texture coordinates or colours are not finite: they count as 0")
        check.set("pools", "values", np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0))


def _drop(check: Check, meshes: np.ndarray, keep: np.ndarray) -> None:
    """Remove triangles from the pool, with their ranges, outlines, and face and corner values."""
    table, pools = check.tables["geometries"], check.tables["pools"]
    before = np.concatenate([[0], np.cumsum(keep)])
    first, count = table["first_triangle"].copy(), table["triangle_count"].copy()
    for row in meshes:
        start, end = int(first[row]), int(first[row] + count[row])
        if not keep[start:end].all():
            for name, width in _WIDTHS.items():
                if table[name][row] >= 0:
                    _filter_attribute(check, int(row), name, width, keep[start:end])
        first[row], count[row] = before[start], before[end] - before[start]
    check.set("geometries", "first_triangle", first)
    check.set("geometries", "triangle_count", count)
    check.set("pools", "triangles", pools["triangles"][keep])
    polygons = check.tables["polygons"]
    if len(polygons["first_triangle"]):
        start = np.clip(polygons["first_triangle"], 0, len(keep)).astype(np.int64)
        end = np.clip(start + polygons["triangle_count"], start, len(keep))
        check.set("polygons", "first_triangle", before[start].astype(np.int32))
        check.set("polygons", "triangle_count", (before[end] - before[start]).astype(np.int32))


def _filter_attribute(check: Check, row: int, name: str, width: int, keep: np.ndarray) -> None:
    """Give a mesh a new attribute without the values of dropped faces or corners."""
    attributes, pools = check.tables["attributes"], check.tables["pools"]
    old = int(check.tables["geometries"][name][row])
    kind = int(attributes["interpolation"][old])
    if kind not in (ir.Interpolation.FACE, ir.Interpolation.CORNER):
        return
    mask = keep if kind == ir.Interpolation.FACE else np.repeat(keep, 3)
    first = int(attributes["first"][old])
    values = pools["values"][first : first + width * len(mask)].reshape(-1, width)[mask]
    if not len(values):
        new = -1
    else:
        new = len(attributes["width"])
        added = {"interpolation": kind, "width": width, "first": len(pools["values"]), "count": len(values)}
        for column, value in added.items():
            check.set("attributes", column, np.append(attributes[column], np.array(value, dtype=attributes[column].dtype)))
        check.set("pools", "values", np.concatenate([pools["values"], values.reshape(-1)]))
        check.names = replace(check.names, attributes=(*check.names.attributes, check.names.attributes[old]))
    rows = check.tables["geometries"][name].copy()
    rows[row] = new
    check.set("geometries", name, rows)


def _outlines(check: Check, meshes: np.ndarray) -> None:
    """A mesh with invalid outlines loses them and keeps its triangles."""
    table, pools, polygons = check.tables["geometries"], check.tables["pools"], check.tables["polygons"]
    wrong = np.zeros(len(table["kind"]), dtype=bool)
    for row in meshes:
        first, count = int(table["first_polygon"][row]), int(table["polygon_count"][row])
        if count:
            wrong[row] = not _outlines_inside(table, pools, polygons, int(row), slice(first, first + count))
    if check.bad("geometries", wrong, "its outlines do not go with its vertices: they are left out", "warning"):
        check.set("geometries", "polygon_count", np.where(wrong, 0, table["polygon_count"]).astype(np.int32))


def _outlines_inside(table: Columns, pools: Columns, polygons: Columns, row: int, which: slice) -> bool:
    first_loop, loops = polygons["first_loop"][which].astype(np.int64), polygons["loop_count"][which].astype(np.int64)
    first_triangle, triangles = polygons["first_triangle"][which].astype(np.int64), polygons["triangle_count"][which].astype(np.int64)
    start, count = int(table["first_triangle"][row]), int(table["triangle_count"][row])
    if (first_loop < 0).any() or (loops < 1).any() or (first_loop + loops > len(pools["loops"])).any():
        return False
    if (triangles < 0).any() or (first_triangle < start).any() or (first_triangle + triangles > start + count).any():
        return False
    used = pools["loops"][_spread(first_loop, loops)].astype(np.int64)
    if (used[:, 0] < 0).any() or (used[:, 1] < 0).any() or (used.sum(axis=1) > len(pools["corners"])).any():
        return False
    if used[:, 1].sum() > 4 * len(pools["corners"]) + 4:
        return False  # loops that reuse the same corners
    corners = pools["corners"][_spread(used[:, 0], used[:, 1])]
    low = int(table["first_vertex"][row])
    return bool(((corners >= low) & (corners < low + int(table["vertex_count"][row]))).all())


def _spread(first: np.ndarray, count: np.ndarray) -> np.ndarray:
    """The rows of all ranges, concatenated."""
    ends = np.cumsum(count)
    return np.repeat(first - (ends - count), count) + np.arange(int(ends[-1]) if len(ends) else 0)


def _positions(check: Check) -> None:
    """Moves non-finite vertices, which no triangle uses any more, to the origin."""
    positions = check.tables["pools"]["positions"]
    finite = np.isfinite(positions)
    if not finite.all():
        check.set("pools", "positions", np.where(finite.all(axis=1)[:, None], positions, np.float32(0)))


def _bounds(check: Check, meshes: np.ndarray) -> None:
    table, pools = check.tables["geometries"], check.tables["pools"]
    bounds, origin = table["bounds"], table["origin"]
    if check.bad("geometries", ~np.isfinite(origin).all(axis=1), "its origin is not finite"):
        return
    right = bounds.copy()
    for row in meshes:
        if table["triangle_count"][row]:
            start = int(table["first_vertex"][row])
            points = pools["positions"][start : start + int(table["vertex_count"][row])]
            right[row] = mesh_storage.bounds(points) + origin[row]
        else:
            right[row] = origin[row]
    wrong = ~((bounds[:, 0] <= right[:, 0]) & (bounds[:, 1] >= right[:, 1]) & np.isfinite(bounds).all(axis=1)).all(axis=1)
    wrong[~np.isin(np.arange(len(wrong)), meshes)] = False
    if check.bad("geometries", wrong, "its bounds did not hold it: computed again", "warning"):
        check.set("geometries", "bounds", np.where(wrong[:, None, None], right, bounds))


def _junctions(check: Check, row: int) -> int:
    """T-junctions of a mesh."""
    table, pools = check.tables["geometries"], check.tables["pools"]
    low, first = int(table["first_vertex"][row]), int(table["first_triangle"][row])
    corners = pools["positions"][low : low + int(table["vertex_count"][row])]
    return t_junctions.count(corners, pools["triangles"][first : first + int(table["triangle_count"][row])] - low)


def _t_junctions(check: Check, meshes: np.ndarray) -> None:
    """Reports T-junctions, where rounding opens cracks. Large meshes are not searched."""
    table = check.tables["geometries"]
    seams = np.zeros(len(table["kind"]), dtype=np.int64)
    for row in meshes:
        count = int(table["triangle_count"][row])
        if 2 <= count <= MAX_SEARCHED_TRIANGLES:
            seams[row] = _cached(check, int(row), "meshes searched for seams", partial(_junctions, check, int(row)))
    total = int(seams.sum())
    who = "1 corner lies" if total == 1 else f"{total} corners lie"
    what = f"{who} on the edge of a triangle that goes on: the seam may show cracks"
    check.bad("geometries", seams > 0, what, "warning", "split the edge there")
