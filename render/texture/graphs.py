"""Textures from tapes of texture graphs (compiler/texture_graph): patterns that read u, v, the normal and pictures.

With a footprint, a graph is averaged over it as patterns are (pixel_mean.py), and its pictures are looked up in levels for the
footprint of one of these points. `Lookups` is a part of the table Textures in scenes with graphs; other scenes compile none of this.
"""

# pyright: reportArgumentType=false
# (numbers of kernels are numpy's)

from __future__ import annotations

import ctypes
from collections import namedtuple
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir as lir
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.formula.tape import INPUTS, load_tape
from ...compiler.texture_graph import evaluate as definition
from ...compiler.texture_graph.opcodes import CHANNELS, REGISTERS, Op, U, is_graph
from .. import simd
from ..formula.llvm_math import LANES
from ..jit.kernel import helper, separate_helper
from ..lanes import crosslane, ops
from ..simd.llvm_expr import I64
from ..simd.registration import intrinsic, overload, signature, types
from ..types import Lane, Vec
from . import graph_interpreter, pixel_mean
from .image_lookup import Rgba, look_up, look_up_level
from .pixel_mean import WITH_PLACES
from .procedural import FORMULA, place_in_array

Inputs = tuple[Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane]
"""x, y, z, u, v and the three parts of the normal."""
_FARTHEST = 1e12  # coordinates beyond this count as 0
_ROOM = REGISTERS * LANES
_ACROSS = 4.0  # points of a footprint along a side
_SYMBOL = "maquette_graph_slot"
_STEP = 1e-4  # of differences that measure how coordinates change
_slot = (ctypes.c_int64 * 1)(0)
llvm.add_symbol(_SYMBOL, ctypes.addressof(_slot))


class Lookups(NamedTuple):
    """The look-ups of pictures in graphs; those of a texture are consecutive."""

    first: NDArray[np.int64]  # (textures,)
    count: NDArray[np.int64]  # (textures,)
    row: NDArray[np.int64]  # (n,) of the tape
    s: NDArray[np.int64]  # (n,) names
    t: NDArray[np.int64]
    texture: NDArray[np.int64]  # (n,) the picture, a row of Textures
    by_uv: NDArray[np.float64]  # (n,) largest change of s and t by u and v, its median over points
    by_place: NDArray[np.float64]  # (n,) by x, y and z


_Textures = namedtuple("_Textures", (*ir.Textures._fields, "lookups"))


def with_lookups(tables: ir.Tables) -> ir.Tables:
    """Tables of a scene with texture graphs for kernels, whose interpreter is linked; those of other scenes as they are."""
    rows = np.flatnonzero(np.asarray(tables.textures.kind == FORMULA))
    tapes = {row: load_tape(tables, int(tables.textures.tape[row])) for row in rows.tolist()}
    if not any(is_graph(tape.code, tape.results) for tape in tapes.values()):
        return tables
    _slot[0] = graph_interpreter.address()
    count = len(tables.textures.kind)
    starts, counts, columns = np.zeros(count, np.int64), np.zeros(count, np.int64), []
    for row, tape in tapes.items():
        places = np.flatnonzero(tape.code[:, 0] == Op.LOOK_UP).tolist()
        starts[row], counts[row] = len(columns), len(places)
        for place, change in zip(places, _changes(tape, places), strict=True):
            _, s, t, k = tape.code[place].tolist()
            columns.append((place, s, t, int(tape.constants[~k]), *change))
    table = np.array(columns, np.float64).reshape(-1, 6).T
    lookups = Lookups(starts, counts, *(np.ascontiguousarray(c, np.int64) for c in table[:4]), *map(np.ascontiguousarray, table[4:]))
    return tables._replace(textures=_Textures(*tables.textures, lookups))  # pyright: ignore[reportArgumentType]


