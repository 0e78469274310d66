"""Graphs of BSDFs of MaterialX as slabs of OpenPBR, surfaces with textures by graphs, and documents as scenes."""

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.formula.tape import load_tape
from maquette.compiler.importers.usd.shaders import slabs
from maquette.compiler.load import load
from maquette.compiler.texture_graph.opcodes import is_graph
from maquette.lang.diagnostics import Diagnostics, SceneError

from ....files import write_image
from .stages import slot
from .test_materialx import STANDARD, drawn
from .test_scattering import DIFFUSE, bsdf, graph, model_of

CONDUCTOR = bsdf("m", "ND_conductor_bsdf", "float2 inputs:roughness = (0.2, 0.05)")
DIELECTRIC = bsdf("k", "ND_dielectric_bsdf", "float inputs:ior = 1.4\nfloat2 inputs:roughness = (0.09, 0.09)\nfloat inputs:weight = 0.5")


def joined(name, kind, more="", **ends):
    return bsdf(name, kind, "\n".join(f"token inputs:{end}.connect = </m/{node}.outputs:out>" for end, node in ends.items()) + more)


def surface(tmp_path, nodes, last, more=""):
    inputs, nodes = graph(nodes, last)
    return drawn(tmp_path, f"{inputs}\n{more}", "ND_surface", nodes)


def test_a_conductor_is_a_metal(tmp_path):
    """Gold by n and k: its reflectance by Fresnel's equations; α of 0.2 and 0.05 are an anisotropy of 3/4."""
    scene, messages = surface(tmp_path, CONDUCTOR, "m")
    n, k = np.array((0.183, 0.421, 1.373)), np.array((3.424, 2.346, 1.770))
    assert (model_of(scene), messages, slot(scene, "METALLIC")[0]) == (ir.MaterialModel.OPENPBR, [], 1.0)
    assert slot(scene, "DIFFUSE") == pytest.approx(((n - 1) ** 2 + k * k) / ((n + 1) ** 2 + k * k))
    rough, narrow = slot(scene, "ROUGHNESS")[0], slot(scene, "ANISOTROPY")[0]
    assert narrow == pytest.approx(0.75)
    assert rough**2 * math.sqrt(2 / (1 + (1 - narrow) ** 2)) == pytest.approx(0.2)


def test_a_dielectric_over_a_diffuse_base_is_its_specular(tmp_path):
    nodes = DIFFUSE + DIELECTRIC + bsdf("y", "ND_sheen_bsdf", "float inputs:weight = 0.25")
    nodes += joined("l", "ND_layer_bsdf", top="k", base="b") + joined("t", "ND_layer_bsdf", top="y", base="l")
    scene, messages = surface(tmp_path, nodes, "t")
    assert (model_of(scene), messages) == (ir.MaterialModel.OPENPBR, [])
    assert slot(scene, "DIFFUSE") == pytest.approx([0.1, 0.2, 0.3])
    assert [slot(scene, name)[0] for name in ("IOR", "SPECULAR_WEIGHT", "ROUGHNESS", "FUZZ", "METALLIC", "COAT")] == pytest.approx(
        [1.4, 0.5, 0.3, 0.25, 0, 0])  # fmt: skip


def test_a_dielectric_over_a_metal_is_its_coat(tmp_path):
    scene, messages = surface(tmp_path, CONDUCTOR + DIELECTRIC + joined("l", "ND_layer_bsdf", top="k", base="m"), "l")
    assert ([slot(scene, name)[0] for name in ("METALLIC", "COAT", "COAT_IOR", "COAT_ROUGHNESS")], messages) == (
        pytest.approx([1, 0.5, 1.4, 0.3]), [])  # fmt: skip


def test_a_mixture_by_a_texture_is_a_blend(tmp_path):
    nodes = DIFFUSE + CONDUCTOR + joined("x", "ND_mix_bsdf", "\nfloat inputs:mix.connect = </m/r.outputs:out>", bg="b", fg="m")
    nodes += bsdf("r", "ND_ramplr_float", "float inputs:valuel = 0\nfloat inputs:valuer = 1")
    scene, messages = surface(tmp_path, nodes, "x")
    assert (model_of(scene), messages) == (ir.MaterialModel.BLEND, [])
    m, row = scene.tables.materials, int(scene.tables.instances.material[0])
    assert scene.tables.textures.kind[m.textures[row, ir.Slot.WEIGHT]] == ir.TextureKind.FORMULA
    metallic = m.values[[m.first[row], m.second[row]], ir.Slot.METALLIC, 0]
    assert metallic.tolist() == [0, 1]


