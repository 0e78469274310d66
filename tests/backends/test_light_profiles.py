"""Lights whose emission depends on the direction: closed forms of the light on a floor, with cones, focus and IES profiles of USD."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest

STAGE = """#usda 1.0
(
    defaultPrim = "w"
)
def Xform "w" {
    def Mesh "floor" {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-9, 0, 9), (9, 0, 9), (9, 0, -9), (-9, 0, -9)]
        uniform token subdivisionScheme = "none"
        color3f[] primvars:displayColor = [(1, 1, 1)]
    }
    def Camera "main_cam" {
        token projection = "orthographic"
        float horizontalAperture = 40
        float verticalAperture = 40
        float2 clippingRange = (0.1, 100)
        double3 xformOp:translate = (0, 5, 0)
        float xformOp:rotateX = -90
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
    }
    def LIGHT "lamp" (
        prepend apiSchemas = ["ShapingAPI"]
    ) {
        INPUTS
        double3 xformOp:translate = (0, 1.5, 0)
        float xformOp:rotateX = -90
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX"]
    }
}
"""
POINT = "bool treatAsPoint = 1\n        bool inputs:normalize = 1\n        float inputs:intensity = 40\n        "
HEIGHT = 1.5
IES = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 5 1 2 0 0 0\n1 1 100\n0 45 90\n0 90 180 270 360\n{}\n"


def floor(folder: Path, light: str, inputs: str, backend: str, samples: int = 1, **more: Any) -> tuple[np.ndarray, np.ndarray]:
    """(radiance, position) (h, w, 3) of the floor below a light that shines down."""
    (folder / "a.usda").write_text(STAGE.replace("LIGHT", light).replace("INPUTS", inputs))
    found = maquette.render(folder / "a.usda", size=(24, 24), samples=samples, backend=backend, aov=("position",), **more).channels
    return found["rgba"][..., :3].astype(float), found["position"].astype(float)


def below(place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(radiance of the floor under a lamp of 10 candela; the angle from its axis)."""
    squared = (place**2).sum(axis=-1) + HEIGHT**2
    return 10 / np.pi * HEIGHT / squared**1.5, np.arccos(HEIGHT / np.sqrt(squared))


@pytest.mark.parametrize("bounces", [0, 1])
def test_cone_and_focus(tmp_path: Path, backend: str, bounces: int) -> None:
    """E = I cos θ / d² · (1 − smoothstep(θ)) · lerp(cosⁿ θ, tint, 1); with bounces paths sample the lamp, without them all lamps are."""
    shape = (
        "float inputs:shaping:cone:angle = 50\n float inputs:shaping:cone:softness = 0.5\n"
        "float inputs:shaping:focus = 4\n color3f inputs:shaping:focusTint = (0.25, 0, 0)"
    )
    found, place = floor(tmp_path, "SphereLight", POINT + shape, backend, bounces=bounces)
    light, angle = below(place)
    t = np.clip((np.degrees(angle) - 25) / 25, 0, 1)
    focus = np.cos(angle) ** 4
    tinted = np.stack([0.25 + 0.75 * focus, focus, focus], axis=-1)
    expected = (light * (1 - t * t * (3 - 2 * t)))[..., None] * tinted
    assert np.abs(found - expected).max() < 1e-3 * light.max()
    assert found.max() > 0.5 * light.max()


def test_an_ies_profile_around_the_axis(tmp_path: Path, backend: str) -> None:
    """Intensity 1 + sin of the azimuth in a file of four half planes; the horizontal angle of the direction to the light is read."""
    rows = [[100, 100, 100], [200, 200, 200], [300, 300, 300], [400, 400, 400], [100, 100, 100]]
    (tmp_path / "a.ies").write_text(IES.format("\n".join(" ".join(map(str, row)) for row in rows)))
    found, place = floor(tmp_path, "SphereLight", POINT + "asset inputs:shaping:ies:file = @a.ies@", backend)
    light, _ = below(place)
    # The lamp's frame: x is the world's x, y the world's −z. The direction to the lamp is opposite to that of the light.
    around = np.degrees(np.arctan2(place[..., 2], -place[..., 0])) % 360
    expected = light * np.interp(around, [0, 90, 180, 270, 360], [100, 200, 300, 400, 100])
    far = np.hypot(place[..., 0], place[..., 2]) > 0.3
    smooth = far & (np.abs(around - 180) < 170)  # between 350° and 10° the profile bends within a column of the image
    assert np.abs(found[..., 0] - expected)[smooth].max() < 0.02 * expected.max()


