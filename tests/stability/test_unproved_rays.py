"""No ray of an ordinary scene passes a place where a formula's surface is neither found nor ruled out, whatever the params."""

from __future__ import annotations

import random
import re
from functools import cache
from pathlib import Path

import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.lang.elements import ParamInfo
from maquette.render.render_scene import draw

ROOT = Path(__file__).resolve().parents[2]
VASE = """unit cm
param waist = 6 in 4..8
param belly = 3.2 in 1..4
param grooves: int = 22 in 3..24
param depth = 0.12 in 0..0.6
param twist = 2.5 in 1..6
param wall = 0.5 in 0.2..0.9
param height = 34 in 5..60
let profile(y) = waist + belly * sin(y / 7 - 0.4) - 0.0035 * (y - 14) ^ 2
intersection() {
  shell(wall) {
    implicit(|x, y, z| hypot(x, z) <= profile(y) + depth * cos(grooves * atan2(z, x) + y / twist) and y >= 0 and y <= 30,
      within: [16, 31, 16])
  }
  box([60, 59.2, 60])  // open above
}
plane(y: 0)
area(position: [90, 125, 80], look_at: [0, 12, 0], size: [90, 90], luminance: 8)
sky(luminance: 0.6)
camera(position: [0, height, 70], look_at: [0, 14, 0], fov: 34deg)
"""


@cache
def scenes() -> dict[str, str]:
    """The texts of all scenes with formulas or solids that are shown to users, and of a vase."""
    files = [path for folder in ("examples", "stdlib/new") for path in (ROOT / folder).glob("*.scene")]
    found = {path.name: path.read_text(encoding="utf-8") for path in files}
    for page in ("README.md", "docs/language.md"):
        blocks = re.findall(r"^```(?:scene)?\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
        found.update({f"{page} {k}": block for k, block in enumerate(blocks)})
    shaped = re.compile(r"\b(implicit|union|difference|intersection|shell|twist|bend)\b\s*[({]")
    return {"vase": VASE, **{name: found[name] for name in sorted(found) if shaped.search(found[name]) and "FILE" not in found[name]}}


def value(param: ParamInfo, rng: random.Random) -> str | None:
    """A random value of a param within its range, as text; None without a range of numbers."""
    if param.type == "bool":
        return rng.choice(("true", "false"))
    if not isinstance(param.range, tuple) or len(param.range) != 2 or not all(isinstance(end, int | float) for end in param.range):
        return None
    low, high = param.range
    return str(rng.randint(int(low), int(high))) if param.type == "int" else f"{rng.uniform(low, high):.6g}{param.unit}"


def unproved(number: int, size: tuple[int, int], folder: Path) -> tuple[str, int]:
    """(a scene with its values, its unproved rays) of a variation; the first ones have the defaults of each scene."""
    names = list(scenes())
    name, rng = names[number % len(names)], random.Random(number)
    path = folder / "a.scene"
    if name.endswith(".scene"):
        path = next(p for p in (ROOT / "examples" / name, ROOT / "stdlib/new" / name) if p.exists())
    else:
        path.write_text(scenes()[name], encoding="utf-8")
    sets = {}
    if number >= len(names):
        params = load.load(path).params
        sets = {param.name: text for param in params if (text := value(param, rng)) is not None}
    scene = load.load(path, sets=sets)
    camera = rng.choice(scene.names.cameras) if len(scene.names.cameras) > 1 else None
    image = draw(scene, planner.make_plan(scene, ir.Settings(size=size, samples=1, camera=camera, backend="ray")))
    return f"{name} {sets}", image.metadata["unproved"]


def test_there_are_scenes_with_formulas() -> None:
    assert {"vase", "vase.scene", "gear.scene", "formula.scene", "part.scene", "bracket.scene"} <= set(scenes())
    assert any(name.startswith("docs/language.md") for name in scenes())


@pytest.mark.long
def test_three_variations_have_no_unproved_ray(tmp_path: Path) -> None:
    numbers = range(1000, 1003)
    assert [found for found in (unproved(number, (80, 60), tmp_path) for number in numbers) if found[1]] == []


@pytest.mark.long
@pytest.mark.parametrize("part", range(20))
def test_two_hundred_variations_have_no_unproved_ray(part: int, tmp_path: Path) -> None:
    numbers = range(10 * part, 10 * part + 10)
    assert [found for found in (unproved(number, (400, 300), tmp_path) for number in numbers) if found[1]] == []
