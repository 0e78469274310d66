"""UsdPreviewSurface, its specular workflow: SPECULAR is the reflectance at normal incidence. The element `principled` makes it."""

from __future__ import annotations

from ..compiler import ir
from ..compiler.scene.metallic_roughness import NOTHING
from . import layered
from .contract import Element, Exported, FacetInputs, Facets, Lobes, SurfaceRow
from .lanes import black, clipped, helper, ops
from .layered import mitsuba, povray

__all__ = ["mitsuba", "povray"]

MODEL = ir.MaterialModel.PRINCIPLED_SPECULAR
ELEMENTS: tuple[Element, ...] = ()
LOBES, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.FACETS | Lobes.BASE, ir.Slot.DIFFUSE, ir.Slot.SPECULAR, False
SLOTS = (*layered.SLOTS, ir.Slot.SPECULAR)
LOBE = None


@helper
def facets(p: FacetInputs) -> Facets:
    """f0 = SPECULAR."""
    base = ops.scale(clipped(p.color), (1.0 - p.metallic) * (1.0 - p.transmission))
    return Facets(base, clipped(p.specular), black(p.ior), p.coat)


def surface(row: SurfaceRow) -> Exported:
    return layered.surface(row, NOTHING, row.input(ir.Slot.SPECULAR))
