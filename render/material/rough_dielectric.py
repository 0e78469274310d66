"""Rough dielectric BSDF: microfacet reflection and refraction, with energy compensation.

Walter, Marschner, Li, Torrance 2007, Microfacet Models for Refraction through Rough Surfaces, with Smith's height-correlated shadowing and
visible-normal sampling. Light that passes leaves below the height where it arrived, so its shadowing is Euler's beta function of both
1 + Λ (Heitz, Hanika, d'Eon, Dachsbacher 2016, Multiple-Scattering Microfacet BSDFs with the Smith Model). The energy that single scattering
loses returns as a diffuse lobe on either side (Kulla and Conty 2017): of the share 1 − E(μₒ), x is transmitted, such that the BSDF is
reciprocal. Radiance is not scaled by the square of the index. E is tabulated for each index, from outside and from inside.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...materials import traits
from ..jit.kernel import helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops, row_gather
from ..simd.registration import overload
from ..surface import model_tests
from ..surface.material_inputs import number_of
from ..types import Lane, Surface, Tables, Vec
from . import energy_compensation, microfacet
from .microfacet import LEAST

ROUGHNESS, IOR = int(ir.Slot.ROUGHNESS), int(ir.Slot.IOR)
COLUMNS, ROWS = 32, 20  # of the tables, as in energy_compensation
NODES = (377, 233), (987, 610)  # of each integral, consecutive Fibonacci numbers: from outside, from inside
MISSED = 6e-4, 2.5e-3  # greatest error of E by quadrature and interpolation, likewise
ROUNDED = 2e-4  # likewise of a mean of 1 − E
STEEPEST = 1e3  # greatest Λ, so that float32 suffices
SAME = 1e-3  # a relative index nearer to 1 than this does not refract: the boundary is clear

F64 = NDArray[np.float64]


class Clear(NamedTuple):
    """A scene without rough glass."""


class AlbedoTables(NamedTuple):
    """Tables of 1 − E, and of R, the reflected part of E."""

    of: NDArray[np.int64]  # (materials,) table of a material
    each: F64  # (k · 2 · ROWS · COLUMNS, 4) 1 − E of a column and of the next, then R likewise; from outside, then from inside
    mean: F64  # (k · 2 · ROWS, 4) mean of 1 − E on this side and on the other; transmitted share of the loss over the latter; mean of R


class RoughGlass(NamedTuple):
    """Parameters of rough glass at a point, from the viewer's side."""

    here: Lane  # bool
    alpha: Lane
    ratio: Lane  # index of the other side over this side's
    tint: Vec  # factor of transmitted light
    row: Lane  # of Tabled.each: this side
    other: Lane  # the other side
    table: Any


def tables_of(tables: ir.Tables, general: bool = False) -> AlbedoTables | Clear:
    """Return the tables of a scene's rough glass; without any Clear, with `general` a table that no material uses."""
    rough = traits.rough_glass(tables)
    used = bool((rough & traits.used(tables)).any())
    return tables_of_indices(tables.materials.values[:, IOR, 0], rough & used) if used or general else Clear()


def tables_of_indices(index: F64, rough: NDArray[np.bool_]) -> AlbedoTables:
    """Return the tables of materials of these indices, of those that are rough; without any, a table that no material uses."""
    if not rough.any():
        return AlbedoTables(np.zeros(len(index), np.int64), np.zeros((2 * ROWS * COLUMNS, 4)), np.zeros((2 * ROWS, 4)))
    indices, rows = np.unique(np.where(rough, index, index[rough][0]), return_inverse=True)
    albedo_tables = [albedo_table(float(index)) for index in indices]
    return AlbedoTables(
        rows.ravel().astype(np.int64), np.concatenate([t[0] for t in albedo_tables]), np.concatenate([t[1] for t in albedo_tables])
    )


def is_rough(tables: ir.Tables) -> bool:
    """Whether a scene has rough glass."""
    return isinstance(tables_of(tables), AlbedoTables)


