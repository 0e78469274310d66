"""Text: areas and advances as fontTools reads them from the file, holes, kerning, lines, alignment, solids, and messages."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from fontTools.pens.areaPen import AreaPen
from fontTools.pens.boundsPen import BoundsPen
from fontTools.ttLib import TTFont
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler.importers import fonts
from maquette.compiler.io.sandbox import LIBRARY
from maquette.compiler.mesh import mesh_csg, polygon_mesh, profiles, swept

from ..mesh.test_mesh_csg import triangles
from .test_formulas import refused

REST = "\ncamera([0, 1, 5])\nsun()\n"
SANS = LIBRARY / "fonts" / "DejaVuSans.ttf"


@pytest.fixture(scope="module")
def reader() -> TTFont:
    return TTFont(SANS)


def bounds(text: str, **layout: object) -> np.ndarray:
    loops, _ = fonts.Font(SANS).outlines(text, fonts.Layout(**layout))  # type: ignore[arg-type]
    flat = np.concatenate(loops)
    return np.stack([flat.min(axis=0), flat.max(axis=0)])


@pytest.mark.parametrize("letter", list("HOo8gQ&@") + ["Ä", "ß", "é"])
def test_a_letter_has_its_area_and_bounds(reader, letter):
    """The capital height of DejaVu Sans is 1493 units, that of its H."""
    glyphs = reader.getGlyphSet()
    name = (reader.getBestCmap() or {})[ord(letter)]
    area, box = AreaPen(glyphs), BoundsPen(glyphs)
    glyphs[name].draw(area)
    glyphs[name].draw(box)
    loops, missing = fonts.Font(SANS).outlines(letter, fonts.Layout())
    assert missing == ""
    assert sum(map(profiles.signed_area, loops)) == pytest.approx(abs(area.value) / 1493**2, rel=2e-3)
    assert bounds(letter).ravel() == pytest.approx(np.array(box.bounds) / 1493, abs=1e-3)


@pytest.mark.parametrize(("text", "outer", "holes"), [("o", 1, 1), ("8", 1, 2), ("i", 2, 0), ("B%", 4, 4), ("\u03bb", 1, 0)])
def test_holes(text, outer, holes):
    areas = [profiles.signed_area(loop) for loop in fonts.Font(SANS).outlines(text, fonts.Layout())[0]]
    assert (sum(a > 0 for a in areas), sum(a < 0 for a in areas)) == (outer, holes)


def kerning(reader: TTFont, first: str, second: str) -> int:
    """The kerning of two letters, by the font's table `kern`."""
    names = reader.getBestCmap() or {}
    pair = names[ord(first)], names[ord(second)]
    return sum(table.kernTable.get(pair, 0) for table in reader["kern"].kernTables)


def width(text: str) -> float:
    """The advance: how far `align: "right"` moves a text."""
    return float(bounds(text, align="left")[0, 0] - bounds(text, align="right")[0, 0])


@pytest.mark.parametrize("pair", ["AV", "To", "HH", "Yo"])
def test_pairs_are_kerned(reader, pair):
    advances = [reader["hmtx"][(reader.getBestCmap() or {})[ord(letter)]][0] for letter in pair]
    expected = sum(advances) + kerning(reader, *pair)
    assert width(pair) * 1493 == pytest.approx(expected, abs=1)
    assert (kerning(reader, *pair) < 0) == (pair != "HH")


def test_alignment():
    left, center, right = (bounds("Ho", align=align) for align in ("left", "center", "right"))
    assert left[:, 0] - center[:, 0] == pytest.approx(0.5 * width("Ho"))
    assert center[:, 0] - right[:, 0] == pytest.approx(0.5 * width("Ho"))
    assert bounds("H", vertical="top")[1, 1] == pytest.approx(0)
    assert bounds("H", vertical="center").mean(axis=0)[1] == pytest.approx(0)
    assert bounds("H\nH", vertical="bottom")[0, 1] == pytest.approx(0)
    assert bounds("H\nH", vertical="center").mean(axis=0)[1] == pytest.approx(0)


def test_lines_and_spacing():
    """The distance of lines is ascender − descender + gap of the font: 1901 + 483 units."""
    assert bounds("H\nH")[0, 1] == pytest.approx(-2384 / 1493)
    assert bounds("H\nH", line_spacing=1.5)[0, 1] == pytest.approx(-1.5 * 2384 / 1493)
    plain, wide = bounds("HH"), bounds("HH", spacing=1.5)
    assert wide[1, 0] - plain[1, 0] == pytest.approx(0.5 * width("H"))
    assert bounds("H\r\nH") == pytest.approx(bounds("H\nH"))
    assert width("\tH") == pytest.approx(width("    H"))


@pytest.mark.parametrize("argument", ["spacing", "line_spacing"])
def test_letters_lie_at_most_a_thousand_times_as_far_apart(tmp_path, argument):
    messages = refused(tmp_path, f'text("ab", {argument}: 1e15)' + REST)
    assert any(argument in message and "1000" in message for message in messages), messages


@pytest.mark.parametrize("font", fonts.SHIPPED)
def test_every_font_of_the_package(compiled, font):
    positions, faces = triangles(compiled(f'text("Hamburg & 8%", size: 2, depth: 0.5, font: "{font.upper()}")' + REST))
    made = trimesh.Trimesh(positions, faces, process=False)
    assert made.is_watertight
    assert made.volume > 0
    assert (made.bounds[0, 2], made.bounds[1, 2]) == (0, 0.5)
    assert 2.0 <= made.bounds[1, 1] <= 2.4


