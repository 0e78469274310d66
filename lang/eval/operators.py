"""Arithmetic and comparison of values, with dimension checks and recording of formulas."""

from __future__ import annotations

import math
from collections.abc import Callable

from .. import limits, units
from ..elements import Element
from ..formula_graph import OPERATIONS, Graph, Term
from ..units import Dimension, Quantity
from .context import Scope
from .values import Color, ForeignNumber, Mistake, Value, kind

_SYMBOLS = {"add": "+", "subtract": "-", "less": "<", "at_most": "<=", "greater": ">", "at_least": ">=", "equal": "==", "unequal": "!="}


_NUMBERS = (float, Quantity)


def is_scalar(value: Value) -> bool:
    """Whether a value is a number, a quantity or a number of a formula."""
    return isinstance(value, _NUMBERS) or (isinstance(value, Term) and not value.truth)


def split(value: float | Quantity) -> tuple[float, Dimension]:
    """The value in base units and the dimension."""
    return (value.value, value.dimension) if isinstance(value, Quantity) else (value, units.NONE)


def check_finite(value: float, dimension: Dimension = units.NONE) -> float | Quantity:
    """A result as a float or Quantity. Raises Mistake if it is infinite or nan."""
    if not math.isfinite(value):
        raise Mistake("the result is too large for a number")
    return units.quantity(float(value), dimension)


def bare_number_error(value: float, dimension: Dimension) -> Mistake:
    """The error for a bare number in place of a quantity."""
    number = units.show_number(value)
    write = {units.ANGLE: ("deg", "rad"), units.TIME: ("s",), **{d: (u,) for d, u in units.QUANTITIES.values() if d[3]}}.get(dimension, ())
    if dimension == units.ANGLE and abs(value) > 2 * math.pi:
        write = ("deg",)  # more than a turn in radians is not meant
    hint = "write " + " or ".join(number + unit for unit in write) if write else f"give it a unit: {units.symbol(dimension)}"
    return Mistake(f"expected {units.name(dimension)}, got the bare number {number}", hint)


def unify(a: float | Quantity, b: float | Quantity, scope: Scope, doing: str) -> tuple[float, float, Dimension]:
    """Two numbers and their common dimension. 0 has every dimension; a bare number next to a length is in the unit of the file."""
    if type(a) is float and type(b) is float:
        return a, b, units.NONE
    x, da = split(a)
    y, db = split(b)
    if da == db:
        return x, y, da
    if da == units.NONE:
        return bare(x, db, scope), y, db
    if db == units.NONE:
        return x, bare(y, da, scope), da
    raise Mistake(f"cannot {doing} {kind(a)} and {kind(b)}")


def bare(value: float, dimension: Dimension, scope: Scope) -> float:
    """A bare number as a quantity of `dimension`, in base units. Raises Mistake."""
    if dimension == units.LENGTH and isinstance(value, ForeignNumber):
        return value.metres
    if value == 0:
        return 0.0
    if dimension == units.LENGTH:
        return split(check_finite(units.scale(value, scope.unit)))[0]
    if dimension == units.ANGLE and scope.plain:
        return value
    raise bare_number_error(value, dimension)


def unify_all(numbers: list[float | Quantity], scope: Scope, doing: str) -> tuple[list[float], Dimension]:
    """Any count of numbers and their common dimension."""
    dimension = next((n.dimension for n in numbers if isinstance(n, Quantity)), units.NONE)
    sample = units.quantity(0.0, dimension)
    return [unify(n, sample, scope, doing)[0] for n in numbers], dimension


def combine(op: str, numbers: list[float | Quantity], scope: Scope) -> float | Quantity:
    """A minimum, maximum or norm: an operation whose result has the dimension of its numbers."""
    values, dimension = unify_all(numbers, scope, "compare")
    result = OPERATIONS[op](*values)
    if dimension == units.NONE and any(isinstance(n, ForeignNumber) for n in values):
        return foreign_number(result, OPERATIONS[op](*[bare(n, units.LENGTH, scope) for n in values]))
    return check_finite(result, dimension)


def foreign_number(value: float, metres: float) -> ForeignNumber:
    """The result of an operation on numbers from a file with another unit."""
    return ForeignNumber(split(check_finite(value))[0], split(check_finite(metres))[0])


# --- formulas -------------------------------------------------------------------------------------------------------


