"""Traits of materials, as columns of a scene's tables: how they scatter light, by their lobes and inputs.

The plan, backends, channels and exporters read these. Kernels decide likewise at points, with the same thresholds. An input with a texture
may have any value; a constant of 0 times a texture is 0 where a function says so.
"""

from __future__ import annotations

import numpy as np

from ..compiler import ir
from . import ADDED, MATERIALS, thresholds
from .contract import Lobes

Slot = ir.Slot
_ROWS = [MATERIALS[model] for model in sorted(ir.MaterialModel)]  # by the numbers of the models, which begin at 0
_LOBES = np.array([material.LOBES.value for material in _ROWS])
_BY_SLOT = np.array([material.REFLECTANCE is not None for material in _ROWS])
_ADDED = np.array([material.LOBE is not None for material in _ROWS])
_THROUGH = np.array([material.LOBE is not None and material.LOBE.THROUGH for material in _ROWS])
_BODIES = np.array([Slot.RADIUS in material.SLOTS for material in _ROWS])
_COLORS = np.array([-1 if material.COLOR is None else int(material.COLOR) for material in _ROWS])
FOCUSING = Lobes.MIRROR | Lobes.GLASS
PATTERN = 0.8  # albedo of a surface with a texture, relative to its factor


def has(tables: ir.Tables, lobes: Lobes) -> np.ndarray:
    """(materials,) bool: materials whose model has some of these lobes."""
    return (_LOBES[tables.materials.model] & lobes.value) != 0


def color_slots(tables: ir.Tables) -> np.ndarray:
    """(materials,) the input that shows a material's colour; -1 of blends, whose parts have one each."""
    return _COLORS[tables.materials.model]


# --- blends --------------------------------------------------------------------------------------------------------------


def blends(tables: ir.Tables) -> list[int]:
    """The rows of blends; parts have lower rows than their blends."""
    return np.flatnonzero(has(tables, Lobes.PARTS)).tolist()


