"""Tessellates analytic shapes within a tolerance: exact normals, watertight.

Vertices lie on the surface, so the mesh of a convex shape is inscribed. One of n chords of a circle of radius R is off by at most its
sagitta, R (1 - cos(π / n)); where a surface is curved in both directions, two sagittas add. Vertices at creases and at the seam of u
are duplicated with bit-identical positions, so that edges match exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..geometry import analytic_shapes
from . import quadrics

MIN_SEGMENTS = 12  # of a circle
MAX_SEGMENTS = 1024
_RIM = 1e-12  # of a cone's larger radius: an end below it is a tip


class Tessellation(NamedTuple):
    """Triangles of one shape in its own frame, counterclockwise from outside."""

    positions: NDArray[np.float64]  # (n, 4) homogeneous: w = 0 is a direction, a point at infinity
    triangles: NDArray[np.int32]  # (m, 3)
    normals: NDArray[np.float64]  # (n, 3) unit, outward
    uvs: NDArray[np.float64]  # (n, 2) as of geometry.analytic_shapes.uv
    parts: NDArray[np.int32]  # (m,) the part of the shape of each triangle, as in geometry/analytic_shapes.py


class Profile(NamedTuple):
    """A curve (r, y) of a surface of revolution about the y axis: one ring of vertices for each point."""

    radius: NDArray[np.float64]
    height: NDArray[np.float64]
    normal: NDArray[np.float64]  # (k, 2) outward (r, y)
    v: NDArray[np.float64]
    part: int


def visible_analytic(tables: ir.Tables) -> NDArray[np.intp]:
    """The rows of instances that are visible to the camera and no meshes."""
    instances, geometries = tables.instances, tables.geometries
    analytic = geometries.kind[instances.geometry] != ir.GeometryKind.MESH
    return np.flatnonzero(analytic & (instances.visible & ir.Visibility.CAMERA != 0))


def tessellate(kind: int, parameters: Sequence[float], tolerance: float) -> Tessellation:
    """Tessellate a shape of `kind` (ir.GeometryKind) within `tolerance` metres; meshes and unbounded quadrics are not supported.

    `parameters` and `tolerance` are in the geometry's frame. At most MAX_SEGMENTS segments go around and half as many across, so a very
    small tolerance is not reached. Raises ValueError for other kinds.
    """
    match kind:
        case ir.GeometryKind.SPHERE:
            made = revolve([sphere_profile(parameters[0], tolerance)], segments(parameters[0], tolerance / 2))
        case ir.GeometryKind.BOX:
            made = box(*parameters[:3])
        case ir.GeometryKind.PLANE:
            return plane()
        case ir.GeometryKind.RECTANGLE:
            made = rectangle(*parameters[:2])
        case ir.GeometryKind.DISK:
            made = revolve([disk_profile(parameters[0], 0.0, 1.0, 0)], segments(parameters[0], tolerance))
        case ir.GeometryKind.CYLINDER:
            radius, half, capped = parameters[:3]
            made = revolve(cone_profiles(radius, radius, half, bool(capped)), segments(radius, tolerance))
        case ir.GeometryKind.CONE:
            low, high, half, capped = parameters[:4]
            made = revolve(cone_profiles(low, high, half, bool(capped)), segments(max(low, high), tolerance))
        case ir.GeometryKind.TORUS:
            ring, tube = parameters[:2]
            made = revolve([torus_profile(ring, tube, tolerance)], segments(ring + tube, tolerance / 2))
        case ir.GeometryKind.CAPSULE:
            radius, half = parameters[:2]
            made = revolve([capsule_profile(radius, half, tolerance)], segments(radius, tolerance / 2))
        case ir.GeometryKind.QUADRIC:
            made = boxed_quadric(parameters, tolerance)
        case _:
            raise ValueError(f"no tessellation for geometry kind {kind}")
    return with_uvs(kind, parameters, outward(made))


FLAT = (ir.GeometryKind.PLANE, ir.GeometryKind.BOX, ir.GeometryKind.RECTANGLE)


def exceeds_limit(kind: int, parameters: Sequence[float], tolerance: float) -> bool:
    """Whether a round shape needs more than MAX_SEGMENTS for a tolerance; False for boxed quadrics, see quadrics.py."""
    match kind:
        case ir.GeometryKind.SPHERE | ir.GeometryKind.CAPSULE:
            most = unlimited_segments(parameters[0], tolerance / 2)
        case ir.GeometryKind.DISK | ir.GeometryKind.CYLINDER:
            most = unlimited_segments(parameters[0], tolerance)
        case ir.GeometryKind.CONE:
            most = unlimited_segments(max(parameters[:2]), tolerance)
        case ir.GeometryKind.TORUS:
            most = unlimited_segments(parameters[0] + parameters[1], tolerance / 2)
        case _:
            return False
    return most > MAX_SEGMENTS


def deviation(kind: int, parameters: Sequence[float], tolerance: float, made: Tessellation) -> float:
    """The largest distance of the triangles of `tessellate` from the shape: that of chords, of quadrics measured to first order."""

    def off(radius: float, within: float) -> float:
        return radius * (1.0 - math.cos(math.pi / segments(radius, within)))

    match kind:
        case ir.GeometryKind.SPHERE | ir.GeometryKind.CAPSULE:
            return 2 * off(parameters[0], tolerance / 2)  # around, and along the profile
        case ir.GeometryKind.DISK | ir.GeometryKind.CYLINDER:
            return off(parameters[0], tolerance)
        case ir.GeometryKind.CONE:
            return off(max(parameters[:2]), tolerance)
        case ir.GeometryKind.TORUS:
            return off(parameters[0] + parameters[1], tolerance / 2) + off(parameters[1], tolerance / 2)
        case ir.GeometryKind.QUADRIC:
            return quadrics.deviation(quadrics.matrix(parameters), made.positions[:, :3], made.triangles)
    return 0.0


def with_uvs(kind: int, parameters: Sequence[float], made: Tessellation) -> Tessellation:
    """The same with the uv of geometry.analytic_shapes on flat parts and quadrics, whose u is continuous across the seam.

    Round parts keep their profile's: the same values, but 0 and 1 on the sides of the seam, and a u at each pole.
    """
    part = np.zeros(len(made.positions), np.int64)
    part[made.triangles.ravel()] = np.repeat(made.parts, 3)
    row = np.zeros((1, ir.PARAMETERS))
    row[0, : len(parameters)] = parameters
    x, y, z = made.positions[:, :3].T
    none = np.zeros(len(part), np.int64)
    with np.errstate(all="ignore"):
        (u, v), _ = analytic_shapes.uv(none + kind, row, none, part, (x, y, z))
    exact = (part > 0) | (kind in (ir.GeometryKind.BOX, ir.GeometryKind.RECTANGLE, ir.GeometryKind.DISK, ir.GeometryKind.QUADRIC))
    made = made._replace(uvs=np.where(exact[:, None], np.stack([u, v], axis=1), made.uvs))
    return _split_seam(made) if kind == ir.GeometryKind.QUADRIC else made


def _split_seam(made: Tessellation) -> Tessellation:
    """Duplicate the vertices of triangles across the seam of u on its low side, with u + 1."""
    u = made.uvs[made.triangles, 0]
    low = (u.max(axis=1) - u.min(axis=1) > 0.5)[:, None] & (u < 0.5)
    doubled, index = np.unique(made.triangles[low], return_inverse=True)
    triangles = made.triangles.copy()
    triangles[low] = (len(made.positions) + index).astype(np.int32)
    positions, normals = (np.concatenate([column, column[doubled]]) for column in (made.positions, made.normals))
    return made._replace(
        positions=positions, triangles=triangles, normals=normals, uvs=np.concatenate([made.uvs, made.uvs[doubled] + [1.0, 0.0]])
    )


def segments(radius: float, tolerance: float) -> int:
    """The number of chords within `tolerance` of a circle of `radius`: a multiple of 4 between the limits."""
    return int(min(max(4 * math.ceil(min(unlimited_segments(radius, tolerance), MAX_SEGMENTS) / 4), MIN_SEGMENTS), MAX_SEGMENTS))


def unlimited_segments(radius: float, tolerance: float) -> float:
    """The same without limits and rounding."""
    share = min(tolerance / radius, 1.0) if radius > 0 else 1.0
    return math.inf if share < 1e-12 else math.pi / math.acos(1.0 - share)


# --- surfaces of revolution ----------------------------------------------------------------------------------------------


def circle(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(cos, sin) at count + 1 even steps of a turn; the last equals the first, quarter turns are exact."""
    index = np.arange(count + 1) % count
    cos, sin = np.cos(2 * np.pi * index / count), np.sin(2 * np.pi * index / count)
    quarter = index * 4 % count == 0
    return np.where(quarter, np.round(cos), cos), np.where(quarter, np.round(sin), sin)


