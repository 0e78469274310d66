"""Whether triangles bound a volume: closed, wound one way, crossing themselves; Euler number, bodies, and moments, by trimesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..formula.dual_contouring import open_edges
from ..ir import F64, I64

MOST_CROSSED = 500_000  # triangles of a mesh that is searched for crossings
_MOST_PAIRS = 40_000_000
_MARGIN = 1e-6  # of the extent: a vertex nearer to a plane is on it; positions are in single precision
FLAT_TURN = 1e-6  # radians between the normals of triangles in one plane, at most
CREASE = 0.7  # radians between normals from which an edge is sharp: twelve chords round a circle turn by 0.52
_MOST_BODIES = 256  # that are searched for others in them


class Topology(NamedTuple):
    """What the edges of a mesh say of it. Points at one place are one vertex."""

    triangles: int
    open_edges: int  # edges that do not have two triangles, or have them in one direction
    watertight: bool  # each edge has two triangles
    wound: bool  # neighbours go along their edge in opposite directions
    euler_number: int  # vertices - edges + triangles
    bodies: int  # parts that share no vertex

    @property
    def closed(self) -> bool:
        """Whether it bounds a volume, but for crossings."""
        return self.watertight and self.wound


class Moments(NamedTuple):
    """Of a closed mesh of density 1; the volume is negative if its triangles face inwards."""

    volume: F64
    center: F64  # (3,)
    inertia: F64  # (3, 3) about the center


def merged(positions: F64, triangles: I64) -> tuple[F64, I64]:
    """The mesh with one vertex for equal positions, without triangles that lose a side by that."""
    places, index = np.unique(positions, axis=0, return_inverse=True)
    faces = index.reshape(-1)[triangles]
    return places, faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def topology(positions: F64, triangles: I64) -> Topology:
    """The topology of merged triangles (m, 3)."""
    import trimesh

    if not len(triangles):
        return Topology(0, 0, False, False, 0, 0)
    mesh = trimesh.Trimesh(positions, triangles, process=False, validate=False)
    label = connected_vertices(len(positions), triangles)
    bodies = len(np.unique(label[triangles[:, 0]]))
    return Topology(
        len(triangles), open_edges(triangles), mesh.is_watertight, mesh.is_winding_consistent, mesh.euler_number, bodies
    )


def moments(positions: F64, triangles: I64) -> Moments:
    """Volume, center and inertia of a closed mesh, from the middle of its box; nan without a volume."""
    import trimesh.triangles

    origin = 0.5 * (positions.min(axis=0) + positions.max(axis=0))
    with np.errstate(all="ignore"):
        properties = trimesh.triangles.mass_properties((positions - origin)[triangles])
    return Moments(np.asarray(properties.volume), origin + properties.center_mass, np.asarray(properties.inertia))


class Turns(NamedTuple):
    """How the normals of a mesh turn at its edges."""

    total: float  # sum of length times angle over the edges: the area that a layer of thickness 1 over the mesh gains (Steiner's formula)
    round_area: float  # of triangles at an edge whose angle is neither 0 nor that of a crease


def turns(positions: F64, triangles: I64) -> Turns:
    """The turns of merged triangles (m, 3). An edge that does not have two triangles counts as a turn of a radian."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(cross, axis=1)
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    order = np.lexsort(sides.T)
    sides, owner = sides[order], np.tile(np.arange(len(triangles)), 3)[order]
    first = np.flatnonzero(np.concatenate([[True], (sides[1:] != sides[:-1]).any(axis=1)]))
    count = np.diff(np.append(first, len(sides)))
    length = np.linalg.norm(positions[sides[first, 0]] - positions[sides[first, 1]], axis=1)
    a, b = owner[first], owner[np.minimum(first + 1, len(sides) - 1)]  # the triangles of each edge
    sine, cosine = np.linalg.norm(np.cross(cross[a], cross[b]), axis=1), np.einsum("ij,ij->i", cross[a], cross[b])
    angle = np.where(count == 2, np.arctan2(sine, cosine), 1.0)
    smooth = (count == 2) & (angle > FLAT_TURN) & (angle < CREASE)
    rounded = np.zeros(len(triangles), bool)
    rounded[a[smooth]] = rounded[b[smooth]] = True
    return Turns(float((length * angle).sum()), float(area[rounded].sum()))


def connected_vertices(count: int, triangles: np.ndarray) -> I64:
    """(count,) the least vertex of each vertex's connected part, by label propagation with shortcuts.

    The vertices of a row of `triangles` are connected; it may have another number of columns than three.
    """
    label = np.arange(count)
    while True:
        least = label[triangles].min(axis=1)
        new = label.copy()
        for k in range(triangles.shape[1]):
            np.minimum.at(new, triangles[:, k], least)
        while not np.array_equal(new, new[new]):
            new = new[new]
        if np.array_equal(new, label):
            return label
        label = new


# --- crossings ------------------------------------------------------------------------------------------------------------


