"""Meshes for the failure cases."""

from __future__ import annotations

import numpy as np


def ball(segments: int) -> tuple[np.ndarray, np.ndarray]:
    """(positions, triangles) of a closed ball of radius 1, with `segments` (even) around and half of them from pole to pole."""
    rings, around = segments // 2, segments
    turn, fall = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(1, rings) * np.pi / rings)
    ring = np.stack([np.sin(fall) * np.cos(turn), np.cos(fall), np.sin(fall) * np.sin(turn)], axis=-1).reshape(-1, 3)
    points = np.concatenate([ring, [[0, 1, 0], [0, -1, 0]]])
    top, bottom = np.full(around, len(ring)), np.full(around, len(ring) + 1)
    here, after = np.arange(around), (np.arange(around) + 1) % around
    faces = [np.stack([after, here, top], 1)]
    for start in range(0, (rings - 2) * around, around):
        a, b = start + here, start + after
        faces += [np.stack([a, b, b + around], 1), np.stack([a, b + around, a + around], 1)]
    last = (rings - 2) * around
    return points, np.concatenate([*faces, np.stack([last + here, last + after, bottom], 1)])
