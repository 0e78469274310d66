"""Cache keys of kernels: which edits of a module change the key of a kernel that is compiled from it."""

from __future__ import annotations

import ast
import os
import time
from pathlib import Path

import pytest
from maquette.render.jit import cache_key
from maquette.render.jit.package_sources import PACKAGES, Sources

ROOT = Path(__file__).resolve().parents[3]
KERNEL = '''"""Kernels of a test."""

from . import constants, other  # modules
from .constants import HALF  # a constant


@kernel
def area(r: Lane) -> Lane:
    """Docstring."""
    return HALF * r * r


@kernel
def volume(r):
    UNUSED = [FACTOR for FACTOR in r]
    return _height(r) * area(r) * constants.FACTOR


def _height(r):
    return r


@overload(_height)
def _in_kernels(r):
    return lambda r: r


def check(r):
    other.check(r)
'''
CONSTANTS = '"""Constants of a test."""\n\nHALF = 0.5\nFACTOR = 2\nUNUSED = 1\n\n\ndef unused():\n    return FACTOR\n'


class Package:
    """A package of few modules; its files have times of their own."""

    def __init__(self, root: Path) -> None:
        self.root, self.time = root, 10**18

    def write(self, module: str, text: str) -> None:
        path = self.root / "render" / f"{module}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        self.time += 10**9
        os.utime(path, ns=(self.time, self.time))

    def key(self, name: str = "area", module: str = "render.kernel") -> str:
        """The key as a new process computes it."""
        return cache_key.Keys(Sources(self.root, self.root / "shipped.json")).key(module, name)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Package:
    """A package with kernels that import a constant, and an empty cache folder."""
    monkeypatch.setenv("MAQUETTE_CACHE", str(tmp_path / "cache"))
    package_ = Package(tmp_path)
    package_.write("kernel", KERNEL)
    package_.write("constants", CONSTANTS)
    package_.write("other", "OTHER = 1\n\n\ndef check(r):\n    return r\n")
    return package_


def test_the_key_is_the_same_in_every_process(package: Package) -> None:
    assert package.key() == package.key() == package.key("area", "maquette.render.kernel") == package.key("area.<locals>.inner")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("Docstring.", "Another one."), ("Kernels of", "Code of"), ("# a constant", "# one half"), ("HALF * r", "HALF  *  r"),
        ("r: Lane", "r: float"), (" -> Lane", ""), ("_height(r) * area", "_height(r) + area"), ("other.check(r)", "other.check(2)"),
        ("lambda r: r", "lambda r: 2 * r"),
    ],
)  # fmt: skip
def test_docstrings_layout_annotations_and_other_definitions_keep_the_key(package: Package, old: str, new: str) -> None:
    before = package.key()
    assert old in KERNEL
    package.write("kernel", KERNEL.replace(old, new))
    assert package.key() == before


@pytest.mark.parametrize(
    ("name", "module", "old", "new"),
    [
        ("area", "kernel", "r * r", "r + r"),
        ("area", "constants", "HALF = 0.5", "HALF = 0.25"),
        ("area", "constants", "UNUSED = 1", "HALF += 1"),
        ("area", "constants", "UNUSED = 1", "globals().update(HALF=2)"),
        ("area", "constants", "UNUSED = 1", "for k in range(3):\n    HALF = k"),
        ("volume", "kernel", "r * r", "r + r"),
        ("volume", "kernel", "def _height(r):\n    return r", "def _height(r):\n    return 2 * r"),
        ("volume", "kernel", "lambda r: r", "lambda r: 2 * r"),
        ("volume", "constants", "FACTOR = 2", "FACTOR = 3"),
    ],
)
def test_an_edit_of_what_a_kernel_is_compiled_from_changes_the_key(package: Package, name: str, module: str, old: str, new: str) -> None:
    text, before = {"kernel": KERNEL, "constants": CONSTANTS}[module], package.key(name)
    assert old in text
    package.write(module, text.replace(old, new))
    changed = package.key(name)
    assert changed != before
    package.write(module, text)
    assert package.key(name) == before


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [("constants", "UNUSED = 1", "UNUSED = 2"), ("constants", "return FACTOR", "return 2 * FACTOR"), ("other", "OTHER = 1", "OTHER = 2")],
)
def test_an_edit_of_a_name_that_a_kernel_does_not_refer_to_keeps_the_key(package: Package, module: str, old: str, new: str) -> None:
    before = package.key("volume")
    file = package.root / "render" / f"{module}.py"
    assert old in file.read_text()
    package.write(module, file.read_text().replace(old, new))
    assert package.key("volume") == before


