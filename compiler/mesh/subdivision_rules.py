"""The rules of one refinement: cages with sharpness, refined values, limit positions and limit normals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..ir import F64, I64

SHARP = 10.0  # infinitely sharp, as in OpenSubdiv
_TRIANGLE_WEIGHT = 0.470  # of a triangle's center at an edge, for smooth triangles (OpenSubdiv, catmarkScheme)


@dataclass(frozen=True, slots=True, eq=False)
class Cage:
    """Faces with their edges. A half-edge is a corner: it runs from its vertex to that of the next corner of the face."""

    indices: I64  # (c,) vertex of each corner
    counts: I64  # (f,)
    vertices: int
    face_of: I64  # (c,) face of each corner
    next: I64  # (c,) next corner of the face
    previous: I64  # (c,)
    edges: I64  # (e, 2) lower and higher vertex, sorted
    edge_of: I64  # (c,) edge of each half-edge
    faces_at_edge: I64  # (e,)
    manifold: np.ndarray  # (e,) whether two half-edges of opposite direction meet
    twin: I64  # (c,) opposite half-edge of manifold edges, else −1
    edge_sharpness: F64  # (e,) 0 … SHARP
    vertex_sharpness: F64  # (n,)

    @classmethod
    def from_faces(cls, indices: I64, counts: I64, vertices: int) -> Cage:
        """The cage of faces, without sharpness."""
        first = np.cumsum(counts) - counts
        corner = np.arange(len(indices))
        following, preceding = corner + 1, corner - 1
        following[first + counts - 1] = first
        preceding[first] = first + counts - 1
        other = indices[following]
        low, high = np.minimum(indices, other), np.maximum(indices, other)
        keys, edge_of = np.unique(low * (vertices + 1) + high, return_inverse=True)
        edges = np.stack([keys // (vertices + 1), keys % (vertices + 1)], axis=1)
        edge_of = edge_of.reshape(-1)
        faces_at_edge = np.bincount(edge_of, minlength=len(keys))
        forward = np.bincount(edge_of[indices == low], minlength=len(keys))
        manifold = (faces_at_edge == 2) & (forward == 1)
        twin = np.full(len(indices), -1)
        order = np.argsort(edge_of, kind="stable")
        order = order[manifold[edge_of[order]]]
        twin[order[0::2]], twin[order[1::2]] = order[1::2], order[0::2]
        face_of = np.repeat(np.arange(len(counts)), counts)
        none = np.where(manifold, 0.0, SHARP)
        soft = np.zeros(vertices)
        return cls(indices, counts, vertices, face_of, following, preceding, edges, edge_of, faces_at_edge, manifold, twin, none, soft)

    def with_sharpness(self, edge: F64, vertex: F64) -> Cage:
        return replace(self, edge_sharpness=edge, vertex_sharpness=vertex)

    def at_vertices(self, rows: I64, values: np.ndarray) -> np.ndarray:
        """Sums (n, k) of values over the vertices that `rows` name."""
        return np.stack([np.bincount(rows, values[:, k], self.vertices) for k in range(values.shape[1])], axis=1)

    def neighbours(self, values: F64, chosen: np.ndarray | None = None) -> F64:
        """Sums (n, k) of the values at the other ends of the edges of each vertex; `chosen` (e,) limits the edges."""
        edges = self.edges if chosen is None else self.edges[chosen]
        return self.at_vertices(edges[:, 0], values[edges[:, 1]]) + self.at_vertices(edges[:, 1], values[edges[:, 0]])

    def valence(self, chosen: np.ndarray | None = None) -> I64:
        """Edges at each vertex; `chosen` (e,) limits them."""
        edges = self.edges if chosen is None else self.edges[chosen]
        return np.bincount(edges.reshape(-1), minlength=self.vertices)

    def boundary_edges(self) -> I64:
        """Boundary edges at each vertex that lie between two values of one mesh edge."""
        return self.valence(~self.manifold) // 2

    def centers(self, values: F64) -> F64:
        """Mean (f, k) of the values at the corners of each face."""
        return np.add.reduceat(values[self.indices], np.cumsum(self.counts) - self.counts, axis=0) / self.counts[:, None]


def _decayed(sharpness: F64) -> F64:
    return np.where(sharpness >= SHARP, SHARP, np.maximum(sharpness - 1.0, 0.0))


def child_cage(cage: Cage, scheme: str) -> Cage:
    """The refined faces. Their vertices are those of the cage, then one an edge, then, without Loop, one a face."""
    n, e = cage.vertices, len(cage.edges)
    on_edge, before = n + cage.edge_of, n + cage.edge_of[cage.previous]
    if "loop" in scheme:
        corners = np.stack([cage.indices, on_edge, before], axis=1).reshape(-1, 3, 3)  # at the three corners of each triangle
        middle = on_edge.reshape(-1, 1, 3)
        indices = np.concatenate([corners, middle], axis=1).reshape(-1)
        child = Cage.from_faces(indices, np.full(len(indices) // 3, 3), n + e)
    else:
        indices = np.stack([cage.indices, on_edge, n + e + cage.face_of, before], axis=1).reshape(-1)
        child = Cage.from_faces(indices, np.full(len(indices) // 4, 4), n + e + len(cage.counts))
    low, high = child.edges.T
    half = (low < n) & (high >= n) & (high < n + e)  # half of an edge of the cage
    edge = np.zeros(len(child.edges))
    edge[half] = _decayed(cage.edge_sharpness)[high[half] - n]
    edge[~child.manifold] = SHARP
    vertex = np.zeros(child.vertices)
    vertex[:n] = _decayed(cage.vertex_sharpness)
    return child.with_sharpness(edge, vertex)


def refine_values(cage: Cage, values: F64, scheme: str, smooth_triangles: bool = False) -> F64:
    """Values (n', k) at the vertices of `child_cage`, from values (n, k)."""
    a, b = values[cage.edges[:, 0]], values[cage.edges[:, 1]]
    middle = (a + b) / 2
    if scheme == "linear loop":
        return np.concatenate([values, middle])
    centers = cage.centers(values)
    if scheme == "bilinear":
        return np.concatenate([values, middle, centers])
    soft = _loop_edges(cage, values, a + b) if scheme == "loop" else _catmull_clark_edges(cage, centers, a + b, smooth_triangles)
    share = np.minimum(cage.edge_sharpness, 1.0)[:, None]
    edges = np.where(share >= 1.0, middle, share * middle + (1.0 - share) * soft)
    vertices = _vertices(cage, values, _smooth_vertices(cage, values, centers, middle, scheme))
    return np.concatenate([vertices, edges] if scheme == "loop" else [vertices, edges, centers])


def _catmull_clark_edges(cage: Cage, centers: F64, ends: F64, smooth_triangles: bool) -> F64:
    """Smooth edge points: the mean of the ends and of the two face points, or by the weights of smooth triangles."""
    of_faces = np.stack([np.bincount(cage.edge_of, c, len(cage.edges)) for c in centers[cage.face_of].T], axis=1)
    weight = np.full(len(cage.edges), 0.25)
    if smooth_triangles:
        face_weight = np.where(cage.counts == 3, _TRIANGLE_WEIGHT, 0.25)
        weight = np.bincount(cage.edge_of, face_weight[cage.face_of], len(cage.edges)) / np.maximum(cage.faces_at_edge, 1)
    return weight[:, None] * of_faces + (0.5 - weight)[:, None] * ends


def _loop_edges(cage: Cage, values: F64, ends: F64) -> F64:
    opposite = values[cage.indices[cage.previous]]
    of_faces = np.stack([np.bincount(cage.edge_of, c, len(cage.edges)) for c in opposite.T], axis=1)
    return 0.375 * ends + 0.125 * of_faces


def _smooth_vertices(cage: Cage, values: F64, centers: F64, middle: F64, scheme: str) -> F64:
    n = np.maximum(cage.valence(), 1)[:, None]
    if scheme == "loop":
        beta = _loop_beta(n)
        return (1 - n * beta) * values + beta * cage.neighbours(values)
    faces = np.maximum(np.bincount(cage.indices, minlength=cage.vertices), 1)[:, None]
    of_faces = cage.at_vertices(cage.indices, centers[cage.face_of]) / faces
    of_edges = (cage.at_vertices(cage.edges[:, 0], middle) + cage.at_vertices(cage.edges[:, 1], middle)) / n
    return (of_faces + 2 * of_edges + (n - 3) * values) / n


def _loop_beta(n: np.ndarray) -> F64:
    return (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / n)) ** 2) / n


