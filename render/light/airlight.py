"""Light that fog scatters towards the camera, and its transmittance, for pictures without paths (airlight).

Rays of the rasterizer and of Whitted transport are attenuated exactly. Light of suns and of lights with a place is scattered once (Sun and
others 2005), without shadows. Light that scatters more often, and that of skies, has the mean radiance of its height (two_stream.py).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_facts
from ...lights import DISTANT, PLACED, SKIES
from ..geometry.bounds import world_bounds
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..medium import column, phase_table, two_stream
from ..types import Lane, NoAirlight, Ray, Tables, Vec
from . import light_samples, lights

F64 = NDArray[np.float64]
LEVELS = 65  # heights at which the mean radiance is computed
STRATA = 8  # points of Gauss and Legendre along the opacity of a ray
ANGLES = 12  # likewise along its angle around a light
FINE = 0.25  # mean free paths, to which the levels below the top are about even
DIRECTIONS = 64  # along each axis, of a sky
ENDLESS = 1e30  # column of an endless ray, whose product with an extinction of 0 is 0
GROUND = 0.2  # albedo of a ground with a pattern


class Airlight(NamedTuple):
    """The fog of a scene, and its light."""

    extinction: F64  # (4,) per metre in red, green and blue, and their mean
    scattering: F64  # (3,)
    beam: F64  # (3,) extinction of sunlight before it scatters by a large angle: what scatters forwards counts as passed
    phase: F64  # (4,) as Media.draine, whose first number is g of Henyey and Greenstein without a phase function of Draine
    top: float
    falloff: float
    suns: F64  # (k, 8) direction to the sun, 0, irradiance, 0
    placed: NDArray[np.int64]  # (m,) rows of lights with a place
    strata: F64  # (STRATA, 2) points from 0 to 1, and their weights
    angles: F64  # (ANGLES, 2) likewise
    mean: F64  # (LEVELS, 4) mean radiance, evenly by log(1 + column above · fine)
    fine: float  # per metre
    sky: int  # row of the first sky; -1: none
    deepest: float  # column above the last of them; 0: no light comes from above


def build(tables: ir.Tables) -> Airlight | NoAirlight:
    """The airlight of a scene; NoAirlight without fog."""
    rows = np.flatnonzero(tables.media.everywhere)[:1]
    if not len(rows):
        return NoAirlight()
    media, row = tables.media, int(rows[0])
    scattering, top, falloff = media.scattering[row], float(media.top[row]), float(media.falloff[row])
    extinction, kinds = scattering + media.absorption[row], tables.lights.kind
    middle = (np.zeros(1), np.zeros(1), np.zeros(1))
    suns = np.zeros((0, 8))
    for light in np.flatnonzero(ir.is_in(kinds, DISTANT)).tolist():
        half = np.full(1, 0.5)
        arriving = light_samples.sample(tables, light, middle, half, half)
        line = [*(float(c[0]) for c in arriving.direction), 0.0, *(float(c[0]) for c in arriving.irradiance), 0.0]
        suns = np.concatenate([suns, [line]])
    placed = np.flatnonzero(ir.is_in(kinds, PLACED)).astype(np.int64)
    deepest, mean, fine = 0.0, np.zeros((LEVELS, 4)), max(float(extinction.mean()), 1e-9) / FINE
    if math.isfinite(top):
        deepest = falloff + max(top - _bottom(tables), 0.0)
        depths = np.expm1(np.linspace(0.0, np.log1p(deepest * fine), LEVELS))[:, None] / fine * extinction
        beams = [two_stream.Beam(float(s[1]), s[4:7]) for s in suns if s[1] > 1e-3]
        albedo = scattering / np.maximum(extinction, 1e-30)
        mean[:, :3] = two_stream.mean_radiance(depths, albedo, float(media.anisotropy[row]), beams, _sky(tables), _albedo(tables))
    g = float(media.anisotropy[row])
    phase = media.draine[row] if media.draine[row, 3] > 0.0 else np.array([g, 0.0, 0.0, 0.0])
    return Airlight(
        np.append(extinction, extinction.mean()), scattering.copy(), extinction - scattering * g * g, phase.copy(), top,
        falloff, suns, placed, _points(STRATA), _points(ANGLES), mean, fine,
        int(next(iter(np.flatnonzero(ir.is_in(kinds, SKIES)).tolist()), -1)), deepest,
    )  # fmt: skip


def _points(count: int) -> F64:
    """Points of Gauss and Legendre from 0 to 1, and their weights (count, 2)."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return np.column_stack([0.5 * (points + 1.0), 0.5 * weights])


def _bottom(tables: ir.Tables) -> float:
    """The height of the ground, or of the lowest object or camera."""
    ground = scene_facts.ground(tables)
    if ground >= 0:
        return float(tables.transforms.matrix[tables.instances.transform[ground], 1, 3])
    boxes = world_bounds(tables)
    low = boxes[np.isfinite(boxes).all(axis=1), 1]
    return float(min(*low, *tables.transforms.matrix[tables.cameras.transform, 1, 3], np.inf))


