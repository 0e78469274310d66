"""Normal and bump maps: perturb the shading normal by textures of the material.

The x of a normal map follows u and its y follows v, by the mesh's tangents. The tangent of a corner is the angle-weighted mean over all
corners of equal position, normal, coordinates and handedness. Tangents are interpolated between corners and not orthogonalized again
(Mikkelsen 2008, Simulation of Wrinkled Surfaces Revisited, as in MikkTSpace), as maps are baked. Shapes and other mappings take u and v
from differences. A bump map is a height in metres, whose differences give the slope (Blinn 1978).

A perturbed normal may face away from the viewer, or mirror the view direction into the surface. It is bent back until the mirrored
direction just clears the surface (Keller et al. 2017, The Iray Light Transport Simulation and Rendering System, appendix A.3). Light from
behind is masked. This avoids black spots and light leaks.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...materials import traits
from ...materials.contract import Lobes
from ..geometry import analytic_shapes, instance_transform
from ..jit.kernel import helper, make_replace, separate_helper
from ..jit.packed_struct import HandleType
from ..lanes import affine, ops
from ..simd.registration import overload
from ..texture import textures
from ..types import Hit, Lane, Surface, Tables, Vec
from . import interaction
from .material_inputs import color_of

NORMAL, BUMP, COAT_NORMAL = int(ir.Slot.NORMAL), int(ir.Slot.BUMP), int(ir.Slot.COAT_NORMAL)
MESH = int(ir.GeometryKind.MESH)
FLAT = int(ir.Shading.FLAT)
UV = int(ir.TextureMapping.UV)
STEP = 2.0**-10  # step of differences of u, v and procedural heights, relative to the instance's size
CLEAR = 0.01  # smallest sine of the angle between the mirrored direction and the surface
_turned_to, _put_to = make_replace(Surface, "normal"), make_replace(Surface, "local", "uv")
_framed = make_replace(Surface, "tangent")


class NoMaps(NamedTuple):
    """The absence of normal and bump maps."""


class NoCoatNormals(NamedTuple):
    """Coats have the normals of their bases."""


class CoatNormals(NamedTuple):
    """Some coat has a normal of its own."""

    count: int


class CoatFrame(NamedTuple):
    """What a Surface has in place of its tangent where some coat has a normal of its own."""

    tangent: Any  # Vec, or None
    coat: Vec


class Tangents(NamedTuple):
    """Tangents at the corners of meshes that need them."""

    first: NDArray[np.int64]  # (geometries,) row of a mesh's first corner; -1: none
    values: NDArray[np.float32]  # (3 · triangles, 4) unit vectors in the mesh's frame, and the handedness of v, 1 or -1
    maps: int = 1  # 0: no material has a map
    coats: Any = NoCoatNormals()  # or CoatNormals


def build_tangents(tables: ir.Tables, general: bool = False, coated: bool = False) -> Tangents | NoMaps:
    """The tangents of a scene for kernels; without normal and bump maps NoMaps, with `general` an empty record.

    With `coated`, coats have normals of their own, though all may equal those of the bases.
    """
    maps = tables.materials.textures[:, [NORMAL, BUMP, COAT_NORMAL]]
    present = traits.used(tables)
    separate = (tables.materials.values[:, COAT_NORMAL, 2] > 0.0) & present
    coats = CoatNormals(1) if coated or separate.any() else NoCoatNormals()
    if not (maps[present] >= 0).any():
        none = np.full(len(tables.geometries.kind), -1, np.int64), np.zeros((0, 4), np.float32)
        return Tangents(*none, 0, coats) if general else NoMaps()
    used = tables.instances.material
    blended = traits.has(tables, Lobes.PARTS)
    kinds, uvs = tables.geometries.kind, tables.geometries.uvs
    turned = np.unique(tables.instances.geometry[(maps[used, 0] >= 0) | (maps[used, 2] >= 0) | blended[used]])
    first, parts, count = np.full(len(kinds), -1, np.int64), [np.zeros((0, 4), np.float32)], 0
    for g in turned[(kinds[turned] == MESH) & (uvs[turned] >= 0)].tolist():
        flat = (tables.materials.shading[used[tables.instances.geometry == g]] == FLAT).all()
        tangents = mesh_tangents(tables, g, bool(flat))
        first[g] = count
        parts.append(tangents)
        count += len(tangents)
    return Tangents(first, np.concatenate(parts), 1, coats)


def mesh_tangents(tables: ir.Tables, g: int, flat: bool = False) -> NDArray[np.float32]:
    """Tangents of a mesh with texture coordinates, (3 · triangles, 4)."""
    geometry, pools = tables.geometries, tables.pools
    start, count = int(geometry.first_triangle[g]), int(geometry.triangle_count[g])
    corners = pools.triangles[start : start + count]
    p = pools.positions[corners].astype(np.float64)
    uv = _corners(tables, int(geometry.uvs[g]), g, corners, 2)
    edges = p[:, [1, 2, 0]] - p
    face = _unit(np.cross(edges[:, 0], -edges[:, 2]))
    normals = np.repeat(face[:, None], 3, axis=1)
    if geometry.normals[g] >= 0 and not flat:
        vertex_normals = _corners(tables, int(geometry.normals[g]), g, corners, 3)
        vertex_normals = np.where(((vertex_normals * normals).sum(axis=2) < 0)[..., None], -vertex_normals, vertex_normals)
        normals = np.where((np.linalg.norm(vertex_normals, axis=2) > 1e-12)[..., None], _unit(vertex_normals), normals)
    du, dv = uv[:, 1:] - uv[:, :1], p[:, 1:] - p[:, :1]
    det = du[:, 0, 0] * du[:, 1, 1] - du[:, 0, 1] * du[:, 1, 0]
    sign = np.where(det < 0, -1.0, 1.0)
    along = (du[:, 1, 1, None] * dv[:, 0] - du[:, 0, 1, None] * dv[:, 1]) * sign[:, None]
    each = along[:, None] - (along[:, None] * normals).sum(axis=2, keepdims=True) * normals
    each = _unit(each)
    inward = -edges[:, [2, 0, 1]]
    angle = np.arccos(np.clip((_unit(edges) * _unit(inward)).sum(axis=2), -1.0, 1.0))
    key = np.concatenate([p, normals, uv, np.broadcast_to(sign[:, None, None], (*sign.shape, 3, 1))], axis=2).astype(np.float32)
    key = np.ascontiguousarray(key.reshape(3 * count, -1) + np.float32(0.0)).view(np.dtype((np.void, key.shape[2] * 4))).ravel()
    group = np.unique(key, return_inverse=True)[1].ravel()
    sums = np.zeros((int(group.max(initial=-1)) + 1, 3))
    np.add.at(sums, group, (each * angle[..., None]).reshape(-1, 3))
    mean = _unit(sums[group])
    lost = np.linalg.norm(mean, axis=1) < 0.5  # coordinates without area: any direction along the surface
    mean[lost] = _perpendicular(normals.reshape(-1, 3)[lost])
    return np.concatenate([mean, np.repeat(sign, 3)[:, None]], axis=1).astype(np.float32)


def _corners(tables: ir.Tables, row: int, g: int, corners: NDArray[Any], width: int) -> NDArray[np.float64]:
    """An attribute at triangles' corners, (t, 3, width)."""
    a, t = tables.attributes, np.arange(len(corners))[:, None]
    how, first = a.interpolation[row], int(a.first[row])
    index = {
        ir.Interpolation.CONSTANT: 0 * t + np.zeros(3, np.int64), ir.Interpolation.FACE: t + np.zeros(3, np.int64),
        ir.Interpolation.VERTEX: corners.astype(np.int64) - int(tables.geometries.first_vertex[g]),
        ir.Interpolation.CORNER: 3 * t + np.arange(3),
    }[ir.Interpolation(int(how))]  # fmt: skip
    return tables.pools.values[first + width * index[..., None] + np.arange(width)].astype(np.float64)


