"""Several rays that go one way, as one: whether they do, whether they are near each other, and what holds them all."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import crosslane, ops
from ...types import Lane, Vec
from . import ray_box, single_ray, triangle_filter

FEW = 3  # rays from which on it is worth it
BUNDLES = crosslane.WIDTH >= FEW
WIDE = 0.2  # leaves of the mesh for each of them that they may be apart
WIDE_ANY = 0.09  # the same for any hit, which a ray by itself finds sooner
_FAR, _STEEP = np.float32(single_ray.FAR), np.float32(single_ray.STEEP)


class Core(NamedTuple):
    """Rays as one in their middle, and how far they are from it, for a leaf's triangles; numbers in single precision."""

    axes: tuple[int, int, int]
    origin: Vec  # where they enter the mesh's box, in the shear's axes
    shear: tuple[Lane, Lane]
    apart: tuple[Lane, Lane]  # half of their distance where the middle one begins
    flare: tuple[Lane, Lane]  # how much that grows for each unit along the main axis
    early: Lane  # how far before the middle one they may begin, along the main axis
    scale: Lane  # the least t of a unit along the main axis; below 0 where they go down
    off: Lane  # what rounding may move a corner


class Group(NamedTuple):
    """Rays side by side that go one way: of one octant, with one main axis."""

    left: int  # bits of those that count; k is one of them
    k: int
    up: tuple[bool, bool, bool]  # toward greater x, y, z
    origin: Vec  # where they enter the mesh's box, in single precision
    inverse: Vec  # 1 / direction
    limits: Lane  # how far they go from there


@helper
def is_coherent(left: int, d: Vec, ray: ray_box.BoxRay) -> bool:
    """Whether the rays whose bits are set in `left` are several and go one way."""
    if simd.population(left) < FEW:
        return False
    x, y = _main(d)
    return (_mixed(x, left) | _mixed(y, left) | _mixed(crosslane.bits(ray.x), left) | _mixed(crosslane.bits(ray.y), left)
            | _mixed(crosslane.bits(ray.z), left)) == 0  # fmt: skip


@helper
def _main(d: Vec) -> tuple[int, int]:
    """Bits of the rays whose largest axis is x, and y, as flat.shear chooses it."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    return crosslane.bits((x >= y) & (x >= z)), crosslane.bits(y >= z)


@helper
def _mixed(bits: int, left: int) -> int:
    """0 where bits are the same in all of `left`."""
    bits &= left
    return bits * (bits ^ left)


class Way(NamedTuple):
    """Which way rays go that are `alike`."""

    k: int  # one of them
    axes: tuple[int, int, int]  # of the shear
    slopes: Vec  # and its factors


@helper
def way(left: int, d: Vec, ray: ray_box.BoxRay) -> Way:
    k = simd.trailing_zeros(left)
    x, y = _main(d)
    kz = 0 if (x >> k) & 1 else (1 if (y >> k) & 1 else 2)
    kx, ky = (kz + 1) % 3, (kz + 2) % 3
    if not crosslane.lane(pick((ray.x, ray.y, ray.z), kz), k):
        kx, ky = ky, kx
    scale = pick(ray.inverse, kz)
    return Way(k, (kx, ky, kz), (pick(d, kx) * scale, pick(d, ky) * scale, scale))


@helper
def may_be_close(rays: Way, left: int, o: Vec, fine: Any, any_hit: bool) -> bool:
    """Whether the first and the last ray of a mesh, as they pass its middle, may be near enough to each other for all to be `close`."""
    z = pick(o, rays.axes[2])
    last = crosslane.width(o[0]) - 1
    last = last if (left >> last) & 1 else rays.k
    width = (WIDE_ANY if any_hit else WIDE) * fine * simd.population(left)
    return (_between(pick(o, rays.axes[0]) - rays.slopes[0] * z, rays.k, last) <= width
            and _between(pick(o, rays.axes[1]) - rays.slopes[1] * z, rays.k, last) <= width)  # fmt: skip


@helper
def _between(x: Lane, k: int, last: int) -> Any:
    return abs(simd.lane(x, k) - simd.lane(x, last))


@helper
def group(left: int, k: int, o: Vec, d: Vec, ray: ray_box.BoxRay, enters: Lane, until: Lane) -> Group:
    """For rays that are `alike` and enter a mesh's box at `enters`; nothing beyond `until` is asked for."""
    up = (crosslane.bits(ray.x) >> k) & 1 != 0, (crosslane.bits(ray.y) >> k) & 1 != 0, (crosslane.bits(ray.z) >> k) & 1 != 0
    inverse = simd.to_f32(ray.inverse[0]), simd.to_f32(ray.inverse[1]), simd.to_f32(ray.inverse[2])
    most = _STEEP * ops.smallest((abs(inverse[0]), abs(inverse[1]), abs(inverse[2])))
    return Group(
        left, k, up,
        (_entered(o[0], d[0], enters), _entered(o[1], d[1], enters), _entered(o[2], d[2], enters)),
        (ops.clip(inverse[0], -most, most), ops.clip(inverse[1], -most, most), ops.clip(inverse[2], -most, most)),
        simd.to_f32((until - enters) * single_ray.FAR),
    )  # fmt: skip


