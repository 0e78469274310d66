"""Primvars that materials read: several sets of texture coordinates, numbers that vary, and the modes of opacity."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers.common import uv_sets

from ....files import write_image
from .stages import SQUARE, attribute, read, slot
from .test_materials import stage

PRIMVAR = '{0}[] primvars:{1} = {2} (interpolation = "{3}")'
ST = PRIMVAR.format("texCoord2f", "st", "[(0, 0), (1, 0), (1, 1), (0, 1)]", "vertex")
READER = """def Shader "n" {{ uniform token info:id = "UsdPrimvarReader_float"
string inputs:varname = "{0}"
float outputs:result }}"""


def two_sets(tmp_path, second, interpolation="vertex", st=ST, mesh=SQUARE):
    """A material with a diffuse picture that reads st, and an emissive one that reads st1."""
    write_image(tmp_path / "p.png", np.array([[[255, 0, 0]]], np.uint8))
    nodes = "".join(
        f"""def Shader "{name}" {{ uniform token info:id = "UsdUVTexture"
        asset inputs:file = @p.png@
        float2 inputs:st.connect = </m/{name}r.outputs:result>
        float3 outputs:rgb }}
        def Shader "{name}r" {{ uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "{varname}"
        float2 outputs:result }}"""
        for name, varname in (("a", "st"), ("b", "st1"))
    )
    inputs = "color3f inputs:diffuseColor.connect = </m/a.outputs:rgb>\ncolor3f inputs:emissiveColor.connect = </m/b.outputs:rgb>"
    extra = st + "\n" + (PRIMVAR.format("texCoord2f", "st1", second, interpolation) if second else "")
    return read(tmp_path, stage(inputs, nodes, extra).replace(SQUARE, mesh))


def coordinates(scene, name, instance=0):
    """Coordinates of a slot's picture at the corners of an instance's triangles."""
    t = scene.tables
    frame = t.textures.frame[t.materials.textures[t.instances.material[instance], ir.Slot[name]]]
    return attribute(scene, "uvs", instance) @ frame[:, :2].T + frame[:, 2]


def test_a_second_set_of_coordinates_is_a_frame(tmp_path):
    scene, messages = two_sets(tmp_path, "[(0, 0), (0, 3), (-2, 3), (-2, 0)]")
    assert (messages, len(scene.names.instances)) == ([], 1)
    assert coordinates(scene, "DIFFUSE")[0].tolist() == [[0, 0], [1, 0], [1, 1]]
    assert np.allclose(coordinates(scene, "EMISSION")[0], [[0, 0], [0, 3], [-2, 3]])


def test_faces_with_maps_of_their_own_are_parts(tmp_path):
    """Two quads side by side; the second set shows the picture whole on each."""
    mesh = """
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 5, 1, 2, 3, 4]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
    """
    first = PRIMVAR.format("texCoord2f", "st", "[(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)]", "vertex")
    second = "[(0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0), (1, 1), (0, 1)]"
    scene, messages = two_sets(tmp_path, second, "faceVarying", first, mesh)
    assert (messages, len(scene.names.instances)) == ([], 2)
    for instance in (0, 1):
        assert np.allclose(coordinates(scene, "EMISSION", instance)[0], [[0, 0], [1, 0], [1, 1]], atol=1e-6)


def test_a_picture_without_its_coordinates_shows_its_fallback(tmp_path):
    scene, messages = two_sets(tmp_path, "")
    reason = f"`st1` is absent, or no {uv_sets.MOST_PARTS} affine maps lead to it from the first picture's primvar"
    assert messages == [f"x.usda</m/b>: warning: the picture `b` is left out, and its fallback drawn: {reason}"]
    assert slot(scene, "EMISSION") == [0, 0, 0]


@pytest.mark.parametrize(("name", "value"), [("roughness", "ROUGHNESS"), ("metallic", "METALLIC"), ("opacity", "OPACITY")])
def test_a_number_that_varies_is_the_coordinate_of_a_ramp(tmp_path, name, value):
    extra = PRIMVAR.format("float", "wear", "[0, 0.25, 0.5, 2]", "vertex")
    scene, messages = read(tmp_path, stage(f"float inputs:{name}.connect = </m/n.outputs:result>", READER.format("wear"), extra))
    t = scene.tables
    row = t.materials.textures[0, ir.Slot[value]]
    told = "1 of 4 numbers at vertices lie outside 0 to 1: they count as 0 or 1 (primvar `wear`)"
    assert (messages, slot(scene, value)) == ([f"x.usda</thing>: warning: {told}"], [1, 0, 0])
    assert attribute(scene, "uvs")[..., 0].tolist() == [[0, 0.25, 0.5], [0, 0.5, 1]]
    assert (t.textures.frame[row] @ [[0, 1], [0, 0], [1, 1]]).tolist() == [[0.25, 0.75], [0.5, 0.5]]


def test_an_opacity_that_varies_without_a_material(tmp_path):
    text = f'def Mesh "m" {{ {SQUARE}\n{PRIMVAR.format("float", "displayOpacity", "[0, 0.25, 0.5, 1]", "vertex")} }}'
    scene, messages = read(tmp_path, text)
    assert (messages, slot(scene, "OPACITY")) == ([], [1, 0, 0])
    assert scene.tables.materials.textures[0, ir.Slot.OPACITY] >= 0
    assert attribute(scene, "uvs")[..., 0].tolist() == [[0, 0.25, 0.5], [0, 0.5, 1]]


def test_presence_fades_the_whole_surface(tmp_path):
    scene, messages = read(tmp_path, stage('float inputs:opacity = 0.5\ntoken inputs:opacityMode = "presence"'))
    assert (messages, slot(scene, "OPACITY"), slot(scene, "TRANSMISSION")) == ([], [0.5, 0, 0], [0, 0, 0])
    scene, messages = read(tmp_path, stage('float inputs:opacity = 0.5\ntoken inputs:opacityMode = "transparent"'))
    assert (messages, slot(scene, "OPACITY"), slot(scene, "TRANSMISSION")) == ([], [0.5, 0, 0], [0, 0, 0])
    assert slot(scene, "SPECULAR") == pytest.approx([0.08] * 3)


def test_coordinates_that_a_mesh_lacks_are_named(tmp_path):
    write_image(tmp_path / "p.png", np.array([[[255, 0, 0], [0, 0, 0]]], np.uint8))
    nodes = """def Shader "a" { uniform token info:id = "UsdUVTexture"
        asset inputs:file = @p.png@
        float2 inputs:st.connect = </m/r.outputs:result>
        float3 outputs:rgb }
        def Shader "r" { uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "UVMap"
        float2 outputs:result }"""
    messages = read(tmp_path, stage("color3f inputs:diffuseColor.connect = </m/a.outputs:rgb>", nodes, ST))[1]
    assert messages == [
        "x.usda</thing>: warning: the material reads the primvar `UVMap`, which this mesh lacks: each picture shows one texel"
    ]
