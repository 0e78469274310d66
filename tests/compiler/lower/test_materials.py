"""Materials and textures in the tables: every model's slots, textures' frames, pictures by their use."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir

from ...files import write_image

Slot, Model = ir.Slot, ir.MaterialModel
REST = "\ncamera([0, 1, 5])\nsun()\n"


def material(scene: ir.Scene) -> dict[str, object]:
    """The first instance's material: its model, and the slots that are not 0 (opacity: not 1)."""
    m = scene.tables.materials
    row = int(scene.tables.instances.material[0])
    slots = {slot.name.lower(): m.values[row, slot].tolist() for slot in Slot if m.values[row, slot].any()}
    if slots["opacity"] == [1, 0, 0]:
        del slots["opacity"]
    return {"model": Model(int(m.model[row])), **slots}


def test_lambert(compiled) -> None:
    grey = [0.5, 0.5, 0.5]
    expected = {"model": Model.LAMBERT, "ambient": grey, "diffuse": grey, "ior": [1, 0, 0]}
    assert material(compiled("sphere(1, material: lambert(0.5))" + REST)) == expected


@pytest.mark.parametrize(("name", "model"), [("phong", Model.PHONG), ("blinn_phong", Model.BLINN_PHONG)])
def test_the_course_materials(compiled, name: str, model: ir.MaterialModel) -> None:
    arguments = "rgb(0.1, 0.2, 0.3), specular: 0.4, shininess: 50, ambient: 0.05, reflection: 0.2, transmission: rgb(0, 0.1, 0), ior: 1.33"
    scene = compiled(f"sphere(1, material: {name}({arguments}, normalized: true))" + REST)
    assert material(scene) == {
        "model": model,
        "ambient": [0.05] * 3,
        "diffuse": [0.1, 0.2, 0.3],
        "specular": [0.4] * 3,
        "shininess": [50, 0, 0],
        "reflection": [0.2] * 3,
        "transmission": [0, 0.1, 0],
        "ior": [1.33, 0, 0],
    }
    assert scene.tables.materials.normalized[0]


def test_ambient_is_diffuse_when_not_given(compiled) -> None:
    assert material(compiled("sphere(1, material: phong(k_d: 0.3, k_s: 0))" + REST))["ambient"] == [0.3] * 3


def test_mirror_glass_and_emissive(compiled) -> None:
    one = [1, 1, 1]
    mirror = material(compiled("sphere(1, material: mirror(0.9))" + REST))
    assert mirror == {"model": Model.MIRROR, "reflection": [0.9] * 3, "ior": [1, 0, 0]}
    assert material(compiled("sphere(1, material: glass())" + REST)) == {"model": Model.GLASS, "transmission": one, "ior": [1.5, 0, 0]}
    expected = {"model": Model.EMISSIVE, "emission": [0, 0, 4], "ior": [1, 0, 0]}
    assert material(compiled("box(1, material: emissive(rgb(0, 0, 2), luminance: 2))\nrender(bounces: 1)" + REST)) == expected


@pytest.mark.parametrize(
    ("shading", "row"), [("phong", ir.Shading.SMOOTH), ("gouraud", ir.Shading.GOURAUD), ("flat", ir.Shading.FLAT)]
)
def test_shading(compiled, shading: str, row: ir.Shading) -> None:
    assert compiled(f'sphere(1, material: lambert(shading: "{shading}"))' + REST).tables.materials.shading.tolist() == [row]


def test_a_let_material_is_one_row_and_so_are_equal_ones(compiled) -> None:
    scene = compiled("let m = lambert(0.5)\nsphere(1, material: m)\nbox(1, material: m)\ndisk(1, material: lambert(0.5))" + REST)
    assert scene.tables.instances.material.tolist() == [0, 0, 0]


def test_a_checker_in_a_slot(compiled) -> None:
    scene = compiled("sphere(1, material: lambert(checker(#ffffff, #000000, size: 50cm)))" + REST)
    assert scene.tables.materials.textures[0].tolist() == [0, 0] + [-1] * (ir.SLOTS - 2)
    assert scene.tables.materials.values[0, Slot.DIFFUSE].tolist() == [1, 1, 1]
    t = scene.tables.textures
    assert (t.kind[0], t.size[0], t.image[0], t.channel[0]) == (ir.TextureKind.CHECKER, 0.5, -1, -1)
    assert (t.color_a[0].tolist(), t.color_b[0].tolist()) == ([1, 1, 1], [0, 0, 0])