def _changes(tape: Any, places: list[int]) -> list[tuple[float, float]]:
    """Of each look-up the largest change of its coordinates by (u and v, the position), the median over points."""
    if not places:
        return []
    rng = np.random.default_rng(1)
    inputs = np.concatenate([rng.uniform(-1.0, 1.0, (3, 64)), rng.uniform(0.0, 1.0, (2, 64)), rng.normal(size=(3, 64))])
    inputs[5:] /= np.linalg.norm(inputs[5:], axis=0)

    def coordinates(point: Any) -> Any:
        grey = [np.full(64, 0.5)] * CHANNELS
        named = definition.values(tape, point, lambda texture, s, t: grey)
        return np.array([[named[int(name)] for name in tape.code[place, 1:3]] for place in places])

    base, steps = coordinates(inputs), []
    for k in range(5):
        moved = inputs.copy()
        moved[k] += _STEP
        steps.append(np.nan_to_num(np.abs(coordinates(moved) - base).max(axis=1) / _STEP))
    change = np.median(np.array(steps), axis=2)
    return [(float(change[3:, k].max()), float(change[:3, k].max())) for k in range(len(places))]


def are_linked(tables: Any) -> bool:
    """Whether tables are those of `with_lookups`."""
    return hasattr(tables.textures, "lookups")


# --- over a footprint ---------------------------------------------------------------------------------------------------


def evaluate_filtered(tables: Any, row: Lane, surface: Any, spread: Any) -> Vec:
    """The color of patterns and graphs at surface points (textures.Spot), averaged over the footprint if there is one."""
    inputs = (*surface.local, *surface.uv, *surface.local_normal)
    if spread is None or len(spread) < WITH_PLACES:
        return evaluate(tables, row, inputs, None)
    return _mean_over_pixel(tables, row, inputs, spread)


@overload(evaluate_filtered)
def _evaluate_filtered_in_kernels(tables, row, surface, spread):
    if isinstance(spread, types.BaseTuple) and len(spread) >= WITH_PLACES:
        return lambda tables, row, surface, spread: _mean_over_pixel(
            tables, row, (*surface.local, *surface.uv, *surface.local_normal), spread
        )
    return lambda tables, row, surface, spread: evaluate(tables, row, (*surface.local, *surface.uv, *surface.local_normal), None)


@separate_helper
def _mean_over_pixel(tables: Any, row: Lane, point: Inputs, spread: Any) -> Vec:
    """The mean over a parallelogram around a point."""
    right, down = (spread[4], spread[5], spread[6]), (spread[7], spread[8], spread[9])
    of_uv = ops.maximum(abs(spread[0]) + abs(spread[2]), abs(spread[1]) + abs(spread[3]))
    of_place = ops.maximum(ops.length(right), ops.length(down))
    wide = of_uv + of_place > 0.0
    zero = 0.0 * point[0]
    widths = (of_uv * (1.0 / _ACROSS), of_place * (1.0 / _ACROSS))
    mean, k = pixel_mean.begin(zero), 0
    while ops.any_lane(mean.open):
        a, b = pixel_mean.offset(k)
        p = ops.along(ops.along((point[0], point[1], point[2]), right, zero + a), down, zero + b)
        u, v = point[3] + a * spread[0] + b * spread[2], point[4] + a * spread[1] + b * spread[3]
        color = evaluate(tables, row, (p[0], p[1], p[2], u, v, point[5], point[6], point[7]), widths)
        mean = pixel_mean.add(mean, color, k, wide)
        k += 1
    return pixel_mean.result(mean)


# --- at points ----------------------------------------------------------------------------------------------------------


def evaluate(tables: Any, row: Lane, point: Inputs, widths: Any) -> Vec:
    """The color of patterns and graphs (rows of Textures) at points; numbers are gray, undefined values 0.

    `widths` are the changes of (u and v, the position) over a footprint that pictures are averaged over, or None.
    """
    inputs = np.array(np.broadcast_arrays(*point), np.float64)
    rows = np.broadcast_to(row, inputs.shape[1:])
    result = np.zeros(inputs.shape)[:3]
    lookups = tables.textures.lookups
    for texture in np.unique(rows).tolist():
        if tables.textures.tape[texture] < 0:
            continue
        lanes = rows == texture
        steps, numbers = None if widths is None else [np.broadcast_to(w, rows.shape)[lanes] for w in widths], iter(range(1 << 30))

        def look(picture: int, s: Any, t: Any, texture: int = texture, steps: Any = steps, numbers: Any = numbers) -> Rgba:
            k = int(lookups.first[texture]) + next(numbers)
            span = None if steps is None else lookups.by_uv[k] * steps[0] + lookups.by_place[k] * steps[1]
            return _picture(tables, np.full(s.shape, picture), s, t, span)

        values = definition.results(load_tape(tables, int(tables.textures.tape[texture])), inputs[:, lanes], look)
        for k in range(3):
            result[k][lanes] = values[min(k, len(values) - 1)]
    result = np.where(np.isfinite(result), result, 0.0)
    return result[0], result[1], result[2]


