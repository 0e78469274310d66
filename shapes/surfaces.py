"""Triangles of analytic shapes: surfaces of revolution and flat ones, with exact normals, watertight.

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

MIN_SEGMENTS = 12  # of a circle
MAX_SEGMENTS = 1024
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
LEVEL = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turns the plane of x and y with normal +z to that of x and z with normal +y."""


class Tessellation(NamedTuple):
    """Triangles of one shape in its own frame, counterclockwise from outside."""

    positions: NDArray[np.float64]  # (n, 4) homogeneous: w = 0 is a direction, a point at infinity
    triangles: NDArray[np.int32]  # (m, 3)
    normals: NDArray[np.float64]  # (n, 3) unit, outward
    uvs: NDArray[np.float64]  # (n, 2) by the shape's `uv`; nan where it has to be called
    parts: NDArray[np.int32]  # (m,) the part of the shape of each triangle, as of its `hit`


class Profile(NamedTuple):
    """A curve (r, y) of a surface of revolution about the y axis: one ring of vertices for each point."""

    radius: NDArray[np.float64]
    height: NDArray[np.float64]
    normal: NDArray[np.float64]  # (k, 2) outward (r, y)
    v: NDArray[np.float64]
    part: int


def box_of(half: Sequence[float]) -> NDArray[np.float64]:
    """(2, 3) bounds about the origin."""
    extent = np.array(half, dtype=np.float64)
    return np.stack([-extent, extent])


def segments(radius: float, tolerance: float) -> int:
    """The number of chords within `tolerance` of a circle of `radius`: a multiple of 4 between the limits."""
    return int(min(max(4 * math.ceil(min(unlimited_segments(radius, tolerance), MAX_SEGMENTS) / 4), MIN_SEGMENTS), MAX_SEGMENTS))


def unlimited_segments(radius: float, tolerance: float) -> float:
    """The same without limits and rounding."""
    share = min(tolerance / radius, 1.0) if radius > 0 else 1.0
    return math.inf if share < 1e-12 else math.pi / math.acos(1.0 - share)


def sagitta(radius: float, tolerance: float) -> float:
    """The distance of the chords of `segments` from their circle."""
    return radius * (1.0 - math.cos(math.pi / segments(radius, tolerance)))


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


def disk_profile(radius: float, height: float, up: float, part: int) -> Profile:
    """From the centre to the rim; `up` is the normal's y."""
    normal = np.array([[0.0, up], [0.0, up]])
    return Profile(np.array([0.0, radius]), np.array([height, height]), normal, np.array([0.0, 1.0]), part)


def revolve(profiles: Sequence[Profile], count: int) -> Tessellation:
    """Revolve profiles about the y axis in `count` steps from -z towards -x; u goes around, v along the profile.

    A ring of radius 0 is a pole: its vertices share one position; the u of each is the mean of its triangle.
    """
    cos, sin = circle(count)
    sides = [_revolve_one(p, cos, sin) for p in profiles]
    firsts = np.cumsum([0, *(len(m.positions) for m in sides[:-1])])
    triangles = np.concatenate([m.triangles + np.int32(first) for m, first in zip(sides, firsts, strict=True)])
    positions, _, normals, uvs, parts = (np.concatenate(column) for column in zip(*sides, strict=True))
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


def endless(x: float = 0.0, z: float = 0.0) -> Tessellation:
    """The plane y = 0 as four triangles from (x, 0, z) to points at infinity; homogeneous clipping is exact.

    A centre far from the eye costs digits: clipping subtracts large numbers.
    """
    ways = np.array([[x, 0, z, 1], [1, 0, 0, 0], [0, 0, 1, 0], [-1, 0, 0, 0], [0, 0, -1, 0]], np.float64)
    triangles = np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4]], np.int32)
    return Tessellation(ways, triangles, np.tile([0.0, 1.0, 0.0], (5, 1)), np.zeros((5, 2)), np.zeros(4, np.int32))


def flat(positions: NDArray, triangles: NDArray, normals: NDArray) -> Tessellation:
    """A tessellation of finite points, all of part 0, without coordinates."""
    homogeneous = np.concatenate([positions, np.ones((len(positions), 1))], axis=1)
    none = np.zeros(len(triangles), np.int32)
    return Tessellation(homogeneous, triangles.astype(np.int32), normals, np.full((len(positions), 2), np.nan), none)


def without_uvs(tessellation: Tessellation) -> Tessellation:
    """The same without coordinates: those of the shape's `uv` take their place."""
    return tessellation._replace(uvs=np.full_like(tessellation.uvs, np.nan))
