"""UsdPreviewSurface networks: values, pictures, primvars, node graphs, bindings; and what is not drawn, by name."""

import zipfile

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene import metallic_roughness
from maquette.compiler.scene.row_records import Input

from ....files import write_image
from .stages import SQUARE, attribute, load, read, slot

SURFACE = """
def Material "m" { token outputs:surface.connect = </m/s.outputs:surface>
    def Shader "s" { uniform token info:id = "UsdPreviewSurface"
        INPUTS
        token outputs:surface }
    NODES
}
"""
BOUND = f"""
def Mesh "thing" (prepend apiSchemas = ["MaterialBindingAPI"]) {{
    rel material:binding = </m>
    {SQUARE}
    EXTRA
}}
"""
TEXTURE = """
def Shader "t" { uniform token info:id = "UsdUVTexture"
    asset inputs:file = @p.png@
    OPTIONS
    float3 outputs:rgb
    float outputs:g }
"""
GONE = TEXTURE.replace("p.png", "gone.png").replace("OPTIONS", "float4 inputs:fallback = (1, 0, 0, 1)")
READER = """
def Shader "r" { uniform token info:id = "UsdPrimvarReader_float2"
    string inputs:varname = "map1"
    float2 outputs:result }
"""


ST = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'


def stage(inputs, nodes="", extra=""):
    extra = extra or (ST if "UsdUVTexture" in nodes else "")
    return SURFACE.replace("INPUTS", inputs).replace("NODES", nodes) + BOUND.replace("EXTRA", extra)


def picture(path, texels=((0, 0, 0), (255, 255, 255), (255, 0, 0), (0, 0, 255))):
    write_image(path, np.array(texels, np.uint8).reshape(2, 2, 3))


def textured(tmp_path, options="", nodes="", wire="rgb", extra="", name="diffuseColor", kind="color3f"):
    picture(tmp_path / "p.png")
    inputs = f"{kind} inputs:{name}.connect = </m/t.outputs:{wire}>"
    return read(tmp_path, stage(inputs, TEXTURE.replace("OPTIONS", options) + nodes, extra))


def test_values(tmp_path):
    text = "color3f inputs:diffuseColor = (0.5, 0.25, 0.125)\nfloat inputs:roughness = 0.5\nfloat inputs:ior = 1.5"
    scene, messages = read(tmp_path, stage(text))
    assert messages == []
    m = scene.tables.materials
    assert (ir.MaterialModel(m.model[0]).name, scene.names.materials[0]) == ("PRINCIPLED", "m")
    assert slot(scene, "DIFFUSE") == [0.5, 0.25, 0.125]
    assert (slot(scene, "IOR")[0], slot(scene, "ROUGHNESS")[0], slot(scene, "METALLIC")[0]) == (1.5, 0.5, 0)
    assert slot(scene, "EMISSION") == [0, 0, 0]


def test_defaults_are_the_specification_s(tmp_path):
    scene, _ = read(tmp_path, stage(""))
    assert slot(scene, "DIFFUSE") == pytest.approx([0.18] * 3)
    assert [slot(scene, name)[0] for name in ("ROUGHNESS", "METALLIC", "IOR", "COAT", "AMBIENT")] == [0.5, 0, 1.5, 0, 1]


def test_specular_workflow_emission_and_opacity(tmp_path):
    text = """
    int inputs:useSpecularWorkflow = 1
    color3f inputs:specularColor = (0.3, 0.2, 0.1)
    color3f inputs:emissiveColor = (4, 5, 6)
    color3f inputs:diffuseColor = (1, 1, 1)
    float inputs:metallic = 1
    float inputs:opacity = 0.25
    """
    scene, _ = read(tmp_path, stage(text))
    assert slot(scene, "SPECULAR") == pytest.approx([1, 0.8, 0.4])  # over the opacity, below 1
    assert slot(scene, "EMISSION") == [16, 20, 24]
    assert slot(scene, "DIFFUSE") == [1, 1, 1]
    assert slot(scene, "OPACITY") == [0.25, 0, 0]
    assert slot(scene, "TRANSMISSION") == [0] * 3
    assert ir.MaterialModel(scene.tables.materials.model[0]) == ir.MaterialModel.PRINCIPLED_SPECULAR


