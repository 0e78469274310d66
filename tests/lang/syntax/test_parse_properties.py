"""Properties of the parser: random text never raises, valid trees come back from their text, no comment is lost."""

import re
import string
from pathlib import Path

import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.syntax import ast, parser
from maquette.lang.syntax.formatter import format_text
from maquette.lang.syntax.lexer import KEYWORDS

SCENES = [path.read_text(encoding="utf-8") for path in sorted((Path(__file__).parents[1] / "scenes").glob("*.scene"))]

WORDS = [
    *KEYWORDS, "a", "box", "1", "2.5mm", "50%", '"s"', "#fff", "#12", '"open', "//c\n", "/*", "*/", "# ", "!", "\u200b", "\n", "\n", ";",
    *"()[]{},:=.|+-*/^<>", "..", "<=", ">=", "==", "!=", "let x = ", "group() {", "}\n", "if (a) {", "for (k in ks) {", "sphere(1)\n",
    "let x = {", "{ let x = 1; x }", "|x| {",
]  # fmt: skip


@pytest.mark.long
@settings(max_examples=400, deadline=20_000)
@given(st.lists(st.sampled_from(WORDS), max_size=60), st.sampled_from(["", " "]))
@example(["50%", "group() {", "}", "{"], "")
@example(["50%", "group() {", "}", "[1]"], "")
@example(['  ""{\n   "\n}""{'], "")
def test_token_soup_never_raises(words, between):
    text = between.join(words)
    diagnostics = Diagnostics()
    file = parser.parse(text, "t", diagnostics)
    lines = text.count("\n") + 1
    for d in diagnostics.items:
        assert d.message
        assert d.span is not None
        assert 1 <= d.span.line <= lines
        assert not any(name in d.message + d.hint for name in ("__ANON", "RPAR", "LBRACE", "_NL", "$END", "\0"))
    assert_no_broken_name(file)
    places = [(d.span.line, d.span.column) for d in diagnostics.items if d.span]
    assert places == sorted(places)


@pytest.mark.long
@settings(max_examples=100, deadline=20_000)
@given(st.text(max_size=200))
def test_any_text_never_raises(text):
    parser.parse(text, "t", Diagnostics())


@settings(max_examples=100, deadline=20_000)
@given(st.binary(max_size=100))
def test_any_bytes_never_raise(data):
    diagnostics = Diagnostics()
    assert (parser.decode(data, "t", diagnostics) is None) == diagnostics.failed


@pytest.mark.long
@settings(max_examples=80, deadline=20_000)
@given(st.sampled_from(SCENES), st.integers(0, 2000), st.integers(0, 12))
def test_a_hole_in_a_scene_never_raises(text, start, size):
    start %= len(text)
    parser.parse(text[:start] + text[start + size :], "t", Diagnostics())


def assert_no_broken_name(node: ast.Node) -> None:
    waiting = [node]
    while waiting:
        n = waiting.pop()
        assert not (isinstance(n, ast.Name) and "\0" in n.id)
        waiting.extend(ast.children(n))


# --- random trees, written and read again -----------------------------------------------------------------------------

names = st.text(string.ascii_lowercase + "_é", min_size=1, max_size=6).filter(lambda s: s not in KEYWORDS)
leaves = st.one_of(
    names,
    st.sampled_from(["0", "1.5", "3mm", "40%", "1e-3", "#abc", "#a0b1c2", '"text"', '"a // b"', '"\\""', "[]"]),
)


