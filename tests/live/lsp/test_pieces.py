"""Pieces of a source: together they are the source, and parse to the same items; an edit keeps the other pieces."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.syntax.parser import parse
from maquette.live.lsp.document import Document
from maquette.live.lsp.pieces import cut, piece

ROOT = Path(__file__).resolve().parents[3]
SCENES = sorted([*ROOT.glob("examples/*.scene"), *ROOT.glob("stdlib/*.scene")])
LINES = st.sampled_from([
    "let a =", "  1 + 2", "let f(x) = group() {", "sphere(1)", "  sphere(x)", "}", "", "// note", "sphere(", "1)", "else { box(1) }",
    "if (1 > 0) { box(2) }", 'text("a // b {")', "param p = 3  // {", "let l = [1,", "2]", "use \"std/room\"", ") }", '"open',
])  # fmt: skip


def shapes(text: str) -> tuple[list[str], bool]:
    """The kinds of the items of a text, and whether it has syntax errors."""
    found = Diagnostics()
    return [type(item).__name__ for item in parse(text, "", found).items], found.failed


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.name)
def test_pieces_of_a_scene_parse_as_the_whole_does(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    parts = [*cut(text)]
    assert "".join(part for _, part in parts) == text
    assert [above for above, _ in parts] == [text[: text.index(part)].count("\n") for _, part in parts]
    assert ([type(item).__name__ for _, part in parts for item in piece(part).file.items], False) == shapes(text)


@pytest.mark.long
@given(st.lists(LINES, max_size=12))
def test_pieces_of_any_text_are_the_text(lines: list[str]) -> None:
    text = "\n".join(lines)
    parts = [*cut(text)]
    assert "".join(part for _, part in parts) == text
    items, failed = shapes(text)
    if not failed:
        assert [type(item).__name__ for _, part in parts for item in piece(part).file.items] == items


def test_an_edit_parses_one_piece() -> None:
    before = Document("a", "let a = 1\nlet b = 2\n\nlet c = 3\n")
    after = Document("a", "let a = 1\nlet b = 22\n\nlet c = 3\n", before)
    same = [old.piece is new.piece for old, new in zip(before.placed, after.placed, strict=True)]
    assert same == [True, False, True]


def test_a_broken_piece_keeps_the_names_of_its_last_good_text() -> None:
    good = Document("a", "let a = 1\nlet f(k) = sphere(k)\nlet c = 3\n")
    broken = Document("a", "let a = 1\nlet f(k) = sphere((k\n\nlet c = 3\n", good)
    again = Document("a", "let a = 1\nlet f(k = sphere((k\n\n\nlet c = 3\n", broken)
    for document in (broken, again):
        assert document.failed
        assert sorted(document.top) == ["a", "c", "f"]
        assert document.top["f"].span.line == 2
        assert "k" in document.visible(2, 20)
    assert [placed.stale for placed in Document("a", good.text, again).placed] == [False, False, False]