def test_numbers_beyond_their_ends_are_held():
    surface = metallic_roughness.Surface(metallic=Input.number(-3), roughness=Input.number(7), opacity=Input.number(7))
    made = metallic_roughness.material(surface).inputs
    assert (made[ir.Slot.METALLIC].value[0], made[ir.Slot.ROUGHNESS].value[0]) == (0, 1)
    assert ir.Slot.OPACITY not in made


@pytest.mark.parametrize(
    ("surface", "opacity", "specular"),
    [
        (metallic_roughness.Surface(opacity=Input.number(0.5), highlights_stay=True), 0.5, 0.08),  # of 0.04
        (metallic_roughness.Surface(opacity=Input.number(0.0), highlights_stay=True), 0.04, 1.0),
        (metallic_roughness.Surface(opacity=Input.number(0.0), highlights_stay=True, ior=Input.number(1.0)), 0.0, 0.0),
        (metallic_roughness.Surface(opacity=Input.number(0.5), highlights_stay=True, metallic=Input.number(1)), 0.5, None),  # fades
        (metallic_roughness.Surface(opacity=Input.number(0.5, 3), transmission=0.5), 0.25, 0.08),
        (metallic_roughness.Surface(opacity=Input.number(0.0), highlights_stay=True, specular=Input((0.9, 0.9, 0.9))), 0.08, 1.0),
    ],
    ids=["half", "clear", "without a highlight", "metal", "holes", "mirror"],
)
def test_a_transparent_surface_covers_its_opacity_and_keeps_its_highlight(surface, opacity, specular):
    made = metallic_roughness.material(surface)
    assert made.inputs[ir.Slot.OPACITY].value[0] == pytest.approx(opacity)
    assert ir.Slot.TRANSMISSION not in made.inputs
    assert (made.model == ir.MaterialModel.PRINCIPLED_SPECULAR) == (specular is not None)
    if specular is not None:
        assert made.inputs[ir.Slot.SPECULAR].value[0] == pytest.approx(specular)


def test_picture(tmp_path):
    st = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")'
    scene, messages = textured(tmp_path, extra=st)
    t = scene.tables
    assert messages == []
    assert slot(scene, "DIFFUSE") == [1, 1, 1]
    assert t.materials.textures[0, ir.Slot.DIFFUSE] == 0
    assert attribute(scene, "uvs")[0].tolist() == [[0, 0], [1, 0], [1, 1]]
    assert t.images.texels[:, :3].tolist() == [[0, 0, 0], [1, 1, 1], [1, 0, 0], [0, 0, 1]]
    assert (t.textures.wrap_u[0], t.textures.channel[0]) == (ir.Wrap.BLACK, -1)  # useMetadata without metadata


def test_picture_options(tmp_path):
    options = """
    token inputs:wrapS = "repeat"
    token inputs:wrapT = "mirror"
    float4 inputs:scale = (0.5, 0.25, 2, 1)
    float4 inputs:bias = (0.1, 0.2, 0.3, 0)
    token inputs:sourceColorSpace = "raw"
    """
    t = textured(tmp_path, options)[0].tables.textures
    assert (t.wrap_u[0], t.wrap_v[0]) == (ir.Wrap.REPEAT, ir.Wrap.MIRROR)
    assert t.gain[0] == pytest.approx([0.5, 0.25, 2])
    assert t.bias[0] == pytest.approx([0.1, 0.2, 0.3])
    t = textured(tmp_path, options, wire="g")[0].tables.textures
    assert t.channel[0] == 1
    assert t.gain[0] == pytest.approx([0.25] * 3)


@pytest.mark.parametrize(("space", "value"), [("sRGB", 0.2158605), ("raw", 128 / 255), ("auto", 0.2158605)])
def test_colour_spaces(tmp_path, space, value):
    picture(tmp_path / "p.png", [(128, 128, 128)] * 4)
    nodes = TEXTURE.replace("OPTIONS", f'token inputs:sourceColorSpace = "{space}"')
    scene, _ = read(tmp_path, stage("color3f inputs:diffuseColor.connect = </m/t.outputs:rgb>", nodes))
    assert scene.tables.images.texels[0, 0] == pytest.approx(value)


