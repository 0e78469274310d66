"""What text formats share: encodings, commas in numbers, names of files, colours as numbers, and points without faces."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler.importers import ies, mesh_files
from maquette.compiler.importers.common import vertex_colors
from maquette.compiler.io.sandbox import Files
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang.diagnostics import Diagnostics, render_text

from ...files import write_image
from .. import tables

OBJ = "v 0 0 0\nv 1.5 0 0\nv 1.5 1.5 0\nf 1 2 3\n"
OFF = "OFF\n3 1 0\n0 0 0\n1.5 0 0\n1.5 1.5 0\n3 0 1 2\n"
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0.0 0.0 0.0
1.5 0.0 0.0
1.5 1.5 0.0
3 0 1 2
"""
STL = """solid a,b
facet normal 0.0 0.0 1.0
outer loop
vertex 0.0 0.0 0.0
vertex 1.5 0.0 0.0
vertex 1.5 1.5 0.0
endloop
endfacet
endsolid a,b
"""
FORMATS = {"a.obj": OBJ, "a.off": OFF, "a.ply": PLY, "a.stl": STL}
TRIANGLE = [[0, 0, 0], [1.5, 0, 0], [1.5, 1.5, 0]]


def read(data: str | bytes, name: str, folder: Path | None = None):
    """(scene, parts, messages) of a mesh file's text, with the files of `folder` beside it."""
    found = Diagnostics()
    builder = SceneBuilder(found, Files(folder) if folder else None)
    data = data.encode() if isinstance(data, str) else data
    if folder:
        (folder / name).write_bytes(data)
    parts = mesh_files.read(folder / name if folder else data, name, builder, found)
    return builder.finish(), parts, [render_text(d, lambda _: None) for d in found.items]


def corners(scene) -> list:
    return sorted(tables.corners(scene.tables, 0).tolist()[0])


@pytest.mark.parametrize("name", sorted(FORMATS))
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_each_text_format_is_read_in_each_encoding(name: str, encoding: str) -> None:
    scene, _, messages = read(FORMATS[name].encode(encoding), name)
    assert messages == []
    assert corners(scene) == TRIANGLE


@pytest.mark.parametrize("end", ["\r\n", "\r"])
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_each_text_format_has_any_line_ends(name: str, end: str) -> None:
    scene, _, messages = read(FORMATS[name].replace("\n", end), name)
    assert messages == []
    assert corners(scene) == TRIANGLE


def test_a_binary_stl_whose_header_is_utf_16() -> None:
    row = np.zeros(1, np.dtype([("floats", "<f4", 12), ("attribute", "<u2")]))
    row["floats"][0, 3:] = np.ravel(TRIANGLE)
    data = "solid made by a program".encode("utf-16-le").ljust(80, b" ") + np.uint32(1).tobytes() + row.tobytes()
    scene, _, messages = read(data, "a.stl")
    assert messages == []
    assert corners(scene) == TRIANGLE


