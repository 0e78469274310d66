"""Cache keys of kernels: which edits of a module change the key of a kernel that is compiled from it."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import pytest

KERNEL = '''"""Kernels of a test."""

from .constants import HALF  # a constant


def area(r):
    """Docstring."""
    return HALF * r * r
'''
CONSTANTS = '"""Constants of a test."""\n\nHALF = 0.5\n'
OVERLOADS = (
    "from numba.extending import overload\n\nfrom . import kernel\n\n\n@overload(kernel.area)\ndef _area(r):\n    return lambda r: r\n"
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package with a kernel that imports a constant, and an empty cache folder."""
    monkeypatch.setenv("MAQUETTE_CACHE", str(tmp_path / "cache"))
    write(tmp_path, "kernel", KERNEL)
    write(tmp_path, "constants", CONSTANTS)
    write(tmp_path, "other", "OTHER = 1\n")
    return tmp_path


def write(package: Path, module: str, text: str) -> None:
    """Write a module with a modification time of its own."""
    path = package / "render" / f"{module}.py"
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    write.time += 10**9  # pyright: ignore[reportFunctionMemberAccess]
    os.utime(path, ns=(write.time, write.time))  # pyright: ignore[reportFunctionMemberAccess]


write.time = 10**18  # pyright: ignore[reportFunctionMemberAccess]


def key(package: Path, module: str = "render.kernel") -> str:
    """The key as a new process computes it: from a fresh copy of the module."""
    spec = importlib.util.find_spec("maquette.render.jit.cache_key")
    assert spec is not None
    assert spec.loader is not None
    cache_key = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(cache_key)
    vars(cache_key)["ROOT"] = package
    return vars(cache_key)["key"](module)


def test_the_key_is_the_same_in_every_process(package: Path) -> None:
    assert key(package) == key(package) == key(package, "maquette.render.kernel")


@pytest.mark.parametrize(
    ("old", "new"), [("Docstring.", "Another one."), ("Kernels of", "Code of"), ("# a constant", "# one half"), ("HALF * r", "HALF  *  r")]
)
def test_docstrings_comments_and_layout_keep_the_key(package: Path, old: str, new: str) -> None:
    before = key(package)
    write(package, "kernel", KERNEL.replace(old, new))
    assert key(package) == before


def test_code_changes_the_key(package: Path) -> None:
    before = key(package)
    write(package, "kernel", KERNEL.replace("r * r", "r + r"))
    assert key(package) != before


def test_a_constant_of_an_imported_module_changes_the_key(package: Path) -> None:
    before = key(package)
    write(package, "constants", CONSTANTS.replace("0.5", "0.25"))
    changed = key(package)
    assert changed != before
    write(package, "constants", CONSTANTS)
    assert key(package) == before


def test_a_module_that_is_not_imported_keeps_the_key(package: Path) -> None:
    before = key(package)
    write(package, "other", "OTHER = 2\n")
    assert key(package) == before


def test_an_overload_of_a_function_changes_the_key(package: Path) -> None:
    before = key(package)
    write(package, "overloads", OVERLOADS)
    changed = key(package)
    assert changed != before
    write(package, "overloads", OVERLOADS.replace("lambda r: r", "lambda r: 2 * r"))
    assert key(package) not in (before, changed)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"form": 1}', '{"form": 1, "modules": {"render.kernel": ["a"]}}'])
def test_damaged_digests_are_replaced(package: Path, text: str) -> None:
    before = key(package)
    (digests,) = (package / "cache").rglob("sources.json")
    good = digests.read_text(encoding="utf-8")
    digests.write_text(text, encoding="utf-8")
    assert key(package) == before
    assert digests.read_text(encoding="utf-8") == good
