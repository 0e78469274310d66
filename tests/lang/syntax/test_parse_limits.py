"""Input made to overflow a parser ends at once with a message that names the limit."""

import time

import pytest
from maquette.lang.diagnostics import Diagnostics, render_text
from maquette.lang.syntax import ast, parser

DEEP = "operators, calls and blocks more than 1000 deep"
NAME_PARTS = "give parts of it a name with `let`; add up long lists with `fold`"
BRACKETS = "brackets more than 200 deep"


def answer(text: str) -> tuple[ast.File, list[str]]:
    diagnostics = Diagnostics()
    file = parser.parse(text, "t", diagnostics)
    return file, [f"{d.span}: {d.message}" for d in diagnostics.items]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 1_000_000, f"t:1:201: {BRACKETS}"),
        ("let x = " + "(" * 1_000_000, f"t:1:209: {BRACKETS}"),
        ("f(){" * 250_000, f"t:1:802: {BRACKETS}"),
        ("let x = 1" + "+1" * 5_000, f"t:1:1: {DEEP}"),
        ("let x = " + "- " * 5_000 + "1", f"t:1:1: {DEEP}"),
        ("let x = " + "not " * 5_000 + "a", f"t:1:1: {DEEP}"),
        ("let x = " + "if a then b else " * 5_000 + "c", f"t:1:1: {DEEP}"),
        ("let x = 1" + "^2" * 5_000, f"t:1:1: {DEEP}"),
        ("let x = " + "|a| " * 5_000 + "a", f"t:1:1: {DEEP}"),
        ("if (a) { }" + " else if (a) { }" * 5_000, f"t:1:1: {DEEP}"),
        ("f" + "()" * 5_000, f"t:1:1: {DEEP}"),
        ("f" + "[0]" * 5_000, f"t:1:1: {DEEP}"),
        ("f" + ".a" * 5_000, f"t:1:1: {DEEP}"),
        ("f" + "{}" * 5_000, f"t:1:1: {DEEP}"),
        ("let x = " + "if " * 5_000, "t:1:15006: a value is missing after `if`"),
    ],
    ids=range(15),
)
def test_depth(text, message):
    start = time.perf_counter()
    _, messages = answer(text)
    assert messages == [message]
    assert time.perf_counter() - start < 10  # two seconds on an idle machine


def test_the_message_has_a_hint():
    text = "let x = 1" + "+1" * 1500
    diagnostics = Diagnostics()
    parser.parse(text, "t", diagnostics)
    assert [(d.message, d.hint) for d in diagnostics.items] == [(DEEP, NAME_PARTS)]


def test_parsing_continues_after_the_limit():
    file, messages = answer("box()\nlet x = 1" + "+1" * 1500 + "\nsphere(1)\nlet y = 2 2")
    assert [type(i).__name__ for i in file.items] == ["ElementItem", "ElementItem"]
    assert messages == [f"t:2:1: {DEEP}", "t:4:11: an operator or the end of the line is missing before `2`"]
    assert file.broken == {"x", "y"}


def test_items_before_too_many_brackets_are_parsed():
    file, messages = answer("box()\nlet x = 1\nlet y = " + "[" * 300 + "\nsphere(1)")
    assert len(file.items) == 2
    assert messages == [f"t:3:209: {BRACKETS}"]


def test_depth_within_the_limit_is_fine():
    for text in ("let x = 1" + "+1" * 990, "let x = " + "(" * 180 + "1" + ")" * 180, "let x = " + "[" * 190 + "]" * 190):
        assert answer(text)[1] == []


@pytest.mark.long
def test_many_errors_are_cut():
    _, messages = answer("let a 1\n" * 5000)
    assert len(messages) == 101
    assert messages[-1] == "t: more than 100 syntax errors; the rest is not shown"


@pytest.mark.long
def test_many_mistakes_are_cut():
    for text in ("!\n" * 100_000, '"\n' * 100_000, "# x\n" * 100_000, ")\n" * 5_000, "f(\n1 2)\n" * 2000):
        assert len(answer(text)[1]) == 101


def test_unclosed_brackets_on_many_lines():
    _, messages = answer("sphere(1\n" * 30)
    assert messages[0] == "t:1:7: this `(` is not closed"
    assert len(messages) == 30


def test_a_large_file_is_refused():
    file, messages = answer(" " * 4_100_000)
    assert messages == ["t: the file has 4.1 MB; a scene has 4 MB at most"]
    assert file.items == ()


def test_long_words_are_cut_in_messages():
    text = f'let a = 1 "{"x" * 5000}"'
    diagnostics = Diagnostics()
    parser.parse(text, "t", diagnostics)
    printed = render_text(diagnostics.items[0], lambda _: text)
    assert max(map(len, printed.splitlines())) < 250
