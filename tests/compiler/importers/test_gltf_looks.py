"""glTF's anisotropy, iridescence and dispersion: rows of OpenPBR and of glass, their pictures, and the table of extensions."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.formula.tape import load_tape
from maquette.compiler.importers import gltf_materials, gltf_tables
from maquette.compiler.importers.khronos import slabs
from maquette.compiler.importers.understood import State
from maquette.compiler.texture_graph import evaluate

from ...files import write_image
from .test_mesh_files import glb, read, square

Slot = ir.Slot


def material(tmp_path, extensions, texels=None, **pbr):
    """(values by slot, tables, row, messages) of a material with extensions; `texels` (h, w, c) are the picture 0."""
    document, binary = square()
    document["materials"] = [{"pbrMetallicRoughness": {"metallicFactor": 0, **pbr}, "extensions": extensions}]
    document["scenes"] = [{"nodes": [0]}]
    if texels is not None:
        data = write_image(tmp_path / "p.png", np.asarray(texels, np.uint8)).read_bytes()
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        document["images"], document["textures"] = [{"bufferView": 3}], [{"source": 0}]
        binary += data
    scene, parts, messages = read(glb(document, binary), "a.glb")
    row = parts[0].material
    tables = scene.tables
    return {slot: tables.materials.values[row, slot] for slot in Slot}, tables, row, messages


def alphas(rough, anisotropy):
    """α along and across of OpenPBR."""
    along = rough**2 * math.sqrt(2.0 / (1.0 + (1.0 - anisotropy) ** 2))
    return along, along * (1.0 - anisotropy)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_widths_of_highlights_are_those_of_gltf(rough, strength):
    across = max(rough**2, slabs.LEAST_ALPHA)
    along = across + (1.0 - across) * strength**2
    assert alphas(*slabs.roughness_of(rough, strength)) == pytest.approx((along, across), rel=1e-9)


def test_anisotropy(tmp_path):
    extensions = {"KHR_materials_anisotropy": {"anisotropyStrength": 0.6, "anisotropyRotation": math.pi / 2}}
    values, tables, row, messages = material(tmp_path, extensions, metallicFactor=1, roughnessFactor=0.3)
    assert messages == []
    assert tables.materials.model[row] == ir.MaterialModel.OPENPBR
    rough, ratio = values[Slot.ROUGHNESS][0], values[Slot.ANISOTROPY][0]
    assert alphas(rough, ratio) == pytest.approx((0.09 + 0.91 * 0.36, 0.09))
    assert (values[Slot.ROTATION][0], values[Slot.METALLIC][0]) == pytest.approx((0.25, 1.0))
    assert (values[Slot.SPECULAR] == 1.0).all()  # Schlick's reflectance, without a tint at grazing angles


def test_pictures_of_roughness_and_direction(tmp_path):
    """Red and green are the direction, blue is the strength; the same picture's green is the roughness."""
    texels = np.array([[[255, 128, 128], [128, 255, 255]]], np.uint8)
    anisotropy = {"anisotropyStrength": 0.8, "anisotropyTexture": {"index": 0}, "anisotropyRotation": 0.5}
    more = {"metallicRoughnessTexture": {"index": 0}, "roughnessFactor": 0.7}
    _, tables, row, messages = material(tmp_path, {"KHR_materials_anisotropy": anisotropy}, texels, **more)
    assert messages == []
    for k, u in enumerate((0.25, 0.75)):
        direction, blue = texels[0, k, :2] / 255 * 2 - 1, texels[0, k, 2] / 255
        turns = (math.atan2(*direction[::-1]) + 0.5) / (2 * math.pi)
        expected = (*slabs.roughness_of(0.7 * texels[0, k, 1] / 255, 0.8 * blue), turns)
        drawn = [texel(tables, int(tables.materials.textures[row, slot]), u) for slot in (Slot.ROUGHNESS, Slot.ANISOTROPY, Slot.ROTATION)]
        assert drawn == pytest.approx(expected, abs=1e-6)


def texel(tables, texture, u):
    """The number of a texture's tape at u, the middle of a texel, whose look-ups take the nearest one."""

    def look_up(row, s, t):
        image = int(tables.textures.image[row])
        width, first = int(tables.images.width[image]), int(tables.images.first[image])
        return tables.images.texels[first + int(s[0] * width)][:, None]

    point = [*np.zeros((3, 1)), [u], [0.5], [0], [0], [1]]
    return float(evaluate.results(load_tape(tables, int(tables.textures.tape[texture])), point, look_up)[0][0])


