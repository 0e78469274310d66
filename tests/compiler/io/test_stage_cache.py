"""Stages of a compilation are taken again where their inputs are the same, with the same scene and messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.io import stage_cache
from maquette.compiler.io.stage_cache import StageCache
from maquette.lang.diagnostics import Diagnostics
from PIL import Image

MESH = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 5\nf 1 1 2\n"  # the last face has no area
SCENE = """\
mesh("a.obj", material: lambert({color}))
sphere(1, center: [2, 0, 0], material: lambert(image("a.png")))
point([2, 4, 3], intensity: 20)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)
"""


def write(folder: Path, color: str = "#ff0000", mesh: str = MESH) -> Path:
    (folder / "a.obj").write_text(mesh, encoding="utf-8")
    Image.new("RGB", (4, 4), "#4080c0").save(folder / "a.png")
    (folder / "a.scene").write_text(SCENE.format(color=color), encoding="utf-8")
    return folder / "a.scene"


def loaded(scene: Path, cache: StageCache | None = None) -> tuple[Any, list[str]]:
    found = Diagnostics()
    if cache is None:
        return load.load(scene, diagnostics=found).tables, [item.message for item in found.items]
    with cache.compiling():
        return load.load(scene, diagnostics=found).tables, [item.message for item in found.items]


def same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    return one == other if not isinstance(one, tuple) else len(one) == len(other) and all(map(same, one, other))


def test_an_edit_of_a_material_reads_no_mesh_and_no_image_again(tmp_path: Path) -> None:
    cache = StageCache()
    first = loaded(write(tmp_path), cache)
    stages = ("read", "triangulated", "stored", "checked", "searched for seams")
    assert cache.made == {**{f"meshes {stage}": 1 for stage in stages}, "images read": 1}
    assert not cache.reused
    scene = write(tmp_path, "#00ff00")
    second = loaded(scene, cache)
    assert cache.reused == cache.made
    assert sum(cache.made.values()) == 6
    assert same(second, loaded(scene))
    assert second[1] == first[1] == ["1 of 3 faces have no area: they are left out"]
    assert not same(second[0], first[0])


def test_a_changed_mesh_is_read_again_and_the_old_one_is_dropped(tmp_path: Path) -> None:
    cache = StageCache()
    loaded(write(tmp_path), cache)
    scene = write(tmp_path, mesh=MESH + "v 0 0 2\nf 1 2 6\n")
    assert same(loaded(scene, cache), loaded(scene))
    assert cache.made["meshes read"] == 2
    loaded(write(tmp_path), cache)
    assert cache.made["meshes read"] == 3
    assert cache.made["images read"] == 1


def test_results_are_read_only_and_kept_after_an_exception() -> None:
    cache = StageCache()

    def make() -> tuple[np.ndarray, int]:
        return np.ones(3), 2

    with cache.compiling():
        array, _ = stage_cache.cached("ones", (np.zeros(2), "a", None), make)
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 2.0
    with pytest.raises(KeyError), cache.compiling():
        raise KeyError
    with cache.compiling():
        assert stage_cache.cached("ones", (np.zeros(2), "a", None), make)[0] is array
        assert stage_cache.cached("ones", (np.zeros(2, np.float32), "a", None), make)[0] is not array
    assert stage_cache.cached("ones", (np.zeros(2), "a", None), make)[0] is not array  # without a cache
    assert cache.made["ones"] == 2


@pytest.mark.parametrize(
    ("one", "other"),
    [((1,), (1.0,)), ((b"ab", b"c"), (b"a", b"bc")), (((1, 2), 3), (1, (2, 3))), ((np.zeros(2),), (np.zeros((2, 1)),)), (("1",), (1,))],
)
def test_different_inputs_have_different_digests(one: tuple[Any, ...], other: tuple[Any, ...]) -> None:
    assert stage_cache.digest(*one) != stage_cache.digest(*other)
