"""Files that `convert` writes are read back with the same extents, orientation and colours, within the deviation that it tells."""

from __future__ import annotations

import json
import math
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.cli.main import cli
from maquette.compiler import ir, load
from maquette.lang.diagnostics import Diagnostics

FORMATS = ("stl", "3mf", "obj", "ply", "glb", "usda", "usdc", "usdz")
PARTS = """unit mm
box([10, 20, 30], center: [5, 10, -15], material: lambert(#ff0000))
cone(4, 8, center: [30, 4, 0], material: lambert(#00c000))
cylinder(3, 8, center: [50, 4, 5], material: lambert(#4060ff))
"""
LOW, HIGH = np.array([0, 0, -0.03]), np.array([0.053, 0.02, 0.008])
RED, GREEN, BLUE = (1, 0, 0), (0, 0.527, 0), (0.051, 0.117, 1)  # linear


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, [str(a) for a in arguments])
    return done.exit_code, done.stdout, done.stderr


def told(err: str) -> float:
    """The deviation that `convert` tells, in metres."""
    match = re.search(r"distance from the true surface (\S+) mm (?:at most|where it was measured)", err)
    assert match is not None, err
    return float(match[1]) / 1000


def bounds(path: str) -> tuple[np.ndarray, np.ndarray]:
    """The box of all parts as `measure` tells it."""
    code, out, err = run("measure", path, "--json")
    assert code == 0, err
    parts = json.loads(out)
    return np.min([p["low"] for p in parts], axis=0), np.max([p["high"] for p in parts], axis=0)


@pytest.mark.parametrize("ending", ["stl", "glb", "usda"])
@pytest.mark.parametrize(
    "text",
    [
        "sphere(1)",
        "box(1)\nsphere(1, center: [3, 0, 0])",
        "mesh(points: [[0.1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], faces: [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])",
    ],
)
def test_a_shape_alone_has_one_distance(tmp_path: Path, text: str, ending: str) -> None:
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    code, _, err = run("convert", tmp_path / "a.scene", tmp_path / f"a.{ending}")
    assert code == 0, err
    assert err.rstrip().endswith("mm at most")
    assert "edges" not in err


@pytest.mark.parametrize("ending", FORMATS)
def test_extents_and_orientation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.scene").write_text(PARTS, encoding="utf-8")
    code, _, err = run("convert", "a.scene", f"b.{ending}", "--deviation", "0.01mm")
    assert code == 0
    low, high = bounds(f"b.{ending}")
    within = told(err)
    assert np.abs(low - LOW).max() <= within + 1e-7
    assert np.abs(high - HIGH).max() <= within + 1e-7


@pytest.mark.parametrize("ending", FORMATS[1:])
def test_colours(tmp_path: Path, ending: str) -> None:
    """The colours of the triangles of each part, told apart by their place along x; STL has none."""
    (tmp_path / "a.scene").write_text(PARTS, encoding="utf-8")
    assert run("convert", tmp_path / "a.scene", tmp_path / f"b.{ending}")[0] == 0
    scene = load.load(tmp_path / f"b.{ending}")
    found = colors_by_place(scene)
    for first, last, wanted in ((0.0, 0.011, RED), (0.025, 0.035, GREEN), (0.046, 0.054, BLUE)):
        chosen = [color for x, color in found if first <= x <= last]
        assert chosen
        assert np.abs(np.array(chosen) - wanted).max() < 0.01


def colors_by_place(scene: ir.Scene) -> list[tuple[float, np.ndarray]]:
    """(x of its center, linear colour) of each triangle."""
    tables, made = scene.tables, []
    for g, row, material in zip(tables.instances.geometry, tables.instances.transform, tables.instances.material, strict=True):
        first, count = int(tables.geometries.first_triangle[g]), int(tables.geometries.triangle_count[g])
        matrix = tables.transforms.matrix[row]
        albedo = tables.materials.values[material, ir.Slot.DIFFUSE]
        attribute = int(tables.geometries.colors[g])
        for triangle in tables.pools.triangles[first : first + count]:
            center = matrix[:, :3] @ (tables.pools.positions[triangle].mean(axis=0) + tables.geometries.origin[g]) + matrix[:, 3]
            color = albedo
            if attribute >= 0:
                start = int(tables.attributes.first[attribute])
                vertex = int(triangle[0]) - int(tables.geometries.first_vertex[g])
                assert tables.attributes.interpolation[attribute] == ir.Interpolation.VERTEX
                color = tables.pools.values[start + 3 * vertex : start + 3 * vertex + 3] * albedo / 0.8
            made.append((float(center[0]), color))
    return made


