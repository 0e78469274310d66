"""GGX microfacets of two roughnesses, along and across a tangent.

Distribution: Burley 2012. Height-correlated Smith shadowing: Heitz 2014. Visible normals: Dupuy and Benyoub 2023, Sampling Visible GGX
Normals with Spherical Caps. With equal roughnesses they are those of `microfacet`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec

LEAST = 1e-7
SHARP = 1e-3  # least α, as of microfacets that are no perfect mirror


class Facets(NamedTuple):
    """Facets at a point."""

    along: Vec  # unit tangent of the first roughness
    across: Vec
    first: Lane  # α along the tangent
    second: Lane
    alpha: Lane  # α of round facets with the same mean slope


@helper
def facets(along: Vec, across: Vec, turns: Lane, roughness: Lane, anisotropy: Lane) -> Facets:
    """Facets of a roughness and an anisotropy from 0 to 1, as OpenPBR has them; `turns` from the tangent."""
    alpha = roughness * roughness
    narrow = 1.0 - ops.clip(anisotropy, 0.0, 1.0)
    first = alpha * ops.sqrt(2.0 / (1.0 + narrow * narrow))
    first, second = ops.maximum(first, SHARP), ops.maximum(first * narrow, SHARP)
    angle = (2.0 * math.pi) * turns
    c, s = ops.cos(angle), ops.sin(angle)
    unity, two = ops.add(ops.scale(along, c), ops.scale(across, s)), ops.sub(ops.scale(across, c), ops.scale(along, s))
    return Facets(unity, two, first, second, ops.sqrt(0.5 * (first * first + second * second)))


@helper
def to_frame(facets_: Facets, normal: Vec, direction: Vec) -> Vec:
    """A direction in the frame of the facets: along, across, outwards."""
    return ops.dot(direction, facets_.along), ops.dot(direction, facets_.across), ops.dot(direction, normal)


@helper
def distribution(facets_: Facets, half: Vec) -> Lane:
    """The distribution of normals at `half`, in the facets' frame."""
    x, y, z = half[0] / facets_.first, half[1] / facets_.second, half[2]
    size = x * x + y * y + z * z
    return ops.where(z > 0.0, 1.0 / (math.pi * facets_.first * facets_.second * ops.maximum(size * size, 1e-30)), 0.0)


@helper
def reach(facets_: Facets, direction: Vec) -> Lane:
    """cos (1 + 2 Λ) with Smith's Λ, of a direction in the facets' frame."""
    x, y = facets_.first * direction[0], facets_.second * direction[1]
    return ops.sqrt(x * x + y * y + direction[2] * direction[2])


@helper
def visibility(cos_out: Lane, cos_in: Lane, reach_out: Lane, reach_in: Lane) -> Lane:
    """Masking and shadowing over 4 times both cosines."""
    return 0.5 / ops.maximum(cos_out * reach_in + cos_in * reach_out, LEAST * LEAST)


@helper
def sample_visible_normal(facets_: Facets, normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> Vec:
    """A visible normal in the world, by two numbers from 0 to 1."""
    x, y, z = to_frame(facets_, normal, to_viewer)
    x, y, z = ops.normalize((facets_.first * x, facets_.second * y, ops.maximum(z, 0.0)))
    turn = 2.0 * math.pi * v
    height = (1.0 - u) * (1.0 + z) - z
    flat = ops.sqrt(ops.maximum(1.0 - height * height, 0.0))
    x, y = facets_.first * (flat * ops.cos(turn) + x), facets_.second * (flat * ops.sin(turn) + y)
    return ops.normalize(ops.in_basis(facets_.along, facets_.across, normal, x, y, ops.maximum(height + z, LEAST)))


@helper
def _normal_of_coat(coat: Vec, normal: Vec) -> Vec:
    return coat


coat_normal = specialize_if_present(_normal_of_coat)  # the coat's own normal, that of the base: the normal of the coat


@helper
def _normal_of_lanes(coat: Vec, normal: Vec, on_coat: Lane) -> Vec:
    return ops.where3(on_coat, coat, normal)


facets_normal = specialize_if_present(_normal_of_lanes)  # the coat's own normal, that of the base, lanes of the coat
