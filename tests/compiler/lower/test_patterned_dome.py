"""A dome that is a formula of the direction: its picture, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir

from .test_formulas import loaded, refused


def picture(scene: ir.Scene) -> np.ndarray:
    tables = scene.tables
    (dome,) = np.flatnonzero(tables.lights.kind == ir.LightKind.DOME)
    row = int(tables.lights.image[dome])
    first, width, height = int(tables.images.first[row]), int(tables.images.width[row]), int(tables.images.height[row])
    return tables.images.texels[first : first + width * height].reshape(height, width, 4)


def test_each_direction_has_what_the_formula_says(tmp_path):
    """The middle of the picture is +z, +x lies left of it, and its top is +y; below 0 there is no light. Units do not matter."""
    scene, said = loaded(tmp_path, "unit mm\nsphere(1)\ndome(pattern: |x, y, z| rgb(x, y, 2 * z + 1))")
    found = picture(scene)
    assert said == []
    h, w, _ = found.shape
    for column, line, way in ((w // 2, h // 2, (0, 0, 1)), (w // 4, h // 2, (1, 0, 0)), (0, 0, (0, 1, 0)), (0, h // 2, (0, 0, -1))):
        x, y, z = way
        assert found[line, column, :3] == pytest.approx((max(x, 0), max(y, 0), max(2 * z + 1, 0)), abs=0.01)


def test_a_number_is_grey_and_a_truth_value_white(tmp_path):
    assert np.unique(picture(loaded(tmp_path, "sphere(1)\ndome(pattern: |x, y, z| 0.25)")[0])[..., :3]).tolist() == [0.25]
    half = picture(loaded(tmp_path, "sphere(1)\ndome(pattern: |x, y, z| y > 0)")[0])
    assert half[: len(half) // 2, :, :3].min() == 1
    assert half[len(half) // 2 :, :, :3].max() == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("dome()", 'a dome has a picture or a pattern (write dome("sky.exr") or dome(pattern: |x, y, z| …))'),
        ("dome(pattern: |x, y| x)", "a pattern's formula has three parameters, x, y and z, not 2 (write |x, y, z| …)"),
        ("dome(pattern: |x, y, z| [x, y, z])", "a pattern here gives a number or a colour, not a list (write rgb(r, g, b))"),
    ],
)
def test_what_is_refused(tmp_path, text, message):
    assert refused(tmp_path, "sphere(1)\n" + text) == [message]
