"""Tests of emitter sampling by solid angle: densities, closed forms and variance."""

from __future__ import annotations

import math

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.render.accel import intersect
from maquette.render.light import emitter_table, emitters
from maquette.render.surface import interaction
from maquette.render.surface.material_inputs import color_of
from maquette.render.types import Hit, Ray

from ...files import write_image
from ..chi2 import chi2

SAMPLES = 1_000_000
DISK = "disk(0.8, center: [0.1, 0, -0.2], normal: [0.2, 1, 0.1], material: emissive(luminance: 3))"
TRIANGLE = "polygon([[-0.6, 0, 0.4], [0.9, 0.1, 0.2], [0.1, 0.3, -0.8]], material: emissive(luminance: 3))"
TUBE = "cylinder(0.2, 1.6, rotate: [20deg, 0, 30deg], material: emissive(luminance: 3))"
CONE = "cone(0.5, 0.9, top: 0.2, rotate: [20deg, 0, 30deg], capped: false, material: emissive(luminance: 3))"
SHUT = "cone(0.5, 0.9, rotate: [20deg, 0, 30deg], material: emissive(luminance: 3))"
PIPE = "cylinder(0.4, 1, rotate: [0, 0, 40deg], scale: 1.5, capped: false, material: emissive(luminance: 3))"
RING = "torus(0.6, 0.25, rotate: [20deg, 0, 30deg], material: emissive(luminance: 3))"
PILL = "capsule(0.3, 1.1, rotate: [20deg, 0, 60deg], material: emissive(luminance: 3))"
EGG = "sphere(0.4, scale: [1, 1.6, 0.7], rotate: [20deg, 0, 30deg], material: emissive(luminance: 3))"
BOX = "box([0.8, 0.5, 0.3], rotate: [20deg, 0, 30deg], material: emissive(luminance: 3))"
HIDING = (CONE, SHUT, PIPE, RING, PILL, EGG)  # sampled by area: parts of them block each other
PLACES = {
    "a disk above": (DISK, (0.2, -0.4, 0.1)),
    "a disk very near": (DISK, (0.3, 0.05, 0.2)),
    "a disk aside": (DISK, (1.1, 0.3, 0.6)),
    "a disk in its plane but for a little": (DISK, (1.3, -0.15, 0.3)),
    "a disk far off": (DISK, (2.0, 3.0, 1.0)),
    "a triangle above": (TRIANGLE, (0.1, 0.5, 0.0)),
    "a triangle very near": (TRIANGLE, (0.2, 0.15, 0.1)),
    "a triangle below and aside": (TRIANGLE, (0.9, -0.3, -0.6)),
    "a triangle far off": (TRIANGLE, (2.0, 3.0, 1.0)),
    "a tube": (TUBE, (0.5, 0.3, 0.2)),
    "a tube very near": (TUBE, (0.1, 0.2, -0.18)),
    "a tube beyond its end": (TUBE, (-0.9, 1.1, 0.4)),
    "a tube far off": (TUBE, (3.0, 2.0, 4.0)),
    "a tube from within": (TUBE, (0.05, 0.0, 0.05)),
    "an open cone": (CONE, (0.9, 0.3, 0.2)),
    "an open cone from within": (CONE, (0.1, 0.0, 0.05)),
    "an open cone from above": (CONE, (-0.4, 0.9, 0.4)),
    "a closed cone": (SHUT, (0.7, 0.4, 0.4)),
    "an open cylinder": (PIPE, (0.2, 0.1, 2.4)),
    "a torus": (RING, (0.9, 0.6, 0.5)),
    "a torus from its hole": (RING, (0.05, 0.1, 0.0)),
    "a capsule": (PILL, (0.4, 0.8, 0.6)),
    "an ellipsoid": (EGG, (1.3, 1.2, 1.0)),
    "a box": (BOX, (-1.0, 0.4, 0.5)),
}
LONG = ("an open cone", "an open cone from within", "an open cylinder", "a torus", "a torus from its hole", "an ellipsoid")
"""Places whose densities take 10 seconds and more; others of the same surfaces are quick."""
SLIVERS = ("a disk in its plane but for a little", "a triangle below and aside", "a tube beyond its end", "a tube far off")


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Of a text: (tables, emitters, what brute force searches)."""
    tables_of = {}
    for number, text in enumerate(dict.fromkeys(text for text, _ in PLACES.values())):
        path = tmp_path_factory.mktemp("emitters") / f"{number}.scene"
        path.write_text(text)
        tables = maquette.load(path).tables
        tables_of[text] = tables, emitter_table.build(tables)
    return tables_of


def met(tables: ir.Tables, origin, direction):
    """(t, primitive), inf where nothing is met."""
    n = len(direction[0])
    zero = np.zeros(n)
    ray = Ray((zero + origin[0], zero + origin[1], zero + origin[2]), direction, zero, zero + np.inf, None)
    hit = intersect.closest_hit(None, tables, ray, np.ones(n, bool), 1)
    return np.where(hit.instance >= 0, hit.t, np.inf), hit.primitive


class Zoom:
    """A cap of the sphere that holds all directions, blown up to the whole of it without changing shares of area."""

    def __init__(self, directions, counted):
        ways = np.stack(directions)[:, counted]
        axis = ways.mean(axis=1)
        self.axis = axis / np.linalg.norm(axis)
        self.x = np.cross(self.axis, [0.6, 0.0, 0.8] if abs(self.axis[1]) > 0.7 else [0.0, 1.0, 0.0])
        self.x /= np.linalg.norm(self.x)
        self.z = np.cross(self.axis, self.x)
        self.share = min(0.55 * (1.0 - float((self.axis @ ways).min())), 1.0)  # of the sphere: a little more than there is

    def out(self, directions):
        x, y, z = (sum(a * c for a, c in zip(axis, directions, strict=True)) for axis in (self.x, self.axis, self.z))
        y = np.clip(1.0 - (1.0 - y) / self.share, -1.0, 1.0)
        grown = np.sqrt(1.0 - y * y) / np.maximum(np.hypot(x, z), 1e-300)
        return x * grown, y, z * grown

    def back(self, directions):
        x, y, z = directions
        y = 1.0 - (1.0 - y) * self.share
        shrunk = np.sqrt(1.0 - y * y) / np.maximum(np.hypot(x, z), 1e-300)
        return tuple(x * shrunk * a + y * b + z * shrunk * c for a, b, c in zip(self.x, self.axis, self.z, strict=True))


def drawn(tables, table, place, count, seed=3):
    rng = np.random.default_rng(seed)
    return emitters.sample(tables, table, int(table.first[0]), tuple(np.full(count, c) for c in place), *rng.random((2, count)))


@pytest.mark.long
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in PLACES])
def test_directions_are_spread_as_their_density_says(scenes, name):
    """χ² (oracle 34) of the first row: the disk, the triangle, the cylinder's side; those that pass it count as none."""
    text, place = PLACES[name]
    tables, table = scenes[text]
    arriving = drawn(tables, table, place, SAMPLES)

    def density(direction):
        flat = tuple(np.ravel(c) for c in direction)
        t, primitive = met(tables, place, flat)
        is_hit = np.isfinite(t) & (primitive == 0)
        where = tuple(np.full(len(t), c) for c in place)
        densities = emitters.density(table, int(table.first[0]), where, flat, np.where(is_hit, t, 1.0))
        return np.where(is_hit, densities, 0.0).reshape(direction[0].shape)

    seen = arriving.light[0] > 0.0
    if text in HIDING:
        seen &= np.abs(met(tables, place, arriving.direction)[0] / arriving.distance - 1.0) < 1e-6
    zoom = Zoom(arriving.direction, seen)
    fine = 144 if text == EGG else 96 if name in SLIVERS or text in (*HIDING, BOX) else 24
    chi2(zoom.out(arriving.direction), seen, lambda d: density(zoom.back(d)) * zoom.share, fine=fine)


