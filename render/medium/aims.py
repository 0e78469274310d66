"""Equi-angular samples: distances along a ray in proportion to the inverse square of the distance from a light (Kulla and Fajardo 2012)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...compiler import ir
from ...lights import POINTS, SURFACES
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane
from . import tracking

MOST = 64  # lights that distances are sampled for
DEEPEST = 2  # flights of a path that are: each may double the throughput, which would grow without a bound in dense media


def build(tables: ir.Tables) -> np.ndarray:
    """Places of lights (k, 4): x, y, z, and the share of the samples up to this row; brighter lights have more."""
    lights = tables.lights
    local = ir.is_in(lights.kind, POINTS)
    area = ir.is_in(lights.kind, SURFACES)
    places = np.where(local[:, None], lights.position, tables.transforms.matrix[lights.transform, :, 3])
    power = lights.color.sum(axis=1) * np.where(area, np.maximum(lights.size.max(axis=1, initial=0.0), 1e-6) ** 2, 1.0)
    rows = np.flatnonzero((local | area) & (power > 0.0))
    rows = rows[np.argsort(-power[rows], kind="stable")][:MOST]
    if not len(rows):
        return np.zeros((0, 4))
    share = np.sqrt(power[rows])
    return np.column_stack([places[rows], np.cumsum(share) / share.sum()])


@helper
def sample(table: Any, active: Lane, ray: Any, t: Lane, v: Lane, key: tracking.Key) -> tuple[Lane, Lane, Lane]:
    """(where distances are sampled in both ways, density of equi-angular samples there, the distance).

    Half of the samples keep their distance `t`; the density is that around the light which was chosen.
    """
    origin, direction, near, far = ray
    count = len(table.aims)
    none = ops.bool_like(near, False)
    if count == 0 or key.depth > DEEPEST or ops.not_(ops.any_lane(active)):
        return none, 0.0 * near, t
    w, which = tracking.numbers(key, 1)
    row = ops.int_like(near, 0)
    for k in range(count - 1):
        row = row + ops.where(which >= table.aims[k, 3], ops.int_like(near, 1), ops.int_like(near, 0))
    place = (0.0 * near + table.aims[row, 0], 0.0 * near + table.aims[row, 1], 0.0 * near + table.aims[row, 2])
    to_light = ops.sub(place, origin)
    middle = ops.dot(to_light, direction)
    apart = ops.sqrt(ops.maximum(ops.dot(to_light, to_light) - middle * middle, 1e-12 * (1.0 + ops.dot(to_light, to_light))))
    begin = ops.atan2(near - middle, apart)
    end = ops.where(far < math.inf, ops.atan2(ops.where(far < math.inf, far, 0.0) - middle, apart), ops.full_like(near, 0.5 * math.pi))
    angle = begin + (end - begin) * w
    angle = ops.clip(angle, -1.5707, 1.5707)
    turned = middle + apart * ops.sin(angle) / ops.maximum(ops.cos(angle), 1e-7)
    aimed = active & (end > begin)
    t = ops.where(aimed & (v < 0.5), ops.clip(turned, near, far), t)
    away = t - middle
    density = apart / (ops.maximum(end - begin, 1e-9) * (apart * apart + away * away))
    return aimed, density, t
