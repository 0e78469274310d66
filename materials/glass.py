"""Glass: reflects and refracts by Fresnel's equations; ABSORPTION holds inside of it, PRIORITY decides where glasses overlap."""

from __future__ import annotations

import math
from typing import Any

from ..compiler import ir
from ..compiler.scene.metallic_roughness import NOTHING
from ..compiler.scene.row_records import BLACK, Color, Input, MaterialData, as_color
from ..lang.schema.argument_types import Arg, Entry
from . import losses
from .arguments import SURFACE, roughness
from .contract import Arguments, Element, Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.GLASS
DARKEST = 1e-6  # least component of a colour inside glass: 0 has infinite absorption
KHRONOS = 20.0  # over the Abbe number: the measure of dispersion of KHR_materials_dispersion and OpenPBR
LINES = 0.4861327, 0.5875618, 0.6562725  # µm: F, d and C, by which the Abbe number is defined
VIOLET, RED = 0.40, 0.70  # µm: the ends of POV-Ray's spectrum
MOST_DISPERSION = 4.0
DEPTH = 0.1  # metres, that the colour inside refers to by default


def _lower(arguments: Arguments) -> MaterialData:
    inputs = {ir.Slot.TRANSMISSION: arguments.color("color"), ir.Slot.IOR: arguments.number("ior")}
    inputs[ir.Slot.ROUGHNESS] = arguments.number("roughness")
    inputs[ir.Slot.PRIORITY] = Input.number(arguments.args["priority"])
    inputs[ir.Slot.ABSORPTION] = Input(_absorption(arguments))
    inputs[ir.Slot.DISPERSION] = Input.number(arguments.args["dispersion"])
    return MaterialData(MODEL, inputs)


def _absorption(arguments: Arguments) -> Color:
    """The absorption coefficient per metre: white light has the colour `inside` after `depth`."""
    color, depth = arguments.args["inside"], arguments.args["depth"]
    if color is None:
        if depth is not None:
            arguments.error("`depth` is given without `inside`", "give `inside`, the colour at that depth, or leave it out")
        return BLACK
    r, g, b = (-math.log(max(c, DARKEST)) / (DEPTH if depth is None else depth) + 0.0 for c in color)
    return (max(r, 0.0), max(g, 0.0), max(b, 0.0))


ELEMENTS = (
    Element(
        Entry(
            "glass",
            "material",
            "glass: reflects and refracts by Fresnel's and Snell's laws, polished or rough",
            (
                Arg("color", "color_map", (1.0, 1.0, 1.0), "its transmittance"),
                Arg("ior", "number_map", 1.5, "index of refraction", above=0.0, keyword=True),
                roughness(0.0),
                Arg(
                    "dispersion", "number", 0.0, "20 over the Abbe number: crown glass 0.31, diamond 0.36, flint glass 0.56; 0: none",
                    minimum=0.0, maximum=MOST_DISPERSION, keyword=True,
                ),
                Arg("inside", "color", None, "transmittance of the length `depth` inside of it (Beer-Lambert law)", keyword=True),
                Arg("depth", "length", None, "length that `inside` refers to; default 10 cm", above=0.0, keyword=True),
                Arg("priority", "number", 0.0, "where glasses overlap, the one of the highest priority counts", minimum=0.0, keyword=True),
                *SURFACE,
            ),
        ),
        _lower,
    ),
)
LOBES, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.GLASS, ir.Slot.TRANSMISSION, None, False
SLOTS = (ir.Slot.TRANSMISSION, ir.Slot.IOR, ir.Slot.ROUGHNESS, ir.Slot.ABSORPTION, ir.Slot.PRIORITY, ir.Slot.DISPERSION)
LOBE = facets = None


def slope(dispersion: Any) -> Any:
    """The change of n over n − 1 by 1 / λ², µm², of glass whose Abbe number is 20 over `dispersion`."""
    short, _, long = LINES
    return dispersion / KHRONOS / (short**-2 - long**-2)


def index_at(ior: float, dispersion: float, wave: float) -> float:
    """The index at a wavelength in µm, by Cauchy's equation with two terms; `ior` is that at the line d."""
    return ior + (ior - 1.0) * slope(dispersion) * (wave**-2 - LINES[1] ** -2)


def surface(row: SurfaceRow) -> Exported:
    if row.value(ir.Slot.DISPERSION)[0] > 0:
        row.cannot(losses.DISPERSION)
    exported = row.surface(row.input(ir.Slot.TRANSMISSION), NOTHING, row.input(ir.Slot.ROUGHNESS), row.ior)
    return Exported(exported, 1.0, as_color(row.value(ir.Slot.ABSORPTION)))


def mitsuba(row: MitsubaRow) -> Any:
    row.reports_colors()
    if row.texture(ir.Slot.IOR) >= 0:
        row.cannot(losses.texture(ir.Slot.IOR))
    if row.value(ir.Slot.ABSORPTION).max() > 0:
        row.cannot(losses.ABSORPTION)
    if row.value(ir.Slot.DISPERSION)[0] > 0:
        row.cannot(losses.DISPERSION)
    color, ior = row.color("specular_transmittance", ir.Slot.TRANSMISSION), float(row.value(ir.Slot.IOR)[0])
    if row.value(ir.Slot.ROUGHNESS)[0] > 0:
        return row.bsdf("roughdielectric", row.alpha(), color, distribution="ggx", int_ior=ior, ext_ior=1.0)
    if ior == 1.0:
        row.cannot(losses.CLEAR_GLASS)
        ior = 1.000001
    return row.bsdf("dielectric", color, int_ior=ior, ext_ior=1.0)


def povray(row: PovrayRow) -> Finish:
    if row.texture(ir.Slot.TRANSMISSION) >= 0:
        row.cannot(losses.texture(ir.Slot.TRANSMISSION))
    if row.value(ir.Slot.ROUGHNESS)[0] > 0:
        row.cannot(losses.ROUGH_GLASS)
    if row.value(ir.Slot.ABSORPTION).max() > 0:
        row.cannot(losses.ABSORPTION)
    words = "ambient 0 diffuse 0 reflection { rgb 0, rgb 1 fresnel on } conserve_energy"
    ior, dispersion = float(row.value(ir.Slot.IOR)[0]), float(row.value(ir.Slot.DISPERSION)[0])
    interior = f"ior {row.numeral(ior)}"
    if dispersion > 0.0:  # POV-Ray asks for the index of violet light over that of red light
        interior += f" dispersion {row.numeral(index_at(ior, dispersion, VIOLET) / index_at(ior, dispersion, RED))}"
    return Finish(ir.Slot.TRANSMISSION, words, interior, filters=True)
