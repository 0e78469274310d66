"""Arguments of material elements that exporters write and no slot holds: luminance, media inside of glass and bodies, kinds of metal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...materials import glass, losses, metal, openpbr, subsurface, subsurface_inversion
from ...materials.optics import metals
from .. import ir
from ..scene.row_records import MediumData
from .placement import F64

Slot = ir.Slot
SHADINGS = {"phong": ir.Shading.SMOOTH, "gouraud": ir.Shading.GOURAUD, "flat": ir.Shading.FLAT}
_SAME = 1e-5


class MaterialRow:
    """A row of Materials, its constants and its medium."""

    def __init__(self, tables: ir.Tables, row: int) -> None:
        self.tables, self.row, self.materials = tables, row, tables.materials
        self.model = ir.MaterialModel(int(self.materials.model[row]))

    def value(self, slot: ir.Slot) -> F64:
        return self.materials.values[self.row, slot]

    def number(self, slot: ir.Slot) -> float:
        return float(self.value(slot)[0])

    def texture(self, slot: ir.Slot) -> int:
        return int(self.materials.textures[self.row, slot])

    @property
    def medium(self) -> MediumData | None:
        """The coefficients inside; None without, or with a density that varies."""
        media, row = self.tables.media, int(self.materials.medium[self.row])
        if row < 0 or media.density[row] >= 0:
            return None
        r, g, b = media.scattering[row].tolist()
        x, y, z = media.absorption[row].tolist()
        return MediumData((r, g, b), (x, y, z), anisotropy=float(media.anisotropy[row]), priority=float(media.priority[row]))


def special(element: str, row: MaterialRow) -> dict[str, Any]:
    """The values of the arguments of an element that are no slots."""
    values: dict[str, Any] = {"normalized": bool(row.materials.normalized[row.row])}
    values["shading"] = next(name for name, shading in SHADINGS.items() if shading == row.materials.shading[row.row])
    return values | (_SPECIAL[element](row) if element in _SPECIAL else {})


def _emission(argument: str) -> Callable[[MaterialRow], dict[str, Any]]:
    def luminance(row: MaterialRow) -> dict[str, Any]:
        return {argument: brightness(row)}

    return luminance


def brightness(row: MaterialRow) -> float:
    """The luminance at which an emitted colour is written: its largest component, or 1 for what is darker or black."""
    return max(float(row.value(Slot.EMISSION).max()), 1.0)


def _glass(row: MaterialRow) -> dict[str, Any]:
    values: dict[str, Any] = {"priority": row.number(Slot.PRIORITY), "dispersion": row.number(Slot.DISPERSION)}
    absorption = row.value(Slot.ABSORPTION)
    if absorption.max() > 0.0:
        depth = float(1.0 / absorption.max())
        values |= {"depth": depth, "inside": tuple(np.exp(-absorption * depth).tolist())}
    return values


def _metal(row: MaterialRow) -> dict[str, Any]:
    for kind in metal.KINDS:
        _, edge = metals.reflectance(kind)
        if np.allclose(edge, row.value(Slot.EDGE), rtol=_SAME):
            return {"kind": kind}
    return {}


def open_pbr(row: MaterialRow) -> dict[str, Any]:
    values: dict[str, Any] = {"geometry_thin_walled": row.number(Slot.THIN_WALLED) > 0.5}
    values["emission_luminance"] = brightness(row) if row.value(Slot.EMISSION).max() > 0.0 else 0.0
    inside = row.medium
    if values["geometry_thin_walled"]:
        values["subsurface_scatter_anisotropy"] = row.number(Slot.SUBSURFACE_ANISOTROPY)
    elif inside is not None and row.number(Slot.TRANSMISSION_WEIGHT) > 0.0:
        values |= _murky(inside)
    elif inside is not None:
        values |= _body(row, inside)
    if row.model == ir.MaterialModel.GLASS and row.number(Slot.DISPERSION) > 0.0:
        values |= {"transmission_dispersion_scale": 1.0, "transmission_dispersion_abbe_number": glass.KHRONOS / row.number(Slot.DISPERSION)}
    return values


def _glass_inside(row: MaterialRow) -> MediumData | None:
    """What absorbs and scatters inside of glass, together."""
    inside, absorption = row.medium or MediumData(), row.value(Slot.ABSORPTION)
    if row.medium is None and not absorption.max() > 0.0:
        return None
    r, g, b = (a + float(c) for a, c in zip(inside.absorption, absorption, strict=True))
    return replace(inside, absorption=(r, g, b))


def _murky(inside: MediumData) -> dict[str, Any]:
    scattering, absorption = np.array(inside.scattering), np.array(inside.absorption)
    extinction = scattering + absorption
    depth = float(1.0 / max(extinction.max(), 1e-12))
    values: dict[str, Any] = {"transmission_depth": depth, "transmission_color": tuple(np.exp(-extinction * depth).tolist())}
    if scattering.max() > 0.0:
        values["transmission_scatter"] = tuple((scattering * depth).tolist())
        values["transmission_scatter_anisotropy"] = inside.anisotropy
    return values


def _lengths(inside: MediumData) -> F64:
    """(3,) the mean free paths in a body."""
    return 1.0 / np.maximum(np.array(inside.scattering) + np.array(inside.absorption), 1e-30)


def _body(row: MaterialRow, inside: MediumData) -> dict[str, Any]:
    lengths = _lengths(inside)
    radius = float(lengths.max())
    values: dict[str, Any] = {"subsurface_radius": radius, "subsurface_radius_scale": tuple((lengths / radius).tolist())}
    return values | {"subsurface_scatter_anisotropy": inside.anisotropy}


def _subsurface(row: MaterialRow) -> dict[str, Any]:
    inside = row.medium
    if inside is None:
        return {}
    lengths = _lengths(inside) / subsurface_inversion.mean_free_path(np.clip(row.value(Slot.AMBIENT), 0.0, 1.0)) / row.number(Slot.RADIUS)
    return {"radius": tuple(lengths.tolist()), "priority": inside.priority}


_SPECIAL: Mapping[str, Callable[[MaterialRow], dict[str, Any]]] = {
    **dict.fromkeys(("emissive", "principled", "lambert", "phong", "blinn_phong"), _emission("luminance")),
    "glass": _glass, "metal": _metal, "openpbr": open_pbr, "subsurface": _subsurface,
}  # fmt: skip
EMITTING = frozenset(("emissive", "principled", "lambert", "phong", "blinn_phong", "openpbr"))
"""Elements whose emitted colour another argument multiplies."""


def _slots_of_openpbr(row: MaterialRow) -> dict[str, ir.Slot]:
    return {name: slot for table in (openpbr.NUMBERS, openpbr.COLORS) for name, (slot, *_) in table.items()}


_SLOTS: Mapping[int, Callable[[MaterialRow], dict[str, ir.Slot]]] = {
    ir.MaterialModel.OPENPBR: _slots_of_openpbr,
    ir.MaterialModel.GLASS: lambda row: {
        "transmission_color": Slot.TRANSMISSION, "specular_ior": Slot.IOR, "specular_roughness": Slot.ROUGHNESS,
    },
    ir.MaterialModel.METAL: lambda row: {
        "base_color": Slot.SPECULAR, "specular_color": Slot.EDGE, "specular_roughness": Slot.ROUGHNESS,
    },
    ir.MaterialModel.SUBSURFACE: lambda row: {
        "subsurface_color": Slot.AMBIENT, "specular_ior": Slot.IOR, "specular_roughness": Slot.ROUGHNESS,
    },
}  # fmt: skip


CARRYING = frozenset((ir.MaterialModel.OPENPBR, ir.MaterialModel.GLASS, ir.MaterialModel.SUBSURFACE))
"""Models whose slabs hold a medium."""


class Slabs(NamedTuple):
    """A material as slabs of OpenPBR: the slots of its inputs, and the constants of others."""

    slots: dict[str, ir.Slot]
    constants: dict[str, Any]
    lost: list[str]


def slabs(row: MaterialRow) -> Slabs | None:
    """A row as slabs; None of a material that these are not."""
    if int(row.model) not in _SLOTS:
        return None
    slots, lost = _SLOTS[int(row.model)](row), list[str]()
    if row.model == ir.MaterialModel.OPENPBR:
        constants = open_pbr(row)
    elif row.model == ir.MaterialModel.METAL:
        constants = {"base_metalness": 1.0}
    elif row.model == ir.MaterialModel.GLASS:
        constants = {"transmission_weight": 1.0}
        if row.number(Slot.DISPERSION) > 0.0:
            constants |= {"transmission_dispersion_scale": 1.0}
            constants |= {"transmission_dispersion_abbe_number": glass.KHRONOS / row.number(Slot.DISPERSION)}
        inside = _glass_inside(row)
        if inside is not None and (row.texture(Slot.TRANSMISSION) >= 0 or (row.value(Slot.TRANSMISSION) < 1.0).any()):
            lost.append(losses.ABSORPTION)  # one colour is that of the surface or that of the inside
        elif inside is not None:
            constants |= _murky(inside)
    else:
        constants = _slabs_of_body(row)
    for name in constants.keys() & slots.keys():
        del slots[name]
    return Slabs(slots, constants, lost)


def _slabs_of_body(row: MaterialRow) -> dict[str, Any]:
    constants: dict[str, Any] = {"subsurface_weight": 1.0}
    if row.number(Slot.IOR) == 1.0 and row.texture(Slot.IOR) < 0:
        constants |= {"specular_weight": 0.0, "specular_ior": 1.5, "specular_roughness": 1.0}
    inside = row.medium
    if inside is not None:
        lengths = _lengths(inside)
        if row.texture(Slot.AMBIENT) >= 0:  # those of a colour of ½, as subsurface.radius_of_free_path says
            beside = [subsurface_inversion.mean_free_path(np.array(c)) for c in (subsurface.MIDDLE, row.value(Slot.AMBIENT))]
            lengths = lengths * beside[0] / beside[1]
        radius = float(lengths.max())
        constants |= {"subsurface_radius": radius, "subsurface_radius_scale": tuple((lengths / radius).tolist())}
        constants |= {"subsurface_scatter_anisotropy": inside.anisotropy}
    return constants
