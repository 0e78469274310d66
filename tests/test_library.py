"""The page of the library is up to date and has its pictures, and each of its entries is drawn."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.stdlib_page import entries, library, page

DOCS = Path(maquette.__file__).parent / "docs"
FILES = library()
ENTRIES = {file: entries(file, text) for file, text in FILES.items()}


@pytest.mark.long
def test_the_page_is_up_to_date() -> None:
    assert (DOCS / "library.md").read_text(encoding="utf-8") == page(FILES), "run: make library"


@pytest.mark.long
def test_the_command_prints_the_page() -> None:
    command = [sys.executable, "-m", "maquette.lang.stdlib_page"]
    assert subprocess.run(command, capture_output=True, check=True, encoding="utf-8").stdout == page(FILES)


@pytest.mark.long
@pytest.mark.parametrize("file", FILES)
def test_a_file_has_its_sheet_of_pictures(file: str) -> None:
    assert (DOCS / "library" / f"{file}.jpg").read_bytes()[:2] == b"\xff\xd8"
    assert f"(library/{file}.jpg)" in page(FILES)


def test_entries_have_a_line_of_docs_and_names_of_their_own() -> None:
    for file, found in ENTRIES.items():
        assert [entry.name for entry in found if not entry.doc.endswith(".")] == [], file
        assert len({entry.name for entry in found}) == len(found), file


def test_the_library_is_as_large_as_the_pages_say() -> None:
    assert len(ENTRIES["materials"]) >= 75
    assert sum(map(len, ENTRIES.values())) >= 195


def test_materials_with_measured_values_name_their_source() -> None:
    sources = ("[PB]", "[MERL]", "[RII]", " by ", "Schott")
    measured = [entry for entry in ENTRIES["materials"] if any(source in entry.doc for source in sources) and "by eye" not in entry.doc]
    assert len(measured) >= 50


@pytest.mark.long
@pytest.mark.parametrize("file", FILES)
def test_each_entry_is_drawn(file: str) -> None:
    """Small and coarse, by the backend that compiles nothing: no warning, all numbers finite, something seen and lit."""
    for entry in ENTRIES[file]:
        found = Diagnostics()
        scene = maquette.load_text(entry.scene, diagnostics=found)
        assert [d.message for d in found.items] == [], entry.example
        image = maquette.render(scene, size=(24, 20), samples=1, bounces=0, backend="reference")
        rgba = np.asarray(image)
        assert np.isfinite(rgba).all(), entry.example
        assert (rgba[..., 3] > 0).mean() > 0.02, entry.example
        assert rgba[..., :3].mean() > 1e-4, entry.example
        assert image.metadata["issues"] == 0, entry.example
