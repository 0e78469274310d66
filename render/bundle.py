"""Several rays that go one way through a mesh's tree: boxes and triangles are tested against all of them at once.

Intervals of origins and of inverse directions hold all rays, so that one test says whether any of them may enter a box (Reshetov,
Soupikov & Hurley, "Multi-Level Ray Tracing Algorithm", 2005). Triangles are sieved as the rays' middle sees them, with a rectangle
that holds the others; those that are left are met in double precision by all rays side by side, and are what each would meet by itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from . import across, boxes, lanes, simd, walk
from . import shapes_flat as flat
from .kernels import helper
from .records import Lane, Vec
from .wide import DEPTH, LEAF, NODE, WIDTH, spread32

LANES = across.WIDTH
FEW = 3  # rays from which on it is worth it
WIDE = 0.2  # leaves of the mesh for each of them that they may be apart
WIDE_ANY = 0.1  # the same for any hit, which a ray by itself finds sooner
_FAR, _STEEP = np.float32(walk.FAR), np.float32(walk.STEEP)
_like_rays = getattr(simd, f"f32x{LANES}")  # a number for each ray


class Beam(NamedTuple):
    """Rays as intervals, for a node's boxes: t of a plane from below and from above where it is not behind; see walk.Box for the rows."""

    first: Vec  # least 1 / direction
    first_shift: Vec
    last: Vec
    last_shift: Vec
    near: tuple[int, int, int]


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
def alike(left: int, d: Vec, ray: boxes.BoxRay) -> bool:
    """Whether the rays whose bits are set in `left` are several and go one way."""
    if simd.population(left) < FEW:
        return False
    x, y = _main(d)
    return (_mixed(x, left) | _mixed(y, left) | _mixed(across.bits(ray.x), left) | _mixed(across.bits(ray.y), left)
            | _mixed(across.bits(ray.z), left)) == 0  # fmt: skip


@helper
def _main(d: Vec) -> tuple[int, int]:
    """Bits of the rays whose largest axis is x, and y, as flat.shear chooses it."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    return across.bits((x >= y) & (x >= z)), across.bits(y >= z)


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
def way(left: int, d: Vec, ray: boxes.BoxRay) -> Way:
    k = simd.trailing_zeros(left)
    x, y = _main(d)
    kz = 0 if (x >> k) & 1 else (1 if (y >> k) & 1 else 2)
    kx, ky = (kz + 1) % 3, (kz + 2) % 3
    if not across.lane(pick((ray.x, ray.y, ray.z), kz), k):
        kx, ky = ky, kx
    scale = pick(ray.inverse, kz)
    return Way(k, (kx, ky, kz), (pick(d, kx) * scale, pick(d, ky) * scale, scale))


@helper
def may_be_close(rays: Way, left: int, o: Vec, fine: Any, any_hit: bool) -> bool:
    """Whether the first and the last ray of a mesh, as they pass its middle, may be near enough to each other for all to be `close`."""
    z = pick(o, rays.axes[2])
    last = (LANES - 1) if (left >> (LANES - 1)) & 1 else rays.k
    width = (WIDE_ANY if any_hit else WIDE) * fine * simd.population(left)
    return (_between(pick(o, rays.axes[0]) - rays.slopes[0] * z, rays.k, last) <= width
            and _between(pick(o, rays.axes[1]) - rays.slopes[1] * z, rays.k, last) <= width)  # fmt: skip


@helper
def _between(x: Lane, k: int, last: int) -> Any:
    return abs(simd.lane(x, k) - simd.lane(x, last))


@helper
def group(left: int, k: int, o: Vec, d: Vec, ray: boxes.BoxRay, enters: Lane, until: Lane) -> Group:
    """For rays that are `alike` and enter a mesh's box at `enters`; nothing beyond `until` is asked for."""
    up = (across.bits(ray.x) >> k) & 1 != 0, (across.bits(ray.y) >> k) & 1 != 0, (across.bits(ray.z) >> k) & 1 != 0
    inverse = simd.to_f32(ray.inverse[0]), simd.to_f32(ray.inverse[1]), simd.to_f32(ray.inverse[2])
    most = _STEEP * lanes.smallest((abs(inverse[0]), abs(inverse[1]), abs(inverse[2])))
    return Group(
        left, k, up,
        (_entered(o[0], d[0], enters), _entered(o[1], d[1], enters), _entered(o[2], d[2], enters)),
        (lanes.clip(inverse[0], -most, most), lanes.clip(inverse[1], -most, most), lanes.clip(inverse[2], -most, most)),
        simd.to_f32((until - enters) * walk.FAR),
    )  # fmt: skip


