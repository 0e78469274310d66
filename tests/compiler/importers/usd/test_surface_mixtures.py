"""Mixtures of surface shaders, sums of BSDFs and reflectances by generalized_schlick_bsdf, as MaterialX defines them."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers.usd.shaders import schlick

from .stages import slot
from .test_closures import CONDUCTOR, joined, opened, surface
from .test_materialx import drawn
from .test_scattering import DIFFUSE, bsdf, model_of

TRANSLUCENT = bsdf("t", "ND_translucent_bsdf", "color3f inputs:color = (0.2, 0.3, 0.1)")


def shader(name, kind, inputs):
    return f'def Shader "{name}" {{ uniform token info:id = "{kind}"\n{inputs}\ntoken outputs:out }}\n'


def mixed(tmp_path, nodes, share="float inputs:mix = 0.25", kind="ND_mix_surfaceshader"):
    ends = "token inputs:bg.connect = </m/p.outputs:out>\ntoken inputs:fg.connect = </m/q.outputs:out>"
    return drawn(tmp_path, f"{ends}\n{share}", kind, nodes)


def parts(scene):
    """The materials of a blend: model, and values (slots, 3)."""
    m, row = scene.tables.materials, int(scene.tables.instances.material[0])
    assert m.model[row] == ir.MaterialModel.BLEND
    return m.values[row, ir.Slot.WEIGHT, 0], [m.values[int(part)] for part in (m.first[row], m.second[row])]


def test_a_mixture_of_surface_shaders_is_a_blend(tmp_path):
    nodes = shader("p", "ND_standard_surface_surfaceshader", "float inputs:base = 0.5\ncolor3f inputs:base_color = (0.8, 0.4, 0.2)")
    nodes += shader("q", "ND_open_pbr_surface_surfaceshader", "float inputs:base_metalness = 1\nfloat inputs:specular_roughness = 0.6")
    scene, messages = mixed(tmp_path, nodes)
    weight, (below, above) = parts(scene)
    assert (messages, weight) == ([], pytest.approx(0.25))
    assert below[ir.Slot.DIFFUSE] == pytest.approx([0.4, 0.2, 0.1])
    assert (above[ir.Slot.METALLIC, 0], above[ir.Slot.ROUGHNESS, 0]) == pytest.approx((1.0, 0.6))


def test_a_mixture_has_the_normal_map_of_each_surface(tmp_path):
    nodes = shader("p", "ND_UsdPreviewSurface_surfaceshader", "color3f inputs:diffuseColor = (1, 0, 0)\nfloat inputs:metallic = 0.5")
    nodes += shader("q", "ND_standard_surface_surfaceshader", "float3 inputs:normal.connect = </m/n.outputs:out>")
    nodes += """def Shader "n" { uniform token info:id = "ND_normalmap_float"
        float3 inputs:in.connect = </m/r.outputs:out>
        float3 outputs:out }
    def Shader "r" { uniform token info:id = "ND_ramplr_vector3"
        float3 inputs:valuel = (0.5, 0.5, 1)
        float3 inputs:valuer = (0.8, 0.5, 0.8)
        float3 outputs:out }"""
    scene, messages = mixed(tmp_path, nodes)
    m, row = scene.tables.materials, int(scene.tables.instances.material[0])
    maps = m.textures[[m.first[row], m.second[row]], ir.Slot.NORMAL]
    assert (messages, maps[0] < 0, maps[1] >= 0) == ([], True, True)
    assert m.values[m.first[row], ir.Slot.METALLIC, 0] == pytest.approx(0.5)


def test_opacities_of_a_mixture_count_by_their_shares(tmp_path):
    """Of 0.75 · 1 and 0.25 · 0.2, together 0.8, the second surface has 1/16."""
    nodes = shader("p", "ND_standard_surface_surfaceshader", "")
    nodes += shader("q", "ND_standard_surface_surfaceshader", "color3f inputs:opacity = (0.2, 0.2, 0.2)\nfloat inputs:base = 0.1")
    scene, messages = mixed(tmp_path, nodes)
    assert (messages, slot(scene, "OPACITY")[0]) == ([], pytest.approx(0.8))
    m = scene.tables.materials
    weights = m.values[m.model == ir.MaterialModel.BLEND][:, ir.Slot.WEIGHT, 0]
    assert np.isclose(weights, 1 / 16).any()


def test_emission_of_each_surface_of_a_mixture_stays(tmp_path):
    nodes = shader("p", "ND_surface_unlit", "color3f inputs:emission_color = (1, 2, 3)")
    nodes += shader("q", "ND_standard_surface_surfaceshader", "float inputs:emission = 2")
    scene, messages = mixed(tmp_path, nodes, "float inputs:mix = 0.5")
    _, (below, above) = parts(scene)
    assert (messages, below[ir.Slot.EMISSION].tolist(), above[ir.Slot.EMISSION].tolist()) == ([], [1, 2, 3], [2, 2, 2])


@pytest.mark.parametrize("undrawn", ["", shader("q", "ND_wonder_surfaceshader", "")])
def test_a_mixture_with_a_surface_that_is_not_drawn_shows_the_other_one(tmp_path, undrawn):
    nodes = shader("p", "ND_standard_surface_surfaceshader", "float inputs:base = 0.5")
    scene, messages = mixed(tmp_path, nodes + undrawn)
    assert slot(scene, "DIFFUSE") == pytest.approx([0.4] * 3)
    expected = "the surface shader `ND_wonder_surfaceshader` is not drawn: the others of its mixture are"
    assert [message.partition("warning: ")[2] for message in messages] == [expected] * bool(undrawn)


def test_a_mixture_of_itself_is_told(tmp_path):
    _, messages = mixed(tmp_path, shader("p", "ND_dot_surfaceshader", "token inputs:in.connect = </m/s.outputs:out>"))
    assert any("feed each other" in message for message in messages)


def test_a_number_as_a_surface_is_unlit(tmp_path):
    """ND_convert_color3_surfaceshader, by its graph in MaterialX' library."""
    scene, messages = drawn(tmp_path, "color3f inputs:in = (0.25, 0.5, 1)", "ND_convert_color3_surfaceshader")
    assert (slot(scene, "EMISSION"), slot(scene, "DIFFUSE"), messages) == (pytest.approx([0.25, 0.5, 1]), [0, 0, 0], [])


