"""The definitions that cache keys follow hold every function that Numba compiles into a kernel."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import sys
from maquette.cli import build_kernels
from maquette.render.jit import cache_key, compiler, lto

compiled = []
for pipeline in (lto.Fragment, lto.Kernel):
    def define(self, before=pipeline.define_pipelines):
        compiled.append(self.state.func_id.func)
        return before(self)
    pipeline.define_pipelines = define

missing, kernels, fragments = set(), 0, {}
def compile_kernel(function, kinds, folder, before=compiler.compile_kernel):
    global kernels
    compiled.clear()
    code = before(function, kinds, folder)
    kernels += 1
    module = function.__module__.partition(".")[2]
    reach = cache_key.reach(module, function.__qualname__.partition(".")[0])
    kernel = f"{module}.{function.__qualname__}"
    for each in compiled:  # a fragment is compiled once, so later kernels add only what those before them did not need
        if each.__module__ is None:  # made by exec: its key has its code
            continue
        place = each.__module__.partition(".")[2], each.__qualname__.partition(".")[0]
        if each.__module__.startswith("maquette.") and place not in reach:
            missing.add(f"{kernel} is compiled from {place[0]}.{place[1]}")
    return code
compiler.compile_kernel = compile_kernel
build_kernels.compile_variant(sys.argv[1])
print(kernels)
for each in sorted(missing):
    print(each)
"""


@pytest.mark.long
@pytest.mark.parametrize("variant", ["paths of formulas", "triangles with shadow maps"])
def test_keys_follow_all_that_is_compiled(tmp_path: Path, variant: str) -> None:
    environment = {**os.environ, "MAQUETTE_CACHE": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", PROGRAM, variant], env=environment, capture_output=True, text=True, check=True)
    kernels, *missing = done.stdout.splitlines()
    assert int(kernels) > 2
    assert missing == []
