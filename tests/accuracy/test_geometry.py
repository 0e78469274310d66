"""Known answers 7, 8, 10 and 11: silhouettes, chords and volumes of solids, roots by what they leave over and by Vieta, barycentrics."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.shapes import sphere

from ..backends.views import channel
from ..render import tables as make
from ..render.closed import K, after, hit
from ..render.geometry.test_analytic_shapes import SHAPES, some_rays
from ..render.tracing import trace_kernels
from . import radiometry as rm

Array = rm.Array
U = 2.0**-53
EXACT = 1e-10  # relative, in double precision

every = pytest.mark.parametrize("backend", rm.EVERY)


def two_views(far: float, width: float) -> str:
    """Orthographic cameras before and behind the origin."""
    view = 'camera(name: "{}", position: [0, 0, {}], look_at: [0, 0, 0], width: {})\n'
    return view.format("front", far, width) + view.format("back", -far, width) + "ambient(#ffffff)\n"


def depths(folder: Path, scene: ir.Scene, backend: str, size: int) -> tuple[Array, Array]:
    """(size, size) depths from before and from behind of the same lines: right is left from behind."""
    views = (rm.picture(folder, scene, backend, camera=name, size=(size, size), aov=("depth",)) for name in ("front", "back"))
    front, back = (channel(view, "depth") for view in views)
    return front, back[:, ::-1]


# --- 7: convex solids, turned at random (Cauchy 1841) --------------------------------------------------------------------------------

CELL = 16  # pixels across, for each solid
BOX = np.array([[x, y, z] for x in (-3.5, 3.5) for y in (-2.5, 2.5) for z in (-4.5, 4.5)])
TETRAHEDRON = 5.0 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(3)
EDGE = 5.0 * math.sqrt(8 / 3)  # of that tetrahedron
SOLIDS = {  # points, faces, surface, volume
    "box": (BOX, [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]], 2 * (35 + 45 + 63), 7 * 5 * 9),
    "tetrahedron": (TETRAHEDRON, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], math.sqrt(3) * EDGE**2, EDGE**3 / math.sqrt(72)),
}


def turned(random: np.random.Generator) -> Array:
    """(100, 3, 3) turns by which a fixed view becomes the directions of a spiral over the sphere, itself turned at random.

    Each direction alone is even over the sphere, and together they cover it evenly.
    """
    k = np.arange(100) + 0.5
    z, turn = 1 - k / 50, math.pi * (1 + math.sqrt(5)) * k
    spiral = np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)
    way = np.asarray(spiral @ np.linalg.qr(random.normal(size=(3, 3)))[0], float)
    side = np.cross(way, random.normal(size=(100, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return np.stack([side, np.cross(way, side), way], axis=1)


def field(folder: Path, solid: str, turns: Array, random: np.random.Generator) -> ir.Scene:
    """A square of them, each in its own cell of 16 by 16 pixels, off the pixels' raster by chance; seen from before and from behind."""
    points, faces = SOLIDS[solid][:2]
    across = math.isqrt(len(turns))
    text = two_views(50, across * CELL)
    for k, turn in enumerate(turns):
        middle = CELL * np.array([k % across - across / 2 + 0.5, k // across - across / 2 + 0.5, 0])
        corners = points @ turn.T + middle + np.append(random.uniform(-0.5, 0.5, 2), 0)
        text += f"mesh(points: [{', '.join(rm.written(p) for p in corners)}], faces: {faces})\n"
    return rm.load(folder, text)


def area_and_chord(folder: Path, solid: str, backend: str, seed: int) -> tuple[float, float]:
    """Means over a hundred turns. They share a picture, but for the reference, which meets every triangle with every ray."""
    random = np.random.default_rng(seed)
    hits, total = 0, 0.0
    for turns in np.array_split(turned(random), 25 if backend == "reference" else 1):
        front, back = depths(folder, field(folder, solid, turns, random), backend, CELL * math.isqrt(len(turns)))
        seen = np.isfinite(front)
        assert np.count_nonzero(seen != np.isfinite(back)) <= 4  # edges through a pixel's centre
        seen &= np.isfinite(back)
        hits += np.count_nonzero(seen)
        total += float((100 - front - back)[seen].sum())
    return hits / 100, total / hits


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster", pytest.param("reference", marks=pytest.mark.long)])
@pytest.mark.parametrize("solid", ["box", pytest.param("tetrahedron", marks=pytest.mark.long)])
def test_silhouettes_and_chords_of_solids_turned_at_random(tmp_path, measured, backend, solid):
    """The mean of the silhouette's area is S/4, and of the chord over all lines that meet the solid 4V/S."""
    surface, volume = SOLIDS[solid][2:]
    areas, chords = zip(*(area_and_chord(tmp_path, solid, backend, seed) for seed in range(8)), strict=True)
    rm.within_error(measured, 7, f"silhouette of a {solid} turned at random, S/4", backend, areas, surface / 4, note="relative")
    rm.within_error(measured, 7, f"chord of a {solid} turned at random, 4V/S", backend, chords, 4 * volume / surface, note="relative")


# --- 8: volumes ----------------------------------------------------------------------------------------------------------------------

RING, TUBE = 0.65, 0.25
TORUS = 2 * math.pi**2 * RING * TUBE**2
ROUND = {"ball": ("sphere(0.9)", 4 / 3 * math.pi * 0.9**3), "torus": (f"torus({RING}, {TUBE}, rotate: [90deg, 0, 0])", TORUS)}


@pytest.mark.long
@every
@pytest.mark.parametrize("name", ROUND)
def test_the_volume_between_front_and_back(tmp_path, measured, backend, name):
    """∫ (z_back − z_front) dA over 512 by 512 pixels is 4πR³/3, and 2π²Rr² of a ring seen along its axis."""
    shape, volume = ROUND[name]
    front, back = depths(tmp_path, rm.load(tmp_path, two_views(3, 2) + shape + "\n"), backend, 512)
    seen = np.isfinite(front) & np.isfinite(back)
    found = float((6 - front - back)[seen].sum()) * (2 / 512) ** 2
    measured.answer(8, f"volume of a {name} by its depths", backend, abs(found / volume - 1), 1e-3, note="relative, at 512²")


@pytest.mark.long
def test_the_volume_of_a_torus_from_any_side(measured):
    """The sum of the intervals that rays are inside, two at most: 2π²Rr², whatever the way they go."""
    worst = 0.0
    x, y = ((np.mgrid[0:512, 0:512] + 0.5) / 256 - 1).reshape(2, -1)
    for seed in range(3):
        frame = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        o = np.stack([x, y, np.full_like(x, -2)], axis=1) @ frame
        d = np.broadcast_to(frame[2], o.shape)
        total, t = 0.0, np.zeros(len(o))
        for sign in (-1, 1, -1, 1):
            t, _ = after(K.TORUS, [RING, TUBE], o, d, t)
            o, d, t = (v[np.isfinite(t)] for v in (o, d, t))
            total += sign * float(t.sum())
        worst = max(worst, abs(total / 256**2 / TORUS - 1))
    measured.answer(8, "volume of a torus by its intervals", "functions", worst, 1e-3, note="relative, at 512², the worst of three sides")


# --- 10: roots -----------------------------------------------------------------------------------------------------------------------

Long = np.longdouble


def left_over(kind: int, g: list[float], o: Array, d: Array, t: Array) -> Array:
    """|f(o + t d)| of a surface's polynomial, over the sum of its terms' absolute values; by the long double, whose rounding is U/2048."""
    origin, direction, at = o.astype(Long), d.astype(Long), t.astype(Long)[:, None]
    p, size = (origin + at * direction).T, (np.abs(origin) + np.abs(at * direction)).T
    value, terms = _polynomial(kind, g, p[0], p[1], p[2], -1), _polynomial(kind, g, size[0], size[1], size[2], 1)
    return np.asarray(np.abs(value) / terms, float)


def _polynomial(kind: int, g: list[float], x: Any, y: Any, z: Any, minus: int) -> Any:
    """The polynomial; with `minus` 1, of positive places, the sum of its terms' absolute values."""
    if kind == K.SPHERE:
        return x * x + y * y + z * z + minus * Long(g[0]) ** 2
    if kind in (K.CYLINDER, K.CONE):
        bottom, top, half = (g[0], g[0], g[1]) if kind == K.CYLINDER else g[:3]
        middle, slope = 0.5 * (bottom + top), 0.5 * (top - bottom) / half
        w = middle + (abs(slope) if minus > 0 else slope) * y
        return x * x + z * z + minus * w * w
    if kind == K.TORUS:
        ring, tube = Long(g[0]), Long(g[1])
        whole = x * x + y * y + z * z + ring * ring + minus * tube * tube
        return whole * whole + minus * 4 * ring * ring * (x * x + z * z)
    factors = [abs(c) if minus > 0 else c for c in g[:10]]
    return sum(c * m for c, m in zip(factors, (x * x, y * y, z * z, x * y, y * z, x * z, x, y, z, 1), strict=True))


ROOTS = ["sphere", "cylinder", "cone", "frustum", "torus", "thin torus", "hyperboloid", "ellipsoid with mixed terms"]


@pytest.mark.parametrize("name", ROOTS)
def test_what_roots_leave_over(measured, name):
    """|f(p)| ≤ 16 u Σ|terms|: a root that is right but for the last digits of what goes into it; eyes from 3 to 3000 m away."""
    kind, g = SHAPES[name]
    worst = 0.0
    for far in (1.0, 30.0, 1000.0):
        o, d = some_rays(12000, 8)
        o, d = o * far, d - (far - 1) * o
        t, part = hit(kind, g, o, d)
        met = np.isfinite(t) & ((part == 0) | (kind in (K.TORUS, K.QUADRIC)))
        assert met.sum() > 100
        worst = max(worst, float(left_over(kind, g, o[met], d[met], t[met]).max()))
    measured.answer(10, f"residual of roots: {name}", "functions", worst / U, 16, "u Σ|terms|")


def test_roots_of_a_sphere_by_vieta(measured):
    """Σt = −b/a and Πt = c/a of a t² + b t + c, to 16 u of the terms that b and c are sums of."""
    sums, products = 0.0, 0.0
    for far in (1.0, 30.0, 1000.0):
        o, d = some_rays(4000, 9)
        o, d = o * far, d - (far - 1) * o
        with np.errstate(all="ignore"):
            t0, t1 = sphere.sphere_interval(1.3, tuple(o.T), tuple(d.T))
        met = np.isfinite(t0)
        assert met.sum() > 300
        o, d, t0, t1 = (v[met].astype(Long) for v in (o, d, t0, t1))
        a, b, c = (d * d).sum(1), 2 * (o * d).sum(1), (o * o).sum(1) - Long(1.3) ** 2
        sums = max(sums, float(np.max(np.abs(a * (t0 + t1) + b) / (2 * np.abs(o * d).sum(1)))))
        products = max(products, float(np.max(np.abs(a * t0 * t1 - c) / ((o * o).sum(1) + Long(1.3) ** 2))))
    measured.answer(10, "Vieta: sum of a sphere's roots −b/a", "functions", sums / U, 16, "u Σ|terms|")
    measured.answer(10, "Vieta: product of a sphere's roots c/a", "functions", products / U, 16, "u Σ|terms|")


# --- 11: barycentrics, patches, subdivision ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_barycentrics_of_rays(measured):
    """A ray to w a + u b + v c finds these weights, in double precision; its corners are numbers that meshes hold, in single."""
    random = np.random.default_rng(11)
    worst = 0.0
    for _ in range(60):
        corners = np.round(random.normal(size=(3, 3)) * 1024) / 1024
        weights = random.dirichlet((1, 1, 1), 50)
        normal = rm.unit(np.cross(corners[1] - corners[0], corners[2] - corners[0]))
        o = weights @ corners + 3 * normal + random.normal(size=(50, 3))
        ray = make.rays(o, weights @ corners - o)
        t, _, _, u, v, *_ = trace_kernels(make.scene(meshes=[(make.mesh(corners, [[0, 1, 2]]), make.IDENTITY, 0)]), ray)
        assert np.isfinite(t).all()
        worst = max(worst, float(np.abs(np.stack([1 - u - v, u, v], axis=1) - weights).max()))
    measured.answer(11, "barycentrics of a triangle, by rays", "functions", worst, EXACT, note="the worst of 3000")


@every
def test_barycentrics_in_pictures(tmp_path, measured, backend):
    """Texture coordinates that are 1 at one corner and 0 at the others are its barycentrics: they sum to 1, and Σ wᵢ pᵢ is the place."""
    corners = np.array([[-1.5, -1.2, -3], [1.8, -0.6, -5], [0.1, 1.6, -4]])
    text = "camera(position: [0, 0, 0], look_at: [0, 0, -1], fov: 50deg)\nambient(#ffffff)\n"
    text += f"mesh(points: [{', '.join(rm.written(p) for p in corners)}], faces: [[0, 1, 2]], "

    def seen(uv: str) -> tuple[Array, Array]:
        image = rm.picture(tmp_path, text + f"uv: {uv})\n", backend, aov=("uv", "position", "id"))
        met = channel(image, "id")[..., 0] == 0
        assert met.sum() > 300
        return channel(image, "uv")[met], channel(image, "position")[met]

    (first, place), (second, _) = seen("[[1, 0], [0, 1], [0, 0]]"), seen("[[0, 0], [1, 0], [0, 1]]")
    weights = np.stack([first[:, 0], second[:, 0], second[:, 1]], axis=1)
    note = "the worst pixel"
    measured.answer(11, "barycentrics of a triangle sum to 1", backend, np.abs(weights.sum(axis=1) - 1).max(), rm.SINGLE, note=note)
    off = np.abs(weights @ corners - place).max() / 3
    name = "barycentrics of a triangle give its positions"
    measured.answer(11, name, backend, off, rm.SINGLE, note="relative to its size, the worst pixel")


@pytest.mark.long
def test_patches(measured, tmp_path):
    """Places of a NURBS surface on a circle of radius 1, relative to it: as the mesh holds them, in single precision."""
    scene = rm.load(tmp_path, 'use "std/surfaces"\nsurfaces.revolved([[1, 0], [1, 1]], steps: 24)\n')
    places = scene.tables.pools.positions + scene.tables.geometries.origin[0]
    assert len(places) == 25 * 25
    off = np.abs(np.hypot(places[:, 0], places[:, 2]) - 1).max()
    measured.answer(11, "an arc of weights 1, √½, 1 is round", "functions", off, 1e-6, note="corners of a mesh of 24 by 24")


def test_subdivision(measured):
    measured.waits(11, "Catmull–Clark: the limit of a cube's corner is (½, ½, ½)", "`subdivision`")
