"""Environment variables with a choice of values, and the page that lists all variables."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from maquette.compiler.io import environment

ROOT = Path(__file__).resolve().parents[3]
SOURCES = ("cli", "compiler", "lang", "live", "measure", "render")


def test_the_first_choice_is_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MAQUETTE_A", raising=False)
    assert environment.read_choice("MAQUETTE_A", ("x", "y")) == "x"
    monkeypatch.setenv("MAQUETTE_A", "")
    assert environment.read_choice("MAQUETTE_A", ("x", "y")) == "x"
    monkeypatch.setenv("MAQUETTE_A", "y")
    assert environment.read_choice("MAQUETTE_A", ("x", "y")) == "y"


def test_other_values_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAQUETTE_A", "z")
    with pytest.raises(environment.SettingError, match=r"^MAQUETTE_A is z; it can be x, y$"):
        environment.read_choice("MAQUETTE_A", ("x", "y"))


@pytest.mark.long
def test_the_page_lists_every_variable() -> None:
    files = [file for folder in SOURCES for file in (ROOT / folder).rglob("*.py")]
    used = {name for file in files for name in re.findall(r"\bMAQUETTE_[A-Z_]+\b", file.read_text("utf-8"))}
    listed = re.findall(r"^\| `(MAQUETTE_[A-Z_]+)`", (ROOT / "docs" / "environment.md").read_text("utf-8"), re.MULTILINE)
    assert set(listed) == used
