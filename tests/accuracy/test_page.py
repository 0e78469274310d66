"""The page of known answers lists what the tests record, no more and no less, as far as can be said without running them.

The other half is the fixture `measured`: a test that records what is not on the page ends with an error.
"""

from __future__ import annotations

import ast
import importlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

from . import answers

HERE = Path(__file__).resolve().parent
AGAIN = "`make accuracy` writes the page again"

pytestmark = pytest.mark.skipif("MAQUETTE_ACCURACY" in os.environ, reason="the page is being written")


@dataclass(frozen=True, slots=True)
class Recorded:
    """A call by which a test records answers: what names they may have, as patterns, and on which backends."""

    place: str
    number: int
    names: tuple[str, ...]
    backends: tuple[str, ...]


def recorded() -> Iterator[Recorded]:
    """Every such call in this folder's tests."""
    for path in sorted(HERE.glob("test_*.py")):
        module = importlib.import_module(f".{path.stem}", __package__)
        for function in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(function, ast.FunctionDef) and function.name.startswith("test_"):
                for node in ast.walk(function):
                    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                        yield from _call(path.name, module, function, node, node.func)


def _call(file: str, module: ModuleType, function: ast.FunctionDef, call: ast.Call, way: ast.Attribute) -> Iterator[Recorded]:
    of = way.value.id if isinstance(way.value, ast.Name) else ""
    if (of, way.attr) not in (("measured", "answer"), ("measured", "waits"), ("rm", "within_error")):
        return
    number, name, backend = call.args[1:4] if way.attr == "within_error" else call.args[:3]
    place = f"{file}:{call.lineno}"
    assert isinstance(number, ast.Constant), f"{place}: the number must be written there"
    assert isinstance(number.value, int)
    if way.attr == "waits":
        backends = [""]
    elif isinstance(backend, ast.Constant):
        backends = [str(backend.value)]
    else:
        assert isinstance(backend, ast.Name), f"{place}: a backend is a parameter or written there"
        backends = _parameters(getattr(module, function.name), backend.id)
    names, backends = tuple(_patterns(name, function)), tuple(backends)
    assert names, f"{place}: no name is found"
    assert backends, f"{place}: no backend is found"
    yield Recorded(place, number.value, names, backends)


def _patterns(node: ast.expr, function: ast.FunctionDef) -> list[str]:
    """What a string may be, as regular expressions: of what is filled in, anything."""
    if isinstance(node, ast.Constant):
        return [re.escape(str(node.value))]
    if isinstance(node, ast.JoinedStr):
        return ["".join(re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".+" for part in node.values)]
    if isinstance(node, ast.IfExp):
        return _patterns(node.body, function) + _patterns(node.orelse, function)
    if isinstance(node, ast.BinOp):
        return [a + b for a in _patterns(node.left, function) for b in _patterns(node.right, function)]
    assert isinstance(node, ast.Name), ast.dump(node)
    return [pattern for value in _assigned(node.id, function) for pattern in _patterns(value, function)]


def _assigned(name: str, function: ast.FunctionDef) -> Iterator[ast.expr]:
    for statement in ast.walk(function):
        if isinstance(statement, ast.Assign):
            target, value = statement.targets[0], statement.value
            pairs = [(target, value)]
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs = list(zip(target.elts, value.elts, strict=True))
            yield from (given for to, given in pairs if isinstance(to, ast.Name) and to.id == name)


def _parameters(test: object, name: str) -> list[str]:
    """The values that a test's parameter has, by its marks."""
    for mark in getattr(test, "pytestmark", []):
        if mark.name == "parametrize":
            names = [n.strip() for n in mark.args[0].split(",")] if isinstance(mark.args[0], str) else list(mark.args[0])
            if name in names:
                rows = [getattr(row, "values", row) if not isinstance(row, dict) else row for row in mark.args[1]]
                return sorted({str(row if isinstance(row, str) else row[names.index(name)]) for row in rows})
    return []


CALLS = list(recorded())


@pytest.fixture(scope="module")
def page() -> str:
    return answers.PAGE.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def listed(page: str) -> set[tuple[int, str, str]]:
    return answers.listed(page)


def test_every_known_answer_stands_on_the_page(listed):
    assert {number for number, _, _ in listed} == set(range(1, answers.LAST + 1))


def test_every_failing_place_stands_on_the_page(page):
    places = page.partition(answers.PLACES)[2]
    assert {int(number) for number in re.findall(r"^\| (\d+) \|", places, re.MULTILINE)} == set(range(1, 51))


def test_the_page_lists_nothing_that_no_test_records(listed):
    stale = [
        (number, name, backend)
        for number, name, backend in sorted(listed)
        if not any(c.number == number and backend in c.backends and any(re.fullmatch(p, name) for p in c.names) for c in CALLS)
    ]
    assert not stale, AGAIN


@pytest.mark.parametrize("call", CALLS, ids=lambda call: call.place)
def test_what_a_test_records_stands_on_the_page(call, listed):
    """Each name it may have, and each backend."""
    rows = [(name, backend) for number, name, backend in listed if number == call.number]
    for pattern in call.names:
        assert any(re.fullmatch(pattern, name) for name, _ in rows), f"{pattern}: {AGAIN}"
    found = {backend for name, backend in rows if any(re.fullmatch(pattern, name) for pattern in call.names)}
    assert set(call.backends) <= found, AGAIN


def test_nothing_on_the_page_failed(page):
    assert "**failed**" not in page


def test_a_table_is_read_as_it_is_written():
    """A bar in a name, several backends with the same figures, one that fails, and what waits."""
    rows = [
        answers.Answer(3, "|a| ≤ 1", "ray", 1e-7, 1e-5, outcome="passed"),
        answers.Answer(3, "|a| ≤ 1", "raster", 1e-7, 1e-5, outcome="passed"),
        answers.Answer(3, "|a| ≤ 1", "reference", 3e-5, 1e-5, "px", "the worst", outcome="xfailed"),
        answers.Answer(4, "b", "", 0.0, 0.0, waits="mirrors"),
    ]
    table = answers.table(rows)
    assert answers.listed(table + answers.PLACES + "| 5 | no | answer | here |\n") == {(row.number, row.name, row.backend) for row in rows}
    assert table.splitlines()[2:] == [
        "| 3 | \\|a\\| ≤ 1 | ray, raster: 1e−7 (1e−5); reference: 3e−5 (1e−5) px | ✗ the worst |",
        "| 4 | b | | ○ waits for mirrors |",
    ]
