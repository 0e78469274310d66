"""Builds the brute-force list of the large primitives of a scene: flat pieces, boxes and balls that all rays test.

The BVH does not hold the instances of the list. Rays are tested by primitive_hits.py, which describes the affine forms of primitives.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.ir import light_links
from ...lights import DISKS, POINTS, SPHERES, SURFACES
from ...materials import traits
from ..geometry.bounds import world_bounds
from ..surface import triangle_records

Rows = NDArray[np.float64]
MOST = 64  # primitives up to which the list is faster than a BVH
LARGE = 12  # primitives of the list in a larger scene, which most rays hit
SHARE = 0.25  # extent of a large instance, relative to the scene's diagonal
MESH_TRIANGLES = 24  # of a mesh whose triangles may be in the list
EXACT = 1 << 24  # integers up to this are exact in float32
_LISTED = ir.GeometryKind.BOX, ir.GeometryKind.RECTANGLE, ir.GeometryKind.PLANE, ir.GeometryKind.DISK, ir.GeometryKind.SPHERE
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


class Primitives(NamedTuple):
    """A list of primitives. Rows of `forms` hold 4 numbers each of height, a and b: quads, triangles, disks, planes."""

    forms: Rows  # (n, 12)
    boxes: Rows  # (b, 12)
    balls: Rows  # (m, 4) center and radius
    numbers: NDArray[np.int32]  # (n + b + m,) rows of PrimitiveRecords; of a box the first of six
    triangles: int  # first row
    disks: int
    planes: int


class PrimitiveRecords(NamedTuple):
    """The surfaces of primitives. Plain ones are shaded by position and normal alone.

    Plain triangles of the BVH have rows behind those of the list, see surface/triangle_records.py.
    """

    # (k, 8) outer unit normal, or a ball's center; 1 / a ball's radius, or minus the `error` of interaction.origin_offset; instance,
    # primitive, material, plainness (0: not plain)
    rows: Rows
    first: NDArray[np.int32]  # (instances,) row of a mesh's triangle minus its number, for meshes in the BVH
    rounded: Any  # triangle_records.Flat or triangle_records.Rounded


class PrimitiveList(NamedTuple):
    """The primitives of a scene: all, those that may block a light, those that may lie between two surfaces, and their records."""

    seen: Primitives
    blocking: Primitives
    between: Primitives
    records: PrimitiveRecords


class _Primitive(NamedTuple):
    """One primitive during the build."""

    kind: int  # 0 quad, 1 triangle, 2 disk, 3 plane, 4 box, 5 ball
    form: Any  # (3, 4) in the world, or center and radius
    normals: Any  # (parts, 4)
    corners: Any  # (k, 3), None: unbounded
    primitive: int  # of its first part
    cost: int = 1  # in quads


def build(tables: ir.Tables, hull: bool, moves: bool = False, general: bool = False) -> tuple[PrimitiveList, NDArray[np.bool_]]:
    """(primitive list, (instances,) whether an instance is in it and needs no BVH).

    Partly transparent instances are not listed, nor moving ones with `moves`. With `hull` (all lights at finite positions), a primitive
    that has the whole scene and its lights on one side blocks no light. `general` as for triangle_records.build.
    """
    instances, is_plain = tables.instances, _is_plain(tables)
    candidates: dict[int, list[_Primitive]] = {}
    stays = ~traits.partial(tables)[instances.material] & ~light_links.casts_unevenly(tables)
    if moves:
        stays &= tables.transforms.first_key[instances.transform] < 0
    boxes = world_bounds(tables)
    eligible, many = eligible_primitives(tables, boxes)
    for i in np.flatnonzero(stays & eligible).tolist():
        pieces = _primitives_of(tables, i)
        if pieces:
            candidates[i] = pieces
    chosen = _choose(boxes, candidates, many)
    inside = np.zeros(len(instances.geometry), bool)
    inside[chosen] = True
    listed = [(i, piece) for i in chosen for piece in candidates[i]]
    rows = [
        (*normal, i, piece.primitive + part, instances.material[i], is_plain[i])
        for i, piece in listed
        for part, normal in enumerate(piece.normals)
    ]
    listed_records = np.array(rows or [(0.0,) * 8], np.float64)
    meshes = stays & ~inside & _is_bare(tables) & (tables.geometries.kind[instances.geometry] == ir.GeometryKind.MESH)
    how = [(i, triangle_records.PLAIN if is_plain[i] else triangle_records.ROUNDED) for i in np.flatnonzero(meshes).tolist()]
    more, first, rounded = triangle_records.build(tables, how, len(listed_records), general)
    records = PrimitiveRecords(np.concatenate([listed_records, more]), first, rounded)
    every = list(range(len(listed)))
    points = _hull_points(tables, inside, listed)
    between = every if points is None else [k for k in every if not _bounds_scene(listed[k][1], points)]
    blocking = [k for k in (between if hull else every) if instances.visible[listed[k][0]] & ir.Visibility.SHADOW]
    seen, blocking, between = (_make_primitives(listed, rows) for rows in (every, blocking, between))
    return PrimitiveList(seen, blocking, between, records), inside


def _make_primitives(listed: list[tuple[int, _Primitive]], rows: list[int]) -> Primitives:
    order = sorted(rows, key=lambda k: listed[k][1].kind)
    kinds = np.array([listed[k][1].kind for k in order], int)
    flat, boxes, balls = ([k for k in order if listed[k][1].kind in kind_group] for kind_group in (range(4), (4,), (5,)))
    first = np.cumsum([0, *(len(piece.normals) for _, piece in listed)])
    starts = [int(np.sum(kinds < kind)) for kind in (1, 2, 3)]
    return Primitives(
        np.array([np.ravel(listed[k][1].form) for k in flat]).reshape(-1, 12),
        np.array([np.ravel(listed[k][1].form) for k in boxes]).reshape(-1, 12),
        np.array([listed[k][1].form for k in balls]).reshape(-1, 4),
        first[order].astype(np.int32),
        *starts,
    )


def eligible_primitives(tables: ir.Tables, boxes: Rows) -> tuple[NDArray[np.bool_], bool]:
    """((instances,) candidates of the list, whether the instances are so many that only large ones are candidates)."""
    geometry = tables.instances.geometry
    small = (tables.geometries.kind == ir.GeometryKind.MESH) & (tables.geometries.triangle_count <= MESH_TRIANGLES)
    eligible = (ir.is_in(tables.geometries.kind, _LISTED) | small)[geometry]
    finite = np.isfinite(boxes).all(axis=1)
    if np.count_nonzero(eligible) <= MOST or not finite.any():
        return eligible, False
    diagonal = np.linalg.norm(boxes[finite, 3:].max(axis=0) - boxes[finite, :3].min(axis=0))
    large = np.linalg.norm(boxes[:, 3:] - boxes[:, :3], axis=1) >= 0.99 * SHARE * diagonal  # `_choose` measures the primitives in the boxes
    return eligible & (large | ~finite), True


def _choose(boxes: Rows, candidates: dict[int, list[_Primitive]], many: bool) -> list[int]:
    """The instances of the list: all where they are few, otherwise the large ones."""
    cost = {i: sum(piece.cost for piece in pieces) for i, pieces in candidates.items()}
    many = many or sum(cost.values()) > MOST
    if not many and len(candidates) == len(boxes):
        return list(candidates)
    finite = {
        i: np.concatenate([p.corners for p in pieces]) for i, pieces in candidates.items() if all(p.corners is not None for p in pieces)
    }
    if not finite:
        return [i for i in candidates if i not in finite][:LARGE]
    other_boxes = np.delete(boxes, list(candidates), axis=0)
    other_boxes = other_boxes[np.isfinite(other_boxes).all(axis=1)]
    points = np.concatenate([*finite.values(), other_boxes[:, :3], other_boxes[:, 3:]])
    least = SHARE * np.linalg.norm(np.ptp(points, axis=0))
    chosen, budget = [], LARGE if many else MOST
    for i in candidates:
        large = i not in finite or np.linalg.norm(np.ptp(finite[i], axis=0)) >= least
        if large and cost[i] <= budget:
            chosen.append(i)
            budget -= cost[i]
    return chosen


def _instance_corners(tables: ir.Tables, which: NDArray[np.bool_]) -> Rows:
    """Corners of instances' boxes, (8 n, 3)."""
    bounds = tables.geometries.bounds[tables.instances.geometry[which]]
    matrix = tables.transforms.matrix[tables.instances.transform[which]]
    corners = bounds[:, :1] + _CORNERS * (bounds[:, 1:] - bounds[:, :1])
    return (corners @ matrix[:, :, :3].transpose(0, 2, 1) + matrix[:, None, :, 3]).reshape(-1, 3)