@pytest.mark.parametrize(
    ("options", "size", "note"),
    [
        ({}, (0.02, 0.03, 0.02), "a .stl file says no unit and no up axis: read in mm with z up, this one is 0.02 × 0.03 × 0.02 m"),
        ({"unit": "cm"}, (0.2, 0.3, 0.2), "a .stl file says no up axis: read with z up, this one is 0.2 × 0.3 × 0.2 m"),
        ({"up": "y"}, (0.02, 0.02, 0.03), "a .stl file says no unit: read in mm, this one is 0.02 × 0.02 × 0.03 m"),
        ({"unit": "in", "up": "x"}, (0.508, 0.508, 0.762), ""),
    ],
)
def test_the_frame_of_an_stl_file(tmp_path: Path, options: dict[str, str], size: tuple[float, ...], note: str) -> None:
    """A cone 30 mm high, from the command line and from a scene."""
    (tmp_path / "a.scene").write_text("unit mm\ncone(10, 30, center: [0, 15, 0])\n", encoding="utf-8")
    assert run("convert", tmp_path / "a.scene", tmp_path / "b.stl")[0] == 0
    arguments = "".join(f', {name}: "{value}"' for name, value in options.items())
    (tmp_path / "c.scene").write_text(f'unit mm\nmesh("b.stl"{arguments})\n', encoding="utf-8")
    words = [word for name, value in options.items() for word in (f"--{name}", value)]
    for command in (["measure", tmp_path / "b.stl", "--json", *words], ["measure", tmp_path / "c.scene", "--json"]):
        code, out, err = run(*command)
        assert code == 0
        (part,) = json.loads(out)
        assert np.array(part["high"]) - part["low"] == pytest.approx(size, rel=1e-6)
        assert (note in err) if note else ("says no" not in err)


def test_a_height_needs_no_unit(tmp_path: Path) -> None:
    (tmp_path / "a.scene").write_text("unit mm\ncone(10, 30)\n", encoding="utf-8")
    assert run("convert", tmp_path / "a.scene", tmp_path / "b.stl")[0] == 0
    (tmp_path / "c.scene").write_text('mesh("b.stl", height: 6cm, up: "z")\n', encoding="utf-8")
    found = Diagnostics()
    scene = load.load(tmp_path / "c.scene", diagnostics=found)
    assert found.items == []
    assert float(np.ptp(scene.tables.geometries.bounds[0, :, 1]) * np.linalg.norm(scene.tables.transforms.matrix[-1, :, 1])) > 0


@pytest.mark.parametrize(("side", "told"), [(3, False), (60, True), (0.001, True)])
def test_an_unlikely_size_of_an_obj_file_is_told(tmp_path: Path, side: float, told: bool) -> None:
    (tmp_path / "a.obj").write_text(f"v 0 0 0\nv {side} 0 0\nv 0 {side} 0\nf 1 2 3\n", encoding="utf-8")
    note = f"a .obj file says no unit and no up axis: read in m with y up, this one is {side} × {side} × 0 m"
    assert (note in run("check", tmp_path / "a.obj")[2]) == told
    assert "says no" not in run("check", tmp_path / "a.obj", "--unit", "mm")[2]


