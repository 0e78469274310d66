"""Kernels on disk, and how kernel_cache.timed separates compilation from work."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from maquette.render.jit import compile_lock, kernel_cache, kernel_file, value_types
from maquette.render.jit.kernel import kernel
from maquette.render.jit.kernel_file import Code


def test_compilation_is_timed_apart_from_work() -> None:
    number = 2
    double = kernel(lambda x: number * x)
    seconds: dict[str, float] = {}
    started = time.perf_counter()
    with kernel_cache.timed(seconds, "render"):
        assert double(2) == 4
        time.sleep(0.02)
    elapsed = time.perf_counter() - started
    assert seconds["compile_kernels"] > 0.001
    assert seconds["render"] >= 0.02
    assert seconds["compile_kernels"] + seconds["render"] == pytest.approx(elapsed, abs=0.01)
    compiled = seconds["compile_kernels"]
    with kernel_cache.timed(seconds, "render"):
        assert double(3) == 6
    assert seconds["compile_kernels"] == compiled  # nothing new was compiled


FORMULA = """
import sys
import maquette
maquette.render(sys.argv[1], size=(32, 24), samples=1)
print("numba" in sys.modules)
"""


@pytest.mark.long
@pytest.mark.parametrize("example", ["gear", "fillets"])
def test_a_second_process_loads_all_kernels_of_implicit_surfaces(example: str) -> None:
    scene = str(Path(__file__).resolve().parents[3] / "examples" / f"{example}.scene")
    said = [subprocess.run([sys.executable, "-c", FORMULA, scene], capture_output=True, text=True, check=True).stdout for _ in range(2)]
    assert said[1] == "False\n"


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
accumulate.relative_error(0.5 * one, one, np.full((2, 2), 4), np.ones(32), 0.0, out)
hits = sum(loaded.from_disk for loaded in accumulate.relative_error.loaded.values())
if sys.argv[1] == "more":  # another type: it is compiled beside what was loaded
    accumulate.relative_error((0.5 * one).astype(np.float32), one, np.full((2, 2), 4), np.ones(32), 0.0, out)
print(hits, len(accumulate.relative_error.loaded), "numba" in sys.modules, out.tolist())
"""
VALUES = np.full((2, 2), 0.25).tolist()


def run(folder: Path, what: str, program: str = PROGRAM) -> str:
    """Output of a process with this cache folder."""
    environment = {**os.environ, "MAQUETTE_CACHE": str(folder)}
    return subprocess.run([sys.executable, "-c", program, what], env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.long
def test_cached_and_new_kernels_work_together(tmp_path: Path) -> None:
    """Only a process that compiles imports Numba."""
    assert run(tmp_path, "same") == f"0 1 True {VALUES}\n"
    assert run(tmp_path, "same") == f"1 1 False {VALUES}\n"
    assert run(tmp_path, "more") == f"1 2 True {VALUES}\n"


CODE = Code("entry", "function", value_types.tuple_of(value_types.INT64, value_types.FLOAT64), ("sin",), b"code")


@pytest.mark.long
def test_processes_that_write_at_the_same_time_keep_their_code_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "CACHE", tmp_path)
    turns, writers = 100, 4
    together = threading.Barrier(writers)

    def write(key: int) -> None:
        for turn in range(turns):
            together.wait()
            kernel_cache.write(f"kernel{turn % 2}-a-b.kernel", CODE._replace(code=bytes([key]) * (3000 if key % 2 else 3)))
            code = kernel_cache.read(f"kernel{turn % 2}-a-b.kernel")
            assert code is not None
            assert len(code.code) == (3000 if code.code[0] % 2 else 3)

    with ThreadPoolExecutor(writers) as pool:
        list(pool.map(write, range(writers)))


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: b"", lambda data: data[:-7], lambda data: b"x" * len(data), lambda data: data + b"x",
        lambda data: data[:18] + data[40:],
        lambda data: data[:60] + b"~" + data[61:],
    ],
)  # fmt: skip
def test_a_damaged_file_counts_as_missing_and_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: Callable[[bytes], bytes]
) -> None:
    monkeypatch.setattr(kernel_cache, "CACHE", tmp_path)
    name = "kernel-a-b.kernel"
    kernel_cache.write(name, CODE)
    assert kernel_cache.read(name) == CODE
    (tmp_path / name).write_bytes(damage((tmp_path / name).read_bytes()))
    assert kernel_cache.read(name) is None
    kernel_cache.write(name, CODE)
    assert kernel_cache.read(name) == CODE


