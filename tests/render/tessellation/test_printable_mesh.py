"""Printable meshes are closed and manifold in another program, and have the right volume; open meshes get a warning."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from maquette.cli.main import cli

EXAMPLES = Path(__file__).parents[3] / "examples"
BALL, PI = 4 / 3 * math.pi, math.pi
SOLIDS = {  # the scene, its volume, its Euler characteristic
    "ball": ("sphere(0.7)", BALL * 0.343, 2),
    "box": ("box([1, 1.1, 1], rotate: [0, 30deg, 10deg])", 1.1, 2),
    "cone": ("cone(0.7, 1.4)", PI * 0.49 * 1.4 / 3, 2),
    "mirrored": ("cone(0.7, 1.2, top: 0.35, scale: [-1, 1, 1])", PI * 0.4 * (0.49 + 0.245 + 0.1225), 2),
    "torus": ("torus(0.55, 0.2)", 2 * PI**2 * 0.55 * 0.04, 0),
    "capsule": ("capsule(0.4, 0.7)", None, 2),
    "ellipsoid": ("ellipsoid([0.8, 0.5, 0.6])", BALL * 0.24, 2),
    "a quadric within its box": ("quadric([1, 4, 1, 0, 0, 0, 0, 0, 0, -1], within: 3)", BALL * 0.5, 2),
    "far away": ("sphere(0.7, center: [1e5, 0, 3e4])", BALL * 0.343, 2),
    "tiny": ("sphere(1e-5)", BALL * 1e-15, 2),
    "formula in a box": ("implicit(|x, y, z| y <= 0.1 * sin(6 * x), within: box([2, 2, 2]))", 4.0, 2),
    "balls that touch": ("implicit(|x, y, z| min(hypot(x - 0.5, y, z), hypot(x + 0.5, y, z)) <= 0.5)", BALL / 4, None),
    "repeated": ("implicit(|x, y, z| hypot(mod(x, 1) - 0.5, y, z) <= 0.3, within: box([2, 1, 1]))", BALL * 0.054, 4),
    "wedges along an edge": ("implicit(|x, y, z| x * y <= 0, within: box([2, 2, 2]))", 4.0, None),
    "boxes face to face": ("box(1)\nbox(1, center: [0, 1, 0])", 2.0, 4),
    "boxes edge to edge": ("box(1)\nbox(1, center: [1, 1, 0])", 2.0, 4),
    "boxes united along an edge": ("union { box(1); box(1, center: [1, 1, 0]) }", 2.0, None),
    "drilled": ("difference { box(1); cylinder(0.3, 2) }", 1 - PI * 0.09, 0),
    "a pin with a fillet": ("union(round: 0.2) { box([2, 0.4, 2]); cylinder(0.4, 1.2, center: [0, 0.6, 0]) }",
                            1.6 + PI * 0.16 + 2 * PI * (0.04 * (1 - PI / 4) * 0.4 + 0.008 * (5 / 6 - PI / 4)), 2),
    "a lamp beside": ("box(1)\narea(position: [0, 3, 0], size: 1)", 1.0, 2),
}
OPEN = {
    "disk(1)": "`disk` has no thickness",
    "cylinder(1, 2, capped: false)": "`cylinder` has no caps",
    "quadric([1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2], within: 2)": "`quadric` is a surface that ends at its box",
    "implicit(|x, y, z| y == x * z, within: box([2, 2, 2]))": "`implicit` is a sheet",
    "triangle([[0, 0, 0], [1, 0, 0], [0, 1, 0]])": "`triangle` is a mesh with gaps: 3 of its edges",
}


def converted(tmp_path: Path, text: str, ending: str = "stl") -> tuple[trimesh.Trimesh, str]:
    source, out = tmp_path / "a.scene", tmp_path / f"a.{ending}"
    source.write_text(text + "\n", encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(source), str(out)])
    assert done.exit_code == 0, done.stderr
    read = trimesh.load(out, force="mesh")
    assert isinstance(read, trimesh.Trimesh)
    return read, done.stderr


@pytest.mark.long
@pytest.mark.parametrize("ending", ["stl", "obj", "ply"])
@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_as_another_program_reads_them(tmp_path, name, ending):
    text, volume, euler = SOLIDS[name]
    read, said = converted(tmp_path, text, ending)
    assert "triangles, closed, distance" in said
    assert read.is_watertight
    assert read.is_winding_consistent
    if euler is not None:
        assert read.euler_number == euler
    if volume is not None:
        unit = 1e9 if ending == "stl" else 1.0
        assert read.volume / unit == pytest.approx(volume, rel=0.005)


def test_lamps_are_no_things(tmp_path):
    read, said = converted(tmp_path, "box(1)\narea(position: [0, 3, 0], size: 1)")
    assert "`area` is a light and is left out" in said
    assert len(read.faces) == 12


@pytest.mark.long
@pytest.mark.parametrize("text", OPEN)
def test_what_is_open_is_said_with_its_reason(tmp_path, text):
    read, said = converted(tmp_path, text)
    assert not read.is_watertight
    assert OPEN[text] in said
    assert "a.scene:1:1: warning" in said
    assert "open edges" in said


@pytest.mark.long
def test_what_is_too_thin_is_said_and_nothing_else_is(tmp_path):
    _, said = converted(tmp_path, "implicit(|x, y, z| abs(hypot(x, y, z) - 0.5) <= 1e-3)")
    assert "is sampled in cells of 4.67 mm: thinner parts are missing" in said
    _, said = converted(tmp_path, "implicit(|x, y, z| abs(hypot(x, y, z) - 0.5) <= 1e-2)")
    assert "missing" not in said


def test_what_moves_to_the_origin_says_so(tmp_path):
    read, said = converted(tmp_path, "box(1, center: [1e6, 0, 0])")
    assert "moved by [-1000000, 0, 0] metres: .stl has too few digits" in said
    assert np.allclose(read.bounds, [[-500] * 3, [500] * 3])


@pytest.mark.long
@pytest.mark.parametrize("name", ["cut", "chess", "glass", "bracket", "gear", "vase"])
def test_examples_are_closed(tmp_path, name):
    done = CliRunner().invoke(cli, ["convert", str(EXAMPLES / f"{name}.scene"), str(tmp_path / "a.stl")])
    assert "triangles, closed, distance" in done.stderr
    assert trimesh.load(tmp_path / "a.stl").is_watertight  # pyright: ignore[reportAttributeAccessIssue]
