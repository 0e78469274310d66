"""Light inside and behind surfaces of MaterialX in USD stages: weights, radii, thin walls, graphs of BSDFs, and what is told."""

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.materials import subsurface_inversion

from ....files import write_image
from .stages import read, slot
from .test_materialx import STANDARD, drawn

OPEN_PBR = "ND_open_pbr_surface_surfaceshader"
WHOLE = {
    STANDARD: """float inputs:subsurface = 1
        color3f inputs:subsurface_color = (0.8, 0.4, 0.2)
        color3f inputs:subsurface_radius = (1, 0.5, 0.25)
        float inputs:subsurface_scale = 0.1""",
    OPEN_PBR: """float inputs:subsurface_weight = 1
        color3f inputs:subsurface_color = (0.8, 0.4, 0.2)
        float inputs:subsurface_radius = 0.1
        color3f inputs:subsurface_radius_scale = (1, 0.5, 0.25)""",
}


def model_of(scene) -> ir.MaterialModel:
    return ir.MaterialModel(int(scene.tables.materials.model[scene.tables.instances.material[0]]))


@pytest.mark.parametrize("kind", WHOLE)
@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_a_surface_with_a_weight_of_one_is_a_body(tmp_path, kind, unit):
    """Its radii are in units of the stage, and it has the highlight of the surface."""
    more = "\nfloat inputs:specular_roughness = 0.4"
    scene, messages = drawn(tmp_path, WHOLE[kind] + more, kind, header=f"metersPerUnit = {unit}")
    assert (model_of(scene), messages) == (ir.MaterialModel.OPENPBR, [])
    assert (slot(scene, "SUBSURFACE_WEIGHT")[0], slot(scene, "SUBSURFACE_COLOR")) == (1.0, pytest.approx([0.8, 0.4, 0.2]))
    assert (slot(scene, "IOR")[0], slot(scene, "ROUGHNESS")[0]) == pytest.approx((1.5, 0.4))
    m, media = scene.tables.materials, scene.tables.media
    inside = m.medium[scene.tables.instances.material[0]]
    extinction = media.scattering[inside] + media.absorption[inside]
    assert extinction * unit == pytest.approx((10.0, 20.0, 40.0), rel=1e-5)  # over mean free paths
    albedo = subsurface_inversion.single_albedo(np.array((0.8, 0.4, 0.2)))
    assert media.scattering[inside] / extinction == pytest.approx(albedo, rel=1e-5)


def test_a_part_of_a_surface_is_a_body(tmp_path):
    inputs = WHOLE[STANDARD].replace("subsurface = 1", "subsurface = 0.5") + "\nfloat inputs:metalness = 0.2"
    scene, messages = drawn(tmp_path, inputs)
    assert (model_of(scene), messages) == (ir.MaterialModel.OPENPBR, [])
    assert (slot(scene, "SUBSURFACE_WEIGHT")[0], slot(scene, "METALLIC")[0]) == pytest.approx((0.5, 0.2))
    assert scene.tables.materials.medium[scene.tables.instances.material[0]] >= 0


def test_a_phase_function_of_a_body_is_that_of_its_medium(tmp_path):
    """It has the same mean free paths, and the albedo with which light that scatters less leaves as often."""
    scene, messages = drawn(tmp_path, WHOLE[STANDARD] + "\nfloat inputs:subsurface_anisotropy = 0.5", header="metersPerUnit = 1")
    media = scene.tables.media
    assert (messages, media.anisotropy[0]) == ([], 0.5)
    assert media.scattering[0] + media.absorption[0] == pytest.approx((10.0, 20.0, 40.0), rel=1e-5)
    plain = subsurface_inversion.single_albedo(np.array((0.8, 0.4, 0.2)))
    reduced = 0.5 * media.scattering[0]
    assert reduced / (reduced + media.absorption[0]) == pytest.approx(plain, rel=1e-5)


