"""Polygon meshes of round tubes along a polyline, with frames of parallel transport and mitred corners."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from ...lang.input_error import InputError
from ..ir import F64
from .polygon_mesh import PolyMesh
from .swept import Faces

MOST_TURN = math.radians(5)  # of the section of a closed tube from one ring to the next, about its path
SHARPEST = math.radians(160)  # greatest turn of a corner: its mitre reaches 1 / cos 80° = 5.8 radii


class TubeError(InputError):
    """A path that makes no tube."""


class Tube(NamedTuple):
    """A tube's mesh, and a point of its path where it folds into itself; None if it does not."""

    mesh: PolyMesh
    fold: F64 | None


def tube(path: F64, radii: F64, closed: bool, caps: str, sides: int) -> Tube:
    """The tube of `radii` (n,) around a path (n, 3) without repeated points; `caps` are "flat", "round" or "open".

    A radius of 0 at an end makes a tip. u runs round, v along the path. Raises TubeError for corners that turn back.
    """
    _check_corners(path, closed)
    if closed:
        path, radii = _divided(path, radii)
    ways, lengths = _legs(path, closed)
    rings = _rings(path, radii, closed, ways, lengths, sides)
    fold = _fold(path, rings, ways)
    v = np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()
    if closed:
        return Tube(_mesh(np.concatenate([rings, rings[:1]]), v, (False, False), capped=False, closed=True), fold)
    tips = [radii[0] == 0, radii[-1] == 0]
    domes = [np.zeros((0, sides, 3)), np.zeros((0, sides, 3))]
    for end, way in ((0, -ways[0]), (-1, ways[-1])):
        if caps == "round" and not tips[end]:
            domes[end], tips[end] = _dome(path[end], rings[end], radii[end] * way), True
    v = np.concatenate([np.zeros(len(domes[0])), v, np.ones(len(domes[1]))])
    return Tube(_mesh(np.concatenate([domes[0][::-1], rings, domes[1]]), v, (tips[0], tips[1]), caps != "open", closed=False), fold)


def _legs(path: F64, closed: bool) -> tuple[F64, F64]:
    """Directions and lengths of the segments of a path."""
    legs = (np.roll(path, -1, axis=0) - path)[: None if closed else -1]
    lengths = np.linalg.norm(legs, axis=1)
    return legs / lengths[:, None], lengths


def _check_corners(path: F64, closed: bool) -> None:
    ways, _ = _legs(path, closed)
    turns = (ways * np.roll(ways, 1, axis=0)).sum(axis=1)[0 if closed else 1 :]
    if len(turns) and turns.min() < math.cos(SHARPEST):
        corner = path[int(np.argmin(turns)) + (0 if closed else 1)]
        degrees = math.degrees(math.acos(max(-1.0, float(turns.min()))))
        where = ", ".join(f"{float(c) + 0.0:.4g}" for c in corner)
        hint = 'add a point beside the corner, or write kind: "catmull_rom"'
        raise TubeError(f"the curve turns back by {degrees:.0f}° at [{where}] m: no corner joins these tubes", hint)


def _rings(path: F64, radii: F64, closed: bool, ways: F64, lengths: F64, sides: int) -> F64:
    """(n, sides, 3) the section of the tube at each point, in the plane that halves its corner."""
    arriving = np.concatenate([ways[-1:] if closed else ways[:1], ways])[: len(path)]
    leaving = ways if closed else np.concatenate([ways, ways[-1:]])
    frames = _transported(arriving)
    angle = 2 * math.pi * np.arange(sides) / sides + np.zeros((len(path), 1))
    if closed:
        angle = angle - _turn_of_a_round(ways) * (np.concatenate([[0.0], np.cumsum(lengths)[:-1]]) / lengths.sum())[:, None]
    u = frames[:, None]
    v = np.cross(arriving, frames)[:, None]
    circle = radii[:, None, None] * (np.cos(angle)[..., None] * u + np.sin(angle)[..., None] * v)
    halving = arriving + leaving
    halving /= np.linalg.norm(halving, axis=1)[:, None]
    # Along the arriving segment, until the halving plane.
    reach = -(circle @ halving[:, :, None])[..., 0] / (arriving * halving).sum(axis=1)[:, None]
    return path[:, None] + circle + reach[..., None] * arriving[:, None]


def _perpendicular(way: F64) -> F64:
    """A unit vector perpendicular to a direction, horizontal unless the direction is nearly vertical."""
    side = np.cross(way, (0.0, 1.0, 0.0) if abs(way[1]) < 0.99 else (1.0, 0.0, 0.0))
    return side / np.linalg.norm(side)


