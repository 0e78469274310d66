"""Values of MaterialX nodes against hand-computed ones, Python's colorsys, and a port of MaterialX' noise."""

from __future__ import annotations

import colorsys
import math

import numpy as np
import pytest
from maquette.compiler.formula.tape import X, Y, Z
from maquette.compiler.importers.materialx import elementary, library, patterns, physical, pictures
from maquette.compiler.importers.materialx.evaluator import HANDLERS, Evaluator, NotDrawn
from maquette.compiler.importers.materialx.graph import COUNTS, Node, Port
from maquette.compiler.texture_graph import evaluate

from ....render.texture import mx_noise

MODULES = (elementary, patterns, physical, pictures)
POINT = (0.31, -1.7, 2.4)
UV = (0.3, 0.8)
NORMAL = (0.6, 0.0, 0.8)


class Host:
    """Pictures are grey ramps along u; primvars are their defaults."""

    def __init__(self):
        self.messages = []

    def picture(self, node, file, wraps, nearest):
        return 7, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

    def coordinates(self, name):
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)

    def primvar(self, name, kind, default, place):
        return default

    def is_u(self, name):
        return False

    def world(self):
        return None

    def tell(self, message, place):
        self.messages.append(message)


def port(value):
    if isinstance(value, Node):
        return Port("", source=value)
    return Port("", tuple(value) if isinstance(value, list | tuple | np.ndarray) else value)


def node(definition, **inputs):
    return Node("n", f"ND_{definition}", {name.rstrip("_"): port(value) for name, value in inputs.items()})


def picture(row, s, t):
    assert row == 7
    return [s, t, 0.25 + 0.0 * s, 0.0 * s + 0.5]


def value(of, output="out", host=None):
    evaluator = Evaluator(host or Host())
    names = evaluator.node(of, output)
    inputs = [np.array([number]) for number in (*POINT, *UV, *NORMAL)]
    numbers = []
    for k in range(0, len(names), 3):
        numbers += [float(r[0]) for r in evaluate.results(evaluator.builder.finish(*names[k : k + 3]), inputs, picture)]
    return numbers


