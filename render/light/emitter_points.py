"""Points of emitters by area, and the radiance there of emissive materials with a texture."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..jit.kernel import helper, separate_helper
from ..lanes import ops
from ..surface import interaction
from ..surface.material_inputs import color_of
from ..types import Hit, Lane, Ray, Tables, Vec
from . import form_samples, lights, round_emitters
from .form_samples import DISK, RECTANGLE, SPHERE, TRIANGLE

EMISSION = int(ir.Slot.EMISSION)
GRID = 16  # points along each coordinate for the mean of a texture over an emitter; fewer for many emitters
MOST_POINTS = 1 << 20  # of all emitters


@helper
def surface_point(emitters: Any, e: Lane, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    """(position, normal) of a point of emitter e, by area; of emitters without area as the table has them."""
    kind = emitters.kind[e]
    place = (emitters.place[e, 0], emitters.place[e, 1], emitters.place[e, 2])
    normal = (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2])
    flat, round_ = is_plate(kind), round_emitters.is_round(kind)
    ball = (kind == SPHERE) | round_
    x, y = form_samples.plate_coordinates(kind, u, v)
    side_u = (emitters.side_u[e, 0], emitters.side_u[e, 1], emitters.side_u[e, 2])
    side_v = (emitters.side_v[e, 0], emitters.side_v[e, 1], emitters.side_v[e, 2])
    on_plate = ops.add(place, ops.add(ops.scale(side_u, x), ops.scale(side_v, y)))
    up = 0.0 * u
    outward = lights.cone_direction((up, up, up + 1.0), 2.0 * u, v)
    out = ops.scale(outward, side_u[0])
    if ops.any_lane(round_):
        out = ops.where3(round_, round_emitters.point(emitters, e, u, v), out)
        outward = ops.where3(round_, round_emitters.normal(emitters, e, out), outward)
    return ops.where3(flat, on_plate, ops.where3(ball, ops.add(place, out), place)), ops.where3(ball, outward, normal)


@helper
def is_plate(kind: Lane) -> Lane:
    """Whether an emitter is a rectangle, disk or triangle."""
    return (kind == RECTANGLE) | (kind == DISK) | (kind == TRIANGLE)


@separate_helper
def _evaluate(tables: Tables, emitters: Any, e: Lane, origin: Vec, direction: Vec, distance: Lane) -> Vec:
    """Evaluate the emission of the material of emitter e where a ray meets it."""
    zero = 0.0 * distance
    row = ops.int_like(zero, 0) + e
    instance = ops.maximum(emitters.instance[row], 0)
    primitive = ops.int_like(zero, 0) + emitters.parts[instance] + row - emitters.first[instance]
    side_u = (emitters.side_u[row, 0], emitters.side_u[row, 1], emitters.side_u[row, 2])
    side_v = (emitters.side_v[row, 0], emitters.side_v[row, 1], emitters.side_v[row, 2])
    place = (emitters.place[row, 0], emitters.place[row, 1], emitters.place[row, 2])
    off = ops.sub(ops.along(origin, direction, distance), place)
    uu, uv, vv = ops.dot(side_u, side_u), ops.dot(side_u, side_v), ops.dot(side_v, side_v)
    ou, ov = ops.dot(off, side_u), ops.dot(off, side_v)
    scale = 1.0 / ops.maximum(uu * vv - uv * uv, lights.TINY)
    b, c = (ou * vv - ov * uv) * scale, (ov * uu - ou * uv) * scale  # barycentric coordinates of triangles
    ray = Ray(origin, direction, zero, zero + math.inf, None)
    point = interaction.make_interaction(tables, ray, Hit(distance, instance, primitive, ops.clip(b, 0.0, 1.0), ops.clip(c, 0.0, 1.0)))
    return color_of(tables, point, EMISSION)


@helper
def textured_radiance(radiance: Vec, tables: Tables, emitters: Any, e: Lane, origin: Vec, direction: Vec, distance: Lane) -> Vec:
    """`radiance`, or the radiance of emitters with a texture where a ray from `origin` meets them."""
    textured = ops.bool_like(distance, False) | emitters.textured[e]
    if ops.any_lane(textured):
        radiance = ops.where3(textured, _evaluate(tables, emitters, e, origin, direction, ops.where(textured, distance, 1.0)), radiance)
    return radiance


def mean_radiance(tables: ir.Tables, emitters: Any) -> NDArray[np.float64]:
    """(n, 3) radiance of all emitters; of those with a texture the mean over a grid of points."""
    means, rows = emitters.color.copy(), np.flatnonzero(emitters.textured)
    if not len(rows):
        return means
    grid = max(2, min(GRID, int(math.sqrt(MOST_POINTS / len(rows)))))
    middles = (np.arange(grid) + 0.5) / grid
    for some in np.array_split(rows, -(-len(rows) * grid * grid // (1 << 16))):
        e = np.repeat(some, grid * grid)
        u, v = np.tile(np.repeat(middles, grid), len(some)), np.tile(middles, grid * len(some))
        point, normal = surface_point(emitters, e, u, v)
        radiance = _evaluate(tables, emitters, e, ops.add(point, normal), ops.negate(normal), np.ones(len(e)))
        means[some] = np.stack(radiance, -1).reshape(len(some), -1, 3).mean(axis=1)
    return means
