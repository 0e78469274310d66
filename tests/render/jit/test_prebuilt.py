"""Kernels that come with the package: they are loaded without compiling, and damaged ones are compiled."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from maquette.render.jit import cache_key, compiler, kernel_cache, prebuilt
from maquette.render.jit.package_sources import Sources
from maquette.render.simd import target
from numba.core.registry import cpu_target

PROGRAM = """
import sys
from pathlib import Path
import numpy as np
from maquette.render.film import accumulate
from maquette.render.jit import kernel_cache, prebuilt
prebuilt.ROOT = Path(sys.argv[1])
out, one = np.full((2, 2), -1.0), np.ones((2, 2, 3))
accumulate.relative_error(0.5 * one, one, np.full((2, 2), 4), np.ones(32), 0.0, out)
(loaded,) = accumulate.relative_error.loaded.values()
print(loaded.from_disk, "numba" in sys.modules, out.tolist())
print(kernel_cache.CACHE)
"""
VALUES = [[0.25, 0.25], [0.25, 0.25]]


def run(cache: Path, shipped: Path) -> tuple[str, Path]:
    environment = {**os.environ, "MAQUETTE_CACHE": str(cache)}
    command = [sys.executable, "-c", PROGRAM, str(shipped)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    printed, folder = done.stdout.splitlines()
    return printed, Path(folder)


@pytest.mark.long
@pytest.mark.skipif(prebuilt.folder_name() is None, reason="no package has kernels for this target")
def test_kernels_of_the_package_are_loaded(tmp_path: Path) -> None:
    name = prebuilt.folder_name()
    assert name is not None
    shipped = tmp_path / "prebuilt"
    printed, folder = run(tmp_path / "one", shipped)
    assert printed == f"False True {VALUES}"
    shutil.copytree(folder, shipped / name)
    printed, folder = run(tmp_path / "two", shipped)
    assert printed == f"True False {VALUES}"
    assert not [*folder.glob("*.kernel")]
    for path in (shipped / name).iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    assert run(tmp_path / "two", shipped)[0] == f"False True {VALUES}"


def test_only_fixed_targets_have_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    for isa, level in target.X86_LEVELS.items():
        monkeypatch.setattr(target, "ISA", isa)
        monkeypatch.setattr(target, "LEVEL", level)
        assert prebuilt.folder_name() == (None if target.CHECKED else f"{isa}-{level.cpu}")
    monkeypatch.setattr(target, "LEVEL", target.LEVEL._replace(cpu="znver4"))
    assert prebuilt.folder_name() is None
    monkeypatch.setattr(target, "LEVEL", target.X86_LEVELS["sse"])
    monkeypatch.setattr(target, "CHECKED", True)
    assert prebuilt.folder_name() is None


def test_kernels_are_current_by_the_sources_in_their_names() -> None:
    sources = cache_key.key("render.film.accumulate", "add_samples")
    assert kernel_cache.is_current(f"render.film.accumulate~add_samples-{sources}-0123456789abcdef.kernel")
    assert not kernel_cache.is_current("render.film.accumulate~add_samples-0123456789abcdef-0123456789abcdef.kernel")
    assert not kernel_cache.is_current(f"elsewhere~add_samples-{sources}-0123456789abcdef.kernel")
    assert kernel_cache.is_current(f"tape_points-{cache_key.key('render.formula.interpreter')}-8.kernel")


def test_definitions_of_modules_come_with_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules that came with the package are not parsed; changed ones are."""
    film = tmp_path / "render" / "film.py"
    film.parent.mkdir()
    film.write_text("LIMIT = 1\n", encoding="utf-8")
    parsed: list[str] = []
    monkeypatch.setattr(ast, "parse", lambda text, parse=ast.parse: parsed.append(text) or parse(text))

    def keys(cache: str) -> cache_key.Keys:
        """The keys that a process with a cache folder computes."""
        monkeypatch.setenv("MAQUETTE_CACHE", str(tmp_path / cache))
        parsed.clear()
        return cache_key.Keys(Sources(tmp_path, tmp_path / "sources.json"))

    before = keys("one").key("render.film")
    shipped = keys("one").sources.ship()
    assert keys("two").key("render.film") == before
    assert len(parsed) == 1
    (tmp_path / "sources.json").write_text(shipped, encoding="utf-8")
    assert keys("three").key("render.film") == before
    assert not parsed
    (tmp_path / "sources.json").write_text(shipped.replace("film", "firm"), encoding="utf-8")
    assert keys("four").key("render.film") == before
    film.write_text("LIMIT = 2\n", encoding="utf-8")
    assert keys("four").key("render.film") != before
    assert len(parsed) == 1


def test_kernels_call_each_other_as_those_of_the_package_do() -> None:
    assert compiler.convention(cpu_target.target_context) == compiler.CONVENTION