def crossings(positions: F64, triangles: I64) -> int | None:
    """Triangles that an edge of another one passes through; None of a mesh with too many triangles to search."""
    if not len(triangles):
        return 0
    if len(triangles) > MOST_CROSSED:
        return None
    pairs = _overlapping(positions[triangles])
    if pairs is None:
        return None
    a, b = pairs
    shared = (triangles[a][:, :, None] == triangles[b][:, None, :]).any(axis=2).sum(axis=1)
    a, b = a[shared < 2], b[shared < 2]
    margin = _MARGIN * float(np.ptp(positions, axis=0).max(initial=0.0))
    hit = np.concatenate([t[_passes(positions[triangles[s]], positions[triangles[t]], margin)] for s, t in ((a, b), (b, a))])
    return len(np.unique(hit))


def _overlapping(corners: F64) -> tuple[I64, I64] | None:
    """Pairs of triangles whose boxes overlap, each once: pairs of nodes of a binary tree over Morton order, a level at a time."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(_morton(0.5 * (low + high)), kind="stable")
    depth = max(int(np.ceil(np.log2(max(len(order), 1)))), 0)
    boxes = np.full((2**depth, 2, 3), [[np.inf] * 3, [-np.inf] * 3])
    boxes[: len(order), 0], boxes[: len(order), 1] = low[order], high[order]
    levels = [boxes]
    while len(levels[-1]) > 1:
        pair = levels[-1].reshape(-1, 2, 2, 3)
        levels.append(np.stack([pair[:, :, 0].min(axis=1), pair[:, :, 1].max(axis=1)], axis=1))
    a = b = np.zeros(1, np.int64)
    for level in reversed(levels[:-1]):
        a, b = (np.concatenate([2 * a + i for i, _ in _CHILDREN]), np.concatenate([2 * b + j for _, j in _CHILDREN]))
        a, b = a[a <= b], b[a <= b]
        near = (level[a, 0] <= level[b, 1]).all(axis=1) & (level[b, 0] <= level[a, 1]).all(axis=1)
        a, b = a[near], b[near]
        if len(a) > _MOST_PAIRS:
            return None
    a, b = a[a < b], b[a < b]
    return order[a], order[b]


_CHILDREN = ((0, 0), (0, 1), (1, 0), (1, 1))


def _morton(points: F64) -> I64:
    """(n,) codes of points (n, 3) on a grid of 1024 cells along each axis."""
    low, extent = points.min(axis=0, initial=np.inf), np.ptp(points, axis=0) if len(points) else np.ones(3)
    cells = np.minimum((points - low) / np.where(extent > 0, extent, 1.0) * 1024, 1023).astype(np.int64)
    bits = np.arange(10)
    return (((cells[:, :, None] >> bits) & 1) << (3 * bits + np.arange(3)[:, None])).sum(axis=(1, 2))


def _passes(edges: F64, faces: F64, margin: float) -> np.ndarray:
    """(n,) whether an edge of triangles (n, 3, 3) passes through the inside of the triangle beside it in `faces`."""
    a, u, v = faces[:, 0], faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]
    normal = np.cross(u, v)
    length = np.linalg.norm(normal, axis=1)
    flat = length <= 0.0
    unit = normal / np.where(flat, 1.0, length)[:, None]
    height = np.einsum("nkc,nc->nk", edges - a[:, None], unit)
    passes = np.zeros(len(faces), bool)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        across = (np.minimum(height[:, i], height[:, j]) < -margin) & (np.maximum(height[:, i], height[:, j]) > margin) & ~flat
        rows = np.flatnonzero(across)
        share = (height[rows, i] / (height[rows, i] - height[rows, j]))[:, None]
        point = edges[rows, i] + share * (edges[rows, j] - edges[rows, i]) - a[rows]
        s = np.einsum("nc,nc->n", np.cross(point, v[rows]), normal[rows]) / length[rows] ** 2
        t = np.einsum("nc,nc->n", np.cross(u[rows], point), normal[rows]) / length[rows] ** 2
        passes[rows] |= (s > _MARGIN) & (t > _MARGIN) & (s + t < 1.0 - _MARGIN)
    return passes


def counted_twice(positions: F64, triangles: I64) -> int:
    """Bodies of a closed mesh without crossings in which others lie that face the same way, or hollows that lie in none.

    A body that faces outwards lies in the open, and a hollow in one body: by the winding number of the others about a point of it. Of more
    than 256 bodies only the first are looked at.
    """
    label = connected_vertices(len(positions), triangles)[triangles[:, 0]]
    bodies = np.unique(label)[:_MOST_BODIES]
    if len(bodies) < 2:
        return 0
    wrong = 0
    for body in bodies.tolist():
        of_body = label == body
        corners = positions[triangles[of_body]]
        a, b, c = (corners[:, k] - corners[0, 0] for k in range(3))
        outward = float(np.einsum("ij,ij->", a, np.cross(b, c))) > 0.0
        around = round(winding_number(positions[triangles[~of_body]] - corners[0].mean(axis=0)))
        wrong += around != (0 if outward else 1)
    return wrong


def winding_number(corners: F64) -> float:
    """Winding number of closed triangles (m, 3, 3) about the origin (van Oosterom and Strackee 1983)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    x, y, z = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = x * y * z + np.einsum("ij,ij->i", a, b) * z + np.einsum("ij,ij->i", b, c) * x + np.einsum("ij,ij->i", c, a) * y
    return float(np.arctan2(above, below).sum() / (2 * np.pi))
