"""Metallic–roughness surfaces (UsdPreviewSurface, glTF) as the models there are: a normalised Blinn–Phong lobe over a matt base."""

from __future__ import annotations

from dataclasses import dataclass

from . import ir
from .rows import BLACK, WHITE, Color, Input, MaterialData, scaled

GREY = Input((0.18, 0.18, 0.18))
DARK = Input(BLACK)
SMOOTHEST = 0.02  # least α: sharper highlights fall between samples


@dataclass(frozen=True, slots=True)
class Surface:
    """`diffuse` and `emissive` may have textures. `specular` is the reflectance along the normal; None: from `ior` and `metallic`."""

    diffuse: Input = GREY
    metallic: float = 0.0
    roughness: float = 0.5
    ior: float = 1.5
    specular: Color | None = None
    emissive: Input = DARK
    opacity: float = 1.0
    holes: Input | None = None  # opacity that varies over the surface, or is cut at `threshold`: in place of `opacity`
    threshold: float = 0.0
    name: str = ""


def material(surface: Surface) -> MaterialData:
    """The nearest course material. k_d = diffuse · (1 − metallic) · opacity, k_s the reflectance along the normal, the exponent
    2/α² − 2 with α = roughness² (Walter et al. 2007: the Blinn–Phong lobe of the same width as a Beckmann or GGX one), and what is
    not opaque lets straight through k_t = 1 − opacity: highlights stay, as on glass. Where there are `holes`, nothing of it stays."""
    s = surface
    metallic = min(max(s.metallic, 0.0), 1.0)
    opacity = min(max(s.opacity, 0.0), 1.0)
    base = (1.0 - metallic) * opacity
    matt = Input(scaled(s.diffuse.value, base), s.diffuse.texture if base > 0 else -1)
    inputs = {ir.Slot.DIFFUSE: matt, ir.Slot.AMBIENT: matt, ir.Slot.SPECULAR: _specular(s, metallic)}
    alpha = max(min(max(s.roughness, 0.0), 1.0) ** 2, SMOOTHEST)
    inputs[ir.Slot.SHININESS] = Input.number(max(2.0 / (alpha * alpha) - 2.0, 0.0))
    if s.emissive.value != BLACK:
        inputs[ir.Slot.EMISSION] = s.emissive
    if opacity < 1.0:
        inputs[ir.Slot.TRANSMISSION] = Input(scaled(WHITE, 1.0 - opacity))
        inputs[ir.Slot.IOR] = Input.number(1.0)
    if s.holes is not None:
        inputs[ir.Slot.OPACITY] = s.holes
    return MaterialData(ir.MaterialModel.BLINN_PHONG, inputs, normalized=True, name=s.name, threshold=s.threshold)


def _specular(s: Surface, metallic: float) -> Input:
    if s.specular is not None:
        return Input(s.specular)
    if metallic == 1.0:
        return s.diffuse
    dielectric = ((s.ior - 1.0) / (s.ior + 1.0)) ** 2 if s.ior > 0 else 0.04
    r, g, b = (dielectric + (d - dielectric) * metallic for d in s.diffuse.value)
    return Input((r, g, b))