def test_coordinates_by_name_and_transform(tmp_path):
    nodes = READER + """
    def Shader "x" { uniform token info:id = "UsdTransform2d"
        float2 inputs:in.connect = </m/r.outputs:result>
        float inputs:rotation = 90
        float2 inputs:scale = (2, 3)
        float2 inputs:translation = (0.5, 0.25)
        float2 outputs:result }
    """  # fmt: skip
    extra = """
    texCoord2f[] primvars:st = [(9, 9)] (interpolation = "constant")
    texCoord2f[] primvars:map1 = [(0.5, 0.5)] (interpolation = "constant")
    """
    scene, _ = textured(tmp_path, "float2 inputs:st.connect = </m/x.outputs:result>", nodes, extra=extra)
    assert attribute(scene, "uvs")[0, 0].tolist() == [0.5, 0.5]
    assert scene.tables.textures.frame[0] == pytest.approx(np.array([[0, -3, 0.5], [2, 0, 0.25]]), abs=1e-12)


def test_node_graphs_and_interfaces_are_seen_through(tmp_path):
    picture(tmp_path / "q.png", [(255, 0, 0)] * 4)
    text = """
    def Material "m" { token outputs:surface.connect = </m/s.outputs:surface>
        color3f inputs:tint = (0.1, 0.2, 0.3)
        string inputs:coordinates = "map1"
        def Shader "s" { uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </m/g.outputs:color>
            color3f inputs:emissiveColor.connect = </m.inputs:tint>
            token outputs:surface }
        def NodeGraph "g" { color3f outputs:color.connect = </m/g/t.outputs:rgb>
            asset inputs:file = @q.png@
            def Shader "t" { uniform token info:id = "UsdUVTexture"
                asset inputs:file.connect = </m/g.inputs:file>
                float2 inputs:st.connect = </m/g/r.outputs:result>
                float3 outputs:rgb }
            def Shader "r" { uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname.connect = </m.inputs:coordinates>
                float2 outputs:result } } }
    """
    extra = 'texCoord2f[] primvars:map1 = [(0.5, 0.5)] (interpolation = "constant")'
    scene, messages = read(tmp_path, text + BOUND.replace("EXTRA", extra))
    assert messages == []
    assert slot(scene, "EMISSION") == pytest.approx([0.1, 0.2, 0.3])
    assert scene.tables.images.texels[0, :3].tolist() == [1, 0, 0]
    assert attribute(scene, "uvs")[0, 0].tolist() == [0.5, 0.5]


PRIMVAR_READER = """
def Shader "c" { uniform token info:id = "UsdPrimvarReader_float3"
    string inputs:varname = "displayColor"
    float3 inputs:fallback = (0.5, 0.5, 0.5)
    float3 outputs:result }
def Shader "f" { uniform token info:id = "UsdPrimvarReader_float"
    string inputs:varname = "rough"
    float inputs:fallback = 1
    float outputs:result }
"""
READ = "color3f inputs:diffuseColor.connect = </m/c.outputs:result>\nfloat inputs:roughness.connect = </m/f.outputs:result>"


def test_primvars_feed_inputs(tmp_path):
    extra = "color3f[] primvars:displayColor = [(1, 0, 0)]\nfloat primvars:rough = 0.5"
    scene, messages = read(tmp_path, stage(READ, PRIMVAR_READER, extra))
    assert messages == []
    assert slot(scene, "DIFFUSE") == [1, 0, 0]
    assert slot(scene, "ROUGHNESS")[0] == 0.5
    scene, _ = read(tmp_path, stage(READ, PRIMVAR_READER))  # neither is there
    assert slot(scene, "DIFFUSE") == [0.5] * 3
    assert slot(scene, "ROUGHNESS")[0] == 1


