"""A process exits cleanly while LLVM compiles a formula in the background."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import sys, threading
from llvmlite.binding import ExecutionEngine
from maquette.compiler import load
from maquette.render.accel import ray_queries
compiling, finalize = threading.Event(), ExecutionEngine.finalize_object
def finalize_object(engine):
    if threading.current_thread().name == "formula":
        compiling.set()
    finalize(engine)
ExecutionEngine.finalize_object = finalize_object
bvh = ray_queries.build(load.load(sys.argv[1]).tables, closed=False)
assert compiling.wait(60)
print("compiling")
"""


@pytest.mark.long
def test_a_process_ends_while_a_formula_is_compiled(tmp_path: Path) -> None:
    waves = " + ".join(f"sin({1.1 * k + 1:.2f} * x + y) * z" for k in range(200))
    scene = tmp_path / "waves.scene"
    scene.write_text(f"camera(position: [0, 0, 5])\nimplicit(|x, y, z| {waves} <= 0.1, within: box([2, 2, 2]))\n")
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", SCRIPT, str(scene)], capture_output=True, text=True, timeout=300)
        assert (done.returncode, done.stdout) == (0, "compiling\n"), done.stderr
