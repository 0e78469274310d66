"""Random walks on the microsurface: the oracle of multiple scattering between GGX facets.

Heitz, Hanika, d'Eon, Dachsbacher 2016, Multiple-Scattering Microfacet BSDFs with the Smith Model: heights are even over (−1, 1), Smith's
free paths, facets as visible from the ray. The z axis is the normal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from maquette.render.material import rough_dielectric

Array = np.ndarray[Any, Any]
MOST = 40  # bounces; those who have more are left out


class Walks(NamedTuple):
    """Light from one direction."""

    direction: Array  # (n, 3) in which it leaves; 0 where it has not left
    bounces: Array  # (n,) MOST + 1 where it has not left
    weight: Array  # (n, channels) product of the reflectances; 1 for dielectrics, which choose


class Bins(NamedTuple):
    """Bins of equal solid angle: by the cosine, and by half a turn from the incoming direction."""

    cosines: int = 20
    turns: int = 18
    inner: int = 6  # points of a bin along each axis
    both: bool = False  # also below the surface


def conductor(cosine: float, alpha: float, count: int, fresnel: Callable[[Array], Array], seed: int = 1) -> Walks:
    """Walks on a metal; `fresnel` maps (n,) cosines to (n, channels)."""
    rng = np.random.default_rng(seed)
    way, height = _start(cosine, count), np.ones(count)
    left, found = np.arange(count), np.zeros((count, 3))
    bounces, weight = np.full(count, MOST + 1), np.ones((count, fresnel(np.ones(1)).shape[1]))
    for k in range(MOST + 1):
        height, away = _fly(way[:, 2], height, alpha, rng)
        found[left[away]], bounces[left[away]] = way[away], k
        way, height, left = way[~away], height[~away], left[~away]
        facet = _visible_facet(-way, alpha, rng)
        along = np.clip(-np.sum(way * facet, axis=1), 0.0, 1.0)
        weight[left] *= fresnel(along)
        way = way + 2.0 * along[:, None] * facet
    return Walks(found, bounces, weight)


def sent_to(cosine: float, alpha: float, count: int, fresnel: Callable[[Array], Array], to: Array, seed: int = 1) -> Array:
    """(channels, directions) f cos of two bounces and more towards (directions, 3): each facet adds its chance to send light there."""
    rng = np.random.default_rng(seed)
    way, height = _start(cosine, count), np.ones(count)
    weight = np.ones((count, fresnel(np.ones(1)).shape[1]))
    found, smith = np.zeros((weight.shape[1], len(to))), _smith(to[:, 2], alpha)
    for k in range(MOST + 1):
        height, away = _fly(way[:, 2], height, alpha, rng)
        way, height, weight = way[~away], height[~away], weight[~away]
        seen = np.maximum((1.0 + _smith(-way[:, 2], alpha)) * -way[:, 2], 1e-9)
        below = np.clip(0.5 * (height + 1.0), 0.0, 1.0)
        for j in range(len(to) if k else 0):
            half = to[j] - way
            half /= np.linalg.norm(half, axis=1, keepdims=True)
            along = np.clip(-np.sum(way * half, axis=1), 0.0, 1.0)
            size = 1.0 - half[:, 2] ** 2 * (1.0 - alpha * alpha)
            chance = np.where(half[:, 2] > 0.0, alpha * alpha / (math.pi * size * size) / (4.0 * seen) * below ** smith[j], 0.0)
            found[:, j] += (weight * fresnel(along) * chance[:, None]).sum(axis=0)
        facet = _visible_facet(-way, alpha, rng)
        along = np.clip(-np.sum(way * facet, axis=1), 0.0, 1.0)
        weight = weight * fresnel(along)
        way = way + 2.0 * along[:, None] * facet
    return found / count


def dielectric(cosine: float, alpha: float, count: int, ratio: float, seed: int = 1) -> Walks:
    """Walks on a boundary to an index `ratio` times that of the side from which light comes."""
    rng = np.random.default_rng(seed)
    way, height, above = _start(cosine, count), np.ones(count), np.ones(count, bool)
    left, found, bounces = np.arange(count), np.zeros((count, 3)), np.full(count, MOST + 1)
    for k in range(MOST + 1):
        side = np.where(above, 1.0, -1.0)
        height, away = _fly(way[:, 2] * side, height * side, alpha, rng)
        height = height * side
        found[left[away]], bounces[left[away]] = way[away], k
        way, height, above, side, left = way[~away], height[~away], above[~away], side[~away], left[~away]
        facet = _visible_facet(-way * side[:, None], alpha, rng) * side[:, None]
        along = np.clip(-np.sum(way * facet, axis=1), 0.0, 1.0)
        index = np.where(above, ratio, 1.0 / ratio)
        turned = rng.random(len(along)) < rough_dielectric.reflectance(along, index)
        bent = np.sqrt(np.maximum(1.0 - (1.0 - along * along) / index**2, 0.0))
        through = way / index[:, None] + facet * (along / index - bent)[:, None]
        through = through / np.maximum(np.linalg.norm(through, axis=1, keepdims=True), 1e-12)
        way = np.where(turned[:, None], way + 2.0 * along[:, None] * facet, through)
        above = above == turned
    return Walks(found, bounces, np.ones((count, 1)))


def schlick(f0: tuple[float, ...]) -> Callable[[Array], Array]:
    """Schlick's reflectance."""
    base = np.array(f0)
    return lambda cosine: base + (1.0 - base) * (1.0 - cosine[:, None]) ** 5