def _ruled(cage: Cage, values: F64, smooth: F64, edge: F64, vertex: F64) -> tuple[F64, I64]:
    """Vertices by the rule of the sharpness of edges and vertices, and the rule: 0 smooth, 1 crease, 2 corner."""
    sharp = edge > 0
    count = cage.valence(sharp)
    rule = np.where((vertex > 0) | (count > 2), 2, np.where(count == 2, 1, 0))
    crease = 0.75 * values + 0.125 * cage.neighbours(values, sharp)
    return np.where((rule == 2)[:, None], values, np.where((rule == 1)[:, None], crease, smooth)), rule


def _vertices(cage: Cage, values: F64, smooth: F64) -> F64:
    """Vertex points; where the rule changes with the decay of sharpness, a mixture of both rules (DeRose, Kass and Truong)."""
    edge, vertex = cage.edge_sharpness, cage.vertex_sharpness
    now, rule = _ruled(cage, values, smooth, edge, vertex)
    later_edge, later_vertex = _decayed(edge), _decayed(vertex)
    after, next_rule = _ruled(cage, values, smooth, later_edge, later_vertex)
    ends_edge, ends_vertex = (edge > 0) & (later_edge == 0), (vertex > 0) & (later_vertex == 0)
    total = np.where(ends_vertex, vertex, 0.0) + cage.at_vertices(cage.edges[:, 0], np.where(ends_edge, edge, 0.0)[:, None])[:, 0]
    total = total + cage.at_vertices(cage.edges[:, 1], np.where(ends_edge, edge, 0.0)[:, None])[:, 0]
    share = np.minimum(total / np.maximum(ends_vertex + cage.valence(ends_edge), 1), 1.0)
    share = np.where(rule == next_rule, 1.0, share)[:, None]
    return share * now + (1.0 - share) * after


