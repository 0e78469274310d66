"""Lark's LALR automaton, driven token by token, with its chains of unit rules taken at once.

The ladder of operators takes each number through a dozen rules that only hand it up. Where such a chain ends depends on two states and the
kind of the token that follows, and is looked up from then on (Pager, "Eliminating Unit Productions from LR Parsers", 1977).
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
    """A token that fits nowhere; `expected` are the kinds that would."""

    def __init__(self, expected: set[str]) -> None:
        super().__init__()
        self.expected = expected


class Automaton:
    """One parse. `states` and `values` are its stacks; a state more than values, the one it began in."""

    def __init__(self, lark: Lark, made: Callbacks) -> None:
        conf = lark.parse_interactive().parser_state.parse_conf
        self._rows, self._end = conf.states, conf.end_state
        # The tree is built while parsing, by a builder that nobody else uses meanwhile: a tree is never walked recursively.
        self._made = made
        self._chains = _chains.setdefault(id(conf.states), {})
        self.states: list[Any] = [conf.start_state]
        self.values: list[Any] = []

    def feed(self, token: Token) -> Any:
        """Take a token in: what the whole text is made into, after the last one. Raises Unexpected."""
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
            value = self._made[arg](values[first:])
            del values[first:], states[first + 1 :]
            states.append(rows[states[-1]][arg.origin.name][1])
            values.append(value)
            if states[-1] == self._end:
                return value

    def _end_of_chain(self, below: Any, state: Any, kind: str) -> Any:
        """The state after all unit rules that apply one after the other to what was read last."""
        while True:
            action, arg = self._rows[state].get(kind, (Shift, None))
            if action is Shift or not _is_unit(arg) or self._rows[below][arg.origin.name][1] == self._end:
                return state
            state = self._rows[below][arg.origin.name][1]


_chains: dict[int, dict[tuple[Any, Any, str], Any]] = {}  # by grammar, which lives as long as the process


def _is_unit(rule: Any) -> bool:
    """Whether a rule hands up what it is made of."""
    return rule.options.expand1 and rule.alias is None and len(rule.expansion) == 1


@contextmanager
def building(lark: Lark, file: str, comments: Comments) -> Iterator[Callbacks]:
    """What is made of each rule's parts, by a tree builder for a file: one that is idle, for lark takes long to make these."""
    try:
        builder, made = _idle.pop()
    except IndexError:
        builder = TreeBuilder()
        made = lark._parse_tree_builder.create_callback(builder)
        made.update((rule, itemgetter(0)) for rule in made if _is_unit(rule))
    builder.begin(file, comments)
    try:
        yield made
    finally:
        _idle.append((builder, made))


_idle: list[tuple[TreeBuilder, Callbacks]] = []
