"""Flakes in the tables: as a normal map of materials with facets, and errors elsewhere."""

from __future__ import annotations

from pathlib import Path

import pytest
from maquette.compiler import ir, load
from maquette.lang.diagnostics import Diagnostics, SceneError

Slot = ir.Slot
REST = "\ncamera([0, 1, 5])\nsun()\n"


@pytest.mark.parametrize("text", ["openpbr(#c04020{})", 'metal("gold"{})', "principled(#c04020, metallic: 1, clearcoat: 1{})"])
def test_flakes_lie_in_slabs(compiled, text: str) -> None:
    material = text.format(", normal_map: flakes(2mm, tilt: 0.3, coverage: 0.5, seed: 7)")
    materials = compiled(f"sphere(1, material: {material})" + REST).tables.materials
    row = materials.values[0]
    assert materials.model[0] == ir.MaterialModel.OPENPBR
    assert row[[Slot.FLAKE_SIZE, Slot.FLAKE_TILT, Slot.FLAKE_COVERAGE, Slot.FLAKE_SEED], 0].tolist() == [0.002, 0.3, 0.5, 7.0]
    assert materials.textures[0, Slot.NORMAL] == -1


def test_principled_with_flakes_keeps_its_layers(compiled) -> None:
    text = "principled(#c04020, metallic: 0.7, roughness: 0.2, clearcoat: 0.6, sheen: rgb(0.1, 0.2, 0.4), normal_map: flakes(1mm))"
    values = compiled(f"sphere(1, material: {text})" + REST).tables.materials.values[0]
    assert values[[Slot.METALLIC, Slot.ROUGHNESS, Slot.COAT, Slot.FUZZ], 0].tolist() == pytest.approx([0.7, 0.2, 0.6, 0.4])
    assert values[Slot.FUZZ_COLOR].tolist() == pytest.approx([0.25, 0.5, 1.0])


WRONG = {
    "lambert(0.5, normal_map: flakes(1mm))": "this material has none",
    "lambert(flakes(1mm))": "they are no colour",
    "openpbr(specular_roughness: flakes(1mm))": "they are no colour",
    "openpbr(bump_map: flakes(1mm))": "they are no colour",
    "openpbr(opacity: flakes(1mm))": "they are no colour",
    "openpbr(normal_map: flakes(1mm), normal_strength: 2)": "no `normal_strength`",
    "openpbr(normal_map: flakes(0))": "more than 0",
    "openpbr(normal_map: flakes(1mm, coverage: 2))": "coverage",
    "openpbr(normal_map: flakes(1mm, seed: -1))": "seed",
    "openpbr(normal_map: flakes(1mm, seed: 3000000000))": "seed",
    "openpbr(normal_map: flakes(1mm, tilt: flakes(1mm)))": "they are no colour",
    "openpbr(transmission_weight: 1, normal_map: flakes(1mm))": "glass has no base",
    "principled(specular: #808080, normal_map: flakes(1mm))": "give `ior`",
    "principled(occlusion: 0.5, normal_map: flakes(1mm))": "occlusion",
    "glass(normal_map: flakes(1mm))": "glass has no base",
    "subsurface(0.5, radius: 1cm, normal_map: flakes(1mm))": "this material has none",
}


@pytest.mark.parametrize("material", WRONG)
def test_flakes_elsewhere_are_errors(tmp_path: Path, material: str) -> None:
    path, diagnostics = tmp_path / "a.scene", Diagnostics()
    path.write_text(f"sphere(1, material: {material})" + REST, encoding="utf-8")
    with pytest.raises(SceneError):
        load.load(path, diagnostics=diagnostics)
    assert len(diagnostics.items) == 1, [d.message for d in diagnostics.items]
    assert WRONG[material] in diagnostics.items[0].message + diagnostics.items[0].hint
    assert diagnostics.items[0].span is not None
