"""Tessellated shapes are watertight, within the tolerance and convergent, with exact normals and uv."""

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.render.geometry import analytic_shapes
from maquette.render.tessellation import analytic_shapes as tessellation_analytic_shapes
from maquette.shapes import quadric_triangles, surfaces

K = ir.GeometryKind
BALL = [1, 1, 1, 0, 0, 0, 0, 0, 0, -1, 1.3, 1.3, 1.3]
HYPERBOLOID = [1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2, 1, 0.8, 1]
SHAPES = {
    "sphere": (K.SPHERE, [1.7]),
    "box": (K.BOX, [1.0, 2.0, 0.5]),
    "rectangle": (K.RECTANGLE, [1.0, 2.0]),
    "disk": (K.DISK, [1.2]),
    "cylinder": (K.CYLINDER, [0.7, 1.5, 1]),
    "open cylinder": (K.CYLINDER, [0.7, 1.5, 0]),
    "cone": (K.CONE, [1.0, 0.0, 0.8, 1]),
    "truncated cone": (K.CONE, [0.4, 1.0, 0.8, 1]),
    "torus": (K.TORUS, [1.0, 0.3]),
    "spindle torus": (K.TORUS, [0.3, 0.5]),
    "capsule": (K.CAPSULE, [0.5, 0.9]),
    "quadric ball": (K.QUADRIC, BALL),
    "hyperboloid": (K.QUADRIC, HYPERBOLOID),
    "ball without a box": (K.QUADRIC, [*BALL[:10], math.inf, math.inf, math.inf]),
}
CLOSED = ["sphere", "box", "cylinder", "cone", "truncated cone", "torus", "spindle torus", "capsule", "quadric ball", "ball without a box"]
TOLERANCE = 2e-3


def made(name: str, tolerance: float = TOLERANCE) -> surfaces.Tessellation:
    kind, parameters = SHAPES[name]
    return tessellation_analytic_shapes.tessellate(kind, parameters, tolerance)


def corners(mesh: surfaces.Tessellation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    assert (mesh.positions[:, 3] == 1).all()
    a, b, c = (mesh.positions[mesh.triangles[:, k], :3] for k in range(3))
    return a, b, c


def welded_edges(mesh: surfaces.Tessellation) -> tuple[np.ndarray, np.ndarray]:
    """The directed edges between distinct positions (bit for bit), and the number of triangles with each."""
    _, point = np.unique(mesh.positions, axis=0, return_inverse=True)
    t = point.ravel()[mesh.triangles]
    directed = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    return np.unique(directed, axis=0, return_counts=True)


@pytest.mark.parametrize("name", CLOSED)
def test_closed_shapes_are_watertight(name):
    """Two triangles share every edge, in opposite directions."""
    edges, counts = welded_edges(made(name))
    assert (counts == 1).all()
    assert {tuple(e) for e in edges.tolist()} == {tuple(e) for e in edges[:, ::-1].tolist()}


@pytest.mark.parametrize("name", ["open cylinder", "disk", "rectangle", "hyperboloid"])
def test_open_shapes_have_only_their_rims_open(name):
    mesh = made(name)
    edges, counts = welded_edges(mesh)
    assert (counts == 1).all()
    both = {tuple(e) for e in edges.tolist()}
    rim = [e for e in both if (e[1], e[0]) not in both]
    points = np.unique(mesh.positions, axis=0)[np.unique(np.array(rim))][:, :3]
    p = SHAPES[name][1]
    on_rim = {
        "open cylinder": lambda: np.isclose(abs(points[:, 1]), p[1], atol=1e-12),
        "disk": lambda: np.isclose(np.hypot(points[:, 0], points[:, 2]), p[0], atol=1e-12),
        "rectangle": lambda: (abs(points[:, 0]) == p[0]) | (abs(points[:, 2]) == p[1]),
        "hyperboloid": lambda: (abs(abs(points) - p[10:]) < 1e-12).any(axis=1),
    }[name]()
    assert len(rim) > 3
    assert on_rim.all()


def distance(name: str, p: np.ndarray) -> np.ndarray:
    """The distance of points from the true surface, in closed form (to first order for the hyperboloid)."""
    kind, q = SHAPES[name]
    x, y, z = p.T
    rho = np.hypot(x, z)
    if kind == K.SPHERE:
        return abs(np.linalg.norm(p, axis=1) - q[0])
    if kind == K.BOX:
        return abs((abs(p) - q).max(axis=1))
    if kind in (K.RECTANGLE, K.DISK):
        return abs(y)
    if kind in (K.CYLINDER, K.CONE):
        low, high, half = (q[0], q[0], q[1]) if kind == K.CYLINDER else q[:3]
        side = abs(rho - (low + (high - low) * (y + half) / (2 * half))) * 2 * half / math.hypot(2 * half, high - low)
        return np.minimum(side, abs(abs(y) - half)) if q[-1] else side
    if kind == K.TORUS:
        return abs(np.hypot(rho - q[0], y) - q[1])
    if kind == K.CAPSULE:
        return abs(np.hypot(rho, y - np.clip(y, -q[1], q[1])) - q[0])
    homogeneous = np.append(p, np.ones((len(p), 1)), axis=1)
    matrix = quadric_triangles.matrix(q)
    value = np.einsum("ni,ij,nj->n", homogeneous, matrix, homogeneous)
    return abs(value) / np.linalg.norm(2 * homogeneous @ matrix[:, :3], axis=1)


@pytest.mark.parametrize("tolerance", [2e-2, 2e-3])
@pytest.mark.parametrize("name", SHAPES)
def test_triangles_keep_the_tolerance(name, tolerance):
    a, b, c = corners(made(name, tolerance))
    weights = np.random.default_rng(3).dirichlet([1, 1, 1], 12)
    for w in (*weights, (1 / 3, 1 / 3, 1 / 3), (0.5, 0.5, 0), (0, 0.5, 0.5), (0.5, 0, 0.5)):
        assert distance(name, w[0] * a + w[1] * b + w[2] * c).max() <= tolerance * 1.01 + 1e-12
    assert distance(name, np.concatenate([a, b, c])).max() < 1e-12


@pytest.mark.parametrize("name", SHAPES)
def test_normals_and_coordinates_are_the_shape_s(name):
    """At points just inside each corner of each triangle, so that seams, poles and creases lie on a known side."""
    kind, parameters = SHAPES[name]
    mesh = made(name)
    row = np.zeros((1, ir.PARAMETERS))
    row[0, : len(parameters)] = parameters
    p = mesh.positions[mesh.triangles, :3]
    inner = 0.999 * p + 0.001 * p.mean(axis=1, keepdims=True)
    x, y, z = inner.reshape(-1, 3).T
    part = np.repeat(mesh.parts, 3).astype(np.int64)
    g = np.zeros(len(part), np.int64)
    with np.errstate(all="ignore"):
        normal = np.stack(analytic_shapes.normal(g + kind, row, g, part, (x, y, z)), axis=1)
        (u, v), _ = analytic_shapes.uv(g + kind, row, g, part, (x, y, z))
    ours = mesh.normals[mesh.triangles].reshape(-1, 3)
    assert abs(np.linalg.norm(ours, axis=1) - 1).max() < 1e-12
    pole = np.hypot(*p.reshape(-1, 3)[:, [0, 2]].T) < 1e-9  # within a triangle at a pole the direction of the radius is any
    angle = np.linalg.norm(normal - ours, axis=1)
    assert angle[~pole].max() < 2e-3
    uvs = mesh.uvs[mesh.triangles].reshape(-1, 2)
    assert abs(v - uvs[:, 1])[~pole].max() < 2e-3
    wraps = kind == K.QUADRIC  # wraps on purpose: u + 1 beyond its seam
    off = abs(u - uvs[:, 0])
    assert (np.minimum(off, abs(off - 1)) if wraps else off)[~pole].max() < 2e-3


@pytest.mark.parametrize("name", CLOSED)
def test_triangles_face_outside(name):
    a, b, c = corners(made(name))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
    mesh = made(name)
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), mesh.normals[mesh.triangles].sum(axis=1))
    assert (facing > 0).all()


