"""Kernels on disk, and how kernel_cache.timed separates compilation from work."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from maquette.render.jit import kernel_cache
from numba import njit


def test_compilation_is_timed_apart_from_work() -> None:
    double = njit(lambda x: 2 * x)
    seconds: dict[str, float] = {}
    started = time.perf_counter()
    with kernel_cache.timed(seconds, "render"):
        assert double(2) == 4
        time.sleep(0.02)
    whole = time.perf_counter() - started
    assert seconds["compile_kernels"] > 0.001
    assert seconds["render"] >= 0.02
    assert seconds["compile_kernels"] + seconds["render"] == pytest.approx(whole, abs=0.01)
    compiled = seconds["compile_kernels"]
    with kernel_cache.timed(seconds, "render"):
        assert double(3) == 6
    assert seconds["compile_kernels"] == compiled  # nothing new was compiled


def test_failing_work_is_timed() -> None:
    seconds: dict[str, float] = {}
    with pytest.raises(ArithmeticError), kernel_cache.timed(seconds, "build"):
        raise ArithmeticError
    assert seconds["build"] > 0
    assert seconds["compile_kernels"] == 0


PROGRAM = """
import sys
import numpy as np
from maquette.render.film import accumulate
out = np.full((2, 2), -1.0)
one = np.ones((2, 2, 3))
accumulate.relative_error(0.5 * one, one, one, np.full((2, 2), 4), np.ones(32), 1.0, out)
hits = sum(accumulate.relative_error.stats.cache_hits.values())
if sys.argv[1] == "more":  # another type: it is compiled beside what was loaded
    accumulate.relative_error((0.5 * one).astype(np.float32), one, one, np.full((2, 2), 4), np.ones(32), 1.0, out)
print(hits, len(accumulate.relative_error.overloads), out.tolist())
"""


def test_cached_and_new_kernels_work_together(tmp_path: Path) -> None:
    def run(what: str) -> str:
        environment = {**os.environ, "MAQUETTE_CACHE": str(tmp_path)}
        return subprocess.run([sys.executable, "-c", PROGRAM, what], env=environment, capture_output=True, text=True, check=True).stdout

    values = np.full((2, 2), 0.25).tolist()
    assert run("same") == f"0 1 {values}\n"
    assert run("same") == f"1 1 {values}\n"
    assert run("more") == f"1 2 {values}\n"


def test_processes_that_write_at_the_same_time_keep_their_code_apart(tmp_path: Path) -> None:
    turns, writers = 100, 4
    together = threading.Barrier(writers)

    def write(key: int) -> None:
        for turn in range(turns):
            files = kernel_cache.KernelFiles(str(tmp_path), f"kernel{turn}", "stamp")
            together.wait()
            files.save(key, [key] * (3000 if key % 2 else 3))

    with ThreadPoolExecutor(writers) as pool:
        list(pool.map(write, range(writers)))
    kept = [kernel_cache.KernelFiles(str(tmp_path), f"kernel{turn}", "stamp") for turn in range(turns)]
    found = [(key, code[0]) for files in kept for key in range(writers) if (code := files.load(key)) is not None]
    assert len(found) > turns * writers // 2
    assert all(key == code for key, code in found)
    kept[0].save(0, ["newer"])
    assert kept[0].load(0) == ["newer"]


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[:-7], lambda data: b"x" * len(data), lambda data: data + b"x"])
def test_a_damaged_file_counts_as_missing_and_is_replaced(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    files = kernel_cache.KernelFiles(str(tmp_path), "kernel", "stamp")
    files.save("types", "code")
    assert files.load("types") == "code"
    for suffix in (".nbc", ".nbi"):
        (path,) = tmp_path.glob(f"*{suffix}")
        path.write_bytes(damage(path.read_bytes()))
        assert files.load("types") is None
        files.save("types", "code")
        assert files.load("types") == "code"


def test_a_full_disk_costs_the_cache_alone(tmp_path: Path) -> None:
    """As MAQUETTE_CACHE on a full disk: the kernel is compiled and runs, and nothing is kept."""
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (16, 16))\n{PROGRAM}"
    environment = {**os.environ, "MAQUETTE_CACHE": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", limited, "same"], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == f"0 1 {np.full((2, 2), 0.25).tolist()}\n"
    assert not [*tmp_path.rglob("*.nbc")]
