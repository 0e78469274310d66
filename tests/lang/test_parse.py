"""The syntax tree of valid text: every construct, precedence, places, comments and blank lines; decoding of bytes."""

from dataclasses import fields

import pytest
from maquette.lang import ast, parse
from maquette.lang.diagnostics import Diagnostics, render_text

HELLO = """// hello.scene: right-handed, y up; bare lengths are metres
param radius = 1 in 0.2..2  "sphere radius"

let grey = checker(#e8e8e8, #8a8a8a, size: 50cm)
let red  = plastic(#d0402a, roughness: 0.15)

plane(y: 0, material: lambert(grey))
sphere(center: [0, radius, 0], radius: radius, material: red)

sun(from: [2, 4, 3], illuminance: 20000lx)
sky(color: #87b5e0, luminance: 3000nit)

camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
render(size: [800, 600], error: 1%)
"""

ROOM = """// room.scene
use "std/room"                                   // binds `room`
param hour = 20 in 0..24

let plaster = lambert(#c9c4bb)
let wood    = phong(image("oak.png"), specular: 0.2, shininess: 60)

room.box(size: [3, 2.5, 3], wall: plaster, left: lambert(#a33327), right: lambert(#3f7d3a))
room.panel(size: [60cm, 60cm], position: [0, 2.49, 0], flux: 1600lm)
spot(position: [-1.2, 2.3, 1], look_at: [0.5, 0, -0.4], cone: 24deg, soft: 6deg, flux: 800lm, color: kelvin(3000))

transform(translate: [0.6, 0, -0.5], rotate: [0, -18deg, 0]) {
  box(size: 60cm, center: [0, 30cm, 0], material: wood)
  mesh("bunny.obj", translate: [0, 60cm, 0], height: 35cm,
       material: blinn_phong(image("bunny.png"), shininess: 200))
}
sphere(radius: 40cm, center: [-0.7, 0.4, 0.2], material: glass(ior: 1.5))
if (hour > 18) { room.bulb(position: [1.2, 1.6, -1.2], flux: 400lm) }

camera(position: [0, 1.25, 3.9], look_at: [0, 1.1, 0], fov: 39deg)
render(backend: "ray", bounces: 6, error: 0.5%)
"""

GEAR = """// gear.scene
unit mm                                          // this file's bare lengths
param teeth: int = 18 in 6..60  "teeth per gear"

// Inside is where the relation holds: no sign convention to remember. x, y, z are plain numbers, in mm here.
let rim(n, r, h) = implicit(
  |x, y, z| hypot(x, z) + 0.9 * cos(n * atan2(z, x)) <= r and abs(y) <= h / 2,
  within: r + 2)

let gear(n: int = teeth, bore = 4) = difference(round: 0.6) {
  rim(n, 1.2 * n, 8)
  cylinder(radius: bore, height: 40)
  for (k in 0..5) {                              // inclusive; descending ranges are empty
    rotate([0, k * 60deg, 0]) { cylinder(radius: 0.2 * n, height: 40, center: [0.75 * n, 0, 0]) }
  }
}

let turned = 30deg / 1s * time                   // an angle
for (s in [[0, turned], [2.4 * teeth, 180deg / teeth - turned]]) {
  transform(translate: [s[0], 0, 0], rotate: [0, s[1], 0]) { gear(material: metal("steel")) }
}
implicit(|x, y, z| sin(x)*cos(y) + sin(y)*cos(z) + sin(z)*cos(x) == 0.2,
         within: sphere(6), translate: [20, 22, -30], material: glass())

camera(position: [20, 60, 70], look_at: [20, 0, 0], fov: 40deg)
animate(duration: 12s, fps: 24)
render(error: 1%, budget: 20s)
"""


def read(text: str) -> ast.File:
    """The tree of text that has no error."""
    diagnostics = Diagnostics()
    file = parse.parse(text, "t", diagnostics)
    assert [render_text(d, lambda _: text) for d in diagnostics.items] == []
    return file


def shown(node) -> object:
    """A tree without places, as text: (Kind field …)."""
    if isinstance(node, ast.Number):
        return node.text
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.String):
        return f'"{node.value}"'
    if isinstance(node, ast.ColorLiteral):
        return node.text
    if isinstance(node, tuple):
        return "[" + " ".join(str(shown(n)) for n in node) + "]"
    if isinstance(node, ast.Node):
        left_out = {"span", "before", "after", "blank_before", "dangling"}
        parts = [str(shown(getattr(node, f.name))) for f in fields(node) if f.name not in left_out]
        return f"({type(node).__name__} {' '.join(parts)})"
    return str(node)


def expression(text: str) -> object:
    (item,) = read(f"let it = {text}").items
    assert isinstance(item, ast.Let)
    return shown(item.value)


