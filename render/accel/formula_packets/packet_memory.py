"""Memory of ray packets: a thread's packet on a surface. Surfaces share it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...formula.interpreter import KNOWN, PARTS
from ...formula.interval_grid import CHOICE
from ...formula.llvm_math import LANES, ROW, SINGLE
from ...formula.packet_state import GROUP, HULLS, OPEN, PARTS_OF_SPAN, QUARTERS, RAYS, SPACED, STRIDE, VECTOR
from ...formula.scene_surfaces import Forms
from ...formula.tables import DISCONTINUITY, FIRST_CONSTANT, IS_SHEET, WHOLE_TAPE
from ...simd.aligned_arrays import CACHE_LINE


class PacketState(NamedTuple):
    """A thread's packet on one surface: the surface's rows of tables.Forms, and memory."""

    programs: NDArray[np.int64]
    constants: NDArray[np.float64]
    constants32: NDArray[np.float32]
    compiled: NDArray[np.int64]
    numbers: NDArray[np.float64]
    places: NDArray[np.int64]
    unproved: NDArray[np.int64]
    whole_tape: NDArray[np.int32]  # its rows, in the form of Forms.names
    names: NDArray[np.int32]
    code: NDArray[np.int32]
    tapes: NDArray[np.int64]
    ends: NDArray[np.int64]
    scratch: NDArray[np.int64]
    state: NDArray[np.int64]
    registers: NDArray[np.float32]
    rays: NDArray[np.float32]  # columns: x y z of the start, x y z of the direction, first and last distance
    exact: NDArray[np.float64]  # the same in float64, and the directions' original length
    hulls: NDArray[np.float32]  # (12, STRIDE) lowest x y z of starts, highest; the same of directions
    alive: NDArray[np.int32]  # bits of each vector's rays without a hit
    carried_at: NDArray[np.float32]  # distance at which each vector's values are known
    carried: NDArray[np.float32]
    list: NDArray[np.int64]  # vectors to intersect
    slopes: NDArray[np.float32]  # (4, …) of these: least slope, most; 1 if they have one sign; error of values
    values: NDArray[np.float32]  # (2, …) values at both ends
    open: NDArray[np.float32]  # (9, …) undecided segments of single rays, as brackets
    open_ray: NDArray[np.int32]
    brackets: NDArray[np.float32]  # (9, …) ends, values there, least slope, side, original ends, error of values
    bracket_ray: NDArray[np.int32]
    packed: NDArray[np.float32]  # (6, …) rays
    slab_state: NDArray[np.int64]  # copy of `state` after bounding the slabs
    bounds: NDArray[np.float32]  # (10, 64) results of `spans32` for groups in quarters, and for vectors in quarters
    results: NDArray[np.float32]  # (2, 16) bounds of the result in slabs
    inputs: NDArray[np.float32]  # copy of registers
    tape_of: NDArray[np.int64]  # groups' tapes in quarters, or −1
    spent: NDArray[np.int64]  # rounds of root_isolation of each ray, plus packet_leaves.COUNTED once it is unproved


def allocate(forms: Forms, k: int) -> PacketState:
    """Allocate the packet state of a thread for surface k."""
    return allocate_shared(forms, [k])[0]


def allocate_shared(forms: Forms, surfaces: Sequence[int]) -> list[PacketState]:
    """Allocate packet states of a thread for surfaces, in the same memory: a packet on one ends before the next begins."""
    shapes = [_shapes(forms, k) for k in surfaces]
    largest = [max((every[part] for every in shapes), key=lambda each: math.prod(each[0])) for part in range(len(shapes[0]))]
    memory = _zeros(largest)
    parts = [[block[: shape[0]] for block, (shape, _) in zip(memory, surface_shapes, strict=True)] for surface_shapes in shapes]
    return [_state(forms, k, part) for k, part in zip(surfaces, parts, strict=True)]


def _state(forms: Forms, k: int, memory: Any) -> PacketState:
    places = forms.places[k]
    first, rows = forms.tapes[places[WHOLE_TAPE], :2].tolist()
    begin = int(places[FIRST_CONSTANT])
    wide = begin // (PARTS * LANES) * PARTS * SINGLE.lanes
    surface_places = np.zeros((1, 6), np.int64)
    columns = [IS_SHEET, DISCONTINUITY]
    surface_places[0, columns] = places[columns]
    return PacketState(
        forms.programs, forms.constants[begin:], forms.constants32[wide:], forms.compiled[k : k + 1], forms.numbers[k : k + 1],
        surface_places, forms.unproved,
        np.ascontiguousarray(forms.names[first : first + rows]), *memory,
    )  # fmt: skip


def _shapes(forms: Forms, k: int) -> Sequence[tuple[tuple[int, ...], Any]]:
    """(shape, type) of the memory for surface k, from `names` on."""
    first, rows = forms.tapes[forms.places[k, WHOLE_TAPE], :2].tolist()
    choices = 1 + 2 * max(int(CHOICE[forms.names[first : first + rows, 0]].sum()), 1)
    many = 24 * rows + 2048
    single, double, half, number = np.float32, np.float64, np.int32, np.int64
    return (
        ((many, 4), half), ((many, ROW), half), ((512, 4), number), ((3,), number), ((3 * rows + 8,), number), ((choices,), number),
        (((KNOWN + 1) * PARTS_OF_SPAN * QUARTERS * VECTOR,), single), ((8 * SPACED,), single), ((9 * SPACED,), double),
        ((12 * STRIDE,), single), ((HULLS,), half), ((HULLS,), single), ((RAYS,), single), ((VECTOR,), number), ((4 * VECTOR,), single),
        ((2 * GROUP,), single), ((9 * OPEN,), single), ((OPEN,), half), ((9 * OPEN,), single), ((OPEN,), half), ((6 * OPEN,), single),
        ((choices,), number), ((2 * PARTS_OF_SPAN, QUARTERS * VECTOR), single), ((2 * VECTOR,), single),
        ((21 * QUARTERS * VECTOR,), single), ((QUARTERS * VECTOR,), number), ((RAYS,), number),
    )  # fmt: skip


def _zeros(parts: Sequence[tuple[tuple[int, ...], Any]]) -> list[NDArray[Any]]:
    """Zeros of these shapes and types in one block; each begins at a cache line, so that no vector lies across two."""
    places, size = [], 0
    for shape, dtype in parts:
        places.append(size)
        size += -(-np.dtype(dtype).itemsize * math.prod(shape) // CACHE_LINE) * CACHE_LINE
    block = simd.aligned_empty(size, np.uint8)
    block[...] = 0
    return [np.ndarray(shape, dtype, block, place) for place, (shape, dtype) in zip(places, parts, strict=True)]
