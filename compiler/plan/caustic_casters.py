"""Caustic casters: instances and lights that cause caustics, and whether path tracing would find that light.

A path reaches a light behind glass by chance alone, in a random direction from a diffuse surface. Where the light fills a hundredth of the
view there, one path in hundreds carries all its energy. No path reaches a point light.
"""

from __future__ import annotations

import math

import numpy as np

from ...lights import DISTANT, LIGHTS, PLACED, POINTS, SUNS, SURFACES
from ...materials import traits
from .. import ir
from ..ir import light_links
from . import dome_spots, scene_facts

SMALL = 0.3  # steradians as seen from a caster, below which paths hit a light too seldom (one in twenty of a hemisphere)
SMALL_FOR_DENSE = 0.1  # the same for a caster with a dense medium: light that scatters in it often has many chances to hit a light
DENSE = 10.0  # free paths across a caster's medium, from which it is dense
FAINT = 0.1  # least reflectance that photons are aimed by: highlights reflect more at grazing angles
CARRIERS = ("photons", "paths")
THIN = 4.0  # free paths across a medium, up to which photons in it are beams: in denser ones each has many short flights
MEDIA_CARRIERS = ("beams", "points")


def gains(tables: ir.Tables) -> np.ndarray:
    """(instances,) approximate reflectance of caustic casters: 1, less for highlights over a diffuse base; 0 for others."""
    specular = (traits.sharp(tables) | traits.polished(tables))[tables.instances.material]
    part = traits.narrow_highlights(tables)[tables.instances.material]
    return np.where(specular, 1.0, np.maximum(part, FAINT)) * gathering(tables)


def bounding_spheres(tables: ir.Tables) -> tuple[np.ndarray, np.ndarray]:
    """((instances, 3) centres, (instances,) radii) of bounding spheres in the world; radius inf for unbounded shapes."""
    instances = tables.instances
    matrix, kind = tables.transforms.matrix[instances.transform], tables.geometries.kind[instances.geometry]
    bounds = tables.geometries.bounds[instances.geometry]
    finite = np.asarray(np.isfinite(bounds).all(axis=(1, 2)))
    with np.errstate(invalid="ignore"):
        middle, half = bounds.mean(axis=1), 0.5 * (bounds[:, 1] - bounds[:, 0])
    middle, half = (np.where(finite[:, None], x, 0.0) for x in (middle, half))
    centre = np.einsum("nij,nj->ni", matrix[:, :, :3], middle) + matrix[:, :, 3]
    corners = np.array([[1, y, z] for y in (-1, 1) for z in (-1, 1)])[None] * half[:, None, :]  # half of them: the others are opposite
    radius = np.linalg.norm(np.einsum("nij,nkj->nki", matrix[:, :, :3], corners), axis=2).max(axis=1, initial=0.0)
    stretch = np.linalg.norm(matrix[:, :, :3], ord=2, axis=(1, 2)) if len(matrix) else np.zeros(0)
    radius = np.where(kind == ir.GeometryKind.SPHERE, stretch * half.max(axis=1, initial=0.0), radius)
    return centre, np.where(finite, radius, np.inf)


def gathering(tables: ir.Tables) -> np.ndarray:
    """(instances,) bool: caustic casters, which reflect or refract light in narrow lobes; invisible boundaries of media do neither."""
    seen = (tables.instances.visible & ir.Visibility.REFLECTION != 0) & ~traits.invisible(tables)[tables.instances.material]
    specular = traits.sharp(tables) | traits.polished(tables)
    casters, narrow = specular[tables.instances.material], traits.narrow_highlights(tables) > 0.0
    if narrow.any():
        bounded = np.isfinite(bounding_spheres(tables)[1])  # photons cannot be aimed at unbounded shapes
        casters = casters | (narrow[tables.instances.material] & bounded)
    return casters & seen


