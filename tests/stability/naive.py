"""The naive method of each failing place, as a first program writes it: small, in numpy, in the number type it is given.

They are what the tables of this folder measure the real code against. Each fails where its docstring says, and nowhere else is
it wrong: away from its place it gives the same as ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Loops = Sequence[Array]

# --- where rays meet shapes ------------------------------------------------------------------------------------------------


def sphere(o: Array, d: Array, radius: float, dtype: Any = np.float32) -> Array:
    """(−b − √(b² − a c)) / a of rays (n, 3) and a sphere about the origin; NaN where it is missed. Cancels for far spheres."""
    o, d, r = np.asarray(o, dtype), np.asarray(d, dtype), dtype(radius)
    a, b, c = (d * d).sum(-1, dtype=dtype), (o * d).sum(-1, dtype=dtype), (o * o).sum(-1, dtype=dtype) - r * r
    with np.errstate(invalid="ignore"):
        return (-b - np.sqrt(b * b - a * c)) / a


def cone(o: Array, d: Array, middle: float, slope: float) -> Array:
    """Both t (n, 2) of the endless cone x² + z² = (middle + slope y)², by the textbook formula from wherever the eye is."""
    w, change = middle + slope * o[:, 1], slope * d[:, 1]
    a = d[:, 0] ** 2 + d[:, 2] ** 2 - change**2
    b = o[:, 0] * d[:, 0] + o[:, 2] * d[:, 2] - change * w
    c = o[:, 0] ** 2 + o[:, 2] ** 2 - w**2
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        return np.stack([(-b - root) / a, (-b + root) / a], axis=1)


def larger_root(a: float, b: float, c: float, dtype: Any = np.float64) -> float:
    """(−b + √(b² − 4ac)) / 2a: for b > 0 two nearly equal numbers are subtracted."""
    a, b, c = dtype(a), dtype(b), dtype(c)
    return float((-b + np.sqrt(b * b - dtype(4) * a * c)) / (dtype(2) * a))


def plane(normal: Array, offset: float, o: Array, d: Array, epsilon: float = 1e-6) -> Array:
    """t of n·p = offset; 'parallel' below a fixed epsilon is taken for a miss (NaN)."""
    slope = d @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(np.abs(slope) < epsilon, np.nan, (offset - o @ normal) / slope)


def torus(ring: float, tube: float, o: Array, d: Array) -> Array:
    """The real roots t > 0 of the torus' quartic in t from the eye, by its companion matrix. Far eyes drown its coefficients."""
    a, b, c = d @ d, o @ d, o @ o
    k = c + ring * ring - tube * tube
    level = [a - d[1] ** 2, b - o[1] * d[1], c - o[1] ** 2]
    quartic = [a * a, 4 * a * b, 2 * a * k + 4 * b * b, 4 * b * k, k * k]
    quartic[2] -= 4 * ring * ring * level[0]
    quartic[3] -= 8 * ring * ring * level[1]
    quartic[4] -= 4 * ring * ring * level[2]
    roots = np.roots(quartic)
    return np.sort(roots.real[(np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real > 0)])


def triangle(a: Array, b: Array, c: Array, o: Array, d: Array, dtype: Any = np.float32, epsilon: float = 0.0) -> Array:
    """Möller–Trumbore for triangles and rays (n, 3): t, inf where missed. Neighbours round their common edge each in its own way."""
    a, b, c, o, d = (np.asarray(x, dtype) for x in (a, b, c, o, d))
    e1, e2 = b - a, c - a
    p = np.cross(d, e2)
    det = (e1 * p).sum(-1)
    with np.errstate(all="ignore"):
        inverse = dtype(1) / det
        s = o - a
        u = (s * p).sum(-1) * inverse
        q = np.cross(s, e1)
        v = (d * q).sum(-1) * inverse
        t = (e2 * q).sum(-1) * inverse
        hit = (np.abs(det) > epsilon) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return np.where(hit, t, np.inf)


