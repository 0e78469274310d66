"""Estimates of memory: arrays that the film holds, and their order."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.render import large_images, memory_estimate

from . import memory_cases

BALL = "sphere(1)\npoint([2, 4, 3], intensity: 20)\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n"


@pytest.fixture
def ball(tmp_path: Path) -> ir.Scene:
    (tmp_path / "a.scene").write_text(BALL, encoding="utf-8")
    return maquette.load(tmp_path / "a.scene")


def needs(scene: ir.Scene, linear: bool = False, **settings: Any) -> memory_estimate.Estimate:
    return memory_estimate.estimate(scene, planner.make_plan(scene, ir.Settings(**{"backend": "ray", **settings})), linear)


def test_more_work_takes_more_memory(ball: ir.Scene) -> None:
    """One sample; several, with an error; rounds, with sums; floats and channels on disk."""
    single, several, rounds = needs(ball, samples=1), needs(ball, samples=4), needs(ball, error=0.05)
    assert single.pixel < several.pixel < rounds.pixel
    assert needs(ball, True, samples=4).pixel == several.pixel + 12
    assert needs(ball, True, samples=4, aov=("depth", "normal")).pixel == several.pixel + 12 + 2 * 4 * 4
    assert several.total(1000) == several.fixed + 1000 * several.pixel
    assert several.most_pixels(several.total(1000)) == 1000


def test_threads_count(ball: ir.Scene, tmp_path: Path) -> None:
    """64 threads take less than half a gigabyte more than two; with hits of many samples with formulas less than one."""
    (tmp_path / "c.scene").write_text(BALL + "implicit(|x, y, z| x * x + y * y + z * z * z * z <= 1)\n", encoding="utf-8")
    formula = maquette.load(tmp_path / "c.scene")
    cases: tuple[Any, ...] = (
        (ball, 0.5e9, {}), (ball, 0.5e9, {"backend": "raster"}),
        (formula, 0.4e9, {"samples": 16}), (formula, 1.0e9, {"samples": 4096}), (formula, 1.0e9, {"error": 1e-3}),
    )  # fmt: skip
    for scene, most, settings in cases:
        two, many = (needs(scene, size=(3840, 2160), threads=threads, **settings).fixed for threads in (2, 64))
        assert 0.1e9 < many - two < most


def test_a_mesh_counts(ball: ir.Scene, tmp_path: Path) -> None:
    mesh = "mesh(points: [[k, mod(k, 7), 0] for k in 0..2999], faces: [[3 * k, 3 * k + 1, 3 * k + 2] for k in 0..999])"
    (tmp_path / "b.scene").write_text(BALL.replace("sphere(1)", mesh), encoding="utf-8")
    assert needs(maquette.load(tmp_path / "b.scene")).fixed > needs(ball).fixed + 3000 * 12


def test_less_memory_makes_smaller_strips(ball: ir.Scene) -> None:
    """Strips of whole rows of tiles, which cover the picture once."""
    plan = planner.make_plan(ball, ir.Settings(backend="ray", size=(1000, 1000)))
    assert large_images.strip_plans(plan) == [plan]
    strips = [part["crop"] for part in large_images.strip_plans(plan, 300_000)]
    assert strips == [(0, 0, 1000, 288), (0, 288, 1000, 576), (0, 576, 1000, 864), (0, 864, 1000, 1000)]
    assert [part["crop"][3] for part in large_images.strip_plans(plan, 0)][:2] == [32, 64]


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    ["hello 200", "room 400", "vase 1000 raster", "ball 2000 error", "ball 2000 aovs", "ball 1000 denoised", "mesh ply", "texture 4096"],
)
def test_estimates_are_within_a_quarter_of_what_pictures_take(tmp_path: Path, name: str) -> None:
    """In processes of their own, with compiled kernels; `python tests/render/memory_cases.py` measures all cases."""
    if "denoised" in name:
        pytest.importorskip("pyoidn")
    expected, peak = memory_cases.measure(memory_cases.CASES[name], tmp_path)
    assert expected == pytest.approx(peak, rel=0.25)
