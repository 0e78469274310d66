"""Solids of planes, quadrics and tori found in tapes: relations that `and`, `or` and `not` combine, of each of which rays know all roots.

A field whose value is k √Q + P, with Q and P polynomials of second degree or less, is at most 0 where polynomials are: hypot(x, z) ≤ r
where x² + z² ≤ r² and r ≥ 0. Minima and maxima are the relations' combinations, whatever is added to all of them (Appel and others'
`Roth diagrams`: Roth, "Ray casting for modeling solids", 1982).
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from .. import ir
from . import quadric_recognition
from .opcodes import Op, arity
from .quadric_recognition import Quadratic
from .tape import INPUTS, Tape, load_tape

MOST_LEAVES = 48  # with more, most are far from a ray: interval cells are faster
MOST_KNOWN = 64  # cached results
MOST_DEPTH = 12  # of the stack that combines relations
LEAF, BOTH, EITHER = 0, 1, 2  # a step: push leaf `number`; combine the two on top of the stack by `and`, by `or`
_TINY = 1e-12
THIN = 2.0**-12  # of a solid's extent: thinner slabs are too inexact as one relation of a square


@dataclass(frozen=True, eq=False)
class Root:
    """k √under + rest, where `under` is at least 0; a polynomial if k is 0."""

    k: float
    under: Quadratic
    rest: Quadratic

    @property
    def is_plain(self) -> bool:
        return self.k == 0.0


class Torus(NamedTuple):
    """A torus: `frame` (3, 4) leads from the shape's frame to one whose y is the axis."""

    frame: np.ndarray
    ring: float
    tube: float


class Leaf(NamedTuple):
    """A relation: a polynomial is at most 0, or a point is inside, or outside, of a torus."""

    form: Quadratic | None
    torus: Torus | None = None
    outside: bool = False


class Solid(NamedTuple):
    """A CSG tree of relations, as steps (op, number) of a stack machine."""

    leaves: tuple[Leaf, ...]
    steps: tuple[tuple[int, int], ...]


_known: dict[tuple[Any, ...], Solid | None] = {}


class _Unknown(Exception):
    """The field is not a CSG tree of planes, quadrics and tori."""


def of_geometry(tables: ir.Tables, g: int) -> Solid | None:
    """`solid` of geometry g, a formula. Results are cached: planning and rendering both need them."""
    geometries = tables.geometries
    tape, sheet = load_tape(tables, int(geometries.tape[g])), bool(geometries.parameters[g, 0])
    reach = float(np.abs(geometries.bounds[g]).max())
    key = tape.structure(), tape.constants.tobytes(), sheet, reach
    with contextlib.suppress(KeyError):
        return _known[key]
    form = solid(tape, sheet, reach)
    if len(_known) >= MOST_KNOWN:
        _known.clear()
    _known[key] = form
    return form


def solid(tape: Tape, sheet: bool = False, reach: float = 1.0) -> Solid | None:
    """Where a field is at most 0, of planes, quadrics and tori; None where it is made of anything else, or of too much.

    Of a sheet the field must have both signs: where it only touches 0 there is no side that rays could come to. `reach` is the largest
    coordinate of interest.
    """
    reader = _Reader(tape, THIN * reach)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # overflows are detected later
            tree = reader.holds(tape.results[0], 1.0, np.zeros((4, 4)))
    except _Unknown:
        return None
    if isinstance(tree, bool):
        return None
    leaves: list[Leaf] = []
    steps: list[tuple[int, int]] = []
    deepest = _written(tree, leaves, steps)
    if len(leaves) > MOST_LEAVES or deepest > MOST_DEPTH or (sheet and not all(map(_has_both_signs, leaves))):
        return None
    return Solid(tuple(leaves), tuple(steps))


def _has_both_signs(leaf: Leaf) -> bool:
    if leaf.form is None:
        return True
    values = np.linalg.eigvalsh(leaf.form)
    return bool(values[0] < -_TINY * np.abs(values).max() and values[-1] > _TINY * np.abs(values).max())


Tree = bool | Leaf | tuple[int, "Tree", "Tree"]


def _joined(op: int, first: Tree, second: Tree) -> Tree:
    for a, b in ((first, second), (second, first)):
        if isinstance(a, bool):
            return b if a == (op == BOTH) else a
    return op, first, second


