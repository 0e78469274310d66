"""Trees of meshes that were built before: in memory, and of large meshes on disk, by what they are made from.

A scene that is drawn again after something moved, or was typed, builds only the tree over its instances anew; a large mesh that was
drawn yesterday is read faster than its tree is built; one whose corners moved keeps the shape of its tree where that is good.
Files lie beside the kernels that read them, so that none outlives its form.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import threading
from collections import OrderedDict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...jit import cache_key, kernel_cache
from . import refit, wide_bvh
from .wide_bvh import LEAF, NODE, WIDTH, Wide

LARGE = 50_000  # triangles from which on a tree is kept on disk
IN_MEMORY = 256 << 20  # bytes of trees at most
ON_DISK = 2 << 30
_known: OrderedDict[str, Wide] = OrderedDict()
_shapes: OrderedDict[str, tuple[Wide, float]] = OrderedDict()  # by triangles alone: the tree last built for them, and what it cost
_lock = threading.Lock()


def cached_mesh_bvh(positions: NDArray[np.float32], triangles: NDArray[np.int32], threads: int = 0) -> Wide:
    """The tree of a mesh as wide.build makes it, or one refitted to it that is nearly as good; it is not to be changed."""
    key = hashlib.sha256(_numbers(len(positions), len(triangles)))
    key.update(np.ascontiguousarray(triangles).data)
    shape = key.hexdigest()
    key.update(np.ascontiguousarray(positions).data)
    name = key.hexdigest()
    with _lock:
        known = _known.get(name)
        if known is not None:
            _known.move_to_end(name)
            return known
    file = kernel_cache.CACHE / "trees" / f"{cache_key.key(__name__)}-{name}"
    made = read(file) if len(triangles) >= LARGE else None
    if made is None:
        made = _refitted(shape, positions, triangles)
    if made is None:
        made = wide_bvh.build(positions, triangles, threads)
        with _lock:
            _shapes[shape] = made, refit.cost(made)
            _shapes.move_to_end(shape)
            while len(_shapes) > 1 and sum(each.nbytes for each, _ in _shapes.values()) > IN_MEMORY:
                _shapes.popitem(last=False)
        if len(triangles) >= LARGE:
            write(file, made)
    with _lock:
        _known[name] = made
        while len(_known) > 1 and sum(each.nbytes for each in _known.values()) > IN_MEMORY:
            _known.popitem(last=False)
    return made


def _refitted(shape: str, positions: NDArray[np.float32], triangles: NDArray[np.int32]) -> Wide | None:
    """The tree last built for these triangles round their new places, if there is one and it costs little more than it did."""
    with _lock:
        built = _shapes.get(shape)
    if built is None:
        return None
    made = refit.refitted(built[0], positions, triangles)
    return made if refit.cost(made) <= refit.WORSE * built[1] else None


def clear() -> None:
    """Drop what is in memory."""
    with _lock:
        _known.clear()
        _shapes.clear()


def _numbers(*values: int) -> bytes:
    return np.array(values, np.int64).tobytes()


def read(file: Path) -> Wide | None:
    """The tree in a file; None where there is none, or not a whole one."""
    try:
        with file.open("rb", buffering=0) as stream:
            nodes, leaves = (int(n) for n in np.frombuffer(stream.read(16), np.int64))
            if nodes < 1 or leaves < 0 or os.fstat(stream.fileno()).st_size != 16 + 4 * (nodes * (NODE + WIDTH) + leaves * LEAF):
                return None
            made = wide_bvh.allocate(nodes, leaves)
            for part in made:
                if stream.readinto(part.data.cast("B")) != part.nbytes:
                    return None
        os.utime(file)
    except (OSError, ValueError):
        return None
    return made


def write(file: Path, made: Wide) -> None:
    """Put a tree into a file, whole or not at all; where that cannot be, nothing happens. The longest unread ones make room for it."""
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        others = sorted(((each.stat().st_mtime, each) for each in file.parent.iterdir()), reverse=True)
        room = ON_DISK - made.nbytes
        for _, other in others:
            room -= other.stat().st_size
            if room < 0:
                other.unlink()
        handle, name = tempfile.mkstemp(dir=file.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(_numbers(len(made.nodes), len(made.leaves)))
                for part in made:
                    stream.write(np.ascontiguousarray(part).data.cast("B"))
            os.replace(name, file)
        except BaseException:
            os.unlink(name)
            raise
    except OSError:
        return
