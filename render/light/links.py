"""Light links: which surfaces a light lights, and which instances cast its shadows.

Both are masks over the bits of Instances.visible: an instance is a member if it has one of the bits. Paths and rays carry the bits of the
surface that they leave, so that lights which they hit count for this surface alone. Scenes without links compile none of this.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.ir import light_links
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Surface, Tables, Unlinked, Vec
from . import light_kinds, lights

ALL = -1  # bits of the eye, which sees all lights
CASTS = int(ir.Visibility.SHADOW)


class Links(NamedTuple):
    """The links of a scene."""

    receivers: NDArray[np.int64]  # (lights,) mask of the surfaces that each light lights
    blockers: NDArray[np.int64]  # (lights,) mask of the instances that cast its shadows
    sets: NDArray[np.int64]  # the different blockers, that of shadow casters first


def of(tables: ir.Tables) -> Links | Unlinked:
    """The links of a scene's lights; Unlinked where every light lights all surfaces and all casters cast its shadows."""
    if not light_links.are_there(tables):
        return Unlinked()
    blockers = tables.lights.blockers.astype(np.int64)
    sets = np.array([CASTS, *sorted(set(blockers.tolist()) - {CASTS})], np.int64)
    return Links(tables.lights.receivers.astype(np.int64), blockers, sets)


@helper
def _bits_of(links: Any, default: Any, tables: Tables, point: Surface) -> Lane:
    return ops.int_like(point.offset, 0) + tables.instances.visible[point.instance]


@helper
def _bits_of_eye(links: Any, default: Any, like: Lane) -> Lane:
    return ops.int_like(like, ALL)


@helper
def _bits_beyond(links: Any, default: Any, tables: Tables, point: Surface, before: Lane, straight: Lane) -> Lane:
    return ops.where(straight, before, _bits_of(links, None, tables, point))


@helper
def _receives(links: Any, active: Lane, light: Lane, bits: Lane) -> Lane:
    return active & ((bits & links.receivers[light]) != 0)


@helper
def _receives_lamp(links: Any, active: Lane, light: Lane, bits: Lane) -> Lane:
    return active & ((light < 0) | ((bits & links.receivers[ops.maximum(light, 0)]) != 0))


@helper
def _background(links: Any, default: Vec, tables: Tables, direction: Vec, which: int, bits: Lane) -> Vec:
    zero = 0.0 * direction[0]
    total = (zero, zero, zero)
    for light in range(len(tables.lights.kind)):
        kind = tables.lights.kind[light]
        if light_kinds.is_sky(kind) and (which == lights.ALL or tables.lights.shadows[light] == (which == lights.SHADOWED)):
            received = _receives(links, ops.bool_like(zero, True), light, bits)
            total = ops.where3(received, ops.add(total, lights.sky_radiance(tables, light, direction)), total)
    return total


@helper
def _ambient(links: Any, default: Vec, tables: Tables, like: Lane, bits: Lane) -> Vec:
    zero = 0.0 * like
    total = (zero, zero, zero)
    for light in range(len(tables.lights.kind)):
        if light_kinds.is_ambient(tables.lights.kind[light]):
            received = _receives(links, ops.bool_like(zero, True), light, bits)
            color = tables.lights.color
            increased = (total[0] + color[light, 0], total[1] + color[light, 1], total[2] + color[light, 2])
            total = ops.where3(received, increased, total)
    return total


bits_of = specialize_if_present(_bits_of)
"""(links, None, tables, point): the bits of surfaces; None in scenes without links."""
bits_of_eye = specialize_if_present(_bits_of_eye)
"""(links, None, like): the bits of the eye, likewise."""
bits_beyond = specialize_if_present(_bits_beyond)
"""(links, None, tables, point, before, straight): the bits of rays that leave surfaces; those that go straight through keep theirs."""
receives = specialize_if_present(_receives)
"""(links, active, light, bits): the lanes of `active` whose surfaces a light lights."""
receives_lamp = specialize_if_present(_receives_lamp)
"""(links, active, light, bits): as `receives`; a light of -1 is an emissive shape, which lights all surfaces."""
background = specialize_if_present(_background)
"""(links, default, tables, direction, which, bits): the radiance of the skies that light surfaces, `default` being that of all skies."""
ambient = specialize_if_present(_ambient)
"""(links, default, tables, like, bits): the ambient light of surfaces, `default` being that of all ambient lights."""
