"""UsdLux lights against their definitions: strength, normalisation, frames, cones; and the dome's picture."""

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers.usd import light_plates

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


def test_a_cylinder_is_a_prism_of_its_perimeter(tmp_path):
    """Its sides face outward, touch each other, and have the cylinder's area; normalized they share one power."""
    text = f'def CylinderLight "l" {{ float inputs:length = 8\nfloat inputs:radius = 1\nMORE\n{TURNED} }}'
    scene, messages, row = light(tmp_path, text.replace("MORE", ""))
    lights = scene.tables.lights
    assert (messages, lights.kind.tolist()) == ([], [ir.LightKind.RECTANGLE] * light_plates.SIDES)
    assert 4 * lights.size.prod(axis=1).sum() == pytest.approx(2 * math.pi * 8 * 2**2)  # TURNED scales by 2
    middle = np.array([1, 2, 3])
    for k in range(len(lights.kind)):
        matrix = scene.tables.transforms.matrix[lights.transform[k]]
        outward = matrix[:, 3] - middle
        assert matrix[:, 1] @ outward == pytest.approx(np.linalg.norm(outward))
    dim = light(tmp_path, text.replace("MORE", "bool inputs:normalize = 1"))[2]
    assert dim["color"] == pytest.approx(row["color"] / (2 * math.pi * 8 * 2**2))


def shaped(tmp_path, kind, inputs, extra=""):
    text = f'def {kind} "l" (prepend apiSchemas = ["ShapingAPI"]) {{ {inputs}\n{extra} }}'
    scene, messages, row = light(tmp_path, text)
    assert messages == []
    t = scene.tables
    if row["image"] < 0:
        return row, np.zeros(0)
    first, high = t.images.first[row["image"]], t.images.height[row["image"]]
    return row, t.images.texels[first : first + high * t.images.width[row["image"]], :3].reshape(high, -1, 3)


@pytest.mark.parametrize("kind", ["SphereLight", "RectLight", "DiskLight"])
def test_a_cone_is_a_factor_by_direction(tmp_path, kind):
    row, factor = shaped(tmp_path, kind, "float inputs:shaping:cone:angle = 30\nfloat inputs:shaping:cone:softness = 0.5")
    assert factor.shape == (2048, 1, 3)
    angle = (np.arange(2048) + 0.5) * 180 / 2048
    t = np.clip((angle - 15) / 15, 0, 1)
    assert factor[:, 0, 0] == pytest.approx(1 - t * t * (3 - 2 * t), abs=1e-6)
    kinds = {"SphereLight": ir.LightKind.SPHERE, "RectLight": ir.LightKind.RECTANGLE, "DiskLight": ir.LightKind.DISK}
    assert row["kind"] == kinds[kind]


def test_a_focus_has_a_tint(tmp_path):
    _, factor = shaped(tmp_path, "SphereLight", "float inputs:shaping:focus = 3\ncolor3f inputs:shaping:focusTint = (0.5, 0, 0)")
    share = np.abs(np.cos((np.arange(2048) + 0.5) * np.pi / 2048)) ** 3
    assert factor[:, 0] == pytest.approx(np.stack([0.5 + 0.5 * share, share, share], axis=1), abs=1e-6)


def test_the_axis_of_a_shaped_ball_is_its_minus_z(tmp_path):
    text = f'def SphereLight "l" (prepend apiSchemas = ["ShapingAPI"]) {{ float inputs:shaping:focus = 1\n{TURNED} }}'
    scene, _, row = light(tmp_path, text)
    assert frame(scene, row)[:3, 1] == pytest.approx([0, 1, 0], abs=1e-7)


@pytest.mark.parametrize("inputs", ["float inputs:shaping:cone:angle = 180", "", "float inputs:shaping:focus = 0"])
def test_shaping_without_effect(tmp_path, inputs):
    row, factor = shaped(tmp_path, "SphereLight", inputs)
    assert (row["kind"], factor.size) == (ir.LightKind.SPHERE, 0)


PROFILE = "IESNA:LM-63-2002\n[TEST] a\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 100\n0 90 180\n0\n100 50 0\n"


