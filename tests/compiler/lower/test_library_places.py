"""Messages and rows of the library's elements point at the scene's call first."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.lang.diagnostics import Diagnostics, SceneError, render_text

REST = "\ncamera(position: [0, 0, 9], look_at: [0, 0, 0])\n"


@pytest.mark.long
def test_an_error_inside_of_the_library_points_at_the_call(tmp_path: Path) -> None:
    scene = tmp_path / "a.scene"
    scene.write_text('use "std/room"\nroom.table(at: [1e40, 0, 0])' + REST, encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        maquette.load(scene)
    (found,) = caught.value.diagnostics
    text = scene.read_text(encoding="utf-8")
    assert render_text(found, lambda name: text) == (
        f"{scene}:2:1: error: `translate` holds 1e+40: that is too big to be drawn (in room.table, std/room:100:55)\n"
        "   2 | room.table(at: [1e40, 0, 0])\n"
        "     | ^^^^^^^^^^ at most 1e+18"
    )


def test_the_calls_around_it_follow(tmp_path: Path) -> None:
    scene = tmp_path / "a.scene"
    scene.write_text('use "std/room"\nlet far() = room.table(at: [1e40, 0, 0])\nfar()' + REST, encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        maquette.load(scene)
    (found,) = caught.value.diagnostics
    assert str(found.span) == f"{scene}:2:13"
    assert [(name, str(span)) for name, span in found.trace] == [("far", f"{scene}:3:1")]


def test_rows_of_the_library_have_the_place_of_the_call(tmp_path: Path) -> None:
    scene = tmp_path / "a.scene"
    scene.write_text('use "std/shapes"\nuse "std/lights"\nshapes.column()\nlights.studio()' + REST, encoding="utf-8")
    found = Diagnostics()
    loaded = maquette.load(scene, diagnostics=found)
    assert not found.items
    for table, line in (("instances", 3), ("lights", 4)):
        places = {str(loaded.spans.get(table, row)) for row in range(len(getattr(loaded.tables, table)[0]))}
        assert f"{scene}:{line}:1" in places
        assert not [place for place in places if place.startswith("std/")]
