"""A published scene against long runs of another renderer: only noise differs (z-tests: Subr and Arvo 2007)."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.bench import paths
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.measure.peers import registry
from maquette.measure.records import Setting
from maquette.render import render_scene
from maquette.render.material import energy_compensation

MITSUBA = registry.find(["mitsuba"])[0]
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


def t_of(ours: np.ndarray, theirs: np.ndarray, nothing: float) -> tuple[np.ndarray, np.ndarray]:
    """(Welch's t of each pixel's grey, its standard error over the mean) of runs (n, h, w); so much of a pixel counts as nothing."""
    spread = (ours.var(axis=0, ddof=1) + theirs.var(axis=0, ddof=1)) / RUNS
    mean = theirs.mean(axis=0)
    return (ours.mean(axis=0) - mean) / np.sqrt(spread + (nothing * mean) ** 2), np.sqrt(spread) / mean


def runs_of(scene: ir.Scene, plan: Callable[[int], planner.Plan]) -> np.ndarray:
    """Grey of our runs, (n, h, w)."""
    return np.array([render_scene.draw(scene, plan(k)).channels["rgba"][..., :3].mean(axis=-1) for k in range(1, RUNS + 1)], float)


def runs_of_theirs(scene: ir.Scene, plan: Callable[[int], planner.Plan], samples: int) -> np.ndarray:
    setting = Setting("mitsuba", "samples", samples, {"samples": samples})
    return np.array([MITSUBA.run(scene, plan(k), setting, k).rgb.mean(axis=-1) for k in range(1, RUNS + 1)], float)


@pytest.mark.long
@pytest.mark.skipif(bool(MITSUBA.missing), reason=MITSUBA.missing)
def test_the_cornell_box_is_mitsubas(tmp_path: Path) -> None:
    """Grey of each pixel: the means of independent runs differ by no more than their own spread says (Welch's t, Šidák's correction).

    Mitsuba keeps light in single precision: 10⁻⁴ of a pixel counts as nothing, which matters where only the lamp is seen.
    """
    scene = maquette.load(paths.SCENES / "cornell.scene")

    def plan(seed: int) -> planner.Plan:
        return planner.make_plan(scene, ir.Settings(size=SIZE, bounces=6, filter="box", samples=1024, seed=seed, backend="ray"))

    ours, theirs = runs_of(scene, plan), runs_of_theirs(scene, plan, 1024)
    t, error = t_of(ours, theirs, 1e-4)
    least = float(student(t, 2 * RUNS - 2).min())
    assert np.median(error) < 0.02  # the test would notice 5 % in a pixel
    assert 1.0 - (1.0 - least) ** t.size > 0.01
    assert abs(t.mean()) < 4.0 / math.sqrt(t.size)
    assert np.sqrt(np.mean(t**2)) < 1.15  # of Student's t with 22 degrees of freedom it is 1.05
    assert abs(ours.mean() / theirs.mean() - 1.0) < 2e-3


PLATES = """
let plate(alpha, y0, z0, y1, z1) = polygon([[4, y0, z0], [4, y1, z1], [-4, y1, z1], [-4, y0, z0]],
  material: metal("silver", roughness: sqrt(alpha)))
plate(0.005, -2.70651, 0.25609, -2.08375, -0.526323)
plate(0.02, -3.28825, 1.36972, -2.83856, 0.476536)
plate(0.05, -3.73096, 2.70046, -3.43378, 1.74564)
plate(0.1, -3.99615, 4.0667, -3.82069, 3.08221)
let matt = lambert(rgb(0.4, 0.4, 0.4))
polygon([[-10, -4.14615, 10], [10, -4.14615, 10], [10, -4.14615, -10], [-10, -4.14615, -10]], material: matt)
polygon([[-10, -10, -2], [10, -10, -2], [10, 10, -2], [-10, 10, -2]], material: matt)
let ball(center, r, l) = sphere(r, center: center, material: emissive(luminance: l))
ball([-3.75, 0, 0], 0.0333, 901.803)
ball([-1.25, 0, 0], 0.1, 100)
ball([1.25, 0, 0], 0.3, 11.1111)
ball([3.75, 0, 0], 0.9, 1.23457)
ball([10, 10, 4], 0.5, 800)
camera(position: [0, 2, 15], look_at: [0, -2, 2.5], fov: 21deg)
"""


@pytest.mark.long
@pytest.mark.skipif(bool(MITSUBA.missing), reason=MITSUBA.missing)
def test_veachs_plates_are_mitsubas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four polished to rough plates under four balls and a lamp, all of which throw shadows (Veach 1997, figure 9.2).

    Mitsuba's facets reflect once: what light gains by further bounces, 1 to 3 % on the roughest plate, is left out of ours by tables that
    say that one bounce loses none. Its metals are exact, ours Schlick's law with an edge: 0.3 % counts as nothing.
    """
    path = tmp_path / "plates.scene"
    path.write_text(PLATES, encoding="utf-8")
    scene = maquette.load(path)

    def plan(seed: int) -> planner.Plan:
        return planner.make_plan(scene, ir.Settings(size=(60, 40), bounces=2, filter="box", samples=512, seed=seed, backend="ray"))

    whole, real = runs_of(scene, plan), energy_compensation.table()
    once = real._replace(each=real.each.copy(), mean=real.mean.copy(), again=0.0 * real.again)
    once.each[:, [0, 2]] = once.mean[:, 0] = 1.0
    monkeypatch.setattr(energy_compensation, "table", lambda: once)
    ours, theirs = runs_of(scene, plan), runs_of_theirs(scene, plan, 512)
    t, error = t_of(ours, theirs, 3e-3)
    least = float(student(t, 2 * RUNS - 2).min())
    assert np.median(error) < 0.01
    assert 1.0 - (1.0 - least) ** t.size > 0.001
    assert abs(t.mean()) < 0.1
    assert np.sqrt(np.mean(t**2)) < 1.1  # of Student's t with 22 degrees of freedom it is 1.05
    assert abs(ours.mean() / theirs.mean() - 1.0) < 3e-3
    gained = whole[:, -4:].mean() / ours[:, -4:].mean() - 1.0
    assert 0.01 < gained < 0.03
