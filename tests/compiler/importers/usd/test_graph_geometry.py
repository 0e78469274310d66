"""Graphs of MaterialX that read places in the world, and primvars that vary over a mesh or are constant."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.formula.tape import load_tape
from maquette.compiler.texture_graph import evaluate

from .stages import SQUARE, read, slot

MATERIAL = """
def Material "m" {{ token outputs:mtlx:surface.connect = </m/s.outputs:out>
    def Shader "s" {{ uniform token info:id = "ND_open_pbr_surface_surfaceshader"
        {inputs}
        token outputs:out }}
    {nodes}
}}
"""
MESH = 'def Mesh "{name}" (prepend apiSchemas = ["MaterialBindingAPI"]) {{\n rel material:binding = </m>\n{primvars}\n{square}\n}}\n'
POSITION = """def Shader "p" {{ uniform token info:id = "ND_{kind}_vector3"
        string inputs:space = "{space}"
        float3 outputs:out }}
    def Shader "c" {{ uniform token info:id = "ND_convert_vector3_color3"
        float3 inputs:in.connect = </m/p.outputs:out>
        color3f outputs:out }}"""
COLOR = """def Shader "c" { uniform token info:id = "ND_geompropvalue_color3"
        string inputs:geomprop = "displayColor"
        color3f outputs:out }
    """
BASE = "color3f inputs:base_color.connect = </m/{}.outputs:out>"


def scene_of(tmp_path, inputs, nodes, meshes, header=""):
    return read(tmp_path, MATERIAL.format(inputs=inputs, nodes=nodes) + meshes, header)


def mesh(name, primvars="", square=SQUARE):
    return MESH.format(name=name, primvars=primvars, square=square)


def value(scene, instance, point, normal=(0.0, 0.0, 1.0), of="DIFFUSE"):
    """The value of the graph of a slot at a point of an instance's own frame."""
    t = scene.tables
    row = t.materials.textures[t.instances.material[instance], ir.Slot[of]]
    tape = load_tape(t, int(t.textures.tape[row]))
    inputs = [np.array([number]) for number in (*point, 0.25, 0.5, *normal)]
    return [float(channel[0]) for channel in evaluate.results(tape, inputs, lambda texture, s, t: [s, t, s, t])]


MOVED = "double3 xformOp:translate = (1, 2, 3)\nfloat3 xformOp:rotateXYZ = (0, 0, 90)\nfloat3 xformOp:scale = (2, 4, 1)\n" \
    'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]'  # fmt: skip


@pytest.mark.parametrize("header", ["", 'upAxis = "Z"\nmetersPerUnit = 0.01'])
def test_the_position_in_the_world_is_that_of_each_object(tmp_path, header):
    """In the axes and units of the stage: (x, y, z) → (1 − 4 y, 2 + 2 x, 3 + z), and of the other mesh itself."""
    nodes = POSITION.format(kind="position", space="world")
    scene, messages = scene_of(tmp_path, BASE.format("c"), nodes, mesh("a", MOVED) + mesh("b"), header)
    assert messages == []
    assert value(scene, 0, (0.5, 0.25, 0.1)) == pytest.approx([0.0, 3.0, 3.1])
    assert value(scene, 1, (0.5, 0.25, 0.1)) == pytest.approx([0.5, 0.25, 0.1])


def test_normals_in_the_world_have_a_length_of_one(tmp_path):
    scene, messages = scene_of(tmp_path, BASE.format("c"), POSITION.format(kind="normal", space="world"), mesh("a", MOVED))
    slanted = value(scene, 0, (0, 0, 0), (0.6, 0.8, 0.0))
    bent = np.array([-0.8 / 4, 0.6 / 2, 0.0])
    assert (messages, slanted) == ([], pytest.approx(bent / np.linalg.norm(bent)))


def test_places_go_from_space_to_space_and_back(tmp_path):
    nodes = POSITION.format(kind="position", space="world").replace("</m/p.outputs:out>", "</m/t.outputs:out>")
    nodes += """
    def Shader "t" { uniform token info:id = "ND_transformpoint_vector3"
        float3 inputs:in.connect = </m/p.outputs:out>
        string inputs:fromspace = "world"
        string inputs:tospace = "object"
        float3 outputs:out }"""
    scene, messages = scene_of(tmp_path, BASE.format("c"), nodes, mesh("a", MOVED))
    assert (messages, value(scene, 0, (0.5, 0.25, 0.1))) == ([], pytest.approx([0.5, 0.25, 0.1]))


def test_places_of_prototypes_are_told(tmp_path):
    copies = """def PointInstancer "i" { rel prototypes = </i/a>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (5, 0, 0)]
        """ + mesh("a") + "}\n"  # fmt: skip
    _, messages = scene_of(tmp_path, BASE.format("c"), POSITION.format(kind="position", space="world"), copies)
    expected = "a point in the space `world` is drawn as that in the frame of the object: it has several places"
    assert [message.partition("warning: ")[2] for message in messages] == [expected]


