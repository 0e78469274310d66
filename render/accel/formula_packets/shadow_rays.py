"""Traces shadow packets from implicit surfaces to point lights, a tile at a time, before shading (camera_rays.py).

Rays from neighboring points to a light without extent are coherent, as camera rays are. The result is an integer for each sample: bit 2 l
says that light l was tested, bit 2 l + 1 that a formula surface hides it. The BVH traversal then tests only instances with the bit
SHADOW_REST.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ....compiler import ir
from ....compiler.ir import light_links
from ...jit.kernel import helper, kernel
from ...lanes import crosslane, ops, ray_soa
from ...light import light_kinds, light_samples, lights
from ...simd.registration import overload, types
from ...surface import interaction
from ...types import Hit, Lane, Options, Ray, Surface, Tables, Vec
from .. import intersect
from ..bvh_build import scene_layout
from ..bvh_build.scene_layout import VISIBILITY
from .hits import load_slots, packet_instances

MAX_LIGHTS = 31  # two bits a light
CASTS, REST = int(ir.Visibility.SHADOW), scene_layout.SHADOW_REST


def select_lights(bvh: scene_layout.Bvh, tables: ir.Tables, options: Options) -> list[int]:
    """The lights that packets test: none where no formula surface in packets casts shadows, and none in scenes with light links."""
    if light_links.are_there(tables) or not options.shadows or not (bvh.instance_rows[packet_instances(bvh), VISIBILITY] & CASTS).any():
        return []
    return [k for k in range(len(tables.lights.kind)) if is_selected(tables, k)]


@helper
def is_selected(tables: Tables, light: int) -> bool:
    """Whether packets test a light."""
    sharp = not light_kinds.is_ambient(tables.lights.kind[light]) and not lights.is_soft(tables, light)
    return sharp and tables.lights.shadows[light] and light < MAX_LIGHTS


@kernel
def generate_rays(tables, light, rays, hits, out):
    """Generate rays from hits of camera rays to a light, in the layout of ray_soa; return how many the light may reach.

    Other samples get a ray whose t_max is less than its t_min.
    """
    n, many = len(hits.t), 0
    for start in range(0, n, crosslane.WIDTH):
        origin, direction, _, _ = ray_soa.get(rays, start)
        instance = load_slots(hits.instance, start)
        hit_mask = (instance >= 0) & (crosslane.lane_indices(start) < n)
        ends = ops.full_like(origin[0], -1.0)
        if ops.any_lane(hit_mask):
            u, v = load_slots(hits.u, start), load_slots(hits.v, start)
            hit = Hit(load_slots(hits.t, start), instance, load_slots(hits.spacing, start), u, v)
            position, geometric, offset = _formula_points(tables, Ray(origin, direction, 0.0, np.inf, None), hit, hit_mask)
            arriving = light_samples.sample_sharp(tables, light, position)
            lit = hit_mask & (ops.dot(arriving.direction, geometric) > 0.0) & (ops.largest(arriving.irradiance) > 0.0)
            ends = ops.where(lit, arriving.distance, ends)
            origin, direction = ops.along(position, geometric, offset), arriving.direction
            many += crosslane.count(lit)
            ray_soa.put(out, start, origin, direction, ops.full_like(ends, 0.0), ends)
        else:
            crosslane.store_row(out, 7 * out.shape[1] + start, ends)
    return many


@helper
def _formula_points(tables: Tables, ray: Ray, hit: Hit, hit_mask: Lane) -> tuple[Vec, Vec, Lane]:
    """interaction.formula_point in the lanes of a mask; where all hit one instance, its transform is read once."""
    offset = ops.full_like(hit.t, 0.0)
    position = geometric = (offset, offset, offset)
    pending = hit_mask
    while ops.any_lane(pending):
        instance, group = crosslane.uniform_group(hit.instance, pending)
        p, normal, far = interaction.formula_point(tables, instance, ray, hit)
        position, geometric = ops.where3(group, p, position), ops.where3(group, normal, geometric)
        offset = ops.where(group, far, offset)
        pending = pending & ops.not_(group)
    return position, geometric, offset


@kernel
def mark_hidden(light, rays, t, hidden):
    """Set the bits of a light in `hidden` from the hits t of rays to it, inf: none."""
    for i in range(len(t)):
        if rays[7, i] > 0.0:
            hidden[i] |= (3 if t[i] < np.inf else 1) << (2 * light)


# --- in shading -------------------------------------------------------------------------------------------------


def forget_hidden(hidden: Any) -> Any:
    """Hidden lights at hits of other rays: none known."""
    return None


@overload(forget_hidden)
def _forget_hidden_in_kernels(hidden):
    return (lambda hidden: None) if isinstance(hidden, types.NoneType) else lambda hidden: ops.int_like(hidden, 0)


def attenuate_light(point: Surface, accel: Any, tables: Tables, light: int, ray: Ray, active: Lane, radiance: Vec) -> Vec:
    """The light `radiance` of a light source that reaches a point; 0 for inactive rays."""
    return intersect.attenuate(accel, tables, ray, active, radiance)


@overload(attenuate_light)
def _attenuate_light_in_kernels(point, accel, tables, light, ray, active, radiance):
    if not isinstance(point.types[point.fields.index("known")], types.NoneType):
        return lambda point, accel, tables, light, ray, active, radiance: _apply_known(
            point.known, accel, tables, light, ray, active, radiance
        )
    return lambda point, accel, tables, light, ray, active, radiance: intersect.attenuate(accel, tables, ray, active, radiance)


@helper
def _apply_known(hidden: Lane, accel: Any, tables: Tables, light: int, ray: Ray, active: Lane, radiance: Vec) -> Vec:
    is_tested = ops.bool_like(ray.t_min, False)
    if is_selected(tables, light):
        bits = hidden >> (2 * light)
        is_tested = (bits & 1) != 0
        active = active & ((bits & 2) == 0)
    zero = ops.full_like(ray.t_min, 0.0)
    total = ops.where3(active & is_tested, radiance, (zero, zero, zero))
    if accel.rest_bits & REST != 0:
        total = intersect.attenuate(accel, tables, ray, active & is_tested, radiance, REST)
    untested = active & ops.not_(is_tested)
    if ops.any_lane(untested):
        total = ops.add(total, intersect.attenuate(accel, tables, ray, untested, radiance))
    return total
