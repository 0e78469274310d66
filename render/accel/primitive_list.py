"""A few primitives need no tree: flat pieces, boxes and balls that all rays are tried against, as many at once as there are lanes.

A piece is three affine forms of a point of the world, (height, a, b): a ray meets the plane where the height is 0, and the piece where
a and b lie in the unit square (parallelograms), the corner of it (triangles) or the unit disk. That is a third of the work of a ray
in a shape's own frame. A box is three forms, each between -1 and 1 inside of it; a ball is its centre and radius.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_facts
from ..geometry.bounds import world_bounds
from ..surface import triangle_records

Rows = NDArray[np.float64]
MOST = 64  # pieces that are tried one after the other before a tree is quicker
LARGE = 12  # pieces of a larger scene that are tried before its tree: those that most rays meet
SHARE = 0.25  # of the scene's diagonal, from which on a thing is large
MESH_TRIANGLES = 24  # of a mesh that may be tried piece by piece
EXACT = 1 << 24  # whole numbers up to this are exact in float32
EDGE = 1e-6  # by which pieces reach beyond their edges, so that no ray passes between two
_TRIED = ir.GeometryKind.BOX, ir.GeometryKind.RECTANGLE, ir.GeometryKind.PLANE, ir.GeometryKind.DISK, ir.GeometryKind.SPHERE
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])


class Pieces(NamedTuple):
    """What is tried. Rows of `forms`: 4 numbers each of height, a and b. Quads stand first, then triangles, disks, endless planes."""

    forms: Rows  # (n, 12)
    boxes: Rows  # (b, 12)
    balls: Rows  # (m, 4) centre and radius
    numbers: NDArray[np.int32]  # (n + b + m,) rows of Records, of a box the first of six
    triangles: int  # where they begin
    disks: int
    planes: int


class Records(NamedTuple):
    """What a piece is a piece of. For those that are `plain`, nothing but their place and their normal is needed to shade them: not 0.

    Triangles in trees have rows behind those of pieces, where they are plain (facets.py).
    """

    # (k, 8) outer unit normal, or a ball's centre; 1 / a ball's radius, or less what is `wide` to surface.spacing; instance, primitive,
    # material, how plain
    rows: Rows
    first: NDArray[np.int32]  # (instances,) which rows meshes in trees have: that of a triangle is so many beyond its number
    rounded: Any  # facets.Flat or facets.Rounded


class Tried(NamedTuple):
    """The pieces of a scene: those that rays meet, those that may stand before a light or between two surfaces, and what they are."""

    seen: Pieces
    blocking: Pieces
    between: Pieces
    records: Records


class _Found(NamedTuple):
    """One piece while the lists are made."""

    kind: int  # 0 quad, 1 triangle, 2 disk, 3 plane, 4 box, 5 ball
    form: Any  # (3, 4) of the world, or centre and radius
    normals: Any  # (parts, 4)
    corners: Any  # (k, 3), None: endless
    primitive: int  # of its first part
    cost: int = 1  # in quads


def build(tables: ir.Tables, hull: bool, moves: bool = False) -> tuple[Tried, NDArray[np.bool_]]:
    """The pieces to try, and which instances they are all of: those need no tree. What `moves` or is not wholly there is none.

    With `hull` (every light lies at a finite place), pieces that have the whole scene and its lights on one side block none of them.
    """
    instances, plain = tables.instances, _is_plain(tables)
    made: dict[int, list[_Found]] = {}
    stays = ~scene_facts.partial(tables)[instances.material]
    if moves:
        stays &= tables.transforms.first_key[instances.transform] < 0
    boxes = world_bounds(tables)
    eligible, many = _eligible(tables, boxes)
    for i in np.flatnonzero(stays & eligible).tolist():
        found = _pieces_of(tables, i)
        if found:
            made[i] = found
    chosen = _chosen(boxes, made, many)
    inside = np.zeros(len(instances.geometry), bool)
    inside[chosen] = True
    listed = [(i, piece) for i in chosen for piece in made[i]]
    rows = [
        (*normal, i, piece.primitive + part, instances.material[i], plain[i])
        for i, piece in listed
        for part, normal in enumerate(piece.normals)
    ]
    own = np.array(rows or [(0.0,) * 8], np.float64)
    meshes = stays & ~inside & _is_bare(tables) & (tables.geometries.kind[instances.geometry] == ir.GeometryKind.MESH)
    how = [(i, triangle_records.PLAIN if plain[i] else triangle_records.ROUNDED) for i in np.flatnonzero(meshes).tolist()]
    more, first, rounded = triangle_records.build(tables, how, len(own))
    records = Records(np.concatenate([own, more]), first, rounded)
    every = list(range(len(listed)))
    points = _points(tables, inside, listed)
    between = every if points is None else [k for k in every if not _bounds(listed[k][1], points)]
    blocking = [k for k in (between if hull else every) if instances.visible[listed[k][0]] & ir.Visibility.SHADOW]
    return Tried(_tables(listed, every), _tables(listed, blocking), _tables(listed, between), records), inside


def _tables(listed: list[tuple[int, _Found]], rows: list[int]) -> Pieces:
    order = sorted(rows, key=lambda k: listed[k][1].kind)
    kinds = np.array([listed[k][1].kind for k in order], int)
    flat, boxes, balls = ([k for k in order if listed[k][1].kind in of] for of in (range(4), (4,), (5,)))
    first = np.cumsum([0, *(len(piece.normals) for _, piece in listed)])
    starts = [int(np.sum(kinds < kind)) for kind in (1, 2, 3)]
    return Pieces(
        np.array([np.ravel(listed[k][1].form) for k in flat]).reshape(-1, 12),
        np.array([np.ravel(listed[k][1].form) for k in boxes]).reshape(-1, 12),
        np.array([listed[k][1].form for k in balls]).reshape(-1, 4),
        first[order].astype(np.int32),
        *starts,
    )


def _eligible(tables: ir.Tables, boxes: Rows) -> tuple[NDArray[np.bool_], bool]:
    """(instances,) whose pieces are to be looked at, and whether things are so many that these are the large ones alone."""
    geometry = tables.instances.geometry
    small = (tables.geometries.kind == ir.GeometryKind.MESH) & (tables.geometries.triangle_count <= MESH_TRIANGLES)
    eligible = (ir.is_in(tables.geometries.kind, _TRIED) | small)[geometry]
    finite = np.isfinite(boxes).all(axis=1)
    if np.count_nonzero(eligible) <= MOST or not finite.any():
        return eligible, False
    whole = np.linalg.norm(boxes[finite, 3:].max(axis=0) - boxes[finite, :3].min(axis=0))
    large = np.linalg.norm(boxes[:, 3:] - boxes[:, :3], axis=1) >= 0.99 * SHARE * whole  # `_chosen` measures what is in the boxes
    return eligible & (large | ~finite), True


def _chosen(boxes: Rows, made: dict[int, list[_Found]], many: bool) -> list[int]:
    """The instances whose pieces are tried: all where they are few, else the large ones."""
    cost = {i: sum(piece.cost for piece in found) for i, found in made.items()}
    many = many or sum(cost.values()) > MOST
    if not many and len(made) == len(boxes):
        return list(made)
    finite = {i: np.concatenate([p.corners for p in found]) for i, found in made.items() if all(p.corners is not None for p in found)}
    if not finite:
        return [i for i in made if i not in finite][:LARGE]
    rest = np.delete(boxes, list(made), axis=0)
    rest = rest[np.isfinite(rest).all(axis=1)]
    whole = np.concatenate([*finite.values(), rest[:, :3], rest[:, 3:]])
    least = SHARE * np.linalg.norm(np.ptp(whole, axis=0))
    chosen, left = [], LARGE if many else MOST
    for i in made:
        large = i not in finite or np.linalg.norm(np.ptp(finite[i], axis=0)) >= least
        if large and cost[i] <= left:
            chosen.append(i)
            left -= cost[i]
    return chosen


def _box_corners(tables: ir.Tables, which: NDArray[np.bool_]) -> Rows:
    """(8 n, 3) the corners of instances' boxes."""
    bounds = tables.geometries.bounds[tables.instances.geometry[which]]
    matrix = tables.transforms.matrix[tables.instances.transform[which]]
    corners = bounds[:, :1] + _CORNERS * (bounds[:, 1:] - bounds[:, :1])
    return (corners @ matrix[:, :, :3].transpose(0, 2, 1) + matrix[:, None, :, 3]).reshape(-1, 3)


