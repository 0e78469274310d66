"""Scopes: names bound to values or to definitions that wait for their first use."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..diagnostics import Span
from ..limits import Meter
from ..syntax import ast
from .values import UserFunction

if TYPE_CHECKING:
    from .evaluator import Evaluator

Trace = tuple[tuple[str, Span], ...]


class Thunk:
    """A definition that is evaluated when it is first used, and once."""

    __slots__ = ("label", "node", "scope", "state", "value")

    WAITING, RUNNING, DONE, FAILED = range(4)

    def __init__(self, label: str, node: Any, scope: Scope) -> None:
        self.label = label
        self.node = node
        self.scope = scope
        self.state = Thunk.WAITING
        self.value: Any = None

    def label_span(self) -> Span:
        """Where the definition stands."""
        return self.node.span if self.node is not None else Span(self.label)

    @classmethod
    def failed(cls, label: str, scope: Scope) -> Thunk:
        """A name whose definition is known to be wrong: using it says nothing more."""
        thunk = cls(label, None, scope)
        thunk.state = Thunk.FAILED
        return thunk


class Scope:
    """Names of one block or call, and what its expressions need to know of their place.

    unit   metres in a bare length of the file that the text stands in
    trace  the calls that led here, innermost first
    path   dotted names of those calls, for naming elements
    plain  inside a formula or function literal: bare angles are radians
    """

    __slots__ = ("machine", "meter", "names", "parent", "path", "plain", "trace", "unit")

    def __init__(self, machine: Evaluator, meter: Meter, unit: float = 1.0, parent: Scope | None = None) -> None:
        self.machine = machine
        self.meter = meter
        self.unit = unit
        self.parent = parent
        self.names: dict[str, Any] = {}
        self.trace: Trace = ()
        self.path = ""
        self.plain = False

    def inner(self) -> Scope:
        """A scope inside this one, at the same place in the chain of calls."""
        scope = Scope(self.machine, self.meter, self.unit, self)
        scope.trace = self.trace
        scope.path = self.path
        scope.plain = self.plain
        return scope

    def beside(self) -> Scope:
        """A scope like this one, with a copy of the names it has so far."""
        scope = self.inner()
        scope.parent = self.parent
        scope.names = self.names.copy()
        return scope

    def called(self, name: str, span: Span, caller: Scope) -> Scope:
        """A scope inside this one for the body of a function that `caller` calls."""
        scope = Scope(self.machine, self.meter, self.unit, self)
        scope.trace = ((name, span), *caller.trace)
        scope.path = f"{caller.path}.{name}" if caller.path else name
        scope.plain = self.plain or caller.plain
        return scope

    def find(self, name: str) -> Any:
        """What `name` is bound to here or further out; None where it is not known."""
        scope: Scope | None = self
        while scope is not None:
            value = scope.names.get(name)
            if value is not None:
                return value
            scope = scope.parent
        return None

    def call(self, function: Any, values: list[Any]) -> Any:
        """Call a function with values, from a function of the language."""
        return self.machine.call_values(function, values, self)


def bind_block(items: tuple[ast.Item, ...], scope: Scope) -> None:
    """Bind the `let`s of a block that waits to be evaluated; of two of one name, the first."""
    for item in items:
        if isinstance(item, ast.Let) and item.name.id not in scope.names:
            name = item.name.id
            if item.parameters is None:
                scope.names[name] = Thunk(name, item.value, scope)
            else:
                scope.names[name] = UserFunction(item, scope)