def _unit(v: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.zeros_like(v), where=length > 0)


def _perpendicular(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """A unit vector perpendicular to each."""
    axis = np.eye(3)[np.argmin(np.abs(n), axis=1)] if len(n) else n
    return _unit(np.cross(n, axis))


# --- in lanes ------------------------------------------------------------------------------------------------------------


def is_used(tables: Any) -> bool:
    """Whether tables of this Numba type have normal or bump maps."""
    field = tables.field("materials.tangents") if isinstance(tables, HandleType) else None
    return field is not None and field[1] != ()


def has_coats(tables: Any) -> bool:
    """Whether in tables of this Numba type some coat has a normal of its own."""
    field = tables.field("materials.tangents.coats") if is_used(tables) else None
    return field is not None and field[1] != ()


def apply_maps(tables: Tables, point: Surface, hit: Hit, direction: Vec) -> Surface:
    """The surface with its normal perturbed by the material's maps, for a ray of `direction`."""
    part = getattr(tables.materials, "tangents", None)
    if not isinstance(part, Tangents):
        return point
    apply = _apply_with_coats if isinstance(part.coats, CoatNormals) else _apply_if_any
    return apply(tables, point, hit, direction)


@overload(apply_maps)
def _apply_maps_in_kernels(tables, point, hit, direction):
    if has_coats(tables):
        return lambda tables, point, hit, direction: _apply_with_coats(tables, point, hit, direction)
    if is_used(tables):
        return lambda tables, point, hit, direction: _apply_if_any(tables, point, hit, direction)
    return lambda tables, point, hit, direction: point


def has_map(tables: Tables, point: Surface) -> Lane:
    """Where the material has a normal or bump map: its normal depends on the viewer."""
    return _has_map(tables, point)


@overload(has_map)
def _has_map_in_kernels(tables, point):
    if is_used(tables):
        return lambda tables, point: _has_map(tables, point)
    return lambda tables, point: ops.bool_like(point.offset, False)


@helper
def _has_map(tables: Any, point: Surface) -> Lane:
    textures_ = tables.materials.textures
    mapped = (textures_[point.material, NORMAL] >= 0) | (textures_[point.material, BUMP] >= 0)
    return mapped | (textures_[point.material, COAT_NORMAL] >= 0)


def mask_behind(tables: Tables, point: Surface, direction: Vec, lit: Lane) -> Lane:
    """`lit` without light from behind the surface, where maps perturb normals."""
    return _mask_behind(tables, point, direction, lit) if isinstance(getattr(tables.materials, "tangents", None), Tangents) else lit


@overload(mask_behind)
def _mask_behind_in_kernels(tables, point, direction, lit):
    if is_used(tables):
        return lambda tables, point, direction, lit: _mask_behind(tables, point, direction, lit)
    return lambda tables, point, direction, lit: lit


@helper
def _mask_behind(tables: Any, point: Surface, direction: Vec, lit: Lane) -> Lane:
    return lit & ((ops.dot(direction, point.geometric) > 0.0) | (tables.materials.tangents.maps == 0))


@helper
def _apply_if_any(tables: Any, point: Surface, hit: Hit, direction: Vec) -> Surface:
    if tables.materials.tangents.maps == 0:
        return point
    return _apply_maps(tables, point, hit, direction)


@helper
def _apply_with_coats(tables: Any, point: Surface, hit: Hit, direction: Vec) -> Surface:
    if tables.materials.tangents.maps == 0:  # pyright: ignore[reportAttributeAccessIssue]
        return _framed(point, CoatFrame(None, point.normal))
    mapped = _apply_maps(tables, point, hit, direction)
    return _framed(mapped, CoatFrame(None, _coat_normal(tables, point, mapped.normal, hit, direction)))


@separate_helper
def _coat_normal(tables: Tables, point: Surface, base: Vec, hit: Hit, direction: Vec) -> Vec:
    """The normal of the coat at a surface without maps: its own, or that of the base."""
    is_separate = tables.materials.values[point.material, COAT_NORMAL, 2] > 0.0
    if ops.not_(ops.any_lane(is_separate)):
        return base
    turned = tables.materials.textures[point.material, COAT_NORMAL] >= 0
    zero = ops.full_like(point.offset, 0.0)
    side = ops.where(point.front, zero + 1.0, zero - 1.0)
    normal = point.normal
    if ops.any_lane(turned):
        place = instance_transform.transform_at(tables, ops.to_int(tables.instances.transform[point.instance]), point.time)
        outward = ops.scale(point.normal, side)
        turned_to = _mapped(tables, point, hit, COAT_NORMAL, place, outward)
        normal = ops.where3(turned, ops.scale(turned_to, side), normal)
    return ops.where3(is_separate, bend_to_viewer(normal, point.geometric, ops.negate(direction)), base)


@helper
def _mapped(tables: Tables, point: Surface, hit: Hit, slot: int, place: instance_transform.Frame, outward: Vec) -> Vec:
    """The outward normal by the normal map of a slot."""
    s, t = ops.basis(point.local_normal)
    step = STEP * size_of(tables, point)
    over_s, over_t = shift_point(tables, point, hit, s, step), shift_point(tables, point, hit, t, step)
    x, y, z = color_of(tables, point, slot)
    along, round_ = _frame(tables, point, hit, slot, s, t, (over_s, over_t), place, outward)
    across = ops.scale(ops.cross(outward, along), round_)
    return ops.normalize(ops.in_basis(along, across, outward, x, y, z))


@separate_helper
def _apply_maps(tables: Tables, point: Surface, hit: Hit, direction: Vec) -> Surface:
    turned = tables.materials.textures[point.material, NORMAL] >= 0
    bumped = tables.materials.textures[point.material, BUMP] >= 0
    if ops.not_(ops.any_lane(turned | bumped)):
        return point
    zero = ops.full_like(point.offset, 0.0)
    side = ops.where(point.front, zero + 1.0, zero - 1.0)
    place = instance_transform.transform_at(tables, ops.to_int(tables.instances.transform[point.instance]), point.time)
    outward = ops.scale(point.normal, side)
    s, t = ops.basis(point.local_normal)
    normal = outward
    if ops.any_lane(turned):
        normal = ops.where3(turned, _mapped(tables, point, hit, NORMAL, place, outward), normal)
    if ops.any_lane(bumped):
        normal = ops.where3(bumped, _apply_bump(tables, point, hit, s, t, place, normal), normal)
    normal = bend_to_viewer(ops.scale(normal, side), point.geometric, ops.negate(direction))
    return _turned_to(point, ops.where3(turned | bumped, normal, point.normal))


@helper
def bend_to_viewer(normal: Vec, geometric: Vec, viewer: Vec) -> Vec:
    """The normal, bent so that it mirrors the view direction to this side of the surface."""
    mirrored = ops.reflect(ops.negate(viewer), normal)
    height = ops.dot(mirrored, geometric)
    least = ops.minimum(ops.dot(viewer, geometric), CLEAR)
    sinks = height < least
    raised = ops.normalize(ops.along(mirrored, geometric, least - height))
    return ops.where3(sinks, ops.normalize(ops.add(viewer, raised)), normal)


@helper
def size_of(tables: Tables, point: Surface) -> Lane:
    """Approximate size of the instance in its own frame; 1 where it is unbounded."""
    g = tables.instances.geometry[point.instance]
    bounds = tables.geometries.bounds
    x, y, z = bounds[g, 1, 0] - bounds[g, 0, 0], bounds[g, 1, 1] - bounds[g, 0, 1], bounds[g, 1, 2] - bounds[g, 0, 2]
    size = ops.maximum(x, ops.maximum(y, z)) + 0.0 * point.offset
    return ops.where(ops.is_finite(size) & (size > 0.0), size, 1.0)


@helper
def shift_point(tables: Tables, point: Surface, hit: Hit, direction: Vec, step: Lane) -> Surface:
    """The surface at a step along its tangent plane, for texture lookup."""
    local = ops.along(point.local, direction, step)
    g = ops.to_int(tables.instances.geometry[point.instance])
    kind = ops.to_int(tables.geometries.kind[g])
    on_mesh = kind == MESH
    part = ops.where(on_mesh, 0, hit.primitive)
    (u, v), _ = analytic_shapes.uv(kind, tables.geometries.parameters, g, part, local)
    if ops.any_lane(on_mesh):
        slope_u, slope_v = uv_gradients(tables, g, on_mesh, hit)
        u = ops.where(on_mesh, point.uv[0] + step * ops.dot(slope_u, direction), u)
        v = ops.where(on_mesh, point.uv[1] + step * ops.dot(slope_v, direction), v)
    return _put_to(point, local, (u, v))


@helper
def uv_gradients(tables: Tables, g: Lane, on_mesh: Lane, hit: Hit) -> tuple[Vec, Vec]:
    """Gradients of u and v on a triangle in the mesh's frame; 0 without coordinates or area."""
    row = ops.to_int(tables.geometries.uvs[g])
    has = on_mesh & (row >= 0)
    nowhere = ops.like3(hit.u, 0.0, 0.0, 0.0)
    u, v = nowhere, nowhere
    if ops.any_lane(has):  # otherwise there may be no attribute at all
        u, v = _gradients(tables, ops.where(has, g, 0), ops.where(has, row, 0), has, hit)
    return u, v


@helper
def _gradients(tables: Tables, g: Lane, row: Lane, has: Lane, hit: Hit) -> tuple[Vec, Vec]:
    """Gradients for meshes with coordinates (`row` of Attributes); 0 in other lanes, which read row 0."""
    first = ops.to_int(tables.geometries.first_triangle[g])
    triangle = ops.where(has, ops.clip(hit.primitive, first, first + tables.geometries.triangle_count[g] - 1), 0)
    a, b, c = interaction.corners(tables, g, triangle)
    ua, va = interaction.corner_uv(tables, g, row, triangle, 0, has)
    ub, vb = interaction.corner_uv(tables, g, row, triangle, 1, has)
    uc, vc = interaction.corner_uv(tables, g, row, triangle, 2, has)
    e1, e2 = ops.sub(b, a), ops.sub(c, a)
    aa, ab, bb = ops.dot(e1, e1), ops.dot(e1, e2), ops.dot(e2, e2)
    area = aa * bb - ab * ab
    is_regular = has & (area > 0.0)
    scale = ops.where(is_regular, 1.0 / ops.where(is_regular, area, 1.0), 0.0)
    gradient_b = ops.scale(ops.sub(ops.scale(e1, bb), ops.scale(e2, ab)), scale)  # gradient of the weight of b
    gradient_c = ops.scale(ops.sub(ops.scale(e2, aa), ops.scale(e1, ab)), scale)
    return (
        ops.add(ops.scale(gradient_b, ub - ua), ops.scale(gradient_c, uc - ua)),
        ops.add(ops.scale(gradient_b, vb - va), ops.scale(gradient_c, vc - va)),
    )  # fmt: skip


@helper
def _frame(
    tables: Tables,
    point: Surface,
    hit: Hit,
    slot: int,
    s: Vec,
    t: Vec,
    over: tuple[Surface, Surface],
    place: instance_transform.Frame,
    outward: Vec,
) -> tuple[Vec, Lane]:
    """(tangent in the world, handedness 1 or -1) for the normal map."""
    texture = ops.maximum(tables.materials.textures[point.material, slot], 0)
    us, vs = _difference(tables, texture, point, over[0])
    ut, vt = _difference(tables, texture, point, over[1])
    det = us * vt - ut * vs
    round_ = ops.sign_of(det)
    local = ops.normalize(ops.scale(ops.sub(ops.scale(s, vt), ops.scale(t, vs)), round_))
    local = ops.where3(det == 0.0, s, local)
    g = ops.to_int(tables.instances.geometry[point.instance])
    table: Any = tables.materials.tangents  # pyright: ignore[reportAttributeAccessIssue]
    first = ops.to_int(table.first[g])
    has_tangents = (first >= 0) & (tables.textures.mapping[texture] == UV)
    if ops.any_lane(has_tangents):
        corner = first + 3 * (ops.to_int(hit.primitive) - tables.geometries.first_triangle[g])
        corner = ops.where(has_tangents, corner, 0)
        a, b, c = _tangent(table, corner), _tangent(table, corner + 1), _tangent(table, corner + 2)
        w = 1.0 - hit.u - hit.v
        mixed = ops.add(ops.scale(a, w), ops.add(ops.scale(b, hit.u), ops.scale(c, hit.v)))
        local = ops.where3(has_tangents, mixed, local)
        round_ = ops.where(has_tangents, ops.to_float(table.values[corner, 3]), round_)
    flips = tables.transforms.flips[tables.instances.transform[point.instance]]
    world = ops.normalize(affine.transform_vector12(place.matrix, local))
    along = ops.normalize(ops.along(world, outward, -ops.dot(world, outward)))
    return along, ops.where(flips, -round_, round_)


@helper
def _tangent(table: Any, row: Lane) -> Vec:
    return ops.to_float(table.values[row, 0]), ops.to_float(table.values[row, 1]), ops.to_float(table.values[row, 2])


@helper
def _difference(tables: Tables, texture: Lane, point: Surface, moved: Surface) -> tuple[Lane, Lane]:
    """Change of u and v between two points, across seams too."""
    u, v, _, _ = textures.texture_coordinates(tables, texture, point)
    mu, mv, _, _ = textures.texture_coordinates(tables, texture, moved)
    du, dv = mu - u, mv - v
    du = ops.where(ops.absolute(du) > 0.5, du - ops.sign_of(du), du)
    return du, ops.where(ops.absolute(dv) > 0.5, dv - ops.sign_of(dv), dv)


@helper
def _apply_bump(tables: Tables, point: Surface, hit: Hit, s: Vec, t: Vec, place: instance_transform.Frame, normal: Vec) -> Vec:
    """A normal perturbed by the slope of the height: differences over a texel, or over a small step for procedural heights."""
    texture = ops.maximum(tables.materials.textures[point.material, BUMP], 0)
    image = ops.to_int(tables.textures.image[texture])
    pictured = image >= 0
    image = ops.maximum(image, 0)
    scale = interaction.mean_scale(place.matrix)
    step = STEP * size_of(tables, point)
    if ops.any_lane(pictured):
        texel = ops.minimum(point.metric[0] / tables.images.width[image], point.metric[1] / tables.images.height[image]) / scale
        step = ops.where(pictured, texel, step)
    per = 0.5 / (step * scale)
    ds = per * (_height(tables, point, hit, s, step) - _height(tables, point, hit, s, -step))
    dt = per * (_height(tables, point, hit, t, step) - _height(tables, point, hit, t, -step))
    along = ops.normalize(affine.transform_vector12(place.matrix, s))
    across = ops.normalize(affine.transform_vector12(place.matrix, t))
    tilt = ops.add(ops.scale(along, ds), ops.scale(across, dt))
    return ops.normalize(ops.sub(normal, tilt))


@helper
def _height(tables: Tables, point: Surface, hit: Hit, direction: Vec, step: Lane) -> Lane:
    return color_of(tables, shift_point(tables, point, hit, direction, step), BUMP)[0]
