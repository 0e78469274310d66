"""A diffuse surface: the albedo of a matt one, with the other coefficients of the course 0 in scenes, and as read in files."""

from __future__ import annotations

from ..compiler import ir
from ..compiler.scene.row_records import MaterialData
from ..lang.schema.argument_types import Arg, Entry
from . import classic
from .arguments import EMISSION, SHADING, SURFACE
from .classic import mitsuba, povray, surface
from .contract import Arguments, Element, Lobes

__all__ = ["mitsuba", "povray", "surface"]

MODEL = ir.MaterialModel.LAMBERT


def _lower(arguments: Arguments) -> MaterialData:
    diffuse = arguments.color("color")
    return MaterialData(MODEL, {ir.Slot.AMBIENT: diffuse, ir.Slot.DIFFUSE: diffuse, **classic.emitted(arguments)}, arguments.shading)


ELEMENTS = (
    Element(
        Entry(
            "lambert",
            "material",
            "matt: L = ρE/π",
            (Arg("color", "color_map", (0.8, 0.8, 0.8), "albedo ρ"), *EMISSION, *SURFACE, SHADING),
            example="lambert(#c9c4bb)",
        ),
        _lower,
    ),
)
LOBES, SLOTS, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.CLASSIC, classic.SLOTS, ir.Slot.DIFFUSE, None, False
LOBE = facets = None
