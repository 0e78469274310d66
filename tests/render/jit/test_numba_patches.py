"""Patches of Numba's compiler give the same results as Numba's own code."""

from __future__ import annotations

import gc
import importlib.util
import math
import operator
from functools import partial, wraps
from inspect import signature
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pytest
from llvmlite import ir as llvm
from llvmlite.ir import types as llvm_types
from maquette.render.jit import compiler, numba_patches  # noqa: F401 - which puts it in place
from numba import extending
from numba.core import compiler_lock, event, ir, postproc, types
from numba.core.compiler import Flags, run_frontend
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.core.typing import context as typing_context


def unpatched(module: ModuleType) -> Any:
    """A module loaded a second time: its classes and functions are those of the library."""
    spec = importlib.util.spec_from_file_location(f"{module.__name__}_unpatched", module.__file__ or "")
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


POST_PROCESSOR = unpatched(postproc).PostProcessor
LLVM_TYPE = unpatched(llvm_types).Type
TYPING = unpatched(typing_context).BaseContext


def sample(a, b):
    total = [a, b][0]
    for k in range(3):
        total += max(a, {"x": b}["x"], k) if a > b else (a, b)[1]
    return total


def all_values(config: Flags) -> dict[str, object]:
    return {name: getattr(config, name) for name in config.options}


def test_flags_are_compared_by_all_their_values() -> None:
    first, second = Flags(), Flags()
    assert numba_patches.values(first) == all_values(first)
    assert first == second
    assert hash(first) == hash(second)
    first.nrt = True  # pyright: ignore[reportAttributeAccessIssue]
    assert numba_patches.values(first) == all_values(first)
    assert first != second


def slowly(value: object) -> list[ir.Var]:
    if isinstance(value, ir.Var):
        return [value]
    if isinstance(value, ir.Inst):
        return value.list_vars()
    parts = value if isinstance(value, list | tuple) else value.values() if isinstance(value, dict) else ()
    return [variable for part in parts for variable in slowly(part)]


def test_the_same_variables_are_found_in_statements() -> None:
    statements = [each for block in run_frontend(sample).blocks.values() for each in block.body]
    assert len(statements) > 20
    for each in statements:
        assert numba_patches.variables(each, each.__dict__) == slowly(each.__dict__)
    assert sum(len(each.list_vars()) for each in statements) > 40


def test_only_the_outermost_lock_sends_events_and_garbage_collection_resumes_after_it() -> None:
    lock = compiler_lock.global_compiler_lock
    with event.install_recorder("numba:compiler_lock") as record:
        assert gc.isenabled()
        with lock:
            with lock:
                assert lock.is_locked()
                assert not gc.isenabled()
            assert not gc.isenabled()
        assert gc.isenabled()
    assert len(record.buffer) == 2
    assert not lock.is_locked()


def test_disabled_garbage_collection_stays_disabled() -> None:
    gc.disable()
    try:
        with compiler_lock.global_compiler_lock:
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_patches_without_their_target_are_skipped() -> None:
    class Elsewhere:
        pass

    replaced = numba_patches.REPLACED
    try:
        numba_patches.REPLACED = ((Elsewhere, "values", numba_patches.values, ("options",)),)
        numba_patches.install_patches()
    finally:
        numba_patches.REPLACED = replaced
    assert not hasattr(Elsewhere, "values")


def taking(x: object, loc: object = None) -> None: ...


@wraps(taking)
def wrapped(*args: object) -> None: ...


def test_functions_that_take_loc_are_recognized() -> None:
    for function in (taking, wrapped, slowly, partial(taking, loc=1), print):
        assert numba_patches.has_loc(function) == ("loc" in signature(function).parameters)


def test_del_statements_are_where_numba_puts_them() -> None:
    ours, theirs = run_frontend(sample), run_frontend(sample)
    numba_patches.post_process(postproc.PostProcessor(ours), emit_dels=True)
    POST_PROCESSOR(theirs).run(emit_dels=True)
    said = [str(each) for block in ours.blocks.values() for each in block.body]
    assert said == [str(each) for block in theirs.blocks.values() for each in block.body]
    assert any(text.startswith("del ") for text in said)
    block = next(iter(ours.blocks.values()))
    assert sorted(ours.get_block_entry_vars(block)) == sorted(theirs.get_block_entry_vars(next(iter(theirs.blocks.values()))))


