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


def test_the_page_in_docs_is_up_to_date():
    page = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    assert page == made(), "run: python -m maquette.lang.reference_page > docs/reference.md"


def test_the_command_prints_the_page():
    command = [sys.executable, "-m", "maquette.lang.reference_page"]
    printed = subprocess.run(command, capture_output=True, check=True, encoding="utf-8").stdout
    assert printed == made()


def test_every_implemented_element_is_on_the_page():
    page = made()
    for entry in CATALOGUE.values():
        assert (f"\n### {entry.name}\n" in page) != entry.planned
        assert not entry.planned or f"`{entry.name}`" in page
    for name in builtins.FUNCTIONS:
        assert f"| `{name}(" in page


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
    assert line in made().splitlines()
