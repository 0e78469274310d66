"""What formats lack of materials, in one wording for all of them."""

from __future__ import annotations

from ..compiler import ir

HIGHLIGHT = "a Phong highlight is carried as one of microfacets of the same width"
HIGHLIGHT_OF_MIRROR = "a highlight beside k_r is not carried"
NORMALIZED = "a normalized highlight is not carried"
HIGHLIGHT_COLOR = "a highlight's colour is not carried"
MIRROR = "k_r is not carried"
TRANSMISSION = "k_t is not carried"
BOTH = "k_d and k_r at once are not carried"
EMISSION = "emission beside k_d is not carried"
AMBIENT = "k_a is carried as a share of k_d only"
EDGE = "a metal's colour at grazing angles is carried as white"
FACETS = "microfacets are not carried"
INTERREFLECTION = "light that bounces between facets is not carried: rough surfaces are darker"
COAT = "a clear coat is not carried"
DIFFUSE_TRANSMISSION = "light that passes a sheet diffusely is not carried: its back stays dark"
DIFFUSE_TRANSMISSION_COLOR = "light that passes a sheet diffusely is carried in the colour of the reflected light"
SUBSURFACE = "light that scatters inside of a body is not carried: it is a diffuse surface of its colour"
BODY_COLOR = "the texture of a body's colour is not carried into its medium, which has one colour"
PHASE = "a phase function of Draine is carried as one of Henyey and Greenstein with its mean cosine"
MEDIUM = "the medium inside of a shape is not carried"
FOG = "fog is not carried"
DENSITY = "a medium whose density varies is not carried"
MEDIUM_EMISSION = "light that a medium emits is not carried"
PRIORITY = "the priority of a medium is not carried: where shapes overlap, both media are there"
INSIDE_OF_MEDIUM = "a light or a camera inside of a medium is not carried: Mitsuba takes it to be outside"
SCATTERS_ONCE = "light scatters once in media of POV-Ray: they are darker where it scatters more often"
SHEEN = "sheen is not carried"
FUZZ = "fuzz is carried as sheen, whose law is another"
ROUGH_GLASS = "roughness of glass is not carried"
ABSORPTION = "what glass absorbs inside is not carried"
REFRACTION = "refraction is not carried: glass is a surface that light passes straight"
DISPERSION = "the dispersion of glass is not carried: it has the index of yellow light at all wavelengths"
CLEAR_GLASS = "glass of index 1 is not carried"
AT_VERTICES = "light at vertices (gouraud) is not carried: it is computed at every point"
NORMAL_STRENGTH = "the strength of a normal map is not carried"
COAT_NORMAL = "the coat's own normal is not carried: it has that of the base"
BUMP_MAP = "a bump map is not carried"
FLAKES = "single flakes are not carried: the roughness is that of all flakes together"
BLEND = "a blend is not carried: the material that counts more is"
COLORS = "the mesh's colours are carried only where they stand alone, or times a constant"
TOO_BRIGHT = "no more light is reflected than arrives: colours above 1 are cut"
_NAMES = {
    ir.Slot.AMBIENT: "k_a", ir.Slot.DIFFUSE: "the diffuse colour", ir.Slot.SPECULAR: "the specular colour", ir.Slot.SHININESS: "shininess",
    ir.Slot.REFLECTION: "k_r", ir.Slot.TRANSMISSION: "the transmittance", ir.Slot.IOR: "the index of refraction",
    ir.Slot.COAT: "the clear coat", ir.Slot.COAT_ROUGHNESS: "the clear coat's roughness", ir.Slot.SHEEN_ROUGHNESS: "the sheen's roughness",
}  # fmt: skip


def texture(slot: ir.Slot) -> str:
    """The loss of an input's texture."""
    return f"a texture of {_NAMES.get(slot, slot.name.lower())} is not carried"


def argument(name: str) -> str:
    """The loss of an argument of an element."""
    return f"`{name}` is not carried"
