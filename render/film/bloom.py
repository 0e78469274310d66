"""Bloom: the light that a lens scatters, as a convolution of a picture with a point spread function by angle.

The halo is that of Spencer and others 1995, Physically-Based Glare Effects for Digital Images: 20.91 / (θ + 0.02)³ and 72.37 / (θ + 0.02)²
with weights 0.478 and 0.138, θ in degrees, here normalised over half of all directions.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

from ..image.image import Image

F32 = NDArray[np.float32]
NEAR = 0.02  # degrees
WEIGHTS = ((3, 0.478 / 0.616), (2, 0.138 / 0.616))  # exponent, share of the halo
MOST_PIXELS = 1 << 20  # that are convolved; larger pictures are reduced first
SECONDS = 5e-7  # a pixel, with its reduction


def time_of(pixels: int) -> float:
    """The seconds that `add` takes for a picture, as estimated."""
    return 0.1 + SECONDS * pixels


def add(image: Image, share: float, pixel_angle: float, layers: tuple[str, ...] = ("rgba",)) -> None:
    """Spread a share of the light of these channels (h, w, 3 or more); `pixel_angle` is that of a pixel in the middle, in radians.

    Light that leaves the picture is lost; that from outside of it is unknown, and missing.
    """
    for name in layers:
        rgb = image.channels[name][..., :3]
        rgb += np.float32(share) * _scattered(rgb, pixel_angle)


def _scattered(rgb: F32, pixel_angle: float) -> F32:
    """The halo of a picture (h, w, 3), minus the light that makes it."""
    height, width, _ = rgb.shape
    factor = max(1, math.ceil(math.sqrt(height * width / MOST_PIXELS)))
    light = np.where(np.isfinite(rgb), rgb, np.float32(0.0))
    small = _reduced(light, factor)
    kernel = _kernel(small.shape[0], small.shape[1], pixel_angle * factor)
    rows, columns = (_fast_length(2 * n - 1) for n in small.shape[:2])
    spectrum = np.fft.rfft2(kernel, (rows, columns))
    halo: F32 = np.empty_like(small)
    for c in range(3):
        padded = np.fft.rfft2(small[..., c], (rows, columns))
        spread = np.fft.irfft2(padded * spectrum, (rows, columns))
        first_row, first_column = small.shape[0] - 1, small.shape[1] - 1
        halo[..., c] = spread[first_row : first_row + small.shape[0], first_column : first_column + small.shape[1]]
    inner = np.float32(kernel[small.shape[0] - 1, small.shape[1] - 1])  # stays in its pixel
    if factor == 1:
        return halo - light
    return _enlarged((halo - inner * small).astype(np.float32), factor, height, width) + (inner - np.float32(1.0)) * light


def _reduced(light: F32, factor: int) -> F32:
    """Means of blocks; the last ones count what lies beyond the picture as black."""
    if factor == 1:
        return light
    height, width, _ = light.shape
    padded = np.pad(light, ((0, -height % factor), (0, -width % factor), (0, 0)))
    return padded.reshape(padded.shape[0] // factor, factor, padded.shape[1] // factor, factor, 3).mean(axis=(1, 3), dtype=np.float32)


def _enlarged(small: F32, factor: int, height: int, width: int) -> F32:
    """Bilinear interpolation between the middles of blocks."""
    for axis, size in enumerate((height, width)):
        place = np.clip((np.arange(size) + 0.5) / factor - 0.5, 0.0, small.shape[axis] - 1)
        low = place.astype(int)
        high = np.minimum(low + 1, small.shape[axis] - 1)
        part = (place - low).astype(np.float32).reshape([-1 if k == axis else 1 for k in range(3)])
        small = (np.take(small, low, axis) * (1 - part) + np.take(small, high, axis) * part).astype(np.float32)
    return small


@functools.lru_cache(maxsize=4)
def _kernel(height: int, width: int, pixel_angle: float) -> NDArray[np.float64]:
    """The halo of a pixel (2 height - 1, 2 width - 1), in the middle: shares of its light that the others get, and its own."""
    y, x = np.mgrid[1 - height : height, 1 - width : width]
    kernel = _density(np.hypot(x, y) * pixel_angle) * pixel_angle**2
    near = 4  # pixels around the middle, whose means are computed
    rows, columns = (slice(max(n - 1 - near, 0), n + near) for n in (height, width))
    fine = (np.arange(16) + 0.5) / 16 - 0.5
    part = np.hypot(x[rows, columns, None, None] + fine, y[rows, columns, None, None] + fine[:, None]) * pixel_angle
    kernel[rows, columns] = _density(part).mean(axis=(2, 3)) * pixel_angle**2
    edge = pixel_angle * math.sqrt(1.0 / math.pi)  # of a disk as large as a pixel
    kernel[height - 1, width - 1] = _within(edge)
    return kernel


def _density(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The halo by the angle in radians, per steradian."""
    degrees = np.degrees(np.minimum(angle, 0.5 * np.pi))
    return sum(share / _integral(exponent, 90.0) / (degrees + NEAR) ** exponent for exponent, share in WEIGHTS)  # type: ignore[return-value]


def _within(angle: float) -> float:
    """The share of the halo within an angle in radians."""
    degrees = math.degrees(min(angle, 0.5 * math.pi))
    return sum(share * _integral(exponent, degrees) / _integral(exponent, 90.0) for exponent, share in WEIGHTS)


@functools.cache
def _integral(exponent: int, degrees: float) -> float:
    """The integral of (θ + NEAR)^-exponent over all directions up to an angle."""
    edges = np.concatenate([[0.0], np.geomspace(1e-5 * degrees, degrees, 20_001)])
    middle = 0.5 * (edges[1:] + edges[:-1])
    return float(2 * np.pi * np.sum(np.sin(np.radians(middle)) * np.diff(np.radians(edges)) / (middle + NEAR) ** exponent))


def _fast_length(least: int) -> int:
    """The least length from `least` on whose only factors are 2, 3 and 5."""
    while True:
        cofactor = least
        for factor in (2, 3, 5):
            while cofactor % factor == 0:
                cofactor //= factor
        if cofactor == 1:
            return least
        least += 1
