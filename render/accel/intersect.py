"""Closest-hit, occlusion and transmittance queries, by BVH traversal in kernels and by brute force in numpy.

Both give the same result. Rays are transformed to a shape's frame without normalization, so t stays the same. Of hits at the same t the
lowest instance wins, then the lowest primitive. A surface of opacity 0 is not hit. A surface of an opacity below 1 is hit, and shadow rays
multiply its transmittance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...compiler import ir
from ...materials import traits
from ..geometry import analytic_shapes, instance_transform
from ..lanes import affine, crosslane, ops
from ..simd.registration import overload, types
from ..surface import alpha, interaction
from ..types import Hit, Lane, Ray, Vec
from .traverse import motion_alpha, shape_hit, two_level

CHUNK = 1 << 17  # ray–triangle pairs tested at a time: limits memory to a few dozen MB
MESH = int(ir.GeometryKind.MESH)
SHADOW = int(ir.Visibility.SHADOW)


class Brute(NamedTuple):
    """The brute-force accelerator: tests every instance and every triangle."""


def closest_hit(accel: Any, tables: ir.Tables, ray: Ray, active: Lane, visible_bit: Lane) -> Hit:
    """First hit of each active ray with instances that have a bit of `visible_bit` in Instances.visible; instance -1: none."""
    rays, active = _flat(ray, active)
    n = len(active)
    partial = traits.partial(tables)[tables.instances.material]
    t, instance, primitive = np.full(n, np.inf), np.full(n, -1), np.full(n, -1)
    u, v = np.zeros(n), np.zeros(n)
    with np.errstate(all="ignore"):
        for i in range(len(tables.instances.geometry)):
            lane = np.flatnonzero(active & ((tables.instances.visible[i] & visible_bit) != 0))
            if len(lane) == 0:
                continue
            hits = _intersect_instance(tables, i, _rows(rays, lane), partial[i])[0]
            nearer = hits.t < t[lane]
            lane = lane[nearer]
            t[lane], instance[lane], primitive[lane] = hits.t[nearer], i, hits.primitive[nearer]
            u[lane], v[lane] = hits.u[nearer], hits.v[nearer]
    return Hit(t, instance, primitive, u, v)


def occluded(accel: Any, tables: ir.Tables, ray: Ray, active: Lane) -> Lane:
    """Whether shadow casters block all light between t_min and t_max; False for inactive rays."""
    return np.ravel(active) & (transmittance(accel, tables, ray, active) <= 0.0)


def transmittance(accel: Any, tables: ir.Tables, ray: Ray, active: Lane, visible_bit: int = SHADOW) -> Lane:
    """Share of light, 0 to 1, that passes instances with `visible_bit` between t_min and t_max; 1 for inactive rays."""
    rays, active = _flat(ray, active)
    share = np.ones(len(active))
    partial = traits.partial(tables)[tables.instances.material]
    with np.errstate(all="ignore"):
        for i in np.flatnonzero(tables.instances.visible & visible_bit):
            lane = np.flatnonzero(active & (share > 0.0))
            if len(lane):
                share[lane] *= _intersect_instance(tables, int(i), _rows(rays, lane), partial[i], through=True)[1]
    return share


def attenuate(accel: Any, tables: ir.Tables, ray: Ray, active: Lane, radiance: Vec, visible_bit: int = SHADOW) -> Vec:
    """The light `radiance` times the transmittance of instances with `visible_bit` between t_min and t_max; 0 for inactive rays."""
    return ops.scale(radiance, np.where(active, transmittance(accel, tables, ray, active, visible_bit), 0.0))


def _flat(ray: Ray, active: Lane) -> tuple[np.ndarray, np.ndarray]:
    """Rays as (9, n): origin, direction, t_min, t_max, time (NaN: none)."""
    columns = np.broadcast_arrays(*ray.origin, *ray.direction, ray.t_min, ray.t_max, np.nan if ray.time is None else ray.time, active)
    return np.stack([np.ravel(c) for c in columns[:9]]).astype(np.float64), np.ravel(columns[9]).astype(bool)


def _rows(rays: np.ndarray, lane: np.ndarray) -> Ray:
    x, y, z, dx, dy, dz, t_min, t_max, time = rays[:, lane]
    return Ray((x, y, z), (dx, dy, dz), t_min, t_max, None if np.isnan(time).any() else time)


def _intersect_instance(tables: ir.Tables, i: int, ray: Ray, partial: bool, through: bool = False) -> tuple[Hit, np.ndarray]:
    """(first hits of rays with instance i, share of light that passes it); with `through`, the share is that of all hits.

    Only `partial` instances have an opacity to evaluate.
    """
    geometry, row = tables.instances.geometry[i], tables.instances.transform[i]
    inverse = instance_transform.transform_at(tables, row, ray.time).inverse
    o, d = affine.transform_point12(inverse, ray.origin), affine.transform_vector12(inverse, ray.direction)
    kind = tables.geometries.kind[geometry]

    def cover(rows: np.ndarray, t: np.ndarray, primitive: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Opacity of the surface at the hits of rays `rows`."""
        rays = Ray(_some(ray.origin, rows), _some(ray.direction, rows), 0.0, np.inf, None if ray.time is None else ray.time[rows])
        return alpha.opacity_at(tables, interaction.make_interaction(tables, rays, Hit(t, np.full(len(rows), i), primitive, u, v)))

    if kind == MESH:
        return _intersect_mesh(tables, geometry, Ray(o, d, ray.t_min, ray.t_max), cover if partial else None)
    t_min, share = ray.t_min, np.ones(len(ray.t_min))
    while True:
        t, part, u, v, onward = _intersect_shape(tables, int(kind), int(geometry), Ray(o, d, t_min, ray.t_max))
        zero = np.zeros(len(t))
        if not partial:
            return Hit(t, zero, part, u, v), np.where(t < np.inf, 0.0, share)
        hit_rows = np.flatnonzero(t < np.inf)
        opacity = np.zeros(len(t))
        opacity[hit_rows] = cover(hit_rows, t[hit_rows], part[hit_rows], u[hit_rows], v[hit_rows])
        share = share * (1.0 - opacity)
        on = (t < np.inf) & ((share > 0.0) if through else (opacity == 0.0))
        if not on.any():
            return Hit(t, zero, part, u, v), share
        t_min = np.where(on, onward, np.where(t < np.inf, t_min, np.inf))