@pytest.mark.parametrize(("text", "count"), [(HELLO, 9), (ROOM, 12), (GEAR, 10)])
def test_scenes_of_the_language_description(text, count):
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
        ("if a then b else if c then d else e", "(Choose a b (Choose c d e))"),
        ("|x, y| x + y", "(Function [x y] (Binary + x y))"),
        ("a.b(c)[d]", "(Index (Call (Member a b) [(Argument None c)]) d)"),
        ("f()", "(Call f [])"),
        ("f(a, b: c,)", "(Call f [(Argument None a) (Argument b c)])"),
        ("[]", "(ListLiteral [])"),
        ("[1, 2,]", "(ListLiteral [1 2])"),
        ("[k * 2 for k in 0..5]", "(Each (Binary * k 2) k (Binary .. 0 5) None)"),
        ("[k for k in ks if k > 2]", "(Each k k ks (Binary > k 2))"),
        ('"a \\"b\\" \\\\ c\\nd"', '"a "b" \\ c\nd"'),
        ("group() { box() }", "(WithChildren (Call group []) (Block [(ElementItem (Call box []))]))"),
        ("users + format + android + information", "(Binary + (Binary + (Binary + users format) android) information)"),
    ],
)
def test_expression(text, tree):
    assert expression(text) == tree


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
    ],
)
def test_item(text, tree):
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
def test_line_ends_and_blanks_mean_nothing_inside(text):
    (item,) = read(text).items
    assert shown(item) == "(Let a None (Binary + 1 2))"


def test_items_end_with_lines_and_semicolons():
    assert len(read("a; b\nc;\n\n;d").items) == 4


def test_lines_go_on_inside_brackets_but_not_inside_their_blocks():
    (item,) = read("f(a,\n  [1\n  , 2]\n  , group() {\n  b\n  c\n}\n)").items
    group = "(WithChildren (Call group []) (Block [(ElementItem b) (ElementItem c)]))"
    assert shown(item) == f"(ElementItem (Call f [(Argument None a) (Argument None (ListLiteral [1 2])) (Argument None {group})]))"


def test_else_may_start_a_line():
    (item,) = read("if (a) { b }\n\nelse { c }").items
    assert isinstance(item, ast.If)
    assert item.no is not None


def test_empty_files():
    for text in ("", "\n\n", ";", "   ", "\ufeff"):
        file = read(text)
        assert (file.items, file.dangling) == ((), ())


def test_spans_count_from_one_and_end_behind():
    (item,) = read("// a\n  let a = f(1,\n    2) // b").items
    assert isinstance(item, ast.Let)
    assert str(item.span) == "t:2:3"
    assert (item.span.end_line, item.span.end_column) == (3, 7)
    assert isinstance(item.value, ast.Call)
    assert (item.value.span.line, item.value.span.column) == (2, 11)
    argument = item.value.arguments[1]
    assert (argument.span.line, argument.span.column, argument.span.end_column) == (3, 5, 6)


def test_comments_and_blank_lines():
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


def test_comment_between_the_branches_of_an_if():
    (item,) = read("if (a) { // one\n  b\n} // two\n// three\nelse if (c) { d } // four").items
    assert [c.text for c in item.before] == ["// two", "// three"]
    assert item.after is not None
    assert item.after.text == "// four"
    assert isinstance(item, ast.If)
    assert [c.text for c in item.yes.items[0].before] == ["// one"]


def test_good_items_survive_and_broken_names_are_known():
    diagnostics = Diagnostics()
    text = 'let a = 1\nlet b = = 2\nuse "x.scene" c\ngroup() {\n  let d = 1 1\n  box()\n}\nlet e = "open\nparam f 3\nlet g = 2'
    file = parse.parse(text, "t", diagnostics)
    assert [type(i).__name__ for i in file.items] == ["Let", "ElementItem", "Let"]
    assert file.broken == {"b", "x", "d", "e", "f"}
    assert shown(file.items[1]) == "(ElementItem (WithChildren (Call group []) (Block [(ElementItem (Call box []))])))"
    assert len(diagnostics.items) == 5


def decoded(data: bytes) -> tuple[str | None, list[str]]:
    diagnostics = Diagnostics()
    text = parse.decode(data, "t", diagnostics)
    return text, [render_text(d, lambda _: None) for d in diagnostics.items]


def test_decode():
    assert decoded(b"a\r\nb\rc\n") == ("a\nb\nc\n", [])
    assert decoded(b"\xef\xbb\xbfa") == ("a", [])
    assert decoded(b"") == ("", [])
    assert decoded(b"\x89PNG\r\n\x00\x01") == (None, ["t: error: this is a binary file, no scene"])
    assert decoded(b"let a = 1\n// caf\xe9") == (None, ["t: error: line 2 is not UTF-8 text (byte 0xe9)\n  save the file as UTF-8"])
    too_large = "t: error: the file has 4.1 MB; a scene has 4 MB at most\n  put large meshes and tables into files of their own"
    assert decoded(b" " * 4_100_000) == (None, [too_large])


def test_invisible_characters_are_named():
    diagnostics = Diagnostics()
    parse.parse("let x = 1\u200b + 2", "t", diagnostics)
    assert [(d.message, d.hint) for d in diagnostics.items] == [("the language has no invisible character U+200B", "delete it")]
