"""The pages: every command parses, every cited file and function exists, and pages with a limit keep it."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path

import click
import pytest
from maquette.cli.main import COMMANDS, cli

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    *ROOT.glob("*.md"), *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "reference").glob("*.md")),
    ROOT / "examples" / "README.md",
]  # fmt: skip
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
IN_BLOCKS = re.compile(r"^(?:\.venv/bin/)?((?:maquette|make) .+)$", re.MULTILINE)
IN_PROSE = re.compile(r"`((?:maquette|make) [^`\n]+)`")
CITED = re.compile(r"`((?:bench|cli|compiler|docs|examples|lang|live|measure|render|stdlib|tests)/[\w./-]*)`")
LINK = re.compile(r"\]\(([\w./-]+)(?:#[\w-]*)?\)")
CALL = re.compile(r"\[`(\w+)`\]\(([\w./-]+\.py)\)")
MAX_LINES = {"docs/architecture.md": 200, "CHANGELOG.md": 120}
FILE = re.compile(r"[\w./*-]+\.(?:scene|usda|usdz|mtlx|glb|gltf|obj|stl|npz|png|exr|json)$")


def commands() -> list[tuple[str, str]]:
    """(page, command line): in blocks of shell commands, and between backticks."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        lines = [line for block in FENCED.findall(text) for line in IN_BLOCKS.findall(block)] + IN_PROSE.findall(FENCED.sub("", text))
        for line in lines:
            if "…" not in line and not re.search(r" [A-Z]+\b", line.split("#")[0]):  # A, B and SCENE stand for what is the reader's
                found.append((page.relative_to(ROOT).as_posix(), re.split(r"\s{2,}#|\s+# |\s+>", line)[0].strip()))
    return list(dict.fromkeys(found))


def test_there_are_commands():
    found = commands()
    assert len(found) >= 60
    assert {words.split()[1] for _, words in found if words.startswith("maquette")} >= set(COMMANDS) - {"watch", "lsp"}


@pytest.mark.parametrize(("page", "line"), commands(), ids=lambda text: text[:60])
def test_a_command_of_the_pages_is_one(page, line, tmp_path, monkeypatch):
    program, *words = shlex.split(line)
    if program == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
        asked = [word for word in words if re.fullmatch("[a-z][a-z-]*", word)]
        assert [word for word in asked if word not in targets and not word.startswith("bench-")] == [], page
        return
    for word in words:
        if FILE.match(word):
            if word.startswith(("examples/", "bench/")):
                assert "*" in word or (ROOT / word).exists(), f"{page}: {word}"
            file = tmp_path / word.replace("*", "a")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch()
    monkeypatch.chdir(tmp_path)
    context = click.Context(cli, info_name="maquette")
    if words[0].startswith("-"):
        return
    command = cli.get_command(context, words[0])
    assert command is not None, f"{page}: {line}"
    if len(words) > 1:
        command.make_context(words[0], [word for word in words[1:] if word != "<"], parent=context)


@pytest.mark.parametrize(
    "page", [*PAGES, *sorted((ROOT / "docs" / "design").glob("*.md"))], ids=lambda page: page.relative_to(ROOT).as_posix()
)
def test_cited_files_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    prose = FENCED.sub("", text)
    missing = [path for path in CITED.findall(prose) if not (ROOT / path).exists()]
    missing += [link for link in LINK.findall(prose) if not (page.parent / link).exists()]
    assert missing == []


def test_calls_of_the_architecture_page_exist() -> None:
    """A function in a link is defined in the linked file."""
    page = ROOT / "docs" / "architecture.md"
    for name, link in CALL.findall(page.read_text(encoding="utf-8")):
        tree = ast.parse((page.parent / link).read_text(encoding="utf-8"))
        assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, f"{link} defines no {name}"


def test_worked_examples_name_files_and_definitions_that_exist() -> None:
    """Comments of the architecture page's examples: `# FILE, in NAME …`, or `# FILE, a new file`."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    found = re.findall(r"^# (\w+/[\w/]+\.py)(?:, (.*))?$", page, re.MULTILINE)
    assert len(found) >= 12
    for file, rest in found:
        path = ROOT / file
        assert path.exists() != (rest == "a new file"), file
        for name in re.findall(r"^in (\w+)", rest):
            assert re.search(rf"\b{name}\b", path.read_text(encoding="utf-8")), f"{file} has no {name}"


def test_design_pages_are_listed() -> None:
    folder = ROOT / "docs" / "design"
    listed = set(LINK.findall((folder / "README.md").read_text(encoding="utf-8")))
    assert {path.name for path in folder.glob("*.md")} - {"README.md"} <= listed


@pytest.mark.parametrize(("page", "most"), MAX_LINES.items())
def test_a_page_is_short(page: str, most: int) -> None:
    assert len((ROOT / page).read_text(encoding="utf-8").splitlines()) <= most


def test_packages_name_a_file_to_begin_with() -> None:
    """The file after `Begin with` in the docstring of a package exists."""
    missing = []
    for package in ROOT.rglob("__init__.py"):
        if ".venv" not in package.parts:
            found = re.search(r"^Begin with `([\w./]+)`", package.read_text(encoding="utf-8"), re.MULTILINE)
            if found and not (package.parent / found[1]).exists():
                missing.append(package.relative_to(ROOT).as_posix())
    assert missing == []
