"""The table of built-in functions, and checks of their arguments."""

from __future__ import annotations

from collections.abc import Callable

from .. import units
from ..formula_graph import OPERATIONS
from . import operators, suggestions
from .context import Scope
from .operators import checked, has_term, record
from .values import Builtin, Mistake, Value, describe, kind

FUNCTIONS: dict[str, Builtin] = {}


def define(signature: str, doc: str) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Put a function into the table. `signature` is `name a b c? rest*`: `?` may be left out, `*` any number more."""
    name, *parameters = signature.split()
    required = sum(p[-1] not in "?*" for p in parameters)
    variadic = bool(parameters) and parameters[-1].endswith("*")

    def keep(run: Callable[..., Value]) -> Callable[..., Value]:
        names = tuple([p.rstrip("?*") for p in parameters if not p.endswith("*")])
        FUNCTIONS[name] = Builtin(name, names, required, run, variadic, doc)
        return run

    return keep


def require_scalar(value: Value, argument: int = 0) -> Value:
    if not operators.is_scalar(value):
        raise Mistake(f"number wanted, got {describe(value)}", argument=argument)
    return value


def require_number(value: Value, argument: int = 0, hint: str = "") -> Value:
    """A plain number or a term."""
    if not isinstance(value, float) and not (operators.is_scalar(value) and has_term(value)):
        raise Mistake(f"number wanted, got {describe(value)}", hint, argument)
    return value


def require_list(value: Value, argument: int) -> tuple[Value, ...]:
    if not isinstance(value, tuple):
        raise Mistake(f"list wanted, got {describe(value)}", suggestions.NO_POINT if has_term(value) else "", argument)
    return value


def require_vector(value: Value, argument: int) -> tuple[Value, ...]:
    for item in require_list(value, argument):
        if not operators.is_scalar(item):
            raise Mistake(f"list of numbers wanted, got {kind(item)} in it", argument=argument)
    return value


def apply_operation(op: str, *args: Value) -> Value:
    """An operation on plain numbers, recorded if one is a term."""
    if has_term(*args):
        return record(op, *args)
    try:
        return checked(OPERATIONS[op](*args))
    except (ValueError, ZeroDivisionError):
        given = ", ".join(units.show_number(a) for a in args)
        raise Mistake(f"{op}({given}) is not defined") from None
    except OverflowError:
        raise Mistake("the result is too large for a number") from None


def bare_radians(value: float, scope: Scope) -> float:
    try:
        return operators.bare(value, units.ANGLE, scope)
    except Mistake as mistake:
        number = units.show_number(value)
        raise Mistake(mistake.message, f"write {number}deg or {number}rad; * 1rad makes an angle of a number", argument=0) from None
