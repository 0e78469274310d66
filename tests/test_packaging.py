"""What is installed is what stands here: the packages, their data files, the command."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from maquette.lang import distribution
from maquette.render.simd import target

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
NOT_PACKAGES = {"tests", "examples", "bench", "docs", "build"}


def folders() -> set[str]:
    found = {path.parent for path in ROOT.rglob("__init__.py")} - {ROOT}
    inside = {path.relative_to(ROOT) for path in found}
    return {"maquette"} | {
        ".".join(("maquette", *path.parts)) for path in inside if path.parts[0] not in NOT_PACKAGES and not path.parts[0].startswith(".")
    }


@pytest.mark.long
def test_setuptools_finds_the_folders_and_says_nothing(tmp_path: Path) -> None:
    """It runs on an overlay of links, as it writes beside setup.py."""
    for path in ROOT.iterdir():
        if not path.name.startswith(".") and not path.name.endswith(".egg-info") and path.name not in ("build", "dist"):
            (tmp_path / path.name).symlink_to(path)
    command = [sys.executable, "setup.py", "-q", "build_py", "--build-lib", "out"]
    writes = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}  # of which setuptools would warn
    done = subprocess.run(command, cwd=tmp_path, env=writes, capture_output=True, text=True, check=True)
    assert not (tmp_path / "out" / "maquette" / "setup.py").exists()
    assert done.stdout + done.stderr == ""
    made = {path.parent.relative_to(tmp_path / "out") for path in (tmp_path / "out").rglob("__init__.py")}
    assert {".".join(path.parts) for path in made} == folders()


def test_every_data_file_is_packaged() -> None:
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["*"]
    for package in folders():
        folder = ROOT.joinpath(*package.split(".")[1:])
        data = [folder, *(inside for inside in folder.iterdir() if inside.is_dir() and not (inside / "__init__.py").exists())]
        for path in (path for place in data for path in place.iterdir()):
            if path.is_file() and package != "maquette" and path.suffix not in (".py", ".pyc"):
                assert any(path.match(pattern) for pattern in patterns), f"{path.relative_to(ROOT)} is in no pattern of package-data"


def test_every_dependency_is_pinned() -> None:
    pinned = {
        line.split("==")[0].lower().replace("_", "-")
        for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
        if "==" in line
    }
    wanted = [*PROJECT["project"]["dependencies"], *(d for more in PROJECT["project"]["optional-dependencies"].values() for d in more)]
    for requirement in wanted:
        name = requirement.split(">=")[0].split("[")[0].lower().replace("_", "-")
        assert name in pinned, f"{requirement} has no version in constraints.txt"


@pytest.mark.long
def test_the_distribution_has_one_name() -> None:
    assert PROJECT["project"]["name"] == distribution.NAME
    assert PROJECT["project"]["scripts"] == {"maquette": "maquette.__main__:start"}
    files = (path for path in ROOT.rglob("*") if path.suffix in (".md", ".py") and path != Path(__file__))
    pages = [path for path in files if path.relative_to(ROOT).parts[0][0] != "." and path.relative_to(ROOT).parts[0] != "build"]
    wrong = re.compile(r"pip install[^\n`#]*\bmaquette\b(?!-render)")  # another program on the package index
    assert [path.name for path in pages if wrong.search(path.read_text(encoding="utf-8"))] == []
    extras = PROJECT["project"]["optional-dependencies"]
    written = {extra for path in pages for extra in re.findall(r"maquette-render\[(\w+)\]", path.read_text(encoding="utf-8"))}
    assert written <= set(extras)


@pytest.mark.long
def test_a_wheel_installs_a_command_that_works_anywhere(tmp_path: Path) -> None:
    run = [sys.executable, "-m", "pip"]
    subprocess.run([*run, "wheel", "-q", "--no-deps", "-w", str(tmp_path), str(ROOT)], check=True)
    (wheel,) = tmp_path.glob("maquette_render-*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    data = [*ROOT.glob("stdlib/*.scene"), ROOT / "lang/syntax/tables.json", ROOT / "py.typed", *ROOT.glob("cli/*.py")]
    assert {f"maquette/{path.relative_to(ROOT).as_posix()}" for path in data} <= names
    assert not [name for name in names if name.startswith("maquette/tests")]
    subprocess.run([*run, "install", "-q", "--no-deps", "--target", str(tmp_path / "site"), str(wheel)], check=True)
    scene = tmp_path / "one.scene"
    scene.write_text('use "std/room"\nsphere(1, material: plastic(#d0402a))\n', encoding="utf-8")
    code = "import sys; sys.path.insert(0, 'site'); from maquette.cli.main import main; main()"
    done = subprocess.run([sys.executable, "-I", "-c", code, "check", "one.scene"], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "one.scene: no errors\n"), done.stderr


WARM = """
import json, sys
sys.path.insert(0, "site")
from pathlib import Path
from dataclasses import replace
from maquette.compiler import load
from maquette.compiler.plan import plan
from maquette.render import render_scene
scene = load.load(Path(sys.argv[1]))
image = render_scene.draw(scene, plan.make_plan(scene, replace(scene.settings, size=(64, 48))))
print(json.dumps([image.metadata["seconds"]["compile_kernels"], "numba" in sys.modules, load.__file__]))
"""


@pytest.mark.long
def test_a_wheel_with_kernels_draws_without_compiling(tmp_path: Path) -> None:
    """In an empty home, and without a home to write to."""
    isa = target.highest(target.HOST)
    scene = ROOT / "examples" / "hello.scene"
    options = ["--out", str(tmp_path / "out"), "--build", str(tmp_path / "build"), "--sets", isa, "--scenes", str(scene), "--no-general"]
    subprocess.run([sys.executable, str(ROOT / "tools" / "wheel.py"), *options], check=True)
    (wheel,) = (tmp_path / "out").glob("maquette_render-*-py3-none-*.whl")
    assert wheel.stat().st_size < 40_000_000
    assert json.loads(wheel.with_suffix(".cdx.json").read_text(encoding="utf-8"))["bomFormat"] == "CycloneDX"
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-index", "--target", str(tmp_path / "site"), str(wheel)]
    subprocess.run(install, check=True)
    (tmp_path / "home").mkdir()
    for home in (tmp_path / "home", Path("/proc/no/home")):
        environment = {"PATH": os.environ["PATH"], "HOME": str(home)}
        command = [sys.executable, "-P", "-c", WARM, str(scene)]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
        seconds, compiled, where = json.loads(done.stdout)
        assert where.startswith(str(tmp_path / "site"))
        assert (seconds < 1.0, compiled) == (True, False), done.stderr
