"""The tables of lexer and parser, which build_tables.py makes from grammar.lark: reading them takes a hundredth of building them."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

FILE = Path(__file__).with_name("tables.json")


class Rule(NamedTuple):
    """A production."""

    origin: str
    parts: tuple[str, ...]  # names of terminals are in capitals
    method: str  # of the tree builder; "": the parts become parts of the rule above
    is_unit: bool  # the value is that of the only part


class Tables(NamedTuple):
    """Terminals, productions and LALR states."""

    pattern: re.Pattern[str]  # matches one token; the name of its group is the kind
    keywords: dict[str, str]  # text of a NAME → kind
    ignored: frozenset[str]  # kinds that are no tokens
    rules: tuple[Rule, ...]
    states: list[dict[str, int]]  # for each state, from the start, and each symbol: the next state; below 0: reduce rule -1 - n
    end: int


@cache
def tables() -> Tables:
    """The tables of the language."""
    found = json.loads(FILE.read_text(encoding="utf-8"))
    return Tables(
        re.compile(found["pattern"]), found["keywords"], frozenset(found["ignored"]),
        tuple(Rule(origin, tuple(parts), method, unit) for origin, parts, method, unit in found["rules"]),
        found["states"], found["end"],
    )  # fmt: skip
