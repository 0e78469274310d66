"""The syntax tree of valid text: every construct, precedence, places, comments and blank lines; decoding of bytes."""

from pathlib import Path

import pytest
from maquette.lang.diagnostics import Diagnostics, render_text
from maquette.lang.syntax import ast, parser

BLOCK = "(BlockExpression [(Let b None 1) (Let f [(Parameter c None None)] b)] (Result (Parens (Unary - b))))"
ARGUMENTS = (
    "(Call f [(Argument None (BlockExpression [(Let b None 1)] (Result b)))"
    " (Argument c (BlockExpression [(Let d None 2)] (Result (Unary - d))))])"
)
BRANCHES = "(Conditional a (BlockExpression [(Let b None 1)] (Result b)) (BlockExpression [(Let c None 2)] (Result c)))"
ITEM_CHOICE = "(If a (Block [(Let b None 1) (ElementItem b)]) (Block [(Let c None 1) (ElementItem c)]))"
LOOP = "(For k (BlockExpression [(Let n None 3)] (Result (Binary .. 0 n))) (Block [(ElementItem k)]))"
NESTED = "(BlockExpression [(Let b None 1)] (Result (BlockExpression [(Let c None 2)] (Result c))))"
CHILDREN = "(BlockExpression [(Let b None 1)] (Result (WithChildren (Call group []) (Block [(ElementItem b)]))))"


@pytest.mark.parametrize(("name", "count"), [("hello", 9), ("room", 12), ("gear", 10)])
def test_scenes_of_the_language_description(read, name, count):
    text = (Path(__file__).parents[1] / "scenes" / f"{name}.scene").read_text(encoding="utf-8")
    assert len(read(text).items) == count


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ("1..5", "(Binary .. 1 5)"),
        ("5mm", "5mm"),
        ("50%", "50%"),
        ("1e-3m", "1e-3m"),
        ("2.5e3", "2.5e3"),
        ("24°", "24°"),
        ("#fff", "#fff"),
        ("2.4 * teeth", "(Binary * 2.4 teeth)"),
        ("a - b - c", "(Binary - (Binary - a b) c)"),
        ("a + b * c", "(Binary + a (Binary * b c))"),
        ("a / b * c", "(Binary * (Binary / a b) c)"),
        ("-a ^ b", "(Unary - (Binary ^ a b))"),
        ("a ^ -b", "(Binary ^ a (Unary - b))"),
        ("a ^ b ^ c", "(Binary ^ a (Binary ^ b c))"),
        ("-a * b", "(Binary * (Unary - a) b)"),
        ("a * -b", "(Binary * a (Unary - b))"),
        ("(a + b) * c", "(Binary * (Parens (Binary + a b)) c)"),
        ("not a == b", "(Unary not (Binary == a b))"),
        ("not a and b or c", "(Binary or (Binary and (Unary not a) b) c)"),
        ("a or b and c", "(Binary or a (Binary and b c))"),
        ("0..n - 1", "(Binary .. 0 (Binary - n 1))"),
        ("a < 1 + b", "(Binary < a (Binary + 1 b))"),
        ("if a then b else if c then d else e", "(Conditional a b (Conditional c d e))"),
        ("|x, y| x + y", "(Function [x y] (Binary + x y))"),
        ("a.b(c)[d]", "(Index (Call (Member a b) [(Argument None c)]) d)"),
        ("f()", "(Call f [])"),
        ("f(a, b: c,)", "(Call f [(Argument None a) (Argument b c)])"),
        ("[]", "(ListLiteral [])"),
        ("[1, 2,]", "(ListLiteral [1 2])"),
        ("[k * 2 for k in 0..5]", "(Comprehension (Binary * k 2) k (Binary .. 0 5) None)"),
        ("[k for k in ks if k > 2]", "(Comprehension k k ks (Binary > k 2))"),
        ('"a \\"b\\" \\\\ c\\nd"', '"a "b" \\ c\nd"'),
        ("group() { box() }", "(WithChildren (Call group []) (Block [(ElementItem (Call box []))]))"),
        ("{ let b = 1; b }", "(BlockExpression [(Let b None 1)] (Result b))"),
        ("{\n  let b = 1\n  let f(c) = b\n\n  (-b)\n  // end\n}", BLOCK),
        ("|x| { let b = x; |y| b }", "(Function [x] (BlockExpression [(Let b None x)] (Result (Function [y] b))))"),
        ("f({ let b = 1; b }, c: { let d = 2; -d })", ARGUMENTS),
        ("if a then { let b = 1; b } else { let c = 2; c }", BRANCHES),
        ("{ let b = 1; if (b) then c else d }", "(BlockExpression [(Let b None 1)] (Result (Conditional (Parens b) c d)))"),
        ("{ let b = 1\n{ let c = 2; c } }", NESTED),
        ("{ let b = 1; group() { b } }", CHILDREN),
        ("users + format + android + information", "(Binary + (Binary + (Binary + users format) android) information)"),
    ],
)
def test_expression(read, shown, text, tree):
    (item,) = read(f"let it = {text}").items
    assert shown(item.value) == tree


