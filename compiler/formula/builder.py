"""Tapes: formulas as flat lists of operations, each number of theirs in a table, so that editing a number changes no code.

A value's name is a whole number: 0, 1 and 2 are the coordinates x, y and z, 3 + i is what row i of the code computes, and ~k (negative)
is constant k. What the operations mean, and what they give for boxes of points, stands in enclosures.py.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ...lang.formula_graph import Formula, Node
from . import factor_cancellation, regularize, step_functions
from .opcodes import COMMUTES, KEEP_WHOLE, STEPS, Op, arity, fold
from .step_functions import Levels

INPUTS = 3
X, Y, Z = 0, 1, 2
MOST_LIVE = 256  # values that evaluators keep at a time
HUGE = 1e35  # stands for what is divided by 0 all over a region
MOST_FACTORS = 64  # whole powers up to this are products


class Unfit(ValueError):
    """A formula that is no surface; the message says why, `hint` what to write."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True, eq=False)
class Tape:
    """A finished formula: code (n, 4) int32, constants (k,) float64, and the names of the values that are its results."""

    code: np.ndarray
    constants: np.ndarray
    results: tuple[int, ...]

    def structure(self) -> bytes:
        """Tells its code from other tapes', whatever its constants are."""
        return hashlib.blake2b(self.code.tobytes() + repr(self.results).encode(), digest_size=16).digest()


def stored(tables: Any, row: int) -> Tape:
    """Row `row` of Tapes (ir.Tables)."""
    tapes, pools = tables.tapes, tables.pools
    first, begin = int(tapes.first[row]), int(tapes.first_constant[row])
    code, constants = pools.code[first : first + int(tapes.count[row])], pools.constants[begin : begin + int(tapes.constant_count[row])]
    return Tape(code, constants, tuple(tapes.results[row, : tapes.result_count[row]].tolist()))


