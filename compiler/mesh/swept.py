"""Polygon meshes of profiles that are revolved about y, or extruded along y with twist and taper."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .. import ir
from ..ir import F64, I64
from ..scene.row_records import MeshAttribute
from . import mesh_csg, profiles
from .polygon_mesh import PolyMesh

MOST_SIDES = 4096
LEAST_SIDES = 24
MOST_CELLS = 1 << 20  # quads of a twisted prism


class Faces:
    """Faces of a mesh with texture coordinates at their corners, gathered in groups of one size."""

    def __init__(self) -> None:
        self._counts: list[np.ndarray] = []
        self._indices: list[np.ndarray] = []
        self._uvs: list[np.ndarray] = []

    def add(self, corners: I64, uvs: F64) -> None:
        """Faces (n, size) with their coordinates (n, size, 2)."""
        self._counts.append(np.full(len(corners), corners.shape[1], np.int64))
        self._indices.append(corners.reshape(-1))
        self._uvs.append(uvs.reshape(-1, 2))

    def mesh(self, points: F64) -> PolyMesh:
        """The mesh of the faces added, without normals."""
        uvs = MeshAttribute(np.concatenate(self._uvs).astype(np.float32), ir.Interpolation.CORNER)
        return PolyMesh(points, np.concatenate(self._counts), np.concatenate(self._indices), uvs=uvs)


def sides(radius: float, tolerance: float) -> int:
    """Sides of a regular polygon inscribed in a circle that is off it by `tolerance` at most."""
    share = min(max(1 - tolerance / radius, -1.0), 1.0) if radius > 0 else -1.0
    return min(max(LEAST_SIDES, math.ceil(math.pi / max(math.acos(share), 1e-9))), MOST_SIDES)


def sagitta(radius: float, angle: float) -> float:
    """The distance of a chord over `angle` radians from its circle."""
    return radius * (1.0 - math.cos(0.5 * angle))


# --- revolved ---------------------------------------------------------------------------------------------------------


def turns(profile: F64, angle: float, tolerance: float | None = None) -> int:
    """The pieces of `angle` radians of a surface of revolution; the default tolerance is that of profiles."""
    return max(3, math.ceil(sides(float(profile[:, 0].max()), profiles.fineness(profile, tolerance)) * angle / (2 * math.pi)))


def revolve(profile: F64, closed: bool, angle: float, tolerance: float | None = None) -> PolyMesh:
    """The surface of revolution about y of a profile (n, 2) of [radius, y], radii 0 or more, by `angle` radians from +x towards -z.

    A closed profile is counter-clockwise; less than a whole turn of it has flat ends. u runs round, v along the profile.
    """
    full_turn = angle >= 2 * math.pi
    count = turns(profile, angle, tolerance)
    # A whole turn begins at -z, as u of a cylinder does.
    turned = (-math.pi if full_turn else math.pi / 2) + angle / count * np.arange(count if full_turn else count + 1)
    pole = profile[:, 0] == 0
    vertices = _ring_vertices(pole, len(turned))
    radius, y = (np.broadcast_to(column[:, None], vertices.shape) for column in profile.T)
    rings = np.stack([radius * np.sin(turned), y, radius * np.cos(turned)], axis=2)
    points = np.zeros((int(vertices.max()) + 1, 3))
    points[vertices] = rings
    if full_turn:
        vertices = np.concatenate([vertices, vertices[:, :1]], axis=1)
    edge = np.arange(len(profile) if closed else len(profile) - 1)
    after = (edge + 1) % len(profile)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(profile[after] - profile[edge], axis=1))])
    v, u = length / length[-1], np.linspace(0.0, 1.0, count + 1)
    faces = Faces()
    for kind in (~pole[edge] & ~pole[after], pole[edge] & ~pole[after], ~pole[edge] & pole[after]):
        rows = np.flatnonzero(kind)
        if len(rows):
            _revolve_edges(faces, vertices, (edge[rows], after[rows]), (v[rows], v[rows + 1]), u, pole)
    if closed and not full_turn:
        low, size = profile.min(axis=0), profiles.extent(profile)
        triangles = mesh_csg.triangulate([profile])
        for column, order in ((0, triangles), (-1, triangles[:, ::-1])):
            faces.add(vertices[order, column], ((profile - low) / size)[order])
    return faces.mesh(points)


def _ring_vertices(pole: np.ndarray, count: int) -> I64:
    """(n, count) vertex of each profile point at each angle; a point on the axis has one."""
    size = np.where(pole, 1, count)
    first = np.cumsum(size) - size
    return first[:, None] + np.where(pole[:, None], 0, np.arange(count))


def _revolve_edges(faces: Faces, vertices: I64, ends: tuple[I64, I64], v: tuple[F64, F64], u: F64, pole: np.ndarray) -> None:
    """The faces of edges from profile points to profile points: quads, or triangles at the axis."""
    low, high = vertices[ends[0]], vertices[ends[1]]
    corners = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2).reshape(-1, 4)
    us = np.broadcast_to(np.stack([u[:-1], u[1:], u[1:], u[:-1]], axis=1), (len(low), len(u) - 1, 4))
    vs = np.broadcast_to(np.stack([v[0], v[0], v[1], v[1]], axis=1)[:, None], us.shape)
    uvs = np.stack([us, vs], axis=3).reshape(-1, 4, 2)
    for end, columns, tip in ((ends[0], [0, 2, 3], 0), (ends[1], [0, 1, 2], 2)):
        if pole[end].all():
            uvs = uvs[:, columns]
            uvs[:, tip, 0] = 0.5 * (uvs[:, 1, 0] + uvs[:, (tip + 2) % 3 if tip == 0 else 0, 0])
            corners = corners[:, columns]
            break
    faces.add(corners, uvs)


# --- extruded ---------------------------------------------------------------------------------------------------------


class Sweep(NamedTuple):
    """How a profile is extruded: from `base` to `base + height` along y, turned by `twist` radians and scaled to `taper` at the top."""

    base: float
    height: float
    twist: float = 0.0
    taper: tuple[float, float] = (1.0, 1.0)
    tolerance: float | None = None  # of sides that are not flat; by default that of profiles


def extrude(loops: Sequence[F64], sweep: Sweep) -> PolyMesh:
    """The prism of a profile: an outline (n, 2), counter-clockwise in [x, -z], and its holes, clockwise.

    On the sides u runs along each loop and v up; the ends have the profile's bounding square.
    """
    pointed = not any(sweep.taper)
    layers, pieces = _cells(loops, sweep)
    share = np.linspace(0.0, 1.0, layers + 1)
    faces, points, first, caps = Faces(), [], 0, []
    for loop in loops:
        cut = _divided(loop, pieces)
        count = len(cut)
        rows = first + count * np.arange(layers + 1)[:, None] + np.arange(count)
        points.append(_layers(cut, sweep, share).reshape(-1, 3))
        after = np.roll(rows, -1, axis=1)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.roll(cut, -1, axis=0) - cut, axis=1))])
        u = length / length[-1]
        corners = np.stack([rows[:-1], after[:-1], after[1:], rows[1:]], axis=2)
        us = np.broadcast_to(np.stack([u[:-1], u[1:], u[1:], u[:-1]], axis=1), corners.shape)
        vs = np.broadcast_to(np.stack([share[:-1], share[:-1], share[1:], share[1:]], axis=1)[:, None], corners.shape)
        uvs = np.stack([us, vs], axis=3)
        if pointed:  # the top layer is one point: triangles
            faces.add(np.where(corners[-1] >= rows[-1, 0], rows[-1, 0], corners[-1])[:, :3], uvs[-1][:, :3])
            corners, uvs = corners[:-1], uvs[:-1]
        faces.add(corners.reshape(-1, 4), uvs.reshape(-1, 4, 2))
        caps.append((cut, rows[0], rows[-1]))
        first += (layers + 1) * count
    _add_caps(faces, caps, pointed)
    return faces.mesh(np.concatenate(points))


def _add_caps(faces: Faces, caps: list[tuple[F64, I64, I64]], pointed: bool) -> None:
    """The ends of a prism: the loops with their vertices at the bottom and at the top."""
    triangles = mesh_csg.triangulate([cut for cut, _, _ in caps])
    flat = np.concatenate([cut for cut, _, _ in caps])
    uv = (flat - flat.min(axis=0)) / profiles.extent(flat)
    bottom, top = np.concatenate([rows for _, rows, _ in caps]), np.concatenate([rows for _, _, rows in caps])
    faces.add(bottom[triangles[:, ::-1]], uv[triangles[:, ::-1]])
    if not pointed:
        faces.add(top[triangles], uv[triangles])


def sheet(loops: Sequence[F64]) -> PolyMesh:
    """The area of a profile in y = 0, seen from +y."""
    triangles = mesh_csg.triangulate(loops)
    flat = np.concatenate(list(loops))
    uv = (flat - flat.min(axis=0)) / profiles.extent(flat)
    faces = Faces()
    faces.add(triangles, uv[triangles])
    return faces.mesh(np.stack([flat[:, 0], np.zeros(len(flat)), -flat[:, 1]], axis=1))


def _cells(loops: Sequence[F64], sweep: Sweep) -> tuple[int, float]:
    """(layers, greatest length of a piece of an edge) that keep sides that are not flat within the tolerance of their triangles.

    Raises ProfileError if they would be too many.
    """
    wide, deep = sweep.taper
    turn = abs(sweep.twist) + (math.asin(abs(wide - deep) / (wide + deep)) if wide != deep else 0.0)
    if not turn:
        return 1, math.inf
    flat = np.concatenate(list(loops))
    tolerance = profiles.fineness(flat, sweep.tolerance)
    edges = np.concatenate([np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1) for loop in loops]) * max(1.0, wide, deep)
    reach = float(np.linalg.norm(flat, axis=1).max()) * max(1.0, wide, deep)
    # A quad whose opposite edges of length e turn by a is off its two triangles by e a / 4.
    cells = float(edges.max()) * turn / (4 * tolerance)
    layers = math.ceil(max(1.0, abs(sweep.twist) / (2 * math.acos(max(0.0, 1 - tolerance / reach))), math.sqrt(cells)))
    longest = float(edges.max()) / max(1.0, cells / layers)
    count = layers * int(np.ceil(edges / longest).sum())
    if count > MOST_CELLS:
        raise profiles.ProfileError(f"this twist takes {2 * count:,} triangles: {2 * MOST_CELLS:,} at the most", "twist it less")
    return layers, longest / max(1.0, wide, deep)


def _divided(loop: F64, longest: float) -> F64:
    """A polygon with its edges cut into equal pieces of `longest` at most."""
    if not math.isfinite(longest):
        return loop
    ways = np.roll(loop, -1, axis=0) - loop
    counts = np.maximum(1, np.ceil(np.linalg.norm(ways, axis=1) / longest * (1 - 1e-12)).astype(int))
    return np.concatenate([a + np.arange(n)[:, None] / n * way for a, way, n in zip(loop, ways, counts.tolist(), strict=True)])


def _layers(loop: F64, sweep: Sweep, share: F64) -> F64:
    """(layers, n, 3) the points of a loop at shares of the height."""
    scale = 1.0 + share[:, None] * (np.array(sweep.taper) - 1.0)
    x, v = (loop[None] * scale[:, None]).transpose(2, 0, 1)
    angle = (sweep.twist * share)[:, None]
    c, s = np.cos(angle), np.sin(angle)
    y = np.broadcast_to((sweep.base + sweep.height * share)[:, None], x.shape)
    return np.stack([c * x - s * v, y, -(s * x + c * v)], axis=2)