@helper
def _entered(o: Lane, d: Lane, enters: Lane) -> Lane:
    return simd.to_f32(o + enters * d)


@helper
def close(core: Core, left: int, reach: Any, fine: Any, any_hit: bool) -> bool:
    """Whether rays go through much the same leaves of a mesh that single precision has the range for.

    `reach` is the largest of the mesh's coordinates, `fine` how wide its leaves are.
    """
    if walk.unsure(np.float32(0.5) * core.off) != 0:
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


@helper
def _beam(rays: Group) -> Beam:
    ax, bx, cx, dx = _interval(rays, 0)
    ay, by, cy, dy = _interval(rays, 1)
    az, bz, cz, dz = _interval(rays, 2)
    return Beam((ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz), boxes.rows_of(rays.up[0], rays.up[1], rays.up[2]))


@helper
def _interval(rays: Group, axis: int) -> tuple[Lane, Lane, Lane, Lane]:
    """What a beam holds of an axis. t of a plane ahead is least for the ray that begins nearest to it and is the steepest."""
    origin, inverse = rays.origin[axis], rays.inverse[axis]
    mine = simd.mask_from_bits(rays.left, origin)
    origin, inverse = simd.select(mine, origin, simd.lane(origin, rays.k)), simd.select(mine, inverse, simd.lane(inverse, rays.k))
    low, high, least, most = simd.min_of(origin), simd.max_of(origin), simd.min_of(inverse), simd.max_of(inverse)
    if not rays.up[axis]:
        low, high, least, most = high, low, most, least
    return spread32(least), spread32(-high * least), spread32(most), spread32(-low * most)


@helper
def _enter(nodes: Any, node: int, beam: Beam, limit: Any) -> tuple[Lane, int]:
    """Where the first ray may enter a node's boxes, and bits of those that one may enter before `limit`."""
    at = node * NODE
    x, y, z = beam.near
    near = simd.maximum(
        simd.maximum(_plane(nodes, at + x, beam.first, beam.first_shift, 0), _plane(nodes, at + y, beam.first, beam.first_shift, 1)),
        simd.maximum(_plane(nodes, at + z, beam.first, beam.first_shift, 2), spread32(0.0)),
    )
    far = simd.minimum(
        simd.minimum(
            _plane(nodes, at + (x ^ WIDTH), beam.last, beam.last_shift, 0), _plane(nodes, at + (y ^ WIDTH), beam.last, beam.last_shift, 1)
        ),
        _plane(nodes, at + (z ^ WIDTH), beam.last, beam.last_shift, 2),
    )
    return near, simd.bits(near <= simd.minimum(far * _FAR, spread32(limit)))


@helper
def _plane(nodes: Any, at: int, scale: Vec, shift: Vec, axis: int) -> Lane:
    return simd.fma(simd.load(nodes, at, WIDTH), scale[axis], shift[axis])


@helper
def _sieve(core: Core) -> walk.Sieve:
    kx, ky, kz = core.axes
    x, y, z = core.origin
    return walk.Sieve(
        WIDTH * kx, WIDTH * ky, WIDTH * kz, (spread32(x), spread32(y), spread32(z)), (spread32(core.shear[0]), spread32(core.shear[1])),
        spread32(core.off), spread32(np.float32(0.0)), 0,
    )  # fmt: skip


