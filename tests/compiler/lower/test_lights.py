"""Lights in the tables: strengths in every unit, cones, fall-offs, frames of area lights, and what shines of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.lower import lights as lights_module
from maquette.compiler.plan import light_shapes
from maquette.compiler.scene import transforms
from maquette.compiler.scene.row_records import ALL_RAYS, NO_SHADOW
from maquette.lang.elements import Euler
from maquette.lights import spot

Kind = ir.LightKind
BALL = "\nsphere(1)\ncamera([0, 1, 5])\n"


@pytest.mark.parametrize(
    ("text", "kind", "strength"),
    [
        ("point([0,2,0])", Kind.POINT, 9 * math.pi),
        ("point([0,2,0], intensity: 40cd)", Kind.POINT, 40),
        ("point([0,2,0], intensity: 40)", Kind.POINT, 40),
        ("point([0,2,0], flux: 400lm)", Kind.POINT, 100 / math.pi),
        ("spot([0,2,0], intensity: 7)", Kind.SPOT, 7),
        ("directional([0,1,0])", Kind.DIRECTIONAL, math.pi),
        ("directional([0,1,0], irradiance: 2)", Kind.DIRECTIONAL, 2),
        ("sun(illuminance: 20000lx)", Kind.SUN, 20000),
        ("sky(luminance: 3000nit)", Kind.SKY, 3000),
        ("ambient(luminance: 0.2)", Kind.AMBIENT, 0.2),
        ("area([0,2,0], radiance: 5)", Kind.RECTANGLE, 5),
        ("area([0,2,0], size: [2, 3], flux: 60lm)", Kind.RECTANGLE, 10 / math.pi),
        ('area([0,2,0], size: 2, shape: "disk", flux: 60lm)', Kind.DISK, 60 / math.pi**2),
    ],
)
def test_strengths(compiled, text: str, kind: ir.LightKind, strength: float) -> None:
    lights = compiled(text + BALL).tables.lights
    assert lights.kind.tolist() == [kind]
    assert lights.color[0].tolist() == pytest.approx([strength] * 3, rel=1e-12)


def test_a_colour_multiplies_the_strength(compiled) -> None:
    assert compiled("point([0,2,0], intensity: 10, color: rgb(1, 0.5, 0))" + BALL).tables.lights.color[0].tolist() == [10, 5, 0]


@pytest.mark.parametrize(("text", "photometric"), [("point([0,2,0], intensity: 5)", False), ("point([0,2,0], intensity: 5cd)", True)])
def test_a_unit_makes_a_scene_photometric(compiled, text: str, photometric: bool) -> None:
    assert compiled(text + BALL).photometric is photometric


def test_an_emissive_unit_makes_a_scene_photometric(compiled) -> None:
    assert compiled("sphere(1, material: emissive(luminance: 100nit))" + BALL).photometric
    assert compiled("box(1, material: emissive(luminance: 100nit))\nrender(bounces: 1)" + BALL).photometric


def test_spot_flux_is_the_integral_of_its_fading() -> None:
    """∫ I·smoothstep dω over the sphere, by the midpoint rule in the cosine."""
    cos_cone, cos_full = math.cos(0.6), math.cos(0.4)
    edges = np.linspace(cos_cone, cos_full, 100_001)
    x = ((edges[1:] + edges[:-1]) / 2 - cos_cone) / (cos_full - cos_cone)
    fading = float((x * x * (3 - 2 * x)).sum() * (edges[1] - edges[0]))
    assert spot.flux_share(cos_cone, cos_full) == pytest.approx(2 * math.pi * ((1 - cos_full) + fading), rel=1e-9)


def test_a_spot_of_a_flux(compiled) -> None:
    lights = compiled("spot([0,2,0], look_at: [0,2,-3], cone: 60deg, soft: 60deg, flux: 100lm)" + BALL).tables.lights
    assert lights.direction[0].tolist() == [0, 0, -1]
    assert (lights.cos_cone[0], lights.cos_full[0]) == (pytest.approx(0.5), 1)
    assert lights.color[0, 0] == pytest.approx(100 / (2 * math.pi * 0.25))


def test_a_narrow_spot_fades_over_all_of_it(compiled) -> None:
    lights = compiled("spot([0,2,0], cone: 3deg)" + BALL).tables.lights
    assert lights.cos_full[0] == 1


@pytest.mark.parametrize(
    ("falloff", "kind", "coefficients"),
    [
        ("", ir.FalloffKind.INVERSE_SQUARE, [0, 0, 0]),
        (", falloff: [1, 0.5, 0.25]", ir.FalloffKind.POLYNOMIAL, [1, 0.5, 0.25]),
        (", falloff: ramp(50cm, 4m)", ir.FalloffKind.RAMP, [0.5, 4, 0]),
    ],
)
def test_falloffs(compiled, falloff: str, kind: ir.FalloffKind, coefficients: list[float]) -> None:
    lights = compiled(f"point([0,2,0]{falloff})" + BALL).tables.lights
    assert (lights.falloff[0], lights.coefficients[0].tolist()) == (kind, coefficients)


def test_the_sun_has_half_its_diameter(compiled) -> None:
    lights = compiled("sun(from: [0, 3, 4], angle: 2deg)\nsun(from: [0, 1, 0], angle: 0deg)" + BALL).tables.lights
    assert lights.kind.tolist() == [Kind.SUN, Kind.DIRECTIONAL]
    assert lights.direction[0].tolist() == [0, 0.6, 0.8]
    assert lights.angle.tolist() == [pytest.approx(math.radians(1)), 0]


def test_blocks_move_lights(compiled) -> None:
    scene = compiled(
        "transform(rotate: [0, 0, 90deg], translate: [1, 0, 0], scale: 2) {\n"
        "point([1, 0, 0]); directional([1, 0, 0]); spot([1,0,0], look_at: [2,0,0]) }" + BALL
    )
    lights = scene.tables.lights
    assert lights.position[0] == pytest.approx([1, 2, 0], abs=1e-15)
    assert lights.direction[1] == pytest.approx([0, 1, 0], abs=1e-15)
    assert lights.direction[2] == pytest.approx([0, 1, 0], abs=1e-15)


def test_an_area_light_is_seen_and_shines(compiled) -> None:
    scene = compiled('area([0, 3, 0], look_at: [0, 0, 0], size: [2, 1], luminance: 4, color: rgb(1, 0.5, 0), name: "lamp")' + BALL)
    t = scene.tables
    assert t.lights.instance.tolist() == [0]
    assert (t.instances.light[0], t.instances.visible[0]) == (0, ALL_RAYS)
    assert t.geometries.kind[t.instances.geometry[0]] == ir.GeometryKind.RECTANGLE
    assert t.geometries.parameters[t.instances.geometry[0], :2].tolist() == t.lights.size[0].tolist() == [1, 0.5]
    assert t.materials.model[t.instances.material[0]] == ir.MaterialModel.EMISSIVE
    assert t.materials.values[t.instances.material[0], ir.Slot.EMISSION].tolist() == t.lights.color[0].tolist() == [4, 2, 0]
    assert t.transforms.matrix[t.lights.transform[0]] @ [0, 1, 0, 0] == pytest.approx([0, -1, 0])
    assert scene.names.lights == ("lamp",)
    assert scene.names.instances[0] == "lamp"


def test_which_lamps_shapes_stand_in_the_light_of_others(compiled) -> None:
    """Not one alone, nor a ball that shows another lamp, nor a lamp that nothing blocks."""
    lamp, glow = "area([0, 3, 0]{})\n", "sphere(0.2, center: [2, 0, 0], material: emissive(#ffffff))\n"
    for text, blocking in (
        (lamp.format(""), [False]),
        (lamp.format("") + "ambient()\n", [False]),
        (lamp.format("") + "point([2, 0, 0])\n", [True]),
        (lamp.format("") + "box(0.1, center: [2, 0, 0], material: emissive(#ffffff))\nrender(bounces: 1)\n", [True, False]),
        (lamp.format("") + glow, [True, True]),
        (glow + "point([2, 0.1, 0])\n", [False]),
        (lamp.format(", shadows: false") + glow + "point([5, 0, 0])\n", [False, True]),
    ):
        tables = compiled(text + BALL).tables
        assert light_shapes.blocking(tables).tolist()[: len(blocking)] == blocking
        shadow = light_shapes.let_through(tables, True).instances.visible & ir.Visibility.SHADOW != 0
        assert shadow[tables.instances.light >= 0].tolist() == [b for b, k in zip(blocking, tables.instances.light, strict=False) if k >= 0]
    assert compiled(lamp.format(", shadows: false") + BALL).tables.instances.visible[0] == NO_SHADOW


def test_an_area_light_without_look_at_shines_down(compiled) -> None:
    t = compiled("area([1, 2, 3])" + BALL).tables
    assert t.transforms.matrix[t.lights.transform[0]].tolist() == [[1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3]]


def test_the_up_of_an_area_light_is_where_its_second_edge_points(compiled) -> None:
    t = compiled("area([0, 2, 0], look_at: [0, 2, -1], up: [1, 0, 0], size: [1, 5])" + BALL).tables
    frame = t.transforms.matrix[t.lights.transform[0]]
    assert abs(frame[:, 2]) == pytest.approx([1, 0, 0])


def test_a_scaled_block_scales_an_area_light_and_its_flux_stays(compiled) -> None:
    t = compiled("scale([2, 1, 3]) { area([0, 2, 0], size: 1, flux: 60lm) }" + BALL).tables
    assert t.lights.size[0].tolist() == pytest.approx([1, 1.5])
    assert t.lights.color[0, 0] == pytest.approx(10 / math.pi)
    assert np.linalg.det(t.transforms.matrix[t.lights.transform[0], :, :3]) == pytest.approx(1)


def test_a_mirrored_block_turns_an_area_light_over(compiled) -> None:
    t = compiled("scale([1, -1, 1]) { area([0, 2, 0]) }" + BALL).tables
    frame = t.transforms.matrix[t.lights.transform[0]]
    assert frame[:, 1].tolist() == [0, 1, 0]
    assert frame[:, 3].tolist() == [0, -2, 0]
    assert np.linalg.det(frame[:, :3]) == pytest.approx(1)


def test_rigid_parts_of_a_matrix() -> None:
    turn = transforms.rotation(Euler((0.3, -0.7, 1.1)))
    frame, scale, even = lights_module.rigid(turn @ transforms.scaling((2, 3, 4)))
    assert frame == pytest.approx(turn)
    assert (scale.tolist(), even) == (pytest.approx([2, 3, 4]), True)


def test_an_emissive_sphere_is_a_light(compiled) -> None:
    t = compiled("sphere(0.5, center: [0, 3, 0], scale: 2, material: emissive(rgb(1, 0.5, 0), luminance: 6))" + BALL).tables
    assert t.lights.kind.tolist() == [Kind.SPHERE]
    assert t.lights.size[0, 0] == 1
    assert t.lights.color[0].tolist() == [6, 3, 0]
    assert t.transforms.matrix[t.lights.transform[0]].tolist() == [[1, 0, 0, 0], [0, 1, 0, 6], [0, 0, 1, 0]]
    assert t.instances.light.tolist() == [0, -1]


@pytest.mark.parametrize("text", ["sphere(1, scale: [1, 2, 1], material: emissive())", "box(1, material: emissive())"])
def test_other_emissive_shapes_shine_without_being_sampled(compiled, text: str) -> None:
    scene = compiled(text + BALL + "render(bounces: 2)")
    assert len(scene.tables.lights.kind) == 0
    assert scene.defaults == ()  # there is light: none is added


def test_many_emissive_spheres_are_not_all_sampled(compiled) -> None:
    t = compiled("for (k in 1..100) { sphere(0.1, center: [k, 0, 0], material: emissive()) }\nrender(bounces: 1)" + BALL).tables
    assert len(t.lights.kind) == 64
    assert len(t.instances.geometry) == 101


def test_lights_without_shadows(compiled) -> None:
    assert compiled("point([0,2,0], shadows: false)\nambient()" + BALL).tables.lights.shadows.tolist() == [False, False]


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        (
            "spot([0,2,0], cone: 10deg, soft: 20deg)",
            "error: the spot fades over 20deg, more than its cone of 10deg",
            "make soft less",
        ),
        ("spot([0,2,0], cone: 1e-9deg)", "error: the spot's cone of 1e-09deg is too narrow to be distinguished from none", ""),
        ("spot([0,2,0], look_at: [0,2,0])", "error: the spot looks at where it is: it has no direction", "give it another look_at"),
        ("area([0,2,0], look_at: [0,2,0])", "error: the area light looks at where it is: it has no direction", "give it another look_at"),
        (
            'area([0,2,0], shape: "disk", size: [1, 2])',
            "error: a disk has one diameter, got two sizes",
            'write size: 1m, or shape: "rectangle"',
        ),
        ('dome("nothing.exr")', "error: there is no picture `nothing.exr`", "looked in {folder}"),
        ("point([0,2,0], intensity: 0)", "warning: light: its strength is 0: it gives no light", ""),
    ],
)
def test_messages(said, tmp_path, text: str, message: str, hint: str) -> None:
    hint = hint.format(folder=tmp_path)
    assert said(text + BALL) == f"a.scene:1:1: {message}\n   1 | {text}\n     | {'^' * len(text)} {hint}".rstrip()


def test_a_skewing_block_is_warned_about(said) -> None:
    text = "transform(matrix: [[1,0,1,0],[0,1,0,0],[0,0,1,0]]) { area([0,2,0]) }"
    message = said(text + BALL)
    assert message.startswith("a.scene:1:54: warning: the block around it skews or squeezes this area light: it is drawn even\n")
