"""Shapes in closed form: known hits, points that satisfy their equations, and numpy against kernels.

Cases where plain formulas fail are in tests/stability."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.render.geometry import analytic_shapes
from maquette.render.jit.kernel import kernel
from maquette.render.lanes import ops

from ..closed import INF, K, after, equation, hit, table

U = 2.0**-53

SHAPES = {
    "sphere": (K.SPHERE, [1.3]),
    "box": (K.BOX, [1.0, 0.5, 0.8]),
    "plane": (K.PLANE, []),
    "rectangle": (K.RECTANGLE, [1.0, 2.0]),
    "disk": (K.DISK, [1.5]),
    "cylinder": (K.CYLINDER, [1.0, 0.7, 1.0]),
    "tube": (K.CYLINDER, [1.0, 0.7, 0.0]),
    "cone": (K.CONE, [1.0, 0.0, 0.7, 1.0]),
    "open cone": (K.CONE, [0.2, 1.0, 0.7, 0.0]),
    "frustum": (K.CONE, [0.3, 1.0, 0.7, 1.0]),
    "torus": (K.TORUS, [1.0, 0.3]),
    "thin torus": (K.TORUS, [1.0, 0.01]),
    "apple": (K.TORUS, [0.5, 0.8]),
    "capsule": (K.CAPSULE, [0.5, 0.8]),
    "hyperboloid": (K.QUADRIC, [1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2, 1, 1, 1]),
    "ellipsoid with mixed terms": (K.QUADRIC, [2, 1, 3, 0.5, -0.4, 0.3, 0.1, 0.2, -0.3, -1, INF, INF, INF]),
}
SOLIDS = ["sphere", "box", "cylinder", "cone", "frustum", "torus", "thin torus", "apple", "capsule", "ellipsoid with mixed terms"]


def some_rays(n: int, seed: int, aim: float = 1.2) -> tuple[np.ndarray, np.ndarray]:
    """Rays from all around to points near the center; directions of any length."""
    rng = np.random.default_rng(seed)
    o = rng.normal(size=(n, 3)) * 3.0
    d = rng.uniform(-aim, aim, size=(n, 3)) - o
    return o, d * rng.uniform(0.1, 3.0, size=(n, 1))


@kernel
def in_kernel(kinds, rows, parameters, o, d, t, part, n, uv):
    for i in range(len(t)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        t[i], part[i] = analytic_shapes.intersect(kinds[i], parameters, rows[i], origin, direction, 0.0, np.inf)
        p = ops.along(origin, direction, t[i])
        n[i, 0], n[i, 1], n[i, 2] = analytic_shapes.normal(kinds[i], parameters, rows[i], part[i], p)
        (uv[i, 0], uv[i, 1]), (uv[i, 2], uv[i, 3]) = analytic_shapes.uv(kinds[i], parameters, rows[i], part[i], p)


def compiled(kinds: np.ndarray, rows: np.ndarray, parameters: np.ndarray, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, ...]:
    n = len(o)
    t, part, normal, uv = np.empty(n), np.empty(n, np.int64), np.empty((n, 3)), np.empty((n, 4))
    in_kernel(kinds, rows, parameters, o, d, t, part, normal, uv)
    return t, part, normal, uv


@pytest.mark.parametrize(
    ("name", "origin", "direction", "t", "part", "normal"),
    [
        ("sphere", (0, 0, 5), (0, 0, -1), 3.7, 0, (0, 0, 1)),
        ("sphere", (0, 0, 0), (0, 2, 0), 0.65, 0, (0, 1, 0)),
        ("box", (5, 0.1, 0.2), (-2, 0, 0), 2.0, 1, (1, 0, 0)),
        ("box", (0, 0, 0), (0, -1, 0), 0.5, 2, (0, -1, 0)),
        ("box", (0.3, 0.2, -3), (0, 0, 1), 2.2, 4, (0, 0, -1)),
        ("plane", (7, 2, 3), (0, -1, 1), 2.0, 0, (0, 1, 0)),
        ("plane", (7, 2, 3), (0, 1, 1), INF, 0, None),
        ("rectangle", (0.9, -1, 1.9), (0, 1, 0), 1.0, 0, (0, 1, 0)),
        ("rectangle", (1.1, -1, 1.9), (0, 1, 0), INF, 0, None),
        ("disk", (1.1, 1, 1), (0, -1, 0), 1.0, 0, (0, 1, 0)),
        ("disk", (1.1, 1, 1.1), (0, -1, 0), INF, 0, None),
        ("cylinder", (0, 0.5, 4), (0, 0, -1), 3.0, 0, (0, 0, 1)),
        ("cylinder", (0.5, 3, 0.5), (0, -1, 0), 2.3, 2, (0, 1, 0)),
        ("cylinder", (0.5, 0, 0.5), (0, -1, 0), 0.7, 1, (0, -1, 0)),
        ("cylinder", (0, 0.8, 4), (0, 0, -1), INF, 0, None),
        ("tube", (0.5, 3, 0.5), (0, -1, 0), INF, 0, None),
        ("tube", (0, 3, 0), (0.5, -2, 0), 2.0 - 0.0, 0, None),
        ("cone", (0, -3, 0.2), (0, 1, 0), 2.3, 1, (0, -1, 0)),
        ("cone", (0, 0, 4), (0, 0, -1), 3.5, 0, (0, 0.7 / math.hypot(0.7, 0.5) * 0.5 / 0.7, 0.7 / math.hypot(0.7, 0.5))),
        ("frustum", (0, 3, 0.9), (0, -1, 0), 2.3, 2, (0, 1, 0)),
        ("torus", (5, 0, 0), (-1, 0, 0), 3.7, 0, (1, 0, 0)),
        ("torus", (0, 0, 0), (-1, 0, 0), 0.7, 0, (1, 0, 0)),
        ("torus", (1, 5, 0), (0, -1, 0), 4.7, 0, (0, 1, 0)),
        ("torus", (0, 5, 0), (0, -1, 0), INF, 0, None),
        ("thin torus", (1, 1e4, 0), (0, -1, 0), 1e4 - 0.01, 0, (0, 1, 0)),
        ("capsule", (0, 5, 0), (0, -1, 0), 3.7, 0, (0, 1, 0)),
        ("capsule", (3, 0.4, 0), (-1, 0, 0), 2.5, 0, (1, 0, 0)),
        ("hyperboloid", (0, 0, 3), (0, 0, -1), 3 - math.sqrt(0.2), 0, (0, 0, 1)),
        ("hyperboloid", (0, 0.95, 3), (0, 0, -1), 3 + math.sqrt(0.2 + 0.95**2), 0, None),
    ],
)
def test_known_hits(name, origin, direction, t, part, normal) -> None:
    kind, parameters = SHAPES[name]
    if name == "hyperboloid" and normal is None:  # beyond its box both roots are cut away
        t = INF
    if name == "tube" and direction == (0.5, -2, 0):  # in by the open top, out by the open bottom
        t = INF
    distance, which = hit(kind, parameters, origin, direction)
    assert distance[0] == pytest.approx(t, rel=1e-12)
    if normal is not None:
        p = np.asarray(origin, float) + distance[0] * np.asarray(direction, float)
        n = analytic_shapes.normal(int(kind), table(parameters), 0, which[:1], tuple(p[:, None]))
        assert which[0] == part
        np.testing.assert_allclose(np.stack(np.broadcast_arrays(*n))[:, 0], normal, atol=1e-9)


def test_a_range_without_the_nearest_root_gives_the_next() -> None:
    assert hit(K.SPHERE, [1.0], (0, 0, 3), (0, 0, -1), t_min=2.5)[0][0] == 4.0
    assert hit(K.SPHERE, [1.0], (0, 0, 3), (0, 0, -1), t_max=1.5)[0][0] == INF
    assert hit(K.SPHERE, [1.0], (0, 0, 3), (0, 0, -1), t_min=2.0)[0][0] == 4.0  # the ends are not in the range


@pytest.mark.parametrize("name", SHAPES)
def test_hits_satisfy_their_equations_and_normals_are_their_gradients(name: str) -> None:
    kind, parameters = SHAPES[name]
    o, d = some_rays(4000, 1)
    t, part = hit(kind, parameters, o, d)
    seen = np.isfinite(t)
    assert 50 < seen.sum() < 4000 or kind == K.PLANE
    p, part = (o + t[:, None] * d)[seen], part[seen]
    size = np.abs(o).max()
    assert np.abs(equation(kind, parameters, p, part)).max() < 64 * U * size * (8 if kind == K.QUADRIC else 1)
    with np.errstate(all="ignore"):
        n = np.stack(np.broadcast_arrays(*analytic_shapes.normal(int(kind), table(parameters), 0, part, tuple(p.T))), axis=1)
    step = 1e-6
    slope = [equation(kind, parameters, p + step * e, part) - equation(kind, parameters, p - step * e, part) for e in np.eye(3)]
    gradient = np.stack(slope, axis=1)
    np.testing.assert_allclose(n, gradient / np.linalg.norm(gradient, axis=1, keepdims=True), atol=3e-6)


@pytest.mark.parametrize("name", SOLIDS)
def test_a_ray_leaves_what_it_enters(name: str) -> None:
    kind, parameters = SHAPES[name]
    rng = np.random.default_rng(2)
    n = 3000
    o = rng.normal(size=(n, 3))
    o *= 30.0 / np.linalg.norm(o, axis=1, keepdims=True)
    d = rng.uniform(-0.9, 0.9, o.shape) - o
    start, count = np.zeros(n), np.zeros(n, int)
    for crossing in range(6):
        t, part = after(kind, parameters, o, d, start)
        is_hit = np.isfinite(t)
        assert np.all(t[is_hit] > start[is_hit])
        with np.errstate(all="ignore"):
            normal = analytic_shapes.normal(int(kind), table(parameters), 0, part, tuple((o + t[:, None] * d).T))
        facing = sum(c * d[:, k] for k, c in enumerate(normal)) / np.linalg.norm(d, axis=1)
        clear = is_hit & (np.abs(facing) > 1e-5)
        assert np.all((facing[clear] < 0) == (crossing % 2 == 0))
        count += is_hit
        start = np.where(is_hit, t, INF)
    assert count.max() == {"torus": 4, "apple": 4}.get(name, 2)
    assert not np.any(count % 2), f"{np.sum(count % 2)} rays went in and never came out"


@pytest.mark.long
def test_numpy_and_kernels_agree_to_the_last_bit() -> None:
    names = list(SHAPES)
    parameters = table(*(SHAPES[n][1] for n in names))
    rng = np.random.default_rng(5)
    rows = rng.integers(0, len(names), 20000)
    kinds = np.array([int(SHAPES[n][0]) for n in names], np.int32)[rows]
    o, d = some_rays(20000, 6)
    t, part, normal, uv = compiled(kinds, rows, parameters, o, d)
    with np.errstate(all="ignore"):
        t_, part_ = analytic_shapes.intersect(kinds, parameters, rows, tuple(o.T), tuple(d.T), 0.0, INF)
        p = tuple((o + t_[:, None] * d).T)
        normal_ = np.stack(analytic_shapes.normal(kinds, parameters, rows, part_, p), axis=1)
        (u, v), (du, dv) = analytic_shapes.uv(kinds, parameters, rows, part_, p)
    np.testing.assert_array_equal(t, t_)
    seen = np.isfinite(t)
    np.testing.assert_array_equal(part[seen], part_[seen])
    np.testing.assert_allclose(normal[seen], normal_[seen], rtol=0, atol=4e-16)
    np.testing.assert_allclose(uv[seen], np.stack([u, v, du, dv], axis=1)[seen], rtol=1e-14, atol=1e-15)


coordinate = st.floats(-4.0, 4.0, allow_subnormal=False)
special = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 1.3, 0.7, 1e-300, -1e-12])
number = st.one_of(coordinate, special)


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(st.sampled_from(sorted(SHAPES)), st.tuples(number, number, number), st.tuples(number, number, number))
def test_any_ray_gives_a_hit_in_range_or_none_alike_in_both(name: str, origin, direction) -> None:
    kind, parameters = SHAPES[name]
    d = np.array([direction], float)
    if not np.any(d):
        return
    o = np.array([origin], float)
    t, part = hit(kind, parameters, o, d)
    assert t[0] > 0.0  # not NaN, and behind the origin is not in range
    kinds, rows = np.array([int(kind)], np.int32), np.array([0])
    t_, part_, *_ = compiled(kinds, rows, table(parameters), o, d)
    assert t[0] == t_[0]
    assert t[0] == INF or part[0] == part_[0]


@pytest.mark.parametrize("name", SHAPES)
def test_directions_with_zeros_give_what_their_neighbours_give(name: str) -> None:
    kind, parameters = SHAPES[name]
    for axis in range(3):
        for sign in (1.0, -1.0):
            o = np.full((1, 3), 0.137)
            o[0, axis] = -3.0 * sign
            exact, near = np.zeros((1, 3)), np.full((1, 3), 1e-13)
            exact[0, axis] = near[0, axis] = sign
            negative = exact.copy()
            negative[negative == 0.0] = -0.0
            t = [hit(kind, parameters, o, d)[0][0] for d in (exact, negative, near)]
            assert t[0] == t[1]
            if np.isfinite(t[0]) or kind not in (K.PLANE, K.RECTANGLE, K.DISK):
                assert t[0] == pytest.approx(t[2], rel=1e-9)


# --- surface coordinates ---------------------------------------------------------------------------------------------------


def uv_at(name: str, point, part: int = 0) -> tuple[float, float]:
    kind, parameters = SHAPES[name]
    (u, v), _ = analytic_shapes.uv(int(kind), table(parameters), 0, np.array([part]), tuple(np.array([c], float) for c in point))
    return float(u[0]), float(v[0])


@pytest.mark.parametrize(
    ("name", "point", "part", "uv"),
    [
        ("sphere", (0, 0, 1.3), 0, (0.5, 0.5)),
        ("sphere", (1.3, 0, 0), 0, (0.75, 0.5)),
        ("sphere", (0, -1.3, 1e-9), 0, (0.5, 0.0)),
        ("sphere", (0, 1.3, 1e-9), 0, (0.5, 1.0)),
        ("box", (-1, -0.5, 0.8), 5, (0, 0)),
        ("box", (1, 0.5, 0.8), 5, (1, 1)),
        ("box", (1, -0.5, 0.8), 1, (0, 0)),
        ("box", (1, -0.5, -0.8), 4, (0, 0)),
        ("box", (-1, -0.5, -0.8), 0, (0, 0)),
        ("box", (-1, 0.5, 0.8), 3, (0, 0)),
        ("box", (-1, -0.5, -0.8), 2, (0, 0)),
        ("plane", (2.5, 0, -3.0), 0, (2.5, 3.0)),
        ("rectangle", (-1, 0, 2), 0, (0, 0)),
        ("disk", (0, 0, -1.5), 0, (0.5, 1.0)),
        ("cylinder", (1, 0.7, 0), 0, (0.75, 1.0)),
        ("cylinder", (0, 0.7, -1), 2, (0.5, 1.0)),
        ("cylinder", (0, -0.7, -1), 1, (0.5, 0.0)),
        ("torus", (0, 0, 1.3), 0, (0.5, 0.5)),
        ("torus", (0, 0.3, 1.0), 0, (0.5, 0.75)),
        ("capsule", (0, -1.3, 1e-12), 0, (0.5, 0.0)),
        ("capsule", (0, 1.3, 1e-12), 0, (0.5, 1.0)),
    ],
)
def test_coordinates_match_the_table(name: str, point, part: int, uv) -> None:
    assert uv_at(name, point, part) == pytest.approx(uv, abs=1e-8)


@pytest.mark.parametrize(
    ("name", "point", "part", "across", "up"),
    [
        ("sphere", (0, 0, 1.3), 0, (1, 0, 0), (0, 1, 0)),
        ("box", (1, 0.1, 0.1), 1, (0, 0, -1), (0, 1, 0)),
        ("box", (0.2, 0.5, 0.1), 3, (1, 0, 0), (0, 0, -1)),
        ("plane", (3, 0, 4), 0, (1, 0, 0), (0, 0, -1)),
        ("rectangle", (0.3, 0, 0.4), 0, (1, 0, 0), (0, 0, -1)),
        ("disk", (0.3, 0, 0.4), 0, (1, 0, 0), (0, 0, -1)),
        ("cylinder", (0, 0.2, 1), 0, (1, 0, 0), (0, 1, 0)),
        ("cone", (0, -0.7, 1.0), 0, (1, 0, 0), (0, 1.4 / math.hypot(1.4, 1.0), -1.0 / math.hypot(1.4, 1.0))),
        ("torus", (0, 0, 1.3), 0, (1, 0, 0), (0, 1, 0)),
        ("capsule", (0, 0.1, 0.5), 0, (1, 0, 0), (0, 1, 0)),
    ],
)
def test_units_of_u_and_v_have_their_length(name: str, point, part: int, across, up) -> None:
    kind, parameters = SHAPES[name]
    _, (du, dv) = analytic_shapes.uv(int(kind), table(parameters), 0, np.array([part]), tuple(np.array([c], float) for c in point))
    h = 1e-7
    for k, (way, length) in enumerate(((across, du), (up, dv))):
        ahead = uv_at(name, np.add(point, np.multiply(way, h)), part)[k]
        behind = uv_at(name, np.subtract(point, np.multiply(way, h)), part)[k]
        assert (ahead - behind) * float(np.ravel(length)[0]) == pytest.approx(2 * h, rel=1e-5)


# --- triangles ---------------------------------------------------------------------------------------------------------------


def test_weights_of_a_triangle_are_those_of_its_corners() -> None:
    a, b, c = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0]])
    p = 0.2 * a + 0.3 * b + 0.5 * c
    for eye in ([1.0, 2.0, 5.0], [1.0, 2.0, -5.0]):
        o = np.array(eye)
        t, u, v = analytic_shapes.triangle(*(tuple(x) for x in (a, b, c, o, 2.0 * (p - o))), 0.0, INF)
        assert (float(t), float(u), float(v)) == pytest.approx((0.5, 0.3, 0.5), rel=1e-14)


