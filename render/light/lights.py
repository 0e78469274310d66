"""Directions to lights: cones, cosine lobes and balls; fall-off, factors by direction, and the radiance of skies and domes."""

from __future__ import annotations

import math

from ...compiler import ir
from ..jit.kernel import helper
from ..lanes import affine, ops
from ..types import Lane, Tables, Vec
from . import light_kinds

POLYNOMIAL = int(ir.FalloffKind.POLYNOMIAL)
RAMP = int(ir.FalloffKind.RAMP)
FAR = math.inf
ALL, SHADOWED, OPEN = 0, 1, 2  # selects skies: all, with shadows, without shadows
TINY = 1e-30  # lower bound of lengths, angles and weights; a float32 number


@helper
def has_profile(tables: Tables, light: int) -> bool:
    """Whether a light's emission depends on the direction by an image."""
    return tables.lights.image[light] >= 0 and not light_kinds.is_pictured(tables.lights.kind[light])


@helper
def profile(tables: Tables, light: Lane, towards: Vec) -> Vec:
    """Return the factor of a light's emission toward a point from which the light lies in the direction `towards`.

    The light's image is latitude-longitude as that of a dome, with its top toward +y of the light's frame.
    """
    row, matrix = tables.lights.transform[light], tables.transforms.matrix
    x = -ops.dot(towards, ops.normalize(affine.transform_vector(matrix, row, (1.0, 0.0, 0.0))))
    y = -ops.dot(towards, ops.normalize(affine.transform_vector(matrix, row, (0.0, 1.0, 0.0))))
    z = -ops.dot(towards, ops.normalize(affine.transform_vector(matrix, row, (0.0, 0.0, 1.0))))
    from_top = ops.atan2(ops.sqrt(x * x + z * z), y)
    s, t = 0.5 - ops.atan2(x, z) / (2.0 * math.pi), 1.0 - from_top / math.pi
    return _look_up(tables, ops.maximum(tables.lights.image[light], 0), s, t)


@helper
def is_soft(tables: Tables, light: int) -> bool:
    """Whether a light has an extent and needs random numbers."""
    kind = tables.lights.kind[light]
    return light_kinds.is_soft(kind) and (not light_kinds.is_sun(kind) or tables.lights.angle[light] > 0.0)


@helper
def falloff(kind: Lane, a: Lane, b: Lane, c: Lane, distance: Lane) -> Lane:
    """Return the attenuation at a distance in metres: 1/d², the classic polynomial, or a linear ramp."""
    square = 1.0 / ops.maximum(distance * distance, TINY)
    course = 1.0 / ops.maximum(a + distance * (b + c * distance), TINY)
    ramp = ops.clip((b - distance) / ops.maximum(b - a, TINY), 0.0, 1.0)
    return ops.where(kind == POLYNOMIAL, course, ops.where(kind == RAMP, ramp, square))


@helper
def color_of(tables: Tables, light: int, s: Lane) -> Vec:
    color = tables.lights.color
    return (color[light, 0] * s, color[light, 1] * s, color[light, 2] * s)


@helper
def cone_direction(axis: Vec, below: Lane, v: Lane) -> Vec:
    """Return the direction at cosine 1 - below from the axis, and azimuth 2π v."""
    sine = ops.sqrt(ops.maximum(below * (2.0 - below), 0.0))
    a, b = ops.basis(axis)
    turn = 2.0 * math.pi * v
    sideways = ops.add(ops.scale(a, sine * ops.cos(turn)), ops.scale(b, sine * ops.sin(turn)))
    return ops.normalize(ops.add(ops.scale(axis, 1.0 - below), sideways))


