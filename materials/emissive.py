"""A surface that emits light, and reflects none: EMISSION is its radiance."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.scene.metallic_roughness import ALL, DARK, NOTHING
from ..compiler.scene.row_records import Input, MaterialData, scale_color
from ..lang.schema.argument_types import Arg, Entry
from .arguments import OPACITY
from .classic import NO_HIGHLIGHT
from .contract import Arguments, Element, Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.EMISSIVE


def _lower(arguments: Arguments) -> MaterialData:
    color = arguments.color("color")
    return MaterialData(MODEL, {ir.Slot.EMISSION: Input(scale_color(color.value, arguments.args["luminance"]), color.texture)})


ELEMENTS = (
    Element(
        Entry(
            "emissive",
            "material",
            "emits light",
            (
                Arg("color", "color_map", (1.0, 1.0, 1.0), "its colour"),
                Arg("luminance", "luminance", 1.0, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
                *OPACITY,
            ),
        ),
        _lower,
    ),
)
LOBES, SLOTS, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.EMISSION, (ir.Slot.EMISSION,), ir.Slot.EMISSION, None, False
LOBE = facets = None


def surface(row: SurfaceRow) -> Exported:
    return Exported(row.surface(DARK, NOTHING, ALL, NO_HIGHLIGHT, emissive=row.input(ir.Slot.EMISSION)))


def mitsuba(row: MitsubaRow) -> Any:
    return row.two_sided(row.bsdf("diffuse", row.rgb("reflectance", np.zeros(3))))


def povray(row: PovrayRow) -> Finish:
    return Finish(ir.Slot.EMISSION, "ambient 0 diffuse 0 emission 1")
