"""Whether the pixels of a block can share what their paths find beyond the first surface; see render/integrator/path_reuse.py."""

from __future__ import annotations

from .. import ir
from . import scene_facts

SHARED = ("blocks", "none")
_MATT = (ir.MaterialModel.LAMBERT, ir.MaterialModel.PHONG, ir.MaterialModel.BLINN_PHONG, ir.MaterialModel.EMISSIVE)
MANY = 64  # lamps from which on most noise is of which one was looked for at the first surface
_SKIES = (ir.LightKind.SKY, ir.LightKind.DOME)


def by_blocks(tables: ir.Tables, transport: str, backend: str, moves: bool) -> tuple[str, str, tuple[str, ...]]:
    """(value, reason, choices) of the decision."""
    why = ""
    if transport != "path":
        why = "no path is drawn by chance"
    elif backend != "ray":
        why = "the reference draws each path for itself"
    elif moves:
        why = "each path has a time of its own"
    elif not is_matt(tables):
        why = "something is not matt, even and wholly there: what it sends depends on where it is seen from"
    elif ir.is_in(tables.lights.kind, _SKIES).any():
        why = "light comes from the sky, which each pixel looks for by itself"
    elif len(tables.lights.kind) > MANY:
        why = "lamps are so many that most noise is of which one the first surface looks for"
    if why:
        return "none", why, SHARED[1:]
    return "blocks", "all is matt: blocks of 4 × 4 pixels share what their paths find beyond the first surface", SHARED


def is_matt(tables: ir.Tables) -> bool:
    """Whether all things send the same light in all directions, by normals of their own, and every ray may meet them."""
    m, instances, slot = tables.materials, tables.instances, ir.Slot
    other = [slot.SPECULAR, slot.REFLECTION, slot.TRANSMISSION]
    plain = ir.is_in(m.model, _MATT) & (m.shading != ir.Shading.GOURAUD) & ~scene_facts.partial(tables)
    plain &= m.values[:, other].max(axis=(1, 2), initial=0.0) <= 0.0
    plain &= (m.textures[:, [*other, slot.NORMAL, slot.BUMP]] < 0).all(axis=1)
    rounded = (tables.geometries.normals[instances.geometry] >= 0) & (m.shading[instances.material] != ir.Shading.FLAT)
    met = instances.visible & ir.Visibility.REFLECTION != 0
    return bool((plain[instances.material] & ~rounded & met).all())
