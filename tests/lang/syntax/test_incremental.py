"""The incremental parser answers as a fresh parse does, after any edits, and keeps the trees of items that an edit leaves alone."""

import time
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.syntax import ast, parser
from maquette.lang.syntax.incremental import IncrementalParser

SCENES = [path.read_text(encoding="utf-8") for path in sorted((Path(__file__).parents[1] / "scenes").glob("*.scene"))]
LINES = (
    "let a = 1", "sphere(a)", "let b = a +", "  2", "else", "} else {", "if (a) {", "for (k in 0..3) {", "group() {", "  box()", "}",
    "x = 3", "a = a", "f(", ")", "let c = [1,", "// one", "  // two", "# hash", "#12 box()", "/* open", "close */", '"open', "", "",
    "foo(1) // after", "use as", "as b", "let", "unit in", "mesh(unit: 1)", "sphere(1); box(2) 3", "{", "a, b", "é = 1", "<", "!",
    "translate(a) sphere(a)", "let d = {", "let p = f(|x| {", "  a * 2", "})", "let q = { let r = 1; r }",
)  # fmt: skip
MARKS = (*'()[]{}\n;"/#+=! ', "\n\n", "//", "/*", " 2 2", " {", "\ufeff", "\u2028")
insertions = st.sampled_from((*MARKS, *LINES))


def answer(text: str) -> tuple[ast.File, list]:
    diagnostics = Diagnostics()
    return parser.parse(text, "t", diagnostics), diagnostics.items


def check(incremental: IncrementalParser, text: str) -> ast.File:
    """The tree of the next text, which has to be that of a fresh parse, as have the messages."""
    diagnostics = Diagnostics()
    file = incremental.parse(text, diagnostics)
    fresh, messages = answer(text)
    assert diagnostics.items == messages
    assert file == fresh
    return file


@pytest.mark.long
@settings(max_examples=150, deadline=20_000)
@given(
    st.one_of(st.sampled_from(SCENES), st.lists(st.sampled_from(LINES), max_size=25).map("\n".join)),
    st.lists(st.tuples(st.floats(0, 1), st.sampled_from([0, 0, 0, 1, 1, 4, 40]), insertions), max_size=8),
)
@example("x = 3\n", [(0.0, 0, "let x = 1\n"), (0.0, 3, "par")])
def test_any_edits(text, edits):
    incremental = IncrementalParser("t")
    check(incremental, text)
    before = text
    for place, removed, inserted in edits:
        at = round(place * len(text))
        before, text = text, text[:at] + inserted + text[at + removed :]
        check(incremental, text)
    check(incremental, before)


@pytest.mark.long
@settings(max_examples=150, deadline=20_000)
@given(st.lists(st.lists(st.sampled_from(LINES), max_size=12), min_size=2, max_size=6))
def test_any_texts(texts):
    incremental = IncrementalParser("t")
    for lines in texts:
        check(incremental, "\n".join(lines))


@pytest.mark.parametrize(
    "text",
    [
        "", "\n", "// alone", "\ufefflet a = 1\nlet b = 2\n", "let a = 1 // after\n// above b\n\nlet b = 2\n// last\n",
        "let a = 1\n# wrong comment\nlet b = 2\n", "let a = 1\nlet b = f(\nlet c = 3\nbox()\n", "box(\nsphere(1)\nball(2)\n",
        "a() {\nbox()\n}\nb() {\n  c()\n", "x() {\n  a() {\n}\nb() {\n  c()\n", '  ""{\n   "\n}""{', "a + b\n+ c\nd()\n",
        "let a = 1 +\nb\nc()\n", "if (a) { }\nelse { }\nb()\n", "f()\n/* a\nb() */\nc()\n/* d\ne()\n", "f() 2\ng(1) 2\nh() 2\ng\n",
        "f(" + "[" * 150 + "\nlet a = " + "[" * 100 + "\nlet b = 1\n", "let a 1\n" * 150, "f(\n1 2)\n" * 30, ")\nlet a = 1\n" * 30,
        "let a = 1!\n" * 1200, "let x = 1" + "+1" * 1500 + "\nbox()\n", " " * 4_100_000,
    ],
    ids=range(23),
)  # fmt: skip
def test_texts_whose_parts_depend_on_each_other(text):
    incremental = IncrementalParser("t")
    for edited in (text, "let q = 1\n\n" + text, text + "\nlet r = 1\n", text):
        check(incremental, edited)


BLOCK = """let a = 1
let p = pattern(|x, y, z| {
  let row = floor(z / a)  // of a brick
  let f(k) = { let c = k * row; c + 1 }
  if row > 1 then f(row) else { let d = 2; d }
})
sphere(a, material: lambert(p))
"""


@pytest.mark.long
def test_a_block_expression_typed_letter_by_letter():
    """With and without the `}` and `)` that editors insert after a `{` and a `(`; then deleted from its end."""
    first, last = BLOCK.index("let p"), BLOCK.index("sphere")
    for closers in ("", "})"):
        incremental = IncrementalParser("t")
        for end in (*range(first, last), *range(last, first, -1)):
            rest = closers if "{" in BLOCK[first:end] and end < last - 3 else ""
            check(incremental, BLOCK[:end] + rest + "\n" + BLOCK[last:])


def test_items_that_an_edit_leaves_alone_are_the_same_objects():
    lines = ["let a = 1", "", "// a ball", "sphere(a) // round", "group() {", "  box(1)", "}", "let b = 2"]
    incremental = IncrementalParser("t")
    before = check(incremental, "\n".join([*lines, ""]))
    after = check(incremental, "\n".join([*lines[:5], "  box(1, 2)", *lines[6:], ""]))
    assert [a is b for a, b in zip(before.items, after.items, strict=True)] == [True, True, False, True]
    wrong = check(incremental, "\n".join([*lines[:5], "  box(1 2)", *lines[6:], ""]))
    assert [a is b for a, b in zip(before.items, wrong.items, strict=True)] == [True, True, False, True]


def test_items_below_a_new_line_are_moved():
    """They are not parsed again: a message that would name their line is the exception."""
    incremental = IncrementalParser("t")
    check(incremental, "let a = 1\n\nsphere(a)\nlet d = f(1\nlet e = 2\n")
    after = check(incremental, "let a = 1\n\n\nsphere(a)\nlet d = f(1\nlet e = 2\n")
    assert [item.span.line for item in after.items] == [1, 4, 6]


def test_a_file_that_was_parsed_stays_as_it_is():
    incremental = IncrementalParser("t")
    before = check(incremental, "let a = 1\nsphere(a)\n")
    check(incremental, "\n\nlet a = 1\nsphere(a)\n")
    assert before == answer("let a = 1\nsphere(a)\n")[0]


@pytest.mark.long
def test_a_keystroke_takes_a_fraction_of_a_parse():
    lines = [f"sphere({k % 7}, at: [{k}, {k % 13}, 0.5], material: metal)" for k in range(300)]
    incremental = IncrementalParser("t")
    check(incremental, "\n".join(lines))
    texts = ["\n".join([*lines[:150], f"box({k})", *lines[151:]]) for k in range(5)]
    typed = min(cpu(lambda text=text: incremental.parse(text, Diagnostics())) for text in texts)
    assert typed < cpu(lambda: answer(texts[0])) / 5


def cpu(run) -> float:
    """Seconds of this process."""
    start = time.process_time()
    run()
    return time.process_time() - start
