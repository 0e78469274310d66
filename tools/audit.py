"""Looks the locked dependencies up in the list of known vulnerabilities of the package index, with pip-audit.

    python tools/audit.py [requirements/run.txt …]

Exit code 1 if there are some, or if the locks name no dependency. Without the network, or with a package index that has
no such list (a mirror), nothing can be audited: it says so, and the exit code is 0.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
SECONDS = 15  # of waiting for an answer
_UNREACHED = re.compile(r"Connection ?Error|Could not connect|ProxyError|Timeout|SSLError")


def judge(report: dict[str, Any]) -> tuple[list[str], str]:
    """(a line for each vulnerability, a sentence about what was looked up) of a report of pip-audit."""
    packages = report["dependencies"]
    found = [
        f"{package['name']} {package['version']}: {each['id']}; fixed in {', '.join(each['fix_versions']) or 'no version yet'}"
        for package in packages for each in package.get("vulns", ())
    ]  # fmt: skip
    unknown = sum("skip_reason" in package for package in packages)
    told = f"{len(packages) - unknown} dependencies audited, {len(found)} vulnerabilities"
    if unknown:
        told += f"; the package index knows nothing about {unknown} others"
    return found, told


def main(names: list[str]) -> int:
    locks = names or [str(ROOT / "requirements" / f"{name}.txt") for name in ("run", "develop", "bench")]
    command = ["-m", "pip_audit", "--disable-pip", "--require-hashes", "--format", "json", "--progress-spinner", "off"]
    command += ["--timeout", str(SECONDS), *(word for lock in locks for word in ("--requirement", lock))]
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True)
    try:
        report = json.loads(done.stdout)
    except ValueError:
        if _UNREACHED.search(done.stderr):
            print("dependencies are not audited: the package index cannot be reached")
            return 0
        print(done.stderr, file=sys.stderr)
        return 1
    found, told = judge(report)
    print(told)
    print("\n".join(found), end="\n" if found else "")
    if told.startswith("0 "):
        print("nothing was audited: set PIP_INDEX_URL to an index that has a list of vulnerabilities", file=sys.stderr)
    return 1 if found or not report["dependencies"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
