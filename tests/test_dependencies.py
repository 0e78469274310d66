"""Dependencies are locked with hashes and audited, and the bill of materials names them all."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
PIN = re.compile(r"^([\w.-]+)==([^\s;]+)", re.MULTILINE)
LOCKS = {"run": (), "develop": ("test", "check", "docs"), "bench": ("bench",)}


def normal(name: str) -> str:
    """A distribution's name as PEP 503 writes it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(path: Path) -> dict[str, str]:
    return {normal(name): version for name, version in PIN.findall(path.read_text(encoding="utf-8"))}


@pytest.mark.parametrize("name", LOCKS)
def test_locks_hold_the_pinned_versions_with_hashes(name: str) -> None:
    path = ROOT / "requirements" / f"{name}.txt"
    locked, pinned = pins(path), pins(ROOT / "constraints.txt")
    assert {package: pinned.get(package) for package in locked} == locked
    for entry in re.split(r"\n(?=\S)", path.read_text(encoding="utf-8").partition("\n")[2]):
        assert re.fullmatch(r"[\w.-]+==\S+( ; [^\\]+)?( \\\n    --hash=sha256:[0-9a-f]{64})+\n?", entry), entry
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *(each for extra in LOCKS[name] for each in project["optional-dependencies"][extra])]
    assert {normal(re.split(r"[>\[]", each)[0]) for each in wanted} <= set(locked)


def audit(folder: Path, answer: str, code: int) -> tuple[int, str]:
    """Exit code and output of tools/audit.py with a pip-audit that gives this answer."""
    stream = "stderr" if code > 1 else "stdout"
    (folder / "pip_audit.py").write_text(f"import sys\nprint({answer!r}, file=sys.{stream})\nsys.exit({code})\n", encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(folder)}
    done = subprocess.run([sys.executable, str(ROOT / "tools" / "audit.py")], env=environment, capture_output=True, text=True)
    return done.returncode, done.stdout


CLEAN = {"name": "numpy", "version": "2.4.6", "vulns": []}
UNKNOWN = {"name": "usd-core", "skip_reason": "Dependency not found on PyPI"}
BAD = {"name": "pillow", "version": "9.0.0", "vulns": [{"id": "PYSEC-2023-227", "fix_versions": ["10.0.1"]}]}


@pytest.mark.parametrize(
    ("packages", "code", "told"),
    [
        ([CLEAN], 0, "1 dependencies audited, 0 vulnerabilities\n"),
        ([CLEAN, UNKNOWN], 0, "1 dependencies audited, 0 vulnerabilities; the package index knows nothing about 1 others\n"),
        (
            [UNKNOWN],
            3,
            "dependencies are NOT audited: the package index knows nothing about any of 1, osv.dev knows nothing about any of 1\n",
        ),
        ([], 3, "dependencies are NOT audited: the package index knows nothing about any of 0, osv.dev knows nothing about any of 0\n"),
        ([CLEAN, BAD], 1, "2 dependencies audited, 1 vulnerabilities\npillow 9.0.0: PYSEC-2023-227; fixed in 10.0.1\n"),
    ],
)
def test_an_audit_tells_what_it_looked_up(tmp_path: Path, packages: list[dict[str, Any]], code: int, told: str) -> None:
    assert audit(tmp_path, json.dumps({"dependencies": packages, "fixes": []}), 0) == (code, told)


@pytest.mark.long
def test_an_audit_without_the_network_says_so() -> None:
    environment = {**os.environ, "HTTPS_PROXY": "http://127.0.0.1:1", "https_proxy": "http://127.0.0.1:1"}
    command = [sys.executable, str(ROOT / "tools" / "audit.py"), str(ROOT / "requirements" / "run.txt")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout) == (
        3,
        "dependencies are NOT audited: the package index cannot be reached, osv.dev cannot be reached\n",
    ), done.stderr


def test_another_failure_of_the_audit_is_an_error(tmp_path: Path) -> None:
    assert audit(tmp_path, "error: requirement has no hash", 2) == (1, "")


@pytest.mark.long
def test_the_bill_of_materials_names_what_comes_along() -> None:
    made = [subprocess.run([sys.executable, str(ROOT / "tools" / "sbom.py")], capture_output=True, check=True).stdout for _ in range(2)]
    assert made[0] == made[1]
    bill = json.loads(made[0])
    parts = {part["bom-ref"]: part for part in bill["components"]}
    locked = {f"pkg:pypi/{name}@{version}" for name, version in pins(ROOT / "requirements" / "run.txt").items()}
    assert locked == {name for name in parts if name.startswith("pkg:pypi/")}
    assert all(re.fullmatch(r"[0-9a-f]{64}", each["content"]) for name in locked for each in parts[name]["externalReferences"][0]["hashes"])
    assert {part["name"] for part in bill["components"] if part["type"] == "file"} == {p.name for p in ROOT.glob("stdlib/fonts/*.ttf")}
    notice = (ROOT / "live" / "page" / "codemirror.LICENSE.txt").read_text(encoding="utf-8")
    npm = {part["name"] for part in bill["components"] if part["bom-ref"].startswith("pkg:npm/")}
    assert "@codemirror/view" in npm
    assert all(re.sub(r"^(@codemirror|@lezer)/.*", r"\1/*", name) in notice for name in npm)
    (product,) = (each for each in bill["dependencies"] if each["ref"] == bill["metadata"]["component"]["bom-ref"])
    assert set(product["dependsOn"]) == set(parts)
