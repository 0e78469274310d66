"""Media whose density is a formula: delta tracking of free flights, ratio tracking of transmittance, along cells of majorants.

A ray steps through the cells of a grid (Amanatides and Woo 1987). In each, the majorant of the density gives distances to tentative
collisions (Woodcock and others 1965). Throughput picks real or null collisions (Kutz and others 2017, Spectral and decomposition tracking).
Transmittance is a product over collisions (Novák and others 2014, Residual ratio tracking).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..geometry import instance_transform
from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import affine, ops, row_gather
from ..sampling import sobol
from ..texture import procedural
from ..types import Lane, Tables, Vec

FLIGHT = 1 << 26  # first dimension of the random numbers of flights
STEPS = 1 << 12  # dimensions of one flight
SEGMENTS = 1024  # random numbers of the segments of a shadow ray are SEGMENTS depths apart
MOST_SEGMENTS = 128  # segments with random numbers of their own
STRATIFIED = 3  # flights of a path whose first numbers are Sobol points
PHOTON = 2  # kind of the key of flights of photons
FAINT = 0.05  # transmittance below which ratio tracking ends by Russian roulette


class NoFields(NamedTuple):
    """All media have densities in closed form."""


class Fields(NamedTuple):
    """Densities by formulas, by the number of the medium."""

    density: Any  # (n,) int: row of Textures, or -1
    to_local: Any  # (n, 12) rows of the matrix from the world to the frame of the formula
    to_cells: Any  # (n, 12) rows of the matrix from the world to the cells of a grid: 0 … cells
    cells: Any  # (n, 4) int: cells along x, y and z, and the first majorant
    majorants: Any  # (k,) densities
    sizes: Any  # (n, 4) int: voxels along x, y and z, and the first one; 0 of formulas
    to_voxels: Any  # (n, 12) rows of the matrix from the world to voxels, whose centres have integer coordinates
    voxels: Any  # (m,) densities, x fastest
    moving: Any  # (n,) int: row of Transforms of a shape that may move, with which the density moves; -1: it stands still


class Key(NamedTuple):
    """The path of a flight: the key of its random numbers, and the body around it."""

    pixel: Lane
    sample: Lane
    depth: int
    seed: int
    kind: int  # 0: of a path, 1: of a shadow ray, PHOTON
    body: Any = None  # colour, and factor of the radius, where the path entered a body; see bodies.py
    time: Any = None  # Ray.time; None in scenes without motion
    axis: Any = None  # see PathState; None of shadow rays, of photons, and in scenes without thick bodies


class Flight(NamedTuple):
    """A ray through one medium."""

    scattered: Lane  # bool: light scatters before the end of the ray
    t: Lane  # where it scatters, or the end
    factor: Vec  # of the throughput
    emitted: Vec  # radiance that the medium adds, before the throughput


class Walk(NamedTuple):
    """Rays in the coordinates of a grid of majorants."""

    origin: Vec
    direction: Vec
    sides: Vec  # cells along each axis
    first: Lane  # int: first majorant
    begin: Lane  # distances between which a ray is in the grid
    end: Lane


@helper
def numbers(key: Key, step: int) -> tuple[Lane, Lane]:
    """A pair of random numbers of a flight."""
    dimension = ops.int_like(key.pixel, FLIGHT + (2 * key.depth + key.kind) * STEPS + step % STEPS)
    if step == 0 and key.depth < STRATIFIED:
        return sobol.pair(key.pixel, key.sample, dimension, key.seed)
    return sobol.hashed_pair(key.pixel, key.sample, dimension, key.seed)


@helper
def depth_of_segment(depth: int, segment: int) -> int:
    """The depth that gives a segment of a shadow ray its random numbers."""
    return depth + SEGMENTS * (1 + segment % MOST_SEGMENTS)


@helper
def _follow(time: Lane, default: Any, tables: Tables, fields: Any, number: Lane) -> Any:
    """Rays at their time, in the world as it is at the scene's time; their distances stay."""
    origin, direction, near, far = default
    row = ops.int_like(near, 0) + fields.moving[number]
    moves = row >= 0
    if ops.not_(ops.any_lane(moves)):
        return default
    row = ops.where(moves, row, 0)
    back, still = instance_transform.transform_at(tables, row, time).inverse, affine.load12(tables.transforms.matrix, row)
    start = affine.transform_point12(still, affine.transform_point12(back, origin))
    along = affine.transform_vector12(still, affine.transform_vector12(back, direction))
    return ops.where3(moves, start, origin), ops.where3(moves, along, direction), near, far


_in_motion = specialize_if_present(_follow)  # (time, ray, tables, fields, number)


