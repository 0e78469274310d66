"""Placed mesh files and stages: materials in place of theirs, and their height as they are turned."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.lang.diagnostics import Diagnostics

from .. import tables

REST = "\ncamera([0, 1, 5])\nsun()\n"
OBJ = """mtllib a.mtl
v 0 0 0
v 2 0 0
v 0 4 1
usemtl Body
f 1 2 3
usemtl Lid Top
f 3 2 1
usemtl Absent
f 2 3 1
"""
MTL = "newmtl Body\nKd 1 0 0\nnewmtl Lid Top\nKd 0 1 0\n"
USDA = """#usda 1.0
(
    upAxis = "Z"
    metersPerUnit = 0.01
)
def Xform "Root"
{
    def Mesh "Body" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (200, 0, 0), (0, 100, 400)]
        uniform token subdivisionScheme = "none"
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] (
            interpolation = "vertex"
        )
        rel material:binding = </Root/Mats/Red>
    }
    def Sphere "Lid"
    {
        double radius = 50
        double3 xformOp:translate = (0, 0, 450)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        color3f[] primvars:displayColor = [(0, 1, 0)]
    }
    def Scope "Mats"
    {
        def Material "Red"
        {
            token outputs:surface.connect = </Root/Mats/Red/S.outputs:surface>
            def Shader "S"
            {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor.connect = </Root/Mats/Red/T.outputs:rgb>
                token outputs:surface
            }
            def Shader "T"
            {
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @missing.png@
                float3 outputs:rgb
            }
        }
    }
}
"""
BLUE, GREY, RED, GREEN = [0, 0, 1], [0.8] * 3, [1, 0, 0], [0, 1, 0]


def diffuse(scene: ir.Scene) -> list[list[float]]:
    """The diffuse colour of each instance."""
    rows = scene.tables.instances.material.tolist()
    return [[] if row < 0 else scene.tables.materials.values[row, ir.Slot.DIFFUSE].tolist() for row in rows]


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with files whose materials have names."""
    (tmp_path / "a.obj").write_text(OBJ)
    (tmp_path / "a.mtl").write_text(MTL)
    (tmp_path / "a.usda").write_text(USDA)
    document = {
        "asset": {"version": "2.0"}, "materials": [{"name": "Body"}, {}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": k} for k in (0, 1)]}],
        "buffers": [{"uri": "b.bin", "byteLength": 36}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    }  # fmt: skip
    (tmp_path / "b.bin").write_bytes(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes())
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    return tmp_path


@pytest.mark.parametrize(
    ("pairs", "expected"),
    [
        ('[["Body", blue]]', [BLUE, GREEN, GREY]), ('[["Lid Top", blue], ["Body", blue]]', [BLUE, BLUE, GREY]),
        ('[["*", blue]]', [BLUE] * 3), ('[["*o*", blue], ["Body", grey]]', [GREY, BLUE, GREY]), ('[["Absent", blue]]', [RED, GREEN, BLUE]),
        ("[]", [RED, GREEN, GREY]),
    ],
)  # fmt: skip
def test_materials_of_an_obj_are_replaced_by_name(files: Path, pairs: str, expected: list) -> None:
    (files / "a.scene").write_text(f'let blue = lambert(#0000ff)\nlet grey = lambert(0.8)\nmesh("a.obj", materials: {pairs}){REST}')
    assert diffuse(load.load(files / "a.scene", diagnostics=Diagnostics())) == expected


def test_materials_of_a_library_that_is_missing_are_replaced_by_name(said, files: Path) -> None:
    (files / "a.mtl").unlink()
    text = f'mesh("a.obj", materials: [["Body", gold()], ["Absent", gold()], ["Lid Top", gold()]]){REST}'
    assert said('use "std/materials"\n' + text) == (
        f"a.obj:1:1: warning: there is no material library `a.mtl`: its materials are not read\n   1 | mtllib a.mtl\n     | ^^^^^^^^^^^^ "
        f"looked in {files}\n  in mesh, called at a.scene:2:1"
    )


def test_material_is_for_what_materials_does_not_name(compiled, files: Path) -> None:
    scene = compiled(f'mesh("a.gltf", material: lambert(0.8), materials: [["Body", lambert(#0000ff)]]){REST}')
    assert diffuse(scene) == [BLUE, GREY]
    scene = compiled(f'mesh("a.gltf", materials: [["material 1", lambert(#0000ff)]]){REST}')
    assert diffuse(scene) == [[1, 1, 1], BLUE]
    scene = compiled(f'group(material: lambert(0.8)) {{ mesh("a.gltf", materials: [["Body", lambert(#0000ff)]]) }}{REST}')
    assert diffuse(scene) == [BLUE, [1, 1, 1]]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("material: lambert(#0000ff)", [BLUE, BLUE]), ('materials: [["Red", lambert(#0000ff)]]', [BLUE, GREEN]),
        ('materials: [["/Root/Mats/*", lambert(#0000ff)]]', [BLUE, GREEN]),
        ('material: lambert(0.8), materials: [["Red", lambert(#0000ff)]]', [BLUE, GREY]),
    ],
)  # fmt: skip
def test_materials_of_a_stage_are_replaced(compiled, files: Path, arguments: str, expected: list) -> None:
    """Its pictures are not read then, and the colours of its vertices do not tint the material."""
    scene = compiled(f'usd("a.usda", {arguments}){REST}')
    assert diffuse(scene) == expected
    assert scene.tables.geometries.colors[0] < 0


