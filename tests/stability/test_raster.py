"""Places 16 to 19, 21, 22, 46 to 48: what is behind the eye, far out or less than a pixel; shared edges; depth; weights; fills."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import mapbox_earcut
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData
from maquette.render.image.image import Image
from maquette.render.jit.kernel import kernel
from maquette.render.raster import coverage as raster_coverage

from ..render import pictures
from ..render.raster.filling import covered, exactly, random_triangles, star
from ..render.tables import matrix, mesh, scene
from . import exact, naive

ORTHOGRAPHIC = ir.Projection.ORTHOGRAPHIC
EYE = CameraData(transform=0, extent=1.0)  # at the origin, looking down −z, 90 degrees high
BACKENDS = ("raster", "ray")


def flat(pixels: int) -> CameraData:
    """Down −z, one metre a pixel."""
    return CameraData(transform=0, extent=pixels / 2, projection=ORTHOGRAPHIC)


def picture(tables: ir.Tables, backend: str = "raster", **settings: Any) -> Image:
    return pictures.picture(tables, backend, aov=("id", "depth"), **settings)


def ids(image: Image) -> np.ndarray:
    return image.channels["id"][..., 0]


def one(corners: np.ndarray) -> ir.Tables:
    """A triangle before the eye, its corners in the eye's frame."""
    return scene(meshes=[(mesh(corners, [[0, 1, 2]]), np.eye(4), 0)], camera=EYE)


def stored(tables: ir.Tables) -> list[exact.Rational]:
    """The corners of the first triangle as the tables hold them."""
    middle = exact.rational(tables.geometries.origin[0])
    rows = tables.pools.positions[tables.pools.triangles[0]]
    return [tuple(x + y for x, y in zip(exact.rational(row), middle, strict=True)) for row in rows]


# --- 16: in front of the eye and behind it -------------------------------------------------------------------------------------


def divided_first(corners: np.ndarray, size: int) -> np.ndarray:
    """The picture that dividing by w before clipping makes."""
    y, x = np.mgrid[0:size, 0:size] + 0.5
    samples = np.stack([x.ravel(), y.ravel()], axis=1)
    return naive.half_planes(naive.projected(corners, size / 2, (size, size))[None], samples[None], closed=True).reshape(size, size)


def across_the_eye(corners: np.ndarray, size: int = 64) -> tuple[float, float]:
    """Shares of the picture in which dividing first, and the z-buffer, differ from what rays meet."""
    raster, ray = (ids(picture(one(corners), backend, size=(size, size))) >= 0 for backend in BACKENDS)
    return float(np.mean(divided_first(corners, size) != ray)), float(np.mean(raster != ray))


def test_a_triangle_from_behind_the_eye_to_before_it(measured):
    corners = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, -0.01], [2.0, 0.0, -5.0]])
    plain, ours = across_the_eye(corners)
    measured.place(
        16, "a triangle with z = −1, 0.01 and 5 before the eye", naive=f"divided by w first: {plain:.0%} of the pixels wrong",
        ours=f"{ours:.0%} differ from the tracer", bound="none: cut in homogeneous coordinates",
    )  # fmt: skip
    assert plain > 0.1
    assert ours == 0


@pytest.mark.long
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_any_triangle_across_the_eye(seed):
    """Corners on both sides of the eye's plane: but for samples nearer than 1/256 pixel to an edge, as rays see it."""
    random = np.random.default_rng(seed)
    corners = random.normal(size=(3, 3)) * 10.0 ** random.uniform(-2, 2, (3, 1))
    corners[:, 2] = np.where([True, False, random.random() < 0.5], np.abs(corners[:, 2]), -np.abs(corners[:, 2]))
    raster, ray = (ids(picture(one(corners), backend, size=(24, 24))) >= 0 for backend in BACKENDS)
    assert np.sum(raster != ray) <= 1