A, B = (0.2, 0.5, 0.9), (0.7, 0.25, 0.4)
PLACE = Node("p", "ND_position_vector3")
CASES = {
    "add_color3": ({"in1": A, "in2": B}, (0.9, 0.75, 1.3)),
    "add_color3FA": ({"in1": A, "in2": 0.5}, (0.7, 1.0, 1.4)),
    "subtract_vector3": ({"in1": A, "in2": B}, (-0.5, 0.25, 0.5)),
    "multiply_color3": ({"in1": A, "in2": B}, (0.14, 0.125, 0.36)),
    "divide_float": ({"in1": 3.0, "in2": 4.0}, (0.75,)),
    "modulo_float": ({"in1": -0.3, "in2": 1.0}, (0.7,)),
    "power_float": ({"in1": 0.5, "in2": 3.0}, (0.125,)),
    "safepower_float": ({"in1": -0.5, "in2": 3.0}, (-0.125,)),
    "sqrt_float": ({"in_": 0.49}, (0.7,)),
    "absval_color3": ({"in_": (-1.0, 2.0, -3.0)}, (1.0, 2.0, 3.0)),
    "sign_float": ({"in_": -0.1}, (-1.0,)),
    "floor_float": ({"in_": -0.1}, (-1.0,)),
    "ceil_float": ({"in_": 0.1}, (1.0,)),
    "round_float": ({"in_": 1.5}, (2.0,)),
    "fract_float": ({"in_": -0.25}, (0.75,)),
    "clamp_float": ({"in_": 3.0, "low": 0.0, "high": 2.0}, (2.0,)),
    "min_vector3": ({"in1": A, "in2": B}, (0.2, 0.25, 0.4)),
    "max_vector3": ({"in1": A, "in2": B}, (0.7, 0.5, 0.9)),
    "sin_float": ({"in_": 0.4}, (math.sin(0.4),)),
    "cos_float": ({"in_": 0.4}, (math.cos(0.4),)),
    "tan_float": ({"in_": 0.4}, (math.tan(0.4),)),
    "asin_float": ({"in_": 0.4}, (math.asin(0.4),)),
    "acos_float": ({"in_": 0.4}, (math.acos(0.4),)),
    "atan2_float": ({"iny": 1.0, "inx": -1.0}, (0.75 * math.pi,)),
    "exp_float": ({"in_": 1.0}, (math.e,)),
    "ln_float": ({"in_": 2.0}, (math.log(2.0),)),
    "invert_color3": ({"in_": A}, (0.8, 0.5, 0.1)),
    "mix_color3": ({"bg": A, "fg": B, "mix": 0.25}, (0.325, 0.4375, 0.775)),
    "mix_color3_color3": ({"bg": A, "fg": B, "mix": (0.0, 1.0, 0.5)}, (0.2, 0.25, 0.65)),
    "smoothstep_float": ({"in_": 0.25, "low": 0.0, "high": 1.0}, (0.15625,)),
    "remap_float": ({"in_": 0.5, "inlow": 0.0, "inhigh": 2.0, "outlow": 10.0, "outhigh": 20.0}, (12.5,)),
    "range_float": ({"in_": 0.25, "inlow": 0.0, "inhigh": 1.0, "gamma": 2.0, "outlow": 0.0, "outhigh": 2.0, "doclamp": False}, (1.0,)),
    "contrast_float": ({"in_": 0.75, "amount": 2.0, "pivot": 0.5}, (1.0,)),
    "dotproduct_vector3": ({"in1": A, "in2": B}, (0.14 + 0.125 + 0.36,)),
    "crossproduct_vector3": ({"in1": (1.0, 0.0, 0.0), "in2": (0.0, 1.0, 0.0)}, (0.0, 0.0, 1.0)),
    "magnitude_vector3": ({"in_": (2.0, 3.0, 6.0)}, (7.0,)),
    "normalize_vector3": ({"in_": (2.0, 3.0, 6.0)}, (2 / 7, 3 / 7, 6 / 7)),
    "distance_vector3": ({"in1": (2.0, 3.0, 6.0), "in2": (0.0, 0.0, 0.0)}, (7.0,)),
    "reflect_vector3": ({"in_": (1.0, -1.0, 0.0), "normal": (0.0, 1.0, 0.0)}, (1.0, 1.0, 0.0)),
    "rotate2d_vector2": ({"in_": (1.0, 0.0), "amount": 90.0}, (0.0, -1.0)),
    "rotate3d_vector3": ({"in_": (1.0, 0.0, 0.0), "amount": 90.0, "axis": (0.0, 0.0, 1.0)}, (0.0, -1.0, 0.0)),
    "transformmatrix_vector3": ({"in_": (1.0, 2.0, 3.0), "mat": (0, 1, 0, 1, 0, 0, 0, 0, 2)}, (2.0, 1.0, 6.0)),
    "place2d_vector2": ({"texcoord": (1.0, 1.0), "pivot": (0.5, 0.5), "scale": (2.0, 2.0), "offset": (0.1, 0.0)}, (0.65, 0.75)),
    "combine3_color3": ({"in1": 0.1, "in2": 0.2, "in3": 0.3}, (0.1, 0.2, 0.3)),
    "combine2_vector4VV": ({"in1": (1.0, 2.0), "in2": (3.0, 4.0)}, (1.0, 2.0, 3.0, 4.0)),
    "extract_color3": ({"in_": A, "index": 2}, (0.9,)),
    "convert_float_color3": ({"in_": 0.3}, (0.3, 0.3, 0.3)),
    "convert_color3_color4": ({"in_": A}, (*A, 1.0)),
    "convert_color4_color3": ({"in_": (0.1, 0.2, 0.3, 0.4)}, (0.1, 0.2, 0.3)),
    "ifgreater_float": ({"value1": 2.0, "value2": 1.0, "in1": 5.0, "in2": 6.0}, (5.0,)),
    "ifgreatereq_float": ({"value1": 1.0, "value2": 1.0, "in1": 5.0, "in2": 6.0}, (5.0,)),
    "ifequal_floatI": ({"value1": 1, "value2": 2, "in1": 5.0, "in2": 6.0}, (6.0,)),
    "switch_float": ({"in1": 1.0, "in2": 2.0, "in3": 3.0, "in4": 4.0, "in5": 5.0, "which": 1.5}, (2.0,)),
    "luminance_color3": ({"in_": A, "lumacoeffs": (0.2, 0.7, 0.1)}, (0.48, 0.48, 0.48)),
    "rgbtohsv_color3": ({"in_": A}, colorsys.rgb_to_hsv(*A)),
    "hsvtorgb_color3": ({"in_": (0.37, 0.6, 0.8)}, colorsys.hsv_to_rgb(0.37, 0.6, 0.8)),
    "hsvadjust_color3": ({"in_": A, "amount": (0.1, 0.5, 2.0)}, colorsys.hsv_to_rgb(
        *(np.array(colorsys.rgb_to_hsv(*A)) * (1.0, 0.5, 2.0) + (0.1, 0.0, 0.0)))),
    "saturate_color3": ({"in_": A, "amount": 0.0, "lumacoeffs": (0.2, 0.7, 0.1)}, (0.48, 0.48, 0.48)),
    "burn_float": ({"fg": 0.5, "bg": 0.75, "mix": 1.0}, (0.5,)),
    "dodge_float": ({"fg": 0.5, "bg": 0.25, "mix": 1.0}, (0.5,)),
    "screen_float": ({"fg": 0.5, "bg": 0.25, "mix": 1.0}, (0.625,)),
    "difference_float": ({"fg": 0.5, "bg": 0.25, "mix": 0.5}, (0.25,)),
    "over_color4": ({"fg": (0.1, 0.2, 0.3, 0.5), "bg": (0.4, 0.4, 0.4, 1.0), "mix": 1.0}, (0.3, 0.4, 0.5, 1.0)),
    "disjointover_color4": ({"fg": (0.1, 0.2, 0.3, 0.5), "bg": (0.4, 0.4, 0.4, 1.0), "mix": 1.0}, (0.3, 0.4, 0.5, 1.0)),
    "premult_color4": ({"in_": (0.2, 0.4, 0.6, 0.5)}, (0.1, 0.2, 0.3, 0.5)),
    "ramplr_float": ({"valuel": 1.0, "valuer": 2.0}, (1.0 + UV[0],)),
    "ramptb_float": ({"valuet": 2.0, "valueb": 1.0}, (1.0 + UV[1],)),
    "splitlr_float": ({"valuel": 1.0, "valuer": 2.0, "center": 0.25}, (2.0,)),
    "splittb_float": ({"valuet": 2.0, "valueb": 1.0, "center": 0.9}, (1.0,)),
    "ramp4_float": ({"valuetl": 0.0, "valuetr": 1.0, "valuebl": 2.0, "valuebr": 3.0}, (UV[0] + 2.0 * (1.0 - UV[1]),)),
    "checkerboard_color3": ({"color1": A, "color2": B, "uvtiling": (1.0, 1.0)}, B),
    "position_vector3": ({}, POINT),
    "normal_vector3": ({}, NORMAL),
    "texcoord_vector2": ({}, UV),
    "image_color3": ({}, (*UV, 0.25)),
    "image_float": ({"texcoord": (0.6, 0.1)}, (0.6,)),
    "tiledimage_color3": ({"uvtiling": (2.0, 4.0), "uvoffset": (0.1, 0.0)}, (2 * UV[0] - 0.1, 4 * UV[1], 0.25)),
    "noise2d_float": ({"amplitude": 2.0, "pivot": 0.5}, (0.5 + 2.0 * mx_noise.perlin(UV)[0],)),
    "noise2d_vector2": ({"texcoord": (3.3, -7.1)}, mx_noise.perlin((3.3, -7.1))[1][:2]),
    "noise3d_vector3": ({}, mx_noise.perlin(POINT)[1]),
    "noise3d_vector4": ({}, (*mx_noise.perlin(POINT)[1], mx_noise.perlin(np.add(POINT, (19, 73, 29)))[0])),
    "noise3d_color3": ({"position": PLACE}, mx_noise.perlin(POINT)[1]),
    "fractal3d_float": ({"octaves": 3, "lacunarity": 2.0, "diminish": 0.5},
                        (sum(0.5**k * mx_noise.perlin(np.multiply(POINT, 2.0**k))[0] for k in range(3)),)),
    "fractal2d_vector2": ({"octaves": 2, "lacunarity": 3.0, "diminish": 0.4}, tuple(
        sum(0.4**k * mx_noise.perlin(np.multiply(p, 3.0**k))[0] for k in range(2)) for p in (UV, np.add(UV, (19, 193))))),
    "fractal3d_vector4": ({"octaves": 1}, (*mx_noise.perlin(POINT)[1], mx_noise.perlin(np.add(POINT, (19, 193, 17)))[0])),
    "cellnoise2d_float": ({"texcoord": (3.7, -2.2)}, (mx_noise.cell((3.7, -2.2)),)),
    "cellnoise3d_float": ({}, (mx_noise.cell(POINT),)),
    "worleynoise2d_float": ({"texcoord": (3.7, -2.2), "jitter": 0.8}, (mx_noise.worley((3.7, -2.2), 0.8),)),
    "worleynoise3d_float": ({}, (mx_noise.worley(POINT),)),
    "worleynoise3d_vector3": ({"style": 1}, mx_noise.cell_vec3(mx_noise.nearest(POINT))),
    "roughness_anisotropy": ({"roughness": 0.5, "anisotropy": 0.75}, (0.5, 0.125)),
    "roughness_dual": ({"roughness": (0.5, -1.0)}, (0.25, 0.25)),
}  # fmt: skip