def test_options_that_a_file_cannot_take(tmp_path: Path) -> None:
    (tmp_path / "a.scene").write_text("sphere(1)\n", encoding="utf-8")
    assert "only mesh files take --up" in run("check", tmp_path / "a.scene", "--up", "z")[2]
    assert run("convert", tmp_path / "a.scene", tmp_path / "b.glb")[0] == 0
    assert "a glTF file is in metres with y up" in run("check", tmp_path / "b.glb", "--unit", "mm")[2]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("a.step", "FreeCAD opens it, and exports .3mf or .stl"), ("a.IGES", "FreeCAD opens it, and exports .3mf or .stl"),
        ("a.fbx", "Blender imports it, and exports .glb or .usdc"), ("a.abc", "Blender imports it, and exports .glb or .usdc"),
        ("a.dae", "assimp converts it: assimp export a.dae a.glb -fglb2"),
        ("a.amf", "assimp converts it: assimp export a.amf a.glb -fglb2"),
        ("a b.DAE", "assimp converts it: assimp export FILE.DAE FILE.glb -fglb2"),
        ("a.wrl", "MeshLab opens it, and exports .ply or .obj"), ("a.vrml", "MeshLab opens it, and exports .ply or .obj"),
        ("a.x3d", "MeshLab opens it, and exports .ply or .obj"), ("a.las", "CloudCompare opens it, and exports .ply"),
        ("a.dxf", "it is a drawing: FreeCAD extrudes it, and exports .3mf or .stl"),
        ("a.blend", "Blender writes it: blender a.blend -b --python-expr \"import bpy; bpy.ops.wm.usd_export(filepath='a.usdc')\""),
        ("x'$(id).blend", "Blender writes it: blender FILE.blend -b --python-expr "
         "\"import bpy; bpy.ops.wm.usd_export(filepath='FILE.usdc')\""),
    ],
)  # fmt: skip
def test_a_format_that_is_not_read_names_a_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, hint: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text("x", encoding="utf-8")
    assert run("check", name) == (1, f"{name}: 1 error\n", f"{name}: error: `{name}` is not a known kind of scene\n  {hint}\n")
    for line in (f'mesh("{name}")\n', f'usd("{name}")\n', f'use "{name}"\nsphere(1)\n'):
        Path("a.scene").write_text(line, encoding="utf-8")
        code, _, err = run("check", "a.scene")
        assert code == 1
        assert hint in err


@pytest.mark.parametrize(("line", "fix"), [
    ('usd("a.obj")', 'write mesh("a.obj")'), ('mesh("a.usda")', 'write usd("a.usda")'), ('mesh("b.scene")', 'write use "b.scene"'),
    ('mesh("c")', "known are .obj, .ply, .stl, .glb, .gltf, .off, .3mf, .xyz, and USD"),
])  # fmt: skip
def test_a_file_of_another_element_names_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, fix: str) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a.obj", "a.usda", "b.scene", "c"):
        Path(name).write_text("x", encoding="utf-8")
    Path("a.scene").write_text(f"{line}\n", encoding="utf-8")
    code, _, err = run("check", "a.scene")
    assert code == 1
    assert fix in err


def test_a_stage_that_refers_to_another_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.dae").write_text("x", encoding="utf-8")
    Path("a.usda").write_text('#usda 1.0\ndef "a" (references = @./a.dae@) {}\n', encoding="utf-8")
    assert "  assimp converts it: assimp export a.dae a.glb -fglb2" in run("check", "a.usda")[2].splitlines()


