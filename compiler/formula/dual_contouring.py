"""Dual contouring of implicit surfaces: triangles that keep sharp edges and corners, on cells that interval bounds leave.

A cell gets a vertex for each piece of surface in it, where the planes of the surface at its edges' roots meet best (Ju and others,
"Dual Contouring of Hermite Data", SIGGRAPH 2002); pieces are told apart as the loops of the cell's edges (Nielson, "Dual Marching Cubes",
Visualization 2004), so that two sheets in one cell stay two. Two cells between whose vertices two edges would lie in the same place decide
otherwise on the face that they share (Wenger, "Isosurfaces", 2013, 5.4), so that every edge has two triangles.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import numpy_interpreter
from .tape import Tape

BLOCK = 8  # cells along an axis of the first blocks that are bounded
BISECTIONS = 44
FLATTEST = 0.1  # of the largest eigenvalue: along axes with less a vertex stays at the mean of its roots
LEAST, MOST = 16, 256  # cells along the longest axis
_BATCH = 1 << 18
_LOOKED_AT, _HALVINGS = 1024, 12  # points per batch of the refined deviation, and its halvings
_BEYOND = (1.0001, 1.01, 1.1)  # of the Newton step towards the surface
_OFFSETS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Contour(NamedTuple):
    """Triangles of a surface, counter-clockwise from outside, with their distance from it to first order."""

    positions: Floats  # (n, 3)
    triangles: Ints  # (m, 3)
    normals: Floats  # (n, 3) of the field
    furthest: float
    mean: float
    missing: float = 0.0  # size of the cells that miss thinner parts; 0 if none were found, or searched for


def within(tape: Tape, bounds: Floats, tolerance: float, most: int = MOST, complete: bool = False) -> Contour:
    """The surface in a box, with cells halved until its deviation is at most `tolerance`.

    With `complete` also until no part is found between the corners of cells. At most `most` cells lie along the longest axis.
    """
    count = LEAST
    while True:
        surface = contour(tape, bounds, count, complete)
        if (surface.furthest <= tolerance and surface.missing == 0.0) or 2 * count > most:
            return surface
        count *= 2


def contour(tape: Tape, bounds: Floats, count: int, complete: bool = False) -> Contour:
    """The surface in a box (2, 3), with `count` cells along its longest axis."""
    extent = bounds[1] - bounds[0]
    size = float(extent.max()) / count
    shape = np.ceil(extent / size - 1e-9).astype(np.int64) + 2  # one more cell on each side
    low = bounds.mean(axis=0) - 0.5 * size * shape
    grid = _Grid(low, size, shape)
    cells = _cells(tape, grid)
    nothing = Contour(np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3)), 0.0, 0.0)
    if not len(cells):
        return nothing
    corners = cells[:, None, :] + _OFFSETS
    codes, index = np.unique(grid.number(corners.reshape(-1, 3)), return_inverse=True)
    inside = _field(tape, grid.place(grid.cell(codes))) <= 0
    pattern = (inside[index.reshape(-1, 8)] << np.arange(8)).sum(axis=1)
    mixed = (pattern != 0) & (pattern != 255)
    missing = size if complete and _is_missing(tape, grid, cells, pattern, mixed) else 0.0
    cells, pattern = cells[mixed], pattern[mixed]
    if not len(cells):
        return nothing._replace(missing=missing)
    loops = _loop_tables()[_is_otherwise(grid, cells, pattern).astype(np.int64), pattern]
    edges = _Edges(tape, grid, cells, loops)
    vertices, vertex_of = _vertices(tape, grid, cells, loops, edges)
    triangles = _triangles(grid, cells, edges, vertex_of, vertices)
    _, gradient = numpy_interpreter.gradients(tape, *vertices.T)
    length = np.linalg.norm(gradient, axis=0)
    with np.errstate(all="ignore"):
        normals = np.where((length > 0) & np.isfinite(length), gradient / length, np.array([[0.0], [1.0], [0.0]])).T
    furthest, mean = deviation(tape, vertices, triangles)
    beyond = max(float((vertices.min(axis=0) - edges.root.min(axis=0)).max()), float((edges.root.max(axis=0) - vertices.max(axis=0)).max()))
    furthest = max(furthest, beyond)
    return Contour(vertices, triangles, normals, furthest, mean, missing)


class _Grid(NamedTuple):
    low: Floats
    size: float
    shape: Ints  # cells along each axis

    def number(self, corner: Ints) -> Ints:
        """An integer for each corner (n, 3)."""
        return (corner[:, 0] * (self.shape[1] + 1) + corner[:, 1]) * (self.shape[2] + 1) + corner[:, 2]

    def cell(self, number: Ints) -> Ints:
        first, z = np.divmod(number, self.shape[2] + 1)
        x, y = np.divmod(first, self.shape[1] + 1)
        return np.stack([x, y, z], axis=1)

    def place(self, corner: NDArray) -> Floats:
        return self.low + self.size * corner


def _field(tape: Tape, points: Floats) -> Floats:
    parts = [numpy_interpreter.points(tape, *points[k : k + _BATCH].T)[0] for k in range(0, len(points), _BATCH)]
    return np.concatenate(parts) if parts else np.zeros(0)


def _cells(tape: Tape, grid: _Grid) -> Ints:
    """Cells (n, 3) that may contain a part of the surface."""
    blocks = -(-grid.shape // BLOCK)
    cells = np.stack(np.meshgrid(*map(np.arange, blocks), indexing="ij"), axis=-1).reshape(-1, 3) * BLOCK
    size = BLOCK
    while True:
        keep = [_may_hold(tape, grid, cells[k : k + _BATCH], size) for k in range(0, len(cells), _BATCH)]
        cells = cells[np.concatenate(keep)] if keep else cells
        if size == 1 or not len(cells):
            return cells
        size //= 2
        cells = (cells[:, None, :] + size * _OFFSETS).reshape(-1, 3)
        cells = cells[(cells < grid.shape).all(axis=1)]


def _may_hold(tape: Tape, grid: _Grid, cells: Ints, size: int) -> NDArray[np.bool_]:
    slack = 1e-9 * grid.size
    (least, most), _, maybe = numpy_interpreter.boxes(tape, (grid.place(cells) - slack).T, (grid.place(cells + size) + slack).T)
    return (least <= 0) & (~(most < 0) | maybe)


def _is_missing(tape: Tape, grid: _Grid, cells: Ints, pattern: Ints, mixed: NDArray[np.bool_]) -> bool:
    """Whether a cell without a sign change at its corners, nor its neighbours', has one inside: searched along the gradient."""
    near = np.zeros(grid.shape + 2, bool)
    near[tuple(cells[mixed].T + 1)] = True
    for axis in range(3):
        layers = np.moveaxis(near, axis, 0)
        layers[1:-1] = layers[:-2] | layers[1:-1] | layers[2:]
    lone = ~near[tuple(cells.T + 1)]
    cells, inside = cells[lone], pattern[lone] != 0
    for first in range(0, len(cells), _BATCH):
        low, high = (grid.place(cells[first : first + _BATCH] + k) for k in (0, 1))
        middle = 0.5 * (low + high)
        value, gradient = numpy_interpreter.gradients(tape, *middle.T)
        with np.errstate(all="ignore"):
            step = np.nan_to_num((value / (gradient**2).sum(axis=0) * gradient).T, posinf=0.0, neginf=0.0)
        for share in _BEYOND:
            other = (_field(tape, np.clip(middle - share * step, low, high)) <= 0) != inside[first : first + _BATCH]
            if other.any():
                return True
    return False


