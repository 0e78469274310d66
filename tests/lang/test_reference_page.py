"""The reference page: the lines of entries, and that docs/reference.md is up to date."""

import subprocess
import sys
from pathlib import Path

import maquette
import pytest
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang.eval import builtins
from maquette.lang.reference_page import reference

ROOT = Path(maquette.__file__).parent


def made():
    library = {path.stem: path.read_text(encoding="utf-8") for path in sorted((ROOT / "stdlib").glob("*.scene"))}
    return reference(library)


@pytest.mark.long
def test_the_pages_in_docs_are_up_to_date():
    pages = {f"reference/{path.name}" for path in (ROOT / "docs" / "reference").glob("*.md")} | {"reference.md"}
    assert pages == {*made()}
    for path, text in made().items():
        assert (ROOT / "docs" / path).read_text(encoding="utf-8") == text, "run: make reference"


@pytest.mark.long
def test_the_command_writes_the_pages(tmp_path):
    subprocess.run([sys.executable, "-m", "maquette.lang.reference_page", str(tmp_path)], check=True)
    assert {path: (tmp_path / path).read_text(encoding="utf-8") for path in made()} == made()


def test_every_implemented_element_is_on_one_page():
    pages = made()
    page = "\n".join(pages.values())
    for entry in CATALOGUE.values():
        assert sum(f"\n## {entry.name}\n" in text for text in pages.values()) == (not entry.planned)
        assert (f"`{entry.name}`" in pages["reference.md"]) != entry.planned
        assert not entry.planned or f"`{entry.name}`" in page
    for name in builtins.FUNCTIONS:
        assert f"| `{name}(" in page


@pytest.mark.long
@pytest.mark.parametrize(
    "line",
    [
        "| 1 | `radius` | length > 0 | `1m` | radius |",
        "|  | `cone` | angle > 0, ≤ 180deg | `30deg` | half angle of the cone |",
        '|  | `shape` | `"rectangle"` `"disk"` | `"rectangle"` | its outline |',
        "|  | `illuminance`, `irradiance` | illuminance ≥ 0 | `pi` | lux on a surface that faces it |",
        "|  | `film` | size2 > 0 | `[36mm, 24mm]` | width and height of the film, with `focal` |",
        "| `hypot(a, b, c?)` | √(a² + b² + c²) |",
        "| formula | a formula \\|x, y, z\\| … |",
        "| `clay(color = #b5654a)` | Fired clay. |",
        "| `gold(roughness = 0.1)` | Polished gold. |",
        "**plastic, paint and glaze**",
    ],
)
def test_lines_of_the_page(line):
    assert line in "\n".join(made().values()).splitlines()
