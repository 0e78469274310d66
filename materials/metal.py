"""A metal by its measured index of refraction: SPECULAR is its reflectance at normal incidence, EDGE that at 81.8°, over Schlick's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.scene.metallic_roughness import ALL, GLASS
from ..compiler.scene.row_records import Input, MaterialData, multiply_colors
from ..lang.schema.argument_types import REQUIRED, Arg, Entry
from . import losses, openpbr
from .arguments import SHADING, SURFACE, roughness
from .contract import F64, Arguments, Element, Exported, FacetInputs, Facets, Finish, Lane, Lobes, MitsubaRow, PovrayRow, SurfaceRow
from .lanes import black, clipped, helper, ops
from .optics import metals
from .thresholds import LOWEST

MODEL = ir.MaterialModel.METAL
KINDS = ("gold", "silver", "copper", "aluminium", "iron", "steel", "titanium", "chromium", "chrome", "nickel")
_DIP = LOWEST * (1.0 - LOWEST) ** 6


def _lower(arguments: Arguments) -> MaterialData:
    f0, edge = metals.reflectance(arguments.args["kind"])
    color = arguments.color("color")
    inputs = {
        ir.Slot.SPECULAR: Input(multiply_colors(f0, color.value), color.texture),
        ir.Slot.EDGE: Input(edge),
        ir.Slot.ROUGHNESS: arguments.number("roughness"),
    }
    anisotropy = arguments.args["anisotropy"]
    if anisotropy == 0.0:
        if arguments.args["rotation"] is not None:
            arguments.error("metal: `rotation` is given without `anisotropy`", "give `anisotropy`, 0 to 1, or leave it out")
        return MaterialData(MODEL, inputs, arguments.shading)
    return _brushed(arguments, inputs)


def _brushed(arguments: Arguments, inputs: dict[ir.Slot, Input]) -> MaterialData:
    """Slabs of the metal alone: they have the same reflectance, by which SPECULAR is the tint at grazing angles."""
    if arguments.shading == ir.Shading.GOURAUD:
        arguments.error("metal: light of an anisotropic metal is computed at points", 'leave out `shading: "gouraud"`')
    turns = Input.number(0.0) if arguments.args["rotation"] is None else arguments.number("rotation")
    turned = {ir.Slot.ANISOTROPY: arguments.number("anisotropy"), ir.Slot.ROTATION: turns}
    shading = ir.Shading.SMOOTH if arguments.shading == ir.Shading.GOURAUD else arguments.shading
    return replace(slabs({**inputs, **turned}), shading=shading)


def slabs(inputs: Mapping[ir.Slot, Input]) -> MaterialData:
    """Slabs of a metal of these inputs."""
    others = {slot: entry for slot, entry in inputs.items() if slot not in (ir.Slot.SPECULAR, ir.Slot.EDGE)}
    base = {ir.Slot.METALLIC: Input.number(1.0), ir.Slot.DIFFUSE: inputs[ir.Slot.SPECULAR], ir.Slot.SPECULAR: inputs[ir.Slot.EDGE]}
    return openpbr.data({**others, **base})


ELEMENTS = (
    Element(
        Entry(
            "metal",
            "material",
            "a metal by its measured index of refraction, polished or rough",
            (
                Arg("kind", "choice", REQUIRED, "the metal; steel has the values of iron", choices=KINDS),
                roughness(0.1),
                Arg("color", "color_map", (1.0, 1.0, 1.0), "multiplies its reflectance", keyword=True),
                Arg(
                    "anisotropy", "number_map", 0.0, "0: round highlights, 1: lines, as of brushed metal", minimum=0.0, maximum=1.0,
                    keyword=True,
                ),
                Arg(
                    "rotation", "number_map", None,
                    "turns from the surface's u to the long side of the highlight, across the scratches; default 0", keyword=True,
                ),
                *SURFACE,
                SHADING,
            ),
            example='sphere(1, material: metal("gold", roughness: 0.2))',
        ),
        _lower,
    ),
)
LOBES, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.FACETS, ir.Slot.SPECULAR, ir.Slot.SPECULAR, False
SLOTS = (ir.Slot.SPECULAR, ir.Slot.EDGE, ir.Slot.ROUGHNESS)
LOBE = None


@helper
def facets(p: FacetInputs) -> Facets:
    """No base and no coat; f0 = SPECULAR."""
    f0 = clipped(p.specular)
    bend = _bend(f0[0], p.edge[0]), _bend(f0[1], p.edge[1]), _bend(f0[2], p.edge[2])
    return Facets(black(p.ior), f0, bend, 0.0 * p.ior)


@helper
def _bend(f0: Lane, edge: Lane) -> Lane:
    """The coefficient of the dip that leaves `edge` of Schlick's reflectance at LOWEST."""
    return (f0 + (1.0 - f0) * (1.0 - LOWEST) ** 5) * (1.0 - ops.clip(edge, 0.0, 1.0)) * (1.0 / _DIP)


def surface(row: SurfaceRow) -> Exported:
    row.note(losses.EDGE)
    return Exported(row.surface(row.input(ir.Slot.SPECULAR), ALL, row.input(ir.Slot.ROUGHNESS), GLASS))


def mitsuba(row: MitsubaRow) -> Any:
    if row.texture(ir.Slot.SPECULAR) >= 0:
        row.cannot(losses.texture(ir.Slot.SPECULAR))
    n, k = indices_of(row.value(ir.Slot.SPECULAR), row.value(ir.Slot.EDGE))
    return row.two_sided(row.bsdf("roughconductor", row.rgb("eta", n), row.rgb("k", k), row.alpha(), distribution="ggx"))


def povray(row: PovrayRow) -> Finish:
    row.cannot(losses.FACETS, "lambert(…), phong(…) or mirror(…) are")
    mirror = " reflection { rgb 1 metallic 1 }" if row.bounces > 0 else ""
    return Finish(ir.Slot.SPECULAR, f"diffuse 0 ambient rgb <0, 0, 0>{mirror}")


def indices_of(f0: F64, edge: F64) -> tuple[F64, F64]:
    """(n, k) of conductors with reflectance f0 along the normal and factor `edge` of Schlick's law at LOWEST.

    Nearest entry of a fine grid.
    """
    n = np.geomspace(0.01, 6.0, 400)
    nearest = np.zeros((2, 3))
    for channel in range(3):
        along = min(float(f0[channel]), 0.9999)
        k = np.sqrt(np.maximum((along * (n + 1.0) ** 2 - (n - 1.0) ** 2) / (1.0 - along), 0.0))
        wanted = (along + (1.0 - along) * (1.0 - LOWEST) ** 5) * float(edge[channel])
        off = np.abs(metals.conductor(n, k, LOWEST) - wanted) + np.abs(metals.conductor(n, k, 1.0) - along)
        best = int(np.argmin(off))
        nearest[:, channel] = n[best], k[best]
    return nearest[0], nearest[1]
