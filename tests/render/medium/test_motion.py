"""Media of shapes that move while the shutter is open, against the mean of still pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.lang.diagnostics import SceneWarning

STILLS = 8
TEXT = """camera(position: [0, 0.5, 4], look_at: [0, 0, 0], fov: 35deg{shutter})
sky(radiance: 1)
directional(from: [1, 2, 1], irradiance: 2)
plane(y: -1, material: lambert(0.6))
translate([3 * (time + {start}s) / 1s - 0.5, 0, 0]) {{ rotate([0, 0, 60deg * (time + {start}s) / 1s]) {{
  box([1.2, 0.8, 1], medium: medium(scattering: 4, absorption: [1, 3, 6]{density})) }} }}
"""
DENSITIES = {"even": "", "formula": ", density: |x, y, z| max(0, 1.5 * x + 0.75)"}


def drawn(tmp_path: Path, density: str, start: float, shutter: bool, **settings: Any) -> np.ndarray:
    path = tmp_path / "a.scene"
    text = TEXT.format(shutter=", shutter: 400ms" if shutter else "", start=start, density=DENSITIES[density])
    path.write_text(text, encoding="utf-8")
    settings = {"size": (12, 8), "denoise": False, "bounces": 6, "backend": "reference", **settings}
    return maquette.load(path).render(**settings).channels["rgba"][..., :3]


@pytest.mark.parametrize("backend", ["ray", pytest.param("reference", marks=pytest.mark.long)])
@pytest.mark.parametrize("density", DENSITIES)
def test_a_medium_moves_with_its_shape(tmp_path: Path, density: str, backend: str) -> None:
    moving = drawn(tmp_path, density, 0.0, True, samples=64, seed=2, backend=backend)
    times = [0.4 * (k + 0.5) / STILLS for k in range(STILLS)]
    stills = np.mean([drawn(tmp_path, density, t, False, samples=8, seed=5, backend=backend) for t in times], axis=0)
    first = drawn(tmp_path, density, 0.0, False, samples=64, seed=2, backend=backend)
    away, still_away = (np.sqrt(np.mean((picture - stills) ** 2)) for picture in (moving, first))
    assert away < 0.3 * still_away
    assert moving.mean(axis=(0, 1)) == pytest.approx(stills.mean(axis=(0, 1)), rel=0.02)


def test_a_density_stays_in_a_shape_that_stands_still_beside_one_that_moves(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    still = "sphere(0.5, center: [0, 0, 0], medium: medium(absorption: 2, density: |x, y, z| 1 + x))\n"
    move = "translate([{}, 0, 0]) {{ sphere(0.2, center: [0, 2, 0], medium: medium(absorption: 1, density: |x, y, z| 1 + x)) }}\n"
    pictures = []
    for shutter, place in ((", shutter: 100ms", "time / 1s"), ("", "0")):
        look = f"camera(position: [0, 0, 4], look_at: [0, 0, 0], fov: 10deg{shutter})\nsky(radiance: 1)\n"
        path.write_text(look + still + move.format(place), encoding="utf-8")
        pictures.append(maquette.load(path).render(size=(8, 8), samples=64, denoise=False, backend="ray").channels["rgba"])
    assert pictures[0] == pytest.approx(pictures[1], abs=0.12)
    assert pictures[0].mean() == pytest.approx(pictures[1].mean(), rel=5e-3)


@pytest.mark.parametrize(
    ("medium", "expected"),
    [
        ("absorption: 1 + time / 1s", "this medium changes"),
        ("absorption: 1, density: |x, y, z| 2 + x * time / 1s", "the density of this medium changes"),
    ],
)
def test_a_medium_that_changes_is_told_of(tmp_path: Path, medium: str, expected: str) -> None:
    path = tmp_path / "a.scene"
    path.write_text(
        "camera(position: [0, 0, 4], look_at: [0, 0, 0], shutter: 100ms)\nsky(radiance: 1)\n" f"sphere(1, medium: medium({medium}))\n",
        encoding="utf-8",
    )
    with pytest.warns(SceneWarning, match=f"{expected} while the shutter is open: it is drawn as it is at the opening"):
        maquette.load(path)
