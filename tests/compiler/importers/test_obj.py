"""OBJ and MTL text in, geometry, materials and whole messages out."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers import mesh_files, mtl, obj_lexer
from maquette.compiler.io.sandbox import Files
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang.diagnostics import Diagnostics, Span, render_text

from ...files import write_image
from .. import tables

GONE = "there is no material library `gone.mtl`: its materials are not read"
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def read(text, folder=None, name="x.obj"):
    """(scene, parts, printed messages) of an OBJ file's text; beside it the files of `folder`."""
    data = text if isinstance(text, bytes) else text.encode()
    found = Diagnostics()
    builder = SceneBuilder(found, Files(folder) if folder else None)
    if folder:
        (folder / name).write_bytes(data)
    parts = mesh_files.read(folder / name if folder else data, name, builder, found)
    messages = [render_text(d, lambda file: None) for d in found.items]
    return builder.finish(), parts, messages


def corners(scene):
    """The corners of all triangles, (t, 3, 3), where they were written."""
    made = [tables.corners(scene.tables, row) for row in range(len(scene.tables.geometries.kind))]
    return np.concatenate(made) if made else np.zeros((0, 3, 3))


def test_a_square():
    scene, parts, messages = read(SQUARE + "f 1 2 3 4\n")
    assert messages == []
    assert corners(scene).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert [p.name for p in parts] == ["x"]
    assert parts[0].material is None
    assert scene.tables.geometries.polygon_count.tolist() == [1]


@pytest.mark.parametrize(
    "text",
    [
        SQUARE.replace("\n", "\r\n") + "f 1 2 3 4\r\n",
        SQUARE.replace("\n", "\r") + "f 1 2 3 4\r",
        "\ufeff" + SQUARE + "f 1 2 3 4",
        SQUARE + "f 1 \\\n 2 3 \\\n4\n",
        SQUARE + "f 1 2 \\\r\n3 4\r\n",
        "  " + SQUARE.replace("\n", "\n\t ") + "f  1\t2  3 4  \n",
        "# a square\n\n" + SQUARE + "# its face\nf 1 2 3 4 # here\n",
        SQUARE.replace(" 0\n", " 0 1.0\n") + "f 1 2 3 4\n",
        SQUARE + "f -4 -3 -2 -1\n",
        SQUARE + "f +1 2 3 4\n",
        "v 0 0 0\nv 1 0 0\nf 1 2 3 4\nv 1 1 0\nv 0 1 0\n",
        (SQUARE + "f 1 2 3 4\n").encode("utf-16"),
        SQUARE + "vt 0 0\nvn 0 0 1\nf 1// 2/1/1 3/1 4//1\n",
    ],
    ids=[
        "crlf",
        "cr",
        "bom",
        "continued",
        "continued-crlf",
        "blanks",
        "comments",
        "weights",
        "negative",
        "plus",
        "face-first",
        "utf16",
        "mixed",
    ],
)
def test_the_same_square_however_it_is_written(text):
    scene, _, messages = read(text)
    assert messages == []
    assert corners(scene).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]


def test_negative_indices_count_from_where_they_stand():
    moved = SQUARE.replace(" 0\n", " 5\n")
    scene, _, messages = read(SQUARE + "f -4 -3 -2\n" + moved + "f -4 -3 -2\n")
    assert messages == []
    assert corners(scene)[:, 0, 2].tolist() == [0, 5]


def test_texture_coordinates_and_normals_follow_their_corners():
    text = SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 2\nf 1/4/1 2/3/1 3/2/1\nf 1/1/1 3/3/1 4/4/1\n"
    scene, _, messages = read(text)
    assert messages == []
    assert tables.attribute(scene.tables, "uvs").tolist() == [[[0, 1], [1, 1], [1, 0]], [[0, 0], [1, 1], [0, 1]]]
    assert tables.attribute(scene.tables, "normals").tolist() == [[[0, 0, 1]] * 3] * 2


def test_corners_without_a_normal_get_a_computed_one():
    scene, _, _ = read(SQUARE + "vn 0 1 0\nf 1//1 2//1 3//1\nf 1 3 4\n")
    assert tables.attribute(scene.tables, "normals").tolist() == [[[0, 1, 0]] * 3, [[0, 0, 1]] * 3]


