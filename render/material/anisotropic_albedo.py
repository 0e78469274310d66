"""Tables of the directional albedo of GGX facets of two roughnesses, for energy compensation and layering of slabs.

They are those of energy_compensation and rough_dielectric with two more axes: the ratio of both roughnesses, and the direction's azimuth.
E and B of reflectance 1 serve metals and thin walls, and h their lobe of further bounces. R of a dielectric is that of round facets plus
the difference of s² (E − B) + B: Schlick's approximation differs from Fresnel's equations about equally for both. The light that a rough
boundary loses is tabulated for each index of refraction, on both sides.

No round facets have the albedo of lines: a white metal of roughness 1 reflects 0.38 in one bounce along its lines, at any cosine.

Scenes without such materials compile nothing of it: the `anisotropy` of their Slabs is None, which is a type.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper, noinline_helper, specialize_if_present
from ..lanes import ops, row_gather
from ..types import Lane, Vec
from . import anisotropic_facets, energy_compensation, further_bounces, rough_dielectric
from .anisotropic_facets import Facets

ROWS, RATIOS, TURNS, COLUMNS = 12, 5, 7, 16  # of √√α, √(second α / first α), |cos φ| to the first axis, cosine
CELLS = ROWS * RATIOS * TURNS * COLUMNS
NODES = (610, 377), (987, 610), (233, 144)  # of integrals of a boundary from outside; from inside; of the lobe of further bounces
MISSED = 1e-3, 2.5e-3  # greatest error by quadrature, likewise
EVEN = 0.999  # facets with a greater ratio of their roughnesses are round
LEAST = 1e-7

F64 = NDArray[np.float64]


class NoAnisotropy(NamedTuple):
    """No facets have two roughnesses."""


class AnisotropicTables(NamedTuple):
    """Tables as kernels read them. Rows of four: at a column, the next, and both at the next azimuth."""

    albedo: F64  # (CELLS, 4) E
    grazing: F64  # (CELLS, 4) B
    again: F64  # (CELLS, 4) h
    mean: F64  # (ROWS · RATIOS, 4) cosine-weighted means of E and B, at a ratio and at the next
    lost: F64  # (k · 2 · CELLS, 4) 1 − E of each index, from outside, then from inside
    lost_mean: F64  # (k · 2 · ROWS · RATIOS, 4) as `mean` of rough_dielectric.AlbedoTables


class Anisotropy(NamedTuple):
    """The tables at a point."""

    here: Lane  # bool: the base or the coat has two roughnesses
    tables: Any  # AnisotropicTables


class Place(NamedTuple):
    """Where in a table a direction is: a cell, and the fractions to the next ones."""

    cell: Lane
    row: Lane
    ratio: Lane
    turn: Lane
    column: Lane


@helper
def _axis(value: Lane, count: int) -> tuple[Lane, Lane]:
    """(cell, fraction to the next) of a value from 0 to 1 among `count` even steps."""
    position = ops.clip(value, 0.0, 1.0) * (count - 1.0)
    cell = ops.minimum(ops.floor_int(position), count - 2)
    return cell, position - ops.to_float(cell)


@helper
def _root(alpha: Lane) -> Lane:
    return (ops.sqrt(ops.sqrt(alpha)) - energy_compensation.FIRST) * (1.0 / (1.0 - energy_compensation.FIRST))


@helper
def is_uneven(facets: Facets) -> Lane:
    """Whether facets have two roughnesses."""
    return facets.second < EVEN * facets.first


@noinline_helper
def place_of(facets: Facets, normal: Vec, direction: Vec) -> Place:
    """The place of a direction on either side."""
    cosine = ops.clip(ops.absolute(ops.dot(normal, direction)), LEAST, 1.0)
    x, y = ops.dot(direction, facets.along), ops.dot(direction, facets.across)
    row, row_part = _axis(_root(facets.alpha), ROWS)
    ratio, ratio_part = _axis(ops.sqrt(facets.second / facets.first), RATIOS)
    turn, turn_part = _axis(ops.absolute(x) / ops.sqrt(ops.maximum(x * x + y * y, 1e-12)), TURNS)
    column, column_part = _axis(energy_compensation.column_of(cosine, facets.alpha), COLUMNS)
    return Place(((row * RATIOS + ratio) * TURNS + turn) * COLUMNS + column, row_part, ratio_part, turn_part, column_part)


@helper
def _quad(table: Any, cell: Lane, place: Place) -> Lane:
    a, b, c, d = row_gather.four_at(table, cell)
    return ops.lerp(ops.lerp(a, b, place.column), ops.lerp(c, d, place.column), place.turn)


@noinline_helper
def _read(table: Any, first: Lane, place: Place) -> Lane:
    """A number of a table whose cells begin at `first`."""
    cell, next_row = first + place.cell, RATIOS * TURNS * COLUMNS
    low = ops.lerp(_quad(table, cell, place), _quad(table, cell + TURNS * COLUMNS, place), place.ratio)
    cell = cell + next_row
    return ops.lerp(low, ops.lerp(_quad(table, cell, place), _quad(table, cell + TURNS * COLUMNS, place), place.ratio), place.row)


@helper
def _mean_cell(facets: Facets) -> tuple[Lane, Lane, Lane]:
    """(cell of a table of means, fraction to the next ratio, to the next row)."""
    row, row_part = _axis(_root(facets.alpha), ROWS)
    ratio, ratio_part = _axis(ops.sqrt(facets.second / facets.first), RATIOS)
    return row * RATIOS + ratio, ratio_part, row_part


@noinline_helper
def means(tables: AnisotropicTables, facets: Facets) -> tuple[Lane, Lane]:
    """(mean of E, mean of B) over the hemisphere, weighted by the cosine."""
    cell, ratio, row = _mean_cell(facets)
    e, b, e_next, b_next = row_gather.four_at(tables.mean, cell)
    e_below, b_below, e_last, b_last = row_gather.four_at(tables.mean, cell + RATIOS)
    return ops.lerp(ops.lerp(e, e_next, ratio), ops.lerp(e_below, e_last, ratio), row), ops.lerp(
        ops.lerp(b, b_next, ratio), ops.lerp(b_below, b_last, ratio), row
    )


# --- what slabs take from it: each gets the Anisotropy or None, and the result of round facets ---------------------------------------


@helper
def _is_active(anisotropy: Anisotropy) -> bool:
    return ops.any_lane(anisotropy.here)


@helper
def _at(tables: AnisotropicTables, default: Any, facets: Facets, coat_facets: Facets) -> Anisotropy:
    return Anisotropy(is_uneven(facets) | is_uneven(coat_facets), tables)


@helper
def _split_sum(step: Lane, e: Lane, b: Lane) -> Lane:
    return step * step * (e - b) + b


@noinline_helper
def _corrected(
    tables: AnisotropicTables, plain: tuple[Lane, Lane, Lane, Lane], table: energy_compensation.Albedo, facets: Facets, step: Lane,
    normal: Vec, direction: Vec
) -> tuple[Lane, Lane, Lane, Lane]:  # fmt: skip
    place, uneven, nowhere = place_of(facets, normal, direction), is_uneven(facets), ops.int_like(facets.alpha, 0)
    e = _read(tables.albedo, nowhere, place)
    b = ops.minimum(_read(tables.grazing, nowhere, place), e)
    cosine = ops.clip(ops.absolute(ops.dot(normal, direction)), LEAST, 1.0)
    e_round, b_round = energy_compensation.directional_albedo(table, cosine, ops.minimum(facets.alpha, 1.0))
    correction = _split_sum(step, e, b) - _split_sum(step, e_round, b_round)
    r = ops.where(uneven & (step > 0.0), ops.clip(plain[0] + correction, 0.0, 1.0), plain[0])
    return (
        r,
        ops.where(uneven, e, plain[1]),
        ops.where(uneven, b, plain[2]),
        ops.where(uneven, _read(tables.again, nowhere, place), plain[3]),
    )


@helper
def _albedos(
    anisotropy: Anisotropy, plain: tuple[Lane, Lane, Lane, Lane], table: energy_compensation.Albedo, facets: Facets, step: Lane,
    normal: Vec, direction: Vec
) -> tuple[Lane, Lane, Lane, Lane]:  # fmt: skip
    if ops.any_lane(is_uneven(facets)):
        return _corrected(anisotropy.tables, plain, table, facets, step, normal, direction)
    return plain


@helper
def _mean_reflectance(anisotropy: Anisotropy, plain: Lane, table: energy_compensation.Albedo, facets: Facets, step: Lane) -> Lane:
    e, b = means(anisotropy.tables, facets)
    e_round, b_round, _ = energy_compensation.means(table, ops.minimum(facets.alpha, 1.0))
    correction = _split_sum(step, e, b) - _split_sum(step, e_round, b_round)
    return ops.where(is_uneven(facets) & (step > 0.0), ops.clip(plain + correction, 0.0, 1.0), plain)


@helper
def _lost(anisotropy: Anisotropy, plain: tuple[Lane, Lane], facets: Facets, side: Lane, normal: Vec, direction: Vec) -> tuple[Lane, Lane]:
    place, uneven = place_of(facets, normal, direction), is_uneven(facets)
    wall = 1.0 - _read(anisotropy.tables.albedo, ops.int_like(facets.alpha, 0), place)
    glass = _read(anisotropy.tables.lost, side * (CELLS // rough_dielectric.ROWS), place)
    return ops.where(uneven, wall, plain[0]), ops.where(uneven, glass, plain[1])


@helper
def _mean_lost(anisotropy: Anisotropy, plain: tuple[Lane, Lane, Lane, Lane], facets: Facets, side: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    uneven = is_uneven(facets)
    cell, ratio, row = _mean_cell(facets)
    cell = side * (ROWS * RATIOS // rough_dielectric.ROWS) + cell
    table = anisotropy.tables.lost_mean
    a, b = row_gather.four_at(table, cell), row_gather.four_at(table, cell + 1)
    c, d = row_gather.four_at(table, cell + RATIOS), row_gather.four_at(table, cell + RATIOS + 1)
    mean = ops.lerp(ops.lerp(a[0], b[0], ratio), ops.lerp(c[0], d[0], ratio), row)
    mean_other = ops.lerp(ops.lerp(a[1], b[1], ratio), ops.lerp(c[1], d[1], ratio), row)
    through = ops.minimum(ops.lerp(ops.lerp(a[2], b[2], ratio), ops.lerp(c[2], d[2], ratio), row) * mean_other, 1.0)
    wall = 1.0 - means(anisotropy.tables, facets)[0]
    return (
        ops.where(uneven, wall, plain[0]), ops.where(uneven, mean, plain[1]), ops.where(uneven, mean_other, plain[2]),
        ops.where(uneven, through, plain[3]),
    )  # fmt: skip


at = specialize_if_present(_at)  # tables, None, facets of the base, of the coat: Anisotropy or None
albedos = specialize_if_present(_albedos, _is_active)
"""anisotropy, (R of a dielectric; E, B and h of a metal), table of round facets, facets, s, normal, direction."""
mean_reflectance = specialize_if_present(_mean_reflectance, _is_active)  # anisotropy, mean of R, table of round facets, facets, s
lost = specialize_if_present(_lost, _is_active)  # anisotropy, 1 − E of (a wall, a boundary), facets, its RoughGlass.row, normal, direction
mean_lost = specialize_if_present(_mean_lost, _is_active)
"""anisotropy, (mean loss of a wall, of a boundary, on its other side, share of the loss that passes), facets, its RoughGlass.row."""


# --- tabulation ----------------------------------------------------------------------------------------------------------------------


def tables_of(indices: F64, passing: NDArray[np.bool_], uneven: NDArray[np.bool_]) -> AnisotropicTables:
    """The tables of materials by their (materials,) indices: of rough boundaries, where `passing` and `uneven` ones share an index.

    `passing`: light passes them; their indices in order are those of rough_dielectric.AlbedoTables. `uneven`: they have two roughnesses.
    Without any of these, tables of zeros, which general kernels do not read.
    """
    used = np.unique(np.where(passing, indices, indices[passing][0])) if passing.any() else indices[:1]
    tabled = np.isin(used, indices[passing & uneven])
    none = np.zeros((2 * CELLS, 4)), np.zeros((2 * ROWS * RATIOS, 4))
    boundaries = [_boundary(float(index)) if needed else none for index, needed in zip(used, tabled, strict=True)]
    lost, lost_mean = np.concatenate([t[0] for t in boundaries]), np.concatenate([t[1] for t in boundaries])
    if not uneven.any():
        empty = np.zeros((CELLS, 4))
        return AnisotropicTables(empty, empty, empty, np.zeros((ROWS * RATIOS, 4)), lost, lost_mean)
    return AnisotropicTables(*_plain_tables(), lost, lost_mean)


def _surfaces() -> list[tuple[int, float, float, float]]:
    """(row, α, α along, α across) of each row and ratio."""
    surfaces = []
    for row, alpha in enumerate(energy_compensation.alphas(ROWS)):
        for ratio in np.linspace(0.0, 1.0, RATIOS) ** 2:
            along = alpha * np.sqrt(2.0 / (1.0 + ratio * ratio))
            surfaces.append((row, float(alpha), float(along), max(float(along * ratio), anisotropic_facets.SHARP * min(float(alpha), 1.0))))
    return surfaces


def _directions(row: int, alpha: float) -> tuple[F64, F64, F64]:
    """Unit vectors (TURNS · COLUMNS,) of the cells of a row."""
    cosine = energy_compensation.cosines(energy_compensation.alphas(ROWS), COLUMNS)[row]
    turned, z = np.meshgrid(np.linspace(0.0, 1.0, TURNS), cosine, indexing="ij")
    sine = np.sqrt(1.0 - z * z)
    return (sine * turned).ravel(), (sine * np.sqrt(1.0 - turned * turned)).ravel(), z.ravel()


def _visible(view: tuple[F64, F64, F64], along: float, across: float, nodes: int, step: int) -> tuple[Any, F64, F64]:
    """(visible normals, their cosines to the view, weights) by a Fibonacci lattice, denser at steep facets."""
    k = np.arange(nodes)
    turn, height = 2.0 * np.pi * ((k * step % nodes) + 0.5) / nodes, ((k + 0.5) / nodes) ** 2
    x, y, z = (c[:, None] for c in view)
    length = np.sqrt((along * x) ** 2 + (across * y) ** 2 + z * z)
    up = height * (1.0 + z / length) - z / length
    flat = np.sqrt(np.maximum(1.0 - up * up, 0.0))
    normal = along * (flat * np.cos(turn) + along * x / length), across * (flat * np.sin(turn) + across * y / length), up + z / length
    size = np.sqrt(np.maximum(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2, 1e-30))
    normal = normal[0] / size, normal[1] / size, normal[2] / size
    return normal, np.clip(x * normal[0] + y * normal[1] + z * normal[2], LEAST, 1.0), 2.0 * np.sqrt(height) / nodes


def _lambda(direction: Any, along: float, across: float) -> F64:
    """Smith's Λ of directions on either side."""
    x, y, z = direction
    z = np.maximum(np.abs(z), 1e-12)
    return np.minimum(0.5 * (np.sqrt((along * x) ** 2 + (across * y) ** 2 + z * z) / z - 1.0), rough_dielectric.STEEPEST)