@pytest.mark.parametrize("name", PLACES)
def test_what_is_drawn_is_met_there_with_that_density(scenes, name):
    text, place = PLACES[name]
    tables, table = scenes[text]
    arriving = drawn(tables, table, place, 2000)
    lit = arriving.light[0] > 0.0
    t, primitive = met(tables, place, arriving.direction)
    assert lit.mean() > 0.2
    if text in HIDING:
        lit &= np.abs(t / arriving.distance - 1.0) < 1e-6
    assert np.mean((primitive == 0)[lit]) > 0.99  # the rest grazes an edge
    lit &= np.isfinite(t) & (primitive == 0)
    assert arriving.distance[lit] == pytest.approx(t[lit], rel=2e-3)
    where = tuple(np.full(lit.sum(), c) for c in place)
    densities = emitters.density(table, int(table.first[0]), where, tuple(c[lit] for c in arriving.direction), t[lit])
    assert densities == pytest.approx(arriving.density[lit], rel=1e-4)
    assert 3.0 / densities == pytest.approx(arriving.light[0][lit], rel=1e-4)


def lambert(corners, place, normal):
    """E / L of a polygon in front of a place (Lambert): ½ |Σ βᵢ n · Γᵢ|."""
    ways = [(np.array(c) - place) / np.linalg.norm(np.array(c) - place) for c in corners]
    total = 0.0
    for a, b in zip(ways, ways[1:] + ways[:1], strict=True):
        across = np.cross(a, b)
        total += math.atan2(float(np.linalg.norm(across)), float(a @ b)) * float(across @ normal) / float(np.linalg.norm(across))
    return 0.5 * abs(total)


