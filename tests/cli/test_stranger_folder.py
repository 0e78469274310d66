"""In a folder of somebody else's, no command runs a file of the folder as a module, or reads settings of libraries there."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import pytest
from maquette.compiler.io import cache_dirs, child_process, import_path
from maquette.compiler.io.environment import SettingError

SCENE = """\
sphere(1, center: [0, 1, 0], material: lambert(#d0402a), name: "ball")
union(round: 0.1) { box(1, center: [1, 1, 0]); sphere(0.8) }
directional(from: [1, 1, 0])
camera(position: [0, 2, 6], look_at: [0, 1, 0])
render(size: [24, 16], samples: 1)
"""
ENTRY = "from maquette.__main__ import start\nstart()\n"  # what an installer writes as bin/maquette
TRAP = "open({mark!r}, 'a').write({name!r})\nraise ImportError({name!r})\n"
VARIABLES = {"MAQUETTE_KERNELS": "general", "MAQUETTE_PROGRESS": "off"}


def traps(folder: Path) -> Path:
    """Fill a folder with a module of each name that is imported; return the file that such a module writes when it runs."""
    mark = folder / "executed"
    installed = {name for name in metadata.packages_distributions() if name.isidentifier()}
    for name in (set(sys.stdlib_module_names) | installed | {"sitecustomize", "usercustomize"}) - {"maquette"}:
        (folder / f"{name}.py").write_text(TRAP.format(mark=str(mark), name=name), encoding="utf-8")
    (folder / ".numba_config.yaml").write_text("opt: [0\n", encoding="utf-8")
    (folder / "matplotlibrc").write_text("backend: module://evil\n", encoding="utf-8")
    (folder / "plugInfo.json").write_text("{ no JSON\n", encoding="utf-8")
    (folder / "a.scene").write_text(SCENE, encoding="utf-8")
    return mark


def told(command: Sequence[object], folder: Path, **variables: str) -> str:
    """The output of a command in a folder; it ends with 0."""
    done = subprocess.run(
        list(map(str, command)), cwd=folder, env={**os.environ, **VARIABLES, **variables}, capture_output=True, text=True,
        stdin=subprocess.DEVNULL, timeout=900,
    )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout + done.stderr


@pytest.fixture
def script(tmp_path: Path) -> Path:
    """The console script of the command, in a folder of its own."""
    (tmp_path / "bin").mkdir()
    path = tmp_path / "bin" / "maquette"
    path.write_text(ENTRY, encoding="utf-8")
    return path


@pytest.fixture
def stranger(tmp_path: Path) -> Path:
    """An empty folder."""
    (tmp_path / "stranger").mkdir()
    return tmp_path / "stranger"


@pytest.mark.long
def test_the_command(script: Path, stranger: Path) -> None:
    mark = traps(stranger)
    assert told([sys.executable, script, "check", "a.scene"], stranger) == "a.scene: no errors\n"
    assert not mark.exists()


@pytest.mark.long
def test_python_m_maquette(stranger: Path) -> None:
    mark = traps(stranger)
    assert told([sys.executable, "-m", "maquette", "check", "a.scene"], stranger) == "a.scene: no errors\n"
    assert not mark.exists()


@pytest.mark.long
def test_python_p_m_maquette(stranger: Path) -> None:
    mark = traps(stranger)
    assert told([sys.executable, "-P", "-m", "maquette", "check", "a.scene"], stranger) == "a.scene: no errors\n"
    assert not mark.exists()


@pytest.mark.long
def test_a_child_of_a_program(stranger: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The import path of a program has the current folder, as that of a notebook; its children do not."""
    mark = traps(stranger)
    monkeypatch.chdir(stranger)
    monkeypatch.syspath_prepend(str(stranger))
    monkeypatch.setenv("PYTHONPATH", f"{stranger}{os.pathsep}")
    monkeypatch.setenv("PYTHONSTARTUP", str(stranger / "json.py"))
    command = child_process.python("import json, os, sys, numpy\nimport maquette.lang.units\nprint(os.getcwd())")
    done = child_process.run(command, capture_output=True, text=True, timeout=60)
    assert (done.stdout.strip(), done.stderr) == (str(Path(import_path.__file__).resolve().parents[2] / "stdlib"), "")
    assert not mark.exists()


def test_programs_of_the_current_folder(stranger: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty entry of PATH is the current folder."""
    (stranger / "povray").write_text("#!/bin/sh\ntouch executed\n", encoding="utf-8")
    (stranger / "povray").chmod(0o755)
    monkeypatch.chdir(stranger)
    monkeypatch.setenv("PATH", os.pathsep.join(["", ".", "bin"]))
    with pytest.raises(FileNotFoundError):
        child_process.run(["povray"], stranger)
    assert not (stranger / "executed").exists()


def test_folders_that_depend_on_the_current_one_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    full = os.path.abspath(os.sep + "plugins")
    monkeypatch.setenv("PXR_PLUGINPATH_NAME", os.pathsep.join(["plugins", full, ""]))
    monkeypatch.setenv("OIIO_LIBRARY_PATH", ".")
    monkeypatch.setenv("OCIO", "ocio://default")
    assert import_path.environment()["OCIO"] == "ocio://default"
    monkeypatch.setenv("OCIO", "config.ocio")
    found = import_path.environment()
    assert found["PXR_PLUGINPATH_NAME"] == full
    assert "OIIO_LIBRARY_PATH" not in found
    assert "OCIO" not in found
    assert found["PYTHONSAFEPATH"] == "1"


def test_the_environment_of_a_program_comes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", os.pathsep.join(["", os.environ["PATH"]]))
    before = dict(os.environ)
    with child_process.isolated():
        assert os.environ["PYTHONSAFEPATH"] == "1"
        assert not os.environ["PATH"].startswith(os.pathsep)
    assert dict(os.environ) == before


def test_the_cache_is_the_same_in_each_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compiled code in it is executed."""
    monkeypatch.setenv("MAQUETTE_CACHE", "cache")
    with pytest.raises(SettingError, match=r"MAQUETTE_CACHE is cache; it can be a full path, such as /.*/cache"):
        cache_dirs.cache_root()
    monkeypatch.delenv("MAQUETTE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "cache")
    assert cache_dirs.cache_root() == Path.home() / ".cache" / "maquette"


EACH = {
    "render": ["render", "a.scene", "-o", "a.png"],
    "cluster": ["render", "a.scene", "-o", "b.png", "--cluster", "local:2"],
    "inspect": ["inspect", "a.scene"],
    "explain": ["explain", "a.scene"],
    "compare": ["compare", "a.png", "a.png", "--html", "a.html"],
    "test": ["test", "a.scene", "--update"],
    "sweep": ["sweep", "s.scene", "--set", "size=1,2", "-o", "s.png"],
    "thumbnail": ["thumbnail", "a.obj", "b.obj", "-o", "thumbs", "--jobs", "2", "--size", "16"],
    "convert": ["convert", "a.scene", "a.usda"],
    "measure": ["measure", "a.scene"],
    "format": ["format", "a.scene"],
    "new": ["new", "n"],
    "doctor": ["doctor"],
    "lsp": ["lsp"],
    "chart": ["chart", "a.scene", "-o", "c.svg", "--budget", "5s"],
}


@pytest.mark.long
def test_each_command(script: Path, stranger: Path) -> None:
    mark = traps(stranger)
    (stranger / "s.scene").write_text("param size = 1\n" + SCENE.replace("sphere(1,", "sphere(size,"), encoding="utf-8")
    for name in "ab":
        (stranger / f"{name}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    for command, words in EACH.items():
        told([sys.executable, script, *words], stranger)
        assert not mark.exists(), f"{command} executed {mark.read_text(encoding='utf-8')}"