def test_generalized_schlick_alone_reflects_as_a_metal_and_over_a_base_as_a_dielectric(tmp_path):
    schlick = bsdf("g", "ND_generalized_schlick_bsdf", "color3f inputs:color0 = (0.04, 0.04, 0.04)")
    scene, messages = surface(tmp_path, schlick, "g")
    assert (slot(scene, "DIFFUSE"), slot(scene, "METALLIC")[0], messages) == (pytest.approx([0.04] * 3), 1.0, [])
    scene, messages = surface(tmp_path, schlick + DIFFUSE + joined("l", "ND_layer_bsdf", top="g", base="b"), "l")
    assert (slot(scene, "IOR")[0], slot(scene, "METALLIC")[0], messages) == (pytest.approx(1.5), 0.0, [])


def test_emission_and_products(tmp_path):
    nodes = CONDUCTOR + DIFFUSE + joined("a", "ND_multiply_bsdfF", "\nfloat inputs:in2 = 0.5", in1="b")
    nodes += joined("c", "ND_mix_bsdf", "\nfloat inputs:mix = 0", bg="a", fg="m")
    nodes += bsdf("e", "ND_uniform_edf", "color3f inputs:color = (1, 2, 3)")
    scene, messages = surface(tmp_path, nodes, "c", "token inputs:edf.connect = </m/e.outputs:out>")
    assert (slot(scene, "DIFFUSE"), slot(scene, "EMISSION"), messages) == (pytest.approx([0.05, 0.1, 0.15]), [1, 2, 3], [])


def test_what_is_not_drawn_of_bsdfs_is_told(tmp_path):
    _, messages = surface(tmp_path, CONDUCTOR + bsdf("h", "ND_chiang_hair_bsdf") + joined("l", "ND_add_bsdf", in1="m", in2="h"), "l")
    assert messages == ["x.usda</m/s>: warning: the shader `ND_chiang_hair_bsdf` is not drawn: the other BSDFs of its surface are"]
    loop = joined("a", "ND_mix_bsdf", "\nfloat inputs:mix = 0.5", bg="a", fg="m")
    _, messages = surface(tmp_path, CONDUCTOR + loop, "a")
    assert any("more than 64 BSDFs feed each other" in message for message in messages)


# --- surface shaders ----------------------------------------------------------------------------------------------------


def test_the_metal_of_a_standard_surface_has_its_edge_colour(tmp_path):
    """Gulbrandsen's n and k for r = ¼ and an edge of 1 are 0.6 and 0.8: their reflectance at 0° is ¼."""
    inputs = "float inputs:metalness = 1\ncolor3f inputs:base_color = (0.25, 0.25, 0.25)\nfloat inputs:specular_anisotropy = 0.5"
    scene, messages = drawn(tmp_path, inputs)
    n, k = slabs.artistic_ior((0.25,) * 3, (1.0,) * 3)
    assert (n, k) == (pytest.approx([0.6] * 3), pytest.approx([0.8] * 3))
    assert slabs.conductor(0.6, 0.8, 1.0) == pytest.approx(0.25)
    assert (slot(scene, "DIFFUSE"), messages) == (pytest.approx([0.25] * 3), [])
    assert slot(scene, "SPECULAR") == pytest.approx(list(slabs.edge_tint((0.25,) * 3, (1.0,) * 3)))
    rough, narrow = slot(scene, "ROUGHNESS")[0], slot(scene, "ANISOTROPY")[0]
    along = rough**2 * math.sqrt(2 / (1 + (1 - narrow) ** 2))
    assert (along, along * (1 - narrow)) == pytest.approx((0.04 / math.sqrt(0.5), 0.04 * math.sqrt(0.5)))


