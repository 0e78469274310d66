"""Tests of the bright spots of domes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.plan import dome_spots

REST = "sphere(1)\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n"


@pytest.fixture
def found(tmp_path):
    def run(text):
        path = tmp_path / "a.scene"
        path.write_text(text + REST, encoding="utf-8")
        return dome_spots.find(load.load(path).tables)

    return run


def disk(x, y, z, cosine=0.999, luminance=3000):
    """The formula of a disk of light around a direction."""
    return f"{luminance} * min(max(1e5 * ({x} * x + {y} * y + {z} * z - {cosine}), 0), 1)"


def test_a_sun_in_an_even_sky(found):
    """Its cells hold its light, within the neighbors that interpolation reaches."""
    spots = found(f"dome(pattern: |x, y, z| 1 + {disk(0.6, 0.8, 0)})\n")
    assert spots is not None
    assert spots.count == 1
    light = np.where(spots.cells, spots.luminance, 0.0) * spots.solid
    assert light.sum() == pytest.approx(3000 * 2 * math.pi * 0.001, rel=0.1)
    row, column = np.argwhere(spots.cells).mean(axis=0)
    height, width = spots.cells.shape
    assert math.cos(math.pi * (row + 0.5) / height) == pytest.approx(0.8, abs=0.03)
    assert 2 * math.pi * (0.5 - (column + 0.5) / width) == pytest.approx(math.atan2(0.6, 0.0), abs=0.05)


@pytest.mark.long
def test_spots_are_counted_across_the_seam(found):
    spots = found(f"dome(pattern: |x, y, z| 1 + {disk(0, 0, -1)} + {disk(0.6, 0.8, 0)})\n")
    assert spots is not None
    assert spots.count == 2


@pytest.mark.parametrize("text", [
    "dome(pattern: |x, y, z| 1 + y)\n",
    "sky(luminance: 2)\n",
    f"dome(pattern: |x, y, z| 1 + {disk(0.6, 0.8, 0, 0.9, 200)})\n",  # too wide
    f"dome(pattern: |x, y, z| 1 + {disk(0.6, 0.8, 0, 0.9995, 100)})\n",  # too faint
    f"dome(pattern: |x, y, z| 1 + {disk(0.6, 0.8, 0)}, shadows: false)\n",
    f"sky()\ndome(pattern: |x, y, z| 1 + {disk(0.6, 0.8, 0)})\n",
])  # fmt: skip
def test_none(found, text):
    assert found(text) is None
