"""Memory of a wave of paths, and the inputs of the wavefront path tracer."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..lanes.soa import ROW, compress_store, compress_store3, load3
from ..light import links
from ..simd.registration import overload
from ..types import Lane, Vec
from . import path_reuse
from .state.path_state import FAR

STATE = 11  # rows of a path: origin, direction, weight, density, and its phase, or 1 where it is straight
ASKED = 10  # rows of a shadow ray: origin, direction, distance, light
START, BEND, END, LIGHT, STRAIGHT, BENT, ESTIMATE = 0, 3, 6, 9, 12, 13, 14  # rows of an estimate from photons, and their number


class WaveMemory(NamedTuple):
    """A thread's memory of waves, in rows of ROW numbers; `float` is float32 or float64, and `int` as wide."""

    state: Any  # (2 · STATE · ROW,) float: rays of this depth, and those of the next
    index: Any  # (2 · 3 · ROW,) int: their slot in the wave, pixel (y · width + x) and sample
    hit: Any  # (3 · ROW,) float: t, u, v of their hits
    hit_ids: Any  # (3 · ROW,) int: row of the primitive list or -1, instance or -1, primitive
    shadow: Any  # (ASKED · ROW,) float: shadow rays
    shadow_slot: Any  # (ROW,) int: the slots of their paths
    gathered: Any  # (ESTIMATE · ROW,) float: of an estimate from photons three points, light, share that passes straight and by BEND
    gathered_slot: Any  # (ROW,) int: the slots of their paths
    queue: Any  # (ROW,) int64: rays for the BVH
    light: Any  # (4 · ROW,) float: radiance of each slot, red, green, blue and coverage
    items: Any  # (6 · ROW,) int: x, y, sample, place in the tile, and x, y that number the range of the Sobol sequence, by slot
    near: Any  # (2 · ROW,) float: where camera rays begin, and those that passed invisible boundaries
    leaving: Any  # (2 · ROW,) float: cosines where rays entered a medium, see PathState
    inside: Any  # (2 · ROW,) int: medium stacks of the rays, in scenes with media
    facing: Any  # (2 · 3 · ROW,) float: the normals at the origins of rays, in scenes with many lights
    links: Any  # (2 · ROW,) int: light links of the origins of rays, in scenes with links
    blockers: Any  # (ROW,) int: masks of what blocks shadow rays, in scenes with links
    shadow_inside: Any  # (ROW,) int: medium stacks of shadow rays, in scenes with scattering media
    body: Any  # (2 · 4 · ROW,) float: bodies of the rays, in scenes with bodies of varying colour
    shadow_body: Any  # (4 · ROW,) float: bodies of shadow rays, likewise
    divided: Any  # (2 · ROW,) float: 1 where paths have a wavelength, see PathState
    axis: Any  # (2 · 3 · ROW,) float: see PathState, in scenes with thick bodies
    shared: Any  # path_reuse.Shared or path_reuse.Alone

    @classmethod
    def of(cls, kind: type, reuses: bool = False) -> WaveMemory:
        """Allocate memory for waves of float32 or float64; with `reuses`, also for path reuse."""
        index_type = np.int32 if kind == np.float32 else np.int64

        def row(count: int, what: type) -> NDArray[Any]:
            array = simd.aligned_empty(count * ROW, what)
            array[:] = 0
            return array

        return cls(
            row(2 * STATE, kind), row(2 * 3, index_type), row(3, kind), row(3, index_type), row(ASKED, kind), row(1, index_type),
            row(ESTIMATE, kind), row(1, index_type), row(1, np.int64),
            row(4, kind), row(6, index_type), row(2, kind), row(2, kind), row(2, index_type), row(2 * 3, kind),
            row(2, index_type), row(1, index_type), row(1, index_type), row(2 * 4, kind), row(4, kind), row(2, kind),
            row(2 * 3, kind),
            path_reuse.Shared.of(kind) if reuses else path_reuse.Alone(),
        )  # fmt: skip


class NoBvh(NamedTuple):
    """In place of a BVH, if the primitive list holds the whole scene."""


