"""The formatter: spaces, indentation and blank lines of each construct; tokens and comments do not change."""

import random
import re
from pathlib import Path

import pytest
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.syntax.formatter import format_text

ROOT = Path(__file__).resolve().parents[3]
SCENES = sorted([*(ROOT / "examples").glob("*.scene"), *(ROOT / "stdlib").glob("*.scene"), *(ROOT / "bench" / "scenes").glob("*.scene")])


def laid_out(text: str) -> str:
    diagnostics = Diagnostics()
    done = format_text(text, "t", diagnostics)
    assert diagnostics.items == []
    assert done is not None
    assert format_text(done, "t", diagnostics) == done
    return done


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("", ""),
        ("\n\n", ""),
        ("sphere( 1 ,center:[0,1 , 0] )", "sphere(1, center: [0, 1, 0])\n"),
        ("\tsphere(1)  \r\n\r\n\r\n\r\nbox(1)", "sphere(1)\n\nbox(1)\n"),
        ("let a=-1+2*-x^2..- 3", "let a = -1 + 2 * -x ^ 2..-3\n"),
        ("let a = 1-1", "let a = 1 - 1\n"),
        ("let f=|x,y||z|-x-(y)-1", "let f = |x, y| |z| -x - (y) - 1\n"),
        ("let f(a:int=1,b)=if not(a>1)and b then[a]else (b)", "let f(a: int = 1, b) = if not (a > 1) and b then [a] else (b)\n"),
        ("let a = b [1] . c (2)", "let a = b[1].c(2)\n"),
        ("let a = [k  for k in[1,2]if(k>1)]", "let a = [k for k in [1, 2] if (k > 1)]\n"),
        ('param n:int=7 in 1 .. 20 "how many"', 'param n: int = 7 in 1..20  "how many"\n'),
        ('param s = "a" "how"\nuse "b"', 'param s = "a"  "how"\nuse "b"\n'),
        ("sphere(1) ; box(1);\n;disk(1);", "sphere(1); box(1)\ndisk(1)\n"),
        ("group(){}", "group() {}\n"),
        ("group(){sphere(1);box(1)}", "group() { sphere(1); box(1) }\n"),
        ("group() { foot()\n  sphere(1); }", "group() {\n  foot()\n  sphere(1)\n}\n"),
        ("group() {\n\nsphere(1)\n\n\n\nbox(1)\n\n}", "group() {\n  sphere(1)\n\n  box(1)\n}\n"),
        ("for(k in 0..5){rotate([0,k,0]){\nbox(1)}}", "for (k in 0..5) {\n  rotate([0, k, 0]) {\n    box(1)\n  }\n}\n"),
        ("if(a){\nbox(1)}else if(b){\nbox(2)}\nelse{}", "if (a) {\n  box(1)\n} else if (b) {\n  box(2)\n}\nelse {}\n"),
        ("let a = if b then 1\nelse 2", "let a = if b then 1\n  else 2\n"),
        ("let a={let b=1;-b}", "let a = { let b = 1; -b }\n"),
        ("f(|x,y|{\nlet b=x;let c=y\n|z|b-c\n})", "f(|x, y| {\n  let b = x; let c = y\n  |z| b - c\n})\n"),
        ("let a = {let b = 1\n\n\n\n[b,-b]}", "let a = {\n  let b = 1\n\n  [b, -b]\n}\n"),
        ("let a =\n{\nlet b = 1\nb\n}", "let a =\n  {\n    let b = 1\n    b\n  }\n"),
        (
            "let f(x) = if x>1 then {\nlet b = x\nb\n} else {\nlet b = 2\nb }",
            "let f(x) = if x > 1 then {\n  let b = x\n  b\n} else {\n  let b = 2\n  b\n}\n",
        ),
        ("box(\n{ let a = 1\na },\n1)", "box(\n  {\n    let a = 1\n    a\n  },\n  1)\n"),
        ("let a =\ngroup() {\nbox(1)\n}", "let a =\n  group() {\n    box(1)\n  }\n"),
        ("let a = 1 +\n2 +\n3\nbox(a)", "let a = 1 +\n  2 +\n  3\nbox(a)\n"),
        ("box(1,\n      center: [\n0,\n1, 0\n])", "box(1,\n  center: [\n    0,\n    1, 0\n  ])\n"),
        ("f(g(\n1\n))", "f(g(\n  1\n))\n"),
        ("move(translate: 1,\nrotate: 2) {\nbox(1)\n}", "move(translate: 1,\n  rotate: 2) {\n  box(1)\n}\n"),
    ],
)
def test_spaces_and_indentation(written, wanted):
    assert laid_out(written) == wanted


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("\n\n// first\nbox(1)", "// first\nbox(1)\n"),
        ("box(1)// behind\nplane()     //  too", "box(1)   // behind\nplane()  //  too\n"),
        ("box(1)\n\n  //between\ndisk(1)", "box(1)\n\n//between\ndisk(1)\n"),
        ("group() { // of a block\nbox(1)\n  // last in it\n}", "group() {  // of a block\n  box(1)\n  // last in it\n}\n"),
        ("let a = // of a value\n// alone\n1", "let a =  // of a value\n  // alone\n  1\n"),
        ("[0, // of an element\n1]   // all", "[0,   // of an element\n  1]  // all\n"),
        ("box(1)\n// last", "box(1)\n// last\n"),
        (
            "let a = { // of a block\n//of b\nlet b = 1 // b\nb\n// end\n}",
            "let a = {  // of a block\n  //of b\n  let b = 1  // b\n  b\n  // end\n}\n",
        ),
    ],
)
def test_comments_stay_in_place(written, wanted):
    assert laid_out(written) == wanted


def test_comments_begin_in_one_column_only_on_lines_that_follow_each_other():
    written = "let a = 1 // a\n\nlet long_name = 2 // b\nlet c = 3 // c\nlet d = 4\nlet e = 5 // e\n"
    wanted = "let a = 1  // a\n\nlet long_name = 2  // b\nlet c = 3          // c\nlet d = 4\nlet e = 5  // e\n"
    assert laid_out(written) == wanted


def test_a_text_with_errors_is_not_formatted():
    diagnostics = Diagnostics()
    assert format_text("sphere(1\nbox(", "t", diagnostics) is None
    assert [d.message for d in diagnostics.items] == ["this `(` is not closed", "this `(` is not closed"]


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_our_own_scenes_are_laid_out(path):
    text = path.read_text(encoding="utf-8")
    assert laid_out(text) == text


@pytest.mark.parametrize("path", SCENES, ids=lambda p: p.stem)
def test_a_scene_comes_back_however_it_was_spaced(path):
    """Random spaces and blank lines, only at places where they do not change the meaning."""
    text = path.read_text(encoding="utf-8")
    chance = random.Random(path.stem)
    lines = []
    for line in text.splitlines():
        code = re.match(r'(?:"[^"]*"|[^"/]|/(?!/))*', line)
        assert code is not None
        parts = re.split(r'("[^"]*")', code[0])
        parts[::2] = [re.sub(r" +|(?<=[,(\[{}|)])(?=.)", lambda m: m[0] + " " * chance.randrange(3), part) for part in parts[::2]]
        lines.append(" " * chance.randrange(9) + "".join(parts) + line[code.end() :] + " " * chance.randrange(3))
        if line == "":
            lines += [" "] * chance.randrange(3)
    assert laid_out("\n" * chance.randrange(3) + "\n".join(lines)) == text
