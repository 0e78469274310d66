"""Kernels for a machine with a larger instruction set are listed and compiled here, without running."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from maquette.render.simd import target

ROOT = Path(__file__).resolve().parents[3]
TOOLS = ROOT / "tools"

# A machine without AVX-512, in a process whose code begins with this.
OLDER = """
import llvmlite.binding as llvm
features = {name: on and not name.startswith(("avx512", "avx10")) for name, on in llvm.get_host_cpu_features().items()}
llvm.get_host_cpu_features = lambda: features
"""
WORK = """
import numpy as np
from maquette.render.film import accumulate
out, one = np.full((2, 2), -1.0), np.ones((2, 2, 3))
accumulate.relative_error(0.5 * one, one, np.full((2, 2), 4), np.ones(32), 0.0, out)
assert out.tolist() == [[0.25, 0.25], [0.25, 0.25]]
"""
SCENE = """
import sys
sys.argv[1:] = [{0!r}]
exec(open({1!r}).read())
"""
needs_avx512 = pytest.mark.skipif(target.highest(target.HOST) != "avx512", reason="compares with code that this machine runs")


def run(code: str, cache: Path, requests: Path | None = None) -> None:
    environment = {**os.environ, "MAQUETTE_SIMD": "avx512", "MAQUETTE_CACHE": str(cache), "MAQUETTE_KERNELS": "special"}
    environment["MAQUETTE_REQUESTS"] = "" if requests is None else str(requests)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def kernels(cache: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in cache.rglob("*~*.kernel")}


def compare(tmp_path: Path, work: str) -> set[str]:
    """Compile the kernels of `work` on an older machine and on this one: the files are equal. The kernels' names."""
    run(OLDER + work, tmp_path / "drawn", tmp_path / "requests")
    tool = str(TOOLS / "compile_requests.py")
    only = "from maquette.render.formula import op_codegen; op_codegen.WIDTHS.clear(); "  # the interpreters take a minute
    script = f"import sys; sys.argv[1:] = [{str(tmp_path / 'requests')!r}]; exec(open({tool!r}).read())"
    run(OLDER + only + script, tmp_path / "older")
    run(work, tmp_path / "here")
    assert kernels(tmp_path / "older") == kernels(tmp_path / "here")
    return {name.partition("-")[0] for name in kernels(tmp_path / "here")}


@needs_avx512
def test_a_kernel_is_compiled_for_a_larger_instruction_set(tmp_path: Path) -> None:
    assert compare(tmp_path, WORK) == {"render.film.accumulate~relative_error"}


@needs_avx512
@pytest.mark.long
def test_the_kernels_of_a_picture_are_compiled_for_a_larger_instruction_set(tmp_path: Path) -> None:
    """Those on vectors, and those that call others."""
    scene = SCENE.format(str(ROOT / "examples" / "hello.scene"), str(TOOLS / "compile_scenes.py"))
    assert {"render.integrator.whitted~_radiance", "render.accel.traverse.two_level~_search"} < compare(tmp_path, scene)


@needs_avx512
def test_code_of_the_older_machine_runs_with_more_lanes() -> None:
    code = OLDER + "from maquette.render.simd import target; print(target.WIDTH, target.LEVEL.cpu, target.AVX512, target.AVX2)"
    environment = {**os.environ, "MAQUETTE_SIMD": "avx512", "MAQUETTE_REQUESTS": "somewhere"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout == "16 x86-64-v3 False True\n"