@dataclass(eq=False)
class Builder:
    """Collects operations: equal ones once, on constants at once. Methods take and give names of values."""

    rows: list[tuple[int, int, int, int]] = field(default_factory=list)
    constants: list[float] = field(default_factory=list)
    parted: bool = False  # whether what is compared may be equal all over a region without anything in it saying so
    _known: dict[Any, int] = field(default_factory=dict)
    _whole: set[int] = field(default_factory=set)  # what is a whole number wherever it is defined
    _flat: dict[int, Levels] = field(default_factory=dict)  # what may be the same number all over a region, and which
    _ways: dict[int, frozenset[int]] = field(default_factory=dict)  # of minima and the like, the values that they may be

    @classmethod
    def of(cls, tape: Tape) -> tuple[Builder, tuple[int, ...]]:
        """(a builder with a tape's operations as they are, the tape's results), to add to: what may be flat of these is not known."""
        builder = cls([tuple(row) for row in tape.code.tolist()], tape.constants.tolist())
        builder._known |= {number: ~k for k, number in enumerate(builder.constants)}
        builder._known |= {row: INPUTS + i for i, row in enumerate(builder.rows)}
        return builder, tape.results

    def constant(self, number: float) -> int:
        number = float(number) + 0.0  # −0 and 0 are the same
        if number not in self._known:
            self._known[number] = ~len(self.constants)
            self.constants.append(number)
        return self._known[number]

    def number(self, name: int) -> float | None:
        """The value of a constant; None for others."""
        return self.constants[~name] if name < 0 else None

    def op(self, op: Op, a: int, b: int = 0, c: int = 0) -> int:
        """The name of an operation's value."""
        simpler = self._simpler(op, a, b, c)
        if simpler is not None:
            return simpler
        if op in COMMUTES and b < a:
            a, b = b, a
        if op == Op.MOD and a in self._whole and self.rows[a - INPUTS][0] not in STEPS:
            a = self.op(Op.FLOOR, self.shifted(a, 0.5))  # changes nothing, but that its bounds are one number again
        if op in (Op.LOG, Op.POWER) and self.stays_0(a):  # bounds take 0 for a place alone: see enclosures.LEAST
            there = self._row(op, self.op(Op.MIN, a, self.constant(0.0)), b, c)
            return self.op(Op.CHOOSE, a, there, self._row(op, a, b, c))
        if op == Op.MOD and self.stays_0(b):  # undefined there
            return self.op(Op.CHOOSE, self.op(Op.ABS, b), self._undefined(), self._row(op, a, b, c))
        if op == Op.DIVIDE and (sign := step_functions.sign_of_0(self, b)):  # ∞ there, whose bounds would be everything
            there = self.scaled(self.op(Op.SIGN, a), sign * HUGE)
            if self.stays_0(a):
                there = self.op(Op.CHOOSE, self.op(Op.ABS, a), self._undefined(), there)
            return self.op(Op.CHOOSE, self.op(Op.ABS, b), there, self._row(op, a, b, c))
        return self._row(op, a, b, c)

    def stays_0(self, name: int) -> bool:
        """Whether a value may be 0 all over a region."""
        levels = self.levels(name)
        return levels is None or 0.0 in levels

    def _undefined(self) -> int:
        return self.op(Op.SQRT, self.constant(-1.0))

    def _row(self, op: Op, a: int, b: int, c: int) -> int:
        row = (int(op), a, b, c)
        if row not in self._known:
            self.rows.append(row)
            self._known[row] = INPUTS + len(self.rows) - 1
            self._marked(op, (a, b, c)[: arity(op)])
        return self._known[row]

    def _marked(self, op: Op, used: tuple[int, ...]) -> None:
        """Note whether the last row is whole, and whether it may be flat."""
        name, values = INPUTS + len(self.rows) - 1, used[1:] if op == Op.CHOOSE else used
        if op in STEPS or (op in KEEP_WHOLE and all(a in self._whole or (a < 0 and self.constants[~a].is_integer()) for a in values)):
            self._whole.add(name)
        steep = op not in STEPS and not any(a < 0 or a in self._flat for a in values)
        levels = step_functions.NOWHERE if steep else step_functions.levels(op, [self.levels(a) for a in values])
        if op in (Op.MIN, Op.MAX, Op.CHOOSE, Op.ABS):
            self._ways[name] = frozenset().union(*({a} | self._ways.get(a, frozenset()) for a in values))
        if op == Op.SUBTRACT and (values[0] in self._ways.get(values[1], ()) or values[1] in self._ways.get(values[0], ())):
            levels = step_functions.both(levels, frozenset({0.0}))
        if levels is None or levels:
            self._flat[name] = levels

    def levels(self, name: int) -> Levels:
        """The numbers that a value may be all over a region."""
        return frozenset({self.constants[~name]}) if name < 0 else self._flat.get(name, frozenset())

    def row(self, name: int) -> tuple[Op, int, int]:
        """(operation, first operand, second one) of a value; of a coordinate a copy of itself."""
        return (Op(self.rows[name - INPUTS][0]), *self.rows[name - INPUTS][1:3]) if name >= INPUTS else (Op.COPY, name, 0)

    def is_whole(self, name: int) -> bool:
        """Whether a value is a whole number wherever it is defined."""
        return name in self._whole

    def below(self, a: int, b: int, strictly: bool) -> int:
        """A field that is at most 0 where a ≤ b, or a < b. Where both are equal all over a region it says which, and is never 0."""
        while self.row(a)[0] == Op.EXP == self.row(b)[0]:  # which rise, and are defined everywhere
            a, b = self.row(a)[1], self.row(b)[1]
        against = step_functions.against_own(self, a, b, strictly)
        if against is not None:
            return against
        field = self.subtract(a, b)
        levels = self.levels(field)
        if field < 0:
            holds = self.constants[~field] < 0.0 or (self.constants[~field] == 0.0 and not strictly)
            return self.constant(-1.0 if holds else 1.0)
        if field in self._whole:
            return self.shifted(field, 0.5 if strictly else -0.5)
        return step_functions.parted(self, field, strictly) if self.parted or levels is None or 0.0 in levels else field

    def zero(self, whole: int) -> int:
        """A field that is at most 0 where a whole number is 0."""
        return self.shifted(self.op(Op.ABS, whole), -0.5)

    def _simpler(self, op: Op, a: int, b: int, c: int) -> int | None:
        used = (a, b, c)[: arity(op)]
        if all(name < 0 for name in used):
            value = fold(op, *(self.constants[~name] for name in used))
            if math.isfinite(value):
                return self.constant(value)
        x, y = self.number(a), self.number(b) if len(used) > 1 else None
        if op == Op.ADD and (x == 0.0 or y == 0.0):
            return b if x == 0.0 else a
        if op == Op.SUBTRACT and y == 0.0:
            return a
        if op == Op.SUBTRACT and x == 0.0:
            return self.op(Op.NEGATE, b)
        if op == Op.NEGATE and a >= INPUTS and self.rows[a - INPUTS][0] == Op.NEGATE:
            return self.rows[a - INPUTS][1]
        if op == Op.MULTIPLY and (x == 1.0 or y == 1.0):
            return b if x == 1.0 else a
        if op == Op.MULTIPLY and a == b:
            return self.op(Op.SQUARE, a)
        if op == Op.MULTIPLY and (self.row(a)[:2] == (Op.SQUARE, b) or self.row(b)[:2] == (Op.SQUARE, a)):
            return self.op(Op.CUBE, b if self.row(a)[:2] == (Op.SQUARE, b) else a)
        if op == Op.MULTIPLY and (x == -1.0 or y == -1.0):
            return self.op(Op.NEGATE, b if x == -1.0 else a)
        if op in (Op.ADD, Op.SUBTRACT) and (shared := self._shared(a, b)):
            factor, one, other = shared
            return self.op(Op.MULTIPLY, factor, self.op(op, one, other))  # whose bounds are never wider
        if op == Op.DIVIDE and y is not None and y != 0.0 and math.frexp(y)[0] in (0.5, -0.5):
            return self.op(Op.MULTIPLY, a, self.constant(1.0 / y))  # by a power of two: exact
        if op in (Op.MIN, Op.MAX) and a == b:
            return a
        if op in (Op.MIN, Op.MAX) and self._opposite(a, b):
            size = self.op(Op.ABS, b if self.row(a)[0] == Op.NEGATE else a)
            return size if op == Op.MAX else self.op(Op.NEGATE, size)
        if op == Op.CHOOSE and c >= INPUTS and self.rows[c - INPUTS][:2] == (Op.CHOOSE, a):
            return self.op(Op.CHOOSE, a, b, self.rows[c - INPUTS][3])
        if op == Op.SQRT and self.row(a)[0] == Op.SQUARE:
            return self.op(Op.ABS, self.row(a)[1])
        if op == Op.DIVIDE and (self.row(b)[:2] == (Op.ABS, a) or self.row(a)[:2] == (Op.ABS, b)):
            of = a if self.row(b)[:2] == (Op.ABS, a) else b
            return None if self.stays_0(of) else self.op(Op.SIGN, of)
        return None

    def _shared(self, a: int, b: int) -> tuple[int, int, int] | None:
        """(what two products share, the rest of one, of the other), unless it is a constant: others may be equal by chance."""
        one, other = self.row(a), self.row(b)
        if one[0] == Op.MULTIPLY == other[0]:
            for k, m in ((1, 1), (1, 2), (2, 1), (2, 2)):
                if one[k] == other[m] >= 0:
                    return one[k], one[3 - k], other[3 - m]
        return None

    def _opposite(self, a: int, b: int) -> bool:
        """Whether one value is the other's negative, to the bit."""
        one, other = self.row(a), self.row(b)
        turned = one[0] == Op.SUBTRACT and other == (Op.SUBTRACT, one[2], one[1])
        if shared := self._shared(a, b):
            turned = self._opposite(*shared[1:])
        return turned or one[:2] == (Op.NEGATE, b) or other[:2] == (Op.NEGATE, a)

    # --- what is made of several operations ---

    def add(self, a: int, b: int) -> int:
        return self.op(Op.ADD, a, b)

    def subtract(self, a: int, b: int) -> int:
        return self.op(Op.SUBTRACT, a, b)

    def multiply(self, a: int, b: int) -> int:
        return self.op(Op.MULTIPLY, a, b)

    def scaled(self, a: int, factor: float) -> int:
        return self.op(Op.MULTIPLY, a, self.constant(factor))

    def shifted(self, a: int, by: float) -> int:
        return self.op(Op.ADD, a, self.constant(by))

    def power(self, a: int, b: int) -> int:
        """a to the b: products for whole b, roots for b = ½."""
        exponent = self.number(b)
        if exponent == 0.5:
            return self.op(Op.SQRT, a)
        if exponent is None or exponent != int(exponent) or not abs(exponent) <= MOST_FACTORS or exponent == 0.0:
            return self.op(Op.POWER, a, b)
        product, square, left = None, a, abs(int(exponent))
        while left % 3 == 0:
            square, left = self.op(Op.CUBE, square), left // 3
        while left:
            if left & 1:
                product = square if product is None else self.multiply(product, square)
            left >>= 1
            square = self.op(Op.SQUARE, square) if left else square
        assert product is not None
        return product if exponent > 0 else self.op(Op.DIVIDE, self.constant(1.0), product)

    def several(self, op: Op, names: Sequence[int]) -> int:
        """MIN, MAX or HYPOT of any number of values."""
        found = names[0]
        for name in names[1:]:
            found = self.op(op, found, name)
        return self.op(Op.ABS, found) if op == Op.HYPOT and len(names) == 1 else found

    def linear(self, terms: Sequence[tuple[float, int]], offset: float = 0.0) -> int:
        """Σ factor · value + offset."""
        total = None
        for factor, name in terms:
            if factor:
                part = self.scaled(name, factor)
                total = part if total is None else self.add(total, part)
        return self.constant(offset) if total is None else self.shifted(total, offset)

    def inlined(self, tape: Tape, inputs: Sequence[int]) -> tuple[int, ...]:
        """Another tape's results with other values for x, y and z."""
        names = list(inputs)

        def of(name: int) -> int:
            return names[name] if name >= 0 else self.constant(tape.constants[~name])

        for op, *operands in tape.code.tolist():
            names.append(self.op(Op(op), *(of(name) for name in operands[: arity(op)])))
        return tuple(of(name) for name in tape.results)

    def formula(self, formula: Formula, inputs: Sequence[int] = (X, Y, Z), exact: bool = False) -> tuple[int, ...]:
        """The values of a formula of numbers; a truth value becomes a field that is at most 0 where it holds. Raises Unfit: of
        equality, unless `exact`."""
        reader = _Reader(self, formula, inputs)
        return tuple(reader.field(i, exact=exact) if formula.kind == "truth" else reader.number(i) for i in formula.results)

    def _ordered(self, results: Sequence[int]) -> tuple[list[int], set[int]]:
        """(rows that results need, in their order; all names that they need): of a row's operands that which keeps most values goes first
        (Sethi and Ullman, "The Generation of Optimal Code for Arithmetic Expressions", Journal of the ACM 1970)."""
        operands = [row[1 : 1 + arity(row[0])] for row in self.rows]
        keeps = [0] * INPUTS
        for used in operands:
            most = 1
            for i, count in enumerate(sorted([keeps[name] for name in used if name >= INPUTS], reverse=True)):
                most = max(most, count + i)
            keeps.append(most)
        kept: list[int] = []
        needed: set[int] = set()
        waiting = [(name, False) for name in reversed(results)]
        while waiting:
            name, ready = waiting.pop()
            if ready:
                kept.append(name)
            elif name not in needed:
                needed.add(name)
                if name >= INPUTS:
                    waiting.append((name, True))
                    used = operands[name - INPUTS]
                    if len(used) > 1:
                        used = sorted(used, key=lambda name: keeps[name] if name >= 0 else 0)
                    waiting += [(operand, False) for operand in used]
        return kept, needed

    def finish(self, *results: int) -> Tape:
        """The tape of these values: of code and constants only what they need, in an order in which few values wait for others."""
        kept, needed = self._ordered(results)
        place = {X: X, Y: Y, Z: Z} | {name: INPUTS + i for i, name in enumerate(kept)}
        numbers = sorted((name for name in needed if name < 0), reverse=True)
        place |= {name: ~k for k, name in enumerate(numbers)}
        rows = []
        for name in kept:
            op, *operands = self.rows[name - INPUTS]
            used = [place[operand] for operand in operands[: arity(op)]]
            rows.append((op, *used, *[0] * (3 - len(used))))
        constants = np.array([self.constants[~name] for name in numbers], np.float64)
        code = np.array(rows, np.int32).reshape(-1, 4)
        tape = Tape(code, constants, tuple(place[name] for name in results))
        for i in np.flatnonzero(code[:, 0] == Op.ATAN2).tolist():
            if _cut_is_hidden(tape, INPUTS + i):
                code[i, 0] = Op.ANGLE
        return tape


