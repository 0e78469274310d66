"""Slabs of OpenPBR materials at points, and what other lobes of a BSDF take from them.

The inputs are those of materials/openpbr.py. The coat roughens the base: the fourth power of the base's roughness grows by twice that of
the coat's. It also lowers the base's relative index; where that falls below 1, it counts inverted. `specular_weight` scales the
reflectance of the dielectric at normal incidence (OpenPBR Surface 1.1).
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...materials import traits
from ...materials.thresholds import LOWEST, MAX_CAUSTIC_ALPHA, MAX_REFLECTION_ALPHA
from ..jit.kernel import helper, make_replace, separate_helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops
from ..simd.registration import overload
from ..surface import tangent_frame
from ..surface.material_inputs import color_of, number_of
from ..types import Lane, Surface, Tables, Vec
from . import anisotropic_albedo, anisotropic_facets, dielectric_albedo, energy_compensation, flakes, rough_dielectric, slabs, thin_film
from .anisotropic_facets import Facets
from .slab_passage import SAME, Passage
from .slabs import LEAST, Slabs

Slot = ir.Slot
OPENPBR = int(ir.MaterialModel.OPENPBR)
NARROW = 0.04  # as of bsdf
_DIP = LOWEST * (1.0 - LOWEST) ** 6
_FIFTH = (1.0 - LOWEST) ** 5
BASE_WEIGHT, DIFFUSE = int(Slot.BASE_WEIGHT), int(Slot.DIFFUSE)
DIFFUSE_ROUGHNESS, METALLIC = int(Slot.DIFFUSE_ROUGHNESS), int(Slot.METALLIC)
SPECULAR_WEIGHT, SPECULAR, ROUGHNESS, IOR = (int(s) for s in (Slot.SPECULAR_WEIGHT, Slot.SPECULAR, Slot.ROUGHNESS, Slot.IOR))
ANISOTROPY, ROTATION, COAT, COAT_COLOR = (int(s) for s in (Slot.ANISOTROPY, Slot.ROTATION, Slot.COAT, Slot.COAT_COLOR))
COAT_ROUGHNESS, COAT_IOR, COAT_ANISOTROPY = (int(s) for s in (Slot.COAT_ROUGHNESS, Slot.COAT_IOR, Slot.COAT_ANISOTROPY))
COAT_ROTATION, COAT_DARKENING = int(Slot.COAT_ROTATION), int(Slot.COAT_DARKENING)
TRANSMISSION_WEIGHT, TRANSMISSION_COLOR = int(Slot.TRANSMISSION_WEIGHT), int(Slot.TRANSMISSION_COLOR)
SUBSURFACE_WEIGHT, SUBSURFACE_COLOR = int(Slot.SUBSURFACE_WEIGHT), int(Slot.SUBSURFACE_COLOR)
PHASE, THIN_WALLED = int(Slot.SUBSURFACE_ANISOTROPY), int(Slot.THIN_WALLED)
FILM, FILM_THICKNESS, FILM_IOR = int(Slot.FILM), int(Slot.FILM_THICKNESS), int(Slot.FILM_IOR)
FUZZ, FUZZ_COLOR, FUZZ_ROUGHNESS = int(Slot.FUZZ), int(Slot.FUZZ_COLOR), int(Slot.FUZZ_ROUGHNESS)


class NoSlabs(NamedTuple):
    """No material is OpenPBR's."""


class NoFilms(NamedTuple):
    """No material has a thin film."""


class Films(NamedTuple):
    """Some material has a thin film."""

    count: int


class NoPassages(NamedTuple):
    """Light passes no material of slabs."""


class Passages(NamedTuple):
    """Light passes some material of slabs."""

    rough: rough_dielectric.AlbedoTables  # by the materials' indices under their coats


class SlabTables(NamedTuple):
    """Some material is OpenPBR's."""

    metal: energy_compensation.Albedo
    reflection: dielectric_albedo.Reflection
    turned: Any  # tangent_frame.Turned or Round
    films: Any  # Films or NoFilms
    passages: Any  # Passages or NoPassages
    flakes: Any  # flakes.Flakes or NoFlakes
    anisotropy: Any  # anisotropic_albedo.AnisotropicTables or NoAnisotropy


