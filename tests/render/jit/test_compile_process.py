"""Kernels that another process compiles: they are loaded from disk, or compiled here if that process ends without."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from maquette.render.accel.formula_packets import shadow_rays
from maquette.render.jit import compile_process, function_pointer, kernel_cache
from maquette.render.jit.value_types import typeof
from maquette.render.simd import target

BEGIN = """
import subprocess
import sys
import numpy as np

class Recorded(subprocess.Popen):
    def __init__(self, *args, **more):
        super().__init__(*args, **more)
        started.append(self)

started = []
subprocess.Popen = Recorded
from maquette.render.accel.formula_packets import shadow_rays
from maquette.render.jit import compile_process, function_pointer
from maquette.render.simd import target
target.cores = lambda: 2
given = 3, np.ones((8, 2)), np.array([1.0, np.inf]), np.zeros(2, np.int64)
"""
START = "compile_process.compile_in_background(2, shadow_rays.mark_hidden, *given)\n"
END = """
shadow_rays.mark_hidden(*given)
assert given[3].tolist() == [3 << 6, 1 << 6]
assert all(process.poll() is not None for process in started)
hits = [loaded.from_disk for loaded in shadow_rays.mark_hidden.loaded.values()]
print(hits.count(True), hits.count(False))
"""


def run(folder: Path, text: str) -> str:
    """Output of a process with this cache folder."""
    environment = {**os.environ, "MAQUETTE_CACHE": str(folder)}
    done = subprocess.run([sys.executable, "-c", BEGIN + text], env=environment, capture_output=True, text=True, timeout=120)
    assert not done.returncode, done.stderr
    return done.stdout.strip()


@pytest.mark.long
def test_a_kernel_of_the_other_process_is_loaded(tmp_path: Path) -> None:
    assert run(tmp_path, START + "assert len(started) == 1" + END) == "1 0"
    again = START + "assert not started"  # a cached kernel starts no process
    assert run(tmp_path, again + END) == "1 0"


@pytest.mark.long
def test_a_kernel_is_compiled_here_if_the_other_process_ends(tmp_path: Path) -> None:
    assert run(tmp_path, START + "started[0].kill()" + END) == "0 1"


@pytest.mark.long
@pytest.mark.parametrize("threads", [1, 2])
def test_processes_are_limited_by_threads(tmp_path: Path, threads: int) -> None:
    start = f"compile_process.compile_in_background({threads}, shadow_rays.mark_hidden, *given)\n"
    text = 2 * start + "print(len(started))"
    assert run(tmp_path, text) == str(threads - 1)


@pytest.mark.long
def test_the_other_process_ends_with_this_one(tmp_path: Path) -> None:
    text = """
import time
compile_process.run_in_background(2, time.sleep, 100)
(process,) = started
process.stdin.close()
print(process.wait(60))
"""
    assert run(tmp_path, text) == "1"


@pytest.mark.long
def test_interpreters_are_compiled_in_another_process(tmp_path: Path) -> None:
    text = """
from maquette.render.formula import interpreter
interpreter.compile_missing(1)
assert not started
interpreter.compile_missing(2)
started[0].wait(100)
print(sum(map(interpreter.is_compiled, interpreter.WIDTHS)), len(interpreter.WIDTHS))
interpreter.compile_missing(2)
assert all(process.poll() is not None for process in started)
"""
    compiled, programs = run(tmp_path, text).split()
    assert compiled == programs


def test_kernels_are_found_by_the_names_of_their_functions() -> None:
    from maquette.render.integrator import wavefront, whitted

    assert compile_process.find_kernel(wavefront, "draw_tile") is wavefront.draw_tile
    assert compile_process.find_kernel(whitted, whitted.linked.kernel.py_func.__name__) is whitted.linked.kernel
    assert isinstance(whitted.linked, function_pointer.KernelPointer)


def test_a_kernel_compiled_here_starts_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(target, "cores", lambda: 2)
    arguments = 3, np.ones((8, 2)), np.zeros(2), np.zeros(2, np.int64)
    shadow_rays.mark_hidden(*arguments)
    assert kernel_cache.is_cached(shadow_rays.mark_hidden, tuple(map(typeof, arguments)))
    started: list[object] = []
    monkeypatch.setattr(subprocess, "Popen", lambda *args, **more: started.append(args))
    compile_process.compile_in_background(2, shadow_rays.mark_hidden, *arguments)
    assert not started
