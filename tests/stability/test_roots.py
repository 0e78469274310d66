"""Places 1 to 6: far spheres and near planets, roots that cancel, tangents, grazing planes, thin rings; and quadrics."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene import transforms
from maquette.shapes import lanes

from ..render.closed import INF, K, after, equation, hit
from ..render.geometry.test_analytic_shapes import SHAPES
from ..render.tables import matrix, rays, scene
from ..render.tracing import trace_kernels
from . import exact, naive

U = 2.0**-53
ENDLESS = [INF, INF, INF]


def first_hits(tables: ir.Tables, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(t, unit directions) through the trees."""
    ray = rays(o, d)
    return trace_kernels(tables, ray)[0], np.stack(ray.direction, axis=1)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


# --- 1: a far sphere -------------------------------------------------------------------------------------------------------


def far_sphere(distance: float, radius: float, centre: np.ndarray, seed: int) -> dict[str, float]:
    """Errors of the naive formulas and ours in t, and the shares that the naive ones miss, for rays to a sphere far away."""
    random = np.random.default_rng(seed)
    toward = unit(random.normal(size=(300, 3)))
    o = centre + toward * distance
    side = random.normal(size=o.shape)
    side = unit(side - toward * np.sum(side * toward, axis=1, keepdims=True))
    off = np.sqrt(random.uniform(0, 0.9, 300))[:, None]  # of the radius, by which a ray passes the centre
    t, d = first_hits(scene([(K.SPHERE, [radius], matrix(centre), 0)]), o, centre + radius * off * side - o)
    true = np.array([float(exact.sphere(o[k], d[k], centre, radius) or math.nan) for k in range(300)])
    tangent = np.sqrt(1 - off[:, 0] ** 2)  # how squarely the sphere is met: rounding along it counts that much more
    plain = {kind: naive.sphere(o - centre, d, radius, kind) for kind in (np.float32, np.float64)}
    return {
        "missed by f32": float(np.mean(np.isnan(plain[np.float32]))),
        "missed by f64": float(np.mean(np.isnan(plain[np.float64]))),
        "f32": float(np.nanmax(np.abs(plain[np.float32] - true))),
        "f64": float(np.nanmax(np.abs(plain[np.float64] - true))),
        "ours": float(np.max(np.abs(t - true))),
        "ulps": float(np.max(np.abs(t - true) * tangent) / np.spacing(distance)),
    }


@pytest.mark.parametrize(("distance", "radius"), [(1e3, 1.0), (1e6, 1.0), (1e9, 1.0), (3e7, 40.0), (1e4, 1e-3)])
@pytest.mark.parametrize("at_home", [True, False])
def test_a_far_sphere(measured, distance, radius, at_home):
    centre = np.zeros(3) if at_home else np.random.default_rng(2).normal(size=3) * distance
    found = far_sphere(distance, radius, centre, seed=1)
    if (distance, at_home) == (1e6, True):
        measured.place(
            1, "a sphere of radius 1 seen from 10⁶",
            naive=f"f32 misses {found['missed by f32']:.0%}, off by up to {found['f32']:.3g}; f64 off by {found['f64']:.2g}",
            ours=f"off by {found['ours']:.2g}", bound="4 ulp of the distance, over the cosine at the hit",
        )  # fmt: skip
    assert found["f64"] > 100 * found["ours"]
    assert found["ulps"] <= 4


