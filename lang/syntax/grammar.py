"""The language's grammar as Lark's lexer and LALR parser, read from tables.json. `make grammar` builds that file from grammar.lark.

Reading the tables takes a fraction of the time of building them, so that a run of maquette only reads.
"""

from __future__ import annotations

import json
import re
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from lark import Lark, Token, Tree, UnexpectedToken
from lark.common import LexerConf
from lark.grammar import NonTerminal, Rule, RuleOptions, Terminal
from lark.lark import PostLex
from lark.lexer import BasicLexer, LexerThread, TerminalDef
from lark.parse_tree_builder import ParseTreeBuilder
from lark.parsers.lalr_analysis import IntParseTable, Reduce, Shift
from lark.parsers.lalr_parser_state import ParseConf, ParserState

__all__ = ["Grammar", "ParserState", "Token", "UnexpectedToken", "grammar"]

START = "start"  # the rule of a file
TABLES = Path(__file__).with_name("tables.json")
SOURCE = Path(__file__).with_name("grammar.lark")


class Grammar(NamedTuple):
    """Lexer, rules and LALR table."""

    lexer: BasicLexer
    rules: list[Rule]
    table: IntParseTable

    def tokens(self, text: str, line: int = 1) -> LexerThread:
        """Lark's lexer at the start of `text`, which begins in `line`."""
        thread = LexerThread.from_text(self.lexer, text)
        assert thread.state is not None
        thread.state.line_ctr.line = line
        return thread

    def actions(self, builder: object) -> ParseConf[int]:
        """The LALR table with the methods of `builder` as actions: each takes the list of the parts of its rule."""
        return ParseConf(self.table, ParseTreeBuilder(self.rules, Tree).create_callback(builder), START)


@cache
def grammar() -> Grammar:
    """The grammar of the language."""
    tables = json.loads(TABLES.read_text(encoding="utf-8"))
    terminals = [TerminalDef.deserialize(terminal, {}) for terminal in tables["terminals"]]
    rules = [_rule(*row) for row in tables["rules"]]
    actions: dict[int, tuple[Any, Any]] = {k: (Shift, k) for k in range(len(tables["states"]))}
    actions |= {-1 - k: (Reduce, rule) for k, rule in enumerate(rules)}
    states = {k: {name: actions[action] for name, action in row.items()} for k, row in enumerate(tables["states"])}
    lexer = BasicLexer(LexerConf(terminals, re, tables["ignored"], skip_validation=True))
    return Grammar(lexer, rules, IntParseTable(states, {START: 0}, {START: tables["end"]}))


def _rule(origin: str, parts: list[str], alias: str | None, is_inlined: bool) -> Rule:
    """A production. The value of an inlined one is that of its only part."""
    symbols = [Terminal(name) if name.isupper() else NonTerminal(name) for name in parts]
    return Rule(NonTerminal(origin), symbols, 0, alias, RuleOptions(keep_all_tokens=True, expand1=is_inlined))


# --- building the tables ----------------------------------------------------------------------------------------------


class _KeepMistakes(PostLex):
    """Makes Lark accept terminals outside the grammar's rules: comments and lexical errors."""

    always_accept = ("COMMENT", "OPEN_STRING", "BLOCK_COMMENT", "HASH_COMMENT", "BAD_COLOR", "UNKNOWN")

    def process(self, stream):
        return stream


def build() -> dict[str, Any]:
    """The content of tables.json.

    `states` has for each state, from the start, and each symbol the next state k, or -1 - k to reduce rule k.
    """
    options: Any = {"parser": "lalr", "lexer": "basic", "keep_all_tokens": True, "maybe_placeholders": False}
    lark: Any = Lark(SOURCE.read_text(encoding="utf-8"), start=START, postlex=_KeepMistakes(), **options)
    table = lark.parse_interactive().parser_state.parse_conf.parse_table
    order = _reached(table)
    numbers = {rule: -1 - k for k, rule in enumerate(lark.rules)}
    return {
        "terminals": [_terminal(terminal) for terminal in sorted(lark.terminals, key=lambda terminal: terminal.name)],
        "ignored": sorted(lark.ignore_tokens),
        "rules": [
            [rule.origin.name, [part.name for part in rule.expansion], rule.alias, bool(rule.options.expand1)] for rule in lark.rules
        ],
        "states": [
            {name: order[arg] if action is Shift else numbers[arg] for name, (action, arg) in sorted(table.states[state].items())}
            for state in order
        ],
        "end": order[table.end_states[START]],
    }


def _terminal(terminal: TerminalDef) -> dict[str, Any]:
    """A terminal as Lark writes it. Python's versions have different numbers for unlimited width."""
    data = terminal.serialize()
    if width := data["pattern"].get("_width"):
        data["pattern"]["_width"] = [min(each, 1 << 31) for each in width]
    return data


def _reached(table: IntParseTable) -> dict[int, int]:
    """New numbers of the states, in the order in which the start reaches them: Lark's own numbers change from run to run."""
    order = {table.start_states[START]: 0}
    for state in (waiting := [*order]):
        for _, (action, target) in sorted(table.states[state].items()):
            if action is Shift and target not in order:
                order[target] = len(order)
                waiting.append(target)
    return order


def text() -> str:
    """The text of tables.json: a line for each terminal, rule and state."""
    rows = {name: value if isinstance(value, list) else [value] for name, value in build().items()}
    parts = [f"{json.dumps(name)}: [\n" + ",\n".join(map(json.dumps, row)) + "\n]" for name, row in rows.items() if name != "end"]
    return "{\n" + ",\n".join([*parts, f'"end": {rows["end"][0]}']) + "\n}\n"


if __name__ == "__main__":
    sys.stdout.write(text())