def caustic_lights(tables: ir.Tables, all_sizes: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """((lights,), (instances,)) bool: lights and emissive instances that are small as seen from casters, in a bulb, or of `all_sizes`.

    Lights without shadows pass through casters, and lights without inverse-square falloff are not physical: neither counts.
    """
    lit = tables.lights
    centre, radius = bounding_spheres(tables)
    mirrors = gathering(tables)
    small = math.inf if all_sizes else SMALL_FOR_DENSE if holds_dense_medium(tables) else SMALL
    chosen = ir.is_in(lit.kind, PLACED + DISTANT) & lit.shadows & (lit.color.max(axis=1, initial=0.0) > 0.0)
    chosen &= lit.falloff == ir.FalloffKind.INVERSE_SQUARE
    for k in np.flatnonzero(chosen):
        kind = lit.kind[k]
        if kind in SUNS:
            chosen[k] = 2.0 * math.pi * (1.0 - math.cos(float(lit.angle[k]))) < small
        elif kind in SURFACES:
            matrix = tables.transforms.matrix[lit.transform[k]]
            size = float(np.linalg.norm(matrix[:, :3], 2)) * float(np.max(lit.size[k]))
            near = _fills(matrix[:, 3], size, centre[mirrors], radius[mirrors])
            chosen[k] = near < small or bool(enclosing(tables, matrix[None, :, 3])[0])
    shining = traits.emissive(tables)[tables.instances.material]
    shining = shining & (tables.instances.light < 0) & np.isfinite(radius)
    for i in np.flatnonzero(shining):
        others = mirrors.copy()
        others[i] = False
        near = _fills(centre[i], radius[i], centre[others], radius[others])
        shining[i] = near < small or (not mirrors[i] and bool(enclosing(tables, centre[None, i])[0]))
    return chosen, shining


def holds_dense_medium(tables: ir.Tables) -> bool:
    """Whether a caustic caster is around a medium in which light scatters DENSE times and more: photons are as slow there as paths."""
    mirrors, radius = gathering(tables), bounding_spheres(tables)[1]
    row = tables.materials.medium[tables.instances.material]
    held = mirrors & (row >= 0)
    paths = 2.0 * radius[held] * tables.media.scattering[row[held]].max(axis=1, initial=0.0)
    return bool((np.where(np.isfinite(paths), paths, math.inf) >= DENSE).any())


def beam_media(tables: ir.Tables, all_depths: bool = False) -> np.ndarray:
    """(media,) bool: media in which photons are beams: thin ones, or with `all_depths` all whose density has a closed form."""
    media, bodies = tables.media, tables.materials.medium[traits.varying_bodies(tables)]
    closed = (media.density < 0) & (media.scattering.max(axis=1, initial=0.0) > 0.0)
    closed[bodies[bodies >= 0]] = False
    centre, radius = bounding_spheres(tables)
    finite, row = np.isfinite(radius), tables.materials.medium[tables.instances.material]
    across = np.zeros(len(closed))
    np.maximum.at(across, row[row >= 0], 2.0 * radius[row >= 0])
    if finite.any():
        low, high = (centre - radius[:, None])[finite].min(axis=0), (centre + radius[:, None])[finite].max(axis=0)
        across[media.everywhere] = float(np.linalg.norm(high - low))
    paths = np.where(closed, across, 0.0) * media.scattering.max(axis=1, initial=0.0)
    return closed & (all_depths | (paths <= THIN))


def carrier_in_media(tables: ir.Tables, carrier_: str) -> tuple[str, str, tuple[str, ...]]:
    """(form of photons in media: "beams", "points" or "none"; the reason; the possible values)."""
    if carrier_ != "photons" or not (tables.media.scattering > 0.0).any():
        return "none", "no photons scatter in media", ("none",)
    if not beam_media(tables, all_depths=True).any():
        return "points", "each density is a formula or voxels: the light of a beam has no closed form", MEDIA_CARRIERS[1:]
    if not beam_media(tables).any():
        return "points", f"each medium is over {THIN:g} free paths across: photons have many short flights", MEDIA_CARRIERS
    if not _confined(tables):
        return "points", "some light scatters before it meets a caustic caster: its noise is larger than that of photons", MEDIA_CARRIERS
    return "beams", f"all light passes caustic casters, and a medium is at most {THIN:g} free paths across", MEDIA_CARRIERS


def _confined(tables: ir.Tables) -> bool:
    """Whether all light meets a caustic caster first: that of lamps in bulbs, and of spots whose cone a caster fills."""
    lit, (centre, radius), mirrors = tables.lights, bounding_spheres(tables), gathering(tables)
    centre, radius = centre[mirrors], radius[mirrors]
    for k in np.flatnonzero(lit.color.max(axis=1, initial=0.0) > 0.0):
        place = lit.position[k] if lit.kind[k] in POINTS else tables.transforms.matrix[lit.transform[k], :, 3]
        bulb = lit.kind[k] in PLACED and bool(enclosing(tables, place[None])[0])
        way = centre - place
        away = np.maximum(np.linalg.norm(way, axis=1), 1e-12)
        widest = LIGHTS[int(lit.kind[k])].widest if lit.kind[k] in POINTS else None
        fills = False
        if widest is not None:
            off = np.arccos(np.clip(way @ lit.direction[k] / away, -1.0, 1.0)) + widest(lit, int(k))
            fills = bool((off < np.arcsin(np.clip(radius / away, 0.0, 1.0))).any())
        if not (bulb or fills):
            return False
    shining = traits.emissive(tables)[tables.instances.material] & (tables.instances.light < 0)
    return bool(enclosing(tables, bounding_spheres(tables)[0][shining]).all())


def bright_spots(tables: ir.Tables) -> dome_spots.Spots | None:
    """Return the bright spots of a dome that photons may carry; None with unbounded casters, at which they cannot be aimed."""
    bounded = np.isfinite(bounding_spheres(tables)[1][gathering(tables)]).all()
    return dome_spots.find(tables) if bounded else None


def enclosing(tables: ir.Tables, places: np.ndarray) -> np.ndarray:
    """(n,) bool: places (n, 3) in the box of a caster that transmits light, as that of a lamp in its bulb: all its light passes the glass.

    Paths find the bulb as seldom as they would find the lamp.
    """
    instances, clear = tables.instances, traits.clear(tables)
    inside = np.zeros(len(places), bool)
    for row in np.flatnonzero(gathering(tables) & clear[instances.material]).tolist():
        inverse, bounds = tables.transforms.inverse[instances.transform[row]], tables.geometries.bounds[instances.geometry[row]]
        if np.isfinite(bounds).all():
            local = places @ inverse[:, :3].T + inverse[:, 3]
            inside |= ((local > bounds[0]) & (local < bounds[1])).all(axis=1)
    return inside


def _fills(place: np.ndarray, size: float, centre: np.ndarray, radius: np.ndarray) -> float:
    """Approximate solid angle of a sphere, from the nearest point of any of the bounding spheres."""
    away = np.linalg.norm(centre - place, axis=1) - np.where(np.isfinite(radius), radius, 0.0)
    nearest = float(away.min(initial=math.inf))
    return 4.0 * math.pi if nearest <= size else 2.0 * math.pi * (1.0 - math.sqrt(1.0 - (size / nearest) ** 2))


def carrier(tables: ir.Tables, transport: str, backend: str, moves: bool) -> tuple[str, str, tuple[str, ...]]:
    """(what carries caustics: "photons", "paths" or "none"; the reason; the possible values)."""
    chance = CARRIERS[1:]
    mirrors = gathering(tables)
    in_media = bool((tables.media.scattering > 0.0).any())
    if not mirrors.any() or not (in_media or (traits.receives_caustics(tables) & traits.used(tables)).any()):
        return "paths", f"nothing casts caustics onto diffuse surfaces{' or into media' if traits.participates(tables) else ''}", chance
    if transport != "path":
        return "none", "Whitted ray tracing has direct light alone on diffuse surfaces: write --bounces", ("none",)
    if backend != "ray":
        return "paths", "the ray backend alone traces photons", chance
    if moves:
        return "paths", "objects move: photons and paths have different times", chance
    if light_links.are_there(tables):
        return "paths", "some light lights some surfaces only: photons do not know their light's links", chance
    if scene_facts.profiled(tables).any():
        return "paths", "a light's emission depends on the direction: photons are not emitted by profiles", chance
    small, shining = caustic_lights(tables)
    endless = ~np.isfinite(bounding_spheres(tables)[1][mirrors])
    if endless.any() and (ir.is_in(tables.lights.kind, DISTANT) & small).any():
        return "paths", "an unbounded shape reflects a light at infinity: photons cannot be aimed at it", chance
    spots = bright_spots(tables)
    count = int(small.sum() + shining.sum())
    if not count and spots is None:
        possible = any(lights.any() for lights in caustic_lights(tables, all_sizes=True))
        limit = f" around a dense medium (over {SMALL_FOR_DENSE:g} sr)" if holds_dense_medium(tables) else ""
        reason = f"all lights are large as seen from caustic casters{limit}: paths hit them"
        return "paths", reason, CARRIERS if possible else chance
    lights = [] if count == 0 else ["1 small light"] if count == 1 else [f"{count} small lights"]
    if spots is not None:
        lights.append("1 bright spot of a dome" if spots.count == 1 else f"{spots.count} bright spots of a dome")
    casters = "1 caustic caster" if mirrors.sum() == 1 else f"{int(mirrors.sum())} caustic casters"
    return "photons", f"{', '.join(lights)} and {casters}: photons carry the caustics", CARRIERS