def _half_segments(radius: float, tolerance: float) -> int:
    """The number of chords of half a circle, even."""
    return segments(radius, tolerance / 2) // 2


def sphere_profile(radius: float, tolerance: float) -> Profile:
    """From the south pole to the north pole."""
    half = _half_segments(radius, tolerance)
    cos, sin = circle(2 * half)
    normal = np.stack([sin, -cos], axis=1)[: half + 1]
    return Profile(radius * normal[:, 0], radius * normal[:, 1], normal, np.linspace(0.0, 1.0, half + 1), 0)


def torus_profile(ring: float, tube: float, tolerance: float) -> Profile:
    """The tube's circle from its innermost point, downwards first; of a spindle torus only the outer part."""
    count = segments(tube, tolerance / 2)
    if tube <= ring:
        cos, sin = circle(count)
        angle = np.linspace(-np.pi, np.pi, count + 1)
        normal = np.stack([-cos, -sin], axis=1)
    else:
        end = math.acos(-ring / tube)
        angle = np.linspace(-end, end, count + 1)
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius = ring + tube * normal[:, 0]
    if tube >= ring:
        radius[[0, -1]] = 0.0
    return Profile(radius, tube * normal[:, 1], normal, 0.5 + angle / (2 * np.pi), 0)


def capsule_profile(radius: float, half: float, tolerance: float) -> Profile:
    """From the south pole to the north pole; v is proportional to arc length."""
    ball = sphere_profile(radius, tolerance)
    middle = len(ball.radius) // 2
    rows = np.r_[0 : middle + 1, middle : len(ball.radius)]  # the equator twice: both ends of the cylinder
    shift = np.where(np.arange(len(rows)) <= middle, -half, half)
    length = np.pi * radius + 2 * half
    v = (ball.v[rows] * np.pi * radius + np.where(shift > 0, 2 * half, 0.0)) / length
    return Profile(ball.radius[rows], ball.height[rows] + shift, ball.normal[rows], v, 0)


