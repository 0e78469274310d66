"""NaN and infinity never reach a picture: such samples are omitted and counted, on every backend and transport."""

from __future__ import annotations

import maquette
import numpy as np
import pytest

from . import scenes

TEXT = scenes.CAMERA + scenes.FLOOR + scenes.SHAPES
CASES = {  # light that overflows, or a lamp in a surface
    "as bright as may be": "point([3, 5, 4], intensity: 1e18)\n",
    "too bright for float32": "directional(from: [0, 1, 0], illuminance: 1e18, color: rgb(1e18, 1e18, 1e5))\n"
    "point([3, 5, 4], intensity: 1e18, color: rgb(1e18, 1e18, 1e18), falloff: [1e-18, 0, 0])\n",
    "a lamp on the floor": "point([0.5, -0.01, 1], intensity: 5)\narea([1, -0.01, 1.2], size: 0.5, luminance: 5)\n",
    "a lamp of no size to speak of": "area([0, 3, 0], size: 1e-12, luminance: 1e18)\n",
}


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(("backend", "bounces"), [("reference", None), ("ray", None), ("raster", None), ("ray", 2), ("reference", 2)])
def test_pictures_are_finite(tmp_path, name, backend, bounces):
    path = tmp_path / "a.scene"
    path.write_text(TEXT + CASES[name])
    asked = {"size": (24, 18), "samples": 4, "threads": 1, "aov": ("variance", "albedo", "normal")}
    image = maquette.render(path, backend=backend, bounces=bounces, **asked)
    for channel, values in image.channels.items():
        assert np.isfinite(values).all(), channel
    if name == "too bright for float32":
        assert image.metadata["issues"] > 0


def test_what_is_left_out_is_said(tmp_path):
    from maquette.render import picture_notes

    assert picture_notes.invalid_sample_warnings(0) == []
    (said,) = picture_notes.invalid_sample_warnings(1234)
    assert said.message == "the light of 1,234 samples was infinite or no number, and left out of the picture"