def _hull_points(tables: ir.Tables, inside: NDArray[np.bool_], listed: list[tuple[int, _Primitive]]) -> Rows | None:
    """Points whose convex hull holds the scene and its lights; None without bounds."""
    if not np.isfinite(tables.geometries.bounds[tables.instances.geometry[~inside]]).all():
        return None
    points = [_instance_corners(tables, ~inside)]
    for _, piece in listed:
        if piece.corners is None:
            return None
        points.append(piece.corners)
    points.append(tables.lights.position[ir.is_in(tables.lights.kind, POINTS)])
    points.append(light_corners(tables))
    return np.concatenate(points)


def light_corners(tables: ir.Tables) -> Rows:
    """Corners of the bounds of area lights, (n, 3)."""
    lit = tables.lights
    wide = ir.is_in(lit.kind, SURFACES)
    kind, matrix, size = lit.kind[wide], tables.transforms.matrix[lit.transform[wide]], lit.size[wide]
    sides = np.array([[x, z] for x in (-1.0, 1.0) for z in (-1.0, 1.0)])
    half = np.where(ir.is_in(kind, DISKS)[:, None], size[:, :1], size)
    flat = matrix[:, None, :, 3] + np.einsum("kj,nj,nij->nki", sides, half, matrix[:, :, [0, 2]])
    ball = ir.is_in(kind, SPHERES)
    reach = np.linalg.norm(matrix[ball, :, 0], axis=1) * size[ball, 0]
    around = matrix[ball, None, :, 3] + reach[:, None, None] * (2.0 * _CORNERS - 1.0)
    return np.concatenate([flat[~ball].reshape(-1, 3), around.reshape(-1, 3)])


