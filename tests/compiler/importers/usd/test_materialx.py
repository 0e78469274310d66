"""MaterialX surfaces in USD stages as principled materials."""

import numpy as np
import pytest
from maquette.compiler import ir

from ....files import write_image
from .stages import SQUARE, read, slot

STAGE = """
def Material "m" {{ token outputs:{context}surface.connect = </m/s.outputs:out>
    def Shader "s" {{ uniform token info:id = "{kind}"
        {inputs}
        token outputs:out }}
    {nodes}
}}
def Mesh "thing" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    rel material:binding = </m>
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    {square}
}}
"""
STANDARD = "ND_standard_surface_surfaceshader"


def drawn(tmp_path, inputs, kind=STANDARD, nodes="", context="mtlx:", header=""):
    return read(tmp_path, STAGE.format(context=context, kind=kind, inputs=inputs, nodes=nodes, square=SQUARE), header)


@pytest.mark.parametrize("context", ["mtlx:", ""])
def test_constants_of_a_standard_surface(tmp_path, context):
    inputs = """float inputs:base = 0.5
        color3f inputs:base_color = (0.8, 0.4, 0.2)
        float inputs:metalness = 0.25
        float inputs:specular_roughness = 0.4
        float inputs:specular_IOR = 1.6
        float inputs:coat = 0.75
        float inputs:emission = 3
        color3f inputs:emission_color = (1, 0.5, 0)
        color3f inputs:opacity = (0.5, 0.5, 0.5)"""
    scene, messages = drawn(tmp_path, inputs, context=context)
    assert messages == []
    assert slot(scene, "DIFFUSE") == pytest.approx([0.4, 0.2, 0.1])
    assert slot(scene, "EMISSION") == pytest.approx([3, 1.5, 0])
    found = [slot(scene, name)[0] for name in ("METALLIC", "ROUGHNESS", "IOR", "COAT", "COAT_ROUGHNESS", "OPACITY")]
    below = 1.6 * (1 + 0.75 * (1.5 - 1))  # below the coat its highlight is that of 1.6 below air
    assert found == pytest.approx([0.25, 0.4, below, 0.75, 0.1, 0.5])


@pytest.mark.parametrize(
    ("kind", "diffuse", "rough"),
    [(STANDARD, 0.8, 0.2), ("ND_open_pbr_surface_surfaceshader", 0.8, 0.3), ("ND_gltf_pbr_surfaceshader", 1, 1),
     ("arnold:standard_surface", 0.8, 0.2), ("ND_UsdPreviewSurface_surfaceshader", 0.18, 0.5)],
)  # fmt: skip
def test_defaults(tmp_path, kind, diffuse, rough):
    scene, messages = drawn(tmp_path, "", kind, context="arnold:" if kind.startswith("arnold") else "mtlx:")
    assert messages == []
    assert (slot(scene, "DIFFUSE"), slot(scene, "ROUGHNESS")[0]) == (pytest.approx([diffuse] * 3), pytest.approx(rough))
    assert slot(scene, "EMISSION") == [0, 0, 0]


def test_sheen(tmp_path):
    inputs = "float inputs:sheen = 0.5\ncolor3f inputs:sheen_color = (1, 0.5, 0)"
    scene, messages = drawn(tmp_path, inputs)
    assert (slot(scene, "FUZZ")[0], slot(scene, "FUZZ_COLOR")) == (0.5, [1, 0.5, 0])
    assert (slot(scene, "FUZZ_ROUGHNESS")[0], messages) == (pytest.approx(0.603), [])  # conty_kulla
    inputs = "color3f inputs:sheen_color = (1, 0.5, 0)\nfloat inputs:sheen_roughness = 0.75"
    scene, messages = drawn(tmp_path, inputs, "ND_gltf_pbr_surfaceshader")
    assert (slot(scene, "SHEEN"), slot(scene, "SHEEN_ROUGHNESS")[0], messages) == ([1, 0.5, 0], 0.75, [])


def test_other_inputs_are_named(tmp_path):
    others = ("haze", "transmission_extra_roughness")
    inputs = "\n".join(f"float inputs:{name} = 0.5" for name in others)
    _, messages = drawn(tmp_path, f"float inputs:transmission = 1\n{inputs}")
    expected = [f"x.usda</m/s>: warning: the input `{name}` of {STANDARD} is not drawn" for name in others]
    assert sorted(messages) == expected


