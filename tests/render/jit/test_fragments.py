"""Fragments on disk: helpers are compiled once for a machine, and files that are damaged, old or gone change no result."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

HELPERS = '''
from maquette.render.jit.kernel import helper, kernel, make_replace
from maquette.render.jit.packed_struct import Handle
from typing import NamedTuple
import numpy as np

class Table(NamedTuple):
    share: float
    numbers: np.ndarray

class Pair(NamedTuple):
    first: float
    second: float

@helper
def square(x):
    return x * x * FACTOR

def scaled_by(factor):
    @helper
    def scaled(x):
        return factor * x
    return scaled

twice, thrice = scaled_by(2.0), scaled_by(3.0)
replace_second = make_replace(Pair, "second")

@helper
def mean(table):
    return table.share * (table.numbers[0] + table.numbers[1])

@helper
def is_wide(pair):
    return True

@helper
def larger(x, y):
    return max(x, y) if x > 0.0 else None
'''
KERNELS = {
    "squares": "square(x) + twice(square(x)) + thrice(x)",
    "records": "replace_second(Pair(x, x), twice(x)).second + (1.0 if is_wide(Pair(x, x)) else 0.0)",
    "tables": "mean(table) + square(x)",
    "choices": "(1.0 if larger(x, 3.0) is None else 5.0) + thrice(x)",
}
RUN = """
import json, sys
sys.path.insert(0, sys.argv[1])
from maquette.render.jit import lto
compiled = []
def define(self, before=lto.Fragment.define_pipelines):
    compiled.append(self.state.func_id.func_name)
    return before(self)
lto.Fragment.define_pipelines = define
import kernels_of_test as module
table = module.Handle(module.Table(0.5, module.np.array([2.0, 4.0])))
print(json.dumps([[getattr(module, name)(5.0, table) for name in sys.argv[2:]], sorted(compiled)]))
"""
ANSWERS = {"squares": 25.0 + 50.0 + 15.0, "records": 11.0, "tables": 3.0 + 25.0, "choices": 20.0}


class Machine:
    """A folder of kernels, and a module whose kernels new processes call."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def start(self, *names: str, factor: float = 1.0) -> subprocess.Popen[str]:
        """Start a process that calls kernels."""
        kernels = "".join(f"@kernel\ndef {each}(x, table):\n    return {body}\n\n" for each, body in KERNELS.items())
        Path(self.folder, "kernels_of_test.py").write_text(f"FACTOR = {factor}\n{HELPERS}\n{kernels}", encoding="utf-8")
        environment = {**os.environ, "MAQUETTE_CACHE": str(self.folder / "cache")}
        command = [sys.executable, "-c", RUN, str(self.folder), *names]
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)

    def call(self, *names: str, factor: float = 1.0) -> tuple[list[float], list[str]]:
        """(results of kernels, helpers that were compiled for them) in a new process without kernels on disk."""
        self.remove("kernel")
        result, compiled = json.loads(self.start(*names, factor=factor).communicate()[0])
        return result, compiled

    def files(self, ending: str) -> list[Path]:
        """The files of an ending in the folder of compiled code."""
        return sorted(self.folder.glob(f"cache/kernels/*/*.{ending}"))

    def remove(self, ending: str) -> None:
        """Remove the files of an ending."""
        for file in self.files(ending):
            file.unlink()


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """A machine without compiled code."""
    return Machine(tmp_path)


RIGHT = list(ANSWERS.values())


@pytest.mark.long
def test_a_second_process_compiles_no_helper_again(machine: Machine) -> None:
    result, compiled = machine.call(*KERNELS)
    assert result == RIGHT
    assert {"square", "scaled", "replace", "mean", "is_wide", "larger"} <= set(compiled)
    assert machine.call(*KERNELS) == (RIGHT, [])


def test_another_kernel_takes_the_helpers_that_it_shares(machine: Machine) -> None:
    assert "square" in machine.call("squares")[1]
    assert machine.call("tables") == ([ANSWERS["tables"]], ["mean"])


@pytest.mark.long
def test_an_edit_gives_the_new_result(machine: Machine) -> None:
    assert machine.call("squares")[0] == [90.0]
    result, compiled = machine.call("squares", factor=2.0)
    assert result == [50.0 + 100.0 + 15.0]
    assert "square" in compiled
    assert machine.call("squares") == ([90.0], [])


DAMAGES: list[Callable[[bytes], bytes]] = [
    lambda data: b"", lambda data: data[:-5], lambda data: data[:40] + b"~" + data[41:], lambda data: data[::-1],
]  # fmt: skip


@pytest.mark.long
def test_damaged_files_count_as_missing(machine: Machine) -> None:
    machine.call(*KERNELS)
    files = machine.files("fragments")
    assert len(files) == len(DAMAGES)  # one for each kernel
    for file, damage in zip(files, DAMAGES, strict=True):
        file.write_bytes(damage(file.read_bytes()))
    result, compiled = machine.call(*KERNELS)
    assert result == RIGHT
    assert compiled
    assert machine.call(*KERNELS) == (RIGHT, [])


@pytest.mark.long
def test_fragments_whose_callees_are_gone_are_compiled_again(machine: Machine) -> None:
    machine.call("records")
    before = machine.files("fragments")
    machine.call("squares")
    for file in before:
        file.unlink()
    assert machine.call(*KERNELS)[0] == RIGHT


@pytest.mark.long
def test_processes_that_compile_at_once_agree(machine: Machine) -> None:
    processes = [machine.start(name) for name in KERNELS]
    assert [json.loads(process.communicate()[0])[0] for process in processes] == [[answer] for answer in RIGHT]
    assert machine.call(*KERNELS) == (RIGHT, [])