# --- the pieces of surface in a cell ------------------------------------------------------------------------------------

# Edges of a cell: 4 · axis + index, between corners that differ in that axis alone.
_ENDS = [(a, a | 1 << axis) for axis in range(3) for a in range(8) if not a >> axis & 1]
_AXIS = np.array([axis for axis in range(3) for a in range(8) if not a >> axis & 1])


_EDGE_OF = {frozenset(ends): k for k, ends in enumerate(_ENDS)}
_FACES = [[c for c in range(8) if (c >> axis & 1) == side] for axis in range(3) for side in range(2)]


def _loops(otherwise: bool) -> Ints:
    """(256, 12) for each pattern of inside corners, the surface component of each edge; -1 without one.

    On a face with four roots the edges at each corner inside go together, or `otherwise` those at each corner outside: both cells that
    share the face decide alike.
    """
    table = np.full((256, 12), -1, np.int64)
    for pattern in range(256):
        crossed = [k for k, (a, b) in enumerate(_ENDS) if (pattern >> a & 1) != (pattern >> b & 1)]
        joined: dict[int, list[int]] = {k: [] for k in crossed}
        for face in _FACES:
            face_edges = [k for k in crossed if _ENDS[k][0] in face and _ENDS[k][1] in face]
            pairs = [tuple(face_edges)] if len(face_edges) == 2 else []
            if len(face_edges) == 4:
                corners = [c for c in face if (pattern >> c & 1) != otherwise]
                pairs = [tuple(_EDGE_OF[frozenset((c, d))] for d in face if frozenset((c, d)) in _EDGE_OF) for c in corners]
            for first, second in pairs:
                joined[first].append(second)
                joined[second].append(first)
        piece = 0
        for start in crossed:
            if table[pattern, start] < 0:
                waiting = [start]
                while waiting:
                    k = waiting.pop()
                    if table[pattern, k] < 0:
                        table[pattern, k] = piece
                        waiting.extend(joined[k])
                piece += 1
    return table