@helper
def enter_grid(fields: Any, number: Lane, ray: Any) -> Walk:
    origin, direction, near, far = ray
    zero = 0.0 * near
    a, b, c, d, e, f, g, h = row_gather.eight_at(fields.to_cells, number, 0)
    i, j, k, m = fields.to_cells[number, 8], fields.to_cells[number, 9], fields.to_cells[number, 10], fields.to_cells[number, 11]
    o = (
        ops.dot((a, b, c), origin) + d, ops.dot((e, f, g), origin) + h, ops.dot((i, j, k), origin) + m,
    )  # fmt: skip
    w = (ops.dot((a, b, c), direction), ops.dot((e, f, g), direction), ops.dot((i, j, k), direction))
    x, y, z = ops.to_float(fields.cells[number, 0]), ops.to_float(fields.cells[number, 1]), ops.to_float(fields.cells[number, 2])
    begin, end = near, far
    for axis in range(3):
        side = x if axis == 0 else y if axis == 1 else z
        turn = ops.where(ops.absolute(w[axis]) > 1e-30, w[axis], 1e-30)
        at_low, at_high = (0.0 - o[axis]) / turn, (side - o[axis]) / turn
        begin, end = ops.maximum(begin, ops.minimum(at_low, at_high)), ops.minimum(end, ops.maximum(at_low, at_high))
    return Walk(o, w, (zero + x, zero + y, zero + z), ops.int_like(zero, 0) + fields.cells[number, 3], begin, end)


@helper
def _axis_cell(origin: Lane, direction: Lane, side: Lane, t: Lane) -> tuple[Lane, Lane]:
    """(cell along one axis, distance at which the ray leaves it)."""
    ahead = direction > 0.0
    place = origin + t * direction
    nudge = 1e-9 * (1.0 + ops.absolute(place))
    cell = ops.clip(ops.floor(place + ops.where(ahead, nudge, -nudge)), 0.0, side - 1.0)
    turn = ops.where(ops.absolute(direction) > 1e-30, direction, 1e-30)
    leaves = (cell + ops.where(ahead, 1.0, 0.0) - origin) / turn
    return cell, ops.where(ops.absolute(direction) > 1e-30, leaves, ops.full_like(leaves, math.inf))


@helper
def cell_at(fields: Any, walk: Walk, t: Lane) -> tuple[Lane, Lane]:
    """(majorant of the cell at a distance, distance at which the ray leaves the cell)."""
    x, out_x = _axis_cell(walk.origin[0], walk.direction[0], walk.sides[0], t)
    y, out_y = _axis_cell(walk.origin[1], walk.direction[1], walk.sides[1], t)
    z, out_z = _axis_cell(walk.origin[2], walk.direction[2], walk.sides[2], t)
    index = ops.to_int((z * walk.sides[1] + y) * walk.sides[0] + x) + walk.first
    index = ops.minimum(ops.maximum(index, 0 * index), 0 * index + (len(fields.majorants) - 1))  # lanes without a ray may hold anything
    leaves = ops.minimum(out_x, ops.minimum(out_y, out_z))
    return fields.majorants[index], ops.maximum(leaves, t + 1e-7 * (1.0 + ops.absolute(t)))


@helper
def transform(matrix: Any, number: Lane, p: Vec) -> Vec:
    a, b, c, d, e, f, g, h = row_gather.eight_at(matrix, number, 0)
    z = matrix[number, 8] * p[0] + matrix[number, 9] * p[1] + matrix[number, 10] * p[2] + matrix[number, 11]
    return ops.dot((a, b, c), p) + d, ops.dot((e, f, g), p) + h, z


@helper
def density_at(tables: Tables, fields: Any, number: Lane, ray: Any, t: Lane) -> Lane:
    """The density at a distance along rays."""
    p = ops.along(ray[0], ray[1], t)
    of_voxels = fields.sizes[number, 0] > 0
    density = 0.0 * t
    if ops.any_lane(ops.not_(of_voxels)):
        local = transform(fields.to_local, number, p)
        row = ops.where(of_voxels, 0, fields.density[number])
        density = ops.where(of_voxels, density, procedural.evaluate(tables, ops.maximum(row, 0), local)[0])
    if ops.any_lane(of_voxels):
        density = ops.where(of_voxels, _interpolate(fields, number, transform(fields.to_voxels, number, p)), density)
    return ops.maximum(density, 0.0)