def test_glass_with_a_depth_has_a_medium(tmp_path):
    """Light has the transmission colour after a depth of 2 units of 0.01 m; a tenth of it scatters in each unit of depth."""
    inputs = """float inputs:transmission = 1
        color3f inputs:transmission_color = (0.5, 0.25, 1)
        float inputs:transmission_depth = 2
        color3f inputs:transmission_scatter = (0.1, 0.1, 0)"""
    scene, messages = drawn(tmp_path, inputs, header="metersPerUnit = 0.01")
    assert (model_of(scene), messages) == (ir.MaterialModel.GLASS, [])
    assert slot(scene, "TRANSMISSION") == [1, 1, 1]
    media = scene.tables.media
    assert media.scattering[0] == pytest.approx([5, 5, 0], rel=1e-5)
    assert (media.scattering + media.absorption)[0] == pytest.approx([math.log(2) / 0.02, math.log(4) / 0.02, 0.0], rel=1e-5, abs=1e-9)


def test_glass_that_splits_light_is_glass(tmp_path):
    """standard_surface has the Abbe number, of which glass has the 20th part's inverse."""
    scene, messages = drawn(tmp_path, "float inputs:transmission = 1\nfloat inputs:transmission_dispersion = 40")
    assert (model_of(scene), messages) == (ir.MaterialModel.GLASS, [])
    assert (slot(scene, "DISPERSION")[0], slot(scene, "IOR")[0]) == (pytest.approx(0.5), pytest.approx(1.5))


def test_a_weight_of_zero_is_no_body(tmp_path):
    scene, messages = drawn(tmp_path, WHOLE[STANDARD].replace("subsurface = 1", "subsurface = 0"))
    assert (model_of(scene), messages) == (ir.MaterialModel.OPENPBR, [])


def test_the_thin_wall_of_a_body_is_a_sheet(tmp_path):
    scene, messages = drawn(tmp_path, WHOLE[STANDARD] + "\nbool inputs:thin_walled = 1")
    assert (model_of(scene), messages) == (ir.MaterialModel.OPENPBR, [])
    assert (slot(scene, "THIN_WALLED")[0], slot(scene, "SUBSURFACE_COLOR")) == (1.0, pytest.approx([0.8, 0.4, 0.2]))
    assert not len(scene.tables.media.priority)


def test_a_picture_is_the_colour_of_a_body(tmp_path):
    write_image(tmp_path / "p.png", np.array([[[128, 64, 255]]], np.uint8))
    nodes = """def Shader "t" { uniform token info:id = "ND_image_color3"
        asset inputs:file = @p.png@
        color3f outputs:out }"""
    inputs = "float inputs:subsurface = 1\ncolor3f inputs:subsurface_color.connect = </m/t.outputs:out>"
    scene, messages = drawn(tmp_path, inputs, nodes=nodes)
    assert (model_of(scene), messages) == (ir.MaterialModel.SUBSURFACE, [])
    assert scene.tables.materials.textures[scene.tables.instances.material[0], ir.Slot.AMBIENT] >= 0


def graph(nodes: str, bsdf: str = "a") -> tuple[str, str]:
    return f"token inputs:bsdf.connect = </m/{bsdf}.outputs:out>", nodes


def bsdf(name: str, kind: str, inputs: str = "") -> str:
    return f"""def Shader "{name}" {{ uniform token info:id = "{kind}"
        {inputs}
        token outputs:out }}
    """


TRANSLUCENT = bsdf("a", "ND_translucent_bsdf", "color3f inputs:color = (0.6, 0.5, 0.4)\nfloat inputs:weight = 0.5")
SUBSURFACE = bsdf("a", "ND_subsurface_bsdf", "color3f inputs:color = (0.6, 0.5, 0.4)\ncolor3f inputs:radius = (0.2, 0.1, 0.1)")
DIFFUSE = bsdf("b", "ND_oren_nayar_diffuse_bsdf", "color3f inputs:color = (0.2, 0.4, 0.6)\nfloat inputs:weight = 0.5")


def test_a_translucent_bsdf_is_a_sheet(tmp_path):
    inputs, nodes = graph(TRANSLUCENT)
    scene, messages = drawn(tmp_path, inputs, "ND_surface", nodes)
    assert (model_of(scene), messages) == (ir.MaterialModel.TRANSLUCENT, [])
    assert (slot(scene, "DIFFUSE"), slot(scene, "DIFFUSE_TRANSMISSION")) == ([0, 0, 0], pytest.approx([0.3, 0.25, 0.2]))


