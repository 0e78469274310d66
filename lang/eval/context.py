"""The context of an evaluation: lexical scopes with lazy bindings, values of arguments, and the interface of the evaluator."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NoReturn, Protocol

from ..diagnostics import Diagnostics, Span
from ..elements import Element
from ..formula_graph import Formula, Graph
from ..limits import Meter
from ..schema.argument_types import Catalogue
from ..syntax import ast
from .modules import Loader, Module

Trace = tuple[tuple[str, Span], ...]
Code = Callable[["Scope"], Any]  # the value of a compiled expression in a scope; raises Poisoned after reporting errors


class Names:
    """The names that one scope binds, and those of the scopes around it, known before evaluation."""

    __slots__ = ("bound", "outer")

    def __init__(self, bound: Iterable[str], outer: Names | None = None) -> None:
        self.bound = frozenset(bound)
        self.outer = outer

    def depth(self, name: str) -> int:
        """How many scopes outwards `name` is bound; -1 if no scope of the file binds it."""
        names: Names | None = self
        count = 0
        while names is not None:
            if name in names.bound:
                return count
            names, count = names.outer, count + 1
        return -1


class Thunk:
    """A definition that is evaluated once, at its first use. `code` gives its value in `scope`."""

    __slots__ = ("code", "label", "scope", "span", "state", "value")

    WAITING, RUNNING, DONE, FAILED = range(4)

    def __init__(self, label: str, span: Span, code: Code, scope: Scope) -> None:
        self.label = label
        self.span = span
        self.code = code
        self.scope = scope
        self.state = Thunk.WAITING
        self.value: Any = None

    @classmethod
    def make_failed(cls, label: str, scope: Scope) -> Thunk:
        """A name whose definition has a reported error. Its uses raise Poisoned."""
        thunk = cls(label, Span(label), _raise_nothing, scope)
        thunk.state = Thunk.FAILED
        return thunk


def _raise_nothing(scope: Scope) -> None:
    """The code of a failed definition, which is never run."""


class Scope:
    """The names of one block or call, and the context of its expressions.

    unit   metres in a bare length of the file
    trace  the chain of calls, innermost first
    path   dotted names of the calls, for default names of elements
    plain  inside a formula or function literal, where bare angles are radians
    """

    __slots__ = ("evaluator", "meter", "names", "parent", "path", "plain", "trace", "unit")

    def __init__(
        self, evaluator: Evaluator, meter: Meter, unit: float = 1.0, parent: Scope | None = None, trace: Trace = (), path: str = "",
        plain: bool = False,
    ) -> None:  # fmt: skip
        self.evaluator = evaluator
        self.meter = meter
        self.unit = unit
        self.parent = parent
        self.names: dict[str, Any] = {}
        self.trace = trace
        self.path = path
        self.plain = plain

    def inner(self) -> Scope:
        """A nested scope with the same chain of calls."""
        return Scope(self.evaluator, self.meter, self.unit, self, self.trace, self.path, self.plain)

    def snapshot(self) -> Scope:
        """A copy of this scope with its present names."""
        scope = Scope(self.evaluator, self.meter, self.unit, self.parent, self.trace, self.path, self.plain)
        scope.names = self.names.copy()
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
    outside          whether it is a value of `--set` or of a call from Python
    """

    name: str | None
    name_span: Span
    value: Any
    span: Span
    node: ast.Node | None = None
    outside: bool = False


class Evaluator(Protocol):
    """The evaluator as expressions, calls and conversions use it. `evaluator.Evaluator` implements it."""

    diagnostics: Diagnostics
    catalogue: Catalogue
    loader: Loader
    meter: Meter
    shared: dict[Any, Element]  # materials and textures by call site and arguments; see calls.share
    outer: Scope  # the scope around a file: the language and the prelude
    language: dict[str, Any]  # the names of `outer` and of the scope around it
    graph: Graph | None  # of the formula that is being recorded

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

    def place(self, value: Any, node: ast.Node, scope: Scope, sink: Any) -> None:
        """Add the value of an item to a blocks.Sink."""
        ...

    def collect_file(self, module: Module, scope: Scope) -> tuple[Element, ...]:
        """The shapes and lights that a used file places."""
        ...

    def instance(self, module: Module, arguments: Mapping[str, ArgumentValue], label: str, call: Span | None, caller: Scope) -> Scope:
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