def test_tints_above_one_are_named(tmp_path):
    kind = "ND_open_pbr_surface_surfaceshader"
    for red, said in ((1.0, []), (1.2, ["x.usda</thing>: warning: a specular colour above 1 counts as 1"])):
        assert drawn(tmp_path, f"color3f inputs:specular_color = ({red}, 1, 1)", kind)[1] == said


MAPS = """
    def Shader "{name}" {{ uniform token info:id = "ND_normalmap"
        vector3f inputs:in.connect = </m/{name}i.outputs:out>
        vector3f outputs:out }}
    def Shader "{name}i" {{ uniform token info:id = "ND_image_vector3"
        asset inputs:file = @{name}.png@
        vector3f outputs:out }}"""


@pytest.mark.parametrize(
    ("kind", "coat", "coat_normal"),
    [(STANDARD, "coat", "coat_normal"), ("ND_open_pbr_surface_surfaceshader", "coat_weight", "geometry_coat_normal"),
     ("ND_gltf_pbr_surfaceshader", "clearcoat", "clearcoat_normal")],
)  # fmt: skip
@pytest.mark.parametrize(
    ("base", "coat_map", "values", "mapped"),
    [("a", "", (0, 0, 1), False), ("a", "b", (1, 1, 1), True), ("", "b", (1, 1, 1), True), ("a", "a", (0, 0, 0), False),
     ("", "", (0, 0, 0), False)],
)  # fmt: skip
def test_normals_of_coats(tmp_path, kind, coat, coat_normal, base, coat_map, values, mapped):
    """A coat without a normal of its own is smooth: the default is the geometric normal."""
    for name in "ab":
        write_image(tmp_path / f"{name}.png", np.full((2, 2, 3), (140, 128, 250), np.uint8))
    normal = "geometry_normal" if kind.startswith("ND_open") else "normal"
    lines = [f"float inputs:{coat} = 1"]
    lines += [f"vector3f inputs:{name}.connect = </m/{at}.outputs:out>" for name, at in ((normal, base), (coat_normal, coat_map)) if at]
    scene, messages = drawn(tmp_path, "\n".join(lines), kind, "".join(MAPS.format(name=name) for name in "ab"))
    m = scene.tables.materials
    assert messages == []
    assert tuple(m.values[0, ir.Slot.COAT_NORMAL]) == values
    assert (m.textures[0, ir.Slot.COAT_NORMAL] >= 0) == mapped
    assert (m.textures[0, ir.Slot.NORMAL] >= 0) == bool(base)


def test_a_coat_with_the_normal_of_the_geometry_is_smooth(tmp_path):
    """In the space of the world, too: the node is not evaluated."""
    write_image(tmp_path / "a.png", np.full((2, 2, 3), (140, 128, 250), np.uint8))
    node = """
    def Shader "g" { uniform token info:id = "ND_normal_vector3"
        string inputs:space = "world"
        vector3f outputs:out }"""
    lines = ["float inputs:coat = 1", "vector3f inputs:normal.connect = </m/a.outputs:out>",
             "vector3f inputs:coat_normal.connect = </m/g.outputs:out>"]  # fmt: skip
    scene, messages = drawn(tmp_path, "\n".join(lines), nodes=MAPS.format(name="a") + node)
    assert (messages, slot(scene, "COAT_NORMAL")) == ([], [0, 0, 1])


