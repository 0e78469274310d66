"""Running another program once: its error, its time limit, and how many threads it gets."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...compiler.plan.plan import Plan
from ...render.simd import target

LIMIT = 3600.0  # seconds after which a peer is given up
_SHOWN = 1200  # characters of a failed program's last words


class PeerError(RuntimeError):
    """A peer that failed; the message holds its own words."""


def threads(plan: Plan) -> int:
    """As many as our own backends take."""
    return int(plan["threads"]) or target.cores()


def call(name: str, command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None) -> str:
    """What a program said (both streams), run in `folder`. Raises PeerError if it fails."""
    try:
        done = subprocess.run(
            command, cwd=folder, env={**os.environ, **(environment or {})}, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, errors="replace", timeout=LIMIT, check=False,
        )  # fmt: skip
    except OSError as error:
        raise PeerError(f"{name} cannot be started: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise PeerError(f"{name} took longer than {LIMIT:g} s") from None
    if done.returncode:
        raise PeerError(f"{name} failed: {done.stdout.strip()[-_SHOWN:]}")
    return done.stdout
