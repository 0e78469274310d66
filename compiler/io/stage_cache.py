"""Results of costly stages of a compilation, kept by content, so that the next compilation of an edited scene takes them again."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from ...lang.diagnostics import Diagnostics

T = TypeVar("T")
_current: ContextVar[StageCache | None] = ContextVar("stage_cache", default=None)


class StageCache:
    """Results by stage and digest of all inputs. Those that the last compilation did not use are dropped after it."""

    def __init__(self) -> None:
        self.made: Counter[str] = Counter()
        """How often each stage has run."""
        self.reused: Counter[str] = Counter()
        """How often a result of each stage was taken again."""
        self._kept: dict[tuple[str, bytes], Any] = {}
        self._used: set[tuple[str, bytes]] = set()
        self._digests: dict[int, tuple[np.ndarray, bytes]] = {}  # of arrays in results, by identity: these are read-only

    @contextmanager
    def compiling(self) -> Iterator[None]:
        """The block compiles a scene with this cache. After an exception all results stay."""
        token, self._used = _current.set(self), set()
        try:
            yield
            self._kept = {key: value for key, value in self._kept.items() if key in self._used}
            arrays = {id(array) for value in self._kept.values() for array in _arrays(value)}
            self._digests = {key: entry for key, entry in self._digests.items() if key in arrays}
        finally:
            _current.reset(token)

    def get(self, stage: str, inputs: tuple[Any, ...], make: Callable[[], T]) -> T:
        """The result of a stage for these inputs."""
        key = stage, digest(*inputs)
        self._used.add(key)
        if key in self._kept:
            self.reused[stage] += 1
            return self._kept[key]
        result = make()
        self.made[stage] += 1
        for array in _arrays(result):
            array.flags.writeable = False
            if array.flags.c_contiguous:
                self._digests[id(array)] = array, _hash(array)
        self._kept[key] = result
        return result

    def kept_digest(self, array: np.ndarray) -> bytes | None:
        """The digest of an array of a result."""
        entry = self._digests.get(id(array))
        return entry[1] if entry is not None and entry[0] is array else None


def is_active() -> bool:
    """Whether results are kept, so that the digests of their inputs are worth their time."""
    return _current.get() is not None


def cached(stage: str, inputs: tuple[Any, ...], make: Callable[[], T]) -> T:
    """make(), or its result for equal inputs if the last compilation has kept one. Its arrays are read-only then.

    Inputs are arrays, bytes, texts, numbers, None, and tuples and dataclasses of these.
    """
    cache = _current.get()
    return make() if cache is None else cache.get(stage, inputs, make)


def cached_read(stage: str, inputs: tuple[Any, ...], diagnostics: Diagnostics, read: Callable[[Diagnostics], T]) -> T:
    """Like `cached`, for a reader that adds diagnostics: a result that is taken again adds those of its first time."""

    def make() -> tuple[T, list[Any]]:
        messages = Diagnostics()
        return read(messages), messages.items

    if _current.get() is None:
        return read(diagnostics)
    result, items = cached(stage, inputs, make)
    diagnostics.items.extend(items)
    return result


def digest(*inputs: Any) -> bytes:
    """SHA-256 of values, arrays with their types and shapes."""
    hashed = hashlib.sha256()
    for value in inputs:
        _add(hashed, value)
    return hashed.digest()


def _add(hashed: Any, value: Any) -> None:
    if isinstance(value, np.ndarray):
        cache = _current.get()
        hashed.update((cache.kept_digest(value) if cache is not None else None) or _hash(value))
    elif isinstance(value, bytes):
        hashed.update(b"b%d:" % len(value))
        hashed.update(value)
    elif isinstance(value, tuple):
        hashed.update(b"t%d:" % len(value))
        for item in value:
            _add(hashed, item)
    elif is_dataclass(value):
        hashed.update(type(value).__qualname__.encode())
        for part in fields(value):
            _add(hashed, getattr(value, part.name))
    elif value is None or isinstance(value, str | int | float):
        hashed.update(f"{type(value).__name__} {value!r};".encode())
    else:
        raise TypeError(f"no digest of a {type(value).__name__}")


def _hash(array: np.ndarray) -> bytes:
    values = np.ascontiguousarray(array)
    hashed = hashlib.sha256(f"{values.dtype.str}{values.shape}".encode())
    hashed.update(values.data if values.size else b"")
    return hashed.digest()


def _arrays(value: Any) -> Iterator[np.ndarray]:
    """The arrays in tuples and dataclasses."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from _arrays(item)
    elif is_dataclass(value):
        for part in fields(value):
            yield from _arrays(getattr(value, part.name))