@helper
def _entered(o: Lane, d: Lane, enters: Lane) -> Lane:
    return simd.to_f32(o + enters * d)


@helper
def share_leaves(core: Core, left: int, reach: Any, fine: Any, any_hit: bool) -> bool:
    """Whether rays go through much the same leaves of a mesh that single precision has the range for.

    `reach` is the largest of the mesh's coordinates, `fine` how wide its leaves are.
    """
    if triangle_filter.unsure(np.float32(0.5) * core.off) != 0:
        return False
    width = np.float32(0.5 * (WIDE_ANY if any_hit else WIDE) * fine * simd.population(left))
    far = np.float32(2.0 * reach)
    return core.apart[0] + far * core.flare[0] <= width and core.apart[1] + far * core.flare[1] <= width


@helper
def core_of(rays: Group, go: Way, off: Any) -> Core:
    """`off`: by how much a corner may be off."""
    kx, ky, kz = go.axes
    x, y, z = pick(rays.origin, kx), pick(rays.origin, ky), pick(rays.origin, kz)
    k, mine = rays.k, simd.mask_from_bits(rays.left, z)
    sx, sy = simd.to_f32(go.slopes[0]), simd.to_f32(go.slopes[1])
    mz, hz = _middle(z, mine, k)
    (mx, hx), (my, hy) = _middle(simd.fma(sx, mz - z, x), mine, k), _middle(simd.fma(sy, mz - z, y), mine, k)
    (tx, fx), (ty, fy) = _middle(sx, mine, k), _middle(sy, mine, k)
    return Core(
        go.axes, (mx, my, mz), (tx, ty), (hx + off, hy + off), (fx * _FAR, fy * _FAR), hz + off,
        _least(simd.to_f32(go.slopes[2]), mine, k), off,
    )  # fmt: skip


@helper
def pick(x: Vec, k: int) -> Lane:
    """Component k, the same of all rays."""
    return x[0] if k == 0 else (x[1] if k == 1 else x[2])


@helper
def _middle(x: Lane, mine: Lane, k: int) -> tuple[Any, Any]:
    """The middle of some lanes, of which k is one, and how far they may be from it."""
    x = simd.select(mine, x, simd.lane(x, k))
    low, high = simd.min_of(x), simd.max_of(x)
    return np.float32(0.5) * (low + high), np.float32(0.5) * (high - low)


@helper
def _least(x: Lane, mine: Lane, k: int) -> Any:
    """What is nearest to 0 in some lanes that are all above or all below it."""
    x = simd.select(mine, x, simd.lane(x, k))
    return simd.min_of(x) if simd.lane(x, k) > np.float32(0.0) else simd.max_of(x)
