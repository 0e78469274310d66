"""Implicit surfaces to triangles, by dual contouring."""

from __future__ import annotations

import numpy as np

from ...compiler import ir
from ...compiler.formula import dual_contouring
from ..formula import scene_surfaces
from .analytic_shapes import Tessellation


def contour(tables: ir.Tables, g: int, tolerance: float, whole: bool = False) -> dual_contouring.Contour:
    """The triangles of implicit surface `g` in its own frame, `tolerance` metres off; `tolerance` and `whole` as in `within`.

    Only the part inside its ball, for a sheet that has one.
    """
    made = dual_contouring.within(scene_surfaces.tape_of(tables, g), tables.geometries.bounds[g], tolerance, whole=whole)
    *middle, radius = tables.geometries.parameters[g, 1:5].tolist()
    if radius > 0.0:
        inside = np.linalg.norm(made.positions[made.triangles].mean(axis=1) - middle, axis=1) <= radius
        made = made._replace(triangles=made.triangles[inside])
    return made


def tessellate(tables: ir.Tables, g: int, tolerance: float) -> Tessellation:
    """The same as a tessellation, with the coordinates of `analytic_shapes.uv`."""
    made = contour(tables, g, tolerance)
    positions = np.concatenate([made.positions, np.ones((len(made.positions), 1))], axis=1)
    triangles = made.triangles.astype(np.int32)
    uvs = np.stack([made.positions[:, 0], -made.positions[:, 2]], axis=1)
    return Tessellation(positions, triangles, made.normals, uvs, np.zeros(len(triangles), np.int32))