@helper
def _triangles(leaves: Any, leaf: int, core: Core, ray: walk.Sieve, limit: Any) -> int:
    """Bits of a leaf's triangles that one of the rays may meet before `limit`.

    Seen along the middle ray the others pass through a rectangle, as large as it is where the farther end of a triangle lies; a
    triangle is left out where one of the rectangle's axes or one of its own edges parts the two. What the rays go apart along the
    triangle itself counts with rounding, as what may move its corners.
    """
    at, half = leaf * LEAF, np.float32(0.5)
    a, b, c = walk.aside(leaves, at, ray), walk.aside(leaves, at + 3 * WIDTH, ray), walk.aside(leaves, at + 6 * WIDTH, ray)
    low, high = _least_of(a[2], b[2], c[2]), _most_of(a[2], b[2], c[2])
    away, long = half * abs(low + high), half * (high - low)
    wide, tall = simd.fma(away, core.flare[0], spread32(core.apart[0])), simd.fma(away, core.flare[1], spread32(core.apart[1]))
    off = simd.fma(long, max(core.flare[0], core.flare[1]), ray.off)
    hits = simd.bits(_spans(a[0], b[0], c[0], wide + off) & _spans(a[1], b[1], c[1], tall + off) & _parted(a, b, c, wide, tall, off))
    first = low if core.scale > np.float32(0.0) else high
    return hits & simd.bits((first * core.scale - core.early * abs(core.scale)) <= limit * _FAR)


@helper
def _least_of(a: Lane, b: Lane, c: Lane) -> Lane:
    return simd.minimum(simd.minimum(a, b), c)


@helper
def _most_of(a: Lane, b: Lane, c: Lane) -> Lane:
    return simd.maximum(simd.maximum(a, b), c)


@helper
def _spans(a: Lane, b: Lane, c: Lane, half: Lane) -> Lane:
    """Whether what lies around a, b, c meets -half … half."""
    return simd.maximum(_least_of(a, b, c), -_most_of(a, b, c)) <= half


@helper
def _parted(a: Vec, b: Vec, c: Vec, wide: Lane, tall: Lane, off: Lane) -> Lane:
    """Whether no edge has a rectangle around 0, 0 wholly on the other side than the triangle, whose corners may be off by `off`."""
    far = (abs(a[0]) + abs(a[1])) + (abs(b[0]) + abs(b[1])) + (abs(c[0]) + abs(c[1])) + np.float32(4.0) * (wide + tall)
    error = simd.fma(far, simd.fma(far, np.float32(2.0**-21), off), np.float32(2.0) * off * off)
    u, eu = _edge(c, b, wide, tall, error)
    v, ev = _edge(a, c, wide, tall, error)
    w, ew = _edge(b, a, wide, tall, error)
    low, high = _least_of(u + eu, v + ev, w + ew), _most_of(u - eu, v - ev, w - ew)
    return (low >= np.float32(0.0)) | (high <= np.float32(0.0))


@helper
def _edge(p: Vec, q: Vec, wide: Lane, tall: Lane, error: Lane) -> tuple[Lane, Lane]:
    """Twice the area of 0, 0 and an edge, and by how much it may be off for the rectangle's other points."""
    return simd.fma(p[0], q[1], -(p[1] * q[0])), simd.fma(abs(p[1] - q[1]), wide, simd.fma(abs(p[0] - q[0]), tall, error))