def test_a_block_s_material_is_for_prims_of_a_stage_without_one(compiled, files: Path) -> None:
    (files / "a.usda").write_text(USDA.replace("        color3f[] primvars:displayColor = [(0, 1, 0)]\n", "").replace(
        "inputs:diffuseColor.connect = </Root/Mats/Red/T.outputs:rgb>", "inputs:diffuseColor = (1, 0, 0)"))  # fmt: skip
    scene = compiled(f'group(material: lambert(#0000ff)) {{ usd("a.usda") }}{REST}')
    assert diffuse(scene) == [RED, BLUE]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('mesh("a.obj", materials: [["Boddy", lambert(1)]])', "the file has no material `Boddy`|did you mean `Body`?"),
        ('usd("a.usda", materials: [["Blue", lambert(1)]])', "the file has no material `Blue`|it has `Red`"),
        ('mesh("b.stl", materials: [["Body", lambert(1)]])',
         "the file has no material `Body`|it names none: write material: for all of it"),
        ('mesh(points: [[0,0,0],[1,0,0],[0,1,0]], faces: [[0,1,2]], materials: [["a", lambert(1)]])',
         "`materials` replaces those of a file, and this mesh has none|write material: for its own"),
        ('union { mesh("a.obj", materials: [["Body", lambert(1)]]) }',
         "a mesh in a solid has one material: `materials` does not go there|write material:"),
    ],
)  # fmt: skip
def test_names_that_a_file_does_not_have(said, files: Path, text: str, message: str) -> None:
    (files / "b.stl").write_text("solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
                                   "endfacet\nendsolid\n")  # fmt: skip
    (files / "a.obj").write_text(OBJ.replace("usemtl Absent\n", ""))
    shown, hint = message.split("|")
    printed = said(text + REST)
    errors = [line for line in printed.splitlines() if "error" in line]
    assert errors == [f"a.scene:1:{9 if 'union' in text else 1}: error: {shown}"]
    assert f"^ {hint}" in printed


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ('["Body", lambert(1)]', "26: error: expected list of pairs of a name and a material, got a list of 2"),
        ('[["Body"]]', "27: error: expected pair of a name and a material, got a list of 1"),
        ('[["Body", 1]]', "36: error: expected material, got the bare number 1"),
        ("[[1, lambert(1)]]", "28: error: expected string, got the bare number 1"),
        ("lambert(1)", "26: error: expected list of pairs of a name and a material, got the material `lambert`"),
    ],
)  # fmt: skip
def test_what_materials_takes(said, files: Path, value: str, message: str) -> None:
    assert said(f'mesh("a.obj", materials: {value})').splitlines()[0] == f"a.scene:1:{message}"


# --- height ---


