"""Cache directory of parser tables, compiled kernels and reference pictures."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def cache_root() -> Path:
    """The cache directory: MAQUETTE_CACHE, else `maquette` in the user's cache directory."""
    asked = os.environ.get("MAQUETTE_CACHE")
    if asked:
        return Path(asked)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "maquette"


def parser_tables() -> str | None:
    """Path of the cached parser tables; None if the cache directory is not writable."""
    try:
        cache_root().mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return str(cache_root() / f"grammar-{sys.version_info[0]}.{sys.version_info[1]}")