# --- 17: corners far outside of the picture --------------------------------------------------------------------------------------


def far_out(pixels: float, seed: int, size: int = 40) -> tuple[float, int, int, float]:
    """(share of samples that int32 gets wrong, the z-buffer's wrong ones, samples inside, how far the worst of those is from an edge).

    A corner comes so near to the eye's plane that it is projected to about `pixels`; the others are in the picture.
    """
    random = np.random.default_rng(seed)
    near = size / 2 / pixels
    turn = random.uniform(0, 2 * np.pi)
    corners = np.array([[math.cos(turn), math.sin(turn), -near], *np.column_stack([random.uniform(-1.5, 1.5, (2, 2)), [-2.0, -2.0]])])
    tables = one(corners)
    seen = ids(picture(tables, size=(size, size))) >= 0
    half = Fraction(size, 2)
    outline = [(half - half * x / z, half + half * y / z) for x, y, z in stored(tables)]
    where = [[exact.inside(outline, Fraction(2 * i + 1, 2), Fraction(2 * j + 1, 2)) for i in range(size)] for j in range(size)]
    true, distance = (np.array([[place[k] for place in row] for row in where]) for k in (0, 1))
    y, x = np.mgrid[0:size, 0:size] + 0.5
    fixed = naive.fixed_point(np.array([[float(c) for c in p] for p in outline]))
    plain = naive.half_planes(fixed[None], np.stack([x.ravel(), y.ravel()], axis=1)[None], closed=True).reshape(size, size)
    return float(np.mean(plain != true)), int(np.sum(seen != true)), int(true.sum()), float(np.max(distance[seen != true], initial=0))


@pytest.mark.long
@pytest.mark.parametrize("pixels", [1e9, 1e7, 1e12, 1e15])
def test_a_corner_a_thousand_million_pixels_away(measured, pixels):
    found = [far_out(pixels, seed) for seed in range(8)]
    plain, wrong, inside, off = np.mean([f[0] for f in found]), sum(f[1] for f in found), sum(f[2] for f in found), max(f[3] for f in found)
    if pixels == 1e9:
        measured.place(
            17, "a corner projected to 10⁹ pixels", naive=f"int32 24.8 wraps round: {plain:.0%} of the samples wrong",
            ours=f"{wrong} of {8 * 1600} samples differ from fractions", bound="none farther than 1/256 pixel from an edge",
        )  # fmt: skip
    assert inside > 1000
    assert plain > 0.05
    assert off <= 1 / 256
    assert wrong <= 8


def test_a_corner_a_thousand_million_metres_away(measured, load):
    """The same from a mesh whose corner lies there: what is stored is about where most corners are."""
    worst, plain, said = 0.0, 0.0, []
    for seed in range(4):
        random = np.random.default_rng(seed)
        turn = random.uniform(0, 2 * np.pi)
        corners = np.array([[1e9 * math.cos(turn), 1e9 * math.sin(turn), 0.0], *np.column_stack([random.uniform(-20, 20, (2, 2)), [0, 0]])])
        loaded, more = load(f"camera(position: [0, 0, 5], width: 64)\nmesh(points: {corners.tolist()}, faces: [[0, 1, 2]])\n")
        said += more
        if len(loaded.tables.pools.triangles):
            kept = np.array([[float(x) for x in p] for p in stored(loaded.tables)])
            worst = max(worst, float(np.abs(kept - corners)[1:].max()))
        else:
            worst = math.inf
        plain = max(plain, float(np.abs(corners.astype(np.float32) - corners)[1:].max()))
    ours = "dropped as having no area" if math.isinf(worst) else f"near corners off by {worst:.3g} m"
    measured.place(
        17, "a mesh with a corner 10⁹ m away", naive=f"float32 as they stand: near corners off by {plain:.1g} m",
        ours=f"{ours}; message: {'; '.join(said) or 'nothing'}",
        bound="10⁻³ m, or a message",
    )  # fmt: skip
    assert worst < 1e-3


