"""Text forms of diagnostics."""

from __future__ import annotations

import pytest
from maquette.lang.diagnostics import Diagnostic, Span, render_text, suggest


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("\x1b]0;title\x07.png", "␛]0;title␇.png"),  # sets the title of a terminal
        ("\x9b2J\x7f", "\ufffd2J␡"),
        ("\u202egnp.a\u2066", "\ufffdgnp.a\ufffd"),  # shown as a.png
        ("été 雪.png", "été 雪.png"),
    ],
)
def test_names_do_not_control_the_terminal(name: str, shown: str) -> None:
    """In the message, the quoted line and the calls; carets stay in place."""
    found = Diagnostic("error", f"there is no picture `{name}`", Span("a.scene", 1, 1, 1, 4), trace=((name, Span("b.scene", 2, 1, 2, 2)),))
    assert render_text(found, lambda _: f'image("{name}")') == (
        f"a.scene:1:1: error: there is no picture `{shown}`\n"
        f'   1 | image("{shown}")\n'
        "     | ^^^\n"
        f"  in {shown}, called at b.scene:2:1"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("word", "suggestion"),
    [
        ("ratius", "did you mean `radius`?"),
        ("brass", "did you mean `polished_brass` or `patina_brass`?"),  # no other name is like it but `amber_glass`
        ("hight", "did you mean `height`?"),
        ("color", "did you mean `base_color`?"),
        ("zebra", ""),
    ],
)
def test_names_like_an_unknown_word_are_suggested(word: str, suggestion: str) -> None:
    assert suggest(word, ["amber_glass", "polished_brass", "patina_brass", "radius", "height", "base_color"]) == suggestion


def test_words_are_not_compared_with_many_names() -> None:
    """100,000 names and 1,000 unknown words took minutes."""
    names = [f"name{k}" for k in range(100_000)]
    assert suggest("name1x", names[:1000]) == "did you mean `name1`?"
    assert suggest("name1x", names) == ""
