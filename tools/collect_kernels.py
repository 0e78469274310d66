"""Copies compiled kernels and their separate helpers, of this target, and the digests of all modules, to the folder `prebuilt`.

The folder is the argument. Kernels that were compiled from other sources stay behind.
Kernels that a process without Numba cannot load are an error.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from maquette.render.jit import cache_key, kernel_cache, kernel_file, prebuilt


def main() -> None:
    root, name = Path(sys.argv[1]), prebuilt.folder_name()
    assert name is not None
    target = root / name
    target.mkdir(parents=True)
    names = [path.name for path in kernel_cache.CACHE.glob(f"*{kernel_cache.SUFFIX}") if kernel_cache.is_current(path.name)]
    copied = set[str]()
    while names:
        file = names.pop()
        if file not in copied:
            copied.add(file)
            code = kernel_file.unpacked(file, (kernel_cache.CACHE / file).read_bytes())
            if code is None or any(name.startswith(("numba_", "NRT_")) for name in code.needs):
                sys.exit(f"{file} cannot be loaded: it is damaged, or calls functions of Numba")
            shutil.copy(kernel_cache.CACHE / file, target / file)
            names += code.helpers
    (root / "sources.json").write_text(cache_key.ship(), encoding="utf-8")


if __name__ == "__main__":
    main()