def extent(scene: ir.Scene) -> np.ndarray:
    """(2, 3) bounds of the vertices of all meshes where they are placed."""
    points = []
    for row, transform in zip(scene.tables.instances.geometry, scene.tables.instances.transform, strict=True):
        if scene.tables.geometries.kind[row] == ir.GeometryKind.MESH:
            corners = tables.corners(scene.tables, row).reshape(-1, 3)
            points.append(np.c_[corners, np.ones(len(corners))] @ scene.tables.transforms.matrix[transform].T)
    return np.array([np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)])


@pytest.mark.parametrize("rotate", ["[0, 0, 0]", "[-90deg, 0, 0]", "[30deg, 40deg, 50deg]", "axis([1, 1, 0], 33deg)"])
@pytest.mark.parametrize("more", ["", ", translate: [0, 3, 0]", ", scale: 2"])
def test_the_height_of_a_mesh_is_measured_as_it_is_turned(compiled, files: Path, rotate: str, more: str) -> None:
    (files / "a.obj").write_text(OBJ.replace("usemtl Absent\n", ""))
    low, high = extent(compiled(f'mesh("a.obj", height: 1.5, rotate: {rotate}{more}){REST}'))
    assert high[1] - low[1] == pytest.approx(3 if "scale" in more else 1.5, rel=1e-6)
    assert low[1] == pytest.approx(3 if "translate" in more else 0, abs=1e-6)


def test_a_turn_about_y_moves_the_middle_of_a_mesh_nowhere(compiled, files: Path) -> None:
    (files / "a.obj").write_text(OBJ.replace("usemtl Absent\n", ""))
    for degrees in (0, 20, 300):
        scene = compiled(f'mesh("a.obj", height: 4, rotate: [0, {degrees}deg, 0]){REST}')
        matrix = scene.tables.transforms.matrix[scene.tables.instances.transform[0]]
        assert (matrix @ [1, 0, 0.5, 1]).tolist() == pytest.approx([0, 0, 0], abs=1e-9)


@pytest.mark.parametrize("rotate", ["[0, 0, 0]", "[0, 0, 90deg]", "[40deg, 0, 20deg]"])
def test_the_height_of_a_stage(compiled, files: Path, rotate: str) -> None:
    """A mesh of 4 m, and a sphere of radius 0.5 m on it, in a stage of centimetres with z up."""
    scene = compiled(f'usd("a.usda", height: 2, rotate: {rotate}, material: lambert(1)){REST}')
    low, high = extent(scene)
    rows = scene.tables.instances.geometry
    ball = next(k for k, row in enumerate(rows) if scene.tables.geometries.kind[row] == ir.GeometryKind.SPHERE)
    matrix = scene.tables.transforms.matrix[scene.tables.instances.transform[ball]]
    reach = scene.tables.geometries.parameters[rows[ball]][0] * float(np.linalg.norm(matrix[1, :3]))
    assert min(low[1], matrix[1, 3] - reach) == pytest.approx(0, abs=1e-5)
    assert max(high[1], matrix[1, 3] + reach) == pytest.approx(2, rel=1e-5)


@pytest.mark.parametrize(
    ("given", "size"),
    [
        ("", (2, 4, 1)),
        (', up: "y"', (2, 1, 4)),
        (', unit: "m"', (200, 400, 100)),
        (', unit: "mm", up: "y"', (0.2, 0.1, 0.4)),
        (', up: "y", height: 3', (6, 3, 12)),
    ],
)
def test_another_unit_and_axis_than_the_stage_says(compiled, files: Path, given: str, size: tuple[float, float, float]) -> None:
    (files / "a.usda").write_text(USDA.replace('Sphere "Lid"', 'Scope "Lid"'))
    low, high = extent(compiled(f'usd("a.usda", material: lambert(1){given}){REST}'))
    assert (high - low).tolist() == pytest.approx(size, rel=1e-5)


def test_a_flat_stage_has_no_height(said, files: Path) -> None:
    (files / "a.usda").write_text(USDA.replace("(0, 100, 400)", "(0, 100, 0)").replace('Sphere "Lid"', 'Scope "Lid"'))
    text = 'usd("a.usda", height: 2, material: lambert(1))'
    assert said(text + REST) == (
        "a.scene:1:1: error: the stage is flat: it has no height that could be scaled\n"
        f"   1 | {text}\n     | {'^' * len(text)} use scale instead of height"
    )