def _written(tree: Tree, leaves: list[Leaf], steps: list[tuple[int, int]]) -> int:
    """Append the steps of a tree. Returns the depth of the stack."""
    if isinstance(tree, Leaf):
        steps.append((LEAF, len(leaves)))
        leaves.append(tree)
        return 1
    assert not isinstance(tree, bool)
    op, left, right = tree
    deep, rest = _depth(left), _depth(right)
    first, second = (left, right) if deep >= rest else (right, left)
    depth = max(_written(first, leaves, steps), 1 + _written(second, leaves, steps))
    steps.append((op, 0))
    return depth


def _depth(tree: Tree) -> int:
    if not isinstance(tree, tuple) or isinstance(tree, Leaf):
        return 1
    less, more = sorted(map(_depth, tree[1:]))
    return max(more, less + 1)


class _Reader:
    """Recognizes the values of a tape."""

    def __init__(self, tape: Tape, thin: float) -> None:
        self.tape, self.thin = tape, thin
        self.known: dict[int, Root | None] = {}
        self.seen = self.leaves = 0

    def row(self, name: int) -> tuple[Op, list[int]]:
        op, *operands = self.tape.code[name - INPUTS].tolist()
        return Op(op), operands[: arity(op)]

    def holds(self, name: int, factor: float, added: Quadratic) -> Tree:
        """The tree of factor · value + added ≤ 0."""
        self.seen += 1
        if self.seen > 8 * MOST_LEAVES:
            raise _Unknown
        value = self.value(name)
        if value is not None:
            leaf = _at_most_0(Root(factor * value.k, value.under, factor * value.rest + added))
            self.leaves += not isinstance(leaf, bool)
            if self.leaves > MOST_LEAVES:
                raise _Unknown
            return leaf
        op, names = self.row(name)
        a, b = names[0], names[-1]
        match op:
            case Op.COPY:
                return self.holds(a, factor, added)
            case Op.NEGATE:
                return self.holds(a, -factor, added)
            case Op.MIN | Op.MAX:
                how = BOTH if (op == Op.MAX) == (factor > 0.0) else EITHER
                return _joined(how, self.holds(a, factor, added), self.holds(b, factor, added))
            case Op.ABS:
                argument, level = self.value(a), _number(added)
                if argument is not None and argument.is_plain and not argument.rest[:3, :3].any() and level is not None and factor:
                    return _slab(argument.rest, factor, level, self.thin)
                how = BOTH if factor > 0.0 else EITHER
                return _joined(how, self.holds(a, factor, added), self.holds(a, -factor, added))
            case Op.ADD | Op.SUBTRACT:
                sign = 1.0 if op == Op.ADD else -1.0
                for operand, other, factor_of_operand, factor_of_other in ((a, b, 1.0, sign), (b, a, sign, 1.0)):
                    plain = self.value(operand)
                    if plain is not None and plain.is_plain:
                        return self.holds(other, factor * factor_of_other, added + factor * factor_of_operand * plain.rest)
            case Op.MULTIPLY | Op.DIVIDE:
                operand, other = (a, self.number(b)) if op == Op.DIVIDE or self.number(a) is None else (b, self.number(a))
                if other:
                    return self.holds(operand, factor / other if op == Op.DIVIDE else factor * other, added)
            case Op.SQRT | Op.HYPOT:
                inner = self.square(names)
                level = _number(added)
                if inner is not None and level is not None and factor and (op == Op.HYPOT or self.never_negative(a)):
                    return _root_at_most(inner, factor, level)
        raise _Unknown

    def never_negative(self, name: int) -> bool:
        """Whether a value is known to be at least 0 everywhere."""
        number = self.number(name)
        if number is not None or name < INPUTS:
            return number is not None and number >= 0.0
        op, names = self.row(name)
        if op in (Op.SQUARE, Op.ABS, Op.HYPOT):
            return True
        if op in (Op.ADD, Op.MIN, Op.MAX, Op.MULTIPLY, Op.COPY) and all(map(self.never_negative, names)):
            return True
        value = self.value(name)
        return value is not None and value.is_plain and _never_negative(value.rest)

    def number(self, name: int) -> float | None:
        value = self.value(name)
        return _number(value.rest) if value is not None and value.is_plain else None

    def value(self, name: int) -> Root | None:
        """A value as k √Q + P, if it has that form."""
        waiting = [name]  # chains of operations may be longer than the stack
        while name not in self.known:
            last = waiting[-1]
            unknown = self._first_unknown(last)
            if unknown is None:
                self.known[last] = self._value(last)
                waiting.pop()
            else:
                waiting.append(unknown)
        return self.known[name]

    def _first_unknown(self, name: int) -> int | None:
        """The first operand that is not known, unless one before it has no such form."""
        for operand in self.row(name)[1] if name >= INPUTS else ():
            if operand not in self.known:
                return operand
            if self.known[operand] is None:
                return None
        return None

    def _value(self, name: int) -> Root | None:
        if name < 0:
            return _plain(_constant(float(self.tape.constants[~name])))
        if name < INPUTS:
            coordinate = np.zeros((4, 4))
            coordinate[name, 3] = coordinate[3, name] = 0.5
            return _plain(coordinate)
        op, names = self.row(name)
        if op in (Op.SQRT, Op.HYPOT):
            inner = self.square(names)
            return Root(1.0, inner.rest, np.zeros((4, 4))) if inner is not None and inner.is_plain and _never_negative(inner.rest) else None
        values = []
        for operand in names:
            value = self.value(operand)
            if value is None:
                return None
            values.append(value)
        return _applied(op, values)

    def square(self, names: list[int]) -> Root | None:
        """The radicand of SQRT (one name) or HYPOT (two)."""
        values = [self.value(name) for name in names]
        if len(values) == 1 or None in values:
            return None if None in values else values[0]
        first, second = (_applied(Op.SQUARE, [value]) for value in values)  # type: ignore[list-item]
        return None if first is None or second is None else _applied(Op.ADD, [first, second])