def _albedo(tables: ir.Tables) -> F64:
    """The albedo of the ground (3,)."""
    ground = scene_facts.ground(tables)
    if ground < 0:
        return np.zeros(3)
    material = tables.instances.material[ground]
    if tables.materials.textures[material, ir.Slot.DIFFUSE] >= 0:
        return np.full(3, GROUND)
    return np.clip(tables.materials.values[material, ir.Slot.DIFFUSE], 0.0, 0.95)


def _sky(tables: ir.Tables) -> F64:
    """The irradiance (3,) of all skies on level ground."""
    if not ir.is_in(tables.lights.kind, SKIES).any():
        return np.zeros(3)
    u, v = (a.ravel() for a in np.meshgrid(*[(np.arange(DIRECTIONS) + 0.5) / DIRECTIONS] * 2))
    radius, angle = np.sqrt(u), 2.0 * np.pi * v
    direction = (radius * np.cos(angle), np.sqrt(1.0 - u), radius * np.sin(angle))
    radiance: Any = lights.background(tables, direction)[0]
    return np.pi * np.array([float(np.mean(np.broadcast_to(c, u.shape))) for c in radiance])


# --- kernels --------------------------------------------------------------------------------------------------------------


@helper
def _passed(extinction: Any, length: Lane) -> Vec:
    """The transmittance of a column."""
    return (
        ops.exp(-ops.minimum(extinction[0] * length, 80.0)), ops.exp(-ops.minimum(extinction[1] * length, 80.0)),
        ops.exp(-ops.minimum(extinction[2] * length, 80.0)),
    )  # fmt: skip


@helper
def _column(air: Any, origin: Vec, direction: Vec, distance: Lane) -> Lane:
    zero = 0.0 * origin[1] + 0.0 * direction[1]
    height, slope, far = origin[1] + zero, direction[1] + zero, zero + distance
    return ops.minimum(column.column(height, slope, zero + air.top, zero + air.falloff, far), ENDLESS)


@helper
def _transmit(air: Any, light: Vec, origin: Vec, direction: Vec, distance: Lane) -> Vec:
    return ops.mul(light, _passed(air.extinction, _column(air, origin, direction, distance)))


@helper
def _phase(air: Any, cosine: Lane) -> Lane:
    zero = 0.0 * cosine
    return phase_table.value(zero + air.phase[0], zero + air.phase[1], zero + air.phase[2], zero + air.phase[3], 1.0 - cosine)


@helper
def _from_above(air: Any, cosines: Vec, position: Vec) -> Vec:
    """Light that suns, skies and other fog scatter at a place, per unit of scattering, towards a viewer; `cosines`: the view direction."""
    zero = 0.0 * position[1]
    light = (zero, zero, zero)
    if air.deepest <= 0.0:
        return light
    over = position[1] - air.top
    above = ops.where(over > 0.0, column.density_at(over + air.top, zero + air.top, zero + air.falloff) * air.falloff, air.falloff - over)
    share = ops.log(1.0 + above * air.fine) / math.log(1.0 + air.deepest * air.fine)
    level = ops.clip(share * (LEVELS - 1), 0.0, LEVELS - 1.001)
    low = ops.floor_int(level)
    share = level - ops.to_float(low)
    a, b = row_gather.three_at(air.mean, low, 0), row_gather.three_at(air.mean, low + 1, 0)
    light = ops.add(ops.scale(a, 1.0 - share), ops.scale(b, share))
    for k in range(len(air.suns)):
        if air.suns[k, 1] > 1e-3:
            cosine = cosines[0] * air.suns[k, 0] + cosines[1] * air.suns[k, 1] + cosines[2] * air.suns[k, 2]
            strength = _phase(air, cosine)
            color = (air.suns[k, 4] * strength, air.suns[k, 5] * strength, air.suns[k, 6] * strength)
            light = ops.add(light, ops.mul(color, _passed(air.beam, above / air.suns[k, 1])))
    return light


@helper
def _along_column(air: Any, origin: Vec, direction: Vec, distance: Lane, length: Lane) -> Vec:
    """Airlight of suns and skies, by points of the opacity of the mean extinction."""
    zero = 0.0 * length
    light = (zero, zero, zero)
    mean = air.extinction[3]
    if air.deepest <= 0.0 or mean <= 0.0:
        return light
    opacity = 1.0 - ops.exp(-ops.minimum(mean * length, 80.0))
    top, falloff, height, slope = zero + air.top, zero + air.falloff, origin[1] + zero, direction[1] + zero
    for k in range(len(air.strata)):
        remains = 1.0 - opacity * air.strata[k, 0]
        before = -ops.log(ops.maximum(remains, 1e-30)) / mean
        t = ops.minimum(column.distance_of(height, slope, top, falloff, ops.minimum(before, length)), 1e12)
        t = ops.where(t < distance, t, ops.where(distance < math.inf, distance, t))
        place = ops.add(origin, ops.scale(direction, t))
        source = ops.mul(_from_above(air, direction, place), _passed(air.extinction, before))
        light = ops.add(light, ops.scale(source, opacity * air.strata[k, 1] / (mean * ops.maximum(remains, 1e-30))))
    return light


