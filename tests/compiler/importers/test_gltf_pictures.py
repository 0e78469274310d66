"""Pictures of glTF materials: each of every ratified KHR_materials_… extension is drawn on every kind of material, or named."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir

from ...files import write_image
from .test_mesh_files import glb, read, square

Slot = ir.Slot
PICTURE = {"index": 0}
PROPERTIES = {  # of the material itself, and of each ratified extension that has pictures
    "": {"normalTexture": {}, "occlusionTexture": {}, "emissiveTexture": {"emissiveFactor": [1, 1, 1]}},
    "pbrMetallicRoughness": {"baseColorTexture": {}, "metallicRoughnessTexture": {}},
    "KHR_materials_anisotropy": {"anisotropyTexture": {"anisotropyStrength": 1}},
    "KHR_materials_clearcoat": {
        name: {"clearcoatFactor": 1} for name in ("clearcoatTexture", "clearcoatRoughnessTexture", "clearcoatNormalTexture")
    },
    "KHR_materials_diffuse_transmission": {
        name: {"diffuseTransmissionFactor": 0.5} for name in ("diffuseTransmissionTexture", "diffuseTransmissionColorTexture")
    },
    "KHR_materials_iridescence": {name: {"iridescenceFactor": 1} for name in ("iridescenceTexture", "iridescenceThicknessTexture")},
    "KHR_materials_sheen": {name: {"sheenColorFactor": [1, 1, 1]} for name in ("sheenColorTexture", "sheenRoughnessTexture")},
    "KHR_materials_specular": {"specularTexture": {}, "specularColorTexture": {}},
    "KHR_materials_transmission": {"transmissionTexture": {"transmissionFactor": 1}},
    "KHR_materials_volume": {"thicknessTexture": {"thicknessFactor": 1}},
    "KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {}, "specularGlossinessTexture": {}},
}
WITHOUT_EFFECT = {
    ("thicknessTexture", ""): "a shape has its own thickness",
    ("baseColorTexture", "glossy"): "the extension replaces it",
    ("metallicRoughnessTexture", "glossy"): "likewise",
    ("metallicRoughnessTexture", "matt leaf"): "it has no highlight",
}
KINDS = {
    "plain": {},
    "metal": {"pbrMetallicRoughness": {"metallicFactor": 1}},
    "cut out": {"alphaMode": "MASK"},
    "lines": {"KHR_materials_anisotropy": {"anisotropyStrength": 0.5}},
    "thin": {"KHR_materials_transmission": {"transmissionFactor": 0.8}},
    "smooth and thin": {"KHR_materials_transmission": {"transmissionFactor": 0.8}, "pbrMetallicRoughness": {"roughnessFactor": 0}},
    "glass": {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 1}},
    "dispersive glass": {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 1},
                         "KHR_materials_dispersion": {"dispersion": 0.1}},
    "milk": {"KHR_materials_transmission": {"transmissionFactor": 1},
             "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [0.5, 0.5, 0.5]},
             "KHR_materials_volume_scatter": {"multiscatterColor": [0.5, 0.5, 0.5]}},
    "leaf": {"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5}},
    "matt leaf": {"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5}, "KHR_materials_ior": {"ior": 1}},
    "skin": {"KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 1},
             "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [0.5, 0.5, 0.5]},
             "KHR_materials_volume_scatter": {"multiscatterColor": [0.5, 0.5, 0.5]}},
    "glossy": {"KHR_materials_pbrSpecularGlossiness": {}},
}  # fmt: skip


def written(kind, owner, name):
    """A material of a kind with one picture."""
    material: dict = {"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 0.5}}
    for key, value in (*KINDS[kind].items(), (owner, {**PROPERTIES[owner][name], name: PICTURE})):
        if key.startswith("KHR"):
            extensions = material.setdefault("extensions", {})
            extensions[key] = {**value, **extensions.get(key, {}), **({name: PICTURE} if key == owner else {})}
        elif key and isinstance(value, dict):
            material[key] |= value
        else:
            material |= value if isinstance(value, dict) else {key: value}
    return material


def drawn(tmp_path, material):
    """(scene, row, messages) of a material with the picture 0."""
    document, binary = square(materials=[material], scenes=[{"nodes": [0]}])
    data = write_image(tmp_path / "p.png", np.array([[[250, 130, 60, 90], [20, 250, 130, 200]]], np.uint8)).read_bytes()
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
    document["images"], document["textures"] = [{"bufferView": 3}], [{"source": 0}]
    scene, parts, messages = read(glb(document, binary + data), "a.glb")
    return scene, parts[0].material, messages


def textures(tables, row):
    """The rows of Textures that a material and its parts refer to."""
    rows = [int(k) for k in tables.materials.textures[row] if k >= 0]
    for part in (tables.materials.first[row], tables.materials.second[row]):
        rows += textures(tables, int(part)) if part >= 0 else []
    return rows


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("owner", "name"), [(owner, name) for owner, names in PROPERTIES.items() for name in names])
def test_each_picture_is_drawn_or_named(tmp_path, owner, name, kind):
    scene, row, messages = drawn(tmp_path, written(kind, owner, name))
    used, named = textures(scene.tables, row), [text for text in messages if name in text or (owner and owner in text)]
    if (name, kind) in WITHOUT_EFFECT or (name, "") in WITHOUT_EFFECT:
        assert not named
    else:
        assert used or named, messages
    if kind == "plain" and used:
        assert messages == []


def test_pictures_of_a_highlight_are_both_drawn(tmp_path):
    """Weight and colour are inputs of OpenPBR; `principled` has one input for both."""
    extension = {"specularTexture": PICTURE, "specularColorTexture": PICTURE}
    material = {"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {"KHR_materials_specular": extension}}
    scene, row, messages = drawn(tmp_path, material)
    assert (messages, scene.tables.materials.model[row]) == ([], ir.MaterialModel.OPENPBR)
    rows = scene.tables.materials.textures[row]
    assert scene.tables.textures.channel[[rows[Slot.SPECULAR_WEIGHT], rows[Slot.SPECULAR]]].tolist() == [3, -1]


@pytest.mark.parametrize("solid", [False, True])
@pytest.mark.parametrize("extension", ["KHR_materials_transmission", "ADOBE_materials_thin_transparency"])
def test_a_picture_of_what_passes(tmp_path, extension, solid):
    """Red times the factor is the share of the light that passes; without a volume the wall is thin."""
    extensions: dict = {extension: {"transmissionFactor": 0.75, "transmissionTexture": PICTURE}}
    extensions |= {"KHR_materials_volume": {"thicknessFactor": 1}} if solid else {}
    color = {"metallicFactor": 0, "roughnessFactor": 0.05, "baseColorFactor": [1, 0.5, 0.25, 1]}
    scene, row, messages = drawn(tmp_path, {"pbrMetallicRoughness": color, "extensions": extensions})
    m = scene.tables.materials
    assert (messages, m.model[row], m.values[row, Slot.THIN_WALLED, 0]) == ([], ir.MaterialModel.OPENPBR, 0 if solid else 1)
    assert m.values[row, Slot.TRANSMISSION_WEIGHT, 0] == pytest.approx(0.75)
    assert scene.tables.textures.channel[m.textures[row, Slot.TRANSMISSION_WEIGHT]] == 0
    assert m.values[row, Slot.TRANSMISSION_COLOR] == pytest.approx([1, 0.5, 0.25])


def test_thin_rough_surfaces_blur_and_tint(tmp_path):
    extensions = {"KHR_materials_transmission": {"transmissionFactor": 1}}
    color = {"metallicFactor": 0, "roughnessFactor": 0.4, "baseColorFactor": [0.5, 0.5, 0.5, 1]}
    scene, row, messages = drawn(tmp_path, {"pbrMetallicRoughness": color, "extensions": extensions})
    values = scene.tables.materials.values[row]
    assert messages == []
    expected = {Slot.THIN_WALLED: 1, Slot.TRANSMISSION_WEIGHT: 1, Slot.TRANSMISSION_COLOR: 0.5, Slot.ROUGHNESS: 0.4}
    assert {slot: values[slot][0] for slot in expected} == pytest.approx(expected)


@pytest.mark.parametrize(
    ("more", "slot", "value"),
    [
        ({"extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.5}}}, Slot.COAT, 0.5),
        ({"extensions": {"KHR_materials_sheen": {"sheenColorFactor": [0.5, 0.5, 0.5]}}}, Slot.FUZZ, 0.5),
        ({"extensions": {"KHR_materials_specular": {"specularFactor": 0.5}}}, Slot.SPECULAR_WEIGHT, 0.5),
        ({"emissiveFactor": [0.5, 0.5, 0.5]}, Slot.EMISSION, 0.5),
        ({"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.5}}}, Slot.TRANSMISSION_WEIGHT, 0.5),
        ({"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5]}}, Slot.OPACITY, 0.5),
    ],
)
def test_solid_glass_keeps_what_lies_on_it(tmp_path, more, slot, value):
    glass = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 1}}
    material = {**more, "extensions": {**glass, **more.get("extensions", {})}}
    scene, row, messages = drawn(tmp_path, material)
    assert (messages, scene.tables.materials.values[row, slot, 0]) == ([], pytest.approx(value))


@pytest.mark.parametrize(
    ("base", "coat", "values"),
    [
        ({}, PICTURE, (1.0, 1.0, 1.0)),
        (PICTURE, None, (0.0, 0.0, 1.0)),  # smooth
        (PICTURE, {**PICTURE, "scale": 0.5}, (0.5, 0.5, 1.0)),
        (PICTURE, PICTURE, None),  # that of the base
    ],
)
def test_coats_have_normals_of_their_own(tmp_path, base, coat, values):
    coated = {"clearcoatFactor": 1, **({} if coat is None else {"clearcoatNormalTexture": coat})}
    material = {"extensions": {"KHR_materials_clearcoat": coated}, **({"normalTexture": base} if base else {})}
    scene, row, messages = drawn(tmp_path, material)
    m = scene.tables.materials
    assert messages == []
    if values is None:
        assert m.model[row] == ir.MaterialModel.PRINCIPLED
        return
    assert (m.model[row], tuple(m.values[row, Slot.COAT_NORMAL])) == (ir.MaterialModel.OPENPBR, values)
    assert (m.textures[row, Slot.COAT_NORMAL] >= 0) == (coat is not None)
    assert (m.textures[row, Slot.NORMAL] >= 0) == bool(base)


def test_glass_with_a_normal_map(tmp_path):
    scene, row, messages = drawn(tmp_path, {**written("glass", "", "normalTexture")})
    m = scene.tables.materials
    assert (messages, m.model[row]) == ([], ir.MaterialModel.GLASS)
    assert m.textures[row, Slot.NORMAL] >= 0
