"""Cache directory of compiled kernels and reference pictures."""

from __future__ import annotations

import os
from pathlib import Path


def cache_root() -> Path:
    """The cache directory: MAQUETTE_CACHE, else `maquette` in the user's cache directory."""
    asked = os.environ.get("MAQUETTE_CACHE")
    if asked:
        return Path(asked)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "maquette"