def tables_of(tables: ir.Tables, general: bool = False, always: bool = False) -> SlabTables | NoSlabs:
    """The tables if a material of an instance is OpenPBR's, or `always`. With `general` they have all parts."""
    used = traits.used(tables)
    if not always and not (traits.slabs(tables) & used).any():
        return NoSlabs()
    uneven = traits.anisotropic(tables) & used
    turned = tangent_frame.Turned(1) if general or uneven.any() else tangent_frame.Round()
    films = Films(1) if general or (traits.filmed(tables) & used).any() else NoFilms()
    passing = traits.passed(tables) & used
    indices = _relative_indices(tables)
    boundaries = rough_dielectric.tables_of_indices(indices, passing) if general or passing.any() else None
    albedos = anisotropic_albedo.tables_of(indices, passing, uneven) if general or uneven.any() else anisotropic_albedo.NoAnisotropy()
    passages = NoPassages() if boundaries is None else Passages(boundaries)
    of_flakes = flakes.tables_of(tables, general)
    return SlabTables(energy_compensation.table(), dielectric_albedo.table(), turned, films, passages, of_flakes, albedos)


def _relative_indices(tables: ir.Tables) -> NDArray[np.float64]:
    """(materials,) the constant index of each base, over that of its coat, above 1."""
    values = tables.materials.values[..., 0]
    ratio = np.maximum(values[:, IOR], 1e-3) / (1.0 + np.clip(values[:, COAT], 0.0, 1.0) * (np.maximum(values[:, COAT_IOR], 1.0) - 1.0))
    step = np.abs(ratio - 1.0) / (ratio + 1.0) * np.sqrt(np.maximum(values[:, SPECULAR_WEIGHT], 0.0))
    step = np.minimum(step, dielectric_albedo.STEEPEST)
    return np.round((1.0 + step) / (1.0 - step), 3)


def at(tables: Tables, surface: Surface) -> Slabs | None:
    """Return the Slabs of a surface; None in scenes without any."""
    return _at(tables, surface) if isinstance(getattr(tables.materials, "slabs", None), SlabTables) else None


@overload(at)
def _at_in_kernels(tables, surface):
    part = tables.field("materials.slabs") if isinstance(tables, HandleType) else None
    if part is not None and part[1] != ():
        return lambda tables, surface: _at(tables, surface)
    return lambda tables, surface: None


@helper
def _share(tables: Tables, surface: Surface, slot: int) -> Lane:
    return ops.clip(number_of(tables, surface, slot), 0.0, 1.0)


@helper
def _color(tables: Tables, surface: Surface, slot: int) -> Vec:
    r, g, b = color_of(tables, surface, slot)
    return ops.clip(r, 0.0, 1.0), ops.clip(g, 0.0, 1.0), ops.clip(b, 0.0, 1.0)


@helper
def bend_of(f0: Lane, tint: Lane) -> Lane:
    """The coefficient of the dip that leaves `tint` of Schlick's reflectance at LOWEST."""
    return (f0 + (1.0 - f0) * _FIFTH) * (1.0 - tint) * (1.0 / _DIP)


@helper
def step_of(ratio: Lane, weight: Lane) -> Lane:
    """s of a boundary (see dielectric_albedo) whose reflectance at normal incidence is scaled by `weight`."""
    return ops.minimum(ops.absolute(ratio - 1.0) / (ratio + 1.0) * ops.sqrt(ops.maximum(weight, 0.0)), dielectric_albedo.STEEPEST)


