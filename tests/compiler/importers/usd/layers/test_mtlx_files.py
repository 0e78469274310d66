"""References to MaterialX documents."""

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.load import load as load_file
from maquette.lang.diagnostics import Diagnostics

from .....files import write_image
from ..stages import SQUARE, load, slot

DOCUMENT = """<?xml version="1.0"?>
<materialx version="1.38" fileprefix="maps/">
  <nodegraph name="NG">
    <input name="tint" type="color3" value="1, 0.5, 0.25"/>
    <image name="img" type="color3"><input name="file" type="filename" value="t.png" colorspace="srgb_texture"/></image>
    <constant name="c" type="color3"><input name="value" type="color3" interfacename="tint"/></constant>
    <output name="out" type="color3" nodename="img"/>
    <output name="tinted" type="color3" nodename="c"/>
  </nodegraph>
  <standard_surface name="S1" type="surfaceshader">
    <input name="base" type="float" value="0.5"/>
    <input name="base_color" type="color3" value="0.8, 0.4, 0.2"/>
    <input name="specular_roughness" type="float" value="0.3"/>
  </standard_surface>
  <standard_surface name="S2" type="surfaceshader"><input name="base_color" type="color3" nodegraph="NG" output="out"/></standard_surface>
  <UsdPreviewSurface name="S3" type="surfaceshader">
    <input name="diffuseColor" type="color3" nodegraph="NG" output="tinted"/>
  </UsdPreviewSurface>
  <surfacematerial name="Plain" type="material"><input name="surfaceshader" type="surfaceshader" nodename="S1"/></surfacematerial>
  <surfacematerial name="Mapped" type="material"><input name="surfaceshader" type="surfaceshader" nodename="S2"/></surfacematerial>
  <surfacematerial name="Graph" type="material"><input name="surfaceshader" type="surfaceshader" nodename="S3"/></surfacematerial>
</materialx>
"""


def stage(folder, material, document=DOCUMENT):
    (folder / "m.mtlx").write_text(document)
    st = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (\n    interpolation = "vertex"\n)'
    bound = f'(\n    prepend apiSchemas = ["MaterialBindingAPI"]\n)\n{{\n    rel material:binding = </M/Materials/{material}>'
    text = f'#usda 1.0\ndef Mesh "q" {bound}\n{SQUARE}\n{st}\n}}\ndef "M" (\n    references = @m.mtlx@\n)\n{{\n}}\n'
    (folder / "x.usda").write_text(text)
    return load(folder / "x.usda")


def test_a_surface_of_numbers(tmp_path):
    scene, messages = stage(tmp_path, "Plain")
    assert messages == []
    assert np.allclose(slot(scene, "DIFFUSE"), [0.4, 0.2, 0.1])
    assert np.isclose(slot(scene, "ROUGHNESS")[0], 0.3)


def test_a_picture_of_a_node_graph(tmp_path):
    (tmp_path / "maps").mkdir()
    write_image(tmp_path / "maps" / "t.png", np.array([[[255, 0, 0]]], np.uint8))
    scene, messages = stage(tmp_path, "Mapped")
    assert messages == []
    t = scene.tables
    row = t.materials.textures[t.instances.material[0], ir.Slot.DIFFUSE]
    assert t.images.texels[t.images.first[t.textures.image[row]]].tolist() == [1, 0, 0, 1]


def test_an_input_of_a_node_graph(tmp_path):
    scene, messages = stage(tmp_path, "Graph")
    assert messages == []
    assert slot(scene, "DIFFUSE") == [1, 0.5, 0.25]


def test_a_damaged_document_is_named(tmp_path):
    _, messages = stage(tmp_path, "Plain", DOCUMENT[:300])
    assert messages[0].startswith("m.mtlx: warning: the MaterialX file `m.mtlx` cannot be read: ")


def test_nodes_that_do_not_exist_are_named(tmp_path):
    _, messages = stage(tmp_path, "Plain", DOCUMENT.replace('nodename="S1"', 'nodename="S9"'))
    assert messages[0] == "m.mtlx: warning: there is no node `S9`: the input that it feeds takes its default"


