"""Guided walks in thick bodies: directions and distances that lead back to the surface where a path entered.

In a half space the radiance that leaves falls with the depth as exp(−κ σ z). Walks whose cosines μ to the surface have a density as
1 / (1 − κ μ), and whose free paths are those of an extinction σ (1 − κ μ), have least variance (Dwivedi 1982; Křivánek and d'Eon 2014). A
share of the samples stays classic. Channels and both ways are combined by the balance heuristic (Meng and others 2016). κ is the root of
albedo = κ / artanh κ. Scenes whose bodies are thin compile nothing of this.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..types import Lane, Surface, Vec

F64 = NDArray[np.float64]
SHARE = 0.5  # of the samples that are guided: where a body is lit from behind after all, such walks return light too seldom
LEAST, MOST = 0.02, 0.98  # κ
DEEP = 6.0  # thickness of a body times κ σ, from which walks are guided: exp(-6) of the light passes it
FARTHEST = 80.0  # optical depth beyond which exp is 0


class NoGuides(NamedTuple):
    """No body is thick enough."""


class Guides(NamedTuple):
    """Guides by the number of the medium."""

    decay: F64  # (n, 4) κ of red, green and blue, and 1 where walks are guided, else 0
    norm: F64  # (n, 4) κ / artanh κ, and 0
    used: NDArray[np.bool_]  # (1,) whether some walks are guided


class Guide(NamedTuple):
    """Guides of walks at a collision, or on a flight."""

    axis: Vec  # outward normal where a path entered
    decay: Vec
    norm: Vec
    chance: Vec  # share of each channel
    active: Lane  # bool


def decay_of(albedo: F64) -> F64:
    """κ of albedos of single scattering from 0 to 1, by bisection."""
    low, high = np.full(np.shape(albedo), 1e-9), np.full(np.shape(albedo), 1.0 - 1e-12)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = middle / np.arctanh(middle) > albedo
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return 0.5 * (low + high)


def build(extinction: F64, scattering: F64, thickness: F64, general: bool) -> Guides | NoGuides:
    """The guides of media by their coefficients (n, 4) and their thickness (n,) in metres, 0 of those that may not be guided.

    A body is deep if no channel that scatters passes it: where one does, guided walks lose more in it than they gain in the others.
    """
    decay = decay_of(scattering / np.maximum(extinction, 1e-30))
    passes = (decay * extinction * thickness[:, None] < DEEP)[:, :3]
    deep = ~(passes & (scattering[:, :3] > 0.0)).any(axis=1) & (scattering[:, :3].max(axis=1) > 0.0) & (thickness > 0.0)
    if not deep.any() and not general:
        return NoGuides()
    decay = np.clip(decay, LEAST, MOST)
    norm = decay / np.arctanh(decay)
    decay[:, 3], norm[:, 3] = deep, 0.0
    return Guides(decay, norm, np.array([bool(deep.any())]))


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def _of(axis: Vec, default: Any, table: Any, number: Lane, weight: Vec, back: Vec, active: Lane) -> Guide:
    if not table.guides.used[0]:
        return Guide(axis, axis, axis, axis, active & ops.not_(active))
    k_r, k_g, k_b, guided = row_gather.four_at(table.guides.decay, number)
    n_r, n_g, n_b, _ = row_gather.four_at(table.guides.norm, number)
    chance = ops.mul(weight, back)
    total = chance[0] + chance[1] + chance[2]
    active = active & (guided > 0.5) & (total > 0.0) & (ops.dot(axis, axis) > 0.5)
    return Guide(axis, (k_r, k_g, k_b), (n_r, n_g, n_b), ops.scale(chance, 1.0 / ops.where(active, total, 1.0)), active)


@helper
def _ratio(guide: Guide, cosine: Lane) -> Vec:
    """Densities of guided directions over those of even ones, by channel."""
    return (
        guide.norm[0] / (1.0 - guide.decay[0] * cosine), guide.norm[1] / (1.0 - guide.decay[1] * cosine),
        guide.norm[2] / (1.0 - guide.decay[2] * cosine),
    )  # fmt: skip


@helper
def _density(guide: Any, default: Lane, direction: Vec) -> Lane:
    """The density of directions of both ways; `default` is the even one."""
    if ops.not_(ops.any_lane(guide.active)):
        return default
    ratio = ops.dot(guide.chance, _ratio(guide, ops.dot(guide.axis, direction)))
    return ops.where(guide.active, default * (1.0 - SHARE + SHARE * ratio), default)


@helper
def _sample(guide: Any, default: tuple[Vec, Lane, Lane], u: Lane, v: Lane, which: Lane) -> tuple[Vec, Lane, Lane]:
    onward, weight, density = default
    if ops.not_(ops.any_lane(guide.active)):
        return default
    guided = guide.active & (which < SHARE)
    stretched = which / SHARE
    red, green = guide.chance[0], guide.chance[0] + guide.chance[1]
    decay = ops.where(stretched < red, guide.decay[0], ops.where(stretched < green, guide.decay[1], guide.decay[2]))
    decay = ops.where(guided, decay, 0.5)
    power = ops.exp(u * ops.log((1.0 - decay) / (1.0 + decay)))
    cosine = ops.clip((1.0 - (1.0 + decay) * power) / decay, -1.0, 1.0)
    sine = ops.sqrt(ops.maximum(1.0 - cosine * cosine, 0.0))
    up = ops.where3(guided, guide.axis, onward)
    s, t = ops.basis(up)
    angle = 2.0 * math.pi * v
    onward = ops.where3(guided, ops.in_basis(s, t, up, sine * ops.cos(angle), sine * ops.sin(angle), cosine), onward)
    mixed = _density(guide, density, onward)
    return onward, ops.where(guide.active, weight * density / ops.maximum(mixed, 1e-30), weight), mixed


@helper
def _faded(coefficient: Vec, length: Lane) -> Vec:
    return (
        ops.exp(-ops.minimum(coefficient[0] * length, FARTHEST)), ops.exp(-ops.minimum(coefficient[1] * length, FARTHEST)),
        ops.exp(-ops.minimum(coefficient[2] * length, FARTHEST)),
    )  # fmt: skip


@helper
def _fly(
    axis: Vec, default: tuple[Lane, Lane, Vec], table: Any, number: Lane, ray: Any, coefficients: tuple[Vec, Vec], weight: Vec, u: Lane
) -> tuple[Lane, Lane, Vec]:  # fmt: skip
    """(whether light scatters before the end of a ray, the distance, the factor of the throughput) of guided lanes, `default` of others."""
    if not table.guides.used[0]:
        return default
    _, direction, near, far = ray
    extinction, back = coefficients
    guide = _of(axis, None, table, number, weight, back, far > near)
    if ops.not_(ops.any_lane(guide.active)):
        return default
    cosine = ops.dot(axis, direction)
    ratio = _ratio(guide, cosine)
    led = (
        extinction[0] * (1.0 - guide.decay[0] * cosine), extinction[1] * (1.0 - guide.decay[1] * cosine),
        extinction[2] * (1.0 - guide.decay[2] * cosine),
    )  # fmt: skip
    of_led, of_plain = ops.scale(ops.mul(guide.chance, ratio), SHARE), ops.scale(guide.chance, 1.0 - SHARE)
    total = of_led[0] + of_led[1] + of_led[2] + of_plain[0] + of_plain[1] + of_plain[2]
    total = 1.0 / ops.where(guide.active, total, 1.0)
    of_led, of_plain = ops.scale(of_led, total), ops.scale(of_plain, total)
    length = ops.where(guide.active, far - near, 1.0)
    passed, passed_led = _faded(extinction, length), _faded(led, length)
    through = ops.dot(of_plain, passed) + ops.dot(of_led, passed_led)
    scatters = ops.maximum(1.0 - through, 0.0)
    hits = u < scatters
    part_led = _hit(of_led, passed_led)
    part_plain = _hit(of_plain, passed)
    sum_led, sum_plain = part_led[0] + part_led[1] + part_led[2], part_plain[0] + part_plain[1] + part_plain[2]
    u = ops.where(hits, u / ops.maximum(scatters, 1e-30), 0.0) * (sum_led + sum_plain)
    is_led = u < sum_led
    u = ops.where(is_led, u, u - sum_led)
    part, rate = ops.where3(is_led, part_led, part_plain), ops.where3(is_led, led, extinction)
    is_red, is_green = u < part[0], u < part[0] + part[1]
    low = ops.where(is_red, 0.0, ops.where(is_green, part[0], part[0] + part[1]))
    width = ops.where(is_red, part[0], ops.where(is_green, part[1], part[2]))
    sigma = ops.where(is_red, rate[0], ops.where(is_green, rate[1], rate[2]))
    u = ops.clip((u - low) / ops.maximum(width, 1e-12), 0.0, 0.9999999)
    lost = 1.0 - ops.exp(-ops.minimum(sigma * length, FARTHEST))
    t = ops.minimum(-ops.log(ops.maximum(1.0 - u * lost, 1e-30)) / ops.maximum(sigma, 1e-30), length)
    t = ops.where(guide.active & hits, t, 0.0)
    before, before_led = _faded(extinction, t), _faded(led, t)
    density = ops.dot(of_plain, ops.mul(extinction, before)) + ops.dot(of_led, ops.mul(led, before_led))
    at_hit = ops.scale(ops.mul(back, before), 1.0 / ops.maximum(density, 1e-30))
    at_end = ops.scale(passed, 1.0 / ops.maximum(through, 1e-30))
    factor = ops.where3(hits, at_hit, at_end)
    scattered = (guide.active & hits) | (ops.not_(guide.active) & default[0])
    end = ops.where(hits, near + t, far)
    return scattered, ops.where(guide.active, end, default[1]), ops.where3(guide.active, factor, default[2])


@helper
def _hit(part: Vec, passed: Vec) -> Vec:
    return part[0] * (1.0 - passed[0]), part[1] * (1.0 - passed[1]), part[2] * (1.0 - passed[2])


@helper
def _turn(axis: Vec, default: Any, point: Surface, scattered: Lane) -> Vec:
    outward = ops.where3(point.front, point.geometric, ops.negate(point.geometric))
    return ops.where3(scattered, axis, outward)


@helper
def _choose(first: Vec, second: Vec, takes_first: Lane) -> Vec:
    return ops.where3(takes_first, first, second)


@helper
def _start(guides: Any, default: Any, like: Lane) -> Vec:
    return 0.0 * like, 0.0 * like, 0.0 * like


@helper
def _before(guide: Any, default: Lane, weight: Lane) -> Lane:
    return ops.where(guide.active, weight, default)


of = specialize_if_present(_of)  # (axis, None, table, number, throughput, scattering, mask) → Guide
density = specialize_if_present(_density)  # (guide, density of even directions, direction) → density of the mixture
sample = specialize_if_present(_sample)  # (guide, (direction, weight, density), u, v, which) → likewise of the mixture
fly = specialize_if_present(_fly)  # (axis, (scattered, distance, factor), table, number, ray, coefficients, throughput, u)
turn = specialize_if_present(_turn)  # (axis, None, point, points in media) → axis of the rays that leave points
choose = specialize_if_present(_choose)  # (axis, other axis, mask) → the first where the mask is true
start = specialize_if_present(_start)  # (guides, None, like) → axis of camera rays
before = specialize_if_present(_before)  # (guide, number of others, number of guided ones)
