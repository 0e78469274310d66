"""Packets of coherent rays: the test for coherence, and the intervals and the central ray that represent a packet."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import crosslane, ops
from ...types import Lane, Vec
from . import ray_box, ray_state, triangle_filter

MIN_RAYS = 3  # of a packet
PACKETS = crosslane.WIDTH >= MIN_RAYS
SPREAD = 0.2  # largest extent of a packet, in leaves of the mesh per ray
SPREAD_ANY = 0.09  # the same for any hit, which single rays find sooner
_FAR, _STEEP = np.float32(ray_state.FAR), np.float32(ray_state.STEEP)


class CentralRay(NamedTuple):
    """The central ray of a packet and the extent of the packet around it, in single precision, for the triangles of a leaf."""

    axes: tuple[int, int, int]  # of the shear
    origin: Vec  # the entry into the mesh's box, in the shear's axes
    shear: tuple[Lane, Lane]
    spread: tuple[Lane, Lane]  # half the extent of the packet at the central ray's start
    flare: tuple[Lane, Lane]  # growth of `spread` per unit along the main axis
    early: Lane  # how far before the central ray others start, along the main axis
    scale: Lane  # smallest t of a unit along the main axis; negative for rays that go down it
    off: Lane  # rounding error of a corner


class Packet(NamedTuple):
    """Rays of one octant with one main axis, in single precision."""

    active: int  # bits of the rays of the packet; k is one of them
    k: int
    up: tuple[bool, bool, bool]  # toward greater x, y, z
    origin: Vec  # the entry into the mesh's box
    inverse: Vec  # 1 / direction
    limits: Lane  # lengths of the rays from there


@helper
def is_coherent(active: int, d: Vec, ray: ray_box.BoxRay) -> bool:
    """Whether the rays whose bits are set are at least MIN_RAYS and share octant and main axis."""
    if simd.population(active) < MIN_RAYS:
        return False
    x, y = _main_axis(d)
    return (_differs(x, active) | _differs(y, active) | _differs(crosslane.bits(ray.x), active) | _differs(crosslane.bits(ray.y), active)
            | _differs(crosslane.bits(ray.z), active)) == 0  # fmt: skip


@helper
def _main_axis(d: Vec) -> tuple[int, int]:
    """Bits of the rays whose largest component is x, and whose y is not less than z, as triangle_hit.shear chooses axes."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    return crosslane.bits((x >= y) & (x >= z)), crosslane.bits(y >= z)


@helper
def _differs(bits: int, active: int) -> int:
    """0 where all active bits are equal."""
    bits &= active
    return bits * (bits ^ active)


class PacketShear(NamedTuple):
    """The shear of coherent rays."""

    k: int  # one of the rays
    axes: tuple[int, int, int]
    factors: Vec


@helper
def shear_packet(active: int, d: Vec, ray: ray_box.BoxRay) -> PacketShear:
    """The shear that the active coherent rays share, with a factor for each ray."""
    k = simd.trailing_zeros(active)
    x, y = _main_axis(d)
    kz = 0 if (x >> k) & 1 else (1 if (y >> k) & 1 else 2)
    kx, ky = (kz + 1) % 3, (kz + 2) % 3
    if not crosslane.lane(component((ray.x, ray.y, ray.z), kz), k):
        kx, ky = ky, kx
    scale = component(ray.inverse, kz)
    return PacketShear(k, (kx, ky, kz), (component(d, kx) * scale, component(d, ky) * scale, scale))


@helper
def may_share_leaves(shear: PacketShear, active: int, o: Vec, leaf_extent: Any, any_hit: bool) -> bool:
    """Whether the first and the last ray are close enough at the mesh's origin for `share_leaves` to hold: a quick rejection."""
    z = component(o, shear.axes[2])
    last = crosslane.width(o[0]) - 1
    last = last if (active >> last) & 1 else shear.k
    width = (SPREAD_ANY if any_hit else SPREAD) * leaf_extent * simd.population(active)
    return (_lane_distance(component(o, shear.axes[0]) - shear.factors[0] * z, shear.k, last) <= width
            and _lane_distance(component(o, shear.axes[1]) - shear.factors[1] * z, shear.k, last) <= width)  # fmt: skip