# --- 18: triangles much smaller than a pixel ---------------------------------------------------------------------------------------


def crumbs(pixels: int, edge: float, seed: int = 18) -> tuple[np.ndarray, np.ndarray]:
    """A square of `pixels` in triangles of about `edge` pixels, its inner corners shaken."""
    n = round(pixels / edge)
    random = np.random.default_rng(seed)
    line = np.linspace(-pixels / 2, pixels / 2, n + 1)
    x, y = np.meshgrid(line, line)
    shake = random.uniform(-0.35, 0.35, (2, n + 1, n + 1)) * edge
    shake[:, [0, -1]] = shake[:, :, [0, -1]] = 0
    points = np.stack([x + shake[0], y + shake[1], np.full_like(x, -5.0)], axis=-1).reshape(-1, 3)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    return points, np.concatenate([np.stack([i, i + 1, i + n + 2], 1), np.stack([i, i + n + 2, i + n + 1], 1)])


def holes(pixels: int, edge: float, samples: int) -> tuple[float, float, int]:
    """(share of pixels that whole-pixel corners leave empty, coverage of the z-buffer less 1 at worst, triangles)."""
    points, triangles = crumbs(pixels, edge)
    tables = scene(meshes=[(mesh(points, triangles), np.eye(4), 0)], camera=flat(pixels))
    covered_ = picture(tables, size=(pixels, pixels), samples=samples, filter="box").channels["rgba"][..., 3]
    whole = np.rint(points[:, :2])[triangles]
    y, x = np.mgrid[0:pixels, 0:pixels] + 0.5 - pixels / 2
    left = np.unique(whole.reshape(len(whole), 6), axis=0).reshape(-1, 3, 2)
    centres = np.broadcast_to(np.stack([x.ravel(), y.ravel()], axis=1), (len(left), pixels * pixels, 2))
    plain = naive.half_planes(left, centres, closed=False)
    return float(np.mean(~plain.any(axis=0))), float(np.abs(covered_ - 1).max()), len(triangles)


@pytest.mark.long
def test_triangles_of_a_hundredth_of_a_pixel(measured):
    plain, off, count = holes(4, 0.01, 16)
    measured.place(
        18, f"{count} triangles of 0.01 pixels", naive=f"corners rounded to pixels: {plain:.0%} of the pixels are holes",
        ours=f"every sample has one owner: coverage 1 ± {off:.1g}", bound="no hole: coverage exactly 1",
    )  # fmt: skip
    assert plain == 1
    assert off == 0


@pytest.mark.long
@pytest.mark.parametrize("edge", [0.04, 0.3, 0.9])
def test_small_triangles_leave_no_hole(edge):
    assert holes(12, edge, 16)[1] == 0


@pytest.mark.long
@pytest.mark.parametrize("edge", [0.3, 0.1])
def test_a_small_triangle_alone_has_its_area(edge):
    """Two triangles of an `edge` pixels wide square, wherever it lies: the mean coverage is the area, within 4 standard errors."""
    random = np.random.default_rng(3)
    got = []
    for place in random.uniform(-3, 3, (30, 2)):
        points = np.array([[0, 0, 0], [edge, 0, 0], [edge, edge, 0], [0, edge, 0]]) + [*place, -5]
        tables = scene(meshes=[(mesh(points, [[0, 1, 2], [0, 2, 3]]), np.eye(4), 0)], camera=flat(8))
        got.append(float(picture(tables, size=(8, 8), samples=256, filter="box").channels["rgba"][..., 3].sum()))
    error = np.std(got, ddof=1) / math.sqrt(len(got)) + 2 * edge / 512  # and corners are snapped to 1/256 pixel
    assert abs(np.mean(got) - edge * edge) < 4 * error


# --- 19: fans ----------------------------------------------------------------------------------------------------------------------