def test_iridescence(tmp_path):
    film = {"iridescenceFactor": 0.75, "iridescenceIor": 1.4, "iridescenceThicknessMaximum": 550.0}
    values, tables, row, messages = material(tmp_path, {"KHR_materials_iridescence": film}, roughnessFactor=0.2)
    assert messages == []
    assert tables.materials.model[row] == ir.MaterialModel.OPENPBR
    drawn = [values[slot][0] for slot in (Slot.FILM, Slot.FILM_IOR, Slot.FILM_THICKNESS, Slot.ROUGHNESS)]
    assert drawn == pytest.approx([0.75, 1.4, 0.55, 0.2])
    pictures = {"iridescenceThicknessTexture": {"index": 0}, "iridescenceTexture": {"index": 0}, "iridescenceThicknessMinimum": 200.0}
    values, tables, row, _ = material(tmp_path, {"KHR_materials_iridescence": {**film, **pictures}}, np.full((1, 1, 3), 128))
    texture = tables.materials.textures[row, Slot.FILM_THICKNESS]
    assert (tables.textures.channel[texture], values[Slot.FILM_THICKNESS][0]) == (1, 1.0)
    assert (tables.textures.gain[texture][0], tables.textures.bias[texture][0]) == pytest.approx((0.35, 0.2))
    assert tables.textures.channel[tables.materials.textures[row, Slot.FILM]] == 0


def test_other_lobes_of_such_a_surface(tmp_path):
    extensions = {
        "KHR_materials_iridescence": {"iridescenceFactor": 1}, "KHR_materials_ior": {"ior": 1.6},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 0.5, 0.25], "specularTexture": {"index": 0},
                                   "specularColorTexture": {"index": 0}},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.7, "clearcoatRoughnessFactor": 0.1},
        "KHR_materials_sheen": {"sheenColorFactor": [0.5, 0.25, 0], "sheenRoughnessFactor": 0.4},
    }  # fmt: skip
    values, tables, row, messages = material(tmp_path, extensions, np.full((1, 1, 4), 128))
    assert messages == []
    assert values[Slot.SPECULAR] == pytest.approx([1, 0.5, 0.25])
    below = 1.6 * (1 + 0.7 * (1.5 - 1))  # below the coat its highlight is that of 1.6 below air
    numbers = {Slot.SPECULAR_WEIGHT: 0.5, Slot.IOR: below, Slot.COAT: 0.7, Slot.COAT_ROUGHNESS: 0.1, Slot.COAT_IOR: 1.5,
               Slot.COAT_DARKENING: 0.0, Slot.FUZZ: 0.5, Slot.FUZZ_ROUGHNESS: 0.4}  # fmt: skip
    assert {slot: values[slot][0] for slot in numbers} == pytest.approx(numbers)
    assert values[Slot.FUZZ_COLOR] == pytest.approx([1, 0.5, 0])
    rows = tables.materials.textures[row]
    assert tables.textures.channel[[rows[Slot.SPECULAR_WEIGHT], rows[Slot.SPECULAR]]].tolist() == [3, -1]


def test_a_tint_above_one_is_a_larger_index(tmp_path):
    specular = {"specularColorFactor": [2, 1, 1]}
    extensions = {"KHR_materials_iridescence": {"iridescenceFactor": 1}, "KHR_materials_specular": specular}
    values, *_ = material(tmp_path, extensions)
    ior = values[Slot.IOR][0]
    assert ((ior - 1) / (ior + 1)) ** 2 == pytest.approx(0.08)
    assert values[Slot.SPECULAR] == pytest.approx([1, 0.5, 0.5])


def test_dispersion(tmp_path):
    glass = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_volume": {"thicknessFactor": 1}}
    values, tables, row, messages = material(tmp_path, {**glass, "KHR_materials_dispersion": {"dispersion": 0.36}})
    assert messages == []
    assert (tables.materials.model[row], values[Slot.DISPERSION][0]) == (ir.MaterialModel.GLASS, pytest.approx(0.36))
    values, *_ = material(tmp_path, {**glass, "KHR_materials_dispersion": {"dispersion": 50.0}})
    assert values[Slot.DISPERSION][0] == 4.0


