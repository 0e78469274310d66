"""Cubes and planes as meshes, where primvars vary over them: the faces and points of OpenUSD's implicit surfaces.

Source: UsdImaging's implicitSurfaceMeshUtils. Primvars of other shapes fit its tessellations, which are coarse, and are reported.
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom

from ....lang.diagnostics import Diagnostics, Span
from ...ir import F64
from ...mesh.polygon_mesh import PolyMesh
from . import stage
from .geometry import Faces, Reads, primvar

_CUBE = np.array([(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1), (-1, -1, -1), (-1, 1, -1), (1, 1, -1), (1, -1, -1)]) / 2
_CUBE_FACES = np.array([(0, 1, 2, 3), (4, 5, 6, 7), (0, 6, 5, 1), (4, 7, 3, 2), (0, 3, 7, 6), (4, 2, 1, 5)])


def is_wanted(prim: Any, reads: Reads, diagnostics: Diagnostics, span: Span) -> bool:
    """Whether primvars that a material reads vary over a shape. A shape that is neither a cube nor a plane gets a warning instead."""
    api, varying = UsdGeom.PrimvarsAPI(prim), []
    for name in (reads.uv, reads.color):
        authored = api.GetPrimvar(name) if name else None
        if authored and authored.HasAuthoredValue() and str(authored.GetInterpolation()) != "constant":
            varying.append(name)
    kind = str(prim.GetTypeName())
    if not varying or kind in ("Cube", "Plane"):
        return bool(varying)
    if reads.uv in varying and not reads.ramp:
        diagnostics.warning(f"the primvar `{reads.uv}` of this {kind} is not drawn: it has the coordinates of an exact shape", span)
    return False


def faces(prim: Any, time: Any, reads: Reads, diagnostics: Diagnostics, span: Span) -> Faces | None:
    """A Cube or Plane as flat faces, with the primvars of `reads`; None without a size."""
    points, indices = _surface(prim, time)
    if not np.isfinite(points).all() or not np.ptp(points, axis=0).any():
        diagnostics.warning(f"this {prim.GetTypeName()} has no size: it is not drawn", span)
        return None
    counts, api = np.full(len(indices), 4), UsdGeom.PrimvarsAPI(prim)
    uvs = primvar(api, reads.uv, time, 2, len(points), counts, diagnostics, span) if reads.uv and not reads.ramp else None
    colors = primvar(api, reads.color, time, 3, len(points), counts, diagnostics, span) if reads.color else None
    return Faces(PolyMesh(points, counts, indices.reshape(-1), None, uvs, colors), np.arange(len(counts)), False)


def _surface(prim: Any, time: Any) -> tuple[F64, np.ndarray]:
    if str(prim.GetTypeName()) == "Cube":
        return _CUBE * abs(stage.number(prim.GetAttribute("size"), time)), _CUBE_FACES
    axis = str(UsdGeom.Plane(prim).GetAxisAttr().Get(time))
    width, length = (abs(stage.number(prim.GetAttribute(name), time)) / 2 for name in ("width", "length"))
    if axis == "X":
        corners = [(0.0, y * length, z * width) for y, z in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    elif axis == "Y":
        corners = [(x * width, 0.0, z * length) for x, z in ((-1, 1), (1, 1), (1, -1), (-1, -1))]
    else:
        corners = [(x * width, y * length, 0.0) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    return np.array(corners), np.array([(0, 1, 2, 3)])
