"""Phase functions of media by their arguments: Henyey and Greenstein's, Draine's, and the blend of both for water droplets."""

from __future__ import annotations

import math
from collections.abc import Sequence

Shape = tuple[float, float, float, float]
NONE: Shape = (0.0, 0.0, 0.0, 0.0)
MICROMETRE = 1e-6
SMALLEST, GREATEST = 5.0, 50.0  # micrometres of the diameter of droplets


def of(phase: float, alpha: float, droplet: float | None) -> tuple[float, Shape]:
    """(mean cosine of the angle of deflection, columns `draine` of ir.Media) by g, α and a diameter of droplets in metres."""
    if droplet is not None:
        shape = droplets(droplet / MICROMETRE)
    elif alpha > 0.0:
        shape = (phase, phase, alpha, 1.0)
    else:
        return phase, NONE
    g, of_draine, alpha, weight = shape
    return (1.0 - weight) * g + weight * mean_cosine(of_draine, alpha), shape


def droplets(diameter: float) -> Shape:
    """The blend for droplets of 5 to 50 µm: equations 4 to 7 of Jendersie and d'Eon 2023."""
    d = diameter
    return (
        math.exp(-0.0990567 / (d - 1.67154)), math.exp(-2.20679 / (d + 3.91029) - 0.428934), math.exp(3.62489 - 8.29288 / (d + 5.52825)),
        math.exp(-0.599085 / (d - 0.641583) - 0.665888),
    )  # fmt: skip


def droplet_of(shape: Sequence[float]) -> float | None:
    """The diameter in metres of the droplets whose blend this is, with few digits; None if it is no blend of droplets."""
    g = shape[0]
    if not 0.0 < g < 1.0:
        return None
    diameter = 1.67154 - 0.0990567 / math.log(g)
    for digits in range(13):
        shorter = round(diameter, digits)
        if SMALLEST <= shorter <= GREATEST and all(math.isclose(a, b, rel_tol=1e-9) for a, b in zip(droplets(shorter), shape, strict=True)):
            return shorter * MICROMETRE
    return None


def mean_cosine(g: float, alpha: float) -> float:
    """That of Draine 2003."""
    return g * (1.0 + alpha * (3.0 + 2.0 * g * g) / 5.0) / (1.0 + alpha * (1.0 + 2.0 * g * g) / 3.0)
