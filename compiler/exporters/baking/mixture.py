"""Blends of two surfaces as one metallic–roughness surface, whose inputs are mixed at every point."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ....materials import losses, traits
from ....materials.contract import Lobes
from ... import ir
from ...ir import F64
from ...scene.metallic_roughness import Surface
from ...scene.row_records import Input
from ..export import Export
from ..surfaces import surface_of

Slot = ir.Slot
Values = Callable[[int], F64]
"""The values (k, 3) of a texture (a row) at points."""
MODEL = ir.MaterialModel.PRINCIPLED
NOTE = "a blend is carried as one surface, whose colours and numbers are mixed"


def parts_of(tables: ir.Tables, row: int) -> Iterator[int]:
    """The rows of the materials of a blend that are not blends."""
    m = tables.materials
    for part in (int(m.first[row]), int(m.second[row])):
        yield from parts_of(tables, part) if m.model[part] == ir.MaterialModel.BLEND else (part,)


def is_mixture(out: Export, instance: int) -> bool:
    """Whether the material of an instance is a blend of opaque surfaces that can be mixed. The parts of solids keep their edges."""
    tables, row = out.scene.tables, int(out.scene.tables.instances.material[instance])
    if not traits.has(tables, Lobes.PARTS)[row] or out.scene.spans.get("materials", row) == out.scene.spans.get("instances", instance):
        return False
    unheard = Export(out.scene)  # what formats lack is reported of the mixture alone
    return all(_can_be_mixed(unheard, part) for part in parts_of(tables, row))


def _can_be_mixed(out: Export, row: int) -> bool:
    m = out.scene.tables.materials
    if m.medium[row] >= 0 or m.threshold[row] > 0.0 or (m.textures[row, [Slot.NORMAL, Slot.COAT_NORMAL]] >= 0).any():
        return False
    exported = surface_of(out, row)
    is_opaque = exported.transmission == 0.0 and exported.diffuse_transmission is None and not exported.body
    return is_opaque and exported.surface.specular is None and exported.surface.transmission == 0.0


def inputs(out: Export, row: int, values: Values) -> dict[ir.Slot, F64]:
    """The inputs (1 or k, 3) of a blend as one surface, with the highest index of its parts. Reports losses of these."""
    m = out.scene.tables.materials
    if m.model[row] != ir.MaterialModel.BLEND:
        surface = surface_of(out, row, frozenset((losses.BUMP_MAP,)), lambda texture: True).surface
        return {slot: _at_points(entry, values) for slot, entry in _entries(surface).items()}
    first, second = (inputs(out, int(part), values) for part in (m.first[row], m.second[row]))
    share = weight(out.scene.tables, row, values)
    mixed = {slot: (1.0 - share) * first[slot] + share * second[slot] for slot in first}
    mixed[Slot.IOR] = np.maximum(*(part[Slot.IOR].max(axis=0, keepdims=True) * _has_dielectric(part) for part in (first, second)))
    opacity = Input.number(float(m.values[row, Slot.OPACITY, 0]), int(m.textures[row, Slot.OPACITY]))
    return mixed | {Slot.OPACITY: mixed[Slot.OPACITY] * _at_points(opacity, values)}


def _has_dielectric(part: dict[ir.Slot, F64]) -> bool:
    """Whether the index of a part shows: metals have none."""
    return bool(part[Slot.METALLIC][:, 0].min() < 1.0)


def weight(tables: ir.Tables, row: int, values: Values) -> F64:
    """(1 or k, 1) the weight of the second part of a blend."""
    m = tables.materials
    factor, texture = float(m.values[row, Slot.WEIGHT, 0]), int(m.textures[row, Slot.WEIGHT])
    return np.clip(factor * (np.ones((1, 1)) if texture < 0 else np.nan_to_num(values(texture))[:, :1]), 0.0, 1.0)


def _entries(surface: Surface) -> dict[ir.Slot, Input]:
    return {
        Slot.DIFFUSE: surface.diffuse, Slot.METALLIC: surface.metallic, Slot.ROUGHNESS: surface.roughness, Slot.IOR: surface.ior,
        Slot.EMISSION: surface.emissive, Slot.COAT: surface.coat, Slot.COAT_ROUGHNESS: surface.coat_roughness, Slot.SHEEN: surface.sheen,
        Slot.SHEEN_ROUGHNESS: surface.sheen_roughness, Slot.AMBIENT: surface.occlusion, Slot.OPACITY: surface.opacity,
    }  # fmt: skip


def _at_points(entry: Input, values: Values) -> F64:
    factor = np.array(entry.value)[None]
    return factor if entry.texture < 0 else factor * np.nan_to_num(values(entry.texture))


def slopes(tables: ir.Tables, row: int, values: Values, of_heights: Callable[[int, float], F64]) -> F64 | None:
    """(k, 3) normals of the heights of a blend's parts, mixed; None without any. `of_heights`: those of a texture times a factor."""
    m = tables.materials
    if m.model[row] != ir.MaterialModel.BLEND:
        texture = int(m.textures[row, Slot.BUMP])
        is_formula = texture >= 0 and tables.textures.kind[texture] == ir.TextureKind.FORMULA
        return of_heights(texture, float(m.values[row, Slot.BUMP, 0])) if is_formula else None
    part_slopes = [slopes(tables, int(part), values, of_heights) for part in (m.first[row], m.second[row])]
    if part_slopes[0] is None and part_slopes[1] is None:
        return None
    share = weight(tables, row, values)
    first, second = (np.array([[0.0, 0.0, 1.0]]) if part is None else part for part in part_slopes)
    mixed = (1.0 - share) * first + share * second
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
