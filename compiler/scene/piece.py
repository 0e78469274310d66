"""What shapes of the language are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A geometry in the frame of the element it belongs to. `material` -1: the element's."""

    geometry: int
    matrix: np.ndarray  # (4, 4)
    material: int = -1
    name: str = ""
