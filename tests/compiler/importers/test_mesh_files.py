"""PLY, STL and GLB files in, geometry out; broken ones are one message; and the shared sample meshes."""

import base64
import codecs
import itertools
import json
import math
import struct

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.importers import mesh_files, mtl
from maquette.compiler.io.sandbox import Files
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang.diagnostics import Diagnostics

from ...files import write_image
from .. import tables

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def read(data, name):
    """(scene, parts, messages) of a mesh file's bytes."""
    found = Diagnostics()
    builder = SceneBuilder(found)
    parts = mesh_files.read(data, name, builder, found)
    return builder.finish(), parts, [f"{d.span}: {d.severity}: {d.message}" for d in found.items]


# --- PLY ---

HEADER = """ply
format {format} 1.0
comment made here
element vertex 4
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
property double s
property double t
element face {faces}
property list uchar {index} vertex_indices
property float quality
element edge 0
property int vertex1
end_header
"""


QUALITY = "a.ply: warning: the PLY file has data that is not drawn: `quality` of `face`"


def ply(order, faces, index="int"):
    head = HEADER.format(format=order, faces=len(faces), index=index).encode()
    if order == "ascii":
        rows = [f"{x:g} {y:g} {z:g} 255 {round(y * 255)} 0 {x:g} {y:g}" for x, y, z in SQUARE]
        rows += [f"{len(f)} {' '.join(map(str, f))} 0.5" for f in faces]
        return head + "\n".join(rows).encode() + b"\n"
    e = "<" if "little" in order else ">"
    body = b"".join(struct.pack(f"{e}3f3B2d", *p, 255, round(p[1] * 255), 0, p[0], p[1]) for p in SQUARE)
    code = {"int": "i", "ushort": "H"}[index]
    return head + body + b"".join(struct.pack(f"{e}B{len(f)}{code}f", len(f), *f, 0.5) for f in faces)


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("index", ["int", "ushort"])
def test_ply(order, index):
    scene, parts, messages = read(ply(order, [[0, 1, 2, 3]], index), "a.ply")
    assert messages == [QUALITY]
    assert [(p.name, p.material) for p in parts] == [("a", None)]
    assert tables.corners(scene.tables).tolist() == [SQUARE[[0, 1, 2]].tolist(), SQUARE[[0, 2, 3]].tolist()]
    assert tables.attribute(scene.tables, "uvs").tolist() == [SQUARE[[0, 1, 2], :2].tolist(), SQUARE[[0, 2, 3], :2].tolist()]
    assert tables.attribute(scene.tables, "colors")[0].tolist() == [[1, 0, 0], [1, 0, 0], [1, 1, 0]]
    assert scene.tables.geometries.polygon_count.tolist() == [1]


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_ply_with_faces_of_many_sizes(order):
    scene, _, messages = read(ply(order, [[0, 1, 2, 3], [0, 1, 3]]), "a.ply")
    assert messages == [QUALITY]
    assert len(tables.corners(scene.tables)) == 3


def test_ply_colours_of_faces_and_coordinates_of_corners():
    text = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_index
