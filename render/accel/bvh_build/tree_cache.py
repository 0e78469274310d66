"""Cache of mesh BVHs by content: in memory, and on disk for large meshes.

A redraw after an edit builds only the BVH over instances. The BVH of a large mesh is read faster than built. A mesh whose vertices moved is
refitted where that is good enough. Files stand in the folder of the kernels that read them, so none outlives its format.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections import Counter, OrderedDict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ....compiler.io.replace_file import replacing
from ...jit import cache_folder, cache_key, cancellation, kernel_cache
from . import refit, wide_bvh
from .wide_bvh import LEAF, NODE, WIDTH, Wide

LARGE = 50_000  # triangles from which on a BVH is stored on disk
IN_MEMORY = 256 << 20  # bytes of BVHs in memory, at most
_known: OrderedDict[str, Wide] = OrderedDict()
_shapes: OrderedDict[str, tuple[Wide, float]] = OrderedDict()  # by hash of the triangles: the last BVH built and its cost
_lock = threading.Lock()
COUNTS: Counter[str] = Counter()
"""BVHs of meshes that this process has "built", "refitted" and "read" from disk."""


def cached_mesh_bvh(positions: NDArray[np.float32], triangles: NDArray[np.int32], threads: int = 0) -> Wide:
    """The BVH of a mesh as by wide_bvh.build, or a refitted one of similar cost. Callers must not change it."""
    key = hashlib.sha256(_numbers(len(positions), len(triangles)))
    key.update(np.ascontiguousarray(triangles).data)
    shape = key.hexdigest()
    key.update(np.ascontiguousarray(positions).data)
    name = key.hexdigest()
    with _lock:
        cached = _known.get(name)
        if cached is not None:
            _known.move_to_end(name)
            return cached
    file = kernel_cache.CACHE / "trees" / f"{cache_key.key(__name__)}-{name}"
    tree = read(file) if len(triangles) >= LARGE else None
    how = "read"
    if tree is None:
        tree, how = _refit_last(shape, positions, triangles), "refitted"
    if tree is None:
        cancellation.check()
        how = "built"
        tree = wide_bvh.build(positions, triangles, threads)
        with _lock:
            _shapes[shape] = tree, refit.cost(tree)
            _shapes.move_to_end(shape)
            while len(_shapes) > 1 and sum(each.nbytes for each, _ in _shapes.values()) > IN_MEMORY:
                _shapes.popitem(last=False)
        if len(triangles) >= LARGE:
            write(file, tree)
    with _lock:
        COUNTS[how] += 1
        _known[name] = tree
        while len(_known) > 1 and sum(each.nbytes for each in _known.values()) > IN_MEMORY:
            _known.popitem(last=False)
    return tree


def _refit_last(shape: str, positions: NDArray[np.float32], triangles: NDArray[np.int32]) -> Wide | None:
    """The last BVH of these triangles, refitted, if there is one and its cost stays close to that of the build."""
    with _lock:
        built = _shapes.get(shape)
    if built is None:
        return None
    tree = refit.refit(built[0], positions, triangles)
    return tree if refit.cost(tree) <= refit.MAX_COST_RATIO * built[1] else None


def clear() -> None:
    """Empty the cache in memory."""
    with _lock:
        _known.clear()
        _shapes.clear()


def _numbers(*values: int) -> bytes:
    return np.array(values, np.int64).tobytes()


def read(file: Path) -> Wide | None:
    """Read a BVH from a file; None without a complete one."""
    try:
        with file.open("rb", buffering=0) as stream:
            nodes, leaves = (int(n) for n in np.frombuffer(stream.read(16), np.int64))
            if nodes < 1 or leaves < 0 or os.fstat(stream.fileno()).st_size != 16 + 4 * (nodes * (NODE + WIDTH) + leaves * LEAF):
                return None
            tree = wide_bvh.allocate(nodes, leaves)
            for part in tree:
                if stream.readinto(part.data.cast("B")) != part.nbytes:
                    return None
        os.utime(file)
    except (OSError, ValueError):
        return None
    return tree


def write(file: Path, tree: Wide) -> None:
    """Write a BVH to a file atomically, where the cache of compiled code has room; errors are ignored."""
    if not cache_folder.make_room(tree.nbytes + 16):
        return
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as partial, partial.open("wb") as stream:
            stream.write(_numbers(len(tree.nodes), len(tree.leaves)))
            for part in tree:
                stream.write(np.ascontiguousarray(part).data.cast("B"))
    except OSError:
        return
