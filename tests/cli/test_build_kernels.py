"""General kernels: every example and every scene of one feature is drawn without compiling."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.cli import build_kernels
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.render import render_scene
from maquette.render.backends import kernel_choice
from maquette.render.jit import kernel_cache

from ..backends import alone

EXAMPLES = Path(maquette.__file__).parent / "examples"


@pytest.mark.long
def test_no_example_needs_another_kernel(monkeypatch):
    assert build_kernels.main() == 0
    monkeypatch.setenv(kernel_choice.VARIABLE, "general")
    missing = []
    for path in sorted([*EXAMPLES.glob("*.scene"), *EXAMPLES.glob("gallery/*.scene")]):
        scene = load.load(path)
        for backend in ("ray", "raster"):
            try:
                plan = planner.make_plan(scene, ir.Settings(size=(72, 40), samples=2, threads=1, backend=backend))
            except planner.PlanError:
                continue  # a panorama
            try:
                with kernel_cache.compiled_only():
                    render_scene.draw(scene, plan)
            except kernel_cache.NotCompiled as why:
                missing.append((path.name, backend, why.key))
    assert missing == []


@pytest.mark.long
@pytest.mark.parametrize("bounces", [0, 1])
def test_no_feature_alone_needs_another_kernel(monkeypatch, tmp_path, bounces):
    assert build_kernels.main() == 0
    monkeypatch.setenv(kernel_choice.VARIABLE, "general")
    path, missing = tmp_path / "a.scene", []
    for name, text in alone.every_scene().items():
        if '("' in text:  # it reads a file
            continue
        path.write_text(text, encoding="utf-8")
        scene = load.load(path)
        for backend in ("ray", "raster"):
            try:
                plan = planner.make_plan(scene, ir.Settings(size=(72, 40), samples=2, threads=1, bounces=bounces, backend=backend))
                with kernel_cache.compiled_only():
                    render_scene.draw(scene, plan)
            except planner.PlanError:
                continue  # a panorama
            except kernel_cache.NotCompiled as why:
                missing.append((name, backend, why.key))
    assert missing == []
