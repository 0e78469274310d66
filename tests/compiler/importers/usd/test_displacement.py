"""Displacement of UsdPreviewSurface: points of meshes move along their normals."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.importers.usd import displacement
from maquette.compiler.scene.row_records import TextureData

from ....files import write_image
from .stages import SQUARE, attribute, corners, read
from .test_materials import stage

OUTPUT = "token outputs:surface.connect = </m/s.outputs:surface>"
BOTH = OUTPUT + "\n    token outputs:displacement.connect = </m/s.outputs:displacement>"
CONSTANT = "float inputs:displacement = 0.5\ntoken outputs:displacement"
ST = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'
PICTURE = """def Shader "t" { uniform token info:id = "UsdUVTexture"
    asset inputs:file = @p.png@
    token inputs:sourceColorSpace = "raw"
    token inputs:wrapS = "clamp"
    token inputs:wrapT = "clamp"
    float4 inputs:scale = (2, 2, 2, 2)
    float4 inputs:bias = (-1, -1, -1, -1)
    float outputs:r }"""
CUBE = """
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 3, 2, 2, 3, 5, 4, 4, 5, 7, 6, 6, 7, 1, 0, 1, 7, 5, 3, 6, 0, 2, 4]
    point3f[] points = [(-1, -1, 1), (1, -1, 1), (-1, 1, 1), (1, 1, 1), (-1, 1, -1), (1, 1, -1), (-1, -1, -1), (1, -1, -1)]
    uniform token subdivisionScheme = "none"
"""


def test_a_number_moves_a_square(tmp_path):
    scene, messages = read(tmp_path, stage(CONSTANT).replace(OUTPUT, BOTH))
    assert messages == []
    assert corners(scene)[0].tolist() == [[0, 0, 0.5], [1, 0, 0.5], [1, 1, 0.5]]
    assert attribute(scene, "normals")[0].tolist() == [[0, 0, 1]] * 3


def test_a_cube_stays_closed_and_grows_along_its_diagonals(tmp_path):
    scene, messages = read(tmp_path, stage(CONSTANT).replace(OUTPUT, BOTH).replace(SQUARE, CUBE))
    assert messages == []
    assert np.abs(corners(scene)) == pytest.approx(1 + 0.5 / np.sqrt(3))


def test_a_picture_moves_points_by_its_values(tmp_path):
    """Black at the lower left, white at the right: from -1 to 1; each point reads the texel at its corner."""
    write_image(tmp_path / "p.png", np.array([[[0] * 3, [255] * 3], [[0] * 3, [255] * 3]], np.uint8))
    text = stage("float inputs:displacement.connect = </m/t.outputs:r>\ntoken outputs:displacement", PICTURE, ST).replace(OUTPUT, BOTH)
    scene, messages = read(tmp_path, text)
    assert messages == [
        "x.usda</thing>: note: displacement moves the points of the meshes as they are\n"
        "  --complexity medium, high or veryhigh refines them"
    ]
    assert corners(scene)[0][:, 2].tolist() == [-1, 1, 1]


def test_refined_points_move(tmp_path):
    text = stage(CONSTANT).replace(OUTPUT, BOTH).replace('subdivisionScheme = "none"', 'subdivisionScheme = "bilinear"')
    scene, _ = read(tmp_path, text, options=StageOptions(complexity=2))
    at = corners(scene)
    assert len(at) == 2 * 16
    assert at[..., 2] == pytest.approx(0.5)


def test_shapes_are_not_displaced(tmp_path):
    text = stage(CONSTANT).replace(OUTPUT, BOTH) + (
        '\ndef Sphere "b" (prepend apiSchemas = ["MaterialBindingAPI"]) { rel material:binding = </m>\n}'
    )
    assert read(tmp_path, text)[1] == ["x.usda</b>: warning: displacement is drawn on meshes alone"]


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [(ir.Wrap.REPEAT, [0.25, 0.75, 0.25]), (ir.Wrap.CLAMP, [0.25, 1, 0]), (ir.Wrap.MIRROR, [0.25, 0.75, 0.25]),
     (ir.Wrap.BLACK, [0.25, 0, 0])],
)  # fmt: skip
def test_sampling_of_pictures(wrap, expected):
    """Texels 0 and 1 at u = 1/4 and 3/4; at u = 3/8, beyond the right edge and beyond the left one."""
    at = {ir.Wrap.REPEAT: (1.625, -0.625), ir.Wrap.MIRROR: (1.375, -0.375)}.get(wrap, (9.0, -9.0))
    mapping = TextureData(ir.TextureKind.IMAGE, wrap_u=wrap, wrap_v=ir.Wrap.REPEAT, channel=0)
    texels = np.array([[[0.0, 9, 9, 1], [1.0, 9, 9, 1]]])
    found = displacement.sample(mapping, texels, np.array([[0.375, 0.5], [at[0], 0.5], [at[1], 0.5]]))
    assert found == pytest.approx(expected)


@pytest.mark.parametrize(
    ("scale", "z"), [((20, 20, 20), 0.5), ((1, 1, 4), 0.5), ((3, 1, -2), 0.5)]
)  # fmt: skip
def test_heights_are_in_units_of_the_stage(tmp_path, scale, z):
    """As in Storm, which moves points after the transform; a mirror turns the outside around with the normal."""
    moved = f'float3 xformOp:scale = {scale}\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    scene, messages = read(tmp_path, stage(CONSTANT, extra=moved).replace(OUTPUT, BOTH))
    assert messages == []
    assert corners(scene)[..., 2] == pytest.approx(np.copysign(z, scale[2]))


def test_a_sheared_square_moves_along_its_normal_in_the_world(tmp_path):
    rows = "((1, 0, 1, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))"  # x goes to (1, 0, 1)
    moved = f'matrix4d xformOp:transform = {rows}\nuniform token[] xformOpOrder = ["xformOp:transform"]'
    scene, _ = read(tmp_path, stage(CONSTANT, extra=moved).replace(OUTPUT, BOTH))
    assert corners(scene)[0, 0] == pytest.approx(0.5 * np.array([-1, 0, 1]) / np.sqrt(2))
