"""Sheen of cloth: Charlie's distribution of fibres over all other lobes but the coat (KHR_materials_sheen of glTF).

- Distribution and shadowing: Estevez and Kulla 2017, Production Friendly Microfacet Sheen BRDF. Directions are sampled by the cosine.
- E, the directional albedo of this lobe, exceeds 1 for smooth fibres at grazing angles. The lobe is divided by max(1, E(μₒ), E(μᵢ)).
- What lies below is scaled by 1 − c min(1, max(E(μₒ), E(μᵢ))), with c the largest component of the colour.
  So no light is gained, and the whole is reciprocal.

Scenes without sheen compile nothing of it: the `sheen` of their Lobes is None, which is a type.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...materials import traits
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..surface.material_inputs import color_of, number_of
from ..types import Lane, Surface, Tables, Vec

COLOR, ROUGHNESS = int(ir.Slot.SHEEN), int(ir.Slot.SHEEN_ROUGHNESS)
LEAST_ROUGHNESS = 0.1
SIZE = 33  # rows and columns of the table

F64 = NDArray[np.float64]


class Albedo(NamedTuple):
    """The table of directional albedos as kernels read it."""

    each: F64  # (SIZE · SIZE, 4) E at a place of roughness and √cosine, at the next cosine, at the next roughness, and at both


class NoSheen(NamedTuple):
    """No material has sheen."""


class Sheen(NamedTuple):
    """Sheen of a material at a point."""

    color: Vec
    roughness: Lane
    table: Albedo


def tables_of(tables: ir.Tables, general: bool = False) -> Albedo | NoSheen:
    """The table if a material of an instance has sheen; otherwise with `general` one of zeros, which no material uses."""
    has = tables.materials.values[:, COLOR].any(axis=1) & traits.used(tables)
    return table() if has.any() else Albedo(np.zeros((SIZE * SIZE, 4))) if general else NoSheen()


@helper
def _at(table_: Any, default: Any, tables: Tables, surface: Surface) -> Sheen:
    color = color_of(tables, surface, COLOR)
    color = ops.clip(color[0], 0.0, 1.0), ops.clip(color[1], 0.0, 1.0), ops.clip(color[2], 0.0, 1.0)
    return Sheen(color, ops.clip(number_of(tables, surface, ROUGHNESS), LEAST_ROUGHNESS, 1.0), table_)


@helper
def _without(table_: Any, default: Any, zero: Lane) -> Sheen:
    return Sheen((zero, zero, zero), zero + LEAST_ROUGHNESS, table_)


@helper
def is_active(sheen: Sheen) -> bool:
    """Whether the material of some lane has sheen."""
    return ops.any_lane(ops.largest(sheen.color) > 0.0)


@helper
def _curve(x: Lane, alpha: Lane) -> Lane:
    """L of the paper: a / (1 + b xᶜ) + d x + e, with coefficients between those of α = 0 and α = 1."""
    t = (1.0 - alpha) * (1.0 - alpha)
    a, b, c = 21.5473 + 3.7772 * t, 3.82987 - 0.50552 * t, 0.19823 - 0.03022 * t
    return a / (1.0 + b * ops.power(ops.maximum(x, 1e-9), c)) + (-1.9776 + 0.70367 * t) * x - 4.32054 - 0.53913 * t


@helper
def _shadowing(cosine: Lane, alpha: Lane) -> Lane:
    """Λ of the paper."""
    low = _curve(ops.minimum(cosine, 0.5), alpha)
    high = 2.0 * _curve(0.0 * cosine + 0.5, alpha) - _curve(1.0 - ops.maximum(cosine, 0.5), alpha)
    return ops.exp(ops.where(cosine < 0.5, low, high))


@helper
def eval_sheen(roughness: Lane, cos_in: Lane, cos_out: Lane, cos_half: Lane) -> Lane:
    """π f of sheen of colour 1, of cosines to the normal above 0."""
    alpha = roughness * roughness
    sine = ops.sqrt(ops.maximum(1.0 - cos_half * cos_half, 1e-12))
    strength = (2.0 + 1.0 / alpha) * ops.power(sine, 1.0 / alpha) * 0.5  # over 2 π, times π
    return strength / ((1.0 + _shadowing(cos_in, alpha) + _shadowing(cos_out, alpha)) * 4.0 * cos_in * cos_out)


@helper
def directional_albedo(table_: Albedo, cosine: Lane, roughness: Lane) -> Lane:
    """E of sheen of colour 1 at a cosine."""
    down = (roughness - LEAST_ROUGHNESS) * ((SIZE - 1.0) / (1.0 - LEAST_ROUGHNESS))
    across = ops.sqrt(cosine) * (SIZE - 1.0)
    row = ops.clip(ops.floor_int(down), 0, SIZE - 2)
    column = ops.clip(ops.floor_int(across), 0, SIZE - 2)
    part = across - ops.to_float(column)
    first, next_, below, last = row_gather.four_at(table_.each, row * SIZE + column)
    return ops.lerp(ops.lerp(first, next_, part), ops.lerp(below, last, part), down - ops.to_float(row))


@helper
def _albedo(sheen: Sheen, default: Any, cosine: Lane) -> Lane:
    if ops.not_(is_active(sheen)):
        return 0.0 * cosine
    return directional_albedo(sheen.table, cosine, sheen.roughness)


@helper
def _over(
    sheen: Sheen, below: tuple[Vec, Vec], out: Lane, into: Lane, cos_in: Lane, cos_out: Lane, cos_half: Lane, factor: Lane
) -> tuple[Vec, Vec]:
    most = ops.maximum(out, into)
    under = 1.0 - ops.largest(sheen.color) * ops.minimum(most, 1.0)
    value = eval_sheen(sheen.roughness, cos_in, cos_out, cos_half) * factor / ops.maximum(most, 1.0)
    return ops.add(ops.scale(below[0], under), ops.scale(sheen.color, value)), ops.scale(below[1], under)


@helper
def _rest(sheen: Sheen, share: Lane, albedo: Lane) -> Lane:
    return share * (1.0 - ops.largest(sheen.color) * ops.minimum(albedo, 1.0))


@helper
def _reflects(sheen: Sheen, default: Lane, albedo: Lane, passed: Lane) -> Lane:
    return default + ops.mean3(sheen.color) * ops.minimum(albedo, 1.0) * passed


@helper
def _or_has(sheen: Sheen, default: Lane) -> Lane:
    return default | (ops.largest(sheen.color) > 0.0)


at = specialize_if_present(_at)  # table, None, tables, surface: the Sheen, or None
without = specialize_if_present(_without)  # table, None, zero: the Sheen of other materials, or None
albedo_of = specialize_if_present(_albedo)  # sheen, None, cosine: E, or None
over = specialize_if_present(_over, is_active)  # π f cos of (diffuse lobe with sheen, highlight): E of both directions, …
rest = specialize_if_present(_rest, is_active)  # a share that passes the sheen, both ways in directions of the same E
reflects = specialize_if_present(_reflects, is_active)  # an albedo with that of the sheen, E, times `passed`
or_has = specialize_if_present(_or_has)  # the condition, or that there is sheen


# --- tabulation ----------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def table() -> Albedo:
    """Return the table, computed on first use."""
    roughness, cosine = np.linspace(LEAST_ROUGHNESS, 1.0, SIZE)[:, None], np.linspace(0.0, 1.0, SIZE)[None] ** 2
    e = integrals(np.maximum(cosine, 1e-4), roughness)
    below = np.vstack([e[1:], e[-1:]])
    return Albedo(np.ascontiguousarray(np.stack([e, np.roll(e, -1, 1), below, np.roll(below, -1, 1)], axis=-1).reshape(-1, 4)))


def integrals(cosine: Any, roughness: Any, heights: int = 48, turns: int = 48) -> Any:
    """E = ∫ f cos dω by quadrature over cosines and azimuths, of the arrays' common shape."""
    mu, rough = (x[..., None, None] for x in np.broadcast_arrays(np.asarray(cosine, float), np.asarray(roughness, float)))
    nodes, weights = np.polynomial.legendre.leggauss(heights)
    into = (0.5 * (nodes + 1.0)) ** 2  # denser at grazing angles, dμ = 2 √μ d√μ
    steps, around = np.polynomial.legendre.leggauss(turns)
    turn = 0.5 * np.pi * (steps + 1.0)
    into, turn = into[:, None], turn[None]
    weight = (weights * 0.5 * (nodes + 1.0))[:, None] * (0.5 * np.pi * around)[None] * 2.0
    along = mu * into + np.sqrt((1.0 - mu * mu) * (1.0 - into * into)) * np.cos(turn)
    half = (mu + into) / np.sqrt(np.maximum(2.0 + 2.0 * along, 1e-12))
    return (eval_sheen(rough, into, mu, np.minimum(half, 1.0)) * into * weight).sum(axis=(-2, -1)) / np.pi
