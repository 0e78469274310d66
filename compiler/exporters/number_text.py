"""Numbers as text of a file."""

from __future__ import annotations

from typing import Any

import numpy as np


def number(value: float) -> str:
    """A number as text that reads back as the same float32, and nearly the same float64."""
    return f"{float(value) + 0.0:.12g}"  # + 0: −0 becomes 0


def numbers(values: Any, separator: str = ", ") -> str:
    return separator.join(number(v) for v in np.asarray(values, np.float64).ravel())
