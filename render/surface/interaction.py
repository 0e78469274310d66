"""Computes the surface at a hit: position, normals, texture coordinates, color, and the offset of new rays.

Normals face the side the ray came from. Mesh attributes are interpolated with the barycentrics of the hit. An interpolated normal first
flips to the side that the triangle's winding calls outside, so shading does not depend on careless normals of a file.

Shadow rays from triangles with interpolated normals start off the triangle, where the round surface would be (Hanika 2021, Hacking the
Shadow Terminator, Ray Tracing Gems II, ch. 4). Otherwise facets that face away from a light are dark beside lit ones.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...compiler import ir
from ..geometry import analytic_shapes, instance_transform
from ..jit.kernel import helper, make_replace, separate_helper, specialize_if_present
from ..lanes import affine, ops
from ..texture import textures
from ..types import Hit, Lane, Ray, Surface, Tables, Vec

MESH = int(ir.GeometryKind.MESH)
FORMULA = int(ir.GeometryKind.FORMULA)
CONSTANT = int(ir.Interpolation.CONSTANT)
FACE = int(ir.Interpolation.FACE)
VERTEX = int(ir.Interpolation.VERTEX)
FLAT = int(ir.Shading.FLAT)
COARSEST = 0.7  # smallest cosine between a triangle and a normal of its corners on a round surface; below it is an edge
UNIT = 2.0  # units of roundoff of a formula's largest coordinate per unit of its spacing, twice its meaning (formula/intersect.py)
ROUNDING = 32.0  # units of roundoff of the sums of absolute terms in `spacing`: a few operations for the hit and for the next ray


class HitPoint(NamedTuple):
    """The point of a hit before texture coordinates and normals in the world."""

    hit: Hit  # of meshes: with a triangle of the mesh in all lanes
    world: Vec
    local: Vec  # in the shape's frame
    corners: tuple[Vec, Vec, Vec]  # of the triangle
    outward: Vec  # normal in the shape's frame
    smooth: Vec  # interpolated normal in the shape's frame
    color: Vec  # of the mesh
    error: Lane  # as `spacing` takes it


@helper
def make_interaction(tables: Tables, ray: Ray, hit: Hit, mapped: bool = False) -> Surface:
    """The surface at the hit of a ray. Lanes without a hit (instance -1) hold finite or NaN garbage that callers mask.

    Texture coordinates are computed where the material has a texture, or everywhere if `mapped`; otherwise uv is 0, 0 and metric 1, 1.
    The tables must have an instance.
    """
    row = instance_transform.row_of(tables, hit)
    if instance_transform.moves(tables, row, ray.time):
        return _moving_interaction(tables, ray, hit, mapped)
    return _interaction(tables, ray, hit, instance_transform.transform_at(tables, row, None), mapped)


@separate_helper
def _moving_interaction(tables: Tables, ray: Ray, hit: Hit, mapped: bool) -> Surface:
    """`make_interaction` where an instance moves: each lane has a frame of its own, which would slow down all others."""
    return _interaction(tables, ray, hit, instance_transform.transform_at(tables, instance_transform.row_of(tables, hit), ray.time), mapped)


@helper
def _interaction(tables: Tables, ray: Ray, hit: Hit, frame: instance_transform.Frame, mapped: bool) -> Surface:
    instance = ops.where(hit.instance >= 0, hit.instance, 0)
    instances, geometries = tables.instances, tables.geometries
    g = ops.to_int(instances.geometry[instance])
    matrix, inverse = frame.matrix, frame.inverse
    material = ops.to_int(instances.material[instance])
    kind = ops.to_int(geometries.kind[g])

    t = ops.where(hit.instance >= 0, hit.t, 0.0)
    on_mesh = kind == MESH
    part = ops.where(on_mesh | (kind == FORMULA), 0, hit.primitive)
    point = _shape_point(tables, ray, hit, t, kind, g, part, frame)
    zero = ops.full_like(t, 0.0)
    if ops.any_lane(on_mesh):
        point = _mesh_point(tables, g, on_mesh, matrix, point)
    uv, metric = (zero, zero), (zero + 1.0, zero + 1.0)
    if mapped or ops.any_lane(textures.has_texture(tables, material)):
        uv, metric = _coordinates(tables, kind, g, part, on_mesh, matrix, point)

    geometric = ops.normalize(affine.transform_normal12(inverse, point.outward))
    shaded = geometric
    rounded = on_mesh & (tables.materials.shading[material] != FLAT)
    if ops.any_lane(rounded):
        shaded = ops.where3(rounded, ops.normalize(affine.transform_normal12(inverse, point.smooth)), geometric)
    front = ops.dot(ray.direction, geometric) < 0.0
    side = ops.where(front, zero + 1.0, zero - 1.0)
    lift = (zero, zero, zero)
    if ops.any_lane(rounded):
        lift = _transform_linear(matrix, _mesh_lift(tables, g, point.hit, rounded, point.local, point.corners, point.outward, side))
    return Surface(
        point.world, point.local, ops.scale(geometric, side), ops.scale(shaded, side), point.outward, uv, metric,
        front, instance, material, point.color, origin_offset(frame, ray, t, geometric, point.error), ray.time, None, lift, None, None,
    )  # fmt: skip


@helper
def _shape_point(tables: Tables, ray: Ray, hit: Hit, t: Lane, kind: Lane, g: Lane, part: Lane, frame: instance_transform.Frame) -> HitPoint:
    """The point of a hit with an analytic shape or a formula surface."""
    world = ops.along(ray.origin, ray.direction, t)
    local = affine.transform_point12(frame.inverse, world)
    outward = analytic_shapes.normal(kind, tables.geometries.parameters, g, part, local)
    error, formed = ops.full_like(t, 0.0), kind == FORMULA
    if ops.any_lane(formed):
        outward = ops.where3(formed, unpack_normal(hit.u, hit.v), outward)
        error = ops.where(formed, _formula_error(tables, g, hit, frame.matrix), error)
    return HitPoint(hit, world, local, (local, local, local), outward, outward, ops.like3(t, 1.0, 1.0, 1.0), error)


@helper
def _mesh_point(tables: Tables, g: Lane, on_mesh: Lane, matrix: instance_transform.Affine, point: HitPoint) -> HitPoint:
    """`point`, with that of the triangle in the lanes of meshes."""
    first = ops.to_int(tables.geometries.first_triangle[g])
    last = first + tables.geometries.triangle_count[g] - 1
    hit = point.hit
    triangle = ops.where(on_mesh, ops.clip(hit.primitive, first, last), 0)  # other lanes: any triangle
    hit = Hit(hit.t, hit.instance, triangle, hit.u, hit.v)
    a, b, c = corners(tables, g, triangle)
    error = ops.where(on_mesh, mean_scale(matrix) * _corner_distance(a, b, c), point.error)
    local = ops.where3(on_mesh, _blend(a, b, c, 1.0 - hit.u - hit.v, hit.u, hit.v), point.local)
    world = ops.where3(on_mesh, affine.transform_point12(matrix, local), point.world)
    face = ops.normalize(ops.cross(ops.sub(b, a), ops.sub(c, a)))
    outward = ops.where3(on_mesh, face, point.outward)
    smooth = ops.where3(on_mesh, _mesh_normal(tables, g, hit, on_mesh, face), point.smooth)
    color = ops.where3(on_mesh, _mesh_color(tables, g, hit, on_mesh), point.color)
    return HitPoint(hit, world, local, (a, b, c), outward, smooth, color, error)


@helper
def _coordinates(
    tables: Tables, kind: Lane, g: Lane, part: Lane, on_mesh: Lane, matrix: instance_transform.Affine, point: HitPoint
) -> tuple[tuple[Lane, Lane], tuple[Lane, Lane]]:
    """((u, v), metres in the world that one unit of each spans)."""
    (u, v), (du, dv) = analytic_shapes.uv(kind, tables.geometries.parameters, g, part, point.local)
    if ops.any_lane(on_mesh):
        a, b, c = point.corners
        mu, mv, mdu, mdv = _mesh_uv(tables, g, point.hit, on_mesh, a, b, c)
        u, v = ops.where(on_mesh, mu, u), ops.where(on_mesh, mv, v)
        du, dv = ops.where(on_mesh, mdu, du), ops.where(on_mesh, mdv, dv)
    stretch = mean_scale(matrix)
    return (u, v), (du * stretch, dv * stretch)


@helper
def origin_offset(frame: instance_transform.Frame, ray: Ray, t: Lane, normal: Vec, error: Lane) -> Lane:
    """Offset along the normal at which a new ray starts, so that it does not hit its own surface again.

    It is a bound on rounding errors, not a fixed length: the sums of absolute terms that gave the point (world to the shape's frame and
    back), projected on the normal. For triangles, the error of the next ray's distance is added. It comes from corners that may lie much
    farther away: `error` is their distance in metres, 0 for other shapes.
    Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th ed., section 6.8.
    """
    m, inv = frame.matrix, frame.inverse
    x = abs(ray.origin[0]) + abs(t * ray.direction[0])
    y = abs(ray.origin[1]) + abs(t * ray.direction[1])
    z = abs(ray.origin[2]) + abs(t * ray.direction[2])
    lx = abs(inv[0]) * x + abs(inv[1]) * y + abs(inv[2]) * z + abs(inv[3])
    ly = abs(inv[4]) * x + abs(inv[5]) * y + abs(inv[6]) * z + abs(inv[7])
    lz = abs(inv[8]) * x + abs(inv[9]) * y + abs(inv[10]) * z + abs(inv[11])
    wx = abs(m[0]) * lx + abs(m[1]) * ly + abs(m[2]) * lz + abs(m[3])
    wy = abs(m[4]) * lx + abs(m[5]) * ly + abs(m[6]) * lz + abs(m[7])
    wz = abs(m[8]) * lx + abs(m[9]) * ly + abs(m[10]) * lz + abs(m[11])
    return ROUNDING * ops.roundoff(t) * (abs(normal[0]) * wx + abs(normal[1]) * wy + abs(normal[2]) * wz + error)


@helper
def formula_point(tables: Tables, instance: int, ray: Ray, hit: Hit) -> tuple[Vec, Vec, Lane]:
    """(position, geometric normal, offset) of hits with a static formula surface, as in `make_interaction`."""
    g, frame = tables.instances.geometry[instance], instance_transform.transform_at(tables, tables.instances.transform[instance], None)
    t = ops.where(hit.instance >= 0, hit.t, 0.0)
    geometric = ops.normalize(affine.transform_normal12(frame.inverse, _decode_octahedral(hit.u, hit.v)))
    offset = origin_offset(frame, ray, t, geometric, _formula_error(tables, g, hit, frame.matrix))
    side = ops.where(ops.dot(ray.direction, geometric) < 0.0, 1.0, -1.0)
    return ops.along(ray.origin, ray.direction, t), ops.scale(geometric, side), offset


@helper
def _formula_error(tables: Tables, g: Any, hit: Hit, matrix: instance_transform.Affine) -> Lane:
    """Distance in metres between a hit and a formula surface, at most, as `spacing` takes it."""
    return ops.to_float(hit.primitive) * tables.geometries.parameters[g, 5] * (UNIT / ROUNDING) * mean_scale(matrix)


@helper
def unpack_normal(u: Lane, v: Lane) -> Vec:
    """The unit vector that formula.intersect packs into two numbers (octahedral encoding)."""
    return ops.normalize(_decode_octahedral(u, v))


@helper
def _decode_octahedral(u: Lane, v: Lane) -> Vec:
    """A vector in the direction of an octahedral encoding, not normalized."""
    z = 1.0 - abs(u) - abs(v)
    below = z < 0.0
    x = ops.where(below, (1.0 - abs(v)) * ops.sign_of(u), u)
    y = ops.where(below, (1.0 - abs(u)) * ops.sign_of(v), v)
    return x, y, z


@helper
def offset_origin(surface: Surface, direction: Vec) -> Vec:
    """Origin of a new ray in a direction: offset from the surface to the side of the direction."""
    return offset_origin_at(surface, surface.position, direction)


@helper
def offset_origin_at(surface: Surface, place: Vec, direction: Vec) -> Vec:
    """`leave` for a place other than the surface's position."""
    side = ops.where(ops.dot(direction, surface.geometric) >= 0.0, surface.offset, -surface.offset)
    return ops.along(place, surface.geometric, side)


