"""Cache directory of compiled kernels and reference pictures."""

from __future__ import annotations

import os
from pathlib import Path

from .environment import SettingError


def cache_root() -> Path:
    """The cache directory: MAQUETTE_CACHE, else `maquette` in the user's cache directory.

    Code in it is executed. So no relative name leads to another one in each folder: that of MAQUETTE_CACHE raises SettingError, and that of
    XDG_CACHE_HOME counts for nothing, as its specification says.
    """
    chosen = os.environ.get("MAQUETTE_CACHE")
    if chosen:
        if not os.path.isabs(chosen):
            raise SettingError(f"MAQUETTE_CACHE is {chosen}; it can be a full path, such as {os.path.abspath(chosen)}")
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "maquette"
