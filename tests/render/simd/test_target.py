"""Instruction sets: forced widths, the registers that the compiler uses, the disk cache, and all tests of this folder on each width."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler.io.environment import SettingError
from maquette.render import simd
from maquette.render.jit import loader
from maquette.render.jit.kernel import kernel
from maquette.render.simd import target

HERE = Path(__file__).resolve().parent
NARROWER = [isa for isa, size in target.BYTES.items() if size < target.BYTES[target.ISA]]
FORCED = "MAQUETTE_SIMD" in os.environ

KERNEL = '''
import sys
import numpy as np
from maquette.render import simd
from maquette.render.simd import target as machine
from maquette.render.jit.kernel import kernel, helper


@helper
def grown(x):
    return simd.exp(-x * x) + simd.reciprocal(x + 2)


@kernel
def work(x, out):
    for i in range(0, len(x), simd.WIDTH):
        y = grown(simd.load(x, i, simd.f32))
        if simd.any_of(y > 0.5):
            y = simd.select(y > 0.5, x[simd.to_i32(y) * 0], y)
        simd.compress_store(out, i, y, y < 3)


x = np.linspace(0, 4, 4096, dtype=np.float32)
out = np.zeros_like(x)
work(x, out)
((kinds, loaded),) = work.loaded.items()
print(machine.ISA, simd.WIDTH, simd.WIDTH64, int(loaded.from_disk))
from maquette.render.jit import compiler
code = compiler.assembly(work.py_func, kinds)
print("zmm" in code, "ymm" in code, "vfmadd" in code, f"{out.astype(float).sum():.3f}")
'''


BOTH = """
import numba
import numpy as np
from numba.core import codegen
from numba.core.registry import cpu_target
host = codegen.get_host_cpu_features()
print(numba.njit(lambda x: x.sum())(np.ones(16)))
from maquette.render.jit.kernel import kernel

@kernel
def twice(x):
    return 2.0 * x

assert twice(1.5) == 3.0
print(cpu_target.target_context.codegen()._tm_features == host)
print(numba.njit(lambda x: 2 * x.sum())(np.ones(16)))
"""


def run(script: Path, isa: str | None, cache: Path, *more: str) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k != "MAQUETTE_SIMD"}
    environment |= {"MAQUETTE_CACHE": str(cache), **({"MAQUETTE_SIMD": isa} if isa else {})}
    return subprocess.run([sys.executable, *more, str(script)], env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("simd") / "work.py"
    path.write_text(KERNEL)
    return path


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One cache folder for all widths, which must not load each other's code."""
    return tmp_path_factory.mktemp("kernels")


@pytest.mark.long
@pytest.mark.parametrize("isa", [target.ISA, *NARROWER])
def test_each_width_uses_its_registers_and_compiles_once(isa, script, cache):
    expected = {"avx512": (16, 8), "avx2": (8, 4), "sse": (4, 2), "scalar": (1, 1)}[isa]
    first, second = run(script, isa, cache), run(script, isa, cache)
    assert first.stderr == ""
    name, width, width64, hits = first.stdout.splitlines()[0].split()
    assert (name, int(width), int(width64), hits) == (isa, *expected, "0")
    assert second.stdout.splitlines()[0].split()[3] == "1"  # a second process loads what the first compiled
    zmm, ymm, fused, _ = first.stdout.splitlines()[1].split()
    if target.X86:
        assert zmm == str(isa == "avx512")
        assert ymm == "True" if isa == "avx2" else isa == "avx512" or ymm == "False"
        assert fused == str(isa in ("avx512", "avx2"))
    assert first.stdout.split()[-1] == second.stdout.split()[-1]