def fan(corners: int, radius: float) -> np.ndarray:
    """(n, 3, 2) fixed-point triangles about one point, clockwise on the screen."""
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    rim = np.rint(radius * raster_coverage.ONE * np.stack([np.cos(turn), np.sin(turn)], axis=1)).astype(np.int64)
    return np.stack([np.zeros_like(rim), rim, np.roll(rim, -1, axis=0)], axis=1)


@pytest.mark.long
@pytest.mark.parametrize(("corners", "radius"), [(24, 8.0), (4, 8.0), (7, 11.3), (360, 20.0)])
def test_a_fan_covers_each_sample_once(measured, corners, radius):
    triangles = fan(corners, radius)
    at = np.arange(-math.floor(radius), math.ceil(radius) + 1) * raster_coverage.HALF
    samples = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    samples = samples[(samples**2).sum(axis=1) < (0.9 * radius * raster_coverage.ONE * math.cos(math.pi / corners)) ** 2]
    repeated = np.repeat(samples[None], corners, axis=0)
    closed, open_ = (naive.half_planes(triangles, repeated, closed=closed).sum(axis=0) for closed in (True, False))
    counts = [covered(how, triangles.reshape(-1, 6), repeated).sum(axis=0) for how in raster_coverage.NAMES.values()]
    if corners == 24:
        measured.place(
            19, "a fan of 24 triangles, samples on its edges and its middle",
            naive=f"edges ≥ 0: up to {closed.max()} owners; edges > 0: {np.mean(open_ == 0):.0%} of the samples without one",
            ours=f"{min(c.min() for c in counts)} to {max(c.max() for c in counts)} owners", bound="1 each",
        )  # fmt: skip
    assert closed.max() > 1
    assert open_.min() == 0
    assert all((c == 1).all() for c in counts)


@pytest.mark.long
def test_a_fan_drawn_piece_by_piece_adds_up():
    """By the public way: the coverages of its triangles, each drawn alone, add up to that of the whole in every pixel."""
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    points = np.concatenate([[[0.0, 0.0, -5.0]], np.stack([7 * np.cos(turn), 7 * np.sin(turn), np.full(12, -5.0)], axis=1)])
    triangles = [[0, 1 + k, 1 + (k + 1) % 12] for k in range(12)]

    def coverage(which: list[list[int]]) -> np.ndarray:
        tables = scene(meshes=[(mesh(points, which), np.eye(4), 0)], camera=flat(16))
        return picture(tables, size=(16, 16), samples=16, filter="box").channels["rgba"][..., 3]

    assert np.allclose(sum(coverage([t]) for t in triangles), coverage(triangles), atol=1e-6)


# --- 21: depth -----------------------------------------------------------------------------------------------------------------------


def quad(z: float, slope: float) -> np.ndarray:
    """A square that fills a 90° picture at distance z in its middle, leaning by `slope`."""
    return np.array([[x * 4 * z, y * 4 * z, -z * (1 + slope * y)] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])


def confused(z: float, step: float, backend: str) -> int:
    """Pixels of 2 × 256 in which the farther of two squares is seen, a relative `step` apart, drawn in either order."""
    wrong = 0
    eye = CameraData(0, 1.0, near=0.1, far=1e5)
    for order in (1, -1):
        squares = [quad(z, 0.2), quad(z * (1 + step), 0.2)][::order]
        tables = scene(meshes=[(mesh(s, [[0, 1, 2], [0, 2, 3]]), np.eye(4), 0) for s in squares], camera=eye)
        wrong += int(np.sum(ids(picture(tables, backend, size=(16, 16))) != (0 if order == 1 else 1)))
    return wrong


