"""Mesh files that end early, or hold more than they promise: warnings name the lost facets, rows and bytes."""

import struct

import pytest
from maquette.compiler.importers import off
from maquette.lang.diagnostics import Diagnostic, Diagnostics, Span

from .. import tables
from .test_mesh_files import BOX, OFF, QUALITY, ply, read, stl

TEXT = stl(BOX, True)
AGAIN = "copy or write the file again"
IN_A_FACET = "the STL file ends in the middle of this facet: it is left out"
NO_END = "the STL file ends without `endsolid`: it may be cut off"


def triangles(scene):
    return len(tables.corners(scene.tables))


@pytest.mark.parametrize(
    ("data", "line", "message", "drawn"),
    [
        (TEXT[: TEXT.rindex(b"vertex 0 0 1") + 10], 23, IN_A_FACET, 3),  # in the last number
        (TEXT[: TEXT.rindex(b"vertex 0 0 1")], 23, IN_A_FACET, 3),  # before the third vertex
        (TEXT[: TEXT.rindex(b"vertex 0 0 0") + 8], 23, IN_A_FACET, 3),  # in the first vertex
        (TEXT[: TEXT.rindex(b"facet normal") + 8], 23, IN_A_FACET, 3),
        (TEXT[: TEXT.rindex(b"endloop")], 27, NO_END, 4),  # no facet is lost
        (TEXT[: TEXT.rindex(b"endsolid")], 29, NO_END, 4),
        (TEXT.replace(b"\n", b"\r\n")[: -len(b"endsolid a")], 29, NO_END, 4),
        (TEXT.replace(b"\n", b"\r")[: -len(b"endsolid a")], 29, NO_END, 4),
    ],
)
def test_an_stl_text_that_ends_early(data, line, message, drawn):
    scene, _, messages = read(data, "a.stl")
    assert messages == [f"a.stl:{line}:1: warning: {message}"]
    assert triangles(scene) == drawn


@pytest.mark.long
def test_each_cut_of_an_stl_text_is_told():
    whole = len(b"solid a\n" + TEXT.split(b"endloop")[0])
    for end in range(whole, TEXT.index(b"endsolid") + len(b"endsolid") - 1):
        assert read(TEXT[:end], "a.stl")[2], TEXT[:end][-40:]


def test_a_facet_without_vertices():
    data = TEXT.replace(b"endsolid a", b"facet normal 0 0 1\nouter loop\nendloop\nendfacet\nendsolid a")
    scene, _, messages = read(data, "a.stl")
    assert messages == ["a.stl:30:1: warning: 1 facets of the STL file have no three vertices: they are left out"]
    assert triangles(scene) == 4


@pytest.mark.parametrize(
    ("count", "after", "message", "drawn"),
    [
        (0, b"", "the STL file promises 0 triangles and holds 4: these are drawn", 4),
        (3, b"", "after the 3 triangles that the STL file promises, 48 more bytes are not drawn", 3),
        (4, b"more", "after the 4 triangles that the STL file promises, 4 more bytes are not drawn", 4),
        (2**32 - 1, b"", "the STL file ends early: it promises 4294967295 triangles and holds 4", 4),
    ],
)
def test_a_binary_stl_whose_count_does_not_fit(count, after, message, drawn):
    data = stl(BOX, False)
    scene, _, messages = read(b" " * 80 + struct.pack("<I", count) + data[84:] + after, "a.stl")
    assert messages == [f"a.stl: warning: {message}"]
    assert triangles(scene) == drawn


def test_zeros_after_a_file_are_no_data():
    assert read(stl(BOX, False) + b"\0" * 100, "a.stl")[2] == []
    assert read(ply("binary_little_endian", [[0, 1, 2, 3]]) + b"\0\0\n", "a.ply")[2] == [QUALITY]


@pytest.mark.parametrize(
    ("order", "after", "message"),
    [
        ("ascii", b"3 0 1 2 0.5\n", "after the rows that the PLY header promises, 5 more words are not drawn"),
        ("binary_little_endian", b"more", "after the rows that the PLY header promises, 4 more bytes are not drawn"),
        ("binary_big_endian", b"more", "after the rows that the PLY header promises, 4 more bytes are not drawn"),
    ],
)
def test_a_ply_with_more_than_it_promises(order, after, message):
    assert read(ply(order, [[0, 1, 2, 3]]) + after, "a.ply")[2] == [f"a.ply: warning: {message}", QUALITY]


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_each_cut_of_a_ply_is_told(order):
    data = ply(order, [[0, 1, 2, 3], [0, 1, 3]])
    for end in range(data.index(b"end_header") + 11, len(data) - len(b"0.5\n") - 1):
        assert any("ends in the middle of its" in message for message in read(data[:end], "a.ply")[2]), end


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (OFF + b"3 0 1 3\n", "after the 2 faces that the OFF file promises, 1 more lines are not drawn"),
        (OFF[:-4], "1 of 2 faces are damaged, or use vertices that do not exist or are not finite: they are left out"),
        (
            OFF.replace(b"3 0 1 2", b"3 0 1 2 7"),
            "the colours of 1 of 2 faces are rows of a colour map, which is not read: they are left out",
        ),
    ],
)
def test_an_off_with_more_or_less_than_it_promises(data, message):
    assert read(data, "a.off")[2] == [f"a.off: warning: {message}"]


def test_face_colours_of_an_off_whose_vertices_have_some():
    data = b"COFF\n3 2 0\n0 0 0 1 0 0 1\n1 0 0 1 0 0 1\n0 1 0 1 0 0 1\n3 0 1 2 0 255 0\n3 2 1 0\n"
    message = "the colours of 1 of 2 faces are left out: the vertices of the OFF file have colours, which are drawn"
    found = Diagnostics()
    off.read(data, found, Span("a.off"))
    hint = "to draw those of the faces, write the vertices without colours"
    assert found.items == [Diagnostic("warning", message, Span("a.off"), hint)]


OBJ = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4"


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (OBJ[:-2], "a.obj:6:1: warning: a face needs 3 corners or more, this one has 2: it is left out"),
        (OBJ[:-6], "a.obj:6:1: warning: a face needs 3 corners or more, this one has 0: it is left out"),
        (OBJ + b"\nv", "a.obj:7:1: warning: malformed line: `v` needs 3 numbers or more, got 0"),
        (OBJ + b"\nv 1 2", "a.obj:7:1: warning: malformed line: `v` needs 3 numbers or more, got 2"),
        (OBJ + b"\nvt", "a.obj:7:1: warning: malformed line: `vt` needs 1 numbers or more, got 0"),
        (OBJ + b"\nf 1/1/", "a.obj:7:1: warning: there is no texture coordinate 1 (the file has 0): the face is drawn without"),
        (OBJ + b"\nusem", "a.obj:7:1: warning: OBJ has no keyword `usem`: the line is left out"),
    ],
)
def test_an_obj_whose_last_line_is_cut(data, expected):
    assert expected in read(data, "a.obj")[2]