@pytest.mark.parametrize("value", ["0.8 0.4 0.2", "0.8,0.4,0.2", " 0.8 ,\t0.4, 0.2 "])
def test_commas_and_blanks_separate_numbers(tmp_path, value):
    text = DOCUMENT.replace("0.8, 0.4, 0.2", value)
    scene, messages = stage(tmp_path, "Plain", text)
    assert messages == []
    assert np.allclose(slot(scene, "DIFFUSE"), [0.4, 0.2, 0.1])


@pytest.mark.parametrize("value", ["0.4 0.2", "0.4 0.2 0.1 1", "red"])
def test_values_with_another_number_of_numbers_are_named(tmp_path, value):
    _, messages = stage(tmp_path, "Plain", DOCUMENT.replace("0.8, 0.4, 0.2", value))
    assert messages == [f"m.mtlx: warning: `{value}` is not of the type color3: the input takes its default"]


@pytest.mark.parametrize("before", ["\n", " \r\n\t", "\ufeff\n"])
def test_blanks_before_the_declaration(tmp_path, before):
    scene, messages = stage(tmp_path, "Plain", before + DOCUMENT.lstrip())
    assert messages == []
    assert np.allclose(slot(scene, "DIFFUSE"), [0.4, 0.2, 0.1])


ONE = '<surfacematerial name="{0}" type="material"><input name="surfaceshader" type="surfaceshader" nodename="{1}"/></surfacematerial>'


def texels(tables, row, channel=ir.Slot.DIFFUSE):
    image = tables.textures.image[tables.materials.textures[row, channel]]
    return tables.images.texels[tables.images.first[image]].tolist()


def opened(path):
    diagnostics = Diagnostics()
    return load_file(path, diagnostics=diagnostics).tables, [item.message for item in diagnostics.items]


def test_an_included_document_keeps_its_version_colour_space_and_prefix(tmp_path):
    for folder in ("part", "maps"):
        (tmp_path / folder).mkdir()
    write_image(tmp_path / "maps" / "t.png", np.array([[[255, 0, 0]]], np.uint8))
    (tmp_path / "part" / "p.mtlx").write_text("""<materialx version="1.36" colorspace="srgb_texture" fileprefix="maps/">
        <image name="i" type="color3"><parameter name="file" type="filename" value="t.png"/></image>
        <material name="Old"><shaderref name="s" node="standard_surface">
        <bindinput name="base_color" type="color3" value="0.5, 0.5, 0.5"/></shaderref></material>
        <material name="Map"><shaderref name="q" node="standard_surface">
        <bindinput name="base_color" type="color3" nodename="i"/></shaderref></material></materialx>""")
    (tmp_path / "m.mtlx").write_text(
        '<materialx version="1.39" xmlns:xi="http://www.w3.org/2001/XInclude"><xi:include href="part/p.mtlx"/>'
        '<standard_surface name="a" type="surfaceshader"><input name="base_color" type="color3" value="0.5, 0.5, 0.5"/></standard_surface>'
        + ONE.format("New", "a") + "</materialx>"
    )  # fmt: skip
    tables, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    colors = tables.materials.values[:, ir.Slot.DIFFUSE, 0]
    assert np.isclose(colors, ((0.5 + 0.055) / 1.055) ** 2.4).any()  # of sRGB
    assert np.isclose(colors, 0.5).any()
    assert [1, 0, 0, 1] in [texels(tables, row) for row in np.flatnonzero(tables.materials.textures[:, ir.Slot.DIFFUSE] >= 0)]


def test_units_are_metres_and_degrees(tmp_path):
    value = '<input name="{}" type="float" value="{}" unittype="{}" unit="{}"/>'
    inputs = value.format("base", 20, "distance", "inch") + value.format("metalness", 0.005, "angle", "radian")
    inputs += value.format("coat", 0.25, "distance", "cubit")
    text = f'<standard_surface name="a" type="surfaceshader">{inputs}</standard_surface>' + ONE.format("M", "a")
    (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text}</materialx>')
    tables, messages = opened(tmp_path / "m.mtlx")
    assert messages == ["the unit `cubit` of `a/coat` is not known: the value is drawn as it is"]
    rows = tables.materials.values[tables.materials.values[:, ir.Slot.COAT, 0] == 0.25]
    assert rows[0, ir.Slot.DIFFUSE, 0] == pytest.approx(0.8 * 20 * 0.0254)
    assert rows[0, ir.Slot.METALLIC, 0] == pytest.approx(math.degrees(0.005))


