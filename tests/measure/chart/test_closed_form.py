"""Closed forms against the ray backend to float32, and scenes without a closed form."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.measure.chart import closed_form, reference_light

ABOVE = "camera(position: [0, 3, 0.001], look_at: [0, 0, 0], fov: 40deg)\n"
SUNS = "directional(from: [1, 2, -1], illuminance: 3, color: #a0c0ff)\ndirectional(from: [0, 1, 3], illuminance: 1)\n"
GREY = "material: lambert(#d0a060)"
KNOWN = {
    "a plane": ABOVE + SUNS + f"plane(y: 0, {GREY})\n",
    "a plane from below": ABOVE.replace("3, 0.001", "-3, 0.001") + SUNS + f"plane(y: 0, {GREY})\n",
    "a plane in ambient light": ABOVE + SUNS + f"ambient(#ffeecc, luminance: 0.5)\nplane(y: 0, {GREY})\n",
    "a turned plane": ABOVE + SUNS + f"plane(y: 0, rotate: [10deg, 0, 5deg], {GREY})\n",
    "orthographic": "camera(position: [1, 2, 3], look_at: [0, 0, 0], width: 4)\n" + SUNS + f"plane(y: 0, {GREY})\n",
}
UNKNOWN = {
    "a ball too": KNOWN["a plane"] + "sphere(0.2, center: [0, 0.2, 0])\n",
    "a point light": KNOWN["a plane"] + "point([0, 2, 0], intensity: 3)\n",
    "a texture": KNOWN["a plane"].replace("lambert(#d0a060)", "lambert(checker(#ffffff, #000000))"),
    "a highlight": KNOWN["a plane"].replace("lambert(#d0a060)", "phong(#d0a060, specular: 0.5)"),
    "a mirror": KNOWN["a plane"].replace("lambert(#d0a060)", "mirror()"),
    "the horizon": KNOWN["a plane"].replace("look_at: [0, 0, 0]", "look_at: [0, 3, -9]"),
    "a far plane": KNOWN["a plane"].replace("fov: 40deg", "fov: 40deg, far: 2"),
    "a sky": KNOWN["a plane"] + "sky(luminance: 1)\n",
}


def found(text: str, folder: Path) -> tuple[ir.Scene, reference_light.ReferenceLight, closed_form.ConstantPicture | None]:
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    scene = maquette.load(path)
    light = reference_light.choose(scene, ir.Settings(size=(24, 18)))
    return scene, light, closed_form.recognize(scene, light.plan(scene))


@pytest.mark.parametrize("name", KNOWN)
def test_the_closed_form_is_what_is_drawn(name: str, tmp_path: Path) -> None:
    scene, light, known = found(KNOWN[name], tmp_path)
    assert known is not None
    exact = {"transport": "whitted"}  # paths look at one of several suns at a time
    image = maquette.render(scene, size=(24, 18), samples=4, bounces=light.bounces or 0, plan=exact)
    np.testing.assert_allclose(image.channels["rgba"], np.broadcast_to((*known.rgb, known.alpha), (18, 24, 4)), rtol=1e-6, atol=1e-12)
    assert max(known.rgb) > 0 or name == "a plane from below"


@pytest.mark.parametrize("background", ["transparent", (0.1, 0.2, 0.4)])
def test_nothing_but_the_background(background: str | tuple[float, float, float], tmp_path: Path) -> None:
    text = KNOWN["a plane"]
    scene, light, _ = found(text, tmp_path)
    unseen = scene.tables.instances._replace(visible=scene.tables.instances.visible & ~np.int32(ir.Visibility.CAMERA))
    scene = ir.Scene(scene.name, scene.tables._replace(instances=unseen), settings=ir.Settings(background=background))
    known = closed_form.recognize(scene, light.plan(scene))
    assert known is not None
    image = maquette.render(scene, size=(24, 18), samples=4)
    np.testing.assert_allclose(image.channels["rgba"][..., :3], np.broadcast_to(known.rgb, (18, 24, 3)), rtol=1e-6)
    assert image.channels["rgba"][..., 3].max() == known.alpha == 0.0


@pytest.mark.parametrize("name", UNKNOWN)
def test_what_has_no_closed_form_is_not_recognised(name: str, tmp_path: Path) -> None:
    assert found(UNKNOWN[name], tmp_path)[2] is None