@pytest.mark.long
def test_depth_from_a_tenth_to_a_hundred_thousand(measured):
    distances = np.geomspace(1, 9e4, 60)
    one_more = distances * (1 + 1e-6)
    by24 = np.mean(naive.depth24(distances, 0.1, 1e5) >= naive.depth24(one_more, 0.1, 1e5))
    reversed_ = np.mean(naive.depth_reversed(distances, 0.1) <= naive.depth_reversed(one_more, 0.1))
    ladder = 1e4 + np.arange(0, 400, 0.1)
    step = float(np.diff(ladder[1:][np.diff(naive.depth24(ladder, 0.1, 1e5)) > 0]).max())
    wrong = sum(confused(float(z), 1e-6, backend) for z in distances[::6] for backend in BACKENDS)
    measured.place(
        21, "near 0.1, far 10⁵: surfaces Δz/z = 10⁻⁶ apart",
        naive=f"D24 cannot tell {by24:.0%} apart (a step at 10⁴ is {step:.3g} m), reversed f32 {reversed_:.0%}",
        ours=f"{wrong} of {10 * 2 * 512} pixels in the wrong order", bound="0",
    )  # fmt: skip
    assert by24 > 0.5
    assert wrong == 0


@pytest.mark.long
@pytest.mark.parametrize("backend", BACKENDS)
@given(st.floats(0.2, 9e4), st.floats(1e-7, 1e-2))
@settings(max_examples=10, deadline=None)
def test_the_nearer_one_is_seen_at_any_distance(backend, z, step):
    assert confused(z, step, backend) == 0


# --- 22: interpolation over a large ratio of w ---------------------------------------------------------------------------------------


def floor_to(near: float, far: float, backend: str, size: int = 48) -> tuple[float, float, float]:
    """(largest error of v, of u, of v by affine weights) on a floor from `near` to `far`, its corners a ratio far/near of w apart."""
    from maquette.compiler.scene.row_records import MeshAttribute

    h = 0.5 * near
    points = np.array([[-far, -h, -near], [far, -h, -near], [far, -h, -far], [-far, -h, -far]])
    uvs = MeshAttribute(np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]))
    tables = scene(meshes=[(mesh(points, [[0, 1, 2], [0, 2, 3]], uvs=uvs), np.eye(4), 0)], camera=EYE)
    image = pictures.picture(tables, backend, size=(size, size), aov=("uv", "id"))
    y, x = np.mgrid[0:size, 0:size]
    px, py = 2 * (x + 0.5) / size - 1, 1 - 2 * (y + 0.5) / size
    with np.errstate(divide="ignore"):
        z = -h / np.where(py < 0, py, np.nan)
    u, v = (px * z + far) / (2 * far), (z - near) / (far - near)
    on = (ids(image) >= 0) & (v > 0) & (v < 1)
    assert on.sum() > 400
    screen = h / near, h / far  # where the two ends lie below the middle of the picture
    share = (screen[0] + py) / (screen[0] - screen[1])
    affine = naive.affine(np.array([0.0, 1.0]), np.stack([1 - share, share], axis=-1))
    uv = image.channels["uv"].astype(float)
    off_v, off_u, off_affine = (float(np.abs(e[on]).max()) for e in (uv[..., 1] - v, uv[..., 0] - u, affine - v))
    return off_v, off_u, off_affine


@pytest.mark.parametrize(("near", "far"), [(0.01, 1e4), (1.0, 1e6), (1e-3, 10.0), (0.5, 2.0)])
@pytest.mark.parametrize("backend", BACKENDS)
def test_coordinates_on_a_floor_to_the_horizon(measured, backend, near, far):
    v, u, plain = floor_to(near, far, backend)
    if (backend, near) == ("raster", 0.01):
        measured.place(
            22, "coordinates between corners whose w differ 10⁶ times", naive=f"affine: off by up to {plain:.2g}",
            ours=f"u off by {u:.1g}, v by {v:.1g}", bound="10⁻⁵",
        )  # fmt: skip
    assert plain > 0.1
    assert max(u, v) < 1e-5


