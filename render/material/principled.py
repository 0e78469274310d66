"""Microfacets of materials at points, made from the functions `facets` of the modules in materials/.

TRANSMISSION is the share of the base that transmits straight through, AMBIENT the ambient occlusion of the base. EDGE is the factor of
Schlick's reflectance at 81.8°, where a metal reflects least (Kutz, Hašan, Edmondson 2021, Novel aspects of the Adobe Standard Material).
α is roughness squared (Burley 2012).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiler import ir
from ...materials import MATERIALS, traits
from ...materials.contract import FacetInputs, Facets
from ..jit.kernel import helper
from ..jit.packed_struct import HandleType
from ..lanes import ops
from ..simd.registration import overload
from ..surface import blend, model_tests, normal_map
from ..surface.material_inputs import color_of, number_of
from ..types import Surface, Tables
from . import added_lobes, body_coat, dispersion, energy_compensation, medium_stack, microfacet, openpbr, rough_dielectric, sheen
from .microfacet import Lobes

DIFFUSE, SPECULAR, IOR = int(ir.Slot.DIFFUSE), int(ir.Slot.SPECULAR), int(ir.Slot.IOR)
TRANSMISSION, EDGE = int(ir.Slot.TRANSMISSION), int(ir.Slot.EDGE)
ROUGHNESS, METALLIC = int(ir.Slot.ROUGHNESS), int(ir.Slot.METALLIC)
COAT, COAT_ROUGHNESS = int(ir.Slot.COAT), int(ir.Slot.COAT_ROUGHNESS)


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
    medium: Any
    albedo: Any  # energy_compensation.Albedo, or Smooth
    sheen: Any  # sheen.Albedo or NoSheen
    tangents: Any  # normal_map.Tangents or Untilted
    rough_glass: Any  # rough_dielectric.Tabled or Clear
    media: Any  # medium_stack.Media or Air
    blended: Any  # blend.Blended or Plain
    added: Any  # added_lobes.Added or NotAdded
    coats: Any  # body_coat.Coats or NoCoats
    slabs: Any  # openpbr.SlabTables or NoSlabs
    dispersion: Any  # dispersion.Dispersion or NoDispersion


class Smooth(NamedTuple):
    """No material has microfacets."""


def tables_for(tables: ir.Tables, general: bool = False, around: tuple[int, ...] = (), space: str | None = None) -> ir.Tables:
    """Return tables with `Layered` materials if an instance uses microfacets, a normal or height map, a medium or a blend.

    With `general`, every part is there: those that the scene does not use are empty. `around` are the materials around the camera.
    Glass disperses light where a working space is given. Slabs and dispersion are in no general kernels but those of scenes with either,
    which have both.
    """
    media = medium_stack.media(tables, general, around)
    disperses = space is not None and traits.disperses(tables)
    rare = general and (disperses or bool((traits.slabs(tables) & traits.used(tables)).any()))
    facets = bool(((traits.facets(tables) | traits.coated(tables)) & traits.used(tables)).any())
    parts = (
        energy_compensation.table() if facets else energy_compensation.unused_table() if general else Smooth(),
        sheen.tables_of(tables, general), normal_map.build_tangents(tables, general, rare),
        rough_dielectric.tables_of(tables, general), media, blend.find_blends(tables, general),
        added_lobes.tables_of(tables, general), body_coat.tables_of(tables, general),
        openpbr.tables_of(tables, general, rare),
        dispersion.tables_of(tables, media, space, rare) if space else dispersion.NoDispersion(),
    )  # fmt: skip
    absent = (
        Smooth, sheen.NoSheen, normal_map.NoMaps, rough_dielectric.Clear, medium_stack.Air, blend.Unblended, added_lobes.NotAdded,
        body_coat.NoCoats, openpbr.NoSlabs, dispersion.NoDispersion,
    )  # fmt: skip
    if all(isinstance(part, absent) for part in parts):
        return tables
    return tables._replace(materials=Layered(*tables.materials, *parts))  # pyright: ignore[reportArgumentType]


def at(tables: Tables, surface: Surface) -> Lobes | None:
    """Return the microfacet lobes of a surface; None in scenes without any."""
    return _at(tables, surface) if isinstance(getattr(tables.materials, "albedo", None), energy_compensation.Albedo) else None


@overload(at)
def _at_in_kernels(tables, surface):
    field = tables.field("materials.albedo") if isinstance(tables, HandleType) else None
    if field is not None and field[1] != ():
        return lambda tables, surface: _at(tables, surface)
    return lambda tables, surface: None


def _make_facets() -> Any:
    """A helper with a branch for each function `facets` of materials/: `own` is the mask of its lanes."""
    models: dict[Any, list[str]] = {}
    for model, material in MATERIALS.items():
        if material.facets is not None:
            models.setdefault(material.facets, []).append(f"(model == {int(model)})")
    scope: dict[str, Any] = {"ops": ops, "Facets": Facets}
    lines = ["def any_facets(no, model, zero, p):", "base = f0 = bend = (zero, zero, zero)", "coat = zero"]
    for n, (function, tests) in enumerate(models.items()):
        scope[f"facets_{n}"] = function
        lines += [
            f"own = no | {' | '.join(tests)}", "if ops.any_lane(own):", f"    q = facets_{n}(p)",
            "    base, f0 = ops.where3(own, q.base, base), ops.where3(own, q.f0, f0)",
            "    bend, coat = ops.where3(own, q.bend, bend), ops.where(own, q.coat, coat)",
        ]  # fmt: skip
    exec("\n    ".join([*lines, "return Facets(base, f0, bend, coat)"]), scope)
    return helper(scope["any_facets"])


_any_facets = _make_facets()


@helper
def _at(tables: Tables, surface: Surface) -> Lobes:
    materials: Any = tables.materials
    model = materials.model[surface.material]
    zero = ops.full_like(surface.offset, 0.0)
    no = ops.bool_like(zero, False)
    faceted = no | model_tests.has_facets(model)
    if ops.not_(ops.any_lane(faceted)):
        black, rough = (zero, zero, zero), zero + 1.0
        return Lobes(
            faceted, no, black, black, zero, black, rough, zero, rough, materials.albedo, sheen.without(materials.sheen, None, zero)
        )
    color = ops.mul(color_of(tables, surface, DIFFUSE), surface.color)
    specular = color_of(tables, surface, SPECULAR)
    ior = ops.maximum(number_of(tables, surface, IOR), 1e-3)
    metallic = ops.clip(number_of(tables, surface, METALLIC), 0.0, 1.0)
    coat = ops.clip(number_of(tables, surface, COAT), 0.0, 1.0)
    transmission = ops.clip(number_of(tables, surface, TRANSMISSION), 0.0, 1.0)
    edge = color_of(tables, surface, EDGE)
    facets = _any_facets(no, model, zero, FacetInputs(color, specular, edge, ior, metallic, transmission, coat))
    f90 = ops.minimum(microfacet.GRAZING * ops.largest(facets.f0), 1.0)
    roughness = ops.clip(number_of(tables, surface, ROUGHNESS), 0.0, 1.0)
    alpha = roughness * roughness
    coat_roughness = ops.clip(number_of(tables, surface, COAT_ROUGHNESS), 0.0, 1.0)
    return Lobes(
        faceted, faceted & (alpha < microfacet.SHARP), facets.base, facets.f0, f90, facets.bend, ops.maximum(alpha, microfacet.SHARP),
        facets.coat, ops.maximum(coat_roughness * coat_roughness, microfacet.SHARP), materials.albedo,
        sheen.at(materials.sheen, None, tables, surface),
    )  # fmt: skip