@pytest.mark.parametrize(("mode", "passes"), [("presence", True), ("1", True), ("transparent", False), ("glassy", False)])
def test_an_integer_may_have_its_name(tmp_path, mode, passes):
    kind = "integer" if mode.isdigit() else "string"
    inputs = f'<input name="opacity" type="float" value="0.25"/><input name="opacityMode" type="{kind}" value="{mode}"/>'
    text = f'<UsdPreviewSurface name="a" type="surfaceshader">{inputs}</UsdPreviewSurface>' + ONE.format("M", "a")
    (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text}</materialx>')
    tables, messages = opened(tmp_path / "m.mtlx")
    warnings = ["the input `opacityMode` of `a` has the type string, not integer: it takes its default"] if mode == "glassy" else []
    assert messages == warnings
    plain, _ = opened(_with_mode(tmp_path, int(passes)))
    assert np.array_equal(tables.materials.values, plain.materials.values)


def _with_mode(folder, number):
    inputs = f'<input name="opacity" type="float" value="0.25"/><input name="opacityMode" type="integer" value="{number}"/>'
    text = f'<UsdPreviewSurface name="a" type="surfaceshader">{inputs}</UsdPreviewSurface>' + ONE.format("M", "a")
    (folder / "number.mtlx").write_text(f'<materialx version="1.39">{text}</materialx>')
    return folder / "number.mtlx"


def test_a_document_without_materials_shows_its_outputs(tmp_path):
    (tmp_path / "m.mtlx").write_text("""<materialx version="1.39"><nodegraph name="g">
        <standard_surface name="s" type="surfaceshader"><input name="metalness" type="float" value="0.5"/></standard_surface>
        <constant name="c" type="color3"><input name="value" type="color3" value="0.25, 0.5, 1"/></constant>
        <constant name="f" type="float"><input name="value" type="float" value="0.125"/></constant>
        <output name="surface" type="surfaceshader" nodename="s"/><output name="color" type="color3" nodename="c"/>
        <output name="number" type="float" nodename="f"/></nodegraph></materialx>""")
    tables, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    values = tables.materials.values
    assert (values[:, ir.Slot.METALLIC, 0] == 0.5).any()
    emitted = values[:, ir.Slot.EMISSION].tolist()
    assert [0.25, 0.5, 1.0] in emitted
    assert [0.125] * 3 in emitted


@pytest.mark.parametrize(
    ("kind", "space", "stored"),
    [("color3", "srgb_texture", 0.2158605), ("color3", "", 128 / 255), ("color3", "none", 128 / 255), ("color3", "gamma22", 0.2195197),
     ("float", "srgb_texture", 128 / 255), ("float", "", 128 / 255)],
)  # fmt: skip
def test_pictures_are_converted_where_a_colour_has_a_space(tmp_path, kind, space, stored):
    write_image(tmp_path / "t.png", np.array([[[128, 128, 128]]], np.uint8))
    name = "base_color" if kind == "color3" else "specular_roughness"
    file = f'<input name="file" type="filename" value="t.png"{f""" colorspace="{space}" """ if space else ""}/>'
    text = f'<image name="i" type="{kind}">{file}</image><standard_surface name="a" type="surfaceshader">'
    text += f'<input name="{name}" type="{kind}" nodename="i"/></standard_surface>' + ONE.format("M", "a")
    (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text}</materialx>')
    tables, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    slot_of = ir.Slot.DIFFUSE if kind == "color3" else ir.Slot.ROUGHNESS
    row = int(np.flatnonzero(tables.materials.textures[:, slot_of] >= 0)[0])
    assert texels(tables, row, slot_of)[0] == pytest.approx(stored, abs=2e-3)


