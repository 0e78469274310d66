"""Arena memory: reused by the next caller, never shared by two, limited to the requested size."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
import pytest
from maquette.render.jit import arena


@pytest.fixture(autouse=True)
def _empty_arena(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as context:
        context.setattr(arena, "MAX_RETAINED", 0)
        borrow(64)


def borrow(size: int) -> int:
    with arena.arena(size) as memory:
        return memory.empty((1,), np.uint8).ctypes.data


def watched(array: Any) -> weakref.ref[Any]:
    """A reference to the memory of an array's block: None once it is freed."""
    return weakref.ref(array.base)


def test_a_block_is_reused_and_replaced_by_a_larger_one() -> None:
    first = borrow(1 << 16)
    assert borrow(1 << 10) == borrow(1 << 16) == first
    more = borrow(1 << 23)
    assert more != first
    assert borrow(1 << 16) == more


def test_a_large_block_is_not_retained(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arena, "MAX_RETAINED", 1 << 20)
    with arena.arena(1 << 20) as small:
        retained = watched(small.empty((1,), np.uint8))
    del small
    assert retained() is not None
    with arena.arena(1 << 21) as large:
        freed = watched(large.empty((1,), np.uint8))
    del large
    assert freed() is None


def test_nested_arenas_have_their_own_blocks() -> None:
    with arena.arena(64) as outer, arena.arena(64) as inner:
        a, b = outer.empty((64,), np.uint8), inner.empty((64,), np.uint8)
        blocks = watched(a), watched(b)
    assert a.ctypes.data != b.ctypes.data
    del outer, inner, a, b
    assert sum(block() is not None for block in blocks) == 1


def test_arrays_are_consecutive_and_aligned_to_cache_lines() -> None:
    with arena.arena(arena.size_of((3, 5), np.float64) + arena.size_of((7,), np.int32)) as memory:
        first, second = memory.empty((3, 5), np.float64), memory.empty((7,), np.int32)
        first[:], second[:] = 1.5, 7
        assert first.sum() == 22.5
        assert first.ctypes.data % 64 == second.ctypes.data % 64 == 0
        with pytest.raises(ValueError, match="too small"):
            memory.empty((1,), np.uint8)