def test_a_module_that_is_read_as_a_value_counts_whole(package: Package) -> None:
    package.write("kernel", KERNEL.replace("HALF * r * r", "getattr(constants, name) * r"))
    before = package.key()
    package.write("constants", CONSTANTS.replace("UNUSED = 1", "UNUSED = 2"))
    assert package.key() != before


def test_a_kernel_outside_of_the_package_depends_on_its_imports(package: Package, tmp_path: Path) -> None:
    def key() -> str:
        return cache_key.Keys(Sources(package.root, package.root / "shipped.json")).key_of_file(tmp_path / "tests" / "test_area.py")

    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_area.py").write_text("from maquette.render.kernel import area\n\nfrom . import tables\n")
    (tmp_path / "tests" / "tables.py").write_text("TABLE = 1\n")
    before = key()
    package.write("other", "OTHER = 2\n")
    assert key() == before
    package.write("constants", CONSTANTS.replace("0.5", "0.25"))
    changed = key()
    (tmp_path / "tests" / "tables.py").write_text("TABLE = 2\n")
    assert len({before, changed, key()}) == 3


@pytest.mark.parametrize("text", ["", "{", "[]", '{"form": 2, "rows": {}}', "0123456789abcdef\n{}"])
@pytest.mark.parametrize("file", ["definitions.json", "keys.json"])
def test_damaged_files_are_replaced(package: Package, monkeypatch: pytest.MonkeyPatch, file: str, text: str) -> None:
    later = time.time_ns() + 10**10
    monkeypatch.setattr(time, "time_ns", lambda: later)  # keys are kept once the files of the package are some seconds old
    before = package.key()
    stored = package.root / "cache" / file
    good = stored.read_text(encoding="utf-8")
    stored.write_text(text, encoding="utf-8")
    assert package.key() == before
    if file == "keys.json":
        assert stored.read_text(encoding="utf-8") == good
    for place in (0, len(good) // 2, len(good) - 2):
        stored.write_text(f"{good[:place]}{'a' if good[place] != 'a' else 'b'}{good[place + 1 :]}", encoding="utf-8")
        assert package.key() == before


def test_checkouts_share_a_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two versions of a package in turn: neither takes the keys of the other."""
    monkeypatch.setenv("MAQUETTE_CACHE", str(tmp_path / "cache"))
    both = []
    for number in (1, 2):
        (tmp_path / str(number)).mkdir()
        both.append(Package(tmp_path / str(number)))
        both[-1].write("kernel", "HALF = 1\n\n\ndef area(r):\n    return HALF * r\n".replace("1", str(number)))
    first, second = [each.key() for each in both]
    assert first != second
    assert [each.key() for each in both] == [first, second]


@pytest.mark.long
def test_overloads_stand_beside_their_functions() -> None:
    """A key follows an overload from its function, within a module. Names of modules are imported one by one."""
    problems = []
    for path in sorted((ROOT / "render").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and any(alias.name == "*" for alias in node.names):
                problems.append(f"{path.name}:{node.lineno}: import *")
            for each in getattr(node, "decorator_list", ()):
                if isinstance(each, ast.Call) and getattr(each.func, "id", "") == "overload" and not isinstance(each.args[0], ast.Name):
                    problems.append(f"{path.name}:{each.lineno}: overloads a function of another module")
    assert not problems


def test_kernels_depend_on_the_modules_of_shapes_lights_and_materials() -> None:
    """They are made from all of these, which no import names."""
    reached = cache_key.Keys(Sources(ROOT, ROOT / "none.json")).reach("render.integrator.wavefront", "draw_tile")
    assert {("shapes.torus", "hit"), ("shapes.torus", "normal"), ("lights.spot", "profile"), ("lights.sun", "FORM")} <= reached
    assert {("materials.metal", "facets"), ("materials.principled", "facets"), ("materials.blinn_phong", "HALF_VECTOR")} <= reached
    assert {("materials.glass", "LOBES"), ("materials.glass", "LOBE")} <= reached


@pytest.mark.long
def test_keys_know_every_package_that_kernels_import() -> None:
    """An edit of a file that keys do not read would leave old kernels in use."""
    unread = set()
    for path in (path for name in PACKAGES for path in (ROOT / name).rglob("*.py")):
        depth = len(path.relative_to(ROOT).parts)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == depth and node.module:
                first = node.module.partition(".")[0]
                if (ROOT / first).is_dir() and first not in PACKAGES:
                    unread.add(f"{path.relative_to(ROOT)}: {first}")
    assert not unread
