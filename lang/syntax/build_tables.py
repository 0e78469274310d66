"""Builds the tables of lexer and parser from grammar.lark with Lark. `make grammar` writes them to tables.json.

Lark itself takes a quarter of the time of `maquette check`, so that only this module imports it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from lark import Lark
from lark.lark import PostLex
from lark.parsers.lalr_analysis import Shift

GRAMMAR = Path(__file__).with_name("grammar.lark")


class _KeepMistakes(PostLex):
    """Makes Lark accept terminals outside the grammar's rules: comments and lexical errors."""

    always_accept = ("COMMENT", "OPEN_STRING", "BLOCK_COMMENT", "HASH_COMMENT", "BAD_COLOR", "UNKNOWN")

    def process(self, stream):
        return stream


def build() -> dict[str, Any]:
    """The tables as JSON data; see tables.Tables."""
    options: Any = {"parser": "lalr", "lexer": "basic", "keep_all_tokens": True, "maybe_placeholders": False}
    made: Any = Lark(GRAMMAR.read_text(encoding="utf-8"), postlex=_KeepMistakes(), **options)
    lexer, conf = made._build_lexer(), made.parse_interactive().parser_state.parse_conf
    keywords = {word.pattern.value: word.name for word in lexer.terminals if word.pattern.type == "str" and word.name.isalpha()}
    keywords = {text: name for text, name in keywords.items() if text.isalpha()}
    symbols = [terminal for terminal in lexer.terminals if terminal.pattern.type != "str" or terminal.pattern.value not in keywords]
    numbers = {rule: k for k, rule in enumerate(made.rules)}
    order = _reached(conf.states, conf.start_state)
    new = {state: k for k, state in enumerate(order)}
    states = [
        {name: new[arg] if action is Shift else -1 - numbers[arg] for name, (action, arg) in sorted(conf.states[k].items())} for k in order
    ]
    return {
        "pattern": "|".join(f"(?P<{terminal.name}>{terminal.pattern.to_regexp()})" for terminal in symbols),
        "keywords": keywords,
        "ignored": sorted(lexer.ignore_types),
        "rules": [_rule(rule) for rule in made.rules],
        "states": states,
        "end": new[conf.end_state],
    }


def _reached(states: Any, start: Any) -> list[Any]:
    """The states in the order in which the start reaches them: Lark's own numbers change from run to run."""
    order = {start: None}
    for state in (todo := [start]):
        for _, (action, arg) in sorted(states[state].items()):
            if action is Shift and arg not in order:
                order[arg] = None
                todo.append(arg)
    return list(order)


def _rule(rule: Any) -> tuple[str, list[str], str, bool]:
    origin, parts = str(rule.origin.name), [str(part.name) for part in rule.expansion]
    method = "" if origin.startswith("_") else str(rule.alias or origin)
    return origin, parts, method, bool(rule.options.expand1) and rule.alias is None and len(parts) == 1


def text() -> str:
    """The content of tables.json: one line for each rule and state."""
    parts = []
    for name, value in build().items():
        rows = value if name in ("rules", "states") else None
        shown = json.dumps(value) if rows is None else "[\n  " + ",\n  ".join(map(json.dumps, rows)) + "\n ]"
        parts.append(f" {json.dumps(name)}: {shown}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


if __name__ == "__main__":
    sys.stdout.write(text())
