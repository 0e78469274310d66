"""Shapes in closed form: known hits, points that satisfy their equations, numpy against kernels, and where plain formulas fail."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.render import lanes, shapes, shapes_round
from maquette.render.kernels import kernel

K = ir.GeometryKind
INF = math.inf
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


def table(*rows: list[float]) -> np.ndarray:
    """Geometries.parameters with these rows."""
    made = np.zeros((len(rows), ir.PARAMETERS))
    for k, row in enumerate(rows):
        made[k, : len(row)] = row
    return made


def hit(kind: int, parameters: list[float], origin, direction, t_min: float = 0.0, t_max: float = INF) -> tuple[np.ndarray, np.ndarray]:
    """(t, part) of rays (n, 3) with one shape, by numpy."""
    o, d = np.broadcast_arrays(np.atleast_2d(np.asarray(origin, float)), np.atleast_2d(np.asarray(direction, float)))
    n = np.zeros(len(o))
    with np.errstate(all="ignore"):
        t, part = shapes.intersect(int(kind), table(parameters), 0, tuple(o.T), tuple(d.T), n + t_min, n + t_max)
    return np.broadcast_to(t, n.shape), np.broadcast_to(part, n.shape)


def equation(kind: int, p: list[float], at: np.ndarray, part: np.ndarray) -> np.ndarray:
    """What is 0 on the surface at points (n, 3), in units of length; inside is negative."""
    x, y, z = at.T
    rho = np.hypot(x, z)
    if kind == K.SPHERE:
        return np.linalg.norm(at, axis=1) - p[0]
    if kind == K.BOX:
        side = np.where(part % 2 == 1, 1.0, -1.0) * np.choose(part // 2, [x, y, z])
        return side - np.choose(part // 2, p[:3])
    if kind in (K.PLANE, K.RECTANGLE, K.DISK):
        return y
    if kind in (K.CYLINDER, K.CONE):
        bottom, top, half = (p[0], p[0], p[1]) if kind == K.CYLINDER else p[:3]
        slope = 0.5 * (top - bottom) / half
        side = (rho - (0.5 * (bottom + top) + slope * y)) / math.hypot(1.0, slope)
        return np.choose(part, [side, -half - y, y - half])
    if kind == K.TORUS:
        return np.hypot(rho - p[0], y) - p[1]
    if kind == K.CAPSULE:
        return np.linalg.norm(np.stack([x, y - np.clip(y, -p[1], p[1]), z]), axis=0) - p[0]
    a, b, c, d, e, f, g, h, i, j = p[:10]
    return a * x * x + b * y * y + c * z * z + d * x * y + e * y * z + f * x * z + g * x + h * y + i * z + j


def some_rays(n: int, seed: int, aim: float = 1.2) -> tuple[np.ndarray, np.ndarray]:
    """Rays from round about to places near the middle; directions of any length."""
    rng = np.random.default_rng(seed)
    o = rng.normal(size=(n, 3)) * 3.0
    d = rng.uniform(-aim, aim, size=(n, 3)) - o
    return o, d * rng.uniform(0.1, 3.0, size=(n, 1))


@kernel
def in_kernel(kinds, rows, parameters, o, d, t, part, n, uv):
    for i in range(len(t)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        t[i], part[i] = shapes.intersect(kinds[i], parameters, rows[i], origin, direction, 0.0, np.inf)
        p = lanes.along(origin, direction, t[i])
        n[i, 0], n[i, 1], n[i, 2] = shapes.normal(kinds[i], parameters, rows[i], part[i], p)
        (uv[i, 0], uv[i, 1]), (uv[i, 2], uv[i, 3]) = shapes.uv(kinds[i], parameters, rows[i], part[i], p)


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
    found, which = hit(kind, parameters, origin, direction)
    assert found[0] == pytest.approx(t, rel=1e-12)
    if normal is not None:
        p = np.asarray(origin, float) + found[0] * np.asarray(direction, float)
        n = shapes.normal(int(kind), table(parameters), 0, which[:1], tuple(p[:, None]))
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
        n = np.stack(np.broadcast_arrays(*shapes.normal(int(kind), table(parameters), 0, part, tuple(p.T))), axis=1)
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
    at, count = np.zeros(n), np.zeros(n, int)
    for crossing in range(6):
        t, part = after(kind, parameters, o, d, at)
        found = np.isfinite(t)
        assert np.all(t[found] > at[found])
        with np.errstate(all="ignore"):
            normal = shapes.normal(int(kind), table(parameters), 0, part, tuple((o + t[:, None] * d).T))
        facing = sum(c * d[:, k] for k, c in enumerate(normal)) / np.linalg.norm(d, axis=1)
        clear = found & (np.abs(facing) > 1e-5)
        assert np.all((facing[clear] < 0) == (crossing % 2 == 0))
        count += found
        at = np.where(found, t, INF)
    assert count.max() == {"torus": 4, "apple": 4}.get(name, 2)
    assert not np.any(count % 2), f"{np.sum(count % 2)} rays went in and never came out"


def after(kind: int, parameters: list[float], o: np.ndarray, d: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(t, part) of what rays meet beyond `at`."""
    with np.errstate(all="ignore"):
        t, part = shapes.intersect(int(kind), table(parameters), 0, tuple(o.T), tuple(d.T), at, np.full(len(o), INF))
    return np.broadcast_to(t, at.shape), np.broadcast_to(part, at.shape)


