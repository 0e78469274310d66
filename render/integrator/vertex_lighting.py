"""Gouraud shading: light at the vertices of meshes, computed once for a view."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ...compiler import ir
from ...lights import SOFT
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle
from ..lanes import affine, crosslane, ops
from ..material.shader import evaluate_shader
from ..surface import interaction
from ..types import Hit, Lane, Ray, Surface, Tables, Vec, VertexLight, View
from . import direct_light
from .state.records import SampleIndex, Scene, ShadingContext

SOFT_SAMPLES = 64  # of lights with an extent, at each vertex
MESH = int(ir.GeometryKind.MESH)
ORTHOGRAPHIC = int(ir.Projection.ORTHOGRAPHIC)


def vertex_light(tables: Tables, packed: Any, accel: Any, frame: Any) -> VertexLight:
    """Return direct and ambient light at the vertices of mesh instances with Gouraud materials, for both sides.

    The viewer is the camera's position, or its axis if it is orthographic. Each vertex has light for both sides, as vertices of a
    silhouette belong to triangles of either; a triangle reads the side it shows. `packed` and `frame` are the tables and a Frame:
    Handles if `accel` is a BVH, else the records themselves.
    """
    instances, geometries = tables.instances, tables.geometries
    g = instances.geometry
    shaded = (tables.materials.shading[instances.material] == ir.Shading.GOURAUD) & (geometries.kind[g] == MESH)
    counts = np.where(shaded, geometries.vertex_count[g], 0).astype(np.int64)
    first = np.where(shaded, np.cumsum(counts) - counts, -1).astype(np.int64)
    half = max(int(counts.sum()), 1)
    light = VertexLight(first, np.zeros((2 * half, 3)))
    samples = SOFT_SAMPLES if ir.is_in(tables.lights.kind, SOFT).any() else 1
    run: Any = _in_kernel if isinstance(packed, Handle) else _in_numpy
    for i in np.flatnonzero(shaded):
        corners = _vertex_corners(tables, int(g[i]))
        used = np.flatnonzero(corners[:, 0] >= 0)
        for side, start in ((1.0, first[i]), (-1.0, half + first[i])):
            out = light.color[start : start + counts[i]]
            run(packed, accel, frame, samples, side, int(i), corners[used, 0], corners[used, 1], used, out)
    return light


@functools.cache
def none() -> Handle:
    """Return a handle of no vertex light."""
    return Handle(VertexLight(np.zeros(0, np.int64), np.zeros((0, 3))))


def _vertex_corners(tables: Tables, g: int) -> np.ndarray:
    """(vertices, 2) a triangle and corner of each vertex; -1 for unused vertices."""
    geometries = tables.geometries
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    corners = np.full((int(geometries.vertex_count[g]), 2), -1, np.int64)
    for corner in (2, 1, 0):
        vertex = tables.pools.triangles[first : first + count, corner] - geometries.first_vertex[g]
        corners[vertex, 0] = np.arange(first, first + count)
        corners[vertex, 1] = corner
    return corners


def _in_numpy(
    tables: Tables, accel: Any, frame: Any, samples: int, side: float, i: int, triangle: Any, corner: Any, vertex: Any, out: Any
) -> None:
    lane = np.full(len(vertex), i, np.int64)
    with np.errstate(all="ignore"):
        rgb = at_vertex(tables, accel, frame, samples, side, lane, triangle, corner, vertex)
    for k in range(3):
        out[vertex, k] = rgb[k]


@kernel
def _in_kernel(tables, accel, frame, samples, side, i, triangle, corner, vertex, out):
    n = len(vertex)
    for start in range(0, n, crosslane.WIDTH):
        k = ops.minimum(crosslane.lane_indices(start), n - 1)  # the last lanes may repeat the last vertex
        rgb = at_vertex(tables, accel, frame, samples, side, i, triangle[k], corner[k], vertex[k])
        for j in range(min(n - start, crosslane.WIDTH)):
            for c in range(3):
                out[vertex[start + j], c] = crosslane.lane(rgb[c], j)


@helper
def at_vertex(
    tables: Tables, accel: Any, frame: Any, samples: int, side: float,
    instance: Lane, triangle: Lane, corner: Lane, vertex: Lane,
) -> Vec:  # fmt: skip
    """Return the light at a corner of a triangle, on its outside (side 1) or inside (-1), as the mean of `samples`."""
    zero = ops.to_float(triangle) * 0.0
    u, v = ops.where(corner == 1, 1.0, zero), ops.where(corner == 2, 1.0, zero)
    point = _surface_at_vertex(tables, Hit(zero, instance, triangle, u, v), side)
    shader = evaluate_shader(tables, point)
    scene = Scene(tables, accel, None, frame.options)
    shading = ShadingContext(point, shader, _to_viewer(tables, frame.picture, point), None, None)
    everywhere, key = ops.bool_like(zero, True), ops.int_like(zero, 1)
    total = (zero, zero, zero)
    for s in range(samples):
        sample = ops.int_like(zero, s)
        light = direct_light.direct_light(scene, shading, everywhere, SampleIndex(vertex, sample, key))
        total = ops.add(total, light)
    return ops.scale(total, 1.0 / samples)


@helper
def _surface_at_vertex(tables: Tables, hit: Hit, side: float) -> Surface:
    """The surface at a vertex, hit by a ray from straight above (side 1) or below (-1) the triangle."""
    zero = hit.t
    any_ray = Ray((zero, zero, zero), (zero, zero, zero + 1.0), zero, zero + np.inf, None)
    surface = interaction.make_interaction(tables, any_ray, hit)
    above = ops.scale(surface.geometric, ops.where(surface.front, side, -side))
    ray = Ray(ops.add(surface.position, above), ops.negate(above), zero, zero + np.inf, None)
    return interaction.make_interaction(tables, ray, Hit(zero + 1.0, hit.instance, hit.primitive, hit.u, hit.v))


@helper
def _to_viewer(tables: Tables, view: View, point: Surface) -> Vec:
    """The unit direction from a point to the camera."""
    cameras, matrix = tables.cameras, tables.transforms.matrix
    row = cameras.transform[view.camera]
    to_eye = ops.sub(affine.transform_point(matrix, row, (0.0, 0.0, 0.0)), point.position)
    axis = affine.transform_vector(matrix, row, (0.0, 0.0, 1.0))
    return ops.normalize(ops.where3(cameras.projection[view.camera] == ORTHOGRAPHIC, axis, to_eye))