@pytest.mark.parametrize("definition", CASES)
def test_value(definition):
    inputs, expected = CASES[definition]
    numbers = value(node(definition, **inputs))
    assert numbers == pytest.approx(expected, abs=1e-9)


def test_a_metal_by_its_colours():
    """n = (1 − r) / (1 + r) at an edge of 1, and k² = (r (n + 1)² − (n − 1)²) / (1 − r)."""
    metal = node("artistic_ior", reflectivity=(0.25,) * 3, edge_color=(1.0,) * 3)
    assert (value(metal, "ior"), value(metal, "extinction")) == (pytest.approx([0.6] * 3), pytest.approx([0.8] * 3))


def test_a_black_body_of_daylight_is_white_and_a_warm_one_red():
    """The white of Rec. 709, daylight of 6504 K, lies beside the black body of that temperature."""
    assert value(node("blackbody", temperature=6504.0)) == pytest.approx([1.0, 1.0, 1.0], abs=0.06)
    red, green, blue = value(node("blackbody", temperature=2000.0))
    assert red > 1.5 > green > blue >= 0.0
    assert 0.2126 * red + 0.7152 * green + 0.0722 * blue == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("definition", ["separate3_color3", "separate4_color4", "separate2_vector2"])
def test_outputs_of_separate(definition):
    numbers = (0.1, 0.2, 0.3, 0.4)[: int(definition[8])]
    outputs = "rgba" if "color" in definition else "xyzw"
    assert [value(node(definition, in_=numbers), f"out{o}")[0] for o in outputs[: len(numbers)]] == list(numbers)


