"""Table of scattering media that kernels read, with majorants of their densities.

A density is a formula. Its interval bounds on the cells of a grid are majorants: no point of a cell has a higher density (Woodcock and
others 1965 need one; here it is proved). Rows are numbered as in material/medium_stack.py; row 0 is air.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.formula import upper_bounds
from ...compiler.formula.tape import Tape, load_tape
from . import aims, bodies, guides, phase_table, tracking

F64 = NDArray[np.float64]
CELLS = 32  # of a grid of majorants along its longest side
LEAST_CELLS = 4
SPLIT = 2  # parts of a cell, along each side, whose bounds give its majorant


class NoScattering(NamedTuple):
    """No medium scatters or emits light, and none has an invisible boundary."""


class Scattering(NamedTuple):
    """Media by number."""

    extinction: F64  # (n, 4) per metre in red, green and blue, and the largest of them
    scattering: F64  # (n, 4) likewise
    emission: F64  # (n, 4) radiance per metre, and 0
    anisotropy: F64  # (n,) g of the phase function
    draine: Any  # phase_table.Draine, or NoDraine
    top: F64  # (n,) see ir.Media
    falloff: F64  # (n,)
    clear: NDArray[np.bool_]  # (materials,) invisible boundaries: index 1 on both sides, without colour
    aimed: NDArray[np.bool_]  # (n,) light samples in it find lights: distances are sampled around these, too
    aims: F64  # (k, 4) places of lights, see aims.build
    fields: Any  # tracking.Fields, or NoFields
    bodies: Any  # bodies.Bodies, or NoBodies
    guides: Any  # guides.Guides, or NoGuides
    outside: NDArray[np.int64]  # (1,) stack of camera rays
    walled: NDArray[np.bool_]  # (1,) some medium has a boundary that light passes straight


def bounded_density(tape: Tape, low: np.ndarray, high: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Majorants (z, y, x) of the first result of a tape on the cells of a grid; undefined values count as 0."""
    x, y, z = cells.tolist()
    fine = upper_bounds.over_grid(tape, np.stack([low, high]), (SPLIT * x, SPLIT * y, SPLIT * z), upper_bounds.DENSEST)
    return np.ascontiguousarray(fine.reshape(z, SPLIT, y, SPLIT, x, SPLIT).max(axis=(1, 3, 5)))


def build(
    tables: ir.Tables, rows: np.ndarray, flags: tuple[np.ndarray, np.ndarray], absorbed: np.ndarray, outside: int, general: bool = False
) -> Scattering:
    """The table of media `rows` (n,) of ir.Media by number, -1 without one; `absorbed` (n, 4) of materials is added to the absorption.

    `flags` are the columns `clear` and `aimed`. With `general` it has fields, which may be empty.
    """
    media, count, has = tables.media, len(rows), rows >= 0
    coefficients = {name: np.zeros((count, 4)) for name in ("extinction", "scattering", "emission")}
    coefficients["extinction"][:, :3] = absorbed[:, :3]
    coefficients["scattering"][has, :3], coefficients["emission"][has, :3] = media.scattering[rows[has]], media.emission[rows[has]]
    coefficients["extinction"][has, :3] += media.scattering[rows[has]] + media.absorption[rows[has]]
    for name in ("extinction", "scattering"):
        coefficients[name][:, 3] = coefficients[name][:, :3].max(axis=1)
    shines = has & (coefficients["emission"].max(axis=1) > 0.0)
    coefficients["extinction"][shines, 3] = np.maximum(coefficients["extinction"][shines, 3], _least_rate(tables, rows[shines]))
    anisotropy, top, falloff = np.zeros(count), np.full(count, np.inf), np.zeros(count)
    anisotropy[has], top[has], falloff[has] = media.anisotropy[rows[has]], media.top[rows[has]], media.falloff[rows[has]]
    return Scattering(
        **coefficients, anisotropy=anisotropy, top=top, falloff=falloff, clear=flags[0], aimed=flags[1],
        draine=phase_table.build(tables, rows, general),
        fields=_fields(tables, rows, general), aims=aims.build(tables), bodies=bodies.none(count, general), guides=guides.NoGuides(),
        outside=np.array([outside], np.int64), walled=np.array([bool(flags[0].any())]),
    )  # fmt: skip