VOLUMES = {
    "sphere": 4 / 3 * math.pi * 1.7**3,
    "box": 8.0,
    "cylinder": math.pi * 0.49 * 3,
    "cone": math.pi / 3 * 1.6,
    "truncated cone": math.pi * 1.6 / 3 * (0.16 + 0.4 + 1),
    "torus": 2 * math.pi**2 * 0.09,
    "capsule": math.pi * 0.25 * 1.8 + 4 / 3 * math.pi * 0.125,
    "quadric ball": 4 / 3 * math.pi,
}
AREAS = {
    "sphere": 4 * math.pi * 1.7**2,
    "box": 8 * (2 + 1 + 0.5),
    "rectangle": 8.0,
    "disk": math.pi * 1.44,
    "open cylinder": 2 * math.pi * 0.7 * 3,
    "torus": 4 * math.pi**2 * 0.3,
    "capsule": 2 * math.pi * 0.5 * 1.8 + math.pi,
    "quadric ball": 4 * math.pi,
}


@pytest.mark.parametrize("name", VOLUMES)
def test_volume_converges_from_inside(name):
    def volume(tolerance: float) -> float:
        a, b, c = corners(made(name, tolerance))
        return np.einsum("ij,ij->", a, np.cross(b, c)) / 6

    coarse, fine = VOLUMES[name] - volume(1e-2), VOLUMES[name] - volume(1e-3)
    assert abs(fine) <= 3e-3 * VOLUMES[name]
    if name != "box":
        assert abs(fine) < 0.25 * abs(coarse)
    if name not in ("box", "torus"):  # convex and round: inscribed
        assert 0 < fine < coarse


@pytest.mark.parametrize("name", AREAS)
def test_area_converges(name):
    a, b, c = corners(made(name, 5e-4))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert area == pytest.approx(AREAS[name], rel=3e-3)


def test_a_silhouette_is_short_by_four_thirds_of_the_tolerance():
    """An inscribed n-gon's area is short by (2π/n)²/6 of the circle's, its sagitta is (π/n)²/2 of the radius: 4/3 of that."""
    tolerance = 1e-3
    a, b, c = corners(tessellation_analytic_shapes.tessellate(K.DISK, [1.0], tolerance))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert 0.8 * 4 / 3 * tolerance < 1 - area / math.pi <= 4 / 3 * tolerance * 1.001


def test_segments_are_capped():
    assert surfaces.segments(1.0, 1e-30) == surfaces.MAX_SEGMENTS
    assert surfaces.segments(1.0, 5.0) == surfaces.MIN_SEGMENTS
    assert surfaces.segments(0.0, 1.0) == surfaces.MIN_SEGMENTS


def test_planes_reach_to_infinity():
    mesh = tessellation_analytic_shapes.tessellate(K.PLANE, [], 1.0)
    assert (mesh.positions[:, 3] == [1, 0, 0, 0, 0]).all()
    assert len(mesh.triangles) == 4
