"""Pictures of the sky as emitters: directions drawn by how bright they are, with the density of each.

The picture's cells are a table of two steps, a row by the sum of its cells and a cell of the row, each by its cumulative sum, so that well
spread numbers stay well spread (Pharr, Jakob, Humphreys, "Physically Based Rendering", 4th ed., §12.5). What is even all around
is found as well by any other direction: the mean is taken off first, and only what is brighter is drawn (Karlík et al. 2019, "MIS
Compensation"), so that the rest is found by the rays that go on.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ...compiler import ir
from ..image import metrics
from ..jit.kernel import HELPER, helper, noinline_helper
from ..lanes import affine, ops
from ..types import Lane, Tables, Vec
from . import lights

CELLS = 1024  # across, at the most
COARSE = 256  # across, where several skies are one picture
EVEN = 1e-4  # of all light: less than this above the mean is not worth a direction


class Even(NamedTuple):
    """No sky, or one that is found as well by any direction."""


class SkyMap(NamedTuple):
    """How directions of the sky are drawn, in a frame of its own."""

    matrix: NDArray[np.float64]  # (1, 3, 4) to the world
    inverse: NDArray[np.float64]
    rows: NDArray[np.float64]  # (1, h + 1) cumulative share of the rows, from the top
    columns: NDArray[np.float64]  # (h, w + 1) cumulative share within each row
    density: NDArray[np.float64]  # (h, w) of directions, a solid angle
    power: float  # what a surface may get of it at the most
    row: int  # of emitters


def build(tables: ir.Tables, row: int, horizon: NDArray[np.float64] | None) -> SkyMap | Even:
    """The map of all skies and domes that cast shadows; directions below a `horizon` (its unit normal) are blocked for all."""
    lit = tables.lights
    kinds = np.isin(lit.kind, (ir.LightKind.SKY, ir.LightKind.DOME)) & lit.shadows
    domes = np.flatnonzero(kinds & (lit.kind == ir.LightKind.DOME) & (lit.image >= 0) & lit.color.any(axis=1))
    if not len(domes):
        return Even()
    frame = int(lit.transform[domes[0]])
    matrix = tables.transforms.matrix[[frame]]
    inverse = tables.transforms.inverse[[frame]]
    bright = _cells_of_one(tables, int(domes[0])) if len(domes) == 1 else _cells_of_all(tables, matrix[0])
    height, width = bright.shape
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    solid = (2.0 * np.pi / width) * (edges[:-1] - edges[1:])[:, None]
    whole = float(np.sum(bright * solid))
    more = np.maximum(bright - whole / (4.0 * np.pi), 0.0)
    if horizon is not None:
        more[_below(matrix[0], horizon, height, width)] = 0.0
    total = float(np.sum(more * solid))
    if not total > EVEN * whole:
        return Even()
    share = more * solid
    columns = np.concatenate([np.zeros((height, 1)), np.cumsum(share, axis=1)], axis=1)
    rows = np.concatenate([[0.0], np.cumsum(columns[:, -1])]) / columns[:, -1].sum()
    columns /= np.maximum(columns[:, -1:], 1e-300)
    columns[:, -1], rows[-1] = 1.0, 1.0
    return SkyMap(matrix, inverse, rows[None], columns, more / total, total, row)


def _cells_of_one(tables: ir.Tables, light: int) -> NDArray[np.float64]:
    """(h, w) how bright a dome's picture is in the mean over each cell, as it is looked up: bilinearly."""
    images, image = tables.images, int(tables.lights.image[light])
    width, height, first = int(images.width[image]), int(images.height[image]), int(images.first[image])
    texels = images.texels[first : first + width * height, :3].astype(np.float64) * tables.lights.color[light]
    bright = np.maximum(texels @ metrics.LUMINANCE, 0.0).reshape(height, width)
    above, below = np.roll(bright, 1, axis=0), np.roll(bright, -1, axis=0)
    above[0], below[-1] = bright[0], bright[-1]
    bright = 0.75 * bright + 0.125 * (above + below)
    bright = 0.75 * bright + 0.125 * (np.roll(bright, 1, axis=1) + np.roll(bright, -1, axis=1))
    return _fewer(_fewer(bright, CELLS).T, CELLS).T


