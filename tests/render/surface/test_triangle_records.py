"""Triangle records: equal to the data of their meshes, and pictures equal to brute force."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.render.accel import primitive_list
from maquette.render.integrator import wave_intersection
from maquette.render.lanes import ops
from maquette.render.light import light_samples
from maquette.render.surface import interaction, triangle_records
from maquette.render.types import Hit, Ray

ROOM = """
polygon([[-3, 0, 3], [3, 0, 3], [3, 0, -3], [-3, 0, -3]], material: lambert(0.5))
polygon([[-3, 0, -3], [3, 0, -3], [3, 3, -3], [-3, 3, -3]], material: lambert(0.7))
area([0, 2.9, 0], size: [1, 1], luminance: 5)
camera(position: [0, 1.5, 4], look_at: [0, 0.8, 0], fov: 50deg)
render(bounces: 3)
"""
SIZE, SAMPLES = (24, 18), 4


def hill(path: Path, normals: bool) -> None:
    """A grid of 648 triangles, as OBJ."""
    across = np.linspace(-1.0, 1.0, 19)
    x, z = np.meshgrid(across, across)
    y = 0.4 * np.cos(2.0 * x) * np.cos(3.0 * z)
    slope = np.stack([0.8 * np.sin(2.0 * x) * np.cos(3.0 * z), np.ones_like(x), 1.2 * np.cos(2.0 * x) * np.sin(3.0 * z)], axis=-1)
    lines = [f"v {a:.6f} {b:.6f} {c:.6f}" for a, b, c in zip(x.ravel(), y.ravel(), z.ravel(), strict=True)]
    if normals:
        lines += ["vn {:.6f} {:.6f} {:.6f}".format(*n) for n in slope.reshape(-1, 3)]
    corner = "{0}//{0}" if normals else "{0}"
    for j in range(18):
        for i in range(18):
            a, b, c, d = (19 * j + i + 1, 19 * j + i + 20, 19 * j + i + 21, 19 * j + i + 2)
            lines += [" ".join(["f", *(corner.format(k) for k in face)]) for face in ((a, b, c), (a, c, d))]
    path.write_text("\n".join(lines))


def scene_of(folder: Path, text: str) -> ir.Scene:
    hill(folder / "flat.obj", False)
    hill(folder / "smooth.obj", True)
    (folder / "a.scene").write_text(ROOM + text)
    return maquette.load(folder / "a.scene")


def drawn(scene: ir.Scene, **decisions: str) -> np.ndarray:
    return maquette.render(scene, size=SIZE, samples=SAMPLES, backend="ray", plan=decisions).channels["rgba"]


MESH = 'mesh("{0}.obj", translate: [0, 0.8, 0], rotate: [20deg, 30deg, 0], material: lambert(0.8, shading: "{1}"))'
MANY = "\n".join(
    f"sphere(0.05, center: [{0.2 * (k % 20) - 2:.2f}, {0.1 + 0.12 * (k // 50):.2f}, {0.3 * (k % 7) - 1:.2f}])" for k in range(700)
)


@pytest.mark.long
@pytest.mark.parametrize("text", [MESH.format("flat", "flat"), MANY], ids=["one mesh", "many things"])
def test_pictures_match_brute_force(tmp_path: Path, text: str) -> None:
    scene = scene_of(tmp_path, text)
    assert np.array_equal(drawn(scene), drawn(scene, accelerator="brute_force"))


def test_rounded_triangles_match_their_meshes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(tmp_path, MESH.format("smooth", "phong"))
    by_rows = drawn(scene)
    monkeypatch.setattr(triangle_records, "MOST", 0)
    by_mesh = drawn(scene)
    assert np.median(np.abs(by_rows - by_mesh)) < 1e-5  # some path goes another way after the last bit of a direction
    assert by_rows[..., :3].mean() == pytest.approx(by_mesh[..., :3].mean(), rel=0.02)


def test_rounded_triangles_in_double_precision(tmp_path: Path) -> None:
    """As with formulas, and where the largest coordinate is many times the smallest instance."""
    scene = scene_of(tmp_path, MESH.format("smooth", "phong"))
    narrow, wide = (drawn(scene, precision=kind) for kind in ("float32", "float64"))
    assert np.median(np.abs(narrow - wide)) < 1e-5
    assert narrow[..., :3].mean() == pytest.approx(wide[..., :3].mean(), rel=0.02)


@pytest.mark.parametrize("how", ["", ", scale: [-2, 2, 2]", ", scale: [1, 3, 1]"], ids=["plain", "mirrored", "stretched"])
@pytest.mark.parametrize("name", ["flat", "smooth"])
def test_records_match_interactions(tmp_path: Path, name: str, how: str) -> None:
    scene = scene_of(tmp_path, MESH.format(name, {"flat": "flat", "smooth": "phong"}[name]).replace("0.8, 0]", f"0.8, 0]{how}", 1))
    tables = scene.tables
    tried, inside = primitive_list.build(tables, True)
    (i,) = np.flatnonzero(tables.geometries.triangle_count[tables.instances.geometry] == 648)
    assert not inside[i]
    first = int(tried.records.first[i])
    if name == "smooth" and "3" in how:  # interpolated normals of the world are not those of the mesh
        assert first == triangle_records.NONE
        return
    numbers = np.arange(648) + int(tables.geometries.first_triangle[tables.instances.geometry[i]])
    rng = np.random.default_rng(3)
    u = rng.uniform(0.0, 0.5, 648)
    v = rng.uniform(0.0, 0.5, 648)
    zero = np.zeros(648)
    direction = (zero, zero - 1.0, zero)
    ray = Ray((zero, zero + 9.0, zero), direction, zero, zero + np.inf, None)
    surface = interaction.make_interaction(tables, ray, Hit(zero + 9.0, np.full(648, i), numbers, u, v))
    rows = tried.records.rows[first + numbers]
    side = np.where(surface.front, 1.0, -1.0)
    assert np.allclose(rows[:, :3], np.stack(surface.geometric, axis=1) * side[:, None], atol=2e-5)
    assert np.array_equal(rows[:, 4:7], np.stack([np.full(648, i), numbers, surface.material], axis=1))
    assert (rows[:, 7] == (triangle_records.ROUNDED if name == "smooth" else triangle_records.PLAIN)).all()
    wide = (surface.offset / (interaction.ROUNDING * ops.roundoff(zero))) >= -rows[:, 3] * (1 - 1e-5)
    assert wide.all()
    if name == "smooth":
        corners = tried.records.rounded.corners.reshape(-1, triangle_records.CORNERS)[:, :9].reshape(-1, 3, 3)
        mean = np.einsum("nk,nkx->nx", np.stack([1.0 - u - v, u, v], axis=1), corners)
        mean /= np.linalg.norm(mean, axis=1, keepdims=True)
        mean *= np.sign(np.sum(mean * rows[:, :3], axis=1, keepdims=True))
        assert np.allclose(mean, np.stack(surface.normal, axis=1) * side[:, None], atol=2e-5)


def test_a_formulas_primitive_is_no_row():
    """A formula's primitive is its spacing, up to 10¹⁵, far beyond any table."""
    scene = SimpleNamespace(primitives=SimpleNamespace(records=SimpleNamespace(first=np.array([triangle_records.NONE, -3, 7], np.int32))))
    instance, primitive = np.array([0, 0, 0, 1, 2, -1]), np.array([10**15, 5, -1, 4, 0, -1])
    assert wave_intersection.row_of(scene, instance, primitive).tolist() == [-1, -1, -1, 1, 7, -1]


