"""Closed meshes about the y axis for the CSG of meshes: points (n, 3) and triangles (m, 3)."""

from __future__ import annotations

import math

import numpy as np

MOST = 2048  # chords of a circle


def chords(radius: float, tolerance: float) -> int:
    """Chords of a circle, a multiple of 4, that keep the tolerance or are MOST."""
    share = min(tolerance / radius, 1.0) if radius > 0.0 else 1.0
    needed = MOST if share < 1e-9 else math.pi / math.acos(1.0 - share)
    return min(max(24, 4 * math.ceil(needed / 4)), MOST)


def sagitta(radius: float, count: int) -> float:
    """The distance of `count` chords from their circle."""
    return radius * (1.0 - math.cos(math.pi / count))


def arc(radius: float, y: float, count: int) -> np.ndarray:
    """(count + 1, 2) points of half a circle, from its lowest to its highest."""
    cos, sin = _circle(2 * count)
    return np.stack([radius * sin[: count + 1], y - radius * cos[: count + 1]], axis=1)


def _circle(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosines and sines of even steps of a turn, exact at quarters."""
    angle = 2 * math.pi * np.arange(count) / count
    quarter = np.arange(count) * 4 % count == 0
    return (np.where(quarter, np.round(f(angle)), f(angle)) for f in (np.cos, np.sin))  # type: ignore[return-value]


def revolved(profile: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A profile (n, 2) of [radius, y] about y, which begins and ends on the axis."""
    cos, sin = _circle(count)
    rings = profile[1:-1]
    points = np.stack([rings[:, :1] * cos, np.broadcast_to(rings[:, 1:], (len(rings), count)), -rings[:, :1] * sin], axis=2)
    ends = np.array([[0.0, profile[0, 1], 0.0], [0.0, profile[-1, 1], 0.0]])
    k = np.arange(count)
    after = (k + 1) % count
    last = (len(rings) - 1) * count
    south, north = len(rings) * count, len(rings) * count + 1
    fans = [np.stack([np.full(count, south), after, k], axis=1), np.stack([np.full(count, north), last + k, last + after], axis=1)]
    return np.concatenate([points.reshape(-1, 3), ends]), np.concatenate([_between(len(rings), count), *fans])


def ring(profile: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed counter-clockwise profile (n, 2) of [radius, y] about y, which does not meet the axis."""
    cos, sin = _circle(count)
    points = np.stack([profile[:, :1] * cos, np.broadcast_to(profile[:, 1:], (len(profile), count)), -profile[:, :1] * sin], axis=2)
    return points.reshape(-1, 3), _between(len(profile) + 1, count) % (len(profile) * count)


def _between(rings: int, count: int) -> np.ndarray:
    """The triangles between rings of `count` vertices, one after the other."""
    first = np.arange(rings - 1)[:, None] * count
    column = np.arange(count)[None]
    after = (column + 1) % count
    a, b, c, d = (x.ravel() for x in (first + column, first + after, first + count + after, first + count + column))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