property list uchar float texcoord
property float red
property float green
property float blue
end_header
0 0 0
1 0 0
1 1 0
0 1 0
3 0 1 2 6 0 0 1 0 1 1 1 0 0
3 0 2 3 6 0.5 0 1 1 0 1 0.5 0.5 0.5
"""
    scene, _, messages = read(text.encode(), "a.ply")
    assert messages == []
    assert tables.attribute(scene.tables, "colors")[:, 0] == pytest.approx(np.array([[1, 0, 0], [0.2140411] * 3]))
    assert tables.attribute(scene.tables, "uvs")[1].tolist() == [[0.5, 0], [1, 1], [0, 1]]


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: d[:-5], "a.ply: warning: the PLY file ends in the middle of its `face` rows: it promises 2 and has 1"),
        (lambda d: d[:300], "a.ply: error: the PLY file has no line `end_header` in its first 65,536 bytes"),
        (lambda d: b"plx" + d[3:], "a.ply: error: this is not a PLY file: it does not begin with a PLY header"),
        (lambda d: d.replace(b"property float z", b"property foat z"),
         "a.ply: warning: the PLY header has a property of no known type, which is read as a number: `property foat z`"),
        (lambda d: d.replace(b"element vertex", b"remark\nelement vertex"),
         "a.ply: warning: the PLY header has a line that says nothing: `remark`"),
        (lambda d: codecs.BOM_UTF8 + d.replace(b"4 0 1 2 3", b"4 0 1 2 -1"),
         "a.ply: warning: 1 of 2 faces use vertices that do not exist or are not finite: they are left out"),
        (lambda d: d.replace(b"format ascii", b"format morse"), "a.ply: error: the PLY file has no format that is known: `morse`"),
        (lambda d: d.replace(b"float x", b"float q"), "a.ply: error: the PLY file has no vertices with x, y and z"),
        (lambda d: d.replace(b"vertex_indices", b"strips"),
         "a.ply: error: the PLY file has no faces that can be drawn: a face is a list `vertex_indices`"),
        (lambda d: d.replace(b"0.5", b"half"), "a.ply: warning: the PLY file has `half` among its numbers: it is read as not finite"),
        (lambda d: d.replace(b"4 0 1 2 3", b"4 0 1 2 9"),
         "a.ply: warning: 1 of 2 faces use vertices that do not exist or are not finite: they are left out"),
        (lambda d: d.replace(b"0 1 0 255", b"0 nan 0 255"),
         "a.ply: warning: 1 of 2 faces use vertices that do not exist or are not finite: they are left out"),
    ],
)  # fmt: skip
def test_broken_ply(change, expected):
    messages = read(change(ply("ascii", [[0, 1, 2, 3], [0, 1, 2]])), "a.ply")[2]
    assert messages == ([expected, QUALITY] if "warning" in expected else [expected])


TEXTURED = """ply
format ascii 1.0
comment TextureFile {picture}
element vertex 4
property float x
property float y
property float z
{uv}element face 1
property list uchar int vertex_indices
end_header
"""


def test_the_picture_of_a_ply_is_drawn(tmp_path):
    write_image(tmp_path / "a b.png", np.array([[[255, 0, 0]]], np.uint8))
    text = TEXTURED.format(picture="a b.png", uv="property float s\nproperty float t\n")
    (tmp_path / "a.ply").write_text(text + "".join(f"{x:g} {y:g} {z:g} {x:g} {y:g}\n" for x, y, z in SQUARE) + "4 0 1 2 3\n")
    found = Diagnostics()
    builder = SceneBuilder(found, Files(tmp_path))
    (part,) = mesh_files.read(tmp_path / "a.ply", "a.ply", builder, found)
    assert found.items == []
    table = builder.finish().tables
    row = table.materials.textures[part.material, ir.Slot.DIFFUSE]
    assert table.textures.image[row] == 0


def test_what_is_not_drawn_of_a_ply_is_named():
    rows = "".join(f"{x:g} {y:g} {z:g} 1 2 0.5\n" for x, y, z in SQUARE)
    more = "property float confidence\nproperty float u0\nproperty uchar alpha\n"
    data = (TEXTURED.format(picture="t.png", uv=more) + rows + "4 0 1 2 3\n").encode()
    _, parts, messages = read(data, "a.ply")
    assert len(parts) == 1
    assert messages == [
        "a.ply: warning: the PLY file has data that is not drawn: `confidence` of `vertex`, `u0` of `vertex`, `alpha` of `vertex`",
        "a.ply: warning: the picture `t.png` is not drawn: the PLY file has no texture coordinates",
    ]


def test_cut_off_binary_ply():
    whole = ply("binary_little_endian", [[0, 1, 2, 3], [0, 1, 2]])
    for length in range(len(whole) - 38, len(whole)):
        _, parts, messages = read(whole[:length], "a.ply")
        held = len(parts)
        expected = f"a.ply: warning: the PLY file ends in the middle of its `face` rows: it promises 2 and has {held}"
        absent = "a.ply: error: the PLY file has no faces that can be drawn: a face is a list `vertex_indices`"
        assert messages == ([expected, QUALITY] if held else [expected, absent])
    assert held == 1


def test_a_ply_that_promises_too_many_vertices():
    data = ply("ascii", [[0, 1, 2, 3]]).replace(b"vertex 4", b"vertex 4000000000")
    parts, messages = read(data, "a.ply")[1:]
    assert parts == []
    assert messages[0].startswith("a.ply: warning: the PLY file ends in the middle of its `vertex` rows: it promises 4,000,000,000")


# --- STL ---

BOX = SQUARE[[[0, 3, 2], [0, 2, 1]]].tolist() + np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 1]], [[0, 0, 0], [1, 0, 1], [0, 0, 1]]]).tolist()


def stl(triangles, text):
    if text:
        lines = ["solid a"]
        for t in triangles:
            lines += ["facet normal 0 0 0", " outer loop", *(f"  vertex {x} {y} {z}" for x, y, z in t), " endloop", "endfacet"]
        return "\n".join([*lines, "endsolid a"]).encode()
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *(c for p in t for c in p), 0) for t in triangles)
    return b"solid, though binary".ljust(80) + struct.pack("<I", len(triangles)) + rows


@pytest.mark.parametrize("text", [False, True])
def test_stl_is_welded_and_has_creases(text):
    scene, _, messages = read(stl(BOX, text), "a.stl")
    assert messages == []
    assert tables.corners(scene.tables).tolist() == np.array(BOX, float).tolist()
    assert scene.tables.geometries.vertex_count.tolist() == [6]
    normals = np.array([[0, 0, -1], [0, 0, -1], [0, -1, 0], [0, -1, 0]])
    assert tables.attribute(scene.tables, "normals")[:, 0] == pytest.approx(normals, abs=1e-6)


@pytest.mark.parametrize("before", [b" ", b"\n", b"\xef\xbb\xbf", b"\r\n\t"])
def test_blanks_before_the_text_of_an_stl(before):
    scene, _, messages = read(before + stl(BOX, True), "a.stl")
    assert messages == []
    assert tables.corners(scene.tables).tolist() == np.array(BOX, float).tolist()


@pytest.mark.parametrize("name", [b"vertex shader test piece", b"a vertex 1 2 3 b", b""])
def test_the_name_of_an_stl_may_be_any_text(name):
    data = stl(BOX, True).replace(b"solid a", b"solid " + name)
    assert tables.corners(read(data, "a.stl")[0].tables).tolist() == np.array(BOX, float).tolist()


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"rubbish" * 3, "a.stl: error: this is not an STL file: it is neither binary nor does it begin with `solid`"),
        (b"x" * 80 + struct.pack("<I", 7) + b"y" * 40, "a.stl: error: the STL file ends early: it promises 7 triangles and holds 0"),
        (b"solid\nvertex 1 2 x\n", "a.stl: error: the STL file has 1 vertices, which make no whole number of triangles"),
        (b"   ", "a.stl: error: `a.stl` is empty"),
    ],
)  # fmt: skip
def test_broken_stl(data, expected):
    assert read(data, "a.stl")[2] == [expected]


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (stl(BOX, False)[:-1], "the STL file ends early: it promises 4 triangles and holds 3"),
        (b"solid" + stl(BOX, False)[5:-1], "the STL file ends early: it promises 4 triangles and holds 3"),
        (stl(BOX, True).replace(b"vertex 1 0 1", b"vertex 1 x 1", 1),
         "1 of 4 triangles have corners that are not finite: they are left out"),
    ],
)  # fmt: skip
def test_one_bad_triangle_of_an_stl_is_left_out(data, expected):
    scene, _, messages = read(data, "a.stl")
    assert messages == [f"a.stl: warning: {expected}"]
    assert len(tables.corners(scene.tables)) == 3


def test_a_facet_of_two_vertices_is_left_out():
    scene, _, messages = read(stl(BOX, True).replace(b"vertex 1 0 1", b"", 1), "a.stl")
    assert messages == ["a.stl:16:1: warning: 1 facets of the STL file have no three vertices: they are left out"]
    assert len(tables.corners(scene.tables)) == 3


@pytest.mark.parametrize(
    ("header", "attributes", "expected"),
    [
        (b"", [0x8000 | 31 << 10, 0x8000 | 31], [[1, 0, 0], [0, 0, 1]]),  # VisCAM: bit 15 set, red in the high bits
        (b"", [0x8000 | 31 << 5, 0], [[0, 1, 0], [1, 1, 1]]),
        (b"COLOR=\xff\xff\x00\xff", [31, 0x8000], [[1, 0, 0], [1, 1, 0]]),  # Magics: bit 15 clear, red in the low bits
    ],
)
def test_stl_colors(header, attributes, expected):
    rows = np.zeros(2, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    rows["corners"] = SQUARE[[[0, 1, 2], [0, 2, 3]]]
    rows["attribute"] = attributes
    scene, _, messages = read(header.ljust(80, b" ") + struct.pack("<I", 2) + rows.tobytes(), "a.stl")
    assert messages == []
    assert np.allclose(tables.attribute(scene.tables, "colors", 0)[:, 0], expected)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize(("normal", "told"), [((0, 0, 1), False), ((0, 0, 0), False), ((0, 0, -1), True)])
def test_stl_normals_against_the_winding(tmp_path, normal, told, binary):
    rows = struct.pack("<12fH", *normal, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    text = f"solid a\nfacet normal {normal[0]} {normal[1]} {normal[2]}\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
    data = b"".ljust(80) + struct.pack("<I", 1) + rows if binary else f"{text}endfacet\nendsolid a\n".encode()
    (tmp_path / "a.stl").write_bytes(data)
    found = Diagnostics()
    load.load(tmp_path / "a.stl", diagnostics=found)
    message = "the normals of 1 of 1 triangles point against their winding, which is drawn as the outside"
    assert [d.message for d in found.items if "winding" in d.message] == ([message] if told else [])


def test_stl_attributes_that_are_no_colours(tmp_path):
    rows = np.zeros(2, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]))
    rows["corners"] = SQUARE[[[0, 1, 2], [0, 2, 3]]]
    rows["attribute"] = 7
    rows["corners"][1, 0, 0] = np.nan
    _, _, messages = read(b" " * 80 + struct.pack("<I", 2) + rows.tobytes(), "a.stl")
    assert messages == [
        "a.stl: warning: the attribute bytes of the triangles are not colours: they are left out",
        "a.stl: warning: 1 of 2 triangles have corners that are not finite: they are left out",
    ]


@pytest.mark.parametrize("color", ["255 0 128", "1.0 0.0 0.50196"])
def test_colours_of_the_faces_of_an_off(color):
    text = f"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 {color}\n3 0 2 3\n"
    scene, _, messages = read(text.encode(), "a.off")
    assert messages == []
    assert tables.attribute(scene.tables, "colors")[:, 0] == pytest.approx(np.array([[1, 0, 0.21586], [1, 1, 1]]), abs=1e-4)


def test_normals_colours_and_coordinates_of_an_off():
    text = "STCNOFF\n3 1 0\n" + "".join(f"{x} {y} 0  0 0 1  255 0 0 255  {x} {y}\n" for x, y in ((0, 0), (1, 0), (0, 1))) + "3 0 1 2\n"
    scene, _, messages = read(text.encode(), "a.off")
    assert messages == []
    for name, values in (("normals", [0, 0, 1]), ("colors", [1, 0, 0])):
        assert tables.attribute(scene.tables, name)[0].tolist() == [values] * 3
    assert tables.attribute(scene.tables, "uvs")[0].tolist() == [[0, 0], [1, 0], [0, 1]]


def test_mtl_halo_and_options_are_named(tmp_path):
    (tmp_path / "m.mtl").write_text("newmtl m\nd -halo 0.5\nmap_Kd -cc on -boost 2 -blendu off p.png\n")
    found = Diagnostics()
    mtl.parse((tmp_path / "m.mtl").read_bytes(), "m.mtl", tmp_path, found)
    assert [d.message for d in found.items] == ["`d -halo` is drawn without the halo", "`map_Kd`: the option `-cc` is not drawn"]


# --- GLB ---


def glb(document, binary=b""):
    text = json.dumps({"asset": {"version": "2.0"}, **document}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def square(**more):
    """A document with a square of two triangles, shown by two nodes, and its buffer."""
    binary = SQUARE.astype("<f4").tobytes() + SQUARE[:, :2].astype("<f4").tobytes() + np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    document = {
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [{"buffer": 0, "byteOffset": a, "byteLength": n} for a, n in ((0, 48), (48, 32), (80, 12))],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "meshes": [{"name": "sq", "primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.25, 1], "metallicFactor": 0}}],
        "nodes": [
            {"mesh": 0, "name": "one", "translation": [1, 2, 3]},
            {"children": [0, 2], "scale": [2, 2, 2]},
            {"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]},
        ],
        "scenes": [{"nodes": [1]}],
    }
    return {**document, **more}, binary


def test_glb():
    scene, parts, messages = read(glb(*square()), "a.glb")
    assert messages == []
    assert [p.name for p in parts] == ["one", "sq"]
    assert [p.geometry for p in parts] == [0, 0]  # shared
    first, second = (p.transform for p in parts)
    assert first is not None
    assert second is not None
    assert first.tolist() == [[2, 0, 0, 2], [0, 2, 0, 4], [0, 0, 2, 6]]
    assert second.tolist() == [[0, -2, 0, 10], [2, 0, 0, 0], [0, 0, 2, 0]]
    assert tables.corners(scene.tables)[0].tolist() == SQUARE[[0, 1, 2]].tolist()
    assert tables.attribute(scene.tables, "uvs")[0].tolist() == [[0, 1], [1, 1], [1, 0]]  # its v goes down
    assert scene.tables.materials.values[parts[0].material, ir.Slot.DIFFUSE].tolist() == [1, 0.5, 0.25]
    assert scene.names.materials == ("red",)


def test_glb_pictures_and_their_frames(tmp_path):
    data = write_image(tmp_path / "p.png", np.array([[[255, 0, 0]]], np.uint8)).read_bytes()
    document, binary = square()
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
    document["images"] = [{"bufferView": 3, "mimeType": "image/png"}]
    document["samplers"] = [{"wrapS": 33071, "magFilter": 9728}]
    document["textures"] = [{"source": 0, "sampler": 0}]
    moved = {"KHR_texture_transform": {"offset": [0.25, 0.5], "scale": [2, 3]}}
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0, "extensions": moved}
    scene, _, messages = read(glb(document, binary + data), "a.glb")
    t = scene.tables.textures
    assert messages == []
    assert scene.tables.images.texels[0].tolist() == [1, 0, 0, 1]
    assert (t.wrap_u[0], t.wrap_v[0], bool(t.nearest[0])) == (ir.Wrap.CLAMP, ir.Wrap.REPEAT, True)
    assert t.frame[0].tolist() == [[2, 0, 0.25], [0, 3, -2.5]]  # v' = 1 − (3 (1 − v) + 0.5)


@pytest.mark.parametrize(("mode", "order", "count"), [(5, [0, 1, 3, 2], 2), (6, [0, 1, 2, 3], 2), (4, [0, 1, 2], 1)])
def test_glb_strips_and_fans_wind_alike(mode, order, count):
    document, binary = square()
    document["accessors"][2]["count"] = len(order)
    document["meshes"][0]["primitives"][0]["mode"] = mode
    scene, _, messages = read(glb(document, binary[:80] + np.array(order, "<u2").tobytes().ljust(12)), "a.glb")
    t = tables.corners(scene.tables)
    assert messages == []
    assert np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])[:, 2].tolist() == [1] * count


INDEX = "the glTF file contradicts itself (IndexError: list index out of range)"
OUTSIDE = "the glTF file's data lies outside of it"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"asset": {"version": "1.0"}}, "the glTF file is of version 1.0; version 2 is read"),
        ({"nodes": [{}, {}, {}]}, "the glTF file shows no mesh"),
    ],
)
def test_broken_glb(change, expected):
    assert read(glb(*square(**change)), "a.glb")[2] == [f"a.glb: error: {expected}"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"nodes": [{"children": [1]}, {"children": [0]}]}, ["the glTF file's nodes contain each other: the rest is left out"]),
        ({"nodes": [{}], "scenes": [{"nodes": [0] * 200_001}]}, ["the glTF file has more than 200,000 nodes: the rest is left out"]),
        ({"bufferViews": []}, [f"primitive 0 of `sq` is left out: {INDEX}"]),
        ({"bufferViews": [{"buffer": 0, "byteOffset": 9999}] * 3}, [f"primitive 0 of `sq` is left out: {OUTSIDE}"]),
        ({"scenes": [7]}, ["`scenes[0]` is not an object: it is left out"]),
        ({"nodes": "x"}, ["`nodes` is not a list: it is left out", f"node 1 is left out: {INDEX}"]),
    ],
)  # fmt: skip
def test_a_glb_without_a_sound_mesh(change, expected):
    warnings = [f"a.glb: warning: {message}" for message in expected]
    assert read(glb(*square(**change)), "a.glb")[2] == [*warnings, "a.glb: error: the glTF file shows no mesh"]


def bad_primitive(document):
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 9}})


def bad_texture(document):
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 5}


def bad_material(document):
    document["materials"][0]["pbrMetallicRoughness"] = {"baseColorFactor": [1, 0]}


def no_material(document):
    document["meshes"][0]["primitives"][0]["material"] = 4


def bad_child(document):
    document["nodes"][1]["children"].append(77)


def bad_skin(document):
    document["nodes"][0]["skin"] = 3


def bad_camera(document):
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0, "znear": 0.1}}]
    document["nodes"][0]["camera"] = 0


def bad_scene(document):
    document["scene"] = 4


def negative_child(document):
    document["nodes"][1]["children"].append(-1)


def negative_accessor(document):
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": -3}})


def unknown_mode(document):
    document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 99})


def infinite_color(document):
    document["materials"][0]["pbrMetallicRoughness"] = {"baseColorFactor": [1e999, 0, 0, 1]}


def infinite_light(document):
    document["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": math.inf}]}}
    document["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}


NEGATIVE = "the glTF file contradicts itself (IndexError: there is no row {})"


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (negative_child, f"node -1 is left out: {NEGATIVE.format(-1)}"),
        (negative_accessor, f"primitive 1 of `sq` is left out: {NEGATIVE.format(-3)}"),
        (unknown_mode, "primitive 1 of `sq` is left out: there is no mode 99: 0 to 6 are points, lines and triangles"),
        (infinite_color, "material 0 is left out: `baseColorFactor` is too large or no number"),
        (infinite_light, "the light of node 0 is left out: `intensity` is too large or no number"),
        (bad_primitive, f"primitive 1 of `sq` is left out: {INDEX}"),
        (bad_texture, "texture 5, its sampler or its image does not exist: it is left out"),
        (bad_material, f"material 0 is left out: {INDEX}"),
        (no_material, f"material 4 is left out: {INDEX}"),
        (bad_child, f"node 77 is left out: {INDEX}"),
        (bad_skin, "a skin is left out: the glTF file contradicts itself (KeyError: 'skins')"),
        (bad_camera, "the camera of node 0 is left out: its field of view is not above 0"),
        (bad_scene, f"the default scene is left out: {INDEX}"),
    ],
)
def test_one_bad_item_of_a_glb_is_left_out(spoil, expected):
    """The square is drawn at its two nodes all the same."""
    document, binary = square()
    spoil(document)
    found = Diagnostics()
    builder = SceneBuilder(found)
    parts = mesh_files.read(glb(document, binary), "a.glb", builder, found, as_scene=True)
    assert [f"{d.severity}: {d.message}" for d in found.items if d.severity != "note"] == [f"warning: {expected}"]
    assert len(parts) == 2


def test_a_buffer_that_ends_early_is_read_as_far_as_it_goes():
    document, binary = square()
    document["accessors"][2]["count"] = 600
    scene, _, messages = read(glb(document, binary), "a.glb")
    assert messages == ["a.glb: warning: buffer view 2 ends early: 6 of 600 elements are read"]
    assert len(tables.corners(scene.tables)) == 2


def test_attributes_that_end_early_are_left_out():
    document, binary = square()
    document["accessors"][1]["count"] = 3
    scene, _, messages = read(glb(document, binary), "a.glb")
    assert messages == ["a.glb: warning: `TEXCOORD_0` of `sq` has 3 values for 4 vertices: it is left out"]
    assert not tables.has(scene.tables, "uvs", 0)


@pytest.mark.parametrize("tail", [b"\x1a", b"\0\0", b"}"])
def test_bytes_after_the_document_are_left_out(tmp_path, tail):
    document, binary = square()
    document["buffers"] = [{"byteLength": len(binary), "uri": "data:;base64," + base64.b64encode(binary).decode()}]
    _, parts, messages = read(json.dumps(document).encode() + tail, "a.gltf")
    assert messages == [f"a.gltf: warning: {len(tail)} characters after the document are left out"]
    assert len(parts) == 2


def test_extensions_of_another_type_are_left_out():
    document, binary = square()
    document["nodes"][0]["extensions"], document["extensions"] = "x", {"KHR_lights_punctual": 7}
    _, parts, messages = read(glb(document, binary), "a.glb")
    assert messages[:2] == [
        "a.glb: warning: `KHR_lights_punctual` is not an object: it is left out",
        "a.glb: warning: `extensions` is not an object: it is left out"
    ]  # fmt: skip
    assert len(parts) == 2


def test_triangles_without_their_vertices_are_left_out():
    document, binary = square()
    document["accessors"][0]["count"] = 3
    scene, parts, messages = read(glb(document, binary), "a.glb")
    assert messages == ["a.glb: warning: 1 of 2 triangles of `sq` use vertices that do not exist or are not finite: they are left out"]
    assert (len(parts), len(scene.tables.pools.triangles)) == (2, 1)


def gltf_lights(kind, **more):
    """A document with a square, a light of this kind and a camera, both turned to +x at (0, 0, 2)."""
    document, binary = square()
    turned = {"translation": [0, 0, 2], "rotation": [0, -(0.5**0.5), 0, 0.5**0.5]}
    lights = [{"type": kind, "color": [0, 0, 1], "intensity": 5, "name": "lamp", **more}]
    document["extensions"] = {"KHR_lights_punctual": {"lights": lights}}
    document["extensionsUsed"] = ["KHR_lights_punctual"]
    document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "aspectRatio": 1.5, "znear": 0.1}}]
    document["nodes"] += [{**turned, "extensions": {"KHR_lights_punctual": {"light": 0}}}, {**turned, "camera": 0, "name": "view"}]
    document["scenes"] = [{"nodes": [1, 3, 4]}]
    return glb(document, binary)


@pytest.mark.parametrize(
    ("kind", "more", "expected"),
    [
        ("directional", {}, {"kind": ir.LightKind.DIRECTIONAL, "direction": [-1, 0, 0]}),
        ("point", {}, {"kind": ir.LightKind.POINT, "position": [0, 0, 2]}),
        ("spot", {"spot": {"outerConeAngle": 0.5, "innerConeAngle": 0.25}},
         {"kind": ir.LightKind.SPOT, "position": [0, 0, 2], "direction": [1, 0, 0], "cos_cone": np.cos(0.5), "cos_full": np.cos(0.25)}),
    ],
)  # fmt: skip
def test_the_lights_and_the_camera_of_a_gltf(tmp_path, kind, more, expected):
    """KHR_lights_punctual and §3.10: both look to −z of their node."""
    (tmp_path / "a.glb").write_bytes(gltf_lights(kind, **more))
    scene = load.load(tmp_path / "a.glb")
    lights, cameras = scene.tables.lights, scene.tables.cameras
    assert lights.color.tolist() == [[0, 0, 5]]
    for column, value in expected.items():
        assert getattr(lights, column)[0].tolist() == pytest.approx(value, abs=1e-6)
    assert scene.names.cameras == ("view",)
    assert scene.photometric
    assert cameras.extent[0] == pytest.approx(np.tan(0.5))
    assert cameras.aspect[0] == 1.5
    matrix = scene.tables.transforms.matrix[cameras.transform[0]]
    assert -matrix[:3, 2] == pytest.approx([1, 0, 0], abs=1e-6)


def test_a_mesh_in_a_scene_leaves_lights_and_cameras_out():
    messages = read(gltf_lights("point"), "a.glb")[2]
    assert messages == [
        f"a.glb: warning: the {what} of a mesh file are left out: only a file that is drawn by itself brings its {what}"
        for what in ("lights", "cameras")
    ]


def test_instances_of_a_gltf():
    """EXT_mesh_gpu_instancing: a node shows its mesh at each row of its attributes."""
    document, binary = square()
    places = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]], "<f4").tobytes()
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": 36})
    document["accessors"].append({"bufferView": 3, "componentType": 5126, "count": 3, "type": "VEC3"})
    document["nodes"] = [{"mesh": 0, "scale": [2, 2, 2], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 3}}}}]
    document["scenes"] = [{"nodes": [0]}]
    _, parts, messages = read(glb(document, binary + places), "a.glb")
    assert messages == []
    assert [np.asarray(p.transform)[:, 3].tolist() for p in parts] == [[0, 0, 0], [6, 0, 0], [0, 8, 0]]
    assert {p.geometry for p in parts} == {0}


def test_an_invisible_node_hides_its_children():
    document, binary = square()
    document["nodes"][1]["extensions"] = {"KHR_node_visibility": {"visible": False}}
    document["scenes"] = [{"nodes": [1, 0]}]
    assert [p.name for p in read(glb(document, binary), "a.glb")[1]] == ["one"]


@pytest.mark.parametrize("override", [False, True])
def test_pictures_use_the_set_of_coordinates_that_they_name(tmp_path, override):
    data = write_image(tmp_path / "p.png", np.array([[[255, 0, 0]]], np.uint8)).read_bytes()
    document, binary = square()
    second = np.full((4, 2), 0.25, "<f4").tobytes()
    document["bufferViews"] += [
        {"buffer": 0, "byteOffset": len(binary), "byteLength": 32}, {"buffer": 0, "byteOffset": len(binary) + 32, "byteLength": len(data)},
    ]  # fmt: skip
    document["accessors"].append({"bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC2"})
    document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = 3
    document["images"], document["textures"] = [{"bufferView": 4}], [{"source": 0}]
    reference = {"index": 0, "extensions": {"KHR_texture_transform": {"texCoord": 1}}} if override else {"index": 0, "texCoord": 1}
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = reference
    scene, _, messages = read(glb(document, binary + second + data), "a.glb")
    assert messages == []
    assert tables.attribute(scene.tables, "uvs")[0].tolist() == [[0.25, 0.75]] * 3


def test_a_gltf_with_a_file_and_a_data_uri(tmp_path):
    """Text, buffer and picture apart; the mesh's buffer beside it, the picture inside."""
    picture = base64.b64encode(write_image(tmp_path / "p.png", np.array([[[0, 255, 0]]], np.uint8)).read_bytes()).decode()
    document, binary = square(asset={"version": "2.0"})
    document["buffers"][0]["uri"] = "the%20mesh.bin"
    document["images"], document["textures"] = [{"uri": f"data:image/png;base64,{picture}"}], [{"source": 0}]
    document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    (tmp_path / "the mesh.bin").write_bytes(binary)
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    found = Diagnostics()
    scene = load.load(tmp_path / "a.gltf", diagnostics=found)
    assert [d.message for d in found.items if d.severity != "note"] == []
    assert scene.tables.images.texels[0].tolist() == [0, 1, 0, 1]
    assert len(scene.tables.pools.triangles) == 2
    assert str(tmp_path / "the mesh.bin") in scene.files


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"animations": [{}]}, "the file has 1 animation: a mesh in a scene stands as its file places it"),
        ({"extensionsUsed": ["EXT_new", "KHR_mesh_quantization"]}, "the extension `EXT_new` is not known: it is not drawn"),
        ({"materials": [{"extensions": {"KHR_materials_scatter": {}}}]},
         "the extension `KHR_materials_scatter` is not drawn"),
        ({"textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}],
          "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]},
         "texture 0, its sampler or its image does not exist: it is left out"),
        ({"textures": [{"extensions": {"EXT_texture_astc": {"source": 0}}}],
          "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]},
         ("the extension `EXT_texture_astc` is not drawn", "a texture is not drawn: its picture is given by EXT_texture_astc alone")),
        ({"scenes": [{"nodes": [1], "mood": 1}],
          "materials": [{"glow": 2}, {"glow": 2}]},
         ("`scenes[0].mood` is not known: it is not drawn", "`materials[0].glow` is not known: it is not drawn")),
        ({"extensionsUsed": ["KHR_materials_clearcoat"],
          "materials": [{"extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1.0, "clearcoatTint": 1}}}]},
         "`materials[0].KHR_materials_clearcoat.clearcoatTint` is not drawn"),
        ({"textures": [{"source": 0}], "images": [{"uri": "p.png"}],
          "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]},
         "the picture `p.png` is not read: its mesh has no folder"),
    ],
)  # fmt: skip
def test_what_is_not_drawn_of_a_gltf_is_named(change, expected):
    _, parts, messages = read(glb(*square(**change)), "a.glb")
    assert len(parts) == 2
    assert sorted(messages) == sorted(f"a.glb: warning: {e}" for e in ([expected] if isinstance(expected, str) else expected))


def test_emission_coats_glass_and_unlit_of_a_gltf():
    document, binary = square()
    extensions = {
        "KHR_materials_emissive_strength": {"emissiveStrength": 4}, "KHR_materials_ior": {"ior": 1.25},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5},
    }  # fmt: skip
    document["materials"] = [{"emissiveFactor": [0, 0.5, 0], "extensions": extensions}]
    scene, (part, _), messages = read(glb(document, binary), "a.glb")
    values = scene.tables.materials.values[part.material]
    assert messages == []
    assert values[ir.Slot.EMISSION].tolist() == [0, 2, 0]
    assert (values[ir.Slot.IOR][0], values[ir.Slot.COAT][0]) == (1.25, 0.5)
    document["materials"] = [{"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}]
    scene, (part, _), messages = read(glb(document, binary), "a.glb")
    assert (messages, scene.tables.materials.values[part.material, ir.Slot.EMISSION].tolist()) == ([], [1, 0, 0])
    clear = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.4}}
    for metallic, opacity in ((0, (0.4 / 2.4) ** 2), (1, 1)):  # a clear pane covers what it reflects; metals transmit nothing
        document["materials"] = [{"extensions": clear, "pbrMetallicRoughness": {"roughnessFactor": 0, "metallicFactor": metallic}}]
        scene, (part, _), messages = read(glb(document, binary), "a.glb")
        assert messages == []
        assert scene.tables.materials.values[part.material, [ir.Slot.IOR, ir.Slot.OPACITY], 0] == pytest.approx([1.4, opacity])


@pytest.mark.parametrize("data", [b"glTF", b"x" * 30, b"glTF" + struct.pack("<III4s", 2, 99, 4000, b"JSON")])
def test_no_glb(data):
    assert len(read(data, "a.glb")[2]) == 1


def test_an_unknown_ending():
    assert read(b"x", "a.max")[2] == ["a.max: error: `a.max` is not a mesh file of a known format"]


def extended(**extensions):
    """(scene, messages) of a square whose material has these extensions."""
    pbr = {"baseColorFactor": [1, 1, 1, 1], "metallicFactor": 0}
    scene, _, messages = read(glb(*square(materials=[{"pbrMetallicRoughness": pbr, "extensions": extensions}])), "a.glb")
    return scene, messages


def test_glass_of_a_volume_absorbs():
    scene, messages = extended(
        KHR_materials_transmission={"transmissionFactor": 1.0},
        KHR_materials_volume={"thicknessFactor": 1.0, "attenuationDistance": 2.0, "attenuationColor": [1.0, 0.5, 0.25]},
    )
    m = scene.tables.materials
    assert (messages, m.model[0]) == ([], ir.MaterialModel.GLASS)
    assert m.values[0, ir.Slot.ROUGHNESS, 0] == 1
    assert m.values[0, ir.Slot.ABSORPTION] == pytest.approx([0, np.log(2) / 2, np.log(4) / 2])


@pytest.mark.parametrize(("color", "share", "model"), [([1, 0.2, 0.2, 1], 0.75, "GLASS"), ([1, 1, 1, 1], 0.75, "PRINCIPLED_SPECULAR"),
                                                       ([1, 0.2, 0.2, 1], 0.25, "PRINCIPLED_SPECULAR")])  # fmt: skip
def test_transmission_without_a_volume_is_thin_or_tinted_glass(color, share, model):
    pbr = {"baseColorFactor": color, "metallicFactor": 0, "roughnessFactor": 0}
    extensions = {"KHR_materials_transmission": {"transmissionFactor": share}}
    scene, _, messages = read(glb(*square(materials=[{"pbrMetallicRoughness": pbr, "extensions": extensions}])), "a.glb")
    m = scene.tables.materials
    assert ir.MaterialModel(m.model[0]).name == model
    if model == "GLASS":
        assert m.values[0, ir.Slot.TRANSMISSION].tolist() == color[:3]
        return
    assert m.values[0, ir.Slot.OPACITY, 0] == pytest.approx(1.0 - share)
    white = "light passes thin smooth surfaces white: without the colour of KHR_materials_transmission"
    assert messages == ([f"a.glb: warning: {white}"] if color[1] < 1 else [])


def test_the_extension_before_transmission_is_drawn_where_it_is_alone():
    old = {"transmissionFactor": 0.25}
    for more, share in (({}, 0.25), ({"KHR_materials_transmission": {"transmissionFactor": 0.5}}, 0.5)):
        pbr = {"metallicFactor": 0, "roughnessFactor": 0}
        written = {"pbrMetallicRoughness": pbr, "extensions": {"ADOBE_materials_thin_transparency": old, **more}}
        scene, _, messages = read(glb(*square(materials=[written])), "a.glb")
        assert (messages, scene.tables.materials.values[0, ir.Slot.OPACITY, 0]) == ([], pytest.approx(1.0 - share))


def test_the_specular_factor_scales_the_reflectance():
    scene, messages = extended(KHR_materials_specular={"specularFactor": 0.25})
    ior = scene.tables.materials.values[0, ir.Slot.IOR, 0]
    assert messages == []
    assert ((ior - 1) / (ior + 1)) ** 2 == pytest.approx(0.04 / 4)
    metal = {"extensions": {"KHR_materials_specular": {"specularColorFactor": [1, 0, 0]}}}
    assert read(glb(*square(materials=[metal])), "a.glb")[2] == [
        "a.glb: warning: the colour and the pictures of KHR_materials_specular are drawn as the mean of its factors where metallic is not 0"
    ]


def test_the_specular_colour_of_a_surface_that_is_no_metal():
    given = {"specularFactor": 0.5, "specularColorFactor": [1, 0.5, 80]}
    written = {"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {"KHR_materials_specular": given}}
    scene, _, messages = read(glb(*square(materials=[written])), "a.glb")
    m = scene.tables.materials
    assert messages == []
    assert ir.MaterialModel(m.model[0]) == ir.MaterialModel.PRINCIPLED_SPECULAR
    assert m.values[0, ir.Slot.SPECULAR] == pytest.approx([0.02, 0.01, 1])


@pytest.mark.parametrize(("mode", "parts"), [(1, [[0, 1], [2, 3]]), (2, [[0, 1, 2, 3, 0]]), (3, [[0, 1, 2, 3]])])
def test_lines_of_a_glb_are_tubes(mode, parts):
    document, binary = square()
    primitive = document["meshes"][0]["primitives"][0]
    primitive["mode"] = mode
    del primitive["indices"]
    scene, _, messages = read(glb(document, binary), "a.glb")
    assert messages == []
    corners = tables.corners(scene.tables)
    radius = 2**0.5 / 300
    ends = [(SQUARE[a], SQUARE[b]) for part in parts for a, b in itertools.pairwise(part)]
    away = np.stack([distance(corners.reshape(-1, 3), a, b) for a, b in ends]).min(axis=0)
    assert away.max() < 1.5 * radius
    assert away.max() > 0.9 * radius
    for a, b in ends:
        assert distance(corners.reshape(-1, 3), a, b).min() < 1.01 * radius
        assert distance(corners.mean(axis=1), (a + b) / 2, (a + b) / 2).min() < 0.6


def distance(points, a, b):
    """Distances (n,) of points from a segment."""
    along = np.clip((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0, 1)
    return np.linalg.norm(points - a - along[:, None] * (b - a), axis=1)


def test_points_of_a_glb_are_spheres():
    document, binary = square()
    primitive = document["meshes"][0]["primitives"][0]
    primitive["mode"] = 0
    document["accessors"][2]["count"] = 3
    scene, _, messages = read(glb(document, binary), "a.glb")
    assert messages == []
    corners = tables.corners(scene.tables).reshape(-1, 3)
    assert np.linalg.norm(corners[:, None] - SQUARE[[0, 1, 2]], axis=2).min(axis=1) == pytest.approx(2**0.5 / 300, rel=1e-4)


def test_specular_and_glossiness():
    given = {"diffuseFactor": [0.1, 0.2, 0.3, 1], "specularFactor": [0.5, 0.4, 0.3], "glossinessFactor": 0.75}
    scene, messages = extended(KHR_materials_pbrSpecularGlossiness=given)
    m = scene.tables.materials
    assert messages == []
    assert m.model[0] == ir.MaterialModel.PRINCIPLED_SPECULAR
    assert m.values[0, ir.Slot.DIFFUSE].tolist() == [0.1, 0.2, 0.3]
    assert m.values[0, ir.Slot.SPECULAR].tolist() == [0.5, 0.4, 0.3]
    assert m.values[0, ir.Slot.ROUGHNESS, 0] == 0.25


def moving(interpolation="LINEAR", targets=(), **more):
    """A square whose first node an animation of two seconds moves by 4 along x and turns by 90 degrees about z."""
    document, binary = square(**more)
    h = 0.5**0.5
    columns = [np.array([0, 2], "<f4"), np.array([[0, 0, 0], [4, 0, 0]], "<f4"), np.array([[0, 0, 0, 1], [0, 0, h, h]], "<f4"), *targets]
    first = len(document["accessors"])
    for values in columns:
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": values.nbytes})
        kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[values.shape[1] if values.ndim > 1 else 1]
        code = {"f": 5126, "u": 5121}[values.dtype.kind]
        accessor = {"bufferView": len(document["bufferViews"]) - 1, "componentType": code, "count": len(values), "type": kind}
        document["accessors"].append(accessor)
        binary += values.tobytes()
    document["buffers"] = [{"byteLength": len(binary)}]
    document["animations"] = [{
        "channels": [{"sampler": k, "target": {"node": 0, "path": path}} for k, path in enumerate(("translation", "rotation"))],
        "samplers": [{"input": first, "output": first + 1 + k, "interpolation": interpolation} for k in range(2)],
    }]  # fmt: skip
    document["scenes"] = [{"nodes": [0]}]
    return document, binary, first + 3


def at_time(data, time):
    found = Diagnostics()
    builder = SceneBuilder(found)
    parts = mesh_files.read(data, "a.glb", builder, found, time=time)
    return builder.finish(), parts, [d.message for d in found.items]


@pytest.mark.parametrize(
    ("interpolation", "time", "x", "angle"), [("LINEAR", 0.5, 1, 22.5), ("LINEAR", 9, 4, 90), ("STEP", 1.9, 0, 0), ("LINEAR", -1, 0, 0)]
)
def test_an_animation_moves_its_node(interpolation, time, x, angle):
    document, binary, _ = moving(interpolation)
    _, parts, messages = at_time(glb(document, binary), time)
    matrix = np.asarray(parts[0].transform)
    assert messages == []
    assert matrix[:, 3] == pytest.approx([x, 0, 0], abs=1e-6)
    assert np.degrees(np.arctan2(matrix[1, 0], matrix[0, 0])) == pytest.approx(angle, abs=1e-4)


def test_without_a_time_nodes_stand_where_the_file_places_them():
    document, binary, _ = moving()
    _, parts, messages = at_time(glb(document, binary), None)
    assert np.asarray(parts[0].transform)[:, 3].tolist() == [1, 2, 3]
    assert messages == ["the file has 1 animation: a mesh in a scene stands as its file places it"]


def test_morph_targets():
    shift = np.tile(np.array([0, 0, 2], "<f4"), (4, 1))
    document, binary, first = moving(targets=[shift])
    document["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": first}]
    document["meshes"][0]["weights"] = [0.5]
    scene, _, messages = at_time(glb(document, binary), 0)
    assert messages == []
    assert tables.corners(scene.tables)[..., 2].tolist() == [[1, 1, 1], [1, 1, 1]]


def test_a_skin_moves_the_mesh_by_its_joints():
    """Joint 0 stays and joint 1 is moved by 4 along x at two seconds; the right side of the square follows joint 1."""
    joints = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0]], "<u1")
    weights = np.tile(np.array([1, 0, 0, 0], "<f4"), (4, 1))
    bound = np.tile(np.eye(4, dtype="<f4").reshape(16), (2, 1))
    document, binary, first = moving(targets=[joints, weights, bound])
    document["meshes"][0]["primitives"][0]["attributes"] |= {"JOINTS_0": first, "WEIGHTS_0": first + 1}
    document["skins"] = [{"joints": [1, 0], "inverseBindMatrices": first + 2}]
    document["nodes"] = [{"translation": [1, 2, 3]}, {}, {"mesh": 0, "skin": 0, "translation": [100, 0, 0]}]
    document["scenes"] = [{"nodes": [0, 1, 2]}]
    document["animations"][0]["channels"].pop()
    scene, parts, messages = at_time(glb(document, binary), 2)
    assert messages == []
    assert np.asarray(parts[0].transform).tolist() == np.eye(4)[:3].tolist()  # the node of a skinned mesh does not count
    assert tables.corners(scene.tables)[0].tolist() == [[0, 0, 0], [5, 0, 0], [5, 1, 0]]


# --- the shared samples ---

SAMPLES = {  # triangles, materials that the file names
    "obj_spot/spot.obj": (5856, 0),
    "obj_fuze/fuze.obj": (1000, 1),
    "obj_cornell_box/cornell_box.obj": (36, 4),
    "obj_negative_indices/negative_indices.obj": (12, 0),
    "obj_groups/groups.obj": (2308, 0),
    "obj_cube_usemtl/cube_usemtl.obj": (12, 2),
    "obj_teapot/teapot.obj": (6320, 0),
    "ply_box_textured/BoxTextured.ply": (12, 0),
    "ply_float_colors/float-color.ply": (1, 0),
    "ply_binary_cube/cube_binary.ply": (12, 0),
    "ply_fuze/fuze.ply": (1000, 0),
}


NAMED = {  # what is said of them
    "obj_cube_usemtl/cube_usemtl.obj": ["warning"],  # its library lacks one material
    "ply_fuze/fuze.ply": ["warning"],  # its picture has another name
}


@pytest.mark.assets
@pytest.mark.parametrize("name", SAMPLES)
def test_samples(assets, name):
    found = Diagnostics()
    path = assets / "mesh" / name
    scene = load.load(path, diagnostics=found)
    triangles, materials = SAMPLES[name]
    assert len(scene.tables.pools.triangles) == triangles
    assert len([m for m in scene.names.materials if m != "default"]) == materials
    assert [d.severity for d in found.items if "says no" not in d.message] == NAMED.get(name, [])  # without the note on its unit


@pytest.mark.assets
def test_the_picture_of_fuze_is_shown_and_opaque(assets):
    found = Diagnostics()
    folder = assets / "mesh" / "obj_fuze"
    builder = SceneBuilder(found, Files(folder))
    part = mesh_files.read(folder / "fuze.obj", "fuze.obj", builder, found)[0]
    scene = builder.finish()
    materials = scene.tables.materials
    assert found.items == []
    assert materials.textures[part.material, ir.Slot.DIFFUSE] == 0
    assert materials.values[part.material, ir.Slot.TRANSMISSION].tolist() == [0, 0, 0]
    assert materials.values[part.material, ir.Slot.DIFFUSE].tolist() == [1, 1, 1]


@pytest.mark.assets
def test_negative_indices_make_the_cube(assets):
    scene = load.load(assets / "mesh/obj_negative_indices/negative_indices.obj")
    t = tables.corners(scene.tables)
    volume = np.einsum("ti,ti->t", t[:, 0], np.cross(t[:, 1], t[:, 2])).sum() / 6
    assert volume == pytest.approx(np.prod(t.reshape(-1, 3).max(axis=0) - t.reshape(-1, 3).min(axis=0)))


# --- OFF ---

OFF = b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"


def test_off():
    scene, parts, messages = read(OFF, "a.off")
    assert messages == []
    assert len(parts) == 1
    assert tables.corners(scene.tables).reshape(-1, 3).tolist() == SQUARE[[0, 1, 2, 0, 2, 3]].tolist()


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"rubbish", "error: this is not an OFF file: it does not begin with `OFF`"),
        (b"OFF\n4 1 0\n0 0 0\n1 0 0\n",
         "warning: the OFF file ends early: it promises 4 vertices and 1 faces and holds 2 and 0"),
        (b"OFF BINARY\n", "error: OFF files in binary or of another dimension than 3 are not read"),
        (b"OFF\n", "error: the OFF file does not say how many vertices and faces it has"),
        (OFF.replace(b"0 2 3", b"0 2 9"),
         "warning: 1 of 2 faces are damaged, or use vertices that do not exist or are not finite: they are left out"),
        (OFF.replace(b"0 1 0", b"0 x 0"),
         "warning: 1 of 2 faces are damaged, or use vertices that do not exist or are not finite: they are left out"),
    ],
)  # fmt: skip
def test_broken_off(data, expected):
    assert read(data, "a.off")[2][0] == f"a.off: {expected}"