def lift(graph: Graph, value: Value) -> Term:
    """A value as a term of `graph`: lengths in the unit of the graph, angles in radians, the rest in base units."""
    if isinstance(value, Term):
        if value.graph is not graph:
            raise Mistake("a formula cannot use the arguments of another formula")
        return value
    if isinstance(value, ForeignNumber):
        return graph.constant(value.metres / graph.unit)
    if isinstance(value, bool | float):
        return graph.constant(value)
    if isinstance(value, Quantity):
        try:
            return graph.constant(split(check_finite(value.value / graph.unit ** value.dimension[0]))[0])
        except ArithmeticError:
            raise Mistake("the result is too large for a number") from None
    raise Mistake(f"expected a number, got {kind(value)}")


def record(op: str, *args: Value) -> Term:
    """The term of `op` on values of which at least one is a term."""
    graph = next(a.graph for a in args if isinstance(a, Term))
    return graph.apply(op, *[lift(graph, a) for a in args])


def graph_of(scope: Scope, *args: Value) -> Graph | None:
    """The graph of the formula that is recorded here: that of a term, or inside of a function the one of the evaluator."""
    terms = (a.graph for a in args if isinstance(a, Term))
    return next(terms, scope.evaluator.graph if scope.plain else None)


def has_term(*args: Value) -> bool:
    """Whether a value is a term."""
    for a in args:  # noqa: SIM110 (called for every operation)
        if isinstance(a, Term):
            return True
    return False


# --- arithmetic -----------------------------------------------------------------------------------------------------


def add(a: Value, b: Value, scope: Scope) -> Value:
    """`a + b` of numbers, lists, colours or strings. Raises Mistake, as all operators."""
    return _sum("add", a, b, scope)


def subtract(a: Value, b: Value, scope: Scope) -> Value:
    """`a - b` of numbers, lists or colours."""
    return _sum("subtract", a, b, scope)


def _sum(op: str, a: Value, b: Value, scope: Scope) -> Value:
    if is_scalar(a) and is_scalar(b):
        if has_term(a, b):
            return record(op, a, b)
        x, y, dimension = unify(a, b, scope, op)
        if dimension == units.NONE and (isinstance(a, ForeignNumber) or isinstance(b, ForeignNumber)):
            return foreign_number(OPERATIONS[op](x, y), OPERATIONS[op](bare(x, units.LENGTH, scope), bare(y, units.LENGTH, scope)))
        return check_finite(OPERATIONS[op](x, y), dimension)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return _elementwise(op, a, b, scope)
    if isinstance(a, Color) and isinstance(b, Color):
        return Color(*[_sum(op, x, y, scope) for x, y in zip(a.channels, b.channels, strict=True)])
    if op == "add" and isinstance(a, str) and isinstance(b, str):
        limits.check_text(len(a) + len(b))
        return a + b
    if op == "add" and (isinstance(a, str) or isinstance(b, str)):
        raise Mistake(f"cannot add {kind(a)} and {kind(b)}", "write string(…) to make a string of it")
    both = isinstance(a, Element) and isinstance(b, Element)
    hint = f"solids are combined as {'union' if op == 'add' else 'difference'} {{ …; … }}" if both else ""
    raise Mistake(f"cannot {op} {kind(a)} and {kind(b)}", hint)


def _elementwise(op: str, a: tuple[Value, ...], b: tuple[Value, ...], scope: Scope) -> Value:
    if len(a) != len(b):
        hint = "`+` adds item by item; write concat(a, b) to join them" if op == "add" else ""
        raise Mistake(f"cannot {op} a list of {len(a)} and a list of {len(b)}", hint)
    scope.meter.step(len(a))
    return tuple([_sum(op, x, y, scope) for x, y in zip(a, b, strict=True)])


