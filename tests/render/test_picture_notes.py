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


@pytest.mark.parametrize(("denoised", "crop", "told"), [(True, (0, 0, 8, 8), 1), (True, None, 0), (False, (0, 0, 8, 8), 0)])
def test_a_denoised_crop_is_told(tmp_path: Path, denoised: bool, crop: tuple[int, int, int, int] | None, told: int) -> None:
    (tmp_path / "a.scene").write_text(SCENE.format(light=1), encoding="utf-8")
    plan = planner.make_plan(maquette.load(tmp_path / "a.scene"), ir.Settings(size=(32, 24), crop=crop))
    found = picture_notes.cropped_notes({"denoised": denoised}, plan)
    message = (
        "note: the crop is denoised without the pixels around it: at its edges it may differ from the whole picture\n"
        "  a crop that is 96 pixels larger on each side has the same pixels inside, or --no-denoise"
    )
    assert [render_text(each, lambda file: None) for each in found] == [message] * told


def test_a_picture_knows_what_light_it_leaves_out(tmp_path: Path) -> None:
    text = "sphere(1)\nplane(y: -1)\ndirectional([0, 1, 0])\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n"
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    found = maquette.render(tmp_path / "a.scene", size=(8, 6), samples=1).metadata
    assert (found["bias"], found["left_out"]) == (None, ("light that diffuse surfaces send on is left out",))
