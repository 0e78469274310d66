"""Principled BSDF parameters: metallic and specular workflow (UsdPreviewSurface 2.6, glTF 2.0) and metals.

`PRINCIPLED`: base = colour (1 − metallic), f0 = ((ior − 1) / (ior + 1))² (1 − metallic) + colour metallic. `PRINCIPLED_SPECULAR`: base =
colour, f0 = SPECULAR. `METAL`: f0 = SPECULAR, and EDGE is the factor of Schlick's reflectance at 81.8°, where a metal reflects least
(Kutz, Hašan, Edmondson 2021, Novel aspects of the Adobe Standard Material). TRANSMISSION is the share of the base that
transmits straight through, AMBIENT the ambient occlusion of the base. α is roughness squared (Burley 2012).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiler import ir
from ...materials import traits
from ..jit.kernel import helper
from ..jit.packed_struct import HandleType
from ..lanes import ops
from ..simd.registration import overload
from ..surface import blend, normal_map
from ..surface.material_inputs import color_of, number_of
from ..types import Lane, Surface, Tables, Vec
from . import energy_compensation, medium_stack, microfacet, rough_dielectric, sheen
from .microfacet import Lobes

PRINCIPLED = int(ir.MaterialModel.PRINCIPLED)
SPECULAR_WORKFLOW = int(ir.MaterialModel.PRINCIPLED_SPECULAR)
METAL = int(ir.MaterialModel.METAL)
DIFFUSE, SPECULAR, IOR = int(ir.Slot.DIFFUSE), int(ir.Slot.SPECULAR), int(ir.Slot.IOR)
TRANSMISSION, EDGE = int(ir.Slot.TRANSMISSION), int(ir.Slot.EDGE)
ROUGHNESS, METALLIC = int(ir.Slot.ROUGHNESS), int(ir.Slot.METALLIC)
COAT, COAT_ROUGHNESS = int(ir.Slot.COAT), int(ir.Slot.COAT_ROUGHNESS)
LOWEST = 1.0 / 7.0  # cosine at which EDGE counts
_DIP = LOWEST * (1.0 - LOWEST) ** 6


class Layered(NamedTuple):
    """ir.Materials of scenes with microfacets, normal maps, media or blends, with their tables; kernels specialize on these types."""

    model: Any
    shading: Any
    normalized: Any
    threshold: Any
    values: Any
    textures: Any
    textured: Any
    first: Any
    second: Any
    albedo: Any  # energy_compensation.Albedo, or Smooth
    sheen: Any  # sheen.Albedo or NoSheen
    tangents: Any  # normal_map.Tangents or Untilted
    rough_glass: Any  # rough_dielectric.Tabled or Clear
    media: Any  # medium_stack.Media or Air
    blended: Any  # blend.Blended or Plain


class Smooth(NamedTuple):
    """No material has microfacets."""


def tables_for(tables: ir.Tables, general: bool = False) -> ir.Tables:
    """Return tables with `Layered` materials if an instance uses microfacets, a normal or height map, a medium or a blend.

    With `general`, every part is there: those that the scene does not use are empty.
    """
    facets = general or bool((traits.facets(tables) & traits.used(tables)).any())
    parts = (
        energy_compensation.table() if facets else Smooth(), sheen.tables_of(tables, general), normal_map.build_tangents(tables, general),
        rough_dielectric.tables_of(tables, general), medium_stack.media(tables, general), blend.find_blends(tables, general),
    )  # fmt: skip
    absent = Smooth, sheen.NoSheen, normal_map.NoMaps, rough_dielectric.Clear, medium_stack.Air, blend.Unblended
    if all(isinstance(part, absent) for part in parts):
        return tables
    return tables._replace(materials=Layered(*tables.materials, *parts))  # pyright: ignore[reportArgumentType]


def at(tables: Tables, surface: Surface) -> Lobes | None:
    """Return the microfacet lobes of a surface; None in scenes without any."""
    return _at(tables, surface) if isinstance(getattr(tables.materials, "albedo", None), energy_compensation.Albedo) else None


@overload(at)
def _at_in_kernels(tables, surface):
    found = tables.field("materials.albedo") if isinstance(tables, HandleType) else None
    if found is not None and found[1] != ():
        return lambda tables, surface: _at(tables, surface)
    return lambda tables, surface: None


@helper
def _at(tables: Tables, surface: Surface) -> Lobes:
    materials: Any = tables.materials
    model = materials.model[surface.material]
    zero = ops.full_like(surface.offset, 0.0)
    no = ops.bool_like(zero, False)
    metal, given = no | (model == METAL), no | (model == SPECULAR_WORKFLOW)
    here = metal | given | (model == PRINCIPLED)
    if ops.not_(ops.any_lane(here)):
        black, rough = (zero, zero, zero), zero + 1.0
        return Lobes(here, no, black, black, zero, black, rough, zero, rough, materials.albedo, sheen.without(materials.sheen, None, zero))
    color = ops.mul(color_of(tables, surface, DIFFUSE), surface.color)
    specular = color_of(tables, surface, SPECULAR)
    ior = ops.maximum(number_of(tables, surface, IOR), 1e-3)
    metallic = ops.clip(number_of(tables, surface, METALLIC), 0.0, 1.0)
    boundary = (ior - 1.0) / (ior + 1.0)
    along = ops.lerp3(_grey(boundary * boundary), color, metallic)
    f0 = _clipped(ops.where3(given | metal, specular, along))
    opaque = (1.0 - metallic) * (1.0 - ops.clip(number_of(tables, surface, TRANSMISSION), 0.0, 1.0))
    base = ops.scale(_clipped(color), ops.where(metal, zero, opaque))
    f90 = ops.minimum(microfacet.GRAZING * ops.largest(f0), 1.0)
    edge = color_of(tables, surface, EDGE)
    bend = (_bend(f0[0], edge[0]), _bend(f0[1], edge[1]), _bend(f0[2], edge[2]))
    bend = ops.where3(metal, bend, (zero, zero, zero))
    roughness = ops.clip(number_of(tables, surface, ROUGHNESS), 0.0, 1.0)
    alpha = roughness * roughness
    coat = ops.clip(number_of(tables, surface, COAT), 0.0, 1.0)
    coat_roughness = ops.clip(number_of(tables, surface, COAT_ROUGHNESS), 0.0, 1.0)
    return Lobes(
        here, here & (alpha < microfacet.SHARP), base, f0, f90, bend, ops.maximum(alpha, microfacet.SHARP),
        ops.where(metal, zero, coat), ops.maximum(coat_roughness * coat_roughness, microfacet.SHARP), materials.albedo,
        sheen.at(materials.sheen, None, tables, surface),
    )  # fmt: skip


@helper
def _grey(x: Lane) -> Vec:
    return x, x, x


@helper
def _clipped(color: Vec) -> Vec:
    return ops.clip(color[0], 0.0, 1.0), ops.clip(color[1], 0.0, 1.0), ops.clip(color[2], 0.0, 1.0)


@helper
def _bend(f0: Lane, edge: Lane) -> Lane:
    """The coefficient of the dip that leaves `edge` of Schlick's reflectance at LOWEST."""
    return (f0 + (1.0 - f0) * (1.0 - LOWEST) ** 5) * (1.0 - ops.clip(edge, 0.0, 1.0)) * (1.0 / _DIP)