def _points(tables: ir.Tables, inside: NDArray[np.bool_], listed: list[tuple[int, _Found]]) -> Rows | None:
    """Points whose hull holds the scene and its lights; None where it has no end."""
    if not np.isfinite(tables.geometries.bounds[tables.instances.geometry[~inside]]).all():
        return None
    found = [_box_corners(tables, ~inside)]
    for _, piece in listed:
        if piece.corners is None:
            return None
        found.append(piece.corners)
    found.append(tables.lights.position[ir.is_in(tables.lights.kind, (ir.LightKind.POINT, ir.LightKind.SPOT))])
    found.append(_lamp_corners(tables))
    return np.concatenate(found)


def _lamp_corners(tables: ir.Tables) -> Rows:
    """(n, 3) corners around lamps with an extent."""
    lit = tables.lights
    wide = ir.is_in(lit.kind, (ir.LightKind.RECTANGLE, ir.LightKind.DISK, ir.LightKind.SPHERE))
    kind, matrix, size = lit.kind[wide], tables.transforms.matrix[lit.transform[wide]], lit.size[wide]
    sides = np.array([[x, z] for x in (-1.0, 1.0) for z in (-1.0, 1.0)])
    half = np.where((kind == ir.LightKind.DISK)[:, None], size[:, :1], size)
    flat = matrix[:, None, :, 3] + np.einsum("kj,nj,nij->nki", sides, half, matrix[:, :, [0, 2]])
    ball = kind == ir.LightKind.SPHERE
    reach = np.linalg.norm(matrix[ball, :, 0], axis=1) * size[ball, 0]
    around = matrix[ball, None, :, 3] + reach[:, None, None] * (2.0 * _CORNERS - 1.0)
    return np.concatenate([flat[~ball].reshape(-1, 3), around.reshape(-1, 3)])


