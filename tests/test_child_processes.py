"""Every process is started by compiler/io/child_process.py, which isolates it from the current folder."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("lang", "compiler", "shapes", "lights", "render", "live", "measure", "stdlib", "cli")
STARTER = "compiler/io/child_process.py"
FORKS = "cli/process/supervisor.py"  # forks the command itself, which runs no other program
# Calls that start processes, by module. Names of other kinds in these modules, such as subprocess.PIPE, start none.
STARTS = {
    "subprocess": {"Popen", "run", "call", "check_call", "check_output", "getoutput", "getstatusoutput"},
    "os": {
        "system", "popen", "startfile", "fork", "forkpty", "posix_spawn", "posix_spawnp", "execl", "execle", "execlp", "execlpe", "execv",
        "execve", "execvp", "execvpe", "spawnl", "spawnle", "spawnlp", "spawnlpe", "spawnv", "spawnve", "spawnvp", "spawnvpe",
    },
    "asyncio": {"create_subprocess_exec", "create_subprocess_shell"},
    "pty": {"spawn", "fork"},
    "webbrowser": {"open", "open_new", "open_new_tab", "get"},
    "multiprocessing": {"Process", "Pool", "Manager"},
}  # fmt: skip
# Libraries that start processes: each call stands in a block `with child_process.isolated()`.
LIBRARIES = {"ProcessPoolExecutor", "LocalCluster", "ensure_running"}


def calls(tree: ast.AST) -> list[tuple[ast.Call, str, str]]:
    """(call, module or "", name) of all calls."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            target = node.func
            if isinstance(target, ast.Attribute):
                found.append((node, target.value.id if isinstance(target.value, ast.Name) else "", target.attr))
            elif isinstance(target, ast.Name):
                found.append((node, "", target.id))
    return found


def starts(text: str) -> list[str]:
    """The places of a source that start processes by themselves."""
    tree, found = ast.parse(text), []
    isolated = [
        range(node.lineno, (node.end_lineno or 0) + 1)
        for node in ast.walk(tree)
        if isinstance(node, ast.With) and any("child_process.isolated()" in ast.unparse(item.context_expr) for item in node.items)
    ]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in STARTS:
            found += [f"{node.lineno}: from {node.module} import {a.name}" for a in node.names if a.name in STARTS[node.module]]
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.attr in STARTS.get(node.value.id, ()):
            annotation = node.value.id == "subprocess" and node.attr == "Popen"
            if not annotation or any(call.func is node for call, _, _ in calls(tree)):
                found.append(f"{node.lineno}: {node.value.id}.{node.attr}")
    for call, _, name in calls(tree):
        if name in LIBRARIES and not any(call.lineno in lines for lines in isolated):
            found.append(f"{call.lineno}: {name} outside of child_process.isolated()")
    return found


@pytest.mark.long
@pytest.mark.parametrize("package", PACKAGES)
def test_one_file_starts_processes(package: str) -> None:
    files = [*ROOT.glob("*.py"), *(ROOT / package).rglob("*.py")]
    found = {f"{file.relative_to(ROOT).as_posix()}:{place}" for file in files for place in starts(file.read_text(encoding="utf-8"))}
    assert {place for place in found if not place.startswith((STARTER, FORKS)) or "os.exec" in place} == set()


@pytest.mark.parametrize("folder", ["tools", "bench", "cli"])
def test_tools_start_python_without_the_current_folder(folder: str) -> None:
    """`python -c` and `python -m` look for modules in the current folder first, except with -P. Those of tools run in this project."""
    for file in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.List) and node.elts and ast.unparse(node.elts[0]) == "sys.executable":
                words = [ast.unparse(word) for word in node.elts[1:3]]
                assert not {"'-c'", "'-m'"} & set(words[:1]), f"{file.name}:{node.lineno} starts python {' '.join(words)} without -P"


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("import subprocess\nsubprocess.run(['a'])", 1),
        ("import subprocess\nkept: subprocess.Popen[bytes] | None = None", 0),
        ("from subprocess import Popen", 1),
        ("import os\nos.execv('a', [])", 1),
        ("start = __import__('os').path\nimport os\ngo = os.system", 1),
        ("with ProcessPoolExecutor(2) as pool:\n    pass", 1),
        ("with child_process.isolated(), ProcessPoolExecutor(2) as pool:\n    pass", 0),
    ],
)
def test_other_ways_are_found(text: str, count: int) -> None:
    assert len(starts(text)) == count
