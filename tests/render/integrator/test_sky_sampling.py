"""Tests of sky_sampling: pictures under an uneven dome keep their mean, and have little noise."""

from __future__ import annotations

from typing import Any

import maquette
import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler import load
from maquette.render.integrator import sky_sampling

MATERIALS = {
    "lambert": "lambert(0.6)",
    "phong": "phong(0.2, specular: 0.4, shininess: 30)",
    "blinn": "blinn_phong(0.2, specular: 0.4, shininess: 30)",
    "metal": "gold(roughness: 0.5)",
    "principled": "principled(#808080, roughness: 0.4)",
    "openpbr": "openpbr(base_color: #808080, specular_roughness: 0.5, coat_weight: 0.5, coat_roughness: 0.4)",
    "translucent": "translucent(0.4, transmission: 0.4)",
}
LOOK = "camera(position: [0, 2, 4], look_at: [0, 0.2, 0], fov: 25deg)\n"


def write_dome(folder: Any, peak: float, cells: int = 1) -> None:
    """A dome of 0.3 with a bright spot 60 degrees up, to the right of the camera."""
    picture = np.full((32, 64, 3), 0.3, np.float32)
    picture[10 : 10 + cells, 20 : 20 + cells] = peak
    out: Any = oiio.ImageOutput.create(str(folder / "dome.exr"))
    out.open(str(folder / "dome.exr"), oiio.ImageSpec(64, 32, 3, "float"))
    out.write_image(picture)
    out.close()


def scene_of(folder: Any, material: str, more: str = "") -> Any:
    path = folder / "a.scene"
    path.write_text(f'{LOOK}dome("dome.exr", rotate: [10deg, 40deg, 0])\nsphere(1, material: {material})\n{more}', encoding="utf-8")
    return path


def drawn(path: Any, **settings: Any) -> np.ndarray:
    return maquette.render(path, size=(16, 16), plan={"transport": "whitted"}, **settings).channels["rgba"]


QUICK = ("lambert", "phong", "metal")


@pytest.mark.parametrize("name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in MATERIALS])
def test_the_map_keeps_the_mean(name, tmp_path, monkeypatch):
    write_dome(tmp_path, 6.0, 4)  # lobes alone converge, too
    path = scene_of(tmp_path, MATERIALS[name], "plane(y: -1, material: lambert(0.4))")
    monkeypatch.setattr(sky_sampling, "LARGEST_RATIO", 10.0)
    by_map = drawn(path, backend="reference", samples=64)
    monkeypatch.setattr(sky_sampling, "LARGEST_RATIO", 0.0)
    by_lobes = drawn(path, backend="reference", samples=256)
    assert by_map.mean((0, 1)) == pytest.approx(by_lobes.mean((0, 1)), rel=0.01)
    error = np.abs(by_map - by_lobes)[..., :3].mean() / by_lobes[..., :3].mean()
    assert error < (0.1 if name == "translucent" else 0.05)  # lobes alone are noisier from two sides


@pytest.mark.parametrize("backend", ["ray", "raster"])
def test_a_spot_of_a_dome_is_no_fireflies(backend, tmp_path):
    write_dome(tmp_path, 2000.0)
    path = tmp_path / "a.scene"
    look = "camera(position: [0, 3, 0.1], look_at: [0, 0, 0], fov: 25deg)"
    path.write_text(f'{look}\ndome("dome.exr", rotate: [10deg, 40deg, 0])\nplane(y: 0, material: lambert(0.6))\n', encoding="utf-8")
    picture, truth = drawn(path, backend=backend, samples=16)[..., :3], drawn(path, backend="reference", samples=256)[..., :3]
    assert picture.mean() == pytest.approx(truth.mean(), rel=0.01)
    assert picture.std() < 0.25 * truth.mean()  # lobes alone: 4


def test_an_even_dome_and_general_kernels_sample_lobes(tmp_path):
    write_dome(tmp_path, 0.4)
    tables = load.load(scene_of(tmp_path, "lambert(0.6)")).tables
    assert sky_sampling.find_dome_map(tables, None) == sky_sampling.NoDomeMap()
    general = sky_sampling.find_dome_map(tables, None, general=True)
    assert isinstance(general, sky_sampling.DomeMap)
    assert (general.light, general.share) == (-1, 0.0)
