"""The tables of the parser are those of the grammar, and tokens cover every text."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from maquette.lang.syntax import grammar, lexer


def test_the_tables_are_those_of_the_grammar() -> None:
    assert grammar.TABLES.read_text(encoding="utf-8") == grammar.text(), "run `make grammar`"


@given(st.text(st.sampled_from('ab1.#f"\\/*\n;{}()[]<=>!|µ° \t\r\x0b\x85\u2028“×'), max_size=60))
def test_tokens_cover_every_text(text: str) -> None:
    """What lies between tokens is blank, and each token's place is that of its text."""
    at = 0
    lines = text.split("\n")
    for token in lexer.lex(text):
        assert not text[at : token.start_pos].strip()
        assert "\n" not in text[at : token.start_pos]
        assert text[token.start_pos : token.end_pos] == token
        assert lines[(token.line or 0) - 1][(token.column or 0) - 1 :].startswith(token.split("\n")[0])
        assert lines[(token.end_line or 0) - 1][: (token.end_column or 0) - 1].endswith(token.split("\n")[-1])
        at = token.end_pos or 0
    assert not text[at:].strip()
