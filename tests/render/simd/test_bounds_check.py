"""MAQUETTE_CHECKED=1: an access outside of an array ends the process with its place."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from maquette.render import simd

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples"
KERNELS = '''
import sys
import numpy as np
from maquette.render import simd
from maquette.render.jit.kernel import kernel

@kernel
def gathered(table, i):
    return simd.sum_of(simd.gather(table, simd.iota(simd.i32(0)) + i))

@kernel
def read(table, i):
    return simd.read(table, i)

@kernel
def indexed(table, i):
    return simd.sum_of(table[simd.iota(simd.i32(0)) * 0 + i])

@kernel
def stored(table, i):
    simd.store(table, i, simd.i32(7))
    return 0

table, name = np.ones(20, np.int32), sys.argv[1]
last = 20 - simd.WIDTH if name in ("gathered", "stored") else 19
print("in:", eval(name)(table, last), flush=True)
print("out:", eval(name)(table, last + 1 if sys.argv[2] == "beyond" else -1), flush=True)
'''


def run(tmp_path: Path, command: list[str]) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "MAQUETTE_CHECKED": "1"}
    return subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)


@pytest.mark.long
@pytest.mark.parametrize("side", ["before", "beyond"])
@pytest.mark.parametrize("name", ["gathered", "read", "indexed", "stored"])
def test_an_access_outside_ends_the_process(tmp_path, name, side):
    script = tmp_path / "outside.py"
    script.write_text(KERNELS, encoding="utf-8")
    done = run(tmp_path, [sys.executable, str(script), name, side])
    assert done.returncode != 0
    line = next(k for k, text in enumerate(KERNELS.splitlines(), 1) if text.startswith(f"def {name}")) + 1
    place = -1 if side == "before" else 21 - simd.WIDTH if name == "stored" else 20
    inside, message = done.stdout.splitlines()
    assert inside.startswith("in: ")
    assert message == f"outside.py:{line}: place {place} of 20"


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
@pytest.mark.parametrize("name", ["hello", "metals", "glass", "chess", "instancing", "room", "materials", "cut"])
def test_examples_stay_inside(tmp_path, name, backend):
    drawing = "from maquette.cli.main import main; main()"
    options = ["--backend", backend, "--size", "96x64", "--samples", "4", "-o", str(tmp_path / "a.png")]
    done = run(tmp_path, [sys.executable, "-c", drawing, "render", str(EXAMPLES / f"{name}.scene"), *options])
    assert done.returncode == 0, done.stdout + done.stderr
