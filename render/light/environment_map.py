"""Importance sampling of environment maps by luminance.

Sampling inverts cumulative sums, first over rows, then over the cells of a row, which preserves stratification (Pharr, Jakob, Humphreys,
"Physically Based Rendering", 4th ed., §12.5). The mean luminance is subtracted first (Karlík et al. 2019, "MIS Compensation"): BSDF
samples find the uniform part. Where light samples alone find the sky (see `is_sampled_alone`), nothing is subtracted.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.ir import light_links
from ...lights import PICTURED, SKIES
from ..image import metrics
from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import affine, ops
from ..simd.registration import overload
from ..types import Lane, Tables, Vec
from . import lights, sky_openings
from .sky_openings import search

CELLS = 1024  # greatest width
COARSE = 256  # width of the map of several skies
EVEN = 1e-4  # share of the light above the mean below which the map is not sampled


class Even(NamedTuple):
    """No sky, or a uniform one: not sampled."""


class SkyMap(NamedTuple):
    """The sampling tables of an environment map, in a frame of its own."""

    matrix: NDArray[np.float64]  # (1, 3, 4) to the world
    inverse: NDArray[np.float64]
    rows: NDArray[np.float64]  # (height + 1,) cumulative share of the rows, from the top
    columns: NDArray[np.float64]  # (height × (width + 1),) cumulative share within each row
    density: NDArray[np.float64]  # (height × width,) over solid angle
    width: int  # of the map; flat tables let one kernel serve every size
    height: int
    power: float  # of its light above the mean
    row: int  # of emitters; -1: not sampled
    openings: Any = sky_openings.NoOpenings()  # or sky_openings.Openings


def build(
    tables: ir.Tables, row: int, horizon: NDArray[np.float64] | None, general: bool = False, learns: bool = False
) -> SkyMap | Even:  # fmt: skip
    """Build the map of all skies and domes with shadows; directions below a `horizon` (its unit normal) get no samples.

    Without an uneven sky: Even, or with `general` a map without a row of emitters. With `learns` the map holds all of the sky, and empty
    histograms of what places see of it.
    """
    openings = sky_openings.empty() if general or learns else sky_openings.NoOpenings()
    sky_map = _build(tables, row, horizon, learns)
    if general and isinstance(sky_map, Even):
        return empty_map()._replace(openings=openings)
    return sky_map if isinstance(sky_map, Even) else sky_map._replace(openings=openings)


def empty_map() -> SkyMap:
    """A map without a row of emitters."""
    frame, edges = np.eye(3, 4)[None], np.array([0.0, 1.0])
    return SkyMap(frame, frame, edges, edges, np.zeros(1), 1, 1, 0.0, -1)


def _build(tables: ir.Tables, row: int, horizon: NDArray[np.float64] | None, learns: bool) -> SkyMap | Even:
    lit = tables.lights
    kinds = ir.is_in(lit.kind, SKIES) & lit.shadows
    domes = np.flatnonzero(kinds & ir.is_in(lit.kind, PICTURED) & (lit.image >= 0) & lit.color.any(axis=1))
    alone = learns or is_sampled_alone(tables)
    if not len(domes) and not (alone and lit.color[kinds].any()):
        return Even()
    frame = int(lit.transform[domes[0]]) if len(domes) else 0
    if learns and not len(domes):
        bright = np.full((1, 1), float((lit.color[kinds] @ metrics.LUMINANCE).sum()))
    else:
        bright = _image_luminance(tables, int(domes[0])) if len(domes) == 1 else _sky_luminance(tables, tables.transforms.matrix[frame])
    if alone and len(domes) == 1:
        bright = bright + float((lit.color[kinds & ~ir.is_in(lit.kind, PICTURED)] @ metrics.LUMINANCE).sum())
    return _of_luminance(tables, frame, bright, horizon, alone, row)[0]


def of_dome(tables: ir.Tables, light: int, horizon: NDArray[np.float64] | None) -> tuple[SkyMap | Even, float, float]:
    """(map of one dome's light above the mean, its share of the dome's light, second moment of samples of both over cosine samples)."""
    bright = _image_luminance(tables, light)
    sky_map, share = _of_luminance(tables, int(tables.lights.transform[light]), bright, horizon, False, 0)
    return sky_map, share, 1.0 if isinstance(sky_map, Even) else _moment_ratio(bright, sky_map, share)


def _moment_ratio(bright: NDArray[np.float64], sky_map: SkyMap, share: float) -> float:
    """Second moment of one-sample MIS of a map and of cosines over that of cosines alone, a mean over all normals without blockers."""
    height = len(bright)
    solid = -np.diff(np.cos(np.pi * np.arange(height + 1) / height))[:, None]
    squared, of_map = bright**2 * solid, share * sky_map.density.reshape(bright.shape)
    cosines = (np.arange(8) + 0.5) / 8.0
    mixed = sum(float(np.sum(squared * (c / np.pi) ** 2 / (of_map + (1.0 - share) * c / np.pi))) for c in cosines) / 8.0
    return mixed / max(float(np.sum(squared)) * 0.5 / np.pi, lights.TINY)


def _of_luminance(
    tables: ir.Tables, frame: int, bright: NDArray[np.float64], horizon: NDArray[np.float64] | None, alone: bool, row: int
) -> tuple[SkyMap | Even, float]:  # fmt: skip
    """(map, share of the light that it holds) of a luminance (h, w) in a frame, less the mean unless `alone`."""
    matrix = tables.transforms.matrix[[frame]]
    height, width = bright.shape
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    solid = (2.0 * np.pi / width) * (edges[:-1] - edges[1:])[:, None]
    integral = float(np.sum(bright * solid))
    more = np.maximum(bright - (0.0 if alone else integral / (4.0 * np.pi)), 0.0)
    if horizon is not None:
        more[_below(matrix[0], horizon, height, width)] = 0.0
    total = float(np.sum(more * solid))
    if not total > EVEN * integral:
        return Even(), 0.0
    share = more * solid
    columns = np.concatenate([np.zeros((height, 1)), np.cumsum(share, axis=1)], axis=1)
    rows = np.concatenate([[0.0], np.cumsum(columns[:, -1])]) / columns[:, -1].sum()
    columns /= np.maximum(columns[:, -1:], 1e-300)
    columns[:, -1], rows[-1] = 1.0, 1.0
    inverse = tables.transforms.inverse[[frame]]
    sky_map = SkyMap(matrix, inverse, rows, columns.ravel(), (more / total).ravel(), width, height, total, row)
    return sky_map, total / integral


def is_sampled_alone(tables: ir.Tables) -> bool:
    """Whether light samples alone find the sky, as not every shadow caster blocks it: the objects that BSDF samples meet do."""
    lit = tables.lights
    skies = ir.is_in(lit.kind, SKIES) & lit.shadows
    return bool((skies & light_links.selective(tables)).any())


def _image_luminance(tables: ir.Tables, light: int) -> NDArray[np.float64]:
    """(h, w) mean luminance of a dome's bilinear image over each cell."""
    images, image = tables.images, int(tables.lights.image[light])
    width, height, first = int(images.width[image]), int(images.height[image]), int(images.first[image])
    texels = images.texels[first : first + width * height, :3].astype(np.float64) * tables.lights.color[light]
    bright = np.maximum(texels @ metrics.LUMINANCE, 0.0).reshape(height, width)
    above, below = np.roll(bright, 1, axis=0), np.roll(bright, -1, axis=0)
    above[0], below[-1] = bright[0], bright[-1]
    bright = 0.75 * bright + 0.125 * (above + below)
    bright = 0.75 * bright + 0.125 * (np.roll(bright, 1, axis=1) + np.roll(bright, -1, axis=1))
    return _downsample(_downsample(bright, CELLS).T, CELLS).T