@cache
def _loop_tables() -> Ints:
    """(2, 256, …): both tables of `_loops`."""
    return np.stack([_loops(False), _loops(True)])


@cache
def _joined() -> NDArray[np.bool_]:
    """(256, 6) whether all four roots of a face belong to one component; such a pattern has a single face of four roots."""
    table = np.zeros((256, 6), bool)
    for k, face in enumerate(_FACES):
        edges = [edge for pair, edge in _EDGE_OF.items() if pair <= set(face)]
        pieces = _loop_tables()[0][:, edges]
        table[:, k] = (pieces >= 0).all(axis=1) & (pieces == pieces[:, :1]).all(axis=1)
    return table



def _is_otherwise(grid: _Grid, cells: Ints, pattern: Ints) -> NDArray[np.bool_]:
    """(n,) whether a cell shares an ambiguous face with a cell whose roots there also belong to one component."""
    otherwise, codes = np.zeros(len(cells), bool), grid.number(cells)
    order = np.argsort(codes)
    for axis in range(3):
        mine = np.flatnonzero(_joined()[pattern, 2 * axis + 1])
        next_ = grid.number(cells[mine] + np.eye(3, dtype=np.int64)[axis])
        other = order[np.minimum(np.searchsorted(codes[order], next_), len(order) - 1)]
        both = (codes[other] == next_) & _joined()[pattern[other], 2 * axis]
        otherwise[mine[both]] = otherwise[other[both]] = True
    return otherwise