def at(tables: Tables, surface: Surface, ior: Lane, tint: Vec) -> RoughGlass | None:
    """Return the rough glass of a surface; None in scenes without any. `ior` is inside over outside."""
    return _at(tables, surface, ior, tint) if isinstance(getattr(tables.materials, "rough_glass", None), AlbedoTables) else None


@overload(at)
def _at_in_kernels(tables, surface, ior, tint):
    field = tables.field("materials.rough_glass") if isinstance(tables, HandleType) else None
    if field is not None and field[1] != ():
        return lambda tables, surface, ior, tint: _at(tables, surface, ior, tint)
    return lambda tables, surface, ior, tint: None


@helper
def _at(tables: Tables, surface: Surface, ior: Lane, tint: Vec) -> RoughGlass:
    materials: Any = tables.materials
    zero, nowhere = 0.0 * ior, ops.int_like(surface.offset, 0)
    if ops.not_(ops.any_lane(ops.bool_like(zero, False) | model_tests.is_glass(materials.model[surface.material]))):
        return RoughGlass(ops.bool_like(zero, False), zero + 1.0, zero + 1.5, tint, nowhere, nowhere, materials.rough_glass)
    roughness = ops.clip(number_of(tables, surface, ROUGHNESS), 0.0, 1.0)
    alpha = roughness * roughness
    ratio = ops.where(surface.front, ior, 1.0 / ior)
    is_rough = model_tests.is_glass(materials.model[surface.material]) & (alpha >= microfacet.SHARP) & (ops.absolute(ratio - 1.0) > SAME)
    first = nowhere + ops.to_int(materials.rough_glass.of[surface.material]) * (2 * ROWS)
    inner = ops.where(surface.front, 0, ROWS)
    alpha = ops.maximum(alpha, microfacet.SHARP)
    return RoughGlass(is_rough, alpha, ops.where(is_rough, ratio, 1.5), tint, first + inner, first + (ROWS - inner), materials.rough_glass)


@helper
def of_row(table: AlbedoTables, material: Lane, inside: Lane, alpha: Lane, ratio: Lane) -> RoughGlass:
    """The parameters of a material of `tables_of_indices` seen from one side, without a tint."""
    first, unity = ops.int_like(alpha, 0) + ops.to_int(table.of[material]) * (2 * ROWS), 0.0 * alpha + 1.0
    inner = ops.where(inside, ROWS, 0)
    alpha = ops.maximum(alpha, microfacet.SHARP)
    return RoughGlass(inside, alpha, ratio, (unity, unity, unity), first + inner, first + (ROWS - inner), table)


# --- energy compensation -------------------------------------------------------------------------------------------------


@helper
def _rows_at(frost: RoughGlass, row: Lane, cosine: Lane) -> tuple[Any, Any, Lane, Lane]:
    """(numbers of `each` at a cosine in the row below the roughness and in the next, fractions to the next column and row)."""
    below, y = energy_compensation.row_of(frost.alpha, ROWS)
    column = energy_compensation.column_of(ops.clip(cosine, 0.0, 1.0), frost.alpha) * (COLUMNS - 1.0)
    cell = ops.minimum(ops.floor_int(column), COLUMNS - 2)
    x = column - ops.to_float(cell)
    lower = row_gather.four_at(frost.table.each, (row + below) * COLUMNS + cell)
    upper = row_gather.four_at(frost.table.each, (row + below + 1) * COLUMNS + cell)
    return lower, upper, x, y


@helper
def lost_share(frost: RoughGlass, row: Lane, cosine: Lane) -> Lane:
    """1 − E at a cosine, on the side whose rows begin at `row`."""
    lower, upper, x, y = _rows_at(frost, row, cosine)
    return ops.lerp(ops.lerp(lower[0], lower[1], x), ops.lerp(upper[0], upper[1], x), y)


@helper
def mean_lost_shares(frost: RoughGlass) -> tuple[Lane, Lane, Lane]:
    """(mean loss on this side, on the other, transmitted share of the loss)."""
    below, y = energy_compensation.row_of(frost.alpha, ROWS)
    lower, upper = row_gather.four_at(frost.table.mean, frost.row + below), row_gather.four_at(frost.table.mean, frost.row + below + 1)
    other = ops.lerp(lower[1], upper[1], y)
    return ops.lerp(lower[0], upper[0], y), other, ops.minimum(ops.lerp(lower[2], upper[2], y) * other, 1.0)