def _mirrored(view: Any, normal: Any, facing: F64) -> tuple[F64, F64, F64]:
    return tuple(2.0 * facing * n - v[:, None] for n, v in zip(normal, view, strict=True))  # pyright: ignore[reportReturnType]


@lru_cache(maxsize=1)
def _plain_tables() -> tuple[F64, F64, F64, F64]:
    """`albedo`, `grazing`, `again` and `mean` of the tables."""
    e, b = np.zeros((2, ROWS * RATIOS, TURNS * COLUMNS))
    for k, (row, alpha, along, across) in enumerate(_surfaces()):
        view = _directions(row, alpha)
        normal, facing, weight = _visible(view, along, across, *NODES[0])
        light = _mirrored(view, normal, facing)
        near = 1.0 + _lambda(view, along, across)[:, None]
        lit = np.where(light[2] > 0.0, near / (near + _lambda(light, along, across)), 0.0) * weight
        e[k], b[k] = lit.sum(axis=1), (lit * (1.0 - facing) ** 5).sum(axis=1)
    shape = ROWS, RATIOS, TURNS, COLUMNS
    bounds = [np.minimum(energy_compensation.raise_to_bound(x.reshape(shape)) + MISSED[0], 1.0) for x in (e, b)]
    e, b = bounds[0], np.minimum(bounds[1], bounds[0])
    again = np.stack([_scaling(*surface, e.reshape(ROWS * RATIOS, -1)[k]) for k, surface in enumerate(_surfaces())])
    e_mean, b_mean = _hemisphere(e), _hemisphere(b)
    mean = np.stack([e_mean, b_mean, _next(e_mean, 1), _next(b_mean, 1)], axis=-1).reshape(-1, 4)
    return _quads(e), _quads(b), _quads(again.reshape(shape)), np.ascontiguousarray(mean)