@helper
def _lift_position(lift: Vec, position: Vec) -> Vec:
    return ops.add(position, lift)


@helper
def _is_above(lift: Vec, above: Lane, normal: Vec, direction: Vec) -> Lane:
    return above | ((ops.dot(lift, lift) > 0.0) & (ops.dot(direction, normal) > 0.0))


_lifted_position, _starts_above = specialize_if_present(_lift_position), specialize_if_present(_is_above)


replace_spread = make_replace(Surface, "spread")  # the surface with another `spread`
_with_known = make_replace(Surface, "known")


@helper
def _replace_known(hidden: Any, surface: Surface) -> Surface:
    return _with_known(surface, hidden)


override_interaction = specialize_if_present(_replace_known)  # the surface with other `known` shadows


@helper
def shadow_origin(surface: Surface) -> Vec:
    """Start of shadow rays: the position, or a point above a triangle with interpolated normals."""
    return _lifted_position(surface.lift, surface.position)


@helper
def offset_shadow_origin(surface: Surface, place: Vec, direction: Vec) -> Vec:
    """`leave` for a ray from `lit_from`, which is above its facet even where it goes down past the facet's edge."""
    above = _starts_above(surface.lift, ops.dot(direction, surface.geometric) >= 0.0, surface.normal, direction)
    return ops.along(place, surface.geometric, ops.where(above, surface.offset, -surface.offset))


