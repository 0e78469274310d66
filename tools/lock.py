"""Writes requirements/: the versions of constraints.txt with the hashes of all their files, for Python 3.11 and newer on every system.

    python tools/lock.py

pip checks the hashes (`--require-hashes`). The files serve the container, the environment of `make venv`, and that of `make bench`.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXTRAS = {"run": (), "develop": ("test", "check", "docs"), "bench": ("bench",)}
OLDEST = "3.11.0"  # of Python, as of pyproject.toml
HEADER = "# Written by `make lock` for {uses}. Versions are changed in constraints.txt.\n"


def main() -> int:
    for name, extras in EXTRAS.items():
        command = ["pip", "compile", "--quiet", "--universal", "--generate-hashes", "--no-annotate", "--no-header", "--upgrade"]
        command += ["--python-version", OLDEST, "--constraints", "constraints.txt", "pyproject.toml"]
        command += [word for extra in extras for word in ("--extra", extra)]
        done = subprocess.run([sys.executable, "-P", "-m", "uv", *command], cwd=ROOT, stdout=subprocess.PIPE, text=True)
        if done.returncode:
            return done.returncode
        uses = "what maquette needs" + "".join(f", and its extra `{extra}`" for extra in extras)
        (ROOT / "requirements" / f"{name}.txt").write_text(HEADER.format(uses=uses) + done.stdout, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
