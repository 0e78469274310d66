"""Conservative single-precision test of one ray against the triangles of a leaf, with bounds on all rounding errors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...types import Lane, Vec
from ..bvh_build.wide_bvh import LEAF, WIDTH

OFF = 2.0**-20  # error of a sheared float32 corner, relative to the mesh's largest coordinate
SMALLEST, LARGEST = 1e-12, 1e17  # coordinates between which float32 products neither underflow nor overflow


class FilterRay(NamedTuple):
    """One ray for the single-precision test. Depth is measured along its main axis, from its entry into the mesh's box."""

    x: int  # rows of a leaf for the shear's axes
    y: int
    z: int
    sign: Lane  # 1 or -1: makes depths grow along the ray
    origin: Vec  # the entry point; its depth times `sign`
    shear: tuple[Lane, Lane]  # times `sign`
    off: Lane  # error of a corner
    least: Lane  # smallest error of a product of two corners
    along: Any  # depth of a unit of t
    all: int  # bits of all triangles where float32 lacks the range, else 0


@helper
def unsure_bits(off: Any) -> int:
    """Bits of all triangles where float32 lacks the range for a mesh, else 0."""
    return 0 if off > OFF * np.float32(SMALLEST) and off < OFF * np.float32(LARGEST) else (1 << WIDTH) - 1


class Evaluation(NamedTuple):
    """The triangles of a leaf as a ray crosses them.

    A sheared corner has an error of up to OFF times the mesh's largest coordinate (twelve roundings), a product of two that times both.
    """

    inside: Lane  # Woop's test, see `inside`
    error: Lane  # of `inside`
    low: Lane  # depths of the triangles
    high: Lane
    depth: Lane  # of the crossing with the triangle's plane, times a positive factor
    blur: Lane  # error of `depth`


@helper
def evaluate(leaves: Any, leaf: int, ray: FilterRay) -> Evaluation:
    """Evaluate the triangles of a leaf against a ray."""
    leaf_start = leaf * LEAF
    a, b, c = (
        shear_corners(leaves, leaf_start, ray),
        shear_corners(leaves, leaf_start + 3 * WIDTH, ray),
        shear_corners(leaves, leaf_start + 6 * WIDTH, ray),
    )
    u, v, w, error = weights(a, b, c, ray.off, ray.least)
    low, high = min_of_three(a[2], b[2], c[2]), max_of_three(a[2], b[2], c[2])
    depth, blur = plane_depth(u, v, w, error, simd.fma(w, c[2], simd.fma(v, b[2], u * a[2])), simd.maximum(high, -low), ray.off)
    return Evaluation(inside(u, v, w), error, low, high, depth, blur)


@helper
def plane_depth(u: Lane, v: Lane, w: Lane, error: Lane, depth: Lane, size: Lane, off: Lane) -> tuple[Lane, Lane]:
    """(depth at which a ray crosses a triangle's plane, times the area; its error where the ray hits the triangle).

    `depth` is the sum of the corners' depths times their weights; no corner's depth exceeds `size`. Inside the triangle all weights have
    one sign, so the errors `off` of the depths average. The ray's start adds another `off`, and six roundings of at most twice the mesh's
    largest coordinate are added. The `error` of a weight counts times its depth.
    """
    total = u + v + w
    blur = simd.fma(error, simd.fma(size, np.float32(4.0), np.float32(8.0) * off), abs(total) * (np.float32(5.0) * off))
    return simd.select(total < np.float32(0.0), -depth, depth), blur


@helper
def may_hit(seen: Evaluation, ray: FilterRay, limit: Any) -> int:
    """Bits of the triangles that the ray may hit before `limit`: all that it hits, and few others.

    The ray hits no triangle before it enters the mesh's box, so triangles behind its start are excluded, up to rounding.
    """
    may = (seen.inside >= -seen.error) & (seen.depth >= -seen.blur) & (seen.low - ray.off <= ray.along * limit)
    return simd.bits(may) | ray.all


@helper
def surely_hits(seen: Evaluation, ray: FilterRay, limit: Any) -> int:
    """Bits of the triangles that the ray certainly hits before `limit`.

    The ray's end has a relative error of 2⁻²⁰, which is below three times `off` near the mesh.
    """
    off = np.float32(4.0) * ray.off
    behind = (seen.depth > seen.blur) | (seen.low > off)
    sure = (seen.inside > seen.error) & behind & (seen.high + off < ray.along * limit)
    return simd.bits(sure) & ~ray.all


@helper
def candidates(leaves: Any, leaf: int, ray: FilterRay, limit: Any) -> int:
    """Bits of the triangles of a leaf that the ray may hit before `limit`."""
    return may_hit(evaluate(leaves, leaf, ray), ray, limit)


@helper
def shear_corners(leaves: Any, corner: int, ray: FilterRay) -> Vec:
    """The first, second or third corners of a leaf's triangles, sheared so that the ray runs along the depth axis."""
    z = simd.fma(simd.load(leaves, corner + ray.z, WIDTH), ray.sign, -ray.origin[2])
    return (
        simd.fma(-ray.shear[0], z, simd.load(leaves, corner + ray.x, WIDTH) - ray.origin[0]),
        simd.fma(-ray.shear[1], z, simd.load(leaves, corner + ray.y, WIDTH) - ray.origin[1]),
        z,
    )  # fmt: skip


@helper
def min_of_three(a: Lane, b: Lane, c: Lane) -> Lane:
    """The minimum of three vectors, lane by lane."""
    return simd.minimum(simd.minimum(a, b), c)


@helper
def max_of_three(a: Lane, b: Lane, c: Lane) -> Lane:
    """The maximum of three vectors, lane by lane."""
    return simd.maximum(simd.maximum(a, b), c)


@helper
def inside(u: Lane, v: Lane, w: Lane) -> Lane:
    """The smallest magnitude of three weights of one sign; negative, by how much they miss having one sign."""
    return simd.maximum(min_of_three(u, v, w), -max_of_three(u, v, w))


@helper
def cross(p: Vec, q: Vec) -> Lane:
    """p × q in the plane across the ray."""
    return simd.fma(p[0], q[1], -(p[1] * q[0]))


@helper
def weights(a: Vec, b: Vec, c: Vec, off: Lane, least: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(weights u, v, w of the corners at 0, 0, times their total; the error of each).

    Each corner has the error `off`; `least` is twice its square.
    """
    u, v, w = cross(c, b), cross(a, c), cross(b, a)
    far = (abs(a[0]) + abs(a[1])) + (abs(b[0]) + abs(b[1])) + (abs(c[0]) + abs(c[1]))
    error = simd.fma(far, simd.fma(far, np.float32(2.0**-22), off), least)
    return u, v, w, error