@helper
def mean_scale(m: instance_transform.Affine) -> Lane:
    """Mean length of a transform's three axes: its scale, exact for a uniform one."""
    x, y, z = ops.length((m[0], m[4], m[8])), ops.length((m[1], m[5], m[9])), ops.length((m[2], m[6], m[10]))
    return (x + y + z) / 3.0


# --- meshes ---


@helper
def corners(tables: Tables, g: Lane, triangle: Lane) -> tuple[Vec, Vec, Vec]:
    """The corners of a row of Pools.triangles in the frame of mesh `g`."""
    triangles = tables.pools.triangles
    return (
        vertex(tables, g, triangles[triangle, 0]),
        vertex(tables, g, triangles[triangle, 1]),
        vertex(tables, g, triangles[triangle, 2]),
    )


@helper
def vertex(tables: Tables, g: Lane, i: Lane) -> Vec:
    """A row of Pools.positions in the frame of mesh `g`, in float64."""
    positions, origin = tables.pools.positions, tables.geometries.origin
    return (
        ops.to_float(positions[i, 0]) + origin[g, 0],
        ops.to_float(positions[i, 1]) + origin[g, 1],
        ops.to_float(positions[i, 2]) + origin[g, 2],
    )


@helper
def _corner_distance(a: Vec, b: Vec, c: Vec) -> Lane:
    """Upper bound of the distance of three corners from the origin: the sum over the axes of the largest magnitude."""
    x = ops.maximum(abs(a[0]), ops.maximum(abs(b[0]), abs(c[0])))
    y = ops.maximum(abs(a[1]), ops.maximum(abs(b[1]), abs(c[1])))
    z = ops.maximum(abs(a[2]), ops.maximum(abs(b[2]), abs(c[2])))
    return x + y + z


