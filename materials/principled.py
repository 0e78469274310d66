"""UsdPreviewSurface, its metallic workflow: the reflectance follows from IOR and METALLIC. Its element makes both workflows."""

from __future__ import annotations

from ..compiler import ir
from ..compiler.scene.row_records import Input, MaterialData, scale_color
from ..lang.schema.argument_types import Arg, Entry
from . import layered
from .arguments import SHADING, SURFACE, roughness
from .contract import Arguments, Element, Exported, FacetInputs, Facets, Lobes, SurfaceRow
from .lanes import black, clipped, helper, ops
from .layered import mitsuba, povray

__all__ = ["mitsuba", "povray"]

MODEL = ir.MaterialModel.PRINCIPLED


def _lower(arguments: Arguments) -> MaterialData:
    color = arguments.color("emission")
    inputs = {
        ir.Slot.AMBIENT: arguments.number("occlusion"),
        ir.Slot.DIFFUSE: arguments.color("color"),
        ir.Slot.ROUGHNESS: arguments.number("roughness"),
        ir.Slot.IOR: arguments.number("ior"),
        ir.Slot.METALLIC: arguments.number("metallic"),
        ir.Slot.COAT: arguments.number("clearcoat"),
        ir.Slot.COAT_ROUGHNESS: arguments.number("clearcoat_roughness"),
        ir.Slot.SHEEN: arguments.color("sheen"),
        ir.Slot.SHEEN_ROUGHNESS: arguments.number("sheen_roughness"),
        ir.Slot.EMISSION: Input(scale_color(color.value, arguments.args["luminance"]), color.texture),
    }
    if arguments.args["specular"] is None:
        return MaterialData(MODEL, inputs, arguments.shading)
    inputs[ir.Slot.SPECULAR] = arguments.color("specular")
    return MaterialData(ir.MaterialModel.PRINCIPLED_SPECULAR, inputs, arguments.shading)


ELEMENTS = (
    Element(
        Entry(
            "principled",
            "material",
            "UsdPreviewSurface: a diffuse or metallic base, a microfacet specular lobe, a clear coat; conserves energy",
            (
                Arg("color", "color_map", (0.18, 0.18, 0.18), "base colour; of metals, their reflectance", aliases=("diffuse",)),
                Arg("metallic", "number_map", 0.0, "0: dielectric, 1: metal", minimum=0.0, maximum=1.0, keyword=True),
                roughness(0.5),
                Arg("ior", "number_map", 1.5, "index of refraction, which sets the reflectance of a dielectric", above=0.0, keyword=True),
                Arg("specular", "color_map", None, "reflectance at normal incidence, in place of `ior` and `metallic`", keyword=True),
                Arg("clearcoat", "number_map", 0.0, "weight of the clear coat", minimum=0.0, maximum=1.0, keyword=True),
                Arg("sheen", "color_map", (0.0, 0.0, 0.0), "colour of the sheen of cloth, at grazing angles", keyword=True),
                Arg("sheen_roughness", "number_map", 0.3, "roughness of the sheen", minimum=0.0, maximum=1.0, keyword=True),
                Arg("clearcoat_roughness", "number_map", 0.01, "roughness of the clear coat", minimum=0.0, maximum=1.0, keyword=True),
                Arg("occlusion", "number_map", 1.0, "share of the ambient light that reaches it", minimum=0.0, maximum=1.0, keyword=True),
                Arg("emission", "color_map", (0.0, 0.0, 0.0), "emitted colour", aliases=("emissive",), keyword=True),
                Arg("luminance", "luminance", 1.0, "nit where `emission` is 1", aliases=("radiance",), minimum=0.0, keyword=True),
                *SURFACE,
                SHADING,
            ),
            exclusive=(("specular", "metallic"), ("specular", "ior")),
            example="sphere(1, material: principled(#a02818, roughness: 0.4, clearcoat: 1))",
        ),
        _lower,
    ),
)
LOBES, SLOTS, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.FACETS | Lobes.BASE, layered.SLOTS, ir.Slot.DIFFUSE, None, False
LOBE = None


@helper
def facets(p: FacetInputs) -> Facets:
    """f0 = ((ior − 1) / (ior + 1))² (1 − metallic) + colour metallic; a metal has no base."""
    boundary = (p.ior - 1.0) / (p.ior + 1.0)
    grey = boundary * boundary
    base = ops.scale(clipped(p.color), (1.0 - p.metallic) * (1.0 - p.transmission))
    return Facets(base, clipped(ops.lerp3((grey, grey, grey), p.color, p.metallic)), black(p.ior), p.coat)


def surface(row: SurfaceRow) -> Exported:
    return layered.surface(row, row.input(ir.Slot.METALLIC))
