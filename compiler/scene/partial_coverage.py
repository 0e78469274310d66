"""Opacity of materials, on one way for all formats: camera rays, shadow rays and photons meet the same share of a surface.

Constant or textured, it ends in the input OPACITY by `with_opacity`; a threshold makes a cut-out of it.

An opacity covers highlights, too. Formats that keep the highlight of a clear surface (UsdPreviewSurface's mode `transparent`, MTL) get one
that is stronger by the inverse. No highlight reflects more light than the surface covers: a clear surface covers its highlight's share, at
most CLEAR.
"""

from __future__ import annotations

from dataclasses import replace

from .. import ir
from .row_records import WHITE, Color, Input, MaterialData, scale_color

OPAQUE = Input.number(1.0)
CLEAR = 0.08  # reflectance along the normal that a clear surface keeps at most: that of an index of refraction of 1.8


def with_opacity(material: MaterialData, opacity: Input, threshold: float = 0.0) -> MaterialData:
    """A material with an opacity, 0 to 1, of the whole surface, highlights too; above 0 the threshold makes a cut-out of it."""
    if opacity == OPAQUE:
        return material
    return replace(material, inputs={**material.inputs, ir.Slot.OPACITY: opacity}, threshold=threshold)


def cover(opacity: float, highlight: float = 0.0) -> float:
    """The share of light that meets a surface of an opacity, 0 to 1, with a highlight of this reflectance along the normal."""
    return max(min(max(opacity, 0.0), 1.0), min(highlight, CLEAR))


def stronger(opacity: Input, share: float, most: float = 1.0) -> Input:
    """An input of a surface that covers `share`, so that the whole has the input itself, or as much of it as fits below `most`."""
    if share <= 0.0:
        return opacity
    r, g, b = (min(c / share, most) for c in opacity.value)
    return Input((r, g, b), opacity.texture)


def passing(material: MaterialData, opacity: Input, tint: Color = WHITE) -> MaterialData:
    """A classic material of which 1 − `opacity` of the light, times `tint`, passes straight; highlights and emission stay.

    Where the opacity has a texture, they fade with it.

    What a coloured tint lets pass of some colours alone is refraction with an index of 1. Shadow rays do not pass it: they carry one number
    for all colours. So the shadow is grey, as dark as that of the darkest colour.
    """
    if opacity.value[0] >= 1.0:
        return with_opacity(material, opacity)
    inputs, constant = material.inputs, opacity.value[0]
    clear = scale_color(tint, 1.0 - min(max(constant, 0.0), 1.0))
    grey = min(clear)
    highlights = [inputs[slot] for slot in (ir.Slot.SPECULAR, ir.Slot.REFLECTION) if slot in inputs]
    share = cover(1.0 - grey, max((max(h.value) for h in highlights), default=0.0))
    covered = dict(inputs)
    for slot in (ir.Slot.DIFFUSE, ir.Slot.AMBIENT):
        if slot in covered:
            covered[slot] = replace(covered[slot], value=scale_color(covered[slot].value, constant / share if share > 0.0 else 0.0))
    for slot in (ir.Slot.SPECULAR, ir.Slot.REFLECTION, ir.Slot.EMISSION):
        if slot in covered:
            covered[slot] = stronger(covered[slot], share, float("inf"))
    if share > 0.0 and max(clear) > grey:
        r, g, b = ((c - grey) / share for c in clear)
        covered |= {ir.Slot.TRANSMISSION: Input((r, g, b)), ir.Slot.IOR: Input.number(1.0)}
    return with_opacity(replace(material, inputs=covered), Input.number(share, opacity.texture))