def test_coordinates_beside_a_diagonal(measured):
    """A centre within 1/512 pixel of the floor's diagonal: the neighbour is taken for it, whose weights must go on beyond its edge."""
    near, far = 8.348033468730634, 227.83909173287847
    v, u, _ = floor_to(near, far, "raster")
    _, _, plain = floor_to(near, far, "ray")
    measured.place(
        22, "a sample 1/512 pixel beside a diagonal", naive=f"affine: off by up to {plain:.2g}", ours=f"u off by {u:.1g}, v by {v:.1g}",
        bound="10⁻⁵",
    )  # fmt: skip
    assert max(u, v) < 1e-5


# --- 46 to 48: which samples a triangle and a polygon cover ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def ten_thousand():
    """Triangles (n, 6), samples (n, k, 2) in, on and about them, and which they cover by fractions."""
    triangles, samples = random_triangles(10_000, seed=1)
    pairs = zip(triangles, samples, strict=True)
    return triangles, samples, np.array([[exactly(t, s) for s in row] for t, row in pairs])


@pytest.mark.long
@pytest.mark.parametrize("name", raster_coverage.NAMES)
def test_every_sample_of_ten_thousand_triangles(name, ten_thousand):
    triangles, samples, expected = ten_thousand
    assert 0.2 < expected.mean() < 0.6
    assert np.array_equal(covered(raster_coverage.NAMES[name], triangles, samples), expected)


@pytest.mark.long
def test_lines_with_slopes(measured, ten_thousand):
    triangles, samples, expected = ten_thousand
    some = zip(triangles[:2000].reshape(-1, 3, 2) / raster_coverage.ONE, samples[:2000] / raster_coverage.ONE, strict=True)
    answers = [[naive.lines(t, s) for s in row] for t, row in some]
    known = np.array([[-1 if a is None else int(a) for a in row] for row in answers])
    wrong = float(np.mean(known[known >= 0] != expected[:2000][known >= 0]))
    ours = int(np.sum(covered(raster_coverage.EDGES, triangles, samples) != expected))
    measured.place(
        46, "edge lines y = a x + b, 10⁴ triangles", naive=f"{np.mean(known == -1):.0%} divide by 0, {wrong:.0%} of the others are wrong",
        ours=f"{ours} of {expected.size} samples differ from fractions", bound="0",
    )  # fmt: skip
    assert np.mean(known == -1) > 0.1
    assert wrong > 0.05
    assert ours == 0


def test_areas_that_must_be_equal(measured, ten_thousand):
    """S1 + S2 + S3 == S, in a unit in which the corners are not whole numbers."""
    triangles, samples, expected = ten_thousand
    plain = naive.equal_areas(triangles.reshape(-1, 3, 2) / 3.0, samples / 3.0)
    ours = int(np.sum(covered(raster_coverage.AREAS, triangles, samples) != expected))
    measured.place(
        47, "S1 + S2 + S3 = S by equality, 10⁴ triangles", naive=f"misses {np.mean(~plain[expected]):.0%} of the samples inside",
        ours=f"{ours} of {expected.size} samples differ from fractions", bound="0: the same samples as 46",
    )  # fmt: skip
    assert np.mean(~plain[expected]) > 0.3
    assert ours == 0


@pytest.mark.long
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_three_fills_agree_on_any_triangles(seed):
    triangles, samples = random_triangles(60, seed)
    expected = np.array([[exactly(t, s) for s in row] for t, row in zip(triangles, samples, strict=True)])
    for how in raster_coverage.NAMES.values():
        assert np.array_equal(covered(how, triangles, samples), expected)


@pytest.mark.parametrize("name", raster_coverage.NAMES)
def test_far_corners_do_not_overflow(name):
    """Corners at the guard band, 2²⁰ pixels away, still give exact answers."""
    far = raster_coverage.ONE << 20
    triangles = np.array([[-far, -far, far, far - 1, -far + 1, far], [far, -far, -far, far, far, far]])
    samples = np.array([[[0, 0], [1, 0], [-1, 0], [0, 1], [7, -7]]] * 2)
    expected = [[exactly(t, s) for s in row] for t, row in zip(triangles, samples, strict=True)]
    assert covered(raster_coverage.NAMES[name], triangles, samples).tolist() == expected