def cone_profiles(low: float, high: float, half: float, capped: bool) -> list[Profile]:
    """The side of a cone or cylinder (part 0) and its caps: part 1 below, part 2 above."""
    slope = np.array([2 * half, low - high]) / math.hypot(2 * half, low - high)
    side = Profile(np.array([low, high]), np.array([-half, half]), np.stack([slope, slope]), np.array([0.0, 1.0]), 0)
    tiny = _RIM * max(low, high)
    caps = [(low, -half, -1.0, 1), (high, half, 1.0, 2)] if capped else []
    return [side, *(disk_profile(*cap) for cap in caps if cap[0] > tiny)]


def disk_profile(radius: float, height: float, up: float, part: int) -> Profile:
    """From the centre to the rim; `up` is the normal's y."""
    normal = np.array([[0.0, up], [0.0, up]])
    return Profile(np.array([0.0, radius]), np.array([height, height]), normal, np.array([0.0, 1.0]), part)


def revolve(profiles: Sequence[Profile], count: int) -> Tessellation:
    """Revolve profiles about the y axis in `count` steps from -z towards -x; u goes around, v along the profile.

    A ring of radius 0 is a pole: its vertices share one position; the u of each is the mean of its triangle.
    """
    cos, sin = circle(count)
    made = [_revolve_one(p, cos, sin) for p in profiles]
    firsts = np.cumsum([0, *(len(m.positions) for m in made[:-1])])
    triangles = np.concatenate([m.triangles + np.int32(first) for m, first in zip(made, firsts, strict=True)])
    positions, _, normals, uvs, parts = (np.concatenate(column) for column in zip(*made, strict=True))
    return Tessellation(positions, triangles, normals, uvs, parts)


