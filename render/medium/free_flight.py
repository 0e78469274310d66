"""Free flight: how far light travels in a medium before it scatters, and what passes a distance.

Distances are sampled in proportion to the mean of the transmittances of red, green and blue, weighted by the path's throughput (one
sample of three strategies with the balance heuristic; Veach 1997). Media that only absorb or emit are integrated without a sample.
"""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..types import Lane, Tables, Vec
from . import column, tracking
from .tracking import Flight

FARTHEST = 80.0  # optical depth beyond which exp is 0


@helper
def _attenuated(coefficient: Vec, length: Lane) -> Vec:
    return (
        ops.exp(-ops.minimum(ops.where(coefficient[0] > 0.0, coefficient[0] * length, 0.0), FARTHEST)),
        ops.exp(-ops.minimum(ops.where(coefficient[1] > 0.0, coefficient[1] * length, 0.0), FARTHEST)),
        ops.exp(-ops.minimum(ops.where(coefficient[2] > 0.0, coefficient[2] * length, 0.0), FARTHEST)),
    )  # fmt: skip


@helper
def _glow(emission: Lane, coefficient: Lane, length: Lane, passed: Lane) -> Lane:
    """Radiance of a medium along a column."""
    closed = (1.0 - passed) / ops.maximum(coefficient, 1e-30)
    return ops.where(emission > 0.0, emission * ops.where(coefficient * length > 1e-4, closed, length), 0.0)


@helper
def _pick(chance: Vec, u: Lane, values: Vec) -> tuple[Lane, Lane]:
    """(value of a channel that is chosen by its chance, u stretched to 0 … 1 again)."""
    red, green = chance[0], chance[0] + chance[1]
    value = ops.where(u < red, values[0], ops.where(u < green, values[1], values[2]))
    low = ops.where(u < red, 0.0, ops.where(u < green, red, green))
    width = ops.where(u < red, chance[0], ops.where(u < green, chance[1], chance[2]))
    return value, ops.clip((u - low) / ops.maximum(width, 1e-12), 0.0, 0.9999999)


@helper
def _fly(
    table: Any, plain: Flight, tables: Tables, number: Lane, origin: Vec, direction: Vec, near: Lane, far: Lane, weight: Vec, key: Any
) -> Flight:  # fmt: skip
    """The flight from `near` to `far` in the media of these numbers; 0 is air. `key` is a tracking.Key of random numbers."""
    zero = 0.0 * near
    sigma_r, sigma_g, sigma_b, _ = row_gather.four_at(table.extinction, number)
    back_r, back_g, back_b, most = row_gather.four_at(table.scattering, number)
    glow_r, glow_g, glow_b, _ = row_gather.four_at(table.emission, number)
    extinction, scattering, emission = (zero + sigma_r, zero + sigma_g, zero + sigma_b), (back_r, back_g, back_b), (glow_r, glow_g, glow_b)
    height, slope = origin[1] + near * direction[1], direction[1]
    top, falloff = zero + table.top[number], zero + table.falloff[number]
    length = column.column(height, slope, top, falloff, far - near)
    passed = _attenuated(extinction, length)
    emitted = (
        _glow(emission[0], extinction[0], length, passed[0]), _glow(emission[1], extinction[1], length, passed[1]),
        _glow(emission[2], extinction[2], length, passed[2]),
    )  # fmt: skip
    u, _ = tracking.numbers(key, 0)
    chance = (weight[0] * scattering[0], weight[1] * scattering[1], weight[2] * scattering[2])
    total = chance[0] + chance[1] + chance[2]
    samples = (most > 0.0) & (total > 0.0)
    chance = ops.scale(chance, 1.0 / ops.where(samples, total, 1.0))
    sigma, u = _pick(chance, u, extinction)
    wanted = -ops.log(1.0 - u) / ops.maximum(sigma, 1e-30)
    scattered = samples & (wanted < length)
    t = near + column.distance_of(height, slope, top, falloff, ops.where(scattered, wanted, 0.0))
    scattered = scattered & (t < far)
    before = _attenuated(extinction, ops.where(scattered, wanted, 0.0))
    density = chance[0] * extinction[0] * before[0] + chance[1] * extinction[1] * before[1] + chance[2] * extinction[2] * before[2]
    mean = ops.where(samples, ops.maximum(ops.dot(chance, passed), 1e-30), 1.0)
    at_end = ops.scale(passed, 1.0 / mean)
    inside = ops.scale(ops.mul(scattering, before), 1.0 / ops.maximum(density, 1e-30))
    flight = Flight(scattered, ops.where(scattered, t, far), ops.where3(scattered, inside, at_end), emitted)
    return tracking.fly(table.fields, flight, tables, table, number, (origin, direction, near, far), weight, key)


fly = specialize_if_present(_fly)
"""(table, flight without media, tables, number, origin, direction, near, far, throughput, key): see `_fly`."""


@helper
def _transmit(table: Any, plain: Vec, tables: Tables, number: Lane, origin: Vec, direction: Vec, near: Lane, far: Lane, key: Any) -> Vec:
    """The share of light in red, green and blue that passes from `near` to `far`; of densities by a formula an unbiased estimate."""
    zero = 0.0 * near
    sigma_r, sigma_g, sigma_b, _ = row_gather.four_at(table.extinction, number)
    height, slope = origin[1] + near * direction[1], direction[1]
    length = column.column(height, slope, zero + table.top[number], zero + table.falloff[number], far - near)
    passed = _attenuated((zero + sigma_r, zero + sigma_g, zero + sigma_b), length)
    return tracking.transmit(table.fields, passed, tables, table, number, (origin, direction, near, far), key)


transmit = specialize_if_present(_transmit)

