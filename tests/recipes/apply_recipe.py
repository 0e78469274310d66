"""Applies a recipe of docs/architecture.md to a copy of the package.

A recipe is a text of blocks. A block begins with `# FILE, a new file`, `# FILE, in NAME`, `# FILE, in NAME before `TEXT`` or
`# FILE, before `TEXT``. Its lines are the new file, or stand at the end of the table NAME, or before the first line that contains TEXT,
inside of the definition NAME or anywhere.
"""

from __future__ import annotations

import ast
import re
import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = sorted({path.parent.name for path in ROOT.glob("*/__init__.py")} - {"bench"})
HEAD = re.compile(r"^# (?P<file>[\w/]+\.py), (?:(?P<new>a new file)|(?:in (?P<name>\w+) ?)?(?:before `(?P<text>[^`]+)`)?)$")
RECIPES = sorted(path for path in Path(__file__).parent.glob("*.recipe"))


def blocks(text: str) -> list[tuple[re.Match[str], list[str]]]:
    """The head and the lines of each block."""
    sections: list[tuple[re.Match[str], list[str]]] = []
    for line in text.splitlines():
        if head := HEAD.match(line):
            sections.append((head, []))
        elif not sections:
            raise ValueError(f"a recipe begins with `# FILE, …`, not with: {line}")
        else:
            sections[-1][1].append(line)
    return sections


def copy_package(folder: Path) -> Path:
    """A copy of the package in folder / "maquette", with its compiled modules."""
    package = folder / "maquette"
    for name in FOLDERS:
        shutil.copytree(ROOT / name, package / name)
    for path in (*ROOT.glob("*.py"), ROOT / "py.typed"):
        shutil.copy2(path, package / path.name)
    return package


def apply(recipe: Path, package: Path) -> list[str]:
    """Change the package as the recipe says; the names of the files it changes. Raises LookupError for a place that does not exist."""
    changed = []
    for head, lines in blocks(recipe.read_text(encoding="utf-8")):
        path = package / head["file"]
        changed.append(head["file"])
        if head["new"]:
            assert not path.exists(), f"{head['file']} exists"
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
            continue
        text = path.read_text(encoding="utf-8").splitlines()
        at = _place(text, head["name"], head["text"], head["file"])
        path.write_text("\n".join([*text[:at], *lines, *text[at:]]) + "\n", encoding="utf-8")
    return changed


def _place(text: list[str], name: str | None, before: str | None, file: str) -> int:
    """The number of the line before which a block goes."""
    first, last = 0, len(text)
    if name:
        node = next((node for node in ast.walk(ast.parse("\n".join(text))) if name in _names(node)), None)
        if not isinstance(node, ast.stmt) or node.end_lineno is None:
            raise LookupError(f"{file} has no {name}")
        first, last = node.lineno - 1, node.end_lineno
        if before is None:
            return last - 1  # the bracket that ends a table
    for k in range(first, last):
        if before is not None and before in text[k]:
            return k
    raise LookupError(f"{file}: no line has {before}")


def _names(node: ast.AST) -> list[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return [target.id for target in targets if isinstance(target, ast.Name)]
    return []
