"""Solids of straight profiles are drawn as the shapes they describe: the same picture to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.render.render_scene import draw

VIEW = "\ncamera([0.5, 2, 6], look_at: [0, 0.6, 0], fov: 30deg)\nsun(from: [2, 4, 3])\n"


def picture(folder: Path, text: str) -> np.ndarray:
    path = folder / "a.scene"
    path.write_text(text + VIEW, encoding="utf-8")
    scene = load.load(path)
    image = draw(scene, planner.make_plan(scene, ir.Settings(size=(96, 96), samples=1, backend="ray")))
    assert image.metadata["issues"] == 0
    return image.channels["rgba"]


@pytest.mark.parametrize(
    ("swept", "shape"),
    [
        ("revolve([[0, 0], [1, 0], [0.4, 1.5], [0, 1.5]])", "cone(1, 1.5, top: 0.4, center: [0, 0.75, 0])"),
        ("revolve([[0, 0], [1, 0], [1, 1.5], [0, 1.5]])", "cylinder(1, 1.5, center: [0, 0.75, 0])"),
        ("extrude([[-1, -1], [1, -1], [1, 1], [-1, 1]], 1.5)", "box([2, 1.5, 2], center: [0, 0.75, 0])"),
    ],
)
def test_a_swept_solid_is_its_shape(tmp_path, swept, shape):
    found, expected = picture(tmp_path, f"union {{ {swept} }}"), picture(tmp_path, shape)
    assert (expected[..., 3] > 0).mean() > 0.1
    assert np.array_equal(found, expected)