def residual(name: str, distance: float, seed: int) -> tuple[float, int, float]:
    """(how far from the surface, in ulp of the distance, the worst hit lies; hits; the same of a naive cone) for rays from afar.

    The shape is turned and placed anywhere.
    """
    kind, parameters = SHAPES[name]
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    place = matrix(0.7 * distance * unit(random.normal(size=3)), turn)
    o = place[:3, 3] + distance * unit(random.normal(size=(1000, 3)))
    angle = random.uniform(0, 2 * np.pi, 1000)
    on_ring = parameters[0] * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1) if kind == K.TORUS else None
    local = random.uniform(-0.5, 0.5, (1000, 3)) if on_ring is None else on_ring
    ray = rays(o, place[:3, 3] + local @ turn.T - o)
    t, _, part, *_ = trace_kernels(scene([(kind, parameters, place, 0)]), ray)
    met = np.isfinite(t)
    long_o, long_d = (np.stack(v, axis=1)[met].astype(np.longdouble) for v in (ray.origin, ray.direction))
    p = ((long_o + t[met, None] * long_d - place[:3, 3]) @ turn.astype(np.longdouble)).astype(np.float64)
    plain = math.nan
    if kind == K.CONE:
        bottom, top, half = parameters[:3]
        local_o, local_d = ((np.stack(v, axis=1)[met] - w) @ turn for v, w in ((ray.origin, place[:3, 3]), (ray.direction, 0.0)))
        both = naive.cone(local_o, local_d, 0.5 * (bottom + top), 0.5 * (top - bottom) / half)
        sides = np.nanmin(np.abs(both - t[met, None]), axis=1)[part[met] == 0]  # a side's t is one of the two
        plain = float(np.max(sides) / np.spacing(distance))
    return float(np.abs(equation(kind, parameters, p, part[met])).max() / np.spacing(distance)), int(met.sum()), plain


CONES = ("cone", "open cone", "frustum")