def box(o: Array, d: Array, low: Array, high: Array) -> Array:
    """The widely used slab test, numpy's min and max of (bound − o) · (1/d): 0 · ∞ = NaN spreads to the answer, and misses."""
    with np.errstate(all="ignore"):
        inverse = 1.0 / d
        a, b = (low - o) * inverse, (high - o) * inverse
        near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
        return np.where((near <= far) & (far > 0), near, np.inf)


def split(centres: Array, leaf: int, depth: int = 0) -> int:
    """The depth of a tree that halves its box in space until a leaf has few items: it never ends where centres are equal."""
    if len(centres) <= leaf:
        return depth
    low, high = centres.min(0), centres.max(0)
    axis = int(np.argmax(high - low))
    left = centres[:, axis] < 0.5 * (low[axis] + high[axis])
    return max(split(centres[left], leaf, depth + 1), split(centres[~left], leaf, depth + 1))


def leave(point: Array, direction: Array, epsilon: float = 1e-4, dtype: Any = np.float32) -> Array:
    """A shadow ray's origin, a fixed epsilon along its direction: nothing at all where the coordinates' spacing is larger."""
    return np.asarray(point, dtype) + np.asarray(direction, dtype) * dtype(epsilon)


# --- implicit surfaces -----------------------------------------------------------------------------------------------------


def march(f: Callable[[float], float], step: float, limit: float) -> float | None:
    """The first t at which f(t) < 0 on steps of a fixed length: what is thinner than a step, or stands before the first, is missed."""
    t = step
    while t <= limit:
        if f(t) < 0:
            return t
        t += step
    return None


def sphere_trace(f: Callable[[float], float], limit: float) -> float | None:
    """Steps as long as f says, though f is no distance: it jumps over the surface and never comes back."""
    t = 0.0
    for _ in range(200):
        value = f(t)
        if abs(value) < 1e-9:
            return t
        t += value
        if not 0 <= t <= limit:
            return None
    return None


def bisect(f: Callable[[float], float], low: float, high: float) -> float:
    """Where f changes its sign between two places: a pole or a jump is taken for a root."""
    sign = f(low) < 0
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (f(middle) < 0) == sign else (low, middle)
    return 0.5 * (low + high)


def bounds(f: Callable[[Array], Array], low: float, high: float) -> tuple[float, float]:
    """An interval of f from its ends, as for a monotonic function: one end outside of f's domain makes both bounds NaN."""
    with np.errstate(invalid="ignore"):
        values = f(np.array([low, high]))
    return float(values.min()), float(values.max())