def test_an_ies_profile_is_a_factor_by_direction(tmp_path):
    (tmp_path / "a.ies").write_text(PROFILE)
    _, factor = shaped(tmp_path, "SphereLight", "asset inputs:shaping:ies:file = @a.ies@")
    assert factor[:, 0, 0] == pytest.approx(np.linspace(100, 0, 2049)[:-1] - 100 / 4096, rel=1e-5, abs=1e-3)
    _, even = shaped(tmp_path, "SphereLight", "asset inputs:shaping:ies:file = @a.ies@\nbool inputs:shaping:ies:normalize = 1")
    assert even == pytest.approx(factor / 50, rel=1e-3, abs=1e-4)  # the mean of 100 (1 − θ/π) over the sphere is 50
    _, wide = shaped(tmp_path, "SphereLight", "asset inputs:shaping:ies:file = @a.ies@\nfloat inputs:shaping:ies:angleScale = 1")
    assert wide[0, 0, 0] == pytest.approx(50, abs=0.1)  # the axis shows the angle π/2


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("nothing", "the IES profile `a.ies` is left out: an IES file has a line with TILT="),
        (PROFILE[:-12], "the IES profile `a.ies` is left out: the numbers of this IES file end early"),
        (PROFILE.replace("3 1 1 2", "3 1 2 2"),
         "the IES profile `a.ies` is left out: photometry of the types A and B is not drawn: type C is"),
        (None, "there is no IES profile `a.ies`: it is left out"),
    ],
)  # fmt: skip
def test_a_bad_ies_profile_is_left_out(tmp_path, text, expected):
    if text is not None:
        (tmp_path / "a.ies").write_text(text)
    lamp = 'def SphereLight "l" (prepend apiSchemas = ["ShapingAPI"]) { asset inputs:shaping:ies:file = @a.ies@\n}'
    scene, messages = read(tmp_path, lamp + CUBE)
    assert messages == [f"x.usda</l>: warning: {expected}"]
    assert scene.tables.lights.image.tolist() == [-1]


def test_an_uneven_scale_makes_an_ellipse(tmp_path):
    scale = 'float3 xformOp:scale = (2, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    scene, messages, row = light(tmp_path, f'def DiskLight "l" {{ float inputs:radius = 3\nbool inputs:normalize = 1\n{scale} }}')
    assert (messages, row["size"][0]) == ([], 3)
    assert frame(scene, row)[:3, :3] == pytest.approx(np.array([[2, 0, 0], [0, 0, 1], [0, -1, 0]]))
    assert row["color"] == pytest.approx([1 / (math.pi * 9 * 2)] * 3)


def test_a_picture_of_a_rectangle_is_a_grid_of_its_means(tmp_path):
    """The lower left pixel is at the lowest x and y."""
    write_image(tmp_path / "a.png", np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [0, 0, 0]]], np.uint8))
    text = 'def RectLight "l" { float inputs:width = 4\nfloat inputs:intensity = 2\nasset inputs:texture:file = @a.png@\n}'
    scene, messages, _ = light(tmp_path, text)
    t, cells = scene.tables, light_plates.CELLS
    assert (messages, len(t.lights.kind)) == ([], cells * cells * 3 // 4)
    assert (4 * t.lights.size.prod(axis=1)) == pytest.approx(np.full(len(t.lights.kind), 4 / cells**2))
    place = t.transforms.matrix[t.lights.transform][:, :2, 3]
    for color, left, top in (([2, 0, 0], True, True), ([0, 2, 0], False, True), ([0, 0, 2], True, False)):
        assert t.lights.color[((place[:, 0] < 0) == left) & ((place[:, 1] > 0) == top)] == pytest.approx(np.tile(color, (16, 1)))


def test_point_instancers_place_lights(tmp_path):
    text = """def PointInstancer "pi" {
        int[] protoIndices = [0, 0]
        point3f[] positions = [(1, 0, 0), (0, 5, 0)]
        rel prototypes = </pi/lamp>
        def SphereLight "lamp" { float inputs:intensity = 3
        } }"""
    scene, messages = read(tmp_path, text + CUBE)
    assert messages == []
    assert scene.tables.lights.position.tolist() == [[1, 0, 0], [0, 5, 0]]
    assert scene.tables.lights.color.tolist() == [[3, 3, 3]] * 2


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
        ('def RectLight "l" { asset inputs:texture:file = @a.png@\n}',
         "x.usda</l>: warning: there is no picture `a.png`: its fallback is drawn"),
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


@pytest.mark.parametrize(("intensity", "names", "bounces"), [(5, (), 1), (0, ("head light",), None)])
def test_mesh_lights_replace_the_light_at_the_camera_and_take_a_bounce(tmp_path, intensity, names, bounces):
    text = f'def Mesh "m" (prepend apiSchemas=["MeshLightAPI"]) {{ {SQUARE}\nfloat inputs:intensity = {intensity} }}'
    scene, _ = read(tmp_path, text)
    assert (scene.names.lights, scene.settings.bounces) == (names, bounces)
    said = "bounces: 1; without bounces, mesh lights light no other prims"
    assert (said in scene.defaults) == (bounces == 1)


def test_a_cylinder_as_a_line_has_its_power(tmp_path):
    text = 'def CylinderLight "l" { float inputs:length = 8\nfloat inputs:radius = 1\nbool treatAsLine = MODE }'
    whole, line = (read(tmp_path, text.replace("MODE", mode) + CUBE)[0].tables.lights for mode in ("0", "1"))

    def power(lights: ir.Lights) -> float:
        return float((4 * lights.size.prod(axis=1) * lights.color[:, 0]).sum())

    assert power(line) == pytest.approx(power(whole))
    assert line.size.min() == pytest.approx(0.008 * math.pi / light_plates.SIDES)