@separate_helper
def _at(tables: Tables, surface: Surface) -> Slabs:
    materials: Any = tables.materials
    zero = ops.full_like(surface.offset, 0.0)
    has_slabs = ops.bool_like(zero, False) | (materials.model[surface.material] == OPENPBR)
    turned = tangent_frame.tangent_of(surface.tangent)
    coat_normal = tangent_frame.coat_of(surface.tangent)
    anisotropy, turns = _share(tables, surface, ANISOTROPY), number_of(tables, surface, ROTATION)
    tangent, across = tangent_frame.frame(turned, surface.normal, anisotropy > 0.0)
    weight = ops.maximum(number_of(tables, surface, BASE_WEIGHT), 0.0)
    color = ops.scale(ops.mul(color_of(tables, surface, DIFFUSE), surface.color), weight)
    color = ops.clip(color[0], 0.0, 1.0), ops.clip(color[1], 0.0, 1.0), ops.clip(color[2], 0.0, 1.0)
    metal, gleam = _share(tables, surface, METALLIC), number_of(tables, surface, SPECULAR_WEIGHT)
    tint, rough = _color(tables, surface, SPECULAR), _share(tables, surface, ROUGHNESS)
    bend = bend_of(color[0], tint[0]), bend_of(color[1], tint[1]), bend_of(color[2], tint[2])
    coat = ops.where(has_slabs, _share(tables, surface, COAT), zero)
    ratio = ops.maximum(number_of(tables, surface, IOR), 1e-3)
    coat_facets, coat_ratio, coat_step = Facets(tangent, across, zero + 1.0, zero + 1.0, zero + 1.0), zero + 1.5, zero
    dark, log = (zero + 1.0, zero + 1.0, zero + 1.0), (zero, zero, zero)
    if ops.any_lane(coat > 0.0):
        coat_ratio, coat_rough = ops.maximum(number_of(tables, surface, COAT_IOR), 1.0), _share(tables, surface, COAT_ROUGHNESS)
        coat_step = step_of(coat_ratio, zero + 1.0)
        coat_turns, coat_uneven = number_of(tables, surface, COAT_ROTATION), _share(tables, surface, COAT_ANISOTROPY)
        plain = tangent_frame.frame(turned, surface.normal, coat_uneven > 0.0)
        coat_along, coat_across = _coat_frame(coat_normal, plain, turned, coat_uneven > 0.0)
        coat_facets = anisotropic_facets.facets(coat_along, coat_across, coat_turns, coat_rough, coat_uneven)
        r, g, b = _color(tables, surface, COAT_COLOR)
        log = 0.5 * ops.log(ops.maximum(r, 1e-4)), 0.5 * ops.log(ops.maximum(g, 1e-4)), 0.5 * ops.log(ops.maximum(b, 1e-4))
        dark = _darkening(materials.slabs.reflection, color, metal, rough, (coat_ratio, coat_step, coat_facets.alpha))
        dark = ops.lerp3((zero + 1.0, zero + 1.0, zero + 1.0), dark, coat * _share(tables, surface, COAT_DARKENING))
        square, coat_square = rough * rough, coat_rough * coat_rough
        rougher = ops.sqrt(ops.sqrt(ops.minimum(square * square + 2.0 * coat_square * coat_square, 1.0)))
        rough = ops.lerp(rough, rougher, coat)
        ratio = ratio / ops.lerp(zero + 1.0, coat_ratio, coat)
    fibres = ops.where(has_slabs, _share(tables, surface, FUZZ), zero)
    facets = anisotropic_facets.facets(tangent, across, turns, rough, anisotropy)
    flake = flakes.at(materials.slabs.flakes, None, tables, surface, facets)
    facets = flakes.all_facets(flake, facets)
    plain = Slabs(
        has_slabs, color, _share(tables, surface, DIFFUSE_ROUGHNESS), metal, bend, ops.clip(gleam, 0.0, 1.0), step_of(ratio, gleam), tint,
        facets, coat, coat_step, coat_ratio, log, coat_facets, dark, fibres, _color(tables, surface, FUZZ_COLOR),
        _share(tables, surface, FUZZ_ROUGHNESS), materials.slabs.metal, materials.slabs.reflection,
        _film(materials.slabs.films, None, tables, surface, color, ops.lerp(zero + 1.0, coat_ratio, coat)), None, flake,
        anisotropic_albedo.at(materials.slabs.anisotropy, None, facets, coat_facets), coat_normal,
    )  # fmt: skip
    return _with_passage(materials.slabs.passages, plain, tables, surface)


@helper
def _frame_of_coat(normal: Vec, plain: tuple[Vec, Vec], tangent: Any, lined: Lane) -> tuple[Vec, Vec]:
    return tangent_frame.frame(tangent, normal, lined)


_coat_frame = specialize_if_present(_frame_of_coat)  # the coat's own normal, (along, across) at the base's, tangent, where it counts


