"""Estimates of memory: arrays that the film holds, and their order."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.render import large_images, memory_estimate

BALL = "sphere(1)\npoint([2, 4, 3], intensity: 20)\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n"


@pytest.fixture
def ball(tmp_path: Path) -> ir.Scene:
    (tmp_path / "a.scene").write_text(BALL, encoding="utf-8")
    return maquette.load(tmp_path / "a.scene")


def needs(scene: ir.Scene, linear: bool = False, **settings: Any) -> memory_estimate.Estimate:
    return memory_estimate.estimate(scene, planner.make_plan(scene, ir.Settings(**{"backend": "ray", **settings})), linear)


def test_more_work_takes_more_memory(ball: ir.Scene) -> None:
    """One sample; several, with an error; rounds, with sums; floats and channels on disk."""
    one, several, rounds = needs(ball, samples=1), needs(ball, samples=4), needs(ball, error=0.05)
    assert one.pixel < several.pixel < rounds.pixel
    assert needs(ball, True, samples=4).pixel == several.pixel + 12
    assert needs(ball, True, samples=4, aov=("depth", "normal")).pixel == several.pixel + 12 + 2 * 4 * 4
    assert several.total(1000) == several.fixed + 1000 * several.pixel
    assert several.most_pixels(several.total(1000)) == 1000


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


PEAK = """
import resource, subprocess, sys
subprocess.run([sys.executable, "-P", "-m", "maquette", "render", *sys.argv[1:]], check=True, capture_output=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
"""
LIT = "plane(y: -1)\nsphere(1)\n"
LIT += "area(position: [2, 4, 3], look_at: [0, 0, 0], size: 2, luminance: 20)\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n"


@pytest.mark.long
@pytest.mark.parametrize(
    ("size", "settings", "options"),
    [
        (5000, {"samples": 1}, ["--samples", "1"]),
        (4000, {"samples": 2}, ["--samples", "2"]),
        (4000, {"samples": 2, "backend": "raster"}, ["--samples", "2", "--backend", "raster"]),
        (4000, {"samples": 2, "denoise": True}, ["--samples", "2", "--denoise"]),
    ],
)
def test_estimates_are_within_a_quarter_of_what_large_pictures_take(
    tmp_path: Path, size: int, settings: dict[str, Any], options: list[str]
) -> None:
    if settings.get("denoise"):
        pytest.importorskip("pyoidn")
    scene = tmp_path / "a.scene"
    scene.write_text(LIT, encoding="utf-8")
    loaded = maquette.load(scene)
    plan = planner.make_plan(loaded, ir.Settings(size=(size, size), **{"denoise": False, **settings}))
    said = memory_estimate.estimate(loaded, plan, False).total(size * size)
    more = [] if settings.get("denoise") else ["--no-denoise"]
    command = [sys.executable, "-c", PEAK, str(scene), "--size", f"{size}x{size}", *options, *more, "-o", str(tmp_path / "a.png")]
    peak = int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    assert said == pytest.approx(peak, rel=0.25)
