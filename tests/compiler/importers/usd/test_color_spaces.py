"""Colours in other spaces than linear sRGB, against usd-core's conversion and the definition of sRGB."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

import pytest
from maquette.compiler import ir
from pxr import Gf

from .stages import SQUARE, attribute, read, slot

COLOR = (0.5, 0.25, 1.0)


def linear(space: str) -> list[float]:
    return list(Gf.ColorSpace("lin_rec709_scene").Convert(Gf.ColorSpace(space), Gf.Vec3f(*COLOR)).GetRGB())


def srgb(value: float) -> float:
    return ((value + 0.055) / 1.055) ** 2.4 if value > 0.04045 else value / 12.92


def within(space: str, prim: str) -> str:
    return f'def Xform "x" (prepend apiSchemas = ["ColorSpaceAPI"]) {{ uniform token colorSpace:name = "{space}"\n{prim} }}'


BALL = 'def Sphere "s" { color3f[] primvars:displayColor = [(0.5, 0.25, 1)]\n}'


@pytest.mark.parametrize("space", ["lin_ap1_scene", "lin_rec2020_scene", "g22_rec709_scene", "lin_rec709_scene"])
def test_the_space_of_an_ancestor(tmp_path, space):
    scene, messages = read(tmp_path, within(space, BALL))
    assert messages == []
    assert slot(scene, "DIFFUSE") == pytest.approx(linear(space), abs=1e-5)


@pytest.mark.parametrize("name", ["srgb_rec709_scene", "sRGB"])
def test_the_space_of_the_attribute_precedes(tmp_path, name):
    ball = BALL.replace("1)]", f'1)] (colorSpace = "{name}")')
    scene, messages = read(tmp_path, within("lin_ap1_scene", ball))
    assert messages == []
    assert slot(scene, "DIFFUSE") == pytest.approx([srgb(c) for c in COLOR], abs=1e-4)


def test_colors_of_vertices(tmp_path):
    colors = 'color3f[] primvars:displayColor = [(0.5, 0.25, 1), (0, 0, 0), (1, 1, 1), (0.5, 0.25, 1)] (interpolation = "vertex")'
    scene, _ = read(tmp_path, within("lin_ap1_scene", f'def Mesh "m" {{ {SQUARE}\n{colors} }}'))
    assert attribute(scene, "colors")[0, 0] == pytest.approx([max(c, 0.0) for c in linear("lin_ap1_scene")], abs=1e-5)


def test_lights_and_materials(tmp_path):
    material = """def Material "mat" { token outputs:surface.connect = </x/mat/s.outputs:surface>
        def Shader "s" { uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0.5, 0.25, 1)
        token outputs:surface } }
        def Cube "c" (prepend apiSchemas = ["MaterialBindingAPI"]) { rel material:binding = </x/mat> }"""
    light = 'def DomeLight "l" { color3f inputs:color = (0.5, 0.25, 1) }'
    scene, messages = read(tmp_path, within("lin_rec2020_scene", f"{material}\n{light}"))
    expected = [max(c, 0.0) for c in linear("lin_rec2020_scene")]
    assert scene.tables.lights.color[0] == pytest.approx(expected, abs=1e-5)
    assert scene.tables.materials.values[scene.tables.instances.material[0], ir.Slot.DIFFUSE] == pytest.approx(expected, abs=1e-5)
    assert [m for m in messages if "negative" not in m] == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (within("odd", BALL), "Unknown color space odd encountered."),
        (BALL.replace("1)]", '1)] (colorSpace = "odd")'),
            "the colour space `odd` of </s.primvars:displayColor> is not known: its colours are drawn as they are"),
    ],
)  # fmt: skip
def test_an_unknown_space(tmp_path, text, expected):
    scene, messages = read(tmp_path, text)
    assert (slot(scene, "DIFFUSE"), messages) == (list(COLOR), [f"x.usda: warning: {expected}"])