def test_worley_gives_the_nearest_distances_in_order():
    first, second, third = value(node("worleynoise3d_vector3"))
    assert first == pytest.approx(mx_noise.worley(POINT))
    assert first < second < third


def test_hexagons_of_an_even_picture_are_even():
    """Blue and alpha of the picture are constant: the weights have a sum of 1."""
    numbers = value(node("hextiledimage_color4", tiling=(4.0, 4.0)))
    assert numbers[2:] == pytest.approx([0.25, 0.5])
    assert numbers[:2] != pytest.approx(value(node("image_color4"))[:2])


def test_hexagons_without_turns_keep_the_picture():
    numbers = value(node("hextiledimage_color3", rotation=0.0, scale=0.0, offset=0.0))
    assert numbers == pytest.approx([*UV, 0.25])


def test_the_projection_of_three_pictures_follows_the_normal():
    """The normal has no part along y: the pictures along x and z share by |n|, each with the coordinates of its plane."""
    numbers = value(node("triplanarprojection_color3", blend=1.0))
    assert np.isfinite(numbers).all()
    assert numbers[2] == pytest.approx(0.25)


def test_swizzle_of_older_versions():
    assert HANDLERS["swizzle"](Evaluator(Host()), node("swizzle_color3_color3", in_=(0.1, 0.2, 0.3), channels="bgr1"), "out", 4)
    evaluator = Evaluator(Host())
    names = HANDLERS["swizzle"](evaluator, node("swizzle_color3_color3", in_=(0.1, 0.2, 0.3), channels="b0g"), "out", 3)
    assert [evaluator.builder.number(name) for name in names] == [0.3, 0.0, 0.2]