SOLIDS = {
    "sphere(10)": ((20, 20, 20), 4 / 3 * math.pi * 1000),
    "torus(10, 3)": ((26, 6, 26), 2 * math.pi**2 * 90),
    "cylinder(5, 12, scale: [1, 1, 3])": ((10, 12, 30), 3 * 25 * math.pi * 12),
    "capsule(3, 10)": ((6, 16, 6), math.pi * 90 + 36 * math.pi),
    "revolve([[0, -4], [6, -4], [6, 4], [0, 4]])": ((12, 8, 12), 36 * math.pi * 8),
    "difference { box(20); cylinder(4, 30) }": ((20, 20, 20), 8000 - 16 * math.pi * 20),
    'difference { box(20); text("I", size: 8, depth: 4, align: "center", vertical: "center", translate: [0, 0, 7]) }': ((20, 20, 20), None),
    'difference { cylinder(10, 8, scale: [1, 1, 2]); text("o", size: 8, depth: 4, translate: [0, 0, 50]) }':
        ((20, 8, 40), 2 * 100 * math.pi * 8),
    'union { sphere(9, center: [0, 9, 0]); text("x", size: 4, depth: 2, align: "center", vertical: "center", translate: [0, 9, -1]) }':
        ((18, 18, 18), 4 / 3 * math.pi * 729),
    'mirrored(normal: [1, 0, 0]) { difference { cylinder(5, 6, center: [9, 0, 0]); text("i", size: 3, translate: [0, 0, 40]) } }':
        ((28, 6, 10), 50 * math.pi * 6),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("solid", SOLIDS)
@pytest.mark.parametrize("deviation", [None, "0.004mm"])
def test_solids_have_the_size_that_is_told(tmp_path: Path, solid: str, deviation: str | None) -> None:
    """Extents against closed forms, within twice the deviation; volumes within the error that `measure` tells."""
    size, volume = SOLIDS[solid]
    (tmp_path / "a.scene").write_text(f"unit mm\n{solid}\n", encoding="utf-8")
    options = [] if deviation is None else ["--deviation", deviation]
    code, _, err = run("convert", tmp_path / "a.scene", tmp_path / "b.stl", *options)
    assert code == 0, err
    off = told(err)
    assert deviation is None or off <= 4.02e-6
    low, high = bounds(str(tmp_path / "b.stl"))
    assert np.abs((high - low) - np.array(size) / 1000).max() <= 2 * off + 1e-9
    (part,) = json.loads(run("measure", tmp_path / "a.scene", "--json", *options)[1])
    assert np.abs(np.array(part["high"]) - part["low"] - np.array(size) / 1000).max() <= 2 * part["deviation"] + 1e-12
    assert part["deviation"] <= off
    if volume is not None:
        assert abs(part["volume"]["value"] - volume * 1e-9) <= part["volume"]["error"]


@pytest.mark.long
def test_a_rounded_plate_with_text_is_60_mm_long(tmp_path: Path) -> None:
    text = """unit mm
use "std/profiles"
difference {
  union(round: 3) {
    extrude(profiles.rectangle([60, 40], round: 6), 5)
    box([20, 20, 20], center: [0, 10, 0])
  }
  text("M5", size: 7, depth: 2, translate: [12, 0, 4], rotate: [-90deg, 0, 0])
}
"""
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    for ending in ("stl", "3mf"):
        code, _, err = run("convert", tmp_path / "a.scene", tmp_path / f"b.{ending}")
        assert code == 0, err
        off = told(err)
        assert 0 < off < 2e-4
        low, high = bounds(str(tmp_path / f"b.{ending}"))
        assert abs(high[0] - low[0] - 0.06) <= off
        assert abs(high[2] - low[2] - 0.04) <= off
    assert "± " in run("measure", tmp_path / "a.scene")[1]


sizes = st.floats(0.2, 1.0)
places = st.tuples(*[st.floats(-0.5, 0.5)] * 3)


@st.composite
def random_solids(draw: st.DrawFn) -> tuple[str, np.ndarray, np.ndarray]:
    """(a union of a box and a ball, turned by quarters; the corners of its box in closed form)"""
    half, at, radius, centre = np.array([draw(sizes) for _ in range(3)]), np.array(draw(places)), draw(sizes), np.array(draw(places))
    low, high = np.minimum(at - half, centre - radius), np.maximum(at + half, centre + radius)
    listed = [", ".join(f"{x:.9f}" for x in each.tolist()) for each in (2 * half, at, centre)]
    solid = f"union {{ box([{listed[0]}], center: [{listed[1]}]); sphere({radius:.9f}, center: [{listed[2]}]) }}"
    if draw(st.booleans()):  # x, z → z, -x
        low, high = np.array([low[2], low[1], -high[0]]), np.array([high[2], high[1], -low[0]])
        solid = f"rotate([0, 90deg, 0]) {{ {solid} }}"
    return solid, low, high


@pytest.mark.long
@settings(max_examples=5, deadline=None, derandomize=True)
@given(random_solids(), st.sampled_from(["stl", "3mf", "obj", "ply", "glb", "usda"]))
def test_random_solids_keep_their_size(solid: tuple[str, np.ndarray, np.ndarray], ending: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "a.scene").write_text(solid[0], encoding="utf-8")
        code, _, err = run("convert", Path(folder) / "a.scene", Path(folder) / f"a.{ending}", "--deviation", "5mm")
        assert code == 0, err
        low, high = bounds(str(Path(folder) / f"a.{ending}"))
    assert np.abs(low - solid[1]).max() <= told(err) + 1e-6
    assert np.abs(high - solid[2]).max() <= told(err) + 1e-6
