"""The tangent along u at a surface point, for materials whose highlights have a direction.

Shapes and meshes give it by the gradients of their coordinates. A mesh without coordinates, and the pole of a shape, have any tangent.
Scenes without such materials compile nothing of it: the `tangent` of their Surface is None.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiler import ir
from ..geometry import analytic_shapes, instance_transform
from ..jit.kernel import helper, make_replace, separate_helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import affine, ops
from ..simd.registration import overload
from ..types import Hit, Lane, Surface, Tables, Vec
from . import normal_map
from .normal_map import CoatFrame

MESH = int(ir.GeometryKind.MESH)
_put = make_replace(Surface, "tangent")


class Round(NamedTuple):
    """No material has highlights with a direction."""


class Turned(NamedTuple):
    """Some material has highlights with a direction."""

    count: int


def is_used(tables: Any) -> bool:
    """Whether tables of this Numba type have such a material."""
    slabs = tables.field("materials.slabs") if isinstance(tables, HandleType) else None
    part = tables.field("materials.slabs.turned") if slabs is not None and slabs[1] != () else None
    return part is not None and part[1] != ()


def attach(tables: Tables, point: Surface, hit: Hit) -> Surface:
    """The surface with its tangent; without one in scenes that need none."""
    turned = getattr(getattr(tables.materials, "slabs", None), "turned", None)
    return _attach(tables, point, hit) if isinstance(turned, Turned) else point


@overload(attach)
def _attach_in_kernels(tables, point, hit):
    if is_used(tables):
        return lambda tables, point, hit: _attach(tables, point, hit)
    return lambda tables, point, hit: point


@helper
def _attach(tables: Tables, point: Surface, hit: Hit) -> Surface:
    return _put(point, _with_coat(coat_of(point.tangent), tangent_at(tables, point, hit)))


@helper
def _beside(coat: Vec, tangent: Vec) -> CoatFrame:
    return CoatFrame(tangent, coat)


_with_coat = specialize_if_present(_beside)  # the normal of a coat, a tangent: the tangent, or both


def tangent_of(tangent: Any) -> Any:
    """The tangent of a Surface, or None."""
    return tangent.tangent if isinstance(tangent, CoatFrame) else tangent


@overload(tangent_of)
def _tangent_of_in_kernels(tangent):
    if getattr(tangent, "instance_class", None) is CoatFrame:
        return lambda tangent: tangent.tangent
    return lambda tangent: tangent


def coat_of(tangent: Any) -> Any:
    """The normal of the coat, or None where all coats have the normals of their bases."""
    return tangent.coat if isinstance(tangent, CoatFrame) else None


@overload(coat_of)
def _coat_of_in_kernels(tangent):
    if getattr(tangent, "instance_class", None) is CoatFrame:
        return lambda tangent: tangent.coat
    return lambda tangent: None


@helper
def frame(tangent: Any, normal: Vec, lined: Lane) -> tuple[Vec, Vec]:
    """Unit vectors along a tangent and across it, at a right angle to a normal; without one (None), and where not `lined`, any.

    So a highlight without a direction is sampled alike in scenes with and without tangents.
    """
    plain = ops.basis(normal)
    if tangent is None:
        return plain
    flat = ops.sub(tangent, ops.scale(normal, ops.dot(tangent, normal)))
    size = ops.dot(flat, flat)
    along = ops.where3(lined & (size > 1e-12), ops.scale(flat, 1.0 / ops.sqrt(ops.maximum(size, 1e-12))), plain[0])
    return along, ops.where3(lined, ops.cross(normal, along), plain[1])


@separate_helper
def tangent_at(tables: Tables, point: Surface, hit: Hit) -> Vec:
    """The direction in the world in which u grows and v stays."""
    g = ops.to_int(tables.instances.geometry[point.instance])
    kind = ops.to_int(tables.geometries.kind[g])
    on_mesh = kind == MESH
    part = ops.where(on_mesh, 0, hit.primitive)
    s, t = ops.basis(point.local_normal)
    step = normal_map.STEP * normal_map.size_of(tables, point)
    (u, v), _ = analytic_shapes.uv(kind, tables.geometries.parameters, g, part, point.local)
    (us, vs), _ = analytic_shapes.uv(kind, tables.geometries.parameters, g, part, ops.along(point.local, s, step))
    (ut, vt), _ = analytic_shapes.uv(kind, tables.geometries.parameters, g, part, ops.along(point.local, t, step))
    us, vs, ut, vt = _near(us - u), _near(vs - v), _near(ut - u), _near(vt - v)
    if ops.any_lane(on_mesh):
        slope_u, slope_v = normal_map.uv_gradients(tables, g, on_mesh, hit)
        us, vs = ops.where(on_mesh, ops.dot(slope_u, s), us), ops.where(on_mesh, ops.dot(slope_v, s), vs)
        ut, vt = ops.where(on_mesh, ops.dot(slope_u, t), ut), ops.where(on_mesh, ops.dot(slope_v, t), vt)
    det = us * vt - ut * vs
    local = ops.scale(ops.sub(ops.scale(s, vt), ops.scale(t, vs)), ops.sign_of(det))
    local = ops.where3(det == 0.0, s, local)
    place = instance_transform.transform_at(tables, ops.to_int(tables.instances.transform[point.instance]), point.time)
    return ops.normalize(affine.transform_vector12(place.matrix, local))


@helper
def _near(change: Lane) -> Lane:
    """A change of a coordinate, across seams too."""
    return ops.where(ops.absolute(change) > 0.5, change - ops.sign_of(change), change)