class WaveScene(NamedTuple):
    """Inputs of the wavefront path tracer."""

    tables: Any  # as narrow as the waves' numbers
    primitives: Any  # primitive_list.PrimitiveList
    light: Any  # path_state.Light
    trees: bool  # whether there is a BVH
    low: Any  # (3,) float64: its bounding box; inf: unbounded
    high: Any


@helper
def _load_medium(outside: Any, default: Any, memory: Any, element: int, depth: int) -> Lane:
    return outside if depth == 0 else simd.load(memory.inside, element)


@helper
def _load_body(start: Any, default: Any, rows: Any, element: int, depth: int) -> Any:
    if depth == 0:
        return start
    return simd.load(rows, element), simd.load(rows, element + ROW), simd.load(rows, element + 2 * ROW), simd.load(rows, element + 3 * ROW)


@helper
def _store_body(body: Any, default: Any, rows: Any, element: int, going: Lane) -> None:
    for k in range(4):
        compress_store(rows, element + k * ROW, body[k], going)


@helper
def _store_optional(value: Lane, default: Any, rows: Any, element: int, going: Lane) -> None:
    compress_store(rows, element, value, going)


@helper
def _store_optional3(value: Vec, default: Any, rows: Any, element: int, going: Lane) -> None:
    compress_store3(rows, element, value, going)


@helper
def _load_leaving(volume: Any, default: Any, memory: Any, element: int, depth: int) -> Lane:
    cosine = simd.load(memory.leaving, element)
    return 0.0 * cosine + FAR if depth == 0 else cosine


@helper
def _load_divided(table: Any, plain: Any, memory: Any, at: int, depth: int) -> Lane:
    divided = simd.load(memory.divided, at)
    return 0.0 * divided if depth == 0 else divided


@helper
def _load_axis(guides: Any, default: Any, memory: Any, element: int, depth: int) -> Vec:
    axis = load3(memory.axis, element, 0, 0)
    zero = 0.0 * axis[0]
    return (zero, zero, zero) if depth == 0 else axis


def load_facing(below: Any, memory: Any, element: int) -> Any:
    raise NotImplementedError


@overload(load_facing)
def _load_facing_in_kernels(below, memory, element):
    """Load the normals at the origins of rays; None in scenes with few lights."""
    if below.layout:
        return lambda below, memory, element: load3(memory.facing, element, 0, 0)
    return lambda below, memory, element: None


@helper
def _load_links(linked: Any, default: Any, memory: Any, element: int, depth: int) -> Lane:
    bits = simd.load(memory.links, element)
    return links.bits_of_eye(linked, None, ops.to_float(bits)) if depth == 0 else bits


@helper
def _load_near(table: Any, default: Any, memory: Any, element: int) -> Lane:
    return simd.load(memory.near, element)


load_near = specialize_if_present(_load_near)
"""(scattering media, plain, memory, at): where rays begin; `plain` in scenes without such media."""
load_leaving = specialize_if_present(_load_leaving)
"""(volume maps, None, memory, at, depth): the cosines at the boundaries where rays entered media; FAR for camera rays."""
load_divided = specialize_if_present(_load_divided)
"""(dispersion.Dispersion, None, memory, at, depth): 1 where paths have a wavelength; None in scenes without dispersion."""
load_axis = specialize_if_present(_load_axis)
"""(guides.Guides, None, memory, at, depth): the outward normals of the last surfaces of paths; 0 of camera rays."""
load_links = specialize_if_present(_load_links)
"""(links, None, memory, at, depth): the light links of the origins of rays; None in scenes without links."""
load_medium = specialize_if_present(_load_medium)
"""(outside, None, memory, at, depth): the medium stacks of rays; `outside` for camera rays, None in scenes without media."""
load_body = specialize_if_present(_load_body)
"""(body of camera rays, None, rows, at, depth): the bodies of rays; None in scenes without bodies of varying colour."""
store_body = specialize_if_present(_store_body)
store_optional = specialize_if_present(_store_optional)
"""(value, None, rows, at, going): store the lanes of a mask from place `at` on; nothing where the scene has no such value."""
store_optional3 = specialize_if_present(_store_optional3)