def test_every_node_of_the_library_that_is_a_texture_is_drawn_or_told():
    """All definitions with default inputs; those that are refused are these."""
    refused, reported = set(), set()
    for element in library.document().getNodeDefs():
        for output in element.getActiveOutputs():
            if output.getType() not in COUNTS or element.getName() == "ND_UsdUVTexture":
                continue
            host = Host()
            try:
                numbers = value(Node("n", element.getName()), output.getName(), host)
            except NotDrawn:
                refused.add(element.getNodeString())
                continue
            assert len(numbers) == COUNTS[output.getType()], element.getName()
            if any("is not drawn" in message for message in host.messages):
                reported.add(element.getNodeString())
    assert refused == {
        "bitangent", "bump", "flake2d", "flake3d", "gltf_normalmap", "heighttonormal", "hextilednormalmap", "normalmap",
        "standard_surface_to_gltf_pbr", "tangent",
    }  # fmt: skip
    assert reported == {
        "blur", "chiang_hair_absorption_from_color", "chiang_hair_roughness", "deon_hair_absorption_from_melanin", "determinant",
        "invertmatrix", "transpose",
    }  # fmt: skip


def test_the_view_is_straight_onto_the_surface():
    host = Host()
    assert value(node("viewdirection_vector3"), host=host) == pytest.approx(-np.array(value(node("normal_vector3", space="world"))))
    assert value(node("facingratio_float"), host=host) == pytest.approx([1.0])
    assert value(node("facingratio_float", invert=True), host=host) == pytest.approx([0.0], abs=1e-6)
    assert sum("straight onto the surface" in message for message in host.messages) == 3


def test_a_node_that_feeds_itself_is_refused():
    loop = node("add_float", in2=1.0)
    loop.inputs["in1"] = Port("float", source=loop)
    with pytest.raises(NotDrawn, match="feed each other"):
        value(loop)


def test_a_factor_that_must_be_a_number_is_told():
    host = Host()
    numbers = value(node("fractal3d_float", octaves=node("ramplr_float", valuel=1.0, valuer=5.0)), host=host)
    assert numbers == value(node("fractal3d_float"))
    assert host.messages == ["the input `octaves` of ND_fractal3d_float is drawn only as a number: its default is drawn"]


def test_names_of_inputs_are_the_coordinates():
    assert Evaluator(Host()).geometry("Pobject") == (X, Y, Z)