def test_an_emission_alone_shines(tmp_path):
    nodes = bsdf("e", "ND_uniform_edf", "color3f inputs:color = (1, 2, 3)") + bsdf(
        "f", "ND_uniform_edf", "color3f inputs:color = (3, 2, 1)"
    )
    for kind, ends, expected in (
        ("ND_add_edf", {"in1": "e", "in2": "f"}, [4, 4, 4]),
        ("ND_mix_edf", {"fg": "e", "bg": "f"}, [2.5, 2, 1.5]),
    ):
        weight = "\nfloat inputs:mix = 0.25" if "mix" in kind else ""
        every = nodes + joined("l", kind, weight, **ends)
        scene, messages = drawn(tmp_path, "token inputs:edf.connect = </m/l.outputs:out>", "ND_surface", every)
        assert (slot(scene, "EMISSION"), messages) == (pytest.approx(expected), [])


# --- sums ---------------------------------------------------------------------------------------------------------------


def test_a_sum_that_reflects_no_more_than_all_light_is_drawn_exactly(tmp_path):
    """Share times part is each summand: a metal of weight 0.3 beside a diffuse surface, and a sheet of two BSDFs."""
    metal = CONDUCTOR.replace("float2 inputs:roughness", "float inputs:weight = 0.3\nfloat2 inputs:roughness")
    scene, messages = surface(tmp_path, DIFFUSE + metal + joined("a", "ND_add_bsdf", in1="b", in2="m"), "a")
    share, (below, above) = parts(scene)
    assert messages == []
    assert below[ir.Slot.DIFFUSE] * (1 - share) == pytest.approx([0.1, 0.2, 0.3])
    assert above[ir.Slot.SPECULAR_WEIGHT, 0] * share == pytest.approx(0.3)
    assert above[ir.Slot.DIFFUSE] == pytest.approx(parts(scene)[1][1][ir.Slot.DIFFUSE])
    matt = DIFFUSE + bsdf("r", "ND_oren_nayar_diffuse_bsdf", "float inputs:roughness = 0.5\ncolor3f inputs:color = (0.1, 0.1, 0.2)")
    nodes = matt + TRANSLUCENT + joined("i", "ND_add_bsdf", in1="b", in2="r") + joined("a", "ND_add_bsdf", in1="i", in2="t")
    scene, messages = surface(tmp_path, nodes, "a")
    share, (below, above) = parts(scene)
    assert messages == []
    assert below[ir.Slot.DIFFUSE] * (1 - share) == pytest.approx([0.2, 0.3, 0.5])
    assert above[ir.Slot.DIFFUSE_TRANSMISSION] * share == pytest.approx([0.2, 0.3, 0.1])


