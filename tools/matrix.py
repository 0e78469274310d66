"""Runs parts of the suite under other conditions: threads, instruction sets, kinds of kernels, locale, home, a wheel, other Pythons.

    python tools/matrix.py                     # one row, chosen by the date: a minute
    python tools/matrix.py --all               # all rows
    python tools/matrix.py sse "C locale"      # these

A row that this machine cannot run is skipped, and the reason printed. Exit code 1 if the tests of a row fail.
"""

from __future__ import annotations

import argparse
import datetime
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MADE = ROOT / "build" / "matrix"  # the environments of other Pythons
UNWRITABLE = Path("/proc")  # for root too
SETS = ("avx512", "avx2", "sse", "scalar")
PYTHONS = ("3.11", "3.12", "3.13", "3.14")

PICTURES = ("tests/backends/test_determinism.py", "--long", "-k", "not (test_determinism and (area or asked))")
TEXT = (
    "tests/lang/syntax", "tests/compiler/io", "tests/compiler/importers/test_mesh_files.py", "tests/compiler/importers/usd/layers",
    "tests/cli/test_check.py", "tests/cli/test_new.py",
)  # fmt: skip
ALONE = ("tests/backends/test_alone.py",)  # each kind of shape, light, material and texture
WHEEL = ("tests/test_packaging.py", "--long", "-k", "wheel_installs")


@dataclass(frozen=True, slots=True)
class Row:
    """A condition: variables of the environment (None: unset), what is run, and the Python."""

    name: str
    tests: tuple[str, ...]
    environment: Mapping[str, str | None] = field(default_factory=dict)
    python: str = ""  # a version; "" for that of this script
    sampled: bool = True  # takes a minute, without a new environment


_HOME = {"HOME": str(UNWRITABLE), "XDG_CACHE_HOME": None, "MAQUETTE_CACHE": None, "XDG_CONFIG_HOME": None}
_LOCALE = {"LC_ALL": "C", "LANG": None, "LC_CTYPE": None}
ROWS = (
    *(Row(f"{n} thread{'s' * (n > 1)}", PICTURES, {"MAQUETTE_TEST_THREADS": str(n)}) for n in (1, 2, 8)),
    *(Row(name, PICTURES, {"MAQUETTE_SIMD": name, "MAQUETTE_TEST_KERNELS": "special"}) for name in SETS),
    *(Row(f"general kernels of {name}", ALONE, {"MAQUETTE_SIMD": name}, sampled=False) for name in SETS),
    Row("checked kernels", ALONE, {"MAQUETTE_CHECKED": "1"}, sampled=False),
    Row("special kernels", (*ALONE, "-k", "emitter or light"), {"MAQUETTE_TEST_KERNELS": "special"}, sampled=False),
    Row("C locale", TEXT, _LOCALE),
    Row("read-only home", (*TEXT, "tests/backends/test_camera.py", "-k", "not (test_camera and (ray or raster))"), _HOME),
    Row("installed wheel", WHEEL, sampled=False),
    *(Row(f"Python {version}", (*TEXT, *PICTURES), python=version, sampled=False) for version in PYTHONS),
)


class Unavailable(Exception):
    """This machine cannot run a row."""


def interpreter(version: str) -> Path:
    """The Python of an environment with the pinned packages, which is made where it is missing. Raises Unavailable."""
    folder = MADE / f"python{version}"
    python = folder / "bin" / "python"
    if (folder / ".made").exists():
        return python
    base_python = _found(version)
    subprocess.run([base_python, "-m", "venv", "--clear", folder], check=True)
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--require-hashes", "-r"]
    done = subprocess.run([*install, ROOT / "requirements" / "develop.txt"], capture_output=True, text=True)
    if done.returncode:
        raise Unavailable(f"the packages for Python {version} cannot be installed: {done.stderr.strip().splitlines()[-1:]}")
    (folder / ".made").touch()
    return python


def _found(version: str) -> str:
    """An interpreter of a version, of the PATH or of pyenv."""
    pyenv = sorted(Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob(f"versions/{version}.*/bin/python{version}"))
    for path in (shutil.which(f"python{version}"), *map(str, pyenv)):
        probe = path and subprocess.run([path, "-c", "import sys; print(*sys.version_info[:2], sep='.')"], capture_output=True, text=True)
        if path and probe and probe.stdout.strip() == version:
            return path
    raise Unavailable(f"there is no python{version} on this machine")


def run(row: Row) -> bool:
    """Run the tests of a row. Raises Unavailable."""
    if row.environment is _HOME and not UNWRITABLE.is_dir():
        raise Unavailable("no folder is known that nobody can write to")
    python = interpreter(row.python) if row.python else Path(sys.executable)
    with tempfile.TemporaryDirectory() as packages:
        (Path(packages) / "maquette").symlink_to(ROOT)
        environment = {name: value for name, value in os.environ.items() if name not in row.environment} | {"PYTHONPATH": packages}
        environment |= {name: value for name, value in row.environment.items() if value is not None}
        if level := row.environment.get("MAQUETTE_SIMD"):
            code = "from maquette.render.simd import target; target.check_host()"
            if subprocess.run([python, "-c", code], env=environment, capture_output=True).returncode:
                raise Unavailable(f"this machine has no {level}")
        command = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *row.tests]
        return subprocess.run(command, cwd=ROOT, env=environment).returncode == 0


def chosen(names: list[str], everything: bool, day: datetime.date) -> list[Row]:
    """The rows of these names, all, or one by the date."""
    if everything:
        return list(ROWS)
    if names:
        by_name = {row.name: row for row in ROWS}
        unknown = [name for name in names if name not in by_name]
        if unknown:
            raise SystemExit(f"there is no row `{unknown[0]}`: choose from {', '.join(by_name)}")
        return [by_name[name] for name in names]
    sampled = [row for row in ROWS if row.sampled]
    return [sampled[day.toordinal() % len(sampled)]]


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("rows", nargs="*", metavar="ROW")
    words.add_argument("--all", action="store_true")
    options = words.parse_args()
    failed = []
    for row in chosen(options.rows, options.all, datetime.datetime.now(datetime.UTC).date()):
        print(f"--- {row.name}", flush=True)
        start = time.monotonic()
        try:
            if not run(row):
                failed.append(row.name)
        except Unavailable as reason:
            print(f"skipped: {reason}")
        print(f"{time.monotonic() - start:.0f} s", flush=True)
    if failed:
        print(f"failed: {', '.join(failed)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