def _turn_of_a_round(ways: F64) -> float:
    """The angle by which parallel transport around a closed path turns a frame."""
    frames = _transported(np.concatenate([ways[-1:], ways]))
    first, back = frames[0], frames[-1]
    return math.atan2(float(np.cross(ways[-1], first) @ back), float(first @ back))


def _divided(path: F64, radii: F64) -> tuple[F64, F64]:
    """A closed path with long segments divided, so that the sections turn by little from one to the next."""
    ways, lengths = _legs(path, True)
    turns = abs(_turn_of_a_round(ways)) * lengths / lengths.sum()
    counts = np.maximum(1, np.ceil(turns / MOST_TURN)).astype(int)
    segment = np.repeat(np.arange(len(path)), counts)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[segment]
    after = (segment + 1) % len(path)
    return path[segment] + share[:, None] * (path[after] - path[segment]), radii[segment] + share * (radii[after] - radii[segment])


def _transported(ways: F64) -> F64:
    """(n, 3) vectors perpendicular to directions: each is the one before, turned as the direction turns (Bishop 1975)."""
    normals = [_perpendicular(ways[0])]
    for before, after in itertools.pairwise(ways):
        total = before + after
        # The rotation that takes `before` to `after`, as two reflections.
        last = normals[-1]
        turned = last - total * (2 * (total @ last) / (total @ total))
        turned = turned - after * (turned @ after)
        normals.append(turned / np.linalg.norm(turned))
    return np.array(normals)


def _dome(center: F64, ring: F64, top: F64) -> F64:
    """(k, sides, 3) the rings of a half sphere beyond a ring, which ends in the point center + top."""
    count = max(3, len(ring) // 4)
    up = 0.5 * math.pi * np.arange(1, count + 1) / count
    return center + np.cos(up)[:, None, None] * (ring - center) + np.sin(up)[:, None, None] * top


def _fold(path: F64, rings: F64, ways: F64) -> F64 | None:
    """The first point of a path after which a line along the tube runs backwards: there the bend is tighter than the radius."""
    steps = (np.roll(rings, -1, axis=0) - rings)[: len(ways)]
    forward = np.einsum("nsk,nk->ns", steps, ways).min(axis=1)
    folded = np.flatnonzero(forward < -1e-9 * np.ptp(path, axis=0).max())
    return path[int(folded[0])] if len(folded) else None


def _mesh(rings: F64, v: F64, tips: tuple[bool, bool], capped: bool, closed: bool) -> PolyMesh:
    """The mesh of rings (n, sides, 3) with v (n,). `tips`: the first, the last ring is one point. A closed one repeats its first ring."""
    count, sides = rings.shape[:2]
    vertices = np.arange(count * sides).reshape(count, sides)
    if closed:
        vertices[-1] = vertices[0]
    for end in (0, -1):
        if tips[end]:
            vertices[end] = vertices[end, 0]
    around = np.concatenate([vertices, vertices[:, :1]], axis=1)
    corners = np.stack([around[:-1, :-1], around[:-1, 1:], around[1:, 1:], around[1:, :-1]], axis=2)
    u = np.arange(sides + 1) / sides
    us = np.broadcast_to(np.stack([u[:-1], u[1:], u[1:], u[:-1]], axis=1), corners.shape)
    vs = np.broadcast_to(np.stack([v[:-1], v[:-1], v[1:], v[1:]], axis=1)[:, None], corners.shape)
    uvs = np.stack([us, vs], axis=3)
    faces = Faces()
    inner = slice(1 if tips[0] else 0, count - 2 if tips[1] else count - 1)
    if tips[0]:
        faces.add(corners[0][:, [0, 2, 3]], uvs[0][:, [0, 2, 3]])
    if tips[1]:
        faces.add(corners[-1][:, :3], uvs[-1][:, :3])
    faces.add(corners[inner].reshape(-1, 4), uvs[inner].reshape(-1, 4, 2))
    disk = 0.5 + 0.5 * np.stack([np.cos(2 * math.pi * u[:-1]), np.sin(2 * math.pi * u[:-1])], axis=1)
    for end, order in ((0, slice(None, None, -1)), (-1, slice(None))):
        if capped and not tips[end]:
            faces.add(vertices[end][None, order], disk[None, order])
    return faces.mesh(rings.reshape(-1, 3))
