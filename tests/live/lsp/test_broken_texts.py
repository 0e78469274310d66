"""Requests on texts that are cut off or damaged: an answer, never an exception."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
from lsprotocol import types
from maquette.live.lsp import completion, edits, navigation
from maquette.live.lsp.places import Places
from maquette.live.lsp.project import Project
from pygls.workspace import PositionCodec

TEXT = (Path(__file__).resolve().parents[3] / "examples" / "chess.scene").read_text(encoding="utf-8")
URI = "file:///nowhere/a.scene"


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(TEXT)), st.integers(0, len(TEXT)), st.sampled_from(["", "(", "}", '"', "😀", "\r\n", "let ", "parts."]))
def test_each_request_has_an_answer(first: int, last: int, put: str) -> None:
    project = Project()
    project.change(URI, TEXT, 1)
    first, last = min(first, last), max(first, last)
    document = project.change(URI, TEXT[:first] + put + TEXT[last:], 2)
    places = Places(project, PositionCodec())
    row = TEXT[:first].count("\n")
    for at in (types.Position(row, first - TEXT.rfind("\n", 0, first) - 1), types.Position(row, 0), types.Position(row + 1, 400)):
        completion.complete(places, document, at)
        navigation.hover(places, document, at, {})
        navigation.signature_help(places, document, at)
        navigation.definition(places, document, at)
        navigation.references(places, document, at, True)
        navigation.highlights(places, document, at)
    for symbol in navigation.symbols(places, document):
        assert symbol.range.start.line <= symbol.selection_range.start.line <= symbol.range.end.line < len(document.lines)
    edits.swatches(places, document)
    edits.formatted(places, document)
