"""Copies the compiled kernels of this target, and the digests of all modules, to the folder `prebuilt` given as the argument.

Kernels that were compiled from other sources stay behind.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from maquette.render.jit import cache_key, kernel_cache, prebuilt


def main() -> None:
    root, name = Path(sys.argv[1]), prebuilt.folder_name()
    assert name is not None
    target = root / name
    target.mkdir(parents=True)
    for path in kernel_cache.CACHE.glob(f"*{kernel_cache.SUFFIX}"):
        if kernel_cache.is_current(path.name):
            shutil.copy(path, target / path.name)
    (root / "sources.json").write_text(cache_key.ship(), encoding="utf-8")


if __name__ == "__main__":
    main()