def most_live(tape: Tape) -> int:
    """How many values have to be kept at a time, x, y and z among them."""
    last: dict[int, int] = {name: len(tape.code) for name in tape.results}
    for i, (op, *operands) in enumerate(tape.code.tolist()):
        for name in operands[: arity(op)]:
            last[name] = max(last.get(name, 0), i)
    ends = np.bincount([last.get(INPUTS + i, i) for i in range(len(tape.code))], minlength=len(tape.code) + 1)[: len(tape.code)]
    return INPUTS + int((np.arange(1, len(tape.code) + 1) - np.concatenate([[0], np.cumsum(ends)[:-1]])).max(initial=0))


_SAME = {
    "add": Op.ADD, "subtract": Op.SUBTRACT, "multiply": Op.MULTIPLY, "divide": Op.DIVIDE, "negate": Op.NEGATE, "abs": Op.ABS,
    "sqrt": Op.SQRT, "exp": Op.EXP, "log": Op.LOG, "sin": Op.SIN, "cos": Op.COS, "tan": Op.TAN, "asin": Op.ASIN, "acos": Op.ACOS,
    "atan": Op.ATAN, "atan2": Op.ATAN2, "hypot": Op.HYPOT, "min": Op.MIN, "max": Op.MAX, "floor": Op.FLOOR, "ceil": Op.CEIL,
    "mod": Op.MOD, "sign": Op.SIGN,
}  # fmt: skip
EVERYWHERE = "both sides of this `==` are equal all over a region: that is no surface", "write <= for the solid that it is"
NO_INSIDE = "this relation holds on a surface alone, which has no inside", "write how thick it is to be, like abs(y) <= 0.01"
_OPPOSITE = {"less": "at_least", "at_most": "greater", "greater": "at_most", "at_least": "less"}