def test_names_of_materials_in_windows_1252(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_bytes("newmtl gr\xfcn\nKd 0 1 0\nnewmtl gr\xfcn2\nKd 1 0 0\n".encode("cp1252"))
    scene, parts, messages = read(f"mtllib a.mtl\nusemtl gr\xfcn\n{OBJ}".encode("cp1252"), "x.obj", tmp_path)
    assert messages == []
    assert parts[0].material is not None
    assert scene.names.materials[parts[0].material] == "grün"


# --- commas ---

DECIMAL = "warning: the numbers have decimal commas: they are read as points"
SEPARATED = "warning: commas or semicolons separate the numbers: they are read as blanks"
PLACES = {"a.obj": ":2:1", "a.off": "", "a.ply": "", "a.stl": ":2:1"}


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_decimal_commas_are_read_and_told(name: str) -> None:
    head, mark, rest = FORMATS[name].partition("end_header" if name == "a.ply" else "\n")
    scene, _, messages = read(head + mark + rest.replace(".", ","), name)
    assert messages == [f"{name}{PLACES[name]}: {DECIMAL}"]
    assert corners(scene) == TRIANGLE


@pytest.mark.parametrize("separator", [", ", ",", "; ", ";"])
def test_separators_in_an_obj_are_read_and_told(separator: str) -> None:
    lines = [f"v {separator.join(f'{value:.1f}' for value in point)}" for point in TRIANGLE]
    scene, _, messages = read("\n".join([*lines, f"f {separator.join('123')}", ""]), "a.obj")
    assert messages == [f"a.obj:1:1: {SEPARATED}"]
    assert corners(scene) == TRIANGLE


@pytest.mark.parametrize(
    ("line", "point"),
    [
        ("v 1,5 2 -3,25", [1.5, 2, -3.25]), ("v 1,5, 2,0, 3", [1.5, 2, 3]), ("v 1,5; 2,5; 3", [1.5, 2.5, 3]), ("v 1,2,3", [1, 2, 3]),
        ("v 1,2 3", [1, 2, 3]), ("v 1,5e1 0 0,5", [15.0, 0.0, 0.5]), ("v 1 ,2 ,3", [1, 2, 3]), ("v 1.5,2.5,3.5", [1.5, 2.5, 3.5]),
    ],
)  # fmt: skip
def test_commas_of_an_obj(line: str, point: list[float]) -> None:
    scene, _, messages = read(f"{line}\nv 9 9 9\nv 9 8 9\nf 1 2 3\n", "a.obj")
    assert len(messages) == 1
    assert point in tables.corners(scene.tables, 0)[0].tolist()


def test_commas_in_names_and_comments_stay(tmp_path: Path) -> None:
    (tmp_path / "a,b.mtl").write_text("newmtl 1,5 # 2,5\nKd 0 1 0 # 1,5\n")
    scene, parts, messages = read(f"# 1,5\nmtllib a,b.mtl\nusemtl 1,5\n{OBJ}v 1 2 3 # 4,5\n", "x.obj", tmp_path)
    assert messages == []
    assert parts[0].material is not None
    assert scene.names.materials[parts[0].material] == "1,5"


def test_decimal_commas_of_a_material_library(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl m\nKd 0,5 1,0 0\nNi 1,5\nd 0,5\n")
    scene, parts, messages = read(f"mtllib a.mtl\nusemtl m\n{OBJ}", "x.obj", tmp_path)
    assert messages == [f"a.mtl:2:1: {DECIMAL}"]
    assert scene.tables.materials.values[parts[0].material, 0].tolist() == [0.5, 1, 0]


@pytest.mark.parametrize("numbers", ["1 1000 1 2 1 1 2 0 0 0\n1 1 10\n0 90\n0\n0.5 1.5",
                                     "1,1000,1,2,1,1,2,0,0,0,\n1,1,10\n0,90\n0\n0.5,1.5",
                                     "1 1000 1,0 2 1 1 2 0,0 0,0 0,0\n1,0 1,0 10,0\n0,0 90,0\n0\n0,5 1,5"])  # fmt: skip
def test_commas_of_an_ies_file(numbers: str) -> None:
    assert ies.read(f"IESNA\nTILT=NONE\n{numbers}\n".encode("utf-16")).candela.tolist() == [[0.5, 1.5]]


# --- headers ---


@pytest.mark.parametrize(
    ("old", "new"),
    [("element vertex", "comment end_header\nelement vertex"), ("element vertex", "obj_info end_header of it\nelement vertex"),
     ("end_header", "end_header  "), ("end_header", "end_header\t"), ("ply\n", "ply \n"), ("ply\n", "\n ply\n"), ("1.0\n", "1.0 \n"),
     ("3\n", "3  \n")],
)  # fmt: skip
def test_comments_and_blanks_in_the_header_of_a_ply(old: str, new: str) -> None:
    scene, _, messages = read(PLY.replace(old, new, 1), "a.ply")
    assert messages == []
    assert corners(scene) == TRIANGLE


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", " \n", " \r\n", "\t\r"])
@pytest.mark.parametrize("first", [10, 13, 32])
def test_the_rows_of_a_binary_ply_begin_after_the_line_of_the_header(end: str, first: int) -> None:
    head = PLY.partition("0.0")[0].replace("ascii", "binary_little_endian").replace("\n", end)
    points = np.array(TRIANGLE, "<f4")
    points.view(np.uint8)[0, 0] = first  # a tiny number whose first byte is a line end or a blank
    data = head.encode() + points.tobytes() + b"\3" + np.arange(3, dtype="<i4").tobytes()
    scene, _, messages = read(data, "a.ply")
    assert messages == []
    assert corners(scene)[1:] == TRIANGLE[1:]


def test_the_triangle_strips_of_a_ply() -> None:
    head = PLY.partition("element face")[0].replace("vertex 3", "vertex 5")
    rows = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n8 0 1 2 3 -1 2 3 4\n"
    scene, _, messages = read(f"{head}element tristrips 1\nproperty list int int vertex_indices\nend_header\n{rows}", "a.ply")
    assert messages == []
    made = tables.corners(scene.tables, 0)
    assert np.cross(made[:, 1] - made[:, 0], made[:, 2] - made[:, 0]).tolist() == [[0, 0, 1]] * 3


# --- names ---


@pytest.mark.parametrize("written", ["wood.png", "Wood.PNG", "tex\\WOOD.png", "TEX/wood.png", "C:\\models\\wood.png"])
def test_names_with_backslashes_and_in_other_case(tmp_path: Path, written: str) -> None:
    (tmp_path / "tex").mkdir()
    for place in ("wood.png", "tex/wood.png"):
        write_image(tmp_path / place, np.full((2, 2, 3), 255, np.uint8))
    head, _, rest = PLY.partition("element face")
    uvs = "property float s\nproperty float t\nelement face"
    ply = (head + uvs + rest).replace("1.0\n", f'1.0\ncomment TextureFile "{written}"\n', 1).replace(".0\n", ".0 0 0\n").replace(
        "ascii 1.0 0 0", "ascii 1.0")  # fmt: skip
    scene, _, messages = read(ply, "a.ply", tmp_path)
    assert messages == []
    assert len(scene.tables.images.width) == 1
    document = {
        "asset": {"version": "2.0"}, "images": [{"uri": written}], "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}], "buffers": [{"uri": "B.bin", "byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    }  # fmt: skip
    (tmp_path / "b.bin").write_bytes(np.array(TRIANGLE, "<f4").tobytes())
    scene, _, messages = read(json.dumps(document).encode("utf-16"), "a.gltf", tmp_path)
    assert messages == []
    assert len(scene.tables.images.width) == 1


# --- colours ---


@pytest.mark.parametrize(
    ("values", "first"),
    [
        ([[1, 0, 0], [0, 0.5, 0]], [1, 0, 0]), ([[255, 0, 0], [0, 128, 0]], [1, 0, 0]), ([[255, 0, 0.5], [12.5, 128, 0]], [1, 0, 0.00015]),
        ([[65535, 0, 0], [400, 128, 0]], [1, 0, 0]), ([[0, 0, 0]] * 2, [0, 0, 0]), ([[200, 0, 0], [1, 1, 1], [1, 1, 0]], [0.5776, 0, 0]),
    ],
)  # fmt: skip
def test_the_range_of_colours_is_judged_by_all_of_them(values: list, first: list[float]) -> None:
    said: list[str] = []
    assert vertex_colors.from_numbers(np.array(values, float), said.append)[0] == pytest.approx(first, abs=1e-4)
    assert said == []


def test_one_colour_above_one_does_not_darken_the_others() -> None:
    lines = ["v 0 0 0 0.5 0.5 0.5", "v 1 0 0 1.001 0.5 0.5", "v 0 1 0 0.5 0.5 -0.1", "f 1 2 3"]
    scene, _, messages = read("\n".join(lines), "a.obj")
    assert messages == ["a.obj: warning: 2 of 3 colours are not between 0 and 1: they are clipped"]
    assert tables.attribute(scene.tables, "colors")[0, 0].tolist() == pytest.approx([0.214] * 3, abs=1e-3)


@pytest.mark.parametrize(("kind", "colour"), [("uchar", "0 1 255"), ("char", "0 1 -1"), ("ushort", "0 257 65535"), ("int", "0 1 255"),
                                              ("float", "0 0.00392157 1"), ("float", "0 1 255"), ("double", "0 1.0 255.0")])  # fmt: skip
def test_colours_of_a_ply_in_each_type(kind: str, colour: str) -> None:
    head, _, rest = PLY.partition("element face")
    colours = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    scene, _, messages = read((head + colours + "element face" + rest).replace(".0\n", f".0 {colour}\n").replace(
        f"ascii 1.0 {colour}", "ascii 1.0"), "a.ply")  # fmt: skip
    assert messages == []
    assert tables.attribute(scene.tables, "colors")[0, 0].tolist() == pytest.approx([0, 0.0003, 1], abs=1e-4)


# --- points ---


def cloud(name: str, count: int = 8) -> str:
    points = [[(k >> axis) & 1 for axis in range(3)] for k in range(count)]
    if name == "a.ply":
        head, _, _ = PLY.partition("element face")
        return f"{head.replace('vertex 3', f'vertex {count}')}end_header\n" + "\n".join("{} {} {}".format(*p) for p in points)
    lines = "\n".join("{}{} {} {}".format("v " if name == "a.obj" else "", *p) for p in points)
    return lines if name == "a.obj" else f"OFF\n{count} 0 0\n{lines}"


@pytest.mark.parametrize("name", ["a.obj", "a.off", "a.ply"])
def test_points_without_faces_are_spheres(name: str) -> None:
    scene, parts, messages = read(cloud(name), name)
    assert messages == [f"{name}: note: 8 points are drawn as spheres with a width of 0.0115: the file has no faces"]
    assert len(parts) == 1
    made = tables.corners(scene.tables, 0).reshape(-1, 3)
    radius = 3**0.5 / 300
    assert made.min(axis=0) == pytest.approx(-radius, abs=radius / 50)
    assert made.max(axis=0) == pytest.approx(1 + radius, abs=radius / 50)
    assert len(made) == 8 * 320 * 3


def test_one_point_and_points_that_are_not_finite() -> None:
    assert read("v 1 2 3\n", "a.obj")[2] == ["a.obj: note: 1 point is drawn as a sphere with a width of 1: the file has no faces"]
    assert read("v 1 2 3\nv nan 0 0\np 1 2\n", "a.obj")[2] == [
        "a.obj: warning: 1 of 2 points are not finite: they are left out",
        "a.obj: note: 1 point is drawn as a sphere with a width of 1: the file has no faces",
    ]
    assert read(cloud("a.ply", 0), "a.ply")[2] == ["a.ply: error: the PLY file has neither faces nor points"]


@pytest.mark.long
def test_points_have_their_colours_and_are_thin_where_they_are_many() -> None:
    rng = np.random.default_rng(3)
    lines = [f"v {x} {y} 0 255 0 0" for x, y in rng.random((40_000, 2))]
    scene, _, messages = read("\n".join(lines), "a.obj")
    assert messages == ["a.obj: note: 40,000 points are drawn as spheres with a width of 0.00707: the file has no faces"]
    assert tables.attribute(scene.tables, "colors")[0, 0].tolist() == [1, 0, 0]