def _bounds(piece: _Found, points: Rows) -> bool:
    """Whether all points lie on one side of a piece, or in its plane."""
    if piece.kind > 2:  # endless, or with an inside
        return False
    height = (points - piece.corners[0]) @ piece.normals[0, :3]
    slack = 1e-6 * float(np.abs(points).max())
    return bool(np.all(height <= slack) or np.all(height >= -slack))


# --- pieces of one thing -------------------------------------------------------------------------------------------------


def _pieces_of(tables: ir.Tables, i: int) -> list[_Found]:
    """The pieces of an instance; none where it is made of other things, or not every ray may meet it."""
    instances, geometries = tables.instances, tables.geometries
    every = ir.Visibility.CAMERA | ir.Visibility.REFLECTION
    g = int(instances.geometry[i])
    kind, p = geometries.kind[g], geometries.parameters[g]
    matrix = tables.transforms.matrix[instances.transform[i]]
    inverse = tables.transforms.inverse[instances.transform[i]]
    if instances.visible[i] & every != every:
        return []
    if kind == ir.GeometryKind.MESH:
        return _mesh_pieces(tables, i, g, matrix)
    if kind == ir.GeometryKind.BOX:
        outward = np.repeat(inverse[:, :3] / np.linalg.norm(inverse[:, :3], axis=1, keepdims=True), 2, axis=0)
        normals = np.column_stack([outward * np.tile([[-1.0], [1.0]], (3, 1)), np.zeros(6)])
        corners = ((2.0 * _CORNERS - 1.0) * p[:3]) @ matrix[:, :3].T + matrix[:, 3]
        return [_Found(4, inverse / p[:3, None], normals, corners, 0, 2)]
    if kind == ir.GeometryKind.RECTANGLE:
        x, z = p[:2]
        return [_quad(matrix, (-x, 0, z), (x, 0, z), (-x, 0, -z), 0)]
    normal = np.append(inverse[1, :3] / np.linalg.norm(inverse[1, :3]), 0.0)[None]
    if kind == ir.GeometryKind.PLANE:
        return [_Found(3, inverse[[1, 0, 2]], normal, None, 0)]
    if kind == ir.GeometryKind.DISK:
        form = inverse[[1, 0, 2]] / np.array([[1.0], [p[0]], [p[0]]])
        corners = np.array([[x, 0, z] for x in (-p[0], p[0]) for z in (-p[0], p[0])]) @ matrix[:, :3].T + matrix[:, 3]
        return [_Found(2, form, normal, corners, 0)]
    even = matrix[:, :3].T @ matrix[:, :3]
    if kind == ir.GeometryKind.SPHERE and np.allclose(even, even[0, 0] * np.eye(3), rtol=0, atol=1e-12 * even[0, 0]):
        radius, centre = float(p[0]) * math.sqrt(even[0, 0]), matrix[:, 3]
        corners = centre + radius * (2.0 * _CORNERS - 1.0)
        return [_Found(5, np.append(centre, radius), np.append(centre, 1.0 / radius)[None], corners, 0)]
    return []