def counts(walks: Walks, chosen: Array, bins: Bins) -> Array:
    """(channels, cosines, turns) share of the light of the chosen walks that leaves in each bin."""
    turn = np.abs(np.arctan2(walks.direction[:, 1], walks.direction[:, 0]))
    low = -1.0 if bins.both else 0.0
    edges = [np.linspace(low, 1.0, bins.cosines + 1), np.linspace(0.0, math.pi, bins.turns + 1)]
    z = np.clip(walks.direction[:, 2], low, 1.0 - 1e-12)
    return np.stack([np.histogram2d(z, turn, edges, weights=w * chosen)[0] / len(z) for w in walks.weight.T])


def points(bins: Bins) -> tuple[Array, Array]:
    """(cosines, turns) inside all bins, as flat arrays."""
    low = -1.0 if bins.both else 0.0
    cosine = low + (1.0 - low) * (np.arange(bins.cosines * bins.inner) + 0.5) / (bins.cosines * bins.inner)
    turn = math.pi * (np.arange(bins.turns * bins.inner) + 0.5) / (bins.turns * bins.inner)
    found = np.meshgrid(cosine, turn, indexing="ij")
    return found[0].ravel(), found[1].ravel()


def integrate(values: Array, bins: Bins) -> Array:
    """(cosines, turns) integrals over bins of a density over solid angle, at `points`."""
    cell = 2.0 * math.pi * (2.0 if bins.both else 1.0) / (bins.cosines * bins.turns * bins.inner**2)
    return cell * values.reshape(bins.cosines, bins.inner, bins.turns, bins.inner).sum(axis=(1, 3))


def _start(cosine: float, count: int) -> Array:
    return np.tile([-math.sqrt(1.0 - cosine * cosine), 0.0, -cosine], (count, 1))


def _smith(cosine: Array, alpha: float) -> Array:
    """Λ for directions on either side."""
    slope = np.maximum(1.0 - cosine * cosine, 0.0) / np.maximum(cosine * cosine, 1e-30)
    return 0.5 * (np.sign(cosine) * np.sqrt(1.0 + alpha * alpha * slope) - 1.0)


def _fly(cosine: Array, height: Array, alpha: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """(height of the next facet, whether the ray leaves instead)."""
    draw, below = rng.random(len(cosine)), np.clip(0.5 * (height + 1.0), 0.0, 1.0)
    smith = _smith(cosine, alpha)
    away = (cosine > 0.0) & (draw < below ** np.maximum(smith, 0.0))
    with np.errstate(all="ignore"):
        next_ = below * draw ** (-1.0 / smith)
    flat = np.abs(cosine) < 1e-6
    return np.where(flat, height, 2.0 * np.clip(np.nan_to_num(next_), 0.0, 1.0) - 1.0), away & ~flat


def _visible_facet(to_viewer: Array, alpha: float, rng: np.random.Generator) -> Array:
    """Visible normals for directions on either side (Dupuy and Benyoub 2023)."""
    stretch = np.array([alpha, alpha, 1.0])
    seen = to_viewer * stretch
    seen = seen / np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-30)
    turn, z = 2.0 * math.pi * rng.random(len(seen)), (1.0 - rng.random(len(seen))) * (1.0 + seen[:, 2]) - seen[:, 2]
    flat = np.sqrt(np.clip(1.0 - z * z, 0.0, 1.0))
    facet = (np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1) + seen) * stretch
    facet[:, 2] = np.maximum(facet[:, 2], 1e-12)
    return facet / np.linalg.norm(facet, axis=1, keepdims=True)