def test_numpy_and_kernels_agree_to_the_last_bit() -> None:
    names = list(SHAPES)
    parameters = table(*(SHAPES[n][1] for n in names))
    rng = np.random.default_rng(5)
    rows = rng.integers(0, len(names), 20000)
    kinds = np.array([int(SHAPES[n][0]) for n in names], np.int32)[rows]
    o, d = some_rays(20000, 6)
    t, part, normal, uv = compiled(kinds, rows, parameters, o, d)
    with np.errstate(all="ignore"):
        t_, part_ = shapes.intersect(kinds, parameters, rows, tuple(o.T), tuple(d.T), 0.0, INF)
        p = tuple((o + t_[:, None] * d).T)
        normal_ = np.stack(shapes.normal(kinds, parameters, rows, part_, p), axis=1)
        (u, v), (du, dv) = shapes.uv(kinds, parameters, rows, part_, p)
    np.testing.assert_array_equal(t, t_)
    seen = np.isfinite(t)
    np.testing.assert_array_equal(part[seen], part_[seen])
    np.testing.assert_allclose(normal[seen], normal_[seen], rtol=0, atol=4e-16)
    np.testing.assert_allclose(uv[seen], np.stack([u, v, du, dv], axis=1)[seen], rtol=1e-14, atol=1e-15)


coordinate = st.floats(-4.0, 4.0, allow_subnormal=False)
special = st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 1.3, 0.7, 1e-300, -1e-12])
number = st.one_of(coordinate, special)


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


# --- where plain formulas fail -------------------------------------------------------------------------------------------


def plain_sphere(o: np.ndarray, d: np.ndarray, radius: float) -> np.ndarray:
    """The school formula: (-b - sqrt(b² - a c)) / a."""
    a, b, c = np.sum(d * d, 1), np.sum(o * d, 1), np.sum(o * o, 1) - radius**2
    with np.errstate(invalid="ignore"):
        return (-b - np.sqrt(b * b - a * c)) / a


def exact_sphere(o, d, radius: float) -> float:
    """The nearer root with rationals and one square root of 60 digits."""
    o, d, r = [Fraction(float(x)) for x in o], [Fraction(float(x)) for x in d], Fraction(radius)
    a, b, c = sum(x * x for x in d), sum(x * y for x, y in zip(o, d, strict=True)), sum(x * x for x in o) - r * r
    discriminant = b * b - a * c
    scale = 10**60
    root = Fraction(math.isqrt(int(discriminant * scale * scale)), scale)
    return float((-b - root) / a)


def test_a_sphere_a_million_radii_away_keeps_its_digits() -> None:
    rng = np.random.default_rng(7)
    n = 500
    aim = rng.uniform(-0.55, 0.55, (n, 3))
    o = np.tile([6e5, -5.5e5, 6e5], (n, 1))
    d = aim - o
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    exact = np.array([exact_sphere(o[k], d[k], 1.0) for k in range(n)])
    distance = np.linalg.norm(o[0])
    ours = np.abs(hit(K.SPHERE, [1.0], o, d)[0] - exact).max()
    naive = np.nanmax(np.abs(plain_sphere(o, d, 1.0) - exact))
    assert ours < 4 * np.spacing(distance)
    assert naive > 1e4 * ours