def _downsample(bright: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Resample to at most so many rows by area averages."""
    count = len(bright)
    if count <= most:
        return bright
    upto = np.concatenate([np.zeros((1, bright.shape[1])), np.cumsum(bright, axis=0)])
    edges = np.arange(most + 1) * (count / most)
    cells = np.minimum(edges.astype(int), count - 1)
    reached = upto[cells] + (edges - cells)[:, None] * bright[cells]
    return np.maximum(np.diff(reached, axis=0), 0.0) * (most / count)


def _sky_luminance(tables: ir.Tables, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """(h, w) luminance of the sum of all skies at cell centers."""
    x, y, z = _world_directions(matrix, COARSE // 2, COARSE)
    light = lights.background(tables, (x, y, z), lights.SHADOWED)[0]
    return np.maximum(np.tensordot(metrics.LUMINANCE, np.stack(light), 1), 0.0).reshape(COARSE // 2, COARSE)


def _world_directions(matrix: NDArray[np.float64], height: int, width: int) -> NDArray[np.float64]:
    """(3, cells) directions of cell centers in world space."""
    turn = matrix[:, :3] / np.linalg.norm(matrix[:, :3], axis=0)
    return turn @ _cell_directions(height, width).reshape(-1, 3).T


def _cell_directions(height: int, width: int) -> NDArray[np.float64]:
    """(h, w, 3) directions of cell centers in the map's frame."""
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    turn = 2.0 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)[None]
    return np.stack([np.cos(latitude) * np.sin(turn), np.sin(latitude) + 0.0 * turn, np.cos(latitude) * np.cos(turn)], axis=-1)


