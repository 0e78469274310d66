"""The colour temperature of a scene's lights."""

from __future__ import annotations

import pytest
from maquette.compiler.plan import light_temperature


@pytest.mark.parametrize("kelvin", [2200, 2700, 4000, 6500, 9000])
@pytest.mark.parametrize("light", ["point([0, 3, 0], flux: 900lm", "area([0, 3, 0], size: 1, flux: 900lm", "sky(luminance: 100nit"])
def test_one_light_has_its_temperature(compiled, kelvin: int, light: str) -> None:
    found = light_temperature.of_lights(compiled(f"sphere(1)\n{light}, color: kelvin({kelvin}))").tables)
    assert found == pytest.approx(kelvin, rel=0.02)


def test_the_brighter_light_counts_more(compiled) -> None:
    text = "sphere(1)\npoint([0, 3, 0], flux: 900lm, color: kelvin(2700))\npoint([0, 3, 0], flux: 10lm, color: kelvin(9000))"
    assert light_temperature.of_lights(compiled(text).tables) == pytest.approx(2750, abs=60)


def test_green_light_has_no_temperature(compiled) -> None:
    assert light_temperature.of_lights(compiled("sphere(1)\npoint([0, 3, 0], color: #00ff00)").tables) == 0.0
