"""Unified glare rating (CIE 117:1995) at a camera: UGR = 8 log₁₀(0.25/L_b · Σ L² ω/p²) over the lamps that it sees.

L_b is the vertical illuminance at the eye without the direct light of lamps and skies, over π. ω is the solid angle that is seen of a lamp,
L its luminance and p the position index of Guth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.mesh.parts import Part
from ...compiler.plan import plan as planner
from ...lang.diagnostics import Diagnostic
from ...lights import POINTS as LIGHT_POINTS
from ...materials import traits
from ...render.accel import ray_queries
from ...render.image import metrics
from ...render.jit.packed_struct import Handle
from . import illuminance, sensors
from .illuminance import Value
from .replicates import QUANTILE, Effort, Estimate, Sampler, as_estimate

GROUPS = sensors.REPLICATES  # of points on a lamp, whose spread is the error
POINTS = 512  # of a group
LARGE = 0.1  # steradians, above which the rating is not meant for a source (CIE 117, 5)
ROUNDING = 1e-6  # of the whole light at an eye, below which light behind the lamps is rounding
NEAR = 1e-4  # relative difference of a hit's distance from that of the lamp's point, up to which the point is seen
F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Source:
    """A lamp that the eye sees."""

    name: str
    luminance: float  # candela a square metre
    solid_angle: Value  # steradians
    position: float  # Guth's index, weighted by solid angle
    weight: Value  # ∫ L²/p² dω


@dataclass(frozen=True)
class Rating:
    """A rating at an eye. `ugr` is None without a lamp that is seen, or without background light."""

    ugr: Value | None
    background: Value  # L_b in candela a square metre
    sources: tuple[Source, ...]


def rate(scene: ir.Scene, settings: ir.Settings, effort: Effort) -> tuple[Rating, list[Diagnostic]]:
    """The rating at the camera of the settings, and what it leaves out. Raises ValueError for a camera without a perspective."""
    merged = settings.over(scene.settings)
    camera = planner.make_plan(scene, ir.Settings(camera=merged.camera))["camera"]
    tables = scene.tables
    if tables.cameras.projection[camera] != ir.Projection.PERSPECTIVE:
        raise ValueError("a glare rating is that of an eye: the camera must be a perspective one")
    matrix = tables.transforms.matrix[tables.cameras.transform[camera]]
    axes = matrix[:, :3] / np.linalg.norm(matrix[:, :3], axis=0)
    eye = np.eye(4)
    eye[:3, 0], eye[:3, 1], eye[:3, 2], eye[:3, 3] = axes[:, 0], -axes[:, 2], axes[:, 1], matrix[:, 3]
    background, diagnostics = _background(scene, eye, effort)
    accel = ray_queries.build(tables, general=True)
    rows, notes = _shining(scene)
    every = (_source(scene, part, axes, matrix[:, 3], accel) for part in sensors.triangles(scene, rows))
    sources = tuple(source for source in every if source is not None)
    diagnostics += notes + [
        Diagnostic("note", f"`{s.name}` fills {s.solid_angle.value:.2g} sr: above {LARGE:g} sr the rating says too much of a lamp")
        for s in sources if s.solid_angle.value > LARGE
    ]  # fmt: skip
    return Rating(_rating(background, sources), background, sources), diagnostics


def _rating(background: Value, sources: tuple[Source, ...]) -> Value | None:
    total = sum(source.weight.value for source in sources)
    if total <= 0.0 or background.value <= 0.0:
        return None
    relative = math.hypot(math.hypot(*(s.weight.error for s in sources)) / total, background.error / background.value)
    return Value(8.0 * math.log10(0.25 / background.value * total), 8.0 / math.log(10.0) * relative)


def _background(scene: ir.Scene, eye: F64, effort: Effort) -> tuple[Value, list[Diagnostic]]:
    """L_b, from the difference of the whole light and the direct light, with the same random numbers.

    Light samples alone find direct light here: with a share of BSDF samples, no limit on bounces separates it.
    """
    meter = ir.Meter("eye", tuple(map(tuple, eye.tolist())))
    seen, (sensor,) = sensors.with_sensors(scene, [meter])
    sampler = Sampler(seen, ir.Settings(size=(1, 1), camera="0"), effort, {**illuminance.precision(scene, [meter]), "mis": "light"})
    total, sums = sampler.replicates(sensor.cameras, (1, 1))
    direct = sampler.direct(sensor.cameras, (1, 1), total.samples // GROUPS)
    rest: Estimate = as_estimate(sums - direct)
    lost = sampler.unbounced(sensor.cameras, (1, 1))
    mean = rest.mean if rest.mean > ROUNDING * total.mean else 0.0
    return Value(mean, rest.mean_error + lost * total.mean), illuminance.missing_light(scene, sampler)


def _shining(scene: ir.Scene) -> tuple[NDArray[np.int64], list[Diagnostic]]:
    """The instances that shine, and notes on lamps that the rating leaves out."""
    tables, diagnostics = scene.tables, []
    lights = tables.lights
    bright = metrics.luminance(lights.color) > 0.0
    for row in np.flatnonzero(ir.is_in(lights.kind, LIGHT_POINTS) & bright).tolist():
        name = scene.names.lights[row] or "a lamp"
        message = f"{name} is a point, which has no luminance: the glare rating leaves it out"
        diagnostics.append(Diagnostic("note", message, scene.spans.get("lights", row), "a sphere of an emissive material has one"))
    used = tables.instances.material
    shines = traits.emissive(tables)[used]
    varied = shines & (tables.materials.textures[used, ir.Slot.EMISSION] >= 0)
    for row in np.flatnonzero(varied).tolist():
        name = scene.names.instances[row] if row < len(scene.names.instances) else "an object"
        message = f"the luminance of `{name}` varies over it: the glare rating takes its greatest"
        diagnostics.append(Diagnostic("note", message, scene.spans.get("instances", row)))
    return np.flatnonzero(shines), diagnostics


def _source(scene: ir.Scene, part: Part, axes: F64, eye: F64, accel: Handle) -> Source | None:
    """A lamp from points on it; None where the eye sees nothing of it."""
    tables, row = scene.tables, part.instance
    material = int(tables.instances.material[row])
    luminance = float(metrics.luminance(tables.materials.values[material, ir.Slot.EMISSION]))
    light = int(tables.instances.light[row])
    corners = part.positions[part.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(across, axis=1)
    random = np.random.default_rng(row)
    shift = random.random((GROUPS, 1, 3))
    area_sample, u, v = np.moveaxis((shift + np.arange(POINTS)[None, :, None] * np.array(sensors.STEPS)) % 1.0, 2, 0).reshape(3, -1)
    chosen, u = np.minimum(np.searchsorted(np.cumsum(areas), area_sample * areas.sum()), len(areas) - 1), np.sqrt(u)
    points = np.einsum("ni,nij->nj", np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1), corners[chosen])
    way = points - eye
    distance = np.linalg.norm(way, axis=1)
    way = way / distance[:, None]
    cosine = -np.einsum("ni,ni->n", way, across[chosen]) / (2.0 * areas[chosen])
    one_sided = light >= 0
    cosine = np.maximum(cosine, 0.0) if one_sided else np.abs(cosine)
    hits = ray_queries.closest(accel, np.broadcast_to(eye, way.shape), way)
    off = NEAR * distance + 8.0 * part.deviation
    seen = (hits.instance == row) & (np.abs(hits.t - distance) <= off + part.deviation / np.maximum(cosine, 0.01))
    if not one_sided:  # each direction counts once
        seen &= np.abs(hits.t - distance) <= off
    angle = np.where(seen, cosine / distance**2, 0.0) * areas.sum()
    index = position_index(way @ axes[:, 0], way @ axes[:, 1], -way @ axes[:, 2])
    with np.errstate(invalid="ignore"):
        weights = np.where(np.isfinite(index), luminance**2 * angle / index**2, 0.0)
        indices = np.where(np.isfinite(index), angle * index, 0.0)
    counted = np.where(np.isfinite(index), angle, 0.0)
    if not weights.any():
        return None
    name = scene.names.instances[row] if row < len(scene.names.instances) else "a lamp"
    solid = _mean(counted, part, areas)
    return Source(name, luminance, solid, float(indices.mean() / counted.mean()), _mean(weights, part, areas))


def _mean(values: F64, part: Part, areas: F64) -> Value:
    groups = values.reshape(GROUPS, POINTS).mean(axis=1)
    value = float(groups.mean())
    rough = 4.0 * math.sqrt(math.pi / float(areas.sum())) * part.deviation  # of the area, of triangles in place of the surface
    return Value(value, QUANTILE * float(groups.std(ddof=1)) / math.sqrt(GROUPS) + rough * value)


def position_index(right: F64, up: F64, ahead: F64) -> F64:
    """Guth's position index of directions; inf behind the eye.

    Above the line of sight by the formula of the IESNA (Levin 1975), below it by that of Iwata and others (1997).
    """
    beside = np.hypot(right, up)
    with np.errstate(divide="ignore", invalid="ignore"):
        alpha = np.degrees(np.arctan2(np.abs(right), up))  # from the vertical
        beta = np.degrees(np.arctan2(beside, ahead))
        linear = (35.2 - 0.31889 * alpha - 1.22 * np.exp(-2.0 * alpha / 9.0)) * 1e-3
        square = (21.0 + 0.26667 * alpha - 0.002963 * alpha**2) * 1e-5
        above = np.exp(linear * beta + square * beta**2)
        away = beside / ahead
        below = 1.0 + np.where(away < 0.6, 0.8, 1.2) * away
    return np.where(ahead <= 1e-6, np.inf, np.where(up >= 0.0, above, below))
