"""Notes about pictures: those that their exposure shows as black."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.lang.diagnostics import render_text
from maquette.render import picture_notes, render_scene

SCENE = "sphere(1)\nambient(luminance: {light})\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n"
FAINT = (  # 0.8 of the ambient light
    "note: the picture is black: its brightest pixels have 0.00024 of the light of white, at an exposure of 0\n"
    "  --exposure 12 shows it, or brighter lights"
)
BLACK = "note: the picture is black: no light reaches what the camera sees\n  --aov depth shows the shapes"


@pytest.mark.parametrize(("light", "exposure", "told"), [(0.0003, None, [FAINT]), (0.0003, 12.0, []), (0, None, [BLACK]), (0.3, None, [])])
def test_a_black_picture_is_told(tmp_path: Path, light: float, exposure: float | None, told: list[str]) -> None:
    (tmp_path / "a.scene").write_text(SCENE.format(light=light), encoding="utf-8")
    scene = maquette.load(tmp_path / "a.scene")
    plan = planner.make_plan(scene, ir.Settings(size=(32, 24), samples=1, exposure=exposure))
    image = render_scene.draw(scene, plan)
    found = picture_notes.exposure_notes(image.metadata)
    assert [render_text(each, lambda file: None) for each in found] == told
