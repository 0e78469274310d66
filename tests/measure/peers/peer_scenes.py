"""Scenes rendered by maquette and by peers, and the difference of two pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import maquette
import numpy as np
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.measure.peers import registry
from maquette.measure.records import Setting
from maquette.render import render_scene
from maquette.render.image import metrics

VIEW = "render(size: [96, 64])\ncamera(position: [0.5, 1.6, 5], look_at: [0, 0.8, 0], fov: 40deg)\n"
FLOOR = "plane(y: 0, material: lambert(#cccccc))\n"
BALL = "sphere(0.8, center: [0, 0.8, 0], material: lambert(rgb(0.7, 0.2, 0.1)))\n"
BLOCK = "box(0.5, center: [1.3, 0.25, 0.5], rotate: [0, 20deg, 0], material: lambert(#80c080))\n"
CHECKER = "plane(y: 0, material: lambert(checker(rgb(0.8, 0.8, 0.8), rgb(0.1, 0.2, 0.3), size: 0.3, offset: [0.2, 0.3])))\n"
STRIPES = "plane(y: 0, material: lambert(stripes(rgb(0.8, 0.8, 0.8), rgb(0.1, 0.2, 0.3), size: 0.3, angle: 30deg)))\n"
LAMP = "point(position: [2, 4, 3], intensity: 50)\n"
SPOT = "spot(position: [2, 4, 3], look_at: [0, 0.4, 0], cone: 15deg, soft: 8deg, intensity: 50)\n"
SUN = "sun(from: [2, 4, 3], angle: 3deg, irradiance: 3)\n"
SHINING = "sphere(0.4, center: [0, 0.8, 0], material: emissive(rgb(0.5, 0.2, 0.1), radiance: 10))\n"
SKY = "sky(color: rgb(0.4, 0.6, 1.0))\n"
PICTURE = """mesh(points: [[-1, 1, 0], [1, 1, 0], [1, 2, 0], [-1, 2, 0]], faces: [[0, 1, 2, 3]], uv: [[0, 0], [2, 0], [2, 1], [0, 1]],
     material: lambert(image("noise.exr", space: "linear", scale: [0.8, 1.3])))
"""
GLASS = "sphere(0.8, center: [0, 0.8, 0], material: glass(rgb(0.9, 0.95, 0.8), ior: 1.5))\n"
MIRROR = "sphere(0.8, center: [0, 0.8, 0], material: mirror(rgb(0.9, 0.8, 0.7)))\n"
ORTHOGRAPHIC = """render(size: [96, 64])
camera(position: [0.5, 1.6, 5], look_at: [0, 0.8, 0], width: 4, shift: [0.1, -0.05])
"""
SHIFTED = """render(size: [96, 64], crop: [10, 4, 90, 61])
camera(position: [0.5, 1.6, 5], look_at: [0, 0.8, 0], fov: 30deg, shift: [0.2, -0.15])
"""
ROUND = """cylinder(0.4, 1, center: [-1.5, 0.5, 0], rotate: [0, 0, 20deg], material: lambert(#c04040))
cone(0.5, 1, top: 0.2, center: [-0.5, 0.5, 0], material: lambert(#40c040))
torus(0.4, 0.15, center: [0.7, 0.4, 0], rotate: [60deg, 0, 0], material: lambert(#4040c0))
disk(0.4, center: [1.7, 0.5, 0], normal: [0.3, 0.4, 1])
ellipsoid([0.3, 0.5, 0.4], center: [1.2, 0.6, 1])
quadric([1, -1, 1, 0.2, 0.1, -0.1, 0.05, 0, 0, -0.05], within: 1, translate: [-0.4, 0.5, 1.5], material: lambert(#a0a040))
"""


def compiled(folder: Path, text: str, **settings: Any) -> tuple[ir.Scene, planner.Plan]:
    """A scene of `text` and its plan with the box filter and unfiltered textures, as in peers."""
    source = folder / "scene.scene"
    source.write_text(text)
    scene = maquette.load(source)
    asked = ir.Settings(**{"filter": "box", **settings})
    common = registry.common_overrides(planner.make_plan(scene, asked))
    return scene, planner.make_plan(scene, asked, {name: value for name, value in common.items() if name != "filter"})


def both(name: str, folder: Path, text: str, ours: int, theirs: int, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
    """(ours, the peer's) linear pictures of a scene that the peer supports."""
    scene, plan = compiled(folder, text, samples=ours, **settings)
    (peer,) = registry.find([name])
    assert peer.unsupported(scene, plan) == []
    run = peer.run(scene, plan, Setting(name, "samples", theirs, {"samples": theirs}), seed=1)
    assert run.seed == 1
    assert run.seconds["render"] >= 0  # POV-Ray reports milliseconds, and a small picture may take less than one
    assert sum(run.seconds.values()) > 0
    assert run.cpu >= 0
    picture = render_scene.draw(scene, plan).channels["rgba"][..., :3]
    assert run.rgb.shape == picture.shape
    return picture.astype(np.float64), run.rgb.astype(np.float64)


def blocks(picture: np.ndarray, size: int = 8) -> np.ndarray:
    """Means of whole blocks of pixels."""
    height, width = (n // size * size for n in picture.shape[:2])
    return picture[:height, :width].reshape(height // size, size, width // size, size, 3).mean(axis=(1, 3))


def apart(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    """(√relMSE of pixels, √relMSE of blocks' means, relative difference of the pictures' means)."""
    return metrics.root_relmse(b, a), metrics.root_relmse(blocks(b), blocks(a)), float(abs(b.mean() / a.mean() - 1.0))