@helper
def _lane_distance(x: Lane, k: int, last: int) -> Any:
    return abs(simd.lane(x, k) - simd.lane(x, last))


@helper
def make_packet(active: int, k: int, rays: ray_box.MeshRays) -> Packet:
    """The packet of coherent rays, of which k is one."""
    o, d, box, enters = rays.origin, rays.direction, rays.box, rays.enters
    up = (crosslane.bits(box.x) >> k) & 1 != 0, (crosslane.bits(box.y) >> k) & 1 != 0, (crosslane.bits(box.z) >> k) & 1 != 0
    inverse = simd.to_f32(box.inverse[0]), simd.to_f32(box.inverse[1]), simd.to_f32(box.inverse[2])
    most = _STEEP * ops.smallest((abs(inverse[0]), abs(inverse[1]), abs(inverse[2])))
    return Packet(
        active, k, up,
        (_entry_point(o[0], d[0], enters), _entry_point(o[1], d[1], enters), _entry_point(o[2], d[2], enters)),
        (ops.clip(inverse[0], -most, most), ops.clip(inverse[1], -most, most), ops.clip(inverse[2], -most, most)),
        simd.to_f32((rays.until - enters) * ray_state.FAR),
    )  # fmt: skip


@helper
def _entry_point(o: Lane, d: Lane, enters: Lane) -> Lane:
    return simd.to_f32(o + enters * d)


@helper
def share_leaves(central: CentralRay, active: int, extent: Any, leaf_extent: Any, any_hit: bool) -> bool:
    """Whether a packet crosses mostly the same leaves and float32 has the range for the mesh.

    `extent` is the mesh's largest coordinate, `leaf_extent` the median extent of its leaves.
    """
    if triangle_filter.unsure_bits(np.float32(0.5) * central.off) != 0:
        return False
    width = np.float32(0.5 * (SPREAD_ANY if any_hit else SPREAD) * leaf_extent * simd.population(active))
    far = np.float32(2.0 * extent)
    return central.spread[0] + far * central.flare[0] <= width and central.spread[1] + far * central.flare[1] <= width


@helper
def central_ray(rays: Packet, shear: PacketShear, off: Any) -> CentralRay:
    """The central ray of a packet; `off` is the rounding error of a corner."""
    kx, ky, kz = shear.axes
    x, y, z = component(rays.origin, kx), component(rays.origin, ky), component(rays.origin, kz)
    k, mask = rays.k, simd.mask_from_bits(rays.active, z)
    sx, sy = simd.to_f32(shear.factors[0]), simd.to_f32(shear.factors[1])
    mz, hz = _center(z, mask, k)
    (mx, hx), (my, hy) = _center(simd.fma(sx, mz - z, x), mask, k), _center(simd.fma(sy, mz - z, y), mask, k)
    (tx, fx), (ty, fy) = _center(sx, mask, k), _center(sy, mask, k)
    return CentralRay(
        shear.axes, (mx, my, mz), (tx, ty), (hx + off, hy + off), (fx * _FAR, fy * _FAR), hz + off,
        _nearest_to_zero(simd.to_f32(shear.factors[2]), mask, k), off,
    )  # fmt: skip


@helper
def component(x: Vec, k: int) -> Lane:
    """Component k, one number for all lanes."""
    return x[0] if k == 0 else (x[1] if k == 1 else x[2])


@helper
def _center(x: Lane, mask: Lane, k: int) -> tuple[Any, Any]:
    """(center, half extent) of the lanes of a mask, of which k is one."""
    x = simd.select(mask, x, simd.lane(x, k))
    low, high = simd.min_of(x), simd.max_of(x)
    return np.float32(0.5) * (low + high), np.float32(0.5) * (high - low)


@helper
def _nearest_to_zero(x: Lane, mask: Lane, k: int) -> Any:
    """The value of smallest magnitude in the lanes of a mask, which all have one sign."""
    x = simd.select(mask, x, simd.lane(x, k))
    return simd.min_of(x) if simd.lane(x, k) > np.float32(0.0) else simd.max_of(x)
