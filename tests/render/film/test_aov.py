"""Tests of auxiliary channels: albedo of metals, mirrors and glass, and unproven roots of formulas."""

from __future__ import annotations

import maquette
import numpy as np
import pytest

TINTS = {
    "lambert(rgb(0.2, 0.4, 0.6))": (0.2, 0.4, 0.6), "mirror(rgb(0.9, 0.5, 0.1))": (0.9, 0.5, 0.1),
    "glass(color: rgb(0.3, 0.9, 0.8))": (0.3, 0.9, 0.8),
}  # fmt: skip


def seen(tmp_path, material):
    path = tmp_path / "a.scene"
    path.write_text(f"camera(position: [0, 0, 3], look_at: [0, 0, 0])\nsphere(1, material: {material})\n", encoding="utf-8")
    image = maquette.render(path, size=(3, 3), samples=1, backend="reference", aov=("albedo",))
    return image.channels["albedo"][1, 1]


@pytest.mark.parametrize("material", TINTS)
def test_tints(tmp_path, material):
    assert seen(tmp_path, material) == pytest.approx(TINTS[material], abs=1e-6)


def test_gold_is_not_black(tmp_path):
    red, green, blue = seen(tmp_path, 'metal("gold")')
    assert np.all(np.array([red, green, blue]) > 0.2)
    assert red > green > blue


def test_pixels_that_are_not_proved_are_seen(tmp_path):
    """Waves finer than rays can be cut lie left of a box with round edges: their pixels are counted and shown, and none of the box."""
    path = tmp_path / "doubtful.scene"
    path.write_text(
        "camera(position: [0, 2.5, 6], look_at: [0, 0, 0])\ndirectional(from: [1, 2, 3], shadows: false)\n"
        "implicit(|x, y, z| 0.1 * sin(1e8 * x) >= y, within: 0.8, translate: [-1, 0, 0])\n"
        "implicit(|x, y, z| x^4 + y^4 + z^4 <= 0.2, within: 1, translate: [1, 0, 0])\n",
        encoding="utf-8",
    )
    counted = maquette.render(path, size=(24, 24), samples=1, backend="ray").metadata["unproved"]
    image = maquette.render(path, size=(24, 24), samples=1, backend="ray", aov=("issues", "id"))
    doubtful, instances = image.channels["issues"][..., 0], image.channels["id"][..., 0]
    assert abs(counted - doubtful.sum()) <= 2  # rays as a bundle and one by one need not leave the same open
    assert doubtful[:, :12].sum() > 10
    assert (instances == 1).sum() > 10
    assert not doubtful[:, 12:].any()
