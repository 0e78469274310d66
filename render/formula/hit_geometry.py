"""Geometry of hits on implicit surfaces: gradient, normal, and the error of the hit point."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..types import Lane, Vec
from . import discontinuities, root_isolation
from .bracketing import ULP
from .evaluate import RayFunction, error_at, gradient_and_value_at
from .tables import DISCONTINUITY, IS_SHEET, LARGEST_COORDINATE

BACK = 2.0**-42  # of the largest coordinate: offset before a root at which a vanishing gradient is evaluated instead
MANIFOLD = 4.0  # bound of the multiplicity of coinciding roots: the point's error is at most this times value / gradient


@helper
def complete_hits(ray: RayFunction, origin: Vec, begin: Lane, root: Lane, inside: Lane, hit: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(distance from the origin, spacing, u, v) of roots `root` from the rays' starts, which lie `begin` from the origins."""
    forms, k, memory, direction = ray.forms, ray.k, ray.memory, ray.direction
    point, distance = ops.along(ray.start, direction, root), begin + root
    far = distance + forms.numbers[k, LARGEST_COORDINATE]
    gradient = gradient_at(ray, root, far, hit)
    off = MANIFOLD * error_at(forms, k, ray.tape, memory, point, direction, hit) + bracket_error(gradient, far)
    if forms.places[k, DISCONTINUITY] != 0:
        surface_function = discontinuities.whole_tape(forms, k, memory, origin, direction, distance)
        face = discontinuities.discontinuity_normal(surface_function, distance, inside, gradient, off, hit)
        distance, gradient, off = face.distance, face.gradient, face.off
    spacing, u, v = normal_and_spacing(forms, k, direction, gradient, inside, off)
    return distance, spacing, u, v


@noinline_helper
def gradient_at(ray, root, far, mask):
    """Gradient at roots of rays; where it vanishes, the gradient just before the root. `far` is the largest coordinate there."""
    _, x, y, z = gradient_and_value_at(ray.forms, ray.k, ray.tape, ray.memory, ops.along(ray.start, ray.direction, root), mask)
    vanishing = mask & ops.not_(x * x + y * y + z * z > 0.0)
    if ops.any_lane(vanishing):
        before = ops.along(ray.start, ray.direction, root - BACK * far)
        _, bx, by, bz = gradient_and_value_at(ray.forms, ray.k, ray.tape, ray.memory, before, vanishing)
        x, y, z = ops.where3(vanishing, (bx, by, bz), (x, y, z))
    return x, y, z


@helper
def bracket_error(gradient: Vec, far: Lane) -> Lane:
    """Bound of the value in the middle of a bracket no longer than root_isolation.FINEST."""
    return 0.5 * root_isolation.FINEST * far * ops.length(gradient)


@helper
def normal_and_spacing(forms: Any, k: int, direction: Vec, gradient: Vec, inside: Lane, off: Lane) -> tuple[Lane, Lane, Lane]:
    """(spacing, u, v) of hits with this gradient, where the value is at most `off` from 0."""
    x, y, z = gradient
    size = ops.sqrt(x * x + y * y + z * z)
    usable = (size > 0.0) & (size < np.inf)
    inverse = 1.0 / ops.where(usable, size, 1.0)
    toward = ops.where(inside, 1.0, -1.0)
    normal = ops.where3(usable, (x * inverse, y * inverse, z * inverse), ops.scale(direction, toward))
    if forms.places[k, IS_SHEET] == 0:  # a ray that enters a solid hits its outside, also where rounding of the gradient says otherwise
        against = toward * ops.dot(normal, direction)
        flipped = ops.sub(normal, ops.scale(direction, 2.0 * ops.dot(normal, direction)))
        normal = ops.where3(against < 0.0, flipped, normal)
    distance = off * inverse
    reach = forms.numbers[k, LARGEST_COORDINATE]
    units = ops.where(usable & (distance < reach), distance / (0.5 * ULP * reach), 0.0)
    u, v = encode_normal(normal)
    return ops.to_int(ops.minimum(units, 1e15)), u, v


@helper
def encode_normal(n: Vec) -> tuple[Lane, Lane]:
    """Encode a unit vector as two numbers by the octahedral map (Cigolle et al. 2014)."""
    inverse = 1.0 / (abs(n[0]) + abs(n[1]) + abs(n[2]))
    u, v = n[0] * inverse, n[1] * inverse
    fold_u, fold_v = (1.0 - abs(v)) * ops.sign_of(u), (1.0 - abs(u)) * ops.sign_of(v)
    return ops.where(n[2] < 0.0, fold_u, u), ops.where(n[2] < 0.0, fold_v, v)