@helper
def reflected_share(frost: RoughGlass, row: Lane, cosine: Lane) -> Lane:
    """R at a cosine, on the side whose rows begin at `row`: an upper bound, smeared where a smooth boundary begins to reflect all light."""
    lower, upper, x, y = _rows_at(frost, row, cosine)
    return ops.lerp(ops.lerp(lower[2], lower[3], x), ops.lerp(upper[2], upper[3], x), y)


@helper
def mean_reflected_share(frost: RoughGlass, row: Lane) -> Lane:
    """The mean of R over the hemisphere of a side, weighted by the cosine."""
    below, y = energy_compensation.row_of(frost.alpha, ROWS)
    return ops.lerp(row_gather.four_at(frost.table.mean, row + below)[3], row_gather.four_at(frost.table.mean, row + below + 1)[3], y)


# --- evaluation and sampling ---------------------------------------------------------------------------------------------


@helper
def reflectance(cosine: Lane, ratio: Lane) -> Lane:
    """Return the Fresnel reflectance of unpolarized light at a boundary of relative index `ratio` (Walter et al., equation 22)."""
    square = ratio * ratio - 1.0 + cosine * cosine
    g = ops.sqrt(ops.maximum(square, 0.0))
    a, b = (g - cosine) / (g + cosine), (cosine * (g + cosine) - 1.0) / (cosine * (g - cosine) + 1.0)
    return ops.where(square > 0.0, ops.minimum(0.5 * a * a * (1.0 + b * b), 1.0), 1.0)


@helper
def smith_lambda(cosine: Lane, alpha: Lane) -> Lane:
    """Return Smith's Λ at a cosine above 0, at most STEEPEST."""
    return ops.minimum(0.5 * (_reach(cosine, alpha) / cosine - 1.0), STEEPEST)


@helper
def shadowing_across(out: Lane, into: Lane) -> Lane:
    """Return B(1 + Λₒ, 1 + Λᵢ) (1 + Λₒ): of the light that a visible facet refracts, the share that leaves; by Stirling, within 10⁻⁴."""
    p, q = 1.0 + out, 1.0 + into
    s = p + q
    log_p, log_q, log_s = ops.log(p), ops.log(q), ops.log(s)
    log_beta = p * (log_p - log_s) + q * (log_q - log_s) + 0.5 * (log_s - log_p - log_q) + 0.5 * math.log(2.0 * math.pi)
    return ops.minimum(ops.exp(log_beta + _stirling(p) + _stirling(q) - _stirling(s)) * p, 1.0)


@helper
def _stirling(z: Lane) -> Lane:
    """Terms of Stirling's series for ln Γ, the last one fitted."""
    over = 1.0 / z
    square = over * over
    return over * (1.0 / 12.0 + square * (square * 0.00052 - 1.0 / 360.0))