@helper
def _interpolate(fields: Any, number: Lane, p: Vec) -> Lane:
    """Trilinear interpolation of voxels; beyond the outer ones their density goes on."""
    least = ops.int_like(p[0], 1)  # of lanes in media without voxels, which read the first one
    nx, ny = ops.maximum(fields.sizes[number, 0], least), ops.maximum(fields.sizes[number, 1], least)
    nz = ops.maximum(fields.sizes[number, 2], least)
    first = fields.sizes[number, 3]
    x, y, z = ops.maximum(p[0], 0.0), ops.maximum(p[1], 0.0), ops.maximum(p[2], 0.0)
    x, y, z = ops.minimum(x, ops.to_float(nx) - 1.0), ops.minimum(y, ops.to_float(ny) - 1.0), ops.minimum(z, ops.to_float(nz) - 1.0)
    i, j, k = ops.to_int(x), ops.to_int(y), ops.to_int(z)
    u, v, w = x - ops.to_float(i), y - ops.to_float(j), z - ops.to_float(k)
    right = ops.where(i + 1 < nx, i + 1, i)
    low = 0.0 * x
    for n in range(4):
        row, slab = j, k
        share_y, share_z = 1.0 - v, 1.0 - w
        if n % 2 == 1:
            row, share_y = ops.where(j + 1 < ny, j + 1, j), v
        if n >= 2:
            slab, share_z = ops.where(k + 1 < nz, k + 1, k), w
        base = first + ops.maximum((slab * ny + row) * nx, 0)
        last = 0 * base + (len(fields.voxels) - 1)
        at_near, at_far = ops.maximum(base + i, 0 * base), ops.maximum(base + right, 0 * base)
        near_voxel, far_voxel = fields.voxels[ops.minimum(at_near, last)], fields.voxels[ops.minimum(at_far, last)]
        low = low + share_y * share_z * (near_voxel + (far_voxel - near_voxel) * u)
    return low


@separate_helper
def _fly(fields: Any, default: Any, tables: Tables, table: Any, number: Lane, ray: Any, weight: Vec, key: Key) -> Any:
    inside = fields.density[number] >= 0
    if ops.not_(ops.any_lane(inside)):
        return default
    ray = _in_motion(key.time, ray, tables, fields, number)
    sigma_r, sigma_g, sigma_b, sigma = row_gather.four_at(table.extinction, number)
    back_r, back_g, back_b, _ = row_gather.four_at(table.scattering, number)
    glow_r, glow_g, glow_b, _ = row_gather.four_at(table.emission, number)
    walk = enter_grid(fields, number, ray)
    zero = 0.0 * walk.begin
    factor, emitted = (zero + 1.0, zero + 1.0, zero + 1.0), (zero, zero, zero)
    scattered, t = ops.bool_like(zero, False), walk.begin
    going = inside & (walk.begin < walk.end)
    u, v = numbers(key, 0)
    exponent, step = -ops.log(1.0 - u), 1
    while ops.any_lane(going):
        most, leaves = cell_at(fields, walk, ops.where(going, t, 0.0))
        bound = most * ops.maximum(sigma, 1e-30)
        leaves = ops.minimum(leaves, walk.end)
        depth = bound * (leaves - t)
        collides = going & (exponent < depth)
        exponent = ops.where(going & ops.not_(collides), exponent - depth, exponent)
        t = ops.where(going, ops.where(collides, t + exponent / ops.maximum(bound, 1e-30), leaves), t)
        if ops.any_lane(collides):
            density = density_at(tables, fields, number, ray, ops.where(collides, t, 0.0))
            share = ops.where(collides, density / ops.maximum(bound, 1e-30), 0.0)
            real = (back_r * share, back_g * share, back_b * share)
            null = (
                ops.maximum(1.0 - sigma_r * share, 0.0), ops.maximum(1.0 - sigma_g * share, 0.0), ops.maximum(1.0 - sigma_b * share, 0.0),
            )  # fmt: skip
            emitted = ops.add(emitted, ops.mul(factor, (glow_r * share, glow_g * share, glow_b * share)))
            now = ops.mul(weight, factor)
            hits, passes = ops.dot(now, real), ops.dot(now, null)
            chance = hits / ops.maximum(hits + passes, 1e-30)
            takes = collides & (v < chance)
            factor = ops.where3(takes, ops.scale(ops.mul(factor, real), 1.0 / ops.maximum(chance, 1e-30)), factor)
            passed = ops.scale(ops.mul(factor, null), 1.0 / ops.maximum(1.0 - chance, 1e-30))
            factor = ops.where3(collides & ops.not_(takes), passed, factor)
            scattered = scattered | takes
            going = going & ops.not_(takes)
            u, v = numbers(key, step)
            exponent = ops.where(collides, -ops.log(1.0 - u), exponent)
            step += 1
        going = going & (t < walk.end)
    return Flight(
        (inside & scattered) | (ops.not_(inside) & default.scattered),
        ops.where(inside, ops.where(scattered, t, ray[3]), default.t), ops.where3(inside, factor, default.factor),
        ops.where3(inside, emitted, default.emitted),
    )  # fmt: skip