def test_a_file_under_another_name_counts_as_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "CACHE", tmp_path)
    kernel_cache.write("kernel-a-b.kernel", CODE)
    (tmp_path / "kernel-a-b.kernel").rename(tmp_path / "kernel-a-c.kernel")
    assert kernel_cache.read("kernel-a-c.kernel") is None


def test_code_that_needs_unknown_symbols_counts_as_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "CACHE", tmp_path)
    kernel_cache.write("kernel-a-b.kernel", CODE._replace(needs=("sin", "no_such_symbol_of_maquette")))
    assert kernel_cache.read("kernel-a-b.kernel") is None


NO_TUPLE = b'{"name":"n","entry":"e","function":"f","result":["named","os","path",[],[]],"needs":[],"helpers":[]}'


def with_header(header: bytes) -> bytes:
    """A file of a header, without code: a line, a digest of 16 bytes, the header's length, the header."""
    body = struct.pack("<I", len(header)) + header
    return b"maquette kernel 2\n" + hashlib.blake2b(body, digest_size=16).digest() + body


def test_the_format_of_a_file() -> None:
    header = {"name": "n", "entry": "e", "function": "f", "result": CODE.result.plain, "needs": [], "helpers": ["g.helper"]}
    assert kernel_file.unpacked("n", with_header(json.dumps(header).encode())) == Code("e", "f", CODE.result, (), b"", ("g.helper",))


@pytest.mark.parametrize("header", [b"{}", b"[]", b"{", NO_TUPLE])
def test_a_header_of_another_form_counts_as_missing(header: bytes) -> None:
    assert kernel_file.unpacked("n", with_header(header)) is None


@pytest.mark.long
def test_a_damaged_cache_is_compiled_again(tmp_path: Path) -> None:
    run(tmp_path, "same")
    for path in tmp_path.rglob("*.kernel"):
        path.write_bytes(path.read_bytes()[:-100])
    assert run(tmp_path, "same") == f"0 1 True {VALUES}\n"
    assert run(tmp_path, "same") == f"1 1 False {VALUES}\n"


@pytest.mark.long
def test_a_full_disk_costs_the_cache_alone(tmp_path: Path) -> None:
    """As MAQUETTE_CACHE on a full disk: the kernel is compiled and runs, and nothing is kept."""
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (16, 16))\n{PROGRAM}"
    assert run(tmp_path, "same", limited) == f"0 1 True {VALUES}\n"
    assert not [*tmp_path.rglob("*.kernel")]


TWICE = """
import sys
import numpy as np
from pathlib import Path
from maquette.render.film import accumulate
from maquette.render.jit import kernel_cache
while not Path(sys.argv[1], "start").exists(): pass
out, one = np.full((2, 2), -1.0), np.ones((2, 2, 3))
accumulate.relative_error(0.5 * one, one, np.full((2, 2), 4), np.ones(32), 0.0, out)
(loaded,) = accumulate.relative_error.loaded.values()
print(loaded.from_disk, out.tolist())
"""


@pytest.mark.long
def test_two_processes_compile_a_kernel_once(tmp_path: Path) -> None:
    environment = {**os.environ, "MAQUETTE_CACHE": str(tmp_path)}
    command = [sys.executable, "-c", TWICE, str(tmp_path)]
    both = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    (tmp_path / "start").touch()
    said = sorted(each.communicate()[0].strip() for each in both)
    assert said == [f"False {VALUES}", f"True {VALUES}"]
    assert not [*tmp_path.rglob(f"*{compile_lock.SUFFIX}")]


def test_a_lock_that_a_killed_process_left_is_free(tmp_path: Path) -> None:
    file = tmp_path / "a.kernel"
    holder = "import sys, time; from pathlib import Path; from maquette.render.jit import compile_lock\n"
    holder += "with compile_lock.compiling(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", holder, str(file)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        process.kill()
    started = time.monotonic()
    with compile_lock.compiling(file):
        assert time.monotonic() - started < compile_lock.LONGEST / 2
    with compile_lock.compiling(tmp_path / "missing" / "a.kernel"):
        pass


def test_no_kernel_of_the_product_has_free_variables():
    """Their code would not be kept on disk: each process would compile it again."""
    nested = []
    for path in sorted(Path(kernel_cache.__file__).parents[1].rglob("*.py")):
        for outer in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(outer, ast.FunctionDef):
                inner = [node for node in ast.walk(outer) if isinstance(node, ast.FunctionDef) and node is not outer]
                nested += [f"{path.name}: {node.name}" for node in inner if "kernel" in map(ast.unparse, node.decorator_list)]
    assert nested == []