@helper
def _blend(a: Vec, b: Vec, c: Vec, wa: Lane, wb: Lane, wc: Lane) -> Vec:
    return (
        a[0] * wa + b[0] * wb + c[0] * wc,
        a[1] * wa + b[1] * wb + c[1] * wc,
        a[2] * wa + b[2] * wb + c[2] * wc,
    )


@helper
def attribute_row(tables: Tables, g: Lane, row: Lane, triangle: Lane, corner: int, has: Lane) -> Lane:
    """Start in Pools.values of an attribute's value at a triangle's corner; 0 in lanes without the attribute.

    Those lanes may pair a triangle of one mesh with the attribute of another, which may have fewer values.
    """
    attributes, geometries = tables.attributes, tables.geometries
    how = attributes.interpolation[row]
    face = ops.to_int(triangle) - geometries.first_triangle[g]
    at_vertex = ops.to_int(tables.pools.triangles[triangle, corner]) - geometries.first_vertex[g]
    index = ops.where(how == CONSTANT, 0, ops.where(how == FACE, face, ops.where(how == VERTEX, at_vertex, 3 * face + corner)))
    return ops.where(has, attributes.first[row] + attributes.width[row] * index, 0)


@helper
def _value3(tables: Tables, start: Lane) -> Vec:
    values = tables.pools.values
    return ops.to_float(values[start]), ops.to_float(values[start + 1]), ops.to_float(values[start + 2])