@separate_helper
def _transmit(fields: Any, default: Vec, tables: Tables, table: Any, number: Lane, ray: Any, key: Key) -> Vec:
    inside = fields.density[number] >= 0
    if ops.not_(ops.any_lane(inside)):
        return default
    ray = _in_motion(key.time, ray, tables, fields, number)
    sigma_r, sigma_g, sigma_b, sigma = row_gather.four_at(table.extinction, number)
    walk = enter_grid(fields, number, ray)
    zero = 0.0 * walk.begin
    factor, t = (zero + 1.0, zero + 1.0, zero + 1.0), walk.begin
    going = inside & (walk.begin < walk.end)
    u, v = numbers(key, 0)
    exponent, step = -ops.log(1.0 - u), 1
    while ops.any_lane(going):
        most, leaves = cell_at(fields, walk, ops.where(going, t, 0.0))
        bound = most * ops.maximum(sigma, 1e-30)
        leaves = ops.minimum(leaves, walk.end)
        depth = bound * (leaves - t)
        collides = going & (exponent < depth)
        exponent = ops.where(going & ops.not_(collides), exponent - depth, exponent)
        t = ops.where(going, ops.where(collides, t + exponent / ops.maximum(bound, 1e-30), leaves), t)
        if ops.any_lane(collides):
            density = density_at(tables, fields, number, ray, ops.where(collides, t, 0.0))
            share = ops.where(collides, density / ops.maximum(bound, 1e-30), 0.0)
            null = (
                ops.maximum(1.0 - sigma_r * share, 0.0), ops.maximum(1.0 - sigma_g * share, 0.0), ops.maximum(1.0 - sigma_b * share, 0.0),
            )  # fmt: skip
            factor = ops.where3(collides, ops.mul(factor, null), factor)
            faint = collides & (ops.largest(factor) < FAINT)
            lives = v * FAINT < ops.largest(factor)
            survivor = ops.scale(factor, FAINT / ops.maximum(ops.largest(factor), 1e-30))
            factor = ops.where3(faint, ops.where3(lives, survivor, (zero, zero, zero)), factor)
            going = going & ops.not_(faint & ops.not_(lives))
            u, v = numbers(key, step)
            exponent = ops.where(collides, -ops.log(1.0 - u), exponent)
            step += 1
        going = going & (t < walk.end)
    return ops.where3(inside, factor, default)


@separate_helper
def march(fields: Any, tables: Tables, number: Lane, ray: Any, rate: Vec, steps: int) -> tuple[Lane, Vec]:
    """(column of a density along a ray, integral of the distance · probability density of the first scattering), by midpoints.

    `rate` is the scattering per metre of density 1 in red, green and blue. Each medium has a density.
    """
    walk = enter_grid(fields, number, ray)
    zero = 0.0 * walk.origin[0]
    length = ops.where(walk.end > walk.begin, walk.end - walk.begin, zero)
    step = length / steps
    start = ops.where(length > 0.0, walk.begin, zero)
    total, first, before = zero, (zero, zero, zero), (zero + 1.0, zero + 1.0, zero + 1.0)
    for k in range(steps):
        t = start + (k + 0.5) * step
        total = total + step * density_at(tables, fields, number, ray, t)
        after = (ops.exp(-ops.minimum(rate[0] * total, 80.0)), ops.exp(-ops.minimum(rate[1] * total, 80.0)),
                 ops.exp(-ops.minimum(rate[2] * total, 80.0)))  # fmt: skip
        first = ops.add(first, ops.scale(ops.sub(before, after), t))
        before = after
    return total, first


@helper
def _at(fields: Any, default: Lane, tables: Tables, number: Lane, place: Vec) -> Lane:
    inside = fields.density[number] >= 0
    if ops.not_(ops.any_lane(inside)):
        return default
    still = 0.0 * place[0]
    ray = (place, (still, still, still), still, still)
    return ops.where(inside, density_at(tables, fields, ops.where(inside, number, 0), ray, still), default)


density_at_place = specialize_if_present(_at)  # (fields, density in closed form, tables, number, place) → density
fly = specialize_if_present(_fly)
"""(fields, flight in closed form, tables, table, number, (origin, direction, near, far), throughput, key) → flight."""
transmit = specialize_if_present(_transmit)
"""(fields, transmittance in closed form, tables, table, number, (origin, direction, near, far), key) → transmittance."""