@pytest.mark.long
def test_large_instances_of_many_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same list as with the primitives of all instances as candidates."""
    tables = scene_of(tmp_path, MANY + "\nbox([2, 2, 1], center: [0, 1, -2])\nbox(0.5)\nplane(translate: [0, -1, 0])").tables
    quick, inside = primitive_list.build(tables, True)
    every = np.ones(len(tables.instances.geometry), bool)
    monkeypatch.setattr(primitive_list, "eligible_primitives", lambda tables, boxes: (every, False))
    slow, also = primitive_list.build(tables, True)
    assert np.array_equal(inside, also)
    assert 4 <= np.count_nonzero(inside) <= 6
    for part in ("seen", "blocking"):
        for a, b in zip(getattr(quick, part), getattr(slow, part), strict=True):
            assert np.array_equal(a, b)


LAMPS = """
group(rotate: [20deg, 40deg, 10deg], scale: [2, 1, 3]) { area([0.2, 2.9, 0], size: [1, 0.5], luminance: 5) }
area([-1, 2.5, 1], look_at: [0.3, 0, 0], size: 1, luminance: 5, shape: "disk")
sphere(0.4, center: [1, 2, 1], material: emissive(luminance: 3))
"""


def test_lights_lie_between_their_corners(tmp_path: Path) -> None:
    tables = scene_of(tmp_path, LAMPS).tables
    corners = primitive_list.light_corners(tables)
    u, v = np.random.default_rng(2).uniform(0, 1, (2, 4000))
    origin = tuple(np.full(4000, x) for x in (0.1, 0.4, 2.5))
    samples = []
    for row in np.flatnonzero(np.isin(tables.lights.kind, (ir.LightKind.RECTANGLE, ir.LightKind.DISK, ir.LightKind.SPHERE))):
        arriving = light_samples.sample(tables, int(row), origin, u, v)
        samples.append(np.stack([o + arriving.distance * d for o, d in zip(origin, arriving.direction, strict=True)], axis=1))
    points = np.concatenate(samples)
    assert len(samples) == 4
    assert (points >= corners.min(axis=0) - 1e-9).all()
    assert (points <= corners.max(axis=0) + 1e-9).all()
    assert np.abs(np.ptp(points, axis=0) / np.ptp(corners, axis=0) - 1.0).max() < 0.1