def test_a_triangle_gives_what_lambert_says(scenes):
    """And all samples of its own light are alike: only the cosine at the place is left to stray."""
    tables, table = scenes[TRIANGLE]
    place, normal = np.array([0.2, -0.2, 0.0]), np.array([0.0, 1.0, 0.0])
    arriving = drawn(tables, table, place, 200_000)
    corners = [(-0.6, 0, 0.4), (0.9, 0.1, 0.2), (0.1, 0.3, -0.8)]
    irradiance = arriving.light[0] * (arriving.direction[1] * normal[1])
    assert irradiance.mean() == pytest.approx(3.0 * lambert(corners, place, normal), abs=4 * irradiance.std() / math.sqrt(len(irradiance)))
    assert np.ptp(arriving.light[0]) < 1e-6 * arriving.light[0].mean()


@pytest.mark.parametrize("place", [(0.0, 0.1), (0.5, 0.1), (0.9, 0.3), (1.4, 0.4), (0.0, 1.0)])
def test_a_disk_gives_the_closed_form(tmp_path, place):
    """Oracle 17, and its samples stray from their mean by less than a tenth, where by area they do by up to several times it."""
    path = tmp_path / "a.scene"
    path.write_text("disk(1, normal: [0, -1, 0], material: emissive(luminance: 1))")
    tables = maquette.load(path).tables
    q, h = place
    arriving = drawn(tables, emitter_table.build(tables), (q, -h, 0.0), 200_000)
    irradiance = arriving.light[0] * arriving.direction[1]
    squares = h * h + q * q + 1.0
    answer = 0.5 * math.pi * (1.0 - (h * h + q * q - 1.0) / math.sqrt(squares * squares - 4.0 * q * q))
    assert irradiance.mean() == pytest.approx(answer, abs=4 * irradiance.std() / math.sqrt(len(irradiance)))
    assert arriving.light[0].std() < 0.1 * arriving.light[0].mean()


def test_scenes_without_such_lights_have_no_marks(tmp_path):
    path = tmp_path / "a.scene"
    path.write_text("sphere(1)\narea([0, 3, 0], size: 1, luminance: 2)\nsphere(0.1, center: [2, 0, 0], material: emissive(luminance: 2))")
    assert not any(emitter_table.build(maquette.load(path).tables).wide)