@helper
def eval_both_sides(frost: RoughGlass, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    """(π f cos, solid angle density of `_sample`) for light from either side."""
    cos_out = ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    cosine = ops.dot(normal, to_light)
    above = cosine > 0.0
    cos_in = ops.clip(ops.absolute(cosine), LEAST, 1.0)
    bent = ops.where(above, 1.0, frost.ratio)
    half = ops.normalize(ops.add(to_viewer, ops.scale(to_light, bent)))
    half = ops.scale(half, ops.sign_of(ops.dot(half, normal)))
    out, into = ops.dot(half, to_viewer), ops.dot(half, to_light)
    strength = ops.where((out > 0.0) & ((into > 0.0) == above), microfacet.ggx_distribution(half, normal, frost.alpha), 0.0)
    turned = reflectance(ops.clip(out, LEAST, 1.0), frost.ratio)
    denominator = out + frost.ratio * into
    squeezed = frost.ratio * frost.ratio * ops.absolute(into) / ops.maximum(denominator * denominator, 1e-20)
    per_solid = ops.where(above, 0.25 * turned, (1.0 - turned) * ops.absolute(out) * squeezed)
    seen = 2.0 * strength / (cos_out + _reach(cos_out, frost.alpha)) * per_solid
    mirrored = 4.0 * math.pi * cos_in * strength * microfacet.smith_visibility(cos_out, cos_in, frost.alpha) * per_solid
    leaves = shadowing_across(smith_lambda(cos_out, frost.alpha), smith_lambda(cos_in, frost.alpha))
    single = ops.where(above, mirrored, math.pi * seen * leaves)
    lost = lost_share(frost, frost.row, cos_out)
    mean, mean_other, through = mean_lost_shares(frost)
    lost_in = ops.where(above, lost_share(frost, frost.row, cos_in), lost_share(frost, frost.other, cos_in))
    side = ops.where(above, 1.0 - through, through)
    again = lost * lost_in * side / ops.maximum(ops.where(above, mean, mean_other), LEAST)
    total = single + cos_in * again
    density = (1.0 - lost) * seen + lost * side * cos_in * (1.0 / math.pi)
    ones = 0.0 * total + 1.0
    return ops.scale(ops.where3(above, (ones, ones, ones), frost.tint), total), density


@helper
def _reach(cosine: Lane, alpha: Lane) -> Lane:
    square = alpha * alpha
    return ops.sqrt(square + (1.0 - square) * cosine * cosine)


@helper
def _sample(frost: RoughGlass, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Lane]:
    """(direction, whether it lies on the intended side); `which` from 0 to 1 chooses the event."""
    cos_out = ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    lost = lost_share(frost, frost.row, cos_out)
    through = mean_lost_shares(frost)[2]
    half = microfacet.sample_visible_normal(normal, to_viewer, frost.alpha, u, v)
    out = ops.clip(ops.dot(half, to_viewer), LEAST, 1.0)
    turned = reflectance(out, frost.ratio)
    again = which < lost
    mirrors = which - lost < turned * (1.0 - lost)
    arriving = ops.negate(to_viewer)
    eta = 1.0 / frost.ratio
    bent = ops.sqrt(ops.maximum(1.0 - eta * eta * (1.0 - out * out), 0.0))
    refracted = ops.normalize(ops.add(ops.scale(arriving, eta), ops.scale(half, eta * out - bent)))
    single = ops.where3(mirrors, ops.reflect(arriving, half), refracted)
    height = ops.sqrt(ops.maximum(1.0 - u, 0.0))
    flat, turn = ops.sqrt(ops.clip(u, 0.0, 1.0)), 2.0 * math.pi * v
    s, t = ops.basis(normal)
    passes = which >= lost * (1.0 - through)
    spread = ops.in_basis(s, t, normal, flat * ops.cos(turn), flat * ops.sin(turn), ops.where(passes, -height, height))
    direction = ops.where3(again, spread, single)
    above = ops.dot(direction, normal) > 0.0
    return direction, above == ops.where(again, ops.not_(passes), mirrors)


# --- specializations -----------------------------------------------------------------------------------------------------


@helper
def _reflected(frost: RoughGlass, default: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    return ops.where3(frost.here, eval_both_sides(frost, normal, to_light, to_viewer)[0], default)


@helper
def _eval_pdf(frost: RoughGlass, default: tuple[Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    share, density = eval_both_sides(frost, normal, to_light, to_viewer)
    return ops.where3(frost.here, share, default[0]), ops.where(frost.here, density, default[1])


@helper
def _eval_lobes_pdf(frost: RoughGlass, default: tuple[Vec, Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Vec, Lane]:
    share, density = eval_both_sides(frost, normal, to_light, to_viewer)
    none = (0.0 * density, 0.0 * density, 0.0 * density)
    lanes = frost.here
    return ops.where3(lanes, none, default[0]), ops.where3(lanes, share, default[1]), ops.where(lanes, density, default[2])


@helper
def _draw(frost: RoughGlass, default: tuple[Vec, Lane], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Lane]:
    direction, sound = _sample(frost, normal, to_viewer, u, v, ops.clip(which, 0.0, 1.0))
    return ops.where3(frost.here, direction, default[0]), ops.where(frost.here, sound, default[1])


@helper
def _sample_all(frost: RoughGlass, default: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Vec]:
    direction, sound = _sample(frost, normal, to_viewer, u, v, which)
    share, density = eval_both_sides(frost, normal, direction, to_viewer)
    factor = ops.where(sound & (density > 0.0), 1.0 / (math.pi * ops.where(density > 0.0, density, 1.0)), 0.0)
    return ops.where3(frost.here, direction, default[0]), ops.where3(frost.here, ops.scale(share, factor), default[1])


@helper
def _one(frost: RoughGlass, default: Lane) -> Lane:
    return ops.where(frost.here, 1.0, default)


@helper
def _or_rough(frost: RoughGlass, default: Lane) -> Lane:
    return default | frost.here


@helper
def _fine(frost: RoughGlass, default: Lane, most: float) -> Lane:
    return default | (frost.here & (frost.alpha <= most))


@helper
def _relative_index(frost: RoughGlass, default: Lane) -> Lane:
    return ops.where(frost.here, 1.0 / frost.ratio, default)


@helper
def is_active(frost: RoughGlass) -> bool:
    """Whether the material of some lane is rough glass."""
    return ops.any_lane(frost.here)


_if_active = functools.partial(specialize_if_present, is_active=is_active)


# Each takes the rough glass, the result without it, and: the normal, the direction to the light, the direction to the viewer.
reflected = _if_active(_reflected)  # π f cos
eval_pdf = _if_active(_eval_pdf)  # (π f cos, density of `draw`)
eval_lobes_pdf = _if_active(_eval_lobes_pdf)  # (0, π f cos, density of `sample`)
draw = _if_active(_draw)  # (direction, whether it counts): normal, viewer, u, v, event number 0 to 1
sample = _if_active(_sample_all)  # (direction, f cos / density)
one = _if_active(_one)  # 1 for rough glass
or_rough = specialize_if_present(_or_rough)  # `plain`, or whether it is rough glass
is_fine = _if_active(_fine)  # `plain`, or whether it is rough glass of α up to a limit
eta = _if_active(_relative_index)  # index of this side over the other's


# --- tabulation ----------------------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=16)  # frames of an animation and edits in the window have the same indices
def albedo_table(index: float) -> tuple[F64, F64]:
    """(each, mean) of a glass of this index."""
    alpha = energy_compensation.alphas(ROWS)
    cosine = energy_compensation.cosines(alpha, COLUMNS)
    sides = zip((index, 1.0 / index), NODES, MISSED, strict=True)
    rows = list(zip(cosine, alpha, strict=True))  # one by one they stay in the cache
    bounds = [
        [energy_compensation.raise_to_bound(np.stack(share)) + missed
         for share in zip(*(_shares(*row, ratio, *nodes) for row in rows), strict=True)]
        for ratio, nodes, missed in sides
    ]  # fmt: skip
    reflected, sent = (np.stack(part) for part in zip(*bounds, strict=True))
    lost, reflected = np.clip(1.0 - sent, 0.0, 1.0), np.minimum(reflected, 1.0)
    means = _hemisphere(lost, alpha)
    mean = mean_table(means + np.minimum(ROUNDED, 0.05 * means), index, alpha)
    mean[..., 3] = _hemisphere(reflected, alpha)
    each = np.stack([lost, _next_column(lost), reflected, _next_column(reflected)], axis=-1)
    return np.ascontiguousarray(each.reshape(-1, 4)), np.ascontiguousarray(mean.reshape(-1, 4))


def _next_column(table: F64) -> F64:
    return np.concatenate([table[..., 1:], table[..., -1:]], axis=-1)


def _hemisphere(sides: F64, alpha: F64) -> F64:
    """(2, ROWS) cosine-weighted means of a (2, ROWS, COLUMNS) table, as it is interpolated."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = 0.5 * (nodes + 1.0)
    return np.array([[np.interp(energy_compensation.column_of(mu, a), np.linspace(0.0, 1.0, COLUMNS), row) @ (weights * mu)
                      for a, row in zip(alpha, side, strict=True)] for side in sides])  # fmt: skip


def mean_table(means: F64, index: float, alpha: F64) -> F64:
    """(2, rows, 4) `AlbedoTables.mean` without R, of the (2, rows) means of 1 − E on both sides of a boundary, by rows of rising α."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = 0.5 * (nodes + 1.0)
    # Reciprocity: x_out · mean_out = index² · x_in · mean_in; x is at most 1.
    clear = float(np.sum(weights * mu * (1.0 - np.asarray(reflectance(mu, np.full(64, max(index, 1.0 / index)))))))
    outward = np.full(len(alpha), clear / max(index, 1.0) ** 2)
    ratio = np.divide(means[1], means[0], out=np.ones(len(alpha)), where=means[0] > 1e-9)
    inward = index**2 * outward * ratio
    other = means[::-1]
    over = np.divide(np.stack([inward, outward]), other, out=np.zeros_like(other), where=other > 1e-9)
    most = 1.0 - (1.0 - clear) * np.minimum(0.3 / alpha, 3.5)  # from the rarer side: fitted to random walks
    over = over * np.minimum(most / np.maximum((over * other).max(axis=0), 1e-9), 1.0)
    between = 0.2503 * (over[:, 1:] + over[:, :-1]) * (other[:, 1:] + other[:, :-1])  # upper bound between rows
    most = np.pad(between, ((0, 0), (0, 1))), np.pad(between, ((0, 0), (1, 0))), over * other
    over = over / np.maximum(np.max(most, axis=(0, 1)), 1.0)  # equal for both directions
    return np.stack([means, other, over, 0 * means], axis=-1)


def integral(cosine: Any, alpha: Any, ratio: float, nodes: int = 987, step: int = 610) -> F64:
    """Return E by quadrature over visible normals: the single-scattering albedo of both sides."""
    return _shares(cosine, alpha, ratio, nodes, step)[1]


def _shares(cosine: Any, alpha: Any, ratio: float, nodes: int, step: int) -> tuple[F64, F64]:
    """(R, E) by quadrature.

    Nodes are a Fibonacci lattice (Niederreiter and Sloan 1994), denser at steep facets. The critical angle and both horizons cause kinks
    at arbitrary places, which defeat rules for smooth functions.
    """
    k = np.arange(nodes)
    turned = np.cos(2.0 * np.pi * (k * step % nodes) / nodes)
    height = ((k + 0.5) / nodes) ** 2  # over the depth of the cap of facets that are seen
    weight = 2.0 * np.sqrt(height) / nodes
    mu, a = (x[..., None] for x in np.broadcast_arrays(np.asarray(cosine, float), np.asarray(alpha, float)))
    sine = np.sqrt(1.0 - mu * mu)
    length = np.sqrt((a * sine) ** 2 + mu * mu)
    z = height * (1.0 + mu / length) - mu / length
    flat = np.sqrt(np.maximum(1.0 - z * z, 0.0))
    x, up = a * (flat * turned + a * sine / length), z + mu / length
    size = np.sqrt(np.maximum(x * x + (a * flat) ** 2 * (1.0 - turned * turned) + up * up, 1e-30))
    up = up / size
    out = np.clip(sine * x / size + mu * up, LEAST, 1.0)
    turned_back = reflectance(out, np.full_like(out, ratio))
    bent = np.sqrt(np.maximum(1.0 - (1.0 - out * out) / ratio**2, 0.0))
    near = 1.0 + smith_lambda(mu, a)
    mirror, through = 2.0 * out * up - mu, (mu - out * up) / ratio + bent * up  # cosines on either side
    mirrored = np.where(mirror > 0.0, near / (near + smith_lambda(np.maximum(mirror, 1e-12), a)), 0.0)
    refracted = np.where(through > 0.0, shadowing_across(near - 1.0, smith_lambda(np.maximum(through, 1e-12), a)), 0.0)
    back = turned_back * mirrored
    return (back * weight).sum(axis=-1), ((back + (1.0 - turned_back) * refracted) * weight).sum(axis=-1)