def limit_positions(cage: Cage, values: F64, scheme: str) -> F64:
    """Values (n, k) at the limit of refinement, of a cage of quads or, for Loop, of triangles. Sharp edges stay sharp."""
    n = np.maximum(cage.valence(), 1)[:, None]
    if scheme == "loop":
        omega = 1.0 / (n + 0.375 / _loop_beta(n))
        smooth = (1 - n * omega) * values + omega * cage.neighbours(values)
    else:
        across = cage.at_vertices(cage.indices, values[cage.indices[cage.next[cage.next]]])
        smooth = (n * n * values + 4 * cage.neighbours(values) + across) / (n * (n + 5))
    sharp = cage.edge_sharpness > 0
    count = cage.valence(sharp)
    crease = (4 * values + cage.neighbours(values, sharp)) / 6
    corner = (cage.vertex_sharpness > 0) | (count > 2)
    limit = np.where(corner[:, None], values, np.where((count == 2)[:, None], crease, smooth))
    return np.where((cage.valence() > 0)[:, None], limit, values)


def limit_normals(cage: Cage, points: F64, scheme: str) -> F64:
    """Unit normals (c, 3) at corners. At vertices without sharp edges, those of the limit surface, from its two tangents."""
    sharp = cage.valence(cage.edge_sharpness > 0)
    smooth = (sharp == 0) & (cage.vertex_sharpness == 0) & (cage.valence() >= 3)
    normals = np.zeros((cage.vertices, 3))
    rows = np.flatnonzero(smooth)
    outgoing = np.full(cage.vertices, -1)
    outgoing[cage.indices] = np.arange(len(cage.indices))
    half, n = outgoing[rows], cage.valence()[rows]
    first, second = np.zeros((len(rows), 3)), np.zeros((len(rows), 3))
    turn = 2 * np.pi / n
    scale = 1 + np.cos(turn) + np.cos(turn / 2) * np.sqrt(2 * (9 + np.cos(turn)))
    for k in range(int(n.max(initial=0))):
        on = np.flatnonzero(k < n)
        h, angle = half[on], turn[on] * k
        edge = points[cage.indices[cage.next[h]]]
        for tangent, wave in ((first, np.cos), (second, np.sin)):
            if scheme == "loop":
                tangent[on] += wave(angle)[:, None] * edge
            else:
                face = points[cage.indices[cage.next[cage.next[h]]]]
                tangent[on] += (scale[on] * wave(angle))[:, None] * edge + (wave(angle) + wave(angle + turn[on]))[:, None] * face
        half[on] = cage.twin[cage.previous[h]]
    normals[rows] = np.cross(first, second)
    at_corners = normals[cage.indices]
    weak = np.linalg.norm(at_corners, axis=1) <= 1e-30
    at_corners[weak] = _side_normals(cage, limit_positions(cage, points, scheme))[weak]
    length = np.linalg.norm(at_corners, axis=1, keepdims=True)
    return at_corners / np.where(length > 0, length, 1.0)


def _side_normals(cage: Cage, points: F64) -> F64:
    """Sums (c, 3) of the faces' normals over the corners of a vertex that no sharp edge separates."""
    corner, after, before = (points[cage.indices[rows]] for rows in (np.arange(len(cage.indices)), cage.next, cage.previous))
    normal = np.cross(after - corner, before - corner)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    angle = np.arctan2(length[:, 0], np.einsum("ij,ij->i", after - corner, before - corner))
    normal = normal / np.where(length > 0, length, 1.0) * angle[:, None]
    # A half-edge and the one after its twin start at one vertex, on both sides of their edge.
    linked = np.flatnonzero((cage.twin >= 0) & (cage.edge_sharpness[cage.edge_of] <= 0))
    first, second = linked, cage.next[cage.twin[linked]]
    label = np.arange(len(cage.indices))
    while True:
        low = np.minimum(label[first], label[second])
        if (low == label[first]).all() and (low == label[second]).all():
            break
        np.minimum.at(label, first, low)
        np.minimum.at(label, second, low)
    return np.stack([np.bincount(label, normal[:, k], len(label)) for k in range(3)], axis=1, dtype=np.float64)[label]
