"""True answers in rational arithmetic, for what floating point is measured against."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction

DIGITS = 10**50  # of the one square root

Rational = tuple[Fraction, ...]


def rational(v: Iterable[float]) -> Rational:
    """The numbers as they are stored."""
    return tuple(Fraction(float(x)) for x in v)


def dot(a: Sequence[Fraction], b: Sequence[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


def sub(a: Sequence[Fraction], b: Sequence[Fraction]) -> Rational:
    return tuple(x - y for x, y in zip(a, b, strict=True))


def cross(a: Sequence[Fraction], b: Sequence[Fraction]) -> Rational:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def root(x: Fraction) -> Fraction:
    """√x, to 50 digits after the point."""
    return Fraction(math.isqrt(x.numerator * DIGITS * DIGITS // x.denominator), DIGITS)


def sphere(o: Iterable[float], d: Iterable[float], centre: Iterable[float], radius: float) -> Fraction | None:
    """The nearer t of a ray with a sphere, None where it is missed."""
    way, direction = sub(rational(o), rational(centre)), rational(d)
    a, b = dot(direction, direction), dot(way, direction)
    discriminant = b * b - a * (dot(way, way) - Fraction(radius) ** 2)
    return None if discriminant < 0 else (-b - root(discriminant)) / a


def weights(corners: Sequence[Sequence[Fraction]], o: Iterable[float], d: Iterable[float]) -> Rational | None:
    """Barycentric weights of the place where a line meets the plane of a triangle; all are ≥ 0 inside. None where it runs along it."""
    origin, direction = rational(o), rational(d)
    a, b, c = (sub(corner, origin) for corner in corners)
    volumes = (dot(direction, cross(c, b)), dot(direction, cross(a, c)), dot(direction, cross(b, a)))
    total = sum(volumes)
    return None if total == 0 else tuple(v / total for v in volumes)


def inside(polygon: Sequence[Sequence[Fraction]], x: Fraction, y: Fraction) -> tuple[bool, float]:
    """Whether a point lies strictly inside a convex polygon (either way round), and how far it is from the nearest edge's line."""
    signs, distance = set(), math.inf
    for (ax, ay), (bx, by) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
        side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        signs.add((side > 0) - (side < 0))
        length = math.hypot(float(bx - ax), float(by - ay))
        distance = min(distance, abs(float(side)) / length if length else math.inf)
    return len(signs) == 1 and 0 not in signs, distance
