"""OpenPBR in the tables: media of its inside, and errors for what has no effect."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.lang.diagnostics import Diagnostics, SceneError
from maquette.materials import openpbr, subsurface

Slot = ir.Slot
REST = "\ncamera([0, 1, 5])\nsun()\n"


def test_defaults_are_those_of_the_specification(compiled) -> None:
    values = compiled("sphere(1, material: openpbr())" + REST).tables.materials.values[0]
    for slot, default, *_ in openpbr.NUMBERS.values():
        assert values[slot, 0] == default, slot
    for slot, grey, _ in openpbr.COLORS.values():
        assert values[slot].tolist() == [grey] * 3, slot
    assert values[Slot.EMISSION].tolist() == [0.0] * 3


def test_a_depth_makes_a_medium(compiled) -> None:
    """White light has `transmission_color` after the depth; what the inside scatters is a part of what it takes."""
    text = "transmission_weight: 1, transmission_color: rgb(0.5, 0.25, 1), transmission_depth: 2, transmission_scatter: rgb(0.1, 0.1, 0.1)"
    tables = compiled(f"sphere(1, material: openpbr({text}))" + REST).tables
    row = int(tables.materials.medium[0])
    extinction = tables.media.scattering[row] + tables.media.absorption[row]
    shift = extinction - (-np.log([0.5, 0.25, 1.0]) / 2)
    assert np.allclose(tables.media.scattering[row], 0.05)
    assert np.allclose(shift, shift[0])  # where scattering exceeds extinction, absorption is raised in all channels alike
    assert tables.materials.values[0, Slot.TRANSMISSION].tolist() == [1.0] * 3


def test_clear_slabs_are_glass(compiled) -> None:
    """Slabs that are glass and nothing else may have dispersion."""
    text = "transmission_weight: 1, specular_roughness: 0.4, specular_ior: 1.6, transmission_color: #80c0ff"
    slabs = "openpbr({}, transmission_dispersion_scale: 0.5, transmission_dispersion_abbe_number: 40)"
    own, glass = (
        compiled(f"sphere(1, material: {material})" + REST).tables.materials
        for material in (slabs.format(text), "glass(#80c0ff, ior: 1.6, roughness: 0.4, dispersion: 0.25)")
    )
    assert own.model[0] == glass.model[0] == ir.MaterialModel.GLASS
    assert (own.values[0] == glass.values[0]).all()


OTHERS = (
    "coat_weight: 0.1", "thin_film_weight: 1", "fuzz_weight: 0.1", "specular_color: #ff0000", "base_metalness: 0.5",
    "specular_weight: 0.5", "specular_roughness_anisotropy: 0.5", "geometry_thin_walled: true",
)  # fmt: skip


@pytest.mark.parametrize("more", OTHERS)
def test_other_slabs_are_no_glass(compiled, more: str) -> None:
    materials = compiled(f"sphere(1, material: openpbr(transmission_weight: 1, {more}))" + REST).tables.materials
    assert materials.model[0] == ir.MaterialModel.OPENPBR


def test_a_body_is_that_of_subsurface(compiled) -> None:
    tables = compiled("sphere(1, material: openpbr(subsurface_weight: 0.5, subsurface_color: 0.6, subsurface_radius: 2cm))" + REST).tables
    scattering, absorption = subsurface.of_free_path((0.6, 0.6, 0.6), (0.02, 0.01, 0.005))
    row = int(tables.materials.medium[0])
    assert np.allclose(tables.media.scattering[row] + tables.media.absorption[row], (50.0, 100.0, 200.0))  # 1 over mean free paths
    assert np.allclose(tables.media.scattering[row], scattering)
    assert np.allclose(tables.media.absorption[row], absorption)
    plain = subsurface.diffuse_substitute(tables).materials
    assert plain.medium[0] == -1
    assert np.allclose(plain.values[0, Slot.DIFFUSE], 0.7)


def test_emission_is_in_nit(compiled) -> None:
    table = compiled("sphere(1, material: openpbr(emission_luminance: 30, emission_color: rgb(1, 0.5, 0)))" + REST).tables.materials
    assert table.values[0, Slot.EMISSION].tolist() == [30.0, 15.0, 0.0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("transmission_weight: 1, subsurface_weight: 1", "both above 0"),
        ("transmission_depth: 1", "no effect without `transmission_weight`"),
        ("transmission_dispersion_scale: 1", "counts in glass alone"),
        ("transmission_weight: 1, geometry_thin_walled: true, transmission_dispersion_scale: 1", "counts in glass alone"),
        ("transmission_weight: 1, transmission_scatter: rgb(0, 0, 1)", "no effect without `transmission_depth`"),
        ("geometry_thin_walled: true, transmission_weight: 1, transmission_depth: 1", "a thin wall has none"),
        ("subsurface_weight: 1, subsurface_color: checker(#fff, #000, size: 1)", "is one colour"),
        ("transmission_weight: 1, transmission_depth: 1, transmission_color: checker(#fff, #000, size: 1)", "has one colour"),
        ("base_metalness: 2", "base_metalness"),
        ("specular_ior: 0", "specular_ior"),
    ],
)
def test_what_has_no_effect_is_an_error(tmp_path: Path, arguments: str, message: str) -> None:
    path, found = tmp_path / "a.scene", Diagnostics()
    path.write_text(f"sphere(1, material: openpbr({arguments}))" + REST, encoding="utf-8")
    with pytest.raises(SceneError, match=message):
        load.load(path, diagnostics=found)
    assert [d.span is not None for d in found.items] == [True]


def test_extremes_are_finite(compiled) -> None:
    """Black insides, huge and tiny lengths."""
    text = "transmission_weight: 1, transmission_color: 0, transmission_depth: 1e-6"
    media = compiled(f"sphere(1, material: openpbr({text}))" + REST).tables.media
    assert math.isfinite(float(media.absorption.max()))


def test_a_body_below_a_coat_is_darker(compiled) -> None:
    """By OpenPBR's formula: (1 − K) / (1 − E K) with K = 1 − (1 − F₀) / η²."""
    text = "sphere(1, material: openpbr(subsurface_weight: 1, subsurface_color: 0.8, subsurface_radius: 2cm{}))" + REST
    back = 1 - (1 - (0.68 / 2.68) ** 2) / 1.68**2
    dark = 0.8 * (1 - back) / (1 - 0.8 * back)
    for coat, color in (("", 0.8), (", coat_weight: 1, coat_ior: 1.68", dark), (", coat_weight: 1, coat_darkening: 0", 0.8),
                        (", coat_weight: 0.5, coat_ior: 1.68", 0.5 * (0.8 + dark))):  # fmt: skip
        tables = compiled(text.format(coat)).tables
        scattering, _ = subsurface.of_free_path((color, color, color), (0.02, 0.01, 0.005))
        assert np.allclose(tables.media.scattering[int(tables.materials.medium[0])], scattering)
        assert np.allclose(tables.materials.values[0, Slot.SUBSURFACE_COLOR], 0.8)
