"""Memory of this process: the peak so far, the bytes still free, and the strips of pictures that do not fit."""

from __future__ import annotations

import os
import re
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ..compiler import ir
    from ..compiler.plan.plan import Plan

SMALL_PICTURE = 256_000_000  # bytes of pixels that are tried in any case
PROGRAM = 150_000_000  # bytes of this process with a small scene
LATER = 600_000_000  # bytes of address space of libraries that are loaded later
LIMITS = (  # name, kind, least bytes, the command that raises it
    ("RLIMIT_STACK", "stack", 1 << 20, "ulimit -s 8192"),
    ("RLIMIT_DATA", "data", 300_000 << 10, "ulimit -d unlimited"),
    ("RLIMIT_AS", "address space", 600_000 << 10, "ulimit -v unlimited"),
)

try:
    import resource
except ImportError:  # Windows
    resource = None


def peak_memory() -> int | None:
    """Largest resident memory of this process so far, in bytes; None where the system has no such figure."""
    if resource is None:
        return None
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def resident_memory() -> int:
    """Resident memory of this process now, in bytes; the peak, or PROGRAM, where the system has no such figure."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return peak_memory() or PROGRAM
    return pages * resource.getpagesize() if resource is not None else PROGRAM


def refused_limits() -> str:
    """Limits of the shell under which libraries end the process without a message, and the command that raises them; "" if none does."""
    if resource is None:
        return ""
    for name, kind, least, command in LIMITS:
        limit = resource.getrlimit(getattr(resource, name))[0]
        if limit != resource.RLIM_INFINITY and limit < least:
            return f"this shell limits the {kind} to {limit >> 10} kB, and {least >> 10} are needed: {command}"
    return _refused_threads()


def refused_library(error: BaseException) -> str:
    """Why a library could not be loaded, where the address space is limited; "" for other errors and without a limit."""
    if resource is None or "shared object" not in str(error):
        return ""
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return ""
    return f"a library does not fit into the address space, which this shell limits to {limit >> 10} kB: ulimit -v unlimited"


def _refused_threads() -> str:
    """Why the threads of the libraries cannot all be started, which ends the process without a message; "" if they can."""
    count, leave = min(3 * (os.cpu_count() or 1) + 2, 100), threading.Event()
    threads: list[threading.Thread] = []
    try:
        for _ in range(count):
            threads.append(threading.Thread(target=leave.wait, daemon=True))
            threads[-1].start()
    except RuntimeError:
        return f"the system allows {len(threads) - 1} more threads, and {count} are needed: end other processes, or raise ulimit -u"
    finally:
        leave.set()
    for thread in threads:
        thread.join()
    return ""


def free_memory() -> int | None:
    """Bytes that this process can still take: of the system, of its control group and of `ulimit -v`; None where none is known."""
    return min((value for value in (_of_system(), _of_group(), _of_limit()) if value is not None), default=None)


def _of_system() -> int | None:
    try:
        match = re.search(r"^MemAvailable:\s*(\d+) kB", Path("/proc/meminfo").read_text(encoding="ascii"), re.MULTILINE)
    except OSError:
        return None
    return 1024 * int(match[1]) if match else None


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


def strip_plans(scene: ir.Scene, plan: Plan, path: Path, memory: int | None) -> tuple[list[Plan], int]:
    """(the plan, or the plans of its strips for a picture larger than memory; the peak memory of this process that is expected).

    Where kernels must be compiled, the process takes memory_estimate.COMPILER more. Room is left for it.
    Raises UsageError for options that exclude strips, and for a picture that does not fit.
    """
    from ..render import large_images, memory_estimate
    from ..render.image import image_files

    linear, taken = path.suffix.lower() in image_files.LINEAR, resident_memory()
    needs, free = memory_estimate.estimate(scene, plan, linear), free_memory() if memory is None else memory
    x0, y0, x1, y1 = plan["crop"]
    pixels = (x1 - x0) * (y1 - y0)
    estimate, most = needs.total(pixels), large_images.MAX_PIXELS
    limit = None if free is None else free - memory_estimate.COMPILER - (0 if memory is None else taken)
    if limit is not None and (memory is not None or needs.pixel * pixels > SMALL_PICTURE):
        most = needs.most_pixels(limit)
    parts = large_images.strip_plans(plan, max(most, 0))
    if len(parts) == 1:
        return parts, max(taken + estimate, peak_memory() or 0)
    why, strip = large_images.refusal(plan, exposed=not linear), needs.total((x1 - x0) * (parts[0]["crop"][3] - y0))
    size = f"a picture of {plan['size'][0]} by {plan['size'][1]} pixels"
    if free is not None and limit is not None and most < large_images.MAX_PIXELS:
        takes = estimate + memory_estimate.COMPILER + (0 if memory is None else taken)
        needed = f"{size} takes about {takes / 1e9:.2g} GB of memory, and {free / 1e9:.2g} GB are {'free' if memory is None else 'allowed'}"
        if why:
            raise click.UsageError(f"{needed}; in strips it takes less, but {why}")
        if strip > limit:
            raise click.UsageError(f"{needed}; a strip of it does not fit either: give a smaller --size")
    elif why:
        raise click.UsageError(f"{size} is rendered in strips: {why}")
    return parts, max(taken + strip, peak_memory() or 0)