def _quad(matrix: Any, origin: Any, first: Any, second: Any, primitive: int, kind: int = 0) -> _Found:
    """A parallelogram (kind 0) or triangle (1) from three corners in a thing's own frame, counter-clockwise from outside."""
    origin, first, second = (matrix[:, :3] @ np.asarray(c, float) + matrix[:, 3] for c in (origin, first, second))
    u, v = first - origin, second - origin
    normal = np.cross(u, v)
    flipped = -1.0 if np.linalg.det(matrix[:, :3]) < 0.0 else 1.0
    linear = np.linalg.inv(np.stack([normal, u, v], axis=1))
    form = np.column_stack([linear, -linear @ origin])
    corners = np.array([origin, first, second] if kind else [origin, first, second, first + v])
    return _Found(kind, form, np.append(flipped * normal / np.linalg.norm(normal), 0.0)[None], corners, primitive)


def _mesh_pieces(tables: ir.Tables, i: int, g: int, matrix: Any) -> list[_Found]:
    """A small mesh's triangles, two that make a parallelogram as one where nothing is interpolated over them.

    Of what shines each is an emitter of its own, and what is met must tell which.
    """
    geometries, pools = tables.geometries, tables.pools
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    if not 0 < count <= MESH_TRIANGLES or first + count > EXACT:
        return []
    triangles = pools.triangles[first : first + count]
    at = pools.positions.astype(np.float64)
    corner = {int(v): at[v] + geometries.origin[g] for v in np.unique(triangles)}
    found, left = [], list(range(count))
    whole = _is_plain(tables)[i] and not tables.materials.values[tables.instances.material[i], ir.Slot.EMISSION].any()
    while left:
        k = left.pop(0)
        a, b, c = (corner[int(v)] for v in triangles[k])
        partner = next((m for m in left if _opposite(triangles[k], triangles[m], corner) is not None), None) if whole else None
        if partner is not None:
            left.remove(partner)
            origin = _opposite(triangles[k], triangles[partner], corner)
            assert origin is not None
            a, b, c = (corner[int(triangles[k][(origin + n) % 3])] for n in range(3))
            found.append(_quad(matrix, a, b, c, first + k))
        else:
            found.append(_quad(matrix, a, b, c, first + k, 1))
    return found


def _opposite(one: Any, other: Any, corner: dict[int, Any]) -> int | None:
    """Which corner of a triangle lies across the edge it shares with another, if both make a parallelogram."""
    shared = [k for k in range(3) if one[k] in other]
    if len(shared) != 2:
        return None
    alone = 3 - sum(shared)
    a, b, c = (corner[int(one[(alone + n) % 3])] for n in range(3))
    fourth = next(corner[int(v)] for v in other if v not in one)
    return alone if np.abs(b + c - a - fourth).max() <= 1e-6 * np.abs([a, b, c]).max() else None


def _is_bare(tables: ir.Tables) -> NDArray[np.bool_]:
    """(instances,) which have no texture, no colours of their mesh, and no light at vertices."""
    materials = tables.materials
    bare = (materials.textures < 0).all(axis=1) & (materials.shading != ir.Shading.GOURAUD)
    return bare[tables.instances.material] & (tables.geometries.colors[tables.instances.geometry] < 0)


def _is_plain(tables: ir.Tables) -> NDArray[np.bool_]:
    """(instances,) of which, beside that, a point is shaded by its normal alone: their meshes have no normals, or they don't count."""
    flat = tables.materials.shading[tables.instances.material] == ir.Shading.FLAT
    return _is_bare(tables) & (flat | (tables.geometries.normals[tables.instances.geometry] < 0))
