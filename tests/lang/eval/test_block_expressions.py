"""Block expressions: values, scopes, order of evaluation, formulas, and time in proportion to their length."""

from __future__ import annotations

import time

import pytest
from maquette.lang import formula_graph
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.syntax.formatter import format_text

from .evaluating import elements, run, value


@pytest.mark.parametrize(
    ("expression", "before", "expected"),
    [
        ("{ let a = 2; a * a }", "", 4),
        ("{ let b = a + 1; let a = 2; b }", "", 3),
        ("{ let f(x) = x + k; let k = 1; f(2) }", "", 3),
        ("f(2)", "let f(i) = { let k = 3 * i; k + 1 }", 7),
        ("{ let a = 1; let b = { let a = 2; a }; a + b }", "let a = 5", 3),
        ("map(|x| { let x2 = x * x; x2 + 1 }, [1, 2])", "", (2, 5)),
        ("[{ let d = k + 1; d } for k in 0..1]", "", (1, 2)),
        ("fact(5)", "let fact(n) = { let rest = fact(n - 1); if n <= 1 then 1 else n * rest }", 120),
        ("half(0)", "let half(n) = { let inverse = 1 / n; if n == 0 then 7 else inverse }", 7),
        ("{ let even(n) = n == 0 or odd(n - 1); let odd(n) = n > 0 and even(n - 1); even(10) }", "", True),
        ("f(2)(3)", "let f(a) = { let b = 2 * a; |x| b + x }", 7),
        ("({ let a = [1, 2]; a })[1] + 1", "", 3),
    ],
)
def test_values(expression: str, before: str, expected: object) -> None:
    assert value(expression, before) == expected


def test_a_part_with_names_of_its_own() -> None:
    scene = "let pair(r) = { let gap = 3 * r; group { sphere(r); translate([gap, 0, 0]) { children } } }\npair(1) { box(2) }"
    (group,) = elements(scene)
    assert [child.kind for child in group.children] == ["sphere", "translate"]


def test_params_and_values_of_the_command_line() -> None:
    scene = "param size = { let half = 1; half * 2 } in { let most = 9; 0..most }\nsphere(size)"
    assert elements(scene)[0].args["radius"] == 2
    assert elements(scene, sets={"size": "{ let third = 1; third * 3 }"})[0].args["radius"] == 3


def formula(text: str, before: str = "") -> formula_graph.Formula:
    """The formula of `pattern(text)`."""
    (sphere,) = elements(f"{before}\nsphere(1, material: lambert(pattern({text})))")
    return sphere.args["material"].args["color"].args["formula"]


def test_a_formula_with_a_block_has_the_operations_of_the_one_without() -> None:
    repeated = formula("|x, y, z| sin(floor(x / 2) + y) * floor(x / 2) + max(floor(x / 2), 30deg)")
    block = formula("|x, y, z| { let row = floor(x / 2); let least(a) = max(a, 30deg); sin(row + y) * row + least(row) }")
    assert block.nodes == repeated.nodes
    assert block.results == repeated.results


def test_quantities_in_a_formula_are_plain_numbers() -> None:
    block = formula("|x, y, z| { let later = time + 1s; let turn = 90deg; let size = 2mm; x * later + turn * size }")
    assert block.nodes == formula("|x, y, z| x * (time + 1s) + 90deg * 2mm").nodes


def test_definitions_without_a_use_record_nothing() -> None:
    assert formula("|x, y, z| { let _unused = noise(x, y, z); x }").nodes == formula("|x, y, z| x").nodes


# --- long blocks ------------------------------------------------------------------------------------------------------


def chain(count: int, start: str, step: str = "0.5 * {} + 1") -> str:
    """A block of `count` definitions, each of the one before."""
    lets = [f"  let a{k} = {step.format(f'a{k - 1}')}" for k in range(1, count)]
    return "\n".join(["{", f"  let a0 = {start}", *lets, f"  a{count - 1}", "}"])


def seconds(run) -> float:
    """The least seconds of this process in three runs."""
    return min(_seconds(run) for _ in range(3))


def _seconds(run) -> float:
    start = time.process_time()
    run()
    return time.process_time() - start


@pytest.mark.long
def test_two_thousand_definitions_take_time_in_proportion() -> None:
    def check(count: int) -> None:
        scene = f"sphere(1, material: lambert(pattern(|x, y, z| {chain(count, 'x')})))\n"
        assert format_text(scene, "t", Diagnostics()) == scene
        assert len(elements(scene)) == 1

    assert seconds(lambda: check(2000)) < 6 * seconds(lambda: check(500))


@pytest.mark.long
def test_long_chains_need_no_recursion() -> None:
    scene = f"param a = {chain(9_000, '2')}\nsphere(a)"
    assert elements(scene)[0].args["radius"] == 2
    assert elements("param a = 1\nsphere(a)", sets={"a": chain(9_000, "2").replace("\n", ";")})[0].args["radius"] == 2


@pytest.mark.long
@pytest.mark.parametrize("option", ["let", "param", "set"])
def test_a_chain_of_choices_that_is_too_deep_is_one_message(option: str) -> None:
    deep = chain(9_000, "2", "if {} > 0 then 1 else 0").replace("if a", "if 0 < 1 and a")
    scene = "param a = 1\nsphere(a)" if option == "set" else f"{option} a = {deep}\nsphere(a)"
    _, messages = run(scene, sets={"a": deep.replace("\n", ";")} if option == "set" else None)
    assert [message.split("\n")[0].split("error: ")[1] for message in messages] == ["this is nested too deeply"]


@pytest.mark.long
def test_a_formula_with_too_many_operations_is_one_message() -> None:
    _, messages = run(f"sphere(1, material: lambert(pattern(|x, y, z| {chain(30_000, 'x', 'sin({}) + 1')})))")
    assert len(messages) == 1
    assert "the formula has more than 50,000 operations" in messages[0]
    assert messages[0].startswith("a.scene:")


def test_files_use_blocks_of_their_units() -> None:
    """Bare lengths in a block have the unit of its file."""
    parts = "unit mm\nlet ball(r) = { let radius = 2 * r; sphere(radius) }"
    (ball,) = elements('use "parts.scene"\nparts.ball(5mm)', {"parts.scene": parts})
    assert ball.args["radius"] == pytest.approx(0.01)
