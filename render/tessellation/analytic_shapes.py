"""Tessellates analytic shapes within a tolerance, with the coordinates of their surface; see shapes/surfaces.py."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...shapes import SHAPES
from ...shapes.surfaces import MAX_SEGMENTS, Tessellation, sagitta, unlimited_segments
from ..geometry import analytic_shapes


def visible_analytic(tables: ir.Tables) -> NDArray[np.intp]:
    """The rows of instances that are visible to the camera and no meshes."""
    instances, geometries = tables.instances, tables.geometries
    analytic = geometries.kind[instances.geometry] != ir.GeometryKind.MESH
    return np.flatnonzero(analytic & (instances.visible & ir.Visibility.CAMERA != 0))


def tessellate(kind: int, parameters: Sequence[float], tolerance: float) -> Tessellation:
    """Tessellate a shape of `kind` (ir.GeometryKind) within `tolerance` metres; meshes and unbounded quadrics are not supported.

    `parameters` and `tolerance` are in the geometry's frame. At most MAX_SEGMENTS segments go around and half as many across, so a very
    small tolerance is not reached. Raises ValueError for other kinds.
    """
    if kind not in SHAPES:
        raise ValueError(f"no tessellation for geometry kind {kind}")
    tessellation = SHAPES[kind].triangles(parameters, tolerance)
    return with_uvs(kind, parameters, outward(tessellation)) if tessellation.positions[:, 3].all() else tessellation


def exceeds_limit(kind: int, parameters: Sequence[float], tolerance: float) -> bool:
    """Whether the circles of a shape around its axis need more than MAX_SEGMENTS for a tolerance."""
    circles = SHAPES[kind].circles(parameters)
    return bool(circles) and unlimited_segments(circles[0][0], circles[0][1] * tolerance) > MAX_SEGMENTS


def deviation(kind: int, parameters: Sequence[float], tolerance: float, tessellation: Tessellation) -> float:
    """The largest distance of the triangles of `tessellate` from the shape: that of chords, of quadrics measured to first order."""
    shape = SHAPES[kind]
    if shape.deviation is not None:
        return shape.deviation(parameters, tessellation)
    return sum((sagitta(radius, share * tolerance) for radius, share in shape.circles(parameters)), 0.0)


def with_uvs(kind: int, parameters: Sequence[float], tessellation: Tessellation) -> Tessellation:
    """The same with the uv of geometry.analytic_shapes on flat parts and where a shape's triangles leave them out.

    Round parts keep their profile's: the same values, but 0 and 1 on the sides of the seam, and a u at each pole.
    """
    part = np.zeros(len(tessellation.positions), np.int64)
    part[tessellation.triangles.ravel()] = np.repeat(tessellation.parts, 3)
    row = np.zeros((1, ir.PARAMETERS))
    row[0, : len(parameters)] = parameters
    x, y, z = tessellation.positions[:, :3].T
    none = np.zeros(len(part), np.int64)
    with np.errstate(all="ignore"):
        (u, v), _ = analytic_shapes.uv(none + kind, row, none, part, (x, y, z))
    exact = (part > 0) | np.isnan(tessellation.uvs).any(axis=1)
    tessellation = tessellation._replace(uvs=np.where(exact[:, None], np.stack([u, v], axis=1), tessellation.uvs))
    return _split_seam(tessellation) if SHAPES[kind].WRAPS else tessellation


def _split_seam(tessellation: Tessellation) -> Tessellation:
    """Duplicate the vertices of triangles across the seam of u on its low side, with u + 1."""
    u = tessellation.uvs[tessellation.triangles, 0]
    low = (u.max(axis=1) - u.min(axis=1) > 0.5)[:, None] & (u < 0.5)
    doubled, index = np.unique(tessellation.triangles[low], return_inverse=True)
    triangles = tessellation.triangles.copy()
    triangles[low] = (len(tessellation.positions) + index).astype(np.int32)
    columns = tessellation.positions, tessellation.normals
    positions, normals = (np.concatenate([column, column[doubled]]) for column in columns)
    uvs = np.concatenate([tessellation.uvs, tessellation.uvs[doubled] + [1.0, 0.0]])
    return tessellation._replace(positions=positions, triangles=triangles, normals=normals, uvs=uvs)


def outward(tessellation: Tessellation) -> Tessellation:
    """The same triangles, counterclockwise seen from the side of their normals. Points must be finite."""
    a, b, c = (tessellation.positions[tessellation.triangles[:, k], :3] for k in range(3))
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), tessellation.normals[tessellation.triangles].sum(axis=1))
    turned = np.where((facing < 0)[:, None], tessellation.triangles[:, ::-1], tessellation.triangles)
    return tessellation._replace(triangles=np.ascontiguousarray(turned))
