"""What is told of light that a picture leaves out."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import omitted_light
from maquette.compiler.plan import plan as planner

SUN = "directional([0, 1, 0])\ncamera(position: [0, 3, 9], look_at: [0, 0, 0])\n"
FLOOR = "plane(y: -1, material: lambert(0.5))\n"
SENT = "light that diffuse surfaces send on is left out"


@pytest.mark.parametrize(
    ("text", "settings", "clauses"),
    [
        (FLOOR, {}, ()),  # a plane lights nothing
        (FLOOR + "sphere(1)\n", {}, (SENT,)),
        (FLOOR + "sphere(1)\n", {"bounces": 1}, ("light that bounces more than once is left out",)),
        (FLOOR + "sphere(1)\n", {"bounces": 4}, ("light that bounces more than 4 times is left out",)),
        (FLOOR + "sphere(1)\n", {"backend": "raster"}, (SENT,)),
        (FLOOR + "sphere(1, material: mirror())\n", {"backend": "raster"}, ("reflections of other objects are left out", SENT)),
        ("sphere(1, material: mirror())\n", {}, ("light that bounces more than 8 times is left out",)),
        ("sphere(1, material: emissive(1))\nbox(1, material: emissive(1))\n", {}, ()),
    ],
    ids=["plane", "default", "one bounce", "bounces", "raster", "raster's mirror", "mirror", "emissive"],
)
def test_clauses(tmp_path: Path, text: str, settings: dict[str, object], clauses: tuple[str, ...]) -> None:
    (tmp_path / "a.scene").write_text(text + SUN, encoding="utf-8")
    scene = maquette.load(tmp_path / "a.scene")
    plan = planner.make_plan(scene, ir.Settings(**settings))  # type: ignore[arg-type]
    found = omitted_light.clauses(scene, plan)
    assert tuple(clause for clause in found if "caustics" not in clause) == clauses
    limit = tuple(clause for clause in clauses if "more than" not in clause)
    assert tuple(clause for clause in omitted_light.unmeasured(scene, plan, True) if "caustics" not in clause) == limit


@pytest.mark.parametrize(
    ("error", "bias", "left_out", "whole", "words"),
    [
        (0.01, 0.0, (), 0.01, ""),
        (0.0, None, (SENT,), 0.0, f"of noise alone; {SENT}"),
        (0.03, 0.04, (), 0.05, "3.00% of noise, 4.0% of light beyond 8 bounces"),
        (0.03, 0.04, ("caustics are left out",), 0.05, "3.00% of noise, 4.0% of light beyond 8 bounces; caustics are left out"),
        (0.03, 0.0001, (), pytest.approx(0.03, rel=1e-4), ""),
        (None, None, (SENT,), None, f"of noise alone; {SENT}"),
    ],
)
def test_the_error_that_is_told(
    error: float | None, bias: float | None, left_out: tuple[str, ...], whole: float | None, words: str
) -> None:
    assert omitted_light.with_bias(error, bias) == whole
    assert omitted_light.phrase(error, bias, left_out, 8) == words