def test_sizes_are_those_of_each_type() -> None:
    data = cpu_target.target_context.target_data  # pyright: ignore[reportAttributeAccessIssue]
    double, three = llvm.DoubleType(), llvm.ArrayType(llvm.DoubleType(), 3)
    named = llvm.global_context.get_identified_type("haste.named")
    if named.is_opaque:
        named.set_body(double, double)
    for kind in (double, three, llvm.IntType(1), llvm.LiteralStructType([double, llvm.IntType(8)]), llvm.VectorType(double, 8), named):
        assert numba_patches.size_of(kind, data) == numba_patches.size_of(kind, data) == LLVM_TYPE.get_abi_size(kind, data)


def test_cached_call_types_depend_on_the_arguments() -> None:
    context: Any = cpu_target.typing_context
    context.refresh()
    add = context.resolve_value_type(operator.add)
    ints = numba_patches.call_type(add, context, (types.int64, types.int64), {})
    assert numba_patches.call_type(add, context, (types.int64, types.int64), {}) is ints
    assert ints.return_type == types.int64
    assert numba_patches.call_type(add, context, (types.float64, types.int64), {}).return_type == types.float64
    with pytest.raises(TypingError, match="No implementation"):
        numba_patches.call_type(add, context, (types.unicode_type, types.int64), {})


def test_events_reach_listeners() -> None:
    with event.install_recorder("haste:test") as record, event.trigger_event("haste:test", data=3):
        pass
    assert [each.is_start for _, each in record.buffer] == [True, False]
    with event.trigger_event("haste:test"):
        pass
    assert len(record.buffer) == 2


class Later:
    """A function that is registered between two compilations."""


def later(a: float) -> float:
    raise NotImplementedError


@pytest.mark.long
def test_a_function_registered_between_two_kernels_is_known_to_the_second() -> None:
    numba.njit(lambda a: abs(a))(1.0)  # whatever is known before
    extending.overload(later)(lambda a: lambda a: 2.0 * a)
    assert numba.njit(lambda a: later(a))(3.0) == 6.0
    extending.overload_attribute(types.Float, "twice")(lambda a: lambda a: 2.0 * a)
    assert numba.njit(lambda a: a.twice)(4.0) == 8.0


@pytest.mark.parametrize(("owner", "name"), [
    (types.Module(np), "sqrt"), (types.Module(np), "pi"), (types.Module(math), "pi"),
    (types.float64[:, ::1], "shape"), (types.float64[:, ::1], "ravel"), (types.float64, "real"), (types.float64, "nothing"),
])  # fmt: skip
def test_attributes_have_the_same_types(owner: types.Type, name: str) -> None:
    typing: Any = cpu_target.typing_context
    expected = TYPING.resolve_getattr(typing, owner, name)
    for _ in range(2):
        resolved = typing.resolve_getattr(owner, name)
        assert type(resolved) is type(expected)
        assert str(resolved) == str(expected)


@pytest.mark.parametrize("value", [math.sqrt, np.sqrt, np, sample, 1, 2.5, (1, 2), np.float32, max, operator.add, later])
def test_constants_have_the_same_types(value: object) -> None:
    typing: Any = cpu_target.typing_context
    try:
        expected: object = TYPING.resolve_value_type(typing, value)
    except ValueError:
        with pytest.raises(ValueError, match="Numba type"):
            typing.resolve_value_type(value)
    else:
        assert typing.resolve_value_type(value) == expected


def test_errors_name_their_source_line() -> None:
    with pytest.raises(TypingError, match=r"(?s)unknown to Numba.*During: typing of call at.*test_numba_patches"):
        numba.njit(lambda a: unknown_to_numba(a))(1.0)


def unknown_to_numba(a: float) -> float:
    raise NotImplementedError


@extending.overload(unknown_to_numba)
def _unknown(a):
    raise TypingError("unknown to Numba")


def test_isinstance_of_types_is_unchanged() -> None:
    assert isinstance(types.float64, types.Number)
    assert not isinstance(types.float64, types.Array)
    assert isinstance(types.float64[:], types.Buffer)
    assert not isinstance(1, types.Type)
    assert issubclass(types.Array, types.Type)
    assert not issubclass(types.Array, types.Number)