@pytest.mark.parametrize(
    ("extensions", "message"),
    [
        ({"KHR_materials_dispersion": {"dispersion": 1}},
         "KHR_materials_dispersion counts in solid glass alone: with KHR_materials_transmission and KHR_materials_volume"),
        ({"KHR_materials_iridescence": {"iridescenceFactor": 1}, "KHR_materials_transmission": {"transmissionFactor": 1},
          "KHR_materials_volume": {"thicknessFactor": 1}, "KHR_materials_dispersion": {"dispersion": 1}},
         "KHR_materials_dispersion of glass that is drawn as OpenPBR is not drawn: its boundary has other lobes"),
        ({"KHR_materials_anisotropy": {"anisotropyStrength": 1}, "KHR_materials_pbrSpecularGlossiness": {}},
         "the anisotropy and iridescence of a surface with KHR_materials_pbrSpecularGlossiness are not drawn"),
    ],
)  # fmt: skip
def test_what_is_not_drawn_is_named(tmp_path, extensions, message):
    _, _, _, messages = material(tmp_path, extensions, roughnessFactor=0.05)
    assert any(message in text for text in messages), messages


@pytest.mark.parametrize(
    "extensions",
    [{"KHR_materials_anisotropy": {}}, {"KHR_materials_anisotropy": {"anisotropyRotation": 1}}, {"KHR_materials_iridescence": {}},
     {"KHR_materials_iridescence": {"iridescenceFactor": 0, "iridescenceIor": 1.8}}],
)  # fmt: skip
def test_lobes_of_strength_zero_change_no_row(tmp_path, extensions):
    plain = material(tmp_path, {}, roughnessFactor=0.4)
    other = material(tmp_path, extensions, roughnessFactor=0.4)
    assert other[1].materials.model[other[2]] == plain[1].materials.model[plain[2]] == ir.MaterialModel.PRINCIPLED
    assert all((other[0][slot] == plain[0][slot]).all() for slot in Slot)


def test_bubbles_and_glass_have_films(tmp_path):
    film = {"KHR_materials_iridescence": {"iridescenceFactor": 1}, "KHR_materials_transmission": {"transmissionFactor": 0.9}}
    values, tables, row, messages = material(tmp_path, film, roughnessFactor=0.02, baseColorFactor=[1, 1, 1, 1])
    assert messages == []
    assert tables.materials.model[row] == ir.MaterialModel.OPENPBR
    assert [values[slot][0] for slot in (Slot.THIN_WALLED, Slot.TRANSMISSION_WEIGHT, Slot.OPACITY)] == pytest.approx([1.0, 0.9, 1.0])
    volume = {"thicknessFactor": 1, "attenuationDistance": 0.5, "attenuationColor": [0.5, 0.25, 1]}
    values, tables, row, messages = material(tmp_path, {**film, "KHR_materials_volume": volume}, roughnessFactor=0.02)
    assert messages == []
    assert [values[slot][0] for slot in (Slot.THIN_WALLED, Slot.TRANSMISSION_WEIGHT, Slot.FILM)] == [0.0, 0.9, 1.0]
    assert tables.media.absorption[tables.materials.medium[row]] == pytest.approx([2 * math.log(2), 2 * math.log(4), 0.0])


def test_sheets_keep_the_lobe(tmp_path):
    """A surface that passes light diffusely is a blend, whose reflecting part has the anisotropy."""
    through = {"diffuseTransmissionFactor": 0.5}
    extensions = {"KHR_materials_anisotropy": {"anisotropyStrength": 1}, "KHR_materials_diffuse_transmission": through}
    _, tables, row, _ = material(tmp_path, extensions, roughnessFactor=0.4)
    assert tables.materials.model[row] == ir.MaterialModel.BLEND
    assert tables.materials.model[tables.materials.first[row]] == ir.MaterialModel.OPENPBR


def test_the_table_names_the_extensions_that_the_reader_reads():
    """Each extension of materials that the sources name is drawn by the table, and each drawn one stands in the sources."""
    folder = Path(gltf_materials.__file__).parent
    sources = [folder / "gltf_materials.py", *(folder / "khronos").glob("*.py")]
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    named = set(re.findall(r"KHR_materials_[a-zA-Z_]*[a-zA-Z]", text)) | {f"KHR_materials_{name}" for name in ("clearcoat", "sheen")}
    table = {name: state for state, names, _ in gltf_tables.EXTENSIONS for name in names.split() if name.startswith("KHR_materials_")}
    assert {name for name in named if table.get(name) != State.DRAWN} == set()
    assert {name for name, state in table.items() if state == State.DRAWN} - named == set()
