"""Whether blocks of pixels can share their paths beyond the first surface (render/integrator/path_reuse.py)."""

from __future__ import annotations

from .. import ir
from ..ir import light_links
from . import scene_facts

SHARED = ("blocks", "none")
_MATT = (ir.MaterialModel.LAMBERT, ir.MaterialModel.PHONG, ir.MaterialModel.BLINN_PHONG, ir.MaterialModel.EMISSIVE)
MANY = 64  # lights, from which on most noise comes from the choice of a light at the first surface
_SKIES = (ir.LightKind.SKY, ir.LightKind.DOME)


def by_blocks(tables: ir.Tables, transport: str, backend: str, moves: bool) -> tuple[str, str, tuple[str, ...]]:
    """(value, reason, choices) of the decision."""
    why = ""
    if transport != "path":
        why = "there are no random paths"
    elif backend != "ray":
        why = "the reference backend traces each path by itself"
    elif moves:
        why = "each path has its own time"
    elif not is_matt(tables):
        why = "some surface is not matt, smooth-shaded or partly transparent: its radiance depends on the direction"
    elif light_links.are_there(tables):
        why = "some light lights some surfaces only: paths count for the surface that they leave"
    elif ir.is_in(tables.lights.kind, _SKIES).any():
        why = "the sky is sampled for each pixel by itself"
    elif len(tables.lights.kind) > MANY:
        why = "there are many lights: most noise comes from the choice of one at the first surface"
    if why:
        return "none", why, SHARED[1:]
    return "blocks", "all surfaces are matt: blocks of 4 × 4 pixels share their paths beyond the first surface", SHARED


def is_matt(tables: ir.Tables) -> bool:
    """Whether all instances are Lambertian, opaque, with geometric normals, and visible to every ray."""
    m, instances, slot = tables.materials, tables.instances, ir.Slot
    other = [slot.SPECULAR, slot.REFLECTION, slot.TRANSMISSION]
    plain = ir.is_in(m.model, _MATT) & (m.shading != ir.Shading.GOURAUD) & ~scene_facts.partial(tables)
    plain &= m.values[:, other].max(axis=(1, 2), initial=0.0) <= 0.0
    plain &= (m.textures[:, [*other, slot.NORMAL, slot.BUMP]] < 0).all(axis=1)
    rounded = (tables.geometries.normals[instances.geometry] >= 0) & (m.shading[instances.material] != ir.Shading.FLAT)
    hit = instances.visible & ir.Visibility.REFLECTION != 0
    return bool((plain[instances.material] & ~rounded & hit).all())
