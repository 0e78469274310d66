"""Tubes and ribbons of many curves at once, for hair and fur; `tubes.py` makes one mitred tube."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..ir import F64, I64, Interpolation
from ..scene.row_records import MeshAttribute
from .polygon_mesh import PolyMesh

_SIDES = ((50_000, 16), (500_000, 8))  # up to so many samples, sides of a tube
_FEWEST_SIDES = 4  # without ends and with normals of points
_MOST_STRETCH = 3.0  # of a section at a corner; sharper ones are bevelled (the mitre limit of PostScript)


class Strands(NamedTuple):
    """Polylines, one after the other."""

    points: F64  # (m, 3)
    radii: F64  # (m,)
    counts: I64  # (c,) points of each polyline, two or more
    closed: np.ndarray  # (c,) whether the last point is joined to the first


def tangents(strands: Strands) -> tuple[F64, F64]:
    """Unit tangents (m, 3), which halve the angles between segments, and the way (m, 3) that a section is stretched there.

    A section is stretched by 1 + |way| along `way`, to the mitre of both segments.
    """
    before, after = _neighbours(strands)
    arriving, leaving = _unit(strands.points - strands.points[before]), _unit(strands.points[after] - strands.points)
    both = arriving + leaving
    lost = np.einsum("ij,ij->i", both, both) < 1e-12
    along = _unit(np.where(lost[:, None], np.where((leaving != 0).any(axis=1)[:, None], leaving, (0.0, 1.0, 0.0)), both))
    cosine = np.where((arriving == 0).all(axis=1) | (leaving == 0).all(axis=1), 1.0, np.einsum("ij,ij->i", along, leaving))
    stretch = np.minimum(1.0 / np.maximum(cosine, 1e-3), _MOST_STRETCH) - 1.0
    return along, _unit(leaving - cosine[:, None] * along) * stretch[:, None]


def _bevelled(strands: Strands) -> tuple[Strands, I64]:
    """The polylines with each corner twice that is too sharp for a mitre, and the points (n,) that theirs are.

    Two points at one place have a section each, across their own segment, and the bevel between. One stretched section would be too thin.
    """
    before, after = _neighbours(strands)
    arriving, leaving = _unit(strands.points - strands.points[before]), _unit(strands.points[after] - strands.points)
    inner = (arriving != 0).any(axis=1) & (leaving != 0).any(axis=1)
    # The cosine of the whole turn is 2 cos² − 1 of its half, whose inverse is the stretch.
    sharp = inner & (np.einsum("ij,ij->i", arriving, leaving) < 2.0 / _MOST_STRETCH**2 - 1.0)
    rows = np.repeat(np.arange(len(strands.points)), 1 + sharp)
    of = np.repeat(np.arange(len(strands.counts)), strands.counts)
    counts = strands.counts + np.bincount(of[sharp], minlength=len(strands.counts))
    return Strands(strands.points[rows], strands.radii[rows], counts, strands.closed), rows


def _neighbours(strands: Strands) -> tuple[I64, I64]:
    """Rows of the points before and after each point; ends of open polylines are their own."""
    first = np.cumsum(strands.counts) - strands.counts
    last = first + strands.counts - 1
    before, after = np.arange(len(strands.points)) - 1, np.arange(len(strands.points)) + 1
    before[first] = np.where(strands.closed, last, first)
    after[last] = np.where(strands.closed, first, last)
    return before, after


def _frames(strands: Strands, along: F64) -> F64:
    """Unit vectors (m, 3) across the tangents, transported without twist (Bishop 1975).

    The smallest rotation from a tangent to the next turns the frame of one point against that of the next by an angle. The sum of these
    angles along a polyline makes up for it.
    """
    first = np.cumsum(strands.counts) - strands.counts
    across = _unit(np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)]))
    beside = np.cross(along, across)
    before, after = along[:-1], along[1:]
    cosine = 1.0 + np.einsum("ij,ij->i", before, after)
    turned = cosine > 1e-9  # back along itself has no smallest rotation
    share = np.einsum("ij,ij->i", after, across[:-1]) / np.where(turned, cosine, 1.0)
    moved = across[:-1] - share[:, None] * (before + after)
    angle = np.zeros(len(along))
    angle[1:] = np.arctan2(np.einsum("ij,ij->i", moved, beside[1:]), np.einsum("ij,ij->i", moved, across[1:])) * turned
    angle[first] = 0.0
    angle = np.cumsum(angle)
    angle -= np.repeat(angle[first], strands.counts)
    return np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * beside


def _unit(vectors: F64) -> F64:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _segments(strands: Strands) -> tuple[I64, I64]:
    """Rows of the two ends of each segment."""
    _, after = _neighbours(strands)
    rows = np.arange(len(strands.points))
    used = after != rows  # the bevel between the two points of a corner is a segment too
    return rows[used], after[used]


def tubes(strands: Strands, uvs: np.ndarray | None = None, colors: np.ndarray | None = None) -> PolyMesh:
    """Round tubes with smooth normals and flat ends; without ends if they have very many points.

    `uvs` (m, 2) and `colors` (m, 3) are values at the points.
    """
    strands, rows = _bevelled(strands)
    uvs, colors = (None if values is None else np.asarray(values)[rows] for values in (uvs, colors))
    sides = next((sides for most, sides in _SIDES if len(strands.points) <= most), _FEWEST_SIDES)
    along, way = tangents(strands)
    across = _frames(strands, along)
    beside = np.cross(along, across)
    angle = 2 * np.pi * np.arange(sides) / sides
    outward = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * beside[:, None]  # (m, sides, 3)
    length = np.linalg.norm(way, axis=1)
    stretched = (outward @ way[:, :, None]) / np.maximum(length, 1e-300)[:, None, None] * way[:, None]
    points = strands.points[:, None] + strands.radii[:, None, None] * (outward + stretched)
    a, b = (rows[:, None] * sides for rows in _segments(strands))
    k, after = np.arange(sides), (np.arange(sides) + 1) % sides
    quads = np.stack([a + k, a + after, b + after, b + k], axis=2).reshape(-1, 4)

    def spread(values: np.ndarray | None) -> MeshAttribute | None:
        return None if values is None else MeshAttribute(np.repeat(values, sides, axis=0).astype(np.float32))

    if sides == _FEWEST_SIDES:
        normal = MeshAttribute(outward.reshape(-1, 3).astype(np.float32))
        return PolyMesh(points.reshape(-1, 3), np.full(len(quads), 4), quads.reshape(-1), normal, spread(uvs), spread(colors))
    first = np.cumsum(strands.counts) - strands.counts
    low, high = first[~strands.closed], (first + strands.counts - 1)[~strands.closed]
    caps = np.concatenate([low[:, None] * sides + k[::-1], high[:, None] * sides + k])
    flat = np.repeat(np.concatenate([-along[low], along[high]]), sides, axis=0)
    normals = np.concatenate([outward.reshape(-1, 3)[quads.reshape(-1)], flat])
    counts = np.concatenate([np.full(len(quads), 4), np.full(len(caps), sides)])
    indices = np.concatenate([quads.reshape(-1), caps.reshape(-1)])
    normal = MeshAttribute(normals.astype(np.float32), Interpolation.CORNER)
    return PolyMesh(points.reshape(-1, 3), counts, indices, normal, spread(uvs), spread(colors))


def ribbons(strands: Strands, facing: F64, uvs: np.ndarray | None = None, colors: np.ndarray | None = None) -> PolyMesh:
    """Flat ribbons whose normals are those of `facing` (m, 3), made perpendicular to the curve."""
    strands, rows = _bevelled(strands)
    facing, uvs, colors = facing[rows], *(None if values is None else np.asarray(values)[rows] for values in (uvs, colors))
    along, way = tangents(strands)
    side = _unit(np.asarray(np.cross(facing, along), np.float64)) * (strands.radii * (1.0 + np.linalg.norm(way, axis=1)))[:, None]
    points = np.stack([strands.points - side, strands.points + side], axis=1).reshape(-1, 3)
    a, b = (2 * rows for rows in _segments(strands))
    quads = np.stack([a, b, b + 1, a + 1], axis=1)

    def spread(values: np.ndarray | None) -> MeshAttribute | None:
        return None if values is None else MeshAttribute(np.repeat(values, 2, axis=0).astype(np.float32))

    normals = _unit(np.asarray(np.cross(along, side), np.float64))
    return PolyMesh(points, np.full(len(quads), 4), quads.reshape(-1), spread(normals), spread(uvs), spread(colors))


def balls(centers: F64, radii: F64, colors: np.ndarray | None = None) -> PolyMesh:
    """Spheres as triangles with smooth normals: 320, 80 or 20 triangles each, the fewer the more spheres."""
    unit, triangles = _icosphere(2 if len(centers) <= 2_000 else 1 if len(centers) <= 50_000 else 0)
    points = centers[:, None] + radii[:, None, None] * unit
    indices = triangles[None] + (np.arange(len(centers)) * len(unit))[:, None, None]
    normals = np.broadcast_to(unit, points.shape).reshape(-1, 3).astype(np.float32)
    tint = None if colors is None else MeshAttribute(np.repeat(colors, len(unit), axis=0).astype(np.float32))
    return PolyMesh(points.reshape(-1, 3), np.full(indices.size // 3, 3), indices.reshape(-1), MeshAttribute(normals), None, tint)


def _icosphere(level: int) -> tuple[F64, I64]:
    """Unit vectors and triangles of an icosahedron, subdivided `level` times."""
    g = 0.5 + math.sqrt(1.25)
    points: F64 = _unit(np.array([[a, b * g, 0.0] for a in (-1, 1) for b in (-1, 1)] + [[0.0, a, b * g] for a in (-1, 1) for b in (-1, 1)]
                            + [[b * g, 0.0, a] for a in (-1, 1) for b in (-1, 1)]))  # fmt: skip
    near = np.linalg.norm(points[:, None] - points, axis=2) < 1.1
    np.fill_diagonal(near, False)
    faces = [[i, j, k] for i in range(12) for j in range(i) for k in range(j) if near[i, j] and near[j, k] and near[i, k]]
    triangles = np.array(faces)
    inward = np.linalg.det(points[triangles]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    for _ in range(level):
        edges = np.sort(np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        unique, rows = np.unique(edges, axis=0, return_inverse=True)
        middle = len(points) + rows.reshape(-1, 3)
        points = np.concatenate([points, _unit(points[unique].mean(axis=1))])
        corners = [np.stack([triangles[:, k], middle[:, k], middle[:, k - 1]], axis=1) for k in range(3)]
        triangles = np.concatenate([*corners, middle])
    return points, triangles