@helper
def attribute3(tables: Tables, g: Lane, row: Lane, hit: Hit, triangle: Lane, has: Lane) -> Vec:
    """An attribute of width 3, interpolated over the triangle; arbitrary in lanes without the attribute."""
    return attribute_at(tables, g, row, hit.u, hit.v, triangle, has)


@helper
def attribute_at(tables: Tables, g: Lane, row: Lane, u: Lane, v: Lane, triangle: Lane, has: Lane) -> Vec:
    """An attribute of width 3 at weights u and v of a triangle's second and third corner, in the lanes that have it."""
    a = _value3(tables, attribute_row(tables, g, row, triangle, 0, has))
    b = _value3(tables, attribute_row(tables, g, row, triangle, 1, has))
    c = _value3(tables, attribute_row(tables, g, row, triangle, 2, has))
    return _blend(a, b, c, 1.0 - u - v, u, v)


@helper
def _mesh_normal(tables: Tables, g: Lane, hit: Hit, on_mesh: Lane, face: Vec) -> Vec:
    """The interpolated normal, on the face's side; the face normal where the mesh has none or they cancel."""
    row = ops.to_int(tables.geometries.normals[g])
    has = on_mesh & (row >= 0)
    normal = face
    if ops.any_lane(has):
        n = attribute3(tables, ops.where(has, g, 0), ops.where(has, row, 0), hit, ops.where(has, hit.primitive, 0), has)
        size = ops.length(n)
        good = has & (size > 1e-12) & (size < math.inf)
        n = ops.scale(n, ops.where(ops.dot(n, face) < 0.0, -1.0, 1.0) / ops.where(good, size, 1.0))
        normal = ops.where3(good, n, face)
    return normal


@helper
def _mesh_lift(
    tables: Tables, g: Lane, hit: Hit, on_mesh: Lane, place: Vec, corner_places: tuple[Vec, Vec, Vec], face: Vec, side: Lane
) -> Vec:  # fmt: skip
    """Vector from a point of a triangle to the mean of its projections on the tangent planes of the corners that lie above it.

    `side` is 1 for the outside, -1 for the inside; all in the mesh's frame.
    """
    row = ops.to_int(tables.geometries.normals[g])
    has = on_mesh & (row >= 0)
    zero = ops.full_like(hit.u, 0.0)
    lift = (zero, zero, zero)
    if ops.any_lane(has):
        g, row, triangle = ops.where(has, g, 0), ops.where(has, row, 0), ops.where(has, hit.primitive, 0)
        a = _value3(tables, attribute_row(tables, g, row, triangle, 0, has))
        b = _value3(tables, attribute_row(tables, g, row, triangle, 1, has))
        c = _value3(tables, attribute_row(tables, g, row, triangle, 2, has))
        w = 1.0 - hit.u - hit.v
        side = side * ops.where(ops.dot(_blend(a, b, c, w, hit.u, hit.v), face) < 0.0, -1.0, 1.0)
        a, b = _lift_to_tangent(place, corner_places[0], a, face, side), _lift_to_tangent(place, corner_places[1], b, face, side)
        c = _lift_to_tangent(place, corner_places[2], c, face, side)
        raised = _blend(a, b, c, w, hit.u, hit.v)
        lift = ops.where3(has & ops.is_finite(ops.dot(raised, raised)), raised, lift)
    return lift


