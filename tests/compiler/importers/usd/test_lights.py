"""UsdLux lights against their definitions: strength, normalisation, frames, cones; and the dome's picture."""

import math

import numpy as np
import pytest
from maquette.compiler import ir

from ....files import write_image
from .stages import SQUARE, read

TURNED = """
    float3 xformOp:rotateXYZ = (90, 0, 0)
    double3 xformOp:translate = (1, 2, 3)
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
"""
CUBE = '\ndef Cube "c" {}'


def light(tmp_path, text, header=""):
    scene, messages = read(tmp_path, text + CUBE, header)
    return scene, messages, {name: getattr(scene.tables.lights, name)[0] for name in ir.Lights._fields}


def frame(scene, row):
    return scene.tables.transforms.matrix[row["transform"]]


def test_distant(tmp_path):
    _, messages, row = light(tmp_path, f'def DistantLight "l" {{ float inputs:intensity = 1000\nfloat inputs:angle = 2\n{TURNED} }}')
    assert messages == []
    assert row["kind"] == ir.LightKind.SUN
    assert row["color"] == pytest.approx([1000 * math.pi * math.sin(math.radians(1)) ** 2] * 3)
    assert row["direction"] == pytest.approx([0, -1, 0], abs=1e-7)  # it shines along its −z, so it comes from its z
    assert row["angle"] == pytest.approx(math.radians(1))


def test_distant_normalized_is_irradiance(tmp_path):
    text = 'def DistantLight "l" { float inputs:intensity = 3\nbool inputs:normalize = 1\nfloat inputs:exposure = 1\nCOLOR }'
    text = text.replace("COLOR", "color3f inputs:color = (1, 0.5, 0)")
    assert light(tmp_path, text)[2]["color"] == pytest.approx([6, 3, 0])


def test_a_distant_light_without_angle_is_a_direction(tmp_path):
    row = light(tmp_path, 'def DistantLight "l" { float inputs:intensity = 3\nfloat inputs:angle = 0\n}')[2]
    assert (row["kind"], row["color"].tolist()) == (ir.LightKind.DIRECTIONAL, [3, 3, 3])


def test_sphere(tmp_path):
    scene, _, row = light(tmp_path, f'def SphereLight "l" {{ float inputs:intensity = 5\nfloat inputs:radius = 0.5\n{TURNED} }}')
    assert row["kind"] == ir.LightKind.SPHERE
    assert row["color"].tolist() == [5, 5, 5]
    assert row["size"][0] == pytest.approx(1)
    assert frame(scene, row)[:, 3].tolist() == [1, 2, 3]


def test_sphere_normalized_by_its_area_in_the_world(tmp_path):
    row = light(tmp_path, f'def SphereLight "l" {{ float inputs:intensity = 5\nbool inputs:normalize = 1\n{TURNED} }}')[2]
    assert row["color"] == pytest.approx([5 / (4 * math.pi)] * 3)


def test_sphere_as_a_point(tmp_path):
    row = light(tmp_path, f'def SphereLight "l" {{ float inputs:intensity = 5\nbool treatAsPoint = 1\n{TURNED} }}')[2]
    assert (row["kind"], row["position"].tolist()) == (ir.LightKind.POINT, [1, 2, 3])
    assert row["color"] == pytest.approx([5 * math.pi] * 3)  # L π r²: what the ball sends into any direction


def test_rectangle_shines_along_its_minus_z(tmp_path):
    text = f'def RectLight "l" {{ float inputs:width = 3\nfloat inputs:height = 4\nfloat inputs:intensity = 2\n{TURNED} }}'
    scene, _, row = light(tmp_path, text)
    assert row["kind"] == ir.LightKind.RECTANGLE
    assert row["size"] == pytest.approx([3, 4])  # half of 3 and 4, twice
    assert frame(scene, row) @ [0, 1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-7)  # −z turned by 90° about x
    assert row["color"].tolist() == [2, 2, 2]
    row = light(tmp_path, text.replace("intensity = 2", "intensity = 96\nbool inputs:normalize = 1"))[2]
    assert row["color"] == pytest.approx([2] * 3)


def test_disk(tmp_path):
    scene, _, row = light(tmp_path, f'def DiskLight "l" {{ float inputs:radius = 3\nbool inputs:normalize = 1\n{TURNED} }}')
    assert (row["kind"], row["size"][0]) == (ir.LightKind.DISK, pytest.approx(6))
    assert row["color"] == pytest.approx([1 / (math.pi * 36)] * 3)
    assert frame(scene, row) @ [0, 1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-7)


def test_cylinder_becomes_a_ball_of_the_same_area(tmp_path):
    _, messages, row = light(tmp_path, 'def CylinderLight "l" { float inputs:length = 8\nfloat inputs:radius = 1\n}')
    assert messages == ["x.usda</l>: warning: cylinder lights are drawn as balls of the same area"]
    assert (row["kind"], row["size"][0]) == (ir.LightKind.SPHERE, pytest.approx(2))


