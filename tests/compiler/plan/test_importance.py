"""The five decisions that matter most for a scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import importance, plan

BALL = "sphere(1)\npoint([2, 4, 3], intensity: 20)\n"
GLASS = "plane(y: -1)\nsphere(1, material: glass())\npoint([2, 4, 3], intensity: 20)\nsky()\n"
CAMERA = "camera(position: [0, 0, 5], look_at: [0, 0, 0]{0})\n"


def names(folder: Path, text: str, overrides: dict[str, str] | None = None, **settings: Any) -> list[str]:
    (folder / "a.scene").write_text(text + ("" if "camera(" in text else CAMERA.format("")), encoding="utf-8")
    found = plan.make_plan(maquette.load(folder / "a.scene"), ir.Settings(**settings), overrides or {})
    return [decision.name for decision in importance.most_important(found)]


@pytest.mark.parametrize(("text", "settings", "expected"), [
    (BALL, {}, ["backend", "samples", "shadows", "exposure", "size"]),
    (BALL, {"error": 0.01}, ["backend", "error", "shadows", "exposure", "size"]),
    (BALL, {"budget": 3.0, "backend": "raster"}, ["backend", "budget", "raster.secondary_rays", "raster.shadows", "shadows"]),
    (GLASS, {"bounces": 4}, ["backend", "error", "samples", "transport", "bounces"]),
    (GLASS, {"bounces": 4, "samples": 9}, ["backend", "samples", "transport", "bounces", "transport.caustics"]),
    (BALL + "implicit(|x, y, z| x^4 + y^4 + z^4 <= 1)\n", {}, ["backend", "samples", "implicit_surfaces", "shadows", "exposure"]),
    (BALL + CAMERA.format(", focal: 50mm, aperture: 1, focus: 5"), {}, ["backend", "samples", "lens", "shadows", "exposure"]),
])  # fmt: skip
def test_what_matters(tmp_path: Path, text: str, settings: dict[str, Any], expected: list[str]) -> None:
    assert names(tmp_path, text, **settings) == expected


def test_overridden_decisions_come_first(tmp_path: Path) -> None:
    assert names(tmp_path, BALL, {"accelerator": "bvh", "filter": "box"})[:3] == ["filter", "accelerator", "backend"]


def test_every_name_is_a_decision(tmp_path: Path) -> None:
    (tmp_path / "a.scene").write_text(BALL, encoding="utf-8")
    found = plan.make_plan(maquette.load(tmp_path / "a.scene"), ir.Settings(), {})
    assert set(importance.ORDER) <= set(found.decisions)