@pytest.mark.parametrize("distance", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("name", [name for name in SHAPES if name not in CONES])
def test_any_far_shape(name, distance):
    """Not only spheres: where a hit lies, its equation is 0 within a few ulp of the eye's distance."""
    ulps, count, _ = residual(name, distance, 3)
    assert count > 600
    assert ulps < 16


@pytest.mark.parametrize("distance", [1e3, 1e6])
def test_far_cones(measured, distance):
    found = [residual(name, distance, seed) for name in CONES for seed in (3, 4)]
    ulps, plain = max(f[0] for f in found), max(f[2] for f in found)
    if distance == 1e6:
        measured.place(
            1, "cones seen from 10⁶", naive=f"f64 is up to {plain:.1g} ulp off",
            ours=f"up to {ulps:.0f} ulp of the distance off their surface, all other shapes below 16", bound="16 ulp",
        )  # fmt: skip
    assert ulps < 16


@pytest.mark.parametrize("seed", [2, 3])
def test_the_naive_sphere_is_right_near_by(seed):
    """It is not made to fail."""
    found = far_sphere(3.0, 1.0, np.zeros(3), seed)
    assert found["f32"] < 1e-5
    assert found["f64"] < 1e-13


# --- 2: just above a planet ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("radius", "height", "angle"), [(1e7, 2.0, 45.0), (6.371e6, 1.7, 30.0), (1e9, 0.5, 80.0), (1e4, 1e-3, 45.0)])
def test_just_above_a_planet(measured, radius, height, angle):
    """The eye `height` above a sphere of `radius`, looking down by `angle`."""
    o = np.array([0.0, radius + height, 0.0])
    d = np.array([math.cos(math.radians(angle)), -math.sin(math.radians(angle)), 0.0])
    true = exact.sphere(o, d, np.zeros(3), radius)
    assert true is not None
    t = hit(K.SPHERE, [radius], o, d)[0][0]
    plain = [float(naive.sphere(o[None], d[None], radius, kind)[0]) for kind in (np.float32, np.float64)]
    off = abs(float(Fraction(float(t)) / true - 1))
    if radius == 1e7:
        measured.place(
            2, "2 m above a planet of radius 10⁷ m, looking 45° down", naive=f"f32 {plain[0]:.4g} m, f64 {plain[1]:.8g} m",
            ours=f"{t:.8g} m of {float(true):.8g}", bound="10⁻⁶ of it",
        )  # fmt: skip
    assert not abs(plain[0] / float(true) - 1) < 0.01
    assert off < 1e-6


# --- 3: a quadratic whose roots differ by many digits ------------------------------------------------------------------------


def ours_of(a: float, b: float, c: float) -> tuple[float, float]:
    """The two roots of a t² + b t + c by the function that every round shape uses."""
    one = np.ones(1)
    half = -0.5 * b
    with np.errstate(all="ignore"):
        low, high = lanes.ordered_roots(a * one, half * one, c * one, (half * half - a * c) * one)
    return float(low[0]), float(high[0])


def exact_roots(a: float, b: float, c: float) -> tuple[float, float]:
    a_, b_, c_ = exact.rational((a, b, c))
    root = exact.root(b_ * b_ - 4 * a_ * c_)
    low, high = sorted(((-b_ - root) / (2 * a_), (-b_ + root) / (2 * a_)))
    return float(low), float(high)


def test_roots_that_differ_by_sixteen_digits(measured):
    plain, ours, true = naive.larger_root(1, 1e8, 1), ours_of(1, 1e8, 1), exact_roots(1, 1e8, 1)
    ulps = max(abs(x - y) / np.spacing(abs(y)) for x, y in zip(ours, true, strict=True))
    measured.place(3, "t² + 10⁸ t + 1 = 0", naive=f"{plain:.3g}", ours=f"{ours[1]:.17g}, {ulps:.0f} ulp off", bound="4 ulp")
    assert abs(plain / true[1] - 1) > 0.2
    assert ulps <= 4


@pytest.mark.long
@given(st.floats(1e-3, 10), st.floats(1e2, 1e12), st.floats(1e-3, 10), st.sampled_from([1.0, -1.0]), st.sampled_from([1.0, -1.0]))
@settings(max_examples=200, deadline=None)
def test_roots_far_apart_keep_their_digits(a, b, c, of_b, of_c):
    """|b| is so large beside a and c that nothing but cancelling can go wrong: the discriminant itself is well known."""
    for ours, true in zip(ours_of(a, of_b * b, of_c * c), exact_roots(a, of_b * b, of_c * c), strict=True):
        assert abs(ours - true) <= 4 * np.spacing(abs(true))


# --- 4: rays that barely touch or miss -----------------------------------------------------------------------------------


def tangents(radius: float, distance: float, power: int, seed: int) -> tuple[int, int, int]:
    """(wrong, NaN, wrong by f32) of rays that pass a sphere at radius · (1 ± 2^power), against rational arithmetic."""
    random = np.random.default_rng(seed)
    n = 200
    toward = unit(random.normal(size=(n, 3)))
    side = random.normal(size=(n, 3))
    side = unit(side - toward * np.sum(side * toward, axis=1, keepdims=True))
    share = 1 + random.choice([-1, 1], (n, 1)) * 2.0**power
    o = radius * share * side - distance * toward
    t = hit(K.SPHERE, [radius], o, toward)[0]
    true = [exact.sphere(o[k], toward[k], np.zeros(3), radius) for k in range(n)]
    plain = naive.sphere(o, toward, radius)
    meets = np.array([x is not None for x in true])
    return int(np.sum(np.isfinite(t) != meets)), int(np.sum(np.isnan(t))), int(np.sum(np.isfinite(plain) != meets))


@pytest.mark.parametrize(("radius", "distance"), [(3.0, 20.0), (1.0, 2.0), (1e5, 3e5)])
def test_tangents(measured, radius, distance):
    """Outside of 4 ulp of the eye's distance all agree with fractions; within it, either answer is right, but never NaN."""
    wrong, nan, by_f32 = tangents(radius, distance, -40, seed=4)
    if radius == 3.0:
        measured.place(
            4, "rays that pass a sphere at r (1 ± 2⁻⁴⁰)", naive=f"f32 wrong for {by_f32} of 200", ours=f"wrong for {wrong}, NaN for {nan}",
            bound="agrees with fractions outside of 4 ulp",
        )  # fmt: skip
    assert by_f32 > 20
    assert wrong == nan == 0
    assert tangents(radius, distance, -53, seed=5)[1] == 0


# --- 5: planes seen edge-on --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [1e-9, 1e-5, 1e-12, 1e-300])
def test_a_plane_seen_edge_on(measured, slope):
    """n·d = −slope, exactly: the plane y = 7 and a direction whose y it is."""
    o, where = np.array([11.3, 9.1, 2.2]), (3.0, 7.0, -5.0)
    t, d = first_hits(scene([(K.PLANE, [], matrix(where), 0)]), o, np.array([1.0, -slope, 0.0]))
    true = (Fraction(7) - Fraction(9.1)) / Fraction(float(d[0, 1]))
    plain = naive.plane(np.array([0.0, 1.0, 0.0]), 7.0, o, d)[0]
    off, bound = abs(Fraction(float(t[0])) - true), 4 * U * (float(np.linalg.norm(where)) + float(np.linalg.norm(o))) / slope
    if slope == 1e-9:
        measured.place(
            5, "a plane seen under n·d = 10⁻⁹", naive="rejected as parallel" if np.isnan(plain) else f"{plain:.17g}",
            ours=f"t = {t[0]:.10g}, off by {float(off):.2g}", bound=f"4 u (|p| + |o|) / |n·d| = {bound:.2g}",
        )  # fmt: skip
    assert np.isnan(plain) == (slope < 1e-6)
    assert off <= bound


def test_only_a_ray_along_a_plane_misses_it():
    t = hit(K.PLANE, [], (0, 1, 0), [(1, -1e-9, 0), (1, -1e-300, 0), (1, 0, 0), (1, -0.0, 0), (1, 1e-9, 0)])[0]
    assert t[0] == pytest.approx(1e9, rel=4 * U)
    assert t[1] == pytest.approx(1e300, rel=4 * U)
    assert (t[2:] == INF).all()


@pytest.mark.long
@given(st.integers(0, 2**32 - 1), st.floats(-12, -2))
@settings(max_examples=100, deadline=None)
def test_a_tilted_plane_seen_edge_on(seed, power):
    """Whichever way it is turned, the point that is found lies in it: within 8 u of the numbers it was found from."""
    random = np.random.default_rng(seed)
    normal = unit(random.normal(size=3))
    place = transforms.facing((10 * random.normal(size=3)).tolist(), normal.tolist())
    assert place is not None
    along = unit(np.cross(normal, random.normal(size=3)))
    o = place[:3, 3] + 10 * random.normal(size=3)
    o += (random.uniform(0.5, 5) - (o - place[:3, 3]) @ normal) * normal
    tables = scene([(K.PLANE, [], place, 0)])
    t, d = first_hits(tables, o, along - 10.0**power * normal)
    up, at = (exact.rational(place[:3, k]) for k in (1, 3))
    if exact.dot(up, exact.rational(d[0])) >= 0:  # rounding of the direction took it along the plane or away from it
        assert power < -11
        return
    assert np.isfinite(t[0])
    point = [x + Fraction(float(t[0])) * y for x, y in zip(exact.rational(o), exact.rational(d[0]), strict=True)]
    off = abs(float(exact.dot(up, exact.sub(point, at))))
    assert off <= 8 * U * (np.linalg.norm(place[:3, 3]) + np.linalg.norm(o) + t[0])


# --- 6: thin rings from afar -------------------------------------------------------------------------------------------------


def thin_ring(ring: float, tube: float, distance: float, n: int, seed: int) -> dict[str, float]:
    """Rays from afar through the inside of a torus' tube: ours, and the quartic's companion matrix on the first 200 of them."""
    random = np.random.default_rng(seed)
    turn, way, off = random.uniform(0, 2 * np.pi, n), random.uniform(0, 2 * np.pi, n), 0.95 * tube * random.uniform(0, 1, n)
    out = ring + off * np.cos(way)
    aim = np.stack([out * np.cos(turn), off * np.sin(way), out * np.sin(turn)], axis=1)
    o = distance * unit(random.normal(size=(n, 3)))
    d = unit(aim - o)
    t, _ = hit(K.TORUS, [ring, tube], o, d)
    p = (o.astype(np.longdouble) + t[:, None].astype(np.longdouble) * d).astype(np.float64)
    count, at = np.zeros(n, int), np.zeros(n)
    while np.isfinite(at).any():
        at = np.where(np.isfinite(at), after(K.TORUS, [ring, tube], o, d, np.where(np.isfinite(at), at, 0.0))[0], INF)
        count += np.isfinite(at)
    plain = [naive.torus(ring, tube, o[k], d[k]) for k in range(min(n, 200))]
    return {
        "missed": int(np.sum(~np.isfinite(t))), "odd": int(np.sum(count % 2)),
        "residual": float(np.max(np.abs(equation(K.TORUS, [ring, tube], p, np.zeros(n, int))))),
        "naive wrong": sum(len(roots) % 2 or not len(roots) for roots in plain) / len(plain),
        "naive off": max(abs(roots[0] - t[k]) for k, roots in enumerate(plain) if len(roots)),
    }  # fmt: skip


@pytest.mark.parametrize(("ring", "tube", "distance"), [(1, 0.01, 1e4), (1, 0.001, 1e4), (0.3, 0.8, 1e4), (2.5, 0.02, 3e3)])
def test_a_thin_ring_from_afar(measured, ring, tube, distance):
    found = thin_ring(ring, tube, distance, 2000, seed=8)
    if tube == 0.01:
        measured.place(
            6, "a ring of tube 0.01 from 10⁴",
            naive=f"the quartic's roots: none or an odd number for {found['naive wrong']:.0%}, off by up to {found['naive off']:.2g}",
            ours=f"{found['missed']} missed, {found['odd']} odd, residual {found['residual']:.1g}", bound="residual 10⁻¹⁰, even parity",
        )  # fmt: skip
    assert found["naive wrong"] > 0.2
    assert found["missed"] == found["odd"] == 0
    assert found["residual"] < 1e-10


@pytest.mark.long
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 20), st.floats(0.001, 20), st.floats(0, 5))
@settings(max_examples=60, deadline=None)
def test_rays_leave_every_ring_they_enter(seed, ring, tube, power):
    """Even parity from outside, whatever the ring, the tube and the distance, for rays that meet it or pass it."""
    random = np.random.default_rng(seed)
    size = ring + tube
    o = 1.1 * size * 10**power * unit(random.normal(size=(40, 3)))
    d = unit(size * random.uniform(-1, 1, (40, 3)) - o)
    count, at = np.zeros(40, int), np.zeros(40)
    while np.isfinite(at).any():
        at = np.where(np.isfinite(at), after(K.TORUS, [ring, tube], o, d, np.where(np.isfinite(at), at, 0.0))[0], INF)
        count += np.isfinite(at)
    assert (count % 2 == 0).all()
    assert count.max() <= 4


