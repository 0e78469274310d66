"""The command `doctor`: one line for each part of an installation, and exit code 1 where something prevents rendering."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli import installation
from maquette.cli.main import cli
from maquette.render.jit import kernel_cache, prebuilt
from maquette.render.simd import target


def run(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli, ["doctor", *arguments])
    return done.exit_code, done.stdout


def findings() -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in json.loads(run("--json")[1])["findings"]}


@pytest.mark.long
def test_each_part_has_a_line() -> None:
    code, out = run()
    lines = {line.split("  ")[0]: line for line in out.splitlines()}
    assert code == 0
    assert set(lines) >= {"maquette", "Python", "packages", "instruction set", "kernel cache", "denoiser", "mitsuba", "povray"}
    assert lines["prebuilt kernels"]
    assert f"numpy {np.__version__}" in lines["packages"]
    assert f"{target.ISA} ({target.LEVEL.cpu})" in lines["instruction set"]
    assert str(kernel_cache.CACHE) in lines["kernel cache"]


@pytest.mark.long
def test_json_has_the_same() -> None:
    found = json.loads(run("--json")[1])
    assert found["ready"] is True
    assert [row["name"] for row in found["findings"]] == [line.split("  ")[0] for line in run()[1].splitlines()]
    assert {row["state"] for row in found["findings"]} <= {"ok", "missing"}


@pytest.mark.long
def test_what_is_missing_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    version = metadata.version

    def without(name: str) -> str:
        if name == "pyoidn":
            raise metadata.PackageNotFoundError(name)
        return version(name)

    monkeypatch.setattr(metadata, "version", without)
    assert findings()["denoiser"]["text"] == "noise is left in pictures: pip install maquette-render[denoise]"
    assert run()[0] == 0


@pytest.mark.long
def test_a_package_that_rendering_needs_prevents_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "required_packages", lambda: {"numpy": "99.1", "no-such-package": "2.0"})
    code, out = run()
    assert code == 1
    assert f"numpy             error: {np.__version__} is too old: pip install 'numpy>=99.1'\n" in out
    assert "no-such-package   error: not installed: pip install 'no-such-package>=2.0'\n" in out


def test_every_dependency_is_checked() -> None:
    assert {"numpy", "numba", "click"} <= set(installation.required_packages())


@pytest.mark.long
@pytest.mark.parametrize(("variable", "value", "name", "state", "text", "code"), [
    ("MAQUETTE_SIMD", "mmx", "instruction set", "error", "MAQUETTE_SIMD=mmx is not an instruction set; choose from:", 1),
    ("MAQUETTE_CACHE", "/proc/none", "kernel cache", "missing", "not writable, so that each run compiles what is not prebuilt", 0),
    ("MAQUETTE_CACHE_SIZE", "much", "kernel cache", "error", "MAQUETTE_CACHE_SIZE is much, which is no size", 1),
])  # fmt: skip
def test_settings_are_checked(variable: str, value: str, name: str, state: str, text: str, code: int) -> None:
    command = [sys.executable, "-m", "maquette", "doctor", "--json"]
    done = subprocess.run(command, env={**os.environ, variable: value}, capture_output=True, text=True, timeout=60)
    row = next(row for row in json.loads(done.stdout)["findings"] if row["name"] == name)
    assert (row["state"], done.returncode) == (state, code)
    assert text in row["text"]


def test_the_cache_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "one"
    for path in (folder, tmp_path / "two"):
        path.mkdir()
        (path / "a").write_bytes(bytes(1_500_000))
    monkeypatch.setattr(kernel_cache, "CACHE", folder)
    row = findings()["kernel cache"]
    assert (row["files"], row["bytes"], row["writable"]) == (1, 3_000_000, True)
    assert row["text"] == f"{folder}: 1 files; 3 MB of 1000 MB (MAQUETTE_CACHE_SIZE) for all targets"
    folder.chmod(0o777)
    assert "; open to other users, so that each run compiles" in findings()["kernel cache"]["text"]


@pytest.mark.long
def test_prebuilt_kernels_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def told() -> tuple[str, str]:
        prebuilt.folder.cache_clear()
        row = findings()["prebuilt kernels"]
        return row["state"], row["text"]

    monkeypatch.setattr(prebuilt, "ROOT", tmp_path / "prebuilt")
    assert told() == ("missing", "none, as this is not a wheel made by `make wheel`: kernels are compiled when they are first needed")
    (tmp_path / "prebuilt" / "other").mkdir(parents=True)
    name = f"{target.ISA}-{target.LEVEL.cpu}"
    assert told() == ("missing", f"none for {name}: this package has other")
    (tmp_path / "prebuilt" / name).mkdir()
    (tmp_path / "prebuilt" / name / "a.kernel").write_bytes(bytes(3_000_000))
    assert told() == ("ok", f"{tmp_path / 'prebuilt' / name}: 1 files, 3 MB")
    prebuilt.folder.cache_clear()
