"""Thin translucent sheets: paper, cloth, leaves and lamp shades."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.scene.metallic_roughness import ALL, NOTHING
from ..compiler.scene.row_records import Input, MaterialData
from ..lang.schema.argument_types import Arg, Entry
from . import diffuse_transmission, losses
from .arguments import SURFACE
from .classic import NO_HIGHLIGHT
from .contract import Arguments, Element, Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.TRANSLUCENT


def _lower(arguments: Arguments) -> MaterialData:
    reflected, passed = arguments.color("color"), arguments.color("transmission")
    most = max((a + b for a, b in zip(reflected.value, passed.value, strict=True)), default=0.0)
    if reflected.texture < 0 and passed.texture < 0 and most > 1.0 + 1e-6:
        arguments.error(
            f"translucent: color and transmission are {most:.2g} together: a sheet sends on no more light than arrives",
            "their sum is at most 1 in red, green and blue",
        )
    both = Input(tuple(a + b for a, b in zip(reflected.value, passed.value, strict=True)))  # type: ignore[arg-type]
    ambient = both if reflected.texture < 0 and passed.texture < 0 else reflected
    return MaterialData(MODEL, {ir.Slot.AMBIENT: ambient, ir.Slot.DIFFUSE: reflected, ir.Slot.DIFFUSE_TRANSMISSION: passed})


ELEMENTS = (
    Element(
        Entry(
            "translucent",
            "material",
            "a thin sheet that light passes diffusely, as paper, cloth, leaves and lamp shades; both sides look alike",
            (
                Arg("color", "color_map", (0.45, 0.45, 0.45), "share of the light that it reflects diffusely"),
                Arg("transmission", "color_map", (0.45, 0.45, 0.45), "share of the light that leaves it diffusely on the other side"),
                *SURFACE,
            ),
            example="cylinder(0.15, 0.25, capped: false, material: translucent(#7a705c, transmission: #6a5c40))",
        ),
        _lower,
    ),
)
LOBE = diffuse_transmission
LOBES, SLOTS = Lobes.CLASSIC, (ir.Slot.AMBIENT, ir.Slot.DIFFUSE, ir.Slot.DIFFUSE_TRANSMISSION)
COLOR, REFLECTANCE, HALF_VECTOR = ir.Slot.DIFFUSE, None, False
facets = None


def surface(row: SurfaceRow) -> Exported:
    sheet = row.surface(row.input(ir.Slot.DIFFUSE), NOTHING, ALL, NO_HIGHLIGHT)
    return Exported(sheet, diffuse_transmission=row.input(ir.Slot.DIFFUSE_TRANSMISSION))


def mitsuba(row: MitsubaRow) -> Any:
    row.cannot(losses.DIFFUSE_TRANSMISSION)
    return row.two_sided(row.bsdf("diffuse", row.reflectance("reflectance")))


def povray(row: PovrayRow) -> Finish:
    """`diffuse` takes a second number for light from behind, of the same pigment."""
    reflected, passed = row.value(ir.Slot.DIFFUSE), row.value(ir.Slot.DIFFUSE_TRANSMISSION)
    behind = float(passed.mean() / max(reflected.mean(), 1e-6))
    alike = row.texture(ir.Slot.DIFFUSE) == row.texture(ir.Slot.DIFFUSE_TRANSMISSION)
    if not alike or np.ptp(passed - behind * reflected) > 1e-6:
        row.cannot(losses.DIFFUSE_TRANSMISSION_COLOR)
    return Finish(ir.Slot.DIFFUSE, f"diffuse 1, {row.numeral(behind)} ambient rgb <{row.vector(row.ambient)}>")
