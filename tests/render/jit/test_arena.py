"""Memory that is lent: kept for the next one, never for two at once, and no more than was asked for."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render.jit import arena


@pytest.fixture(autouse=True)
def _empty_arena(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arena, "_retained", [])


def borrow(size: int) -> int:
    with arena.arena(size) as memory:
        return memory.empty((1,), np.uint8).ctypes.data


def test_it_is_kept_for_the_next_and_replaced_by_more() -> None:
    first = borrow(1 << 16)
    assert borrow(1 << 10) == borrow(1 << 16) == first
    more = borrow(1 << 23)
    assert more != first
    assert borrow(1 << 16) == more


def test_too_much_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arena, "MAX_RETAINED", 1 << 20)
    borrow(1 << 21)
    assert not arena._retained


def test_two_at_once_have_their_own() -> None:
    with arena.arena(64) as one, arena.arena(64) as other:
        a, b = one.empty((64,), np.uint8), other.empty((64,), np.uint8)
    assert a.ctypes.data != b.ctypes.data
    assert len(arena._retained) == 1


def test_arrays_stand_one_behind_the_other_in_cache_lines() -> None:
    with arena.arena(arena.size_of((3, 5), np.float64) + arena.size_of((7,), np.int32)) as memory:
        one, two = memory.empty((3, 5), np.float64), memory.empty((7,), np.int32)
        one[:], two[:] = 1.5, 7
        assert one.sum() == 22.5
        assert one.ctypes.data % 64 == two.ctypes.data % 64 == 0
        with pytest.raises(ValueError, match="too small"):
            memory.empty((1,), np.uint8)
