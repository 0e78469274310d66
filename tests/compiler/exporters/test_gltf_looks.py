"""Anisotropy, iridescence, tints and dispersion written to glTF and read back."""

from __future__ import annotations

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir

from ...files import write_image

Slot = ir.Slot
SCENE = "sphere(1, material: MATERIAL)\ncamera(position: [0, 1, 5])\ndirectional(from: [1, 2, 3])\nrender(size: [24, 18], samples: 4)\n"


def converted(folder, material):
    """(scene, the scene of its .glb, what the command said)"""
    (folder / "a.scene").write_text(SCENE.replace("MATERIAL", material), encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(folder / "a.scene"), str(folder / "a.glb")])
    assert done.exit_code == 0, done.output
    return maquette.load(folder / "a.scene"), maquette.load(folder / "a.glb"), done.output


def numbers(scene, *slots):
    row = scene.tables.instances.material[0]
    return np.concatenate([scene.tables.materials.values[row, slot] for slot in slots])


@pytest.mark.parametrize(
    ("material", "slots"),
    [
        ("openpbr(#c09040, base_metalness: 1, specular_roughness: 0.3, specular_roughness_anisotropy: 0.8, specular_rotation: 0.1)",
         (Slot.DIFFUSE, Slot.METALLIC, Slot.ROUGHNESS, Slot.ANISOTROPY, Slot.ROTATION)),
        ("openpbr(#202020, specular_ior: 1.5, thin_film_weight: 0.8, thin_film_thickness: 0.45, thin_film_ior: 1.33)",
         (Slot.DIFFUSE, Slot.IOR, Slot.ROUGHNESS, Slot.FILM, Slot.FILM_THICKNESS, Slot.FILM_IOR)),
        ("openpbr(#202020, thin_film_weight: 1, specular_weight: 0.5, specular_color: rgb(1, 0.5, 0.25))",
         (Slot.SPECULAR_WEIGHT, Slot.SPECULAR, Slot.FILM)),
        ("openpbr(#802020, thin_film_weight: 1, coat_weight: 0.5, coat_roughness: 0.2, coat_ior: 1.5, coat_darkening: 0)",
         (Slot.COAT, Slot.COAT_ROUGHNESS, Slot.COAT_IOR, Slot.COAT_DARKENING)),
        ("glass(dispersion: 0.5, ior: 1.7)", (Slot.IOR, Slot.DISPERSION)),
    ],
)  # fmt: skip
def test_round_trips(tmp_path, material, slots):
    there, back, said = converted(tmp_path, material)
    assert len({int(scene.tables.materials.model[scene.tables.instances.material[0]]) for scene in (there, back)}) == 1
    assert numbers(back, *slots) == pytest.approx(numbers(there, *slots), abs=1e-6)
    assert "is not carried" not in said


@pytest.mark.long
def test_the_picture_of_the_way_back(tmp_path):
    metal = "openpbr(#c09040, base_metalness: 1, specular_roughness: 0.5, specular_roughness_anisotropy: 0.8)"
    there, back, _ = converted(tmp_path, metal)
    a, b = (np.asarray(scene.render(size=(24, 18), samples=16, backend="reference", view="standard")) for scene in (there, back))
    assert np.abs(a - b)[..., :3].mean() < 0.05 * a[..., :3].mean()


def test_pictures_of_the_direction_are_reported(tmp_path):
    _, _, said = converted(tmp_path, "openpbr(#888888, specular_roughness_anisotropy: 0.5, specular_rotation: pattern(|x, y, z| x))")
    assert "`specular_rotation` is not carried" in said


@pytest.mark.parametrize(
    ("more", "values", "has_picture"),
    [
        ("normal_map: image(\"n.png\"), geometry_coat_smooth: true", (0.0, 0.0, 1.0), False),
        ("geometry_coat_normal: image(\"n.png\")", (1.0, 1.0, 1.0), True),
        ("normal_map: image(\"n.png\"), coat_weight: 1", None, False),
    ],
)
def test_the_normals_of_coats(tmp_path, more, values, has_picture):
    """A coat of glTF without a normal map is smooth: one with the normals of its base gets its map."""
    write_image(tmp_path / "n.png", np.full((2, 2, 3), (140, 128, 250), np.uint8))
    coat = "" if "coat_weight" in more else "coat_weight: 1, "
    there, back, said = converted(tmp_path, f"openpbr(#802020, {coat}coat_ior: 1.5, coat_darkening: 0, {more})")
    row = back.tables.instances.material[0]
    assert "is not carried" not in said
    if values is None:
        assert not back.tables.materials.values[row, Slot.COAT_NORMAL].any()
        assert back.tables.materials.textures[row, Slot.NORMAL] >= 0
        return
    assert numbers(back, Slot.COAT_NORMAL) == pytest.approx(values)
    assert numbers(there, Slot.COAT_NORMAL) == pytest.approx(values)
    assert (back.tables.materials.textures[row, Slot.COAT_NORMAL] >= 0) == has_picture


@pytest.mark.parametrize(
    ("material", "slots"),
    [
        ("principled(#204080, sheen: PICTURE, sheen_roughness: PICTURE)", (Slot.SHEEN, Slot.SHEEN_ROUGHNESS)),
        ("openpbr(#202020, thin_film_weight: PICTURE, thin_film_thickness: PICTURE)", (Slot.FILM, Slot.FILM_THICKNESS)),
        ("openpbr(#202020, thin_film_weight: 1, specular_weight: PICTURE, specular_color: PICTURE)", (Slot.SPECULAR_WEIGHT, Slot.SPECULAR)),
    ],
)
def test_pictures_of_lobes(tmp_path, material, slots):
    """The mean of each input is that of before: pictures keep their channel, their encoding and their factor."""
    texels = np.zeros((4, 4, 3), np.uint8) + np.array([200, 100, 50], np.uint8)
    write_image(tmp_path / "p.png", texels)
    there, back, said = converted(tmp_path, material.replace("PICTURE", 'image("p.png")'))
    assert not [line for line in said.splitlines() if "is not carried" in line and "texture" in line]
    for slot in slots:
        means = [texture_mean(scene, slot) for scene in (there, back)]
        assert means[1] == pytest.approx(means[0], abs=5e-3), slot


def texture_mean(scene, slot):
    """The mean of an input over its picture."""
    t, row = scene.tables, scene.tables.instances.material[0]
    texture = int(t.materials.textures[row, slot])
    assert texture >= 0
    first, count = int(t.images.first[t.textures.image[texture]]), int(t.images.width[t.textures.image[texture]]) ** 2
    texel, channel = t.images.texels[first : first + count].mean(axis=0), int(t.textures.channel[texture])
    color = texel[:3] if channel < 0 else np.repeat(texel[channel], 3)
    value = t.materials.values[row, slot] if slot in ir.COLOR_SLOTS else np.repeat(t.materials.values[row, slot, 0], 3)
    return value * (t.textures.gain[texture] * color + t.textures.bias[texture])


def test_flakes_are_carried_as_the_roughness_of_all(tmp_path):
    """From far, flakes are facets of α² = r⁴ + t⁴; single ones are reported."""
    _, back, said = converted(tmp_path, "openpbr(#c09040, base_metalness: 1, specular_roughness: 0.3, normal_map: flakes(1mm, tilt: 0.4))")
    assert numbers(back, Slot.ROUGHNESS)[0] == pytest.approx((0.3**4 + 0.4**4) ** 0.25, abs=1e-6)
    assert "single flakes are not carried" in said