def test_a_varying_colour_is_the_mesh_s_own(tmp_path):
    extra = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)] (interpolation = "vertex")'
    scene, _ = read(tmp_path, stage(READ, PRIMVAR_READER, extra))
    assert attribute(scene, "colors")[0].tolist() == np.eye(3).tolist()
    assert slot(scene, "DIFFUSE") == [1, 1, 1]


def test_a_picture_of_numbers_keeps_its_channel(tmp_path):
    scene, messages = textured(tmp_path, name="roughness", kind="float", wire="g")
    t = scene.tables
    assert messages == []
    row = t.materials.textures[0, ir.Slot.ROUGHNESS]
    assert (slot(scene, "ROUGHNESS")[0], t.textures.channel[row]) == (1, 1)
    assert t.images.texels[:, 1].tolist() == [0, 1, 0, 0]


def test_numbers_of_a_picture_are_as_stored_unless_it_says_srgb(tmp_path):
    picture(tmp_path / "p.png", [(128, 128, 128)] * 4)
    for space, value in (("auto", 128 / 255), ("raw", 128 / 255), ("sRGB", 0.2158605)):
        nodes = TEXTURE.replace("OPTIONS", f'token inputs:sourceColorSpace = "{space}"')
        scene, _ = read(tmp_path, stage("float inputs:metallic.connect = </m/t.outputs:g>", nodes))
        assert scene.tables.images.texels[0, 0] == pytest.approx(value)


@pytest.mark.parametrize("levels", [True, False])
def test_a_normal_map(tmp_path, levels):
    options = "float4 inputs:scale = (2, 2, 2, 2)\nfloat4 inputs:bias = (-1, -1, -1, -1)" if levels else ""
    scene, messages = textured(tmp_path, options, name="normal", kind="normal3f")
    t = scene.tables
    row = t.materials.textures[0, ir.Slot.NORMAL]
    assert (t.textures.gain[row].tolist(), t.textures.bias[row].tolist(), t.textures.channel[row]) == ([2, 2, 2], [-1, -1, -1], -1)
    said = "x.usda</m/t>: warning: the normal map has no scale of 2 and bias of -1: it is read as if it had"
    assert messages == ([] if levels else [said])


@pytest.mark.parametrize(
    ("inputs", "nodes", "expected"),
    [
        ("color3f inputs:diffuseColor.connect = </m/t.outputs:rgb>", GONE,
            "x.usda</m/t>: warning: there is no picture `gone.png`: its fallback is drawn"),
        ("float inputs:displacement = 0.5", "",
         "x.usda</m>: warning: the displacement of this material is not drawn: its outputs:displacement is not connected"),
        ("color3f inputs:diffuseColor.connect = </m/n.outputs:out>",
            'def Shader "n" { uniform token info:id = "Noise"\ncolor3f outputs:out }',
            "x.usda</m/n>: warning: the shader `Noise` is not drawn: the input it feeds takes its default"),
    ],
)  # fmt: skip
def test_what_is_not_drawn(tmp_path, inputs, nodes, expected):
    scene, messages = read(tmp_path, stage(inputs, nodes))
    assert messages == [expected]
    assert slot(scene, "DIFFUSE") == ([1, 0, 0] if "gone" in nodes else pytest.approx([0.18] * 3))


def test_unknown_surfaces_show_the_display_colour(tmp_path):
    text = stage("", "", "color3f[] primvars:displayColor = [(1, 0, 0)]").replace("UsdPreviewSurface", "Fancy")
    scene, messages = read(tmp_path, text)
    assert messages == ["x.usda</m>: warning: the surface shader `Fancy` is not drawn: its prims show their displayColor"]
    assert slot(scene, "DIFFUSE") == [1, 0, 0]