class _Reader:
    """Translates the nodes of one formula."""

    def __init__(self, builder: Builder, formula: Formula, inputs: Sequence[int]) -> None:
        self.builder, self.formula, self.inputs = builder, formula, inputs
        self.values: list[int | None] = []
        self._fields: dict[tuple[int, bool, bool], int] = {}
        for node in formula.nodes:  # in the order to do them: no recursion, however deep
            self.values.append(self._value(node))

    def number(self, index: int) -> int:
        found = self.values[index]
        assert found is not None
        return found

    def _value(self, node: Node) -> int | None:
        """The name of a number's value; None for truth values, which become fields where they are asked for."""
        b = self.builder
        if node.op == "constant":
            return None if isinstance(node.value, bool) else b.constant(node.value)
        if node.op == "parameter":
            if int(node.value) >= len(self.inputs):
                raise Unfit("a surface's formula has three parameters, x, y and z", "write |x, y, z| …")
            return self.inputs[int(node.value)]
        given = [self.values[i] for i in node.args]
        if node.op == "select":
            return None if None in given[1:] else b.op(Op.CHOOSE, self.field(node.args[0], exact=True), given[1], given[2])  # type: ignore[arg-type]
        if any(name is None for name in given):
            return None
        names: list[int] = given  # type: ignore[assignment]
        if node.op == "power":
            return b.power(*names)
        if node.op == "divide":
            return factor_cancellation.divided(b, *names)
        if node.op == "mod":
            return factor_cancellation.remaindered(b, *names)
        if node.op == "round":
            return b.op(Op.FLOOR, b.shifted(names[0], 0.5))
        if node.op == "noise":
            return b.op(Op.NOISE, *(names + [b.constant(0.0)] * (3 - len(names))))
        if node.op in ("min", "max", "hypot"):
            return b.several(_SAME[node.op], names)
        return b.op(_SAME[node.op], *names) if node.op in _SAME else None

    def of_truths(self, node: Node) -> bool:
        """Whether it compares truth values, not numbers."""
        return self.values[node.args[0]] is None

    def field(self, index: int, negated: bool = False, exact: bool = False) -> int:
        """A number that is at most 0 where a truth value holds, and undefined where what it compares is.

        Where it is 0 the truth value may be either, for whether a surface belongs to a solid is nothing that can be seen; over no region is
        it 0 because of steps. Equality of numbers holds nowhere else, and is refused unless `exact`: in what is asked at points, not a
        surface.
        """
        key = index, negated, exact
        if key not in self._fields:
            self._fields[key] = self._field(self.formula.nodes[index], negated, exact)
        return self._fields[key]

    def _field(self, node: Node, negated: bool, exact: bool) -> int:
        b = self.builder
        if node.op == "constant":
            return b.constant(-1.0 if bool(node.value) != negated else 1.0)
        if node.op == "not":
            return self.field(node.args[0], not negated, exact)
        if node.op in ("and", "or"):
            both = (node.op == "and") != negated
            return b.op(Op.MAX if both else Op.MIN, *(self.field(i, negated, exact) for i in node.args))
        if node.op == "select":
            condition = self.field(node.args[0], exact=True)
            return b.op(Op.CHOOSE, condition, self.field(node.args[1], negated, exact), self.field(node.args[2], negated, exact))
        if node.op in _OPPOSITE:
            how = _OPPOSITE[node.op] if negated else node.op
            left, right = (self.number(i) for i in node.args)
            strictly = how in ("less", "greater")
            found = b.below(left, right, strictly) if how in ("less", "at_most") else b.below(right, left, strictly)
            if not strictly or exact:
                return found
            inside = regularize.with_inside(b, found)[0]  # what holds on sheets alone is no part of it
            return b.constant(1.0) if inside is None else inside
        if self.of_truths(node):
            first, second = node.args
            alike = (node.op == "equal") != negated
            both = b.op(Op.MAX, self.field(first, False, exact), self.field(second, not alike, exact))
            neither = b.op(Op.MAX, self.field(first, True, exact), self.field(second, alike, exact))
            return b.op(Op.MIN, both, neither)
        difference, equal = b.subtract(*(self.number(i) for i in node.args)), (node.op == "equal") != negated
        if b.is_whole(difference):
            return b.zero(difference) if equal else b.op(Op.NEGATE, b.zero(difference))
        if exact:
            apart = b.op(Op.ABS, difference)
            return apart if equal else b.op(Op.CHOOSE, apart, b.constant(1.0), b.constant(-1.0))
        sign = "==" if equal else "!="
        raise Unfit(
            f"`{sign}` cannot be part of a larger relation: it holds on a surface, which has no inside",
            "write an inequality there, like abs(a - b) <= 0.01",
        )