def test_what_shines_throws_shadows_where_there_are_no_lamps(tmp_path):
    """And blocks no light of its own: a floor under a shining disk, with and without a plate between them."""
    floor = "plane(y: 0, material: lambert(1))\ndisk(0.5, center: [0, 1, 0], normal: [0, -1, 0], material: emissive(luminance: 4))\n"
    floor += "camera(position: [0, 0.4, 3], look_at: [0, 0, 0], fov: 0.1deg)\nrender(bounces: 1)\n"
    plate = "disk(3, center: [0, 0.6, 0], material: lambert(0))\n"
    means = []
    for text in (floor, floor + plate):
        path = tmp_path / "a.scene"
        path.write_text(text)
        means.append(maquette.render(path, size=(4, 4), samples=256, seed=2).channels["rgba"][..., :3].mean())
    assert means[0] == pytest.approx(4.0 * 0.25 / 1.25, rel=0.01)  # π R² / (h² + R²) over π
    assert means[1] == 0.0


PATTERNED = {text: text.replace("emissive(luminance: 3)", "emissive(PATTERN, luminance: 3)") for text, _ in PLACES.values()}
PATTERNS = ("checker(#ff2000, #40ff80, size: 13cm)", 'image("grid.png")')


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("text", PATTERNED)
def test_light_samples_have_the_radiance_that_rays_meet(tmp_path, text, pattern):
    """By solid patterns and by texture coordinates, on every kind of shape; a row of the table has about the mean over its shape."""
    path = tmp_path / "a.scene"
    path.write_text(PATTERNED[text].replace("PATTERN", pattern))
    texels = np.random.default_rng(5).integers(0, 255, (12, 16, 3), np.uint8)
    write_image(tmp_path / "grid.png", texels)
    tables = maquette.load(path).tables
    table = emitter_table.build(tables)
    assert table.textured.tolist() == (table.light < 0).tolist()
    place = next(place for placed_text, place in PLACES.values() if placed_text == text)
    arriving = drawn(tables, table, place, 4000)
    n = len(arriving.distance)
    zero = np.zeros(n)
    ray = Ray((zero + place[0], zero + place[1], zero + place[2]), arriving.direction, zero, zero + np.inf, None)
    hit = intersect.closest_hit(None, tables, ray, np.ones(n, bool), 1)
    seen = (arriving.light[0] > 0.0) & (np.abs(hit.t / arriving.distance - 1.0) < 1e-5) & (hit.primitive == 0)
    assert seen.mean() > 0.1
    point = interaction.make_interaction(tables, ray, Hit(*(np.where(seen, column, column[seen][0]) for column in hit)))
    met_there = np.stack(color_of(tables, point, int(ir.Slot.EMISSION)))[:, seen]
    sampled = (np.stack(arriving.light) * np.where(np.isfinite(arriving.density), arriving.density, 0.0))[:, seen]
    alike = np.isclose(sampled, met_there, rtol=1e-3, atol=1e-3).all(axis=0)
    assert alike.mean() > 0.995  # the rest lies at the edge of a square
    assert met_there.std() > 0.1
    assert table.color[table.textured].mean() == pytest.approx(met_there.mean(), rel=0.5)


@pytest.mark.parametrize(
    ("shape", "rows", "share"), [(DISK, 1, 1.0), (DISK, 1, 0.25), (TRIANGLE, 1, 0.25), (EGG, 1, 1.0), (EGG, 0, 0.25)]
)  # fmt: skip
def test_flat_emitters_that_are_partly_transparent_have_as_much_less_light(tmp_path, shape: str, rows: int, share: float) -> None:
    """Of round ones the back shows through the front: BSDF samples alone find both."""
    material = f"emissive(luminance: 3, opacity: {share})"
    text = shape.replace("emissive(luminance: 3)", material) + "\ncamera(position: [0, 3, 9], look_at: [0, 0, 0])\n"
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    table = emitter_table.build(maquette.load(tmp_path / "a.scene").tables)
    shapes = table.instance >= 0
    assert shapes.sum() == rows
    assert table.color[shapes] == pytest.approx(np.full((rows, 3), 3.0 * share))
