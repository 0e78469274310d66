"""Syntax errors as printed: each source with its whole messages, in parse_errors/*.txt.

A case is a source, a line `-----` and what is printed; a line `=====` stands between cases.
"""

from pathlib import Path

import pytest
from maquette.lang.diagnostics import Diagnostics, render_text
from maquette.lang.syntax import parser

FILES = sorted((Path(__file__).parent / "parse_errors").glob("*.txt"))
CASES = [case for file in FILES for case in file.read_text(encoding="utf-8").rstrip("\n").split("\n=====\n")]


def printed(source: str) -> str:
    """Every message of `source`, as `render_text` prints it, without blanks at the ends of lines."""
    diagnostics = Diagnostics()
    parser.parse(source, "t", diagnostics)
    text = "\n".join(render_text(d, lambda _: source) for d in diagnostics.items)
    return "\n".join(line.rstrip() for line in text.split("\n"))


@pytest.mark.parametrize("case", CASES, ids=[case.partition("\n")[0][:40] for case in CASES])
def test_message(case):
    source, _, expected = case.partition("\n-----\n")
    assert printed(source) == expected


def test_quoted_lines_are_those_of_the_text():
    source = "// one\u2028still one\f\n// two\r\nlet x = = 1\r\n"
    assert printed(source) == "t:3:9: error: a value is missing before `=`\n   3 | let x = = 1\n     |         ^"