def _intersect_shape(tables: ir.Tables, kind: int, g: int, ray: Ray) -> tuple[np.ndarray, ...]:
    """(t, primitive, u, v, smallest t of the next hit) of rays in the frame of a shape other than a mesh."""
    geometries, zero = tables.geometries, np.zeros(len(ray.t_min))
    if kind != shape_hit.FORMULA:
        t, part = analytic_shapes.intersect(kind, geometries.parameters, g, ray.origin, ray.direction, ray.t_min, ray.t_max)
        return t, part + 0 * zero.astype(np.int64), zero, zero, t
    from ..formula import numpy_reference, scene_surfaces  # by the definition

    tape, parameters = scene_surfaces.tape_of(tables, g), geometries.parameters[g]
    hits = numpy_reference.first_hit(tape, parameters, geometries.bounds[g], ray.origin, ray.direction, ray.t_min, ray.t_max)
    t, spacing, u, v, _ = hits
    return t, spacing, u, v, shape_hit.next_t(parameters[5], ray.direction, t, spacing)


def next_t_min(tables: ir.Tables, ray: Ray, hit: Hit) -> np.ndarray:
    """Smallest t of the next hit of rays that pass their hits, in numpy; see motion_alpha.alpha_at_hit."""
    onward = np.array(hit.t, float)
    geometry = tables.instances.geometry[np.maximum(hit.instance, 0)]
    formulas = (hit.instance >= 0) & (tables.geometries.kind[geometry] == shape_hit.FORMULA)
    for i in np.unique(hit.instance[formulas]):
        rows, g = np.flatnonzero(hit.instance == i), int(tables.instances.geometry[i])
        inverse = instance_transform.transform_at(
            tables, tables.instances.transform[i], None if ray.time is None else ray.time[rows]
        ).inverse
        d = affine.transform_vector12(inverse, _some(ray.direction, rows))
        onward[rows] = shape_hit.next_t(tables.geometries.parameters[g, 5], d, onward[rows], hit.primitive[rows])
    return onward


def _some(v: Vec, rows: np.ndarray) -> Vec:
    return v[0][rows], v[1][rows], v[2][rows]