@helper
def cosine_sample(normal: Vec, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction, cosine) with density cos/π around the normal (Malley's method)."""
    radius = ops.sqrt(u)
    turn = 2.0 * math.pi * v
    cosine = ops.sqrt(ops.maximum(1.0 - u, 0.0))
    a, b = ops.basis(normal)
    sideways = ops.add(ops.scale(a, radius * ops.cos(turn)), ops.scale(b, radius * ops.sin(turn)))
    return ops.add(ops.scale(normal, cosine), sideways), cosine


@helper
def cosine_sample_above(normal: Vec, horizon: Vec, bounded: Lane, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction, share) with density cos/(π share) around the normal and above the horizon; `share` is that part of all cos/π.

    Projected along the normal, the directions above a plane fill a half disk and a half ellipse, flattened by c = normal · horizon.
    Each chord of the disk is scaled from [-s, s] to [-c s, s]. Lanes that are not `bounded` have no horizon.
    """
    across = ops.sub(horizon, ops.scale(normal, ops.dot(normal, horizon)))
    tilted = bounded & (ops.dot(across, across) > 1e-20)
    other, _ = ops.basis(normal)
    a = ops.normalize(ops.where3(tilted, across, other))
    b = ops.cross(normal, a)
    c = ops.where(bounded, ops.clip(ops.dot(normal, horizon), -1.0, 1.0), 1.0)
    radius, turn = ops.sqrt(u), 2.0 * math.pi * v
    x, y = radius * ops.cos(turn), radius * ops.sin(turn)
    chord = ops.sqrt(ops.maximum(1.0 - y * y, 0.0))
    x = 0.5 * (x * (1.0 + c) + chord * (1.0 - c))
    z = ops.sqrt(ops.maximum(1.0 - x * x - y * y, 0.0))
    return ops.in_basis(a, b, normal, x, y, z), 0.5 * (1.0 + c)


@helper
def ball_height(squared: Lane, radius: Lane) -> Lane:
    """Return 1 - cos of a ball's half angle at a squared distance, without cancellation; 2 (all directions) from inside."""
    inside = squared <= radius * radius
    sine2 = ops.where(inside, 1.0, radius * radius / ops.maximum(squared, TINY))
    height = sine2 / (1.0 + ops.sqrt(ops.maximum(1.0 - sine2, 0.0)))
    return ops.where(inside, 2.0, height)


@helper
def sample_ball(way: Vec, radius: Lane, u: Lane, v: Lane) -> tuple[Vec, Lane, Lane]:
    """(direction, distance, solid angle) of a ball at `way`, sampled uniformly by solid angle."""
    squared = ops.dot(way, way)
    inside = squared <= radius * radius
    height = ball_height(squared, radius)
    axis = ops.where3(squared > 0.0, ops.normalize(way), (0.0 * u, 0.0 * u + 1.0, 0.0 * u))
    direction = cone_direction(axis, u * height, v)
    middle = ops.dot(way, direction)
    off = ops.sub(way, ops.scale(direction, middle))
    reach = ops.sqrt(ops.maximum(radius * radius - ops.dot(off, off), 0.0))
    distance = ops.where(inside, middle + reach, middle - reach)
    return direction, ops.maximum(distance, 0.0), 2.0 * math.pi * height


@helper
def sky_radiance(tables: Tables, light: int, direction: Vec) -> Vec:
    """Return the radiance of a sky or dome in a direction.

    A dome's image is latitude-longitude as in OpenEXR and UsdLux. Its center lies toward +z of the dome's frame, and its top toward +y.
    Seen from inside, +x is left of the center.
    """
    lights = tables.lights
    if not light_kinds.is_pictured(lights.kind[light]):
        return color_of(tables, light, 0.0 * direction[0] + 1.0)
    x, y, z = ops.normalize(affine.transform_vector(tables.transforms.inverse, lights.transform[light], direction))
    if lights.image[light] < 0:
        return color_of(tables, light, 0.0 * x + 1.0)
    s, t = 0.5 - ops.atan2(x, z) / (2.0 * math.pi), 0.5 + ops.asin(y) / math.pi
    return ops.mul(color_of(tables, light, 1.0), _look_up(tables, lights.image[light], s, t))


@helper
def _look_up(tables: Tables, image: int, s: Lane, t: Lane) -> Vec:
    """Look up a latitude-longitude image bilinearly at s, t from 0 to 1, without integer divisions."""
    width, height, first = tables.images.width[image], tables.images.height[image], tables.images.first[image]
    x, y = s * width - 0.5, (1.0 - t) * height - 0.5
    a, c = ops.floor_int(x), ops.floor_int(y)
    fx, fy = x - ops.to_float(a), y - ops.to_float(c)
    a = ops.maximum(ops.minimum(ops.where(a < 0, a + width, a), width - 1), 0)
    b = ops.where(a + 1 < width, a + 1, 0)
    d = ops.maximum(ops.minimum(c + 1, height - 1), 0)
    c = ops.maximum(ops.minimum(c, height - 1), 0)
    above, below = first + c * width, first + d * width
    return ops.lerp3(
        ops.lerp3(_texel(tables, above + a), _texel(tables, above + b), fx),
        ops.lerp3(_texel(tables, below + a), _texel(tables, below + b), fx), fy,
    )  # fmt: skip


@helper
def _texel(tables: Tables, row: Lane) -> Vec:
    texels = tables.images.texels
    return texels[row, 0], texels[row, 1], texels[row, 2]


@helper
def background(tables: Tables, direction: Vec, which: int = ALL) -> tuple[Vec, bool]:
    """(radiance, whether any exist) of the skies and domes selected by `which` in a direction."""
    zero = 0.0 * direction[0]
    total = (zero, zero, zero)
    exists = False
    for light in range(len(tables.lights.kind)):
        kind = tables.lights.kind[light]
        if light_kinds.is_sky(kind) and (which == ALL or tables.lights.shadows[light] == (which == SHADOWED)):
            total = ops.add(total, sky_radiance(tables, light, direction))
            exists = True
    return total, exists


@helper
def has_ambient(tables: Tables) -> bool:
    """Whether any light is ambient."""
    any_ambient = False
    for light in range(len(tables.lights.kind)):
        any_ambient = any_ambient or light_kinds.is_ambient(tables.lights.kind[light])
    return any_ambient


@helper
def ambient(tables: Tables) -> tuple[float, float, float]:
    """Return L_a: the sum of all ambient lights."""
    total = (0.0, 0.0, 0.0)
    for light in range(len(tables.lights.kind)):
        if light_kinds.is_ambient(tables.lights.kind[light]):
            total = ops.add(total, color_of(tables, light, 1.0))
    return total
