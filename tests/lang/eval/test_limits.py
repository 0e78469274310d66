"""Evaluation limits: untrusted scenes end in time with a message."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import pytest
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang import limits
from maquette.lang.diagnostics import MAX_MESSAGES, Diagnostics, SceneError
from maquette.lang.eval.evaluator import Source, evaluate
from maquette.lang.schema import argument_types

from .evaluating import Files, elements, run

CASES = {
    "range": ("for (k in 0..1000000000) { sphere(k) }", "a list of 1000000001 items is too long"),
    "list": ("let a = 1..6000000\nsphere(len(concat(a, a)))", "a list of 12000000 items is too long"),
    "string": ('sphere(name: fold(|s, k| s + s, "a", 0..60))', "a string of 1048576 characters is too long"),
    "call": ("let f(n) = f(n + 1)\nsphere(f(1))", "f calls itself too deeply: 200 nested calls"),
    "calls twice": ("let f(n) = f(n + 1) + f(n + 1)\nsphere(f(1))", "f calls itself too deeply: 200 nested calls"),
    "calls as arguments": ("let g(a, b) = a\nlet f(n) = g(f(n), f(n))\nsphere(f(1))", "f calls itself too deeply"),
    "part": ("let tree(n) = group { tree(n + 1)\n sphere(n) }\ntree(1)", "tree calls itself too deeply: 200 nested calls"),
    "closure": ("let f = |n| f(n)\nsphere(f(1))", "f calls itself too deeply: 200 nested calls"),
    "map": ("let f(n) = map(f, [n])\nsphere(f(1))", "calls itself too deeply: 200 nested calls"),
    "default": ("let f(a = f()) = a\nsphere(f())", "f calls itself too deeply: 200 nested calls"),
    "sharing": (
        "let a = fold(|a, k| [a, a], [1], 0..60)\nlet b = fold(|a, k| [a, a], [1], 0..60)\nif (a == b) { sphere() }",
        "2,000,000 steps",
    ),
    "lists placed": ("let a = fold(|a, k| [a, a], [sphere()], 0..60)\ngroup { a }", "2,000,000 steps"),
    "lists of nothing placed": ("let a = fold(|a, k| [a, a], [], 0..60)\na", "2,000,000 steps"),
    "lists of a param": ("param a = fold(|a, k| [a, a], [1], 0..60)\nsphere(len(a))", "2,000,000 steps"),
    "groups": (
        "let dup(n, x) = if n == 0 then x else dup(n - 1, pair(x))\nlet pair(x) = group {\n  x\n  x\n}\ndup(40, sphere())",
        "2,000,000 elements",
    ),
    "groups placed": ("let x = [group { for (k in 1..999) { sphere() } }]\nfor (k in 1..30000) { x[0] }", "2,000,000 elements"),
}


@pytest.mark.long
@pytest.mark.parametrize(("scene", "message"), CASES.values(), ids=CASES.keys())
def test_a_limit_is_one_message_with_its_place_in_time(scene: str, message: str) -> None:
    start = time.process_time()
    _, messages = run(scene)
    assert time.process_time() - start < 10
    assert len(messages) == 1
    assert message in messages[0]
    assert messages[0].startswith("a.scene:")


@pytest.mark.parametrize(
    "expression",
    [
        "1e308 - -1e308",
        "(1m * 1m) ^ 1e308",
        "len(-1e308..1e308)",
        "2km * 1e308",
        "hypot(1e308, 1e308)",
        "[1e308][0] * [10][0]",
        "1e999",
        "exp(1000)",
        "mod(1e308, 1e-308) * 0 + 1e308 * 1e308",
        "length([1e308, 1e308])",
        "lerp(-1e308, 1e308, 1)",
        "-(1e308) * 10",
    ],
)
def test_numbers_stay_finite(expression: str) -> None:
    document, messages = run(f"unit km\nsphere({expression})\nsphere(1e307)")
    assert document.elements == ()
    assert len(messages) == 2
    assert all("too l" in m or "is not defined" in m for m in messages)


USES = ["sphere(name: string(a))", "let f() = a\nf(scale: 2)"]
USES += [pytest.param(use, marks=pytest.mark.long) for use in ("param p: shape = a\np", "sphere(-a)", "sphere(a == a)")]  # ten seconds each


@pytest.mark.long
@pytest.mark.parametrize("use", USES)
def test_lists_that_share_or_nest_are_answered(use: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_STEPS", 200_000)
    for a in ("fold(|a, k| [a, a], [1], 0..60)", "fold(|a, k| [a], [1], 0..99999)"):
        _, messages = run(f"let a = {a}\n{use}\nlet _b = a")
        assert len(messages) <= 1


def test_loops_inside_loops_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_STEPS", 20_000)
    folds = "let n = fold(|s, k| fold(|t, m| t + m, s, 0..999), 0, 0..999)\nsphere(n)"
    _, messages = run("for (i in 0..99999) { for (j in 0..99999) { } }\n" + folds)
    assert [m.splitlines()[0] for m in messages] == ["a.scene:1:33: error: the scene takes more than 20,000 steps to evaluate"]


def test_elements_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_ELEMENTS", 100)
    for made in ("sphere()", "for (j in 0..9) { sphere() }", "group { sphere() }"):
        _, messages = run(f"for (i in 0..999) {{ {made} }}")
        assert messages == [
            "a.scene:1:11: error: the scene makes more than 100 elements, most of them in this loop\n"
            f"   1 | for (i in 0..999) {{ {made} }}\n"
            "     |           ^^^^^^ use a mesh for many small parts, or allow more with --max-elements"
        ]


ROW = "let row(n) = [sphere(center: [k, 0, 0]) for k in 1..n]\n"
LOOPS = {
    "the second of two": ("for (i in 1..20) { sphere() }\nfor (j in 1..9) { box() \n for (k in 0..9) { sphere(k + 1) } }", "2:11"),
    "that calls a part": (ROW + "for (i in 1..9) { row(20) }", "2:11"),
    "of a list": (ROW + "for (i in 1..9) { row(2000) }", "1:50"),
    "that places": ("let ball = group { sphere() }\nfor (i in 1..99) { ball }", "2:11"),
}


@pytest.mark.parametrize(("text", "place"), LOOPS.values(), ids=LOOPS.keys())
def test_the_loop_that_makes_too_many_elements_is_told(text: str, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_ELEMENTS", 100)
    _, messages = run(text)
    assert [m.splitlines()[0] for m in messages] == [
        f"a.scene:{place}: error: the scene makes more than 100 elements, most of them in this loop"
    ]


def test_elements_without_a_loop_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_ELEMENTS", 100)
    _, messages = run("let tree(n) = group { if (n > 0) { tree(n - 1)\n tree(n - 1) }\n sphere() }\ntree(9)")
    assert [m.splitlines()[0] for m in messages] == ["a.scene:3:2: error: the scene makes more than 100 elements"]


FORMULAS = {
    **CATALOGUE,
    "implicit": argument_types.Entry("implicit", "shape", "for tests", (argument_types.Arg("f", "formula", argument_types.REQUIRED),)),
}
"""The catalogue with an element that takes a formula alone."""


def test_operations_of_a_formula_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maquette.lang.formula_graph.MAX_TERMS", 500)
    _, messages = run("implicit(|x| fold(|s, k| s + sin(k * x), 0, 1..999))", catalogue=FORMULAS)
    assert [m.splitlines()[0] for m in messages] == ["a.scene:1:30: error: the formula has more than 500 operations"]


def test_files_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maquette.lang.eval.modules.MAX_FILES", 20)
    files = {f"f{i}.scene": f'use "f{i + 1}.scene" as next\nnext()' for i in range(40)}
    _, messages = run('use "f0.scene"\nf0()', files)
    assert len(messages) == 1
    assert "the scene uses more than 20 files" in messages[0]


def test_a_limit_leaves_the_other_items() -> None:
    document, messages = run("sphere(1)\nfor (k in 0..1e9) { sphere() }\nlet f(n) = f(n)\nsphere(f(1))\nbox(2)")
    assert [e.kind for e in document.elements] == ["sphere", "box"]
    assert len(messages) == 2


def test_deep_recursion_that_ends_is_fine() -> None:
    nested = "n"
    for _ in range(40):
        nested = f"(0 + {nested})"
    assert elements(f"let f(n) = if n <= 1 then 1 else f({nested} - 1) + 1\nsphere(f(150))")[0].args["radius"] == 150.0


def test_expressions_too_deep_for_the_stack_are_a_message() -> None:
    nested = "f(n + 1)"
    for _ in range(90):
        nested = f"[{nested}]"
    _, messages = run(f"let f(n) = {nested}\nsphere(f(1))\nbox(1, 2, 3)")
    assert any("too deep" in m for m in messages)
    assert any("box takes 2 arguments" in m for m in messages)


def test_many_elements_are_quick() -> None:
    start = time.process_time()
    assert len(elements("let red = lambert(#f00)\nfor (k in 1..10000) { sphere(10cm, [k, 0, 2 * k], material: red) }")) == 10_000
    assert time.process_time() - start < 3  # some 0.2 s on a machine that has nothing else to do


def test_an_exception_shows_the_first_of_many_errors() -> None:
    diagnostics = Diagnostics()
    evaluate(Source("a.scene", "sphere(none)\n" * (MAX_MESSAGES + 3), "a.scene"), CATALOGUE, Files({}), diagnostics)
    with pytest.raises(SceneError) as raised:
        diagnostics.raise_if_failed()
    assert str(raised.value) == "; ".join(["there is no `none` here"] * MAX_MESSAGES + ["and 3 more"])
    assert len(raised.value.diagnostics) == MAX_MESSAGES + 3


def test_a_small_thread_is_enough() -> None:
    results: list[int] = []

    def work() -> None:
        diagnostics = Diagnostics()
        text = "let f(n) = [if n > 0 then f(n + 1) else 1]\nsphere(f(1))"
        evaluate(Source("a.scene", text, "a.scene"), CATALOGUE, Files({}), diagnostics)
        results.append(len(diagnostics.items))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert results == [1]


@pytest.mark.long
def test_the_language_imports_no_numpy() -> None:
    code = "import sys, maquette.lang.eval.evaluator; sys.exit('numpy' in sys.modules or 'numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_loops_of_known_ends_are_refused_at_once() -> None:
    """A billion elements, of which none is made; a loop whose elements depend on values is counted."""
    _, messages = run("for (a in 0..999) { for (b in 0..999) { for (c in 0..999) { sphere() } } }")
    assert [m.splitlines()[0] for m in messages] == [
        "a.scene:1:11: error: the scene makes more than 2,000,000 elements, most of them in this loop"
    ]
    document, messages = run("for (a in 0..99999) { if (a == 7) { for (b in 0..99) { sphere() } } }")
    assert (len(document.elements), messages) == (100, [])


def test_formulas_that_repeat_themselves_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("maquette.lang.formula_graph.MAX_APPLIED", 500)
    _, messages = run("let f(n, x) = if n == 0 then x else f(n - 1, x) * f(n - 1, x)\nimplicit(|x| f(40, x))", catalogue=FORMULAS)
    expected = "a.scene:1:37: error: the formula has more than 500 operations, equal ones counted each time"
    assert [m.splitlines()[0] for m in messages] == [expected]
