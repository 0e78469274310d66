"""Formula surfaces as triangles: closed, of the right genus and volume, with their sharp edges; and the files they are written to."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import load
from maquette.compiler.formula import dual_contouring, solid_fields
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.opcodes import Op
from maquette.compiler.formula.tape import Tape, load_tape
from maquette.compiler.mesh import mesh_csg
from maquette.render.accel import ray_queries
from maquette.shapes import SHAPES

CUBE = np.array([[-1.0] * 3, [1.0] * 3])
POINT = (0, 1, 2)


def shape(kind: int, *parameters: float) -> Tape:
    builder = Builder()
    return builder.finish(SHAPES[kind].field(builder, parameters, POINT))


def drilled() -> Tape:
    builder = Builder()
    box = SHAPES[2].field(builder, (0.5, 0.6, 0.4), POINT)
    hole = SHAPES[6].field(builder, (0.25, 1.0, 1.0), POINT)
    return builder.finish(builder.op(Op.MAX, box, builder.op(Op.NEGATE, hole)))


def gyroid() -> Tape:
    b = Builder()
    x, y, z = (b.scale(name, 6.0) for name in POINT)
    waves = [b.multiply(b.op(Op.SIN, p), b.op(Op.COS, q)) for p, q in ((x, y), (y, z), (z, x))]
    return b.finish(b.op(Op.MAX, b.add(b.add(*waves[:2]), waves[2]), b.offset(solid_fields.length(b, POINT), -0.9)))


def volume(made: dual_contouring.Contour) -> float:
    a, b, c = (made.positions[made.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def euler(made: dual_contouring.Contour) -> int:
    return len(np.unique(made.triangles)) - len(made.triangles) * 3 // 2 + len(made.triangles)


def bad_fans(made: dual_contouring.Contour) -> int:
    """Vertices whose triangles are not one ring around them."""
    after: list[dict[int, int]] = [{} for _ in made.positions]
    bad = set()
    for triangle in made.triangles.tolist():
        for k in range(3):
            a, b, c = triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]
            if b in after[a]:
                bad.add(a)
            after[a][b] = c
    for vertex, ring in enumerate(after):
        if ring:
            first = at = next(iter(ring))
            length = 0
            while length <= len(ring):
                at, length = ring.get(at, -1), length + 1
                if at in (first, -1):
                    break
            if at != first or length != len(ring):
                bad.add(vertex)
    return len(bad)


def formula(tmp_path: Path, text: str) -> tuple[Tape, np.ndarray]:
    path = tmp_path / "a.scene"
    path.write_text("camera(position: [0, 0, 5])\n" + text + "\n", encoding="utf-8")
    tables = load.load(path).tables
    (row,) = np.flatnonzero(tables.geometries.tape >= 0)
    return load_tape(tables, int(tables.geometries.tape[row])), tables.geometries.bounds[row]


@pytest.mark.long
@pytest.mark.parametrize("count", [21, 32])
@pytest.mark.parametrize(
    "text",
    [
        "implicit(|x, y, z| noise(4 * x, 4 * y, 4 * z) <= -0.1, within: 0.9)",
        "implicit(|x, y, z| abs(sin(9 * x) * cos(9 * y) + sin(9 * y) * cos(9 * z) + sin(9 * z) * cos(9 * x)) <= 0.2, within: 0.5)",
        "implicit(|x, y, z| sin(6 * x) * sin(6 * y) * sin(6 * z) >= 0, within: 1)",
        "union { box(0.5, center: [0.25, 0.25, 0]); box(0.5, center: [-0.25, -0.25, 0]) }",
        "implicit(|x, y, z| x^2 + z^2 <= y^2, within: 1)",
        "implicit(|x, y, z| hypot(mod(x, 0.5) - 0.25, mod(y, 0.5) - 0.25, mod(z, 0.5) - 0.25) <= 0.25, within: 1)",
    ],
    ids=["noise", "gyroid", "checkers", "an edge touched", "an apex", "balls that touch"],
)
def test_whatever_touches_edges_have_two_triangles_and_vertices_one_ring(tmp_path, text, count):
    """Cells of four roots on a face: where two of them would put two edges in one place they decide otherwise."""
    made = dual_contouring.contour(*formula(tmp_path, text), count)
    assert len(made.triangles) > 200
    assert dual_contouring.open_edges(made.triangles) == 0
    assert bad_fans(made) == 0


def test_a_jump_is_no_deviation(tmp_path):
    """The slope of steps says nothing of their fronts: the nearest change of sign does."""
    made = dual_contouring.contour(*formula(tmp_path, "implicit(|x, y, z| floor(4 * x) / 5 >= 2 * y, within: 1)"), 48)
    assert dual_contouring.open_edges(made.triangles) == 0
    assert made.furthest < 2 / 48  # a cell


@pytest.mark.long
def test_volumes_between_where_rays_enter_and_leave(tmp_path):
    """∫(z_back − z_front) is the volume, by rays through the formula and by its triangles."""
    steps = (np.arange(240) + 0.5) / 240 * 2 - 1
    x, y = (part.ravel() for part in np.meshgrid(steps, steps))
    o, d = np.stack([x, y, np.full_like(x, 3.0)], axis=1), np.tile([0.0, 0.0, -1.0], (len(x), 1))
    for text, size in (
        ("implicit(|x, y, z| (hypot(x, z) - 0.6)^2 + y^2 + 0 * noise(x, y, z) <= 0.0625)", 2 * math.pi**2 * 0.6 * 0.0625),
        ("implicit(|x, y, z| hypot(x, y, z)^3 <= 0.512 and noise(x, y, z) <= 5)", 4 / 3 * math.pi * 0.512),
    ):
        tape, bounds = formula(tmp_path, text)
        trees = ray_queries.build(load.load(tmp_path / "a.scene").tables, closed=False)
        assert volume(dual_contouring.contour(tape, bounds, 64)) == pytest.approx(size, rel=4e-3)
        total, begin = 0.0, np.zeros(len(o))
        for _ in range(2):  # in and out, twice through a ring
            enter = ray_queries.closest(trees, o, d, begin).t
            hit = np.isfinite(enter)
            leave = ray_queries.closest(trees, o, d, np.where(hit, enter + 1e-9, 1e9)).t
            total += float((leave[hit] - enter[hit]).sum())
            begin = np.where(hit, leave + 1e-9, 1e9)
        assert total * (2 / 240) ** 2 == pytest.approx(size, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize(
    ("tape", "euler_number", "size"),
    [
        (shape(1, 0.7), 2, 4 / 3 * math.pi * 0.7**3),
        (shape(8, 0.6, 0.25), 0, 2 * math.pi**2 * 0.6 * 0.25**2),
        (drilled(), 0, 1.0 * 1.2 * 0.8 - math.pi * 0.25**2 * 1.2),
    ],
    ids=["sphere", "torus", "drilled box"],
)
def test_a_solid_is_closed_with_its_genus_and_volume(tape, euler_number, size):
    made = dual_contouring.contour(tape, CUBE, 48)
    assert dual_contouring.open_edges(made.triangles) == 0
    assert euler(made) == euler_number
    assert volume(made) == pytest.approx(size, rel=8e-3)
    finer = dual_contouring.contour(tape, CUBE, 96)
    assert abs(volume(finer) - size) < 0.4 * abs(volume(made) - size)
    assert finer.furthest < 0.4 * made.furthest


def test_many_sheets_stay_closed():
    made = dual_contouring.contour(gyroid(), CUBE, 40)
    assert len(made.triangles) > 1000
    assert dual_contouring.open_edges(made.triangles) == 0


def test_edges_and_corners_are_sharp():
    made = dual_contouring.contour(shape(2, 0.53, 0.61, 0.47), CUBE, 24)
    corner = np.array([0.53, 0.61, 0.47])
    assert np.linalg.norm(made.positions - corner, axis=1).min() < 1e-9
    assert made.furthest < 1e-9
    assert volume(made) == pytest.approx(8 * np.prod(corner), rel=1e-9)


def test_triangles_as_near_as_asked():
    for tolerance in (2e-2, 2e-3):
        made = dual_contouring.within(shape(8, 0.6, 0.25), CUBE, tolerance)
        assert made.furthest <= tolerance
        ring = np.hypot(made.positions[:, 0], made.positions[:, 2]) - 0.6
        assert np.abs(np.hypot(ring, made.positions[:, 1]) - 0.25).max() <= tolerance


@pytest.mark.long
@pytest.mark.parametrize(
    ("tape", "flat", "size"),
    [(drilled(), True, 1.0 * 1.2 * 0.8 - math.pi * 0.25**2 * 1.2), (shape(8, 0.6, 0.25), False, 2 * math.pi**2 * 0.6 * 0.25**2)],
    ids=["drilled box", "torus"],
)
def test_fewer_triangles_within_the_tolerance(tape, flat, size):
    """Flat faces become a few large ones; the solid stays closed, its holes stay holes, its edges sharp."""
    tolerance = 2e-3
    made = dual_contouring.within(tape, CUBE, 0.75 * tolerance)
    positions, triangles, furthest = mesh_csg.simplify(tape, made, tolerance)
    fewer = made._replace(positions=positions, triangles=triangles)
    assert made.furthest <= furthest <= tolerance
    assert len(triangles) < (0.35 if flat else 0.8) * len(made.triangles)
    assert dual_contouring.open_edges(triangles) == 0
    assert euler(fewer) == 0
    assert volume(fewer) == pytest.approx(size, rel=8e-3)
    if flat:
        for corner in ((0.5, 0.6, 0.4), (-0.5, -0.6, 0.4)):
            assert np.linalg.norm(positions - corner, axis=1).min() < 1e-9
        rim = np.abs(np.abs(positions[:, 1]) - 0.6) < 1e-9
        ring = rim & (np.hypot(positions[:, 0], positions[:, 2]) < 0.3)
        assert ring.sum() > 16
        assert np.abs(np.hypot(positions[ring, 0], positions[ring, 2]) - 0.25).max() < tolerance


def test_nothing_has_no_triangles():
    builder = Builder()
    made = dual_contouring.contour(builder.finish(builder.offset(builder.op(Op.SQUARE, 0), 1.0)), CUBE, 16)
    assert (len(made.positions), len(made.triangles), made.furthest) == (0, 0, 0.0)


# --- files ---


def converted(tmp_path: Path, text: str, *options: str) -> tuple[int, str]:
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    result = CliRunner().invoke(cli, ["convert", str(tmp_path / "a.scene"), *options])
    return result.exit_code, result.stderr


PART = "unit mm\ndifference { box([30, 20, 30]); cylinder(8, 60) }\n"


@pytest.mark.parametrize("ending", ["stl", "obj", "ply"])
def test_a_part_is_written_and_read_again(tmp_path, ending):
    from maquette.compiler import load

    out = tmp_path / f"a.{ending}"
    code, said = converted(tmp_path, PART, str(out), "--deviation", "0.1mm")
    assert code == 0
    assert "triangles, closed, distance from the true surface" in said
    box = load.load(out).tables.geometries.bounds[0]
    assert np.allclose(box[1] - box[0], (0.03, 0.02, 0.03), rtol=1e-4)


def test_3mf_holds_each_part_in_millimetres(tmp_path):
    out = tmp_path / "a.3mf"
    code, _ = converted(tmp_path, PART + 'sphere(4, center: [0, 20, 0], name: "a & b")\n', str(out), "--deviation", "0.2mm")
    assert code == 0
    with zipfile.ZipFile(out) as archive:
        model = archive.read("3D/3dmodel.model").decode()
    assert 'unit="millimeter"' in model
    assert model.count("<object ") == 2
    assert 'name="a &amp; b"' in model


def test_what_cannot_be_written_is_said(tmp_path):
    code, said = converted(tmp_path, "plane(y: 0)\n", str(tmp_path / "a.stl"))
    assert code == 1
    assert "is unbounded and is left out" in said
    code, said = converted(tmp_path, PART, str(tmp_path / "a.npz"), "--deviation", "1mm")
    assert code == 2