@helper
def meet(
    tree: Any, root: int, o: Vec, d: Vec, ray: boxes.BoxRay, enters: Lane, t_min: Lane, t_max: Lane, until: Lane, left: int,
    reach: Any, fine: Any, any_hit: bool,
) -> tuple[Lane, Lane, Lane, Lane, bool]:  # fmt: skip
    """(t, triangle, u, v) that rays which are `alike` meet first, and whether they were asked: not where they are too far apart.

    Those count whose bits are set in `left`, and enter the mesh's box at `enters`. Nothing beyond `until` is asked for; `reach` and
    `fine` as in `close`. With `any_hit`, what each is found to meet first.
    """
    nodes, links, leaves, rows = tree.nodes, tree.links, tree.leaves, tree.rows
    t, triangle = enters * 0.0 + np.inf, lanes.int_like(enters, -1)
    v, w, total = enters * 0.0, enters * 0.0, enters * 0.0 + 1.0
    go = way(left, d, ray)
    if not may_be_close(go, left, o, fine, any_hit):
        return t, triangle, v, w, False
    rays = group(left, go.k, o, d, ray, enters, until)
    limits = simd.select(simd.mask_from_bits(left, rays.limits), rays.limits, np.float32(-np.inf))
    limit = simd.max_of(limits)
    beam = _beam(rays)
    near, hits = _enter(nodes, root, beam, limit)
    if hits == 0:
        return t, triangle, v, w, True
    core = core_of(rays, go, np.float32(2.0 * walk.OFF) * np.float32(reach))
    if not close(core, left, reach, fine, any_hit):
        return t, triangle, v, w, False
    middle = _sieve(core)
    ox, oy, oz = pick(o, go.axes[0]), pick(o, go.axes[1]), pick(o, go.axes[2])
    sx, sy, sz = go.slopes
    kx, ky, kz = middle.x, middle.y, middle.z
    t_max = lanes.where(simd.mask_from_bits(left, enters), t_max, -np.inf)
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    node, top = walk.nearest_first(links, root, near, hits, children, reaches, np.int64(0))
    while True:
        if node >= 0:
            near, hits = _enter(nodes, node, beam, limit)
            node, top = walk.nearest_first(links, node, near, hits, children, reaches, top)
        else:
            leaf, before = ~node, limit
            hits = _triangles(leaves, leaf, core, middle, limit)
            while hits != 0:
                j = simd.trailing_zeros(hits)
                hits &= hits - 1
                a, b, c = leaf * LEAF + j, leaf * LEAF + 3 * WIDTH + j, leaf * LEAF + 6 * WIDTH + j
                met = flat.crossing(
                    (_number(leaves, a + kx) - ox, _number(leaves, a + ky) - oy, _number(leaves, a + kz) - oz),
                    (_number(leaves, b + kx) - ox, _number(leaves, b + ky) - oy, _number(leaves, b + kz) - oz),
                    (_number(leaves, c + kx) - ox, _number(leaves, c + ky) - oy, _number(leaves, c + kz) - oz), sx, sy,
                )  # fmt: skip
                if not any_hit or lanes.any_lane(flat.ahead(met, sz)):
                    at_t, row = flat.reached(met, sz, t_min, t_max), np.int64(simd.read(rows, leaf * WIDTH + j))
                    nearer = (at_t < t) | ((at_t == t) & (at_t < np.inf) & (row < triangle))
                    t, triangle = lanes.where(nearer, at_t, t), lanes.where(nearer, row, triangle)
                    v, w, total = lanes.where(nearer, met.v, v), lanes.where(nearer, met.w, w), lanes.where(nearer, met.total, total)
                    if any_hit:
                        t_max = lanes.where(nearer, -np.inf, t_max)
                        shorter = lanes.where(nearer, -np.inf, enters * 0.0 + np.inf)
                    else:
                        shorter = (t - enters) * walk.FAR
                    limits = simd.minimum(limits, simd.to_f32(shorter))
                    limit = simd.max_of(limits)
            if limit < before:
                top = walk.sifted(children, reaches, 0, top, limit)
            node, top = walk.last_of(children, top)
        if top < 0:
            return t, triangle, v / total, w / total, True


@helper
def _number(leaves: Any, i: int) -> Any:
    return simd.to_f64(_like_rays(simd.read(leaves, i)))