@pytest.mark.parametrize(
    ("text", "tree"),
    [
        ('use "std/room"', '(Use "std/room" None)'),
        ('use "robot.usdz" as robot', '(Use "robot.usdz" robot)'),
        ("unit mm", "(Unit mm)"),
        ("param n = 3", "(Param n None 3 None None)"),
        ('param n: int = 3 in 1..9 "how many"', '(Param n int 3 (Binary .. 1 9) "how many")'),
        ("let a = 1", "(Let a None 1)"),
        ("let a() = 1", "(Let a [] 1)"),
        ("let f(a, b: int) = a", "(Let f [(Parameter a None None) (Parameter b int None)] a)"),
        ("let f(c = 2, d: int = 3) = c", "(Let f [(Parameter c None 2) (Parameter d int 3)] c)"),
        ("for (k in ks) { f(k) }", "(For k ks (Block [(ElementItem (Call f [(Argument None k)]))]))"),
        ("if (a) { }", "(If a (Block []) None)"),
        ("if (a) { } else { b }", "(If a (Block []) (Block [(ElementItem b)]))"),
        ("if (a) { } else if (b) { }", "(If a (Block []) (If b (Block []) None))"),
        ("a.b(c)[d] { }", "(ElementItem (WithChildren (Index (Call (Member a b) [(Argument None c)]) d) (Block [])))"),
        ("children", "(ElementItem children)"),
        ("f() { let a = 1\n a }", "(ElementItem (WithChildren (Call f []) (Block [(Let a None 1) (ElementItem a)])))"),
        ("if (a) { let b = 1; b } else { let c = 1; c }", ITEM_CHOICE),
        ("for (k in { let n = 3; 0..n }) { k }", LOOP),
    ],
)
def test_item(read, shown, text, tree):
    (item,) = read(text).items
    assert shown(item) == tree


@pytest.mark.parametrize(
    "text",
    [
        "let a = 1 +\n  2",
        "let a =\n  1 + 2",
        "let a = 1\t+ 2 // three\n",
        "\ufefflet a = 1 + 2",
        "let a = 1 + 2\r\n",
        "\n\n;;let a = 1 + 2;;\n ; \n",
        "let a = 1 +\r\n\r\n // more\r\n 2",
        "let a = 1\u00a0+ 2",
    ],
)
def test_line_ends_and_blanks_inside_brackets_are_ignored(read, shown, text):
    (item,) = read(text).items
    assert shown(item) == "(Let a None (Binary + 1 2))"


def test_items_end_with_lines_and_semicolons(read):
    assert len(read("a; b\nc;\n\n;d").items) == 4