def test_just_above_a_planet() -> None:
    radius, height = 1e7, 2.0
    o = np.array([[0.0, radius + height, 0.0]])
    d = np.array([[math.sqrt(0.5), -math.sqrt(0.5), 0.0]])
    exact = exact_sphere(o[0], d[0], radius)
    assert exact == pytest.approx(2.8284275, abs=1e-6)
    assert hit(K.SPHERE, [radius], o, d)[0][0] == pytest.approx(exact, rel=1e-8)


def test_roots_of_a_quadratic_whose_roots_differ_by_sixteen_digits() -> None:
    one = np.ones(1)
    with np.errstate(all="ignore"):
        lo, hi = shapes_round._ordered_roots(one, -0.5e8 * one, one, (0.25e16 - 1.0) * one)
    assert hi[0] == pytest.approx(-1e-8, rel=4 * 2 * U)
    assert lo[0] == pytest.approx(-1e8, rel=4 * 2 * U)
    naive = (-1e8 + math.sqrt(1e16 - 4.0)) / 2.0
    assert abs(naive + 1e-8) > 2e-9


@pytest.mark.parametrize(("share", "meets"), [(1 - 2.0**-40, True), (1 + 2.0**-40, False)])
def test_rays_that_barely_touch_or_miss_a_sphere(share: float, meets: bool) -> None:
    t = hit(K.SPHERE, [3.0], (3.0 * share, -20.0, 0.0), (0.0, 1.0, 0.0))[0][0]
    assert np.isfinite(t) == meets
    if meets:
        assert t == pytest.approx(20.0 - 3.0 * math.sqrt(1 - share**2), rel=1e-9)


def test_only_a_ray_along_a_plane_misses_it() -> None:
    t = hit(K.PLANE, [], (0, 1, 0), [(1, -1e-9, 0), (1, -1e-300, 0), (1, 0, 0), (1, -0.0, 0)])[0]
    assert t[0] == pytest.approx(1e9, rel=4 * U)
    assert t[1] == pytest.approx(1e300, rel=4 * U)
    assert t[2] == t[3] == INF


def test_a_thin_torus_from_afar_is_found_where_it_is() -> None:
    rng = np.random.default_rng(8)
    n = 2000
    turn = rng.uniform(0, 2 * np.pi, n)
    ring = np.stack([np.cos(turn), np.zeros(n), np.sin(turn)], axis=1)
    o = rng.normal(size=(n, 3))
    o *= 1e4 / np.linalg.norm(o, axis=1, keepdims=True)
    d = ring - o
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    t, _ = hit(K.TORUS, [1.0, 0.01], o, d)
    assert np.isfinite(t).all()
    p = o + t[:, None] * d
    assert np.abs(equation(K.TORUS, [1.0, 0.01], p, np.zeros(n, int))).max() < 1e-10
    behind, _ = after(K.TORUS, [1.0, 0.01], o, d, t)
    assert np.isfinite(behind).all()  # in and out


def plain_slab(o: np.ndarray, d: np.ndarray, half: np.ndarray) -> np.ndarray:
    """The widely used form: min and max of (±half - o) · (1/d), which a 0 · ∞ poisons."""
    with np.errstate(all="ignore"):
        inverse = 1.0 / d
        a, b = (-half - o) * inverse, (half - o) * inverse
        lo, hi = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        return np.where(lo <= hi, lo, INF)


