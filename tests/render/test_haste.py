"""What makes Numba's compiler quicker gives the same answers as Numba's own code."""

from __future__ import annotations

import gc

from maquette.render import haste
from numba.core import compiler_lock, event, ir
from numba.core.compiler import Flags, run_frontend


def sample(a, b):
    total = [a, b][0]
    for k in range(3):
        total += max(a, {"x": b}["x"], k) if a > b else (a, b)[1]
    return total


def all_values(config: Flags) -> dict[str, object]:
    return {name: getattr(config, name) for name in config.options}


def test_flags_are_compared_by_all_their_values() -> None:
    one, other = Flags(), Flags()
    assert haste.values(one) == all_values(one)
    assert one == other
    assert hash(one) == hash(other)
    one.nrt = True  # pyright: ignore[reportAttributeAccessIssue]
    assert haste.values(one) == all_values(one)
    assert one != other


def slowly(value: object) -> list[ir.Var]:
    if isinstance(value, ir.Var):
        return [value]
    if isinstance(value, ir.Inst):
        return value.list_vars()
    parts = value if isinstance(value, list | tuple) else value.values() if isinstance(value, dict) else ()
    return [found for part in parts for found in slowly(part)]


def test_the_same_variables_are_found_in_statements() -> None:
    statements = [each for block in run_frontend(sample).blocks.values() for each in block.body]
    assert len(statements) > 20
    for each in statements:
        assert haste.variables(each, each.__dict__) == slowly(each.__dict__)
    assert sum(len(each.list_vars()) for each in statements) > 40


def test_only_the_outermost_lock_is_told_of_and_garbage_is_looked_for_again_after_it() -> None:
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


def test_whoever_does_not_collect_garbage_still_does_not() -> None:
    gc.disable()
    try:
        with compiler_lock.global_compiler_lock:
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_what_a_version_of_numba_has_no_more_stays_away() -> None:
    class Elsewhere:
        pass

    replaced = haste.REPLACED
    try:
        haste.REPLACED = ((Elsewhere, "values", haste.values, ("options",)),)
        haste.make()
    finally:
        haste.REPLACED = replaced
    assert not hasattr(Elsewhere, "values")
