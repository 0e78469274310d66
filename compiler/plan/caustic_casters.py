"""Light that mirrors and glass gather: which things do that, from which lamps, and whether paths from the eye would ever find it.

A path finds a lamp behind glass by chance alone: its matt surface sends it on in a random direction, and where the lamp fills a hundredth
of what is seen there one path in hundreds has all its light. A point it never finds.
"""

from __future__ import annotations

import math

import numpy as np

from .. import ir
from . import scene_facts

SMALL = 0.3  # steradians of what a gathering thing sees, below which a lamp is found too seldom (of a hemisphere one in twenty)
POLISHED = 0.54  # roughness up to which a metal or glass gathers; its square is below render/materials.POLISHED
BRIGHT = 0.1  # reflectance of the course's lobes, which grow no brighter at grazing angles, below which paths find their light well enough
PEAK, FAINT_PEAK = 8.0, 200.0  # but that of the narrowest: 8 times what is sent at the peak, over what an even surface does; of faint ones
COAT = 0.04  # reflectance of a coat along its normal; as render/microfacet.COAT
FAINT = 0.1  # of what a highlight reflects, the least that is aimed for: it reflects more of what grazes it
CARRIERS = ("photons", "paths")
FLAT = 1e-3  # roughness whose square is below is none; as render/microfacet.SHARP
LAMPS = (
    ir.LightKind.POINT, ir.LightKind.SPOT, ir.LightKind.DIRECTIONAL, ir.LightKind.SUN, ir.LightKind.RECTANGLE, ir.LightKind.DISK,
    ir.LightKind.SPHERE,
)  # fmt: skip
FAR = (ir.LightKind.DIRECTIONAL, ir.LightKind.SUN)
_LAYERED = (ir.MaterialModel.PRINCIPLED, ir.MaterialModel.PRINCIPLED_SPECULAR, ir.MaterialModel.METAL)