@helper
def _around_light(air: Any, tables: Tables, light: int, origin: Vec, direction: Vec, distance: Lane) -> Vec:
    """Airlight of a light with a place, by points of the angle around it (Kulla and Fajardo 2012)."""
    zero = 0.0 * origin[0] + 0.0 * direction[0]
    half = zero + 0.5
    arriving = light_samples.sample(tables, light, ops.add(origin, (zero, zero, zero)), half, half)
    middle = arriving.distance * ops.dot(arriving.direction, direction)
    apart = ops.sqrt(ops.maximum(arriving.distance * arriving.distance - middle * middle, 1e-12))
    begin = ops.atan2(-middle, apart)
    finite = distance < math.inf
    end = ops.where(finite, ops.atan2(ops.where(finite, distance, 0.0) - middle, apart), zero + 0.5 * math.pi)
    total = (zero, zero, zero)
    for k in range(len(air.angles)):
        angle = ops.clip(begin + (end - begin) * air.angles[k, 0], -1.5707, 1.5707)
        along = apart * ops.sin(angle) / ops.maximum(ops.cos(angle), 1e-7)
        t = ops.maximum(middle + along, 0.0)
        place = ops.add(origin, ops.scale(direction, t))
        arriving = light_samples.sample(tables, light, place, half, half)
        density = column.density_at(place[1], zero + air.top, zero + air.falloff)
        strength = _phase(air, ops.dot(arriving.direction, direction)) * density
        strength = strength * air.angles[k, 1] * (end - begin) * (apart * apart + along * along) / apart
        reached = _transmit(air, arriving.irradiance, place, arriving.direction, arriving.distance)
        total = ops.add(total, ops.scale(ops.mul(reached, _passed(air.extinction, _column(air, origin, direction, t))), strength))
    return total


@helper
def _add_airlight(air: Any, light: Vec, tables: Tables, origin: Vec, direction: Vec, distance: Lane) -> Vec:
    """`light` from the end of a ray as it arrives at its origin, with what the fog adds."""
    length = _column(air, origin, direction, distance)
    added = _along_column(air, origin, direction, distance, length)
    for k in range(len(air.placed)):
        added = ops.add(added, _around_light(air, tables, air.placed[k], origin, direction, distance))
    added = ops.mul(added, (air.scattering[0], air.scattering[1], air.scattering[2]))
    return ops.add(ops.mul(light, _passed(air.extinction, length)), added)


@helper
def _arriving_sky(air: Any, radiance: Vec, light: int, origin: Vec, direction: Vec) -> Vec:
    """The radiance of a sky as it arrives at a place; the airlight of suns and skies counts with the first sky."""
    length = _column(air, origin, direction, 0.0 * origin[0] + lights.FAR)
    radiance = ops.mul(radiance, _passed(air.extinction, length))
    if light == air.sky:
        added = _along_column(air, origin, direction, 0.0 * length + lights.FAR, length)
        radiance = ops.add(radiance, ops.mul(added, (air.scattering[0], air.scattering[1], air.scattering[2])))
    return radiance


@helper
def _after_bounce(air: Any, before: tuple[Vec, Vec], tables: Tables, ray: Ray, reach: Lane, active: Lane, seen: Lane) -> tuple[Vec, Vec]:
    """(total, weight) of secondary rays with their airlight; the weight of those that hit nothing is attenuated to the sky."""
    total, weight = before
    zero = 0.0 * reach
    far = ops.where(seen, reach, zero + lights.FAR)
    added = _add_airlight(air, (zero, zero, zero), tables, ray.origin, ray.direction, far)
    total = ops.where3(active, ops.add(total, ops.mul(weight, added)), total)
    return total, ops.where3(seen, weight, _transmit(air, weight, ray.origin, ray.direction, far))


@helper
def _opacity(air: Any, clear: Lane, origin: Vec, direction: Vec, distance: Lane) -> Lane:
    passed = _passed(air.extinction, _column(air, origin, direction, distance))
    return 1.0 - (passed[0] + passed[1] + passed[2]) / 3.0


# Each takes Options.airlight, the result in scenes without fog, and:
transmit = specialize_if_present(_transmit)  # (origin, direction, distance) → light attenuated over the distance
seen_through = specialize_if_present(_add_airlight)  # (tables, origin, direction, distance) → light from there at the origin
sky = specialize_if_present(_arriving_sky)  # (light, origin, direction) → radiance of a sky as it arrives at the origin
after_bounce = specialize_if_present(_after_bounce)  # (tables, ray, distance, active, seen) → (total, weight)
opacity = specialize_if_present(_opacity)  # (origin, direction, distance) → share of light that does not pass
