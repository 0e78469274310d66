"""A published scene against another renderer's long runs, pixel by pixel: only noise is between them (z-tests: Subr and Arvo 2007)."""

from __future__ import annotations

import math
from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.bench import paths
from maquette.compiler import ir
from maquette.compiler import plan as planner
from maquette.measure import peers
from maquette.measure.records import Setting
from maquette.render import draw

MITSUBA = peers.find(["mitsuba"])[0]
RUNS = 12  # of each renderer, with seeds of their own
SIZE = (40, 40)


def student(t: np.ndarray, freedom: int) -> np.ndarray:
    """The chance of more than |t| either way under Student's distribution, by the midpoint rule in the angle arctan(t/√ν)."""
    angle = np.arctan(np.abs(t) / math.sqrt(freedom))[..., None]
    middles = angle + (0.5 * math.pi - angle) * (np.arange(400) + 0.5) / 400
    tail = np.mean(np.cos(middles) ** (freedom - 1), axis=-1) * (0.5 * math.pi - angle[..., 0])
    return 2.0 * tail * math.gamma(0.5 * (freedom + 1)) / (math.sqrt(math.pi) * math.gamma(0.5 * freedom))


def test_student() -> None:
    """Of one degree of freedom it is Cauchy's: half lies beyond 1. Of 22 the table says 2.074 and 2.819 for 5 % and 1 %."""
    assert student(np.array([1.0, 0.0]), 1) == pytest.approx([0.5, 1.0], abs=1e-6)
    assert student(np.array([2.0739, 2.8188]), 22) == pytest.approx([0.05, 0.01], rel=1e-3)


@pytest.mark.long
@pytest.mark.skipif(bool(MITSUBA.missing), reason=MITSUBA.missing)
def test_the_cornell_box_is_mitsubas(tmp_path: Path) -> None:
    """Grey of each pixel: the means of independent runs differ by no more than their own spread says (Welch's t, Šidák's correction).

    Mitsuba keeps light in single precision: 10⁻⁴ of a pixel counts as nothing, which matters where only the lamp is seen.
    """
    scene = maquette.load(paths.SCENES / "cornell.scene")

    def plan(seed: int) -> planner.Plan:
        return planner.make(scene, ir.Settings(size=SIZE, bounces=6, filter="box", samples=1024, seed=seed, backend="ray"))

    ours = np.array([draw.draw(scene, plan(k)).channels["rgba"][..., :3].mean(axis=-1) for k in range(1, RUNS + 1)], float)
    setting = Setting("mitsuba", "samples", 1024, {"samples": 1024})
    theirs = np.array([MITSUBA.run(scene, plan(k), setting, k).rgb.mean(axis=-1) for k in range(1, RUNS + 1)], float)
    apart = ours.mean(axis=0) - theirs.mean(axis=0)
    spread = (ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / RUNS
    t = apart / np.sqrt(spread + (1e-4 * theirs.mean(axis=0)) ** 2)
    least = float(student(t, 2 * RUNS - 2).min())
    assert np.median(np.sqrt(spread) / theirs.mean(axis=0)) < 0.02  # the test would notice 5 % in a pixel
    assert 1.0 - (1.0 - least) ** t.size > 0.01
    assert abs(t.mean()) < 4.0 / math.sqrt(t.size)
    assert np.sqrt(np.mean(t**2)) < 1.15  # of Student's t with 22 degrees of freedom it is 1.05
    assert abs(ours.mean() / theirs.mean() - 1.0) < 2e-3
