"""A tape's values in kernels: by its own code where that is ready, else by an interpreter; the same bit for bit."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import crosslane, ops
from ..types import Lane, Vec
from .evaluator_calls import compiled, interpret
from .interval_grid import MOST_REGISTERS
from .llvm_math import LANES, WAYS

QUICKER = 6  # a tape's own code takes as long as an interpreter for this share of its rows
_ROOM = MOST_REGISTERS * 4 * LANES
_POINTS, _TURNS, _RAYS = 0, 1, 3  # places in fields.PROGRAMS
_OUT, _STATE = 4 * LANES, WAYS + LANES


class Room(NamedTuple):
    """What evaluation writes to."""

    registers: Any
    out: Any
    state: Any


@helper
def room() -> Room:
    return Room(simd.stack_array(np.float64, _ROOM), simd.stack_array(np.float64, _OUT), simd.stack_array(np.int64, _STATE))


@noinline_helper
def value_at(forms, k, tape, memory, p, mask):
    """The values of surface k at points, by each lane's own tape."""
    registers = memory.registers
    crosslane.store(registers, 0, p[0])
    crosslane.store(registers, 1, p[1])
    crosslane.store(registers, 2, p[2])
    code = forms.compiled[k, 0]
    found = 0.0 * p[0]
    rest = mask
    while ops.any_lane(rest):
        one, here = crosslane.uniform_group(tape, rest)
        begin = forms.places[k, 3]
        if code != 0 and forms.tapes[forms.places[k, 4], 1] <= QUICKER * forms.tapes[one, 1]:
            compiled(code, registers, forms.constants, begin, memory.out)
            return crosslane.load(memory.out, 0)
        first, rows = forms.tapes[one, 0], forms.tapes[one, 1]
        interpret(forms.programs[_POINTS], forms.code, first, rows, registers, forms.constants, begin, memory.state, 1)
        found = ops.where(here, crosslane.load(registers, forms.tapes[one, 2]), found)
        rest = rest & ops.not_(here)
    return found


@noinline_helper
def turns_at(forms, k, tape, memory, p, mask):
    """(value, derivatives by x, y, z) at points."""
    registers = memory.registers
    zero = 0.0 * p[0]
    code = forms.compiled[k, 1]
    value, x, y, z = zero, zero, zero, zero
    rest = mask
    while ops.any_lane(rest):
        one, here = crosslane.uniform_group(tape, rest)
        _set_turns(registers, p)
        begin = forms.places[k, 3]
        if code != 0 and forms.tapes[forms.places[k, 4], 1] <= QUICKER * forms.tapes[one, 1]:
            compiled(code, registers, forms.constants, begin, memory.out)
            return (
                crosslane.load(memory.out, 0),
                crosslane.load(memory.out, 1),
                crosslane.load(memory.out, 2),
                crosslane.load(memory.out, 3),
            )
        first, rows = forms.tapes[one, 0], forms.tapes[one, 1]
        interpret(forms.programs[_TURNS], forms.code, first, rows, registers, forms.constants, begin, memory.state, 1)
        out = 4 * forms.tapes[one, 2]
        value = ops.where(here, crosslane.load(registers, out), value)
        x = ops.where(here, crosslane.load(registers, out + 1), x)
        y = ops.where(here, crosslane.load(registers, out + 2), y)
        z = ops.where(here, crosslane.load(registers, out + 3), z)
        rest = rest & ops.not_(here)
    return value, x, y, z


@helper
def _set_turns(registers: Any, p: Vec) -> None:
    zero = 0.0 * p[0]
    for axis in range(3):
        for j in range(3):
            crosslane.store(registers, 4 * axis + 1 + j, zero + 1.0 if j == axis else zero)
    crosslane.store(registers, 0, p[0])
    crosslane.store(registers, 4, p[1])
    crosslane.store(registers, 8, p[2])


class Bounds(NamedTuple):
    """Of a formula along stretches of rays."""

    low: Lane
    high: Lane
    least: Lane  # slope
    most: Lane
    maybe: Lane  # mask: something may be undefined


@helper
def bounds_at(forms: Any, k: int, tape: int, memory: Room, p: Vec, q: Vec, way: Vec) -> Bounds:
    """Bounds over the boxes with corners p and q, and of slopes along `way`, by one tape."""
    registers = memory.registers
    for axis in range(3):
        a, b, d = (p[0], q[0], way[0]) if axis == 0 else (p[1], q[1], way[1]) if axis == 1 else (p[2], q[2], way[2])
        crosslane.store(registers, 4 * axis, ops.minimum(a, b))
        crosslane.store(registers, 4 * axis + 1, ops.maximum(a, b))
        crosslane.store(registers, 4 * axis + 2, d)
        crosslane.store(registers, 4 * axis + 3, d)
    simd.write(memory.state, 0, 0)
    interpret(
        forms.programs[_RAYS],
        forms.code,
        forms.tapes[tape, 0],
        forms.tapes[tape, 1],
        registers,
        forms.constants,
        forms.places[k, 3],
        memory.state,
        1,
    )
    out = 4 * forms.tapes[tape, 2]
    bits = simd.read(memory.state, 0)
    maybe = ((bits >> ops.to_int(crosslane.lane_indices(0))) & 1) != 0
    return Bounds(
        crosslane.load(registers, out),
        crosslane.load(registers, out + 1),
        crosslane.load(registers, out + 2),
        crosslane.load(registers, out + 3),
        maybe,
    )


@noinline_helper
def error_at(forms, k, tape, memory, p, way, mask):
    """How far from 0 the formula may be at points: its value there and what rounding does to it."""
    zero = 0.0 * p[0]
    found = zero
    rest = mask
    while ops.any_lane(rest):
        one, here = crosslane.uniform_group(tape, rest)
        bounds = bounds_at(forms, k, one, memory, p, p, way)
        found = ops.where(here, ops.maximum(abs(bounds.low), abs(bounds.high)), found)
        rest = rest & ops.not_(here)
    return found