class _Edges:
    """The grid edges that the surface crosses: their roots, normals, and the cell edges that they are."""

    def __init__(self, tape: Tape, grid: _Grid, cells: Ints, loops: Ints) -> None:
        cell, edge = np.nonzero(loops >= 0)
        begin = cells[cell] + _OFFSETS[[a for a, _ in _ENDS]][edge]
        self.codes, self.index = np.unique(grid.number(begin) * 3 + _AXIS[edge], return_inverse=True)
        self.cell, self.edge = cell, edge
        self.begin, self.axis = grid.cell(self.codes // 3), self.codes % 3
        a, b = grid.place(self.begin), grid.place(self.begin + np.eye(3, dtype=np.int64)[self.axis])
        self.rising = _field(tape, a) <= 0  # inside at its beginning
        for _ in range(BISECTIONS):
            middle = 0.5 * (a + b)
            same = ((_field(tape, middle) <= 0) == self.rising)[:, None]
            a, b = np.where(same, middle, a), np.where(same, b, middle)
        self.root = 0.5 * (a + b)
        _, gradient = numpy_interpreter.gradients(tape, *np.where(self.rising[:, None], a, b).T)  # on the side where it is defined
        length = np.linalg.norm(gradient, axis=0)
        with np.errstate(all="ignore"):
            self.normal = np.where((length > 0) & np.isfinite(length), gradient / length, 0.0).T


def _vertices(tape: Tape, grid: _Grid, cells: Ints, loops: Ints, edges: _Edges) -> tuple[Floats, Ints]:
    """(positions, the vertex of each (cell, edge) of `edges`)."""
    pieces = loops.max(axis=1) + 1
    first = np.cumsum(pieces) - pieces
    vertex_of = first[edges.cell] + loops[edges.cell, edges.edge]
    count = int(pieces.sum())
    root, normal = edges.root[edges.index], edges.normal[edges.index]
    number = np.bincount(vertex_of, minlength=count)
    middle = np.stack([np.bincount(vertex_of, root[:, k], count) for k in range(3)], axis=1) / number[:, None]
    apart = ((root - middle[vertex_of]) * normal).sum(axis=1)
    matrix = np.zeros((count, 3, 3))
    right = np.zeros((count, 3))
    for i in range(3):
        right[:, i] = np.bincount(vertex_of, normal[:, i] * apart, count)
        for j in range(3):
            matrix[:, i, j] = np.bincount(vertex_of, normal[:, i] * normal[:, j], count)
    values, vectors = np.linalg.eigh(matrix)
    used = values > FLATTEST * values[:, -1:]
    inverse = np.where(used, 1.0 / np.where(used, values, 1.0), 0.0)
    moved = np.einsum("nij,nj,nkj,nk->ni", vectors, inverse, vectors, right)
    owner = np.repeat(cells, pieces, axis=0)
    low, high = grid.place(owner), grid.place(owner + 1)
    vertices = np.clip(middle + moved, low, high)
    vertices = _nearer(tape, vertices, low, high, 2)
    sharp = used.sum(axis=1) > 1  # where the planes of curved faces do not meet in a point of the surface
    vertices[sharp] = _nearer(tape, vertices[sharp], low[sharp], high[sharp], 4)
    return vertices, vertex_of


def _nearer(tape: Tape, points: Floats, low: Floats, high: Floats, steps: int) -> Floats:
    """Points moved onto the surface by Newton's method, within their cells. Steps go to the face of which a point is farthest outside,
    so that several end on an edge of the surface."""
    for _ in range(steps):
        value, gradient = numpy_interpreter.gradients(tape, *points.T)
        with np.errstate(all="ignore"):
            step = (value / (gradient**2).sum(axis=0) * gradient).T
        points = np.where(np.isfinite(step).all(axis=1)[:, None], np.clip(points - step, low, high), points)
    return points


def _triangles(grid: _Grid, cells: Ints, edges: _Edges, vertex_of: Ints, vertices: Floats) -> Ints:
    """Two triangles around each edge that four cells share."""
    around = np.full((len(edges.codes), 4), -1, np.int64)
    other = np.array([[1, 2], [2, 0], [0, 1]])[edges.axis[edges.index]]  # u, v with axis = u × v
    offset = edges.begin[edges.index] - cells[edges.cell]
    u, v = (np.take_along_axis(offset, other[:, k : k + 1], axis=1)[:, 0] for k in range(2))
    turn = np.where(v == 1, np.where(u == 1, 0, 1), np.where(u == 1, 3, 2))  # cells (-u -v), (+u -v), (+u +v), (-u +v)
    around[edges.index, turn] = vertex_of
    complete = (around >= 0).all(axis=1)
    quads, rising = around[complete], edges.rising[complete]
    quads = np.where(rising[:, None], quads, quads[:, ::-1])
    p = vertices[quads]
    wanted = np.where(rising, 1.0, -1.0)[:, None] * np.eye(3)[edges.axis[complete]]

    def flatness(cut: int) -> Floats:
        """Agreement of the normals of the two triangles of a diagonal, with the wanted side."""
        a, b, c, d = (p[:, (cut + k) % 4] for k in range(4))
        first, second = np.cross(b - a, c - a), np.cross(c - a, d - a)
        lengths = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
        alike = (first * second).sum(axis=1) / np.where(lengths > 0, lengths, 1.0)
        return alike + np.minimum((first * wanted).sum(axis=1), 0.0) + np.minimum((second * wanted).sum(axis=1), 0.0)

    swap = flatness(1) > flatness(0) + 1e-9
    quads = np.where(swap[:, None], np.roll(quads, -1, axis=1), quads)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return triangles[distinct]


# --- quality -----------------------------------------------------------------------------------------------------


def deviation(tape: Tape, positions: Floats, triangles: Ints) -> tuple[float, float]:
    """(largest, mean) distance of the corners, and of the centres of triangles and edges, from the surface, to first order.

    A nearer change of sign replaces it: where a formula jumps, the gradient does not apply.
    """
    if not len(triangles):
        return 0.0, 0.0
    corners = positions[triangles]
    used, first = np.unique(triangles, return_index=True)
    sides = 0.5 * (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3)
    places = np.concatenate([corners.mean(axis=1), sides, positions[used]])
    value, gradient = numpy_interpreter.gradients(tape, *places.T)
    with np.errstate(all="ignore"):
        off = np.abs(value) / np.linalg.norm(gradient, axis=0)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    normals = np.concatenate([normals, np.repeat(normals, 3, axis=0), normals[first // 3]])
    finite = np.flatnonzero(np.isfinite(off))
    order, furthest = finite[np.argsort(-off[finite], kind="stable")], 0.0
    for first in range(0, len(order), _LOOKED_AT):  # the largest first, until no other can be larger
        part = order[first : first + _LOOKED_AT]
        if off[part[0]] <= furthest:
            break
        off[part] = _to_change(tape, places[part], normals[part], off[part])
        furthest = max(furthest, float(off[part].max()))
    off = off[finite]
    return (float(off.max()), float(off.mean())) if len(off) else (0.0, 0.0)


def _to_change(tape: Tape, places: Floats, normals: Floats, off: Floats) -> Floats:
    """Distance of a change of sign along normals and axes, within a factor of two; `off` if there is none nearer."""
    inside, distance = _field(tape, places) <= 0, off
    for k in range(_HALVINGS):
        size = off * 0.5**k
        for way in (normals, *np.eye(3)):
            for step in (size[:, None] * way, -size[:, None] * way):
                distance = np.where((_field(tape, places + step) <= 0) != inside, size, distance)
    return distance


def open_edges(triangles: Ints) -> int:
    """Edges that do not have one triangle on either side: 0 for a closed mesh."""
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    n = int(triangles.max(initial=0)) + 1
    forward, counts = np.unique(sides[:, 0] * n + sides[:, 1], return_counts=True)
    back = np.unique(sides[:, 1] * n + sides[:, 0])
    return int((counts != 1).sum() + len(np.setdiff1d(forward, back, assume_unique=True)))
