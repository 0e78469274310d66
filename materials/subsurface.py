"""Bodies that light enters and leaves diffusely, and scatters in: wax, marble, skin and soap.

The medium inside is found from the colour of the body by albedo inversion: Chiang, Kutz and Burley 2016, Practical and Controllable
Subsurface Scattering for Production Path Tracing.
"""

from __future__ import annotations

import math
from typing import Any

from ..compiler import ir
from ..compiler.scene.metallic_roughness import ALL, NOTHING
from ..compiler.scene.row_records import WHITE, Color, Input, MaterialData, MediumData
from ..lang.schema.argument_types import Arg, Entry
from . import diffuse_transmission, losses
from .arguments import SURFACE
from .classic import NO_HIGHLIGHT
from .contract import Arguments, Element, Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.SUBSURFACE


def coefficients(color: Color, radius: Color) -> tuple[Color, Color]:
    """(scattering, absorption) per metre of a body with a diffuse colour and a radius (metres), both by channel."""
    channels = [_channel(min(max(c, 0.0), 1.0), r) for c, r in zip(color, radius, strict=True)]
    (sr, ar), (sg, ag), (sb, ab) = channels
    return (sr, sg, sb), (ar, ag, ab)


def _channel(color: float, radius: float) -> tuple[float, float]:
    """Equations 7 and 8 of the paper: the albedo of single scattering, and the mean free path over the radius."""
    albedo = 1.0 - math.exp(color * (-5.09406 + color * (2.61188 - color * 4.31805)))
    extinction = 1.0 / (radius * (1.9 - color + 3.5 * (color - 0.8) ** 2))
    return albedo * extinction, (1.0 - albedo) * extinction


def _lower(arguments: Arguments) -> MaterialData:
    color = arguments.args["color"]
    scattering, absorption = coefficients(color, arguments.args["radius"])
    medium = arguments.medium(MediumData(scattering, absorption, priority=arguments.args["priority"]))
    return MaterialData(MODEL, {ir.Slot.AMBIENT: Input(color), ir.Slot.DIFFUSE_TRANSMISSION: Input(WHITE)}, medium=medium)


ELEMENTS = (
    Element(
        Entry(
            "subsurface",
            "material",
            "a body that light enters, scatters in and leaves elsewhere, as wax, marble, skin and soap; for closed shapes",
            (
                Arg("color", "color", (0.8, 0.8, 0.8), "its colour: the share of the light that leaves a thick body of it"),
                Arg("radius", "size3", (0.01, 0.01, 0.01), "how far light goes below its surface: red, green, blue", above=0.0),
                Arg("priority", "number", 0.0, "where bodies overlap, the one of the highest priority counts", minimum=0.0, keyword=True),
                *SURFACE,
            ),
            example="sphere(5cm, material: subsurface(#e8d8b8, radius: [8mm, 5mm, 3mm]))",
        ),
        _lower,
    ),
)
LOBE = diffuse_transmission
LOBES, SLOTS = Lobes.CLASSIC, (ir.Slot.AMBIENT, ir.Slot.DIFFUSE_TRANSMISSION)
COLOR, REFLECTANCE, HALF_VECTOR = ir.Slot.AMBIENT, None, False
facets = None


def diffuse_substitute(tables: ir.Tables) -> ir.Tables:
    """The tables with diffuse surfaces of their colour in place of bodies, for rays that do not scatter in media."""
    m = tables.materials
    bodies = m.model == MODEL
    if not bodies.any():
        return tables
    model, values, medium = m.model.copy(), m.values.copy(), m.medium.copy()
    model[bodies], medium[bodies] = ir.MaterialModel.LAMBERT, -1
    values[bodies, ir.Slot.DIFFUSE] = values[bodies, ir.Slot.AMBIENT]
    values[bodies, ir.Slot.DIFFUSE_TRANSMISSION] = 0.0
    return tables._replace(materials=m._replace(model=model, values=values, medium=medium))


def surface(row: SurfaceRow) -> Exported:
    return Exported(row.surface(row.input(ir.Slot.AMBIENT), NOTHING, ALL, NO_HIGHLIGHT), body=True)


def mitsuba(row: MitsubaRow) -> Any:
    row.cannot(losses.SUBSURFACE)
    return row.two_sided(row.bsdf("diffuse", row.color("reflectance", ir.Slot.AMBIENT)))


def povray(row: PovrayRow) -> Finish:
    row.cannot(losses.SUBSURFACE)
    return Finish(ir.Slot.AMBIENT, f"diffuse 1 ambient rgb <{row.vector(row.ambient)}>")
