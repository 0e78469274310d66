"""Packed structs: in a kernel they read like the packed tuples, and they keep their arrays alive."""

from __future__ import annotations

import gc
from typing import NamedTuple

import numpy as np
import pytest
from maquette.render.jit.kernel import helper, kernel
from maquette.render.jit.packed_struct import Handle, skip_when_tagged, with_type_tags
from maquette.render.simd import target


class Inner(NamedTuple):
    points: np.ndarray
    count: int
    half: float


class Outer(NamedTuple):
    inner: Inner
    rows: np.ndarray
    masks: np.ndarray
    frames: np.ndarray
    on: bool
    empty: np.ndarray


@kernel
def read(t, i):
    return (
        t.inner.points[i, 2], t.inner.points.shape[0], t.inner.points.shape[1], t.inner.count, t.inner.half,
        t.rows[i], len(t.rows), t.masks[0], t.masks[1], t.frames[i, 1, 2], t.on, len(t.empty),
    )  # fmt: skip


@kernel
def add_up(t):
    total = 0.0
    for i in range(len(t.inner.points)):
        for k in range(t.inner.points.shape[1]):
            total += t.inner.points[i, k]
    return total


@kernel
def write(t, i, value):
    t.rows[i] = value


def make(n: int = 4) -> Outer:
    inner = Inner(np.arange(3.0 * n).reshape(n, 3), -7, 0.5)
    frames = np.arange(12.0 * n, dtype=np.float32).reshape(n, 3, 4)
    return Outer(inner, np.arange(n, dtype=np.int32), np.array([True, False]), frames, True, np.zeros(0))


def test_every_kind_of_field_reads_as_on_the_tuple() -> None:
    assert read(Handle(make()), 2) == (8.0, 4, 3, -7, 0.5, 2, 4, True, False, 30.0, True, 0)


class Table(NamedTuple):
    kind: np.ndarray
    color: np.ndarray


@kernel
def read_row(table, loose, rows):
    """As lanes do that a mask excludes, whose rows are 0."""
    total = 0.0
    for i in range(len(rows)):
        total += table.kind[rows[i]] + table.color[rows[i], 2] + loose[rows[i], 1]
    return total


@pytest.mark.long
@pytest.mark.skipif(target.CHECKED, reason="bounds checks end the process")
def test_a_row_of_a_table_without_rows_is_zero() -> None:
    """A kernel that reads row 0 of an empty table without asking for its length does not end the process."""
    table = Handle(Table(np.zeros(0, np.int32), np.zeros((0, 3))))
    assert read_row(table, np.zeros((0, 2)), np.zeros(3, np.int64)) == 0.0
    assert read_row(table, np.zeros((0, 2)), np.array([100, 1000, 0])) == 0.0


@pytest.mark.long
def test_equal_layouts_share_a_type_for_any_lengths() -> None:
    assert Handle(make(3)).type == Handle(make(9)).type
    compiled = len(add_up.loaded)
    assert add_up(Handle(make(5))) == 105.0
    assert add_up(Handle(make(2))) == 15.0
    assert len(add_up.loaded) <= compiled + 1


def test_other_layouts_are_other_types() -> None:
    other = make()._replace(rows=np.arange(4, dtype=np.int64))
    assert Handle(make()).type != Handle(other).type


def test_kernels_write_through() -> None:
    table = make()
    write(Handle(table), 1, 42)
    assert table.rows[1] == 42


def test_arrays_live_as_long_as_the_handle() -> None:
    handle = Handle(make(1000))
    gc.collect()
    np.full(100_000, np.nan)  # what would be put where a freed array was
    assert add_up(handle) == pytest.approx(3000 * 2999 / 2)


def test_only_contiguous_arrays_are_accepted() -> None:
    table = make()
    with pytest.raises(ValueError, match="frames is not contiguous"):
        Handle(table._replace(frames=table.frames.transpose(0, 2, 1)))


class Other(NamedTuple):
    other: Handle
    count: int


@kernel
def other_row(t, i):
    return t.other.rows[i]


def test_a_nested_handle_can_be_replaced() -> None:
    """Kernels then read the second handle, which stays alive."""
    first, second = make(3), make(4)
    second.rows[1] = 42
    pointing = Handle(Other(Handle(first), 5))
    assert other_row(pointing, 1) == 1
    pointing.point("other", Handle(second))
    assert pointing.tables.other.tables is second
    gc.collect()
    assert other_row(pointing, 1) == 42


@pytest.mark.parametrize("name", ["count", "nothing"])
def test_only_a_handle_can_be_replaced(name) -> None:
    with pytest.raises(ValueError, match=f"{name} is not a handle of that type"):
        Handle(Other(Handle(make()), 5)).point(name, Handle(make()))


def test_a_handle_of_another_type_is_rejected() -> None:
    pointing = Handle(Other(Handle(make()), 5))
    with pytest.raises(ValueError, match="other is not a handle of that type"):
        pointing.point("other", Handle(make()._replace(rows=np.arange(4, dtype=np.int64))))


class Numbers(NamedTuple):
    numbers: np.ndarray


@helper
def _without(handle, x):
    return -x


@skip_when_tagged("no numbers", _without)
@helper
def first_and(handle, x):
    return handle.numbers[0] + x


@kernel
def asked(handle, x):
    return first_and(handle, x)


def test_a_tagged_type_is_the_same_block_with_code_omitted():
    handle = Handle(Numbers(np.array([2.0])))
    untagged, without = handle.type, with_type_tags(handle.type, "no numbers")
    assert untagged.field("no numbers") is None
    assert without.field("numbers") == untagged.field("numbers")
    assert with_type_tags(handle.type, "no numbers") is without
    assert asked(handle, 1.0) == 3.0
    handle.type = without
    assert asked(handle, 1.0) == -1.0