def test_a_sum_that_reflects_more_than_all_light_is_told(tmp_path):
    nodes = DIFFUSE + CONDUCTOR + joined("a", "ND_add_bsdf", in1="b", in2="m")
    scene, messages = surface(tmp_path, nodes, "a")
    assert model_of(scene) == ir.MaterialModel.BLEND
    assert any("may reflect more light than there is" in message for message in messages)


# --- generalized Schlick ------------------------------------------------------------------------------------------------

CASES = [((0.5, 0.3, 0.1), (1, 1, 1), (0.6, 0.6, 0.6), 5.0, 1e-6), ((0.04,) * 3, (0.9, 0.8, 1), (1, 1, 1), 5.0, 1e-6),
         ((0.2,) * 3, (1, 1, 1), (1, 1, 1), 7.0, 0.05), ((0.2,) * 3, (1, 1, 1), (0.5, 0.2, 0.3), 5.0, 0.4)]  # fmt: skip


@pytest.mark.parametrize(("f0", "f82", "f90", "power", "tolerance"), CASES)
def test_the_metal_has_the_reflectances_of_materialx(f0, f82, f90, power, tolerance):
    """Within the error that the fit states, at all angles; exact at 0° and, but for clipped tints, at 81.8°."""
    fit = schlick.fitted(f0, f82, f90, power)
    assert fit is not None
    cosine, white = np.linspace(0, 1, 500)[:, None], np.ones(3)
    drawn_metal = fit.scale * schlick.reflectance(cosine, np.array(fit.color), np.array(fit.tint), white, 5.0)
    expected = schlick.reflectance(cosine, np.array(f0), np.array(f82), np.array(f90), power)
    error = np.abs(drawn_metal - expected).max()
    assert error <= tolerance
    assert error <= fit.error * 1.02 + 1e-9
    assert drawn_metal[-1] == pytest.approx(f0)


def test_grazing_colours_and_exponents_are_drawn_or_told(tmp_path):
    inputs = "color3f inputs:color0 = (0.3, 0.2, 0.1)\ncolor3f inputs:color90 = (0.5, 0.5, 0.5)\nfloat inputs:weight = 0.5"
    scene, messages = surface(tmp_path, bsdf("g", "ND_generalized_schlick_bsdf", inputs), "g")
    assert (slot(scene, "DIFFUSE"), slot(scene, "SPECULAR_WEIGHT")[0], messages) == (
        pytest.approx([0.6, 0.4, 0.2]),
        pytest.approx(0.25),
        [],
    )
    inputs = "color3f inputs:color0 = (0.1, 0.1, 0.1)\nfloat inputs:exponent = 2"
    _, messages = surface(tmp_path, bsdf("g", "ND_generalized_schlick_bsdf", inputs), "g")
    assert any("is drawn within 0." in message and "`exponent`" in message for message in messages)


# --- documents that are wrong -------------------------------------------------------------------------------------------