# --- quadrics, by the same formula as spheres ----------------------------------------------------------------------------------


def as_quadric(scale: float, seed: int = 9) -> tuple[float, int, float]:
    """(largest relative error, rays that miss, error of the f32 formula) of the unit sphere as a quadric under a scale, against the
    sphere's own form."""
    random = np.random.default_rng(seed)
    o = 5 * scale * unit(random.normal(size=(500, 3)))
    d = 0.2 * scale * random.normal(size=(500, 3)) - o
    place = matrix((0, 0, 0), scale * np.eye(3))
    t, way = first_hits(scene([(K.QUADRIC, [1, 1, 1, 0, 0, 0, 0, 0, 0, -1, *ENDLESS], place, 0)]), o, d)
    true, _ = first_hits(scene([(K.SPHERE, [1.0], place, 0)]), o, d)
    plain = naive.sphere(o, way, scale)
    with np.errstate(invalid="ignore"):
        off = np.nanmax(np.where(np.isfinite(t), np.abs(t - true) / true, np.nan))
    return float(off), int(np.sum(~np.isfinite(t))), float(np.nanmax(np.abs(plain - true) / true))


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 30.0])
def test_quadrics_of_about_their_size(scale):
    off, missed, _ = as_quadric(scale)
    assert off < 1e-14
    assert missed == 0


@pytest.mark.parametrize("scale", [1e4, 1e6, 1e8])
def test_enlarged_quadrics(measured, scale):
    """Directions shrink in the frame of what is enlarged: the terms of second order must stand by themselves."""
    off, missed, plain = as_quadric(scale)
    if scale == 1e6:
        measured.place(
            1, "the unit sphere as a quadric, enlarged 10⁶ times", naive=f"f32: t off by {plain:.2g} of it",
            ours=f"off by {off:.2g} of it, {missed} of 500 missed", bound="10⁻¹² of it",
        )  # fmt: skip
    assert missed == 0
    assert off < 1e-12
