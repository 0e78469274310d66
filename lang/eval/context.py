"""The context of an evaluation: lexical scopes with lazy bindings, values of arguments, and the interface of the evaluator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, Protocol

from ..diagnostics import Diagnostics, Span
from ..elements import Element
from ..formula_graph import Formula
from ..limits import Meter
from ..syntax import ast
from .modules import Loader, Module

Trace = tuple[tuple[str, Span], ...]


class Thunk:
    """A definition that is evaluated once, at its first use."""

    __slots__ = ("label", "node", "scope", "state", "value")

    WAITING, RUNNING, DONE, FAILED = range(4)

    def __init__(self, label: str, node: Any, scope: Scope) -> None:
        self.label = label
        self.node = node
        self.scope = scope
        self.state = Thunk.WAITING
        self.value: Any = None

    def label_span(self) -> Span:
        """The place of the definition."""
        return self.node.span if self.node is not None else Span(self.label)

    @classmethod
    def make_failed(cls, label: str, scope: Scope) -> Thunk:
        """A name whose definition has a reported error. Its uses raise Poisoned."""
        thunk = cls(label, None, scope)
        thunk.state = Thunk.FAILED
        return thunk


class Scope:
    """The names of one block or call, and the context of its expressions.

    unit   metres in a bare length of the file
    trace  the chain of calls, innermost first
    path   dotted names of the calls, for default names of elements
    plain  inside a formula or function literal, where bare angles are radians
    """

    __slots__ = ("evaluator", "meter", "names", "parent", "path", "plain", "trace", "unit")

    def __init__(self, evaluator: Evaluator, meter: Meter, unit: float = 1.0, parent: Scope | None = None) -> None:
        self.evaluator = evaluator
        self.meter = meter
        self.unit = unit
        self.parent = parent
        self.names: dict[str, Any] = {}
        self.trace: Trace = ()
        self.path = ""
        self.plain = False

    def inner(self) -> Scope:
        """A nested scope with the same chain of calls."""
        scope = Scope(self.evaluator, self.meter, self.unit, self)
        scope.trace = self.trace
        scope.path = self.path
        scope.plain = self.plain
        return scope

    def snapshot(self) -> Scope:
        """A copy of this scope with its present names."""
        scope = self.inner()
        scope.parent = self.parent
        scope.names = self.names.copy()
        return scope

    def call_scope(self, name: str, span: Span, caller: Scope) -> Scope:
        """A nested scope for the body of a function that `caller` calls."""
        scope = Scope(self.evaluator, self.meter, self.unit, self)
        scope.trace = ((name, span), *caller.trace)
        scope.path = f"{caller.path}.{name}" if caller.path else name
        scope.plain = self.plain or caller.plain
        return scope

    def find(self, name: str) -> Any:
        """The binding of `name` in this scope or an enclosing one, or None."""
        scope: Scope | None = self
        while scope is not None:
            value = scope.names.get(name)
            if value is not None:
                return value
            scope = scope.parent
        return None

    def call(self, function: Any, values: list[Any]) -> Any:
        """Call a function with values, from a built-in function."""
        return self.evaluator.call_values(function, values, self)


@dataclass(frozen=True, slots=True)
class ArgumentValue:
    """An evaluated argument of a call.

    name, name_span  the name it is given by, None for an argument by position; the place of the name
    value            the value
    span, node       the place and the syntax of the value, for messages about a part of it
    """

    name: str | None
    name_span: Span
    value: Any
    span: Span
    node: ast.Node | None = None


class Evaluator(Protocol):
    """The evaluator as expressions, calls and conversions use it. `evaluator.Evaluator` implements it."""

    diagnostics: Diagnostics
    loader: Loader
    meter: Meter
    weights: dict[Element, int]  # number of elements below a block, with repetitions
    outer: Scope  # the scope around a file: the language and the prelude

    def report(self, message: str, span: Span | None, hint: str = "", trace: Trace = ()) -> None:
        """Add an error to the diagnostics, once for each place."""
        ...

    def fail(self, message: str, span: Span | None, hint: str, scope: Scope) -> NoReturn:
        """Report an error and raise Poisoned."""
        ...

    def value(self, node: ast.Node, scope: Scope) -> Any:
        """The value of an expression. Raises Poisoned."""
        ...

    def force(self, thunk: Thunk, span: Span, scope: Scope) -> Any:
        """The value of a definition that is used at `span`. Raises Poisoned."""
        ...

    def collect(self, block: ast.Block, scope: Scope) -> tuple[Element, ...]:
        """The elements of a block in braces."""
        ...

    def collect_file(self, module: Module, scope: Scope) -> tuple[Element, ...]:
        """The shapes and lights that a used file places."""
        ...

    def instance(self, module: Module, given: Mapping[str, ArgumentValue], label: str, call: Span | None, caller: Scope) -> Scope:
        """A new scope of a file with these values of its `param`s."""
        ...

    def module_scope(self, module: Module, outer: Scope) -> Scope:
        """The scope of a file with the defaults of its `param`s."""
        ...

    def call_values(self, function: Any, values: list[Any], scope: Scope) -> Any:
        """Call a function with values."""
        ...

    def formula(self, function: Any, scope: Scope, span: Span) -> Formula:
        """The formula that a function records. Raises Mistake."""
        ...
