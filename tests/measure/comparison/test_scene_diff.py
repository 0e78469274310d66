"""Changes between two versions of a scene, as whole lines."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.measure.comparison import scene_diff

SCENE = """\
param radius = 1 in 0.2..2
let grey = lambert(#808080)
sphere(radius, material: phong(#d0402a, specular: 0.5, shininess: 9), name: "ball")
for (k in 0..2) { box(0.1, translate: [k, 0, 0], material: grey) }
mesh(points: [[0,0,0],[1,0,0],[0,1,0]], faces: [[0,1,2]], material: grey)
point([2, 4, 3], intensity: 20)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 30deg)
render(samples: 4)
"""


@pytest.fixture
def told(tmp_path: Path):
    """Lines of what changed from SCENE to SCENE with replacements."""

    def tell(*replacements: tuple[str, str]) -> list[str]:
        text = SCENE
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        for name, content in (("a", SCENE), ("b", text)):
            (tmp_path / f"{name}.scene").write_text(content, encoding="utf-8")
        found, _ = scene_diff.diff(*(maquette.load(tmp_path / f"{name}.scene") for name in "ab"))
        return [str(change).replace(f"{tmp_path}/", "") for change in found]

    return tell


def test_nothing_changed(told) -> None:
    assert told() == []


def test_a_number_of_a_shape(told) -> None:
    assert told(("radius = 1", "radius = 1.5")) == [
        "changed params: radius 1 → 1.5",
        "changed shape sphere b.scene:3:1: parameters [1] → [1.5]",
    ]


def test_a_colour_changes_the_material_and_not_what_has_it(told) -> None:
    (line,) = told(("specular: 0.5", "specular: 0.25"))
    assert line == "changed material phong b.scene:3:26: specular [0.5 0.5 0.5] → [0.25 0.25 0.25]"


def test_another_material(told) -> None:
    lines = told(("faces: [[0,1,2]], material: grey", "faces: [[0,1,2]], material: lambert(#ffffff)"))
    assert lines == [
        "added material lambert b.scene:5:69",
        "changed mesh b.scene:5:1: material lambert a.scene:2:12 → lambert b.scene:5:69",
    ]


def test_moved_and_reshaped(told) -> None:
    assert told(("translate: [k, 0, 0]", "translate: [k, 0.5, 0]")) == [
        f"changed box b.scene:4:19: position [{k} 0 0] → [{k} 0.5 0]" for k in range(3)
    ]
    (line,) = told(("[0,1,0]]", "[0,2,0]]"))
    assert line == "changed shape mesh b.scene:5:1: vertices [0 0 0 1 0 0 0 1 0] → [0 0 0 1 0 0 0 2 0]"
    (line,) = told(("[0,1,0]]", "[0,1,0], [1,1,0]]"), ("[[0,1,2]]", "[[0,1,3,2]]"))
    assert line.startswith("changed shape mesh b.scene:5:1: vertices [0 0 0 1 0 0 0 1 0] → 4 #")
    assert "triangles [0 1 2] → [0 1 3 0 3 2]" in line


def test_added_and_removed(told) -> None:
    assert told(("0..2", "0..3")) == ["added box b.scene:4:19"]
    assert told(("0..2", "0..1")) == ["removed box a.scene:4:19"]
    assert told(("point([2, 4, 3], intensity: 20)", "sun()")) == ["added light sun b.scene:6:1", "removed light point a.scene:6:1"]


def test_the_camera_and_the_settings(told) -> None:
    assert told(("fov: 30deg", "fov: 60deg"), ("samples: 4", "samples: 8")) == [
        "changed render: samples 4 → 8",
        "changed camera b.scene:7:1: extent 0.26795 → 0.57735",
    ]


def test_lines_that_move_are_no_change(told) -> None:
    assert told(("sphere(radius", "\n\nsphere(radius")) == []


def test_a_texture_that_comes_and_goes(told) -> None:
    lines = told(("lambert(#808080)", "lambert(checker(#808080, #404040))"))
    assert "added texture checker b.scene:2:20" in lines
    (material,) = [line for line in lines if line.startswith("changed material lambert")]
    assert "diffuse nothing → texture checker b.scene:2:20" in material


def test_which_instance_became_which(tmp_path: Path) -> None:
    a, b = tmp_path / "a.scene", tmp_path / "b.scene"
    a.write_text('sphere(1, name: "one")\nbox(1)\nsphere(2)\n', encoding="utf-8")
    b.write_text('box(1)\nsphere(2)\ntorus(1, 0.2)\nsphere(1.5, name: "one", translate: [1, 0, 0])\n', encoding="utf-8")
    _, same = scene_diff.diff(maquette.load(a), maquette.load(b))
    assert same == {0: 3, 1: 0, 2: 1}


def test_plain_data(tmp_path: Path) -> None:
    a, b = tmp_path / "a.scene", tmp_path / "b.scene"
    a.write_text("sphere(1)\n", encoding="utf-8")
    b.write_text("sphere(2)\n", encoding="utf-8")
    found, _ = scene_diff.diff(maquette.load(a), maquette.load(b))
    (sphere,) = [change.to_json() for change in found if change.table == "geometries"]
    assert sphere == {
        "what": "changed", "table": "geometries", "row": 0, "label": "shape sphere", "place": f"{b}:1:1",
        "cells": [{"column": "parameters", "a": "[1]", "b": "[2]"}],
    }  # fmt: skip


SHAPE = st.sampled_from(["sphere(1)", "sphere(2)", "box(1)", 'box(1, name: "b")', "torus(1, 0.2)"])


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(st.lists(SHAPE, min_size=1, max_size=6), st.lists(SHAPE, min_size=1, max_size=6))
def test_each_row_is_told_once(tmp_path_factory: pytest.TempPathFactory, first: list[str], second: list[str]) -> None:
    folder = tmp_path_factory.mktemp("rows")
    scenes = []
    for name, shapes in (("a", first), ("b", second)):
        (folder / f"{name}.scene").write_text("\n".join([*shapes, "sun()", "camera([0, 0, 9])"]), encoding="utf-8")
        scenes.append(maquette.load(folder / f"{name}.scene"))
    found, same = scene_diff.diff(*scenes)
    told = [change.what for change in found if change.table == "instances"]
    assert told.count("added") == len(second) - len(same)
    assert told.count("removed") == len(first) - len(same)
    assert len(set(same.values())) == len(same)
    kinds = [[ir.GeometryKind(int(s.tables.geometries.kind[g])) for g in s.tables.instances.geometry] for s in scenes]
    assert all(kinds[0][x] == kinds[1][y] for x, y in same.items())
