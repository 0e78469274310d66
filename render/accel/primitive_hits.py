"""Intersection of rays with a list of primitives in kernels: all rays against one primitive after another.

A flat primitive is three affine forms of a world point, (height, a, b). A ray hits the plane where the height is 0, and the primitive where
a and b lie in the unit square (parallelogram), its lower corner (triangle) or the unit disk. That is a third of the work of a test in the
shape's own frame. A box is three forms, each between -1 and 1 inside of it; a intersect_ball is its center and radius.
"""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

EDGE = 1e-6  # extension of a primitive beyond its edges, so that no ray passes between two


@helper
def _height(forms: Any, k: int, origin: Vec, direction: Vec) -> Lane:
    """t at which the height over primitive k is 0."""
    x, y, z = forms[k, 0], forms[k, 1], forms[k, 2]
    above = ops.fma(origin[0], x, ops.fma(origin[1], y, ops.fma(origin[2], z, ops.full_like(origin[2], forms[k, 3]))))
    return -above / ops.fma(direction[0], x, ops.fma(direction[1], y, direction[2] * z))


@helper
def _form(forms: Any, k: int, row: int, point: Vec) -> Lane:
    constant = ops.full_like(point[0], forms[k, row + 3])
    return ops.fma(point[0], forms[k, row], ops.fma(point[1], forms[k, row + 1], ops.fma(point[2], forms[k, row + 2], constant)))


@helper
def intersect_ball(balls: Any, k: int, origin: Vec, direction: Vec) -> tuple[Lane, Lane]:
    """(near, far) t at which rays of unit direction enter and leave ball k; far < near where they miss it.

    The discriminant uses the vector from the center to the nearest point of the ray, which stays precise far away.
    """
    way = (balls[k, 0] - origin[0], balls[k, 1] - origin[1], balls[k, 2] - origin[2])
    middle = ops.dot(way, direction)
    off = ops.sub(way, ops.scale(direction, middle))
    discriminant = balls[k, 3] * balls[k, 3] - ops.dot(off, off)
    half = ops.sqrt(ops.maximum(discriminant, 0.0))
    hit = discriminant > 0.0
    return ops.where(hit, middle - half, 1.0), ops.where(hit, middle + half, -1.0)


@helper
def _intersect_quad(forms: Any, k: int, origin: Vec, direction: Vec, corner: bool) -> tuple[Lane, Lane, Lane, Lane]:
    """(t, a, b, whether it is hit) of a parallelogram or, with `corner`, a triangle."""
    t = _height(forms, k, origin, direction)
    point = ops.along(origin, direction, t)
    a, b = _form(forms, k, 4, point), _form(forms, k, 8, point)
    farthest = a + b if corner else ops.maximum(a, b)
    return t, a, b, (ops.minimum(a, b) >= -EDGE) & (farthest <= 1.0 + EDGE)


@helper
def _intersect_round(forms: Any, k: int, origin: Vec, direction: Vec, unbounded: bool) -> tuple[Lane, Lane]:
    """(t, whether it is hit) of a disk or, with `unbounded`, a plane."""
    t = _height(forms, k, origin, direction)
    if unbounded:
        return t, t == t
    point = ops.along(origin, direction, t)
    a, b = _form(forms, k, 4, point), _form(forms, k, 8, point)
    return t, ops.fma(a, a, b * b) <= 1.0


