"""A leaf's triangles as one ray passes them in single precision, with all that rounding may do: which of them it may meet, or must."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...types import Lane, Vec
from ..build.wide_bvh import LEAF, WIDTH

OFF = 2.0**-20  # of a mesh's largest coordinate: what float32 does to a corner as a ray sees it
SMALLEST, LARGEST = 1e-12, 1e17  # coordinates within which products of float32 neither vanish nor overflow


class Sieve(NamedTuple):
    """A ray as triangles want it in single precision."""

    x: int  # rows of a leaf
    y: int
    z: int
    way: Lane  # 1 or -1: depths grow along the ray, from where it enters the mesh's box
    origin: Vec  # that place, its last number times `way`
    shear: tuple[Lane, Lane]  # times `way`
    off: Lane  # by how much a corner may be off
    least: Lane  # how far off a product of two may be at least
    along: Any  # how deep it goes for each unit of t
    all: int  # bits of all triangles where single precision has not the range, else 0


@helper
def unsure(off: Any) -> int:
    """Bits of all triangles where single precision has not the range for a mesh."""
    return 0 if off > OFF * np.float32(SMALLEST) and off < OFF * np.float32(LARGEST) else (1 << WIDTH) - 1


class Passed(NamedTuple):
    """A leaf's triangles as a ray passes them, where a sheared corner is off by up to OFF times the mesh's largest coordinate (twelve
    roundings), and a product of two by that times both."""

    inside: Lane  # Woop's test, see `inside`
    error: Lane  # how far off that may be
    low: Lane  # depths that they lie between
    high: Lane
    lead: Lane  # how deep the ray passes their planes, times a factor above 0
    blur: Lane  # how far off that may be


@helper
def passed(leaves: Any, leaf: int, ray: Sieve) -> Passed:
    at = leaf * LEAF
    a, b, c = aside(leaves, at, ray), aside(leaves, at + 3 * WIDTH, ray), aside(leaves, at + 6 * WIDTH, ray)
    u, v, w, error = weights(a, b, c, ray.off, ray.least)
    low, high = least_of(a[2], b[2], c[2]), most_of(a[2], b[2], c[2])
    lead, blur = lead_of(u, v, w, error, simd.fma(w, c[2], simd.fma(v, b[2], u * a[2])), simd.maximum(high, -low), ray.off)
    return Passed(inside(u, v, w), error, low, high, lead, blur)


@helper
def lead_of(u: Lane, v: Lane, w: Lane, error: Lane, depth: Lane, size: Lane, off: Lane) -> tuple[Lane, Lane]:
    """How deep a ray passes a triangle's plane, times its area, and how far off that may be where the ray passes through the triangle.

    `depth` is the sum of the corners' depths, each times its weight, none of which is more than `size` from 0. Weights have one sign then,
    so that `off` of each depth comes to that of their mean, and so does that of where the ray begins, and six roundings of what is at most
    twice the mesh's largest coordinate; `error` of a weight counts with its depth.
    """
    total = u + v + w
    blur = simd.fma(error, simd.fma(size, np.float32(4.0), np.float32(8.0) * off), abs(total) * (np.float32(5.0) * off))
    return simd.select(total < np.float32(0.0), -depth, depth), blur


@helper
def may_meet(seen: Passed, ray: Sieve, limit: Any) -> int:
    """Bits of the triangles that the ray may pass through before `limit`: all that it does, and few others.

    It meets none before it enters the mesh's box; so what it leaves is left out, but for what rounding might do.
    """
    may = (seen.inside >= -seen.error) & (seen.lead >= -seen.blur) & (seen.low - ray.off <= ray.along * limit)
    return simd.bits(may) | ray.all


@helper
def surely_meets(seen: Passed, ray: Sieve, limit: Any) -> int:
    """Bits of those that it is sure to.

    Where it ends is off by 2⁻²⁰ of itself, which is below three times `off` as long as it is near the mesh.
    """
    off = np.float32(4.0) * ray.off
    behind = (seen.lead > seen.blur) | (seen.low > off)
    sure = (seen.inside > seen.error) & behind & (seen.high + off < ray.along * limit)
    return simd.bits(sure) & ~ray.all


@helper
def touched(leaves: Any, leaf: int, ray: Sieve, limit: Any) -> int:
    """Bits of a leaf's triangles that the ray may pass through before `limit`."""
    return may_meet(passed(leaves, leaf, ray), ray, limit)


@helper
def aside(leaves: Any, at: int, ray: Sieve) -> Vec:
    """Corners of a leaf's triangles as the ray passes them, and their depths."""
    z = simd.fma(simd.load(leaves, at + ray.z, WIDTH), ray.way, -ray.origin[2])
    return (
        simd.fma(-ray.shear[0], z, simd.load(leaves, at + ray.x, WIDTH) - ray.origin[0]),
        simd.fma(-ray.shear[1], z, simd.load(leaves, at + ray.y, WIDTH) - ray.origin[1]),
        z,
    )  # fmt: skip


@helper
def least_of(a: Lane, b: Lane, c: Lane) -> Lane:
    return simd.minimum(simd.minimum(a, b), c)


@helper
def most_of(a: Lane, b: Lane, c: Lane) -> Lane:
    return simd.maximum(simd.maximum(a, b), c)


@helper
def inside(u: Lane, v: Lane, w: Lane) -> Lane:
    """The least of three weights of one sign, or by how much, below 0, they fall short of having one."""
    return simd.maximum(least_of(u, v, w), -most_of(u, v, w))


@helper
def cross(p: Vec, q: Vec) -> Lane:
    """p × q across the ray."""
    return simd.fma(p[0], q[1], -(p[1] * q[0]))


@helper
def weights(a: Vec, b: Vec, c: Vec, off: Lane, least: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(weights of the corners of triangles that a ray passes at 0, 0, times the total; how far off each may be).

    Each corner may be off by `off`; `least` is twice its square.
    """
    u, v, w = cross(c, b), cross(a, c), cross(b, a)
    far = (abs(a[0]) + abs(a[1])) + (abs(b[0]) + abs(b[1])) + (abs(c[0]) + abs(c[1]))
    error = simd.fma(far, simd.fma(far, np.float32(2.0**-22), off), least)
    return u, v, w, error
