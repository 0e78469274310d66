"""Reads IES photometric files: the luminous intensity of a luminaire by direction.

Format: ANSI/IES LM-63-2002 (and 1986, 1991, 1995), photometry of type C. Intensities are in candela.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ...lang import text_encoding
from ..ir import F64
from .common import number_text

_COUNTED = 10  # numbers before the ballast factors
MOST_VALUES = 1 << 20


class IesError(Exception):
    """An IES file that cannot be read."""


@dataclass(frozen=True, slots=True, eq=False)
class Photometry:
    """Candela by the angle from the nadir and by the angle around it, in radians, ascending."""

    vertical: F64  # (v,) 0 to π
    horizontal: F64  # (h,) 0 alone, or 0 to 2π
    candela: F64  # (h, v)

    def intensity(self, vertical: F64, horizontal: F64) -> F64:
        """Candela at angles of one shape, linear between the given ones and 0 beyond the vertical ones."""
        v, inside = _place(self.vertical, vertical)
        h, _ = _place(self.horizontal, np.mod(horizontal, 2 * np.pi))
        low, across = np.minimum(v.astype(int), len(self.vertical) - 1), np.minimum(h.astype(int), len(self.horizontal) - 1)
        high, other = np.minimum(low + 1, len(self.vertical) - 1), np.minimum(across + 1, len(self.horizontal) - 1)
        a, b = v - low, h - across
        near = self.candela[across, low] * (1 - a) + self.candela[across, high] * a
        far = self.candela[other, low] * (1 - a) + self.candela[other, high] * a
        return np.where(inside, near * (1 - b) + far * b, 0.0)

    def mean(self) -> float:
        """The mean intensity over the directions of the sphere, or of the hemisphere if the file has one alone.

        OpenUSD's hdEmbree normalizes by this mean.
        """
        edges = np.linspace(0.0, np.pi, 721)
        middle = 0.5 * (edges[1:] + edges[:-1])
        around = (np.arange(72) + 0.5) * (2 * np.pi / 72)
        shares = np.cos(edges[:-1]) - np.cos(edges[1:])
        each = self.intensity(middle[:, None] + 0 * around, around + 0 * middle[:, None]).mean(axis=1)
        full_sphere = np.ptp(self.vertical) > np.pi / 2 + 0.1
        return float((each * shares).sum() / (2.0 if full_sphere else 1.0))


def _place(grid: F64, angles: F64) -> tuple[F64, np.ndarray]:
    """(row of each value among ascending ones, with its fraction; whether it is within them)."""
    rows = np.interp(angles, grid, np.arange(len(grid)))
    return rows, (angles >= grid[0] - 1e-9) & (angles <= grid[-1] + 1e-9)


def read(data: bytes) -> Photometry:
    """The photometry of a file. Raises IesError."""
    text = text_encoding.decode_any(data).replace("\0", "")
    tilt = re.search(r"^[ \t]*TILT[ \t]*=[ \t]*(\S*)", text, re.MULTILINE | re.IGNORECASE)
    if tilt is None:
        raise IesError("an IES file has a line with TILT=")
    try:
        numbers = _numbers(text[tilt.end() :].encode())
    except ValueError:
        raise IesError("after TILT= an IES file has numbers alone") from None
    if tilt.group(1).upper() == "INCLUDE" and len(numbers) > 1:
        numbers = numbers[2 + 2 * int(max(numbers[1], 0)) :]
    if len(numbers) < _COUNTED + 3 or not np.isfinite(numbers).all():
        raise IesError("the numbers of this IES file end early")
    multiplier, verticals, horizontals, kind = numbers[2], int(numbers[3]), int(numbers[4]), int(numbers[5])
    if verticals < 1 or horizontals < 1 or verticals * horizontals > MOST_VALUES:
        raise IesError(f"this IES file promises {verticals} by {horizontals} angles")
    if kind != 1:
        raise IesError("photometry of the types A and B is not drawn: type C is")
    rest = numbers[_COUNTED + 3 :]
    if len(rest) < verticals + horizontals + verticals * horizontals:
        raise IesError("the numbers of this IES file end early")
    vertical, horizontal = np.radians(rest[:verticals]), np.radians(rest[verticals : verticals + horizontals])
    candela = rest[verticals + horizontals :][: verticals * horizontals].reshape(horizontals, verticals)
    if (np.diff(vertical) < 0).any() or (np.diff(horizontal) < 0).any():
        raise IesError("the angles of an IES file ascend")
    candela = np.maximum(candela * multiplier * numbers[_COUNTED] * numbers[_COUNTED + 1], 0.0)
    return Photometry(vertical, *_all_around(horizontal, candela))


def _numbers(text: bytes) -> F64:
    """The numbers of text. Commas separate them (LM-63-2002, 4.2), but for decimal commas that make the promised number of values."""
    decimal = number_text.plain(text)
    if decimal.warning == number_text.DECIMAL:
        try:
            values = np.array(decimal.text.split(), np.float64)
        except ValueError:
            values = np.zeros(0)
        if len(values) > _COUNTED + 3 and len(values) == _COUNTED + 3 + values[3] + values[4] + values[3] * values[4]:
            return values
    return np.array(number_text.plain(text, decimal=False).text.split(), np.float64)


def _all_around(horizontal: F64, candela: F64) -> tuple[F64, F64]:
    """Angles around the nadir from 0 to 2π: a quarter or half that the file gives is mirrored (LM-63-2002, 5.14)."""
    last = horizontal[-1]
    if len(horizontal) == 1 or last <= 0:
        return np.zeros(1), candela[:1]
    if abs(last - np.pi / 2) < 1e-3:
        horizontal = np.concatenate([horizontal, np.pi - horizontal[-2::-1]])
        candela = np.concatenate([candela, candela[-2::-1]])
    if abs(horizontal[-1] - np.pi) < 1e-3 and horizontal[0] < 1e-3:
        horizontal = np.concatenate([horizontal, 2 * np.pi - horizontal[-2::-1]])
        candela = np.concatenate([candela, candela[-2::-1]])
    if abs(horizontal[0] - np.pi / 2) < 1e-3 and abs(horizontal[-1] - 1.5 * np.pi) < 1e-3:
        horizontal = np.concatenate([np.pi - horizontal[::-1], horizontal[1:]])  # mirrored about the plane of 90° and 270°
        horizontal, rows = np.unique(np.mod(horizontal, 2 * np.pi), return_index=True)
        candela = np.concatenate([candela[::-1], candela[1:]])[rows]
    if horizontal[-1] < 2 * np.pi - 1e-3:
        horizontal, candela = np.append(horizontal, 2 * np.pi + horizontal[0]), np.concatenate([candela, candela[:1]])
    return horizontal, candela