@helper
def _passing(passages: Passages, plain: Slabs, tables: Tables, surface: Surface) -> Slabs:
    """The slabs with what passes them. Inside of a solid they have neither coat nor fuzz, and all light of a body leaves it."""
    thin = number_of(tables, surface, THIN_WALLED) > 0.0
    clear, spread = _share(tables, surface, TRANSMISSION_WEIGHT), _share(tables, surface, SUBSURFACE_WEIGHT)
    inside = plain.here & ops.not_(thin | surface.front) & (clear + spread > 0.0)
    leaves = inside & (clear <= 0.0)
    zero, unity = 0.0 * clear, 0.0 * clear + 1.0
    white, shown = (unity, unity, unity), ops.not_(leaves)
    bent = (1.0 + plain.step) / (1.0 - plain.step)
    ratio = ops.where(leaves, unity, ops.where(inside, 1.0 / bent, bent))
    turned, sheet = number_of(tables, surface, PHASE), _color(tables, surface, SUBSURFACE_COLOR)
    wall = ops.mul(sheet, ops.where3(thin, white, (zero, zero, zero)))
    color = ops.lerp3(plain.color, ops.scale(wall, 0.5 * (1.0 - turned)), ops.where(thin, spread, zero))
    opaque = ops.where(leaves, zero, (1.0 - clear) * ops.where(thin, unity, 1.0 - spread))
    diffuse = ops.where(leaves, unity, (1.0 - clear) * spread)
    passage = Passage(
        ops.where(leaves, zero, clear), diffuse, opaque, _color(tables, surface, TRANSMISSION_COLOR),
        ops.where3(thin, ops.scale(wall, 0.5 * (1.0 + turned)), white), thin | (ops.absolute(ratio - 1.0) < SAME), inside, ratio,
        rough_dielectric.of_row(passages.rough, surface.material, inside, plain.facets.alpha, ratio),
    )  # fmt: skip
    return _replaced(
        plain, color, ops.where(leaves, zero, plain.metal), ops.where3(shown, plain.tint, (zero, zero, zero)),
        ops.where(inside, zero, plain.coat), ops.where3(inside, white, plain.dark), ops.where(inside, zero, plain.fuzz),
        _film_of(plain.film, None, inside), passage,
    )  # fmt: skip


@helper
def _film_outside(film: thin_film.Film, plain: Any, inside: Lane) -> thin_film.Film:
    return thin_film.Film(ops.where(inside, 0.0, film.weight), film.thickness, film.ratio, film.f0)


_film_of = specialize_if_present(_film_outside)  # film, None, inside of a solid: the film, there without a weight
_replaced = make_replace(Slabs, "color", "metal", "tint", "coat", "dark", "fuzz", "film", "passage")
_with_passage = specialize_if_present(_passing)


@helper
def _film_at(films: Films, plain: Any, tables: Tables, surface: Surface, color: Vec, over: Lane) -> thin_film.Film:
    ratio = ops.maximum(number_of(tables, surface, FILM_IOR) / over, 1.0)
    root = ops.sqrt(ops.minimum(color[0], 0.98)), ops.sqrt(ops.minimum(color[1], 0.98)), ops.sqrt(ops.minimum(color[2], 0.98))
    return thin_film.Film(_share(tables, surface, FILM), ops.maximum(number_of(tables, surface, FILM_THICKNESS), 0.0), ratio, root)


_film = specialize_if_present(_film_at)  # films, None, tables, surface, the metal's colour, the index over the film: Film or None


@helper
def _darkening(table: dielectric_albedo.Reflection, color: Vec, metal: Lane, rough: Lane, coat: Any) -> Vec:
    """Δ = (1 − K)/(1 − E K), with K the share of light from a base of albedo E that the coat (index, s, α) sends back to it."""
    ratio, step, alpha = coat
    smooth, mean = step * step, dielectric_albedo.means(table, alpha, step)[0]
    diffuse = 1.0 - (1.0 - mean) / (ratio * ratio)
    back = ops.clip(ops.lerp(smooth, diffuse, ops.lerp(0.0 * metal + 1.0, rough, metal)), 0.0, 0.999)
    return (1.0 - back) / (1.0 - color[0] * back), (1.0 - back) / (1.0 - color[1] * back), (1.0 - back) / (1.0 - color[2] * back)


