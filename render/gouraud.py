"""Gouraud shading: light computed at the vertices of meshes, once for a view, to be interpolated by every backend."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from . import integrate, lanes, materials, surface
from .handles import Handle
from .kernels import helper, kernel
from .records import GouraudLight, Hit, Lane, Options, Ray, Surface, Tables, Vec, View

MESH = int(ir.GeometryKind.MESH)
PERSPECTIVE = int(ir.Projection.PERSPECTIVE)


def vertex_light(tables: Tables, packed: Any, accel: Any, options: Options, view: View) -> GouraudLight:
    """Direct and ambient light at each vertex of every mesh instance whose material is shaded at vertices.

    Light is seen from the camera's place (or along its axis, when orthographic), on the side of the surface that faces it.
    `packed` are the tables as `accel` wants them: a Handle for kernels and trees, the tables themselves for brute force in numpy.
    """
    instances, geometries = tables.instances, tables.geometries
    g = instances.geometry
    shaded = (tables.materials.shading[instances.material] == ir.Shading.GOURAUD) & (geometries.kind[g] == MESH)
    counts = np.where(shaded, geometries.vertex_count[g], 0).astype(np.int64)
    first = np.where(shaded, np.cumsum(counts) - counts, -1).astype(np.int64)
    light = GouraudLight(first, np.zeros((max(int(counts.sum()), 1), 3)))
    for i in np.flatnonzero(shaded):
        corners = _a_corner_of_each_vertex(tables, int(g[i]))
        rows = light.color[first[i] : first[i] + counts[i]]
        if isinstance(packed, Handle):
            _in_kernel(packed, accel, options, view, int(i), corners, rows)
        else:
            _in_numpy(packed, accel, options, view, int(i), corners, rows)
    return light


def _a_corner_of_each_vertex(tables: Tables, g: int) -> np.ndarray:
    """(vertices, 2) a triangle and its corner that each vertex belongs to; -1 for loose ones."""
    geometries = tables.geometries
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    found = np.full((int(geometries.vertex_count[g]), 2), -1, np.int64)
    for corner in (2, 1, 0):
        vertex = tables.pools.triangles[first : first + count, corner] - geometries.first_vertex[g]
        found[vertex, 0] = np.arange(first, first + count)
        found[vertex, 1] = corner
    return found


def _in_numpy(tables: Tables, accel: Any, options: Options, view: View, i: int, corners: np.ndarray, out: np.ndarray) -> None:
    used = np.flatnonzero(corners[:, 0] >= 0)
    lane = np.full(len(used), i, np.int64)
    with np.errstate(all="ignore"):
        rgb = at_vertex(tables, accel, options, view, lane, corners[used, 0], corners[used, 1], used)
    for k in range(3):
        out[used, k] = rgb[k]


@kernel
def _in_kernel(tables, accel, options, view, i, corners, out):
    for vertex in range(len(corners)):
        if corners[vertex, 0] >= 0:
            rgb = at_vertex(tables, accel, options, view, i, corners[vertex, 0], corners[vertex, 1], vertex)
            out[vertex, 0], out[vertex, 1], out[vertex, 2] = rgb


@helper
def at_vertex(
    tables: Tables, accel: Any, options: Options, view: View, instance: Lane, triangle: Lane, corner: Lane, vertex: Lane
) -> Vec:
    """Light at a corner of a triangle, toward the camera."""
    zero = lanes.to_float(triangle) * 0.0
    u, v = lanes.where(corner == 1, 1.0, zero), lanes.where(corner == 2, 1.0, zero)
    point, viewer = _seen_vertex(tables, view, Hit(zero, instance, triangle, u, v))
    shader = materials.at(tables, point)
    everywhere = lanes.bool_like(zero, True)
    return integrate.direct_light(
        tables, accel, options, point, shader, viewer, everywhere, vertex, lanes.int_like(zero, 0), lanes.int_like(zero, 1)
    )


@helper
def _seen_vertex(tables: Tables, view: View, hit: Hit) -> tuple[Surface, Vec]:
    """The surface at a vertex and the direction to the viewer: a ray is laid from the eye to it."""
    cameras = tables.cameras
    row = cameras.transform[view.camera]
    zero = hit.t
    here = surface.at(tables, Ray((zero, zero, zero), (zero, zero, zero + 1.0), zero, zero), hit)
    to_eye = lanes.sub(lanes.transform_point(tables.transforms.matrix, row, (0.0, 0.0, 0.0)), here.position)
    axis = lanes.transform_vector(tables.transforms.matrix, row, (0.0, 0.0, 1.0))
    perspective = cameras.projection[view.camera] == PERSPECTIVE
    viewer = lanes.normalize(lanes.where3(perspective, to_eye, axis))
    origin = lanes.add(here.position, viewer)
    ray = Ray(origin, lanes.negate(viewer), zero, zero + np.inf)
    return surface.at(tables, ray, Hit(zero + 1.0, hit.instance, hit.primitive, hit.u, hit.v)), viewer