@pytest.mark.parametrize(("join", "share"), [("ND_add_bsdf", 1.0), ("ND_mix_bsdf", 0.5)])
def test_diffuse_and_translucent_together(tmp_path, join, share):
    ends = ("in1", "in2") if join == "ND_add_bsdf" else ("fg", "bg")
    both = "\n".join(f"token inputs:{end}.connect = </m/{name}.outputs:out>" for end, name in zip(ends, "ab", strict=True))
    inputs, nodes = graph(TRANSLUCENT + DIFFUSE + bsdf("c", join, both + "\nfloat inputs:mix = 0.5"), "c")
    scene, messages = drawn(tmp_path, inputs, "ND_surface", nodes)
    assert messages == []
    assert slot(scene, "DIFFUSE") == pytest.approx([0.1 * share, 0.2 * share, 0.3 * share])
    assert slot(scene, "DIFFUSE_TRANSMISSION") == pytest.approx([0.3 * share, 0.25 * share, 0.2 * share])


def test_a_subsurface_bsdf_under_a_dielectric_is_a_body_with_a_highlight(tmp_path):
    top = bsdf("t", "ND_dielectric_bsdf", "float inputs:ior = 1.4\nfloat2 inputs:roughness = (0.09, 0.09)")
    layers = "token inputs:top.connect = </m/t.outputs:out>\ntoken inputs:base.connect = </m/a.outputs:out>"
    inputs, nodes = graph(SUBSURFACE + top + bsdf("c", "ND_layer_bsdf", layers), "c")
    scene, messages = drawn(tmp_path, inputs, "ND_surface", nodes)
    assert (model_of(scene), messages) == (ir.MaterialModel.SUBSURFACE, [])
    assert slot(scene, "AMBIENT") == pytest.approx([0.6, 0.5, 0.4])
    assert (slot(scene, "IOR")[0], slot(scene, "ROUGHNESS")[0]) == pytest.approx((1.4, 0.3))
    inputs, nodes = graph(SUBSURFACE)
    scene, _ = drawn(tmp_path, inputs, "ND_surface", nodes)
    assert slot(scene, "IOR")[0] == 1.0


def test_what_is_told(tmp_path):
    _, messages = drawn(tmp_path, "float inputs:subsurface = 1\nfloat inputs:transmission = 0.5")
    message = "a surface that passes light is drawn without its subsurface: a shape is filled by one medium"
    assert [each.partition("warning: ")[2] for each in messages] == [message]
    write_image(tmp_path / "p.png", np.array([[[128, 64, 255]]], np.uint8))
    nodes = bsdf("t", "ND_image_color3", "asset inputs:file = @p.png@")
    inputs = "float inputs:subsurface = 1\nfloat inputs:coat = 1\ncolor3f inputs:subsurface_color.connect = </m/t.outputs:out>"
    _, messages = drawn(tmp_path, inputs, nodes=nodes)
    message = "the clear coat over a body whose colour has a texture is drawn on the rest of the surface alone"
    assert [each.partition("warning: ")[2] for each in messages] == [message]


def test_other_bsdfs_and_loops_are_told(tmp_path):
    inputs, nodes = graph(bsdf("a", "ND_chiang_hair_bsdf"))
    _, messages = drawn(tmp_path, inputs, "ND_surface", nodes)
    assert any("the shader `ND_chiang_hair_bsdf` is not drawn: the other BSDFs of its surface are" in message for message in messages)
    loop = "\n".join(f"token inputs:{name}.connect = </m/a.outputs:out>" for name in ("in1", "in2"))
    inputs, nodes = graph(bsdf("a", "ND_add_bsdf", loop))
    _, messages = drawn(tmp_path, inputs, "ND_surface", nodes)
    assert any("more than 64 BSDFs feed each other" in message for message in messages)


def test_a_volume_is_told_with_what_to_do(tmp_path):
    stage = """def Volume "smoke" { rel field:density = </smoke/density>
        def OpenVDBAsset "density" { asset filePath = @absent.vdb@
            token fieldName = "density" } }"""
    scene, messages = read(tmp_path, stage)
    assert messages[0] == (
        "x.usda</smoke>: warning: Volume is not drawn: write its grid as an array (docs/media.md says how), "
        "and fill a box with medium(density: volume(…))"
    )
    assert not len(scene.tables.instances.geometry)