class Surface(NamedTuple):
    """The field of a relation, and whether it is a sheet (`==`, but of whole numbers, or what is never below 0 at most 0); else it is a
    solid, where its field is at most 0. `left_out`: the relation holds on sheets besides, too, where a square in a product is 0."""

    tape: Tape
    sheet: bool
    left_out: bool = False


def surface(formula: Formula, parted: bool = False) -> Surface:
    """What a relation is. With `parted` both sides are known to be equal all over a region: see Builder. Raises Unfit."""
    if len(formula.parameters) != 3:
        raise Unfit(f"a surface's formula has three parameters, x, y and z, not {len(formula.parameters)}", "write |x, y, z| …")
    if formula.kind != "truth":
        message = f"a surface's formula is a relation, and this one gives a {formula.kind}"
        raise Unfit(message, "write … <= 0 for a solid, … == 0 for a sheet")
    builder = Builder(parted=parted)
    top = formula.nodes[formula.results[0]]
    reader = _Reader(builder, formula, (X, Y, Z))
    if top.op == "equal" and not reader.of_truths(top):
        found = builder.subtract(*(reader.number(i) for i in top.args))
        if builder.is_whole(found):
            return Surface(builder.finish(builder.zero(found)), False)
        if parted:
            raise Unfit(*EVERYWHERE)
    else:
        found = reader.field(formula.results[0])
        if parted:
            return Surface(builder.finish(found), False)
        if top.op not in ("at_most", "at_least") or not _never_below(builder, found):
            solid, left_out = regularize.with_inside(builder, found)
            if solid is None:
                raise Unfit(*NO_INSIDE)
            return Surface(builder.finish(solid), False, left_out)
    found = _without_squares(builder, found)
    levels = builder.levels(found)
    if levels is not None and 0.0 in levels:
        raise Unfit(*EVERYWHERE)
    if builder.row(found)[0] == Op.MOD:
        hint = "half a period on it passes through what it is compared with: mod(a + b / 2, b) == b / 2"
        raise Unfit("a `mod` that is compared with 0 jumps where it is 0, and passes through it nowhere", hint)
    return Surface(builder.finish(found), True)


