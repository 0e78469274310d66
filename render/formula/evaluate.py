"""Evaluates tapes in kernels, by compiled code once it is ready, else by an interpreter; both give the same bits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import crosslane, ops
from ..types import Lane, Vec
from .evaluator_calls import interpret, run_compiled
from .interval_grid import MAX_REGISTERS
from .llvm_math import BRANCH_WORD, LANES
from .tables import FIRST_CONSTANT, FIRST_ROW, RESULT, ROW_COUNT, WHOLE_TAPE

SPEEDUP = 6  # compiled code of the whole tape runs as fast as an interpreter of a tape this many times shorter
_REGISTERS = MAX_REGISTERS * 4 * LANES
_POINTS, _GRADIENTS, _RAYS = 0, 1, 3  # places in scene_surfaces.PROGRAMS
_OUT, _STATE = 4 * LANES, BRANCH_WORD + LANES


class EvalBuffers(NamedTuple):
    """Memory that evaluation writes to, on the kernel's stack."""

    registers: Any
    out: Any
    state: Any


@helper
def eval_buffers() -> EvalBuffers:
    """Allocate the buffers on the stack of the caller."""
    return EvalBuffers(
        simd.stack_array(np.float64, _REGISTERS), simd.stack_array(np.float64, _OUT), simd.stack_array(np.int64, _STATE)
    )  # fmt: skip


class RayFunction(NamedTuple):
    """The formula of surface `k` as a function of the distance along rays, by each ray's tape."""

    forms: Any
    k: Any
    tape: Lane
    memory: EvalBuffers
    start: Vec
    direction: Vec  # of unit length


@helper
def value_on(ray: RayFunction, t: Lane, mask: Lane) -> Lane:
    """Values at distances t along rays, in the lanes of a mask."""
    return value_at(ray.forms, ray.k, ray.tape, ray.memory, ops.along(ray.start, ray.direction, t), mask)


@noinline_helper
def value_at(forms, k, tape, memory, p, mask):
    """Values of surface k at points, by each lane's tape."""
    registers = memory.registers
    crosslane.store(registers, 0, p[0])
    crosslane.store(registers, 1, p[1])
    crosslane.store(registers, 2, p[2])
    code = forms.compiled[k, 0]
    value = 0.0 * p[0]
    pending = mask
    while ops.any_lane(pending):
        shared_tape, group = crosslane.uniform_group(tape, pending)
        begin = forms.places[k, FIRST_CONSTANT]
        if code != 0 and forms.tapes[forms.places[k, WHOLE_TAPE], ROW_COUNT] <= SPEEDUP * forms.tapes[shared_tape, ROW_COUNT]:
            run_compiled(code, registers, forms.constants, begin, memory.out)
            return crosslane.load(memory.out, 0)
        first, rows = forms.tapes[shared_tape, FIRST_ROW], forms.tapes[shared_tape, ROW_COUNT]
        interpret(forms.programs[_POINTS], forms.code, first, rows, registers, forms.constants, begin, memory.state, 1)
        value = ops.where(group, crosslane.load(registers, forms.tapes[shared_tape, RESULT]), value)
        pending = pending & ops.not_(group)
    return value


@noinline_helper
def gradient_and_value_at(forms, k, tape, memory, p, mask):
    """(value, derivatives by x, y, z) of surface k at points."""
    registers = memory.registers
    zero = 0.0 * p[0]
    code = forms.compiled[k, 1]
    value, x, y, z = zero, zero, zero, zero
    pending = mask
    while ops.any_lane(pending):
        shared_tape, group = crosslane.uniform_group(tape, pending)
        _set_gradient_inputs(registers, p)
        begin = forms.places[k, FIRST_CONSTANT]
        if code != 0 and forms.tapes[forms.places[k, WHOLE_TAPE], ROW_COUNT] <= SPEEDUP * forms.tapes[shared_tape, ROW_COUNT]:
            run_compiled(code, registers, forms.constants, begin, memory.out)
            return (
                crosslane.load(memory.out, 0),
                crosslane.load(memory.out, 1),
                crosslane.load(memory.out, 2),
                crosslane.load(memory.out, 3),
            )
        first, rows = forms.tapes[shared_tape, FIRST_ROW], forms.tapes[shared_tape, ROW_COUNT]
        interpret(forms.programs[_GRADIENTS], forms.code, first, rows, registers, forms.constants, begin, memory.state, 1)
        out = 4 * forms.tapes[shared_tape, RESULT]
        value = ops.where(group, crosslane.load(registers, out), value)
        x = ops.where(group, crosslane.load(registers, out + 1), x)
        y = ops.where(group, crosslane.load(registers, out + 2), y)
        z = ops.where(group, crosslane.load(registers, out + 3), z)
        pending = pending & ops.not_(group)
    return value, x, y, z


@helper
def _set_gradient_inputs(registers: Any, p: Vec) -> None:
    zero = 0.0 * p[0]
    for axis in range(3):
        for j in range(3):
            crosslane.store(registers, 4 * axis + 1 + j, zero + 1.0 if j == axis else zero)
    crosslane.store(registers, 0, p[0])
    crosslane.store(registers, 4, p[1])
    crosslane.store(registers, 8, p[2])


class Bounds(NamedTuple):
    """Bounds of a formula and of its slope over ray segments."""

    low: Lane
    high: Lane
    least: Lane  # slope
    most: Lane
    maybe: Lane  # mask: the formula may be undefined


@helper
def bounds_at(forms: Any, k: int, tape: int, memory: EvalBuffers, p: Vec, q: Vec, direction: Vec) -> Bounds:
    """Bounds over the boxes with corners p and q, and of slopes along `direction`, by one tape."""
    registers, (d0, d1, d2) = memory.registers, direction
    for axis in range(3):
        a, b, d = (p[0], q[0], d0) if axis == 0 else (p[1], q[1], d1) if axis == 1 else (p[2], q[2], d2)
        crosslane.store(registers, 4 * axis, ops.minimum(a, b))
        crosslane.store(registers, 4 * axis + 1, ops.maximum(a, b))
        crosslane.store(registers, 4 * axis + 2, d)
        crosslane.store(registers, 4 * axis + 3, d)
    simd.write(memory.state, 0, 0)
    interpret(
        forms.programs[_RAYS],
        forms.code,
        forms.tapes[tape, FIRST_ROW],
        forms.tapes[tape, ROW_COUNT],
        registers,
        forms.constants,
        forms.places[k, FIRST_CONSTANT],
        memory.state,
        1,
    )
    out = 4 * forms.tapes[tape, RESULT]
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
def error_at(forms, k, tape, memory, p, direction, mask):
    """Bound of the magnitude of the formula at points, rounding included."""
    error = 0.0 * p[0]
    pending = mask
    while ops.any_lane(pending):
        shared_tape, group = crosslane.uniform_group(tape, pending)
        bounds = bounds_at(forms, k, shared_tape, memory, p, p, direction)
        error = ops.where(group, ops.maximum(abs(bounds.low), abs(bounds.high)), error)
        pending = pending & ops.not_(group)
    return error