def test_lines_go_on_inside_brackets_but_not_inside_their_blocks(read, shown):
    (item,) = read("f(a,\n  [1\n  , 2]\n  , group() {\n  b\n  c\n}\n)").items
    group = "(WithChildren (Call group []) (Block [(ElementItem b) (ElementItem c)]))"
    assert shown(item) == f"(ElementItem (Call f [(Argument None a) (Argument None (ListLiteral [1 2])) (Argument None {group})]))"


def test_else_may_start_a_line(read):
    (item,) = read("if (a) { b }\n\nelse { c }").items
    assert isinstance(item, ast.If)
    assert item.no is not None


def test_empty_files(read):
    for text in ("", "\n\n", ";", "   ", "\ufeff"):
        file = read(text)
        assert (file.items, file.dangling) == ((), ())


def test_spans_count_from_one_and_end_exclusively(read):
    (item,) = read("// a\n  let a = f(1,\n    2) // b").items
    assert isinstance(item, ast.Let)
    assert str(item.span) == "t:2:3"
    assert (item.span.end_line, item.span.end_column) == (3, 7)
    assert isinstance(item.value, ast.Call)
    assert (item.value.span.line, item.value.span.column) == (2, 11)
    argument = item.value.arguments[1]
    assert (argument.span.line, argument.span.column, argument.span.end_column) == (3, 5, 6)


def test_comments_and_blank_lines(read):
    file = read(
        "// head\n\n// of a\na // behind a\n\nb(1, // first\n  2)\n"
        "group() { // of c\n\n  // more of c\n  c; d // behind d\n  // last inside\n} // behind group\n// end\n"
    )
    a, b, group = file.items
    texts = [[c.text for c in item.before] for item in file.items]
    assert texts == [["// head", "// of a"], ["// first"], []]
    assert [item.after.text if item.after else None for item in file.items] == ["// behind a", None, "// behind group"]
    assert [item.blank_before for item in (a, b, group)] == [False, True, False]
    assert [c.text for c in file.dangling] == ["// end"]
    assert isinstance(group, ast.ElementItem)
    assert isinstance(group.expression, ast.WithChildren)
    block = group.expression.block
    c, d = block.items
    assert [x.text for x in c.before] == ["// of c", "// more of c"]
    assert (c.after, d.after.text if d.after else None) == (None, "// behind d")
    assert [x.text for x in block.dangling] == ["// last inside"]


def test_comments_of_a_block_expression(read):
    (item,) = read("let a = {\n  // above\n  let b = 1 // after\n\n  // of the value\n  b\n  // last\n} // behind").items
    block = item.value
    assert [c.text for c in (*block.lets[0].before, block.lets[0].after, *block.result.before, *block.dangling, item.after)] == [
        "// above", "// after", "// of the value", "// last", "// behind",
    ]  # fmt: skip
    assert block.result.blank_before


def test_comment_between_the_branches_of_an_if(read):
    (item,) = read("if (a) { // one\n  b\n} // two\n// three\nelse if (c) { d } // four").items
    assert [c.text for c in item.before] == ["// two", "// three"]
    assert item.after is not None
    assert item.after.text == "// four"
    assert isinstance(item, ast.If)
    assert [c.text for c in item.yes.items[0].before] == ["// one"]


def test_good_items_survive_and_broken_names_are_known(shown):
    diagnostics = Diagnostics()
    text = 'let a = 1\nlet b = = 2\nuse "x.scene" c\ngroup() {\n  let d = 1 1\n  box()\n}\nlet e = "open\nparam f 3\nlet g = 2'
    file = parser.parse(text, "t", diagnostics)
    assert [type(i).__name__ for i in file.items] == ["Let", "ElementItem", "Let"]
    assert file.broken == {"b", "x", "d", "e", "f"}
    assert shown(file.items[1]) == "(ElementItem (WithChildren (Call group []) (Block [(ElementItem (Call box []))])))"
    assert len(diagnostics.items) == 5


