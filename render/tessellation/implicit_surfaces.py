"""Implicit surfaces to triangles, by dual contouring."""

from __future__ import annotations

import numpy as np

from ...compiler import ir
from ...compiler.formula import dual_contouring, numpy_interpreter
from ...shapes.surfaces import Tessellation
from ..formula import scene_surfaces

SIDE = 0.1  # of the way from a corner of a triangle to its center
SMOOTH_COSINE = 0.95  # of two normals of one vertex; below it there is an edge
EDGE_STEPS = 32  # of a normal's components, which are equal on one side of an edge


def contour(tables: ir.Tables, g: int, tolerance: float, complete: bool = False) -> dual_contouring.Contour:
    """The triangles of implicit surface `g` in its own frame, `tolerance` metres off; `tolerance` and `complete` as in `within`.

    Only the part inside its ball, for a sheet that has one.
    """
    surface = dual_contouring.within(scene_surfaces.tape_of(tables, g), tables.geometries.bounds[g], tolerance, complete=complete)
    *middle, radius = tables.geometries.parameters[g, 1:5].tolist()
    if radius > 0.0:
        inside = np.linalg.norm(surface.positions[surface.triangles].mean(axis=1) - middle, axis=1) <= radius
        surface = surface._replace(triangles=surface.triangles[inside])
    return surface


def tessellate(tables: ir.Tables, g: int, tolerance: float) -> Tessellation:
    """The contour of implicit surface `g` as a tessellation."""
    return as_tessellation(contour(tables, g, tolerance))


def as_tessellation(surface: dual_contouring.Contour) -> Tessellation:
    """A contour as a tessellation, with the coordinates of `analytic_shapes.uv`."""
    positions = np.concatenate([surface.positions, np.ones((len(surface.positions), 1))], axis=1)
    triangles = surface.triangles.astype(np.int32)
    uvs = np.stack([surface.positions[:, 0], -surface.positions[:, 2]], axis=1)
    return Tessellation(positions, triangles, surface.normals, uvs, np.zeros(len(triangles), np.int32))


def with_edges(tables: ir.Tables, g: int, tessellation: Tessellation) -> Tessellation:
    """The tessellation of implicit surface `g` with vertices divided along its edges: each side has the normals of its own face.

    The gradient is evaluated for each corner of a triangle, from the corner a share of SIDE of the way to the triangle's center.
    """
    corners = tessellation.positions[tessellation.triangles, :3]
    probes = corners + SIDE * (corners.mean(axis=1, keepdims=True) - corners)
    with np.errstate(all="ignore"):
        _, gradient = numpy_interpreter.gradients(scene_surfaces.tape_of(tables, g), *probes.reshape(-1, 3).T)
        normal = (gradient / np.linalg.norm(gradient, axis=0)).T
    vertex = tessellation.triangles.ravel()
    smooth_normal = tessellation.normals[vertex]
    normal = np.where(np.isfinite(normal).all(axis=1, keepdims=True), normal, smooth_normal)
    smooth = (normal * smooth_normal).sum(axis=1) >= SMOOTH_COSINE
    normal = np.where(smooth[:, None], smooth_normal, normal)
    keys = np.concatenate([vertex[:, None], np.where(smooth[:, None], 0, np.round(normal * EDGE_STEPS)).astype(np.int64)], axis=1)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    source = vertex[first]
    triangles = index.reshape(-1, 3).astype(np.int32)
    return Tessellation(tessellation.positions[source], triangles, normal[first], tessellation.uvs[source], tessellation.parts)