SURFACE = (
    '<standard_surface name="S" type="surfaceshader">{}</standard_surface>'
    '<surfacematerial name="M" type="material"><input name="surfaceshader" type="surfaceshader" nodename="S"/></surfacematerial>'
)
COLOR = '<input name="base_color" type="color3" nodename="{}"/>'
CHAIN = "".join(f'<add name="n{k}" type="color3"><input name="in1" type="color3" nodename="n{k + 1}"/></add>' for k in range(3000))
WRONG = {  # a document, and a part of its warning
    "a chain": (CHAIN + SURFACE.format(COLOR.format("n0")), "more than 120 nodes feed each other"),
    "a definition by itself": (
        '<nodedef name="ND_my" node="my"><output name="out" type="color3"/></nodedef><nodegraph name="NG_my" nodedef="ND_my">'
        '<my name="i" type="color3"/><output name="out" type="color3" nodename="i"/></nodegraph><my name="w" type="color3"/>'
        + SURFACE.format(COLOR.format("w")), "more than 120 nodes feed each other"),
    "a text as a colour": (SURFACE.format('<input name="base_color" type="string" value="red"/>'), "has the type string, not color3"),
    "a matrix as a colour": (
        '<constant name="a" type="matrix33"><input name="value" type="matrix33" value="1,0,0,0,1,0,0,0,1"/></constant>'
        + SURFACE.format(COLOR.format("a")), "gives a matrix33, where a color3 is wanted"),
    "an index of 0": (SURFACE.format('<input name="specular_IOR" type="float" value="0"/>'), "`specular_ior` is not above 0: 1.5 is drawn"),
    "flakes without a size": (
        '<flake3d name="f" type="multioutput"><input name="size" type="float" value="0"/></flake3d>'
        + SURFACE.format('<input name="normal" type="vector3" nodename="f" output="flakenormal"/>'), "have no size: they are not drawn"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_material_is_told_and_the_others_are_drawn(tmp_path, name):
    text, message = WRONG[name]
    good = SURFACE.format('<input name="base_color" type="color3" value="0,0.5,0"/>').replace('"S"', '"G"').replace('"M"', '"Good"')
    (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text}{good}</materialx>')
    scene, messages = opened(tmp_path / "m.mtlx")
    assert len(messages) == 1
    assert message in messages[0]
    assert np.isclose(scene.tables.materials.values[:, ir.Slot.DIFFUSE], [0, 0.5, 0]).all(axis=1).any()


def test_prefixes_of_nodes_need_no_declaration(tmp_path):
    text = (
        '<nodedef name="ns:ND_my" node="ns:my"><output name="out" type="color3"/></nodedef><nodegraph name="ns:NG_my" nodedef="ns:ND_my">'
        '<constant name="i" type="color3"><input name="value" type="color3" value="1,0,0"/></constant>'
        '<output name="out" type="color3" nodename="i"/></nodegraph><ns:my name="w" type="color3"/>'
    )
    inputs = '<input name="base" type="float" value="1"/>' + COLOR.format("w")
    (tmp_path / "m.mtlx").write_text(f'<materialx version="1.39">{text}{SURFACE.format(inputs)}</materialx>')
    scene, messages = opened(tmp_path / "m.mtlx")
    assert messages == []
    assert np.isclose(scene.tables.materials.values[:, ir.Slot.DIFFUSE], [1, 0, 0]).all(axis=1).any()


# --- flakes -------------------------------------------------------------------------------------------------------------


def test_flakes_of_materialx_are_ours(tmp_path):
    """Size in units of the object, tilts and coverage; the coat stays smooth."""
    nodes = """def Shader "f" { uniform token info:id = "ND_flake3d"
        float inputs:size = 0.02
        float inputs:roughness = 0.3
        float inputs:coverage = 0.7
        float3 outputs:flakenormal }"""
    inputs = "float inputs:metalness = 1\nfloat inputs:coat = 1\nfloat3 inputs:normal.connect = </m/f.outputs:flakenormal>"
    scene, messages = drawn(tmp_path, inputs, nodes=nodes)
    assert messages == []
    assert [slot(scene, f"FLAKE_{name}")[0] for name in ("SIZE", "TILT", "COVERAGE")] == pytest.approx([0.02, 0.3, 0.7])
    assert slot(scene, "COAT_NORMAL")[2] > 0