@helper
def _lift_to_tangent(place: Vec, corner: Vec, normal: Vec, face: Vec, side: Lane) -> Vec:
    """Vector from a point up to the tangent plane of a corner with a normal of any length; 0 where it is above or at an edge."""
    size, along = ops.dot(normal, normal), ops.dot(normal, face)
    height = ops.maximum(side * ops.dot(ops.sub(corner, place), normal), 0.0)
    round_ = along * along > COARSEST * COARSEST * size
    return ops.scale(normal, ops.where(round_, side * height / ops.where(size > 0.0, size, 1.0), 0.0))


@helper
def _transform_linear(m: instance_transform.Affine, v: Vec) -> Vec:
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[4] * v[0] + m[5] * v[1] + m[6] * v[2], m[8] * v[0] + m[9] * v[1] + m[10] * v[2],
    )  # fmt: skip


@helper
def _mesh_color(tables: Tables, g: Lane, hit: Hit, on_mesh: Lane) -> Vec:
    row = ops.to_int(tables.geometries.colors[g])
    has = on_mesh & (row >= 0)
    color = ops.like3(hit.u, 1.0, 1.0, 1.0)
    if ops.any_lane(has):
        vertex_color = attribute3(tables, ops.where(has, g, 0), ops.where(has, row, 0), hit, ops.where(has, hit.primitive, 0), has)
        color = ops.where3(has, vertex_color, color)
    return color


@helper
def corner_uv(tables: Tables, g: Lane, row: Lane, triangle: Lane, corner: int, has: Lane) -> tuple[Lane, Lane]:
    """An attribute of width 2 at a triangle's corner, in the lanes that have it."""
    start = attribute_row(tables, g, row, triangle, corner, has)
    values = tables.pools.values
    return ops.to_float(values[start]), ops.to_float(values[start + 1])


@helper
def _mesh_uv(tables: Tables, g: Lane, hit: Hit, on_mesh: Lane, a: Vec, b: Vec, c: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """u, v and the metres (in the mesh's frame) that one unit of each spans on the triangle; 0, 0, 1, 1 without coordinates."""
    row = ops.to_int(tables.geometries.uvs[g])
    has = on_mesh & (row >= 0)
    zero = ops.full_like(hit.u, 0.0)
    u, v, du, dv = zero, zero, zero + 1.0, zero + 1.0
    if ops.any_lane(has):
        safe_g, safe_row, triangle = ops.where(has, g, 0), ops.where(has, row, 0), ops.where(has, hit.primitive, 0)
        ua, va = corner_uv(tables, safe_g, safe_row, triangle, 0, has)
        ub, vb = corner_uv(tables, safe_g, safe_row, triangle, 1, has)
        uc, vc = corner_uv(tables, safe_g, safe_row, triangle, 2, has)
        u = ops.where(has, ua + (ub - ua) * hit.u + (uc - ua) * hit.v, u)
        v = ops.where(has, va + (vb - va) * hit.u + (vc - va) * hit.v, v)
        span_u, span_v = uv_metric(ops.sub(b, a), ops.sub(c, a), ub - ua, vb - va, uc - ua, vc - va)
        du, dv = ops.where(has, span_u, du), ops.where(has, span_v, dv)
    return u, v, du, dv


@helper
def uv_metric(e1: Vec, e2: Vec, u1: Lane, v1: Lane, u2: Lane, v2: Lane) -> tuple[Lane, Lane]:
    """Metres that one unit of u and of v spans on triangles, from their changes along two edges; 1, 1 if unknown.

    Two edges and their coordinates give the derivatives of the point: dp/du = (Δv₂ e₁ − Δv₁ e₂) / det.
    """
    det = u1 * v2 - u2 * v1
    is_regular = det != 0.0
    det = ops.where(is_regular, det, 1.0)
    du = ops.length(ops.sub(ops.scale(e1, v2 / det), ops.scale(e2, v1 / det)))
    dv = ops.length(ops.sub(ops.scale(e2, u1 / det), ops.scale(e1, u2 / det)))
    return ops.where(is_regular, du, 1.0), ops.where(is_regular, dv, 1.0)
