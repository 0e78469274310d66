"""Loads, stores, gathers, scatters and compression access exactly their elements."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from maquette.render import simd
from maquette.render.jit.kernel import kernel
from maquette.render.jit.packed_struct import Handle
from numba.core.errors import TypingError

from .values import TYPES, compiled

STORED = {**TYPES, np.uint8: "i32", np.bool_: "m32"}
GUARD = 7


def numbers(dtype, shape, seed=0):
    """Small numbers that every type represents."""
    return np.random.default_rng(seed).integers(0, 2 if dtype == np.bool_ else 100, shape).astype(dtype)


def guarded(dtype, count):
    """An array filled with a number that marks unwritten elements."""
    return np.full(count, GUARD, dtype) if dtype != np.bool_ else np.zeros(count, dtype)


@pytest.mark.parametrize(("k", "lanes"), [(2, 16), (4, 16), (8, 16), (4, 8), (8, 8)])
def test_records_are_stored_at_a_stride(k, lanes):
    columns = "".join(f"simd.load(x, {j * lanes}, {lanes}), " for j in range(k))
    run = compiled(f"def run(x, out, step):\n    simd.store_rows(out, 3, step, ({columns}))")
    x, step = numbers(np.float32, k * lanes), k + 2
    out = np.zeros(3 + lanes * step, np.float32)
    run(x, out, step)
    rows = out[3:].reshape(lanes, step)
    assert np.array_equal(rows[:, :k], x.reshape(k, lanes).T)
    assert not out[:3].any()
    assert not rows[:, k:].any()


@kernel
def _copied(x, out, i, n):
    simd.store(out, i + 1, simd.load(x, i, 8))
    simd.masked_store(out, 20, simd.load(x, 0, 8), simd.first_lanes(n, simd.load(x, 0, 8)))
    simd.store(out, 40, simd.masked_load(x, len(x) - n, simd.first_lanes(n, simd.load(x, 0, 8))))


@pytest.mark.parametrize("dtype", STORED)
@pytest.mark.parametrize("n", [0, 1, 5, 8])
def test_loads_and_stores_with_and_without_masks(dtype, n):
    x, out = numbers(dtype, 30), guarded(dtype, 64)
    expected = out.copy()
    _copied(x, out, 3, n)
    expected[4:12], expected[20 : 20 + n], expected[40:48] = x[3:11], x[:n], 0
    expected[40 : 40 + n] = x[30 - n :]
    assert np.array_equal(out, expected)


@kernel
def _columns(x, out, i):
    a, b, c = simd.load3(x, i, 8)
    simd.store(out, 0, a)
    simd.store(out, 8, b)
    simd.store(out, 16, c)


@pytest.mark.parametrize("dtype", STORED)
@pytest.mark.parametrize("i", [0, 1, 6])
def test_rows_of_three_load_as_columns(dtype, i):
    x, out = numbers(dtype, 30), guarded(dtype, 32)
    _columns(x, out, i)
    assert np.array_equal(out[:24].reshape(3, 8), x[i : i + 24].reshape(8, 3).T)
    assert np.array_equal(out[24:], guarded(dtype, 8))


@kernel
def _natural(x, wide, out):
    a = simd.load(x, 0)
    simd.store(out, 0, a)
    simd.store(wide, 0, simd.load(wide, 16, simd.f32) * 2)
    simd.store_aligned(out, 32, simd.load_aligned(x, 16, 8))
    simd.store_past(out, 40, simd.load_aligned(x, 24, 8))
    simd.prefetch(x, 1 << 40)
    simd.write(out, 50, simd.read(x, 20) + 1)
    simd.write(out, 51, 3.9)


@pytest.mark.parametrize("dtype", TYPES)
def test_a_load_has_a_native_width_or_the_requested_type(dtype):
    x, out, wide = simd.aligned_empty(32, dtype), simd.aligned_empty(64, dtype), np.arange(32.0)
    x[:], out[:] = numbers(dtype, 32), GUARD
    _natural(x, wide, out)
    lanes = simd.WIDTH if x.itemsize == 4 else simd.WIDTH64
    assert np.array_equal(out[:lanes], x[:lanes])
    assert np.array_equal(out[32:40], x[16:24])
    assert np.array_equal(out[40:48], x[24:32])
    assert np.array_equal(wide[: simd.WIDTH], np.arange(16, 16 + simd.WIDTH) * 2.0)
    assert out[50] == x[20] + 1
    assert out[51] == dtype(3.9)
    assert np.all(out[lanes:32] == GUARD)


@pytest.mark.parametrize("alignment", [64, 256])
def test_aligned_arrays_are_aligned(alignment):
    for _ in range(20):
        array = simd.aligned_empty((3, 5), np.float32, alignment)
        assert array.ctypes.data % alignment == 0
        assert array.shape == (3, 5)
        assert array.dtype == np.float32


@pytest.mark.parametrize("rows", [3, 1 << 19])
def test_arrays_without_huge_pages_are_aligned_and_writable(rows):
    array = simd.paged_empty((rows, 5), np.float32)
    array[:] = np.arange(5)
    assert array.ctypes.data % 64 == 0
    assert (array.shape, array.dtype, array.flags.c_contiguous) == ((rows, 5), np.float32, True)
    assert array[-1].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_lanes_that_are_not_constant_are_an_error():
    @kernel
    def wrong(x, n):
        return simd.sum_of(simd.load(x, 0, n))

    with pytest.raises(TypingError, match="the lanes of a load must be constant"):
        wrong(np.zeros(16, np.float32), 4)


@kernel
def _gathered(x, places, on, out):
    i, m = simd.load(places, 0, 8), simd.load(on, 0, 8)
    simd.store(out, 0, simd.gather(x, i))
    simd.store(out, 8, simd.gather(x, simd.select(m, i, 1 << 28), m))
    simd.scatter(out, i + 16, simd.load(x, 0, 8), m)
    simd.scatter(out, i * 0 + 60, simd.load(x, 0, 8))


@pytest.mark.parametrize("dtype", STORED)
@pytest.mark.parametrize("index", [np.int32, np.int64])
def test_gathers_and_scatters(dtype, index):
    """Lanes off in the mask are not read, also out of bounds; the last lane wins at equal places."""
    x, places, on = numbers(dtype, 30), np.array([3, 29, 0, 7, 7, 11, 2, 18], index), np.array([1, 0, 1, 1, 0, 1, 0, 1], bool)
    out = guarded(dtype, 64)
    expected = out.copy()
    _gathered(x, places, on, out)
    expected[:8], expected[8:16] = x[places], np.where(on, x[places], 0)
    expected[16 + places[on]] = x[:8][on]
    expected[60] = x[7]
    assert np.array_equal(out, expected)


@kernel
def _compressed(x, on, out, front, lanes):
    total = 0
    for i in range(0, len(x), lanes):
        v, m = simd.load(x, i, 8), simd.load(on, i, 8)
        total += simd.compress_store(out, total, v, m)
        simd.store(front, i, simd.compress(v, m))
    return total


@pytest.mark.parametrize("dtype", STORED)
def test_compressing_keeps_the_order_and_writes_nothing_behind(dtype):
    random = np.random.default_rng(2)
    x, on = numbers(dtype, 8 * 40), random.random(8 * 40) < np.repeat(np.linspace(0, 1, 40), 8)
    compressed = x[on]
    out, front = guarded(dtype, len(x)), np.zeros_like(x)
    assert _compressed(x, on, out, front, 8) == len(compressed)
    assert np.array_equal(out[: len(compressed)], compressed)
    assert np.array_equal(out[len(compressed) :], guarded(dtype, len(x) - len(compressed)))
    for block, chosen, values in zip(front.reshape(-1, 8), on.reshape(-1, 8), x.reshape(-1, 8), strict=True):
        assert np.array_equal(block[: chosen.sum()], values[chosen])


def _rows(k, lanes):
    stores = "".join(f"    simd.store(out, {j * lanes}, c[{j}])\n" for j in range(k))
    return compiled(
        f"def run(x, places, out, back):\n    i = simd.load(places, 0, {lanes})\n    c = simd.gather_rows(x, i, {k})\n"
        f"{stores}    simd.scatter_rows(back, i, c)"
    )


@pytest.mark.parametrize(("k", "lanes"), [(2, 16), (4, 16), (8, 16), (4, 8), (8, 4), (4, 1)])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.int32])
def test_records_become_columns_and_records_again(k, lanes, dtype):
    x = numbers(dtype, 40 * k)
    places = np.random.default_rng(3).permutation(40)[:lanes].astype(np.int32) * k
    out, back = np.zeros((k, lanes), dtype), np.zeros_like(x)
    _rows(k, lanes)(x, places, out.ravel(), back)
    rows = x.reshape(40, k)[places // k]
    assert np.array_equal(out, rows.T)
    assert np.array_equal(back.reshape(40, k)[places // k], rows)
    assert np.count_nonzero(back) == np.count_nonzero(rows)


def test_parts_of_records_begin_at_first():
    """For a constant and a variable `first`."""
    x, places = numbers(np.float32, 320), (np.random.default_rng(4).permutation(20)[:16] * 16).astype(np.int32)
    run = compiled(
        "def run(x, places, first, out):\n    i = simd.load(places, 0, 16)\n    a = simd.gather_rows(x, i, 4, 8)\n"
        "    b = simd.gather_rows(x, i, 2, first)\n    simd.store(out, 0, a[3])\n    simd.store(out, 16, b[1])"
    )
    out = np.zeros(32, np.float32)
    run(x, places, 5, out)
    assert np.array_equal(out, np.concatenate([x[places + 11], x[places + 6]]))


@kernel
def _on_the_stack(n):
    room = simd.stack_array(np.int32, 64)
    for k in range(64):
        room[k] = k * n
    simd.store(room, 8, simd.load(room, 0, 8) + 1)
    total = 0
    for k in range(64):
        total += room[k]
    return total


def test_an_array_on_the_stack():
    expected = np.arange(64) * 3
    expected[8:16] = expected[:8] + 1
    assert _on_the_stack(3) == expected.sum()


# --- array[vector] -------------------------------------------------------------------------------------------------------


@kernel
def _indexed(line, plane, cube, places, out):
    i = simd.load(places, 0, 8)
    j = i % 3
    simd.store(out, 0, line[i])
    simd.store(out, 8, plane[i, 1])
    simd.store(out, 16, plane[4, j])
    simd.store(out, 24, plane[i, j])
    simd.store(out, 32, cube[i, 1, j])
    simd.store(out, 40, cube[2, j, 1])
    simd.store(out, 48, plane[i + 1, j])


@pytest.mark.parametrize("dtype", STORED)
@pytest.mark.parametrize("index", [np.int32, np.int64, np.uint32])
def test_arrays_are_indexed_by_vectors(dtype, index):
    line, plane, cube = numbers(dtype, 30), numbers(dtype, (30, 3), 1), numbers(dtype, (30, 3, 3), 2)
    places = np.array([3, 28, 0, 7, 7, 11, 2, 18], index)
    out = np.zeros(56, dtype)
    _indexed(line, plane, cube, places, out)
    j = places % 3
    expected = [line[places], plane[places, 1], plane[4, j], plane[places, j], cube[places, 1, j], cube[2, j, 1], plane[places + 1, j]]
    assert np.array_equal(out, np.concatenate(expected))


@pytest.mark.parametrize(
    ("dtype", "index", "kind"),
    [
        (np.float64, "i32", "f32"), (np.float32, "i64", "f64"), (np.int64, "i32", "i32"), (np.int32, "i64", "i64"),
        (np.uint8, "i32", "i32"), (np.uint8, "i64", "i64"), (np.bool_, "i64", "m64"), (np.uint64, "i32", "u32"),
    ],
)  # fmt: skip
def test_a_gather_has_the_lane_width_of_its_index(dtype, index, kind):
    look = compiled(f"def run(x):\n    return simd.count(simd.{kind}x4(0) == x[simd.{index}x4(1)])")
    assert look(np.zeros(3, dtype)) == 4


class Table(NamedTuple):
    rows: Any


def test_a_handles_arrays_are_indexed_too():
    @kernel
    def look(table, places, out):
        simd.store(out, 0, table.rows[simd.load(places, 0, 4), 2])

    rows, out = np.arange(30.0).reshape(10, 3), np.zeros(4)
    look(Handle(Table(rows)), np.array([4, 0, 9, 4]), out)
    assert list(out) == [14.0, 2.0, 29.0, 14.0]


def test_arrays_that_are_not_contiguous_are_an_error():
    @kernel
    def look(x):
        return simd.sum_of(x[simd.i64x4(1)])

    with pytest.raises(TypingError):
        look(np.zeros((4, 4))[:, 1])