def test_vertex_colours_are_srgb():
    scene, _, _ = read("v 0 0 0 1 0 0\nv 1 0 0 0.5 0.5 0.5\nv 0 1 0 0 0 1\nf 1 2 3\n")
    assert tables.attribute(scene.tables, "colors")[0] == pytest.approx(np.array([[1, 0, 0], [0.2140411] * 3, [0, 0, 1]]))


def test_smoothing_groups():
    roof = "v 0 0 0\nv 0 0 -1\nv -1 -1 0\nv 1 -1 0\n"
    faces = "f 1 2 3\nf 1 4 2\n"
    sharp, _, _ = read(roof + faces)
    smooth, _, _ = read(roof + "s 1\n" + faces)
    off, _, _ = read(roof + "s off\n" + faces)
    assert tables.attribute(smooth.tables, "normals")[0, 0] == pytest.approx([0, 1, 0], abs=1e-6)
    assert tables.attribute(sharp.tables, "normals")[0, 0] == pytest.approx([-(0.5**0.5), 0.5**0.5, 0], abs=1e-6)
    assert np.array_equal(tables.attribute(off.tables, "normals"), tables.attribute(sharp.tables, "normals"))


def test_concave_face():
    scene, _, _ = read("v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf 1 2 3 4\n")
    t = corners(scene)
    assert np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])[:, 2].tolist() == [4, 4]


# --- what is wrong ---

FORMS = ": v, v/vt, v//vn or v/vt/vn, whole numbers"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("v 0 0 0\nv 1 0 zero\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n", ["x.obj:2:1: warning: malformed line: `v` needs 3 numbers or more"]),
        ("v 0 0 0\nv 1 0\nv 1 1 0\nv 1\nv 0 1 0\nf 1 2 3\nf 1 3 5\n", [
            "x.obj:2:1: warning: malformed line: `v` needs 3 numbers or more, got 2; so is 1 more line"]),
        (SQUARE + "f 1 2 x\nf 1 2 3\n", ["x.obj:5:1: warning: malformed line: `x` is not a corner of a face" + FORMS]),
        (SQUARE + "f 1 2 3.5\nf 1 2 3\n", ["x.obj:5:1: warning: malformed line: `3.5` is not a corner of a face" + FORMS]),
        (SQUARE + "f 1/1/1/1 2 3\nf 1 2 3\n", ["x.obj:5:1: warning: malformed line: `1/1/1/1` is not a corner of a face" + FORMS]),
        (SQUARE + "fx 1 2 3\nf 1 2 3\n", ["x.obj:5:1: warning: OBJ has no keyword `fx`: the line is left out"]),
        ("hello\n", ["x.obj: error: this is not an OBJ file: it has neither vertices nor faces"]),
        ("", ["x.obj: error: `x.obj` is empty"]),
        (SQUARE + "l 1 2\n", [
            "x.obj: error: the OBJ file has no faces that can be drawn\n  a face is a line like `f 1 2 3`",
            "x.obj:5:1: warning: `l` is not drawn: lines"]),
        (SQUARE + "f 1 2 3\nf 1 2 9\n\nf 1 0 3\n", [
            "x.obj:6:1: warning: there is no vertex 9 (the file has 4): the face is left out; so is 1 more line"]),
        (SQUARE + "f 1 2 3\nf -5 1 2\n", ["x.obj:6:1: warning: there is no vertex -5 (the file has 4): the face is left out"]),
        (SQUARE + "vt 0 0\nf 1/1 2/2 3/1\n", [
            "x.obj:6:1: warning: there is no texture coordinate 2 (the file has 1): the face is drawn without"]),
        (SQUARE + "v nan 0 0\nf 1 2 3\nf 1 2 5\n", ["x.obj:7:1: warning: vertex 5 of this face is not finite: the face is left out"]),
        (SQUARE + "f 1 2 3\nf 1 2\n", ["x.obj:6:1: warning: a face needs 3 corners or more, this one has 2: it is left out"]),
        (SQUARE + "f 1 2 3\nl 1 2\nl 2 3\np 1\n", [
            "x.obj:6:1: warning: `l` is not drawn: lines; so is 1 more line",
            "x.obj:8:1: warning: `p` is not drawn: points of a file with faces"]),
        (SQUARE + "f 1 2 3\ncurv 0 1 1 2\n", ["x.obj:6:1: warning: `curv` is not drawn: free-form curves and surfaces"]),
        (SQUARE + "f 1 2 3\nf 1 2 2\n", ["x.obj: note: 1 of 2 faces have no area: they are left out"]),
        ("mtllib none.mtl\nusemtl red\n" + SQUARE + "f 1 2 3\n", [
            "x.obj:1:1: warning: the material library `none.mtl` is not read: its mesh has no folder"]),
    ],
)  # fmt: skip
def test_messages(text, expected):
    assert read(text)[2] == expected


