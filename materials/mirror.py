"""A perfect mirror: REFLECTION is its reflectance."""

from __future__ import annotations

from typing import Any

from ..compiler import ir
from ..compiler.scene.metallic_roughness import ALL, GLASS, NOTHING
from ..compiler.scene.row_records import MaterialData
from ..lang.schema.argument_types import Arg, Entry
from . import classic
from .arguments import SURFACE
from .contract import Arguments, Element, Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.MIRROR


def _lower(arguments: Arguments) -> MaterialData:
    return MaterialData(MODEL, {ir.Slot.REFLECTION: arguments.color("color")})


ELEMENTS = (
    Element(
        Entry("mirror", "material", "a perfect mirror", (Arg("color", "color_map", (1.0, 1.0, 1.0), "its reflectance"), *SURFACE)), _lower
    ),
)
LOBES, SLOTS, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.MIRROR, (ir.Slot.REFLECTION,), ir.Slot.REFLECTION, None, False
LOBE = facets = None


def surface(row: SurfaceRow) -> Exported:
    return Exported(row.surface(row.input(ir.Slot.REFLECTION), ALL, NOTHING, GLASS))


def mitsuba(row: MitsubaRow) -> Any:
    row.reports_colors()
    return row.two_sided(classic.conductor(row))


def povray(row: PovrayRow) -> Finish:
    words = ["diffuse 0", "ambient rgb <0, 0, 0>"]
    if row.bounces > 0 and row.value(ir.Slot.REFLECTION).max() > 0:
        words.append(f"reflection {{ rgb <{row.vector(row.value(ir.Slot.REFLECTION))}> }}")
    return Finish(None, " ".join(words))