def _below(matrix: NDArray[np.float64], horizon: NDArray[np.float64], height: int, width: int) -> NDArray[np.bool_]:
    """(h, w) cells that lie below a plane entirely."""
    middle = horizon @ _world_directions(matrix, height, width)
    return (middle < -1.5 * np.pi / height).reshape(height, width)


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def sample_map(sky: SkyMap, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction, density) sampled by two numbers in [0, 1)."""
    height, width = sky.height, sky.width
    r = search(sky.rows, ops.int_like(u, 0), height, u)
    first = r * (width + 1)
    c = search(sky.columns, first, width, v)
    above = sky.rows[r]
    du = ops.clip((u - above) / ops.maximum(sky.rows[r + 1] - above, lights.TINY), 0.0, 1.0)
    lower = sky.columns[first + c]
    dv = ops.clip((v - lower) / ops.maximum(sky.columns[first + c + 1] - lower, lights.TINY), 0.0, 1.0)
    top, bottom = ops.cos(ops.to_float(r) * (math.pi / height)), ops.cos(ops.to_float(r + 1) * (math.pi / height))
    y = ops.lerp(top, bottom, du)
    across = ops.sqrt(ops.maximum(1.0 - y * y, 0.0))
    turn = 2.0 * math.pi * (0.5 - (ops.to_float(c) + dv) * (1.0 / width))
    local = (across * ops.sin(turn), y, across * ops.cos(turn))
    return ops.normalize(affine.transform_vector(sky.matrix, 0, local)), sky.density[r * width + c]


@separate_helper
def _density(sky: SkyMap, place: Vec, direction: Vec) -> Lane:
    return _density_by_openings(sky.openings, map_density(sky, direction), place, direction)


@helper
def map_density(sky: SkyMap, direction: Vec) -> Lane:
    """Return the solid angle density of `sample_map`."""
    height, width = sky.height, sky.width
    x, y, z = ops.normalize(affine.transform_vector(sky.inverse, 0, direction))
    s, t = 0.5 - ops.atan2(x, z) * (0.5 / math.pi), 0.5 - ops.asin(ops.clip(y, -1.0, 1.0)) * (1.0 / math.pi)
    r = ops.maximum(ops.minimum(ops.floor_int(t * height), height - 1), 0)
    c = ops.maximum(ops.minimum(ops.floor_int(s * width), width - 1), 0)
    return sky.density[r * width + c]


def sample(sky: Any, tables: Tables, place: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec, Lane]:
    """(direction, radiance, solid angle density) of a sample from a place; radiance 0 for a uniform sky."""
    if isinstance(sky, Even):
        zero = 0.0 * u
        return (zero, zero + 1.0, zero), (zero, zero, zero), zero + 1.0
    return _sample_radiance(sky, tables, place, u, v)


@helper
def _sample_openings(openings: Any, default: tuple[Vec, Lane], sky: SkyMap, place: Vec, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction, density) of the mixture of the map and the openings; `default` is the sample of the map alone."""
    if not openings.share > 0.0:
        return default
    share = sky_openings.share_at(openings, place)
    through = u < share
    narrowed = ops.where(through, u / openings.share, (u - share) / (1.0 - share))
    direction = ops.where3(through, sky_openings.sample(openings, place, narrowed, v), sample_map(sky, narrowed, v)[0])
    return direction, _mixed_density(openings, map_density(sky, direction), place, direction)


@helper
def _mixed_density(openings: Any, map_density: Lane, place: Vec, direction: Vec) -> Lane:
    if not openings.share > 0.0:
        return map_density
    share = sky_openings.share_at(openings, place)
    return map_density + share * (ops.where(share > 0.0, sky_openings.density(openings, place, direction), map_density) - map_density)


_through_openings = specialize_if_present(_sample_openings)
_density_by_openings = specialize_if_present(_mixed_density)


@separate_helper
def _sample_radiance(sky: SkyMap, tables: Tables, place: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec, Lane]:
    direction, density = _through_openings(sky.openings, sample_map(sky, u, v), sky, place, u, v)
    return direction, lights.background(tables, direction, lights.SHADOWED)[0], density


@overload(sample)
def _sample_in_kernels(sky, tables, place, u, v):
    if sky.layout:
        return lambda sky, tables, place, u, v: _sample_radiance(sky, tables, place, u, v)

    def nothing(sky, tables, place, u, v):
        zero = 0.0 * u
        return (zero, zero + 1.0, zero), (zero, zero, zero), zero + 1.0

    return nothing


def density(sky: Any, place: Vec, direction: Vec) -> Lane:
    """Return the solid angle density of `sample`; 0 for a uniform sky."""
    return 0.0 * direction[0] if isinstance(sky, Even) else _density(sky, place, direction)


@overload(density)
def _density_in_kernels(sky, place, direction):
    if sky.layout:
        return lambda sky, place, direction: _density(sky, place, direction)
    return lambda sky, place, direction: 0.0 * direction[0]


def row_of(sky: Any) -> int:
    """Return the map's row of emitters, or -1."""
    return -1 if isinstance(sky, Even) else sky.row


@overload(row_of)
def _row_in_kernels(sky):
    if sky.layout:
        return lambda sky: sky.row
    return lambda sky: -1
