"""Where maquette keeps what it has worked out: parser tables, compiled kernels, reference pictures."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def cache_root() -> Path:
    """The folder for what can be worked out again: MAQUETTE_CACHE, else `maquette` in the user's cache folder."""
    asked = os.environ.get("MAQUETTE_CACHE")
    if asked:
        return Path(asked)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "maquette"


def parser_tables() -> str | None:
    """The file of the parser's tables; None where there is nowhere to write."""
    try:
        cache_root().mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return str(cache_root() / f"grammar-{sys.version_info[0]}.{sys.version_info[1]}")
