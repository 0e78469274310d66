"""Whatever arguments its elements get, a scene is compiled or refused with messages that have a place: never a traceback."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from maquette.compiler import load
from maquette.compiler.catalogue import CATALOGUE
from maquette.compiler.scene import dump
from maquette.lang.diagnostics import Diagnostics, SceneError
from maquette.lang.schema import argument_types

NUMBERS = ("0", "1", "-1", "0.5", "3", "1e16", "1e-9", "1e308", "1e-308", "-1e200")
PLACED = ("shape", "light", "block", "camera", "setting")
INSIDE = ("sphere(1)", "box(1e-9)", "area([0,1,0])", "sun()", "spot([0,1,0])", "mesh(points: [[0,0,0],[1,0,0],[0,1,0]], faces: [[0,1,2]])")


def value(arg: argument_types.Arg, rng: random.Random) -> str:
    """An expression of about the right type, with numbers from everywhere."""

    def n(unit: str = "") -> str:
        return rng.choice(NUMBERS) + unit

    def several(count: int, unit: str = "") -> str:
        return f"[{', '.join(n(unit) for _ in range(count))}]"

    def lists(width: int, *counts: int) -> str:
        return f"[{', '.join(several(width) for _ in range(rng.choice(counts)))}]"

    if arg.choices:
        return f'"{rng.choice(arg.choices)}"'
    color = f"rgb({n()}, {n()}, {n()})"
    rotations = (several(3, "deg"), f"axis({several(3)}, {n('deg')})", f"quaternion({n()}, {n()}, {n()}, {n()})")
    made: dict[str, Callable[[], str]] = {
        "int": lambda: rng.choice(("0", "1", "3")),
        "bool": lambda: rng.choice(("true", "false")),
        "string": lambda: rng.choice(('"x"', '""', '"../a"', '"a.obj"')),
        "angle": lambda: n("deg"),
        "time": lambda: n("s"),
        "flux": lambda: n("lm"),
        "color": lambda: color,
        "factors": lambda: rng.choice((n(), color)),
        "number_map": lambda: rng.choice((n(), "checker()")),
        "color_map": lambda: rng.choice((n(), color, f"stripes(angle: {n('deg')})")),
        "material": lambda: rng.choice(("lambert(0.5)", f"emissive(luminance: {n()})", f"phong(shininess: {n()})", f"glass(ior: {n()})")),
        "point": lambda: several(3),
        "size3": lambda: rng.choice((n(), several(3))),
        "size2": lambda: rng.choice((n(), several(2))),
        "direction": lambda: several(3),
        "numbers2": lambda: several(2),
        "scale3": lambda: rng.choice((n(), several(3))),
        "rotation": lambda: rng.choice(rotations),
        "matrix": lambda: lists(4, 3),
        "numbers": lambda: several(rng.choice((1, 4, 10, 10))),
        "points": lambda: lists(3, 0, 1, 3, 3, 4, 5),
        "point_lists": lambda: f"[{lists(3, 3)}]",
        "lengths": lambda: rng.choice((n(), several(2), several(4))),
        "heights": lambda: rng.choice(('"a.png"', lists(2, 2, 3), lists(1, 2), "[]", "|x, z| x * z", "|x| 1 / x")),
        "points2": lambda: lists(2, 0, 1, 3, 4, 7),
        "point2_lists": lambda: f"[{lists(2, 3, 4)}]",
        "vectors3": lambda: lists(3, 3, 4),
        "vectors2": lambda: lists(2, 3, 4),
        "faces": lambda: rng.choice(("[[0,1,2]]", "[[0,1,2,3]]", "[]", "[[0,1,9]]", "[[0,0,1],[0,1,2]]")),
        "falloff": lambda: rng.choice((several(3), f"ramp({n()}, {n()})")),
        "pixels": lambda: rng.choice(("[10, 10]", "[1, 100000]")),
        "strings": lambda: rng.choice(('["depth"]', '["x"]', "[]")),
    }
    return made.get(arg.type, n)()


def element(rng: random.Random) -> str:
    entry = rng.choice([e for e in CATALOGUE.values() if not e.planned and e.category in PLACED])
    given = [a for a in entry.args if (a.default is argument_types.REQUIRED or rng.random() < 0.3)]
    call = f"{entry.name}({', '.join(f'{a.name}: {value(a, rng)}' for a in given)})"
    return f"{call} {{ {rng.choice(INSIDE)} }}" if entry.children else call


@pytest.mark.long
@pytest.mark.parametrize("seed", range(8))
def test_any_scene_is_answered(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    path = tmp_path / "a.scene"
    compiled = 0
    for _ in range(50):
        path.write_text("\n".join(element(rng) for _ in range(rng.randint(1, 3))))
        found = Diagnostics()
        try:
            dump.text(load.load(path, diagnostics=found))
            compiled += 1
        except SceneError as error:
            found = Diagnostics(list(error.diagnostics))
        assert [d.message for d in found.items if d.span is None] == [], path.read_text()
    assert compiled > 0