def _intersect_mesh(tables: ir.Tables, g: int, ray: Ray, cover: Callable[..., np.ndarray] | None) -> tuple[Hit, np.ndarray]:
    """(first hits of rays with a mesh, share of light that passes it), by tests of all pairs, CHUNK at a time."""
    geometries, pools = tables.geometries, tables.pools
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    corners = pools.positions[pools.triangles[first : first + count]].astype(np.float64)
    origin = ops.sub(ray.origin, tuple(geometries.origin[g]))
    n = len(ray.t_min)
    best, share = Hit(np.full(n, np.inf), np.full(n, -1), np.full(n, -1), np.zeros(n), np.zeros(n)), np.ones(n)
    step = max(1, CHUNK // max(count, 1))
    for start in range(0, n if count else 0, step):
        part = slice(start, start + step)
        o, d = _column(origin, part), _column(ray.direction, part)
        a, b, c = ((corners[:, k, 0], corners[:, k, 1], corners[:, k, 2]) for k in range(3))
        t, u, v = analytic_shapes.triangle(a, b, c, o, d, ray.t_min[part, None], ray.t_max[part, None])
        if cover is not None:
            row, face = np.nonzero(t < np.inf)
            opacity = cover(start + row, t[row, face], first + face, u[row, face], v[row, face])
            np.multiply.at(share, start + row, 1.0 - opacity)
            t[row[opacity == 0.0], face[opacity == 0.0]] = np.inf
        k = np.argmin(t, axis=1)[:, None]
        best.t[part], best.primitive[part] = np.take_along_axis(t, k, 1)[:, 0], first + k[:, 0]
        best.u[part], best.v[part] = np.take_along_axis(u, k, 1)[:, 0], np.take_along_axis(v, k, 1)[:, 0]
    return best, share if cover is not None else np.where(best.t < np.inf, 0.0, 1.0)


def _column(v: Vec, part: slice) -> Vec:
    return v[0][part, None], v[1][part, None], v[2][part, None]


def find(accel: Any, ray: Ray, active: Lane, visible_bit: int, any_hit: bool) -> Hit:
    """The hit that a BVH traversal finds, in kernels."""
    raise NotImplementedError


@overload(find)
def _find_in_kernels(accel, ray, active, visible_bit, any_hit):
    if motion_alpha.has_motion(accel) and not isinstance(ray.types[ray.fields.index("time")], types.NoneType):

        def find_at_time(accel, ray, active, visible_bit, any_hit):
            if motion_alpha.has_no_instances(accel):
                return two_level.find(  # pyright: ignore[reportCallIssue]
                    accel.motion_alpha.opaque_search,
                    (accel, ray.origin, ray.direction, ray.t_min, ray.t_max, active, np.int64(visible_bit), any_hit),
                )
            return motion_alpha.find_moving(  # pyright: ignore[reportCallIssue]
                accel.motion_alpha.moving.address,
                (accel, ray.origin, ray.direction, ray.t_min, ray.t_max, active, np.int64(visible_bit), any_hit, ray.time),
            )

        return find_at_time

    def find_still(accel, ray, active, visible_bit, any_hit):
        return two_level.find(  # pyright: ignore[reportCallIssue]
            accel.search, (accel, ray.origin, ray.direction, ray.t_min, ray.t_max, active, np.int64(visible_bit), any_hit)
        )

    return find_still


@overload(closest_hit)
def _closest_kernel(accel, tables, ray, active, visible_bit):
    if not crosslane.is_mask(active):
        return None
    return lambda accel, tables, ray, active, visible_bit: find(accel, ray, active, visible_bit, False)


@overload(occluded)
def _occluded_kernel(accel, tables, ray, active):
    if not crosslane.is_mask(active):
        return None
    return lambda accel, tables, ray, active: find(accel, ray, active, SHADOW, True).instance >= 0


@overload(transmittance)
def _transmittance_kernel(accel, tables, ray, active, visible_bit=SHADOW):
    if not crosslane.is_mask(active):
        return None

    def with_opacity(accel, tables, ray, active, visible_bit=SHADOW):
        hit = find(accel, ray, active, visible_bit, True)
        if motion_alpha.has_no_instances(accel):
            return ops.where(hit.instance >= 0, 0.0, 1.0)
        return ops.where(hit.instance >= 0, 0.0, hit.u)

    def opaque(accel, tables, ray, active, visible_bit=SHADOW):
        return ops.where(find(accel, ray, active, visible_bit, True).instance >= 0, 0.0, 1.0)

    return with_opacity if motion_alpha.has_opacity(accel) else opaque


@overload(attenuate)
def _attenuate_kernel(accel, tables, ray, active, radiance, visible_bit=SHADOW):
    if not crosslane.is_mask(active):
        return None

    def with_opacity(accel, tables, ray, active, radiance, visible_bit=SHADOW):
        return ops.scale(radiance, ops.where(active, transmittance(accel, tables, ray, active, visible_bit), 0.0))

    def opaque(accel, tables, ray, active, radiance, visible_bit=SHADOW):
        zero = ops.full_like(radiance[0], 0.0)
        blocked = find(accel, ray, active, visible_bit, True).instance >= 0
        return ops.where3(active & ops.not_(blocked), radiance, (zero, zero, zero))

    return with_opacity if motion_alpha.has_opacity(accel) else opaque
