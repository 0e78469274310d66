"""Each material answers all that the stages ask of it, and its answers agree with each other."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import Input, MaterialData
from maquette.materials import MATERIALS, catalogue, thresholds, traits
from maquette.materials.contract import FacetInputs, Lobes, Material
from maquette.materials.lanes import HELPERS
from maquette.render.material import microfacet

COMMON = {ir.Slot.OPACITY, ir.Slot.NORMAL, ir.Slot.BUMP}
NAMES = sorted({*Material.__annotations__, *(name for name, _ in inspect.getmembers(Material, inspect.isfunction) if name[0] != "_")})


def lacking(material: object) -> list[str]:
    return [name for name in NAMES if not hasattr(material, name)]


materials = pytest.mark.parametrize("material", MATERIALS.values(), ids=lambda material: material.MODEL.name.lower())


@materials
def test_a_material_answers_everything(material: Material) -> None:
    name = f"materials/{material.MODEL.name.lower()}.py"
    assert not lacking(material), f"{name} lacks {', '.join(lacking(material))}"
    assert MATERIALS[material.MODEL] is material
    assert material.facets is None or material.facets in HELPERS, f"{name}: @helper is missing at facets"
    assert (material.facets is not None) == (Lobes.FACETS in material.LOBES), f"{name}: LOBES and facets differ"
    assert (material.surface is None) == (material.povray is None) == (material.COLOR is None) == (Lobes.PARTS in material.LOBES)


def test_an_answer_left_out_is_named() -> None:
    class Half:
        MODEL = ir.MaterialModel.METAL

    assert {"LOBES", "facets", "mitsuba"} <= set(lacking(Half))
    assert "MODEL" not in lacking(Half)


@materials
def test_elements_make_rows_of_their_inputs(material: Material, tmp_path: Path) -> None:
    """Each element lowers to its model, or to one of its family, with inputs that the model reads."""
    required = {"metal": '"gold"', "blend": "lambert(0.5), mirror(0.5)"}
    for element in material.ELEMENTS:
        path = tmp_path / "a.scene"
        path.write_text(f"sphere(1, material: {element.entry.name}({required.get(element.entry.name, '')}))\nsun()\n", encoding="utf-8")
        scene = load.load(path)
        table = scene.tables.materials
        row = int(scene.tables.instances.material[0])
        assert table.model[row] == material.MODEL
        given = {ir.Slot(slot) for slot in np.flatnonzero(table.values[row].any(axis=1))}
        assert given <= {*material.SLOTS, *COMMON, ir.Slot.IOR}, given


def test_an_element_has_one_material() -> None:
    names = [element.entry.name for material in MATERIALS.values() for element in material.ELEMENTS]
    assert sorted(names) == sorted(catalogue.ELEMENTS)


@materials
def test_microfacets_are_reflectances(material: Material) -> None:
    if material.facets is None:
        return
    rng = np.random.default_rng(1)
    columns = [tuple(rng.uniform(0, 1.2, (3, 500))) for _ in range(3)]
    rest = [rng.uniform(1.0, 3.0, 500), *(rng.uniform(0, 1, 500) for _ in range(3))]
    found = material.facets(FacetInputs(*columns, *rest))
    for color in (found.base, found.f0):
        assert np.min(color) >= 0.0
        assert np.max(color) <= 1.0
    assert np.min(found.coat) >= 0.0
    assert (np.max(found.base) > 0.0) == (Lobes.BASE in material.LOBES)


def tables_of(*rows: MaterialData) -> Any:
    builder = SceneBuilder()
    for row in rows:
        builder.material(row)
    return builder.finish().tables


def test_a_blend_has_the_traits_of_its_parts() -> None:
    mirror = MaterialData(ir.MaterialModel.MIRROR, {ir.Slot.REFLECTION: Input()})
    matt = MaterialData(ir.MaterialModel.LAMBERT, {ir.Slot.DIFFUSE: Input()})
    tables = tables_of(matt, mirror, MaterialData(ir.MaterialModel.BLEND, {ir.Slot.WEIGHT: Input.number(0.5)}, first=0, second=1))
    assert traits.sharp(tables).tolist() == [False, True, True]
    assert traits.diffuse(tables).tolist() == [True, False, True]
    assert traits.color_slots(tables).tolist() == [ir.Slot.DIFFUSE, ir.Slot.REFLECTION, -1]


def test_thresholds_are_those_of_kernels() -> None:
    """A metal just below and just above each threshold."""
    for alpha, flat in ((0.99 * microfacet.SHARP, True), (1.01 * microfacet.SHARP, False)):
        inputs = {ir.Slot.SPECULAR: Input(), ir.Slot.ROUGHNESS: Input.number(alpha**0.5)}
        assert traits.flat_facets(tables_of(MaterialData(ir.MaterialModel.METAL, inputs))).tolist() == [flat]
    assert microfacet.MAX_REFLECTION_ALPHA == thresholds.MAX_REFLECTION_ROUGHNESS**2
