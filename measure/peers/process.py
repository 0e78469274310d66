"""Runs another program: its errors, its time limit, its number of threads."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...compiler.io import child_process
from ...compiler.plan.plan import Plan
from ...render.simd import target

TIMEOUT = 3600.0  # seconds
_MAX_OUTPUT = 1200  # characters of a failed program's output in the message


class PeerError(RuntimeError):
    """A peer failed; the message has the end of its output."""


def threads(plan: Plan) -> int:
    """The number of threads of our own backends."""
    return int(plan["threads"]) or target.cores()


def run(name: str, command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None) -> str:
    """Run a program in `folder` and return its output (both streams). Raises PeerError if it fails."""
    try:
        done = child_process.run(
            command, folder, environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            errors="replace", timeout=TIMEOUT, check=False,
        )  # fmt: skip
    except OSError as error:
        raise PeerError(f"{name} cannot be started: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise PeerError(f"{name} took longer than {TIMEOUT:g} s") from None
    if done.returncode:
        raise PeerError(f"{name} failed: {done.stdout.strip()[-_MAX_OUTPUT:]}")
    return done.stdout