def _expressions(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    operand = inner.map(lambda e: f"({e})")
    operators = st.sampled_from(["+", "-", "*", "/", "^", "..", "<", "<=", ">", ">=", "==", "!=", "and", "or"])
    return st.one_of(
        st.tuples(operand, operators, operand).map(" ".join),
        st.tuples(st.sampled_from(["-", "not"]), operand).map(" ".join),
        st.lists(inner, min_size=1, max_size=3).map(lambda es: f"[{', '.join(es)}]"),
        st.tuples(inner, names, inner).map(lambda t: f"[{t[0]} for {t[1]} in {t[2]}]"),
        st.tuples(operand, operand, inner).map(lambda t: f"if {t[0]} then {t[1]} else {t[2]}"),
        st.tuples(names, names, inner).map(lambda t: f"|{t[0]}, {t[1]}| {t[2]}"),
        st.tuples(names, names, inner, inner).map(lambda t: f"{t[0]}({t[2]}, {t[1]}: {t[3]})"),
        st.tuples(names, names).map(".".join),
        st.tuples(names, inner).map(lambda t: f"{t[0]}[{t[1]}]"),
        _blocks(inner),
    )


def _blocks(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Block expressions in one line, and in several with blank lines. A sign cannot begin a line."""
    lets = st.one_of(
        st.tuples(names, inner).map(lambda t: f"let {t[0]} = {t[1]}"),
        st.tuples(names, names, inner).map(lambda t: f"let {t[0]}({t[1]}, b = 1) = {t[2]}"),
    )
    result = inner.map(lambda e: f"({e})" if e.startswith("-") else e)
    separators = st.sampled_from(["; ", "\n", "\n\n", ";\n"])
    ends = st.sampled_from([" ", "\n"])
    return st.builds(
        lambda items, value, between, end: "{" + end + between.join([*items, value]) + end + "}",
        st.lists(lets, min_size=1, max_size=3), result, separators, ends,
    )  # fmt: skip


expressions = st.recursive(leaves, _expressions, max_leaves=8)


def _items(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    block = st.lists(inner, max_size=3).map(lambda items: "{\n" + "\n".join(items) + "\n}")
    return st.one_of(
        st.tuples(names, block).map(lambda t: f"{t[0]}() {t[1]}"),
        st.tuples(names, expressions, block).map(lambda t: f"for ({t[0]} in {t[1]}) {t[2]}"),
        st.tuples(expressions, block, block).map(lambda t: f"if ({t[0]}) {t[1]} else {t[2]}"),
        st.tuples(names, names, block).map(lambda t: f"let {t[0]}({t[1]}, b: int = 1) = group() {t[2]}"),
    )


simple_items = st.one_of(
    st.tuples(names, expressions).map(lambda t: f"let {t[0]} = {t[1]}"),
    st.tuples(names, expressions).map(lambda t: f"{t[0]}({t[1]})"),
    st.tuples(names, names, expressions).map(lambda t: f'param {t[0]}: {t[1]} = 1 in {t[2]} "doc"'),
)
scenes = st.lists(st.recursive(simple_items, _items, max_leaves=6), max_size=4).map("\n".join)


def written(node) -> str:
    """A tree as text, each value in one line, with single spaces."""
    match node:
        case ast.Number() | ast.ColorLiteral():
            return node.text
        case ast.String():
            return '"' + node.value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'
        case ast.Name():
            return node.id
        case ast.ListLiteral():
            return "[" + ", ".join(map(written, node.items)) + "]"
        case ast.Comprehension():
            end = f" if {written(node.condition)}" if node.condition else ""
            return f"[{written(node.body)} for {node.name.id} in {written(node.source)}{end}]"
        case ast.Conditional():
            return f"if {written(node.condition)} then {written(node.yes)} else {written(node.no)}"
        case ast.Function():
            return "|" + ", ".join(n.id for n in node.parameters) + "| " + written(node.body)
        case ast.Binary():
            return f"{written(node.left)} {node.op} {written(node.right)}"
        case ast.Unary():
            return f"{node.op} {written(node.operand)}"
        case ast.Parens():
            return f"({written(node.inner)})"
        case ast.Member():
            return f"{written(node.object)}.{node.name.id}"
        case ast.Index():
            return f"{written(node.object)}[{written(node.index)}]"
        case ast.Call():
            return f"{written(node.function)}({', '.join(map(written, node.arguments))})"
        case ast.Argument():
            return f"{node.name.id}: {written(node.value)}" if node.name else written(node.value)
        case ast.Block():
            return "{\n" + "\n".join(map(written, node.items)) + "\n}"
        case ast.BlockExpression():
            return "{\n" + "\n".join(map(written, (*node.lets, node.result))) + "\n}"
        case ast.WithChildren():
            return f"{written(node.target)} {written(node.block)}"
        case _:
            return written_item(node)


def written_item(node) -> str:
    match node:
        case ast.ElementItem() | ast.Result():
            return written(node.expression)
        case ast.For():
            return f"for ({node.name.id} in {written(node.source)}) {written(node.block)}"
        case ast.If():
            return f"if ({written(node.condition)}) {written(node.yes)}" + (f" else {written(node.no)}" if node.no else "")
        case ast.Let():
            parameters = "" if node.parameters is None else f"({', '.join(map(written_item, node.parameters))})"
            return f"let {node.name.id}{parameters} = {written(node.value)}"
        case ast.Parameter() | ast.Param():
            type_ = f": {node.type.id}" if node.type else ""
            default = f" = {written(node.default)}" if node.default else ""
            if isinstance(node, ast.Parameter):
                return node.name.id + type_ + default
            range_ = f" in {written(node.range)}" if node.range else ""
            return f"param {node.name.id}{type_}{default}{range_}" + (f" {written(node.doc)}" if node.doc else "")
        case ast.Use():
            return f"use {written(node.path)}" + (f" as {node.alias.id}" if node.alias else "")
    assert isinstance(node, ast.Unit)
    return f"unit {node.name.id}"


@pytest.mark.long
@settings(max_examples=100, deadline=20_000)
@given(scenes)
def test_trees_come_back_from_their_text(read, shown, text):
    file = read(text)
    again = read("\n".join(map(written, file.items)))
    assert shown(again.items) == shown(file.items)


@pytest.mark.long
@settings(max_examples=100, deadline=20_000)
@given(scenes, st.randoms(use_true_random=False))
def test_layout_changes_no_tree_and_loses_no_comment(read, shown, text, chance):
    """A comment and a line end can replace a space inside ( ) or [ ]."""
    strewn, depth = "", 0
    for part in re.split(r'("(?:\\.|[^"\\])*"|[()\[\]{} ])', text):
        depth += (part in ("(", "[")) - (part in (")", "]"))
        inside = depth > 0 and "{" not in text and chance.random() < 0.2
        strewn += f" // {len(strewn)}\n" if part == " " and inside else part
    before = read(strewn)
    done = format_text(strewn, "t", Diagnostics())
    assert done is not None
    after = read(done)
    assert shown(after.items) == shown(before.items)
    assert comments_of(after) == comments_of(before)
    assert format_text(done, "t", Diagnostics()) == done


@pytest.mark.long
@settings(max_examples=300, deadline=20_000)
@example(["/", "/", "# "], "")
@given(st.lists(st.sampled_from(WORDS), max_size=40), st.sampled_from(["", " "]))
def test_layout_of_token_soup_never_raises(shown, words, between):
    """Text without errors has the same tree and comments after formatting, and formatting is idempotent."""
    text = between.join(words)
    diagnostics = Diagnostics()
    done = format_text(text, "t", diagnostics)
    assert (done is None) == diagnostics.failed
    if done is not None:
        before, after = parser.parse(text, "t", diagnostics), parser.parse(done, "t", diagnostics)
        assert not diagnostics.failed
        assert shown(after.items) == shown(before.items)
        assert comments_of(after) == comments_of(before)
        assert format_text(done, "t", diagnostics) == done


def comments_of(node: ast.Node) -> list[str]:
    found, waiting = [], [node]
    while waiting:
        n = waiting.pop()
        if isinstance(n, ast.Comment):
            found.append(n.text)
        waiting.extend(ast.children(n))
    return sorted(found)


@pytest.mark.long
@settings(max_examples=80, deadline=20_000)
@given(st.one_of(scenes, st.sampled_from(SCENES)), st.data())
def test_every_comment_is_in_the_tree_once(read, text, data):
    lines = [line.split(" //")[0] for line in text.splitlines() if not line.startswith("//") and "a // b" not in line]
    ends = data.draw(st.lists(st.integers(0, len(lines)), max_size=8))
    expected = []
    for n, end in enumerate(sorted(ends, reverse=True)):
        comment = f"// number {n:03}"
        if end and "//" not in lines[end - 1] and data.draw(st.booleans()):
            lines[end - 1] += " " + comment
        else:
            lines.insert(end, comment)
        expected.append(comment)
    assume(parses("\n".join(lines)))  # a line left out above may have held a bracket
    assert comments_of(read("\n".join(lines))) == sorted(expected)


def parses(text: str) -> bool:
    diagnostics = Diagnostics()
    parser.parse(text, "t", diagnostics)
    return not diagnostics.items
