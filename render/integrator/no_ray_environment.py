"""Environment of specular surfaces in backends without secondary rays: the sky, and the ground's mean light below the horizon."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_facts
from ...materials import traits
from ..accel import intersect
from ..geometry.bounds import world_bounds
from ..lanes import ops
from ..material.shader import evaluate_shader
from ..surface import interaction
from ..types import AmbientEnvironment, Float3, Hit, Options, Ray, SecondaryRays
from . import direct_light
from .state.records import SampleIndex, Scene, ShadingContext

PLACES = 256  # points of the ground over which its light is averaged


def ambient_environment(
    scene: ir.Scene, tables: ir.Tables, options: Options, general: bool = False
) -> SecondaryRays | AmbientEnvironment:  # fmt: skip
    """Return the environment; `tables` are ready for shading, `options` without bounces.

    A scene without specular materials uses none; with `general` it gets a black one.
    """
    unused = not (traits.specular(scene.tables) & traits.used(scene.tables)).any()
    if unused and not general:
        return SecondaryRays()
    row = scene_facts.ground(scene.tables)
    if unused or row < 0:
        return AmbientEnvironment(Float3(0.0, 0.0, 0.0), Float3(0.0, 0.0, 0.0))
    up = normal(scene.tables, row)
    return AmbientEnvironment(Float3(*up), Float3(*_mean_light(tables, options, row, np.array(up))))


def normal(tables: ir.Tables, instance: int) -> tuple[float, float, float]:
    """Return the unit normal of a plane in world space."""
    row = tables.transforms.inverse[tables.instances.transform[instance], 1, :3]
    x, y, z = (row / np.linalg.norm(row)).tolist()
    return x, y, z


def _mean_light(tables: ir.Tables, options: Options, ground: int, up: NDArray[np.float64]) -> list[float]:
    """The mean radiance that the ground below the scene sends straight up, without shadows."""
    boxes = world_bounds(tables)
    boxes = boxes[np.isfinite(boxes).all(axis=1)]
    low, high = (boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)) if len(boxes) else (np.zeros(3), np.zeros(3))
    matrix = tables.transforms.matrix[tables.instances.transform[ground]]
    draws = np.random.default_rng(0)
    places = low + draws.random((PLACES, 3)) * (high - low)
    places = places - np.outer((places - matrix[:, 3]) @ up - 1.0, up)  # one metre above the ground
    lane = np.zeros(PLACES, np.int64)
    zero = np.zeros(PLACES)
    origin, down = (tuple(np.ascontiguousarray(a.T)) for a in (places, np.broadcast_to(-up, places.shape)))
    ray: Any = Ray(origin, down, zero, zero + np.inf, None)
    point = interaction.make_interaction(tables, ray, Hit(zero + 1.0, lane + ground, lane, zero, zero))
    shader = evaluate_shader(tables, point)
    unshadowed = options._replace(shadows=False, environment=SecondaryRays())
    everywhere = np.ones(PLACES, bool)
    with np.errstate(all="ignore"):
        viewer = ops.negate(ray.direction)
        scene = Scene(tables, intersect.Brute(), None, unshadowed)
        shading = ShadingContext(point, shader, viewer, None)
        light: Any = direct_light.direct_light(scene, shading, everywhere, SampleIndex(np.arange(PLACES), lane, lane + 1))
    channels = [np.broadcast_to(c, PLACES) for c in ops.add(light, shader.emission)]
    return [float(np.mean(c, where=np.isfinite(c))) for c in channels]
