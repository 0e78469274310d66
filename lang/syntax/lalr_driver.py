"""LALR driver for Lark's tables that takes a chain of unit rules in one step.

The operator precedences pass each number through a dozen unit rules. The end of such a chain depends on two states and the kind of
the next token. It is cached: Pager, "Eliminating Unit Productions from LR Parsers", 1977.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import itemgetter
from typing import Any

from lark import Lark, Token
from lark.parsers.lalr_analysis import Shift

from .ast_builder import TreeBuilder
from .trivia import Comments

Callbacks = dict[Any, Callable[[list[Any]], Any]]  # by rule


class Unexpected(Exception):
    """A token that the grammar does not allow; `expected` are the kinds that it allows."""

    def __init__(self, expected: set[str]) -> None:
        super().__init__()
        self.expected = expected


class Automaton:
    """The state of one parse. The stack `states` holds the start state and one state for each entry of the stack `values`."""

    def __init__(self, lark: Lark, callbacks: Callbacks) -> None:
        conf = lark.parse_interactive().parser_state.parse_conf
        self._rows, self._end = conf.states, conf.end_state
        # The tree is built during the parse, without recursion. The builder serves one parse at a time.
        self._callbacks = callbacks
        self._chains = _chains.setdefault(id(conf.states), {})
        self.states: list[Any] = [conf.start_state]
        self.values: list[Any] = []

    def feed(self, token: Token) -> Any:
        """Shift one token after all reductions. Returns the result of the start rule after the last token. Raises Unexpected."""
        rows, states, values, chains, kind = self._rows, self.states, self.values, self._chains, token.type
        while True:
            if values:
                key = states[-2], states[-1], kind
                try:
                    state = states[-1] = chains[key]
                except KeyError:
                    state = states[-1] = chains[key] = self._end_of_chain(*key)
            else:
                state = states[-1]
            try:
                action, arg = rows[state][kind]
            except KeyError:
                raise Unexpected({name for name in rows[state] if name.isupper()}) from None
            if action is Shift:
                states.append(arg)
                values.append(token)
                return None
            first = len(values) - len(arg.expansion)
            value = self._callbacks[arg](values[first:])
            del values[first:], states[first + 1 :]
            states.append(rows[states[-1]][arg.origin.name][1])
            values.append(value)
            if states[-1] == self._end:
                return value

    def _end_of_chain(self, below: Any, state: Any, kind: str) -> Any:
        """The state after all unit rules that reduce the top of the stack."""
        while True:
            action, arg = self._rows[state].get(kind, (Shift, None))
            if action is Shift or not _is_unit(arg) or self._rows[below][arg.origin.name][1] == self._end:
                return state
            state = self._rows[below][arg.origin.name][1]


_chains: dict[int, dict[tuple[Any, Any, str], Any]] = {}  # by grammar, which is never freed


def _is_unit(rule: Any) -> bool:
    """Whether a rule returns its only part unchanged."""
    return rule.options.expand1 and rule.alias is None and len(rule.expansion) == 1


@contextmanager
def building(lark: Lark, file: str, comments: Comments) -> Iterator[Callbacks]:
    """The callbacks of a tree builder for a file. Idle builders are reused, because Lark creates callbacks slowly."""
    try:
        builder, callbacks = _idle.pop()
    except IndexError:
        builder = TreeBuilder()
        callbacks = lark._parse_tree_builder.create_callback(builder)
        callbacks.update((rule, itemgetter(0)) for rule in callbacks if _is_unit(rule))
    builder.begin(file, comments)
    try:
        yield callbacks
    finally:
        _idle.append((builder, callbacks))


_idle: list[tuple[TreeBuilder, Callbacks]] = []