def test_films_of_each_shader_are_in_micrometres(tmp_path):
    shaders = {
        STANDARD: ("float inputs:thin_film_thickness = 400\nfloat inputs:thin_film_IOR = 1.3", 1.3),
        "ND_open_pbr_surface_surfaceshader": ("float inputs:thin_film_weight = 1\nfloat inputs:thin_film_thickness = 0.4", 1.4),
        "ND_gltf_pbr_surfaceshader": ("float inputs:iridescence = 1\nfloat inputs:iridescence_thickness = 400", 1.3),
    }
    for number, (kind, (inputs, ior)) in enumerate(shaders.items()):
        (tmp_path / str(number)).mkdir()
        scene, messages = drawn(tmp_path / str(number), inputs, kind)
        assert ([slot(scene, name)[0] for name in ("FILM", "FILM_THICKNESS", "FILM_IOR")], messages) == (
            pytest.approx([1, 0.4, ior]), [])  # fmt: skip


def test_a_graph_is_the_colour_and_the_height_of_a_surface(tmp_path):
    nodes = """def Shader "n" { uniform token info:id = "ND_noise3d_color3"
        color3f outputs:out }
    def Shader "f" { uniform token info:id = "ND_fractal3d_float"
        float outputs:out }
    def Shader "b" { uniform token info:id = "ND_bump_vector3"
        float inputs:height.connect = </m/f.outputs:out>
        float3 outputs:out }"""
    inputs = "color3f inputs:base_color.connect = </m/n.outputs:out>\nfloat3 inputs:normal.connect = </m/b.outputs:out>"
    scene, messages = drawn(tmp_path, inputs, nodes=nodes)
    t = scene.tables
    color, bump = (t.materials.textures[0, ir.Slot[name]] for name in ("DIFFUSE", "BUMP"))
    assert (messages, t.textures.kind[[color, bump]].tolist()) == ([], [ir.TextureKind.FORMULA] * 2)
    tapes = [load_tape(t, int(t.textures.tape[row])) for row in (color, bump)]
    assert [len(tape.results) for tape in tapes] == [3, 1]
    assert all(is_graph(tape.code, tape.results) for tape in tapes)


def test_a_product_of_two_pictures_looks_both_up(tmp_path):
    write_image(tmp_path / "p.png", np.array([[[128, 64, 255]]], np.uint8))
    picture = 'def Shader "{0}" {{ uniform token info:id = "ND_image_color3"\nasset inputs:file = @p.png@\n' \
        'string inputs:uaddressmode = "{1}"\ncolor3f outputs:out }}\n'  # fmt: skip
    nodes = picture.format("p", "clamp") + picture.format("q", "mirror") + """def Shader "x" { uniform token info:id = "ND_multiply_color3"
        color3f inputs:in1.connect = </m/p.outputs:out>
        color3f inputs:in2.connect = </m/q.outputs:out>
        color3f outputs:out }"""
    scene, messages = drawn(tmp_path, "color3f inputs:base_color.connect = </m/x.outputs:out>", nodes=nodes)
    assert messages == []
    t = scene.tables.textures
    assert sorted(t.wrap_u[t.kind == ir.TextureKind.IMAGE].tolist()) == [ir.Wrap.CLAMP, ir.Wrap.MIRROR]


# --- documents as scenes ------------------------------------------------------------------------------------------------

DOCUMENT = """<?xml version="1.0"?>
<materialx version="1.39">
  <nodedef name="ND_stripes_color3" node="stripes"><input name="count" type="float" value="4"/><output name="out" type="color3"/></nodedef>
  <nodegraph name="NG_stripes_color3" nodedef="ND_stripes_color3">
    <texcoord name="st" type="vector2"/>
    <extract name="u" type="float"><input name="in" type="vector2" nodename="st"/><input name="index" type="integer" value="0"/></extract>
    <multiply name="m" type="float">
      <input name="in1" type="float" nodename="u"/><input name="in2" type="float" interfacename="count"/>
    </multiply>
    <fract name="f" type="float"><input name="in" type="float" nodename="m"/></fract>
    <convert name="c" type="color3"><input name="in" type="float" nodename="f"/></convert>
    <output name="out" type="color3" nodename="c"/>
  </nodegraph>
  <stripes name="six" type="color3"><input name="count" type="float" value="6"/></stripes>
  <node name="SR" nodetype="standard_surface" type="surfaceshader"><input name="base_color" type="color3" nodename="six"/></node>
  <open_pbr_surface name="OP" type="surfaceshader"><input name="base_metalness" type="float" value="1"/></open_pbr_surface>
  <node name="One" nodetype="surfacematerial" type="material"><input name="surfaceshader" type="surfaceshader" nodename="SR"/></node>
  <surfacematerial name="Two" type="material"><input name="surfaceshader" type="surfaceshader" nodename="OP"/></surfacematerial>
</materialx>
"""