@overload(evaluate)
def _evaluate_in_kernels(tables, row, point, widths):
    if isinstance(point[0], simd.Vector) and point[0].bits == 32:
        return _evaluate_float32
    return _evaluate_lanes if isinstance(row, simd.Vector) else _evaluate_scalar


def _evaluate_float32(tables, row, point, widths):
    """For float32 lanes, which no scene with patterns gets from the plan."""
    zero = 0.0 * point[0]
    return zero, zero, zero


def _evaluate_lanes(tables, row, point, widths):
    zero = 0.0 * point[0]
    result = (zero, zero, zero)
    pending = ops.bool_like(zero, True)
    while ops.any_lane(pending):
        texture, lanes = crosslane.uniform_group(row, pending)
        result = ops.where3(lanes, evaluate(tables, texture, point, widths), result)
        pending = pending & ops.not_(lanes)
    return result


def _evaluate_scalar(tables, row, point, widths):
    tape = np.int64(tables.textures.tape[row])
    zero = 0.0 * point[0]
    if tape < 0:
        return zero, zero, zero
    registers = simd.stack_array(np.float64, _ROOM)
    lanes = ops.to_float(crosslane.lane_indices(0)) * 0.0
    crosslane.store(registers, 0, lanes + point[0])
    crosslane.store(registers, 1, lanes + point[1])
    crosslane.store(registers, 2, lanes + point[2])
    crosslane.store(registers, U, lanes + point[3])
    crosslane.store(registers, U + 1, lanes + point[4])
    crosslane.store(registers, U + 2, lanes + point[5])
    crosslane.store(registers, U + 3, lanes + point[6])
    crosslane.store(registers, U + 4, lanes + point[7])
    first, begin = np.int64(tables.tapes.first[tape]), np.int64(tables.tapes.first_constant[tape])
    lookups = tables.textures.lookups
    done, k = np.int64(0), np.int64(lookups.first[row])
    last = k + np.int64(lookups.count[row])
    while k < last:
        place = np.int64(lookups.row[k])
        _run(tables.pools.code, first + done, place - done, tables.pools.constants, begin, registers, done)
        s, t = _value(tables, lookups.s[k], begin, registers, point[0]), _value(tables, lookups.t[k], begin, registers, point[0])
        picture = ops.to_int(zero) + np.int64(lookups.texture[k])
        red, green, blue, alpha = _picture(tables, picture, s, t, _span(lookups, k, widths))
        crosslane.store(registers, INPUTS + place, lanes + red)
        crosslane.store(registers, INPUTS + place + 1, lanes + green)
        crosslane.store(registers, INPUTS + place + 2, lanes + blue)
        crosslane.store(registers, INPUTS + place + 3, lanes + alpha)
        done = place + CHANNELS
        k += 1
    _run(tables.pools.code, first + done, np.int64(tables.tapes.count[tape]) - done, tables.pools.constants, begin, registers, done)
    results, several = tables.tapes.results, tables.tapes.result_count[tape] > 1
    r = _value(tables, results[tape, 0], begin, registers, point[0])
    if not several:
        return r, r, r
    return r, _value(tables, results[tape, 1], begin, registers, point[0]), _value(tables, results[tape, 2], begin, registers, point[0])


def _span(lookups: Any, k: Any, widths: Any) -> Any:
    raise NotImplementedError("in kernels only")


