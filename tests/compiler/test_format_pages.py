"""The pages of file formats are those of the readers' tables."""

from pathlib import Path

import pytest
from maquette.compiler import format_pages

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", format_pages.PAGES)
def test_a_page_is_up_to_date(name):
    found = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    assert found == format_pages.page(name), f"run: python -m maquette.compiler.format_pages {name} > docs/{name}.md"


def test_a_page_has_each_row_of_its_tables():
    text = format_pages.page("gltf")
    assert "| not drawn | `KHR_animation_pointer` |" in text or "`KHR_animation_pointer`" in text
    assert text.count("\n## ") == 2
