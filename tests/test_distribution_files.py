"""The Dockerfile and the GitHub Action: their parts fit this project, and the action's steps run in a scratch repository."""

from __future__ import annotations

import fnmatch
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from maquette.cli.commands import compare
from maquette.cli.main import cli
from maquette.lang import distribution

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SCENE = "sphere(1, material: lambert({0}))\npoint([2, 4, 3], intensity: 20)\ncamera(position: [0, 1, 5], look_at: [0, 0, 0])\n"
SETTINGS = 'render(size: [16, 12], samples: 1, backend: "reference")\n'


# --- Dockerfile ----------------------------------------------------------------------------------------------------------------


def instructions() -> list[tuple[str, str]]:
    text = (ROOT / "Dockerfile").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [(word, rest.strip()) for word, _, rest in (line.partition(" ") for line in lines)]


def test_the_container_starts_the_command_as_a_plain_user_in_the_mounted_folder() -> None:
    steps = instructions()
    final = steps[max(k for k, (word, _) in enumerate(steps) if word == "FROM") :]
    last = dict(final)
    assert {word for word, _ in steps} <= {"FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "ENTRYPOINT", "CMD"}
    python = {rest.partition(" ")[0] for word, rest in steps if word == "FROM"}
    assert python == {"python:3.12-slim"}
    (install,) = (rest for word, rest in steps if word == "RUN" and "pip wheel" in rest)
    assert f" {distribution.NAME} || pip wheel " in install
    assert (last["USER"], last["WORKDIR"]) == ("maquette", "/scenes")
    assert json.loads(last["ENTRYPOINT"]) == list(PROJECT["project"]["scripts"])
    assert cli.main([*json.loads(last["CMD"])], "maquette", standalone_mode=False) == 0
    assert [word for word, _ in final].index("USER") > max(k for k, (word, _) in enumerate(final) if word == "RUN")
    assert f"useradd --create-home --uid 1000 {last['USER']}" in " ".join(rest for word, rest in final if word == "RUN")
    assert PROJECT["project"]["requires-python"] == ">=3.11"


def installed_packages() -> set[str]:
    """The packages that setup.py finds."""
    code = "import runpy, setuptools; setuptools.setup = lambda **options: print(*options['packages']); runpy.run_path('setup.py')"
    return set(subprocess.run([sys.executable, "-P", "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split())


@pytest.mark.long
def test_what_the_container_copies_is_there() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    packages = {name.split(".")[1] for name in installed_packages() if "." in name}
    for name in ("requirements/run.txt", "pyproject.toml", "setup.py", "README.md", "LICENSE", *packages):
        assert (ROOT / name).exists()
        assert not any(fnmatch.fnmatch(name, pattern) for pattern in ignored)


@pytest.mark.long
@pytest.mark.parametrize("command", [rest for word, rest in instructions() if word == "RUN"])
def test_the_steps_of_the_container_are_shell(command: str) -> None:
    subprocess.run(["bash", "-n", "-c", command], check=True)
    for part in re.split(r"&&|\|\|", command):
        words = shlex.split(part)
        if words[:1] == ["pip"]:
            options = [word for word in words[2:] if word.startswith("--")]
            known = subprocess.run([sys.executable, "-m", "pip", words[1], "--help"], capture_output=True, text=True, check=True).stdout
            assert all(option in known for option in options)


# --- the action ----------------------------------------------------------------------------------------------------------------


def action() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))


def test_the_action_is_well_formed() -> None:
    found = action()
    assert found["runs"]["using"] == "composite"
    assert found["inputs"]["package"]["default"] == distribution.NAME
    assert found["inputs"]["metric"]["default"] in compare.FIGURES
    used = set(re.findall(r"inputs\.(\w+)", (ROOT / "action.yml").read_text(encoding="utf-8")))
    assert used == set(found["inputs"])
    for step in found["runs"]["steps"]:
        assert ("run" in step) != ("uses" in step)
        if "run" in step:
            assert step["shell"] == "bash"
            assert "${{" not in step["run"]  # values reach the shell as variables, never as code
            subprocess.run(["bash", "-n", "-c", step["run"]], check=True)


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """A repository with three scenes, one of them with a part in another file."""
    folder = tmp_path / "work"
    (folder / "rooms").mkdir(parents=True)
    (folder / "same.scene").write_text(SCENE.format("#808080") + SETTINGS, encoding="utf-8")
    (folder / "rooms/red.scene").write_text(SCENE.format("#800000") + SETTINGS, encoding="utf-8")
    (folder / "part.scene").write_text("let ball() = sphere(1, material: lambert(#008000))\n", encoding="utf-8")
    uses = 'use "part.scene"\npart.ball()\n' + SCENE.format("#808080").replace("sphere(1", "sphere(1, center: [2, 0, 0]")
    (folder / "uses.scene").write_text(uses + SETTINGS, encoding="utf-8")
    git(folder, "init", "--quiet")
    git(folder, "add", ".")
    commit(folder)
    return folder


def git(folder: Path, *words: str) -> str:
    return subprocess.run(["git", *words], cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


def commit(folder: Path) -> None:
    git(folder, "-c", "user.name=a", "-c", "user.email=a@b", "commit", "--quiet", "--all", "--message", "change")


def run_action(folder: Path, base: str, **inputs: str) -> tuple[int, str, str]:
    """Exit code, output and summary of the step that compares."""
    found = action()
    values = {name: str(each["default"]) for name, each in found["inputs"].items()} | {"base": base} | inputs
    step = next(step for step in found["runs"]["steps"] if step.get("name") == "Compare the scenes")
    environment = {name: re.sub(r"\$\{\{ inputs\.(\w+) \}\}", lambda m: values[m[1]], value) for name, value in step["env"].items()}
    tools = folder.parent / "tools"
    tools.mkdir(exist_ok=True)
    (tools / "maquette").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m maquette "$@"\n', encoding="utf-8")
    (tools / "maquette").chmod(0o755)
    summary = folder.parent / "summary.md"
    summary.write_text("", encoding="utf-8")
    environment |= {"PATH": f"{tools}:{os.environ['PATH']}", "GITHUB_STEP_SUMMARY": str(summary)}
    command = ["bash", "--noprofile", "--norc", "-e", "-o", "pipefail", "-c", step["run"]]  # as GitHub runs it
    done = subprocess.run(command, cwd=folder, env={**os.environ, **environment}, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout + done.stderr, summary.read_text(encoding="utf-8")


@pytest.mark.long
def test_a_pull_request_without_changes_renders_nothing(repository: Path) -> None:
    code, out, summary = run_action(repository, git(repository, "rev-parse", "HEAD"))
    assert (code, out, summary) == (0, "", "| scene | result |\n|---|---|\n")
    assert git(repository, "worktree", "list").count("\n") == 0


@pytest.mark.long
def test_changed_scenes_are_compared_with_their_base(repository: Path) -> None:
    base = git(repository, "rev-parse", "HEAD")
    (repository / "rooms/red.scene").write_text(SCENE.format("#8f0000") + SETTINGS, encoding="utf-8")
    (repository / "part.scene").write_text("// another word\nlet ball() = sphere(1, material: lambert(#008000))\n", encoding="utf-8")
    (repository / "new.scene").write_text(SCENE.format("#ff0000") + SETTINGS, encoding="utf-8")
    (repository / "wrong.scene").write_text("sphere(radios: 1)\n", encoding="utf-8")
    git(repository, "add", ".")
    commit(repository)
    code, out, summary = run_action(repository, base, threshold="0.1%")
    rows = dict(re.findall(r"^\| (\S+\.scene) \| (.*) \|$", summary, re.MULTILINE))
    assert code == 1, out
    assert set(rows) == {"new.scene", "part.scene", "rooms/red.scene", "uses.scene", "wrong.scene"}
    assert rows["uses.scene"] == "within 0.1% (relmse)"
    assert rows["new.scene"] == "is new"
    assert rows["wrong.scene"] == "does not compile"
    assert re.fullmatch(r".* is \S+%, above the threshold of 0\.1%", rows["rooms/red.scene"])
    assert (repository / "differences/rooms-red.png").exists()
    assert run_action(repository, base, threshold="50%", scenes="rooms/*\nuses.scene")[0] == 0


@pytest.mark.long
def test_every_package_is_installed() -> None:
    """setup.py finds each folder of modules, and no tests or benchmarks."""
    found = {
        ".".join(("maquette", *path.parent.relative_to(ROOT).parts))
        for name in ("cli", "compiler", "lang", "live", "measure", "render", "stdlib") for path in (ROOT / name).rglob("__init__.py")
    }  # fmt: skip
    packages = installed_packages()
    assert found <= packages
    assert not [name for name in packages if name.split(".")[1:2] in (["tests"], ["bench"], ["build"])]
