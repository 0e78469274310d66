"""Kernels that another process compiles: they are loaded from disk, and compiled here where that process ends without."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from maquette.render import ahead, kernels, links, machine, primed

BEGIN = """
import sys
import numpy as np
from maquette.render import ahead, links, machine, primed
machine.cores = lambda: 2
whole = np.zeros((1, 2), np.int64)
given = whole, 3, 4, np.zeros(2, np.int64), np.zeros(3, np.int64), np.zeros(2), np.zeros(2, np.int64)
"""
END = """
primed.begin(*given)
assert given[4].tolist() == [3, 4, 0]
assert not ahead._under_way
print(sum(primed.begin.stats.cache_hits.values()), sum(primed.begin.stats.cache_misses.values()))
"""


def run(folder: Path, text: str) -> str:
    """What a process with an empty cache prints."""
    environment = {**os.environ, "MAQUETTE_CACHE": str(folder)}
    done = subprocess.run([sys.executable, "-c", BEGIN + text], env=environment, capture_output=True, text=True, timeout=120)
    assert not done.returncode, done.stderr
    return done.stdout.strip()


def test_a_kernel_that_was_compiled_beside_is_loaded(tmp_path: Path) -> None:
    assert run(tmp_path, "ahead.start(2, primed.begin, *given)\nassert len(ahead._under_way) == 1" + END) == "1 0"
    again = "ahead.start(2, primed.begin, *given)\nassert not ahead._under_way"  # nobody is asked for what is on disk
    assert run(tmp_path, again + END) == "1 0"


def test_where_the_other_process_ends_the_kernel_is_compiled_here(tmp_path: Path) -> None:
    assert run(tmp_path, "ahead.start(2, primed.begin, *given)\nnext(iter(ahead._under_way.values())).kill()" + END) == "0 1"


@pytest.mark.parametrize("threads", [1, 2])
def test_there_are_no_more_processes_than_threads(tmp_path: Path, threads: int) -> None:
    text = f"ahead.start({threads}, primed.begin, *given)\nahead.start({threads}, primed.begin, *given)\nprint(len(ahead._under_way))"
    assert run(tmp_path, text) == str(threads - 1)


def test_the_other_process_ends_with_this_one(tmp_path: Path) -> None:
    text = """
import time
ahead.call(2, time.sleep, 100)
process = ahead._called[0]
process.stdin.close()
print(process.wait(60))
"""
    assert run(tmp_path, text) == "1"


def test_interpreters_of_formulas_are_made_beside(tmp_path: Path) -> None:
    text = """
from maquette.render.formulas import interpreter
interpreter.make_ready(1)
assert not ahead._called
interpreter.make_ready(2)
ahead._called[0].wait(100)
assert all(map(interpreter._path, interpreter.WIDTHS))
print(sum(interpreter._path(program).exists() for program in interpreter.WIDTHS), len(interpreter.WIDTHS))
interpreter.make_ready(2)
assert all(process.poll() is not None for process in ahead._called)
"""
    made, wanted = run(tmp_path, text).split()
    assert made == wanted


def test_kernels_are_found_by_their_functions_names() -> None:
    from maquette.render import integrate, waves

    assert ahead._named(waves, "draw_tile") is waves.draw_tile
    assert ahead._named(integrate, "_radiance") is integrate.linked.kernel
    assert isinstance(integrate.linked, links.Linked)


def test_nobody_is_asked_for_what_is_known_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "cores", lambda: 2)
    given = np.zeros((1, 2), np.int64), 3, 4, np.zeros(2, np.int64), np.zeros(3, np.int64), np.zeros(2), np.zeros(2, np.int64)
    primed.begin(*given)
    assert kernels.is_kept(primed.begin, tuple(map(numba.typeof, given)))
    monkeypatch.setattr(ahead, "_asked", None)
    ahead.start(2, primed.begin, *given)
    assert not ahead._under_way
