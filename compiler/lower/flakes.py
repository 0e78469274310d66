"""Flakes as a normal map: they turn the rows of openpbr, metal and principled into slabs with flakes in their base."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ...materials import metal, openpbr, principled
from .. import ir
from ..scene.row_records import BLACK, WHITE, Input, MaterialData, scale_color

Slot = ir.Slot
KINDS = "openpbr(…), metal(…) and principled(…)"


class NoFacetsError(Exception):
    """A material has no facets that flakes could tilt."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


def with_flakes(row: MaterialData, size: float, tilt: Input, coverage: Input, seed: int) -> MaterialData:
    """A row of slabs that looks as `row` does, with flakes in its base. Raises NoFacetsError."""
    more = {
        Slot.FLAKE_SIZE: Input.number(size), Slot.FLAKE_TILT: tilt, Slot.FLAKE_COVERAGE: coverage,
        Slot.FLAKE_SEED: Input.number(float(seed)),
    }  # fmt: skip
    slabs = _slabs(row)
    return replace(slabs, inputs={**slabs.inputs, **more})


def _slabs(row: MaterialData) -> MaterialData:
    if row.model == ir.MaterialModel.OPENPBR:
        return row
    if row.model == metal.MODEL:
        return replace(metal.slabs(row.inputs), shading=row.shading)
    if row.model == principled.MODEL:
        return replace(_of_principled(row.inputs), shading=row.shading)
    if row.model == ir.MaterialModel.PRINCIPLED_SPECULAR:
        raise NoFacetsError("flakes: `specular` of principled(…) is a reflectance, which the slabs of flakes do not have", "give `ior`")
    if row.model == ir.MaterialModel.GLASS:
        hint = "leave out `normal_map`, or give a lesser `transmission_weight`"
        raise NoFacetsError("flakes: glass has no base that flakes lie in", hint)
    raise NoFacetsError(f"flakes tilt the facets of {KINDS}, and this material has none", f"use one of {KINDS}")


def _of_principled(inputs: Mapping[ir.Slot, Input]) -> MaterialData:
    """The same base and coat; sheen as fuzz. Slabs have no ambient occlusion."""
    if inputs[Slot.AMBIENT] != Input.number(1.0):
        raise NoFacetsError("flakes: `occlusion` of principled(…) is an input that slabs of flakes do not have", "leave out `occlusion`")
    same = (Slot.DIFFUSE, Slot.METALLIC, Slot.ROUGHNESS, Slot.IOR, Slot.COAT, Slot.COAT_ROUGHNESS, Slot.EMISSION)
    sheen = inputs[Slot.SHEEN]
    weight = 1.0 if sheen.texture >= 0 else max(sheen.value)
    color = sheen if sheen.texture >= 0 else Input(scale_color(sheen.value, 1.0 / weight) if weight > 0.0 else WHITE)
    return openpbr.data({slot: inputs[slot] for slot in same if slot in inputs} | {
        Slot.COAT_IOR: Input.number(1.5), Slot.COAT_DARKENING: Input.number(0.0), Slot.FUZZ: Input.number(weight),
        Slot.FUZZ_COLOR: color, Slot.FUZZ_ROUGHNESS: inputs[Slot.SHEEN_ROUGHNESS], Slot.THIN_WALLED: Input(BLACK),
    })  # fmt: skip