def test_volume_and_default_depth(compiled):
    loops, _ = fonts.Font(SANS).outlines("Ro", fonts.Layout())
    made = trimesh.Trimesh(*triangles(compiled('text("Ro", 10cm)' + REST)), process=False)
    assert made.bounds[1, 2] == pytest.approx(0.02)
    assert made.volume == pytest.approx(sum(map(profiles.signed_area, loops)) * 0.1**2 * 0.02, rel=1e-5)


def test_a_flat_text_faces_the_reader(compiled):
    scene = compiled('text("Ro", depth: 0)' + REST)
    made = trimesh.Trimesh(*triangles(scene), process=False)
    assert made.bounds[:, 2].tolist() == [0, 0]
    assert made.face_normals[:, 2].min() == pytest.approx(1)


def test_letters_are_cut_out_of_a_plate(compiled):
    scene = compiled('difference { box([3, 2, 0.2]); text("8o", depth: 1, align: "center", vertical: "center") }' + REST)
    made = trimesh.Trimesh(*triangles(scene), process=False)
    area = sum(map(profiles.signed_area, fonts.Font(SANS).outlines("8o", fonts.Layout())[0]))
    assert made.is_watertight
    assert made.volume == pytest.approx(3 * 2 * 0.2 - area * 0.1, rel=1e-4)


def test_a_font_of_a_file(compiled, tmp_path):
    (tmp_path / "own.ttf").write_bytes((LIBRARY / "fonts" / "DejaVuSerif.ttf").read_bytes())
    scene = compiled('text("a", font: "own.ttf")\ntext("a", font: "DejaVu Serif")' + REST)
    assert scene.tables.instances.geometry.tolist() == [0, 0]
    assert str(tmp_path / "own.ttf") in scene.files


@pytest.mark.long
@settings(deadline=None, max_examples=60)
@given(st.text(st.characters(codec="utf-8"), max_size=8), st.sampled_from(sorted(fonts.SHIPPED.values())))
def test_any_text_is_closed(text, file):
    """Whatever the characters: known, unknown, combining, from right to left, control."""
    loops, missing = fonts.Font(LIBRARY / "fonts" / file).outlines(text, fonts.Layout(align="center"))
    assert set(missing) <= set(text)
    if loops:
        data, _ = polygon_mesh.assemble(swept.extrude(loops, swept.Sweep(0.0, 0.2)))
        made = trimesh.Trimesh(data.positions, data.triangles, process=False)
        assert made.is_watertight
        assert made.volume == pytest.approx(0.2 * sum(map(profiles.signed_area, loops)), rel=1e-6)


LISTED = '"DejaVu Sans", "DejaVu Sans Bold", "DejaVu Serif", "DejaVu Sans Mono"'


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ('text("a", font: "Arial")', "error: there is no font `Arial`", f'write {LISTED}, or the name of a file: font: "fonts/name.ttf"'),
        ('text("a", font: "DejaVu Sand")', "error: there is no font `DejaVu Sand`", "did you mean `DejaVu Sans`?"),
        ('text("a", font: "b.ttf")', "error: there is no font `b.ttf`", "did you mean `bad.ttf`?"),
        ('text("a", font: "bad.ttf")', "error: `bad.ttf` is not a font", "write the name of a TrueType or OpenType file"),
        ('text("a字あ字")', "warning: the font `DejaVu Sans` has no glyph for `字` (U+5B57), `あ` (U+3042)",
         "take another font, or leave them out"),
        ('text(" ")', "warning: this text has no visible letter: nothing is drawn", ""),
        ('text("")', "warning: this text has no visible letter: nothing is drawn", ""),
    ],
)  # fmt: skip
def test_messages(said, tmp_path, text, message, hint):
    (tmp_path / "bad.ttf").write_bytes(b"no font")
    found = said(text + REST + "sphere(1)").splitlines()
    assert found[0] == f"a.scene:1:1: {message}"
    assert found[2].endswith(f"^ {hint}" if hint else "^")
    assert len(found) == 3


def test_a_number_is_no_text(said):
    assert said("text(5)" + REST).splitlines()[0] == "a.scene:1:6: error: expected string, got the bare number 5"


@pytest.mark.long
def test_long_texts_are_cut_into_letters(monkeypatch):
    """Letters apart have the outlines and the volume that all of them at once have."""
    text = "\n".join(["The quick brown fox", "jumps % over ß & @", "8 lazy dögs. " * 3] * 2)

    def solid() -> trimesh.Trimesh:
        loops, _ = fonts.Font(SANS).outlines(text, fonts.Layout())
        made, _ = polygon_mesh.assemble(swept.extrude(loops, swept.Sweep(0.0, 0.5)))
        return trimesh.Trimesh(made.positions, made.triangles)

    parts = solid()
    monkeypatch.setattr(mesh_csg, "FEW_LOOPS", 10**6)
    whole = solid()
    assert parts.is_watertight
    assert len(parts.faces) == len(whole.faces)
    assert parts.volume == pytest.approx(whole.volume, rel=1e-12)
    assert parts.area == pytest.approx(whole.area, rel=1e-12)


def test_a_text_has_a_limit(tmp_path):
    messages = refused(tmp_path, f'text("{"a" * 50_001}")' + REST)
    assert messages[0] == "a text of 50,001 characters is too long: 50,000 at most (write several texts)"