@kernel
def cover_loops(x, y, starts, counts, samples, out):
    """out[k]: whether samples[k] lies inside of the loops by the scanline fill."""
    room = x.copy()
    for k in range(len(samples)):
        found = 0
        for loop in range(len(starts)):
            found = raster_coverage.crossings(x, y, starts[loop], counts[loop], samples[k, 1], room, found)
        out[k] = raster_coverage.inside_crossings(room, found, samples[k, 0])


def holed(seed: int) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Loops of a concave polygon with a hole, samples on and about its corners, which of them its triangulation covers, and owners."""
    random = np.random.default_rng(seed)
    loops = [star(random, 1500, 5000, int(random.integers(5, 24))), star(random, 300, 1000, int(random.integers(3, 9)))[::-1]]
    points = np.concatenate(loops)
    ends = np.cumsum([len(loop) for loop in loops]).astype(np.uint32)
    triangles = points[mapbox_earcut.triangulate_float64(points.astype(np.float64), ends).reshape(-1, 3)].reshape(-1, 6)
    grid = np.stack(np.meshgrid(np.arange(-5000, 5000, 331), np.unique(points[:, 1])), axis=-1).reshape(-1, 2)  # on every corner's line
    samples = np.concatenate([grid, points, points + [1, 0], points - [1, 0]])
    owners = np.sum([covered(raster_coverage.EDGES, t[None], samples[None])[0] for t in triangles], axis=0)
    return loops, samples, owners == 1, owners


def by_scanline(loops: list[np.ndarray], samples: np.ndarray) -> np.ndarray:
    points, counts = np.concatenate(loops), np.array([len(loop) for loop in loops])
    out = np.empty(len(samples), np.bool_)
    cover_loops(points[:, 0].copy(), points[:, 1].copy(), np.cumsum(counts) - counts, counts, samples, out)
    return out


@pytest.mark.long
def test_scanlines_through_corners(measured):
    """Concave polygons with holes, on the level lines through their corners: the samples of their triangulation."""
    plain = ours = total = 0
    for seed in range(30):
        loops, samples, expected, owners = holed(seed)
        assert owners.max() == 1  # no sample of an inner edge belongs to two triangles
        ours += int(np.sum(by_scanline(loops, samples) != expected))
        some = np.random.default_rng(seed).integers(0, len(samples), 60)
        plain += sum(naive.even_odd(loops, samples[k]) != expected[k] for k in some)
        total += len(samples)
    measured.place(
        48, "even–odd along lines through corners, 30 concave polygons with holes",
        naive=f"edges closed at both ends: {plain / 1800:.0%} of the samples wrong", ours=f"{ours} of {total} wrong",
        bound="0: the samples of the triangulation",
    )  # fmt: skip
    assert plain > 50
    assert ours == 0


@given(st.integers(31, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_any_polygon_covers_the_samples_of_its_triangulation(seed):
    loops, samples, expected, _ = holed(seed)
    assert np.array_equal(by_scanline(loops, samples), expected)


def test_the_flat_view_is_what_it_says():
    """One metre a pixel: a square of 3 m covers 9 pixels."""
    points = np.array([[-1.5, -1.5, 0], [1.5, -1.5, 0], [1.5, 1.5, 0], [-1.5, 1.5, 0]], float)
    tables = scene(meshes=[(mesh(points, [[0, 1, 2], [0, 2, 3]]), matrix((0.5, 0.5, -3)), 0)], camera=flat(8))
    assert picture(tables, size=(8, 8)).channels["rgba"][..., 3].sum() == 9
