"""The channel of colours: of metals, mirrors and glass what they tint light with."""

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