def test_line_numbers_count_continued_lines():
    assert read(SQUARE + "f 1 \\\n2 \\\n3\nf 1 2 7\n")[2] == [
        "x.obj:8:1: warning: there is no vertex 7 (the file has 4): the face is left out"
    ]


def test_a_malformed_line_costs_its_own_faces():
    """One bad line never refuses a file: what uses it is left out."""
    scene, parts, messages = read("v 0 0 0\nv 1 0 zero\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n\x1a")
    assert len(parts) == 1
    assert corners(scene).tolist() == [[[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert len(messages) == 1


def test_binary_rubbish_is_one_error():
    _, parts, messages = read(bytes(range(256)) * 50)
    assert parts == []
    assert len(messages) == 1
    assert messages[0].startswith("x.obj")


@pytest.mark.long
def test_a_very_long_line():
    count = 20_000
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    text = "\n".join(f"v {x:.9f} {y:.9f} 0" for x, y in zip(np.cos(turn), np.sin(turn), strict=True))
    scene, _, messages = read(text + "\nf " + " ".join(map(str, range(1, count + 1))) + "\n")
    assert messages == []
    assert len(scene.tables.pools.triangles) == count - 2


def test_numbers_read_at_once_and_one_by_one_are_the_same():
    fast = SQUARE + "vt 0 0\nvn 0 0 1\nf 1/1/1 2//1 3/1 4\nf -1 -2 -3\n"
    slow = fast.replace("\n", " #\n")
    failed = []
    results = []
    for text in (fast, slow):
        lines = obj_lexer.split(text.encode())
        faces = obj_lexer.faces(lines, lambda *a: failed.append(a))
        values, counts = obj_lexer.numbers(lines, 0, 3, lambda *a: failed.append(a))
        results.append((faces.counts.tolist(), faces.corners.tolist(), values.tolist(), counts.tolist()))
    assert failed == []
    assert results[0] == results[1]
    assert results[0][1] == [[1, 1, 1], [2, 0, 1], [3, 1, 0], [4, 0, 0], [-1, 0, 0], [-2, 0, 0], [-3, 0, 0]]


# --- materials ---


def material(text, folder, obj="usemtl m\n", name="m.mtl"):
    """(row of the material as plain values, messages): one triangle with material m of a library."""
    (folder / name).write_text(text)
    scene, parts, messages = read(f"mtllib {name}\n{obj}{SQUARE}f 1 2 3\n", folder)
    m = scene.tables.materials
    row = parts[0].material
    slots = {} if row is None else {slot.name: m.values[row, slot].tolist() for slot in ir.Slot if m.values[row, slot].any()}
    values = {name: value for name, value in slots.items() if (name, value) != ("OPACITY", [1, 0, 0])}
    return None if row is None else ir.MaterialModel(m.model[row]).name, values, messages, scene


def test_plain_diffuse(tmp_path):
    model, values, messages, _ = material("newmtl m\nKd 0.1 0.2 0.3\n", tmp_path)
    assert (model, messages) == ("LAMBERT", [])
    assert values == {"AMBIENT": [0.1, 0.2, 0.3], "DIFFUSE": [0.1, 0.2, 0.3], "IOR": [1, 0, 0]}


def test_highlight(tmp_path):
    model, values, _, _ = material("newmtl m\nKa 0 0 0\nKd 1 0 0\nKs 0.5 0.5 0.5\nNs 80\nillum 2\n", tmp_path)
    assert model == "BLINN_PHONG"
    assert values == {"DIFFUSE": [1, 0, 0], "SPECULAR": [0.5, 0.5, 0.5], "SHININESS": [80, 0, 0], "IOR": [1, 0, 0]}


def test_no_highlight_with_illum_1_or_without_an_exponent(tmp_path):
    assert material("newmtl m\nKd 1 1 1\nKs 1 1 1\nNs 80\nillum 1\n", tmp_path)[0] == "LAMBERT"
    assert material("newmtl m\nKd 1 1 1\nKs 1 1 1\nNs 0\nillum 2\n", tmp_path)[0] == "LAMBERT"


def test_mirror_and_glass(tmp_path):
    model, values, _, _ = material("newmtl m\nKd 0 0 0\nKs 0.9 0.9 0.9\nillum 5\n", tmp_path)
    assert (model, values["REFLECTION"]) == ("MIRROR", [0.9, 0.9, 0.9])
    model, values, _, _ = material("newmtl m\nKd 0 0 0\nTf 0.9 1 0.9\nNi 1.5\nillum 7\n", tmp_path)
    assert (model, values["TRANSMISSION"], values["IOR"]) == ("GLASS", [0.9, 1, 0.9], [1.5, 0, 0])
    model, values, _, _ = material("newmtl m\nKd 0.5 0 0\nKs 0.3 0.3 0.3\nNs 10\nillum 3\n", tmp_path)
    assert (model, values["REFLECTION"], values["SPECULAR"]) == ("BLINN_PHONG", [0.3] * 3, [0.3] * 3)


@pytest.mark.parametrize(
    ("lines", "opacity"),
    [
        ("d 0.25", 0.25),
        ("Tr 0.75", 0.25),
        ("Tr 1", 1),
        ("Tr 0", 1),
        ("d 0.5\nTr 1", 0.5),
        ("Tr 0.9\nd 1", 1),
        ("d 7", 1),
    ],
)
def test_opacity(tmp_path, lines, opacity):
    model, values, messages, _ = material(f"newmtl m\nKd 1 1 1\n{lines}\n", tmp_path)
    assert messages == []
    assert values["DIFFUSE"] == [1] * 3
    assert values.get("OPACITY", [1])[0] == opacity
    assert "TRANSMISSION" not in values
    assert model == "LAMBERT"


def test_highlights_and_emission_of_clear_materials_stay(tmp_path):
    _, values, _, _ = material("newmtl m\nKd 1 1 1\nKs 0.4 0.4 0.4\nNs 50\nKe 2 2 2\nd 0.5\n", tmp_path)
    assert (values["OPACITY"][0], values["DIFFUSE"], values["SPECULAR"], values["EMISSION"]) == (0.5, [1] * 3, [0.8] * 3, [4] * 3)


def test_a_tint_of_light_that_passes(tmp_path):
    """Grey light passes all of it; the rest of its colours is refraction without a bend."""
    model, values, messages, _ = material("newmtl m\nKd 1 1 1\nd 0.5\nTf 1 0.5 0.5\n", tmp_path)
    assert messages == ["m.mtl:1:1: note: the shadow of material `m` is grey: it is as dark as that of the darkest colour of its `Tf`"]
    assert (model, values["OPACITY"][0], values["IOR"][0]) == ("BLINN_PHONG", 0.75, 1)
    assert values["TRANSMISSION"] == pytest.approx([0.25 / 0.75, 0, 0])
    assert values["DIFFUSE"] == pytest.approx([0.5 / 0.75] * 3)


def test_a_tint_that_is_not_drawn_is_told(tmp_path):
    told = "m.mtl:1:1: warning: the `Tf` of material `m` is not drawn beside keys of the PBR extension: light passes white"
    assert material("newmtl m\nKd 1 1 1\nd 0.5\nTf 1 0.5 0.5\nPr 0.5\n", tmp_path)[2] == [told]
    for plain in ("d 0.5\nTf 1 1 1\nPr 0.5", "d 1\nTf 1 0.5 0.5\nPr 0.5", "d 1\nTf 1 0.5 0.5", "d 0.5\nTf 0.5 0.5 0.5"):
        assert material(f"newmtl m\nKd 1 1 1\n{plain}\n", tmp_path)[2] == []


def test_emission(tmp_path):
    assert material("newmtl m\nKe 5 4 3\n", tmp_path)[1]["EMISSION"] == [5, 4, 3]


def picture(path):
    path.parent.mkdir(exist_ok=True)
    write_image(path, np.full((2, 2, 3), 255, np.uint8))


@pytest.mark.parametrize("written", ["a b.png", "tex\\a b.png", "TEX/A B.PNG", "C:\\Users\\me\\a b.png", "./tex/a b.png", '"tex/a b.png"'])
def test_pictures_are_found_as_people_write_them(tmp_path, written):
    picture(tmp_path / "tex" / "a b.png")
    picture(tmp_path / "a b.png")
    _, values, messages, scene = material(f"newmtl m\nmap_Kd {written}\n", tmp_path)
    assert messages == []
    assert values["DIFFUSE"] == [1, 1, 1]
    assert scene.tables.textures.image.tolist() == [0]


def test_map_options(tmp_path):
    picture(tmp_path / "a.png")
    _, values, messages, scene = material("newmtl m\nKd 0 0 0\nmap_Kd -s 2 3 1 -o 0.5 0.25 -clamp on -mm 0.1 0.8 a.png\n", tmp_path)
    t = scene.tables.textures
    assert messages == []
    assert values["DIFFUSE"] == [1, 1, 1]  # black under a picture counts as white
    assert t.frame[0].tolist() == [[2, 0, 0.5], [0, 3, 0.25]]
    assert (t.wrap_u[0], t.wrap_v[0]) == (ir.Wrap.CLAMP, ir.Wrap.CLAMP)
    assert t.gain[0].tolist() == [0.8] * 3
    assert t.bias[0].tolist() == [0.1] * 3


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("newmtl m\nmap_Kd none.png\n", "m.mtl:2:1: warning: there is no picture `none.png`\n  looked in {folder}"),
        ("newmtl m\nKd red\n", "m.mtl:2:1: warning: `Kd` needs three numbers (spectra and CIE XYZ are not read)"),
        ("newmtl m\nKd 1 -0.5 0\n", "m.mtl:2:1: warning: material `m`: `Kd` has a negative component, which counts as 0"),
        ("newmtl m\nNs lots\n", "m.mtl:2:1: warning: `Ns` needs a number"),
        ("newmtl m\ndisp a.png\n", "m.mtl:2:1: warning: `disp` is not drawn"),
        ("newmtl m\nfoo 1\n", "m.mtl:2:1: warning: MTL has no keyword `foo`: the line is left out"),
        ("Kd 1 1 1\nnewmtl m\n", "m.mtl:1:1: warning: `Kd` stands before the first `newmtl`"),
        ("newmtl m\nmap_Kd -s 1 1\n", "m.mtl:2:1: warning: `map_Kd`: no file name follows the option `-s`"),
        ("newmtl m\nmap_Kd -zoom 1 a.png\n", "m.mtl:2:1: warning: `map_Kd`: the option `-zoom` is not known"),
        ("newmtl other\n", "x.obj:2:1: warning: no material library has `m`: its faces have no material"),
    ],
)
def test_library_messages(tmp_path, text, expected):
    assert material(text, tmp_path)[2] == [expected.format(folder=tmp_path)]


def test_mtl_sheen(tmp_path):
    """Ps makes a material principled; without any it stays what it was."""
    model, values, messages, _ = material("newmtl m\nKd 0.5 0.25 0\nPs 0.5\n", tmp_path)
    assert (model, values["SHEEN"], values["SHEEN_ROUGHNESS"], messages) == ("PRINCIPLED", [0.5] * 3, [0.3, 0, 0], [])
    assert material("newmtl m\nKd 0.5 0.25 0\nPs 0\n", tmp_path)[0] == "LAMBERT"


def test_the_pbr_extension(tmp_path):
    """Pr and Pm make it principled; ORM packs occlusion, roughness and metal; a map of bumps that is coloured is one of normals."""
    write_image(tmp_path / "orm.png", np.array([[[255, 128, 0]]], np.uint8))
    write_image(tmp_path / "h.png", np.array([[[9, 9, 9]]], np.uint8))
    model, values, messages, _ = material("newmtl m\nKd 0.5 0.25 0\nPm 0.75\nPr 0.25\nmap_bump -bm 0.02 h.png\n", tmp_path)
    assert (model, messages) == ("PRINCIPLED", [])
    assert [values[name][0] for name in ("METALLIC", "ROUGHNESS", "BUMP")] == [0.75, 0.25, 0.02]
    scene = material("newmtl m\nmap_ORM orm.png\nmap_bump orm.png\n", tmp_path)[3]
    m, t = scene.tables.materials, scene.tables.textures
    rows = [m.textures[0, slot] for slot in (ir.Slot.ROUGHNESS, ir.Slot.METALLIC, ir.Slot.NORMAL)]
    assert t.channel[rows].tolist() == [1, 2, -1]
    assert t.bias[rows[2]].tolist() == [-1, -1, -1]


def test_a_missing_library_is_a_warning(tmp_path):
    _, parts, messages = read(f"mtllib gone.mtl\nusemtl red\n{SQUARE}f 1 2 3\n", tmp_path)
    assert messages == [f"x.obj:1:1: warning: {GONE}\n  looked in {tmp_path}"]
    assert [p.material for p in parts] == [None]


def test_a_library_outside_of_the_folder_is_not_read(tmp_path):
    (tmp_path / "secret.mtl").write_text("newmtl m\n")
    (tmp_path / "in").mkdir()
    _, _, messages = read(f"mtllib ../secret.mtl\nusemtl m\n{SQUARE}f 1 2 3\n", tmp_path / "in")
    assert messages[0].startswith("x.obj:1:1: warning: `../secret.mtl` lies outside of the scene's folder: its materials are not read")


def test_several_libraries_and_names_with_blanks(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl deep red\nKd 1 0 0\n")
    (tmp_path / "b c.mtl").write_text("newmtl green\nKd 0 1 0\n")
    (tmp_path / "d.mtl").write_text("newmtl green\nKd 0 0 1\n")
    text = f"mtllib a.mtl d.mtl\nmtllib b c.mtl\n{SQUARE}usemtl green\nf 1 2 3\nusemtl deep red\nf 1 3 4\nusemtl green\nf 2 3 4\n"
    scene, parts, messages = read(text, tmp_path)
    assert messages == []
    assert [(p.name, scene.tables.geometries.triangle_count[p.geometry]) for p in parts] == [("green", 2), ("deep red", 1)]
    m = scene.tables.materials.values[:, ir.Slot.DIFFUSE]
    assert [m[p.material].tolist() for p in parts] == [[0, 0, 1], [1, 0, 0]]  # the first library that has a name gives it


def test_faces_before_any_usemtl_keep_no_material(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    _, parts, _ = read(f"mtllib a.mtl\n{SQUARE}f 1 2 3\nusemtl red\nf 1 3 4\n", tmp_path)
    assert [(p.name, p.material) for p in parts] == [("x", None), ("red", 0)]


def test_opacity_rule_is_in_the_type():
    assert mtl.MtlMaterial("m", Span("x.mtl"), None, numbers={"Tr": 0.25}).opacity == 0.75


GREEN = "newmtl m\nKd 0 1 0\n"


@pytest.mark.parametrize(
    ("line", "use", "data"),
    [
        ("a.mtl # the library", "m", GREEN.encode()),
        ('"a.mtl"', "m", GREEN.encode()),
        ("a.mtl", "m   # green", GREEN.encode()),
        ("a.mtl", "m", GREEN.replace("m\n", "m # green\n", 1).encode()),
        ("a.mtl", "m", GREEN.encode("utf-16")),
        ("a.mtl", "m", b"\xfe\xff" + GREEN.encode("utf-16-be")),
        ("a.mtl", "m", b"\xef\xbb\xbf" + GREEN.encode() + b"\x1a"),
        ("a.mtl", "m#1", GREEN.replace("m\n", "m#1\n", 1).encode()),
    ],
)
def test_names_with_comments_and_quotes_and_encodings(tmp_path, line, use, data):
    (tmp_path / "a.mtl").write_bytes(data)
    scene, parts, messages = read(f"mtllib {line}\nusemtl {use}\n{SQUARE}f 1 2 3\n", tmp_path)
    assert messages == []
    assert scene.tables.materials.values[parts[0].material, ir.Slot.DIFFUSE].tolist() == [0, 1, 0]


def test_one_missing_library_of_two_is_a_warning(tmp_path):
    (tmp_path / "a b.mtl").write_text(GREEN)
    _, parts, messages = read(f'mtllib "a b.mtl" gone.mtl\nusemtl m\n{SQUARE}f 1 2 3\n', tmp_path)
    assert messages == [f"x.obj:1:1: warning: {GONE}\n  looked in {tmp_path}"]
    assert parts[0].material is not None
