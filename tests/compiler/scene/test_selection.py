"""Instances of a scene by name: a name stands for all below it."""

from __future__ import annotations

from pathlib import Path

import pytest
from maquette.compiler import load
from maquette.compiler.scene.selection import SelectionError, select
from maquette.compiler.scene.validate import validate
from maquette.lang.diagnostics import Diagnostics

SCENE = """\
group(name: "wheel") { sphere(1, name: "tyre"); box(1) }
box(2, name: "case")
box(3, name: "lid")
sphere(0.1, material: emissive(10), name: "glow")
"""


@pytest.fixture
def scene(tmp_path: Path):
    (tmp_path / "a.scene").write_text(SCENE, encoding="utf-8")
    return load.load(tmp_path / "a.scene")


@pytest.mark.parametrize(
    ("only", "without", "left"),
    [
        (["case"], [], ["case"]),
        (["wheel"], [], ["wheel/tyre", "wheel/box"]),
        (["*i*"], [], ["lid"]),
        (["case", "lid"], ["lid"], ["case"]),
        ([], ["wheel", "glow"], ["case", "lid"]),
    ],
)
def test_names_stand_for_what_is_below_them(scene, only: list[str], without: list[str], left: list[str]) -> None:
    found = select(scene, only, without)
    assert sorted(found.names.instances) == sorted(left)
    diagnostics = Diagnostics()
    validate(found, diagnostics)
    assert diagnostics.items == []
    rows = [scene.names.instances.index(name) for name in found.names.instances]
    assert [found.spans.get("instances", k) for k in range(len(rows))] == [scene.spans.get("instances", row) for row in rows]


@pytest.mark.parametrize(
    ("only", "without", "message"),
    [
        (["lit"], [], "no instance is called `lit`; did you mean `lid`?"),
        ([], ["xyzzy"], "no instance is called `xyzzy`; there are: case, glow, lid, wheel/box, wheel/tyre"),
        (["case"], ["case"], "no instance is left of the scene"),
    ],
)
def test_wrong_names(scene, only: list[str], without: list[str], message: str) -> None:
    with pytest.raises(SelectionError) as error:
        select(scene, only, without)
    assert str(error.value) == message