def test_pictures(tmp_path):
    """A tiled picture times the weight of the base, in the colour space of the file; one channel of another; a normal map."""
    write_image(tmp_path / "p.png", np.array([[[128, 64, 255]]], np.uint8))
    nodes = """
    def Shader "t" { uniform token info:id = "ND_tiledimage_color3"
        asset inputs:file = @p.png@ (colorSpace = "srgb_texture")
        float2 inputs:uvtiling = (4, 2)
        float2 inputs:uvoffset = (0.5, 0)
        string inputs:vaddressmode = "clamp"
        color3f outputs:out }
    def Shader "i" { uniform token info:id = "ND_image_vector3"
        asset inputs:file = @p.png@
        float3 outputs:out }
    def Shader "x" { uniform token info:id = "ND_separate3_vector3"
        float3 inputs:in.connect = </m/i.outputs:out>
        float outputs:outy }
    def Shader "n" { uniform token info:id = "ND_normalmap"
        float3 inputs:in.connect = </m/i.outputs:out>
        float inputs:scale = 0.5
        float3 outputs:out }
    """
    inputs = """float inputs:base = 0.5
        color3f inputs:base_color.connect = </m/t.outputs:out>
        float inputs:specular_roughness.connect = </m/x.outputs:outy>
        vector3f inputs:normal.connect = </m/n.outputs:out>"""
    scene, messages = drawn(tmp_path, inputs, nodes=nodes)
    assert messages == []
    t = scene.tables
    base, rough, normal = (t.materials.textures[0, ir.Slot[name]] for name in ("DIFFUSE", "ROUGHNESS", "NORMAL"))
    assert t.textures.frame[base].tolist() == [[4, 0, -0.5], [0, 2, 0]]
    assert (t.textures.gain[base].tolist(), t.textures.channel[base]) == ([0.5] * 3, -1)
    assert (t.textures.wrap_u[base], t.textures.wrap_v[base]) == (ir.Wrap.REPEAT, ir.Wrap.CLAMP)
    assert t.images.texels[t.images.first[t.textures.image[base]], 0] == pytest.approx(0.2158605)
    assert (t.textures.channel[rough], t.images.texels[t.images.first[t.textures.image[rough]], 1]) == (1, pytest.approx(64 / 255))
    assert t.materials.values[0, ir.Slot.NORMAL].tolist() == [0.5, 0.5, 1]
    assert (t.textures.gain[normal].tolist(), t.textures.bias[normal].tolist()) == ([2] * 3, [-1] * 3)


def test_place2d(tmp_path):
    """Coordinates about the pivot (1/2, 1/2) over the scale 2: the middle stays, the corner is at 1/4."""
    write_image(tmp_path / "p.png", np.array([[[128, 64, 255]]], np.uint8))
    nodes = """
    def Shader "t" { uniform token info:id = "ND_image_color3"
        asset inputs:file = @p.png@
        float2 inputs:texcoord.connect = </m/p.outputs:out>
        color3f outputs:out }
    def Shader "p" { uniform token info:id = "ND_place2d_vector2"
        float2 inputs:texcoord.connect = </m/g.outputs:out>
        float2 inputs:pivot = (0.5, 0.5)
        float2 inputs:scale = (2, 2)
        float2 outputs:out }
    def Shader "g" { uniform token info:id = "ND_geompropvalue_vector2"
        string inputs:geomprop = "st"
        float2 outputs:out }
    """
    scene, messages = drawn(tmp_path, "color3f inputs:base_color.connect = </m/t.outputs:out>", nodes=nodes)
    assert messages == []
    frame = scene.tables.textures.frame[scene.tables.materials.textures[0, ir.Slot.DIFFUSE]]
    assert frame @ [0.5, 0.5, 1] == pytest.approx([0.5, 0.5])
    assert frame @ [0, 0, 1] == pytest.approx([0.25, 0.25])


def test_a_node_that_is_not_drawn_is_named(tmp_path):
    nodes = 'def Shader "f" { uniform token info:id = "ND_flake3d"\ncolor3f outputs:out }'
    scene, messages = drawn(tmp_path, "color3f inputs:base_color.connect = </m/f.outputs:out>", nodes=nodes)
    assert messages == ["x.usda</m/f>: warning: the shader `ND_flake3d` is not drawn: the input it feeds takes its default"]
    assert slot(scene, "DIFFUSE") == pytest.approx([0.8] * 3)


@pytest.mark.parametrize("through_node", [False, True])
def test_a_circle_of_interface_inputs_is_told(tmp_path, through_node):
    nodes = """def NodeGraph "g" {
        float inputs:a.connect = </m/g.inputs:b>
        float inputs:b.connect = </m/g.inputs:a>
        float outputs:out.connect = </m/g/n.outputs:out>
        def Shader "n" { uniform token info:id = "ND_multiply_float"
            float inputs:in1.connect = </m/g.inputs:a>
            float inputs:in2 = 0.5
            float outputs:out } }"""
    source = "outputs:out" if through_node else "inputs:a"
    scene, messages = drawn(tmp_path, f"float inputs:specular_roughness.connect = </m/g.{source}>", nodes=nodes)
    name = "in1" if through_node else "specular_roughness"
    told = [m for m in messages if f"the input `{name}` takes its default: its connections form a circle at `/m/g.inputs:" in m]
    assert len(told) == 1
    assert told[0].startswith("x.usda</m/g>: warning: ")
    assert slot(scene, "ROUGHNESS")[0] == pytest.approx(0.0 if through_node else 0.2)