def test_rays_in_a_face_and_along_the_axes_meet_the_box() -> None:
    half = np.array([1.0, 0.5, 0.8])
    cases = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            for zero in (0.0, -0.0):
                for edge in (-1.0, 1.0):
                    o, d = np.full(3, 0.1), np.full(3, zero)
                    o[(axis + 1) % 3] = edge * half[(axis + 1) % 3]  # in the plane of a face
                    o[axis], d[axis] = -5.0 * sign, sign
                    cases.append((o, d, 5.0 - half[axis]))
    o, d, t = (np.array(column) for column in zip(*cases, strict=True))
    np.testing.assert_array_equal(hit(K.BOX, list(half), o, d)[0], t)
    assert not np.array_equal(plain_slab(o, d, half), t)
    o[:, :] = np.where(d == 0.0, 1.0000001 * np.where(np.abs(o) == half, o, o), o)
    outside = np.abs(o) > half
    beside = np.any(outside & (d == 0.0), axis=1)
    assert beside.all()
    assert np.all(hit(K.BOX, list(half), o, d)[0] == INF)


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
    (u, v), _ = shapes.uv(int(kind), table(parameters), 0, np.array([part]), tuple(np.array([c], float) for c in point))
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
def test_coordinates_stand_where_the_table_says(name: str, point, part: int, uv) -> None:
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
def test_a_unit_of_u_and_v_is_as_long_as_said(name: str, point, part: int, across, up) -> None:
    kind, parameters = SHAPES[name]
    _, (du, dv) = shapes.uv(int(kind), table(parameters), 0, np.array([part]), tuple(np.array([c], float) for c in point))
    h = 1e-7
    for k, (way, length) in enumerate(((across, du), (up, dv))):
        ahead = uv_at(name, np.add(point, np.multiply(way, h)), part)[k]
        behind = uv_at(name, np.subtract(point, np.multiply(way, h)), part)[k]
        assert (ahead - behind) * float(np.ravel(length)[0]) == pytest.approx(2 * h, rel=1e-5)


# --- triangles ---------------------------------------------------------------------------------------------------------------


def moller_trumbore(a, b, c, o, d) -> bool:
    """The common test, without a tolerance."""
    e1, e2 = b - a, c - a
    p = np.cross(d, e2)
    det = e1 @ p
    if det == 0.0:
        return False
    s = o - a
    u = (s @ p) / det
    q = np.cross(s, e1)
    v = (d @ q) / det
    return u >= 0 and v >= 0 and u + v <= 1 and (e2 @ q) / det > 0


def test_weights_of_a_triangle_are_those_of_its_corners() -> None:
    a, b, c = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0]])
    p = 0.2 * a + 0.3 * b + 0.5 * c
    for eye in ([1.0, 2.0, 5.0], [1.0, 2.0, -5.0]):
        o = np.array(eye)
        t, u, v = shapes.triangle(*(tuple(x) for x in (a, b, c, o, 2.0 * (p - o))), 0.0, INF)
        assert (float(t), float(u), float(v)) == pytest.approx((0.5, 0.3, 0.5), rel=1e-14)


def test_no_ray_slips_between_two_triangles() -> None:
    """Rays exactly at the middle of the edge that two triangles share: all places are whole numbers of 31 bits."""
    rng = np.random.default_rng(9)
    n = 3000
    corners = 2.0 * rng.integers(-(2**30), 2**30, size=(n, 4, 3))
    a, b, left, right = (corners[:, k] for k in range(4))
    o = 2.0 * rng.integers(-(2**30), 2**30, size=(n, 3))
    d = 0.5 * (a + b) - o
    sides = [(a, b, left), (b, a, right)]
    hits = [shapes.triangle(*(tuple(x.T) for x in (*side, o, d)), np.zeros(n), np.full(n, INF))[0] < INF for side in sides]
    # the two lie on both sides of the edge as the ray sees it, else a ray beside the edge misses both by right
    across = np.cross(b - a, d)
    opposite = np.sign(np.sum(across * (left - a), 1)) != np.sign(np.sum(across * (right - a), 1))
    leaks = opposite & ~(hits[0] | hits[1])
    assert leaks.sum() == 0
    naive = sum(not any(moller_trumbore(*(x[k] for x in (*side, o, d))) for side in sides) for k in np.flatnonzero(opposite))
    assert naive > 0


def test_a_triangle_without_area_is_never_met() -> None:
    o, d = (0.0, 0.0, 5.0), (0.0, 0.0, -1.0)
    for corners in (((0, 0, 0),) * 3, ((-1, 0, 0), (0, 0, 0), (1, 0, 0))):
        with np.errstate(all="ignore"):
            t, _, _ = shapes.triangle(*(tuple(np.array([float(x)]) for x in c) for c in corners), o, d, 0.0, INF)
        assert t[0] == INF
