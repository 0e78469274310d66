"""Expression graphs of formulas: the operations of `|x, y, z| …`, which later stages compile.

The evaluator calls the function with terms in place of numbers and records its arithmetic. Constants are folded, equal operations
are shared, and calls of functions of the scene are inlined.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from .diagnostics import Span
from .elements import Element
from .limits import MAX_APPLIED, MAX_TERMS, Exhausted
from .noise import noise


def sign(a: float) -> float:
    """-1, 0 or 1."""
    return 0.0 if a == 0 else math.copysign(1.0, a)


def round_half_up(a: float) -> float:
    """The nearest integer; of two, the larger."""
    return float(math.floor(a + 0.5))


def modulo(a: float, b: float) -> float:
    """a − b·⌊a/b⌋ in floating point, as in compiled formulas: mod(1, 0.1) is 0. The exact remainder would be nearly 0.1."""
    turns = a / b
    return a - b * math.floor(turns) if math.isfinite(turns) else a % b


def angle(y: float, x: float) -> float:
    """atan2 with −0 as 0."""
    return math.atan2(y + 0.0, x + 0.0)


# Every operation of a formula, on plain numbers and truth values. They raise outside their domain.
OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "power": math.pow,
    "negate": operator.neg,
    "abs": abs,
    "sqrt": math.sqrt,
    "exp": math.exp,
    "log": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": angle,
    "hypot": math.hypot,
    "min": min,
    "max": max,
    "floor": lambda a: float(math.floor(a)),
    "ceil": lambda a: float(math.ceil(a)),
    "round": round_half_up,
    "mod": modulo,
    "sign": sign,
    "noise": noise,
    "less": operator.lt,
    "at_most": operator.le,
    "greater": operator.gt,
    "at_least": operator.ge,
    "equal": operator.eq,
    "unequal": operator.ne,
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": operator.not_,
    "select": lambda c, a, b: a if c else b,
}
TRUTHS = frozenset({"less", "at_most", "greater", "at_least", "equal", "unequal", "and", "or", "not"})

# Operations that only patterns of materials have: channels of a looked-up picture, and MaterialX's noise, whose values are those of its
# nodes noise2d, noise3d and cellnoise (compiler/texture_graph/noise.py).
CHANNELS = ("red", "green", "blue", "alpha")
NOISES = ("perlin", "perlin_r", "perlin_g", "perlin_b", "cellnoise", "cellnoise_r", "cellnoise_g", "cellnoise_b")
PATTERN_OPERATIONS = frozenset({*CHANNELS, *NOISES})
PATTERN_INPUTS = (("u", "v"), ("x", "y", "z"), ("x", "y", "z", "u", "v"), ("x", "y", "z", "u", "v", "nx", "ny", "nz"))
"""What the parameters of a pattern are, by their number: the point, texture coordinates, and the normal."""


@dataclass(frozen=True, slots=True)
class Node:
    """One operation: `args` are indices of earlier nodes. `constant` has its `value`; `parameter` has its index as `value`.

    A channel of a picture has the picture's index in `Formula.pictures` as `value`.
    """

    op: str
    args: tuple[int, ...] = ()
    value: float | bool = 0.0


@dataclass(frozen=True, slots=True)
class Formula:
    """A function of plain numbers as a list of operations in evaluation order.

    parameters  their names, in order
    nodes       the operations; each uses earlier ones only
    results     indices of the result nodes: one, or one for each item of a list or channel of a colour
    kind        type of the result: "number", "truth", "list" or "color"
    unit        metres in one unit of its coordinates (the unit of the file it is written in)
    span        its place in the source
    pictures    the image elements that it looks up
    """

    parameters: tuple[str, ...]
    nodes: tuple[Node, ...]
    results: tuple[int, ...]
    kind: str
    unit: float
    span: Span
    pictures: tuple[Element, ...] = ()


def evaluate(formula: Formula, values: Sequence[float]) -> Any:
    """The formula's value at `values`: a number, a truth value, or a tuple. Outside its domain nan, or ±inf for x / 0."""
    done: list[Any] = []
    for node in formula.nodes:
        if node.op == "constant":
            done.append(node.value)
        elif node.op == "parameter":
            done.append(float(values[int(node.value)]))
        else:
            done.append(_apply(node.op, [done[i] for i in node.args]))
    results = tuple(done[i] for i in formula.results)
    return results if formula.kind in ("list", "color") else results[0]


