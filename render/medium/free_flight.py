"""Free flight: how far light travels in a medium before it scatters, and what passes a distance.

Whether light scatters before the end of a ray is decided by the mean of the transmittances of red, green and blue, weighted by the path's
throughput. The distance has the density of that mean, or of it and of angles around a light (`aims.py`), combined by the balance heuristic
(Veach 1997). Media that only absorb or emit are integrated without a sample.
"""

from __future__ import annotations

import math
from typing import Any

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..types import Lane, Tables, Vec
from . import aims, bodies, column, guides, tracking
from .tracking import Flight

FARTHEST = 80.0  # optical depth beyond which exp is 0
OFTEN = 0.25  # least probability that a camera ray or a photon scatters in a medium: of thin fog most samples would see none


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
def _pick(parts: Vec, u: Lane, first: Vec, second: Vec) -> tuple[Lane, Lane, Lane]:
    """(components of a channel that is chosen by its part of 1, u stretched to 0 … 1 again)."""
    red, green = parts[0], parts[0] + parts[1]
    is_red, is_green = u < red, u < green
    low = ops.where(is_red, 0.0, ops.where(is_green, red, green))
    width = ops.where(is_red, parts[0], ops.where(is_green, parts[1], parts[2]))
    first_component = ops.where(is_red, first[0], ops.where(is_green, first[1], first[2]))
    second_component = ops.where(is_red, second[0], ops.where(is_green, second[1], second[2]))
    return first_component, second_component, ops.clip((u - low) / ops.maximum(width, 1e-12), 0.0, 0.9999999)


@helper
def _fly(
    table: Any, default: Flight, tables: Tables, number: Lane, origin: Vec, direction: Vec, near: Lane, far: Lane, weight: Vec, key: Any
) -> Flight:  # fmt: skip
    """The flight from `near` to `far` in the media of these numbers; 0 is air. `key` is a tracking.Key of random numbers."""
    zero = 0.0 * near
    sigma_r, sigma_g, sigma_b, _ = row_gather.four_at(table.extinction, number)
    glow_r, glow_g, glow_b, _ = row_gather.four_at(table.emission, number)
    back_r, back_g, back_b, _ = row_gather.four_at(table.scattering, number)
    plain_of = (zero + sigma_r, zero + sigma_g, zero + sigma_b), (zero + back_r, zero + back_g, zero + back_b)
    extinction, back = bodies.coefficients(table.bodies, plain_of, number, key.body)
    height, slope = origin[1] + near * direction[1], direction[1]
    length = column.column(height, slope, zero + table.top[number], zero + table.falloff[number], far - near)
    passed = _attenuated(extinction, length)
    emitted = (
        _glow(glow_r, extinction[0], length, passed[0]), _glow(glow_g, extinction[1], length, passed[1]),
        _glow(glow_b, extinction[2], length, passed[2]),
    )  # fmt: skip
    ray = (origin, direction, near, far)
    sampled = _sample_distance(table, number, ray, (extinction, back), length, passed, weight, key)
    u = tracking.numbers(key, 0)[0]
    scattered, t, factor = guides.fly(key.axis, sampled, table, number, ray, (extinction, back), weight, u)
    return tracking.fly(table.fields, Flight(scattered, t, factor, emitted), tables, table, number, ray, weight, key)


