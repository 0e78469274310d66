"""LALR driver that takes a chain of unit rules in one step, and builds the tree during the parse, without recursion.

The operator precedences pass each number through a dozen unit rules. The end of such a chain depends on two states and the kind of
the next token. It is cached: Pager, "Eliminating Unit Productions from LR Parsers", 1977.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .ast_builder import TreeBuilder
from .tables import Rule, tables
from .token import Token


class Unexpected(Exception):
    """A token that the grammar does not allow; `expected` are the kinds that it allows."""

    def __init__(self, expected: set[str]) -> None:
        super().__init__()
        self.expected = expected


class Automaton:
    """The state of one parse. The stack `states` holds the start state and one state for each entry of the stack `values`."""

    def __init__(self, builder: TreeBuilder) -> None:
        known = tables()
        self._rows, self._rules, self._end = known.states, known.rules, known.end
        self._actions = [_action(rule, builder) for rule in known.rules]
        self.states: list[int] = [0]
        self.values: list[Any] = []

    def feed(self, token: Token) -> Any:
        """Shift one token after all reductions. Returns the result of the start rule after the last token. Raises Unexpected."""
        rows, states, values, kind = self._rows, self.states, self.values, token.type
        while True:
            if values:
                key = states[-2], states[-1], kind
                try:
                    state = states[-1] = _chains[key]
                except KeyError:
                    state = states[-1] = _chains[key] = self._end_of_chain(*key)
            else:
                state = states[-1]
            try:
                action = rows[state][kind]
            except KeyError:
                raise Unexpected({name for name in rows[state] if name.isupper()}) from None
            if action >= 0:
                states.append(action)
                values.append(token)
                return None
            rule = self._rules[-1 - action]
            first = len(values) - len(rule.parts)
            value = self._actions[-1 - action](values[first:])
            del values[first:], states[first + 1 :]
            states.append(rows[states[-1]][rule.origin])
            values.append(value)
            if states[-1] == self._end:
                return value

    def _end_of_chain(self, below: int, state: int, kind: str) -> int:
        """The state after all unit rules that reduce the top of the stack."""
        while True:
            action = self._rows[state].get(kind, 0)
            if action >= 0 or not self._rules[-1 - action].is_unit:
                return state
            after = self._rows[below][self._rules[-1 - action].origin]
            if after == self._end:
                return state
            state = after


_chains: dict[tuple[int, int, str], int] = {}


def _action(rule: Rule, builder: TreeBuilder) -> Callable[[list[Any]], Any]:
    """The function from the parts of a rule to its value. Rules without a method have the list of their parts as value."""
    if rule.is_unit:
        return lambda parts: parts[0]
    method = getattr(builder, rule.method) if rule.method else list
    spread = [k for k, name in enumerate(rule.parts) if name.startswith("_") and not name.isupper()]
    if not spread:
        return method
    if not rule.method and spread == [0] and rule.parts[0] == rule.origin:
        return _append  # a repetition: copies of its list would take quadratic time

    def build(parts: list[Any]) -> Any:
        for k in reversed(spread):
            parts[k : k + 1] = parts[k]
        return method(parts)

    return build


def _append(parts: list[Any]) -> list[Any]:
    """The list of a repetition, with one more item."""
    parts[0] += parts[1:]
    return parts[0]