def sharp_materials(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: those that mirror, or let light through, without spreading it, anywhere; parts of blends count for the blend."""
    m, slot = tables.materials, ir.Slot

    def may_be(which: int, at_most: float = 0.0) -> np.ndarray:
        return (m.values[:, which].max(axis=1, initial=0.0) > at_most) | (m.textures[:, which] >= 0)

    flat = (m.values[:, slot.ROUGHNESS, 0] ** 2 < FLAT) | (m.textures[:, slot.ROUGHNESS] >= 0)
    sharp = may_be(slot.REFLECTION) | (may_be(slot.TRANSMISSION) & (m.model != ir.MaterialModel.GLASS))
    sharp |= ir.is_in(m.model, (*_LAYERED, ir.MaterialModel.GLASS)) & flat
    for row in np.flatnonzero(m.model == ir.MaterialModel.BLEND):  # parts have lower rows than their blends
        sharp[row] = sharp[m.first[row]] | sharp[m.second[row]]
    return sharp


def polished_materials(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: metals and glass neither rough nor smooth as mirrors are, anywhere; parts of blends count for the blend."""
    m, slot = tables.materials, ir.Slot
    polished = (m.values[:, slot.ROUGHNESS, 0] <= POLISHED) | (m.textures[:, slot.ROUGHNESS] >= 0)
    metallic = (m.values[:, slot.METALLIC, 0] >= 1.0) | (m.textures[:, slot.METALLIC] >= 0) | (m.model == ir.MaterialModel.METAL)
    found = ir.is_in(m.model, _LAYERED) & polished & metallic
    frosted = (m.values[:, slot.ROUGHNESS, 0] > 0.0) | (m.textures[:, slot.ROUGHNESS] >= 0)
    found |= (m.model == ir.MaterialModel.GLASS) & polished & frosted
    for row in np.flatnonzero(m.model == ir.MaterialModel.BLEND):
        found[row] = found[m.first[row]] | found[m.second[row]]
    return found


def gleam(tables: ir.Tables) -> np.ndarray:
    """(materials,) about what highlights reflect that are bright and narrow (render/materials.gleams) over something matt, at the most;

    0 of materials without. Parts of blends count for the blend.
    """
    m, slot = tables.materials, ir.Slot

    def most(which: int, textured: float) -> np.ndarray:
        return np.where(m.textures[:, which] >= 0, textured, m.values[:, which].max(axis=1, initial=0.0))

    def reflects(f0: np.ndarray, rough: np.ndarray) -> np.ndarray:
        return np.where((rough <= POLISHED) & (4.0 * rough**4 <= f0), f0, 0.0)

    ior = np.maximum(m.values[:, slot.IOR, 0], 1e-3)
    boundary = np.where(m.textures[:, slot.IOR] >= 0, 1.0, ((ior - 1.0) / (ior + 1.0)) ** 2)
    metallic = np.clip(most(slot.METALLIC, 1.0), 0.0, 1.0)
    f0 = np.maximum(boundary, np.minimum(most(slot.DIFFUSE, 1.0), 1.0) * metallic)
    f0 = np.where(m.model == ir.MaterialModel.PRINCIPLED_SPECULAR, most(slot.SPECULAR, 1.0), f0)
    least = np.where(m.textures[:, slot.ROUGHNESS] >= 0, 0.0, m.values[:, slot.ROUGHNESS, 0])
    least_coat = np.where(m.textures[:, slot.COAT_ROUGHNESS] >= 0, 0.0, m.values[:, slot.COAT_ROUGHNESS, 0])
    layered = ir.is_in(m.model, (ir.MaterialModel.PRINCIPLED, ir.MaterialModel.PRINCIPLED_SPECULAR))
    found = np.where(layered, np.maximum(reflects(f0, least), reflects(COAT * most(slot.COAT, 1.0), least_coat)), 0.0)
    specular = most(slot.SPECULAR, 1.0)
    narrow = m.normalized & (specular * (most(slot.SHININESS, np.inf) + 2.0) >= np.where(specular >= BRIGHT, PEAK, FAINT_PEAK))
    found = np.where(narrow & ~layered, specular, found)
    for row in np.flatnonzero(m.model == ir.MaterialModel.BLEND):
        found[row] = max(found[m.first[row]], found[m.second[row]])
    return np.clip(found, 0.0, 1.0)


def gains(tables: ir.Tables) -> np.ndarray:
    """(instances,) about what things reflect, of those that gather light: 1, or of highlights over something matt less; 0 of others."""
    whole = (sharp_materials(tables) | polished_materials(tables))[tables.instances.material]
    part = gleam(tables)[tables.instances.material]
    return np.where(whole, 1.0, np.maximum(part, FAINT)) * gathering(tables)


def matt_materials(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: those that spread light."""
    m, slot = tables.materials, ir.Slot
    matt = (m.values[:, [slot.DIFFUSE, slot.SPECULAR]].max(axis=(1, 2), initial=0.0) > 0.0) | (m.textures[:, slot.DIFFUSE] >= 0)
    matt |= ir.is_in(m.model, (*_LAYERED, ir.MaterialModel.BLEND))
    return matt & ~ir.is_in(m.model, (ir.MaterialModel.MIRROR,))


def balls(tables: ir.Tables) -> tuple[np.ndarray, np.ndarray]:
    """((instances, 3) centres, (instances,) radii) of balls round things in the world; radius inf of what is endless."""
    instances = tables.instances
    matrix, kind = tables.transforms.matrix[instances.transform], tables.geometries.kind[instances.geometry]
    bounds = tables.geometries.bounds[instances.geometry]
    finite = np.asarray(np.isfinite(bounds).all(axis=(1, 2)))
    with np.errstate(invalid="ignore"):
        middle, half = bounds.mean(axis=1), 0.5 * (bounds[:, 1] - bounds[:, 0])
    middle, half = (np.where(finite[:, None], x, 0.0) for x in (middle, half))
    centre = np.einsum("nij,nj->ni", matrix[:, :, :3], middle) + matrix[:, :, 3]
    corners = np.array([[1, y, z] for y in (-1, 1) for z in (-1, 1)])[None] * half[:, None, :]  # half of them: the others lie across
    radius = np.linalg.norm(np.einsum("nij,nkj->nki", matrix[:, :, :3], corners), axis=2).max(axis=1, initial=0.0)
    stretch = np.linalg.norm(matrix[:, :, :3], ord=2, axis=(1, 2)) if len(matrix) else np.zeros(0)
    radius = np.where(kind == ir.GeometryKind.SPHERE, stretch * half.max(axis=1, initial=0.0), radius)
    return centre, np.where(finite, radius, np.inf)


def gathering(tables: ir.Tables) -> np.ndarray:
    """(instances,) bool: things that mirror or bend light without spreading it much."""
    seen = tables.instances.visible & ir.Visibility.REFLECTION != 0
    whole = sharp_materials(tables) | polished_materials(tables)
    found, gleaming = whole[tables.instances.material], gleam(tables) > 0.0
    if gleaming.any():
        found = found | (gleaming[tables.instances.material] & np.isfinite(balls(tables)[1]))  # what is endless cannot be aimed at
    return found & seen


def lamps(tables: ir.Tables, all_sizes: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """((lights,), (instances,)) bool: lamps and shining things that gathering things see as small, or of `all_sizes`.

    Light that casts no shadows goes through all that gathers, and light that does not fade by the square of the distance is none of
    this world: neither is among them.
    """
    lit = tables.lights
    centre, radius = balls(tables)
    mirrors = gathering(tables)
    small = math.inf if all_sizes else SMALL
    chosen = ir.is_in(lit.kind, LAMPS) & lit.shadows & (lit.color.max(axis=1, initial=0.0) > 0.0)
    chosen &= lit.falloff == ir.FalloffKind.INVERSE_SQUARE
    for k in np.flatnonzero(chosen):
        kind = lit.kind[k]
        if kind == ir.LightKind.SUN:
            chosen[k] = 2.0 * math.pi * (1.0 - math.cos(float(lit.angle[k]))) < small
        elif kind in (ir.LightKind.RECTANGLE, ir.LightKind.DISK, ir.LightKind.SPHERE):
            matrix = tables.transforms.matrix[lit.transform[k]]
            size = float(np.linalg.norm(matrix[:, :3], 2)) * float(np.max(lit.size[k]))
            chosen[k] = _fills(matrix[:, 3], size, centre[mirrors], radius[mirrors]) < small
    shining = (tables.materials.values[:, ir.Slot.EMISSION].max(axis=1, initial=0.0) > 0.0)[tables.instances.material]
    shining = shining & (tables.instances.light < 0) & np.isfinite(radius)
    for i in np.flatnonzero(shining):
        others = mirrors.copy()
        others[i] = False
        shining[i] = _fills(centre[i], radius[i], centre[others], radius[others]) < small
    return chosen, shining


def _fills(place: np.ndarray, size: float, centre: np.ndarray, radius: np.ndarray) -> float:
    """About the steradians that a ball at a place fills, seen from the nearest point of any of some balls."""
    away = np.linalg.norm(centre - place, axis=1) - np.where(np.isfinite(radius), radius, 0.0)
    nearest = float(away.min(initial=math.inf))
    return 4.0 * math.pi if nearest <= size else 2.0 * math.pi * (1.0 - math.sqrt(1.0 - (size / nearest) ** 2))


def carrier(tables: ir.Tables, transport: str, backend: str, moves: bool) -> tuple[str, str, tuple[str, ...]]:
    """(what carries light that mirrors and glass gather: "photons", "paths" or "none"; why; what else may)."""
    chance = CARRIERS[1:]
    mirrors = gathering(tables)
    if not mirrors.any() or not (matt_materials(tables) & scene_facts.used_materials(tables)).any():
        return "paths", "nothing mirrors or bends light onto matt things", chance
    if transport != "path":
        return "none", "the tree looks for lamps from matt things straight: write --bounces", ("none",)
    if backend != "ray":
        return "paths", "the ray backend alone has photons", chance
    if moves:
        return "paths", "things move: photons fly at other times than paths", chance
    small, shining = lamps(tables)
    endless = ~np.isfinite(balls(tables)[1][mirrors])
    if endless.any() and (ir.is_in(tables.lights.kind, FAR) & small).any():
        return "paths", "an endless thing mirrors light from endlessly far: photons cannot be aimed at it", chance
    count = int(small.sum() + shining.sum())
    if not count:
        possible = any(found.any() for found in lamps(tables, all_sizes=True))
        reason = "all lamps are large as seen from what mirrors or bends light: paths find them by chance"
        return "paths", reason, CARRIERS if possible else chance
    what = "is a small lamp" if count == 1 else f"are {count} small lamps"
    things = "a thing that mirrors or bends" if mirrors.sum() == 1 else f"{int(mirrors.sum())} things that mirror or bend"
    return "photons", f"there {what} and {things} light onto matt ones: photons carry it", CARRIERS