def used(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials of instances, and the parts of their blends."""
    m = tables.materials
    mask = np.zeros(len(m.model), bool)
    mask[tables.instances.material] = True
    for row in reversed(blends(tables)):
        if mask[row]:
            mask[[m.first[row], m.second[row]]] = True
    return mask


def with_parts(tables: ir.Tables, trait: np.ndarray) -> np.ndarray:
    """(materials,) bool: materials with a trait, and blends of which a part has it."""
    m, combined = tables.materials, trait.copy()
    for row in blends(tables):
        combined[row] |= combined[m.first[row]] | combined[m.second[row]]
    return combined


# --- media ---------------------------------------------------------------------------------------------------------------


def invisible(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: boundaries of a medium that light passes straight: smooth, colourless glass of index 1."""
    values = tables.materials.values
    plain = (values[:, Slot.IOR, 0] == 1.0) & (values[:, Slot.TRANSMISSION] == 1.0).all(axis=1) & (values[:, Slot.ROUGHNESS, 0] == 0.0)
    plain &= ~_textured(tables, Slot.IOR, Slot.TRANSMISSION, Slot.ROUGHNESS)
    return has(tables, Lobes.GLASS) & (tables.materials.medium >= 0) & plain


def participating(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials around a medium that scatters or emits light, or whose boundary is invisible."""
    media, row = tables.media, tables.materials.medium
    active = np.append((media.scattering + media.emission).max(axis=1, initial=0.0) > 0.0, False)
    return active[row] | invisible(tables)


def participates(tables: ir.Tables) -> bool:
    """Whether light scatters inside of media of this scene, or passes their invisible boundaries."""
    return bool(tables.media.everywhere.any() or (participating(tables) & used(tables)).any())


def bodies(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: bodies that light enters diffusely, with a medium inside of their own."""
    return _BODIES[tables.materials.model]


def coated(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: bodies with a highlight."""
    return bodies(tables) & ((tables.materials.values[:, Slot.IOR, 0] != 1.0) | _textured(tables, Slot.IOR))


def varying_bodies(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: bodies whose colour, or the radius by which light scatters in them, has a texture; those in use."""
    return bodies(tables) & _textured(tables, Slot.AMBIENT, Slot.RADIUS) & (tables.materials.medium >= 0) & used(tables)


# --- inputs --------------------------------------------------------------------------------------------------------------


def _textured(tables: ir.Tables, *slots: ir.Slot) -> np.ndarray:
    return np.any(tables.materials.textures[:, list(slots)] >= 0, axis=1)


def _positive(tables: ir.Tables, *slots: ir.Slot) -> np.ndarray:
    """Whether the constant of one of these inputs is above 0."""
    return tables.materials.values[:, list(slots)].max(axis=(1, 2), initial=0.0) > 0.0


def _most(tables: ir.Tables, slot: ir.Slot, textured: float) -> np.ndarray:
    """The largest component of an input; `textured` where it has a texture."""
    return np.where(_textured(tables, slot), textured, tables.materials.values[:, slot].max(axis=1, initial=0.0))


def _least(tables: ir.Tables, slot: ir.Slot) -> np.ndarray:
    """The least value of a number: 0 where it has a texture."""
    return np.where(_textured(tables, slot), 0.0, tables.materials.values[:, slot, 0])


def _may_exceed(tables: ir.Tables, slot: ir.Slot, bound: float = 0.0) -> np.ndarray:
    return (tables.materials.values[:, slot, 0] > bound) | _textured(tables, slot)


def _may_be_below(tables: ir.Tables, slot: ir.Slot, bound: float) -> np.ndarray:
    return (tables.materials.values[:, slot, 0] < bound) | _textured(tables, slot)


# --- opacity and emission ------------------------------------------------------------------------------------------------


def partial(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials with an opacity below 1 anywhere."""
    return _may_be_below(tables, Slot.OPACITY, 1.0)


def emissive(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: emissive materials."""
    return _positive(tables, Slot.EMISSION)  # a texture multiplies it


def clear(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials that transmit light, as glass and those with k_t do."""
    return has(tables, Lobes.GLASS) | _positive(tables, Slot.TRANSMISSION) | transmitting(tables)


def passes_light(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials that light passes somewhere, straight or refracted."""
    return clear(tables) | partial(tables) | _textured(tables, Slot.TRANSMISSION)


# --- lobes ---------------------------------------------------------------------------------------------------------------


def facets(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials of microfacets."""
    return has(tables, Lobes.FACETS)


def slabs(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials of OpenPBR's slabs."""
    return has(tables, Lobes.SLABS)


def anisotropic(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials whose highlights have a direction."""
    return slabs(tables) & (_may_exceed(tables, Slot.ANISOTROPY) | _may_exceed(tables, Slot.COAT_ANISOTROPY))


def passed(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: slabs that light passes."""
    return slabs(tables) & (_may_exceed(tables, Slot.TRANSMISSION_WEIGHT) | _may_exceed(tables, Slot.SUBSURFACE_WEIGHT))


def transmitting(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: slabs that light passes refracted, or straight through a thin wall."""
    return slabs(tables) & _may_exceed(tables, Slot.TRANSMISSION_WEIGHT)


def filmed(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials under a thin film."""
    return slabs(tables) & _may_exceed(tables, Slot.FILM)


def flaked(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: slabs with flakes in their base."""
    return slabs(tables) & (tables.materials.values[:, Slot.FLAKE_SIZE, 0] > 0.0)


def added(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials with a lobe beside the classic ones."""
    return _ADDED[tables.materials.model]


def translucent(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials that scatter light diffusely to their other side."""
    return _THROUGH[tables.materials.model] | passed(tables)


def rough_glass(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: glass that is not polished everywhere."""
    return has(tables, Lobes.GLASS) & _may_exceed(tables, Slot.ROUGHNESS)


def dispersive(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: glass whose index depends on the wavelength."""
    return has(tables, Lobes.GLASS) & (tables.materials.values[:, Slot.DISPERSION, 0] > 0.0)


def disperses(tables: ir.Tables) -> bool:
    """Whether light is split into its wavelengths by glass of this scene."""
    return bool((dispersive(tables) & used(tables)).any())


def mirrors(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: mirrors, and materials with k_r."""
    return has(tables, Lobes.MIRROR) | _positive(tables, Slot.REFLECTION)


def glossy(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: microfacet materials with recognizable reflections: metals, polished dielectrics, rough glass."""
    bound = thresholds.MAX_REFLECTION_ROUGHNESS
    polish = _may_be_below(tables, Slot.ROUGHNESS, bound) | _may_exceed(tables, Slot.METALLIC)
    polish |= _may_exceed(tables, Slot.COAT) & _may_be_below(tables, Slot.COAT_ROUGHNESS, bound)
    based = has(tables, Lobes.BASE | Lobes.SLABS)
    return (facets(tables) & ~based) | (based & polish) | rough_glass(tables)


def specular(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials that reflect or refract specularly, or show recognizable reflections."""
    return _positive(tables, Slot.REFLECTION, Slot.TRANSMISSION) | glossy(tables) | has(tables, FOCUSING)


def lit(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials with direct light: diffuse, with a highlight, or rough glass."""
    plain = _positive(tables, Slot.DIFFUSE, Slot.SPECULAR) | _textured(tables, Slot.DIFFUSE, Slot.SPECULAR)
    return plain | has(tables, Lobes.FACETS | Lobes.SLABS | Lobes.PARTS) | rough_glass(tables) | added(tables)


def _may_be_flat(tables: ir.Tables) -> np.ndarray:
    """Whether the roughness is somewhere that of a perfect mirror."""
    return (tables.materials.values[:, Slot.ROUGHNESS, 0] ** 2 < thresholds.SHARP) | _textured(tables, Slot.ROUGHNESS)


def flat_coats(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: bodies whose highlight is somewhere a perfect mirror."""
    return coated(tables) & _may_be_flat(tables)


def flat_facets(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials whose microfacets are somewhere a perfect mirror."""
    return facets(tables) & _may_be_flat(tables)


def sharp(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials with perfect specular reflection or transmission; a blend has that of its parts."""
    glass = has(tables, Lobes.GLASS)
    passing = (_positive(tables, Slot.TRANSMISSION) | _textured(tables, Slot.TRANSMISSION)) & ~glass
    reflecting = _positive(tables, Slot.REFLECTION) | _textured(tables, Slot.REFLECTION)
    return with_parts(tables, reflecting | passing | flat_facets(tables) | (glass & _may_be_flat(tables)))


def polished(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: polished metals and frosted glass; a blend counts as its parts."""
    smooth = (tables.materials.values[:, Slot.ROUGHNESS, 0] <= thresholds.MAX_CAUSTIC_ROUGHNESS) | _textured(tables, Slot.ROUGHNESS)
    metallic = (tables.materials.values[:, Slot.METALLIC, 0] >= 1.0) | _textured(tables, Slot.METALLIC)
    metallic |= ~has(tables, Lobes.BASE | Lobes.SLABS)
    focusing = (facets(tables) & metallic) | (slabs(tables) & (metallic | transmitting(tables)))
    return with_parts(tables, (focusing & smooth) | (rough_glass(tables) & smooth))


def narrow_highlights(tables: ir.Tables) -> np.ndarray:
    """(materials,) largest reflectance of bright, narrow highlights over a diffuse base; 0 without. A blend has that of its parts."""
    m = tables.materials

    def reflects(f0: np.ndarray, rough: np.ndarray) -> np.ndarray:
        return np.where((rough <= thresholds.MAX_CAUSTIC_ROUGHNESS) & (4.0 * rough**4 <= f0), f0, 0.0)

    ior = np.maximum(m.values[:, Slot.IOR, 0], thresholds.LEAST_IOR)
    boundary = np.where(_textured(tables, Slot.IOR), 1.0, ((ior - 1.0) / (ior + 1.0)) ** 2)
    metallic = np.clip(_most(tables, Slot.METALLIC, 1.0), 0.0, 1.0)
    f0 = np.maximum(boundary, np.minimum(_most(tables, Slot.DIFFUSE, 1.0), 1.0) * metallic)
    f0 = np.where(_BY_SLOT[m.model], _most(tables, Slot.SPECULAR, 1.0), f0)
    coat = reflects(thresholds.COAT * _most(tables, Slot.COAT, 1.0), _least(tables, Slot.COAT_ROUGHNESS))
    based = has(tables, Lobes.BASE | Lobes.SLABS)
    highlights = np.where(based, np.maximum(reflects(f0, _least(tables, Slot.ROUGHNESS)), coat), 0.0)
    phong = _most(tables, Slot.SPECULAR, 1.0)
    least = np.where(phong >= thresholds.BRIGHT, thresholds.PEAK, thresholds.FAINT_PEAK)
    narrow = m.normalized & (phong * (_most(tables, Slot.SHININESS, np.inf) + 2.0) >= least)
    highlights = np.where(narrow & ~based, phong, highlights)
    for row in blends(tables):
        highlights[row] = max(highlights[m.first[row]], highlights[m.second[row]])
    return np.clip(highlights, 0.0, 1.0)


def receives_caustics(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials that are not perfectly specular."""
    diffuse = _positive(tables, Slot.DIFFUSE, Slot.SPECULAR) | _textured(tables, Slot.DIFFUSE)
    return (diffuse | added(tables) | has(tables, Lobes.FACETS | Lobes.SLABS | Lobes.PARTS)) & ~has(tables, Lobes.MIRROR)


def diffuse(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials with a diffuse part; a blend has that of its parts."""
    return with_parts(tables, _positive(tables, Slot.DIFFUSE, Slot.SHEEN) | added(tables))


def mostly_diffuse(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials whose diffuse lobe outweighs metal, mirror and transmission; blends count as such."""
    other = tables.materials.values[:, [Slot.METALLIC, Slot.TRANSMISSION, Slot.REFLECTION]].max(axis=(1, 2), initial=0.0)
    colored = _positive(tables, Slot.DIFFUSE) | _textured(tables, Slot.DIFFUSE) | added(tables)
    based = has(tables, Lobes.CLASSIC | Lobes.BASE | Lobes.SLABS) & colored
    return (based | has(tables, Lobes.PARTS)) & (other < 0.5)


def albedo(tables: ir.Tables) -> np.ndarray:
    """(materials,) about the share of light that a material reflects."""
    m = tables.materials
    share = _largest_share(tables, (Slot.DIFFUSE, Slot.REFLECTION, Slot.SPECULAR))
    for lobe, models in ADDED:
        colors = tuple(slot for slot in lobe.SLOTS if slot in ir.COLOR_SLOTS)
        if colors and not lobe.THROUGH:
            share = np.where(ir.is_in(m.model, models), np.maximum(share, _largest_share(tables, colors)), share)
    for row in blends(tables):
        share[row] = 0.5 * (share[m.first[row]] + share[m.second[row]])
    return share


def _largest_share(tables: ir.Tables, slots: tuple[ir.Slot, ...]) -> np.ndarray:
    """(materials,) the largest of these reflectances, 0 to 1."""
    m = tables.materials
    parts = m.values[:, list(slots)].mean(axis=2)
    parts = np.where(m.textures[:, list(slots)] >= 0, PATTERN * parts, parts)
    return np.clip(parts.max(axis=1), 0.0, 1.0)