@helper
def _intersect_box(boxes: Any, k: int, origin: Vec, direction: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """(near t, far t, entry face, exit face) of box k; far < near where rays miss it."""
    x, dx = _form(boxes, k, 0, origin), _slope(boxes, k, 0, direction)
    y, dy = _form(boxes, k, 4, origin), _slope(boxes, k, 4, direction)
    z, dz = _form(boxes, k, 8, origin), _slope(boxes, k, 8, direction)
    ix, iy, iz = ops.inverse(dx), ops.inverse(dy), ops.inverse(dz)
    x0, x1 = (-1.0 - x) * ix, (1.0 - x) * ix
    y0, y1 = (-1.0 - y) * iy, (1.0 - y) * iy
    z0, z1 = (-1.0 - z) * iz, (1.0 - z) * iz
    nx, ny, nz = ops.minimum(x0, x1), ops.minimum(y0, y1), ops.minimum(z0, z1)
    fx, fy, fz = ops.maximum(x0, x1), ops.maximum(y0, y1), ops.maximum(z0, z1)
    near, far = ops.maximum(nx, ops.maximum(ny, nz)), ops.minimum(fx, ops.minimum(fy, fz))
    faces = (ops.where(dx < 0.0, 1, 0), ops.where(dy < 0.0, 3, 2), ops.where(dz < 0.0, 5, 4))
    entry_face = ops.where(near == nx, faces[0], ops.where(near == ny, faces[1], faces[2]))
    exit_face = ops.where(far == fx, 1 - faces[0], ops.where(far == fy, 5 - faces[1], 9 - faces[2]))
    return near, far, entry_face, exit_face


@helper
def _slope(forms: Any, k: int, row: int, direction: Vec) -> Lane:
    return ops.fma(direction[0], forms[k, row], ops.fma(direction[1], forms[k, row + 1], direction[2] * forms[k, row + 2]))


@helper
def closest(pieces: Any, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(t, row of PrimitiveRecords or -1, a, b) of the first hits between t_min and t_max."""
    forms, numbers = pieces.forms, pieces.numbers
    best, nearest_row, a, b = t_max, ops.int_like(t_max, -1), ops.full_like(t_max, 0.0), ops.full_like(t_max, 0.0)
    for k in range(pieces.triangles):
        t, _, _, is_hit = _intersect_quad(forms, k, origin, direction, False)
        is_hit = is_hit & (t > t_min) & (t < best)
        best, nearest_row = ops.where(is_hit, t, best), ops.where(is_hit, numbers[k], nearest_row)
    for k in range(pieces.triangles, pieces.disks):
        t, u, v, is_hit = _intersect_quad(forms, k, origin, direction, True)
        is_hit = is_hit & (t > t_min) & (t < best)
        best, nearest_row = ops.where(is_hit, t, best), ops.where(is_hit, numbers[k], nearest_row)
        a, b = ops.where(is_hit, u, a), ops.where(is_hit, v, b)
    for k in range(pieces.disks, pieces.planes):
        t, is_hit = _intersect_round(forms, k, origin, direction, False)
        is_hit = is_hit & (t > t_min) & (t < best)
        best, nearest_row = ops.where(is_hit, t, best), ops.where(is_hit, numbers[k], nearest_row)
    for k in range(pieces.planes, len(forms)):
        t, is_hit = _intersect_round(forms, k, origin, direction, True)
        is_hit = is_hit & (t > t_min) & (t < best)
        best, nearest_row = ops.where(is_hit, t, best), ops.where(is_hit, numbers[k], nearest_row)
    for k in range(len(pieces.boxes)):
        near, far, entry_face, exit_face = _intersect_box(pieces.boxes, k, origin, direction)
        outside = near > t_min
        t = ops.where(outside, near, far)
        is_hit = (near <= far) & (t > t_min) & (t < best)
        best = ops.where(is_hit, t, best)
        nearest_row = ops.where(is_hit, ops.where(outside, entry_face, exit_face) + numbers[len(forms) + k], nearest_row)
    first = len(forms) + len(pieces.boxes)
    for k in range(len(pieces.balls)):
        near, far = intersect_ball(pieces.balls, k, origin, direction)
        t = ops.where(near > t_min, near, far)
        is_hit = (near <= far) & (t > t_min) & (t < best)
        best, nearest_row = ops.where(is_hit, t, best), ops.where(is_hit, numbers[first + k], nearest_row)
    return best, nearest_row, a, b


@helper
def blocked(pieces: Any, origin: Vec, direction: Vec, t_max: Lane) -> Lane:
    """Whether any primitive is hit between 0 and t_max."""
    forms = pieces.forms
    hit = ops.bool_like(t_max, False)
    for k in range(pieces.triangles):
        t, _, _, is_hit = _intersect_quad(forms, k, origin, direction, False)
        hit = hit | (is_hit & (t > 0.0) & (t < t_max))
    for k in range(pieces.triangles, pieces.disks):
        t, _, _, is_hit = _intersect_quad(forms, k, origin, direction, True)
        hit = hit | (is_hit & (t > 0.0) & (t < t_max))
    for k in range(pieces.disks, pieces.planes):
        t, is_hit = _intersect_round(forms, k, origin, direction, False)
        hit = hit | (is_hit & (t > 0.0) & (t < t_max))
    for k in range(pieces.planes, len(forms)):
        t, is_hit = _intersect_round(forms, k, origin, direction, True)
        hit = hit | (is_hit & (t > 0.0) & (t < t_max))
    for k in range(len(pieces.boxes)):
        near, far, _, _ = _intersect_box(pieces.boxes, k, origin, direction)
        hit = hit | ((near <= far) & (far > 0.0) & (near < t_max) & ((near > 0.0) | (far < t_max)))
    for k in range(len(pieces.balls)):
        near, far = intersect_ball(pieces.balls, k, origin, direction)
        hit = hit | ((near <= far) & (far > 0.0) & (near < t_max) & ((near > 0.0) | (far < t_max)))
    return hit
