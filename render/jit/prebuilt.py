"""Compiled code that comes with the package, in the read-only folder `prebuilt`: one folder a fixed target, filled by tools/wheel.py.

It does not depend on the versions of Numba and LLVM, as nothing but kernel_file.py reads it. compiler.py checks that newly compiled kernels
call each other in the same way. Only source checkouts have no such folder.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from ..simd import target
from . import cache_key

ROOT = cache_key.ROOT / "prebuilt"


def folder_name() -> str | None:
    """Name of the folder for the target of this process; None for targets that no package has code for."""
    native = target.LEVEL.cpu not in (*(level.cpu for level in target.X86_LEVELS.values()), "generic")
    return None if native or target.CHECKED else f"{target.ISA}-{target.LEVEL.cpu}"


@cache
def folder() -> Path | None:
    """The folder for the target of this process, if the package has one."""
    name = folder_name()
    return ROOT / name if name is not None and (ROOT / name).is_dir() else None


def read(name: str) -> bytes | None:
    """The content of a file; None where the package lacks it."""
    path = find(name)
    try:
        return path.read_bytes() if path is not None else None
    except OSError:
        return None


def find(name: str) -> Path | None:
    """The file of a name, if the package has it."""
    directory = folder()
    return directory / name if directory is not None and (directory / name).is_file() else None
