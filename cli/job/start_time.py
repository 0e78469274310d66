"""The time at which the budget of a picture begins: the start of the command for its first picture, else its reading.

The CPU time of the process at that time tells whether other work slowed it.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import NamedTuple

from ..process import supervisor


class StartTime(NamedTuple):
    """A time of time.perf_counter, and the CPU seconds that this process had by then."""

    began: float
    processed: float


_began: StartTime | None = None  # of the command, until its first picture takes it


def begin() -> None:
    """Note the start of the command that this process runs."""
    global _began
    _began = StartTime(time.perf_counter() - _age(), 0.0)


def take() -> StartTime:
    """The time at which a picture begins."""
    global _began
    began, _began = _began, None
    return StartTime(time.perf_counter(), time.process_time()) if began is None else began


def _age() -> float:
    """Seconds since the start of the command; 0 where the system does not tell."""
    try:
        fields = Path(f"/proc/{supervisor.first_process()}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        started = int(fields[19]) / os.sysconf("SC_CLK_TCK")  # field 22, of those from 3 on: ticks since the boot
        return max(time.clock_gettime(time.CLOCK_BOOTTIME) - started, 0.0)
    except (OSError, ValueError, IndexError, AttributeError):
        return 0.0