def basis(knots: Sequence[float], i: int, degree: int, t: float) -> float:
    """Cox and de Boor's recursion as it is printed: 0/0 at repeated knots is NaN."""
    if degree == 0:
        return float(knots[i] <= t < knots[i + 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        rising = np.float64(t - knots[i]) / (knots[i + degree] - knots[i])
        falling = np.float64(knots[i + degree + 1] - t) / (knots[i + degree + 1] - knots[i + 1])
        return float(rising * basis(knots, i, degree - 1, t) + falling * basis(knots, i + 1, degree - 1, t))


# --- pictures --------------------------------------------------------------------------------------------------------------


def lines(triangle: Array, sample: Array) -> bool | None:
    """The course's a x − y + b > 0 with float slopes, corners and samples (x, y) in pixels; None where an upright edge has no slope."""
    corners = [tuple(float(v) for v in p) for p in triangle]
    px, py = (float(v) for v in sample)
    for k in range(3):
        (x1, y1), (x2, y2), (x3, y3) = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
        if x1 == x2:
            return None
        a = (y2 - y1) / (x2 - x1)
        b = y1 - a * x1
        if (a * px - py + b > 0) != (a * x3 - y3 + b > 0):
            return False
    return True


def equal_areas(triangles: Array, samples: Array) -> Array:
    """S1 + S2 + S3 == S in floating point: triangles (n, 3, 2), samples (n, k, 2) -> (n, k)."""

    def area(a: Array, b: Array, c: Array) -> Array:
        return 0.5 * np.abs((b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0]))

    a, b, c = (triangles[:, None, k] for k in range(3))
    return area(samples, b, c) + area(a, samples, c) + area(a, b, samples) == area(a, b, c)


def even_odd(loops: Loops, sample: Array) -> bool:
    """Even–odd with edges closed at both ends: a corner on the sample's line is counted twice, a level edge not at all."""
    px, py = (float(v) for v in sample)
    passed = 0
    for loop in loops:
        for (x0, y0), (x1, y1) in zip(loop.tolist(), np.roll(loop, -1, axis=0).tolist(), strict=True):
            if y0 != y1 and min(y0, y1) <= py <= max(y0, y1):
                passed += x0 + (py - y0) * (x1 - x0) / (y1 - y0) <= px
    return passed % 2 == 1


def half_planes(triangles: Array, samples: Array, closed: bool, dtype: Any = np.float64) -> Array:
    """(n, k) edge functions ≥ 0 (closed) or > 0: on a common edge two triangles own a sample, or none does."""
    p, s = np.asarray(triangles, dtype), np.asarray(samples, dtype)
    signs = []
    for k in range(3):
        a, b = p[:, None, k], p[:, None, (k + 1) % 3]
        signs.append((b[..., 0] - a[..., 0]) * (s[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (s[..., 0] - a[..., 0]))
    e = np.stack(signs)
    inside = (e >= 0).all(0) | (e <= 0).all(0) if closed else (e > 0).all(0) | (e < 0).all(0)
    return np.asarray(inside)


def projected(corners: Array, scale: float, size: tuple[int, int]) -> Array:
    """(3, 2) pixels of camera-space corners (looking down −z), divided by w before anything is clipped: behind the eye turns round."""
    width, height = size
    w = -corners[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.stack([width / 2 + scale * corners[:, 0] / w, height / 2 - scale * corners[:, 1] / w], axis=1)


def fixed_point(pixels: Array) -> Array:
    """24.8 fixed-point numbers in int32: they wrap round beyond 2²³ pixels."""
    return np.rint(np.asarray(pixels) * 256).astype(np.int64).astype(np.int32).astype(np.float64) / 256


def depth24(z: Array, near: float, far: float) -> Array:
    """What a 24-bit z-buffer holds at distance z, computed in float32 as the hardware pipeline does."""
    z, n, f = np.asarray(z, np.float32), np.float32(near), np.float32(far)
    return np.rint((f / (f - n) * (np.float32(1) - n / z)).astype(np.float64) * (2**24 - 1)).astype(np.int64)


def depth_reversed(z: Array, near: float) -> Array:
    """A reversed float32 z-buffer: near / z."""
    return np.float32(near) / np.asarray(z, np.float32)


def affine(values: Array, weights: Array) -> Array:
    """Attributes by screen-space weights, without dividing by w."""
    return weights @ values


def polygon_area(n: int, radius: float) -> float:
    """Of the regular polygon with n corners on a circle: the outline of a ball of n segments."""
    return 0.5 * n * radius * radius * math.sin(2 * math.pi / n)


# --- textures and materials ------------------------------------------------------------------------------------------------


def texel(u: Array, width: int) -> Array:
    """The column of a repeated picture by the float32 fraction of u: −1e-9 has the fraction 1, and the column `width`."""
    u = np.asarray(u, np.float32)
    return np.floor((u - np.floor(u)) * np.float32(width)).astype(np.int64)


def refraction(angle: Array, eta: Array, dtype: Any = np.float32) -> Array:
    """The refracted cosine √(1 − (η sin θ)²) up to the critical angle asin(1/η), 0 beyond: at it, a root of −1.2e-7 is NaN."""
    angle, eta = np.asarray(angle, dtype), np.asarray(eta, dtype)
    with np.errstate(invalid="ignore"):
        return np.where(angle <= np.arcsin(dtype(1) / eta), np.sqrt(dtype(1) - (eta * np.sin(angle)) ** 2), dtype(0))


def phong(n: Array, light: Array, view: Array, exponent: float) -> Array:
    """N·L + (R·V)ⁿ unclamped: negative behind the light, NaN where a negative number meets a fractional power."""
    cosine = (n * light).sum(-1)
    mirrored = 2 * cosine[..., None] * n - light
    with np.errstate(invalid="ignore"):
        return cosine + (mirrored * view).sum(-1) ** exponent


def cone_height(radius: float, distance: float) -> float:
    """1 − cos of the cone a sphere light fills: NaN for a point inside of it."""
    with np.errstate(invalid="ignore"):
        return float(1 - np.sqrt(1 - (np.float64(radius) / distance) ** 2))


def mirror_room(reflectance: float, depth: int = 0) -> float:
    """Radiance between two mirrors by recursion until it is small enough: without an end for reflectance 1."""
    weight = reflectance**depth
    return weight + mirror_room(reflectance, depth + 1) if weight > 1e-4 else weight


# --- transforms ------------------------------------------------------------------------------------------------------------


def slerp(p: Array, q: Array, t: float, dtype: Any = np.float64) -> Array:
    """sin((1−t)θ)/sin θ with θ = acos(p·q): NaN or 0/0 where rounding takes p·q past 1, or p = ∓q."""
    p, q = np.asarray(p, dtype), np.asarray(q, dtype)
    with np.errstate(all="ignore"):
        angle = np.arccos((p * q).sum())
        return (np.sin((1 - dtype(t)) * angle) * p + np.sin(dtype(t) * angle) * q) / np.sin(angle)


def euler_angles(m: Array) -> tuple[float, float, float]:
    """Angles about fixed x, y, z of a rotation by asin and atan2: with the middle one at 90° both others are read off zeros."""
    return math.atan2(m[2, 1], m[2, 2]), math.asin(-m[2, 0]), math.atan2(m[1, 0], m[0, 0])


def normal(linear: Array, n: Array) -> Array:
    """A normal moved like a vector: square to nothing under an uneven scale."""
    moved = linear @ n
    return moved / np.linalg.norm(moved)


def inverse_normal(linear: Array, n: Array) -> Array:
    """A normal by the transposed inverse, whatever the matrix: LinAlgError where it is flat, inward where it mirrors and normals
    are taken from the winding."""
    moved = np.linalg.inv(linear).T @ n
    return moved / np.linalg.norm(moved)


def composed(step: Array, count: int, dtype: Any = np.float32) -> Array:
    """`count` turns one after the other in one number type."""
    made, turn = np.eye(3, dtype=dtype), np.asarray(step, dtype)
    for _ in range(count):
        made = made @ turn
    return made


def flatten(node: dict[str, Any], matrix: Array) -> list[Array]:
    """The places of a tree of groups by recursion: Python's stack ends before deep trees do."""
    here = matrix @ node["matrix"]
    return [place for child in node["children"] for place in flatten(child, here)] or [here]


# --- sums and numbers ------------------------------------------------------------------------------------------------------


def film_sum(value: float, count: int) -> float:
    """Samples added one by one in float32: from 2²⁴ times a sample on, nothing is added any more."""
    return float(np.add.accumulate(np.full(count, value, np.float32), dtype=np.float32)[-1])


def clamped(samples: Array, limit: float) -> Array:
    """Fireflies cut off: less noise, and less light."""
    return np.minimum(samples, limit)


def pixel_index(x: int, y: int, width: int, channels: int) -> int:
    """Where a pixel's numbers lie, in int32."""
    with np.errstate(over="ignore"):
        return int((np.int32(y) * np.int32(width) + np.int32(x)) * np.int32(channels))