def test_bindings(tmp_path):
    """Inherited; a stronger one above wins; full goes before preview before all purposes."""

    def material(name, color):
        return SURFACE.replace('"m"', f'"{name}"').replace("</m/", f"</{name}/").replace("NODES", "").replace(
            "INPUTS", f"color3f inputs:diffuseColor = {color}")  # fmt: skip

    api = '(prepend apiSchemas = ["MaterialBindingAPI"])'
    text = (
        material("red", "(1, 0, 0)") + material("green", "(0, 1, 0)") + material("blue", "(0, 0, 1)")
        + f"""
        def Xform "a" {api} {{ rel material:binding = </red>
            def Cube "inherits" {{}}
            def Cube "own" {api} {{ rel material:binding = </green> }}
            def Cube "preview" {api} {{ rel material:binding = </green>
                rel material:binding:preview = </blue> }}
            def Cube "full" {api} {{ rel material:binding:full = </green>
                rel material:binding:preview = </blue> }} }}
        def Xform "b" {api} {{ rel material:binding = </red> (bindMaterialAs = "strongerThanDescendants")
            def Cube "loses" {api} {{ rel material:binding = </green> }} }}
        """
    )  # fmt: skip
    scene, messages = read(tmp_path, text)
    assert messages == []
    colors = {name: slot(scene, "DIFFUSE", k) for k, name in enumerate(scene.names.instances)}
    assert colors == {
        "/a/inherits": [1, 0, 0], "/a/own": [0, 1, 0], "/a/preview": [0, 0, 1], "/a/full": [0, 1, 0], "/b/loses": [1, 0, 0],
    }  # fmt: skip


def test_pictures_inside_of_a_package(tmp_path):
    textured(tmp_path, extra='texCoord2f[] primvars:st = [(0.5, 0.5)] (interpolation = "constant")')
    with zipfile.ZipFile(tmp_path / "y.usdz", "w", zipfile.ZIP_STORED) as package:
        for name in ("x.usda", "p.png"):
            info = zipfile.ZipInfo(name)
            assert package.fp is not None
            at = package.fp.tell() + 30 + len(name)
            info.extra = b"\x86\x19" + (n := (-at - 4) % 64).to_bytes(2, "little") + bytes(n)  # data starts at multiples of 64
            package.writestr(info, (tmp_path / name).read_bytes())
    (tmp_path / "p.png").unlink()
    scene, messages = load(tmp_path / "y.usdz")
    assert messages == []
    assert len(scene.tables.images.texels) == 4


def test_a_material_with_other_surfaces_only(tmp_path):
    text = stage("").replace("token outputs:surface.connect", "token outputs:ri:surface.connect")
    assert read(tmp_path, text)[1] == [
        "x.usda</m>: warning: the material has only surfaces that are not drawn (ri:surface): its prims show their displayColor"
    ]


def test_opacity_pictures_and_thresholds(tmp_path):
    scene, messages = textured(tmp_path, name="opacity", kind="float", wire="g", nodes="")
    m, t = scene.tables.materials, scene.tables.textures
    assert messages == []
    assert t.channel[m.textures[0, ir.Slot.OPACITY]] == 1
    assert (slot(scene, "OPACITY"), slot(scene, "TRANSMISSION"), m.threshold[0]) == ([1, 0, 0], [0, 0, 0], 0)
    scene, messages = read(tmp_path, stage("float inputs:opacity = 0.5\nfloat inputs:opacityThreshold = 0.25"))
    assert (messages, slot(scene, "OPACITY"), slot(scene, "TRANSMISSION")) == ([], [0.5, 0, 0], [0, 0, 0])
    assert scene.tables.materials.threshold[0] == 0.25


@pytest.mark.parametrize(
    ("interpolation", "values", "message"),
    [
        ("constant", "[(1, -0.5, 0)]", "this prim's displayColor has a negative component, which counts as 0"),
        ("vertex", "[(1, -0.5, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]", "this mesh's colours have negative components, which count as 0"),
    ],
)
def test_negative_colours_count_as_0(tmp_path, interpolation, values, message):
    color = f'color3f[] primvars:displayColor = {values} (interpolation = "{interpolation}")'
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {SQUARE}\n{color} }}')
    assert len(scene.tables.instances.material) == 1
    assert messages == [f"x.usda</m>: warning: {message}"]