def _constant(number: float) -> Quadratic:
    form = np.zeros((4, 4))
    form[3, 3] = number
    return form


def _plain(form: Quadratic) -> Root:
    return Root(0.0, np.zeros((4, 4)), form)


def _number(form: Quadratic) -> float | None:
    """The value of a constant polynomial."""
    return None if form[:3].any() else float(form[3, 3])


def _applied(op: Op, values: list[Root]) -> Root | None:
    a, b = values[0], values[-1]
    match op:
        case Op.COPY:
            return a
        case Op.NEGATE:
            return Root(-a.k, a.under, -a.rest)
        case Op.ADD | Op.SUBTRACT:
            b = Root(-b.k, b.under, -b.rest) if op == Op.SUBTRACT else b
            if a.is_plain or b.is_plain or np.array_equal(a.under, b.under):
                return Root(a.k + b.k, b.under if a.is_plain else a.under, a.rest + b.rest)
        case Op.SQUARE:
            shift = _number(a.rest)
            if not a.is_plain and shift is not None:
                return Root(2 * a.k * shift, a.under, a.k**2 * a.under + _constant(shift**2))
            if a.is_plain:
                product = quadric_recognition._applied(op, [a.rest])
                return None if product is None else _plain(product)
        case Op.MULTIPLY | Op.DIVIDE:
            operand, other = (a, b) if op == Op.DIVIDE or _number(b.rest) is not None else (b, a)
            number = _number(other.rest) if other.is_plain else None
            if number is not None and (number or op == Op.MULTIPLY):
                factor = 1.0 / number if op == Op.DIVIDE else number
                return replace(operand, k=factor * operand.k, rest=factor * operand.rest)
            if op == Op.MULTIPLY and a.is_plain and b.is_plain:
                product = quadric_recognition._applied(op, [a.rest, b.rest])
                return None if product is None else _plain(product)
    return None


def _never_negative(form: Quadratic) -> bool:
    if not np.isfinite(form).all():
        raise _Unknown
    values = np.linalg.eigvalsh(form)
    return bool(values[0] >= -_TINY * np.abs(values).max())


# --- relations -----------------------------------------------------------------------------------------------------------


def _leaf(form: Quadratic) -> Tree:
    """The relation polynomial ≤ 0."""
    if not np.isfinite(form).all():
        raise _Unknown
    number = _number(form)
    if number is not None:
        return number <= 0.0
    size = np.abs(form[:3, :3]).max() or np.abs(form[:3, 3]).max()
    return Leaf(form / size)


