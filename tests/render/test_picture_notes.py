"""Notes about pictures: those that their exposure shows as black."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
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


@pytest.mark.parametrize(
    ("light", "exposure", "expected"), [(0.0003, None, [FAINT]), (0.0003, 12.0, []), (0, None, [BLACK]), (0.3, None, [])]
)
def test_a_black_picture_is_told(tmp_path: Path, light: float, exposure: float | None, expected: list[str]) -> None:
    (tmp_path / "a.scene").write_text(SCENE.format(light=light), encoding="utf-8")
    scene = maquette.load(tmp_path / "a.scene")
    plan = planner.make_plan(scene, ir.Settings(size=(32, 24), samples=1, exposure=exposure))
    image = render_scene.draw(scene, plan)
    notes = picture_notes.exposure_notes(image.metadata)
    assert [render_text(each, lambda file: None) for each in notes] == expected


LAMP = """\
sphere(0.03, center: [{x}, 0, 0], material: emissive(50))
sphere(2, center: [0, 0, -3], material: lambert(0))
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)
render(background: #000, bounces: 0)
"""
CROP = "the crop is black: no light reaches what it shows"
TINY = "the picture is black: no light reaches what the camera sees"


@pytest.mark.parametrize(
    ("text", "size", "crop", "expected"),
    [
        (LAMP.format(x=0.5), (64, 48), None, []),  # three pixels are bright
        (LAMP.format(x=0.5), (64, 48), (26, 20, 32, 28), [CROP]),
        (LAMP.format(x=0.5), (64, 48), (33, 20, 41, 28), []),
        (SCENE.format(light=0), (1, 1), None, [TINY]),
        (SCENE.format(light=0), (8, 8), None, [TINY]),
        (SCENE.format(light=0.5), (1, 1), None, []),
        (SCENE.format(light=0.5), (8, 8), (3, 3, 4, 4), []),
        (SCENE.format(light=0.5), (8, 8), (0, 0, 1, 1), []),  # nothing is there
    ],
)
def test_a_picture_with_any_light_is_not_black(
    tmp_path: Path, text: str, size: tuple[int, int], crop: tuple[int, int, int, int] | None, expected: list[str]
) -> None:
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    plan = planner.make_plan(maquette.load(tmp_path / "a.scene"), ir.Settings(size=size, crop=crop, samples=64))
    image = render_scene.draw(maquette.load(tmp_path / "a.scene"), plan)
    assert [each.message for each in picture_notes.exposure_notes(image.metadata)] == expected


CAUSTIC = """\
plane(y: 0, material: lambert(0.7))
sphere(0.5, center: [0, 0.7, 0], material: glass())
sphere(0.02, center: [1.5, 3, 0.5], material: emissive(20000))
camera(position: [0, 2, 4], look_at: [0, 0.3, 0], fov: 40deg)
render(bounces: 6)
"""


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_stray_bright_samples_are_told_where_they_are(tmp_path: Path, seed: int) -> None:
    """Few paths find a caustic of a small lamp. Some seeds have a pixel with most of the true error, others have none."""
    (tmp_path / "a.scene").write_text(CAUSTIC, encoding="utf-8")
    scene = maquette.load(tmp_path / "a.scene")
    truth = scene.render(size=(48, 36), samples=512, seed=99).channels["rgba"][..., :3].astype(np.float64)
    image = scene.render(size=(48, 36), samples=16, seed=seed)
    light = np.square(truth)
    errors = np.square(image.channels["rgba"][..., :3] - truth).mean(axis=2) / (light.mean(axis=2) + 1e-4 * light.mean())
    share = errors.max() / errors.sum()
    assert not 0.3 < share < 0.6  # one or the other
    messages = [each.message for each in picture_notes.sparse_error_notes(image.metadata)]
    assert [message.split(": ")[1] for message in messages] == ["stray bright samples, so the error is uncertain"] * bool(share > 0.5)


@pytest.mark.parametrize(("denoised", "crop", "expected"), [(True, (0, 0, 8, 8), 1), (True, None, 0), (False, (0, 0, 8, 8), 0)])
def test_a_denoised_crop_is_told(tmp_path: Path, denoised: bool, crop: tuple[int, int, int, int] | None, expected: int) -> None:
    (tmp_path / "a.scene").write_text(SCENE.format(light=1), encoding="utf-8")
    plan = planner.make_plan(maquette.load(tmp_path / "a.scene"), ir.Settings(size=(32, 24), crop=crop))
    notes = picture_notes.cropped_notes({"denoised": denoised}, plan)
    message = (
        "note: the crop is denoised without the pixels around it: at its edges it may differ from the whole picture\n"
        "  a crop that is 96 pixels larger on each side has the same pixels inside, or --no-denoise"
    )
    assert [render_text(each, lambda file: None) for each in notes] == [message] * expected


def test_a_picture_knows_what_light_it_leaves_out(tmp_path: Path) -> None:
    text = "sphere(1)\nplane(y: -1)\ndirectional([0, 1, 0])\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n"
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    metadata = maquette.render(tmp_path / "a.scene", size=(8, 6), samples=1).metadata
    assert (metadata["bias"], metadata["left_out"]) == (None, ("light that diffuse surfaces send on is left out",))