def decoded(data: bytes) -> tuple[str | None, list[str]]:
    diagnostics = Diagnostics()
    text = parser.decode(data, "t", diagnostics)
    return text, [render_text(d, lambda _: None) for d in diagnostics.items]


def test_decode():
    assert decoded(b"a\r\nb\rc\n") == ("a\nb\nc\n", [])
    assert decoded(b"\xef\xbb\xbfa") == ("a", [])
    assert decoded(b"") == ("", [])
    assert decoded(b"\x89PNG\r\n\x00\x01") == (None, ["t: error: this is a binary file, no scene"])
    assert decoded(b"let a = 1\n// caf\xe9") == (None, ["t: error: line 2 is not UTF-8 text (byte 0xe9)\n  save the file as UTF-8"])
    too_large = "t: error: the file has 4.1 MB; a scene has 4 MB at most\n  put large meshes and tables into files of their own"
    assert decoded(b" " * 4_100_000) == (None, [too_large])


def test_zero_bytes_are_told_with_their_places():
    data = b'sphere(1)\nlet a =\0 1\nlet b = "x\0y"  // in a comment \0 it is none\n' + b"// more\n" * 20
    diagnostics = Diagnostics()
    text = parser.decode(data, "t", diagnostics)
    assert text is not None
    parser.parse(text, "t", diagnostics)
    assert [render_text(d, lambda _: text) for d in diagnostics.items] == [
        "t:2:8: error: the language has no invisible character U+0000\n   2 | let a =␀ 1\n     |        ^ delete it",
        't:3:11: error: a string has no invisible character U+0000\n   3 | let b = "x␀y"  // in a comment ␀ it is none\n'
        "     |           ^ delete it",
    ]


def test_control_characters_of_strings_are_told():
    """Tabs are fine, and comments may have any of them."""
    for char, picture in (("\x07", "␇"), ("\x1b", "␛"), ("\x7f", "␡"), ("\x85", "\ufffd"), ("\x0c", "␌")):
        diagnostics = Diagnostics()
        text = f'let b = "a\t{char}b{char}"  // {char}\n'
        parser.parse(text, "t", diagnostics)
        assert [render_text(d, lambda _, text=text: text) for d in diagnostics.items] == [
            f't:1:12: error: a string has no invisible character U+{ord(char):04X}\n   1 | let b = "a {picture}b{picture}"  // {picture}\n'
            "     |            ^ delete it",
        ]


@pytest.mark.parametrize("code", [*range(0x202A, 0x202F), *range(0x2066, 0x206A)])
def test_characters_that_turn_text_around_are_told(code: int) -> None:
    diagnostics = Diagnostics()
    text = f'let b = "שלום{chr(code)}"\nlet c = 1  // {chr(code)} let c = 2 {chr(code)}\nlet d = 1 {chr(code)} + 1\n'
    parser.parse(text, "t", diagnostics)
    after = f"has the invisible character U+{code:04X}, which changes the direction of the text after it"
    hint = "delete it: editors may show code as part of the text, and text as code"
    assert [render_text(d, lambda _: text) for d in diagnostics.items] == [
        f't:1:14: warning: this string {after}\n   1 | let b = "שלום\ufffd"\n     |              ^ {hint}',
        f"t:2:15: warning: this comment {after}\n   2 | let c = 1  // \ufffd let c = 2 \ufffd\n     |               ^ {hint}",
        f"t:3:11: error: the language has no invisible character U+{code:04X}\n   3 | let d = 1 \ufffd + 1\n     |           ^ delete it",
    ]


def test_invisible_characters_are_named():
    diagnostics = Diagnostics()
    parser.parse("let x = 1\u200b + 2", "t", diagnostics)
    assert [(d.message, d.hint) for d in diagnostics.items] == [("the language has no invisible character U+200B", "delete it")]