def _revolve_one(profile: Profile, cos: NDArray[np.float64], sin: NDArray[np.float64]) -> Tessellation:
    rings, columns = len(profile.radius), len(cos)
    radius, height = profile.radius[:, None], np.broadcast_to(profile.height[:, None], (rings, columns))
    # + 0.0 turns -0 into 0: equal positions have equal bits
    positions = np.stack([-radius * sin + 0.0, height + 0.0, -radius * cos + 0.0, np.ones((rings, columns))], axis=-1)
    around, along = profile.normal[:, :1], profile.normal[:, 1:]
    normals = np.stack([-around * sin, np.broadcast_to(along, (rings, columns)), -around * cos], axis=-1)
    u = np.broadcast_to(np.linspace(0.0, 1.0, columns), (rings, columns)).copy()
    pole = profile.radius == 0.0
    u[pole, :-1] += 0.5 / (columns - 1)
    uvs = np.stack([u, np.broadcast_to(profile.v[:, None], u.shape)], axis=-1)
    k, j = (i.ravel() for i in np.meshgrid(np.arange(rings - 1), np.arange(columns - 1), indexing="ij"))
    a, b, c, d = k * columns + j, k * columns + j + 1, (k + 1) * columns + j + 1, (k + 1) * columns + j
    lower = np.stack([a, b, np.where(pole[k + 1], d, c)], axis=1)[~pole[k]]
    upper = np.stack([a, c, d], axis=1)[~pole[k + 1]]
    triangles = np.concatenate([lower, upper]).astype(np.int32)
    parts = np.full(len(triangles), profile.part, np.int32)
    return Tessellation(positions.reshape(-1, 4), triangles, normals.reshape(-1, 3), uvs.reshape(-1, 2), parts)


# --- flat shapes ---------------------------------------------------------------------------------------------------------


_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
_HALVES = np.array([[0, 1, 2], [0, 2, 3]])


def box(x: float, y: float, z: float) -> Tessellation:
    """Six faces of four vertices each, in the order of parts: -x, +x, -y, +y, -z, +z."""
    positions, normals = np.empty((6, 4, 3)), np.zeros((6, 4, 3))
    for face in range(6):
        axis, side = face // 2, 2.0 * (face % 2) - 1.0
        positions[face, :, axis] = side
        positions[face][:, [(axis + 1) % 3, (axis + 2) % 3]] = _CORNERS
        normals[face, :, axis] = side
    triangles = (4 * np.arange(6)[:, None, None] + _HALVES).reshape(-1, 3)
    made = _flat(positions.reshape(-1, 3) * [x, y, z], triangles, normals.reshape(-1, 3))
    return made._replace(parts=np.repeat(np.arange(6, dtype=np.int32), 2))


def rectangle(x: float, z: float) -> Tessellation:
    """Two triangles in y = 0."""
    positions = np.stack([_CORNERS[:, 0] * x, np.zeros(4), _CORNERS[:, 1] * z], axis=1)
    return _flat(positions, _HALVES, np.tile([0.0, 1.0, 0.0], (4, 1)))


def plane(x: float = 0.0, z: float = 0.0) -> Tessellation:
    """The plane y = 0 as four triangles from (x, 0, z) to points at infinity; homogeneous clipping is exact.

    A centre far from the eye costs digits: clipping subtracts large numbers.
    """
    ways = np.array([[x, 0, z, 1], [1, 0, 0, 0], [0, 0, 1, 0], [-1, 0, 0, 0], [0, 0, -1, 0]], np.float64)
    triangles = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4]], np.int32)
    return Tessellation(ways, triangles, np.tile([0.0, 1.0, 0.0], (5, 1)), np.zeros((5, 2)), np.zeros(4, np.int32))


def _flat(positions: NDArray, triangles: NDArray, normals: NDArray) -> Tessellation:
    """A tessellation of finite points, all of part 0, without coordinates."""
    homogeneous = np.concatenate([positions, np.ones((len(positions), 1))], axis=1)
    none = np.zeros(len(triangles), np.int32)
    return Tessellation(homogeneous, triangles.astype(np.int32), normals, np.zeros((len(positions), 2)), none)


def boxed_quadric(parameters: Sequence[float], tolerance: float) -> Tessellation:
    """A quadric inside its box (see quadrics.march), without uv."""
    matrix = quadrics.matrix(parameters)
    positions, triangles = quadrics.march(matrix, quadrics.box_grid(parameters, tolerance))
    return _flat(positions, triangles, quadrics.normals(matrix, positions))


def outward(made: Tessellation) -> Tessellation:
    """The same triangles, counterclockwise seen from the side of their normals. Points must be finite."""
    a, b, c = (made.positions[made.triangles[:, k], :3] for k in range(3))
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), made.normals[made.triangles].sum(axis=1))
    turned = np.where((facing < 0)[:, None], made.triangles[:, ::-1], made.triangles)
    return made._replace(triangles=np.ascontiguousarray(turned))
