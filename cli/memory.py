"""Memory of this process: the peak so far, and the bytes still free."""

from __future__ import annotations

import re
import sys
from pathlib import Path

LATER = 600_000_000  # bytes of address space of libraries that are loaded later

try:
    import resource
except ImportError:  # Windows
    resource = None


def peak_memory() -> int | None:
    """Largest resident memory of this process so far, in bytes; None where the system has no such figure."""
    if resource is None:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def free_memory() -> int | None:
    """Bytes that this process can still take: of the system, of its control group and of `ulimit -v`; None where none is known."""
    return min((value for value in (_of_system(), _of_group(), _of_limit()) if value is not None), default=None)


def _of_system() -> int | None:
    try:
        found = re.search(r"^MemAvailable:\s*(\d+) kB", Path("/proc/meminfo").read_text(encoding="ascii"), re.MULTILINE)
    except OSError:
        return None
    return 1024 * int(found[1]) if found else None


def _of_group() -> int | None:
    """Of control groups, version 2 or 1. Cached files that are not in use count as free."""
    for folder, limit, used in (("", "memory.max", "memory.current"), ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes")):
        group = Path("/sys/fs/cgroup", folder)
        try:
            numbers = [(group / name).read_text(encoding="ascii").strip() for name in (limit, used)]
            cached = re.search(r"^(?:total_)?inactive_file (\d+)", (group / "memory.stat").read_text(encoding="ascii"), re.MULTILINE)
        except OSError:
            continue
        if all(text.isdecimal() for text in numbers) and int(numbers[0]) < 1 << 60:
            return max(int(numbers[0]) - int(numbers[1]) + (int(cached[1]) if cached else 0), 0)
    return None


def _of_limit() -> int | None:
    if resource is None:
        return None
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY:
        return None
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:
        return max(soft - LATER, 0)
    return max(soft - pages * resource.getpagesize() - LATER, 0)
