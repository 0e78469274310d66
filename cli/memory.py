"""The memory that this process has taken."""

from __future__ import annotations

import sys

try:
    import resource
except ImportError:  # Windows
    resource = None


def peak_memory() -> int | None:
    """Largest resident memory of this process so far, in bytes; None where the system has no such figure."""
    if resource is None:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