def test_a_texture_as_a_number_is_its_first_channel(compiled) -> None:
    t = compiled("sphere(1, material: phong(shininess: checker(rgb(90,0,0), rgb(10,0,0))))" + REST).tables
    row = t.materials.textures[0, Slot.SHININESS]
    assert t.textures.channel[row] == 0
    assert t.materials.values[0, Slot.SHININESS].tolist() == [1, 0, 0]


def test_an_emissive_texture_is_scaled_by_the_luminance(compiled) -> None:
    t = compiled("box(1, material: emissive(checker(), luminance: 7))\nrender(bounces: 1)" + REST).tables
    assert t.materials.values[0, Slot.EMISSION].tolist() == [7, 7, 7]
    assert t.materials.textures[0, Slot.EMISSION] == 0


def test_scale_repeats_and_offset_moves(compiled) -> None:
    frame = compiled("sphere(1, material: lambert(checker(scale: [2, 3], offset: [0.25, 0.5])))" + REST).tables.textures.frame[0]
    assert frame.tolist() == [[2, 0, -0.5], [0, 3, -1.5]]
    assert frame @ [0.25, 0.5, 1] == pytest.approx([0, 0])  # what was at the corner is now at the offset


def test_an_angle_turns_stripes(compiled) -> None:
    frame = compiled("sphere(1, material: lambert(stripes(angle: 30deg)))" + REST).tables.textures.frame[0]
    along = [-math.sin(math.radians(30)), math.cos(math.radians(30)), 0]
    assert frame @ along == pytest.approx([0, 1])  # along the turned stripes u' stays


@pytest.mark.parametrize("mapping", [m.name.lower() for m in ir.TextureMapping])
def test_mappings(compiled, mapping: str) -> None:
    scene = compiled(f'sphere(1, material: lambert(checker(mapping: "{mapping}")))' + REST)
    assert scene.tables.textures.mapping.tolist() == [ir.TextureMapping[mapping.upper()]]


@pytest.fixture
def grey_picture(tmp_path):
    """128 of 255 everywhere, in a 3 × 2 PNG."""
    write_image(tmp_path / "grey.png", np.full((2, 3, 3), 128, dtype=np.uint8))


def linear(value: float) -> float:
    return ((value + 0.055) / 1.055) ** 2.4


@pytest.mark.usefixtures("grey_picture")
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ('lambert(image("grey.png"))', linear(128 / 255)),
        ('lambert(image("grey.png", space: "linear"))', 128 / 255),
        ('phong(shininess: image("grey.png"))', 128 / 255),
        ('phong(shininess: image("grey.png", space: "srgb"))', linear(128 / 255)),
    ],
)
def test_a_picture_is_stored_as_its_use_wants(compiled, text: str, value: float) -> None:
    images = compiled(f"sphere(1, material: {text})" + REST).tables.images
    assert (images.width.tolist(), images.height.tolist()) == ([3], [2])
    assert images.texels == pytest.approx(np.tile([value, value, value, 1], (6, 1)), rel=1e-6)


@pytest.mark.usefixtures("grey_picture")
def test_a_picture_is_read_once_for_each_space(compiled) -> None:
    text = """
        sphere(1, material: lambert(image("grey.png")))
        box(1, material: lambert(image("grey.png", wrap: "clamp", filter: "nearest")))
        disk(1, material: phong(image("grey.png"), shininess: image("grey.png")))
    """
    t = compiled(text + REST).tables
    assert len(t.images.width) == 2
    assert t.textures.wrap_u.tolist() == t.textures.wrap_v.tolist() == [ir.Wrap.REPEAT, ir.Wrap.CLAMP, ir.Wrap.REPEAT]
    assert t.textures.nearest.tolist() == [False, True, False]


@pytest.mark.usefixtures("grey_picture")
def test_a_dome_has_a_picture_and_a_turn(compiled) -> None:
    t = compiled('sphere(1)\ndome("grey.png", luminance: 2, rotate: [0, 90deg, 0])\ncamera([0,1,5])').tables
    assert (t.lights.kind.tolist(), t.lights.image.tolist()) == ([ir.LightKind.DOME], [0])
    assert t.lights.color[0].tolist() == [2, 2, 2]
    assert t.transforms.matrix[t.lights.transform[0]] @ [0, 0, 1, 1] == pytest.approx([1, 0, 0])