_NEVER_BELOW = frozenset({Op.SQUARE, Op.ABS, Op.SQRT, Op.HYPOT})


def _never_below(builder: Builder, name: int) -> bool:
    """Whether a value is a square, magnitude or root, or a product or the least of such; HYPOT is 0 on no surface."""
    waiting = [name]
    while waiting:
        op, a, b = builder.row(waiting.pop())
        if op in (Op.MULTIPLY, Op.MIN):
            waiting += [a, b]
        elif op not in (Op.SQUARE, Op.ABS, Op.SQRT):
            return False
    return True


def _without_squares(builder: Builder, found: int) -> int:
    """A field that is 0 at the same points, with a sign that changes there.

    Of products' factors, squares and magnitudes have none; a least of such is 0 where any of them is, as their product; a root is 0 where
    what it is of is.
    """
    factors: dict[int, None] = {}
    waiting = [found]
    while waiting:
        name = waiting.pop()
        op, a, b, _ = builder.rows[name - INPUTS] if name >= INPUTS else (Op.COPY, 0, 0, 0)
        if name >= INPUTS and op in (Op.SQUARE, Op.CUBE, Op.ABS, Op.NEGATE):
            waiting.append(a)
        elif op == Op.MULTIPLY or (op == Op.MIN and all(builder.row(part)[0] in _NEVER_BELOW for part in (a, b))):
            waiting += [b, a]
        elif op == Op.SQRT and name == found:
            waiting.append(a)
        elif builder.number(name) in (None, 0.0):
            factors[name] = None
    first, *others = factors or {found: None}
    for other in others:
        first = builder.multiply(first, other)
    return first