def voxel_majorants(voxels: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Majorants (z, y, x) of interpolated voxels (z, y, x) on the cells of a grid over their box."""
    most = voxels
    for axis, count in zip((0, 1, 2), cells[::-1].tolist(), strict=True):
        size = most.shape[axis]
        edges = np.arange(count + 1) / count * size - 0.5  # in voxels, whose centres are integers
        first = np.clip(np.floor(edges[:-1]), 0, size - 1).astype(int)
        last = np.clip(np.ceil(edges[1:]), 0, size - 1).astype(int)
        parts = [np.take(most, range(a, b + 1), axis).max(axis=axis) for a, b in zip(first.tolist(), last.tolist(), strict=True)]
        most = np.stack(parts, axis=axis)
    return np.ascontiguousarray(np.maximum(most, 0.0))


def _voxels(tables: ir.Tables, texture: int) -> np.ndarray:
    """The voxels (z, y, x) of a texture."""
    image, slices = int(tables.textures.image[texture]), int(tables.textures.slices[texture])
    first, width, height = int(tables.images.first[image]), int(tables.images.width[image]), int(tables.images.height[image])
    texels = tables.images.texels[first : first + width * height, 0]
    return texels.reshape(slices, height // slices, width).astype(float)


def _fields(tables: ir.Tables, rows: np.ndarray, general: bool) -> tracking.Fields | tracking.NoFields:
    """The densities of media with their majorants."""
    media, count = tables.media, len(rows)
    density, cells, sizes = np.full(count, -1, np.int64), np.ones((count, 4), np.int64), np.zeros((count, 4), np.int64)
    to_local, to_cells, to_voxels = np.zeros((count, 12)), np.zeros((count, 12)), np.zeros((count, 12))
    grids, volumes, first, begin = [], [], 0, 0
    for number, row in enumerate(rows.tolist()):
        if row < 0 or media.density[row] < 0:
            continue
        texture, (low, high) = int(media.density[row]), media.bounds[row]
        sides = np.maximum(high - low, 1e-12)
        shape = np.clip(np.ceil(CELLS * sides / sides.max()).astype(np.int64), LEAST_CELLS, CELLS)
        inverse = tables.transforms.inverse[media.transform[row]]
        if tables.textures.kind[texture] == ir.TextureKind.VOXELS:
            voxels = _voxels(tables, texture)
            size = np.array(voxels.shape[::-1])
            grids.append(voxel_majorants(voxels, shape).ravel())
            volumes.append(voxels.ravel())
            sizes[number] = (*size.tolist(), begin)
            to_voxels[number] = _to_cells(inverse, low + 0.5 * sides / size, sides / size).ravel()
            begin += len(volumes[-1])
        else:
            grids.append(bounded_density(load_tape(tables, int(tables.textures.tape[texture])), low, high, shape).ravel())
        density[number], cells[number] = texture, (*shape.tolist(), first)
        to_local[number], to_cells[number] = inverse.ravel(), _to_cells(inverse, low, sides / shape).ravel()
        first += len(grids[-1])
    if not grids and not general:
        return tracking.NoFields()
    majorants, all_voxels = (np.concatenate(parts) if parts else np.zeros(1) for parts in (grids, volumes))
    return tracking.Fields(density, to_local, to_cells, cells, majorants, sizes, to_voxels, all_voxels, _moving(tables, rows))


def _moving(tables: ir.Tables, rows: np.ndarray) -> NDArray[np.int64]:
    """(n,) the moving transform of the shape around each medium, or -1."""
    moving, instances = np.full(len(rows), -1, np.int64), tables.instances
    for i in np.flatnonzero(tables.transforms.first_key[instances.transform] >= 0).tolist():
        medium = int(tables.materials.medium[instances.material[i]])
        moving[(rows == medium) & (medium >= 0)] = instances.transform[i]
    return moving


def _least_rate(tables: ir.Tables, rows: np.ndarray) -> np.ndarray:
    """Collisions per metre by which media that shine are found, however little they absorb: some along the side of their box."""
    media = tables.media
    with np.errstate(invalid="ignore"):
        scale = np.linalg.norm(tables.transforms.matrix[media.transform[rows], :, :3], axis=1)
        sides = (media.bounds[rows, 1] - media.bounds[rows, 0]) * scale
    return np.where(np.isfinite(sides), 8.0 / np.maximum(sides, 1e-9), 0.0).min(axis=1, initial=1e6)


def _to_cells(inverse: np.ndarray, low: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """The matrix (3, 4) from the world to a grid's cells."""
    matrix = np.array(inverse, float)
    matrix[:, 3] -= low
    return matrix / cell[:, None]