def _apply(op: str, args: list[Any]) -> Any:
    """An operation with IEEE 754 results outside its domain. Never raises."""
    try:
        return OPERATIONS[op](*args)
    except ZeroDivisionError:
        return math.copysign(math.inf, args[0]) * math.copysign(1.0, args[1]) if op == "divide" and args[0] else math.nan
    except OverflowError:
        return math.inf
    except ValueError:
        return -math.inf if op == "log" and args[0] == 0 else math.nan


class Term:
    """A number or truth value in a formula during recording."""

    __slots__ = ("args", "graph", "index", "op", "value")

    def __init__(self, graph: Graph, index: int, op: str, args: tuple[Term, ...], value: float | bool) -> None:
        self.graph = graph
        self.index = index
        self.op = op
        self.args = args
        self.value = value

    @property
    def truth(self) -> bool:
        """Whether it is a truth value, not a number."""
        if self.op == "select":
            return self.args[1].truth
        return self.op in TRUTHS or (self.op == "constant" and isinstance(self.value, bool))


class Graph:
    """The terms of one formula, without duplicates. `unit` is the metres in one unit of its coordinates."""

    def __init__(self, unit: float) -> None:
        self.unit = unit
        self.terms: list[Term] = []
        self.pictures: list[Element] = []
        self._known: dict[tuple[object, ...], Term] = {}
        self._applied = 0  # operations so far, equal ones counted each time

    def constant(self, value: float | bool) -> Term:
        return self._term("constant", (), value)

    def parameter(self, index: int) -> Term:
        return self._term("parameter", (), float(index))

    def apply(self, op: str, *args: Term) -> Term:
        """The term of `op`; a constant if all arguments are constants within its domain. Raises Exhausted."""
        self._applied += 1
        if self._applied > MAX_APPLIED:
            message = f"the formula has more than {MAX_APPLIED:,} operations, equal ones counted each time"
            raise Exhausted(message, "bind repeated parts with `let`")
        if op in OPERATIONS and all(a.op == "constant" for a in args):
            try:
                value = OPERATIONS[op](*(a.value for a in args))
            except (ArithmeticError, ValueError):
                value = math.nan
            if math.isfinite(value):
                return self.constant(value if isinstance(value, bool) else float(value))
        if op == "select" and args[0].op == "constant":
            return args[1] if args[0].value else args[2]
        return self._term(op, args, 0.0)

    def look_up(self, picture: Element, u: Term, v: Term) -> list[Term]:
        """Red, green, blue and alpha of a picture at u and v."""
        if picture not in self.pictures:
            self.pictures.append(picture)
        number = float(self.pictures.index(picture))
        return [self._term(channel, (u, v), number) for channel in CHANNELS]

    def inline(self, formula: Formula, arguments: Sequence[Term]) -> list[Term]:
        """The results of another formula whose parameters have these values."""
        terms: list[Term] = []
        for node in formula.nodes:
            if node.op == "constant":
                terms.append(self.constant(node.value))
            elif node.op == "parameter":
                terms.append(arguments[int(node.value)])
            elif node.op in CHANNELS:
                texel = self.look_up(formula.pictures[int(node.value)], *[terms[i] for i in node.args])
                terms.append(texel[CHANNELS.index(node.op)])
            else:
                terms.append(self.apply(node.op, *[terms[i] for i in node.args]))
        return [terms[i] for i in formula.results]

    def _term(self, op: str, args: tuple[Term, ...], value: float | bool) -> Term:
        key = (op, value, *[a.index for a in args]) if args else (op, type(value), value, math.copysign(1.0, value))
        term = self._known.get(key)
        if term is None:
            if len(self.terms) >= MAX_TERMS:
                raise Exhausted(f"the formula has more than {MAX_TERMS:,} operations")
            term = Term(self, len(self.terms), op, args, value)
            self.terms.append(term)
            self._known[key] = term
        return term

    def formula(self, parameters: tuple[str, ...], results: Sequence[Term], kind: str, span: Span) -> Formula:
        """The formula with the terms that its results depend on."""
        needed: set[int] = set()
        stack = list(results)
        while stack:
            term = stack.pop()
            if term.index not in needed:
                needed.add(term.index)
                stack.extend(term.args)
        place = {index: i for i, index in enumerate(sorted(needed))}
        nodes = tuple(Node(t.op, tuple(place[a.index] for a in t.args), t.value) for t in self.terms if t.index in needed)
        return Formula(parameters, nodes, tuple(place[t.index] for t in results), kind, self.unit, span, tuple(self.pictures))