def multiply(a: Value, b: Value, scope: Scope) -> Value:
    """`a * b` of numbers, of a number and a list or colour, or of colours."""
    if is_scalar(a) and is_scalar(b):
        if has_term(a, b):
            return record("multiply", a, b)
        x, da = split(a)
        y, db = split(b)
        if da == db == units.NONE and isinstance(a, ForeignNumber):
            return foreign_number(x * y, a.metres * y)
        if da == db == units.NONE and isinstance(b, ForeignNumber):
            return foreign_number(x * y, x * b.metres)
        return check_finite(x * y, units.multiply(da, db))
    if is_scalar(b):
        a, b = b, a
    if is_scalar(a) and isinstance(b, tuple):
        scope.meter.step(len(b))
        return tuple([multiply(a, v, scope) for v in b])
    if isinstance(b, Color) and (is_scalar(a) or isinstance(a, Color)):
        factors = a.channels if isinstance(a, Color) else (a, a, a)
        return Color(*[_channel(multiply(f, c, scope)) for f, c in zip(factors, b.channels, strict=True)])
    if isinstance(a, tuple) and isinstance(b, tuple):
        raise Mistake("cannot multiply a list and a list", "write dot(a, b) or cross(a, b)")
    raise Mistake(f"cannot multiply {kind(a)} and {kind(b)}")


def divide(a: Value, b: Value, scope: Scope) -> Value:
    """`a / b` of a number, list or colour and a number."""
    if not is_scalar(b):
        raise Mistake(f"cannot divide {kind(a)} by {kind(b)}")
    if is_scalar(a):
        if has_term(a, b):
            if not has_term(b) and split(b)[0] == 0:
                raise Mistake("division by 0", "a formula that divides by 0 has no values: divide by another number")
            return record("divide", a, b)
        x, da = split(a)
        y, db = split(b)
        if y == 0:
            raise Mistake("division by 0")
        if db == units.NONE and isinstance(a, ForeignNumber):
            return foreign_number(x / y, a.metres / y)
        return check_finite(x / y, units.divide(da, db))
    if isinstance(a, tuple):
        scope.meter.step(len(a))
        return tuple([divide(v, b, scope) for v in a])
    if isinstance(a, Color):
        return Color(*[_channel(divide(c, b, scope)) for c in a.channels])
    raise Mistake(f"cannot divide {kind(a)} by {kind(b)}")


def _channel(value: Value) -> Value:
    if isinstance(value, Quantity):
        raise Mistake(f"a colour can only be multiplied by plain numbers, not by {kind(value)}")
    return value


def power(a: Value, b: Value, scope: Scope) -> Value:
    """`a ^ b` of numbers; the dimension is raised too."""
    if not (is_scalar(a) and is_scalar(b)):
        raise Mistake(f"cannot raise {kind(a)} to {kind(b)}")
    if has_term(a, b):
        return record("power", a, b)
    if isinstance(b, Quantity):
        raise Mistake(f"an exponent is a plain number, not {kind(b)}")
    x, dimension = split(a)
    try:
        if isinstance(a, ForeignNumber) and x:
            return foreign_number(math.pow(x, b), math.pow(x, b) * (a.metres / x))
        return check_finite(math.pow(x, b), units.power(dimension, b))
    except ValueError:
        raise Mistake("division by 0" if x == 0 else "a negative number has no such power") from None
    except OverflowError:
        raise Mistake("the result is too large for a number") from None


def negate(a: Value, scope: Scope) -> Value:
    """`-a` of a number or list."""
    if isinstance(a, ForeignNumber):
        return ForeignNumber(-float(a), -a.metres)
    if isinstance(a, float):
        return -a
    if isinstance(a, Quantity):
        return Quantity(-a.value, a.dimension)
    if is_scalar(a):
        return record("negate", a)
    if isinstance(a, tuple):
        scope.meter.step(len(a))
        return tuple([negate(v, scope) for v in a])
    raise Mistake(f"cannot negate {kind(a)}")


# --- comparison and logic -------------------------------------------------------------------------------------------


def compare(op: str, a: Value, b: Value, scope: Scope) -> Value:
    """`less`, `at_most`, `greater` or `at_least` of two numbers or two strings."""
    if is_scalar(a) and is_scalar(b):
        if has_term(a, b):
            return record(op, a, b)
        x, y, _ = unify(a, b, scope, "compare")
        return OPERATIONS[op](x, y)
    if isinstance(a, str) and isinstance(b, str):
        return OPERATIONS[op](a, b)
    raise Mistake(f"cannot compare {kind(a)} and {kind(b)} with {_SYMBOLS[op]}")