def _bounds_scene(piece: _Primitive, points: Rows) -> bool:
    """Whether all points lie on one side of a primitive, or in its plane."""
    if piece.kind > 2:  # unbounded, or with an interior
        return False
    height = (points - piece.corners[0]) @ piece.normals[0, :3]
    slack = 1e-6 * float(np.abs(points).max())
    return bool(np.all(height <= slack) or np.all(height >= -slack))


# --- primitives of one instance ---


def _primitives_of(tables: ir.Tables, i: int) -> list[_Primitive]:
    """The primitives of an instance; none for other kinds of shapes or where not every ray may hit it."""
    instances, geometries = tables.instances, tables.geometries
    every = ir.Visibility.CAMERA | ir.Visibility.REFLECTION
    g = int(instances.geometry[i])
    kind, p = geometries.kind[g], geometries.parameters[g]
    matrix = tables.transforms.matrix[instances.transform[i]]
    inverse = tables.transforms.inverse[instances.transform[i]]
    if instances.visible[i] & every != every:
        return []
    if kind == ir.GeometryKind.MESH:
        return _mesh_primitives(tables, i, g, matrix)
    if kind == ir.GeometryKind.BOX:
        outward = np.repeat(inverse[:, :3] / np.linalg.norm(inverse[:, :3], axis=1, keepdims=True), 2, axis=0)
        normals = np.column_stack([outward * np.tile([[-1.0], [1.0]], (3, 1)), np.zeros(6)])
        corners = ((2.0 * _CORNERS - 1.0) * p[:3]) @ matrix[:, :3].T + matrix[:, 3]
        return [_Primitive(4, inverse / p[:3, None], normals, corners, 0, 2)]
    if kind == ir.GeometryKind.RECTANGLE:
        x, z = p[:2]
        return [_quad(matrix, (-x, 0, z), (x, 0, z), (-x, 0, -z), 0)]
    normal = np.append(inverse[1, :3] / np.linalg.norm(inverse[1, :3]), 0.0)[None]
    if kind == ir.GeometryKind.PLANE:
        return [_Primitive(3, inverse[[1, 0, 2]], normal, None, 0)]
    if kind == ir.GeometryKind.DISK:
        form = inverse[[1, 0, 2]] / np.array([[1.0], [p[0]], [p[0]]])
        corners = np.array([[x, 0, z] for x in (-p[0], p[0]) for z in (-p[0], p[0])]) @ matrix[:, :3].T + matrix[:, 3]
        return [_Primitive(2, form, normal, corners, 0)]
    even = matrix[:, :3].T @ matrix[:, :3]
    if kind == ir.GeometryKind.SPHERE and np.allclose(even, even[0, 0] * np.eye(3), rtol=0, atol=1e-12 * even[0, 0]):
        radius, centre = float(p[0]) * math.sqrt(even[0, 0]), matrix[:, 3]
        corners = centre + radius * (2.0 * _CORNERS - 1.0)
        return [_Primitive(5, np.append(centre, radius), np.append(centre, 1.0 / radius)[None], corners, 0)]
    return []