def _fewer(bright: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Rows joined until there are no more than so many, each the mean of what it covers of the old ones."""
    count = len(bright)
    if count <= most:
        return bright
    upto = np.concatenate([np.zeros((1, bright.shape[1])), np.cumsum(bright, axis=0)])
    edges = np.arange(most + 1) * (count / most)
    whole = np.minimum(edges.astype(int), count - 1)
    reached = upto[whole] + (edges - whole)[:, None] * bright[whole]
    return np.maximum(np.diff(reached, axis=0), 0.0) * (most / count)


def _cells_of_all(tables: ir.Tables, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """(h, w) how bright all skies together are at the middle of each cell."""
    x, y, z = _turned(matrix, COARSE // 2, COARSE)
    light = lights.background(tables, (x, y, z), lights.SHADOWED)[0]
    return np.maximum(np.tensordot(metrics.LUMINANCE, np.stack(light), 1), 0.0).reshape(COARSE // 2, COARSE)


def _turned(matrix: NDArray[np.float64], height: int, width: int) -> NDArray[np.float64]:
    """(3, cells) the world's directions of cells' middles."""
    turn = matrix[:, :3] / np.linalg.norm(matrix[:, :3], axis=0)
    return turn @ _middles(height, width).reshape(-1, 3).T


def _middles(height: int, width: int) -> NDArray[np.float64]:
    """(h, w, 3) directions of cells' middles, in the map's frame."""
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    turn = 2.0 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)[None]
    return np.stack([np.cos(latitude) * np.sin(turn), np.sin(latitude) + 0.0 * turn, np.cos(latitude) * np.cos(turn)], axis=-1)


def _below(matrix: NDArray[np.float64], horizon: NDArray[np.float64], height: int, width: int) -> NDArray[np.bool_]:
    """(h, w) cells that lie below a plane with all their points."""
    middle = horizon @ _turned(matrix, height, width)
    return (middle < -1.5 * np.pi / height).reshape(height, width)


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def _search(table: Any, row: Lane, count: int, u: Lane) -> Lane:
    """The last place of a row of cumulative shares whose share is not above u."""
    low = ops.int_like(u, 0)
    step = 1
    while step < count:
        step *= 2
    while step > 1:
        step //= 2
        further = ops.minimum(low + step, count - 1)
        low = ops.where((low + step < count) & (table[row, further] <= u), further, low)
    return low


@helper
def _sample(sky: SkyMap, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction, density) drawn by two numbers in [0, 1)."""
    height, width = sky.density.shape[0], sky.columns.shape[1] - 1
    all_rows = ops.int_like(u, 0)
    r = _search(sky.rows, all_rows, height, u)
    c = _search(sky.columns, r, width, v)
    above = sky.rows[all_rows, r]
    du = ops.clip((u - above) / ops.maximum(sky.rows[all_rows, r + 1] - above, lights.TINY), 0.0, 1.0)
    left = sky.columns[r, c]
    dv = ops.clip((v - left) / ops.maximum(sky.columns[r, c + 1] - left, lights.TINY), 0.0, 1.0)
    top, bottom = ops.cos(ops.to_float(r) * (math.pi / height)), ops.cos(ops.to_float(r + 1) * (math.pi / height))
    y = ops.lerp(top, bottom, du)
    across = ops.sqrt(ops.maximum(1.0 - y * y, 0.0))
    turn = 2.0 * math.pi * (0.5 - (ops.to_float(c) + dv) * (1.0 / width))
    local = (across * ops.sin(turn), y, across * ops.cos(turn))
    return ops.normalize(affine.transform_vector(sky.matrix, 0, local)), sky.density[r, c]


@helper
def _density(sky: SkyMap, direction: Vec) -> Lane:
    height, width = sky.density.shape[0], sky.columns.shape[1] - 1
    x, y, z = ops.normalize(affine.transform_vector(sky.inverse, 0, direction))
    s, t = 0.5 - ops.atan2(x, z) * (0.5 / math.pi), 0.5 - ops.asin(ops.clip(y, -1.0, 1.0)) * (1.0 / math.pi)
    r = ops.maximum(ops.minimum(ops.floor_int(t * height), height - 1), 0)
    c = ops.maximum(ops.minimum(ops.floor_int(s * width), width - 1), 0)
    return sky.density[r, c]


def sample(sky: Any, tables: Tables, u: Lane, v: Lane) -> tuple[Vec, Vec, Lane]:
    """(direction, radiance from there, density of it); nothing where the sky is even."""
    if isinstance(sky, Even):
        zero = 0.0 * u
        return (zero, zero + 1.0, zero), (zero, zero, zero), zero + 1.0
    return _sampled(sky, tables, u, v)


@helper
def _sampled(sky: SkyMap, tables: Tables, u: Lane, v: Lane) -> tuple[Vec, Vec, Lane]:
    direction, density = _sample(sky, u, v)
    return direction, lights.background(tables, direction, lights.SHADOWED)[0], density


_sampled_apart, _density_apart = noinline_helper(_sampled), noinline_helper(_density)


@overload(sample, jit_options=HELPER)
def _sample_in_kernels(sky, tables, u, v):
    if sky.layout:
        return lambda sky, tables, u, v: _sampled_apart(sky, tables, u, v)

    def nothing(sky, tables, u, v):
        zero = 0.0 * u
        return (zero, zero + 1.0, zero), (zero, zero, zero), zero + 1.0

    return nothing


def density(sky: Any, direction: Vec) -> Lane:
    """How likely `sample` takes a direction; 0 where the sky is even."""
    return 0.0 * direction[0] if isinstance(sky, Even) else _density(sky, direction)


@overload(density, jit_options=HELPER)
def _density_in_kernels(sky, direction):
    if sky.layout:
        return lambda sky, direction: _density_apart(sky, direction)
    return lambda sky, direction: 0.0 * direction[0]


def row_of(sky: Any) -> int:
    """The map's row of emitters, -1 where there is none."""
    return -1 if isinstance(sky, Even) else sky.row


@overload(row_of, jit_options=HELPER)
def _row_in_kernels(sky):
    if sky.layout:
        return lambda sky: sky.row
    return lambda sky: -1