def _scaling(row: int, alpha: float, along: float, across: float, e: F64) -> F64:
    """(TURNS · COLUMNS,) h of a surface, as energy_compensation solves it."""
    view, wide = _directions(row, alpha), float(energy_compensation.spread_alpha(np.float64(alpha)))
    normal, facing, weight = _visible(view, wide, wide, *NODES[2])
    light = _mirrored(view, normal, facing)
    near = 1.0 + _lambda(view, wide, wide)[:, None]
    lit = np.where(light[2] > 0.0, near / (near + _lambda(light, wide, wide)), 0.0) * weight
    up = normal[2] ** 2
    y = wide * wide * up / (1.0 - up + wide * wide * up)
    out, into = (energy_compensation.column_of(np.clip(z, LEAST, 1.0), alpha) for z in (view[2], light[2]))
    places = np.asarray(out)[:, None, None], np.asarray(into)[..., None]
    lit = lit * further_bounces.of_row(further_bounces.table(), *places, alpha, y[..., None])[0][..., 0]
    turned = np.abs(light[0]) / np.sqrt(np.maximum(light[0] ** 2 + light[1] ** 2, 1e-12))
    sent, count = np.zeros((TURNS * COLUMNS) ** 2), TURNS * COLUMNS
    column, turn = np.clip(into, 0.0, 1.0) * (COLUMNS - 1.0), turned * (TURNS - 1.0)
    i, j = np.minimum(column.astype(np.int64), COLUMNS - 2), np.minimum(turn.astype(np.int64), TURNS - 2)
    for a, part in ((0, 1.0 - (column - i)), (1, column - i)):
        for c, share in ((0, 1.0 - (turn - j)), (1, turn - j)):
            cell = np.arange(count)[:, None] * count + (j + c) * COLUMNS + i + a
            sent += np.bincount(cell.ravel(), (lit * part * share).ravel(), count * count)
    lost, sent = np.maximum(1.0 - e, 0.0), sent.reshape(count, count)
    h = np.sqrt(lost)
    for _ in range(energy_compensation.SCALINGS):
        h = np.sqrt(h * lost / np.maximum(sent @ h, 1e-12))
    over = np.max(np.divide(h * (sent @ h), lost, out=np.ones_like(lost), where=lost > 1e-9))
    return h * np.sqrt((1.0 - energy_compensation.SCALED[0]) / max(float(over), 1.0))


