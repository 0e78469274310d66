"""Balls in an environment against MaterialX's own renderer of generated GLSL: mean colours of its pictures.

The environment is a formula. The other pictures are of MaterialX 1.39.5, PyMaterialXRenderGlsl with 48 samples of filtered importance
sampling, by Mesa's driver softpipe where facets are rough metal: 64 by 64 pixels, a ball of radius 1 from 5 m with a view of 26°. The
means are over the disc of 0.96 of the ball's radius.
"""

# pyright: reportOptionalMemberAccess=false

from __future__ import annotations

import maquette
import numpy as np
import OpenImageIO as oiio
import pytest

STAGE = """#usda 1.0
(
    upAxis = "Y"
    metersPerUnit = 1
)
def Sphere "ball" (
    prepend apiSchemas = ["MaterialBindingAPI"]
)
{{
    double radius = 1
    rel material:binding = </m>
}}
def Material "m"
{{
    token outputs:mtlx:surface.connect = </m/s.outputs:out>
    def Shader "s"
    {{
        uniform token info:id = "ND_open_pbr_surface_surfaceshader"
        {inputs}
        token outputs:out
    }}
}}
def DomeLight "sky"
{{
    asset inputs:texture:file = @./env.exr@
    token inputs:texture:format = "latlong"
}}
def Camera "cam"
{{
    float focalLength = 50
    float horizontalAperture = {aperture}
    float verticalAperture = {aperture}
    float2 clippingRange = (0.01, 100)
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""
ANGLE, SIZE = np.radians(13), 32
METAL, ROUGH = "float inputs:base_metalness = 1", "float inputs:specular_roughness = "
BALLS = {  # most of PhysicallyBased (CC0): inputs, mean colour of MaterialX's picture
    "aluminum": (f"color3f inputs:base_color = (0.916, 0.923, 0.924)\n{METAL}\n{ROUGH}0\n"
                 "color3f inputs:specular_color = (0.91, 0.936, 0.959)", (0.7325, 0.7630, 0.8454)),
    "brick": (f"color3f inputs:base_color = (0.262, 0.095, 0.061)\n{ROUGH}0.9", (0.1800, 0.0836, 0.0710)),
    "car paint": (f"color3f inputs:base_color = (0.1, 0.1, 0.1)\n{ROUGH}0", (0.1279, 0.1338, 0.1500)),
    "rough gold": (f"color3f inputs:base_color = (1, 0.766, 0.336)\n{METAL}\n{ROUGH}0.5\n"
                   "color3f inputs:specular_color = (1, 0.98, 0.9)", (0.7429, 0.5803, 0.2764)),
    "bone": (f"color3f inputs:base_color = (0.793, 0.793, 0.664)\n{ROUGH}0.9", (0.5083, 0.5572, 0.5559)),
}  # fmt: skip


def environment():
    """(256, 512, 3) a sky over a floor with three soft lights."""
    v, u = np.mgrid[:256, :512]
    up, turn = np.pi * (0.5 - (v + 0.5) / 256), 2 * np.pi * (u + 0.5) / 512
    way = np.stack([np.cos(up) * np.cos(turn), np.sin(up), np.cos(up) * np.sin(turn)], axis=-1)
    high = (way[..., 1] * 0.5 + 0.5)[..., None]
    light = np.array([0.25, 0.2, 0.16]) * (1 - high) + np.array([0.5, 0.65, 0.9]) * high
    for axis, size, color in (((1, 1.2, 0.6), 0.45, (7, 6.5, 6)), ((-1, 0.5, 0.8), 0.35, (3, 3.4, 4)), ((0.2, 0.6, -1), 0.3, (4, 3, 2))):
        angle = np.arccos(np.clip(way @ (np.array(axis) / np.linalg.norm(axis)), -1, 1)) / size
        light = light + np.exp(-(angle**4))[..., None] * np.array(color)
    return light.astype(np.float32)


@pytest.mark.long
@pytest.mark.parametrize("name", BALLS)
def test_balls_are_as_bright_as_those_of_materialx(tmp_path, name):
    file = oiio.ImageOutput.create(str(tmp_path / "env.exr"))
    assert file.open(str(tmp_path / "env.exr"), oiio.ImageSpec(512, 256, 3, "float"))
    file.write_image(environment())
    file.close()
    inputs, expected = BALLS[name]
    stage = STAGE.format(inputs=inputs.replace("\n", "\n        "), aperture=100 * np.tan(ANGLE))
    (tmp_path / "ball.usda").write_text(stage, encoding="utf-8")
    scene = maquette.load(tmp_path / "ball.usda")
    camera = next(camera for camera in scene.names.cameras if "cam" in camera)
    picture = np.asarray(scene.render(size=(SIZE, SIZE), samples=64, camera=camera, backend="reference"))[..., :3]
    across = (np.arange(SIZE) + 0.5 - SIZE / 2) / (SIZE / 2) * np.tan(ANGLE)
    disc = np.hypot(across[:, None], across) < 0.96 * np.tan(np.arcsin(0.2))
    assert picture[disc].mean(axis=0) == pytest.approx(np.array(expected), rel=0.04)