@helper
def _sample_distance(
    table: Any, number: Lane, ray: Any, coefficients: tuple[Vec, Vec], length: Lane, passed: Vec, weight: Vec, key: Any
) -> tuple[Lane, Lane, Vec]:  # fmt: skip
    """(whether light scatters before the end of a ray, the distance, the factor of the throughput)."""
    origin, direction, near, far = ray
    extinction, back = coefficients
    chance = ops.mul(weight, back)
    total = chance[0] + chance[1] + chance[2]
    samples = (ops.largest(back) > 0.0) & (total > 0.0) & (length > 0.0)
    chance = ops.scale(chance, 1.0 / ops.where(samples, total, 1.0))
    scatters = ops.where(samples, 1.0 - ops.dot(chance, passed), 0.0)
    often = scatters
    if key.depth == 0 or key.kind == tracking.PHOTON:
        often = ops.where(scatters > 0.0, ops.maximum(scatters, OFTEN), 0.0)
    u, v = tracking.numbers(key, 0)
    scattered = u < often
    factor = ops.scale(passed, 1.0 / ops.maximum(1.0 - often, 1e-30))
    if ops.not_(ops.any_lane(scattered)):
        return scattered, far, factor
    absent = (1.0 - passed[0], 1.0 - passed[1], 1.0 - passed[2])
    parts = ops.scale(ops.mul(chance, absent), 1.0 / ops.maximum(scatters, 1e-30))
    sigma, lost, u = _pick(parts, ops.where(scattered, u / ops.maximum(often, 1e-30), 0.0), extinction, absent)
    target = ops.where(scattered, -ops.log(ops.maximum(1.0 - u * lost, 1e-30)) / ops.maximum(sigma, 1e-30), 0.0)
    height, slope = origin[1] + near * direction[1], direction[1]
    top, falloff = 0.0 * near + table.top[number], 0.0 * near + table.falloff[number]
    t = near + column.distance_of(height, slope, top, falloff, ops.minimum(target, length))
    aimed, density, t = aims.sample(table, scattered & table.aimed[number], ray, t, v, key)
    t = ops.where(scattered, ops.where(t < far, t, ops.where(far < math.inf, far, near)), near)
    before = _attenuated(extinction, column.column(height, slope, top, falloff, t - near))
    at_point = column.density_at(height + slope * (t - near), top, falloff)
    along = ops.dot(chance, ops.mul(extinction, before)) * at_point / ops.maximum(scatters, 1e-30)
    mixed = often * ops.where(aimed, 0.5 * along + 0.5 * density, along)
    inside = ops.scale(ops.mul(back, before), at_point / ops.maximum(mixed, 1e-30))
    return scattered, ops.where(scattered, t, far), ops.where3(scattered, inside, factor)


fly = specialize_if_present(_fly)
"""(table, flight without media, tables, number, origin, direction, near, far, throughput, key): see `_fly`."""


@helper
def _transmit(table: Any, default: Vec, tables: Tables, number: Lane, origin: Vec, direction: Vec, near: Lane, far: Lane, key: Any) -> Vec:
    """The share of light in red, green and blue that passes from `near` to `far`; of densities by a formula an unbiased estimate."""
    zero = 0.0 * near
    sigma_r, sigma_g, sigma_b, _ = row_gather.four_at(table.extinction, number)
    height, slope = origin[1] + near * direction[1], direction[1]
    length = column.column(height, slope, zero + table.top[number], zero + table.falloff[number], far - near)
    plain_of = (zero + sigma_r, zero + sigma_g, zero + sigma_b), (zero, zero, zero)
    passed = _attenuated(bodies.coefficients(table.bodies, plain_of, number, key.body)[0], length)
    return tracking.transmit(table.fields, passed, tables, table, number, (origin, direction, near, far), key)


transmit = specialize_if_present(_transmit)


@helper
def coefficients_of(table: Any, number: Lane) -> tuple[Vec, Vec]:
    """(extinction, scattering) per metre of media of one colour."""
    red, green, blue, _ = row_gather.four_at(table.extinction, number)
    back_r, back_g, back_b, _ = row_gather.four_at(table.scattering, number)
    return (red, green, blue), (back_r, back_g, back_b)


@helper
def scattering_at(table: Any, tables: Tables, number: Lane, place: Vec, body: Any) -> Vec:
    """The scattering coefficient per metre of the media of these numbers at a place."""
    red, green, blue, _ = row_gather.four_at(table.scattering, number)
    layer_density = column.density_at(place[1], 0.0 * place[1] + table.top[number], 0.0 * place[1] + table.falloff[number])
    density = tracking.density_at_place(table.fields, layer_density, tables, number, place)
    zero = 0.0 * place[0]
    back = (zero + red, zero + green, zero + blue)
    return ops.scale(bodies.coefficients(table.bodies, (back, back), number, body)[1], density)