def opened(path):
    diagnostics = Diagnostics()
    return load(path, diagnostics=diagnostics), [item.message for item in diagnostics.items]


def test_a_document_is_a_scene_with_a_ball_for_each_material(tmp_path):
    (tmp_path / "m.mtlx").write_text(DOCUMENT)
    scene, messages = opened(tmp_path / "m.mtlx")
    t = scene.tables
    assert messages == []
    assert sorted(t.materials.model.tolist()) == [ir.MaterialModel.LAMBERT, ir.MaterialModel.OPENPBR, ir.MaterialModel.OPENPBR]
    assert (t.geometries.kind[t.instances.geometry] == ir.GeometryKind.SPHERE).sum() == 2
    assert (t.textures.kind == ir.TextureKind.FORMULA).sum() == 1
    assert len(t.lights.kind) == 3
    assert str(tmp_path / "m.mtlx") in scene.files


def test_a_document_of_an_older_version_is_upgraded(tmp_path):
    (tmp_path / "m.mtlx").write_text("""<materialx version="1.37"><material name="M"><shaderref name="s" node="standard_surface">
        <bindinput name="metalness" type="float" value="0.5"/></shaderref></material></materialx>""")
    scene, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    assert 0.5 in scene.tables.materials.values[:, ir.Slot.METALLIC, 0]


def test_a_document_without_materials_is_an_error(tmp_path):
    (tmp_path / "m.mtlx").write_text('<materialx version="1.39"/>')
    with pytest.raises(SceneError, match="has no material that could be drawn"):
        load(tmp_path / "m.mtlx")


def test_included_documents_are_read_in_the_folder_alone(tmp_path):
    (tmp_path / "in").mkdir()
    include = '<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="{}"/>'
    surface = DOCUMENT[DOCUMENT.index("  <open_pbr"):DOCUMENT.index("  <node name=\"One\"")]
    (tmp_path / "in" / "part.mtlx").write_text(f'<materialx version="1.39">{surface}</materialx>')
    (tmp_path / "outside.mtlx").write_text('<materialx version="1.39"/>')
    material = DOCUMENT[DOCUMENT.index("  <surfacematerial"):]
    text = '<materialx version="1.39">' + include.format("part.mtlx") + include.format("../outside.mtlx") + material
    (tmp_path / "in" / "m.mtlx").write_text(text)
    scene, messages = opened(tmp_path / "in" / "m.mtlx")
    assert messages == ["the document `../outside.mtlx` lies outside of the folder of `m.mtlx`: it is left out"]
    assert 1.0 in scene.tables.materials.values[:, ir.Slot.METALLIC, 0]


def test_a_dielectric_that_reflects_over_one_that_light_passes_is_glass(tmp_path):
    inputs = 'float inputs:ior = 1.4\nstring inputs:scatter_mode = "T"\ncolor3f inputs:tint = (1, 0.5, 0.25)'
    passes = bsdf("p", "ND_dielectric_bsdf", inputs)
    scene, messages = surface(tmp_path, DIELECTRIC + passes + joined("l", "ND_layer_bsdf", top="k", base="p"), "l")
    assert (messages, slot(scene, "COAT")[0], slot(scene, "TRANSMISSION_WEIGHT")[0]) == ([], 0.0, 1.0)
    assert slot(scene, "TRANSMISSION_COLOR") == [1, 0.5, 0.25]
    assert [slot(scene, name)[0] for name in ("IOR", "SPECULAR_WEIGHT", "ROUGHNESS")] == pytest.approx([1.4, 0.5, 0.3])
