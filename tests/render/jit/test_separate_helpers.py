"""Separate helpers: emitted once for all kernels that call them, in files that may be damaged, old or gone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

MODULE = """
from maquette.render.jit.kernel import helper, kernel, separate_helper
import numpy as np

@separate_helper
def square(x):
    return x * x * FACTOR

@separate_helper
def fourth(x):
    return square(square(x))

@helper
def sum_of(x):
    return fourth(x) + square(x)

@kernel
def first(x):
    return sum_of(x) + 1.0

@kernel
def second(x):
    return 2.0 * fourth(x)

@kernel
def lanes(x):
    total = 0.0
    for k in range(len(x)):
        total += square(x[k])
    return total
"""
RUN = """
import json, sys
sys.path.insert(0, sys.argv[1])
from maquette.render.jit import kernel_cache
emitted = []
def write(name, code, before=kernel_cache.write):
    if name.endswith(".helper"):
        emitted.append(name.split(".")[-3])
    before(name, code)
kernel_cache.write = write
import kernels_of_test as module
values = {"first": 3.0, "second": 3.0, "lanes": module.np.array([1.0, 2.0, 4.0])}
results = [getattr(module, name)(values[name]) for name in sys.argv[2:]]
print(json.dumps([results, sorted(emitted), "numba" in sys.modules]))
"""
RIGHT = {"first": 81.0 + 9.0 + 1.0, "second": 162.0, "lanes": 21.0}


class Machine:
    """A folder of kernels, and a module whose kernels new processes call."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def start(self, *names: str, factor: float = 1.0, **variables: str) -> subprocess.Popen[str]:
        """Start a process that calls kernels."""
        (self.folder / "kernels_of_test.py").write_text(f"FACTOR = {factor}\n{MODULE}", encoding="utf-8")
        environment = {**os.environ, "MAQUETTE_CACHE": str(self.folder / "cache"), **variables}
        command = [sys.executable, "-c", RUN, str(self.folder), *names]
        return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def call(self, *names: str, factor: float = 1.0, **variables: str) -> tuple[list[float], list[str], bool]:
        """(results of kernels, helpers that were emitted for them, whether Numba was loaded) in a new process."""
        output, errors = self.start(*names, factor=factor, **variables).communicate()
        assert not errors, errors
        return tuple(json.loads(output))

    def files(self, ending: str) -> list[Path]:
        """The files of an ending in the folder of compiled code."""
        return sorted(self.folder.glob(f"cache/kernels/*/*.{ending}"))


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    """A machine without compiled code."""
    return Machine(tmp_path)


def test_kernels_share_the_code_of_separate_helpers(machine: Machine) -> None:
    assert machine.call("first") == ([RIGHT["first"]], ["fourth", "square"], True)
    assert machine.call("second", "lanes") == ([RIGHT["second"], RIGHT["lanes"]], [], True)
    assert len(machine.files("helper")) == 2
    assert machine.call(*RIGHT) == (list(RIGHT.values()), [], False)  # from disk alone


@pytest.mark.long
def test_an_edit_emits_helpers_again(machine: Machine) -> None:
    machine.call("first")
    assert machine.call("first", factor=2.0) == ([2.0 * 18.0**2 + 18.0 + 1.0], ["fourth", "square"], True)
    assert machine.call("first") == ([RIGHT["first"]], [], False)


DAMAGES: list[Callable[[Path], object]] = [
    Path.unlink, lambda file: file.write_bytes(b""), lambda file: file.write_bytes(file.read_bytes()[:-9]),
    lambda file: file.write_bytes(file.read_bytes().replace(b"square", b"sqware")),
]  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize(("helper", "emitted"), [("fourth", ["fourth"]), ("square", ["fourth", "square"])])
def test_helpers_without_a_whole_file_are_emitted_again(
    machine: Machine, helper: str, emitted: list[str], damage: Callable[[Path], object]
) -> None:
    """So are those that call them."""
    machine.call("first")
    (file,) = (each for each in machine.files("helper") if f".{helper}." in each.name)
    damage(file)
    assert machine.call("first") == ([RIGHT["first"]], emitted, True)
    assert machine.call("first") == ([RIGHT["first"]], [], False)


@pytest.mark.long
def test_without_room_on_disk_helpers_serve_one_process(machine: Machine) -> None:
    for _ in range(2):
        assert machine.call(*RIGHT, MAQUETTE_CACHE_SIZE="100") == (list(RIGHT.values()), ["fourth", "square"], True)
    assert not machine.files("helper")


@pytest.mark.long
def test_processes_that_emit_at_once_agree(machine: Machine) -> None:
    processes = [machine.start(name) for name in (*RIGHT, *RIGHT)]
    outputs = [json.loads(process.communicate()[0]) for process in processes]
    assert [results for results, *_ in outputs] == [[RIGHT[name]] for name in (*RIGHT, *RIGHT)]
    assert sorted(name for _, emitted, _ in outputs for name in emitted) == ["fourth", "square"]