def test_colours_of_an_instancer(tmp_path):
    """A displayColor for each instance is that of prototypes without one of their own."""
    text = f"""
def PointInstancer "pi" {{
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (1, 0, 0)] (interpolation = "varying")
    point3f[] positions = [(0, 0, 0), (2, 0, 0), (4, 0, 0)]
    int[] protoIndices = [0, 0, 0]
    rel prototypes = [</pi/q>]
    def Mesh "q" {{ {SQUARE} }}
}}"""
    scene, messages = read(tmp_path, text)
    assert messages == []
    rows = scene.tables.instances.material
    assert scene.tables.materials.values[rows, ir.Slot.DIFFUSE].tolist() == [[1, 0, 0], [0, 1, 0], [1, 0, 0]]


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.6, 0, 0.8)])
def test_a_constant_normal(tmp_path, normal):
    scene, messages = read(tmp_path, stage(f"normal3f inputs:normal = {normal}"))
    t = scene.tables
    row = t.materials.textures[t.instances.material[0], ir.Slot.NORMAL]
    assert messages == []
    if normal == (0, 0, 1):
        assert row == -1
    else:
        assert t.images.texels[t.images.first[t.textures.image[row]], :3] == pytest.approx(normal)
        assert (t.textures.gain[row] == 1).all()
        assert (t.textures.bias[row] == 0).all()


def udim(folder, sides, st, options="", faces="[4]", indices="[0, 1, 2, 3]"):
    """The scene of a square with coordinates `st` and a texture of tiles: number, colour, pixels along a side."""
    for number, color, side in sides:
        write_image(folder / f"t.{number}.png", np.full((side, side, 3), color, np.uint8))
    nodes = f"""def Shader "t" {{ uniform token info:id = "UsdUVTexture"
        asset inputs:file = @t.<UDIM>.png@
        token inputs:sourceColorSpace = "raw"
        {options}
        float3 outputs:rgb }}"""
    coordinates = f'texCoord2f[] primvars:st = {st} (interpolation = "faceVarying")'
    text = stage("color3f inputs:diffuseColor.connect = </m/t.outputs:rgb>", nodes, coordinates)
    return read(folder, text.replace("faceVertexCounts = [4]", f"faceVertexCounts = {faces}").replace("[0, 1, 2, 3]", indices))


RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)