@overload(_span)
def _span_in_kernels(lookups, k, widths):
    if isinstance(widths, types.BaseTuple):
        return lambda lookups, k, widths: lookups.by_uv[k] * widths[0] + lookups.by_place[k] * widths[1]
    return lambda lookups, k, widths: None


@separate_helper
def _picture(tables: Any, row: Lane, s: Lane, t: Lane, span: Any) -> Rgba:
    """A picture at s, t; with a span, in the level whose texels are that wide."""
    textures = tables.textures
    s, t = ops.where(ops.absolute(s) < _FARTHEST, s, 0.0), ops.where(ops.absolute(t) < _FARTHEST, t, 0.0)
    image = ops.maximum(textures.image[row], 0)
    wraps = textures.wrap_u[row], textures.wrap_v[row]
    return _texels(tables, image, s, t, wraps, textures.nearest[row], span)


def _texels(tables: Any, image: Lane, s: Lane, t: Lane, wraps: Any, nearest: Lane, span: Any) -> Rgba:
    if span is None or not hasattr(tables.images, "levels"):
        return look_up(tables, image, s, t, wraps[0], wraps[1], nearest)
    return _texels_of_level(tables, image, s, t, wraps, nearest, span)


@overload(_texels)
def _texels_in_kernels(tables, image, s, t, wraps, nearest, span):
    if tables.field("images.levels") is None or isinstance(span, types.NoneType):
        return lambda tables, image, s, t, wraps, nearest, span: look_up(tables, image, s, t, wraps[0], wraps[1], nearest)
    return lambda tables, image, s, t, wraps, nearest, span: _texels_of_level(tables, image, s, t, wraps, nearest, span)


@helper
def _texels_of_level(tables: Any, image: Lane, s: Lane, t: Lane, wraps: Any, nearest: Lane, span: Lane) -> Rgba:
    images = tables.images
    texels = span * ops.to_float(ops.maximum(images.width[image], images.height[image]))
    level = ops.log(ops.maximum(ops.where(nearest, 0.0, texels), 1.0)) * 1.4426950408889634 + 0.5
    level = ops.minimum(ops.floor_int(level), images.levels[image] - 1)
    return look_up_level(tables, image, level, s, t, wraps, nearest)


def _value(tables: Any, name: Any, begin: Any, registers: Any, like: Lane) -> Lane:
    """The value of a name, 0 where it is not finite."""
    raise NotImplementedError("in kernels only")


@overload(_value)
def _value_in_kernels(tables, name, begin, registers, like):
    vector = isinstance(like, simd.Vector)

    def lanes(tables, name, begin, registers, like):
        number = np.int64(name)
        value = ops.full_like(like, tables.pools.constants[begin + ~number]) if number < 0 else _loaded(registers, number, like)
        return ops.where(ops.is_finite(value), value, 0.0)

    def scalar(tables, name, begin, registers, like):
        number = np.int64(name)
        value = tables.pools.constants[begin + ~number] if number < 0 else simd.read(registers, number * LANES)
        return value if abs(value) < np.inf else 0.0

    return lanes if vector else scalar


def _loaded(registers: Any, name: Any, like: Lane) -> Lane:
    raise NotImplementedError("in kernels only")


@overload(_loaded)
def _loaded_in_kernels(registers, name, like):
    return lambda registers, name, like: crosslane.load(registers, name)


@intrinsic
def _run(typingctx, code, first, rows, constants, begin, registers, done):
    """Evaluate rows of a tape, the first of which has the number `done`; see graph_interpreter.py."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        module = builder.module
        slot = module.globals.get(_SYMBOL) or lir.GlobalVariable(module, I64, _SYMBOL)
        function = builder.inttoptr(builder.load(slot), graph_interpreter.GRAPH.as_pointer())
        operands = [
            place_in_array(context, builder, code, args[0], builder.mul(args[1], lir.Constant(I64, 4))),
            args[2],
            place_in_array(context, builder, constants, args[3], args[4]),
            place_in_array(context, builder, registers, args[5], lir.Constant(I64, 0)),
            args[6],
        ]
        builder.call(function, operands)
        return context.get_dummy_value()

    i = types.int64
    return signature(types.void, code, i, i, constants, i, registers, i), generate
