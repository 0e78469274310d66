"""Starts other processes. None of them takes code or settings from the current folder; see import_path.py.

All processes of maquette start here: tests/test_child_processes.py finds others.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import webbrowser
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from . import import_path
from .sandbox import LIBRARY

_PACKAGE = __name__.partition(".")[0]
_BEGIN = """import importlib.util, sys
sys.path[:] = {path!r}
spec = importlib.util.spec_from_file_location({package!r}, {folder!r} + "/__init__.py", submodule_search_locations=[{folder!r}])
sys.modules[{package!r}] = package = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
"""
_changing = threading.Lock()


def python(code: str) -> list[str]:
    """The command of a Python process that runs `code`. It finds this package and its libraries where this process found them."""
    begin = _BEGIN.format(path=import_path.search_path(), package=_PACKAGE, folder=str(LIBRARY.parent))
    return [sys.executable, "-P", "-c", begin + code]


def start(command: Sequence[str], folder: Path = LIBRARY, environment: Mapping[str, str] | None = None, **streams: Any) -> subprocess.Popen:
    """Start a process in `folder`, by default in one of this installation. Raises OSError.

    The environment is that of this process without folders that depend on the current one; `environment` is added. `streams` are those of
    subprocess.Popen.
    """
    variables = _environment(environment)
    return subprocess.Popen(_found(command, variables), cwd=folder, env=variables, **streams)


def run(
    command: Sequence[str], folder: Path = LIBRARY, environment: Mapping[str, str] | None = None, **options: Any
) -> subprocess.CompletedProcess:  # fmt: skip
    """As `start`, and wait for the end. `options` are those of subprocess.run. Raises OSError and subprocess.SubprocessError."""
    variables = _environment(environment)
    return subprocess.run(_found(command, variables), cwd=folder, env=variables, **options)


@contextmanager
def isolated() -> Iterator[None]:
    """In the block, processes that libraries start have the environment of `start`. They begin in the current folder."""
    with _changing:
        after = import_path.environment()
        before = {name: os.environ.get(name) for name in {*os.environ, *after} if os.environ.get(name) != after.get(name)}
        try:
            _set({name: after.get(name) for name in before})
            yield
        finally:
            _set(before)


def browse(url: str) -> None:
    """Open an address in the desktop's browser or viewer."""
    with isolated():
        webbrowser.open(url)


def _set(variables: Mapping[str, str | None]) -> None:
    for name, value in variables.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


def _environment(more: Mapping[str, str] | None) -> dict[str, str]:
    """`python` says where modules are; so nothing that changes where Python looks is handed on."""
    variables = import_path.environment()
    for name in ("PYTHONPATH", "PYTHONSTARTUP", "PYTHONINSPECT"):
        variables.pop(name, None)
    return {**variables, **(more or {})}


def _found(command: Sequence[str], variables: Mapping[str, str]) -> list[str]:
    """The command with the full path of its program. Raises FileNotFoundError."""
    program = shutil.which(command[0], path=variables.get("PATH", os.defpath))
    if program is None:
        raise FileNotFoundError(2, "there is no such program", command[0])
    return [program, *command[1:]]
