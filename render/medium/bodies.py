"""Bodies whose colour varies over their surface: the coefficients of a walk follow from where the path entered, and stay until it leaves.

The inversion is that of materials/subsurface.py. The places of numbers are those of material/medium_stack.py. Scenes whose bodies have one
colour each compile nothing of this.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...materials import subsurface_inversion
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..types import Lane, Vec

Body = tuple[Lane, Lane, Lane, Lane]  # colour, and factor of the radius


class NoBodies(NamedTuple):
    """No body has a colour or a radius that varies."""


class Bodies(NamedTuple):
    """Bodies by the number of their medium."""

    radius: NDArray[np.float64]  # (n, 4) metres in red, green and blue, and 0; 0: the coefficients are those of the medium
    start: NDArray[np.float64]  # (4,) colour and factor of camera rays that begin inside of a body


def none(count: int, general: bool) -> Bodies | NoBodies:
    """The record of a scene without such bodies."""
    return Bodies(np.zeros((count, 4)), np.ones(4)) if general else NoBodies()


@helper
def _coefficients(bodies: Any, default: tuple[Vec, Vec], number: Lane, body: Body) -> tuple[Vec, Vec]:
    red, green, blue, _ = row_gather.four_at(bodies.radius, number)
    varies = red > 0.0
    if ops.not_(ops.any_lane(varies)):
        return default
    r, back_r = subsurface_inversion.channel(body[0], body[3] * red)
    g, back_g = subsurface_inversion.channel(body[1], body[3] * green)
    b, back_b = subsurface_inversion.channel(body[2], body[3] * blue)
    return ops.where3(varies, (r, g, b), default[0]), ops.where3(varies, (back_r, back_g, back_b), default[1])


@helper
def _choose(first: Body, second: Body, takes_first: Lane) -> Body:
    return (
        ops.where(takes_first, first[0], second[0]), ops.where(takes_first, first[1], second[1]),
        ops.where(takes_first, first[2], second[2]),
        ops.where(takes_first, first[3], second[3]),
    )  # fmt: skip


coefficients = specialize_if_present(_coefficients)
"""(bodies, (extinction, scattering) of media, number of the medium, body) → (extinction, scattering) per metre."""
choose = specialize_if_present(_choose)  # (body, other body, mask) → the first where the mask is true