def test_inputs_without_effect_are_not_told(tmp_path):
    write_image(tmp_path / "t.png", np.array([[[128, 128, 255]]], np.uint8))
    text = """<tiledimage name="i" type="color3"><input name="file" type="filename" value="t.png"/>
        <input name="realworldimagesize" type="vector2" value="{0}"/></tiledimage>
        <standard_surface name="a" type="surfaceshader"><input name="base_color" type="color3" nodename="i"/>
        <input name="specular" type="float" value="0"/><input name="specular_IOR" type="float" value="0"/></standard_surface>"""
    for size, warnings in (("1, 1", []), ("2, 1", ["the input `realworldimagesize` of ND_tiledimage_color3 is not drawn"])):
        (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text.format(size)}{ONE.format("M", "a")}</materialx>')
        assert opened(tmp_path / "m.mtlx")[1] == warnings


@pytest.mark.parametrize(
    ("inputs", "wrap"),
    [("", ir.Wrap.REPEAT), ('<input name="scale" type="vector4" value="0.5, 0.5, 0.5, 1"/>', ir.Wrap.REPEAT),
     ('<input name="wrapS" type="string" value="clamp"/>', ir.Wrap.CLAMP)],
)  # fmt: skip
def test_textures_of_usd_repeat_as_materialx_says(tmp_path, inputs, wrap):
    write_image(tmp_path / "t.png", np.array([[[128, 128, 128]]], np.uint8))
    text = f"""<UsdUVTexture name="i" type="multioutput"><input name="file" type="filename" value="t.png"/>{inputs}</UsdUVTexture>
        <UsdPreviewSurface name="a" type="surfaceshader"><input name="diffuseColor" type="color3" nodename="i" output="rgb"/>
        </UsdPreviewSurface>{ONE.format("M", "a")}"""
    (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text}</materialx>')
    tables, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    assert wrap in tables.textures.wrap_u.tolist()


def test_light_below_a_coloured_coat_is_told(tmp_path):
    text = """<standard_surface name="a" type="surfaceshader"><input name="emission" type="float" value="1"/>
        <input name="coat" type="float" value="{0}"/><input name="coat_color" type="color3" value="1, 0.5, 0.5"/></standard_surface>"""
    for coat, warnings in ((0, []), (1, ["light that is emitted below a coat is drawn without the colour of the coat"])):
        (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text.format(coat)}{ONE.format("M", "a")}</materialx>')
        assert opened(tmp_path / "m.mtlx")[1] == warnings


GRAPHS = """<materialx version="1.39">
    <standard_surface name="s" type="surfaceshader"><input name="metalness" type="float" value="0.375"/></standard_surface>
    <nodegraph name="g"><input name="shader" type="surfaceshader" nodename="s"/>
    <surfacematerial name="M" type="material"><input name="surfaceshader" type="surfaceshader" interfacename="shader"/></surfacematerial>
    <output name="out" type="material" nodename="M"/></nodegraph>
    <nodegraph name="h"><standard_surface name="t" type="surfaceshader"><input name="metalness" type="float" value="0.625"/>
    </standard_surface><surfacematerial name="N" type="material"><input name="surfaceshader" type="surfaceshader" nodename="t"/>
    </surfacematerial><output name="out" type="material" nodename="N"/></nodegraph></materialx>"""


def test_materials_in_graphs(tmp_path):
    """One with a shader of its graph, and one whose shader is an input of the graph."""
    (tmp_path / "m.mtlx").write_text(GRAPHS)
    tables, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    assert {0.375, 0.625} <= set(tables.materials.values[:, ir.Slot.METALLIC, 0].tolist())


def test_an_input_that_reads_an_output_of_the_document(tmp_path):
    (tmp_path / "m.mtlx").write_text(f"""<materialx version="1.39">
        <constant name="c" type="float"><input name="value" type="float" value="0.875"/></constant>
        <output name="number" type="float" nodename="c"/><standard_surface name="u" type="surfaceshader">
        <input name="metalness" type="float" output="number"/></standard_surface>{ONE.format("O", "u")}</materialx>""")
    tables, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    assert 0.875 in tables.materials.values[:, ir.Slot.METALLIC, 0]
