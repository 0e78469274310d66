"""Looks the locked dependencies up in lists of known vulnerabilities, with pip-audit.

    python tools/audit.py [requirements/run.txt …]

It asks the package index, and OSV (osv.dev) where the index has no such list, as most mirrors have none.
Exit code 0: looked up, none is known. 1: some are known, or a lock is wrong. 3: no list could be asked; nothing is audited.
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
SERVICES = {"pypi": "the package index", "osv": "osv.dev"}  # names of pip-audit: what messages call them
NOT_AUDITED = 3  # an exit code
_UNREACHED = re.compile(r"Connection ?Error|Could not connect|ProxyError|Timeout|SSLError")


def judge(report: dict[str, Any]) -> tuple[list[str], int]:
    """(a line for each vulnerability, the number of dependencies that were looked up) of a report of pip-audit."""
    packages = report["dependencies"]
    vulnerabilities = [
        f"{package['name']} {package['version']}: {each['id']}; fixed in {', '.join(each['fix_versions']) or 'no version yet'}"
        for package in packages for each in package.get("vulns", ())
    ]  # fmt: skip
    return vulnerabilities, sum("skip_reason" not in package for package in packages)


def ask(service: str, locks: list[str]) -> dict[str, Any] | str:
    """The report of pip-audit about these locks, or why there is none: "unreached", or the message of an error."""
    command = ["-m", "pip_audit", "--vulnerability-service", service, "--disable-pip", "--require-hashes", "--format", "json"]
    command += ["--progress-spinner", "off", "--timeout", str(SECONDS), *(word for lock in locks for word in ("--requirement", lock))]
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True)
    try:
        return json.loads(done.stdout)
    except ValueError:
        return "unreached" if _UNREACHED.search(done.stderr) else done.stderr


def main(names: list[str]) -> int:
    reasons = []
    for service, name in SERVICES.items():
        report = ask(service, names or [str(ROOT / "requirements" / f"{lock}.txt") for lock in ("run", "develop", "bench")])
        if report == "unreached":
            reasons.append(f"{name} cannot be reached")
            continue
        if isinstance(report, str):
            print(report, file=sys.stderr)
            return 1
        vulnerabilities, audited = judge(report)
        if audited:
            others = len(report["dependencies"]) - audited
            summary = f"{audited} dependencies audited, {len(vulnerabilities)} vulnerabilities"
            print(summary + (f"; {name} knows nothing about {others} others" if others else ""))
            print("\n".join(vulnerabilities), end="\n" if vulnerabilities else "")
            return 1 if vulnerabilities else 0
        reasons.append(f"{name} knows nothing about any of {len(report['dependencies'])}")
    print(f"dependencies are NOT audited: {', '.join(reasons)}")
    return NOT_AUDITED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
