"""The cost of an edit of a formula: a redraw with another number, and the first use of a new formula."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

import numpy as np

from ..cli import common_options
from ..compiler import ir, load
from ..compiler.formula.builder import Builder
from ..compiler.formula.opcodes import Op
from ..compiler.formula.tape import Tape
from ..compiler.plan import plan as planner
from ..render import render_scene
from ..render.accel.formula_packets import packet_memory
from ..render.formula import scene_surfaces
from .harness import Effort
from .report import Section, grid

SMALL = {
    "torus": "(hypot(x, z) - 0.7)^2 + y^2 + 0 * x^4 <= k * k",
    "heart": "(x^2 + 2.25 * z^2 + y^2 - 1)^3 <= k * 3 * x^2 * y^3 + 0.1125 * z^2 * y^3",
    "blobs": "exp(-9 * (x^2 + y^2 + z^2)) + exp(-9 * ((x - k)^2 + y^2 + z^2)) >= 0.3",
}
TEXT = """
A number in a formula is changed, as by a slider: from the scene's text to its picture of 512², one sample a pixel, on one thread, all in
one process; the median of 15 redraws. A new formula: from its tape until it can be traced, in wall time.
"""
BOX = np.array([[-1.0] * 3, [1.0] * 3])


def redraw(relation: str, shadows: bool, redraws: int = 15, size: int = 512) -> tuple[list[float], bool]:
    """CPU seconds of redraws from text to picture, and whether an earlier number gives its earlier picture bit for bit.

    Each redraw has another number, one sample a pixel and one thread.
    """
    text = (
        "param k = 0.3\ncamera(position: [0, 0.8, 3], look_at: [0, 0, 0])\n"
        f"directional(from: [1, 2, 1.5], shadows: {str(shadows).lower()})\nimplicit(|x, y, z| {relation}, within: 1.5)\n"
    )
    spent, pictures = [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "slider.scene"
        path.write_text(text, encoding="utf-8")
        for k in range(redraws + 2):  # the first two load kernels
            begun = time.process_time()
            scene = load.load(path, sets={"k": f"{0.3 + 0.002 * (k % (redraws + 1)):.4f}"})
            drawn = render_scene.draw(scene, planner.make_plan(scene, ir.Settings(size=(size, size), samples=1, threads=1, backend="ray")))
            spent.append(time.process_time() - begun)
            if k in (0, redraws + 1):
                pictures.append(drawn.channels["rgba"])
            del drawn
    return spent[2:], np.array_equal(pictures[0], pictures[-1])


def first_use(operations: int = 200, formulas: int = 15) -> list[float]:
    """Seconds from the tape of a new formula until it can be traced, for several formulas."""
    spent = []
    for seed in range(formulas + 1):
        tape = _random_tape(operations, seed)
        begun = time.perf_counter()
        packet_memory.allocate(scene_surfaces.of_surfaces([scene_surfaces.Surface(tape, np.array([0.0] * 5 + [1.0] + [0.0] * 7), BOX)]), 0)
        spent.append(time.perf_counter() - begun)
    return spent[1:]


def _random_tape(operations: int, seed: int) -> Tape:
    """A random tape: sums of waves and distances."""
    random, b, total = np.random.default_rng(seed), Builder(), 0
    while len(b.rows) < operations - 1:
        axis, kind = int(random.integers(3)), (Op.SIN, Op.COS, Op.SQUARE, Op.ABS)[int(random.integers(4))]
        total = b.add(total, b.op(kind, b.scale(axis, float(random.uniform(1, 9)))))
    return b.finish(total)


def section(quick: bool, effort: Effort) -> Section:
    """Measure edits of formulas."""
    common_options.raise_gc_threshold()  # as the command line does
    result = Section("edits", "Edits of a formula", TEXT)
    rows: list[tuple[str, ...]] = []
    for name, relation in SMALL.items():
        for shadows in (False, True):
            what = f"{name}, {'with' if shadows else 'without'} shadows"
            spent, same = redraw(relation, shadows, *((3, 64) if quick else ()))
            rows.append((what, "maquette", *_spread(spent)))
            if not same:
                result.refused.append(f"{what}: a number that comes back brings another picture")
    rows.append(("a new formula of 200 operations", "maquette", *_spread(first_use(formulas=3 if quick else 15))))
    answer = "Answers. A number that comes back brings its picture back, bit for bit."
    result.blocks += [grid(("", "", "CPU, ms", "least", "most"), rows), answer]
    return result


def _spread(spent: list[float]) -> tuple[str, str, str]:
    return tuple(f"{1e3 * seconds:.3g}" for seconds in (statistics.median(spent), min(spent), max(spent)))  # type: ignore[return-value]