@lru_cache(maxsize=16)  # 0.4 MB each: frames of an animation and edits in the window have the same indices
def _boundary(index: float) -> tuple[F64, F64]:
    """`lost` and `lost_mean` of a boundary to this index."""
    sent = np.zeros((2, ROWS * RATIOS, TURNS * COLUMNS))
    for side, ratio in enumerate((index, 1.0 / index)):
        for k, (row, alpha, along, across) in enumerate(_surfaces()):
            view = _directions(row, alpha)
            normal, facing, weight = _visible(view, along, across, *NODES[side])
            near = 1.0 + _lambda(view, along, across)[:, None]
            light = _mirrored(view, normal, facing)
            turned = rough_dielectric.reflectance(facing, np.full_like(facing, ratio))
            bent = np.sqrt(np.maximum(1.0 - (1.0 - facing * facing) / ratio**2, 0.0))
            through = [(facing * n - v[:, None]) / ratio - bent * n for n, v in zip(normal, view, strict=True)]
            mirrored = np.where(light[2] > 0.0, near / (near + _lambda(light, along, across)), 0.0)
            leaves = rough_dielectric.shadowing_across(near - 1.0, _lambda(through, along, across))
            refracted = np.where(through[2] < 0.0, leaves, 0.0)
            sent[side, k] = ((turned * mirrored + (1.0 - turned) * refracted) * weight).sum(axis=1)
    shape = ROWS, RATIOS, TURNS, COLUMNS
    bounds = [energy_compensation.raise_to_bound(x.reshape(shape)) + missed for x, missed in zip(sent, MISSED, strict=True)]
    lost = [np.clip(1.0 - bound, 0.0, 1.0) for bound in bounds]
    means_of_sides, alpha = np.stack([_hemisphere(x) for x in lost]), energy_compensation.alphas(ROWS)
    mean = np.stack([rough_dielectric.mean_table(means_of_sides[..., k], index, alpha) for k in range(RATIOS)], axis=2)
    return np.concatenate([_quads(x) for x in lost]), np.ascontiguousarray(mean.reshape(-1, 4))