def _at_most_0(value: Root) -> Tree:
    """The relation k √Q + P ≤ 0."""
    k, under, rest = value.k, value.under, value.rest
    if not k:
        return _leaf(rest)
    if not rest[:3, :3].any():
        line = np.append(2 * rest[:3, 3], rest[3, 3]) / k
        square = np.outer(line, line)
        return _joined(BOTH, _leaf(rest), _leaf(under - square)) if k > 0 else _joined(EITHER, _leaf(rest), _leaf(square - under))
    torus = _torus(-abs(k), under, rest if k < 0 else -rest)
    if torus is None:
        raise _Unknown
    return Leaf(None, torus, outside=k > 0)


def _root_at_most(inner: Root, factor: float, level: float) -> Tree:
    """The relation factor · √inner + level ≤ 0."""
    bound = -level / factor
    if bound < 0.0:
        return factor < 0.0
    sign = math.copysign(1.0, factor)
    return _at_most_0(Root(sign * inner.k, inner.under, sign * (inner.rest - _constant(bound**2))))


def _slab(line: Quadratic, factor: float, level: float, thin: float) -> Tree:
    """The relation factor · |line| + level ≤ 0: one relation of the square instead of two, unless the slab is thin."""
    bound = -level / factor
    if bound < 0.0:
        return factor < 0.0
    plane = np.append(2 * line[:3, 3], line[3, 3])
    sign = math.copysign(1.0, factor)
    if 0.0 < bound < thin * float(np.linalg.norm(plane[:3])):
        sides = [_leaf(sign * (side * line - _constant(bound))) for side in (1.0, -1.0)]
        return _joined(BOTH if sign > 0.0 else EITHER, *sides)
    return _leaf(sign * (np.outer(plane, plane) - _constant(bound**2)))


def _torus(k: float, under: Quadratic, rest: Quadratic) -> Torus | None:
    """The relation |p − c|² + R² − r² − 2 R ρ ≤ 0 of a torus, ρ the distance from its axis: k √(λ ρ²) + α |p − c|² + β, k < 0."""
    scale = float(np.trace(rest[:3, :3])) / 3
    values, axes = np.linalg.eigh(under[:3, :3])
    if not (scale > 0.0 and values[1] > 0.0):
        return None
    even = np.abs(rest[:3, :3] - scale * np.eye(3)).max() < _TINY * scale
    level = 0.5 * (values[1] + values[2])
    if not even or abs(values[0]) > _TINY * level or values[2] - values[1] > _TINY * level:
        return None
    center = -rest[:3, 3] / scale
    axis = axes[:, 0]
    expected = np.zeros((4, 4))
    flat = level * (np.eye(3) - np.outer(axis, axis))
    expected[:3, :3], expected[:3, 3] = flat, -flat @ center
    expected[3, :3], expected[3, 3] = expected[:3, 3], center @ flat @ center
    if np.abs(expected - under).max() > 1e-10 * np.abs(under).max():
        return None
    ring = -0.5 * k * math.sqrt(level) / scale
    square = ring**2 - (rest[3, 3] / scale - center @ center)
    if not square > 0.0:
        return None
    axis = np.where(np.abs(axis) < _TINY, 0.0, axis)
    x = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    x /= np.linalg.norm(x)
    turned = np.stack([x, axis, np.cross(x, axis)])
    return Torus(np.concatenate([turned, -(turned @ center)[:, None]], axis=1), ring, math.sqrt(square))


def holds(shape: Solid, points: np.ndarray) -> np.ndarray:
    """Whether points (n, 3) are in a solid."""
    waiting: list[np.ndarray] = []
    for op, number in shape.steps:
        if op == LEAF:
            waiting.append(_leaf_holds(shape.leaves[number], points))
        else:
            b, a = waiting.pop(), waiting.pop()
            waiting.append(a & b if op == BOTH else a | b)
    return waiting[0]


def _leaf_holds(leaf: Leaf, points: np.ndarray) -> np.ndarray:
    if leaf.torus is None:
        assert leaf.form is not None  # a leaf has a form or a torus
        homogeneous = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        return np.einsum("ni,ij,nj->n", homogeneous, leaf.form, homogeneous) <= 0.0
    frame, ring, tube = leaf.torus
    x, y, z = (points @ frame[:, :3].T + frame[:, 3]).T
    inside = np.hypot(np.hypot(x, z) - ring, y) <= tube
    return ~inside if leaf.outside else inside
