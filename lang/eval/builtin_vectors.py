"""Built-in functions of vectors, represented as lists of numbers."""

from __future__ import annotations

from .. import units
from . import operators
from .builtin_numbers import absolute, combine
from .builtin_table import define, require_vector
from .context import Scope
from .operators import has_term, split, unify_all
from .values import Mistake, Value


def dot(scope: Scope, a: tuple[Value, ...], b: tuple[Value, ...]) -> Value:
    """The scalar product of two lists of one length."""
    total: Value = None
    for x, y in zip(a, b, strict=True):
        product = operators.multiply(x, y, scope)
        total = product if total is None else operators.add(total, product, scope)
    return total


@define("dot a b", "scalar product of two lists of one length")
def _dot(scope: Scope, a: Value, b: Value) -> Value:
    if len(require_vector(a, 0)) != len(require_vector(b, 1)) or not a:
        raise Mistake(f"dot of a list of {len(a)} and a list of {len(b)}", argument=1)
    return dot(scope, *_same_dimensions(a, b, scope))


@define("cross a b", "vector product of two lists of three")
def _cross(scope: Scope, a: Value, b: Value) -> Value:
    for i, v in enumerate((a, b)):
        if len(require_vector(v, i)) != 3:
            raise Mistake(f"expected list of 3, got a list of {len(v)}", argument=i)
    a, b = _same_dimensions(a, b, scope)

    def minor(i: int, j: int) -> Value:
        return operators.subtract(operators.multiply(a[i], b[j], scope), operators.multiply(a[j], b[i], scope), scope)

    return (minor(1, 2), minor(2, 0), minor(0, 1))


def _same_dimensions(a: tuple[Value, ...], b: tuple[Value, ...], scope: Scope) -> tuple[tuple[Value, ...], tuple[Value, ...]]:
    """Each list with items of one dimension, so that their products have one dimension."""
    return same_dimension(a, scope), same_dimension(b, scope)


def same_dimension(v: tuple[Value, ...], scope: Scope) -> tuple[Value, ...]:
    """The numbers of a list, converted to one dimension."""
    if has_term(*v) or all(isinstance(n, float) for n in v):
        return v
    numbers, dimension = unify_all(list(v), scope, "combine")
    return tuple([units.quantity(n, dimension) for n in numbers])


@define("length vector", "length of a list of numbers")
def _length(scope: Scope, vector: Value) -> Value:
    parts = list(same_dimension(require_vector(vector, 0), scope))
    if not parts:
        raise Mistake("length of an empty list", "write len(…) to count", argument=0)
    return combine("hypot", parts, scope) if len(parts) > 1 else absolute(scope, parts[0])


@define("normalize vector", "a list of numbers scaled to length 1")
def _normalize(scope: Scope, vector: Value) -> Value:
    size = _length(scope, vector)
    if not has_term(size) and split(size)[0] == 0:
        raise Mistake("a vector of length 0 has no direction", argument=0)
    return operators.divide(same_dimension(vector, scope), size, scope)
