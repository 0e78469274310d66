"""Bodies that light enters and leaves diffusely, and scatters in: wax, marble, skin and soap.

The medium inside is found from the colour of the body by albedo inversion, in `subsurface_inversion`. Where the colour varies, that of the
point where a path enters counts until it leaves (Cycles likewise).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.scene.metallic_roughness import ALL, NOTHING
from ..compiler.scene.row_records import WHITE, Color, Input, MaterialData, MediumData, as_color, scale_color
from ..lang.schema.argument_types import Arg, Entry
from . import diffuse_transmission, losses, subsurface_inversion
from .arguments import SURFACE
from .classic import NO_HIGHLIGHT
from .contract import Arguments, Element, Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.SUBSURFACE
MIDDLE = (0.5, 0.5, 0.5)
IOR, ROUGHNESS = 1.5, 0.5  # of a highlight, where one of them is given


def coefficients(color: Color, radius: Color) -> tuple[Color, Color]:
    """(scattering, absorption) per metre of a body with a diffuse colour and a radius (metres), both by channel."""
    extinction, scattering = subsurface_inversion.channel(np.array(color), np.array(radius))
    return as_color(scattering), as_color(extinction - scattering)


def of_free_path(color: Color, lengths: Color, anisotropy: float = 0.0) -> tuple[Color, Color]:
    """(scattering, absorption) per metre of a body of OpenPBR and MaterialX, whose lengths are mean free paths in metres, by channel.

    The albedo of single scattering follows from the colour and the mean cosine of the phase function: OpenPBR Surface 1.1, Subsurface.
    """
    plain = subsurface_inversion.single_albedo(np.clip(np.array(color), 0.0, 1.0))
    albedo = plain / (1.0 - anisotropy * (1.0 - plain))
    extinction = 1.0 / np.maximum(np.array(lengths), subsurface_inversion.LEAST_RADIUS)
    return as_color(albedo * extinction), as_color((1.0 - albedo) * extinction)


def radius_of_free_path(lengths: Color, color: Color = MIDDLE) -> Color:
    """The radius of a body by its mean free paths. Those of a body whose colour varies are those of a `color` of ½."""
    return as_color(np.array(lengths) / subsurface_inversion.mean_free_path(np.array(color)))


def radius(tables: ir.Tables, row: int) -> np.ndarray:
    """(3,) the radius in metres of a body, without the factor RADIUS of its material: the inverse of `coefficients`."""
    m, media = tables.materials, tables.media
    extinction = media.scattering[m.medium[row]] + media.absorption[m.medium[row]]
    lengths = 1.0 / (np.maximum(extinction, 1e-30) * subsurface_inversion.mean_free_path(np.clip(m.values[row, ir.Slot.AMBIENT], 0.0, 1.0)))
    return lengths / m.values[row, ir.Slot.RADIUS, 0]


def _lower(arguments: Arguments) -> MaterialData:
    color, factor = arguments.color("color"), arguments.number("scale")
    scattering, absorption = coefficients(color.value, scale_color(arguments.args["radius"], factor.value[0]))
    medium = arguments.medium(MediumData(scattering, absorption, priority=arguments.args["priority"]))
    inputs = {ir.Slot.AMBIENT: color, ir.Slot.DIFFUSE_TRANSMISSION: Input(WHITE), ir.Slot.RADIUS: factor}
    if {"roughness", "ior"} & {name for name in ("roughness", "ior") if arguments.args[name] is not None}:
        inputs |= {ir.Slot.IOR: _number(arguments, "ior", IOR), ir.Slot.ROUGHNESS: _number(arguments, "roughness", ROUGHNESS)}
    return MaterialData(MODEL, inputs, medium=medium)


def _number(arguments: Arguments, name: str, default: float) -> Input:
    return Input.number(default) if arguments.args[name] is None else arguments.number(name)


ELEMENTS = (
    Element(
        Entry(
            "subsurface",
            "material",
            "a body that light enters, scatters in and leaves elsewhere, as wax, marble, skin and soap; for closed shapes",
            (
                Arg("color", "color_map", (0.8, 0.8, 0.8), "its colour: the share of the light that leaves a thick body of it"),
                Arg("radius", "size3", (0.01, 0.01, 0.01), "how far light goes below its surface: red, green, blue", above=0.0),
                Arg("scale", "number_map", 1.0, "factor of `radius`: a picture or a pattern makes it vary", above=0.0, keyword=True),
                Arg(
                    "roughness", "number_map", None, "of its highlight: 0 polished, 1 rough; default with `ior` 0.5, else no highlight",
                    minimum=0.0, maximum=1.0, keyword=True,
                ),
                Arg(
                    "ior", "number_map", None, "index of refraction of its highlight; default with `roughness` 1.5, else no highlight",
                    above=0.0, keyword=True,
                ),
                Arg("priority", "number", 0.0, "where bodies overlap, the one of the highest priority counts", minimum=0.0, keyword=True),
                *SURFACE,
            ),
            example="sphere(5cm, material: subsurface(#e8d8b8, radius: [8mm, 5mm, 3mm]))",
        ),
        _lower,
    ),
)
LOBE = diffuse_transmission
LOBES, SLOTS = Lobes.CLASSIC, (ir.Slot.AMBIENT, ir.Slot.DIFFUSE_TRANSMISSION, ir.Slot.RADIUS, ir.Slot.IOR, ir.Slot.ROUGHNESS)
COLOR, REFLECTANCE, HALF_VECTOR = ir.Slot.AMBIENT, None, False
facets = None


def diffuse_substitute(tables: ir.Tables) -> ir.Tables:
    """The tables with surfaces of their colour in place of bodies, for rays that do not scatter in media: diffuse ones, and under a
    highlight those of `principled`."""
    tables = _without_slab_bodies(tables)
    m = tables.materials
    bodies = m.model == MODEL
    if not bodies.any():
        return tables
    shiny = bodies & ((m.values[:, ir.Slot.IOR, 0] != 1.0) | (m.textures[:, ir.Slot.IOR] >= 0))
    model, values, textures, medium = m.model.copy(), m.values.copy(), m.textures.copy(), m.medium.copy()
    model[bodies], model[shiny], medium[bodies] = ir.MaterialModel.LAMBERT, ir.MaterialModel.PRINCIPLED, -1
    values[bodies, ir.Slot.DIFFUSE] = values[bodies, ir.Slot.AMBIENT]
    textures[bodies, ir.Slot.DIFFUSE] = textures[bodies, ir.Slot.AMBIENT]
    values[shiny, ir.Slot.AMBIENT], textures[shiny, ir.Slot.AMBIENT] = 1.0, -1  # of `principled` its occlusion
    values[bodies, ir.Slot.DIFFUSE_TRANSMISSION] = 0.0
    return tables._replace(materials=m._replace(model=model, values=values, textures=textures, medium=medium))


def _without_slab_bodies(tables: ir.Tables) -> ir.Tables:
    """Likewise of slabs, whose diffuse colour is a mix of that of the base and that of the body."""
    m, slot = tables.materials, ir.Slot
    share = m.values[:, slot.SUBSURFACE_WEIGHT, :1]
    bodies = (m.model == ir.MaterialModel.OPENPBR) & (m.medium >= 0) & (share[:, 0] > 0.0)
    if not bodies.any():
        return tables
    values, medium = m.values.copy(), np.where(bodies, -1, m.medium).astype(m.medium.dtype)
    base = values[:, slot.DIFFUSE] * values[:, slot.BASE_WEIGHT, :1]
    values[bodies, slot.DIFFUSE] = ((1.0 - share) * base + share * values[:, slot.SUBSURFACE_COLOR])[bodies]
    values[bodies, slot.BASE_WEIGHT], values[bodies, slot.SUBSURFACE_WEIGHT] = 1.0, 0.0
    return tables._replace(materials=m._replace(values=values, medium=medium))


def surface(row: SurfaceRow) -> Exported:
    if row.value(ir.Slot.IOR)[0] == 1.0 and row.texture(ir.Slot.IOR) < 0:
        return Exported(row.surface(row.input(ir.Slot.AMBIENT), NOTHING, ALL, NO_HIGHLIGHT), body=True)
    return Exported(row.surface(row.input(ir.Slot.AMBIENT), NOTHING, row.input(ir.Slot.ROUGHNESS), row.ior), body=True)


def mitsuba(row: MitsubaRow) -> Any:
    row.cannot(losses.SUBSURFACE)
    return row.two_sided(row.bsdf("diffuse", row.color("reflectance", ir.Slot.AMBIENT)))


def povray(row: PovrayRow) -> Finish:
    row.cannot(losses.SUBSURFACE)
    return Finish(ir.Slot.AMBIENT, f"diffuse 1 ambient rgb <{row.vector(row.ambient)}>")
