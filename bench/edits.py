"""What an edit of a formula costs (`python -m maquette.bench.edits`): a slider's redraw, and a new formula until it can be traced."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .. import cli_shared
from ..compiler import ir, load
from ..compiler import plan as planner
from ..compiler.tapes import Builder, Op, Tape
from ..render import draw
from ..render.formulas import fields, tile_room

SMALL = {
    "torus": "(hypot(x, z) - 0.7)^2 + y^2 + 0 * x^4 <= k * k",
    "heart": "(x^2 + 2.25 * z^2 + y^2 - 1)^3 <= k * 3 * x^2 * y^3 + 0.1125 * z^2 * y^3",
    "blobs": "exp(-9 * (x^2 + y^2 + z^2)) + exp(-9 * ((x - k)^2 + y^2 + z^2)) >= 0.3",
}
BOX = np.array([[-1.0] * 3, [1.0] * 3])


def slider(relation: str, shadows: bool, redraws: int = 9) -> float:
    """CPU seconds from a scene's text with another number to its picture of 512², one sample a pixel, on one thread; the median."""
    text = (
        "param k = 0.3\ncamera(position: [0, 0.8, 3], look_at: [0, 0, 0])\n"
        f"directional(from: [1, 2, 1.5], shadows: {str(shadows).lower()})\nimplicit(|x, y, z| {relation}, within: 1.5)\n"
    )
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "slider.scene"
        path.write_text(text, encoding="utf-8")
        for k in range(redraws + 2):  # the first ones load kernels
            begun = time.process_time()
            scene = load.load(path, sets={"k": f"{0.3 + 0.002 * k:.4f}"})
            draw.draw(scene, planner.make(scene, ir.Settings(size=(512, 512), samples=1, threads=1, backend="ray")))
            spent.append(time.process_time() - begun)
    return statistics.median(spent[2:])


def stall(operations: int = 200, formulas: int = 9) -> float:
    """Seconds until a formula never seen before can be traced, from its tape on; the median of different ones."""
    spent = []
    for seed in range(formulas + 1):
        tape = _strange(operations, seed)
        begun = time.perf_counter()
        tile_room.room(fields.of_surfaces([fields.Surface(tape, np.array([0.0] * 5 + [1.0] + [0.0] * 7), BOX)]), 0)
        spent.append(time.perf_counter() - begun)
    return statistics.median(spent[1:])


def _strange(operations: int, seed: int) -> Tape:
    """A tape like no other: sums of waves and distances, in an order of their own."""
    random, b, total = np.random.default_rng(seed), Builder(), 0
    while len(b.rows) < operations - 1:
        axis, kind = int(random.integers(3)), (Op.SIN, Op.COS, Op.SQUARE, Op.ABS)[int(random.integers(4))]
        total = b.add(total, b.op(kind, b.scaled(axis, float(random.uniform(1, 9)))))
    return b.finish(total)


def timed(label: str, work: Callable[[], float]) -> None:
    print(f"{label:44s} {work() * 1e3:7.1f} ms", flush=True)


if __name__ == "__main__":
    cli_shared.collect_seldom()  # as the command line does
    for name, relation in SMALL.items():
        for shadows in (False, True):
            how = "with shadows" if shadows else "without shadows"
            timed(f"slider, {name}, {how} (CPU)", lambda relation=relation, shadows=shadows: slider(relation, shadows))
    timed("a new formula of 200 operations, until traced", stall)
