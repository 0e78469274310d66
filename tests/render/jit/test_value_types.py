"""Types of values: equal types are one object, they survive plain data, and kernels read arguments and return results by them."""

from __future__ import annotations

import json
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.render.jit import loader, value_types
from maquette.render.jit.kernel import kernel
from maquette.render.jit.packed_struct import Handle
from maquette.render.jit.value_types import typeof
from maquette.render.types import Tile, View


class Inner(NamedTuple):
    a: Any
    b: Any


class Outer(NamedTuple):
    inner: Inner
    flag: bool
    nothing: None
    array: Any


VALUES = [
    1, 1.5, True, None, np.float32(2), np.int32(3), np.uint8(4), (1, 2.0), (1, (2.0, None)), np.zeros(3),
    np.zeros((2, 3), np.int32), np.zeros((4, 4))[:, 1:], np.asfortranarray(np.zeros((2, 3))), np.broadcast_to(np.zeros(3), (2, 3)),
    Tile(0, 1, 2, 3), Handle(Inner(np.zeros((2, 3)), 1)), Handle(Inner(Handle(Inner(np.zeros(2), 2.0)), Inner(1.5, False))),
]  # fmt: skip


@pytest.mark.parametrize("value", VALUES, ids=lambda value: typeof(value).text[:60])
def test_types_survive_plain_data(value: Any) -> None:
    kind = typeof(value)
    assert value_types.from_plain(json.loads(json.dumps(kind.plain))) is kind
    assert typeof(value) is kind


def test_types_of_different_values_differ() -> None:
    texts = Counter(typeof(value).text for value in VALUES)
    assert max(texts.values()) == 1


def test_vectors_survive_plain_data() -> None:
    kind = value_types.tuple_of(value_types.vector("f", 64, 8), value_types.vector("m", 32, 16))
    assert value_types.from_plain(kind.plain) is kind


@pytest.mark.parametrize(
    "data", [["named", "maquette.render.types", "Tile", ["x"], []], ["named", "maquette.nothing", "Tile", [], []], ["other"], []]
)
def test_other_data_are_no_types(data: Any) -> None:
    with pytest.raises((ValueError, LookupError, ImportError, AttributeError, TypeError)):
        value_types.from_plain(data)


def test_kernels_take_no_text() -> None:
    with pytest.raises(TypeError, match="a kernel takes no str"):
        typeof("text")


@kernel
def give_back(i, x, flag, nested, nothing):
    return i, x, flag, nested, nothing


NUMBERS = st.integers(-(2**63), 2**63 - 1), st.floats(width=64, allow_nan=False), st.booleans()


@settings(deadline=None)  # the first call compiles
@given(*NUMBERS, *NUMBERS)
def test_numbers_pass_through(i: int, x: float, flag: bool, j: int, y: float, other: bool) -> None:
    arguments = i, x, flag, Inner(j, (y, other)), None
    results = give_back(*arguments)
    assert results == arguments
    assert type(results[3]) is Inner
    assert [type(each) for each in results] == [type(each) for each in arguments]


@kernel
def sizes(x, y):
    return np.float32(x) + y, np.int32(y), np.uint8(x)


def test_narrow_numbers_pass_through() -> None:
    assert sizes(np.float32(1.5), np.int32(-7)) == (-5.5, -7, 1)
    assert sizes(np.uint64(2**63 + 5), np.int8(3))[2] == 5


@kernel
def element(array, row, column):
    return array[row, column], array.shape[0], array.shape[1], array.size


@pytest.mark.parametrize("make", [lambda x: x, lambda x: x.T, lambda x: x[::2, 1::3], np.asfortranarray, lambda x: x[::-1]])
def test_arrays_of_all_layouts_are_read_in_place(make: Any) -> None:
    array = make(np.arange(42.0).reshape(6, 7))
    assert element(array, 0, 0)[1:] == (*array.shape, array.size)
    for row in range(array.shape[0]):
        for column in range(array.shape[1]):
            assert element(array, row, column)[0] == array[row, column]


@kernel
def fill(outer, value):
    outer.array[:] = value + outer.inner.a


def test_arrays_in_tuples_are_written_in_place() -> None:
    array = np.zeros(5, np.float32)
    assert fill(Outer(Inner(2, 3.0), True, None, array), 40.0) is None
    assert array.tolist() == [42.0] * 5


@kernel
def scaled(x, factor=3.0, add=1):
    return x * factor + add


def test_defaults_and_names_of_arguments() -> None:
    assert scaled(2.0) == 7.0
    assert scaled(2.0, add=5) == 11.0
    assert scaled(x=2.0, factor=10.0) == 21.0
    with pytest.raises(TypeError, match="missing a required argument: 'x'"):
        scaled()


@kernel
def calls(x):
    return scaled(x, 2.0, 1) + scaled(x, 3.0, 1)


def test_a_kernel_calls_a_kernel_by_its_name() -> None:
    assert calls(5.0) == 27.0


@kernel
def checked(x):
    if x < 0:
        raise ValueError("negative")
    return np.sqrt(x)


def test_an_error_in_a_kernel_is_raised() -> None:
    assert checked(4.0) == 2.0
    with pytest.raises(loader.KernelError, match="the kernel checked ended with status 1"):
        checked(-1.0)


@kernel
def allocates(n):
    total = 0.0
    for k in range(n):
        room = np.zeros(k + 1, np.float32)
        room[k] = k
        total += room.sum()
    return total


@pytest.mark.long
def test_kernels_allocate_and_free_memory() -> None:
    import resource

    assert allocates(3) == 3.0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert allocates(20_000) == sum(range(20_000))  # 800 MB altogether
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@kernel
def no_result(x):
    return x


def test_arrays_are_no_results() -> None:
    with pytest.raises(TypeError, match="a kernel does not return array"):
        no_result(np.zeros(3))


@kernel
def count_rows(array):
    return len(array)


def test_arrays_may_be_empty() -> None:
    assert count_rows(np.zeros((0, 3))) == 0


def test_a_view_is_a_tuple_of_words() -> None:
    words: list[Any] = []
    view = View(2, 30, 40)
    typeof(view).pack(view, words)
    assert words == [2, 30, 40]