def test_a_missing_picture(said, tmp_path) -> None:
    (tmp_path / "oak.png").write_bytes(b"not a picture")
    text = 'let wood = lambert(image("oka.png"))\nsphere(1, material: wood)\nbox(1, material: lambert(image("oak.png")))'
    assert said(text + REST) == (
        "a.scene:1:20: error: there is no picture `oka.png`\n"
        '   1 | let wood = lambert(image("oka.png"))\n'
        "     |                    ^^^^^^^^^^^^^^^^ did you mean `oak.png`?\n"
        "a.scene:3:26: error: cannot read the picture `oak.png`\n"
        '   3 | box(1, material: lambert(image("oak.png")))\n'
        "     |                          ^^^^^^^^^^^^^^^^ Not a PNG file"
    )


def opacity_of(scene: ir.Scene) -> tuple[float, float, int]:
    """(constant, threshold, channel of the texture or -2 without one) of the first instance's material."""
    m, t = scene.tables.materials, scene.tables.textures
    row = int(scene.tables.instances.material[0])
    texture = int(m.textures[row, Slot.OPACITY])
    return float(m.values[row, Slot.OPACITY, 0]), float(m.threshold[row]), int(t.channel[texture]) if texture >= 0 else -2


@pytest.mark.long
def test_opacity_is_a_number_or_a_picture_of_it(compiled, tmp_path) -> None:
    write_image(tmp_path / "rgb.png", np.full((2, 2, 3), 128, np.uint8))
    write_image(tmp_path / "leaf.png", np.array([[[9, 9, 9, 255], [9, 9, 9, 0]]], np.uint8))
    for material in ("lambert(0.5, OF)", "phong(0.5, OF)", "mirror(OF)", "glass(OF)", "emissive(OF)"):
        texts = {
            "opacity: 25%": (0.25, 0, -2), 'opacity: image("rgb.png")': (1, 0, 0),
            'opacity: image("leaf.png"), opacity_threshold: 0.5': (1, 0.5, 3), "opacity: checker(#ffffff, #000000)": (1, 0, 0),
            "opacity_threshold: 0.5": (1, 0, -2),
        }  # fmt: skip
        for text, expected in texts.items():
            made = compiled(f"box(1, material: {material.replace('OF', text)})\nrender(bounces: 1)" + REST)
            assert opacity_of(made) == expected


def test_opacity_is_a_share(said) -> None:
    assert said("sphere(1, material: lambert(0.5, opacity: 2))" + REST).startswith(
        "a.scene:1:43: error: `opacity` must be at most 1, got 2\n   1 | sphere(1, material: lambert(0.5, opacity: 2))\n"
    )


@pytest.mark.parametrize(("color", "channel", "hint"), [
    ("rgb(255, 128, 0)", "255", "write #ff8000"),
    ("rgb(1.5, 0.5, 0)", "1.5", "channels of a material's colour are 0 to 1"),
])  # fmt: skip
def test_a_colour_that_reflects_more_than_it_gets(said, color: str, channel: str, hint: str) -> None:
    expected = f"this lambert reflects more light than it gets: a channel of its colour is {channel}"
    place = "a.scene:1:21: warning: "
    source = f"sphere(1, material: lambert({color}))"
    marks = "^" * len(f"lambert({color})")
    assert said(source + REST) == f"{place}{expected}\n   1 | {source}\n     |                     {marks} {hint}"


def test_colours_of_light_may_exceed_one(said) -> None:
    assert said("sphere(1, material: emissive(rgb(255, 128, 0)))\nbox(1, material: lambert(rgb(1, 1, 1)))" + REST) == ""


def test_an_anisotropic_metal_has_slabs(compiled) -> None:
    """Its reflectance is that of the round one; without an anisotropy it stays microfacets."""
    table = compiled('sphere(1, material: metal("gold", anisotropy: 0.5, rotation: 0.25))').tables.materials
    plain = compiled('sphere(1, material: metal("gold"))').tables.materials
    assert (table.model[-1], plain.model[-1]) == (Model.OPENPBR, Model.METAL)
    assert (table.values[-1, Slot.DIFFUSE] == plain.values[-1, Slot.SPECULAR]).all()
    assert (table.values[-1, Slot.SPECULAR] == plain.values[-1, Slot.EDGE]).all()
    assert table.values[-1, [Slot.ANISOTROPY, Slot.ROTATION], 0].tolist() == [0.5, 0.25]