def test_tiles_are_pictures_of_their_own(tmp_path):
    """Two triangles, in tiles 1001 and 1101; the third tile is not read."""
    st = [(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (0.1, 10.1), (0.9, 10.1), (0.9, 10.9)]
    scene, messages = udim(tmp_path, [(1001, RED, 2), (1002, BLUE, 64), (1101, GREEN, 4)], st, "", "[3, 3]", "[0, 1, 2, 0, 2, 3]")
    t = scene.tables
    assert messages == []
    assert t.images.width.tolist() == [2, 4]
    rows = t.materials.textures[t.instances.material, ir.Slot.DIFFUSE]
    assert [t.images.texels[t.images.first[t.textures.image[row]]].tolist() for row in rows] == [[1, 0, 0, 1], [0, 1, 0, 1]]
    assert t.textures.frame[rows[1]].tolist() == [[1, 0, 0], [0, 1, -10]]
    assert t.textures.wrap_u[rows].tolist() == [ir.Wrap.CLAMP] * 2


def test_faces_of_a_tile_that_is_missing_show_the_fallback(tmp_path):
    st = [(0.1, 0.1), (0.9, 0.1), (0.9, 0.9), (2.1, 0.1), (2.9, 0.1), (2.9, 0.9)]
    fallback = "float4 inputs:fallback = (0, 0, 1, 1)\nfloat4 inputs:scale = (2, 2, 2, 2)"
    scene, messages = udim(tmp_path, [(1001, RED, 2)], st, fallback, "[3, 3]", "[0, 1, 2, 0, 2, 3]")
    assert messages == ["x.usda</m/t>: warning: `t.<UDIM>.png` has no tile 1003: its fallback is drawn there"]
    assert [slot(scene, "DIFFUSE", k) for k in (0, 1)] == [[1, 1, 1], [0, 0, 1]]


def test_a_face_over_several_tiles_has_their_image(tmp_path):
    """Tiles 1001, 1002 and 1011 of one colour each; coordinates from 0 to 2 reach all and 1012, which shows the fallback."""
    st, fallback = [(0, 0), (2, 0), (2, 2), (0, 2)], "float4 inputs:fallback = (0.5, 0.25, 0.75, 1)"
    scene, messages = udim(tmp_path, [(1001, RED, 2), (1002, GREEN, 4), (1011, BLUE, 2)], st, fallback)
    t = scene.tables
    assert messages == ["x.usda</m/t>: warning: `t.<UDIM>.png` has no tile 1012: its fallback is drawn there"]
    assert (t.images.width[0], t.images.height[0]) == (8, 8)
    texels = t.images.texels.reshape(8, 8, 4)[..., :3]  # from the top
    assert np.array_equal(texels[:4, :4], np.broadcast_to([0, 0, 1], (4, 4, 3)))
    assert np.array_equal(texels[4:, 4:], np.broadcast_to([0, 1, 0], (4, 4, 3)))
    assert np.array_equal(texels[:4, 4:], np.broadcast_to([0.5, 0.25, 0.75], (4, 4, 3)))


@pytest.mark.parametrize("several", [False, True])
def test_tiles_that_are_too_big_together_are_halved(tmp_path, monkeypatch, several):
    monkeypatch.setattr("maquette.compiler.importers.images.MAX_ALL_TEXELS", 40 * 32 * 32 // 10)
    triangles = [(k + u, v) for k in range(5) for u, v in ((0.1, 0.1), (0.9, 0.1), (0.9, 0.9))]
    st = [(0, 0), (5, 0), (5, 1), (0, 1)] if several else triangles
    faces, indices = ("[4]", "[0, 1, 2, 3]") if several else ("[3, 3, 3, 3, 3]", str([0, 1, 2] * 5))
    tiles = [(1001 + k, (50 * k, 0, 0), 32) for k in range(5)]
    scene, messages = udim(tmp_path, tiles, st, "", faces, indices)
    t = scene.tables
    assert t.images.width.tolist() == ([5 * 16] if several else [32, 32, 32, 16, 16])
    assert t.images.texels[:, 0].max() == pytest.approx(200 / 255)
    assert len(t.images.texels) <= 4 * 32 * 32
    shown = "tiles of `t.<UDIM>.png` are drawn with 16 by 16 pixels in place of 32 by 32"
    assert messages == [f"x.usda</m/t>: warning: {shown}\n  all pictures of a scene have at most 4,096 pixels"]


@pytest.mark.parametrize(
    ("bindings", "red"),
    [
        ("rel material:binding:preview = </m>", True),
        ("rel material:binding = </n>\nrel material:binding:preview = </m>", True),
        ("rel material:binding:preview = </n>\nrel material:binding:full = </m>", True),
        ("rel material:binding:collection:preview:a = [</c.collection:a>, </m>]", True),
        ("rel material:binding = </n>\nrel material:binding:collection:full:a = [</c.collection:a>, </m>]", True),
        ("rel material:binding:preview = </n>\nrel material:binding:collection:preview = [</c.collection:a>, </m>]", False),
    ],
)
def test_the_purpose_of_bindings(tmp_path, bindings, red):
    """Full precedes preview, which precedes all-purpose; the last has a collection called preview, of all purposes."""
    other = (
        SURFACE.replace('"m"', '"n"')
        .replace("</m/", "</n/")
        .replace("NODES", "")
        .replace("INPUTS", "color3f inputs:diffuseColor = (0, 0, 1)")
    )
    bound = stage("color3f inputs:diffuseColor = (1, 0, 0)").replace("rel material:binding = </m>", bindings)
    group = 'def Scope "c" (prepend apiSchemas = ["CollectionAPI:a"]) { rel collection:a:includes = [</thing>]\n}'
    scene, messages = read(tmp_path, bound + other + group)
    assert messages == []
    assert slot(scene, "DIFFUSE") == ([1, 0, 0] if red else [0, 0, 1])
