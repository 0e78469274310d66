"""References to MaterialX documents."""

import numpy as np
import pytest
from maquette.compiler import ir

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
