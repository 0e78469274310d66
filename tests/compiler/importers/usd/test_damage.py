"""Stages with one damaged item: it is named and left out, and the rest is drawn."""

import numpy as np
import pytest
from maquette.compiler.importers.usd import sources, stage

from .stages import SQUARE, attribute, kinds, read
from .test_materials import ST

BOUND = '(prepend apiSchemas = ["MaterialBindingAPI"])'
QUAD = f'def Mesh "q" {BOUND} {{ rel material:binding = </m>\n{SQUARE}\nMORE }}'
NO_SIZE = "x.usda</l>: warning: the size or angle of this light is 0, negative or not finite: it is left out"


@pytest.mark.parametrize(
    "text",
    [
        'def RectLight "l" { float inputs:width = 0 }', 'def DiskLight "l" { float inputs:radius = -1 }',
        'def CylinderLight "l" { float inputs:radius = 0 }', 'def CylinderLight "l" { float inputs:length = nan }',
        'def SphereLight "l" { float inputs:radius = nan }', 'def DistantLight "l" { float inputs:angle = nan }',
        'def RectLight "l" { float inputs:height = inf }',
    ],
)  # fmt: skip
def test_a_light_without_a_size_is_left_out(tmp_path, text):
    scene, messages = read(tmp_path, text + '\ndef SphereLight "k" {}\ndef Cube "c" {}')
    assert messages == [NO_SIZE]
    assert scene.names.lights == ("/k",)


@pytest.mark.parametrize(
    "text", ['def Sphere "l" { double radius = 1e30 }', 'def Points "l" { point3f[] points = [(0, 0, 0)]\nfloat[] widths = [3e38] }']
)
def test_a_shape_beyond_a_camera_is_not_framed(tmp_path, text):
    scene, messages = read(tmp_path, text + '\ndef Cube "c" {}')
    assert messages == []
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert scene.tables.transforms.matrix[scene.tables.cameras.transform[0], 2, 3] < 20


def test_time_codes_of_a_damaged_stage(tmp_path):
    path = tmp_path / "x.usda"
    header = "#usda 1.0\n(\n    startTimeCode = 1\n    endTimeCode = 4\n    timeCodesPerSecond = 12\n)\n"
    path.write_text(header + 'double x = ?\ndef Cube "c"\n{\n}\n')
    assert (stage.time_codes(path), stage.time_codes_per_second(path)) == ((1, 4), 12)
    path.write_text("nothing of the kind")
    assert (stage.time_codes(path), stage.time_codes_per_second(path)) == (None, 24)


def test_shaping_that_is_not_finite_is_left_out(tmp_path):
    text = 'def SphereLight "l" (prepend apiSchemas = ["ShapingAPI"]) { float inputs:shaping:cone:angle = nan }\ndef Cube "c" {}'
    scene, messages = read(tmp_path, text)
    assert messages == ["x.usda</l>: warning: the shaping of this light is not finite: it is left out"]
    assert scene.tables.lights.image.tolist() == [-1]


@pytest.mark.parametrize(
    ("kind", "node", "value"),
    [("UsdPreviewSurface", "ND_convert_color3_color3", "diffuseColor"), ("ND_standard_surface_surfaceshader", "ND_convert_color3_color3",
      "base_color")],
)  # fmt: skip
def test_shaders_that_feed_each_other(tmp_path, kind, node, value):
    text = f"""def Material "m" {{ token outputs:surface.connect = </m/s.outputs:out>
        def Shader "s" {{ uniform token info:id = "{kind}"
            color3f inputs:{value}.connect = </m/a.outputs:out>
            token outputs:out }}
        def Shader "a" {{ uniform token info:id = "{node}"
            color3f inputs:in.connect = </m/b.outputs:out>
            color3f outputs:out }}
        def Shader "b" {{ uniform token info:id = "{node}"
            color3f inputs:in.connect = </m/a.outputs:out>
            color3f outputs:out }} }}"""
    scene, messages = read(tmp_path, text + QUAD.replace("MORE", ""))
    assert kinds(scene) == ["MESH"]
    assert len(messages) == 1
    assert messages[0].endswith(f"warning: more than {sources.MOST_NODES} shaders feed each other: the input takes its default")