def test_a_cone_makes_a_spot(tmp_path):
    text = f"""def SphereLight "l" (prepend apiSchemas = ["ShapingAPI"]) {{ float inputs:intensity = 5
        float inputs:radius = 0.25
        float inputs:shaping:cone:angle = 30
        float inputs:shaping:cone:softness = 0.5
        {TURNED} }}"""
    _, messages, row = light(tmp_path, text)
    assert messages == []
    assert (row["kind"], row["position"].tolist()) == (ir.LightKind.SPOT, [1, 2, 3])
    assert row["color"] == pytest.approx([5 * math.pi * 0.25] * 3)
    assert row["direction"] == pytest.approx([0, 1, 0], abs=1e-7)
    assert (row["cos_cone"], row["cos_full"]) == pytest.approx((math.cos(math.radians(30)), math.cos(math.radians(15))))


def test_a_wide_cone_shapes_nothing(tmp_path):
    text = 'def SphereLight "l" (prepend apiSchemas = ["ShapingAPI"]) { float inputs:shaping:cone:angle = 180\n}'
    assert light(tmp_path, text)[2]["kind"] == ir.LightKind.SPHERE


def test_colour_temperature(tmp_path):
    text = 'def SphereLight "l" { bool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000\n}'
    r, g, b = light(tmp_path, text)[2]["color"]
    assert r > 1.5 > g > b
    assert 0.2126 * r + 0.7152 * g + 0.0722 * b == pytest.approx(1, abs=0.02)


def test_a_dome_without_a_picture_is_an_even_sky(tmp_path):
    row = light(tmp_path, 'def DomeLight "l" { float inputs:intensity = 2\ncolor3f inputs:color = (1, 0.5, 0) }')[2]
    assert (row["kind"], row["color"].tolist()) == (ir.LightKind.SKY, [2, 1, 0])


@pytest.mark.parametrize(
    ("prim", "up", "pole"),
    [
        ("DomeLight", "Y", [0, 1, 0]),
        ("DomeLight", "Z", [0, 0, -1]),  # its top is +y of a stage in which z is up
        ("DomeLight_1", "Y", [0, 1, 0]),
        ("DomeLight_1", "Z", [0, 1, 0]),
    ],
)
def test_a_dome_s_picture_and_pole(tmp_path, prim, up, pole):
    write_image(tmp_path / "sky.png", np.full((1, 2, 3), 255, np.uint8))
    scene, messages, row = light(tmp_path, f'def {prim} "l" {{ asset inputs:texture:file = @sky.png@\n}}', f'upAxis = "{up}"')
    assert messages == []
    assert (row["kind"], row["image"]) == (ir.LightKind.DOME, 0)
    assert frame(scene, row) @ [0, 1, 0, 0] == pytest.approx(pole, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('def PortalLight "l" {}', "x.usda</l>: warning: PortalLight is not drawn"),
        ('def SphereLight "l" { float inputs:intensity = inf\n}',
         "x.usda</l>: warning: this light's strength is not finite: it is left out"),
        ('def RectLight "l" { asset inputs:texture:file = @a.png@\n}', "x.usda</l>: warning: `texture:file` of RectLight is not drawn"),
        ('def RectLight "l" (prepend apiSchemas = ["ShapingAPI"]) { float inputs:shaping:cone:angle = 20\n}',
         "x.usda</l>: warning: cones shape balls and disks only: this light shines into its whole side"),
        ('def DomeLight "l" { asset inputs:texture:file = @gone.png@\n}',
         "x.usda</l>: warning: there is no picture `gone.png`: its fallback is drawn"),
    ],
)  # fmt: skip
def test_what_is_not_drawn(tmp_path, text, expected):
    assert read(tmp_path, text + CUBE)[1] == [expected]


def test_lights_that_are_invisible_are_dark(tmp_path):
    scene, _ = read(tmp_path, 'def SphereLight "l" { token visibility = "invisible"\n}' + CUBE)
    assert scene.names.lights == ("head light",)


def test_a_light_that_casts_no_shadow(tmp_path):
    scene, messages = read(tmp_path, CUBE + 'def SphereLight "l" (apiSchemas=["ShadowAPI"]) { bool inputs:shadow:enable = 0 }')
    assert scene.tables.lights.shadows.tolist() == [False]
    assert messages == []


def test_negative_lights(tmp_path):
    """A negative component counts as 0; a light of negative strength is left out. The stage is drawn."""
    text = 'def SphereLight "a" { color3f inputs:color = (1, -1, 0.5) }\ndef SphereLight "b" { float inputs:intensity = -1 }'
    scene, messages = read(tmp_path, CUBE + text)
    assert scene.tables.lights.color.tolist() == [[1, 0, 0.5]]
    assert messages == [
        "x.usda</a>: warning: this light's colour has a negative component, which counts as 0",
        "x.usda</b>: warning: this light's strength is negative: it is left out",
    ]


def test_a_mesh_light_shines(tmp_path):
    """MeshLightAPI: the mesh emits intensity · 2^exposure · color."""
    inputs = "float inputs:intensity = 5\nfloat inputs:exposure = 1\ncolor3f inputs:color = (1, 0.5, 0)"
    text = f'def Mesh "m" (prepend apiSchemas=["MeshLightAPI"]) {{ {SQUARE}\n{inputs} }}'
    scene, messages = read(tmp_path, text)
    materials = scene.tables.materials
    row = scene.tables.instances.material[0]
    assert materials.values[row, ir.Slot.EMISSION].tolist() == [10, 5, 0]
    assert [m for m in messages if "warning" in m] == []
