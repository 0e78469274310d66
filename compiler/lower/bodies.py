"""Bodies: solids while they are lowered, as fields, as meshes, or as both."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..formula import solid_fields
from ..formula.builder import Builder
from ..formula.solid_fields import NoSolid, Point
from ..mesh import mesh_csg
from ..mesh.mesh_csg import Solid
from ..scene import transforms
from ..scene.shape_bounds import boxes_under
from . import solid_materials
from .solid_materials import Field, Looks


class Body(NamedTuple):
    """A solid: its field at a point of its frame, and bounds (2, 3), ±inf where unbounded. With meshes in it: `mesh` (mesh_csg) alone."""

    field: Field
    bounds: np.ndarray
    mesh: Solid | None = None
    meshed: Callable[[float], Solid] | None = None  # the mesh, for a tolerance, of a body that has a field as well
    looks: Looks = solid_materials.only(None)

    def changed(self, field: Field, bounds: np.ndarray, change: Callable[[Builder, Point], Point] | None = None) -> Body:
        """This body with another field, and its materials where `change` leads to their frame."""
        return Body(field, bounds, looks=self.looks.mapped(change) if change else self.looks)


class Refused(Exception):
    """A child is refused, with a diagnostic."""


def no_field(b: Builder, point: Point) -> int:
    raise NoSolid("a mesh has no field")


def placed(body: Body, matrix: np.ndarray) -> Body:
    """A body in the frame of a matrix. The field is scaled by the least singular value, so that it does not exceed the distance."""
    if np.array_equal(matrix, transforms.identity()):
        return body
    if body.mesh is not None:
        moved = body.mesh.moved(matrix)
        return Body(no_field, mesh_csg.bounds(moved), moved, looks=body.looks)
    inverse = np.linalg.inv(matrix)[:3]
    least = float(np.linalg.svd(matrix[:3, :3], compute_uv=False)[-1])
    least = 1.0 if abs(least - 1.0) < 1e-12 else least

    def inside(b: Builder, point: Point) -> Point:
        return solid_fields.transform_point(b, point, _clean(inverse))

    def field(b: Builder, point: Point) -> int:
        return b.scale(body.field(b, inside(b, point)), least)

    meshed, most = body.meshed, float(np.linalg.norm(matrix[:3, :3], 2))
    moved = None if meshed is None else lambda tolerance: meshed(tolerance / most).moved(matrix)
    return body.changed(field, boxes_under(body.bounds[None], matrix[None, :3])[0], inside)._replace(meshed=moved)


def _clean(matrix: np.ndarray) -> np.ndarray:
    """A matrix with rounding errors replaced by 0: each saves a term."""
    size = np.abs(matrix[:, :3]).max()
    linear = np.where(np.abs(matrix[:, :3]) < 1e-15 * size, 0.0, matrix[:, :3])
    return np.concatenate([linear, matrix[:, 3:]], axis=1)