# --- what a BSDF takes from slabs ----------------------------------------------------------------------------------------


@helper
def _reflected(part: Slabs, plain: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    values = slabs.evaluate(part, normal, to_light, to_viewer)
    return ops.where3(part.here, ops.add(values.matt, values.shine), plain)


@helper
def _eval_pdf(part: Slabs, plain: tuple[Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    values = slabs.evaluate(part, normal, to_light, to_viewer)
    return ops.where3(part.here, ops.add(values.matt, values.shine), plain[0]), ops.where(part.here, values.density, plain[1])


@helper
def _eval_lobes_pdf(part: Slabs, plain: tuple[Vec, Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Vec, Lane]:
    values = slabs.evaluate(part, normal, to_light, to_viewer)
    lanes = part.here
    return (
        ops.where3(lanes, values.matt, plain[0]), ops.where3(lanes, values.shine, plain[1]),
        ops.where(lanes, values.shine_density, plain[2]),
    )  # fmt: skip


@helper
def _eval_matt(part: Slabs, plain: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    return ops.where3(part.here, slabs.evaluate(part, normal, to_light, to_viewer).matt, plain)


@helper
def _matt_share(part: Slabs, plain: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    matt = slabs.evaluate(part, normal, to_light, to_viewer).matt
    return ops.where3(part.here, ops.scale(matt, 1.0 / ops.maximum(ops.dot(normal, to_light), LEAST)), plain)


@helper
def _draw(part: Slabs, plain: tuple[Vec, Lane], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Lane]:
    direction, counts = slabs.draw(part, normal, to_viewer, u, v, ops.clip(which, 0.0, 1.0), ops.bool_like(u, True))
    return ops.where3(part.here, direction, plain[0]), ops.where(part.here, counts, plain[1])


@helper
def _sample(part: Slabs, plain: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, all_: bool) -> tuple[Vec, Vec]:
    every = ops.bool_like(u, all_)
    direction, counts = slabs.draw(part, normal, to_viewer, u, v, which, every)
    values = slabs.evaluate(part, normal, direction, to_viewer)
    density = ops.where(every, values.density, values.shine_density)
    share = ops.where3(every, ops.add(values.matt, values.shine), values.shine)
    factor = ops.where(counts & (density > 0.0), 1.0 / (math.pi * ops.where(density > 0.0, density, 1.0)), 0.0)
    return ops.where3(part.here, direction, plain[0]), ops.where3(part.here, ops.scale(share, factor), plain[1])


@helper
def _one(part: Slabs, plain: Lane) -> Lane:
    return ops.where(part.here, 1.0, plain)


@helper
def _diffuse_part(part: Slabs, plain: tuple[Vec, Lane], normal: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    chance = slabs.chances(part, normal, to_viewer)[0]
    among = chance.matt / ops.maximum(slabs.total(chance), LEAST)
    return ops.where3(part.here, ops.scale(part.color, 0.9 * (1.0 - part.metal)), plain[0]), ops.where(part.here, among, plain[1])


@helper
def _or_slabs(part: Slabs, plain: Lane) -> Lane:
    return plain | part.here


@helper
def _matt(part: Slabs) -> Lane:
    """Whether it has a diffuse lobe or fuzz."""
    return _or_diffuse(part.passage, (part.metal < 1.0) & (ops.largest(part.color) > 0.0)) | (part.fuzz > 0.0)


@helper
def _is_diffuse(passage: Passage, plain: Lane) -> Lane:
    return (plain & (passage.opaque > 0.0)) | (passage.diffuse > 0.0)


_or_diffuse = specialize_if_present(_is_diffuse)  # passage, whether the base is diffuse


@helper
def _scatters_through(part: Slabs, plain: Lane) -> Lane:
    return _or_passes(part.passage, plain, part.here)


@helper
def _passes(passage: Passage, plain: Lane, lanes: Lane) -> Lane:
    return plain | (lanes & (passage.share + passage.diffuse > 0.0))


_or_passes = specialize_if_present(_passes)


@helper
def _refracts(part: Slabs, plain: Lane) -> Lane:
    return _or_refracts(part.passage, plain, part.here)


@helper
def _bends(passage: Passage, plain: Lane, lanes: Lane) -> Lane:
    return plain | (lanes & (passage.share > 0.0) & ops.not_(passage.straight))


_or_refracts = specialize_if_present(_bends)


@helper
def _eta(part: Slabs, plain: Lane) -> Lane:
    return _eta_of(part.passage, plain, part.here)


@helper
def _index_of(passage: Passage, plain: Lane, lanes: Lane) -> Lane:
    return ops.where(lanes & ops.not_(passage.straight), 1.0 / passage.ratio, plain)


_eta_of = specialize_if_present(_index_of)


@helper
def _or_matt(part: Slabs, plain: Lane) -> Lane:
    return plain | (part.here & _matt(part))


@helper
def _or_polished(part: Slabs, plain: Lane, most: float) -> Lane:
    alone = (part.coat <= 0.0) | (part.coat_facets.alpha <= most)
    return plain | (part.here & ops.not_(_matt(part)) & alone & (part.facets.alpha <= most))


@helper
def _bright(part: Slabs, plain: Lane) -> Lane:
    alpha, coat = part.facets.alpha, part.coat_facets.alpha
    f0 = ops.maximum(part.step * part.step, part.metal * ops.largest(part.color))
    bright = (alpha <= MAX_CAUSTIC_ALPHA) & (4.0 * alpha * alpha <= f0)
    coated = (coat <= MAX_CAUSTIC_ALPHA) & (4.0 * coat * coat <= part.coat_step * part.coat_step * part.coat)
    return ops.where(part.here, (bright | coated) & _matt(part), plain)


@helper
def _narrow_over_base(part: Slabs, plain: Lane) -> Lane:
    narrow = (part.facets.alpha <= NARROW) | ((part.coat > 0.0) & (part.coat_facets.alpha <= NARROW))
    return ops.where(part.here, narrow & _matt(part), plain)


@helper
def _glossy(part: Slabs, plain: Lane) -> Lane:
    polished = (part.facets.alpha < MAX_REFLECTION_ALPHA) | ((part.coat > 0.0) & (part.coat_facets.alpha < MAX_REFLECTION_ALPHA))
    return ops.where(part.here, polished | (part.metal > 0.0), plain)


@helper
def is_active(part: Slabs) -> bool:
    """Whether the material of some lane has slabs."""
    return ops.any_lane(part.here)


_if_active = functools.partial(specialize_if_present, is_active=is_active)

# Each takes slabs, the result without them, and: the normal, the direction to the light, the direction to the viewer.
reflected = _if_active(_reflected)  # π f cos
eval_pdf = _if_active(_eval_pdf)  # (π f cos, density of `draw`)
eval_lobes_pdf = _if_active(_eval_lobes_pdf)  # (π f cos of the diffuse lobes, of the highlights, density of `sample` of highlights)
eval_matt = _if_active(_eval_matt)  # π f cos of the diffuse lobes
matt_share = _if_active(_matt_share)  # π f of the diffuse lobes
draw = _if_active(_draw)  # (direction, whether it counts): normal, viewer, u, v, number 0 to 1
sample = _if_active(_sample)  # (direction, f cos / density): normal, viewer, u, v, number, whether of all lobes or of highlights
one = _if_active(_one)  # 1 for slabs
diffuse_part = _if_active(_diffuse_part)  # see bsdf.diffuse_part
or_slabs = specialize_if_present(_or_slabs)  # `plain`, or whether it has slabs
or_matt = _if_active(_or_matt)  # `plain`, or whether it has a diffuse lobe
or_polished = _if_active(_or_polished)  # `plain`, or whether all its lobes are narrow: greatest α
bright = _if_active(_bright)  # whether it is diffuse under a bright, narrow highlight
narrow_over_base = _if_active(_narrow_over_base)  # whether it is diffuse under a narrow highlight
or_through = _if_active(_scatters_through)  # `plain`, or whether it scatters light to its other side
or_refracts = _if_active(_refracts)  # `plain`, or whether it refracts
eta = _if_active(_eta)  # index of this side over the other's
glossy = _if_active(_glossy)  # whether its highlight shows surroundings