@pytest.mark.parametrize("kind", ["RectLight", "DiskLight", "SphereLight"])
def test_a_small_shaped_light_is_a_shaped_point(tmp_path: Path, backend: str, kind: str) -> None:
    size = {"RectLight": "float inputs:width = 0.005\n float inputs:height = 0.005", "DiskLight": "float inputs:radius = 0.003"}
    inputs = size.get(kind, "float inputs:radius = 0.003") + "\n float inputs:intensity = 40\n bool inputs:normalize = 1\n"
    found, place = floor(tmp_path, kind, inputs + "float inputs:shaping:focus = 2", backend, bounces=1)
    light, angle = below(place)
    # A normalized flat light of intensity 40 has 40 cos θ candela, a ball 10.
    expected = light * np.cos(angle) ** 2 * (1 if kind == "SphereLight" else 4 * np.cos(angle))
    assert np.abs(found[..., 0] - expected).max() < 0.01 * expected.max()


def test_a_squeezed_disk_is_an_ellipse(tmp_path: Path, backend: str) -> None:
    """Under the middle of a small ellipse E = L π a b / h²."""
    inputs = "float inputs:radius = 0.02\n float inputs:intensity = 9\n"
    text = STAGE.replace('rotateX"]\n    }\n}\n', 'rotateX", "xformOp:scale"]\n        float3 xformOp:scale = (3, 1, 1)\n    }\n}\n')
    (tmp_path / "a.usda").write_text(text.replace("LIGHT", "DiskLight").replace("INPUTS", inputs))
    found = maquette.render(tmp_path / "a.usda", size=(25, 25), samples=1, backend=backend, bounces=1).channels["rgba"][12, 12, 0]
    assert found == pytest.approx(9 * 0.02**2 * 3 / HEIGHT**2, rel=0.01)


def test_a_thin_cylinder_shines_by_its_projected_area(tmp_path: Path, backend: str) -> None:
    """Under the middle of a thin and short cylinder E = L 2 r l / h²."""
    found, _ = floor(tmp_path, "CylinderLight", "float inputs:radius = 0.01\n float inputs:length = 0.1\n float inputs:intensity = 99\n",
                     backend, samples=4, bounces=1)  # fmt: skip
    middle = found[11:13, 11:13, 0].mean()
    assert middle == pytest.approx(99 / np.pi * 2 * 0.01 * 0.1 / HEIGHT**2, rel=0.03)


@pytest.mark.long
def test_a_shaped_cylinder_shines_along_its_minus_z(tmp_path: Path, backend: str) -> None:
    """A thin and short cylinder with a focus, along the line under its middle across it: E = L 2 r l cosⁿ θ · cos θ / d²."""
    inputs = "float inputs:radius = 0.01\n float inputs:length = 0.05\n float inputs:intensity = 99\n"
    found, place = floor(tmp_path, "CylinderLight", inputs + "float inputs:shaping:focus = 3", backend, samples=4, bounces=0)
    light, angle = below(place)
    across = np.abs(place[..., 0]) < 0.1  # the axis is x
    expected = light / 10 * 99 * 2 * 0.01 * 0.05 * np.cos(angle) ** 3
    assert np.abs(found[..., 0] - expected)[across].max() < 0.06 * expected.max()


@pytest.mark.long
def test_paths_choose_lamps_by_their_largest_factor(tmp_path: Path) -> None:
    """Forty lamps at one place, one of them a thousand times as bright by its profile: choice in proportion leaves no noise."""
    (tmp_path / "a.ies").write_text(IES.format("\n".join(["1000 1000 1000"] * 5)))
    place = '\n        double3 xformOp:translate = (0, 1.5, 0)\n        uniform token[] xformOpOrder = ["xformOp:translate"]\n    }\n'
    head = '    def SphereLight "{}" (\n        prepend apiSchemas = ["ShapingAPI"]\n    ) {{\n        '
    dim = "".join(POINT + place + head.format(f"lamp{k}") for k in range(39))
    found, at = floor(tmp_path, "SphereLight", dim + POINT + "asset inputs:shaping:ies:file = @a.ies@", "ray", samples=4, bounces=1)
    light, _ = below(at)
    assert np.abs(found[..., 0] / (1039 * light) - 1).mean() < 0.05
