"""Simulates the smoke of smoke.scene; make_assets.py writes it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def smoke(size: tuple[int, int, int] = (88, 44, 44), steps: int = 130) -> NDArray[np.uint8]:
    """Densities [z, y, x] of smoke that rises from a small fire: stable fluids (Stam 1999) in a box that repeats, 0 to 255."""
    places = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij")).astype(float)
    waves = np.stack(np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n) for n in size), indexing="ij"))
    square = np.maximum((waves**2).sum(axis=0), 1e-9)
    middle = 0.5 * (np.array(size) - 1)
    flat = np.hypot(places[1] - middle[1], places[2] - middle[2])
    source = np.exp(-((flat / 3.6) ** 2) - ((places[0] - 6) / 3) ** 2)
    speed, density = np.zeros((3, *size)), np.zeros(size)
    for step in range(steps):
        phase = 0.23 * step + np.array([0.0, 1.7])
        speed[0] += 0.16 * density + 0.05 * source
        speed[1] += 0.12 * source * np.sin(phase[0])
        speed[2] += 0.12 * source * np.cos(1.3 * phase[1])
        turns = [np.gradient(each) for each in speed]
        whirl = np.stack([turns[2][1] - turns[1][2], turns[0][2] - turns[2][0], turns[1][0] - turns[0][1]])
        slope = np.stack(np.gradient(np.sqrt((whirl**2).sum(axis=0)))) + 1e-9
        speed += 0.22 * np.cross(slope / np.sqrt((slope**2).sum(axis=0)), whirl, axis=0)  # confinement of vortices
        spectrum = np.fft.fftn(speed, axes=(1, 2, 3))
        spectrum -= waves * (waves * spectrum).sum(axis=0) / square
        speed = np.fft.ifftn(spectrum, axes=(1, 2, 3)).real
        back = places - speed
        density = np.minimum(density + 0.5 * source, 1.6)
        *speed, density = (_interpolated(each, back) for each in (*speed, density))
        speed, density = 0.995 * np.stack(speed), 0.995 * density
    beyond = np.array(size).reshape(3, 1, 1, 1) - 1 - places
    fade = np.clip((np.minimum(places, beyond).min(axis=0) - 0.5) / 3, 0, 1)
    cloud = np.clip(density * fade, 0, 1).transpose(1, 0, 2)  # up is y
    return (255 * cloud + 0.5).astype(np.uint8)


def _interpolated(values: Array, places: Array) -> Array:
    """Values of a box that repeats, between its points."""
    low = np.floor(places).astype(int)
    part, total = places - low, np.zeros_like(values)
    for corner in np.ndindex(2, 2, 2):
        index = [(low[k] + corner[k]) % values.shape[k] for k in range(3)]
        weight = np.prod([part[k] if corner[k] else 1 - part[k] for k in range(3)], axis=0)
        total += weight * values[index[0], index[1], index[2]]
    return total
