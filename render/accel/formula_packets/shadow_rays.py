"""Which lamps formula surfaces hide from what camera rays meet of them, found for a tile at a time before that is shaded (bundled.py).

Rays from neighbouring places to a lamp without extent go much the same way, as camera rays do. What was found is a whole number for each
sample: bit 2 l says that lamp l has been asked for, bit 2 l + 1 that a formula surface hides it. Trees are then asked for what has the
bit bvh.SHADOW_REST.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from ....compiler import ir
from ...jit.kernel import HELPER, helper, kernel
from ...lanes import crosslane, ops, ray_soa
from ...light import lights
from ...surface import interaction
from ...types import Hit, Lane, Options, Ray, Surface, Tables, Vec
from .. import intersect
from ..build import scene_layout
from .hits import instances, taken

LAMPS = 31  # two bits each
CASTS, REST = int(ir.Visibility.SHADOW), scene_layout.SHADOW_REST


def lamps(trees: scene_layout.Bvh, tables: ir.Tables, options: Options) -> list[int]:
    """The lamps that are asked for beforehand: none where no formula surface that camera rays meet so casts shadows."""
    if not options.shadows or not (trees.instance_rows[instances(trees), 0] & CASTS).any():
        return []
    return [k for k in range(len(tables.lights.kind)) if is_asked(tables, k)]


@helper
def is_asked(tables: Tables, light: int) -> bool:
    """Whether a light is a lamp that is asked for."""
    sharp = tables.lights.kind[light] != lights.AMBIENT and not lights.is_soft(tables, light)
    return sharp and tables.lights.shadows[light] and light < LAMPS


@kernel
def aim(tables, light, rays, found, out):
    """Rays to a lamp from where camera rays met surfaces, one for each that it may light; how many. As columns.py has them, all;
    where there is none, its last distance is less than its first, and the rest says nothing."""
    n, many = len(found.t), 0
    for start in range(0, n, crosslane.WIDTH):
        origin, direction, _, _ = ray_soa.get(rays, start)
        instance = taken(found.instance, start)
        met = (instance >= 0) & (crosslane.lane_indices(start) < n)
        ends = ops.full_like(origin[0], -1.0)
        if ops.any_lane(met):
            hit = Hit(taken(found.t, start), instance, taken(found.spacing, start), taken(found.u, start), taken(found.v, start))
            position, geometric, offset = _off(tables, Ray(origin, direction, 0.0, np.inf, None), hit, met)
            arriving = lights.sample_sharp(tables, light, position)
            lit = met & (ops.dot(arriving.direction, geometric) > 0.0) & (ops.largest(arriving.irradiance) > 0.0)
            ends = ops.where(lit, arriving.distance, ends)
            origin, direction = ops.along(position, geometric, offset), arriving.direction
            many += crosslane.count(lit)
            ray_soa.put(out, start, origin, direction, ops.full_like(ends, 0.0), ends)
        else:
            crosslane.store_row(out, 7 * out.shape[1] + start, ends)
    return many


@helper
def _off(tables: Tables, ray: Ray, hit: Hit, met: Lane) -> tuple[Vec, Vec, Lane]:
    """surface.off_formula in the lanes of a mask: mostly they have met one thing, and its place is read once for all of them."""
    offset = ops.full_like(hit.t, 0.0)
    position = geometric = (offset, offset, offset)
    rest = met
    while ops.any_lane(rest):
        instance, here = crosslane.uniform_group(hit.instance, rest)
        p, normal, far = interaction.off_formula(tables, instance, ray, hit)
        position, geometric = ops.where3(here, p, position), ops.where3(here, normal, geometric)
        offset = ops.where(here, far, offset)
        rest = rest & ops.not_(here)
    return position, geometric, offset


@kernel
def tell(light, rays, t, hidden):
    """Put to `hidden` what rays to a lamp met, `t` being inf where that is nothing."""
    for i in range(len(t)):
        if rays[7, i] > 0.0:
            hidden[i] |= (3 if t[i] < np.inf else 1) << (2 * light)


# --- where it is shaded -------------------------------------------------------------------------------------------------


def forgotten(known: Any) -> Any:
    """What is known where other rays meet something: nothing."""
    return None


@overload(forgotten, jit_options=HELPER)
def _forgotten(known):
    return (lambda known: None) if isinstance(known, types.NoneType) else lambda known: ops.int_like(known, 0)


def dimmed(point: Surface, accel: Any, tables: Tables, light: int, ray: Ray, active: Lane, given: Vec) -> Vec:
    """What of a lamp's light that is `given` passes to a point; nothing where not active."""
    return intersect.attenuate(accel, tables, ray, active, given)


@overload(dimmed, jit_options=HELPER)
def _dimmed_in_kernels(point, accel, tables, light, ray, active, given):
    if not isinstance(point.types[point.fields.index("known")], types.NoneType):
        return lambda point, accel, tables, light, ray, active, given: _by_rest(point.known, accel, tables, light, ray, active, given)
    return lambda point, accel, tables, light, ray, active, given: intersect.attenuate(accel, tables, ray, active, given)


@helper
def _by_rest(known: Lane, accel: Any, tables: Tables, light: int, ray: Ray, active: Lane, given: Vec) -> Vec:
    told = ops.bool_like(ray.t_min, False)
    if is_asked(tables, light):
        bits = known >> (2 * light)
        told = (bits & 1) != 0
        active = active & ((bits & 2) == 0)
    zero = ops.full_like(ray.t_min, 0.0)
    total = ops.where3(active & told, given, (zero, zero, zero))
    if accel.rest & REST != 0:
        total = intersect.attenuate(accel, tables, ray, active & told, given, REST)
    rest = active & ops.not_(told)
    if ops.any_lane(rest):
        total = ops.add(total, intersect.attenuate(accel, tables, ray, rest, given))
    return total
