"""Metallic–roughness surfaces (UsdPreviewSurface 2.6, glTF 2.0, MTL's PBR extension) as `principled` materials."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .. import ir
from . import partial_coverage
from .row_records import BLACK, WHITE, Color, Input, MaterialData, scale_color

GREY = Input((0.18, 0.18, 0.18))
DARK = Input(BLACK)
NOTHING, ALL = Input.number(0.0), Input.number(1.0)
HALF, GLASS, FINE = Input.number(0.5), Input.number(1.5), Input.number(0.01)


@dataclass(frozen=True, slots=True)
class Surface:
    """A metallic–roughness surface. Any input may have a texture.

    `specular` is the reflectance along the normal (F0); None: from `ior` and `metallic`.
    """

    diffuse: Input = GREY
    metallic: Input = NOTHING
    roughness: Input = HALF
    ior: Input = GLASS
    specular: Input | None = None
    emissive: Input = DARK
    coat: Input = NOTHING
    coat_roughness: Input = FINE
    sheen: Input = DARK
    sheen_roughness: Input = NOTHING
    coat_normal: Input | None = None  # COAT_NORMAL, of slabs
    occlusion: Input = ALL
    normal: Input | None = None  # normal map, its factor the strength
    bump: Input | None = None  # height map, its factor in metres
    opacity: Input = ALL  # of the whole surface, or a cut-out at `threshold`
    threshold: float = 0.0
    highlights_stay: bool = False  # where the constant of the opacity is below 1
    transmission: float = 0.0  # share of the light that passes straight under highlights, which stay
    name: str = ""


def material(surface: Surface) -> MaterialData:
    """The `principled` material of a surface.

    Where highlights stay, as on glass, they are stronger the more light passes, but not where the surface is metallic or its index of
    refraction has a texture (see partial_coverage). Where the texture of the opacity is 0, the whole surface vanishes, highlights too.
    """
    s = _dissolved(surface)
    inputs = {
        ir.Slot.AMBIENT: s.occlusion,
        ir.Slot.DIFFUSE: s.diffuse,
        ir.Slot.METALLIC: _share(s.metallic),
        ir.Slot.ROUGHNESS: _share(s.roughness),
        ir.Slot.IOR: s.ior if s.ior.value[0] > 0 else GLASS,
    }
    if s.coat.value[0] > 0:
        inputs |= {ir.Slot.COAT: _share(s.coat), ir.Slot.COAT_ROUGHNESS: _share(s.coat_roughness)}
    if s.sheen.value != BLACK:
        inputs |= {ir.Slot.SHEEN: s.sheen, ir.Slot.SHEEN_ROUGHNESS: _share(s.sheen_roughness)}
    if s.specular is not None:
        inputs[ir.Slot.SPECULAR] = s.specular
        inputs[ir.Slot.METALLIC] = NOTHING
    if s.emissive.value != BLACK:
        inputs[ir.Slot.EMISSION] = s.emissive
    if s.normal is not None:
        inputs[ir.Slot.NORMAL] = s.normal
    if s.bump is not None:
        inputs[ir.Slot.BUMP] = s.bump
    model = ir.MaterialModel.PRINCIPLED if s.specular is None else ir.MaterialModel.PRINCIPLED_SPECULAR
    return partial_coverage.with_opacity(MaterialData(model, inputs, name=s.name), _share(s.opacity), s.threshold)


def _dissolved(s: Surface) -> Surface:
    """A surface without transmission, whose highlights fade with its opacity: they and the emission are stronger where they stay."""
    under, coverage = (s.opacity.value[0], 1.0) if s.highlights_stay else (1.0, s.opacity.value[0])
    under *= 1.0 - s.transmission
    if under >= 1.0:
        return s
    f0 = s.specular
    if f0 is None and s.metallic == NOTHING and s.ior.texture < 0:
        n = s.ior.value[0] if s.ior.value[0] > 0 else GLASS.value[0]
        f0 = Input(scale_color(WHITE, ((n - 1.0) / (n + 1.0)) ** 2))
    share = partial_coverage.cover(under, 0.0 if f0 is None else max(f0.value))
    return replace(
        s, opacity=Input.number(share * coverage, s.opacity.texture), transmission=0.0,
        specular=None if f0 is None else partial_coverage.stronger(f0, share),
        coat=partial_coverage.stronger(s.coat, share), emissive=partial_coverage.stronger(s.emissive, share, float("inf")),
    )  # fmt: skip


def _share(weight: Input) -> Input:
    """A number clamped to 0…1; a texture's factor is not clamped."""
    value: Color = weight.value if weight.texture >= 0 else (min(max(weight.value[0], 0.0), 1.0), 0.0, 0.0)
    return Input(value, weight.texture)
