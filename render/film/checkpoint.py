"""Checkpoints: the state of a picture on disk, from which rendering goes on with the same result.

A checkpoint is a .npz file of arrays, without pickles. It holds the sums of finished batches alone: a batch that a thread was rendering
is rendered again. It fits one scene, version and plan, which its key identifies.
"""

from __future__ import annotations

import functools
import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...compiler import ir
from ...compiler.io import array_files
from ...compiler.io.replace_file import check_replaceable, replacing
from ...compiler.plan.plan import Plan

FORMAT = 2
SHARE = 0.02  # most of the time that writing may take
_DAMAGE = (ValueError, KeyError, TypeError, AttributeError, RuntimeError, MemoryError, array_files.ArrayFileError)
FREE = ("threads", "budget")  # decisions that a resumed render may change


class State(NamedTuple):
    """A picture between two batches of each tile."""

    arrays: dict[str, np.ndarray]
    numbers: dict[str, Any]  # as JSON


class Keeper:
    """Writes the checkpoints of one picture, and reads the one to go on from."""

    def __init__(
        self, path: Path, key: Callable[[], str], first: float, every: float, resume: bool, fail: Callable[[OSError], Any] = lambda _: None
    ) -> None:
        """`first`: seconds to the first checkpoint; `every`: seconds between two, or more where writing takes long.

        `fail` is called, from any thread, with the error of a checkpoint that cannot be written.
        """
        self.path, self._key, self._fail = path, functools.cache(key), fail  # the key of a large scene takes a second
        self.saved_state = load(path, self._key()) if resume and exists(path) else None  # None: begin
        self._every = every
        self._next = time.monotonic() + first

    def due(self) -> bool:
        """Whether it is time for a checkpoint."""
        return time.monotonic() >= self._next

    def save(self, state: State) -> None:
        """Write a checkpoint in place of the last one. A disk that is full keeps the last one."""
        began = time.monotonic()
        try:
            with replacing(self.path) as partial, open(partial, "wb") as file:
                save(file, self._key(), state)
        except OSError as fault:
            self._fail(fault)
        now = time.monotonic()
        self._next = now + max(self._every, (now - began) / SHARE)

    def remove(self) -> None:
        """Remove the checkpoint of a finished picture."""
        self.path.unlink(missing_ok=True)


def exists(path: Path, protected: Iterable[Path] = ()) -> bool:
    """Whether a checkpoint stands at `path`. Raises OSError where none can: for a name that no file can have, as check_replaceable does."""
    try:
        check_replaceable(path, protected)
        return path.is_file()
    except OSError as fault:
        why = f"{path}: {fault.strerror}; shorten the name of the picture" if fault.strerror else f"{fault}; remove it"
        raise OSError(f"{why}, or give --checkpoint off") from None


def key_of(scene: ir.Scene, plan: Plan, version: str) -> str:
    """The key of a picture: equal for equal scenes, plans and versions."""
    digest = hashlib.blake2b(digest_size=16)
    decided = {name: value for name, value in plan.values().items() if name not in FREE}
    digest.update(json.dumps([FORMAT, version, decided], sort_keys=True, default=str).encode())
    for name, array in _arrays(scene.tables, ""):
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).view(np.uint8).reshape(-1).data if array.size else b"")
    return digest.hexdigest()


def _arrays(value: Any, name: str) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(value, np.ndarray):
        yield name, value
    elif hasattr(value, "_fields"):
        for field in value._fields:
            yield from _arrays(getattr(value, field), f"{name}.{field}")


def save(file: Any, key: str, state: State) -> None:
    """Write a checkpoint to an open binary file."""
    about = {"format": FORMAT, "key": key, "arrays": sorted(state.arrays), **state.numbers}
    head = np.frombuffer(json.dumps(about).encode(), np.uint8)
    np.savez(file, **{"head": head, **state.arrays})  # pyright: ignore[reportArgumentType]


def load(path: Path, key: str) -> State | None:
    """The state in a file; None where there is none, it is damaged, or it is of another picture."""
    try:
        arrays = array_files.read(path)
        numbers = json.loads(arrays.pop("head").tobytes())
        expected = {"format": FORMAT, "key": key, "arrays": sorted(arrays)}
        return State(arrays, numbers) if expected.items() <= numbers.items() else None
    except _DAMAGE:
        return None