def equal(a: Value, b: Value, scope: Scope) -> Value:
    """Whether two values of one kind are equal. Lists are compared item by item."""
    scope.meter.step()
    if isinstance(a, Term) or isinstance(b, Term):
        if _is_truth(a) != _is_truth(b):
            raise Mistake(f"cannot compare {kind(a)} and {kind(b)}")
        return record("equal", a, b)
    if is_scalar(a) and is_scalar(b):
        x, y, _ = unify(a, b, scope, "compare")
        return x == y
    if isinstance(a, tuple) and isinstance(b, tuple):
        return _all_equal(a, b, scope)
    if isinstance(a, Color) and isinstance(b, Color):
        return _all_equal(a.channels, b.channels, scope)
    if type(a) is type(b) and isinstance(a, bool | str):
        return a == b
    raise Mistake(f"cannot compare {kind(a)} and {kind(b)}")


def _is_truth(value: Value) -> bool:
    return value.truth if isinstance(value, Term) else isinstance(value, bool)


def _all_equal(a: tuple[Value, ...], b: tuple[Value, ...], scope: Scope) -> Value:
    if len(a) != len(b):
        return False
    result: Value = True
    for x, y in zip(a, b, strict=True):
        same = equal(x, y, scope)
        if same is False:
            return False
        result = logical_and(result, same)
    return result


def unequal(a: Value, b: Value, scope: Scope) -> Value:
    """`a != b`; see `equal`."""
    return logical_not(equal(a, b, scope))


def truth(value: Value, doing: str) -> Value:
    """The value if it is true, false or a formula's truth value. Raises Mistake."""
    if isinstance(value, bool) or (isinstance(value, Term) and value.truth):
        return value
    raise Mistake(f"{doing} needs true or false, got {kind(value)}")


def logical_not(a: Value) -> Value:
    """`not a` of a truth value; recorded if it is a term."""
    truth(a, "`not`")
    return (not a) if isinstance(a, bool) else record("not", a)


def logical_and(a: Value, b: Value) -> Value:
    """`a and b` of truth values; recorded if one is a term."""
    if isinstance(a, bool):
        return b if a else False
    if isinstance(b, bool):
        return a if b else False
    return record("and", a, b)


def logical_or(a: Value, b: Value) -> Value:
    """`a or b` of truth values; recorded if one is a term."""
    if isinstance(a, bool):
        return True if a else b
    if isinstance(b, bool):
        return True if b else a
    return record("or", a, b)


def select(condition: Term, yes: Value, no: Value, scope: Scope) -> Value:
    """`if … then … else …` inside a formula, with a condition that depends on its parameters."""
    graph = condition.graph
    scope.meter.step()
    if isinstance(yes, tuple) and isinstance(no, tuple) and len(yes) == len(no):
        return tuple([select(condition, a, b, scope) for a, b in zip(yes, no, strict=True)])
    if isinstance(yes, Color) and isinstance(no, Color):
        return Color(*[select(condition, a, b, scope) for a, b in zip(yes.channels, no.channels, strict=True)])
    a, b = lift(graph, yes), lift(graph, no)
    if a.truth != b.truth:
        raise Mistake(f"both branches of an `if` in a formula must be of one kind, got {kind(yes)} and {kind(no)}")
    return graph.apply("select", condition, a, b)


def integer_range(start: Value, stop: Value) -> tuple[float, ...]:
    """`start..stop`: start, start + 1, … up to stop; empty if stop is below start."""
    for end in (start, stop):
        if not isinstance(end, float):
            corners = isinstance(start, tuple) and isinstance(stop, tuple)
            hint = "two corners are a list of both: [[-1, -1, -1], [1, 1, 1]]" if corners else ""
            raise Mistake(f"a range runs over plain numbers, got {kind(end)}", hint)
    limits.check_list(stop - start + 1)
    count = math.floor(stop - start + 1e-9) + 1
    return tuple([float(start) + k for k in range(count)])


BINARY: dict[str, Callable[[Value, Value, Scope], Value]] = {
    "+": add,
    "-": subtract,
    "*": multiply,
    "/": divide,
    "^": power,
    "<": lambda a, b, scope: compare("less", a, b, scope),
    "<=": lambda a, b, scope: compare("at_most", a, b, scope),
    ">": lambda a, b, scope: compare("greater", a, b, scope),
    ">=": lambda a, b, scope: compare("at_least", a, b, scope),
    "==": equal,
    "!=": unequal,
    "..": lambda a, b, scope: integer_range(a, b),
}
