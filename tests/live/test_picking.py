"""Luminance at a place of the picture."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.live import picking
from maquette.live.passes import Shown


def test_the_luminance_of_a_place() -> None:
    rgba = np.zeros((2, 4, 4), np.float32)
    rgba[1, 3] = 100.0, 200.0, 50.0, 1.0
    rgba[0, 0, 0] = np.nan
    shown = Shown(rgba, {})
    assert picking.luminance(shown, 0.9, 0.9) == pytest.approx(0.2126 * 100 + 0.7152 * 200 + 0.0722 * 50, rel=1e-3)
    assert picking.luminance(shown, 1.0, 1.0) == picking.luminance(shown, 0.9, 0.9)
    assert picking.luminance(shown, 0.0, 0.0) is None