def _quad(matrix: Any, origin: Any, first: Any, second: Any, primitive: int, kind: int = 0) -> _Primitive:
    """A parallelogram (kind 0) or triangle (1) from three corners in the instance's frame, counter-clockwise from outside."""
    origin, first, second = (matrix[:, :3] @ np.asarray(c, float) + matrix[:, 3] for c in (origin, first, second))
    u, v = first - origin, second - origin
    normal = np.cross(u, v)
    flipped = -1.0 if np.linalg.det(matrix[:, :3]) < 0.0 else 1.0
    linear = np.linalg.inv(np.stack([normal, u, v], axis=1))
    form = np.column_stack([linear, -linear @ origin])
    corners = np.array([origin, first, second] if kind else [origin, first, second, first + v])
    return _Primitive(kind, form, np.append(flipped * normal / np.linalg.norm(normal), 0.0)[None], corners, primitive)


def _mesh_primitives(tables: ir.Tables, i: int, g: int, matrix: Any) -> list[_Primitive]:
    """The triangles of a small mesh; two that form a parallelogram are one quad where nothing is interpolated over them.

    Triangles of an emissive material stay apart: each is an emitter, and a hit must name it.
    """
    geometries, pools = tables.geometries, tables.pools
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    if not 0 < count <= MESH_TRIANGLES or first + count > EXACT:
        return []
    triangles = pools.triangles[first : first + count]
    positions = pools.positions.astype(np.float64)
    corner = {int(v): positions[v] + geometries.origin[g] for v in np.unique(triangles)}
    quads, remaining = [], list(range(count))
    may_pair = _is_plain(tables)[i] and not tables.materials.values[tables.instances.material[i], ir.Slot.EMISSION].any()
    while remaining:
        k = remaining.pop(0)
        a, b, c = (corner[int(v)] for v in triangles[k])
        partner = next((m for m in remaining if _opposite(triangles[k], triangles[m], corner) is not None), None) if may_pair else None
        if partner is not None:
            remaining.remove(partner)
            origin = _opposite(triangles[k], triangles[partner], corner)
            assert origin is not None
            a, b, c = (corner[int(triangles[k][(origin + n) % 3])] for n in range(3))
            quads.append(_quad(matrix, a, b, c, first + k))
        else:
            quads.append(_quad(matrix, a, b, c, first + k, 1))
    return quads


def _opposite(triangle: Any, other: Any, corner: dict[int, Any]) -> int | None:
    """The corner of a triangle opposite the edge shared with another, if both form a parallelogram."""
    shared = [k for k in range(3) if triangle[k] in other]
    if len(shared) != 2:
        return None
    alone = 3 - sum(shared)
    a, b, c = (corner[int(triangle[(alone + n) % 3])] for n in range(3))
    fourth = next(corner[int(v)] for v in other if v not in triangle)
    return alone if np.abs(b + c - a - fourth).max() <= 1e-6 * np.abs([a, b, c]).max() else None


def _is_bare(tables: ir.Tables) -> NDArray[np.bool_]:
    """(instances,) whether there are no textures, no colors of the mesh, and no light at vertices."""
    materials = tables.materials
    bare = (materials.textures < 0).all(axis=1) & (materials.shading != ir.Shading.GOURAUD)
    return bare[tables.instances.material] & (tables.geometries.colors[tables.instances.geometry] < 0)


def _is_plain(tables: ir.Tables) -> NDArray[np.bool_]:
    """(instances,) whether a point is also shaded by its face normal alone: the mesh has no normals, or they are unused."""
    flat = tables.materials.shading[tables.instances.material] == ir.Shading.FLAT
    return _is_bare(tables) & (flat | (tables.geometries.normals[tables.instances.geometry] < 0))
