"""A bare number has the unit of the file that contains it, also as an argument of a part in another file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.elements import Element
from maquette.lang.formula_graph import Formula
from maquette.lang.reference_page import heading
from maquette.lang.syntax import ast, parser

from .evaluating import elements, good

LIBRARY = {f"std/{path.stem}": path.read_text(encoding="utf-8") for path in (Path(maquette.__file__).parent / "stdlib").glob("*.scene")}
UNITS = {"m": 1.0, "mm": 1e-3, "inch": 0.0254}


def spheres(part: str, call: str) -> list[tuple[float, ...]]:
    """Radius and centre in millimetres of every sphere that a call from a file in mm places; `part` is a file in metres."""

    def walk(items: tuple[Element, ...]) -> list[tuple[float, ...]]:
        found = []
        for item in items:
            if item.kind == "sphere":
                found.append(tuple(round(v * 1000, 9) for v in (item.args["radius"], *item.args["center"])))
            found += walk(item.children)
        return found

    return walk(elements(f'unit mm\nuse "part.scene" as part\n{call}', {"part.scene": f"unit m\n{part}"}))


@pytest.mark.parametrize(
    ("part", "call", "expected"),
    [
        ("let ball(r) = sphere(r)", "part.ball(5)", (5, 0, 0, 0)),
        ("let ball(r = 1m) = sphere(r)", "part.ball(5)", (5, 0, 0, 0)),
        ("let ball(r: length) = sphere(r)", "part.ball(5)", (5, 0, 0, 0)),
        ("let ball(at = [0, 0, 0]) = sphere(1, center: at)", "part.ball([1, 2, 3])", (1000, 1, 2, 3)),
        ("let ball(at = [0, 0, 0]) = sphere(1, center: at + [1, 0, 0])", "part.ball([1, 2, 3])", (1000, 1001, 2, 3)),
        ("let ball(at = [0, 0, 0]) = sphere(1, center: 2 * at - at / 4 + 1m * [0, 1, 0])", "part.ball([4, 4, 4])", (1000, 7, 1007, 7)),
        ("let ball(at = [0, 0, 0]) = sphere(length(at))", "part.ball([0, 3, 4])", (5, 0, 0, 0)),
        ("let ball(at = [0, 0, 0]) = sphere(sqrt(dot(at, at)))", "part.ball([0, 3, 4])", (5, 0, 0, 0)),
        ("let ball(at = [0, 0, 0]) = sphere(max(-at[0], abs(at[1])))", "part.ball([-7, 4, 0])", (7, 0, 0, 0)),
        ("let ball(at = [0, 0, 0]) = sphere(lerp(at[0], at[1], 0.5))", "part.ball([2, 4, 0])", (3, 0, 0, 0)),
        ("let ball(f) = sphere(1, center: f(0.5))", "part.ball(|u| [10 * u, 0, 0])", (1000, 5, 0, 0)),
        ("let ball(f) = sphere(1, center: f(0.5))", "let f(u) = [10 * u, 0, 0]\npart.ball(f)", (1000, 5, 0, 0)),
        ("let ball(r = 2) = sphere(r / 2)", "part.ball(4)", (2, 0, 0, 0)),
        ("let ball(scale: number = 2) = sphere(scale * 3)", "part.ball(4)", (12000, 0, 0, 0)),
        ("let ball(n: number) = sphere(n)", "part.ball(4)", (4000, 0, 0, 0)),
        ("let ball(n: list) = sphere(n[0])", "part.ball([4])", (4000, 0, 0, 0)),
        ("param at = [0, 0, 0]\nsphere(1, center: at)", "part(at: [1, 2, 3])", (1000, 1, 2, 3)),
        ("param r = 1m\nsphere(r)", "part(r: 3)", (3, 0, 0, 0)),
        ("param r = 1\nsphere(r)", "part(r: 3)", (3, 0, 0, 0)),
        ("param r: number = 1\nsphere(r)", "part(r: 3)", (3000, 0, 0, 0)),
        ("param count = 2\nsphere(count * 1cm)", "part(count: 3)", (30, 0, 0, 0)),
    ],
)
def test_a_bare_number_is_in_the_unit_of_its_file(part: str, call: str, expected: tuple[float, ...]) -> None:
    assert spheres(part, call) == [expected]


def test_a_formula_counts_in_the_unit_of_its_own_file() -> None:
    (surface,) = elements(
        'unit mm\nuse "part.scene" as part\npart.skin(|x, y, z| x + y + z < 1)', {"part.scene": "let skin(f) = implicit(f, within: 1)"}
    )
    assert surface.args["formula"].unit == 1e-3


# --- the library: a scene means the same in metres, millimetres and inches -------------------------------------------------

CLOSURES = {
    "at": "|u, v| [{0} * u, {1} * v, {2} * u * v]",
    "points": "[[0, 0, 0], [{0}, {1}, {2}]]",
    "rows": "[[[0, 0, 0], [{0}, 0, 0]], [[0, {1}, 0], [{0}, {1}, {2}]]]",
    "profile": "[[{0}, 0], [{1}, {2}]]",
    "weighted": "[[[{0} * i, {1} * j, {2} * i * j, 1 + i] for i in 0..3] for j in 0..3]",
    "is_full": "|x, y, z| x > y",
}
COUNTS = {"steps": "3", "count": "4"}


def arguments(parameters: tuple[ast.Parameter, ...], numbers: list[float], unit: float) -> str:
    """An argument in bare numbers for each parameter that is a length or a list; `numbers` are metres."""
    given: list[str] = []
    count = 0

    def bare() -> str:
        nonlocal count
        count += 1
        return repr(numbers[count % len(numbers)] * 0.15 ** len(given) / unit)

    def literal(node: ast.Node) -> str:
        return f"[{', '.join(literal(item) for item in node.items)}]" if isinstance(node, ast.ListLiteral) else bare()

    for p in parameters:
        name, default = p.name.id, p.default
        if name in COUNTS:
            given.append(f"{name}: {COUNTS[name]}")
        elif name in CLOSURES and default is None:
            given.append(f"{name}: {CLOSURES[name].format(bare(), bare(), bare())}")
        elif isinstance(default, ast.ListLiteral) and default.items and p.name.id not in ("degree", "into", "rotate"):
            given.append(f"{name}: {literal(default)}")
        elif isinstance(default, ast.Number) and (default.unit in UNITS | {"cm": 0.01} or name == "size"):
            given.append(f"{name}: {bare()}")
    return ", ".join(given)


PLACED_BY = {"std/profiles": "extrude({}, 1m)", "std/media": "sphere(1m, medium: {})"}
NOT_PLACED = "std/prelude std/materials std/patterns face bezier_at stretch spline_at clamped".split()


def placing() -> list[tuple[str, str, tuple[ast.Parameter, ...]]]:
    """File, name and parameters of each part of the library that places something."""
    found = []
    for path, text in LIBRARY.items():
        section = ""
        for item in parser.parse(text, path, Diagnostics()).items:
            section = heading(item) or section
            if section == "helpers" or path in NOT_PLACED:
                continue
            if isinstance(item, ast.Let) and item.parameters and item.name.id not in NOT_PLACED:
                found.append((path, item.name.id, item.parameters))
    return found


def same(a: Any, b: Any, type_name: str = "") -> bool:
    if isinstance(a, Element):
        entry = {arg.name: arg.type for arg in CATALOGUE[a.kind].args}
        return (
            a.kind == b.kind
            and all(same(a.args[n], b.args[n], entry.get(n, "")) for n in a.args)
            and len(a.children) == len(b.children)
            and all(map(same, a.children, b.children))
        )
    if isinstance(a, Formula):
        return (
            a.unit == b.unit and len(a.nodes) == len(b.nodes) and all(same(m.value, n.value) for m, n in zip(a.nodes, b.nodes, strict=True))
        )
    if type_name == "direction" and a is not None:
        return same(tuple(c / math.hypot(*a) for c in a), tuple(c / math.hypot(*b) for c in b))
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y, type_name) for x, y in zip(a, b, strict=True))
    if isinstance(a, float):
        return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)
    return a == b


@pytest.mark.parametrize(("path", "name", "parameters"), placing(), ids=[f"{p[4:]}.{n}" for p, n, _ in placing()])
@pytest.mark.parametrize("seed", range(3))
def test_a_part_of_the_library_means_the_same_in_every_unit(path: str, name: str, parameters: tuple[ast.Parameter, ...], seed: int) -> None:
    """Bare numbers in metres, millimetres and inches give the same elements."""
    numbers = sorted(np.random.default_rng(seed).uniform(2.0, 3.0, 7).tolist(), reverse=True)
    shelf, documents = path.removeprefix("std/"), []
    for unit, size in UNITS.items():
        call = PLACED_BY.get(path, "{}").format(f"{shelf}.{name}({arguments(parameters, numbers, size)})")
        documents.append(good(f'unit {unit}\nuse "{path}"\n{call}', LIBRARY))
    first = documents[0]
    for other in documents[1:]:
        assert len(first.elements) == len(other.elements)
        assert len(first.cameras) == len(other.cameras)
        assert first.elements or first.cameras
        assert all(map(same, (*first.elements, *first.cameras), (*other.elements, *other.cameras)))
