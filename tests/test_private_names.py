"""Tests touch public names alone: a name with a leading underscore may change without a change of behaviour."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent
# Names with a leading underscore that tests may use: public ones, and where they are documented; one of a library, and why.
ALLOWED = {
    "_asdict": "collections.namedtuple",
    "_exit": "os",
    "_fields": "collections.namedtuple",
    "_make": "collections.namedtuple",
    "_replace": "collections.namedtuple",
    "_handle_custom_msg": "ipywidgets: messages of the page arrive by it",
    "_repr_mimebundle_": "notebooks show an object by it",
    "_repr_png_": "notebooks show an object by it",
    "_tm_features": "Numba: no other name has the features of its target machine",
}
BY_NAME = {"setattr", "getattr", "hasattr", "delattr", "attrgetter", "patch", "object"}  # functions that take a name as text


def is_private(name: str) -> bool:
    last = name.rpartition(".")[2]
    return last.isidentifier() and last.startswith("_") and not last.startswith("__") and last != "_" and last not in ALLOWED


def private_names(text: str) -> list[str]:
    """`line: name` of each private name of another object that a program uses: attributes, imports, and names in strings."""
    found: set[tuple[int, str]] = set()
    for node in ast.walk(ast.parse(text)):
        names: list[object] = []
        if isinstance(node, ast.Attribute) and not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
            names = [node.attr]
        elif isinstance(node, ast.ImportFrom):
            names = [*(alias.name for alias in node.names), *(node.module or "").split(".")]
        elif isinstance(node, ast.Import):
            names = [part for alias in node.names for part in alias.name.split(".")]
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in BY_NAME:
            names = [each.value for each in node.args if isinstance(each, ast.Constant)]
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):  # a program for another process
            names = re.findall(r"[\w)\]]\.(_\w+)", node.value)
        found |= {(getattr(node, "lineno", 0), name.rpartition(".")[2]) for name in names if isinstance(name, str) and is_private(name)}
    return [f"{line}: {name}" for line, name in sorted(found)]


@pytest.mark.parametrize("text", [
    "arena._blocks", "from maquette.render import _blocks", "from maquette._blocks import one", "import maquette._blocks",
    'monkeypatch.setattr(arena, "_blocks", [])', 'monkeypatch.setattr("maquette.render.arena._blocks", [])', 'getattr(arena, "_blocks")',
    'run("""print(len(arena._blocks))""")', "arena.find()._blocks", "arena[0]._blocks",
])  # fmt: skip
def test_uses_of_private_names_are_found(text: str) -> None:
    assert len(private_names(text)) == 1
    assert private_names(text)[0].endswith("_blocks")


@pytest.mark.parametrize("text", [
    "self._blocks", "_blocks = 1", "tables._replace(a=1)", "[_ for _ in range(3)]", "arena.__name__", 'name.replace("_", "-")',
    'getattr(arena, "__doc__")', "os._exit(0)",
])  # fmt: skip
def test_other_names_are_allowed(text: str) -> None:
    assert not private_names(text)


@pytest.mark.long
def test_tests_use_public_names() -> None:
    found = [f"{path.relative_to(ROOT)}:{name}" for path in sorted(ROOT.rglob("*.py")) if path != Path(__file__).resolve()
             for name in private_names(path.read_text(encoding="utf-8"))]  # fmt: skip
    assert not found, "\n".join(found)
