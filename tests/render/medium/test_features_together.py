"""Photons, slabs, bodies, dispersion and media in one scene: records of kernels have a field for each, see test_record_constructions."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner

pytestmark = pytest.mark.long
SCENE = """
sphere(0.3, center: [-0.4, 0.3, 0], material: glass(ior: 1.5{dispersion}))
sphere(0.3, center: [0.4, 0.3, 0], material: openpbr(#4060c0, coat_weight: 1, specular_roughness: 0.3))
sphere(0.25, center: [0, 0.25, 0.6], material: openpbr(subsurface_weight: 1, subsurface_color: #e0a080, subsurface_radius: 5mm))
box([3, 1.5, 3], center: [0, 0.7, 0], medium: medium(#ffffff, depth: 5m{density}))
plane(material: lambert(#888888))
point([-1.2, 1.4, 0.4], intensity: 50)
camera(position: [0, 1, 2.4], look_at: [0, 0.25, 0], fov: 45deg)
"""


@pytest.mark.parametrize(("dispersion", "density"), [("", ""), (", dispersion: 1", ", density: |x, y, z| 1 + 0.5 * sin(9 * x)")])
def test_photons_reach_slabs_bodies_and_media(tmp_path: Path, dispersion: str, density: str) -> None:
    path = tmp_path / "a.scene"
    path.write_text(SCENE.format(dispersion=dispersion, density=density), encoding="utf-8")
    scene = maquette.load(path)
    assert planner.make_plan(scene, ir.Settings(size=(12, 8)))["transport.caustics"] == "photons"
    first, second = (scene.render(size=(12, 8), samples=2, bounces=16, denoise=False, threads=n).channels["rgba"] for n in (1, 2))
    assert np.array_equal(first, second)
    assert np.isfinite(first).all()
    assert first[..., :3].mean() > 0.01