def test_a_picture_that_feeds_its_own_scale(tmp_path):
    text = """def Material "m" { token outputs:surface.connect = </m/s.outputs:out>
        def Shader "s" { uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </m/a.outputs:rgb>
            token outputs:out }
        def Shader "a" { uniform token info:id = "UsdUVTexture"
            float4 inputs:scale.connect = </m/a.outputs:rgb>
            asset inputs:file.connect = </m/a.outputs:rgb>
            float3 outputs:rgb } }"""
    scene, messages = read(tmp_path, text + QUAD.replace("MORE", ST))
    assert kinds(scene) == ["MESH"]
    assert messages == ["x.usda</m/a>: warning: the texture names no file: its fallback is drawn"]


def test_a_material_that_does_not_exist_is_named(tmp_path):
    messages = read(tmp_path, QUAD.replace("MORE", ""))[1]
    assert messages == ["x.usda</q>: warning: the material /m does not exist: its prims show their displayColor"]


def test_subsets_beyond_the_faces_are_named(tmp_path):
    subset = f'def GeomSubset "a" {BOUND} {{ uniform token elementType = "face"\nuniform token familyName = "materialBind"\n'
    text = QUAD.replace("rel material:binding = </m>", "").replace("MORE", subset + "int[] indices = [0, 9, -3]\n}")
    scene, messages = read(tmp_path, text)
    assert kinds(scene) == ["MESH"]
    assert messages == ["x.usda</q>: warning: 2 indices of the subsets of this mesh are not faces of it: they are left out"]


def test_primvars_that_are_not_finite_count_as_0(tmp_path):
    colors = 'color3f[] primvars:displayColor = [(nan, 0.5, 1), (1, 1, 1), (1, 1, 1), (1, 1, 1)] (interpolation = "vertex")'
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {SQUARE}\n{colors} }}')
    assert messages == ["x.usda</m>: warning: `displayColor` has values that are not finite: NaN counts as 0"]
    assert attribute(scene, "colors")[0, 0].tolist() == [0, 0.5, 1]
    assert np.isfinite(attribute(scene, "colors")).all()


def test_a_camera_with_an_unknown_operation_is_left_out(tmp_path):
    text = 'def Camera "c" { uniform token[] xformOpOrder = ["xformOp:transla0e"] }\ndef Cube "k" {}'
    _, messages = read(tmp_path, text)
    assert messages[0].startswith("x.usda</c>: warning: this ")
    assert "transla0e" in messages[0]


def test_a_variant_that_does_not_exist_is_named(tmp_path):
    text = """def "v" (
    variants = { string size = "huge"
    }
    prepend variantSets = "size"
)
{
    variantSet "size" = { "small" { def Sphere "s" {} }
    "big" {}
    }
}
def Material "m" (
    variants = { string look = "red"
    }
    prepend variantSets = "look"
)
{
    variantSet "look" = { "blue" {}
    }
}
def Cube "c" {}"""
    scene, messages = read(tmp_path, text)
    assert kinds(scene) == ["BOX"]
    assert messages == [
        "x.usda</v>: warning: the variant set `size` has no variant `huge`, which is selected: none is drawn (it has big, small)",
        "x.usda</m>: warning: the variant set `look` has no variant `red`, which is selected: none is drawn (it has blue)",
    ]


def test_an_instancer_without_prototypes_is_named(tmp_path):
    text = 'def PointInstancer "p" { int[] protoIndices = [0, 0]\npoint3f[] positions = [(0, 0, 0), (1, 0, 0)] }\ndef Cube "c" {}'
    scene, messages = read(tmp_path, text)
    assert kinds(scene) == ["BOX"]
    assert messages == ["x.usda</p>: warning: this instancer has no prototypes: its 2 instances are left out"]


def test_layers_in_memory_have_no_names_in_messages(tmp_path):
    (tmp_path / "y.usda").write_text('#usda 1.0\n(\n    defaultPrim = "y"\n)\ndef "y" (\n    references = @y.usda@\n)\n{\n}\n')
    scene, messages = read(tmp_path, 'def "r" (references = @y.usda@) {}\ndef Cube "c" {}')
    assert kinds(scene) == ["BOX"]
    cycle = "Cycle detected: @x.usda@</r> references: @y.usda@</y> which CANNOT reference: @y.usda@</y>"
    assert messages == [f"x.usda: warning: In </r>: {cycle}"]
