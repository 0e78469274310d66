"""Transforms of instances: translate, rotate and scale where they give the matrix to single precision, else the matrix."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ....lang.elements import Euler
from ...scene import transforms
from ..placement import F64
from . import words

CLOSE = 6e-8  # of the largest scale: half a unit in the last place of single precision
_ROUNDED = (0, 1, 2, 3, 4, 6, 8, 10, 13)  # decimals of angles in degrees


class Place(NamedTuple):
    """A transform: the arguments of a shape or group, or the text of a matrix."""

    arguments: dict[str, str]
    matrix: str = ""


def place(matrix: F64) -> Place:
    """A (3, 4) or (4, 4) transform."""
    linear, move = matrix[:3, :3], matrix[:3, 3]
    reach = max(float(np.abs(move).max()), float(np.abs(linear).max()))
    move = np.where(np.abs(move) < 1e-15 * reach, 0.0, move)  # rounding of the transforms that it is a product of
    turned = decomposed(linear)
    if turned is None:
        return Place({}, f"[{', '.join(words.numbers(row) for row in matrix[:3])}]")
    arguments = {}
    if move.any():
        arguments["translate"] = words.numbers(move)
    rotation, scale = turned
    if rotation:
        arguments["rotate"] = rotation
    if scale:
        arguments["scale"] = scale
    return Place(arguments)


def decomposed(linear: F64) -> tuple[str, str] | None:
    """The texts of a rotation and of factors, "" for none; None for a matrix that is sheared."""
    if np.array_equal(linear, np.eye(3)):
        return "", ""
    diagonal = np.diag(linear)
    if np.array_equal(linear, np.diag(diagonal)):
        return "", words.one_or_all(diagonal)
    lengths = np.linalg.norm(linear, axis=0)
    turn = linear / lengths
    if not np.abs(turn.T @ turn - np.eye(3)).max() < 1e-6:
        return None
    if np.linalg.det(turn) < 0:
        turn[:, 0], lengths[0] = -turn[:, 0], -lengths[0]
    scale = _rounded_scale(lengths)
    for decimals in _ROUNDED:
        angles = [round(math.degrees(angle), decimals) + 0.0 for angle in _euler(turn)]
        again = transforms.rotation(Euler(tuple(map(math.radians, angles))))[:3, :3] @ np.diag(scale)  # type: ignore[arg-type]
        if np.abs(again - linear).max() <= CLOSE * np.abs(lengths).max():
            turns = [f"{words.number(angle)}deg" if angle else "0deg" for angle in angles]
            return (f"[{', '.join(turns)}]" if any(angles) else ""), "" if (scale == 1.0).all() else words.one_or_all(scale)
    return None


def _rounded_scale(lengths: F64) -> F64:
    """Factors with few digits, as far as single precision tells them from the exact ones."""
    for digits in range(1, 12):
        short = np.array([float(f"{v:.{digits}g}") for v in lengths])
        if (np.abs(short - lengths) <= 0.5 * CLOSE * np.abs(lengths)).all():
            return short
    return lengths


def _euler(turn: F64) -> tuple[float, float, float]:
    """The angles about the fixed x, then y, then z axis of a rotation."""
    sine = float(np.clip(-turn[2, 0], -1.0, 1.0))
    if abs(sine) > 1.0 - 1e-9:
        return math.atan2(-turn[1, 2], turn[1, 1]), math.copysign(math.pi / 2, sine), 0.0
    return math.atan2(turn[2, 1], turn[2, 2]), math.asin(sine), math.atan2(turn[1, 0], turn[0, 0])
