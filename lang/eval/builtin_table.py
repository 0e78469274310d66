"""The table of built-in functions, and checks of their arguments."""

from __future__ import annotations

from collections.abc import Callable

from .. import units
from ..formula_graph import OPERATIONS
from . import operators, suggestions
from .context import Scope
from .operators import check_finite, has_term, record
from .values import Builtin, Mistake, Value, describe, kind

FUNCTIONS: dict[str, Builtin] = {}


def define(signature: str, doc: str) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Register a function. `signature` is `name a b c? rest*`: `?` marks an optional parameter, `*` any number of arguments."""
    name, *parameters = signature.split()
    required = sum(p[-1] not in "?*" for p in parameters)
    variadic = bool(parameters) and parameters[-1].endswith("*")

    def register(run: Callable[..., Value]) -> Callable[..., Value]:
        names = tuple([p.rstrip("?*") for p in parameters if not p.endswith("*")])
        FUNCTIONS[name] = Builtin(name, names, required, run, variadic, doc)
        return run

    return register


def require_scalar(value: Value, argument: int = 0) -> Value:
    """A number, a quantity or a term. Raises Mistake."""
    if not operators.is_scalar(value):
        raise Mistake(f"expected number, got {describe(value)}", argument=argument)
    return value


def require_number(value: Value, argument: int = 0, hint: str = "") -> Value:
    """A plain number or a term. Raises Mistake."""
    if not isinstance(value, float) and not (operators.is_scalar(value) and has_term(value)):
        raise Mistake(f"expected number, got {describe(value)}", hint, argument)
    return value


def require_list(value: Value, argument: int) -> tuple[Value, ...]:
    """A list. Raises Mistake."""
    if not isinstance(value, tuple):
        raise Mistake(f"expected list, got {describe(value)}", suggestions.NO_POINT if has_term(value) else "", argument)
    return value


def require_vector(value: Value, argument: int) -> tuple[Value, ...]:
    """A list of numbers, quantities and terms. Raises Mistake."""
    for item in require_list(value, argument):
        if not operators.is_scalar(item):
            raise Mistake(f"expected list of numbers, got {kind(item)} ", argument=argument)
    return value


def apply_operation(op: str, *args: Value) -> Value:
    """An operation on plain numbers; recorded if an argument is a term."""
    if has_term(*args):
        return record(op, *args)
    try:
        return check_finite(OPERATIONS[op](*args))
    except (ValueError, ZeroDivisionError):
        listed = ", ".join(units.show_number(a) for a in args)
        raise Mistake(f"{op}({listed}) is not defined") from None
    except OverflowError:
        raise Mistake("the result is too large for a number") from None


def bare_radians(value: float, scope: Scope) -> float:
    """A bare number as an angle. Raises Mistake outside of formulas."""
    try:
        return operators.bare(value, units.ANGLE, scope)
    except Mistake as mistake:
        number = units.show_number(value)
        raise Mistake(mistake.message, f"write {number}deg or {number}rad; * 1rad makes an angle of a number", argument=0) from None
