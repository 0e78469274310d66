"""Scenes without the geometry that takes long: the same diagnostics, boxes of the right size, and no work on meshes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.formula import dual_contouring
from maquette.compiler.io import stage_cache
from maquette.compiler.mesh import built_geometry, height_grids, mesh_csg, swept
from maquette.lang.diagnostics import Diagnostics, SceneError

REST = "\nsun()\ncamera(position: [0, 1, 6], look_at: [0, 0, 0])\n"
TEXT = 'text("Ag", size: 0.5, depth: 0.1)'


def read(tmp_path: Path, text: str, left_out: bool) -> tuple[Any, list[str]]:
    """The scene, or None, and its messages."""
    path, found = tmp_path / "a.scene", Diagnostics()
    path.write_text(text + REST, encoding="utf-8")
    try:
        if left_out:
            with built_geometry.left_out():
                return load.load(path, diagnostics=found), [d.message for d in found.items]
        return load.load(path, diagnostics=found), [d.message for d in found.items]
    except SceneError as error:
        return None, [d.message for d in error.diagnostics]


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise AssertionError("geometry is made")

    for module, name in (
        (dual_contouring, "within"), (height_grids, "surface"), (height_grids, "solid"), (swept, "extrude"), (swept, "sheet"),
        (mesh_csg, "union_of_outlines"), (mesh_csg, "mesh"),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, refuse)


@pytest.mark.parametrize(
    ("text", "size"),
    [
        (TEXT, (0.85, 0.5, 0.1)),
        ("heightfield(|x, z| 0.2 * sin(3 * x) * cos(4 * z), size: [2, 3], steps: 2000)", (2.0, 0.4, 3.0)),
        ("heightfield(|x, z| 0.2 * sin(3 * x), size: [2, 3], base: 1, steps: 2000)", (2.0, 1.2, 3.0)),
        (f"difference() {{ box([2, 1, 1]); {TEXT} }}", (2.0, 1.0, 1.0)),
        (f"union() {{ sphere(0.5); {TEXT} }}", (1.2, 1.0, 1.0)),
        (f"repeat(step: [2, 0, 0], count: 3) {{ union() {{ sphere(0.5); {TEXT} }} }}", (5.2, 1.0, 1.0)),
        ("union(round: 0.1) { box(1); sphere(0.6, center: [0, 0.5, 0]) }", (1.2, 1.6, 1.2)),
    ],
)
@pytest.mark.usefixtures("no_work")
def test_boxes_stand_for_what_takes_long(tmp_path: Path, text: str, size: tuple[float, ...]) -> None:
    scene, found = read(tmp_path, text, left_out=True)
    assert found == []
    bounds = scene.tables.geometries.bounds[scene.tables.instances.geometry[0]]
    np.testing.assert_allclose(bounds[1] - bounds[0], size, rtol=0.3)


@pytest.mark.parametrize(
    "text",
    [
        'text("字 A")',
        'text("")',
        'text("A", font: "nothing.ttf")',
        'heightfield("none.png", size: 1)',
        "heightfield(|x, z| sqrt(x), size: 2)",
        "heightfield([[0, 1], [1]])",
        f"union(round: 0.1) {{ box(1); {TEXT} }}",
        f"union() {{ plane(y: 0); {TEXT} }}",
        f"union() {{ box(1, material: lambert(0.2)); {TEXT[:-1]}, material: lambert(0.9)) }}",
        f"twist(90deg) {{ {TEXT} }}",
        "union() { plane(y: 0) }",
        "intersection() { box(1); box(1, center: [5, 0, 0]) }",
    ],
)
def test_the_diagnostics_are_those_of_a_scene_with_its_geometry(tmp_path: Path, text: str) -> None:
    found = read(tmp_path, text, left_out=True)[1]
    assert found == read(tmp_path, text, left_out=False)[1]
    assert found


def test_a_lamp_in_a_box_that_stands_for_a_text_is_no_mistake(tmp_path: Path) -> None:
    text = "heightfield(|x, z| x * x, size: 4, base: 1)\nlight(position: [0, 0.5, 0], intensity: 100)"
    assert read(tmp_path, text, left_out=True)[1] == read(tmp_path, text, left_out=False)[1]


@pytest.mark.long
def test_an_edit_makes_again_what_it_touches(tmp_path: Path) -> None:
    """A text is edited in a solid of a box, a ball and a rounded part: neither of these is made again, and nothing by a new colour."""
    cache = stage_cache.StageCache()

    def loaded(label: str, color: float) -> dict[str, int]:
        before = dict(cache.made)
        text = (
            f'difference(material: lambert({color})) {{ union(round: 0.1) {{ box(1); sphere(0.6, center: [0, 0.5, 0]) }};'
            f' text("{label}", size: 0.3, depth: 0.1, translate: [0, 0, 0.45]) }}'
        )
        with cache.compiling():
            assert read(tmp_path, text, left_out=False)[1] == []
        return {stage: count - before.get(stage, 0) for stage, count in cache.made.items() if count > before.get(stage, 0)}

    first = loaded("i", 0.5)
    assert first["surfaces contoured"] == first["edges rounded"] == first["texts outlined"] == first["solids combined"] == 1
    assert loaded("i", 0.6) == {}
    again = loaded("l", 0.6)
    assert "surfaces contoured" not in again
    assert "edges rounded" not in again
    assert again["texts outlined"] == again["solids combined"] == 1


@pytest.mark.long
def test_the_seconds_of_shapes_are_noted(tmp_path: Path) -> None:
    with built_geometry.recorded() as costs:
        read(tmp_path, f"difference() {{ union(round: 0.05) {{ box(0.4); sphere(0.3) }}; {TEXT} }}\nsphere(1)", left_out=False)
    (cost,) = costs
    assert (cost.kind, cost.span.line if cost.span else 0) == ("difference", 1)
    assert {what for what, _, _ in cost.parts} >= {"made into triangles", "combined", "outlined"}
    assert sum(seconds for _, _, seconds in cost.parts) <= cost.seconds
