"""What the materials of the course share: diffuse and Phong lobes, a mirror and transmission, by k_a, k_d, k_s, k_r and k_t."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.scene.metallic_roughness import ALL, NOTHING
from ..compiler.scene.row_records import Input, MaterialData, scale_color
from ..lang.schema.argument_types import Arg, Entry
from . import losses
from .arguments import EMISSION, SHADING, SURFACE
from .contract import Arguments, Element, Exported, Finish, MitsubaRow, PovrayRow, Row, SurfaceRow

SLOTS = (
    ir.Slot.AMBIENT, ir.Slot.DIFFUSE, ir.Slot.SPECULAR, ir.Slot.SHININESS, ir.Slot.REFLECTION, ir.Slot.TRANSMISSION, ir.Slot.IOR,
    ir.Slot.EMISSION,
)  # fmt: skip
NO_HIGHLIGHT = Input.number(1.0)  # index of refraction without a reflectance
_GREY = 1e-9


def emitted(arguments: Arguments) -> dict[ir.Slot, Input]:
    """The input of what a surface emits; none of a dark one."""
    color = arguments.color("emission")
    if color.texture < 0 and max(color.value) <= 0.0:
        return {}
    return {ir.Slot.EMISSION: Input(scale_color(color.value, arguments.args["luminance"]), color.texture)}


def element(name: str, lobe: str, model: ir.MaterialModel) -> Element:
    """The element of a material with a highlight."""

    def lower(arguments: Arguments) -> MaterialData:
        diffuse = arguments.color("color")
        inputs = {
            ir.Slot.AMBIENT: diffuse if arguments.args["ambient"] is None else arguments.color("ambient"),
            ir.Slot.DIFFUSE: diffuse,
            ir.Slot.SPECULAR: arguments.color("specular"),
            ir.Slot.SHININESS: arguments.number("shininess"),
            ir.Slot.REFLECTION: arguments.color("reflection"),
            ir.Slot.TRANSMISSION: arguments.color("transmission"),
            ir.Slot.IOR: arguments.number("ior"),
            **emitted(arguments),
        }
        return MaterialData(model, inputs, arguments.shading, arguments.args["normalized"])

    entry = Entry(
        name,
        "material",
        f"the course's {lobe}: k_a L_a + Σ I (k_d max(0, N·L) + k_s lobe^n) + k_r reflected + k_t refracted",
        (
            Arg("color", "color_map", (0.8, 0.8, 0.8), "diffuse coefficient k_d", aliases=("k_d", "diffuse")),
            Arg("specular", "color_map", (0.5, 0.5, 0.5), "specular coefficient k_s", aliases=("k_s",)),
            Arg("shininess", "number_map", 32.0, "exponent n of the highlight", minimum=0.0),
            Arg("ambient", "color_map", None, "ambient coefficient k_a; default k_d", aliases=("k_a",), keyword=True),
            Arg("reflection", "color_map", (0.0, 0.0, 0.0), "mirror coefficient k_r", aliases=("k_r",), keyword=True),
            Arg("transmission", "color_map", (0.0, 0.0, 0.0), "refraction coefficient k_t", aliases=("k_t",), keyword=True),
            Arg("ior", "number_map", 1.5, "index of refraction for k_t", above=0.0, keyword=True),
            Arg("normalized", "bool", False, "scales the lobe so that it conserves energy", keyword=True),
            *EMISSION,
            *SURFACE,
            SHADING,
        ),
        example=f"sphere(1, material: {name}(#d0402a, specular: 0.4, shininess: 60))",
    )
    return Element(entry, lower)


def highlight_roughness(row: Row, exponent_scale: float) -> float | None:
    """The roughness of microfacets, α = roughness², whose highlight is as wide as that of k_s; None without a highlight.

    `exponent_scale` leads from the exponent to one of cosines of half vectors.
    """
    if exponent_scale <= 0.0 or row.value(ir.Slot.SPECULAR).max() <= 0:
        return None
    exponent = float(row.value(ir.Slot.SHININESS)[0]) * exponent_scale
    return (2.0 / (exponent + 2.0)) ** 0.25  # its square is the α of Walter et al. 2007, √(2 / (n + 2)) for half vectors


def surface(row: SurfaceRow, exponent_scale: float = 0.0) -> Exported:
    """A diffuse surface with the highlight of microfacets."""
    diffuse = row.input(ir.Slot.DIFFUSE)
    if row.value(ir.Slot.REFLECTION).max() > 0:
        row.cannot(losses.MIRROR, "mirror(…) is")
    if row.value(ir.Slot.TRANSMISSION).max() > 0:
        row.cannot(losses.TRANSMISSION, "glass(…) is")
    emissive = row.input(ir.Slot.EMISSION)
    rough = highlight_roughness(row, exponent_scale)
    if rough is None:
        return Exported(row.surface(diffuse, NOTHING, ALL, NO_HIGHLIGHT, emissive=emissive))
    row.note(losses.HIGHLIGHT)
    return Exported(row.surface(diffuse, NOTHING, Input.number(rough), Input.number(1.5), emissive=emissive))


def mitsuba(row: MitsubaRow, exponent_scale: float = 0.0) -> Any:
    """A diffuse BSDF, a plastic, a conductor, or a blend of diffuse and conductor."""
    mirror, diffuse = (float(row.value(slot).max()) for slot in (ir.Slot.REFLECTION, ir.Slot.DIFFUSE))
    rough = highlight_roughness(row, exponent_scale)
    if rough is not None and mirror > 0:
        row.cannot(losses.HIGHLIGHT_OF_MIRROR, "specular: 0, or lambert(…)")
    elif rough is not None:
        row.cannot(losses.HIGHLIGHT, "specular: 0, or lambert(…)")
    if row.value(ir.Slot.TRANSMISSION).max() > 0:
        row.cannot(losses.TRANSMISSION, "glass(…) is")
    if mirror > 0 and diffuse == 0:
        return row.two_sided(conductor(row))
    if mirror > 0:
        return row.two_sided(_mix(row, mirror, diffuse))
    if rough is not None:  # it reflects 4 % along the normal, as microfacets of glTF do
        plastic = {"distribution": "ggx", "int_ior": 1.5, "ext_ior": 1.0, "alpha": rough**2}
        return row.two_sided(row.bsdf("roughplastic", row.reflectance("diffuse_reflectance"), **plastic))
    return row.two_sided(row.bsdf("diffuse", row.reflectance("reflectance")))


def conductor(row: MitsubaRow, scale: float = 1.0) -> Any:
    """A mirror of the colour k_r."""
    return row.bsdf("conductor", row.color("specular_reflectance", ir.Slot.REFLECTION, scale), material="none")


def _mix(row: MitsubaRow, mirror: float, diffuse: float) -> Any:
    """k_d and k_r together: a blend of two BSDFs, each divided by its weight.

    Mitsuba 3.9 weights light seen by the mirror as if it were diffuse (its blendbsdf loses that the sample was discrete). Measured:
    a fifth darker than each BSDF alone. So the two renderers differ.
    """
    row.cannot(losses.BOTH)
    share = mirror / max(mirror + diffuse, 1.0)
    layers = row.bsdf("diffuse", row.reflectance("reflectance", 1.0 / (1.0 - share))), conductor(row, 1.0 / share)
    return row.bsdf("blendbsdf", *layers, weight=share)


def povray(row: PovrayRow, highlight: tuple[str, str] = ("", ""), size: float = 0.0) -> Finish:
    """A finish whose highlight, if it has one, is POV-Ray's of these words, with a size."""
    words = ["diffuse 1", f"ambient rgb <{row.vector(_ambient(row))}>"]
    mirror = row.value(ir.Slot.REFLECTION)
    if mirror.max() > 0 and row.bounces > 0:
        words.append(f"reflection {{ rgb <{row.vector(mirror)}> }}")
    strength = row.value(ir.Slot.SPECULAR)
    if highlight[0] and strength.max() > 0:
        if np.ptp(strength) > _GREY:
            row.cannot(losses.HIGHLIGHT_COLOR)
        if row.normalized:
            row.cannot(losses.NORMALIZED, "normalized: false")
        words.append(f"{highlight[0]} {row.numeral(float(strength.mean()))} {highlight[1]} {row.numeral(size)}")
    if row.value(ir.Slot.TRANSMISSION).max() > 0:
        row.cannot(losses.TRANSMISSION, "glass(…) is")
    if row.value(ir.Slot.EMISSION).max() > 0:
        row.cannot(losses.EMISSION)
    return Finish(ir.Slot.DIFFUSE, " ".join(words))


def _ambient(row: PovrayRow) -> np.ndarray:
    """k_a L_a divided by the pigment, by which POV-Ray multiplies."""
    wanted, diffuse = row.value(ir.Slot.AMBIENT) * row.ambient, row.value(ir.Slot.DIFFUSE)
    if not wanted.any():
        return np.zeros(3)
    alike = row.texture(ir.Slot.AMBIENT) == row.texture(ir.Slot.DIFFUSE)
    if not alike or np.any((diffuse == 0) & (wanted > 0)):
        row.cannot(losses.AMBIENT)
    return np.where(diffuse > 0, wanted / np.where(diffuse > 0, diffuse, 1.0), 0.0)