def test_the_normal_of_the_surface_as_a_normal_is_nothing(tmp_path):
    inputs = "float3 inputs:geometry_normal.connect = </m/p.outputs:out>\nfloat inputs:coat_weight = 1\n" \
        "float3 inputs:geometry_coat_normal.connect = </m/p.outputs:out>"  # fmt: skip
    scene, messages = scene_of(tmp_path, inputs, POSITION.format(kind="normal", space="world"), mesh("a"))
    assert messages == []
    assert scene.tables.materials.textures[scene.tables.instances.material[0], ir.Slot.NORMAL] < 0


# --- primvars -----------------------------------------------------------------------------------------------------------

VARYING = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")'
HALVED = (
    COLOR
    + """def Shader "h" { uniform token info:id = "ND_multiply_color3"
        color3f inputs:in1.connect = </m/c.outputs:out>
        color3f inputs:in2 = (0.5, 0.25, 1)
        color3f outputs:out }
    def Shader "n" { uniform token info:id = "ND_noise3d_color3"
        float inputs:pivot = 0.5
        color3f outputs:out }
    def Shader "x" { uniform token info:id = "ND_multiply_color3"
        color3f inputs:in1.connect = </m/h.outputs:out>
        color3f inputs:in2.connect = </m/n.outputs:out>
        color3f outputs:out }
    def Shader "a" { uniform token info:id = "ND_add_color3"
        color3f inputs:in1.connect = </m/c.outputs:out>
        color3f inputs:in2.connect = </m/n.outputs:out>
        color3f outputs:out }"""
)


def colors(scene):
    t = scene.tables
    return int(t.geometries.colors[t.instances.geometry[0]])


@pytest.mark.parametrize("end", ["c", "h", "x"])
def test_colours_of_vertices_multiply_the_rest_of_a_graph(tmp_path, end):
    scene, messages = scene_of(tmp_path, BASE.format(end), HALVED, mesh("a", VARYING))
    assert (messages, colors(scene) >= 0) == ([], True)
    if end == "h":
        assert value(scene, 0, (0, 0, 0)) == pytest.approx([0.5, 0.25, 1])
    if end == "c":
        assert slot(scene, "DIFFUSE") == [1, 1, 1]


def test_colours_of_vertices_that_do_not_multiply_are_told(tmp_path):
    scene, messages = scene_of(tmp_path, BASE.format("a"), HALVED, mesh("a", VARYING))
    assert [message.partition("warning: ")[2] for message in messages] == [
        "the primvar `displayColor` varies over the surface: its mean is drawn"
    ]
    assert colors(scene) < 0


def test_constant_colours_of_two_meshes_with_one_material_stay_theirs(tmp_path):
    constant = 'color3f[] primvars:displayColor = [({})] (interpolation = "constant")'
    meshes = mesh("a", constant.format("0.5, 0.5, 0.5")) + mesh("b", constant.format("1, 0, 0"))
    scene, messages = scene_of(tmp_path, BASE.format("h"), HALVED, meshes)
    assert messages == []
    values = [slot_of(scene, k) for k in range(2)]
    assert values == [pytest.approx([0.25, 0.125, 0.5]), pytest.approx([0.5, 0, 0])]


def slot_of(scene, instance):
    t = scene.tables
    row = t.instances.material[instance]
    texture = t.materials.textures[row, ir.Slot.DIFFUSE]
    return value(scene, instance, (0, 0, 0)) if texture >= 0 else t.materials.values[row, ir.Slot.DIFFUSE].tolist()


def test_a_number_of_vertices_is_u_of_a_graph(tmp_path):
    nodes = """def Shader "w" { uniform token info:id = "ND_geompropvalue_float"
        string inputs:geomprop = "wear"
        float outputs:out }
    def Shader "q" { uniform token info:id = "ND_power_float"
        float inputs:in1.connect = </m/w.outputs:out>
        float inputs:in2 = 2
        float outputs:out }"""
    wear = 'float[] primvars:wear = [0, 0.25, 0.5, 1] (interpolation = "vertex")'
    inputs = "float inputs:specular_roughness.connect = </m/q.outputs:out>\nfloat inputs:base_metalness.connect = </m/w.outputs:out>"
    scene, messages = scene_of(tmp_path, inputs, nodes, mesh("a", wear))
    assert (messages, value(scene, 0, (0, 0, 0), of="ROUGHNESS")) == ([], pytest.approx([0.25**2]))


@pytest.mark.parametrize("kind", ["ND_add_color3", "ND_mix_surfaceshader"])
def test_long_chains_of_shaders_are_told(tmp_path, kind):
    """3000 shaders one behind the other: more than Python may call."""
    surface = kind.endswith("surfaceshader")
    end, type_ = ("bg", "token") if surface else ("in1", "color3f")
    nodes = "".join(
        f'def Shader "n{k}" {{ uniform token info:id = "{kind}"\n{type_} inputs:{end}.connect = </m/n{k + 1}.outputs:out>\n'
        f"{type_} outputs:out }}\n" for k in range(3000)
    )  # fmt: skip
    text = MATERIAL.format(inputs=f"{type_} inputs:{end if surface else 'base_color'}.connect = </m/n0.outputs:out>", nodes=nodes)
    text = text.replace("ND_open_pbr_surface_surfaceshader", kind) if surface else text
    _, messages = read(tmp_path, text + mesh("a"))
    assert len(messages) == 1
    assert "feed each other" in messages[0]
