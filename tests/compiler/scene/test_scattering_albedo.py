"""Albedos of single and of all scattering: limits, the inverse, and coefficients."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler.scene import scattering_albedo
from maquette.compiler.scene.row_records import MediumData


@pytest.mark.parametrize("g", [-0.8, 0.0, 0.5, 0.95])
def test_both_albedos_are_inverse(g: float) -> None:
    for color in np.linspace(0.0, 1.0, 40).tolist():
        single = scattering_albedo.single_from_multiple((color, color, color), g)
        assert 0.0 <= single[0] <= 1.0
        assert scattering_albedo.multiple_from_single(single, g)[0] == pytest.approx(color, abs=2e-4)


def test_known_albedos() -> None:
    """1 − (4.09712 + 4.20863 c − √(9.59217 + 41.6808 c + 17.7126 c²))² of Kulla and Conty 2017."""
    assert scattering_albedo.single_from_multiple((0.0, 0.5, 1.0)) == pytest.approx((0.0, 0.91171, 1.0), abs=2e-4)


def test_coefficients_by_extinction() -> None:
    medium = scattering_albedo.by_extinction((10.0, 20.0, 0.0), (0.5, 1.0, 0.3), 0.2)
    assert medium == MediumData((5.0, 20.0, 0.0), (5.0, 0.0, 0.0), anisotropy=0.2)
    assert scattering_albedo.extinction(medium) == (10.0, 20.0, 0.0)
    assert scattering_albedo.albedo(medium) == (0.5, 1.0, 0.0)
