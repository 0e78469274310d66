"""Two-stream equations of a layered medium: the mean radiance of light that scatters more than once between a sky and the ground.

Delta-Eddington approximation: Joseph, Wiscombe and Weinman 1976; Meador and Weaver 1980.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


class Beam(NamedTuple):
    """Light from one direction above."""

    cosine: float  # of the angle from the vertical, above 0
    irradiance: F64  # (3,) of a surface that faces it


def mean_radiance(depths: F64, albedo: F64, g: float, beams: Sequence[Beam], sky: F64, ground: F64) -> F64:
    """The mean radiance over all directions (n, 3) of all light but the beams' own, at optical depths (n, 3) below the sky, from 0 on.

    `albedo` (3,) is that of scattering, `sky` (3,) the irradiance from above, `ground` (3,) the ground's albedo.
    """
    means = [
        _channel(depths[:, k], float(albedo[k]), g, [(b.cosine, float(b.irradiance[k])) for b in beams], float(sky[k]), float(ground[k]))
        for k in range(3)
    ]
    return np.stack(means, axis=1)


def _channel(depth: F64, albedo: float, g: float, beams: Sequence[tuple[float, float]], sky: float, ground: float) -> F64:
    """`mean_radiance` of one colour (n,)."""
    forward = g * g  # the share that counts as not scattered
    depth, g = (1.0 - albedo * forward) * depth, g / (1.0 + abs(g))
    albedo = (1.0 - forward) * albedo / (1.0 - albedo * forward)
    loss, gain = (7.0 - albedo * (4.0 + 3.0 * g)) / 4.0, -(1.0 - albedo * (4.0 - 3.0 * g)) / 4.0
    count = len(depth)
    up, down = np.arange(count), count + np.arange(count)
    matrix, right = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
    step = np.diff(depth)
    for row, (same, other, sign) in enumerate(((up, down, 1.0), (down, up, -1.0))):
        rows = row * count + np.arange(count - 1) + (0 if row == 0 else 1)
        for side in (0, 1):
            matrix[rows, same[side : count - 1 + side]] += (2 * side - 1) - sign * 0.5 * step * loss
            matrix[rows, other[side : count - 1 + side]] += sign * 0.5 * step * gain
    for cosine, irradiance in beams:
        passed = irradiance * np.exp(-depth / cosine)
        between = cosine * -np.diff(passed)  # the integral over a layer
        upward = (2.0 - 3.0 * g * cosine) / 4.0
        right[up[:-1]] -= upward * albedo * between
        right[down[1:]] += (1.0 - upward) * albedo * between
        right[up[-1]] += ground * cosine * passed[-1]
    matrix[up[-1], up[-1]], matrix[up[-1], down[-1]] = 1.0, -ground
    matrix[down[0], down[0]], right[down[0]] = 1.0, sky
    flux = np.linalg.solve(matrix, right)
    return np.maximum(flux[up] + flux[down], 0.0) / (2.0 * np.pi)