def _cut_is_hidden(tape: Tape, angle: int) -> bool:
    """Whether adding 2π to one value changes no result: it goes into sines and cosines alone, times whole numbers."""
    share: dict[int, float] = {angle: 1.0}
    for i, (op, *operands) in enumerate(tape.code.tolist()):
        used = operands[: arity(op)]
        if not any(name in share for name in used):
            continue
        numbers = [float(tape.constants[~name]) if name < 0 else None for name in used]
        if op in (Op.SIN, Op.COS):
            if share[used[0]] != round(share[used[0]]):
                return False
            continue
        if op in (Op.NEGATE, Op.COPY):
            found = -share[used[0]] if op == Op.NEGATE else share[used[0]]
        elif op in (Op.ADD, Op.SUBTRACT):
            found = share.get(used[0], 0.0) + share.get(used[1], 0.0) * (1.0 if op == Op.ADD else -1.0)
        elif op == Op.MULTIPLY and (numbers[0] is not None or numbers[1] is not None):
            turned = numbers[0] is not None
            found = share[used[1] if turned else used[0]] * float((numbers[0] if turned else numbers[1]) or 0.0)
        elif op == Op.DIVIDE and numbers[1]:
            found = share[used[0]] / numbers[1]
        else:
            return False
        share[INPUTS + i] = found
    return not any(name in share for name in tape.results)