def _hemisphere(table: F64) -> F64:
    """(ROWS, RATIOS) cosine-weighted means of a (ROWS, RATIOS, TURNS, COLUMNS) table, as it is interpolated."""
    nodes, weights = np.polynomial.legendre.leggauss(32)
    mu, turn = 0.5 * (nodes + 1.0), np.cos(0.25 * np.pi * (nodes + 1.0))
    turns = np.stack([np.interp(turn, np.linspace(0.0, 1.0, TURNS), unit) for unit in np.eye(TURNS)]) @ (0.5 * weights)
    rows = []
    for alpha, part in zip(energy_compensation.alphas(ROWS), table, strict=True):
        place = np.asarray(energy_compensation.column_of(mu, alpha))
        columns = np.stack([np.interp(place, np.linspace(0.0, 1.0, COLUMNS), unit) for unit in np.eye(COLUMNS)]) @ (weights * mu)
        rows.append(np.einsum("rtc,t,c->r", part, turns, columns))
    return np.stack(rows)


def _next(table: F64, axis: int) -> F64:
    """The table moved by one along an axis, with the last entry twice."""
    return np.concatenate([np.delete(table, 0, axis=axis), np.take(table, [-1], axis=axis)], axis=axis)


def _quads(table: F64) -> F64:
    """(CELLS, 4) a (ROWS, RATIOS, TURNS, COLUMNS) table at a column, the next, and both at the next azimuth."""
    turned = _next(table, 2)
    return np.ascontiguousarray(np.stack([table, _next(table, 3), turned, _next(turned, 3)], axis=-1).reshape(-1, 4))