@pytest.mark.long
@pytest.mark.parametrize("isa", NARROWER)
@pytest.mark.skipif(FORCED, reason="the run that was asked for")
def test_this_folder_passes_on_every_narrower_width(isa, tmp_path):
    files = [p for p in sorted(HERE.glob("test_*.py")) if p.name != Path(__file__).name]
    environment = {**os.environ, "MAQUETTE_SIMD": isa}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *map(str, files)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=HERE.parents[2], check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert " passed" in done.stdout


@pytest.mark.long
def test_an_unsupported_instruction_set_is_rejected(script, tmp_path):
    done = run(script, "mmx", tmp_path)
    assert "MAQUETTE_SIMD=mmx is not an instruction set; choose from: avx512, avx2, sse, scalar, native" in done.stderr


def test_code_of_a_higher_level_is_compiled_but_not_loaded(monkeypatch):
    monkeypatch.setattr(target, "HOST", {})
    monkeypatch.setattr(target, "ISA", "avx2")
    with pytest.raises(SettingError, match=re.escape("MAQUETTE_SIMD=avx2 is more than this machine has (sse)")):
        loader.load_object(b"")


V2 = {"cx16", "popcnt", "sse3", "ssse3", "sse4.1", "sse4.2"}
V3 = V2 | {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"}
V4 = V3 | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}


@pytest.mark.parametrize(
    ("features", "isa", "cpu"),
    [
        (V4 | {"avx512vnni"}, "avx512", "x86-64-v4"), (V4 - {"avx512dq"}, "avx2", "x86-64-v3"), (V4 - {"fma"}, "sse", "x86-64-v2"),
        (V3, "avx2", "x86-64-v3"), (V2 | {"avx"}, "sse", "x86-64-v2"), (V3 - {"popcnt"}, "sse", "x86-64"), (set(), "sse", "x86-64"),
    ],
)  # fmt: skip
def test_the_highest_level_of_a_machine_is_chosen(features, isa, cpu):
    level = target.choose("", "x86_64-unknown-linux-gnu", dict.fromkeys(features, True))
    assert (level.isa, level.cpu) == (isa, cpu)
    assert level.fma == (isa != "sse")


def test_levels_are_the_same_on_all_machines_of_a_level():
    features, more_features = (dict.fromkeys(V4 | more, True) for more in (set(), {"avx512vbmi", "gfni"}))
    assert target.choose("", "x86_64-linux", features) == target.choose("", "x86_64-linux", more_features)
    assert target.choose("avx2", "x86_64-linux", features) == target.choose("", "x86_64-linux", dict.fromkeys(V3, True))
    assert target.choose("native", "x86_64-linux", features) != target.choose("native", "x86_64-linux", more_features)


def test_arm_has_one_level():
    assert target.choose("", "aarch64-unknown-linux-gnu", {"neon": True, "sve": True}) == ("sse", "generic", "+neon", True)


@pytest.mark.long
def test_other_code_of_numba_keeps_its_target(tmp_path):
    """Before and after a kernel is compiled for another instruction set, in one process."""
    path = tmp_path / "both.py"
    path.write_text(BOTH)
    done = run(path, NARROWER[-1] if NARROWER else None, tmp_path)
    assert done.stdout.split() == ["16.0", "True", "32.0"], done.stderr


@kernel
def _halved(x, out):
    saved = simd.flush_denormals()
    simd.store(out, 0, simd.load(x, 0, 4) * 0.5)
    simd.restore_denormals(saved)
    simd.store(out, 4, simd.load(x, 0, 4) * 0.5)


def test_denormals_are_flushed_until_restored():
    tiny = np.finfo(np.float32).tiny
    x, out = np.array([tiny, 1, tiny / 4, -tiny], np.float32), np.zeros(8, np.float32)
    _halved(x, out)
    halves = x * np.float32(0.5)
    assert np.array_equal(out[4:], halves)
    assert np.array_equal(out[:4], np.where(np.abs(halves) < tiny, 0, halves) if target.X86 else halves)
    assert np.float32(tiny) * np.float32(0.5) != 0  # the thread is as it was
